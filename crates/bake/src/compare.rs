//! Vertex values alone: one scene's samples fitted by several methods and weights, with what each costs.
//!
//! This is table 1 of Kavan 2011 for any scene and signal. Every method is fitted to the same samples; point sampling
//! takes the light at the vertices, with as many rays each. The error is the paper's, `100 ∫ (f - g)² / area` over the
//! samples of the fit. It has two faults as a measure, and both are answered: it contains the noise of the samples
//! ([`Row::noise`]), and a fit has seen the samples that it is judged by ([`Row::fresh`] is over others).
//!
//! Samples inside other geometry count neither in fits nor in errors.

use std::time::Instant;

use lightkiln_fit::{
    Bounds, Energy, Fit, FitOptions, Mass, Method, Observations, Regularizer, System, energy_shown, fit, look,
};
use lightkiln_light::{Estimates, Signal};
use lightkiln_mesh::{SurfacePoint, VertexId, random};
use lightkiln_sample::{SampleOptions, Samples, fresh_points, poisson_disk};
use serde::Serialize;

use crate::clock::Clock;
use crate::options::Plan;
use crate::shade::refine;
use crate::{BakeError, Surface};

/// One point that is judged by for so many that are fitted to.
const FITTED_PER_FRESH: usize = 4;

/// Points with their light.
pub struct Lit {
    /// Where.
    pub points: Vec<SurfacePoint>,
    /// The area that each stands for; 0 inside other geometry.
    pub weights: Vec<f32>,
    /// The light.
    pub estimates: Estimates,
    /// The variance of each value, points × channels.
    pub variances: Vec<f32>,
}

impl Lit {
    /// The points as a fit takes them.
    pub fn observations(&self) -> Observations<'_> {
        Observations {
            points: &self.points,
            weights: &self.weights,
            values: self.estimates.means(),
            channels: self.estimates.channels,
        }
    }
}

/// What all methods share: light at samples, at the vertices and at points that no fit sees.
pub struct Gathered {
    /// What is fitted to.
    pub samples: Lit,
    /// Points that no fit has seen.
    pub fresh: Lit,
    /// The light at the vertices, V × C.
    pub at_vertices: Vec<f32>,
    /// Seconds that the rays of the samples took.
    pub ray_seconds: f64,
    /// Batches of a sample.
    pub batches: u16,
}

impl Gathered {
    /// Samples a surface and shades samples, vertices and fresh points.
    ///
    /// - `batches`: of rays, for each point
    ///
    /// # Errors
    /// [`BakeError::Sample`].
    pub fn new(
        surface: &Surface<'_>,
        signal: &dyn Signal,
        plan: &Plan,
        batches: u16,
        clock: &mut Clock<'_>,
    ) -> Result<Self, BakeError> {
        let mesh = &surface.mesh;
        clock.stage("sample")?;
        let Samples { points, keys, areas, .. } =
            poisson_disk(mesh, &SampleOptions { radius: plan.radius, seed: plan.seed })?;
        clock.stage("light")?;
        let shade = |points: Vec<SurfacePoint>,
                     keys: &[u64],
                     areas: Vec<f32>,
                     clock: &Clock<'_>|
         -> Result<Lit, BakeError> {
            let mut estimates = Estimates::new(points.len(), signal.channels());
            refine(&mut estimates, signal, &points, keys, &vec![batches; points.len()], clock)?;
            let weights = areas
                .iter()
                .enumerate()
                .map(|(i, &area)| if estimates.valid(i) { area } else { 0.0 })
                .collect();
            let channels = estimates.channels;
            let variances = (0..points.len() * channels)
                .map(|at| estimates.spread_variance_of_mean(at / channels, at % channels))
                .collect();
            Ok(Lit { points, weights, estimates, variances })
        };
        let start = Instant::now();
        let samples = shade(points, &keys, areas, clock)?;
        let ray_seconds = start.elapsed().as_secs_f64();
        let (points, keys) =
            fresh_points(mesh, samples.points.len() / FITTED_PER_FRESH, random::finalize(plan.seed));
        let areas = vec![1.0; points.len()];
        let fresh = shade(points, &keys, areas, clock)?;
        let vertices = (0..mesh.vertex_count() as u32).map(VertexId);
        let points: Vec<SurfacePoint> = vertices.clone().map(|v| surface.point_at(v)).collect();
        let keys: Vec<u64> = vertices.map(|v| random::hash(plan.seed, u64::from(v.0), u64::MAX, 0)).collect();
        let areas = vec![1.0; points.len()];
        let at_vertices = shade(points, &keys, areas, clock)?.estimates.means().to_vec();
        Ok(Self { samples, fresh, at_vertices, ray_seconds, batches })
    }
}

/// One way to find vertex values.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Way {
    /// How.
    pub method: Method,
    /// What smooths.
    pub regularizer: Regularizer,
    /// How much.
    pub alpha: f32,
}

impl Way {
    /// A method without anything that smooths.
    pub fn plain(method: Method) -> Self {
        Self { method, regularizer: Regularizer::Edge, alpha: 0.0 }
    }

    /// Whether alpha makes a difference.
    pub fn is_smoothed(&self) -> bool {
        !matches!(self.method, Method::PointSample | Method::Average)
    }

    /// What the method is called.
    pub fn name(&self) -> &'static str {
        match (self.method, self.alpha > 0.0, self.regularizer) {
            (Method::PointSample, ..) => "point",
            (Method::Average, ..) => "average",
            (Method::LeastSquares { mass: Mass::Sampled }, ..) => "least squares, sampled",
            (Method::LeastSquares { mass: Mass::Analytic }, ..) => "least squares, analytic",
            (Method::Ours, false, _) | (Method::Ours, _, Regularizer::None) => "ours",
            (Method::Ours, true, Regularizer::Edge) => "ours, edge",
            (Method::Ours, true, Regularizer::EdgePrinted) => "ours, edge as printed",
            (Method::Ours, true, Regularizer::Gradient) => "ours, gradient",
            (Method::Ours, true, Regularizer::Both) => "ours, edge and gradient",
        }
    }
}

/// What happens to values outside the signal's range: [`Bounds`], before the range is known.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Outside {
    /// They stay.
    #[default]
    None,
    /// They are clamped.
    Clamp,
    /// They stay, and what is interpolated between them is clamped.
    ClampAfter,
    /// The least error within the range.
    Optimum,
}

impl Outside {
    /// The bounds for a range.
    pub fn bounds(self, [low, high]: [f32; 2]) -> Bounds {
        match self {
            Self::None => Bounds::None,
            Self::Clamp => Bounds::Clamp { low, high },
            Self::ClampAfter => Bounds::ClampAfterInterpolation { low, high },
            Self::Optimum => Bounds::Optimum { low, high },
        }
    }
}

/// Values outside the signal's range, before anything was done about them.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Beyond {
    /// How many of the vertex values, all channels together.
    pub count: usize,
    /// What share of them.
    pub share: f64,
    /// How far the worst is outside.
    pub largest: f64,
    /// How far they are on average.
    pub mean: f64,
}

impl Beyond {
    fn of(values: &[f32], [low, high]: [f32; 2]) -> Self {
        let beyond = values.iter().map(|v| f64::from((low - v).max(v - high))).filter(|&d| d > 0.0);
        let (count, largest, sum) =
            beyond.fold((0, 0.0_f64, 0.0), |(count, most, sum), d| (count + 1, most.max(d), sum + d));
        Self::new(count, values.len(), largest, sum / count.max(1) as f64)
    }

    fn new(count: usize, values: usize, largest: f64, mean: f64) -> Self {
        Self { count, share: count as f64 / values.max(1) as f64, largest, mean }
    }
}

/// What one way costs and gives. Means over channels.
#[derive(Clone, Debug, Serialize)]
pub struct Row {
    /// How vertex values were found.
    pub method: &'static str,
    /// Weight of the regularizer.
    pub alpha: f32,
    /// Error over the samples of the fit, noise included, as the paper prints it.
    pub error: f64,
    /// The part of `error` that is noise of the samples; a fit that follows it hides a little of it.
    pub noise: f64,
    /// Error at points that the fit has not seen, their noise taken off.
    pub fresh: f64,
    /// Standard deviation of the interpolated values over the surface.
    pub contrast: f64,
    /// Root mean square of the gradient jumps over interior edges.
    pub gradient_jump: f64,
    /// Seconds of assembly, factorization and solution; of a new alpha, what is left of these.
    pub seconds: f64,
    /// Estimated peak of the fit's memory.
    pub memory_bytes: usize,
    /// Values outside the signal's range, as fitted.
    pub outside: Beyond,
}

/// A row with its values.
pub struct Tried {
    /// What was tried.
    pub way: Way,
    /// Vertex values, V × C.
    pub values: Vec<f32>,
    /// What it costs and gives.
    pub row: Row,
}

/// Tries many ways on the same samples. Ways that differ from the one before in alpha only reuse its structure.
///
/// - `range`: of the signal; `outside`: what happens to values outside of it
///
/// # Errors
/// [`BakeError::Fit`].
pub fn try_all(
    surface: &Surface<'_>,
    gathered: &Gathered,
    range: [f32; 2],
    outside: Outside,
    ways: &[Way],
    clock: &mut Clock<'_>,
) -> Result<Vec<Tried>, BakeError> {
    clock.stage("fit")?;
    let observations = gathered.samples.observations();
    let bounds = outside.bounds(range);
    let mut system: Option<(Way, System<'_>)> = None;
    let mut tried = Vec::with_capacity(ways.len());
    for &way in ways {
        let options = FitOptions {
            method: way.method,
            regularizer: way.regularizer,
            alpha: way.alpha,
            bounds,
            ..FitOptions::default()
        };
        let start = Instant::now();
        let mut found = match way.method {
            Method::PointSample => Fit { values: gathered.at_vertices.clone(), ..Fit::default() },
            Method::Average => fit(&surface.mesh, &surface.adjacency, &observations, None, &options)?,
            Method::LeastSquares { .. } | Method::Ours => {
                let same = |(w, _): &(Way, _)| (w.method, w.regularizer) == (way.method, way.regularizer);
                let (_, system) = match system.take().filter(same) {
                    Some((_, mut before)) => {
                        before.set_alpha(way.alpha)?;
                        system.insert((way, before))
                    }
                    None => {
                        let new =
                            System::new(&surface.mesh, &surface.adjacency, &observations, None, &options)?;
                        system.insert((way, new))
                    }
                };
                system.solve()?
            }
        };
        let seconds = start.elapsed().as_secs_f64();
        let beyond = match (way.method, bounds) {
            (Method::PointSample, _) | (_, Bounds::None) => Beyond::of(&found.values, range),
            _ => {
                let report = &found.report;
                let (count, largest) = (report.below + report.above, f64::from(report.farthest_outside));
                Beyond::new(count, found.values.len(), largest, report.mean_outside())
            }
        };
        if way.method == Method::PointSample
            && matches!(bounds, Bounds::Clamp { .. } | Bounds::Optimum { .. })
        {
            let [low, high] = range;
            found.values.iter_mut().for_each(|v| *v = v.max(low).min(high));
        }
        let shown = if outside == Outside::ClampAfter { bounds.range() } else { None };
        let row = Row { outside: beyond, ..judge(surface, gathered, shown, way, &found, seconds)? };
        tried.push(Tried { way, values: found.values, row });
    }
    Ok(tried)
}

fn judge(
    surface: &Surface<'_>,
    gathered: &Gathered,
    shown: Option<(f32, f32)>,
    way: Way,
    found: &Fit,
    seconds: f64,
) -> Result<Row, BakeError> {
    let channels = gathered.samples.estimates.channels;
    let mean = |list: &[Energy], of: fn(&Energy) -> f64| list.iter().map(of).sum::<f64>() / channels as f64;
    let over = |lit: &Lit| {
        energy_shown(&surface.mesh, &lit.observations(), Some(&lit.variances), &found.values, shown)
    };
    let (seen, fresh) = (over(&gathered.samples)?, over(&gathered.fresh)?);
    let looks = look(&surface.mesh, &surface.adjacency, &found.values, channels)?;
    Ok(Row {
        method: way.name(),
        alpha: way.alpha,
        error: mean(&seen, |e| e.measured),
        noise: mean(&seen, |e| e.noise),
        fresh: mean(&fresh, Energy::of_fit),
        contrast: looks.iter().map(|l| l.contrast).sum::<f64>() / channels as f64,
        gradient_jump: looks.iter().map(|l| l.gradient_jump).sum::<f64>() / channels as f64,
        seconds,
        memory_bytes: found.report.memory_bytes,
        outside: Beyond::default(),
    })
}

/// Table 1 of Kavan 2011 for one scene: its columns, and the rows behind them.
#[derive(Clone, Debug, Serialize)]
pub struct Comparison {
    /// Light vertices: positions that share a normal and are connected count once.
    pub vertices: usize,
    /// Triangles.
    pub triangles: usize,
    /// Samples that the fits see.
    pub samples: usize,
    /// Samples inside other geometry, which count for nothing.
    pub hidden_samples: usize,
    /// Rays of a sample; 0 where nothing is traced.
    pub rays_per_sample: u32,
    /// Seconds that the rays of the samples took.
    pub ray_seconds: f64,
    /// The alpha of `error_ours`.
    pub alpha: f32,
    /// What happened to values outside the signal's range.
    pub bounds: Outside,
    /// `E` of the light at the vertices.
    pub error_point: f64,
    /// `E` of weighted averages.
    pub error_average: f64,
    /// `E` of ours at `alpha`.
    pub error_ours: f64,
    /// `E` of ours without a regularizer.
    pub error_least_squares: f64,
    /// The part of each of these that is noise of the samples.
    pub noise: f64,
    /// Seconds of the fit of ours at `alpha`.
    pub solve_seconds: f64,
    /// And its memory.
    pub solve_memory_bytes: usize,
    /// Every method that was tried.
    pub rows: Vec<Row>,
}

/// What [`compare`] does with a signal.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CompareOptions {
    /// The signal comes from rays.
    pub traced: bool,
    /// Batches of rays for each point.
    pub batches: u16,
    /// The alpha of ours.
    pub alpha: f32,
    /// What happens to values outside the signal's range.
    pub bounds: Outside,
}

/// Fits one scene's vertices by every method.
///
/// # Errors
/// [`BakeError::Sample`] and [`BakeError::Fit`].
pub fn compare(
    surface: &Surface<'_>,
    signal: &dyn Signal,
    plan: &Plan,
    options: CompareOptions,
    clock: &mut Clock<'_>,
) -> Result<Comparison, BakeError> {
    let CompareOptions { traced, batches, alpha, bounds } = options;
    let gathered = Gathered::new(surface, signal, plan, batches, clock)?;
    let ways = [
        Way::plain(Method::PointSample),
        Way::plain(Method::Average),
        Way::plain(Method::LeastSquares { mass: Mass::Sampled }),
        Way::plain(Method::LeastSquares { mass: Mass::Analytic }),
        Way { alpha, ..Way::plain(Method::Ours) },
        Way::plain(Method::Ours),
    ];
    let tried = try_all(surface, &gathered, signal.range(), bounds, &ways, clock)?;
    let [point, average, _, _, ours, least] = std::array::from_fn(|i| &tried[i].row);
    let hidden_samples = gathered.samples.weights.iter().filter(|&&w| w <= 0.0).count();
    Ok(Comparison {
        vertices: surface.mesh.vertex_count(),
        triangles: surface.mesh.triangle_count(),
        samples: gathered.samples.points.len(),
        hidden_samples,
        rays_per_sample: if traced { u32::from(gathered.batches) * signal.rays_per_batch() } else { 0 },
        ray_seconds: gathered.ray_seconds,
        alpha,
        bounds,
        error_point: point.error,
        error_average: average.error,
        error_ours: ours.error,
        error_least_squares: least.error,
        noise: point.noise,
        solve_seconds: ours.seconds,
        solve_memory_bytes: ours.memory_bytes,
        rows: tried.iter().map(|t| t.row.clone()).collect(),
    })
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use lightkiln_light::Tracer;
    use lightkiln_scene::{ReadOptions, Scene};

    use super::*;
    use crate::clock::Silent;
    use lightkiln_light::Lighting;

    use crate::options::BakeOptions;
    use crate::signals::SignalChoice;

    fn compared(scene: &str, signal: &str, samples: usize) -> Comparison {
        compared_within(scene, signal, samples, Outside::None)
    }

    fn compared_within(scene: &str, signal: &str, samples: usize, bounds: Outside) -> Comparison {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../data").join(scene);
        let scene = Scene::read(&path, &ReadOptions::default()).unwrap();
        let surface = Surface::new(&scene, "test").unwrap();
        let options = BakeOptions {
            samples: Some(samples),
            ao_distance: Some(f32::INFINITY),
            ..BakeOptions::default()
        };
        let plan = Plan::new(&options, &surface.mesh).unwrap();
        let tracer = Tracer::new(&surface.mesh, &surface).unwrap();
        let choice: SignalChoice = signal.parse().unwrap();
        let lighting = Lighting::default();
        let signal = choice.on(&plan.stage(&surface, &tracer, &lighting)).unwrap();
        let mut clock = Clock::new(&Silent);
        let options = CompareOptions { traced: choice.is_traced(), batches: 4, alpha: 0.1, bounds };
        compare(&surface, &*signal, &plan, options, &mut clock).unwrap()
    }

    #[test]
    fn compare_of_the_half_box_puts_least_squares_first() {
        let c = compared("half_box.glb", "ao", 4000);
        assert_eq!((c.vertices, c.triangles, c.rays_per_sample, c.hidden_samples), (12, 6, 64, 0));
        assert!(c.error_least_squares < c.error_ours && c.error_ours < 0.5 * c.error_point, "{c:?}");
        assert!(c.error_ours < 0.2 * c.error_average, "{c:?}");
        // What is left without noise is what the fit cannot show, at fresh points as at its own.
        let least = &c.rows[5];
        assert!((least.error - least.noise - least.fresh).abs() < 0.02, "{least:?}");
    }

    #[test]
    fn compare_of_a_shadow_keeps_the_order() {
        let c = compared("l_shape.glb", "shadow:-0.5,2.2,-0.8,0.08", 20_000);
        assert!(c.error_least_squares < c.error_ours && c.error_ours < c.error_average, "{c:?}");
        assert!(c.rows.iter().all(|row| row.fresh > 0.0 && row.noise > 0.0), "{c:?}");
    }

    #[test]
    fn compare_within_bounds_counts_the_same_and_orders_the_errors() {
        let signal = "shadow:-0.5,2.2,-0.8,0.08";
        let [free, clamp, after, optimum] =
            [Outside::None, Outside::Clamp, Outside::ClampAfter, Outside::Optimum]
                .map(|bounds| compared_within("l_shape.glb", signal, 20_000, bounds).rows.swap_remove(5));
        assert!(free.outside.count > 0 && free.outside.mean > 0.0, "{free:?}");
        assert!(free.outside.mean <= free.outside.largest, "{free:?}");
        for row in [&clamp, &after, &optimum] {
            assert_eq!(row.outside.count, free.outside.count, "{row:?}");
            assert!((row.outside.mean - free.outside.mean).abs() < 1e-6, "{row:?}");
            assert!((row.outside.largest - free.outside.largest).abs() < 1e-6, "{row:?}");
        }
        // Least squares is the least of what is shown unclamped; what is clamped after it comes closer still.
        assert!(free.error <= optimum.error && optimum.error <= clamp.error, "{optimum:?}");
        assert!(after.error <= free.error, "{after:?}");
    }

    #[test]
    fn compare_of_a_texture_has_no_noise() {
        let c = compared("fence.glb", "base-color", 20_000);
        assert_eq!((c.rays_per_sample, c.noise), (0, 0.0));
        assert!(c.error_least_squares <= c.error_ours && c.error_least_squares > 0.0, "{c:?}");
    }

    #[test]
    fn signal_that_a_scene_lacks_is_an_error() {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../data/half_box.glb");
        let scene = Scene::read(&path, &ReadOptions::default()).unwrap();
        let surface = Surface::new(&scene, "test").unwrap();
        let plan = Plan::new(&BakeOptions::default(), &surface.mesh).unwrap();
        let tracer = Tracer::new(&surface.mesh, &surface).unwrap();
        let lighting = Lighting::default();
        let stage = plan.stage(&surface, &tracer, &lighting);
        for choice in [SignalChoice::Occlusion, SignalChoice::FileLightmap, SignalChoice::BaseColor] {
            assert!(matches!(choice.on(&stage), Err(BakeError::NoSignal { .. })), "{choice:?}");
        }
    }
}
