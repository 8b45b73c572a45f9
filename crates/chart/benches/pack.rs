//! Fill rate, time and determinism of every packer that the build has.
//!
//! `cargo bench -p lightkiln-chart --bench pack [--features xatlas,uvunwrap] [-- DUMP...]`
//!
//! Without arguments: charts made here that look like those of a bake (curved strips of 1 to 3 texels, blobs, islands of
//! a few texels, mixtures). With arguments: an OBJ file, of whose triangles wavy bands (the edges of shadows) are
//! charted, or the charts of a bake in plain text:
//!
//! ```text
//! chart WIDTH HEIGHT     texels of the grid, starts a chart
//! v X Y                  a chart vertex, texels of the grid
//! f A B C                a triangle, chart vertices from 0
//! ```
#![allow(clippy::print_stdout, reason = "a bench prints what it measured")]

#[path = "../tests/shapes/mod.rs"]
mod shapes;

use glam::{Vec2, Vec3};
use lightkiln_chart::pack::{BLOCK, PackOptions, Packer, block_fill, check, fill_rate, pack};
use lightkiln_chart::{Chart, ChartOptions, charts};
use lightkiln_mesh::random::{hash, unit};
use lightkiln_mesh::{Adjacency, Mesh, TriangleId, VertexId};
use std::time::Instant;

const GUTTER: u32 = 1;

fn main() {
    let dumps: Vec<String> =
        std::env::args().skip(1).filter(|argument| !argument.starts_with("--")).collect();
    println!(
        "{:<28} {:>6} {:>8} {:>9} {:>11} {:>7} {:>7} {:>8}  same twice",
        "charts from", "charts", "blocks", "packer", "page", "fill", "blocks", "seconds"
    );
    if dumps.is_empty() {
        for (name, charts) in synthetic() {
            measure(name, &charts);
        }
    }
    for path in dumps {
        match std::fs::read_to_string(&path) {
            Ok(text) => {
                let charts = if path.ends_with(".obj") { band_charts(&text) } else { read_dump(&text) };
                measure(path.rsplit('/').next().unwrap_or(&path), &charts);
            }
            Err(error) => println!("{path}: {error}"),
        }
    }
}

fn measure(name: &str, charts: &[Chart]) {
    for &packer in Packer::ALL {
        let options = PackOptions { gutter: GUTTER, packer, ..PackOptions::default() };
        let start = Instant::now();
        let packing = match pack(charts, &options) {
            Ok(packing) => packing,
            Err(error) => {
                println!("{name:<28} {:>6} {packer:?}: {error}", charts.len());
                continue;
            }
        };
        let seconds = start.elapsed().as_secs_f64();
        let same = pack(charts, &options).as_ref() == Ok(&packing);
        let [width, height] = packing.page_size;
        let blocks = block_fill(charts, &packing, GUTTER).unwrap_or(f64::NAN);
        let taken = blocks * packing.page_texels() as f64 / f64::from(BLOCK * BLOCK);
        let sound = if check(charts, &packing, GUTTER).is_ok() { "" } else { "  BROKEN" };
        println!(
            "{name:<28} {:>6} {taken:>8.0} {:>9} {:>11} {:>6.1}% {:>6.1}% {seconds:>8.3}  {same}{sound}",
            charts.len(),
            format!("{packer:?}"),
            format!("{}x{width}x{height}", packing.pages),
            100.0 * fill_rate(charts, &packing),
            100.0 * blocks,
        );
    }
}

/// Random numbers for one chart, keyed by the set and the chart's number.
struct Numbers {
    key: u64,
    drawn: u64,
}

impl Numbers {
    fn between(&mut self, low: f32, high: f32) -> f32 {
        self.drawn += 1;
        low + (high - low) * unit(hash(self.key, self.drawn, 0, 0))
    }

    /// Small ones are more frequent: each doubling is as likely as the next.
    fn logarithmic(&mut self, low: f32, high: f32) -> f32 {
        low * (high / low).powf(self.between(0.0, 1.0))
    }
}

fn synthetic() -> Vec<(&'static str, Vec<Chart>)> {
    let strips = |n: &mut Numbers| strip(n);
    let blobs = |n: &mut Numbers| blob(n, 5.0, 60.0);
    let islands = |n: &mut Numbers| blob(n, 0.5, 1.5);
    let large = |n: &mut Numbers| blob(n, 40.0, 90.0);
    let mixture = |n: &mut Numbers| match n.between(0.0, 1.0) {
        share if share < 0.4 => strip(n),
        share if share < 0.6 => blob(n, 3.0, 40.0),
        _ => blob(n, 0.5, 1.5),
    };
    let make = |key: u64, count: u64, shape: &dyn Fn(&mut Numbers) -> Vec<[Vec2; 3]>| {
        let charts = (0..count).map(|number| {
            let mut numbers = Numbers { key: hash(key, number, 0, 0), drawn: 0 };
            chart(&shape(&mut numbers))
        });
        charts.collect::<Vec<_>>()
    };
    vec![
        ("strips", make(1, 50, &strips)),
        ("strips", make(2, 500, &strips)),
        ("strips", make(3, 5000, &strips)),
        ("blobs", make(4, 50, &blobs)),
        ("blobs", make(5, 500, &blobs)),
        ("large blobs", make(6, 500, &large)),
        ("islands", make(7, 500, &islands)),
        ("islands", make(8, 10_000, &islands)),
        ("mixture", make(9, 50, &mixture)),
        ("mixture", make(10, 500, &mixture)),
        ("mixture", make(11, 5000, &mixture)),
        ("mixture", make(12, 20_000, &mixture)),
    ]
}

/// A strip along a curve whose bend drifts: 1 to 3 texels wide, 10 to 200 long.
fn strip(numbers: &mut Numbers) -> Vec<[Vec2; 3]> {
    let length = numbers.logarithmic(10.0, 200.0);
    let half_width = 0.5 * numbers.between(1.0, 3.0);
    let mut bend = numbers.between(-2.0, 2.0) / length;
    let (mut at, mut heading) = (Vec2::ZERO, 0.0_f32);
    let steps = (length / 2.0).ceil() as u32;
    let side = |at: Vec2, heading: f32| Vec2::from_angle(heading).perp() * half_width + at;
    let mut triangles = Vec::new();
    for _ in 0..steps {
        let (left, right) = (side(at, heading), 2.0 * at - side(at, heading));
        bend = (bend + numbers.between(-0.1, 0.1) / length).clamp(-3.0 / length, 3.0 / length);
        at += Vec2::from_angle(heading) * 2.0;
        heading += 2.0 * bend;
        let (next_left, next_right) = (side(at, heading), 2.0 * at - side(at, heading));
        triangles.push([left, right, next_right]);
        triangles.push([left, next_right, next_left]);
    }
    triangles
}

/// A star-shaped polygon with a wavy border, radii within a factor of two of each other.
fn blob(numbers: &mut Numbers, least_radius: f32, most_radius: f32) -> Vec<[Vec2; 3]> {
    let radius = numbers.logarithmic(least_radius, most_radius);
    let corners = 4 + (radius as usize).min(20);
    let stretch = Vec2::new(1.0, numbers.between(0.3, 1.0));
    let points: Vec<Vec2> = (0..corners)
        .map(|i| {
            let angle = i as f32 / corners as f32 * std::f32::consts::TAU;
            Vec2::from_angle(angle) * stretch * radius * numbers.between(0.7, 1.3)
        })
        .collect();
    (0..corners).map(|i| [Vec2::ZERO, points[i], points[(i + 1) % corners]]).collect()
}

/// Turned to the smallest box of 32 directions, moved behind the gutter, snapped to eighths of a texel.
fn chart(triangles: &[[Vec2; 3]]) -> Chart {
    let bounds = |angle: f32| {
        let points = triangles.iter().flatten().map(|p| Vec2::from_angle(angle).rotate(*p));
        points.fold((Vec2::INFINITY, Vec2::NEG_INFINITY), |(low, high), p| (low.min(p), high.max(p)))
    };
    let area = |angle: f32| {
        let (low, high) = bounds(angle);
        (high - low).element_product()
    };
    let angles = (0..32).map(|i| i as f32 / 64.0 * std::f32::consts::PI);
    let angle = angles.min_by(|&a, &b| area(a).total_cmp(&area(b))).unwrap_or(0.0);
    let (low, _) = bounds(angle);
    let gutter = GUTTER as f32;
    let place = |p: &Vec2| ((Vec2::from_angle(angle).rotate(*p) - low) * 8.0).round() / 8.0 + gutter;
    let uv: Vec<Vec2> = triangles.iter().flatten().map(place).collect();
    let extent = uv.iter().fold(Vec2::ZERO, |extent, &p| extent.max(p)) + gutter;
    let count = triangles.len() as u32;
    Chart {
        triangles: (0..count).map(TriangleId).collect(),
        vertices: (0..3 * count).map(VertexId).collect(),
        corners: (0..count).map(|t| [3 * t, 3 * t + 1, 3 * t + 2]).collect(),
        uv,
        size: [extent.x, extent.y].map(|texels| (texels.ceil() as u32).next_multiple_of(BLOCK)),
    }
}

/// Reads a dump; lines that are none of the three kinds are skipped.
fn read_dump(text: &str) -> Vec<Chart> {
    let mut charts: Vec<Chart> = Vec::new();
    for line in text.lines() {
        let words: Vec<&str> = line.split_whitespace().collect();
        let whole = |i: usize| words.get(i).and_then(|w| w.parse::<u32>().ok()).unwrap_or(0);
        let real = |i: usize| words.get(i).and_then(|w| w.parse::<f32>().ok()).unwrap_or(0.0);
        match (words.first(), charts.last_mut()) {
            (Some(&"chart"), _) => charts.push(Chart {
                triangles: Vec::new(),
                vertices: Vec::new(),
                corners: Vec::new(),
                uv: Vec::new(),
                size: [whole(1), whole(2)],
            }),
            (Some(&"v"), Some(chart)) => {
                chart.vertices.push(VertexId(chart.vertices.len() as u32));
                chart.uv.push(Vec2::new(real(1), real(2)));
            }
            (Some(&"f"), Some(chart)) => {
                chart.triangles.push(TriangleId(chart.triangles.len() as u32));
                chart.corners.push([whole(1), whole(2), whole(3)]);
            }
            _ => {}
        }
    }
    charts
}

/// Charts of the triangles of an OBJ file (`v` and triangular `f` lines) along wavy bands, at about a million
/// texels for the whole surface.
fn band_charts(text: &str) -> Vec<Chart> {
    let (mut positions, mut triangles) = (Vec::new(), Vec::new());
    for line in text.lines() {
        let words: Vec<&str> = line.split_whitespace().collect();
        match words[..] {
            ["v", x, y, z] => positions.push(Vec3::from([x, y, z].map(|w| w.parse().unwrap_or(0.0)))),
            ["f", a, b, c] => {
                let corner = |w: &str| VertexId(w.parse::<u32>().map_or(0, |v| v - 1));
                triangles.push([corner(a), corner(b), corner(c)]);
            }
            _ => {}
        }
    }
    let normals = vec![Vec3::ZERO; positions.len()];
    let mesh = Mesh::new(positions, normals, triangles).expect("the file holds a mesh");
    let (low, high) = mesh.bounds();
    let wave = |p: Vec3| {
        let q = (p - low) * (20.0 / (high - low).max_element());
        (q.x.sin() * q.y.cos() + q.z.sin() * (1.7 * q.x).cos()).abs()
    };
    let taken: Vec<bool> =
        mesh.triangle_ids().map(|t| wave(mesh.corners(t).iter().sum::<Vec3>() / 3.0) < 0.08).collect();
    let adjacency = Adjacency::new(&mesh);
    let options = ChartOptions::new((mesh.total_area() / 1e6).sqrt() as f32);
    let regions = shapes::regions(&adjacency, &taken);
    charts(&mesh, &adjacency, &regions, &options).expect("the bands can be charted").0
}
