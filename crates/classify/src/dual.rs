//! The dual graph of a set of triangles: a node per triangle, an edge where two share one.

use lightkiln_mesh::{Adjacency, TriangleId};
use petgraph::Directed;
use petgraph::csr::Csr;

/// The dual graph of a set of triangles, over interior edges: borders, creases and non-manifold edges connect
/// nothing, and a triangle is no neighbour of itself.
///
/// Compressed rows, 4 bytes a node and 5 a half-edge, built only over the triangles asked for: the texture
/// triangles of a large mesh are few. Building takes 4 bytes per triangle of the whole mesh more.
#[derive(Clone, Debug)]
pub struct Dual {
    /// The triangle of each node, ascending.
    pub triangles: Vec<TriangleId>,
    /// Both directions of each pair; the weight is how many edges the two share.
    pub graph: Csr<(), u8, Directed, u32>,
}

impl Dual {
    /// The dual graph of the triangles that are marked.
    ///
    /// `marked` has an entry for each triangle of the mesh.
    pub fn new(adjacency: &Adjacency, marked: &[bool]) -> Self {
        const NONE: u32 = u32::MAX;
        let mut triangles = Vec::new();
        let mut node_of = vec![NONE; marked.len()];
        for (t, _) in marked.iter().enumerate().filter(|&(_, &m)| m) {
            node_of[t] = triangles.len() as u32;
            triangles.push(TriangleId(t as u32));
        }
        let mut edges: Vec<(u32, u32, u8)> = Vec::with_capacity(triangles.len() * 3);
        for (node, &triangle) in triangles.iter().enumerate() {
            let node = node as u32;
            let row = edges.len();
            for (_, other) in adjacency.neighbors(triangle) {
                let other = node_of[other.index()];
                if other == NONE || other == node {
                    continue;
                }
                match edges[row..].iter_mut().find(|e| e.1 == other) {
                    Some(twice) => twice.2 += 1,
                    None => edges.push((node, other, 1)),
                }
            }
            edges[row..].sort_unstable();
        }
        let mut graph = Csr::from_sorted_edges(&edges).expect("rows ascend, and columns within them");
        while graph.node_count() < triangles.len() {
            graph.add_node(()); // triangles at the end without neighbours
        }
        Self { triangles, graph }
    }

    /// How many edges the triangle of a node shares with triangles of the set.
    pub fn shared_edges(&self, node: u32) -> usize {
        self.graph.edges(node).map(|e| usize::from(*e.weight())).sum()
    }
}
