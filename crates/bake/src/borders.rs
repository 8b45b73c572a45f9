//! Where charts meet color triangles: both must show the same (DESIGN, "Seams").
//!
//! A color triangle beside a chart reads its chart edge from the atlas and blends it with its own color-vertex
//! (Schaefer 4.3). Were the atlas free to show the light as it is there, the vertex values that the color
//! triangles were judged by would no longer be what they show, and the error would creep outward ring by ring.
//! So it is the texels that give way: lookups along such edges are held to the line between the fitted vertex
//! values. They are within the bound of the light where samples have seen it, or the color triangle would be none.
//!
//! The pull is by length, as that of seams, and little of it by vertices. Charts a tenth of a texel wide have dozens of
//! vertices a texel, on both of their borders: were each held firmly for itself, a slope that is steep across the
//! chart would win over all light that was shaded, and leave texels at the ends of the range.

use lightkiln_chart::Chart;
use lightkiln_mesh::{Adjacency, EdgeKind, Fans, Mesh, TriangleId, VertexId};
use lightkiln_texel::Hold;
use rayon::prelude::*;

/// Pull of a half texel of an edge, relative to a shaded texel.
const EDGE_WEIGHT: f32 = 20.0;
/// Pull of a vertex beside that of its edges: color triangles may meet the chart in this corner only. With weaker
/// pulls (10 and 1 here), the rounds of a turbocharger did not come to an end.
const VERTEX_WEIGHT: f32 = 5.0;
/// Pull between the places of a light vertex: firmer than all holds, so that places that can agree do. Where charts are
/// finer than a texel not all can, and a much firmer pull drives texels out of the range, where they are clamped.
pub const PLACES_WEIGHT: f32 = 1e3;

/// Where charts and color triangles of a light mesh may meet.
pub struct Borders<'a> {
    /// The light mesh.
    pub mesh: &'a Mesh,
    /// Which triangle lies across which edge.
    pub adjacency: &'a Adjacency,
    /// Which triangles surround a vertex.
    pub fans: &'a Fans,
    /// Which triangles have charts.
    pub is_texture: &'a [bool],
}

impl Borders<'_> {
    /// What the texels of all charts must read where they meet color triangles; `values` are vertices x channels.
    pub fn holds(&self, charts: &[Chart], values: &[f32], channels: usize) -> Vec<Hold> {
        let value = |vertex: VertexId| &values[vertex.index() * channels..][..channels];
        let of_chart = |(number, chart): (usize, &Chart)| {
            let mut holds = Vec::new();
            let mut hold = |uv, value, weight| {
                holds.push(Hold { chart: number as u32, uv, value, weight });
            };
            let mut of_vertices = vec![VERTEX_WEIGHT; chart.uv.len()];
            for (&triangle, corners) in chart.triangles.iter().zip(&chart.corners) {
                for edge in 0..3 {
                    if !self.meets_color(triangle, edge) {
                        continue;
                    }
                    let ends = [corners[edge], corners[(edge + 1) % 3]].map(|c| c as usize);
                    let [from, to] = ends.map(|c| chart.uv[c]);
                    let [first, last] = ends.map(|c| value(chart.vertices[c]));
                    let half_texels = from.distance(to) * 2.0;
                    let steps = half_texels.ceil().max(1.0) as u32;
                    let weight = EDGE_WEIGHT * half_texels / steps as f32;
                    ends.iter().for_each(|&c| of_vertices[c] += 0.5 * weight);
                    for step in 1..steps {
                        let t = step as f32 / steps as f32;
                        let line = first.iter().zip(last).map(|(a, b)| a + (b - a) * t).collect();
                        hold(from.lerp(to, t), line, weight);
                    }
                }
            }
            for ((&vertex, &uv), weight) in chart.vertices.iter().zip(&chart.uv).zip(of_vertices) {
                if self.fans.around(vertex).iter().any(|t| !self.is_texture[t.index()]) {
                    hold(uv, value(vertex).to_vec(), weight);
                }
            }
            holds
        };
        charts.par_iter().enumerate().flat_map_iter(of_chart).collect()
    }

    /// Whether a color triangle lies across an edge of a texture triangle.
    fn meets_color(&self, triangle: TriangleId, edge: usize) -> bool {
        match self.adjacency.across(triangle, edge) {
            EdgeKind::Interior { triangle, .. } => !self.is_texture[triangle.index()],
            EdgeKind::Boundary => false,
            EdgeKind::NonManifold => {
                let corners = self.mesh.triangles[triangle.index()];
                let [a, b]: [VertexId; 2] = [corners[edge], corners[(edge + 1) % 3]];
                let around = self.fans.around(a).iter();
                around
                    .clone()
                    .any(|t| !self.is_texture[t.index()] && self.mesh.triangles[t.index()].contains(&b))
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::{Vec2, Vec3};
    use lightkiln_texel::{StitchOptions, lift, stitch};

    /// Columns of a sheet, 1/8 texel wide, and its rows: color triangles, a strip of texture 1/8 texel wide, color triangles.
    const COLUMNS: u32 = 160;
    const ROWS: [f32; 4] = [-4.0, 0.0, 0.125, 4.0];

    fn sheet() -> (Mesh, Vec<bool>, Chart) {
        let at = |i: u32, j: u32| VertexId(j * (COLUMNS + 1) + i);
        let positions: Vec<Vec3> = ROWS
            .iter()
            .flat_map(|&y| (0..=COLUMNS).map(move |i| Vec3::new(i as f32 / 8.0, y, 0.0)))
            .collect();
        let quads = (0..3).flat_map(|j| (0..COLUMNS).map(move |i| (i, j)));
        let triangles: Vec<[VertexId; 3]> = quads
            .flat_map(|(i, j)| {
                let [a, b, c, d] = [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)];
                [[a, b, c], [a, c, d]]
            })
            .collect();
        let is_texture: Vec<bool> = (0..triangles.len() as u32).map(|t| t / 2 / COLUMNS == 1).collect();
        let normals = vec![Vec3::Z; positions.len()];
        let mesh = Mesh::new(positions, normals, triangles).unwrap();
        let vertices: Vec<VertexId> =
            [1, 2].iter().flat_map(|&j| (0..=COLUMNS).map(move |i| at(i, j))).collect();
        let own: Vec<TriangleId> = mesh.triangle_ids().filter(|t| is_texture[t.index()]).collect();
        let corner = |v: VertexId| v.0 - at(0, 1).0;
        let chart = Chart {
            corners: own.iter().map(|t| mesh.triangles[t.index()].map(corner)).collect(),
            uv: vertices.iter().map(|v| mesh.positions[v.index()].truncate() + Vec2::new(2.0, 3.0)).collect(),
            triangles: own,
            vertices,
            size: [COLUMNS / 8 + 4, 8],
        };
        (mesh, is_texture, chart)
    }

    fn holds(mesh: &Mesh, is_texture: &[bool], chart: &Chart, values: &[f32]) -> Vec<Hold> {
        let (adjacency, fans) = (Adjacency::new(mesh), Fans::new(mesh));
        let borders = Borders { mesh, adjacency: &adjacency, fans: &fans, is_texture };
        borders.holds(std::slice::from_ref(chart), values, 1)
    }

    /// The vertices on both sides of the strip are within 3 % of the light, on opposite sides of it; a line through
    /// both reaches 0.23 and 0.77 half a texel away. The slack is 0.2 beyond what is held.
    #[test]
    fn holds_of_a_thin_strip_leave_texels_near_the_light() {
        let (mesh, is_texture, chart) = sheet();
        let values: Vec<f32> = mesh.positions.iter().map(|p| if p.y > 0.06 { 0.53 } else { 0.47 }).collect();
        let holds = holds(&mesh, &is_texture, &chart, &values);
        let charts = [chart];
        let texels = lift(&mesh, &Adjacency::new(&mesh), &charts, 0);
        let mut shown = vec![vec![0.5; texels[0].len()]];
        let options = StitchOptions {
            holds: &holds,
            vertex_weight: PLACES_WEIGHT,
            range: [0.0, 1.0],
            ..StitchOptions::default()
        };
        stitch(&mesh, &charts, &texels, &mut shown, 1, &options).unwrap();
        let (low, high) = shown[0].iter().fold((1.0_f32, 0.0_f32), |(l, h), &v| (l.min(v), h.max(v)));
        assert!(low > 0.27 && high < 0.73, "{low} {high}");
    }
}
