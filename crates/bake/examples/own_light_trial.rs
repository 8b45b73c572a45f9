#![allow(missing_docs, clippy::print_stdout, clippy::unwrap_used)]
use lightkiln_bake::{clock::Silent, signals::SignalChoice, *};
use lightkiln_light::{AmbientOcclusion, Tracer};
use lightkiln_sample::{SampleOptions, poisson_disk};
use lightkiln_scene::{ReadOptions, Scene};
fn main() {
    let args: Vec<String> = std::env::args().collect();
    let (input, output) = (std::path::Path::new(&args[1]), std::path::Path::new(&args[2]));
    let options = BakeOptions::default();
    let mut clock = Clock::new(&Silent);
    let scene = Scene::read(input, &ReadOptions::default()).unwrap();
    let surface = Surface::new(&scene, "x").unwrap();
    let plan = Plan::new(&options, &surface.mesh).unwrap();
    let samples = poisson_disk(&surface.mesh, &SampleOptions { radius: plan.radius, seed: plan.seed }).unwrap();
    let tracer = Tracer::new(&surface.mesh, &surface).unwrap();
    surface.turn_hidden_sheets(&AmbientOcclusion::new(&tracer, &surface.mesh, plan.ao_distance, 0));
    let choice: SignalChoice = args[3].parse().unwrap();
    let signal = choice.on(&surface, &tracer, &plan).unwrap();
    let signal = &*signal;
    let lit = shade::light_fit_classify(&surface, signal, samples, &plan, &mut clock).unwrap();
    println!("texture triangles {} of {}", lit.needs_texture.iter().filter(|t| **t).count(), lit.needs_texture.len());
    let seen = verify::seen_points(&surface, signal, lit.estimates.rays(), &plan, &mut clock);
    let shown = rounds::chart_texel_encode(&surface, signal, &lit, &seen, &plan, &mut clock).unwrap();
    println!("rounds {} shaded texels {}", shown.rounds, shown.shaded_texels);
    let written = output::write(&surface, &shown, &plan, &options, output, &mut clock).unwrap();
    let errors = verify::written_file(&surface, signal, &lit, &seen, &shown, &written, &plan, &mut clock).unwrap();
    println!("{}", lightkiln_report::table::errors_table(&errors));
}
