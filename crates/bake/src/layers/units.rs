//! From what was measured at points to unit values and their noise, some of it filtered away.

use glam::Vec3;
use lightkiln_light::Estimates;
use lightkiln_light::denoise::Denoised;
use rayon::prelude::*;

use super::{BakedLayer, Layers};
use crate::BakeError;
use crate::harmonics::{JUDGED, normals};

/// A layer of light that is to be filtered: points x channels.
#[derive(Clone, Copy, Debug)]
pub struct NoisyLayer<'a> {
    /// Shading normals of the points.
    pub normals: &'a [Vec3],
    /// In the unit of the light.
    pub values: &'a [f32],
    /// Variance of each value; infinite for points that lie inside other geometry.
    pub variances: &'a [f32],
    /// Values of a point.
    pub channels: usize,
    /// Values of even and of odd batches, where they are kept apart.
    pub halves: Option<[&'a [f32]; 2]>,
    /// Of harmonics beyond the first: values of the first, filtered.
    pub first: Option<&'a [f32]>,
}

/// Light of many points: flat arrays.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct UnitLight {
    /// Numbers a point.
    pub channels: usize,
    /// Unit values, points x channels.
    pub values: Vec<f32>,
    /// Shading normals of the points.
    pub(super) normals: Vec<Vec3>,
    /// What is judged of the values, points x [`Layers::judged`].
    pub(super) judged: Vec<f32>,
    /// The standard errors of that.
    pub(super) sigmas: Vec<f32>,
}

impl UnitLight {
    /// The values of a point.
    #[inline]
    pub fn value(&self, i: usize) -> &[f32] {
        &self.values[i * self.channels..(i + 1) * self.channels]
    }

    /// What is judged of them, in the unit of the bound.
    #[inline]
    pub fn judged(&self, i: usize) -> &[f32] {
        let judged = self.judged.len() / self.normals.len();
        &self.judged[i * judged..(i + 1) * judged]
    }

    /// The standard errors of that.
    #[inline]
    pub fn sigma(&self, i: usize) -> &[f32] {
        let judged = self.sigmas.len() / self.normals.len();
        &self.sigmas[i * judged..(i + 1) * judged]
    }

    /// The standard errors of all points.
    pub fn sigmas(&self) -> &[f32] {
        &self.sigmas
    }

    /// The noise of a point's noisiest value, as an error.
    pub fn noise(&self, i: usize) -> f32 {
        self.sigma(i).iter().copied().fold(0.0, f32::max)
    }
}

impl Layers {
    /// Unit values and their noise.
    ///
    /// - `normals`: shading normals of the points
    pub fn light(&self, normals: Vec<Vec3>, estimates: &Estimates) -> UnitLight {
        let raw = variances(estimates);
        let variances = self.baked(estimates.channels, &raw);
        self.units(normals, self.baked(estimates.channels, estimates.means()), &variances, &raw)
    }

    /// The channels of the layers alone, of `all` that are measured.
    fn baked(&self, all: usize, rows: &[f32]) -> Vec<f32> {
        rows.chunks_exact(all).flat_map(|row| &row[..self.channels()]).copied().collect()
    }

    /// Whether any layer is light whose noise is filtered away.
    pub fn are_filtered(&self) -> bool {
        self.layers.iter().any(BakedLayer::is_light)
    }

    /// The same with the noise of paths of light filtered away.
    ///
    /// - `normals`: shading normals of the points
    /// - `filter`: filters one layer of light; they come in their order
    ///
    /// # Errors
    /// Those of the filter.
    pub fn filtered_light(
        &self,
        normals: Vec<Vec3>,
        estimates: &Estimates,
        filter: impl Fn(NoisyLayer<'_>) -> Result<Denoised, BakeError>,
    ) -> Result<UnitLight, BakeError> {
        let raw = variances(estimates);
        let mut values = self.baked(estimates.channels, estimates.means());
        let mut all = self.baked(estimates.channels, &raw);
        let channels = self.channels();
        // What lies inside other geometry knows nothing of its own.
        for point in (0..estimates.len()).filter(|&i| !estimates.valid(i)) {
            all[point * channels..][..channels].fill(f32::INFINITY);
        }
        let halves =
            estimates.halves().map(|halves| halves.map(|half| self.baked(estimates.channels, &half)));
        let of = |all: &[f32], layer: &BakedLayer| -> Vec<f32> {
            all.chunks_exact(channels).flat_map(|row| &row[layer.channels()]).copied().collect()
        };
        for (number, layer) in self.layers.iter().enumerate().filter(|(_, l)| l.is_light()) {
            let mut sets = self.harmonics.iter().map(|(harmonics, _)| &harmonics.layers);
            let first = sets.find(|set| set.contains(&number) && set.start != number);
            let halves = halves.as_ref().map(|halves| halves.each_ref().map(|half| of(half, layer)));
            let filtered = filter(NoisyLayer {
                normals: &normals,
                halves: halves.as_ref().map(|halves| halves.each_ref().map(Vec::as_slice)),
                values: &of(&values, layer),
                variances: &of(&all, layer),
                channels: layer.layer.channels,
                first: first.map(|set| of(&values, &self.layers[set.start])).as_deref(),
            })?;
            let put = |all: &mut [f32], own: &[f32]| {
                for (row, own) in all.chunks_exact_mut(channels).zip(own.chunks_exact(layer.layer.channels)) {
                    row[layer.channels()].copy_from_slice(own);
                }
            };
            put(&mut values, &filtered.values);
            put(&mut all, &filtered.variances);
        }
        Ok(self.units(normals, values, &all, &raw))
    }

    /// Unit values of a signal's own, points x channels.
    ///
    /// - `variances`: of these
    /// - `raw`: of all that was measured, before any filter
    fn units(&self, shading: Vec<Vec3>, mut values: Vec<f32>, variances: &[f32], raw: &[f32]) -> UnitLight {
        let (channels, judged) = (self.channels(), self.judged());
        let measured = channels + self.harmonics.len() * JUDGED;
        let (mut all_judged, mut sigmas) = (Vec::new(), Vec::new());
        let points = shading.len();
        all_judged.resize(points * judged, 0.0);
        sigmas.resize(points * judged, 0.0);
        values
            .par_chunks_exact_mut(channels)
            .zip(variances.par_chunks_exact(channels))
            .zip(raw.par_chunks_exact(measured))
            .zip(&shading)
            .zip(all_judged.par_chunks_exact_mut(judged).zip(sigmas.par_chunks_exact_mut(judged)))
            .for_each(|((((values, variances), raw), &normal), (judged, sigmas))| {
                for (sigma, &(channel, errors)) in sigmas.iter_mut().zip(&self.plain) {
                    *sigma = variances[channel].sqrt() * self.scales[channel].slope(values[channel]) * errors;
                }
                let of_harmonics = sigmas[self.plain.len()..].chunks_exact_mut(JUDGED);
                let raw_judged = raw[channels..].chunks_exact(JUDGED);
                for (((harmonics, scale), sigmas), own) in
                    self.harmonics.iter().zip(of_harmonics).zip(raw_judged)
                {
                    let normals = normals(normal);
                    let lux = harmonics.irradiance(normals, |channel| values[channel]);
                    for (k, sigma) in sigmas.iter_mut().enumerate() {
                        let (at, color) = (k / 3, k % 3);
                        let independent =
                            |of: &[f32]| harmonics.independent_variance(normals[at], color, |c| of[c]);
                        // Filtered coefficients depend on each other as they did before.
                        let share = own[k] / independent(raw);
                        let variance = independent(variances) * if share.is_normal() { share } else { 1.0 };
                        *sigma = variance.sqrt() * scale.slope(lux[at][color].max(0.0));
                    }
                }
                values.iter_mut().zip(&self.scales).for_each(|(x, scale)| *x = scale.to_unit(*x));
                self.each_judged(normal, values, |number, value| judged[number] = value);
            });
        UnitLight { channels, values, normals: shading, judged: all_judged, sigmas }
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
