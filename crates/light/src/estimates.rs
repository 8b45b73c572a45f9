//! Running estimates of a signal at many points, with their variance.
//!
//! A point's value is the mean of its batches (Welford 1962, one pass). The variance of that mean comes from
//! two sources: the spread of the batches, which says nothing from one batch and little from two, and what
//! the spread of yes-or-no rays of that mean would be. They are weighed like observations (a scaled
//! inverse-chi-square prior), so that few batches are judged by the second and many by the first; and the
//! second keeps a floor, because batches that all agree have no spread, yet may all have missed the same
//! small occluder.
//!
//! Light has no range that would say what spread to expect, and its noise differs by orders of magnitude between
//! places. What is expected of a point is what its neighbours in the order of points show (samples and texels come
//! triangle by triangle and row by row), or what all points show, if that is more.

use lightkiln_mesh::SurfacePoint;
use rayon::prelude::*;

use crate::{Domain, Signal};

/// How many batches the expected spread counts for.
const PRIOR_BATCHES: f64 = 4.0;
/// The spread of a batch expected before it is seen, relative to that of independent yes-or-no rays: less
/// than 1, because the rays of a batch are stratified, by as much as they are for the most broken occluders.
const PRIOR_GAIN: f64 = 0.85;
/// The part of a stratum (a share of 1 / rays) that stratification cannot know however regular the occluder:
/// what covers less than a stratum is met as if rays were independent, what covers more has an edge.
const LEAST_STRATA: f64 = 0.7;
/// The same for light.
const PRIOR_BATCHES_OF_LIGHT: f64 = 6.0;
/// The share of the spread of all points that a dark point is not trusted with.
const DARK_SHARE: f64 = 0.01;
/// Neighbours on either side.
const NEIGHBOURS: usize = 4;
/// Points that a thread works on at a time: large enough to hide the hand-over, small enough to balance.
const CHUNK: usize = 64;
/// Backs seen first in this share of directions mean that a point lies inside other geometry.
const INSIDE: f32 = 0.7;

/// Running estimates of many points: flat arrays, points x channels.
///
/// Memory: `8 channels + 3` bytes a point; `4 channels` more in halves.
#[derive(Clone, Debug, PartialEq)]
pub struct Estimates {
    /// Numbers a point.
    pub channels: usize,
    mean: Vec<f32>,
    /// Sum of squared differences of the batches from their mean.
    m2: Vec<f32>,
    /// Mean of every second batch from the first on; empty where nobody asks for halves.
    even: Vec<f32>,
    batches: Vec<u16>,
    /// Share of backs seen first, in 255ths.
    backs: Vec<u8>,
    rays_per_batch: u32,
    spreads: Vec<Expected>,
}

/// What the spread of a channel is expected to be before a point has shown its own.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Expected {
    /// That of so many yes-or-no rays between two numbers.
    Rays { low: f32, high: f32, rays: u32 },
    /// What the other points have: the mean variance of a batch, if any has two, and the mean value.
    Pooled { variance: Option<f64>, mean: f64 },
}

impl Estimates {
    /// No batches yet.
    pub fn new(points: usize, channels: usize) -> Self {
        Self {
            channels,
            mean: vec![0.0; points * channels],
            m2: vec![0.0; points * channels],
            even: Vec::new(),
            batches: vec![0; points],
            backs: vec![0; points],
            rays_per_batch: 0,
            spreads: vec![Expected::Rays { low: 0.0, high: 1.0, rays: 0 }; channels],
        }
    }

    /// The same, which keep apart what even and odd batches bring: for filters that are judged by how much their results
    /// from two halves differ.
    pub fn in_halves(points: usize, channels: usize) -> Self {
        Self { even: vec![0.0; points * channels], ..Self::new(points, channels) }
    }

    /// Adds batches until point `i` has `wanted[i]` of them; points that have more keep them.
    ///
    /// Parallel over chunks of points. A point's result depends on its key and the number of its batches only,
    /// not on threads, nor on how many calls it took.
    ///
    /// # Panics
    /// Where the lengths of the slices or the signal's channels do not fit these estimates: that is a mistake
    /// of the caller, not of the input.
    pub fn refine(&mut self, signal: &dyn Signal, points: &[SurfacePoint], keys: &[u64], wanted: &[u16]) {
        let (count, channels) = (self.batches.len(), self.channels);
        assert!(signal.channels() == channels, "a signal of {} channels for {channels}", signal.channels());
        assert!(points.len() == count && keys.len() == count && wanted.len() == count, "one of each a point");
        self.rays_per_batch = signal.rays_per_batch();
        if channels == 0 {
            return;
        }
        let mut even: Vec<&mut [f32]> = self.even.chunks_mut(CHUNK * channels).collect();
        even.resize_with(count.div_ceil(CHUNK), Default::default);
        self.mean
            .par_chunks_mut(CHUNK * channels)
            .zip(self.m2.par_chunks_mut(CHUNK * channels))
            .zip(self.batches.par_chunks_mut(CHUNK).zip(self.backs.par_chunks_mut(CHUNK)))
            .zip(even)
            .enumerate()
            .for_each_init(
                || vec![0.0; channels],
                |values, (chunk, (((mean, m2), (batches, backs)), even))| {
                    for (i, (batches, back)) in batches.iter_mut().zip(backs).enumerate() {
                        let point = chunk * CHUNK + i;
                        let own = i * channels..(i + 1) * channels;
                        let (mean, m2) = (&mut mean[own.clone()], &mut m2[own.clone()]);
                        let mut even = even.get_mut(own);
                        while *batches < wanted[point] {
                            let share = signal.batch(points[point], keys[point], u32::from(*batches), values);
                            if *batches == 0 {
                                *back = (share.clamp(0.0, 1.0) * 255.0).round() as u8;
                            }
                            *batches += 1;
                            add(mean, m2, values, *batches);
                            if let Some(even) = even.as_mut().filter(|_| *batches % 2 == 1) {
                                add_to_mean(even, values, batches.div_ceil(2));
                            }
                        }
                    }
                },
            );
        self.spreads = self.expected_spreads(signal);
    }

    /// What is known of the spreads by now. One thread sums in a fixed order.
    fn expected_spreads(&self, signal: &dyn Signal) -> Vec<Expected> {
        let layers = signal.layers().iter().enumerate();
        let channels = layers.flat_map(|(number, l)| std::iter::repeat_n((number, l.domain), l.channels));
        channels
            .enumerate()
            .map(|(channel, (layer, domain))| match domain {
                Domain::Bounded { low, high } => {
                    Expected::Rays { low, high, rays: signal.rays_of_layer(layer) }
                }
                Domain::Hdr | Domain::SignedHdr => self.pooled_spread(channel),
            })
            .collect()
    }

    fn pooled_spread(&self, channel: usize) -> Expected {
        let (mut variance, mut spread, mut sum, mut lit) = (0.0_f64, 0.0_f64, 0.0_f64, 0.0_f64);
        for (point, &batches) in self.batches.iter().enumerate().filter(|(_, b)| **b > 0) {
            let at = point * self.channels + channel;
            sum += f64::from(self.mean[at]).abs();
            lit += 1.0;
            if batches > 1 {
                variance += f64::from(self.m2[at]) / (f64::from(batches) - 1.0);
                spread += 1.0;
            }
        }
        Expected::Pooled {
            variance: (spread > 0.0).then(|| variance / spread),
            mean: if lit > 0.0 { sum / lit } else { 0.0 },
        }
    }

    /// Variance of a batch among the neighbours of a point; 0 where none has two batches.
    fn spread_around(&self, i: usize, channel: usize) -> f64 {
        let (mut m2, mut freedom) = (0.0, 0.0);
        for j in i.saturating_sub(NEIGHBOURS)..(i + NEIGHBOURS + 1).min(self.batches.len()) {
            if j != i && self.batches[j] > 1 {
                m2 += f64::from(self.m2[j * self.channels + channel]);
                freedom += f64::from(self.batches[j]) - 1.0;
            }
        }
        if freedom > 0.0 { m2 / freedom } else { 0.0 }
    }

    /// The same estimates for other points: point `i` continues point `from[i]` of these, or starts anew.
    ///
    /// # Panics
    /// When `from` names a point that is not there.
    pub fn rearranged(&self, from: &[Option<u32>]) -> Self {
        let mut out = Self {
            rays_per_batch: self.rays_per_batch,
            spreads: self.spreads.clone(),
            even: vec![0.0; if self.even.is_empty() { 0 } else { from.len() * self.channels }],
            ..Self::new(from.len(), self.channels)
        };
        for (to, from) in from.iter().enumerate() {
            let Some(from) = from.map(|f| f as usize) else { continue };
            let channels = self.channels;
            let (to_row, from_row) =
                (to * channels..(to + 1) * channels, from * channels..(from + 1) * channels);
            out.mean[to_row.clone()].copy_from_slice(&self.mean[from_row.clone()]);
            out.m2[to_row.clone()].copy_from_slice(&self.m2[from_row.clone()]);
            if !self.even.is_empty() {
                out.even[to_row].copy_from_slice(&self.even[from_row]);
            }
            out.batches[to] = self.batches[from];
            out.backs[to] = self.backs[from];
        }
        out
    }

    /// Number of points.
    pub fn len(&self) -> usize {
        self.batches.len()
    }

    /// No points at all.
    pub fn is_empty(&self) -> bool {
        self.batches.is_empty()
    }

    /// The values of a point; zeros before its first batch.
    #[inline]
    pub fn mean(&self, i: usize) -> &[f32] {
        &self.mean[i * self.channels..(i + 1) * self.channels]
    }

    /// All values, points x channels.
    pub fn means(&self) -> &[f32] {
        &self.mean
    }

    /// The means of even and of odd batches, points x channels each: their noise is independent. A point with one batch has
    /// it twice. `None` of estimates that are not kept [`Self::in_halves`].
    pub fn halves(&self) -> Option<[Vec<f32>; 2]> {
        if self.even.is_empty() && !self.mean.is_empty() {
            return None;
        }
        let odd = |(at, (&mean, &even)): (usize, (&f32, &f32))| {
            let batches = self.batches[at / self.channels];
            let of_odd = f32::from(batches / 2);
            if batches < 2 { mean } else { mean + (mean - even) * f32::from(batches.div_ceil(2)) / of_odd }
        };
        let odd = self.mean.iter().zip(&self.even).enumerate().map(odd).collect();
        Some([self.even.clone(), odd])
    }

    /// Variance of a point's value around the truth; infinite before the first batch.
    ///
    /// Never zero for bounded values: rays that all agree leave a sigma of about 1.4 / rays of the range. That of light
    /// is zero only where all points are dark, or no ray of any batch differs, as under one hard light.
    pub fn variance_of_mean(&self, i: usize, channel: usize) -> f32 {
        let batches = f64::from(self.batches[i]);
        if batches == 0.0 {
            return f32::INFINITY;
        }
        let at = i * self.channels + channel;
        let m2 = f64::from(self.m2[at]);
        let weighed = |prior: f64, expected: f64| (prior * expected + m2) / (prior + batches - 1.0) / batches;
        let variance = match self.spreads[channel] {
            Expected::Rays { low, high, rays } => {
                let (low, high) = (f64::from(low), f64::from(high));
                let extent = high - low;
                let rays = f64::from(rays);
                // The share of rays that say yes, drawn to the middle by two of each (Agresti and Coull 1998).
                let yes = ((f64::from(self.mean[at]) - low) / extent).clamp(0.0, 1.0) * rays * batches;
                let share = (yes + 2.0) / (rays * batches + 4.0);
                let independent = share * (1.0 - share);
                let unit = extent * extent / rays;
                let least = independent.min(LEAST_STRATA / rays) * unit;
                weighed(PRIOR_BATCHES, (PRIOR_GAIN * independent * unit).max(least)).max(least / batches)
            }
            Expected::Pooled { variance: None, mean } => f64::from(self.mean[at]).powi(2) + mean * mean,
            Expected::Pooled { variance: Some(variance), mean } => {
                // Noise of light grows with the light: in between, its variance is about proportional to it. A point
                // in the dark may have missed the light: it keeps a little of what others have.
                let own = f64::from(self.mean[at]).abs();
                let share = if mean > 0.0 { own / mean } else { 0.0 } + DARK_SHARE / batches;
                let expected = self.spread_around(i, channel).max(variance * share);
                // A point that shows more than is expected is believed.
                let shown = if batches > 1.0 { m2 / (batches - 1.0) } else { 0.0 };
                weighed(PRIOR_BATCHES_OF_LIGHT, expected).max(shown / batches)
            }
        };
        variance as f32
    }

    /// Variance of a point's value from the spread of its batches alone: right on average over many points, where
    /// [`Self::variance_of_mean`] is careful with each. 0 with fewer than two batches.
    pub fn spread_variance_of_mean(&self, i: usize, channel: usize) -> f32 {
        let batches = f32::from(self.batches[i]);
        if batches < 2.0 {
            return 0.0;
        }
        self.m2[i * self.channels + channel] / ((batches - 1.0) * batches)
    }

    /// Batches that a point has.
    #[inline]
    pub fn batches(&self, i: usize) -> u16 {
        self.batches[i]
    }

    /// Whether a point's value means anything: it has a batch, and does not lie inside other geometry.
    ///
    /// Inside closed geometry nearly every ray first meets the back of a triangle. A car's interior, seen
    /// through panels of a single layer, still has windows, seats and double-sided materials in view, so the
    /// rule is a share: a point is inside if at least 0.7 of the rays of batch 0 meet an opaque single-sided
    /// back first.
    #[inline]
    pub fn valid(&self, i: usize) -> bool {
        self.batches[i] > 0 && f32::from(self.backs[i]) < INSIDE * 255.0
    }

    /// Rays so far: batches times rays of a batch, over all points.
    pub fn rays(&self) -> u64 {
        self.batches.iter().map(|&b| u64::from(b)).sum::<u64>() * u64::from(self.rays_per_batch)
    }
}

fn add_to_mean(mean: &mut [f32], values: &[f32], batches: u16) {
    for (mean, &value) in mean.iter_mut().zip(values) {
        *mean += (value - *mean) / f32::from(batches);
    }
}

fn add(mean: &mut [f32], m2: &mut [f32], values: &[f32], batches: u16) {
    for ((mean, m2), &value) in mean.iter_mut().zip(m2).zip(values) {
        let before = value - *mean;
        *mean += before / f32::from(batches);
        *m2 += before * (value - *mean);
    }
}

#[cfg(test)]
mod tests {
    use lightkiln_mesh::TriangleId;

    use super::*;
    use crate::Layer;

    /// Batch `k` brings `key + k`.
    struct Counting([Layer; 1]);

    impl Signal for Counting {
        fn layers(&self) -> &[Layer] {
            &self.0
        }
        fn rays_per_batch(&self) -> u32 {
            1
        }
        fn batch(&self, _: SurfacePoint, key: u64, batch: u32, out: &mut [f32]) -> f32 {
            out.fill(key as f32 + batch as f32);
            0.0
        }
    }

    #[test]
    fn halves_are_the_means_of_even_and_odd_batches_and_change_nothing_else() {
        let signal = Counting([Layer { domain: Domain::Hdr, channels: 3, ..Layer::scalar("light") }]);
        let points = vec![SurfacePoint { triangle: TriangleId(0), barycentric: [0.2, 0.2] }; 150];
        let keys: Vec<u64> = (0..150).collect();
        let wanted: Vec<u16> = (0..150).map(|i| i % 7).collect();
        let mut halved = Estimates::in_halves(150, 3);
        let some: Vec<u16> = wanted.iter().map(|w| w / 2).collect();
        halved.refine(&signal, &points, &keys, &some);
        halved.refine(&signal, &points, &keys, &wanted);
        let mut whole = Estimates::new(150, 3);
        whole.refine(&signal, &points, &keys, &wanted);
        assert_eq!(whole.halves(), None);
        assert_eq!(Estimates { even: Vec::new(), ..halved.clone() }, whole);
        let order: Vec<Option<u32>> = (0..150).rev().map(Some).collect();
        for (estimates, at) in
            [(halved.clone(), (|i| i) as fn(usize) -> usize), (halved.rearranged(&order), |i| 149 - i)]
        {
            let [even, odd] = estimates.halves().expect("halves");
            for i in 0..150 {
                let batches = wanted[at(i)];
                let mean = |first: u16| {
                    let own: Vec<f32> = (first..batches).step_by(2).map(f32::from).collect();
                    at(i) as f32 + own.iter().sum::<f32>() / own.len() as f32
                };
                let expected = match batches {
                    0 => [0.0; 2],
                    1 => [mean(0); 2],
                    _ => [mean(0), mean(1)],
                };
                for (half, expected) in [&even, &odd].into_iter().zip(expected) {
                    assert!((half[3 * i + 2] - expected).abs() < 1e-3, "{i}: {} {expected}", half[3 * i + 2]);
                }
            }
        }
    }
}
