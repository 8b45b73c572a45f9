//! Seams: mesh edges across which the map to the atlas breaks, and light vertices with several places in it.

use glam::Vec2;
use lightkiln_chart::Chart;
use lightkiln_mesh::{Mesh, VertexId};

/// One side of a seam: a chart and the two ends of the edge in its plane.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Side {
    pub chart: u32,
    pub ends: [Vec2; 2],
}

impl Side {
    pub fn at(&self, t: f32) -> Vec2 {
        self.ends[0] * (1.0 - t) + self.ends[1] * t
    }

    pub fn length(&self) -> f32 {
        self.ends[0].distance(self.ends[1])
    }
}

/// A mesh edge between two texture triangles whose maps differ. Both sides run from the same light vertex to
/// the same light vertex.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Seam {
    pub vertices: [VertexId; 2],
    pub sides: [Side; 2],
}

impl Seam {
    /// Length in texels, of the longer side.
    pub fn length(&self) -> f32 {
        self.sides[0].length().max(self.sides[1].length())
    }

    /// Points that are at most half a texel apart, ends included: `(parameter, share of the length)`. Shares
    /// are in half texels, so that the sum over a seam does not depend on how finely the mesh is cut.
    pub fn points(&self) -> impl Iterator<Item = (f32, f32)> {
        let half_texels = 2.0 * self.length();
        let count = half_texels.ceil().clamp(1.0, 65536.0) as u32;
        (0..=count).map(move |k| {
            let end = if k == 0 || k == count { 0.5 } else { 1.0 };
            (k as f32 / count as f32, end * half_texels / count as f32)
        })
    }
}

/// A place of a light vertex in a chart.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Place {
    pub vertex: VertexId,
    pub chart: u32,
    pub uv: Vec2,
}

/// All that must read the same on two sides.
#[derive(Clone, Debug, Default)]
pub(crate) struct Seams {
    pub edges: Vec<Seam>,
    /// Places of light vertices that have more than one, sorted by vertex.
    pub places: Vec<Place>,
    /// Per group of `places` (runs of one vertex): whether all its places must agree to the last bit that is
    /// stored. So it is where color triangles meet the vertex, for they take one place's value; and where the
    /// seams around it are long enough that agreement costs the signal nothing.
    pub exact: Vec<bool>,
}

/// Seam edges shorter than this have ends that are held together by the edge only. Two grids that do not line
/// up can agree at every point of a seam only if both are linear along it.
const EXACT_SPACING: f32 = 1.5;

impl Seams {
    /// Charts must have passed `check_chart`.
    pub fn new(mesh: &Mesh, charts: &[Chart]) -> Self {
        let edges = seam_edges(mesh, charts);
        let mut places: Vec<(Place, u32)> = Vec::new();
        for (chart, c) in charts.iter().enumerate() {
            for (k, (&vertex, &uv)) in c.vertices.iter().zip(&c.uv).enumerate() {
                places.push((Place { vertex, chart: chart as u32, uv }, k as u32));
            }
        }
        places.sort_unstable_by_key(|(p, k)| (p.vertex, p.chart, *k));
        let places: Vec<Place> = places
            .chunk_by(|a, b| a.0.vertex == b.0.vertex)
            .filter(|group| group.len() > 1)
            .flatten()
            .map(|&(place, _)| place)
            .collect();
        let open = open_vertices(mesh, charts);
        let mut spacing: Vec<(VertexId, f32)> =
            edges.iter().flat_map(|e| e.vertices.map(|v| (v, e.length()))).collect();
        spacing.sort_unstable_by(|a, b| a.0.cmp(&b.0).then(a.1.total_cmp(&b.1)));
        let shortest = |v: VertexId| {
            let first = spacing.partition_point(|s| s.0 < v);
            spacing.get(first).filter(|s| s.0 == v).map_or(f32::INFINITY, |s| s.1)
        };
        let exact = places
            .chunk_by(|a, b| a.vertex == b.vertex)
            .map(|group| open[group[0].vertex.index()] || shortest(group[0].vertex) >= EXACT_SPACING)
            .collect();
        Self { edges, places, exact }
    }

    /// The places of each vertex that has several, and whether they must agree exactly.
    pub fn groups(&self) -> impl Iterator<Item = (&[Place], bool)> {
        self.places.chunk_by(|a, b| a.vertex == b.vertex).zip(self.exact.iter().copied())
    }
}

/// Pairs texture triangles over mesh edges. An edge with two texture triangles that run along it in opposite
/// directions is a seam unless both name the same chart vertices; a non-manifold edge is none, because light
/// is not continuous across it.
fn seam_edges(mesh: &Mesh, charts: &[Chart]) -> Vec<Seam> {
    // (edge's vertices, chart, entry of its triangles, edge number)
    let mut halves: Vec<(u64, u32, u32, u8)> = Vec::new();
    for (chart, c) in charts.iter().enumerate() {
        for (local, corners) in c.corners.iter().enumerate() {
            for edge in 0..3 {
                let [a, b] = [corners[edge], corners[(edge + 1) % 3]].map(|v| c.vertices[v as usize].0);
                if a != b && a.max(b) < mesh.vertex_count() as u32 {
                    let key = (u64::from(a.min(b)) << 32) | u64::from(a.max(b));
                    halves.push((key, chart as u32, local as u32, edge as u8));
                }
            }
        }
    }
    halves.sort_unstable();
    let ends = |half: &(u64, u32, u32, u8)| {
        let corners = charts[half.1 as usize].corners[half.2 as usize];
        [corners[half.3 as usize], corners[(half.3 as usize + 1) % 3]]
    };
    let mut seams = Vec::new();
    for run in halves.chunk_by(|x, y| x.0 == y.0) {
        let [left, right] = run else { continue };
        let ([a, b], [d, c]) = (ends(left), ends(right));
        let (left_chart, right_chart) = (&charts[left.1 as usize], &charts[right.1 as usize]);
        let vertices = [left_chart.vertices[a as usize], left_chart.vertices[b as usize]];
        // The other side must run the other way.
        if right_chart.vertices[c as usize] != vertices[0] || (left.1 == right.1 && [a, b] == [c, d]) {
            continue;
        }
        let side = |chart: u32, ends: [u32; 2]| Side {
            chart,
            ends: ends.map(|v| charts[chart as usize].uv[v as usize]),
        };
        seams.push(Seam { vertices, sides: [side(left.1, [a, b]), side(right.1, [c, d])] });
    }
    seams
}

/// Vertices that some triangle without a chart uses.
fn open_vertices(mesh: &Mesh, charts: &[Chart]) -> Vec<bool> {
    let mut textured = vec![false; mesh.triangle_count()];
    for t in charts.iter().flat_map(|c| &c.triangles) {
        textured[t.index()] = true;
    }
    let mut open = vec![false; mesh.vertex_count()];
    for (corners, _) in mesh.triangles.iter().zip(&textured).filter(|(_, textured)| !**textured) {
        for v in corners {
            open[v.index()] = true;
        }
    }
    open
}
