//! Seconds, charts and stretch of chart making: large patches, and thousands of small strips.

#![allow(clippy::print_stdout, missing_docs)]

#[path = "../tests/shapes/mod.rs"]
mod shapes;

use std::time::Instant;

use glam::Vec3;
use lightkiln_chart::{ChartOptions, charts, verify};
use lightkiln_mesh::{Adjacency, Mesh};

fn main() {
    println!(
        "shape,triangles,texel,regions,seconds,charts,splits,merges,cuts,repaired,mean_stretch,max_stretch,symmetric_dirichlet,collapsed,vertices,rectangle_share"
    );
    for n in [71, 224] {
        report("hills 0.05", &shapes::hills(n, 1.0, 0.05, 0.0), 0.25 / n as f32, |_| true);
        report("noisy hills", &shapes::hills(n, 1.0, 0.05, 0.3), 0.25 / n as f32, |_| true);
        report("high hills", &shapes::hills(n, 1.0, 0.4, 0.0), 0.25 / n as f32, |_| true);
    }
    for levels in [5, 7] {
        report("sphere", &shapes::sphere(levels), 0.01, |_| true);
    }
    report("torus", &shapes::torus(128, 2.0, 0.7), 0.01, |_| true);
    // The edge of a shadow across a finely tessellated body: strips of a few triangles' width.
    let band = |p: Vec3| ((p.x * 80.0).sin() * (p.y * 70.0).cos()).abs() < 0.15;
    report("strips", &shapes::hills(700, 1.0, 0.1, 0.2), 0.002, band);
    report("strips on sphere", &shapes::sphere(8), 0.004, |p| (p.x * 40.0).sin().abs() < 0.2);
}

fn report(name: &str, mesh: &Mesh, texel: f32, takes: impl Fn(Vec3) -> bool) {
    let adjacency = Adjacency::new(mesh);
    let taken: Vec<bool> =
        mesh.triangle_ids().map(|t| takes(mesh.corners(t).iter().sum::<Vec3>() / 3.0)).collect();
    let regions = shapes::regions(&adjacency, &taken);
    let start = Instant::now();
    let (charts, r) =
        charts(mesh, &adjacency, &regions, &ChartOptions::new(texel)).expect("shapes can be charted");
    let seconds = start.elapsed().as_secs_f64();
    let bad = charts.iter().filter(|chart| verify(chart, mesh).is_err()).count();
    assert_eq!(bad, 0, "charts that break their promises");
    println!(
        "{name},{},{texel:.5},{},{seconds:.3},{},{},{},{},{},{:.4},{:.3},{:.5},{},{},{:.2}",
        r.triangles,
        regions.len(),
        r.charts,
        r.splits,
        r.merges,
        r.cut_edges,
        r.flips_repaired,
        r.mean_stretch,
        r.max_stretch,
        r.symmetric_dirichlet,
        r.collapsed,
        r.vertices,
        r.chart_area / r.rectangle_texels as f64
    );
}
