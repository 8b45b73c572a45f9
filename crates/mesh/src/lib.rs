//! Indexed triangles of a whole scene, in world space, and what every stage asks of them: ids, areas,
//! adjacency, components, welding and keyed random numbers. No I/O.
//!
//! The *light mesh* is one [`Mesh`] for the scene: every node's triangles one after the other, each with
//! light vertices of its own, because two nodes may share a mesh but never its light (DESIGN.md).
//!
//! | module | what |
//! |---|---|
//! | [`mesh`] | positions, normals, triangles; areas, normals, points on the surface |
//! | [`weld`] | glTF vertices that share position and normal become one light vertex |
//! | [`adjacency`] | which triangle lies across which edge; fans of a vertex; sheets |
//! | [`random`] | random numbers keyed by what they are for, never by a thread |

pub mod adjacency;
pub mod mesh;
pub mod random;
pub mod weld;

pub use adjacency::{Adjacency, EdgeKind, Fans, sheets};
pub use mesh::{Mesh, MeshError, SurfacePoint, TriangleId, VertexId};
pub use weld::{Source, Welded, weld};
