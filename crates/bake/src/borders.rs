//! Where charts meet color triangles: both must show the same (DESIGN, "Seams").
//!
//! A color triangle beside a chart reads its chart edge from the atlas and blends it with its own color-vertex
//! (Schaefer 4.3). Were the atlas free to show the light as it is there, the vertex values that the color
//! triangles were judged by would no longer be what they show, and the error would creep outward ring by ring.
//! So it is the texels that give way: lookups along such edges are held to the line between the fitted vertex
//! values. They are within the bound of the light, or the color triangle would be none.

use lightkiln_chart::Chart;
use lightkiln_mesh::{EdgeKind, TriangleId, VertexId};
use lightkiln_texel::Hold;
use rayon::prelude::*;

use crate::Surface;

/// Pulls of a point of an edge and of a vertex, relative to a shaded texel.
const EDGE_WEIGHT: f32 = 20.0;
const VERTEX_WEIGHT: f32 = 1e3;

/// What the texels of all charts must read where they meet color triangles; `values` are vertices x channels.
pub fn border_holds(
    surface: &Surface<'_>,
    is_texture: &[bool],
    charts: &[Chart],
    values: &[f32],
    channels: usize,
) -> Vec<Hold> {
    let value = |vertex: VertexId| &values[vertex.index() * channels..][..channels];
    let of_chart = |(number, chart): (usize, &Chart)| {
        let mut holds = Vec::new();
        let mut hold = |uv, value, weight| {
            holds.push(Hold { chart: number as u32, uv, value, weight });
        };
        for (&triangle, corners) in chart.triangles.iter().zip(&chart.corners) {
            for edge in 0..3 {
                if !meets_color(surface, is_texture, triangle, edge) {
                    continue;
                }
                let ends = [corners[edge], corners[(edge + 1) % 3]].map(|c| c as usize);
                let [from, to] = ends.map(|c| chart.uv[c]);
                let [first, last] = ends.map(|c| value(chart.vertices[c]));
                let steps = (from.distance(to) * 2.0).ceil().max(1.0) as u32;
                for step in 1..steps {
                    let t = step as f32 / steps as f32;
                    let line = first.iter().zip(last).map(|(a, b)| a + (b - a) * t).collect();
                    hold(from.lerp(to, t), line, EDGE_WEIGHT);
                }
            }
        }
        for (&vertex, &uv) in chart.vertices.iter().zip(&chart.uv) {
            if surface.fans.around(vertex).iter().any(|t| !is_texture[t.index()]) {
                hold(uv, value(vertex).to_vec(), VERTEX_WEIGHT);
            }
        }
        holds
    };
    charts.par_iter().enumerate().flat_map_iter(of_chart).collect()
}

/// Whether a color triangle lies across an edge of a texture triangle.
fn meets_color(surface: &Surface<'_>, is_texture: &[bool], triangle: TriangleId, edge: usize) -> bool {
    match surface.adjacency.across(triangle, edge) {
        EdgeKind::Interior { triangle, .. } => !is_texture[triangle.index()],
        EdgeKind::Boundary => false,
        EdgeKind::NonManifold => {
            let corners = surface.mesh.triangles[triangle.index()];
            let [a, b]: [VertexId; 2] = [corners[edge], corners[(edge + 1) % 3]];
            let around = surface.fans.around(a).iter();
            around.clone().any(|t| !is_texture[t.index()] && surface.mesh.triangles[t.index()].contains(&b))
        }
    }
}
