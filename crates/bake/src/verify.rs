//! The last stage judges all others: what the GPU will show, at points that no fit has seen, against
//! converged references.

use std::collections::BTreeMap;
use std::path::Path;

use lightkiln_light::{AmbientOcclusion, Estimates, Signal, Tracer};
use lightkiln_mesh::{SurfacePoint, VertexId, random};
use lightkiln_report::{BoundCheck, Coarse, ErrorSummary, Errors};
use lightkiln_sample::fresh_points;
use lightkiln_scene::{ReadOptions, Scene};
use rayon::prelude::*;

use crate::clock::{Clock, Progress};
use crate::options::{CONFIDENCE, Plan};
use crate::output::Written;
use crate::rounds::Shown;
use crate::shade::{Lit, interpolate, refine};
use crate::{BakeError, FileLight, Surface};

/// How many nodes with coarse texels a report names.
const COARSE_NODES: usize = 10;

/// Fresh points with converged light.
pub struct References {
    /// Area-uniform points.
    pub points: Vec<SurfacePoint>,
    light: Estimates,
    rays_per_point: u32,
}

impl References {
    /// Traces `count` fresh points with `batches` batches of rays each.
    pub fn trace(
        surface: &Surface<'_>,
        signal: &dyn Signal,
        count: usize,
        batches: u16,
        seed: u64,
        clock: &Clock<'_>,
    ) -> Self {
        let (points, keys) = fresh_points(&surface.mesh, count, seed);
        let mut light = Estimates::new(points.len(), signal.channels());
        let wanted = vec![batches; points.len()];
        refine(&mut light, signal, &points, &keys, &wanted, clock);
        Self { points, light, rays_per_point: u32::from(batches) * signal.rays_per_batch() }
    }

    /// The light at a point.
    pub fn value(&self, point: usize) -> f32 {
        self.light.mean(point)[0]
    }

    /// Its standard error.
    pub fn sigma(&self, point: usize) -> f32 {
        self.light.variance_of_mean(point, 0).sqrt()
    }

    /// Whether the point can be seen: not inside other geometry.
    pub fn visible(&self, point: usize) -> bool {
        self.light.valid(point)
    }

    /// Rays traced.
    pub fn rays(&self) -> u64 {
        self.light.rays()
    }

    /// The distribution of the error of `shown` over the visible points for which `counts` holds.
    pub fn errors(
        &self,
        shown: &(dyn Fn(SurfacePoint) -> f32 + Sync),
        counts: &(dyn Fn(SurfacePoint) -> bool + Sync),
    ) -> ErrorSummary {
        let errors: Vec<(f32, f32)> = (0..self.points.len())
            .into_par_iter()
            .filter(|&i| self.visible(i) && counts(self.points[i]))
            .map(|i| (shown(self.points[i]) - self.value(i), self.sigma(i)))
            .collect();
        ErrorSummary::new(errors)
    }

    /// The error of a hybrid, as a whole and by class, and what the bound says of it.
    pub fn judge(
        &self,
        surface: &Surface<'_>,
        shown: &(dyn Fn(SurfacePoint) -> f32 + Sync),
        is_texture: &(dyn Fn(SurfacePoint) -> bool + Sync),
        limit: f32,
    ) -> Errors {
        let visible: Vec<usize> = (0..self.points.len()).filter(|&i| self.visible(i)).collect();
        let beyond = |class: bool| {
            let in_class = || visible.iter().filter(|&&i| is_texture(self.points[i]) == class);
            let wrong = in_class().filter(|&&i| self.is_beyond(i, shown(self.points[i]), limit)).count();
            (wrong, in_class().count())
        };
        let (color_points_beyond, color_points) = beyond(false);
        let (texture_points_beyond, texture_points) = beyond(true);
        Errors {
            points: self.points.len(),
            rays_per_point: self.rays_per_point,
            hidden_points: self.points.len() - visible.len(),
            point_sampling: None,
            least_squares: None,
            hybrid: self.errors(shown, &|_| true),
            color: self.errors(shown, &|p| !is_texture(p)),
            texture: self.errors(shown, is_texture),
            bound: BoundCheck {
                limit,
                confidence: CONFIDENCE,
                samples_beyond: 0,
                samples_checked: 0,
                color_points_beyond,
                color_points,
                texture_points_beyond,
                texture_points,
            },
            coarse: self.coarse(surface, shown, is_texture, limit),
        }
    }

    /// The nodes with most points in texture triangles beyond the bound.
    fn coarse(
        &self,
        surface: &Surface<'_>,
        shown: &(dyn Fn(SurfacePoint) -> f32 + Sync),
        is_texture: &(dyn Fn(SurfacePoint) -> bool + Sync),
        limit: f32,
    ) -> Vec<Coarse> {
        let mut points = BTreeMap::new();
        for (i, &point) in self.points.iter().enumerate() {
            if is_texture(point) && self.is_beyond(i, shown(point), limit) {
                *points.entry(surface.scene.part_name(surface.part_of(point.triangle).0)).or_insert(0) += 1;
            }
        }
        let mut coarse: Vec<Coarse> =
            points.into_iter().map(|(name, points)| Coarse { name, points }).collect();
        coarse.sort_by_key(|c| std::cmp::Reverse(c.points));
        coarse.truncate(COARSE_NODES);
        coarse
    }

    /// Whether a value breaks the bound at a visible point, beyond the noise of its reference.
    pub fn is_beyond(&self, point: usize, shown: f32, limit: f32) -> bool {
        self.visible(point) && (shown - self.value(point)).abs() - CONFIDENCE * self.sigma(point) > limit
    }
}

/// Streams of random numbers beside the samples': fresh points that may promote triangles, and those that
/// nothing has seen before the report.
const SEEN_STREAM: u64 = 0x5ee9;
const UNSEEN_STREAM: u64 = 0xf4e5;
const VERIFY_STREAM: u64 = 0x7e51f7;

/// Share of a bake's rays that each of both sets may cost.
const REFERENCE_SHARE: f64 = 0.1;

/// Fewest fresh points, for scenes that take next to no rays.
const FEWEST_POINTS: usize = 500;

/// As many fresh points as a share of the rays so far pays for.
fn affordable_points(rays: u64, rays_per_point: u64, plan: &Plan) -> usize {
    let points = REFERENCE_SHARE * rays as f64 / rays_per_point as f64;
    (points as usize).clamp(FEWEST_POINTS, plan.effort.check_points)
}

/// Fresh points that may promote triangles while rounds go on.
pub fn seen_points(
    surface: &Surface<'_>,
    signal: &dyn Signal,
    rays_so_far: u64,
    plan: &Plan,
    clock: &mut Clock<'_>,
) -> References {
    clock.stage("check");
    let batches = plan.effort.reference_batches;
    let rays_per_point = u64::from(batches) * u64::from(signal.rays_per_batch());
    let count = affordable_points(rays_so_far, rays_per_point, plan);
    References::trace(surface, signal, count, batches, plan.seed ^ SEEN_STREAM, clock)
}

/// Reads the written file back and compares what it shows with references at points that nothing has seen.
///
/// The errors of point sampling and of least squares alone are taken at the same points.
///
/// # Errors
/// [`BakeError::ReadBack`] when the file does not hold the scene that was baked, and errors of the readers.
#[allow(clippy::too_many_arguments)] // a line of the pipeline: each argument is one stage's product
pub fn written_file(
    surface: &Surface<'_>,
    signal: &dyn Signal,
    lit: &Lit,
    seen: &References,
    shown: &Shown,
    written: &Written,
    plan: &Plan,
    clock: &mut Clock<'_>,
) -> Result<(Errors, u64), BakeError> {
    clock.stage("verify");
    let scene =
        Scene::read(&written.scene, &ReadOptions { scene: written.scene_number, ..ReadOptions::default() })?;
    let file = crate::file_name(&written.scene);
    let light = FileLight::read(&scene, &file)?;
    let again = Surface::new(&scene, &file)?;
    same_geometry(surface, &again)?;
    let view = light.view()?;

    let batches = plan.effort.reference_batches;
    let rays_per_point = u64::from(batches) * u64::from(signal.rays_per_batch());
    let rays = lit.estimates.rays() + shown.texel_rays;
    let count = affordable_points(rays, rays_per_point, plan);
    let fresh = References::trace(surface, signal, count, batches, plan.seed ^ UNSEEN_STREAM, clock);
    let (at_vertices, vertex_rays) = point_samples(surface, signal, &fresh, plan, clock);

    let mut errors =
        fresh.judge(surface, &|p| light.show(&view, p), &|p| light.is_texture(p.triangle), plan.max_error);
    errors.point_sampling = Some(fresh.errors(&|p| interpolate(surface, &at_vertices, p), &|_| true));
    errors.least_squares = Some(fresh.errors(&|p| interpolate(surface, &lit.values, p), &|_| true));
    [errors.bound.samples_beyond, errors.bound.samples_checked] =
        samples_beyond(lit, plan, &|p| light.show(&view, p), &|p| !light.is_texture(p.triangle));
    Ok((errors, seen.rays() + fresh.rays() + vertex_rays))
}

/// Samples that count and hold in `counts`: how many are shown beyond bound and noise, of how many.
fn samples_beyond(
    lit: &Lit,
    plan: &Plan,
    shown: &(dyn Fn(SurfacePoint) -> f32 + Sync),
    counts: &(dyn Fn(SurfacePoint) -> bool + Sync),
) -> [usize; 2] {
    let checked = || {
        (0..lit.samples.points.len())
            .into_par_iter()
            .filter(|&i| lit.weights[i] > 0.0 && counts(lit.samples.points[i]))
    };
    let beyond =
        checked().filter(|&i| lit.is_beyond(i, shown(lit.samples.points[i]), plan.max_error)).count();
    [beyond, checked().count()]
}

/// The same triangles at the same places, in the same order.
fn same_geometry(surface: &Surface<'_>, again: &Surface<'_>) -> Result<(), BakeError> {
    let (before, after) = (&surface.mesh, &again.mesh);
    if before.triangle_count() != after.triangle_count() {
        let what = format!("{} triangles instead of {}", after.triangle_count(), before.triangle_count());
        return Err(BakeError::ReadBack { what });
    }
    match before.triangle_ids().find(|&t| before.corners(t) != after.corners(t)) {
        Some(t) => Err(BakeError::ReadBack { what: format!("triangle {} lies elsewhere", t.0) }),
        None => Ok(()),
    }
}

/// Point sampling: the light at the vertices around the fresh points, zero elsewhere, and the rays it took.
fn point_samples(
    surface: &Surface<'_>,
    signal: &dyn Signal,
    fresh: &References,
    plan: &Plan,
    clock: &Clock<'_>,
) -> (Vec<f32>, u64) {
    let mesh = &surface.mesh;
    let mut vertices: Vec<VertexId> =
        fresh.points.iter().flat_map(|p| mesh.triangles[p.triangle.index()]).collect();
    vertices.sort_unstable();
    vertices.dedup();
    let points: Vec<SurfacePoint> = vertices.iter().map(|&v| surface.point_at(v)).collect();
    let keys: Vec<u64> =
        vertices.iter().map(|v| random::hash(plan.seed, u64::from(v.0), UNSEEN_STREAM, 0)).collect();
    let mut light = Estimates::new(points.len(), signal.channels());
    refine(&mut light, signal, &points, &keys, &vec![plan.effort.sample_batches[0]; points.len()], clock);
    let mut values = vec![0.0; mesh.vertex_count()];
    for (i, v) in vertices.iter().enumerate() {
        values[v.index()] = light.mean(i)[0];
    }
    (values, light.rays())
}

/// What `verify` traces.
#[derive(Clone, Copy, Debug)]
pub struct VerifyOptions {
    /// Fresh points.
    pub points: usize,
    /// Rays of each reference.
    pub rays: u32,
    /// Seed of points and rays.
    pub seed: u64,
    /// Which scene of the file; its default scene if none.
    pub scene: Option<usize>,
}

/// Reads a baked file, decodes what the GPU shows, and compares it with freshly traced light.
///
/// # Errors
/// [`BakeError::NotBaked`] for a file without our light, and errors of the readers.
pub fn verify_file(
    path: &Path,
    options: &VerifyOptions,
    progress: &dyn Progress,
) -> Result<Errors, BakeError> {
    let mut clock = Clock::new(progress);
    clock.stage("read");
    let scene = Scene::read(path, &ReadOptions { scene: options.scene, ..ReadOptions::default() })?;
    let file = crate::file_name(path);
    let light = FileLight::read(&scene, &file)?;
    let surface = Surface::new(&scene, &file)?;
    let tracer = Tracer::new(&surface.mesh, &surface)?;
    let distance = light.distance();
    let signal = AmbientOcclusion::new(&tracer, &surface.mesh, distance, options.seed ^ VERIFY_STREAM);
    surface.turn_hidden_sheets(&tracer, distance);
    clock.stage("verify");
    let batches = options.rays.div_ceil(signal.rays_per_batch()).clamp(2, u32::from(u16::MAX)) as u16;
    let seed = options.seed ^ VERIFY_STREAM;
    let fresh = References::trace(&surface, &signal, options.points, batches, seed, &clock);
    let view = light.view()?;
    let limit = light.extension.max_error;
    Ok(fresh.judge(&surface, &|p| light.show(&view, p), &|p| light.is_texture(p.triangle), limit))
}
