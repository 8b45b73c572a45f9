//! Irradiance at points of a scene, as `tests/peers` compares it with that of other path tracers.
//!
//!     cargo run --release -p lightkiln-bake --example irradiance_points -- IN.glb [POINTS [BATCHES]] > ours.json
//!
//! Points are spread evenly over the surface; those inside of other geometry are left out. Prints position, normal,
//! direct and all irradiance in lux with their standard errors.

use std::error::Error;
use std::path::Path;
use std::time::Instant;

use lightkiln_bake::Surface;
use lightkiln_bake::lighting::LightOptions;
use lightkiln_light::{Estimates, Output, PathOptions, PathTraced, Signal, Tracer};
use lightkiln_sample::fresh_points;
use lightkiln_scene::Scene;
use serde_json::{Value, json};

const SEED: u64 = 1;

fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments = std::env::args().skip(1);
    let input = arguments.next().ok_or("usage: irradiance_points IN.glb [POINTS [BATCHES]]")?;
    let count: usize = arguments.next().map_or(Ok(1000), |n| n.parse())?;
    let batches: u16 = arguments.next().map_or(Ok(2048), |n| n.parse())?;

    let options = LightOptions::default();
    let scene = Scene::read(Path::new(&input), &options.read_options(None, true))?;
    let lighting = options.lighting(&scene)?;
    let surface = Surface::new(&scene, &input)?;
    let mesh = &surface.mesh;
    let tracer = Tracer::new(mesh, &surface)?;
    let path = PathOptions { seed: SEED, ..PathOptions::default() };
    let signal = PathTraced::new(&tracer, mesh, &lighting, &[Output::Direct, Output::Irradiance], path)?;

    let start = Instant::now();
    let (mut points, mut keys) = fresh_points(mesh, count, SEED);
    // One batch tells which points lie inside; others take their place until there are enough.
    let mut enough = count;
    let estimates = loop {
        let mut estimates = Estimates::new(points.len(), signal.channels());
        estimates.refine(&signal, &points, &keys, &vec![1; points.len()]);
        let valid: Vec<usize> = (0..points.len()).filter(|&i| estimates.valid(i)).collect();
        if valid.len() >= count || enough > 16 * count {
            // Evenly from all over the surface.
            let taken = valid.len().min(count);
            let chosen: Vec<usize> = (0..taken).map(|k| valid[k * valid.len() / taken]).collect();
            points = chosen.iter().map(|&i| points[i]).collect();
            keys = chosen.iter().map(|&i| keys[i]).collect();
            let mut estimates = Estimates::new(points.len(), signal.channels());
            estimates.refine(&signal, &points, &keys, &vec![batches; points.len()]);
            break estimates;
        }
        enough += count / 8 + 1;
        (points, keys) = fresh_points(mesh, enough, SEED);
    };
    let seconds = start.elapsed().as_secs_f64();

    let values = |i: usize, layer: usize| -> [f32; 3] { [0, 1, 2].map(|c| estimates.mean(i)[3 * layer + c]) };
    let errors = |i: usize, layer: usize| -> [f32; 3] {
        [0, 1, 2].map(|c| estimates.spread_variance_of_mean(i, 3 * layer + c).sqrt())
    };
    let point = |i: usize| {
        json!({
            "position": mesh.position(points[i]).to_array(),
            "normal": mesh.shading_normal(points[i]).to_array(),
            "direct": values(i, 0), "directError": errors(i, 0),
            "irradiance": values(i, 1), "irradianceError": errors(i, 1),
        })
    };
    let answer = json!({
        "by": "lightkiln",
        "seconds": seconds,
        "samples": u32::from(batches) * signal.rays_per_batch(),
        "points": (0..points.len()).map(point).collect::<Vec<Value>>(),
    });
    #[allow(clippy::print_stdout)] // what it is for
    {
        println!("{answer}");
    }
    Ok(())
}
