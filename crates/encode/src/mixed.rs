//! Which corner of a color triangle shows what: the four cases of Schaefer 2012, section 4.3 and Fig. 6, and
//! the ones that the paper leaves out.
//!
//! A vertex of a texture triangle is a texture-vertex, every other vertex a color-vertex. `UV / eta` moves
//! along the straight line between the atlas places of a triangle's texture corners. That line shows the
//! right texels only if it is a *chart edge*: an edge that the triangle shares with a texture triangle, with
//! the places that this texture triangle uses. Everywhere else it crosses unrelated texels. So no color
//! triangle may have two texture corners but along one chart edge; any further texture-vertex is shown there
//! as a *color copy*: a color code whose value is what the atlas reads at the vertex.
//!
//! | texture-vertices | chart edge | corners |
//! |---|---|---|
//! | 0 | | three colors |
//! | 1 | | any place of the vertex, two colors |
//! | 2 or 3 | yes | the two places of the chart edge; the third its color or a color copy |
//! | 2 or 3 | no | at most one place of one vertex, color copies for the others |
//!
//! Along every edge between two color triangles both then show the straight line between the values of the
//! two vertices, and along a chart edge both show the same texels: the light has no seam, as long as all
//! places of a vertex read the same (stitching sees to that). A color triangle with several chart edges can
//! follow only one of them, the longest; `classify::fill_notches` leaves none.
//!
//! Deviation: the paper has only the cases whose texture corners share a chart edge.
//!
//! **Which vertices are copied.** The third corner at a chart edge must be. For triangles without a chart
//! edge there is a choice: every pair of texture-vertices needs a copy of one of them, and a copy that exists
//! serves all triangles around it. The fewest copies are a minimum vertex cover of these pairs. It is built
//! greedily: first the copies that must be, then the partner of any vertex with one open pair, then the vertex
//! with the most open pairs, the lowest number first. Pairs form short paths and small stars along borders;
//! without cycles this is the minimum.

use std::cmp::Reverse;
use std::collections::BinaryHeap;

use lightkiln_mesh::{Adjacency, EdgeKind, Mesh, TriangleId, VertexId};

/// Which kind of triangle this is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Case {
    /// A texture triangle.
    Texture,
    /// Three color-vertices.
    Color,
    /// Shares a chart edge with a texture triangle.
    ChartEdge {
        /// The edge's number here; with several chart edges the longest.
        edge: u8,
        /// The texture triangle.
        across: TriangleId,
        /// The edge's number there; it runs the other way.
        across_edge: u8,
        /// How many edges are chart edges.
        chart_edges: u8,
        /// Whether the corner off the edge is a texture-vertex, which takes a color copy.
        third: bool,
    },
    /// No chart edge and one texture-vertex.
    Lone,
    /// No chart edge and several texture-vertices: all but one take color copies.
    Split,
}

/// Marks the vertices with at least one texture triangle around them.
pub fn texture_vertices(mesh: &Mesh, is_texture: &[bool]) -> Vec<bool> {
    let mut marks = vec![false; mesh.vertex_count()];
    for (corners, _) in mesh.triangles.iter().zip(is_texture).filter(|(_, texture)| **texture) {
        for v in corners {
            marks[v.index()] = true;
        }
    }
    marks
}

/// Tells the case of a triangle. `is_texture_vertex` is what [`texture_vertices`] returns, less the detached ones:
/// an edge with a detached end is no chart edge.
pub fn case_of(
    mesh: &Mesh,
    adjacency: &Adjacency,
    is_texture: &[bool],
    is_texture_vertex: &[bool],
    triangle: TriangleId,
) -> Case {
    if is_texture[triangle.index()] {
        return Case::Texture;
    }
    let corners = mesh.triangles[triangle.index()];
    let is_place = corners.map(|v| is_texture_vertex[v.index()]);
    if is_place == [false; 3] {
        return Case::Color;
    }
    let mut longest = -1.0;
    let mut found = None;
    let mut chart_edges = 0;
    for edge in 0..3 {
        let EdgeKind::Interior { triangle: across, edge: across_edge } = adjacency.across(triangle, edge)
        else {
            continue;
        };
        if !is_texture[across.index()] || !is_place[edge] || !is_place[(edge + 1) % 3] {
            continue;
        }
        chart_edges += 1;
        let [from, to] = [corners[edge], corners[(edge + 1) % 3]].map(|v| mesh.positions[v.index()]);
        let length = from.distance_squared(to);
        if length > longest {
            longest = length;
            found = Some((edge, across, across_edge));
        }
    }
    if let Some((edge, across, across_edge)) = found {
        let third = is_place[(edge + 2) % 3];
        return Case::ChartEdge { edge: edge as u8, across, across_edge, chart_edges, third };
    }
    if distinct_places(corners, is_place).count() == 1 { Case::Lone } else { Case::Split }
}

/// The texture-vertices of a triangle, each once (a degenerate triangle may name one twice).
fn distinct_places(corners: [VertexId; 3], is_place: [bool; 3]) -> impl Iterator<Item = VertexId> {
    (0..3).filter(move |&i| is_place[i] && !(0..i).any(|j| corners[j] == corners[i])).map(move |i| corners[i])
}

/// The texture-vertices that some color triangle shows as a color copy.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Copies {
    /// Per light vertex.
    pub marks: Vec<bool>,
    /// Copies that a third corner at a chart edge demands.
    pub at_chart_edges: usize,
    /// Copies that only triangles without a chart edge demand.
    pub elsewhere: usize,
}

impl Copies {
    /// Chooses them; see the [module](self) for how.
    pub fn choose(
        mesh: &Mesh,
        adjacency: &Adjacency,
        is_texture: &[bool],
        is_texture_vertex: &[bool],
    ) -> Self {
        let mut marks = vec![false; mesh.vertex_count()];
        let mut at_chart_edges = 0;
        let mut split = Vec::new();
        for t in mesh.triangle_ids() {
            match case_of(mesh, adjacency, is_texture, is_texture_vertex, t) {
                Case::ChartEdge { edge, third: true, .. } => {
                    let v = mesh.triangles[t.index()][(edge as usize + 2) % 3].index();
                    at_chart_edges += usize::from(!marks[v]);
                    marks[v] = true;
                }
                Case::Split => split.push(t),
                _ => {}
            }
        }
        // Pairs of texture-vertices that still need a copy of one of them, in both directions.
        let mut pairs: Vec<(VertexId, VertexId)> = Vec::new();
        for &t in &split {
            let corners = mesh.triangles[t.index()];
            let open = corners.map(|v| is_texture_vertex[v.index()] && !marks[v.index()]);
            for a in distinct_places(corners, open) {
                pairs.extend(distinct_places(corners, open).filter(|&b| b != a).map(|b| (a, b)));
            }
        }
        pairs.sort_unstable();
        pairs.dedup();
        let elsewhere = cover(&pairs, &mut marks);
        Self { marks, at_chart_edges, elsewhere }
    }

    /// Whether a corner of a triangle shows a color copy.
    pub fn at_corner(&self, mesh: &Mesh, triangle: TriangleId, case: Case, corner: usize) -> bool {
        match case {
            Case::ChartEdge { edge, third: true, .. } => corner == (edge as usize + 2) % 3,
            Case::Split => self.marks[mesh.triangles[triangle.index()][corner].index()],
            _ => false,
        }
    }
}

/// Marks vertices until every pair has a marked one; returns how many. `pairs` is sorted and holds both
/// directions of each pair.
fn cover(pairs: &[(VertexId, VertexId)], marks: &mut [bool]) -> usize {
    let rows: Vec<&[(VertexId, VertexId)]> = pairs.chunk_by(|x, y| x.0 == y.0).collect();
    let row_of =
        |v: VertexId| rows.binary_search_by_key(&v, |row| row[0].0).expect("pairs come in both directions");
    let mut degrees: Vec<u32> = rows.iter().map(|row| row.len() as u32).collect();
    // Vertices with one open pair first, then those with most, then the lowest number. Entries whose count is
    // stale are skipped.
    let entry =
        |row: usize, degree: u32| (if degree == 1 { u32::MAX } else { degree }, Reverse(row as u32), degree);
    let mut queue: BinaryHeap<(u32, Reverse<u32>, u32)> =
        degrees.iter().enumerate().map(|(row, &degree)| entry(row, degree)).collect();
    let mut chosen = 0;
    while let Some((_, Reverse(row), degree)) = queue.pop() {
        let row = row as usize;
        if degree == 0 || degrees[row] != degree || marks[rows[row][0].0.index()] {
            continue;
        }
        let open = rows[row].iter().find(|(_, other)| !marks[other.index()]).map(|&(_, other)| row_of(other));
        let picked = if degree == 1 { open.expect("its one open pair") } else { row };
        marks[rows[picked][0].0.index()] = true;
        chosen += 1;
        for &(_, other) in rows[picked] {
            if !marks[other.index()] {
                let other = row_of(other);
                degrees[other] -= 1;
                queue.push(entry(other, degrees[other]));
            }
        }
    }
    chosen
}

/// The texture triangle nearest to a corner of a color triangle, stepping around the corner's vertex over
/// interior edges, and which of its corners the vertex is.
///
/// A place that a neighbour uses costs no vertex in the file, even where the file splits the vertex between
/// materials. `None` where the texture triangles hang on the vertex alone.
pub(crate) fn nearest_texture_corner(
    adjacency: &Adjacency,
    is_texture: &[bool],
    triangle: TriangleId,
    corner: usize,
) -> Option<(TriangleId, usize)> {
    // Counter-clockwise over the edge that ends in the vertex, clockwise over the one that begins there.
    let ccw = |(t, c): (TriangleId, usize)| match adjacency.across(t, (c + 2) % 3) {
        EdgeKind::Interior { triangle, edge } => Some((triangle, edge as usize)),
        _ => None,
    };
    let cw = |(t, c): (TriangleId, usize)| match adjacency.across(t, c) {
        EdgeKind::Interior { triangle, edge } => Some((triangle, (edge as usize + 1) % 3)),
        _ => None,
    };
    let start = (triangle, corner);
    let (mut left, mut right) = (Some(start), Some(start));
    while left.is_some() || right.is_some() {
        left = left.and_then(ccw).filter(|&at| at != start);
        right = right.and_then(cw).filter(|&at| at != start);
        for at in [left, right].into_iter().flatten() {
            if is_texture[at.0.index()] {
                return Some(at);
            }
        }
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn greedy(vertices: usize, edges: &[(u32, u32)]) -> usize {
        let mut pairs: Vec<_> = edges
            .iter()
            .flat_map(|&(a, b)| [(VertexId(a), VertexId(b)), (VertexId(b), VertexId(a))])
            .collect();
        pairs.sort_unstable();
        pairs.dedup();
        let mut marks = vec![false; vertices];
        let chosen = cover(&pairs, &mut marks);
        assert!(pairs.iter().all(|(a, b)| marks[a.index()] || marks[b.index()]));
        assert_eq!(chosen, marks.iter().filter(|&&mark| mark).count());
        chosen
    }

    #[test]
    fn cover_star_and_path_are_the_fewest() {
        assert_eq!(greedy(5, &[(0, 1), (0, 2), (0, 3), (0, 4)]), 1);
        assert_eq!(greedy(5, &[(0, 1), (1, 2), (2, 3), (3, 4)]), 2);
        assert_eq!(greedy(3, &[(0, 1), (1, 2), (2, 0)]), 2);
        assert_eq!(greedy(2, &[]), 0);
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(64))]

        /// On trees of up to 12 vertices the choice is the fewest.
        #[test]
        fn cover_small_tree_is_the_fewest(parents in prop::collection::vec(any::<prop::sample::Index>(), 1..12)) {
            let edges: Vec<(u32, u32)> =
                parents.iter().enumerate().map(|(i, p)| (p.index(i + 1) as u32, i as u32 + 1)).collect();
            let vertices = parents.len() + 1;
            let fewest = (0_u32..1 << vertices)
                .filter(|set| edges.iter().all(|&(a, b)| set >> a & 1 == 1 || set >> b & 1 == 1))
                .map(u32::count_ones)
                .min()
                .expect("all vertices cover");
            prop_assert_eq!(greedy(vertices, &edges), fewest as usize);
        }
    }
}
