//! Times of lifting, stitching and composing about a million texels, and what stitching does to the error.
//!
//! `cargo bench -p lightkiln-texel`

#![allow(clippy::print_stdout, clippy::unwrap_used, reason = "a bench prints, and its input is its own")]

#[path = "../tests/shapes/mod.rs"]
mod shapes;

use glam::{Vec2, Vec3};
use lightkiln_chart::Chart;
use lightkiln_chart::pack::{PackOptions, pack};
use lightkiln_mesh::{Adjacency, Mesh, SurfacePoint, TriangleId, random};
use lightkiln_texel::{Observations, StitchOptions, compose, lift, stitch};
use std::time::Instant;

fn signal(p: Vec3) -> f32 {
    let shadow = (0.5 + (p.z - 0.9 - 0.3 * p.y + 0.05 * (9.0 * p.x).sin()) / 0.02).clamp(0.0, 1.0);
    0.2 + 0.2 * p.x * p.y + 0.5 * shadow
}

fn timed<T>(what: &str, run: impl FnOnce() -> T) -> T {
    let start = Instant::now();
    let out = run();
    println!("  {what:<28} {:>8.0} ms", start.elapsed().as_secs_f64() * 1e3);
    out
}

fn samples(mesh: &Mesh, radius: f64) -> (Vec<SurfacePoint>, Vec<f32>, Vec<f32>) {
    let (mut points, mut areas, mut values) = (Vec::new(), Vec::new(), Vec::new());
    for t in mesh.triangle_ids() {
        let area = mesh.area(t);
        let count =
            (area / (radius * radius) + f64::from(random::unit(random::hash(1, t.0.into(), 0, 0)))) as u64;
        for k in 0..count {
            let square = random::unit2(random::hash(3, t.0.into(), k, 0));
            let point =
                SurfacePoint { triangle: TriangleId(t.0), barycentric: random::square_to_triangle(square) };
            points.push(point);
            areas.push((area / count as f64) as f32);
            values.push(signal(mesh.position(point)));
        }
    }
    (points, areas, values)
}

fn case(name: &str, mesh: &Mesh, charts: &[Chart], texel: f64, noise: f32) {
    let total: u64 = charts.iter().map(|c| u64::from(c.size[0]) * u64::from(c.size[1])).sum();
    println!("{name}: {} triangles, {} charts, {total} texels", mesh.triangle_count(), charts.len());
    let adjacency = Adjacency::new(mesh);
    let texels = timed("lift", || lift(mesh, &adjacency, charts, 1));
    let mut shaded = shapes::shade(mesh, &texels, signal);
    for (values, texels) in shaded.iter_mut().zip(&texels) {
        for (value, &key) in values.iter_mut().zip(&texels.keys) {
            *value += noise * 3.464 * (random::unit(key) - 0.5);
        }
    }
    let error = |values: &[Vec<f32>]| {
        let (max, rms) = shapes::errors(mesh, charts, values, signal);
        println!("    error: max {max:.4}, rms {rms:.5}");
    };
    let mut values = shaded.clone();
    let loose = StitchOptions { seam_weight: 0.0, vertex_weight: 0.0, ..Default::default() };
    timed("stitch without seams", || stitch(mesh, charts, &texels, &mut values, 1, &loose)).unwrap();
    error(&values);
    let mut values = shaded.clone();
    let report = timed("stitch", || stitch(mesh, charts, &texels, &mut values, 1, &StitchOptions::default()));
    println!("    {:?}", report.unwrap());
    error(&values);
    let (points, areas, mut seen) = samples(mesh, texel);
    for (k, value) in seen.iter_mut().enumerate() {
        *value += noise * 3.464 * (random::unit(random::hash(4, k as u64, 0, 0)) - 0.5);
    }
    let observations = Observations::from_samples(mesh, charts, &points, &areas, &seen, 1).unwrap();
    let options = StitchOptions { observations: Some(&observations), ..Default::default() };
    let mut values = shaded;
    let report =
        timed("stitch, a sample per texel", || stitch(mesh, charts, &texels, &mut values, 1, &options));
    println!("    {:?}", report.unwrap().seam_after);
    error(&values);
    let packing = pack(charts, &PackOptions::default()).unwrap();
    let atlas = timed("compose", || compose(charts, &texels, &values, 1, &packing)).unwrap();
    println!(
        "    {} pages of {:?}: {} shown, {} gutter, {} waste",
        packing.pages,
        atlas.size,
        atlas.shown,
        atlas.gutter,
        atlas.waste()
    );
    let mut png = Vec::new();
    timed("png, 8 bits", || {
        lightkiln_texel::write_png(&mut png, atlas.size, 1, lightkiln_texel::PngDepth::Eight, &atlas.pages[0])
    })
    .unwrap();
}

/// Patches of a wavy sheet, each turned by its own angle: a seam on every side.
fn patches(patches: u32, quads: u32, texel: f32) -> (Mesh, Vec<Chart>) {
    let n = patches * quads;
    let mesh = shapes::grid(n, n, false, |i, j| {
        let (x, y) = (2.0 * i as f32 / n as f32, 2.0 * j as f32 / n as f32);
        Vec3::new(x - 1.0, 0.1 * (5.0 * x).sin(), y)
    });
    let charts = (0..patches * patches)
        .map(|k| {
            let (column, row) = (k % patches * quads, k / patches * quads);
            let angle = random::unit(random::hash(9, k.into(), 0, 0)) * 6.0;
            let own = shapes::quads(n, column..column + quads, row..row + quads);
            shapes::chart_of(&mesh, own, |v| {
                let (i, j) = ((v.0 % (n + 1)) as f32, (v.0 / (n + 1)) as f32);
                Vec2::from_angle(angle).rotate(Vec2::new(i, j) * (2.0 / n as f32) / texel)
            })
        })
        .collect();
    (mesh, charts)
}

fn main() {
    for noise in [0.0, 0.02] {
        println!("-- noise {noise}");
        let (mesh, charts) = shapes::cylinder(400, 100, 0.0035, 0.5);
        case("cylinder in two charts", &mesh, &charts, 0.0035, noise);
        let (mesh, charts) = patches(32, 8, 0.0025);
        case("patches", &mesh, &charts, 0.0025, noise);
        let (mesh, charts) = patches(8, 150, 0.004);
        case("fine patches", &mesh, &charts, 0.004, noise);
        let (mesh, charts) = patches(64, 1, 0.004);
        case("strips", &mesh, &charts, 0.004, noise);
    }
}
