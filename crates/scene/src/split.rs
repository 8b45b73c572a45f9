//! Vertices that carry two codes become two vertices.

use crate::baked::LayerCodes;

/// The vertices of a pool after every vertex got one copy for each distinct tuple of codes, one per layer, that its
/// corners show.
#[derive(Debug)]
pub(crate) struct Split {
    /// The original vertex behind each added one.
    pub added: Vec<u32>,
    /// Per layer, per final vertex; the originals come first and keep their numbers.
    pub codes: Vec<Vec<[u16; 2]>>,
    /// Per final vertex: the color of the first corner that shows it.
    pub fallback: Vec<[f32; 3]>,
    /// Final vertices per triangle, in the order of the corners given.
    pub corners: Vec<[u32; 3]>,
}

/// What vertices without a triangle get: a color-vertex that is valid in every form, a table's first entry included.
const UNUSED: [u16; 2] = [0, 0x8000];

/// Splits a pool of `vertices` vertices. The first tuple of codes that a vertex is seen with stays on it.
///
/// - `corners`: the pool's vertices, per triangle; all below `vertices`
/// - `codes`: per layer, per triangle; `fallback`: per triangle, a missing one counts as white
pub(crate) fn split(
    vertices: usize,
    corners: impl ExactSizeIterator<Item = [u32; 3]>,
    codes: &LayerCodes,
    fallback: &[[[f32; 3]; 3]],
) -> Split {
    const END: u32 = u32::MAX;
    const UNSEEN: u32 = u32::MAX - 1;
    // The copies of a vertex form a chain that starts at the original.
    let mut next = vec![UNSEEN; vertices];
    let mut out = Split {
        added: Vec::new(),
        codes: vec![vec![UNUSED; vertices]; codes.len()],
        fallback: vec![[1.0; 3]; vertices],
        corners: Vec::new(),
    };
    out.corners.reserve_exact(corners.len());
    for (t, triangle) in corners.enumerate() {
        let mut place = |k: usize| -> u32 {
            let vertex = triangle[k];
            let color = fallback.get(t).map_or([1.0; 3], |f| f[k]);
            if next[vertex as usize] == UNSEEN {
                next[vertex as usize] = END;
                for (out, codes) in out.codes.iter_mut().zip(codes) {
                    out[vertex as usize] = codes[t][k];
                }
                out.fallback[vertex as usize] = color;
                return vertex;
            }
            let mut at = vertex;
            while out.codes.iter().zip(codes).any(|(out, codes)| out[at as usize] != codes[t][k]) {
                if next[at as usize] == END {
                    let new = next.len() as u32;
                    next[at as usize] = new;
                    next.push(END);
                    out.added.push(vertex);
                    for (out, codes) in out.codes.iter_mut().zip(codes) {
                        out.push(codes[t][k]);
                    }
                    out.fallback.push(color);
                    return new;
                }
                at = next[at as usize];
            }
            at
        };
        let placed = [place(0), place(1), place(2)];
        out.corners.push(placed);
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn split_keeps_originals_and_appends_copies() {
        // Two triangles of a quad; the shared vertex 2 has another code in the second.
        let corners = [[0, 1, 2], [2, 1, 3]];
        let codes = [vec![[[0, 0], [1, 1], [2, 2]], [[9, 9], [1, 1], [3, 3]]]];
        let fallback = [[0.0, 0.1, 0.2], [0.9, 0.1, 0.3]].map(|f| f.map(|v| [v; 3]));
        let out = split(5, corners.into_iter(), &codes, &fallback);
        assert_eq!(out.added, [2]);
        assert_eq!(out.corners, [[0, 1, 2], [5, 1, 3]]);
        assert_eq!(out.codes, [[[0, 0], [1, 1], [2, 2], [3, 3], UNUSED, [9, 9]]]);
        assert_eq!(out.fallback, [0.0, 0.1, 0.2, 0.3, 1.0, 0.9].map(|v| [v; 3]));
    }

    #[test]
    fn split_same_pair_is_shared() {
        let corners = [[0, 1, 2], [0, 1, 2], [0, 0, 0]];
        let codes = [vec![[[1, 0]; 3], [[2, 0]; 3], [[2, 0]; 3]]];
        let out = split(3, corners.into_iter(), &codes, &[]);
        assert_eq!(out.added, [0, 1, 2]);
        assert_eq!(out.corners, [[0, 1, 2], [3, 4, 5], [3, 3, 3]]);
    }

    #[test]
    fn split_looks_at_the_tuple_of_all_layers() {
        // One vertex, six corners: three distinct pairs, though each layer alone shows only two codes.
        let corners = [[0, 0, 0], [0, 0, 0]];
        let first = vec![[[1, 0], [1, 0], [2, 0]], [[2, 0], [1, 0], [2, 0]]];
        let second = vec![[[7, 0], [8, 0], [8, 0]], [[8, 0], [7, 0], [8, 0]]];
        let out = split(1, corners.into_iter(), &[first, second], &[]);
        assert_eq!(out.added, [0, 0]);
        assert_eq!(out.corners, [[0, 1, 2], [2, 0, 2]]);
        assert_eq!(out.codes, [[[1, 0], [1, 0], [2, 0]], [[7, 0], [8, 0], [8, 0]]]);
    }

    #[test]
    fn split_adds_one_vertex_for_each_further_tuple() {
        // Any numbers will do: few vertices and few codes, so that tuples meet again.
        let mut state = 1_u64;
        let mut below = |n: u64| {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            ((state >> 33) % n) as u32
        };
        for layers in 1..4 {
            for _ in 0..40 {
                let (vertices, triangles) = (1 + below(6) as usize, below(30) as usize);
                let corners: Vec<[u32; 3]> =
                    (0..triangles).map(|_| [0; 3].map(|_| below(vertices as u64))).collect();
                let mut code = || [0; 3].map(|_| [below(2) as u16, 0x8000 | below(2) as u16]);
                let codes: Vec<Vec<_>> =
                    (0..layers).map(|_| (0..triangles).map(|_| code()).collect()).collect();
                let out = split(vertices, corners.iter().copied(), &codes, &[]);
                let mut tuples = std::collections::BTreeSet::new();
                for (t, corner) in corners.iter().enumerate() {
                    for k in 0..3 {
                        let tuple: Vec<[u16; 2]> = codes.iter().map(|c| c[t][k]).collect();
                        let at = out.corners[t][k] as usize;
                        assert_eq!(out.codes.iter().map(|c| c[at]).collect::<Vec<_>>(), tuple);
                        let original = at.checked_sub(vertices).map_or(at as u32, |added| out.added[added]);
                        assert_eq!(original, corner[k]);
                        tuples.insert((corner[k], tuple));
                    }
                }
                let used: std::collections::BTreeSet<u32> = corners.iter().flatten().copied().collect();
                assert_eq!(out.added.len(), tuples.len() - used.len());
            }
        }
    }

    #[test]
    fn split_without_layers_or_triangles_adds_nothing() {
        assert_eq!(split(2, [[0, 1, 0]].into_iter(), &[], &[]).added, [0_u32; 0]);
        let out = split(2, [].into_iter(), &[Vec::new()], &[]);
        assert_eq!((out.codes, out.corners), (vec![vec![UNUSED; 2]], vec![]));
    }
}
