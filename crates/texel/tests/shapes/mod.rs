//! Meshes with charts, small enough to reason about, for tests and the bench.

#![allow(dead_code, clippy::unwrap_used, reason = "each user takes some; the shapes are its own")]

use glam::{Vec2, Vec3};
use lightkiln_chart::Chart;
use lightkiln_mesh::{Mesh, SurfacePoint, TriangleId, VertexId};
use lightkiln_texel::ChartTexels;

/// A chart of some triangles with given coordinates per light vertex: snapped, gutter of 2 texels.
pub fn chart_of(
    mesh: &Mesh,
    triangles: impl IntoIterator<Item = u32>,
    uv: impl Fn(VertexId) -> Vec2,
) -> Chart {
    let triangles: Vec<TriangleId> = triangles.into_iter().map(TriangleId).collect();
    let mut vertices: Vec<VertexId> = triangles.iter().flat_map(|t| mesh.triangles[t.index()]).collect();
    vertices.sort_unstable();
    vertices.dedup();
    let corner = |v: VertexId| vertices.binary_search(&v).unwrap() as u32;
    let corners = triangles.iter().map(|t| mesh.triangles[t.index()].map(corner)).collect();
    let snap = |v: Vec2| (v * 8.0).round() / 8.0;
    let low = vertices.iter().map(|&v| snap(uv(v))).fold(Vec2::INFINITY, Vec2::min).floor() - 2.0;
    // The fraction of the first coordinate is kept, so that grids of several charts need not line up.
    let uv: Vec<Vec2> = vertices.iter().map(|&v| snap(uv(v)) - low).collect();
    let high = uv.iter().copied().fold(Vec2::ZERO, Vec2::max);
    let size = [high.x, high.y].map(|s| ((s + 2.0).ceil() as u32).next_multiple_of(4));
    Chart { triangles, vertices, corners, uv, size }
}

/// A grid of nu x nv quads; `position` of (0..=nu, 0..=nv), the last column being the first when `closed`.
pub fn grid(nu: u32, nv: u32, closed: bool, position: impl Fn(u32, u32) -> Vec3) -> Mesh {
    let columns = if closed { nu } else { nu + 1 };
    let positions: Vec<Vec3> =
        (0..=nv).flat_map(|j| (0..columns).map(move |i| (i, j))).map(|(i, j)| position(i, j)).collect();
    let at = |i: u32, j: u32| VertexId(j * columns + i % columns);
    let mut triangles = Vec::new();
    for j in 0..nv {
        for i in 0..nu {
            let [a, b, c, d] = [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)];
            triangles.push([a, b, c]);
            triangles.push([a, c, d]);
        }
    }
    let normals = vec![Vec3::Z; positions.len()];
    Mesh::new(positions, normals, triangles).unwrap()
}

/// Triangles of the quads `columns` x `rows` of a grid with `nu` columns.
pub fn quads(
    nu: u32,
    columns: std::ops::Range<u32>,
    rows: std::ops::Range<u32>,
) -> impl Iterator<Item = u32> {
    rows.flat_map(move |j| columns.clone().flat_map(move |i| [2 * (j * nu + i), 2 * (j * nu + i) + 1]))
}

/// An open cylinder of radius 1 and height 2 along z, in two charts that meet along two lines. `texel` is the
/// side of a texel; the second chart lies turned by `angle` in its plane.
pub fn cylinder(segments: u32, rows: u32, texel: f32, angle: f32) -> (Mesh, Vec<Chart>) {
    let turn = std::f32::consts::TAU / segments as f32;
    let mesh = grid(segments, rows, true, |i, j| {
        let (sin, cos) = (turn * i as f32).sin_cos();
        Vec3::new(cos, sin, 2.0 * j as f32 / rows as f32)
    });
    let half = segments / 2;
    let uv = |v: VertexId, first: u32| {
        let (i, j) = (v.0 % segments, v.0 / segments);
        let along = (i + segments - first) % segments;
        Vec2::new(turn * along as f32, 2.0 * j as f32 / rows as f32) / texel
    };
    let one = chart_of(&mesh, quads(segments, 0..half, 0..rows), |v| uv(v, 0) + Vec2::new(0.25, 0.5));
    let two = chart_of(&mesh, quads(segments, half..segments, 0..rows), |v| {
        Vec2::from_angle(angle).rotate(uv(v, half)) + Vec2::new(0.625, 0.125)
    });
    (mesh, vec![one, two])
}

/// A cube of side 1 with welded edges, a chart per face, each turned by its own angle.
pub fn cube(n: u32, texels: f32) -> (Mesh, Vec<Chart>) {
    let mut positions: Vec<Vec3> = Vec::new();
    let mut triangles = Vec::new();
    let faces = [
        (Vec3::X, Vec3::Y, Vec3::Z),
        (Vec3::Y, Vec3::Z, Vec3::X),
        (Vec3::Z, Vec3::X, Vec3::Y),
        (Vec3::Y, Vec3::X, Vec3::NEG_Z),
        (Vec3::Z, Vec3::Y, Vec3::NEG_X),
        (Vec3::X, Vec3::Z, Vec3::NEG_Y),
    ];
    for (u, v, w) in faces {
        let mut at = |i: u32, j: u32| {
            let p = u * (i as f32 / n as f32 - 0.5) + v * (j as f32 / n as f32 - 0.5) + 0.5 * w;
            let known = positions.iter().position(|q| q.distance(p) < 1e-4);
            VertexId(known.unwrap_or_else(|| {
                positions.push(p);
                positions.len() - 1
            }) as u32)
        };
        for j in 0..n {
            for i in 0..n {
                let [a, b, c, d] = [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)];
                triangles.extend([[a, b, c], [a, c, d]]);
            }
        }
    }
    let normals = vec![Vec3::Z; positions.len()];
    let mesh = Mesh::new(positions, normals, triangles).unwrap();
    let charts = (0..6)
        .map(|f| {
            let (u, v, _) = faces[f as usize];
            chart_of(&mesh, 2 * n * n * f..2 * n * n * (f + 1), |vertex| {
                let p = mesh.positions[vertex.index()];
                // Shifted by eighths of a texel: the grids of two faces do not line up.
                Vec2::new(p.dot(u), p.dot(v)) * texels + Vec2::splat(0.125 * f as f32)
            })
        })
        .collect();
    (mesh, charts)
}

/// Values of a signal at the lifted points; NaN where there are none.
pub fn shade(mesh: &Mesh, texels: &[ChartTexels], signal: impl Fn(Vec3) -> f32) -> Vec<Vec<f32>> {
    let value = |p: &Option<SurfacePoint>| p.map_or(f32::NAN, |p| signal(mesh.position(p)));
    texels.iter().map(|t| t.lift.iter().map(value).collect()).collect()
}

/// Errors of lookups over points spread evenly over each triangle: largest and root mean square.
pub fn errors(
    mesh: &Mesh,
    charts: &[Chart],
    values: &[Vec<f32>],
    signal: impl Fn(Vec3) -> f32,
) -> (f32, f32) {
    let (mut max, mut sum, mut count) = (0.0_f32, 0.0_f64, 0_u32);
    for (chart, values) in charts.iter().zip(values) {
        for (local, &triangle) in chart.triangles.iter().enumerate() {
            let n = 9;
            for a in 0..=n {
                for b in 0..=n - a {
                    let barycentric = [a as f32 / n as f32, b as f32 / n as f32];
                    let uv = lightkiln_texel::observe::chart_uv(chart, local, barycentric);
                    let mut out = [0.0];
                    lightkiln_texel::lookup(chart.size, 1, values, uv, &mut out);
                    let point = SurfacePoint { triangle, barycentric };
                    let error = (out[0] - signal(mesh.position(point))).abs();
                    assert!(!error.is_nan());
                    max = max.max(error);
                    sum += f64::from(error).powi(2);
                    count += 1;
                }
            }
        }
    }
    (max, (sum / f64::from(count.max(1))).sqrt() as f32)
}
