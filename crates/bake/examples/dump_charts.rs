//! Writes the charts of a bake as text, for `cargo bench -p lightkiln-chart --bench pack -- FILE`.
//!
//!     cargo run --release -p lightkiln-bake --example dump_charts -- IN.glb > charts.txt
//!
//! `chart WIDTH HEIGHT`, then a line `v U V` per chart vertex and `f A B C` per triangle.

use std::error::Error;
use std::fmt::Write as _;
use std::io::Write as _;
use std::path::Path;

use lightkiln_bake::{BakeOptions, Clock, Plan, Silent, Surface, rounds, shade, verify};
use lightkiln_light::{AmbientOcclusion, Lighting, Tracer};
use lightkiln_sample::{SampleOptions, poisson_disk};
use lightkiln_scene::{ReadOptions, Scene};

fn main() -> Result<(), Box<dyn Error>> {
    let input = std::env::args().nth(1).ok_or("usage: dump_charts IN.glb > charts.txt")?;
    let scene = Scene::read(Path::new(&input), &ReadOptions::default())?;
    let surface = Surface::new(&scene, &input)?;
    let plan = Plan::new(&BakeOptions::default(), &surface.mesh)?;
    let mut clock = Clock::new(&Silent);
    let samples = poisson_disk(&surface.mesh, &SampleOptions { radius: plan.radius, seed: plan.seed })?;
    let tracer = Tracer::new(&surface.mesh, &surface)?;
    let signal = AmbientOcclusion::new(&tracer, &surface.mesh, plan.ao_distance, plan.seed);
    surface.turn_hidden_sheets(&tracer, plan.ao_distance, &Lighting::default());
    let mut lit = shade::light_fit_classify(&surface, &signal, samples, &plan, &mut clock)?;
    let seen = verify::seen_points(&surface, &signal, &lit, &plan, &mut clock)?;
    lit.tighten(&surface, &seen, &plan);
    let shown = rounds::chart_texel_encode(&surface, &signal, None, &lit, &seen, &plan, &mut clock)?;
    let mut text = String::new();
    for chart in &shown.charts {
        writeln!(text, "chart {} {}", chart.size[0], chart.size[1])?;
        for uv in &chart.uv {
            writeln!(text, "v {} {}", uv.x, uv.y)?;
        }
        for [a, b, c] in &chart.corners {
            writeln!(text, "f {a} {b} {c}")?;
        }
    }
    std::io::stdout().write_all(text.as_bytes())?;
    Ok(())
}
