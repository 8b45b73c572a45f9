//! Light, fit, classify: rays where a decision is open, and nowhere else.
//!
//! A maximum over noisy samples always exceeds a bound of 3 % in the end, so the decision of Schaefer eq. 5
//! is taken with a confidence bound, and the samples of undecided triangles get more rays until they decide
//! or the budget of a sample is spent. What is still undecided then stays a color triangle: its error exceeds
//! the bound by no more than the noise that the report states.

use lightkiln_classify::{Residuals, Verdict, classify};
use lightkiln_fit::{Bounds, FitOptions, Observations, fit};
use lightkiln_light::{Estimates, Signal};
use lightkiln_mesh::{SurfacePoint, TriangleId};
use lightkiln_report::TOLERATED_SHARE;
use lightkiln_sample::{SampleOptions, Samples, poisson_disk, radius_for};
use rayon::prelude::*;

use crate::clock::{Clock, Stoppable};
use crate::layers::{BakedLayer, Layers, UnitLight};
use crate::options::{BakeBounds, CONFIDENCE, FILTER_RADIUS, Plan};
use crate::snapshot::{Snapshot, SnapshotLight};
use crate::verify::{References, Show};
use crate::{BakeError, Surface};

/// Samples with their light, the vertex values fitted to them, and what follows for each triangle.
pub struct Lit {
    /// The samples.
    pub samples: Samples,
    /// Their light.
    pub estimates: Estimates,
    /// What its layers are.
    pub layers: Layers,
    /// The same light in unit values.
    pub light: UnitLight,
    /// Weights in the fit: the area that a sample stands for, zero inside other geometry.
    pub weights: Vec<f32>,
    /// Unit values of the light vertices, vertices x channels.
    pub values: Vec<f32>,
    /// Whether the bound asks for texture, per triangle.
    pub needs_texture: Vec<bool>,
    /// The bound that this was decided by: the one asked for, or a tighter one, see [`Lit::tighten`].
    pub decision_bound: f32,
}

/// How much tighter the next bound is that is tried, and the tightest.
const TIGHTER: f32 = 0.75;
const TIGHTEST: f32 = 0.25;

impl Lit {
    /// Decides again by a tighter bound, where fresh points say that the samples promise too much: on scanned and
    /// broken meshes light changes so much between samples that more than half of the share that
    /// [`lightkiln_report::TOLERATED_SHARE`] tolerates lies beyond the bound.
    pub fn tighten(&mut self, surface: &Surface<'_>, seen: &References, plan: &Plan) {
        loop {
            let shown =
                |p: SurfacePoint, out: &mut [f32]| interpolate(surface, &self.layers, &self.values, p, out);
            let is_texture = |p: SurfacePoint| self.needs_texture[p.triangle.index()];
            let bound = seen.judge(surface, &shown, &is_texture, plan.max_error).bound;
            let tighter = self.decision_bound * TIGHTER;
            if bound.color_share_beyond() <= TOLERATED_SHARE / 2.0 || tighter < plan.max_error * TIGHTEST {
                return;
            }
            self.decision_bound = tighter;
            let verdicts = classify_triangles(
                surface,
                &self.samples,
                &self.layers,
                &self.light,
                &self.weights,
                &self.values,
                Decision::new(tighter, plan.max_error),
            );
            // What needed texture for another reason still does.
            let needs = self.needs_texture.iter_mut().zip(&verdicts);
            needs.for_each(|(needs, verdict)| *needs |= *verdict == Verdict::Texture);
        }
    }

    /// The noise of a sample's noisiest value, as an error.
    pub fn noise(&self, sample: usize) -> f32 {
        self.light.noise(sample)
    }

    /// Whether values break the bound at a sample, beyond the sample's noise.
    pub fn is_beyond(&self, sample: usize, shown: &[f32], limit: f32) -> bool {
        self.layers.is_beyond(shown, &self.light, sample, limit)
    }

    /// Those of some samples at which what is shown breaks the bound, beyond their noise.
    pub fn beyond(&self, samples: &[usize], shown: &Show<'_>, limit: f32) -> Vec<usize> {
        let buffer = || vec![0.0; self.layers.channels()];
        let is_beyond = |out: &mut Vec<f32>, &i: &usize| {
            shown(self.samples.points[i], out);
            self.is_beyond(i, out, limit).then_some(i)
        };
        samples.par_iter().map_init(buffer, is_beyond).flatten().collect()
    }
}

/// Shades the samples, fits the vertices and classifies the triangles, with more rays where it matters.
///
/// # Errors
/// [`BakeError::Fit`], [`BakeError::Cancelled`], and those of the denoiser.
pub fn light_fit_classify(
    surface: &Surface<'_>,
    signal: &dyn Signal,
    samples: Samples,
    plan: &Plan,
    clock: &mut Clock<'_>,
) -> Result<Lit, BakeError> {
    let [first, mut most] = plan.effort.sample_batches;
    let mut samples = samples;
    let mut estimates = Estimates::new(samples.points.len(), signal.channels());
    let mut wanted = vec![first; samples.points.len()];
    clock.stage("light")?;
    refine(&mut estimates, signal, &samples.points, &samples.keys, &wanted, clock)?;
    let mut weights = weights(surface, &samples, &estimates);
    let layers = Layers::new(signal, &estimates, &weights, plan.white, plan.bounds);
    // Filtering takes longer than tracing a few rays too many, and makes up for most of what they would bring.
    let growth = if layers.are_filtered() { 4 } else { 2 };
    if layers.are_filtered() {
        most = (most / 3).max(first);
    }
    let mut densified = 0;
    loop {
        clock.stage(if layers.are_filtered() { "filter" } else { "fit" })?;
        let radius = FILTER_RADIUS * plan.radius;
        let light = plan.denoiser.samples(surface, &layers, &samples.points, &estimates, radius)?;
        clock.stage("fit")?;
        let values = fit_vertices(surface, &samples, &layers, &light, &weights, plan.bounds)?;
        let shown = SnapshotLight { layers: &layers, values: &values, shown: None };
        clock.show(&Snapshot { surface, plan, light: Some(shown) });
        clock.stage("classify")?;
        let verdicts = classify_triangles(
            surface,
            &samples,
            &layers,
            &light,
            &weights,
            &values,
            Decision::new(plan.max_error, plan.max_error),
        );
        let mut open = 0_usize;
        for (triangle, _) in verdicts.iter().enumerate().filter(|(_, v)| **v == Verdict::Open) {
            for sample in samples.of_triangle(TriangleId(triangle as u32)) {
                if weights[sample] > 0.0 && wanted[sample] < most {
                    wanted[sample] = (wanted[sample] * growth).min(most);
                    open += 1;
                }
            }
        }
        if open == 0 {
            let unsure = if densified < plan.effort.denser_rounds {
                unsure_triangles(surface, &samples, &layers, &values, &verdicts, plan)
            } else {
                Vec::new()
            };
            if unsure.is_empty() {
                let needs_texture = verdicts.iter().map(|v| *v == Verdict::Texture).collect();
                let decision_bound = plan.max_error;
                return Ok(Lit {
                    samples,
                    estimates,
                    layers,
                    light,
                    weights,
                    values,
                    needs_texture,
                    decision_bound,
                });
            }
            densified += 1;
            let (denser, from) = samples.denser(&surface.mesh, &unsure, plan.seed);
            estimates = estimates.rearranged(&from);
            wanted = from.iter().map(|f| f.map_or(first, |f| wanted[f as usize])).collect();
            samples = denser;
        }
        clock.stage("light")?;
        refine(&mut estimates, signal, &samples.points, &samples.keys, &wanted, clock)?;
        if open == 0 {
            weights = self::weights(surface, &samples, &estimates);
        }
    }
}

/// Samples of the first coarse fit, and their batches.
const DRAFT_SAMPLES: usize = 20_000;
const DRAFT_BATCHES: u16 = 1;

/// A first coarse fit for those who watch, within seconds whatever the bake will take. Nothing of it is used again, so that
/// watching changes nothing.
///
/// # Errors
/// [`BakeError::Sample`], [`BakeError::Fit`], [`BakeError::Cancelled`], and those of the denoiser.
pub fn draft(
    surface: &Surface<'_>,
    signal: &dyn Signal,
    plan: &Plan,
    clock: &Clock<'_>,
) -> Result<(), BakeError> {
    if !clock.wants_snapshot() {
        return Ok(());
    }
    let mesh = &surface.mesh;
    let radius = plan.radius.max(radius_for(mesh, DRAFT_SAMPLES));
    let samples = poisson_disk(mesh, &SampleOptions { radius, seed: plan.seed })?;
    let mut estimates = Estimates::new(samples.points.len(), signal.channels());
    let wanted = vec![DRAFT_BATCHES; samples.points.len()];
    refine(&mut estimates, signal, &samples.points, &samples.keys, &wanted, clock)?;
    let weights = weights(surface, &samples, &estimates);
    let layers = Layers::new(signal, &estimates, &weights, plan.white, plan.bounds);
    let reach = FILTER_RADIUS * radius;
    let light = plan.denoiser.samples(surface, &layers, &samples.points, &estimates, reach)?;
    let values = fit_vertices(surface, &samples, &layers, &light, &weights, BakeBounds::Clamp)?;
    let light = SnapshotLight { layers: &layers, values: &values, shown: None };
    clock.show(&Snapshot { surface, plan, light: Some(light) });
    Ok(())
}

/// A triangle with this many samples knows its light as well as three vertex values can.
const ENOUGH_SAMPLES: usize = 6;

/// Triangles smaller than this share of a squared radius are left alone: too small to be seen, and on CAD
/// meshes too many.
const LEAST_AREA: f64 = 0.01;

/// Color triangles whose values differ by more than the bound while fewer samples than unknowns speak for them:
/// a fit goes through all of these samples and may be anything between them.
fn unsure_triangles(
    surface: &Surface<'_>,
    samples: &Samples,
    layers: &Layers,
    values: &[f32],
    verdicts: &[Verdict],
    plan: &Plan,
) -> Vec<TriangleId> {
    let mesh = &surface.mesh;
    let least = LEAST_AREA * f64::from(plan.radius).powi(2);
    mesh.triangle_ids()
        .filter(|&t| verdicts[t.index()] != Verdict::Texture && samples.of_triangle(t).len() < ENOUGH_SAMPLES)
        .filter(|&t| {
            let middle = SurfacePoint { triangle: t, barycentric: [1.0 / 3.0; 2] };
            let normal = surface.lit_normal(middle);
            let mut ends = vec![(f32::INFINITY, f32::NEG_INFINITY); layers.judged()];
            for corner in mesh.triangles[t.index()] {
                let own = &values[corner.index() * layers.channels()..][..layers.channels()];
                layers.each_judged(normal, own, |number, value| {
                    let (low, high) = ends[number];
                    ends[number] = (low.min(value), high.max(value));
                });
            }
            ends.iter().any(|(low, high)| high - low > plan.max_error) && mesh.area(t) > least
        })
        .collect()
}

/// Shades samples with as many batches each and fits the vertices: least squares alone, for pictures.
///
/// # Errors
/// [`BakeError::Fit`] and [`BakeError::Cancelled`].
pub fn light_and_fit(
    surface: &Surface<'_>,
    signal: &dyn Signal,
    layers: &Layers,
    samples: Samples,
    batches: u16,
    clock: &mut Clock<'_>,
) -> Result<Vec<f32>, BakeError> {
    clock.stage("light")?;
    let mut estimates = Estimates::new(samples.points.len(), signal.channels());
    let wanted = vec![batches; samples.points.len()];
    refine(&mut estimates, signal, &samples.points, &samples.keys, &wanted, clock)?;
    let weights = weights(surface, &samples, &estimates);
    clock.stage("fit")?;
    let light = layers.light(surface.lit_normals(&samples.points), &estimates);
    fit_vertices(surface, &samples, layers, &light, &weights, BakeBounds::Clamp)
}

/// Points that are shaded between two looks at the progress.
const CHUNK: usize = 1 << 17;

/// Adds rays chunk by chunk and tells the clock; the chunks do not show in the result.
///
/// # Errors
/// [`BakeError::Cancelled`]; the estimates are worthless then.
pub fn refine(
    estimates: &mut Estimates,
    signal: &dyn Signal,
    points: &[SurfacePoint],
    keys: &[u64],
    wanted: &[u16],
    clock: &Clock<'_>,
) -> Result<(), BakeError> {
    let signal = &Stoppable { signal, clock };
    let count = points.len();
    let mut now = vec![0; count];
    for start in (0..count).step_by(CHUNK) {
        let end = (start + CHUNK).min(count);
        now[start..end].copy_from_slice(&wanted[start..end]);
        estimates.refine(signal, points, keys, &now);
        clock.go_on()?;
        now[start..end].fill(0);
        clock.share(end as f32 / count as f32);
    }
    Ok(())
}

/// A sheet counts as hidden inside other geometry when less than this share of its area is not.
const SEEN_SHARE: f64 = 0.02;

/// The area of each sample, zero inside other geometry: unless that holds for a whole sheet, which then keeps
/// the light that it has. (A lining modelled as one layer sees nothing but the backs of other panels.)
fn weights(surface: &Surface<'_>, samples: &Samples, estimates: &Estimates) -> Vec<f32> {
    let (sheet_of, sheets) = lightkiln_mesh::sheets(&surface.mesh);
    let sheet = |sample: usize| sheet_of[samples.points[sample].triangle.index()] as usize;
    let (mut seen, mut all) = (vec![0.0_f64; sheets], vec![0.0_f64; sheets]);
    for (sample, &area) in samples.areas.iter().enumerate() {
        all[sheet(sample)] += f64::from(area);
        if estimates.valid(sample) {
            seen[sheet(sample)] += f64::from(area);
        }
    }
    samples
        .areas
        .iter()
        .enumerate()
        .map(|(sample, &area)| {
            let hidden_sheet = seen[sheet(sample)] < SEEN_SHARE * all[sheet(sample)];
            if estimates.valid(sample) || hidden_sheet { area } else { 0.0 }
        })
        .collect()
}

fn fit_vertices(
    surface: &Surface<'_>,
    samples: &Samples,
    layers: &Layers,
    light: &UnitLight,
    weights: &[f32],
    bounds: BakeBounds,
) -> Result<Vec<f32>, BakeError> {
    let observations =
        Observations { points: &samples.points, weights, values: &light.values, channels: light.channels };
    let fitted = |options: &FitOptions| -> Result<Vec<f32>, BakeError> {
        Ok(fit(&surface.mesh, &surface.adjacency, &observations, None, options)?.values)
    };
    if bounds != BakeBounds::Optimum || !layers.layers.iter().any(BakedLayer::is_bounded) {
        return fitted(&fit_options());
    }
    let optimum = Bounds::Optimum { low: 0.0, high: 1.0 };
    let mut values = fitted(&FitOptions { bounds: optimum, ..fit_options() })?;
    if !layers.layers.iter().all(BakedLayer::is_bounded) {
        // Light beside them is fitted as it is alone.
        let clamped = fitted(&fit_options())?;
        let rows = values.chunks_exact_mut(light.channels).zip(clamped.chunks_exact(light.channels));
        for (values, clamped) in rows {
            for layer in layers.layers.iter().filter(|l| !l.is_bounded()) {
                values[layer.channels()].copy_from_slice(&clamped[layer.channels()]);
            }
        }
    }
    Ok(values)
}

/// How vertices are fitted: ours, within the range of unit values.
pub fn fit_options() -> FitOptions {
    FitOptions { bounds: Bounds::Clamp { low: 0.0, high: 1.0 }, ..FitOptions::default() }
}

/// What vertex values alone show: linear interpolation (Schaefer eq. 1), clamped where a layer asks for it; `out` has as
/// many channels as `values`.
pub fn interpolate(
    surface: &Surface<'_>,
    layers: &Layers,
    values: &[f32],
    point: SurfacePoint,
    out: &mut [f32],
) {
    let channels = out.len();
    let corners = surface.mesh.triangles[point.triangle.index()];
    out.fill(0.0);
    for (vertex, weight) in corners.iter().zip(point.weights()) {
        let at = vertex.index() * channels;
        out.iter_mut().zip(&values[at..at + channels]).for_each(|(o, v)| *o += weight * v);
    }
    layers.clamp(out);
}

/// What decides whether a triangle is a texture triangle.
#[derive(Clone, Copy)]
struct Decision {
    /// Largest error.
    bound: f32,
    /// Standard errors at which it is certain.
    confidence: f32,
}

impl Decision {
    /// By that bound. The confidence shrinks with it: in a draft the noise alone is larger than the bound, so that a
    /// tighter one would decide next to nothing else, and what noise left open is what fresh points found wrong.
    ///
    /// - `asked`: the bound that was asked for
    fn new(bound: f32, asked: f32) -> Self {
        Self { bound, confidence: CONFIDENCE * bound / asked }
    }
}

/// Each judged value of a sample counts as a sample of its own.
fn classify_triangles(
    surface: &Surface<'_>,
    samples: &Samples,
    layers: &Layers,
    light: &UnitLight,
    weights: &[f32],
    values: &[f32],
    by: Decision,
) -> Vec<Verdict> {
    let judged = layers.judged();
    let mut errors = vec![0.0; samples.points.len() * judged];
    let shown = || vec![0.0; layers.channels()];
    errors.par_chunks_mut(judged).enumerate().for_each_init(shown, |shown, (i, errors)| {
        interpolate(surface, layers, values, samples.points[i], shown);
        layers.each_error(shown, light, i, |number, error, _| errors[number] = error.abs());
    });
    let valid: Vec<bool> = weights.iter().flat_map(|&w| std::iter::repeat_n(w > 0.0, judged)).collect();
    let starts: Vec<u32> = samples.triangle_starts().iter().map(|&s| s * judged as u32).collect();
    let residuals =
        Residuals { triangle_starts: &starts, errors: &errors, sigmas: light.sigmas(), valid: &valid };
    classify(&residuals, by.bound, by.confidence)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// One triangle a sample, of which the first lies far beyond the bound, the second and third less so, the last not.
    #[test]
    fn tighter_decision_makes_texture_of_what_noise_left_open() {
        let errors = [0.2, 0.08, 0.05, 0.001];
        let residuals = Residuals {
            triangle_starts: &[0, 1, 2, 3, 4],
            errors: &errors,
            sigmas: &[0.03; 4],
            valid: &[true; 4],
        };
        let textures = |by: Decision| {
            let verdicts = classify(&residuals, by.bound, by.confidence);
            verdicts.iter().filter(|v| **v == Verdict::Texture).count()
        };
        let (asked, tightest) = (0.03, TIGHTEST * 0.03);
        assert_eq!(textures(Decision::new(asked, asked)), 1);
        // With the confidence of before, the tighter bound decides nothing else.
        assert_eq!(textures(Decision { bound: tightest, confidence: CONFIDENCE }), 1);
        assert_eq!(textures(Decision::new(tightest, asked)), 3);
        let mut bound = asked;
        while bound * TIGHTER >= tightest {
            let (before, after) = (Decision::new(bound, asked), Decision::new(bound * TIGHTER, asked));
            assert!(textures(after) >= textures(before), "no texture triangle leaves");
            bound *= TIGHTER;
        }
    }
}
