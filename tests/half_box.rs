//! The half box against its closed form: samples, rays, fit and the file that the program writes
//! (Kavan 2011, figure 2 and the first row of table 1; docs/HALF_BOX.md).

#[path = "half_box/closed_form.rs"]
mod closed_form;
mod harness;

use closed_form::{Exact, farthest, observed, openness, places};
use glam::Vec3;
use lightkiln_bake::Surface;
use lightkiln_encode::LightCode;
use lightkiln_fit::{FitOptions, Mass, Method, Observations, Regularizer, energy, fit};
use lightkiln_light::directions::{BATCH, cosine_hemisphere, frame};
use lightkiln_light::{AmbientOcclusion, Estimates, Origin, Tracer};
use lightkiln_mesh::{SurfacePoint, random};
use lightkiln_sample::{SampleOptions, Samples, fresh_points, poisson_disk, radius_for};
use lightkiln_scene::{ReadOptions, Scene};

/// Gauss points along a side of a piece.
const ORDER: usize = 24;
/// Batches of 16 rays that make the paper's 256.
const BATCHES: u16 = 16;
/// What the paper prints for the error of the fit (table 1), with 256 rays a sample.
const PRINTED_ERROR: f64 = 0.159;

const LEAST_SQUARES: Method = Method::LeastSquares { mass: Mass::Sampled };

/// A way to split the squares, with the least-squares values by [`Place`], and the errors
/// of least squares and of averages (100 times the integral over area).
struct Figures {
    file: &'static str,
    values: [f64; 3],
    error: f64,
    averages_error: f64,
}

/// The statement of docs/HALF_BOX.md, digit by digit.
const FIGURES: [Figures; 2] = [
    Figures { file: "half_box.glb", values: [0.2288, 0.5850, 0.9859], error: 0.06952, averages_error: 1.414 },
    Figures {
        file: "half_box_other.glb",
        values: [0.2065, 0.6074, 0.9636],
        error: 0.06952,
        averages_error: 0.668,
    },
];

/// The closed form by another formula, for a place `(s, t)` of any of the squares: the share of a rectangle that stands
/// upright on the point's plane and begins right before the point, twice for each wall.
fn openness_by_rectangles([s, t]: [f64; 2]) -> f64 {
    let wall = |distance: f64, along: f64| {
        let far = distance.hypot(1.0);
        let strip = |width: f64| (width / distance).atan() - distance / far * (width / far).atan();
        (strip(along) + strip(1.0 - along)) / std::f64::consts::TAU
    };
    1.0 - wall(s, t) - wall(t, s)
}

fn read(figures: &Figures) -> Scene {
    Scene::read(&harness::data(figures.file), &ReadOptions::default()).expect("a scene of data/")
}

fn sampled(surface: &Surface<'_>, count: usize, seed: u64) -> Samples {
    let radius = radius_for(&surface.mesh, count);
    poisson_disk(&surface.mesh, &SampleOptions { radius, seed }).expect("a radius")
}

/// Vertex values from values at samples, by the method and no regularizer.
fn fitted(surface: &Surface<'_>, samples: &Samples, values: &[f32], method: Method) -> Vec<f32> {
    let observations = Observations { points: &samples.points, weights: &samples.areas, values, channels: 1 };
    let options = FitOptions { method, regularizer: Regularizer::None, alpha: 0.0, ..Default::default() };
    fit(&surface.mesh, &surface.adjacency, &observations, None, &options)
        .expect("observations that fit")
        .values
}

fn traced(surface: &Surface<'_>, points: &[SurfacePoint], keys: &[u64], seed: u64) -> Estimates {
    let tracer = Tracer::new(&surface.mesh, surface).expect("few triangles");
    let signal = AmbientOcclusion::new(&tracer, &surface.mesh, f32::INFINITY, seed);
    let mut light = Estimates::new(points.len(), 1);
    light.refine(&signal, points, keys, &vec![BATCHES; points.len()]);
    light
}

/// The share of `16 * BATCHES` rays that meet nothing, each drawn by itself, without our stratification.
fn independent_rays(surface: &Surface<'_>, points: &[SurfacePoint], keys: &[u64]) -> Vec<f32> {
    let tracer = Tracer::new(&surface.mesh, surface).expect("few triangles");
    let mut open = Vec::new();
    for (&point, &key) in points.iter().zip(keys) {
        let (origin, normal) =
            Origin::on_surface(&tracer, &surface.mesh, point).expect("triangles with an area");
        let [x, y] = frame(normal);
        let mut misses = 0;
        for batch in 0..u64::from(BATCHES) {
            let directions: [Vec3; BATCH] = std::array::from_fn(|ray| {
                let local = cosine_hemisphere(random::unit2(random::hash(key, batch, ray as u64, 0x1a7)));
                x * local.x + y * local.y + normal * local.z
            });
            let mut hits = [None; BATCH];
            tracer.first_hits(origin, &directions, f32::INFINITY, &mut hits);
            misses += hits.iter().filter(|hit| hit.is_none()).count();
        }
        open.push(misses as f32 / (usize::from(BATCHES) * BATCH) as f32);
    }
    open
}

fn wide(values: &[f32]) -> Vec<f64> {
    values.iter().map(|&v| f64::from(v)).collect()
}

/// `100 / n` times the sum of the squared differences: noise as it adds to an error.
fn mean_square(a: &[f32], b: &[f32]) -> f64 {
    let sum: f64 = a.iter().zip(b).map(|(a, b)| f64::from(a - b).powi(2)).sum();
    100.0 * sum / a.len() as f64
}

fn is_near(value: f64, figure: f64, share: f64) -> bool {
    (value - figure).abs() <= share * figure
}

#[test]
fn closed_form_by_two_formulas_is_the_same() {
    let scene = read(&FIGURES[0]);
    let surface = Surface::new(&scene, "half_box").unwrap();
    let steps = [1e-4_f32, 0.01, 0.2, 0.5, 0.75, 0.98];
    for triangle in surface.mesh.triangle_ids() {
        // The coordinate along the normal is 0: the place in the square is the two others.
        let normal = surface.mesh.geometric_normal(triangle).to_array();
        let k = (0..3).find(|&k| normal[k] > 0.5).unwrap();
        for barycentric in steps.iter().flat_map(|&u| steps.map(|v| [u, v])).filter(|[u, v]| u + v < 1.0) {
            let point = SurfacePoint { triangle, barycentric };
            let at = surface.mesh.position(point).to_array().map(f64::from);
            let place = [at[(k + 1) % 3], at[(k + 2) % 3]];
            let (first, second) = (openness(&surface.mesh, point), openness_by_rectangles(place));
            assert!((first - second).abs() < 1e-6, "{place:?}: {first} and {second}");
        }
    }
}

#[test]
fn closed_form_has_the_stated_figures() {
    for figures in &FIGURES {
        let file = figures.file;
        let scene = read(figures);
        let surface = Surface::new(&scene, file).unwrap();
        let (exact, finer) = (Exact::new(&surface.mesh, ORDER), Exact::new(&surface.mesh, 2 * ORDER));
        let (values, finer) = (exact.least_squares(), finer.least_squares());
        let places = places(&surface.mesh);
        assert_eq!(places.len(), 12);
        for (v, &place) in places.iter().enumerate() {
            let stated = figures.values[place as usize];
            assert!((values[v] - stated).abs() <= 0.5e-4, "{file}: {}, not {stated}", values[v]);
            assert!((values[v] - finer[v]).abs() < 1e-8, "{file}: {} and {}", values[v], finer[v]);
        }
        let (error, averages) = (exact.error(&values), exact.error(&exact.averages()));
        assert!((error - figures.error).abs() <= 0.5e-5, "{file}: E {error}");
        assert!((averages - figures.averages_error).abs() <= 0.5e-3, "{file}: E {averages}");
        // No other values are better, in any direction.
        for (v, step) in (0..values.len()).flat_map(|v| [(v, 1e-3), (v, -1e-3)]) {
            let mut moved = values.clone();
            moved[v] += step;
            assert!(exact.error(&moved) > error, "{file}: vertex {v} moved by {step}");
        }
    }
}

#[test]
fn fit_of_exact_light_converges_to_the_closed_form() {
    const SEEDS: u64 = 4;
    for figures in &FIGURES {
        let file = figures.file;
        let scene = read(figures);
        let surface = Surface::new(&scene, file).unwrap();
        let exact = Exact::new(&surface.mesh, ORDER);
        let (best, averages) = (exact.least_squares(), exact.averages());
        let errors = [figures.error, figures.averages_error];
        // Mean over the seeds of the farthest vertex: least squares, ours, averages.
        let means = [1_000, 10_000, 100_000].map(|count| {
            let mut means = [0.0; 3];
            for seed in 0..SEEDS {
                let samples = sampled(&surface, count, seed);
                let values = observed(&surface.mesh, &samples.points);
                let by = |method| fitted(&surface, &samples, &values, method);
                let (squares, ours, average) = (by(LEAST_SQUARES), by(Method::Ours), by(Method::Average));
                let far = [farthest(&squares, &best), farthest(&ours, &best), farthest(&average, &averages)];
                means = std::array::from_fn(|i| means[i] + far[i] / SEEDS as f64);
                // A miss of d costs d² at the minimum, and d elsewhere: averages come in more slowly.
                let share = [1e-2, 1e-3, 1e-4][count.ilog10() as usize - 3];
                let now = [&squares, &ours, &average].map(|v| exact.error(&wide(v)));
                assert!(is_near(now[0], errors[0], share), "{file}, {count} samples: E {now:?}");
                assert!(is_near(now[1], errors[0], share), "{file}, {count} samples: E {now:?}");
                let share = [1e-1, 3e-2, 1e-2][count.ilog10() as usize - 3];
                assert!(is_near(now[2], errors[1], share), "{file}, {count} samples: E {now:?}");
            }
            means
        });
        println!("{file}: {means:?}");
        for method in 0..3 {
            for step in 0..2 {
                let ratio = means[step][method] / means[step + 1][method];
                // Ten times as many samples: independent ones would gain 3.2.
                assert!((2.2..25.0).contains(&ratio), "{file}, method {method}: {means:?}");
            }
        }
        let [squares, ours, average] = means[2];
        assert!(squares < 1e-3 && ours < 1e-3 && average < 3e-3, "{file}: {means:?}");
    }
}

#[test]
fn rays_agree_with_the_closed_form_within_their_noise() {
    for figures in &FIGURES {
        let file = figures.file;
        let scene = read(figures);
        let surface = Surface::new(&scene, file).unwrap();
        let samples = sampled(&surface, 20_000, 0);
        let light = traced(&surface, &samples.points, &samples.keys, 0);
        let truth = observed(&surface.mesh, &samples.points);
        let off: Vec<f64> = wide(light.means()).iter().zip(wide(&truth)).map(|(a, b)| a - b).collect();
        let count = off.len() as f64;
        let variance = |i: usize| f64::from(light.variance_of_mean(i, 0));
        let within = (0..off.len()).filter(|&i| off[i].abs() <= 3.0 * variance(i).sqrt()).count();
        assert!(within as f64 >= 0.99 * count, "{file}: {within} of {count}");
        // Nothing systematic, and no more noise than stated, nor far less.
        let (bias, square) =
            (off.iter().sum::<f64>() / count, off.iter().map(|o| o * o).sum::<f64>() / count);
        assert!(bias.abs() < 4.0 * (square / count).sqrt(), "{file}: bias {bias}");
        let stated = (0..off.len()).map(variance).sum::<f64>() / count;
        assert!((1.0..2.5).contains(&(stated / square)), "{file}: variance {square}, stated {stated}");

        println!("{file}: {within} of {count} within 3 sigma, variance {square:.3e}, stated {stated:.3e}");

        let exact = Exact::new(&surface.mesh, ORDER);
        let values = fitted(&surface, &samples, light.means(), LEAST_SQUARES);
        let far = farthest(&values, &exact.least_squares());
        assert!(far < 4e-3, "{file}: {far}");
        assert!(is_near(exact.error(&wide(&values)), figures.error, 1e-3), "{file}: {values:?}");
    }
}

#[test]
fn error_against_noisy_samples_is_the_error_and_the_noise() {
    for figures in &FIGURES {
        let file = figures.file;
        let scene = read(figures);
        let surface = Surface::new(&scene, file).unwrap();
        let exact = Exact::new(&surface.mesh, ORDER);
        let samples = sampled(&surface, 20_000, 0);
        let light = traced(&surface, &samples.points, &samples.keys, 0);
        let values = fitted(&surface, &samples, light.means(), LEAST_SQUARES);

        let (points, keys) = fresh_points(&surface.mesh, 60_000, 7);
        let weights = vec![1.0; points.len()];
        let measured = |seen: &[f32]| {
            let observations = Observations { points: &points, weights: &weights, values: seen, channels: 1 };
            energy(&surface.mesh, &observations, None, &values).unwrap()[0].measured
        };
        // Our rays: the noise is half the difference of two sets, and the closed form says the same.
        let [first, second] = [1, 2].map(|seed| traced(&surface, &points, &keys, seed));
        let truth = observed(&surface.mesh, &points);
        let noise = 0.5 * mean_square(first.means(), second.means());
        let true_noise = mean_square(first.means(), &truth);
        let error = measured(first.means());
        println!("{file}: stratified: E {error} noise {noise} {true_noise}");
        assert!(is_near(noise, true_noise, 0.03), "{file}: noise {noise}, {true_noise}");
        assert!(error > 1.15 * figures.error, "{file}: E {error}");
        assert!(is_near(error - noise, figures.error, 0.02), "{file}: E {error}, noise {noise}");

        // Rays drawn one by one: their noise is p (1 - p) / 256, and the sum is near what the paper prints.
        let seen = independent_rays(&surface, &points, &keys);
        let noise = exact.noise_of_independent_rays(256);
        let error = measured(&seen);
        println!("{file}: independent: E {error} noise {noise}");
        assert!(is_near(error - noise, figures.error, 0.03), "{file}: E {error}, noise {noise}");
        assert!(is_near(error, PRINTED_ERROR, 0.05), "{file}: E {error}, printed {PRINTED_ERROR}");
    }
}

#[test]
fn error_by_the_matrices_of_the_paper_is_near_the_printed_one() {
    // Mass from areas and right-hand sides from samples (eq. 4 and 14) miss the values by more, and with the noise
    // of 256 rays the error comes out as printed.
    const SEEDS: u64 = 4;
    for figures in &FIGURES {
        let file = figures.file;
        let scene = read(figures);
        let surface = Surface::new(&scene, file).unwrap();
        let exact = Exact::new(&surface.mesh, ORDER);
        let error = |method| {
            let of_seed = |seed| {
                let samples = sampled(&surface, 10_000, seed);
                let values = observed(&surface.mesh, &samples.points);
                exact.error(&wide(&fitted(&surface, &samples, &values, method)))
            };
            (0..SEEDS).map(of_seed).sum::<f64>() / SEEDS as f64
        };
        let (ours, printed) = (error(LEAST_SQUARES), error(Method::LeastSquares { mass: Mass::Analytic }));
        assert!(printed > 1.03 * ours, "{file}: {printed}, ours {ours}");
        let noisy = printed + exact.noise_of_independent_rays(256);
        println!("{file}: E {printed}, with noise {noisy}");
        assert!(is_near(noisy, PRINTED_ERROR, 0.03), "{file}: E {noisy}, printed {PRINTED_ERROR}");
    }
}

#[test]
fn program_on_vertices_alone_writes_the_closed_form() {
    let folder = harness::Folder::new("half-box");
    for figures in &FIGURES {
        let (file, out) = (figures.file, folder.path(figures.file));
        // So wide a bound that no triangle asks for texture.
        let [from, to] = [harness::data(file), out.clone()].map(std::path::PathBuf::into_os_string);
        let options = ["--ao-distance", "inf", "--max-error", "0.9", "--quiet"].map(std::ffi::OsString::from);
        harness::succeed(["bake".into(), from, "-o".into(), to].into_iter().chain(options));
        let scene = Scene::read(&out, &ReadOptions::default()).unwrap();
        let surface = Surface::new(&scene, file).unwrap();
        let light = scene.read_lightmap().unwrap().unwrap();
        let exact = Exact::new(&surface.mesh, ORDER);
        let (best, places) = (exact.least_squares(), places(&surface.mesh));
        // The program's own target: the same integral with its weak regularizer.
        let regularized = exact.regularized(f64::from(lightkiln_bake::shade::fit_options().alpha));
        for t in surface.mesh.triangle_ids() {
            let (part, local) = surface.part_of(t);
            let codes = light.layers[0].parts[part][local];
            for (v, code) in surface.mesh.triangles[t.index()].iter().zip(codes) {
                let value = LightCode(code).value().map(f64::from).unwrap();
                let (best, regularized) = (best[v.index()], regularized[v.index()]);
                println!("{file} {:?}: {value:.5}", places[v.index()]);
                assert!((value - best).abs() < 0.01, "{file}: {value}, least squares {best}");
                assert!((value - regularized).abs() < 0.005, "{file}: {value}, regularized {regularized}");
            }
        }
    }
}
