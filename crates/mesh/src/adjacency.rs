//! Which triangle lies across which edge, which triangles surround a vertex, and which belong together.

use crate::{Mesh, TriangleId};

/// What lies across an edge of a triangle.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum EdgeKind {
    /// One other triangle, which runs along the edge the other way; `edge` is the edge's number there.
    Interior {
        /// The triangle on the other side.
        triangle: TriangleId,
        /// The edge's number in that triangle, `0..3`.
        edge: u8,
    },
    /// Nothing: a border or a crease.
    Boundary,
    /// More than one other triangle, or one that runs along the edge the same way.
    NonManifold,
}

const BOUNDARY: u32 = u32::MAX;
const NON_MANIFOLD: u32 = u32::MAX - 1;

/// Triangle-to-triangle adjacency over light vertices. Edge `e` runs from corner `e` to corner `(e + 1) % 3`.
///
/// Memory: 12 bytes a triangle; building takes 16 bytes an edge more.
#[derive(Clone, Debug)]
pub struct Adjacency {
    // Per half-edge (3 t + e): the half-edge on the other side, or a mark.
    twins: Vec<u32>,
    non_manifold: usize,
}

impl Adjacency {
    /// Sorts the edges of a mesh and pairs those that two triangles share in opposite directions.
    pub fn new(mesh: &Mesh) -> Self {
        let mut edges: Vec<(u64, u32)> = Vec::with_capacity(mesh.triangles.len() * 3);
        for (triangle, corners) in mesh.triangles.iter().enumerate() {
            for edge in 0..3 {
                let (a, b) = (corners[edge].0, corners[(edge + 1) % 3].0);
                if a != b {
                    let key = (u64::from(a.min(b)) << 32) | u64::from(a.max(b));
                    edges.push((key, (triangle * 3 + edge) as u32));
                }
            }
        }
        edges.sort_unstable();
        let mut twins = vec![BOUNDARY; mesh.triangles.len() * 3];
        let mut non_manifold = 0;
        let tail = |half: u32| mesh.triangles[half as usize / 3][half as usize % 3];
        for run in edges.chunk_by(|x, y| x.0 == y.0) {
            match run {
                [_] => {}
                &[(_, x), (_, y)] if tail(x) != tail(y) => {
                    twins[x as usize] = y;
                    twins[y as usize] = x;
                }
                many => {
                    non_manifold += 1;
                    for &(_, half) in many {
                        twins[half as usize] = NON_MANIFOLD;
                    }
                }
            }
        }
        Self { twins, non_manifold }
    }

    /// What lies across edge `edge` (`0..3`) of a triangle.
    #[inline]
    pub fn across(&self, triangle: TriangleId, edge: usize) -> EdgeKind {
        match self.twins[triangle.index() * 3 + edge] {
            BOUNDARY => EdgeKind::Boundary,
            NON_MANIFOLD => EdgeKind::NonManifold,
            half => EdgeKind::Interior { triangle: TriangleId(half / 3), edge: (half % 3) as u8 },
        }
    }

    /// The neighbours of a triangle over interior edges, with the edge's number here.
    #[inline]
    pub fn neighbors(&self, triangle: TriangleId) -> impl Iterator<Item = (usize, TriangleId)> + '_ {
        (0..3).filter_map(move |edge| match self.across(triangle, edge) {
            EdgeKind::Interior { triangle, .. } => Some((edge, triangle)),
            _ => None,
        })
    }

    /// How many edges have more than two triangles or two that run the same way.
    pub fn non_manifold_edges(&self) -> usize {
        self.non_manifold
    }
}

/// The triangles around each vertex, in ascending order, in compressed rows.
#[derive(Clone, Debug)]
pub struct Fans {
    starts: Vec<u32>,
    triangles: Vec<TriangleId>,
}

impl Fans {
    /// Lists the triangles around each vertex. A degenerate triangle that names a vertex twice is listed once.
    pub fn new(mesh: &Mesh) -> Self {
        let mut starts = vec![0_u32; mesh.vertex_count() + 1];
        let distinct = |corners: &[crate::VertexId; 3]| {
            let [a, b, c] = *corners;
            [Some(a), (b != a).then_some(b), (c != a && c != b).then_some(c)]
        };
        for corners in &mesh.triangles {
            for v in distinct(corners).into_iter().flatten() {
                starts[v.index() + 1] += 1;
            }
        }
        for v in 0..mesh.vertex_count() {
            starts[v + 1] += starts[v];
        }
        let mut fill = starts.clone();
        let mut triangles = vec![TriangleId(0); starts[mesh.vertex_count()] as usize];
        for (t, corners) in mesh.triangles.iter().enumerate() {
            for v in distinct(corners).into_iter().flatten() {
                triangles[fill[v.index()] as usize] = TriangleId(t as u32);
                fill[v.index()] += 1;
            }
        }
        Self { starts, triangles }
    }

    /// The triangles around a vertex (`F_i` in Schaefer eq. 4).
    #[inline]
    pub fn around(&self, vertex: crate::VertexId) -> &[TriangleId] {
        &self.triangles[self.starts[vertex.index()] as usize..self.starts[vertex.index() + 1] as usize]
    }
}

/// Numbers the sheets of a mesh: triangles connected through shared light vertices.
///
/// Returns one sheet number per triangle, numbered by first triangle, and how many there are.
pub fn sheets(mesh: &Mesh) -> (Vec<u32>, usize) {
    let mut parent: Vec<u32> = (0..mesh.vertex_count() as u32).collect();
    fn root(parent: &mut [u32], mut v: u32) -> u32 {
        while parent[v as usize] != v {
            parent[v as usize] = parent[parent[v as usize] as usize];
            v = parent[v as usize];
        }
        v
    }
    for &[a, b, c] in &mesh.triangles {
        let ra = root(&mut parent, a.0);
        for other in [b, c] {
            let r = root(&mut parent, other.0);
            let ra = root(&mut parent, ra);
            parent[ra.max(r) as usize] = ra.min(r);
        }
    }
    let mut number = vec![u32::MAX; mesh.vertex_count()];
    let mut count = 0;
    let sheet_of = mesh
        .triangles
        .iter()
        .map(|corners| {
            let r = root(&mut parent, corners[0].0) as usize;
            if number[r] == u32::MAX {
                number[r] = count;
                count += 1;
            }
            number[r]
        })
        .collect();
    (sheet_of, count as usize)
}

#[cfg(test)]
mod tests {
    use glam::Vec3;

    use super::*;
    use crate::VertexId;

    fn mesh(vertices: u32, triangles: &[[u32; 3]]) -> Mesh {
        let positions = (0..vertices).map(|i| Vec3::new(i as f32, (i * i) as f32, 0.0)).collect();
        let normals = vec![Vec3::Z; vertices as usize];
        Mesh::new(positions, normals, triangles.iter().map(|t| t.map(VertexId)).collect()).unwrap()
    }

    // 2---3
    // | \ |    one square, two triangles
    // 0---1
    const SQUARE: [[u32; 3]; 2] = [[0, 1, 2], [3, 2, 1]];

    #[test]
    fn adjacency_of_a_square_is_its_diagonal() {
        let adjacency = Adjacency::new(&mesh(4, &SQUARE));
        assert_eq!(
            adjacency.across(TriangleId(0), 1),
            EdgeKind::Interior { triangle: TriangleId(1), edge: 1 }
        );
        assert_eq!(adjacency.across(TriangleId(0), 0), EdgeKind::Boundary);
        assert_eq!(adjacency.neighbors(TriangleId(1)).collect::<Vec<_>>(), [(1, TriangleId(0))]);
    }

    #[test]
    fn adjacency_of_three_at_an_edge_is_non_manifold() {
        let adjacency = Adjacency::new(&mesh(5, &[[0, 1, 2], [1, 0, 3], [1, 0, 4]]));
        assert_eq!(adjacency.across(TriangleId(0), 0), EdgeKind::NonManifold);
        assert_eq!(adjacency.non_manifold_edges(), 1);
    }

    #[test]
    fn adjacency_of_opposite_windings_is_non_manifold() {
        let adjacency = Adjacency::new(&mesh(4, &[[0, 1, 2], [0, 1, 3]]));
        assert_eq!(adjacency.across(TriangleId(0), 0), EdgeKind::NonManifold);
    }

    #[test]
    fn adjacency_of_a_collapsed_triangle_has_no_edge_to_itself() {
        let adjacency = Adjacency::new(&mesh(3, &[[0, 0, 1], [0, 1, 2]]));
        assert_eq!(adjacency.across(TriangleId(0), 0), EdgeKind::Boundary);
    }

    #[test]
    fn fans_list_each_triangle_once() {
        let fans = Fans::new(&mesh(4, &[[0, 1, 2], [3, 2, 1], [1, 1, 2]]));
        assert_eq!(fans.around(VertexId(1)), [TriangleId(0), TriangleId(1), TriangleId(2)]);
        assert_eq!(fans.around(VertexId(0)), [TriangleId(0)]);
    }

    #[test]
    fn sheets_are_numbered_by_first_triangle() {
        let (sheet_of, count) = sheets(&mesh(9, &[[6, 7, 8], [0, 1, 2], [8, 3, 4], [2, 5, 0]]));
        assert_eq!((sheet_of, count), (vec![0, 1, 0, 1], 2));
        assert_eq!(sheets(&Mesh::default()), (vec![], 0));
    }
}
