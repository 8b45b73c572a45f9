//! The last stage judges all others: what the GPU will show, at points that no fit has seen, against
//! converged references.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use lightkiln_light::{Estimates, Signal, Tracer};
use lightkiln_mesh::{SurfacePoint, TriangleId, VertexId, random};
use lightkiln_report::{BoundCheck, Coarse, ErrorSummary, Errors, LayerError};
use lightkiln_sample::fresh_points;
use lightkiln_scene::Scene;
use rayon::prelude::*;

use crate::clock::{Clock, Progress};
use crate::layers::{Layers, Part, UnitLight};
use crate::options::{CONFIDENCE, Plan};
use crate::output::Written;
use crate::rounds::Shown;
use crate::shade::{Lit, interpolate, refine};
use crate::{BakeError, FileLight, Opened, Opening, Surface};

/// How many nodes with coarse texels a report names.
const COARSE_NODES: usize = 10;

/// What is shown at a point, in unit values.
pub type Show<'a> = dyn Fn(SurfacePoint, &mut [f32]) + Sync + 'a;

/// Fresh points with converged light.
pub struct References {
    /// Area-uniform points.
    pub points: Vec<SurfacePoint>,
    estimates: Estimates,
    layers: Layers,
    light: UnitLight,
    rays_per_point: u32,
}

/// The error at a visible point, in the unit of the bound.
#[derive(Clone, Copy)]
struct PointError {
    /// Of the worst channel, with its sign.
    error: f32,
    /// Standard error of the reference in that channel.
    sigma: f32,
    /// Some channel is beyond the bound and its noise.
    beyond: bool,
}

impl References {
    /// Traces `count` fresh points with `batches` batches of rays each.
    ///
    /// # Errors
    /// [`BakeError::Cancelled`].
    pub fn trace(
        surface: &Surface<'_>,
        signal: &dyn Signal,
        layers: &Layers,
        count: usize,
        batches: u16,
        seed: u64,
        clock: &Clock<'_>,
    ) -> Result<Self, BakeError> {
        let (points, keys) = fresh_points(&surface.mesh, count, seed);
        let mut estimates = Estimates::new(points.len(), signal.channels());
        let wanted = vec![batches; points.len()];
        refine(&mut estimates, signal, &points, &keys, &wanted, clock)?;
        let light = layers.light(surface.lit_normals(&points), &estimates);
        let rays_per_point = u32::from(batches) * signal.rays_per_batch();
        Ok(Self { points, estimates, layers: layers.clone(), light, rays_per_point })
    }

    /// Rays traced.
    pub fn rays(&self) -> u64 {
        self.estimates.rays()
    }

    /// The error of what is shown at each point; none where a point lies inside other geometry.
    fn errors(&self, shown: &Show<'_>, limit: f32) -> Vec<Option<PointError>> {
        let at = |out: &mut Vec<f32>, i: usize| {
            self.estimates.valid(i).then(|| {
                shown(self.points[i], out);
                let (error, sigma) = self.layers.worst(out, &self.light, i);
                PointError { error, sigma, beyond: self.layers.is_beyond(out, &self.light, i, limit) }
            })
        };
        let buffer = || vec![0.0; self.layers.channels()];
        (0..self.points.len()).into_par_iter().map_init(buffer, at).collect()
    }

    /// The distribution of the error of what is shown.
    pub fn summary(&self, shown: &Show<'_>) -> ErrorSummary {
        ErrorSummary::new(self.errors(shown, f32::INFINITY).iter().flatten().map(|e| (e.error, e.sigma)))
    }

    /// The triangles in which what is shown breaks the bound, for points that count.
    pub fn beyond(
        &self,
        shown: &Show<'_>,
        counts: &(dyn Fn(SurfacePoint) -> bool + Sync),
        limit: f32,
    ) -> Vec<TriangleId> {
        let errors = self.errors(shown, limit);
        let beyond =
            self.points.iter().zip(errors).filter(|(p, e)| e.is_some_and(|e| e.beyond) && counts(**p));
        beyond.map(|(p, _)| p.triangle).collect()
    }

    /// The error of a hybrid, as a whole, by class and by layer, and what the bound says of it.
    pub fn judge(
        &self,
        surface: &Surface<'_>,
        shown: &Show<'_>,
        is_texture: &(dyn Fn(SurfacePoint) -> bool + Sync),
        limit: f32,
    ) -> Errors {
        let errors = self.errors(shown, limit);
        let visible: Vec<(SurfacePoint, PointError)> =
            self.points.iter().zip(&errors).filter_map(|(p, e)| e.map(|e| (*p, e))).collect();
        let in_class = |class: bool| visible.iter().filter(move |(p, _)| is_texture(*p) == class);
        let of_class = |class: bool| ErrorSummary::new(in_class(class).map(|(_, e)| (e.error, e.sigma)));
        let beyond = |class: bool| in_class(class).filter(|(_, e)| e.beyond).count();
        Errors {
            points: self.points.len(),
            rays_per_point: self.rays_per_point,
            hidden_points: self.points.len() - visible.len(),
            point_sampling: None,
            least_squares: None,
            hybrid: ErrorSummary::new(visible.iter().map(|(_, e)| (e.error, e.sigma))),
            color: of_class(false),
            texture: of_class(true),
            layers: self.by_layer(shown),
            bound: BoundCheck {
                limit,
                confidence: CONFIDENCE,
                samples_beyond: 0,
                samples_checked: 0,
                color_points_beyond: beyond(false),
                color_points: in_class(false).count(),
                texture_points_beyond: beyond(true),
                texture_points: in_class(true).count(),
            },
            coarse: coarse(surface, in_class(true).filter(|(_, e)| e.beyond).map(|(p, _)| *p)),
        }
    }

    /// The error of each layer alone; harmonics count as one.
    fn by_layer(&self, shown: &Show<'_>) -> Vec<LayerError> {
        let values: Vec<Vec<f32>> = (0..self.points.len())
            .into_par_iter()
            .map(|i| {
                let mut out = vec![0.0; self.layers.channels()];
                shown(self.points[i], &mut out);
                out
            })
            .collect();
        let of_part = |part: &Part| {
            let errors = (0..self.points.len())
                .filter(|&i| self.estimates.valid(i))
                .map(|i| self.layers.worst_of(part.judged.clone(), &values[i], &self.light, i));
            LayerError { signal: part.name.clone(), hybrid: ErrorSummary::new(errors) }
        };
        self.layers.parts().iter().map(of_part).collect()
    }
}

/// The nodes with most of these points.
fn coarse(surface: &Surface<'_>, beyond: impl Iterator<Item = SurfacePoint>) -> Vec<Coarse> {
    let mut points = BTreeMap::new();
    for point in beyond {
        *points.entry(surface.scene.part_name(surface.part_of(point.triangle).0)).or_insert(0) += 1;
    }
    let mut coarse: Vec<Coarse> = points.into_iter().map(|(name, points)| Coarse { name, points }).collect();
    coarse.sort_by_key(|c| std::cmp::Reverse(c.points));
    coarse.truncate(COARSE_NODES);
    coarse
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
///
/// # Errors
/// [`BakeError::Cancelled`].
pub fn seen_points(
    surface: &Surface<'_>,
    signal: &dyn Signal,
    lit: &Lit,
    plan: &Plan,
    clock: &mut Clock<'_>,
) -> Result<References, BakeError> {
    clock.stage("check")?;
    let batches = plan.effort.reference_batches;
    let rays_per_point = u64::from(batches) * u64::from(signal.rays_per_batch());
    let count = affordable_points(lit.estimates.rays(), rays_per_point, plan);
    References::trace(surface, signal, &lit.layers, count, batches, plan.seed ^ SEEN_STREAM, clock)
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
    clock.stage("verify")?;
    let scene = Scene::read(&written.scene, &plan.light.read_options(written.scene_number, false))?;
    let file = crate::file_name(&written.scene);
    let again = Surface::with(&scene, &file, plan.light.cast(&scene, &[])?)?;
    let light = FileLight::read(&again, &file)?;
    same_geometry(surface, &again)?;
    let views = light.views()?;

    let batches = plan.effort.reference_batches;
    let rays_per_point = u64::from(batches) * u64::from(signal.rays_per_batch());
    let rays = lit.estimates.rays() + shown.texel_rays;
    let count = affordable_points(rays, rays_per_point, plan);
    let fresh =
        References::trace(surface, signal, &lit.layers, count, batches, plan.seed ^ UNSEEN_STREAM, clock)?;
    let (at_vertices, vertex_rays) = point_samples(surface, signal, &lit.layers, &fresh, plan, clock)?;

    let shown = |p: SurfacePoint, out: &mut [f32]| light.show(&views, p, out);
    let mut errors = fresh.judge(surface, &shown, &|p| light.is_texture(p.triangle), plan.max_error);
    errors.point_sampling =
        Some(fresh.summary(&|p, out| interpolate(surface, &lit.layers, &at_vertices, p, out)));
    errors.least_squares =
        Some(fresh.summary(&|p, out| interpolate(surface, &lit.layers, &lit.values, p, out)));
    [errors.bound.samples_beyond, errors.bound.samples_checked] =
        samples_beyond(lit, plan, &shown, &|p| !light.is_texture(p.triangle));
    Ok((errors, seen.rays() + fresh.rays() + vertex_rays))
}

/// Samples that count and hold in `counts`: how many are shown beyond bound and noise, of how many.
fn samples_beyond(
    lit: &Lit,
    plan: &Plan,
    shown: &Show<'_>,
    counts: &(dyn Fn(SurfacePoint) -> bool + Sync),
) -> [usize; 2] {
    let checked: Vec<usize> = (0..lit.samples.points.len())
        .filter(|&i| lit.weights[i] > 0.0 && counts(lit.samples.points[i]))
        .collect();
    [lit.beyond(&checked, shown, plan.max_error).len(), checked.len()]
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
    layers: &Layers,
    fresh: &References,
    plan: &Plan,
    clock: &Clock<'_>,
) -> Result<(Vec<f32>, u64), BakeError> {
    let mesh = &surface.mesh;
    let mut vertices: Vec<VertexId> =
        fresh.points.iter().flat_map(|p| mesh.triangles[p.triangle.index()]).collect();
    vertices.sort_unstable();
    vertices.dedup();
    let points: Vec<SurfacePoint> = vertices.iter().map(|&v| surface.point_at(v)).collect();
    let keys: Vec<u64> =
        vertices.iter().map(|v| random::hash(plan.seed, u64::from(v.0), UNSEEN_STREAM, 0)).collect();
    let mut light = Estimates::new(points.len(), signal.channels());
    refine(&mut light, signal, &points, &keys, &vec![plan.effort.sample_batches[0]; points.len()], clock)?;
    let (unit, channels) = (layers.light(surface.lit_normals(&points), &light), layers.channels());
    let mut values = vec![0.0; mesh.vertex_count() * channels];
    for (i, v) in vertices.iter().enumerate() {
        values[v.index() * channels..][..channels].copy_from_slice(unit.value(i));
    }
    Ok((values, light.rays()))
}

/// What `verify` traces.
#[derive(Clone, Debug)]
pub struct VerifyOptions {
    /// Fresh points.
    pub points: usize,
    /// Rays of each reference.
    pub rays: u32,
    /// Seed of points and rays.
    pub seed: u64,
    /// Which scene of the file; its default scene if none.
    pub scene: Option<usize>,
    /// The surroundings, where they lie elsewhere than the file says.
    pub environment: Option<PathBuf>,
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
    clock.stage("read")?;
    let file = crate::file_name(path);
    let environment = options.environment.as_deref();
    let opening = Opening { scene: options.scene, environment, needs_light: true, finish: false };
    let opened = Opened::read(path, opening)?;
    let surface = opened.scenery.surface(&file, &opened.options)?;
    let light = FileLight::read(&surface, &file)?;
    let tracer = Tracer::new(surface.casters(), &surface)?;
    let distance = light.extension.bake.reach();
    surface.turn_hidden_sheets(&tracer, distance, &opened.scenery.lighting);
    let seed = options.seed ^ VERIFY_STREAM;
    let signal = opened.signals.judged_on(&opened.stage(&surface, &tracer, distance, seed))?;
    let signal = signal.as_ref();
    light.expect(signal)?;
    clock.stage("verify")?;
    let batches = options.rays.div_ceil(signal.rays_per_batch()).clamp(2, u32::from(u16::MAX)) as u16;
    let fresh = References::trace(&surface, signal, &light.layers, options.points, batches, seed, &clock)?;
    let views = light.views()?;
    let limit = light.extension.max_error;
    let shown = |p: SurfacePoint, out: &mut [f32]| light.show(&views, p, out);
    let mut errors = fresh.judge(&surface, &shown, &|p| light.is_texture(p.triangle), limit);
    if !opened.signals.is_traced() {
        errors.rays_per_point = 0;
    }
    Ok(errors)
}
