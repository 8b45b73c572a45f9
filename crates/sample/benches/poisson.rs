//! One million Poisson-disk samples on one connected sheet: a sphere with triangles larger than the radius, and
//! one with triangles smaller than it. `cargo bench -p lightkiln-sample`.
#![allow(clippy::print_stdout)]

use std::time::Instant;

use glam::Vec3;
use lightkiln_mesh::{Mesh, VertexId};
use lightkiln_sample::{SampleOptions, poisson_disk, radius_for};

fn sphere(rows: u32) -> Mesh {
    let columns = rows * 2;
    let mut positions = Vec::new();
    for i in 0..=rows {
        for j in 0..columns {
            let (a, b) = (
                std::f32::consts::PI * i as f32 / rows as f32,
                std::f32::consts::TAU * j as f32 / columns as f32,
            );
            positions.push(Vec3::new(a.sin() * b.cos(), a.sin() * b.sin(), a.cos()));
        }
    }
    let at = |i: u32, j: u32| VertexId(i * columns + j % columns);
    let mut triangles = Vec::new();
    for i in 0..rows {
        for j in 0..columns {
            triangles.push([at(i, j), at(i + 1, j), at(i + 1, j + 1)]);
            triangles.push([at(i, j), at(i + 1, j + 1), at(i, j + 1)]);
        }
    }
    Mesh::new(positions.clone(), positions, triangles).expect("indices are in range")
}

fn main() {
    for rows in [50, 500, 1800] {
        let mesh = sphere(rows);
        let radius = radius_for(&mesh, 1_000_000);
        let start = Instant::now();
        let samples = poisson_disk(&mesh, &SampleOptions { radius, seed: 1 }).expect("radius is positive");
        let seconds = start.elapsed().as_secs_f64();
        let support = samples.support.iter().filter(|s| **s).count();
        println!(
            "{} triangles: {} samples, {support} of them support, in {seconds:.2} s",
            mesh.triangle_count(),
            samples.len()
        );
    }
}
