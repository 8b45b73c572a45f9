//! Lifting: the surface point whose light a texel shows (Schaefer 2012, section 4.2).
//!
//! A texel whose centre lies in a triangle of its chart shows that point. A texel beyond the chart's border is
//! still read by lookups near the border; it shows what really lies there: the walk goes on over the mesh, each
//! next triangle unfolded into the plane of the last (Schaefer clones values from the neighbouring chart; this
//! is the same at a seam, and serves borders to color triangles too). Where the surface ends, at a crease or a
//! mesh border, the texel takes the nearest point that there is, and the stitch extrapolates from it.
//!
//! Deviation: Schaefer lifts texels by their centre only and dilates the others.

use crate::grid::{self, barycentric, holds, nearest_on_segment, snapped};
use glam::{DVec2, Vec2};
use lightkiln_chart::Chart;
use lightkiln_mesh::{Adjacency, EdgeKind, Mesh, SurfacePoint, TriangleId, random};
use rayon::prelude::*;

/// Triangles that a walk beyond the border passes at most; CAD triangles may be far smaller than a texel.
const WALK: usize = 64;

/// Cosine of the sharpest fold that a walk crosses. Light has a kink at a sharp fold, and then what lies beyond
/// says less about the border than the chart's own slope does.
const SHARPEST: f64 = 0.85;

/// What the texels of one chart show. Row-major from v = 0.
#[derive(Clone, Debug, PartialEq, Default)]
pub struct ChartTexels {
    /// Width and height in texels.
    pub size: [u32; 2],
    /// The surface point whose light the texel shows; `None`: no lookup inside the chart reads the texel, it is
    /// filled by dilation.
    pub lift: Vec<Option<SurfacePoint>>,
    /// What the rays of a texel are keyed by: its chart's first triangle and its number in the chart, so that
    /// neither packing nor other charts change its noise.
    pub keys: Vec<u64>,
    /// The texels with a lift whose centre lies outside the chart, ascending by texel.
    pub outside: Vec<Outside>,
}

/// A texel that is read near the chart's border but has its centre outside.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Outside {
    /// Row-major number of the texel.
    pub texel: u32,
    /// Where its lifted point lies in the plane of the chart, in texels: the texel's centre where the surface
    /// goes on that far, else the point where it ends.
    pub at: Vec2,
    /// The surface goes on: the texel shows its own centre.
    pub reached: bool,
}

impl ChartTexels {
    /// Number of texels, shown or not.
    pub fn len(&self) -> usize {
        self.lift.len()
    }

    /// Whether the grid is empty.
    pub fn is_empty(&self) -> bool {
        self.lift.is_empty()
    }

    /// Number of texels that a lookup inside the chart can read.
    pub fn shown(&self) -> usize {
        self.lift.iter().flatten().count()
    }

    /// The centre of a texel, in texels.
    #[inline]
    pub fn centre(&self, texel: u32) -> Vec2 {
        centre(self.size, texel)
    }
}

pub(crate) fn centre(size: [u32; 2], texel: u32) -> Vec2 {
    Vec2::new((texel % size[0]) as f32 + 0.5, (texel / size[0]) as f32 + 0.5)
}

/// Finds the surface point of every texel that a bilinear lookup inside a chart can read.
///
/// - `adjacency`: of the whole mesh; borders are crossed where it knows one neighbour
/// - returns: one per chart; a chart whose numbers do not fit the mesh has no lifted texels
///
/// Time: linear in texels and triangles. Parallel over charts, the same for any number of threads.
pub fn lift(mesh: &Mesh, adjacency: &Adjacency, charts: &[Chart], seed: u64) -> Vec<ChartTexels> {
    charts.par_iter().map(|chart| lift_chart(mesh, adjacency, chart, seed)).collect()
}

const INSIDE: u32 = u32::MAX;
const UNREAD: u32 = u32::MAX - 1;

fn lift_chart(mesh: &Mesh, adjacency: &Adjacency, chart: &Chart, seed: u64) -> ChartTexels {
    let size = chart.size;
    let count = size[0] as usize * size[1] as usize;
    let first = chart.triangles.first().map_or(0, |t| u64::from(t.0));
    let mut texels = ChartTexels {
        size,
        lift: vec![None; count],
        keys: (0..count as u64).map(|texel| random::hash(seed, first, texel, 0x7465_7865)).collect(),
        outside: Vec::new(),
    };
    if crate::check_chart(mesh, chart).is_err() {
        return texels;
    }
    // Per texel: inside, not read, or the first triangle that reads it.
    let mut state = vec![UNREAD; count];
    for (local, corners) in chart.corners.iter().enumerate() {
        let uv = corners.map(|v| snapped(chart.uv[v as usize]));
        grid::touched(size, &uv, |i, j, centre| {
            let texel = (j * size[0] + i) as usize;
            if state[texel] == INSIDE {
                return;
            }
            if holds(&uv, centre) {
                state[texel] = INSIDE;
                let uv = corners.map(|v| chart.uv[v as usize].as_dvec2());
                let p = DVec2::new(f64::from(i) + 0.5, f64::from(j) + 0.5);
                if let Some(weights) = barycentric(&uv, p) {
                    texels.lift[texel] = Some(surface_point(chart.triangles[local], weights));
                }
            } else if state[texel] == UNREAD {
                state[texel] = local as u32;
            }
        });
    }
    lift_outside(mesh, adjacency, chart, &state, &mut texels);
    texels
}

/// The border point nearest to a texel's centre.
#[derive(Clone, Copy)]
struct Nearest {
    distance: f64,
    /// Border edges that lead on come first where two edges are equally near, at their common corner.
    ends: bool,
    local: u32,
    edge: u8,
    t: f64,
    at: DVec2,
}

fn lift_outside(mesh: &Mesh, adjacency: &Adjacency, chart: &Chart, state: &[u32], texels: &mut ChartTexels) {
    let size = chart.size;
    let mut nearest: Vec<Option<Nearest>> = vec![None; state.len()];
    for (local, edge) in border_edges(chart) {
        let corners = chart.corners[local as usize];
        let ends = [corners[edge as usize], corners[(edge as usize + 1) % 3]];
        let [a, b] = ends.map(|v| chart.uv[v as usize]);
        let ends = !matches!(
            adjacency.across(chart.triangles[local as usize], edge as usize),
            EdgeKind::Interior { .. }
        );
        grid::touched(size, &[snapped(a), snapped(b), snapped(b)], |i, j, _| {
            let texel = (j * size[0] + i) as usize;
            if state[texel] == INSIDE || state[texel] == UNREAD {
                return;
            }
            let p = DVec2::new(f64::from(i) + 0.5, f64::from(j) + 0.5);
            let (t, at) = nearest_on_segment(a.as_dvec2(), b.as_dvec2(), p);
            let found = Nearest { distance: p.distance_squared(at), ends, local, edge, t, at };
            let better = |old: Nearest| (found.distance, found.ends) < (old.distance, old.ends);
            if nearest[texel].is_none_or(better) {
                nearest[texel] = Some(found);
            }
        });
    }
    for texel in 0..state.len() {
        if state[texel] == INSIDE || state[texel] == UNREAD {
            continue;
        }
        let p = texels.centre(texel as u32).as_dvec2();
        let (at, point) = match nearest[texel] {
            Some(border) => {
                let clamped = edge_point(chart.triangles[border.local as usize], border.edge, border.t);
                let on = if border.ends { None } else { walk(mesh, adjacency, chart, &border, p) };
                match on {
                    Some((at, point)) if at.distance_squared(p) < border.distance => (at, point),
                    _ => (border.at, clamped),
                }
            }
            // Only where a chart's triangles overlap or their uv do not fit its borders.
            None => {
                let local = state[texel] as usize;
                let uv = chart.corners[local].map(|v| chart.uv[v as usize].as_dvec2());
                nearest_in_triangle(chart.triangles[local], &uv, p)
            }
        };
        texels.lift[texel] = Some(point);
        texels.outside.push(Outside { texel: texel as u32, at: at.as_vec2(), reached: at == p });
    }
}

/// The edges of a chart without a twin in the chart, `(entry of triangles, edge)`, ascending.
pub(crate) fn border_edges(chart: &Chart) -> Vec<(u32, u8)> {
    let mut halves: Vec<(u64, u32, u8)> = Vec::with_capacity(chart.corners.len() * 3);
    for (local, corners) in chart.corners.iter().enumerate() {
        for edge in 0..3 {
            let (a, b) = (corners[edge], corners[(edge + 1) % 3]);
            if a != b {
                let key = (u64::from(a.min(b)) << 32) | u64::from(a.max(b));
                halves.push((key, local as u32, edge as u8));
            }
        }
    }
    halves.sort_unstable();
    let mut border: Vec<(u32, u8)> = halves
        .chunk_by(|x, y| x.0 == y.0)
        .filter(|run| run.len() == 1)
        .map(|run| (run[0].1, run[0].2))
        .collect();
    border.sort_unstable();
    border
}

/// Walks from the border towards `p` over the mesh, unfolding triangle after triangle into the chart's plane.
/// Returns where the walk ends: `p` itself, or the last triangle's point nearest to it.
fn walk(
    mesh: &Mesh,
    adjacency: &Adjacency,
    chart: &Chart,
    border: &Nearest,
    p: DVec2,
) -> Option<(DVec2, SurfacePoint)> {
    let local = border.local as usize;
    let mut triangle = chart.triangles[local];
    let mut edge = border.edge as usize;
    let corners = chart.corners[local];
    // The two ends of the edge to cross, in the direction of the triangle that is left, and its far corner.
    let mut tail = chart.uv[corners[edge] as usize].as_dvec2();
    let mut head = chart.uv[corners[(edge + 1) % 3] as usize].as_dvec2();
    let far = chart.uv[corners[(edge + 2) % 3] as usize].as_dvec2();
    // +1 where charts run counter-clockwise: the next triangle's far corner lies to the right of the edge.
    let turn = if (head - tail).perp_dot(far - tail) < 0.0 { -1.0 } else { 1.0 };
    let mut last = None;
    for _ in 0..WALK {
        let EdgeKind::Interior { triangle: next, edge: entry } = adjacency.across(triangle, edge) else {
            break;
        };
        let entry = entry as usize;
        let (here, there) = (mesh.area_vector(triangle), mesh.area_vector(next));
        // A triangle without area has no say.
        if here.dot(there) < SHARPEST * here.length() * there.length() {
            break;
        }
        let positions = mesh.corners(next).map(|p| p.as_dvec3());
        // The next triangle runs along the edge from head to tail.
        let (from, to, apex) = (positions[entry], positions[(entry + 1) % 3], positions[(entry + 2) % 3]);
        let (along, up) = (to - from, apex - from);
        let length = along.length_squared();
        if length <= 0.0 {
            break;
        }
        let (x, y) = (up.dot(along) / length, up.cross(along).length() / length);
        let flat = tail - head;
        let peak = head + flat * x + turn * flat.perp() * y;
        let mut uv = [DVec2::ZERO; 3];
        uv[entry] = head;
        uv[(entry + 1) % 3] = tail;
        uv[(entry + 2) % 3] = peak;
        let Some(weights) = barycentric(&uv, p) else { break };
        if weights.iter().all(|&w| w >= 0.0) {
            return Some((p, surface_point(next, weights)));
        }
        last = Some((next, uv));
        // Leave through the edge beyond which `p` lies farthest; never back.
        let left = weights[entry]; // the corner opposite of edge entry + 1
        let right = weights[(entry + 1) % 3]; // opposite of edge entry + 2
        if left >= 0.0 && right >= 0.0 {
            break; // behind the entry edge: the surface folds away from p
        }
        let exit = if left <= right { (entry + 1) % 3 } else { (entry + 2) % 3 };
        (triangle, edge) = (next, exit);
        (tail, head) = (uv[exit], uv[(exit + 1) % 3]);
    }
    last.map(|(triangle, uv)| nearest_in_triangle(triangle, &uv, p))
}

fn nearest_in_triangle(triangle: TriangleId, uv: &[DVec2; 3], p: DVec2) -> (DVec2, SurfacePoint) {
    if let Some(weights) = barycentric(uv, p)
        && weights.iter().all(|&w| w >= 0.0)
    {
        return (p, surface_point(triangle, weights));
    }
    let mut best = (f64::INFINITY, 0, 0.0, p);
    for edge in 0..3 {
        let (t, at) = nearest_on_segment(uv[edge], uv[(edge + 1) % 3], p);
        let distance = at.distance_squared(p);
        if distance < best.0 {
            best = (distance, edge as u8, t, at);
        }
    }
    (best.3, edge_point(triangle, best.1, best.2))
}

fn edge_point(triangle: TriangleId, edge: u8, t: f64) -> SurfacePoint {
    let mut weights = [0.0; 3];
    weights[edge as usize] = 1.0 - t;
    weights[(edge as usize + 1) % 3] = t;
    surface_point(triangle, weights)
}

/// Weights that are within rounding of the triangle become a point of it.
fn surface_point(triangle: TriangleId, weights: [f64; 3]) -> SurfacePoint {
    let [a, b, c] = weights.map(|w| w.clamp(0.0, 1.0));
    let sum = a + b + c;
    let (u, v) = if sum > 0.0 { ((b / sum) as f32, (c / sum) as f32) } else { (0.0, 0.0) };
    SurfacePoint { triangle, barycentric: [u, v.min(1.0 - u)] }
}
