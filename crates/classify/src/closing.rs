//! Morphology on the set of texture triangles: Schaefer 2012, section 4.2 and figure 5.

use lightkiln_mesh::{Adjacency, TriangleId};
use petgraph::unionfind::UnionFind;
use petgraph::visit::{EdgeRef, IntoEdgeReferences};

use crate::Dual;

/// How often the paper applies [`close`].
pub const STEPS: usize = 2;

/// Closes the set of texture triangles, `steps` times ([`STEPS`] in the paper).
///
/// One step (figure 5): every neighbour of a texture triangle is marked too; then those that share only one edge
/// with a marked triangle are taken back. So gaps of up to two triangles between texture triangles close, and
/// borders do not creep outwards.
///
/// Deviation: read literally the second half takes back original texture triangles as well, at borders of the
/// mesh and where they stand alone. Here a triangle that was texture before a step is texture after it.
///
/// `is_texture` has an entry for each triangle of the mesh.
pub fn close(adjacency: &Adjacency, is_texture: &mut [bool], steps: usize) {
    for _ in 0..steps {
        let mut marked = is_texture.to_vec();
        for (t, _) in is_texture.iter().enumerate().filter(|&(_, &texture)| texture) {
            for (_, n) in adjacency.neighbors(TriangleId(t as u32)) {
                marked[n.index()] = true;
            }
        }
        let dual = Dual::new(adjacency, &marked);
        let mut changed = false;
        for (node, triangle) in dual.triangles.iter().enumerate() {
            let texture = &mut is_texture[triangle.index()];
            if !*texture && dual.shared_edges(node as u32) > 1 {
                *texture = true;
                changed = true;
            }
        }
        if !changed {
            break;
        }
    }
}

/// Promotes color triangles with at least two edges to texture triangles, until there is none; returns how many.
///
/// Such a triangle is a notch of a chart: all its vertices are texture-vertices anyway, and as texture it costs
/// few texels.
///
/// `is_texture` has an entry for each triangle of the mesh.
pub fn fill_notches(adjacency: &Adjacency, is_texture: &mut [bool]) -> usize {
    let is_notch = |t: TriangleId, is_texture: &[bool]| {
        let texture = |&(_, n): &(usize, TriangleId)| n != t && is_texture[n.index()];
        !is_texture[t.index()] && adjacency.neighbors(t).filter(texture).count() >= 2
    };
    let mut open: Vec<TriangleId> =
        (0..is_texture.len() as u32).map(TriangleId).filter(|&t| is_notch(t, is_texture)).collect();
    let mut promoted = 0;
    while let Some(t) = open.pop() {
        if is_notch(t, is_texture) {
            is_texture[t.index()] = true;
            promoted += 1;
            open.extend(adjacency.neighbors(t).map(|(_, n)| n));
        }
    }
    promoted
}

/// The connected regions of texture triangles, over interior edges.
///
/// Triangles ascend within a region, and regions by their first triangle. `is_texture` has an entry for each
/// triangle of the mesh.
pub fn regions(adjacency: &Adjacency, is_texture: &[bool]) -> Vec<Vec<TriangleId>> {
    let Dual { triangles, graph } = Dual::new(adjacency, is_texture);
    let mut sets = UnionFind::<u32>::new(triangles.len());
    for edge in graph.edge_references() {
        sets.union(edge.source(), edge.target());
    }
    let mut region_of = vec![u32::MAX; triangles.len()];
    let mut regions: Vec<Vec<TriangleId>> = Vec::new();
    for (set, triangle) in sets.into_labeling().into_iter().zip(triangles) {
        let region = &mut region_of[set as usize];
        if *region == u32::MAX {
            *region = regions.len() as u32;
            regions.push(Vec::new());
        }
        regions[*region as usize].push(triangle);
    }
    regions
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec3;
    use lightkiln_mesh::{Mesh, VertexId};
    use proptest::prelude::*;

    fn adjacency(vertices: u32, triangles: &[[u32; 3]]) -> Adjacency {
        let mesh = Mesh::new(
            (0..vertices).map(|i| Vec3::splat(i as f32)).collect(),
            vec![Vec3::Z; vertices as usize],
            triangles.iter().map(|t| t.map(VertexId)).collect(),
        );
        Adjacency::new(&mesh.unwrap())
    }

    /// A strip: triangle `t` has vertices t, t + 1, t + 2 and neighbours t - 1 and t + 1.
    ///
    /// ```text
    ///   1---3---5---7
    ///  / \0/ \2/ \4/     (numbers of triangles are approximate places)
    /// 0---2---4---6
    /// ```
    fn strip(count: u32) -> Adjacency {
        let triangle = |t: u32| if t.is_multiple_of(2) { [t, t + 2, t + 1] } else { [t, t + 1, t + 2] };
        adjacency(count + 2, &(0..count).map(triangle).collect::<Vec<_>>())
    }

    /// `n` x `n` quads; quad (i, j) holds triangles 2 (j n + i), below its diagonal, and the next, above.
    fn grid(n: u32) -> Adjacency {
        let at = |i: u32, j: u32| j * (n + 1) + i;
        let mut triangles = Vec::new();
        for j in 0..n {
            for i in 0..n {
                triangles.push([at(i, j), at(i + 1, j), at(i + 1, j + 1)]);
                triangles.push([at(i, j), at(i + 1, j + 1), at(i, j + 1)]);
            }
        }
        adjacency((n + 1) * (n + 1), &triangles)
    }

    fn set(pattern: &str) -> Vec<bool> {
        pattern.chars().map(|c| c == '#').collect()
    }

    fn shown(set: &[bool]) -> String {
        set.iter().map(|&t| if t { '#' } else { '.' }).collect()
    }

    fn closed(adjacency: &Adjacency, pattern: &str, steps: usize) -> String {
        let mut is_texture = set(pattern);
        close(adjacency, &mut is_texture, steps);
        shown(&is_texture)
    }

    #[test]
    fn close_one_step_on_a_strip_is_figure_5() {
        // Neighbours of # become +, those with one marked neighbour go back:
        //   input   # . # . . # . . . # . .
        //   marked  # + # + + # + . + # + .
        //   closed  # # # # # # . . . # . .
        assert_eq!(closed(&strip(12), "#.#..#...#..", 1), "######...#..");
    }

    #[test]
    fn close_hole_in_the_middle_of_a_plane_is_filled() {
        let whole = "#".repeat(32);
        let mut holes = whole.clone();
        holes.replace_range(10..12, ".."); // one quad
        assert_eq!(closed(&grid(4), &holes, 1), whole);
    }

    #[test]
    fn close_lone_triangle_is_kept_and_does_not_grow() {
        for at in 0..32 {
            let mut lone = ".".repeat(32);
            lone.replace_range(at..at + 1, "#");
            assert_eq!(closed(&grid(4), &lone, 5), lone);
        }
    }

    #[test]
    fn close_texture_at_the_border_is_never_lost() {
        // Both ends of a strip have one neighbour only: the paper's text would take them back.
        assert_eq!(closed(&strip(4), "#..#", 1), "####");
        assert_eq!(closed(&strip(5), "#...#", 2), "#...#");
        assert_eq!(closed(&strip(1), "#", 2), "#");
    }

    #[test]
    fn close_non_manifold_edge_connects_nothing() {
        // Three triangles at the edge 0-1, each with a neighbour over an edge of its own.
        let a = adjacency(8, &[[0, 1, 2], [0, 1, 3], [1, 0, 4], [2, 1, 5], [3, 1, 6], [4, 0, 7]]);
        assert_eq!(a.non_manifold_edges(), 1);
        assert_eq!(closed(&a, ".##.##", 3), ".##.##");
        assert_eq!(regions(&a, &set("######")).len(), 3);
    }

    #[test]
    fn close_two_steps_reach_further_than_one() {
        // Rows of a 6 x 6 grid: an L of texture; each step fills the inner corner a little more.
        let n = 6;
        let mut l = vec![false; 72];
        for i in 0..n {
            for k in 0..2 {
                l[2 * i + k] = true; // lowest row
                l[2 * (i * n) + k] = true; // leftmost column
            }
        }
        let count = |steps: usize| {
            let mut s = l.clone();
            close(&grid(6), &mut s, steps);
            s.iter().filter(|t| **t).count()
        };
        assert!(count(0) < count(1) && count(1) < count(2));
    }

    #[test]
    fn fill_notches_reaches_the_fixed_point() {
        let a = strip(9);
        let mut s = set("#.#.#..#.");
        assert_eq!(fill_notches(&a, &mut s), 2);
        assert_eq!(shown(&s), "#####..#.");
        assert_eq!(fill_notches(&a, &mut s), 0);
        // A hole of two quads side by side: filling its notches makes the next ones.
        let mut s = vec![true; 32];
        s[10..14].fill(false);
        assert_eq!(fill_notches(&grid(4), &mut s), 4);
        // Where each triangle of a hole has one texture neighbour at most, nothing is filled.
        let mut s = set("#....#");
        assert_eq!(fill_notches(&strip(6), &mut s), 0);
    }

    #[test]
    fn regions_are_ordered_and_complete() {
        let found = regions(&strip(9), &set("##.#..###"));
        let ids = |r: &[u32]| r.iter().map(|&t| TriangleId(t)).collect::<Vec<_>>();
        assert_eq!(found, [ids(&[0, 1]), ids(&[3]), ids(&[6, 7, 8])]);
        assert!(regions(&strip(3), &[false; 3]).is_empty());
        assert!(regions(&adjacency(0, &[]), &[]).is_empty());
    }

    #[test]
    fn dual_back_to_back_pair_shares_three_edges() {
        let a = adjacency(3, &[[0, 1, 2], [0, 2, 1]]);
        let dual = Dual::new(&a, &[true, true]);
        assert_eq!((dual.shared_edges(0), dual.shared_edges(1)), (3, 3));
        assert_eq!(closed(&a, "#.", 1), "##");
    }

    #[test]
    fn close_degenerate_triangle_is_no_neighbour_of_itself() {
        // Its edges 0-1 and 1-0 lie on each other.
        let a = adjacency(3, &[[0, 1, 0], [0, 1, 2]]);
        let mut s = vec![true, false];
        close(&a, &mut s, 2);
        fill_notches(&a, &mut s);
        assert!(s[0]);
        let a = adjacency(2, &[[0, 1, 0]]);
        assert_eq!(fill_notches(&a, &mut [false]), 0);
        assert_eq!(regions(&a, &[true]).len(), 1);
    }

    proptest! {
        #![proptest_config(ProptestConfig { cases: 64, ..ProptestConfig::default() })]

        #[test]
        fn close_is_monotone_and_never_loses(
            mut small in prop::collection::vec(prop::bool::weighted(0.2), 200),
            more in prop::collection::vec(prop::bool::weighted(0.1), 200),
            steps in 0_usize..4,
        ) {
            let a = grid(10);
            let original = small.clone();
            let mut large: Vec<bool> = small.iter().zip(&more).map(|(x, y)| *x || *y).collect();
            close(&a, &mut small, steps);
            close(&a, &mut large, steps);
            prop_assert!(original.iter().zip(&small).all(|(before, after)| !before || *after));
            prop_assert!(small.iter().zip(&large).all(|(s, l)| !s || *l));
            let mut again = small.clone();
            close(&a, &mut again, 200);
            let fixed = again.clone();
            close(&a, &mut again, 1);
            prop_assert_eq!(again, fixed);
        }

        #[test]
        fn regions_partition_the_texture_triangles(
            s in prop::collection::vec(any::<bool>(), 128),
        ) {
            let a = grid(8);
            let found = regions(&a, &s);
            let mut region_of = vec![usize::MAX; 128];
            for (r, list) in found.iter().enumerate() {
                prop_assert!(list.is_sorted());
                for t in list {
                    prop_assert_eq!(region_of[t.index()], usize::MAX);
                    region_of[t.index()] = r;
                }
            }
            prop_assert!(found.is_sorted_by_key(|r| r[0]));
            for t in 0..128 {
                prop_assert_eq!(s[t], region_of[t] != usize::MAX);
                for (_, n) in a.neighbors(TriangleId(t as u32)) {
                    prop_assert!(!s[t] || !s[n.index()] || region_of[t] == region_of[n.index()]);
                }
            }
        }
    }
}
