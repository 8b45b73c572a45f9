//! The layers of a bake: what their stored values mean, and what an error in them is.
//!
//! From here on light is in *unit values*, `0..=1` over the range of its layer ([`Scale`]). The range of light
//! without an upper end is found in the first look at the samples. One bound serves all layers: an error is the
//! difference of unit values in the layer's own unit, and that of a point is the largest over its channels.

use glam::Vec3;
use lightkiln_light::denoise::{Noisy, denoise};
use lightkiln_light::{Curve, Domain, Estimates, Layer, Scale, Signal};
use lightkiln_mesh::{Mesh, SurfacePoint};
use rayon::prelude::*;

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
    pub fn channels(&self) -> std::ops::Range<usize> {
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
    /// Errors per unit value, by channel.
    errors: Vec<f32>,
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
        let layers = signal.layers();
        let mut first = 0;
        let firsts: Vec<usize> = layers
            .iter()
            .map(|layer| {
                first += layer.channels;
                first - layer.channels
            })
            .collect();
        let white = white.unwrap_or_else(|| {
            let unbounded = layers.iter().zip(&firsts).filter(|(l, _)| l.domain == Domain::Hdr);
            let white = |(layer, &first): (&Layer, &usize)| {
                // The first coefficient of harmonics is irradiance over its basis function, 1 / sqrt(4 pi).
                let basis = if layer.name.starts_with("irradianceSh") { 0.282_095 } else { 1.0 };
                basis * white_of(seen, weights, first, layer.channels)
            };
            unbounded.map(white).fold(0.0, f32::max)
        });
        let white = if white > 0.0 && white.is_finite() { white } else { 1.0 };
        let scale = |layer: &Layer, first: usize| match layer.domain {
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
        };
        let clamp = |layer: &Layer| match layer.domain {
            Domain::Bounded { low, high } if bounds == BakeBounds::ClampAfter => Some([low, high]),
            _ => None,
        };
        let baked = layers.iter().zip(firsts).map(|(l, first)| BakedLayer {
            layer: l.clone(),
            scale: scale(l, first),
            clamp: clamp(l),
            first,
        });
        Self::of(baked.collect())
    }

    /// Layers whose scales are known.
    pub fn of(layers: Vec<BakedLayer>) -> Self {
        let channels = || layers.iter().flat_map(|l| std::iter::repeat_n(l, l.layer.channels));
        let scales = channels().map(|l| l.scale).collect();
        let clamps = channels().map(BakedLayer::unit_clamp).collect();
        let errors = channels().map(|l| 1.0 / l.error_unit()).collect();
        Self { layers, scales, clamps, errors }
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

    /// Unit values and their noise.
    pub fn light(&self, estimates: &Estimates) -> UnitLight {
        self.units(estimates.means().to_vec(), variances(estimates))
    }

    /// Whether any layer is light whose noise is filtered away.
    pub fn are_filtered(&self) -> bool {
        self.layers.iter().any(BakedLayer::is_light)
    }

    /// The same with the noise of paths of light filtered away where neighbours allow it ([`denoise`]).
    ///
    /// - `points`: of the estimates
    /// - `radius`: of the filter, in units of the mesh
    pub fn filtered_light(
        &self,
        mesh: &Mesh,
        points: &[SurfacePoint],
        estimates: &Estimates,
        radius: f32,
    ) -> UnitLight {
        if !self.are_filtered() {
            return self.light(estimates);
        }
        let (mut values, mut all) = (estimates.means().to_vec(), variances(estimates));
        let channels = self.channels();
        // What lies inside other geometry knows nothing of its own.
        for point in (0..estimates.len()).filter(|&i| !estimates.valid(i)) {
            all[point * channels..][..channels].fill(f32::INFINITY);
        }
        let positions: Vec<Vec3> = points.par_iter().map(|&p| mesh.position(p)).collect();
        let normals: Vec<Vec3> = points.par_iter().map(|&p| mesh.shading_normal(p)).collect();
        for layer in self.layers.iter().filter(|l| l.is_light()) {
            let own = |all: &[f32]| -> Vec<f32> {
                all.chunks_exact(channels).flat_map(|row| &row[layer.channels()]).copied().collect()
            };
            let filtered = denoise(
                Noisy {
                    positions: &positions,
                    normals: &normals,
                    values: &own(&values),
                    variances: &own(&all),
                    channels: layer.layer.channels,
                },
                radius,
            );
            let put = |all: &mut [f32], own: &[f32]| {
                for (row, own) in all.chunks_exact_mut(channels).zip(own.chunks_exact(layer.layer.channels)) {
                    row[layer.channels()].copy_from_slice(own);
                }
            };
            put(&mut values, &filtered.values);
            put(&mut all, &filtered.variances);
        }
        self.units(values, all)
    }

    /// Unit values of a signal's own, points x channels.
    fn units(&self, mut values: Vec<f32>, mut variances: Vec<f32>) -> UnitLight {
        let channels = self.channels();
        let rows = values.par_chunks_exact_mut(channels).zip(variances.par_chunks_exact_mut(channels));
        rows.for_each(|(values, sigmas)| {
            for ((x, sigma), scale) in values.iter_mut().zip(sigmas).zip(&self.scales) {
                *sigma = sigma.sqrt() * scale.slope(*x);
                *x = scale.to_unit(*x);
            }
        });
        UnitLight { channels, values, sigmas: variances }
    }

    /// Errors per unit value of each channel.
    pub fn errors_per_unit(&self) -> &[f32] {
        &self.errors
    }

    /// The largest error over the channels, and the noise of that channel, both as errors.
    pub fn worst(&self, shown: &[f32], light: &[f32], sigmas: &[f32]) -> (f32, f32) {
        let of = |c: usize| ((shown[c] - light[c]) * self.errors[c], sigmas[c] * self.errors[c]);
        (1..self.channels())
            .map(of)
            .fold(of(0), |worst, next| if next.0.abs() > worst.0.abs() { next } else { worst })
    }

    /// Whether any channel is off by more than a bound, beyond its noise.
    pub fn is_beyond(&self, shown: &[f32], light: &[f32], sigmas: &[f32], bound: f32) -> bool {
        (0..self.channels())
            .any(|c| ((shown[c] - light[c]).abs() - CONFIDENCE * sigmas[c]) * self.errors[c] > bound)
    }

    /// How large the noise of a point's worst channel may be as an error, relative to that of a layer that is not
    /// filtered.
    pub fn noise_of(&self, estimates: &Estimates, i: usize) -> f32 {
        let of_layer = |layer: &BakedLayer| {
            let share = if layer.is_light() { FILTER_GAIN } else { 1.0 };
            let sigma = |channel: usize| {
                let slope = self.scales[channel].slope(estimates.mean(i)[channel]);
                estimates.variance_of_mean(i, channel).sqrt() * slope * self.errors[channel]
            };
            share * layer.channels().map(sigma).fold(0.0, f32::max)
        };
        self.layers.iter().map(of_layer).fold(0.0, f32::max)
    }

    /// The noise of a point's worst channel, as an error.
    pub fn sigma(&self, sigmas: &[f32]) -> f32 {
        sigmas.iter().zip(&self.errors).map(|(s, k)| s * k).fold(0.0, f32::max)
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

/// Variances of all channels, points x channels.
fn variances(estimates: &Estimates) -> Vec<f32> {
    let channels = estimates.channels;
    (0..estimates.len() * channels)
        .into_par_iter()
        .map(|at| estimates.variance_of_mean(at / channels, at % channels))
        .collect()
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

/// Light of many points in unit values, with its standard errors: flat arrays, points x channels.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct UnitLight {
    /// Numbers a point.
    pub channels: usize,
    /// Unit values.
    pub values: Vec<f32>,
    /// Their standard errors.
    pub sigmas: Vec<f32>,
}

impl UnitLight {
    /// The values of a point.
    #[inline]
    pub fn value(&self, i: usize) -> &[f32] {
        &self.values[i * self.channels..(i + 1) * self.channels]
    }

    /// Their standard errors.
    #[inline]
    pub fn sigma(&self, i: usize) -> &[f32] {
        &self.sigmas[i * self.channels..(i + 1) * self.channels]
    }
}

#[cfg(test)]
mod tests {
    use lightkiln_mesh::TriangleId;

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
        let unit = layers.light(&estimates);
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
        let (error, noise) = layers.worst(&[0.52, 0.41], &[0.5, 0.4], &[0.001, 0.001]);
        assert!(error > 0.02 && noise > 0.002, "{error} {noise}");
        assert!(layers.is_beyond(&[0.52, 0.41], &[0.5, 0.4], &[0.0, 0.0], 0.03));
        assert!(!layers.is_beyond(&[0.52, 0.41], &[0.5, 0.4], &[0.0, 0.01], 0.03));
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
        let (error, noise) = layers.worst(&[0.55], &[0.5], &[0.005]);
        assert!((error - 0.1).abs() < 1e-6 && (noise - 0.01).abs() < 1e-6, "{error} {noise}");
    }
}
