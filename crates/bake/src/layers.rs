//! The layers of a bake: what their stored values mean, and what an error in them is.
//!
//! From here on light is in *unit values*, `0..=1` over the range of its layer ([`Scale`]). The range of light
//! without an upper end is found in the first look at the samples. One bound serves all layers: values are *judged* in the
//! unit of the bound, an error is a difference of judged values, and that of a point is its largest. What is judged are
//! the channels of the layers, in the layer's own unit, but of harmonics what they are for ([`harmonics`](crate::harmonics)).

mod units;

use std::ops::Range;

use glam::Vec3;
use lightkiln_light::harmonics::basis;
use lightkiln_light::{Curve, Domain, Estimates, Layer, Scale, Signal};

pub use self::units::{NoisyLayer, UnitLight};

use crate::harmonics::{Harmonics, JUDGED, baked, normals};
use crate::options::{BakeBounds, CONFIDENCE};

/// A layer with its scale.
#[derive(Clone, Debug, PartialEq)]
pub struct BakedLayer {
    /// What it is.
    pub layer: Layer,
    /// What its stored values mean.
    pub scale: Scale,
    /// What shown values are clamped to after interpolation, in the signal's unit: narrower than the range. `None` where
    /// values need no clamping.
    pub clamp: Option<[f32; 2]>,
    /// The first of its channels among those of the bake.
    pub first: usize,
}

impl BakedLayer {
    /// Its channels among those of the bake.
    pub fn channels(&self) -> Range<usize> {
        self.first..self.first + self.layer.channels
    }

    /// [`Self::clamp`] in unit values.
    pub fn unit_clamp(&self) -> Option<[f32; 2]> {
        self.clamp.map(|ends| ends.map(|x| self.scale.to_unit(x)))
    }

    /// Unit values in one unit of error: errors are shares of what is shown, not of what could be stored.
    pub fn error_unit(&self) -> f32 {
        match (self.unit_clamp(), self.scale.curve) {
            (Some([low, high]), Curve::Linear) => high - low,
            _ => self.scale.error_unit(),
        }
    }

    /// Whether its signal has a range of its own.
    pub fn is_bounded(&self) -> bool {
        matches!(self.layer.domain, Domain::Bounded { .. })
    }

    /// Whether it is light that paths bring, which is noisier than what rays see or do not see.
    fn is_light(&self) -> bool {
        matches!(self.layer.domain, Domain::Hdr | Domain::SignedHdr)
    }
}

/// All layers of a bake.
#[derive(Clone, Debug, PartialEq)]
pub struct Layers {
    /// In the order of their attributes.
    pub layers: Vec<BakedLayer>,
    /// Scale of each channel.
    scales: Vec<Scale>,
    /// What shown unit values are clamped to, by channel.
    clamps: Vec<Option<[f32; 2]>>,
    /// Channels that are judged as they are, and errors per unit value of each.
    plain: Vec<(usize, f32)>,
    /// Harmonics, and the scale that `E(n)` is judged on.
    harmonics: Vec<(Harmonics, Scale)>,
    /// What is judged together.
    parts: Vec<Part>,
}

/// What is judged of a layer, or of the layers of harmonics.
#[derive(Clone, Debug, PartialEq)]
pub struct Part {
    /// The layer's name, of harmonics without a number.
    pub name: String,
    /// Which of the judged values.
    pub judged: Range<usize>,
}

/// How far values that are clamped after interpolation may lie beyond the range of their signal, as a share of it, to
/// either side: docs/KAVAN.md has the measurements.
const MARGIN: f32 = 0.25;

/// White is what so much of the lit surface does not exceed.
const WHITE_QUANTILE: f64 = 0.95;

/// What the filter leaves of the noise of light, about.
const FILTER_GAIN: f32 = 0.25;

/// The range of light goes up to its brightest sample times this: texels between samples may be brighter.
const HEADROOM: f32 = 2.0;

impl Layers {
    /// Finds the scales of a signal's layers from a first look at it.
    ///
    /// - `weights`: of each point, 0 for those that do not count
    /// - `white`: what counts as white in the unit of the light; the 95th percentile of the lit surface if none
    /// - `bounds`: whether layers with a range are clamped after interpolation
    pub fn new(
        signal: &dyn Signal,
        seen: &Estimates,
        weights: &[f32],
        white: Option<f32>,
        bounds: BakeBounds,
    ) -> Self {
        let layers = baked(signal);
        let harmonics = Harmonics::of(layers.iter());
        let of_harmonics = |number: usize| harmonics.iter().any(|h| h.layers.contains(&number));
        let mut first = 0;
        let firsts: Vec<usize> = layers
            .iter()
            .map(|layer| {
                first += layer.channels;
                first - layer.channels
            })
            .collect();
        let white = white.unwrap_or_else(|| {
            let numbered = layers.iter().zip(&firsts).enumerate();
            let unbounded = numbered.filter(|(n, (l, _))| l.domain == Domain::Hdr && !of_harmonics(*n));
            let of_layers = unbounded.map(|(_, (l, &first))| white_of(seen, weights, first, l.channels));
            // Of harmonics the irradiance at the shading normal counts, the first that is measured behind the layers.
            let of_harmonics = (0..harmonics.len()).map(|h| white_of(seen, weights, first + h * JUDGED, 3));
            of_layers.chain(of_harmonics).fold(0.0, f32::max)
        });
        let white = if white > 0.0 && white.is_finite() { white } else { 1.0 };
        let scale = |number: usize, layer: &Layer, first: usize| {
            // Coefficients are stored on the scale of the first, which is this much larger than white where all is white.
            let white = if of_harmonics(number) { white / first_basis() } else { white };
            match layer.domain {
                Domain::Bounded { low, high } => {
                    let margin = if bounds == BakeBounds::ClampAfter { MARGIN * (high - low) } else { 0.0 };
                    Scale::linear(low - margin, high + margin)
                }
                Domain::Hdr => {
                    Scale::log(white, 0.0, HEADROOM * brightest(seen, first, layer.channels).max(white))
                }
                Domain::SignedHdr => {
                    let high = HEADROOM * brightest(seen, first, layer.channels).max(white);
                    Scale::log(white, -high, high)
                }
            }
        };
        let clamp = |layer: &Layer| match layer.domain {
            Domain::Bounded { low, high } if bounds == BakeBounds::ClampAfter => Some([low, high]),
            _ => None,
        };
        let baked = layers.iter().zip(&firsts).enumerate().map(|(number, (l, &first))| BakedLayer {
            layer: l.clone(),
            scale: scale(number, l, first),
            clamp: clamp(l),
            first,
        });
        Self::of(baked.collect())
    }

    /// Layers whose scales are known.
    pub fn of(layers: Vec<BakedLayer>) -> Self {
        let channels = || layers.iter().flat_map(|l| std::iter::repeat_n(l, l.layer.channels));
        let scales: Vec<Scale> = channels().map(|l| l.scale).collect();
        let clamps = channels().map(BakedLayer::unit_clamp).collect();
        let judged_scale = |harmonics: Harmonics| match scales[harmonics.channel(0, 0)].curve {
            Curve::Log { white } => {
                let white = white * first_basis();
                Some((harmonics, Scale::log(white, 0.0, white)))
            }
            Curve::Linear => None,
        };
        let harmonics: Vec<(Harmonics, Scale)> =
            Harmonics::of(layers.iter().map(|l| &l.layer)).into_iter().filter_map(judged_scale).collect();
        let (mut plain, mut parts) = (Vec::new(), Vec::new());
        for (number, layer) in layers.iter().enumerate() {
            if !harmonics.iter().any(|(h, _)| h.layers.contains(&number)) {
                let first = plain.len();
                plain.extend(layer.channels().map(|channel| (channel, 1.0 / layer.error_unit())));
                parts.push(Part { name: layer.layer.name.clone(), judged: first..plain.len() });
            }
        }
        for number in 0..harmonics.len() {
            let first = plain.len() + number * JUDGED;
            parts.push(Part { name: "irradianceSh".to_owned(), judged: first..first + JUDGED });
        }
        Self { layers, scales, clamps, plain, harmonics, parts }
    }

    /// Whether a signal measures what these layers hold and are judged by.
    pub fn fit(&self, signal: &dyn Signal) -> bool {
        signal.channels() == self.channels() + self.harmonics.len() * JUDGED
    }

    /// What is judged, layer by layer.
    pub fn parts(&self) -> &[Part] {
        &self.parts
    }

    /// How many values of a point are judged.
    pub fn judged(&self) -> usize {
        self.plain.len() + self.harmonics.len() * JUDGED
    }

    /// Calls `visit` with the number and the value of everything that is judged at a point, in the unit of the bound.
    ///
    /// - `normal`: the shading normal there
    #[inline]
    pub fn each_judged(&self, normal: Vec3, units: &[f32], mut visit: impl FnMut(usize, f32)) {
        for (number, &(channel, errors)) in self.plain.iter().enumerate() {
            visit(number, units[channel] * errors);
        }
        if self.harmonics.is_empty() {
            return;
        }
        let mut number = self.plain.len();
        let normals = normals(normal);
        for (harmonics, scale) in &self.harmonics {
            let lux = |channel: usize| self.scales[channel].from_unit(units[channel]);
            for irradiance in harmonics.irradiance(normals, lux) {
                for color in irradiance.to_array() {
                    visit(number, scale.to_unit(color.max(0.0)));
                    number += 1;
                }
            }
        }
    }

    /// Numbers of a point, over all layers.
    pub fn channels(&self) -> usize {
        self.scales.len()
    }

    /// Clamps what was interpolated, in the layers that ask for it.
    #[inline]
    pub fn clamp(&self, shown: &mut [f32]) {
        for (value, clamp) in shown.iter_mut().zip(&self.clamps) {
            if let Some(ends) = *clamp {
                *value = lightkiln_encode::clamp(*value, ends);
            }
        }
    }

    /// The largest error of what is shown at a point, and the noise that goes with it.
    pub fn worst(&self, shown: &[f32], light: &UnitLight, i: usize) -> (f32, f32) {
        self.worst_of(0..self.judged(), shown, light, i)
    }

    /// The same of a part alone.
    pub fn worst_of(&self, part: Range<usize>, shown: &[f32], light: &UnitLight, i: usize) -> (f32, f32) {
        let mut worst = (0.0_f32, 0.0);
        self.each_error(shown, light, i, |number, error, sigma| {
            if number == part.start || part.contains(&number) && error.abs() > worst.0.abs() {
                worst = (error, sigma);
            }
        });
        worst
    }

    /// The largest error of what is shown at a point with this shading normal, against light of unit values without noise.
    pub fn difference(&self, normal: Vec3, shown: &[f32], light: &[f32]) -> f32 {
        let mut judged = vec![0.0; self.judged()];
        self.each_judged(normal, light, |number, value| judged[number] = value);
        let mut worst = 0.0_f32;
        self.each_judged(normal, shown, |number, value| {
            let error = value - judged[number];
            worst = if error.abs() > worst.abs() { error } else { worst };
        });
        worst
    }

    /// Whether anything is off by more than a bound, beyond its noise.
    pub fn is_beyond(&self, shown: &[f32], light: &UnitLight, i: usize, bound: f32) -> bool {
        let mut beyond = false;
        self.each_error(shown, light, i, |_, error, sigma| {
            beyond |= error.abs() - CONFIDENCE * sigma > bound
        });
        beyond
    }

    /// Everything that is judged at a point: its number, its error and its noise.
    #[inline]
    pub fn each_error(
        &self,
        shown: &[f32],
        light: &UnitLight,
        i: usize,
        mut visit: impl FnMut(usize, f32, f32),
    ) {
        let (judged, sigmas) = (light.judged(i), light.sigma(i));
        self.each_judged(light.normals[i], shown, |number, value| {
            visit(number, value - judged[number], sigmas[number]);
        });
    }

    /// How large the noise of a point may be as an error, relative to that of a layer that is not filtered.
    pub fn noise_of(&self, estimates: &Estimates, i: usize) -> f32 {
        let mut most = 0.0_f32;
        for layer in &self.layers {
            let share = if layer.is_light() { FILTER_GAIN } else { 1.0 };
            for &(channel, errors) in self.plain.iter().filter(|(c, _)| layer.channels().contains(c)) {
                let slope = self.scales[channel].slope(estimates.mean(i)[channel]);
                most = most.max(share * estimates.variance_of_mean(i, channel).sqrt() * slope * errors);
            }
        }
        let judged = self.harmonics.iter().flat_map(|(_, scale)| std::iter::repeat_n(scale, JUDGED));
        for (channel, scale) in (self.channels()..).zip(judged) {
            let slope = scale.slope(estimates.mean(i)[channel].max(0.0));
            most = most.max(FILTER_GAIN * estimates.variance_of_mean(i, channel).sqrt() * slope);
        }
        most
    }

    /// The signal's own value of a stored one.
    pub fn from_unit(&self, channel: usize, unit: f32) -> f32 {
        self.scales[channel].from_unit(unit)
    }

    /// The stored value of a signal's own.
    pub fn to_unit(&self, channel: usize, x: f32) -> f32 {
        self.scales[channel].to_unit(x)
    }

    /// What a plain viewer shows of a stored value: the share of the range that a bounded layer shows, light as a share
    /// of white.
    pub fn displayed(&self, channel: usize, unit: f32) -> f32 {
        let scale = &self.scales[channel];
        match scale.curve {
            Curve::Linear => match self.clamps[channel] {
                Some([low, high]) => ((unit - low) / (high - low)).clamp(0.0, 1.0),
                None => unit,
            },
            Curve::Log { white } => (scale.from_unit(unit) / white).clamp(0.0, 1.0),
        }
    }
}

/// The brightest channel of a quantile of the lit surface.
fn white_of(seen: &Estimates, weights: &[f32], first: usize, channels: usize) -> f32 {
    let value = |i: usize| seen.mean(i)[first..first + channels].iter().copied().fold(0.0, f32::max);
    let mut lit: Vec<(f32, f32)> =
        (0..seen.len()).map(|i| (value(i), weights[i])).filter(|(v, w)| *v > 0.0 && *w > 0.0).collect();
    lit.sort_unstable_by(|a, b| a.0.total_cmp(&b.0));
    let total: f64 = lit.iter().map(|(_, w)| f64::from(*w)).sum();
    let mut so_far = 0.0;
    let at = lit.iter().find(|(_, w)| {
        so_far += f64::from(*w);
        so_far >= WHITE_QUANTILE * total
    });
    at.map_or(0.0, |(v, _)| *v)
}

fn brightest(seen: &Estimates, first: usize, channels: usize) -> f32 {
    let of = |i: usize| seen.mean(i)[first..first + channels].iter().fold(0.0_f32, |m, v| m.max(v.abs()));
    (0..seen.len()).map(of).filter(|v| v.is_finite()).fold(0.0, f32::max)
}

/// What the first of the harmonics is in every direction.
fn first_basis() -> f32 {
    basis(Vec3::Y)[0]
}

#[cfg(test)]
mod tests {
    use lightkiln_mesh::{SurfacePoint, TriangleId};

    use super::*;

    /// Values that a key names.
    struct Known(Vec<Layer>);

    impl Signal for Known {
        fn layers(&self) -> &[Layer] {
            &self.0
        }
        fn rays_per_batch(&self) -> u32 {
            16
        }
        fn batch(&self, _: SurfacePoint, key: u64, _: u32, out: &mut [f32]) -> f32 {
            out.iter_mut().enumerate().for_each(|(c, v)| *v = key as f32 * (c + 1) as f32);
            0.0
        }
    }

    fn seen(signal: &Known, points: u64) -> Estimates {
        let at = SurfacePoint { triangle: TriangleId(0), barycentric: [0.2, 0.2] };
        let mut estimates = Estimates::new(points as usize, signal.channels());
        let keys: Vec<u64> = (1..=points).collect();
        estimates.refine(signal, &vec![at; points as usize], &keys, &vec![2; points as usize]);
        estimates
    }

    /// One point with known light.
    fn known(layers: &Layers, values: &[f32], sigmas: Vec<f32>) -> UnitLight {
        let mut judged = vec![0.0; layers.judged()];
        layers.each_judged(Vec3::Y, values, |number, value| judged[number] = value);
        UnitLight { channels: values.len(), values: values.to_vec(), normals: vec![Vec3::Y], judged, sigmas }
    }

    #[test]
    fn layers_of_light_take_white_from_the_lit_surface_and_keep_headroom() {
        let light = Layer { channels: 3, domain: Domain::Hdr, ..Layer::scalar("irradiance") };
        let signal = Known(vec![Layer::scalar("ambientOcclusion"), light]);
        let estimates = seen(&signal, 100);
        let layers = Layers::new(&signal, &estimates, &[1.0; 100], None, BakeBounds::Optimum);
        assert_eq!(layers.layers[0].scale, Scale::UNIT);
        assert_eq!(layers.layers[1].channels(), 1..4);
        // The brightest channel is four times the key: 95 of 100 do not exceed 380; the largest is 400.
        assert_eq!(layers.layers[1].scale, Scale::log(380.0, 0.0, 800.0));
        let given = Layers::new(&signal, &estimates, &[1.0; 100], Some(50.0), BakeBounds::ClampAfter);
        assert_eq!(given.layers[0].scale, Scale::linear(-MARGIN, 1.0 + MARGIN));
        assert_eq!((given.layers[0].clamp, given.layers[1].clamp), (Some([0.0, 1.0]), None));
        assert_eq!(given.layers[1].scale, Scale::log(50.0, 0.0, 800.0));
        let unit = layers.light(vec![Vec3::Y; 100], &estimates);
        assert!((layers.from_unit(1, unit.value(9)[1]) - 20.0).abs() < 1e-3);
    }

    #[test]
    fn layers_judge_by_the_worst_channel_in_its_own_unit() {
        let light = Layer { channels: 1, domain: Domain::Hdr, ..Layer::scalar("irradiance") };
        let layers = Layers::of(vec![
            BakedLayer {
                layer: Layer::scalar("ambientOcclusion"),
                scale: Scale::UNIT,
                clamp: None,
                first: 0,
            },
            BakedLayer { layer: light, scale: Scale::log(1.0, 0.0, 1e4), clamp: None, first: 1 },
        ]);
        // A step of 0.01 unit values of light is more than twice that on the way from black to white.
        let light = |sigmas: [f32; 2]| known(&layers, &[0.5, 0.4], sigmas.to_vec());
        let (error, noise) = layers.worst(&[0.52, 0.41], &light([0.001, 0.002]), 0);
        assert!(error > 0.02 && noise == 0.002, "{error} {noise}");
        assert!(layers.worst_of(0..1, &[0.52, 0.41], &light([0.0; 2]), 0).0 < 0.021);
        assert!(layers.is_beyond(&[0.52, 0.41], &light([0.0; 2]), 0, 0.03));
        assert!(!layers.is_beyond(&[0.52, 0.41], &light([0.0, 0.02]), 0, 0.03));
        assert_eq!(layers.difference(Vec3::Y, &[0.52, 0.41], &[0.5, 0.4]), error);
    }

    #[test]
    fn layers_clamped_after_interpolation_judge_what_is_shown() {
        let layers = Layers::of(vec![BakedLayer {
            layer: Layer::scalar("shadow"),
            scale: Scale::linear(-0.5, 1.5),
            clamp: Some([0.0, 1.0]),
            first: 0,
        }]);
        let mut shown = [0.1];
        layers.clamp(&mut shown);
        assert_eq!(layers.from_unit(0, shown[0]), 0.0);
        assert_eq!(
            (layers.displayed(0, 0.25), layers.displayed(0, 0.5), layers.displayed(0, 0.9)),
            (0.0, 0.5, 1.0)
        );
        // A tenth of the signal's range is a twentieth of what could be stored.
        let (error, _) = layers.worst(&[0.55], &known(&layers, &[0.5], vec![0.0]), 0);
        assert!((error - 0.1).abs() < 1e-6, "{error}");
    }
}
