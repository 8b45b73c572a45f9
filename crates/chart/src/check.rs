//! Does a finished chart keep its promises? For tests, and for whoever makes charts in another way.

use glam::DVec2;
use lightkiln_mesh::Mesh;

use crate::chart::{Chart, SUBTEXELS};
use crate::overlap;

/// A promise that a chart breaks.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum ChartFault {
    /// The arrays do not fit each other or the mesh.
    #[error("arrays of the chart do not fit at triangle {triangle}")]
    Arrays {
        /// Entry of `triangles`.
        triangle: usize,
    },
    /// The chart is no connected disk: a hole, a handle, a pinch, an edge used twice.
    #[error("the chart is no disk")]
    NoDisk,
    /// A coordinate is not a multiple of 1/8 texel or lies outside the chart's grid.
    #[error("chart vertex {vertex} lies off the grid")]
    OffGrid {
        /// The chart vertex.
        vertex: usize,
    },
    /// The size is no multiple of 4.
    #[error("size {} x {} is no multiple of 4", size[0], size[1])]
    Size {
        /// Texels.
        size: [u32; 2],
    },
    /// A triangle is turned over, by more than snapping explains.
    #[error("triangle {triangle} of the chart is flipped by {height} texels")]
    Flipped {
        /// Entry of `triangles`.
        triangle: usize,
        /// Its height over its longest edge.
        height: f64,
    },
    /// The chart covers some texels twice.
    #[error("the chart overlaps itself")]
    Overlaps,
}

/// Twice the way that snapping moves a vertex, times the square root of two, and a little.
const SNAP_HEIGHT: f64 = 0.18;
/// Overlaps narrower than this, in texels, are what snapping leaves of borders that touch.
const SEEN: f64 = 0.3;

/// Checks everything that `charts` promises of a chart.
///
/// Snapping to 1/8 texel can turn a triangle over that is thinner than the snapping step; that is no fault.
///
/// # Errors
/// The first [`ChartFault`] found.
pub fn verify(chart: &Chart, mesh: &Mesh) -> Result<(), ChartFault> {
    if chart.corners.len() != chart.triangles.len()
        || chart.uv.len() != chart.vertices.len()
        || chart.triangles.is_empty()
    {
        return Err(ChartFault::Arrays { triangle: 0 });
    }
    for (at, (&t, corners)) in chart.triangles.iter().zip(&chart.corners).enumerate() {
        let ascending = at == 0 || chart.triangles[at - 1] < t;
        let light = mesh.triangles.get(t.index());
        let known = light.is_some_and(|light| {
            corners.iter().zip(light).all(|(&v, w)| chart.vertices.get(v as usize) == Some(w))
        });
        if !ascending || !known {
            return Err(ChartFault::Arrays { triangle: at });
        }
    }
    if chart.size.iter().any(|&s| s == 0 || s % 4 != 0) {
        return Err(ChartFault::Size { size: chart.size });
    }
    for (vertex, p) in chart.uv.iter().enumerate() {
        let steps = *p * SUBTEXELS as f32;
        let inside = p.x >= 0.0 && p.y >= 0.0 && p.x <= chart.size[0] as f32 && p.y <= chart.size[1] as f32;
        if !inside || steps != steps.round() {
            return Err(ChartFault::OffGrid { vertex });
        }
    }
    let border = border_of_disk(chart).ok_or(ChartFault::NoDisk)?;
    check_plane(chart, border)
}

/// The part of [`verify`] that looks at the plane only; `border`: chart vertices around the disk.
pub(crate) fn check_plane(chart: &Chart, border: impl IntoIterator<Item = u32>) -> Result<(), ChartFault> {
    let image = |corners: &[u32; 3]| corners.map(|v| chart.uv[v as usize].as_dvec2());
    for (triangle, corners) in chart.corners.iter().enumerate() {
        let u = image(corners);
        let area = (u[1] - u[0]).perp_dot(u[2] - u[0]);
        let longest = (0..3).map(|e| u[e].distance(u[(e + 1) % 3])).fold(0.0, f64::max);
        if area < -SNAP_HEIGHT * longest {
            return Err(ChartFault::Flipped { triangle, height: -area / longest });
        }
    }
    let curve: Vec<DVec2> = border.into_iter().map(|v| chart.uv[v as usize].as_dvec2()).collect();
    if overlap::crosses_itself(&curve) && overlap::covers_twice(chart.corners.iter().map(image), SEEN) {
        return Err(ChartFault::Overlaps);
    }
    Ok(())
}

/// The vertices around a chart in order, if it is a disk.
fn border_of_disk(chart: &Chart) -> Option<Vec<u32>> {
    let mut edges: Vec<(u32, u32)> =
        chart.corners.iter().flat_map(|c| [(c[0], c[1]), (c[1], c[2]), (c[2], c[0])]).collect();
    edges.sort_unstable();
    if edges.windows(2).any(|w| w[0] == w[1]) || edges.iter().any(|&(a, b)| a == b) {
        return None;
    }
    let open: Vec<(u32, u32)> =
        edges.iter().copied().filter(|&(a, b)| edges.binary_search(&(b, a)).is_err()).collect();
    let edge_count = (edges.len() + open.len()) / 2;
    if chart.vertices.len() + chart.corners.len() != edge_count + 1 {
        return None;
    }
    // One simple border curve. A connected surface with it and Euler characteristic 1 is a disk; pieces that
    // hang together nowhere, or at a vertex only, would each bring a curve of their own or meet one twice.
    let mut border = Vec::with_capacity(open.len());
    let (start, mut at) = *open.first()?;
    border.push(start);
    while at != start && border.len() <= open.len() {
        border.push(at);
        let from = open.partition_point(|&(a, _)| a < at);
        at = open.get(from).filter(|&&(a, _)| a == at)?.1;
    }
    (border.len() == open.len() && open.windows(2).all(|w| w[0].0 != w[1].0)).then_some(border)
}
