//! Measures how fast the fit of the half box comes to its closed form, and draws docs/half_box.svg.
//!
//! `cargo run --release -p lightkiln-bake --example half_box_convergence -- data docs/half_box.svg` prints the
//! tables of docs/HALF_BOX.md. `make figures` does so.
#![allow(clippy::print_stdout)] // tables are what it is for

#[path = "../../../../tests/half_box/closed_form.rs"]
mod closed_form;
mod plot;

use std::error::Error;
use std::path::{Path, PathBuf};

use closed_form::{Exact, Place, farthest, observed, places};
use lightkiln_bake::Surface;
use lightkiln_fit::{FitOptions, Mass, Method, Observations, Regularizer, fit};
use lightkiln_light::{AmbientOcclusion, Estimates, Tracer};
use lightkiln_sample::{SampleOptions, Samples, poisson_disk, radius_for};
use lightkiln_scene::{ReadOptions, Scene};
use plot::Curve;

/// Split from the shared corner, and along the other diagonal.
const FILES: [&str; 2] = ["half_box.glb", "half_box_other.glb"];
/// Gauss points along a side of a piece.
const ORDER: usize = 24;
const COUNTS: [usize; 7] = [100, 300, 1_000, 3_000, 10_000, 30_000, 100_000];
/// Each point of a curve is the mean over so many sets of samples.
const SEEDS: u64 = 8;
/// Batches of 16 rays, for 64 and 256.
const BATCHES: [u16; 2] = [4, 16];

/// What a curve shows: name and color.
const SERIES: [(&str, &str); 4] = [
    ("exact light", "#0072b2"),
    ("256 rays", "#009e73"),
    ("64 rays", "#d55e00"),
    ("exact light, matrices of eq. 4 and 14", "#8a8a8a"),
];

/// Mean number of samples, and means of the farthest vertex and of E, for each of [`SERIES`]; then for averages.
struct Row {
    samples: f64,
    far: [f64; 5],
    errors: [f64; 5],
}

fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments = std::env::args_os().skip(1).map(PathBuf::from);
    let data = arguments.next().unwrap_or_else(|| "data".into());
    let picture = arguments.next().unwrap_or_else(|| "docs/half_box.svg".into());
    let mut curves = Vec::new();
    for (split, file) in FILES.into_iter().enumerate() {
        let rows = measure(&data.join(file), file)?;
        for (s, &(name, color)) in SERIES.iter().enumerate() {
            let points = rows.iter().map(|row| [row.samples, row.far[s]]).collect();
            curves.push(Curve { name, color, dashed: split == 1, points });
        }
    }
    std::fs::write(&picture, plot::svg(&curves))?;
    println!("{}", picture.display());
    Ok(())
}

/// Prints the figures of one file and measures its rows.
fn measure(path: &Path, name: &str) -> Result<Vec<Row>, Box<dyn Error>> {
    let scene = Scene::read(path, &ReadOptions::default())?;
    let surface = Surface::new(&scene, name)?;
    let exact = Exact::new(&surface.mesh, ORDER);
    let (best, averages) = (exact.least_squares(), exact.averages());
    let places = places(&surface.mesh);
    let show = |title: &str, values: &[f64]| {
        let of = |place: Place| {
            let found: Vec<f64> =
                places.iter().zip(values).filter(|(p, _)| **p == place).map(|(_, v)| *v).collect();
            found.iter().sum::<f64>() / found.len() as f64
        };
        let [corner, neighbour, far] = [Place::Corner, Place::Neighbour, Place::Far].map(of);
        let error = exact.error(values);
        println!("  {title:<42} {corner:.5} {neighbour:.5} {far:.5}  E {error:.5}");
    };
    println!("{name}: mean values of corner, neighbour and far corner");
    show("closed form", &best);
    show("closed form, averages", &averages);
    show("closed form, alpha 0.01", &exact.regularized(0.01));
    println!("  noise of 256 independent rays in E: {:.5}", exact.noise_of_independent_rays(256));

    let tracer = Tracer::new(&surface.mesh, &surface)?;
    let signal = AmbientOcclusion::new(&tracer, &surface.mesh, f32::INFINITY, 0);
    let mut rows = Vec::new();
    for count in COUNTS {
        let mut row = Row { samples: 0.0, far: [0.0; 5], errors: [0.0; 5] };
        for seed in 0..SEEDS {
            let radius = radius_for(&surface.mesh, count);
            let samples = poisson_disk(&surface.mesh, &SampleOptions { radius, seed })?;
            let truth = observed(&surface.mesh, &samples.points);
            let mut light = Estimates::new(samples.len(), 1);
            let rays = BATCHES.map(|batches| {
                light.refine(&signal, &samples.points, &samples.keys, &vec![batches; samples.len()]);
                light.means().to_vec()
            });
            let squares = Method::LeastSquares { mass: Mass::Sampled };
            let printed = Method::LeastSquares { mass: Mass::Analytic };
            let fits = [
                fitted(&surface, &samples, &truth, squares)?,
                fitted(&surface, &samples, &rays[1], squares)?,
                fitted(&surface, &samples, &rays[0], squares)?,
                fitted(&surface, &samples, &truth, printed)?,
                fitted(&surface, &samples, &truth, Method::Average)?,
            ];
            row.samples += samples.len() as f64 / SEEDS as f64;
            for (i, fit) in fits.iter().enumerate() {
                let goal = if i == 4 { &averages } else { &best };
                row.far[i] += farthest(fit, goal) / SEEDS as f64;
                row.errors[i] += exact.error(&wide(fit)) / SEEDS as f64;
            }
            if seed == 0 && [10_000, 100_000].contains(&count) {
                for (title, fit) in
                    ["exact", "256 rays", "64 rays", "exact, eq. 14", "exact, averages"].iter().zip(&fits)
                {
                    show(&format!("{} samples, {title}", samples.len()), &wide(fit));
                }
            }
        }
        let [far, errors] = [row.far, row.errors].map(|row| row.map(|x| format!("{x:.5}")).join("  "));
        println!("  {:>8.0} samples: farthest {far}  E {errors}", row.samples);
        rows.push(row);
    }
    Ok(rows)
}

fn wide(values: &[f32]) -> Vec<f64> {
    values.iter().map(|&v| f64::from(v)).collect()
}

fn fitted(
    surface: &Surface<'_>,
    samples: &Samples,
    values: &[f32],
    method: Method,
) -> Result<Vec<f32>, lightkiln_fit::FitError> {
    let observations = Observations { points: &samples.points, weights: &samples.areas, values, channels: 1 };
    let options = FitOptions { method, regularizer: Regularizer::None, alpha: 0.0, ..Default::default() };
    Ok(fit(&surface.mesh, &surface.adjacency, &observations, None, &options)?.values)
}
