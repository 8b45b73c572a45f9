//! Vertices that carry two codes become two vertices.

/// The vertices of a pool after every (vertex, code) pair got a vertex of its own.
#[derive(Debug)]
pub(crate) struct Split {
    /// The original vertex behind each added one.
    pub added: Vec<u32>,
    /// Per final vertex; the originals come first and keep their numbers.
    pub codes: Vec<[u16; 2]>,
    /// Per final vertex: the value of the first corner that shows it.
    pub fallback: Vec<f32>,
    /// Final vertices per triangle, in the order of the corners given.
    pub corners: Vec<[u32; 3]>,
}

/// What vertices without a triangle get: full light, as a color-vertex.
const UNUSED: [u16; 2] = [u16::MAX, 0x8000];

/// Splits a pool of `vertices` vertices. The first code that a vertex is seen with stays on it.
///
/// - `corners`: the pool's vertices, per triangle; all below `vertices`
/// - `codes`, `fallback`: per triangle; a missing fallback counts as 1
pub(crate) fn split(
    vertices: usize,
    corners: impl Iterator<Item = [u32; 3]>,
    codes: &[[[u16; 2]; 3]],
    fallback: &[[f32; 3]],
) -> Split {
    const END: u32 = u32::MAX;
    const UNSEEN: u32 = u32::MAX - 1;
    // The copies of a vertex form a chain that starts at the original.
    let mut next = vec![UNSEEN; vertices];
    let mut out = Split {
        added: Vec::new(),
        codes: vec![UNUSED; vertices],
        fallback: vec![1.0; vertices],
        corners: Vec::new(),
    };
    out.corners.reserve_exact(codes.len());
    for (t, triangle) in corners.enumerate() {
        let mut place = |k: usize| -> u32 {
            let (vertex, code) = (triangle[k], codes[t][k]);
            let value = fallback.get(t).map_or(1.0, |f| f[k]);
            if next[vertex as usize] == UNSEEN {
                next[vertex as usize] = END;
                out.codes[vertex as usize] = code;
                out.fallback[vertex as usize] = value;
                return vertex;
            }
            let mut at = vertex;
            while out.codes[at as usize] != code {
                if next[at as usize] == END {
                    let new = next.len() as u32;
                    next[at as usize] = new;
                    next.push(END);
                    out.added.push(vertex);
                    out.codes.push(code);
                    out.fallback.push(value);
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
        let codes = [[[0, 0], [1, 1], [2, 2]], [[9, 9], [1, 1], [3, 3]]];
        let fallback = [[0.0, 0.1, 0.2], [0.9, 0.1, 0.3]];
        let out = split(5, corners.into_iter(), &codes, &fallback);
        assert_eq!(out.added, [2]);
        assert_eq!(out.corners, [[0, 1, 2], [5, 1, 3]]);
        assert_eq!(out.codes, [[0, 0], [1, 1], [2, 2], [3, 3], UNUSED, [9, 9]]);
        assert_eq!(out.fallback, [0.0, 0.1, 0.2, 0.3, 1.0, 0.9]);
    }

    #[test]
    fn split_same_pair_is_shared() {
        let corners = [[0, 1, 2], [0, 1, 2], [0, 0, 0]];
        let codes = [[[1, 0]; 3], [[2, 0]; 3], [[2, 0]; 3]];
        let out = split(3, corners.into_iter(), &codes, &[]);
        assert_eq!(out.added, [0, 1, 2]);
        assert_eq!(out.corners, [[0, 1, 2], [3, 4, 5], [3, 3, 3]]);
    }
}
