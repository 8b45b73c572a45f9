//! From the scene's parts to one light mesh, and back from its triangles to the file's.

use lightkiln_light::{SurfaceFlags, Surfaces};
use lightkiln_mesh::{Adjacency, Fans, Mesh, Source, SurfacePoint, TriangleId, VertexId, weld};
use lightkiln_scene::Scene;

use crate::BakeError;

/// Normals whose angle is below about one degree are one: exporters and quantization round them differently.
const SAME_NORMAL_COSINE: f32 = 0.999_85;

/// The light mesh of a scene with its connections, and which part each triangle comes from.
pub struct Surface<'a> {
    /// The file.
    pub scene: &'a Scene,
    /// The light mesh: all parts' triangles, part after part.
    pub mesh: Mesh,
    /// Which triangle lies across which edge.
    pub adjacency: Adjacency,
    /// Which triangles surround a light vertex.
    pub fans: Fans,
    /// First triangle of each part, and the end.
    part_starts: Vec<u32>,
    flags: Vec<SurfaceFlags>,
}

impl<'a> Surface<'a> {
    /// Welds a scene into its light mesh.
    ///
    /// # Errors
    /// [`BakeError::NothingToBake`] when no triangle has an area, [`BakeError::Mesh`] for a scene beyond 32 bits.
    pub fn new(scene: &'a Scene, file: &str) -> Result<Self, BakeError> {
        let vertices: usize = scene.parts.iter().map(|p| p.positions.len()).sum();
        let mut positions = Vec::with_capacity(vertices);
        let mut normals = Vec::with_capacity(vertices);
        let mut groups = Vec::with_capacity(vertices);
        let mut triangles = Vec::with_capacity(scene.parts.iter().map(|p| p.triangles.len()).sum());
        let mut part_starts = vec![0];
        let mut flags = Vec::with_capacity(triangles.capacity());
        let mut group = 0;
        for (number, part) in scene.parts.iter().enumerate() {
            // A group is a node, or one instance of it: parts of one node follow each other.
            if number > 0 {
                let before = &scene.parts[number - 1];
                group += u32::from((before.node, before.instance) != (part.node, part.instance));
            }
            let offset = positions.len() as u32;
            positions.extend_from_slice(&part.positions);
            normals.extend_from_slice(&part.normals);
            groups.resize(positions.len(), group);
            triangles.extend(part.triangles.iter().map(|corners| corners.map(|v| v + offset)));
            part_starts.push(triangles.len() as u32);
            flags.extend((0..part.triangles.len()).map(|t| {
                let flags = scene.triangle_flags(number, t);
                SurfaceFlags { translucent: flags.translucent, double_sided: flags.double_sided }
            }));
        }
        let mesh = weld(Source {
            positions: &positions,
            normals: &normals,
            groups: &groups,
            triangles: &triangles,
            normal_cosine: SAME_NORMAL_COSINE,
        })?
        .mesh;
        if !mesh.triangle_ids().any(|t| mesh.area(t) > 0.0) {
            return Err(BakeError::NothingToBake { file: file.to_owned() });
        }
        let (adjacency, fans) = (Adjacency::new(&mesh), Fans::new(&mesh));
        Ok(Self { scene, mesh, adjacency, fans, part_starts, flags })
    }

    /// The part of the scene that a triangle belongs to, and its number there.
    pub fn part_of(&self, triangle: TriangleId) -> (usize, usize) {
        let part = self.part_starts.partition_point(|&start| start <= triangle.0) - 1;
        (part, (triangle.0 - self.part_starts[part]) as usize)
    }

    /// A light vertex as a point of the surface, in the largest triangle around it; of any triangle where it has
    /// none.
    pub fn point_at(&self, vertex: VertexId) -> SurfacePoint {
        let largest = |&a: &TriangleId, &b: &TriangleId| self.mesh.area(a).total_cmp(&self.mesh.area(b));
        let triangle = self.fans.around(vertex).iter().copied().max_by(largest).unwrap_or(TriangleId(0));
        let corner = self.mesh.triangles[triangle.index()].iter().position(|&v| v == vertex);
        let barycentric = match corner {
            Some(1) => [1.0, 0.0],
            Some(2) => [0.0, 1.0],
            _ => [0.0, 0.0],
        };
        SurfacePoint { triangle, barycentric }
    }

    /// The triangles of a part.
    pub fn triangles_of_part(&self, part: usize) -> impl ExactSizeIterator<Item = TriangleId> + use<> {
        (self.part_starts[part]..self.part_starts[part + 1]).map(TriangleId)
    }
}

impl Surfaces for Surface<'_> {
    fn flags(&self, triangle: TriangleId) -> SurfaceFlags {
        self.flags[triangle.index()]
    }

    fn opacity(&self, triangle: TriangleId, barycentric: [f32; 2]) -> f32 {
        let (part, local) = self.part_of(triangle);
        self.scene.triangle_opacity(part, local, barycentric)
    }
}
