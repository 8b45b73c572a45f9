//! From the scene's parts to one light mesh, and back from its triangles to the file's.

use std::sync::OnceLock;

use lightkiln_light::{AmbientOcclusion, SurfaceFlags, Surfaces, Tracer};
use lightkiln_mesh::{Adjacency, Fans, Mesh, Source, SurfacePoint, TriangleId, VertexId, random, weld};
use lightkiln_scene::Scene;
use rayon::prelude::*;

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
    /// Per sheet: its back is the side that is seen.
    turned: OnceLock<TurnedSheets>,
}

struct TurnedSheets {
    sheet_of: Vec<u32>,
    turned: Vec<bool>,
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
                SurfaceFlags {
                    translucent: flags.translucent,
                    double_sided: flags.double_sided,
                    turned: false,
                }
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
        Ok(Self { scene, mesh, adjacency, fans, part_starts, flags, turned: OnceLock::new() })
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

/// Points at which a sheet is looked at from both sides, at most and at least.
const SIDE_POINTS: [usize; 2] = [4, 64];

/// A double-sided sheet is seen from its back when its front is darker than this, and its back brighter by
/// more than the second number.
const DARK_FRONT: f32 = 0.03;
const BRIGHTER_BACK: f32 = 0.05;

impl Surface<'_> {
    /// Finds the double-sided sheets whose front faces the inside of something (tyres and caps are often
    /// exported so), and from then on asks for the light on their backs. To be called once.
    ///
    /// - `distance`: what is farther away does not darken, in units of the mesh; may be infinite
    ///
    /// The decision depends on the geometry and the distance only, not on the seed of a bake, so that a later look
    /// at the same file comes to the same one.
    pub fn turn_hidden_sheets(&self, tracer: &Tracer<'_>, distance: f32) {
        let occlusion = &AmbientOcclusion::new(tracer, &self.mesh, distance, 0);
        let (sheet_of, count) = lightkiln_mesh::sheets(&self.mesh);
        let mut triangles: Vec<Vec<TriangleId>> = vec![Vec::new(); count];
        let mut open_to_question = vec![true; count];
        for t in self.mesh.triangle_ids() {
            let sheet = sheet_of[t.index()] as usize;
            open_to_question[sheet] &= self.flags[t.index()].double_sided;
            triangles[sheet].push(t);
        }
        let turned = triangles
            .par_iter()
            .zip(&open_to_question)
            .map(|(triangles, &open)| open && self.is_seen_from_behind(triangles, occlusion))
            .collect();
        // A second call finds the same and changes nothing.
        let _ = self.turned.set(TurnedSheets { sheet_of, turned });
    }

    fn is_seen_from_behind(&self, triangles: &[TriangleId], occlusion: &AmbientOcclusion<'_>) -> bool {
        let count = triangles.len().clamp(SIDE_POINTS[0], SIDE_POINTS[1]);
        let total: f64 = triangles.iter().map(|&t| self.mesh.area(t)).sum();
        let (mut front, mut back, mut before, mut next) = (0.0, 0.0, 0.0, 0);
        for &triangle in triangles {
            before += self.mesh.area(triangle);
            // Equally spaced by area, as many as fall into this triangle.
            while next < count && (next as f64 + 0.5) / count as f64 * total <= before {
                let key = random::hash(0, u64::from(triangle.0), next as u64, 0);
                let barycentric = random::square_to_triangle(random::unit2(key));
                let point = SurfacePoint { triangle, barycentric };
                for (side, sum) in [(false, &mut front), (true, &mut back)] {
                    let mut out = [0.0];
                    occlusion.batch_on_side(point, key, 1, side, &mut out);
                    *sum += out[0] / count as f32;
                }
                next += 1;
            }
        }
        front < DARK_FRONT && back > front + BRIGHTER_BACK
    }
}

impl Surfaces for Surface<'_> {
    fn flags(&self, triangle: TriangleId) -> SurfaceFlags {
        let turned = self.turned.get().is_some_and(|t| t.turned[t.sheet_of[triangle.index()] as usize]);
        SurfaceFlags { turned, ..self.flags[triangle.index()] }
    }

    fn opacity(&self, triangle: TriangleId, barycentric: [f32; 2]) -> f32 {
        let (part, local) = self.part_of(triangle);
        self.scene.triangle_opacity(part, local, barycentric)
    }
}
