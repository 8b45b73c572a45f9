//! Small meshes and observations shared by the tests.
#![allow(dead_code)]

use glam::Vec3;
use lightkiln_mesh::{Adjacency, Mesh, SurfacePoint, TriangleId, VertexId, random};

/// A mesh with zero normals, which the fit never reads.
pub fn mesh(positions: Vec<Vec3>, triangles: &[[u32; 3]]) -> Mesh {
    let normals = vec![Vec3::ZERO; positions.len()];
    Mesh::new(positions, normals, triangles.iter().map(|t| t.map(VertexId)).collect()).expect("a valid mesh")
}

/// `n` × `n` jittered vertices over the unit square.
pub fn sheet(n: u32, jitter: f32, seed: u64) -> Mesh {
    let step = 1.0 / (n - 1) as f32;
    let offset = |i: u32, j: u32, k: u64| {
        if i == 0 || j == 0 || i == n - 1 || j == n - 1 {
            return 0.0;
        }
        (random::unit(random::hash(seed, u64::from(i), u64::from(j), k)) - 0.5) * jitter * step
    };
    let positions = (0..n * n)
        .map(|v| {
            let (i, j) = (v % n, v / n);
            Vec3::new(i as f32 * step + offset(i, j, 0), j as f32 * step + offset(i, j, 1), 0.0)
        })
        .collect();
    let mut triangles = Vec::new();
    for j in 0..n - 1 {
        for i in 0..n - 1 {
            let [a, b, c, d] = [j * n + i, j * n + i + 1, (j + 1) * n + i + 1, (j + 1) * n + i];
            if random::hash(seed, u64::from(i), u64::from(j), 7) & 1 == 0 {
                triangles.extend([[a, b, c], [a, c, d]]);
            } else {
                triangles.extend([[a, b, d], [b, c, d]]);
            }
        }
    }
    mesh(positions, &triangles)
}

/// Random points, `per_triangle` each, whose weights sum to the area.
pub fn scatter(mesh: &Mesh, per_triangle: usize, seed: u64) -> (Vec<SurfacePoint>, Vec<f32>) {
    let mut points = Vec::new();
    let mut weights = Vec::new();
    for t in mesh.triangle_ids() {
        for k in 0..per_triangle {
            let hash = random::hash(seed, u64::from(t.0), k as u64, 3);
            points.push(SurfacePoint {
                triangle: t,
                barycentric: random::square_to_triangle(random::unit2(hash)),
            });
            weights.push((mesh.area(t) / per_triangle as f64) as f32);
        }
    }
    (points, weights)
}

/// The point's position in double precision.
pub fn position(mesh: &Mesh, point: SurfacePoint) -> glam::DVec3 {
    let [u, v] = point.barycentric.map(f64::from);
    let [a, b, c] = mesh.corners(point.triangle).map(Vec3::as_dvec3);
    a * (1.0 - u - v) + b * u + c * v
}

pub fn adjacency(mesh: &Mesh) -> Adjacency {
    Adjacency::new(mesh)
}

pub fn at(triangle: u32, u: f32, v: f32) -> SurfacePoint {
    SurfacePoint { triangle: TriangleId(triangle), barycentric: [u, v] }
}
