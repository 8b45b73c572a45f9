//! Small meshes made by formula, for tests and benches of charts.

#![allow(dead_code, reason = "each user takes what it needs")]

use std::collections::BTreeMap;

use glam::Vec3;
use lightkiln_mesh::random::{hash, unit};
use lightkiln_mesh::{Adjacency, EdgeKind, Mesh, TriangleId, VertexId};

pub fn mesh(positions: Vec<Vec3>, triangles: Vec<[u32; 3]>) -> Mesh {
    let normals = vec![Vec3::ZERO; positions.len()];
    let triangles = triangles.into_iter().map(|t| t.map(VertexId)).collect();
    Mesh::new(positions, normals, triangles).expect("shapes are meshes")
}

/// A grid of quads over (u, v); `wrap` closes it around in u or v.
pub fn grid(nu: u32, nv: u32, wrap: [bool; 2], place: impl Fn(f32, f32) -> Vec3) -> Mesh {
    let columns = nu + u32::from(!wrap[0]);
    let rows = nv + u32::from(!wrap[1]);
    let mut positions = Vec::new();
    for j in 0..rows {
        for i in 0..columns {
            positions.push(place(i as f32 / nu as f32, j as f32 / nv as f32));
        }
    }
    let at = |i: u32, j: u32| (j % rows) * columns + i % columns;
    let mut triangles = Vec::new();
    for j in 0..nv {
        for i in 0..nu {
            let [a, b, c, d] = [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)];
            // Alternating diagonals, so that nothing depends on one direction.
            if (i + j) % 2 == 0 {
                triangles.extend([[a, b, c], [a, c, d]]);
            } else {
                triangles.extend([[a, b, d], [b, c, d]]);
            }
        }
    }
    mesh(positions, triangles)
}

pub fn plane(n: u32, size: f32) -> Mesh {
    grid(n, n, [false; 2], |u, v| Vec3::new(u * size, v * size, 0.0))
}

pub fn tube(n: u32, rows: u32, radius: f32, height: f32) -> Mesh {
    grid(n, rows, [true, false], move |u, v| {
        let (s, c) = (u * std::f32::consts::TAU).sin_cos();
        Vec3::new(radius * c, radius * s, height * v)
    })
}

pub fn torus(n: u32, major: f32, minor: f32) -> Mesh {
    grid(2 * n, n, [true, true], move |u, v| {
        let (s, c) = (u * std::f32::consts::TAU).sin_cos();
        let (t, d) = (v * std::f32::consts::TAU).sin_cos();
        Vec3::new((major + minor * d) * c, (major + minor * d) * s, minor * t)
    })
}

pub fn annulus(n: u32, rows: u32) -> Mesh {
    grid(n, rows, [true, false], move |u, v| {
        let (s, c) = (u * std::f32::consts::TAU).sin_cos();
        Vec3::new((2.0 - v) * c, (2.0 - v) * s, 0.0)
    })
}

/// A band with one half turn; over the joint two triangles run along the edge the same way.
pub fn moebius(n: u32) -> Mesh {
    let mut positions = Vec::new();
    for i in 0..n {
        let angle = i as f32 / n as f32 * std::f32::consts::TAU;
        for side in [-0.4_f32, 0.4] {
            let out = 2.0 + side * (angle / 2.0).cos();
            positions.push(Vec3::new(out * angle.cos(), out * angle.sin(), side * (angle / 2.0).sin()));
        }
    }
    let mut triangles = Vec::new();
    for i in 0..n {
        let (a, b) = (2 * i, 2 * i + 1);
        let (c, d) = if i + 1 < n { (a + 2, b + 2) } else { (1, 0) };
        triangles.extend([[a, c, b], [b, c, d]]);
    }
    mesh(positions, triangles)
}

/// An octahedron, each triangle cut into four `levels` times, on the unit sphere.
pub fn sphere(levels: u32) -> Mesh {
    let mut positions = vec![Vec3::X, Vec3::NEG_X, Vec3::Y, Vec3::NEG_Y, Vec3::Z, Vec3::NEG_Z];
    let mut triangles: Vec<[u32; 3]> =
        vec![[0, 2, 4], [2, 1, 4], [1, 3, 4], [3, 0, 4], [2, 0, 5], [1, 2, 5], [3, 1, 5], [0, 3, 5]];
    for _ in 0..levels {
        let mut middle = BTreeMap::new();
        let mut next = Vec::new();
        for [a, b, c] in triangles {
            let [ab, bc, ca] = [(a, b), (b, c), (c, a)].map(|(a, b)| {
                *middle.entry((a.min(b), a.max(b))).or_insert_with(|| {
                    positions.push(((positions[a as usize] + positions[b as usize]) / 2.0).normalize());
                    positions.len() as u32 - 1
                })
            });
            next.extend([[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]);
        }
        triangles = next;
    }
    mesh(positions, triangles)
}

/// Eight vertices, twelve triangles.
pub fn cube() -> Mesh {
    let positions =
        (0..8).map(|i| Vec3::new((i & 1) as f32, (i >> 1 & 1) as f32, (i >> 2 & 1) as f32)).collect();
    let quads = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
    let triangles = quads.iter().flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]]).collect();
    mesh(positions, triangles)
}

/// A square with hills, and noise in all directions. Fine enough to be unfolded if `height` is small.
pub fn hills(n: u32, size: f32, height: f32, noise: f32) -> Mesh {
    let step = size / n as f32;
    grid(n, n, [false; 2], move |u, v| {
        let key = |c| unit(hash(7, (u * 1e5) as u64, (v * 1e5) as u64, c)) - 0.5;
        let z = height * ((u * 9.0).sin() * (v * 7.0).cos() + 0.3 * (u * 31.0 + v * 17.0).sin());
        Vec3::new(u * size, v * size, z) + Vec3::new(key(0), key(1), key(2)) * noise * step
    })
}

/// Connected sets of the triangles that `taken` names, as the classifier hands them over.
pub fn regions(adjacency: &Adjacency, taken: &[bool]) -> Vec<Vec<TriangleId>> {
    let mut seen = vec![false; taken.len()];
    let mut regions = Vec::new();
    for start in 0..taken.len() {
        if !taken[start] || std::mem::replace(&mut seen[start], true) {
            continue;
        }
        let mut region = vec![TriangleId(start as u32)];
        let mut at = 0;
        while at < region.len() {
            for edge in 0..3 {
                if let EdgeKind::Interior { triangle, .. } = adjacency.across(region[at], edge)
                    && taken[triangle.index()]
                    && !std::mem::replace(&mut seen[triangle.index()], true)
                {
                    region.push(triangle);
                }
            }
            at += 1;
        }
        regions.push(region);
    }
    regions
}
