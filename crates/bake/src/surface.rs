//! From the scene's parts to one light mesh, and back from its triangles to the file's.

use std::sync::OnceLock;

use glam::Vec3;
use lightkiln_light::{Lighting, SurfaceFlags, Surfaces, Tracer};
use lightkiln_mesh::{Adjacency, Fans, Mesh, Source, SurfacePoint, TriangleId, VertexId, weld};
use lightkiln_scene::{Finish, Scene, TriangleFlags};
use rayon::prelude::*;

use crate::{BakeError, sides};

/// Normals whose angle is below about one degree are one: exporters and quantization round them differently.
const SAME_NORMAL_COSINE: f32 = 0.999_85;

/// The light mesh of a scene with its connections, and which part each triangle comes from; and what else there is
/// that light meets.
///
/// Triangles that get no light but stand in its way have numbers after those of the light mesh.
pub struct Surface<'a> {
    /// The file.
    pub scene: &'a Scene,
    /// The light mesh: the triangles of all parts that get light, part after part.
    pub mesh: Mesh,
    /// Which triangle lies across which edge.
    pub adjacency: Adjacency,
    /// Which triangles surround a light vertex.
    pub fans: Fans,
    /// First triangle of each part in the light mesh, and the end; parts that get no light have none.
    part_starts: Vec<u32>,
    /// Whether each part gets light.
    lit: Vec<bool>,
    /// The light mesh and everything else, if there is anything else.
    world: Option<Mesh>,
    /// The same with what stands in nobody's way shrunk to nothing, if there is such.
    casters: Option<Mesh>,
    /// What stands beside the light mesh, ascending by its first triangle.
    others: Vec<Other<'a>>,
    flags: Vec<SurfaceFlags>,
    /// Whether a triangle stands in the way of light; empty if all do.
    casts: Vec<bool>,
    /// Per triangle of the light mesh: its back is the side that is seen.
    turned: OnceLock<Vec<bool>>,
}

/// A part that gets no light.
struct Other<'a> {
    first: u32,
    scene: &'a Scene,
    part: usize,
}

/// Which parts of a scene get light and which stand in its way, and what else does.
#[derive(Default)]
pub struct Cast<'a> {
    /// Per part: it gets light. All do if empty.
    pub receives: Vec<bool>,
    /// Per part: it may stand in the way. All may if empty.
    pub casts: Vec<bool>,
    /// Scenes that stand in the way and get no light.
    pub occluders: Vec<&'a Scene>,
}

/// Vertices and triangles of several parts, on the way to one mesh.
#[derive(Default)]
struct Gathered {
    positions: Vec<Vec3>,
    normals: Vec<Vec3>,
    groups: Vec<u32>,
    triangles: Vec<[u32; 3]>,
    flags: Vec<SurfaceFlags>,
    casts: Vec<bool>,
}

impl Gathered {
    fn add(&mut self, scene: &Scene, number: usize, group: u32, casts: bool) {
        let part = &scene.parts[number];
        let offset = self.positions.len() as u32;
        self.positions.extend_from_slice(&part.positions);
        self.normals.extend_from_slice(&part.normals);
        self.groups.resize(self.positions.len(), group);
        self.triangles.extend(part.triangles.iter().map(|corners| corners.map(|v| v + offset)));
        for triangle in 0..part.triangles.len() {
            let TriangleFlags { translucent, double_sided } = scene.triangle_flags(number, triangle);
            self.flags.push(SurfaceFlags { translucent, double_sided, turned: false });
            self.casts.push(casts && scene.triangle_roles(number, triangle).casts);
        }
    }
}

impl<'a> Surface<'a> {
    /// Welds a scene into its light mesh; every part gets light, unless the file says otherwise.
    ///
    /// # Errors
    /// As [`Self::with`].
    pub fn new(scene: &'a Scene, file: &str) -> Result<Self, BakeError> {
        Self::with(scene, file, Cast::default())
    }

    /// Welds what gets light into the light mesh, and gathers what stands in its way.
    ///
    /// # Errors
    /// [`BakeError::NothingToBake`] when no triangle has an area, [`BakeError::AllLeftOut`] when none of those gets
    /// light, [`BakeError::Mesh`] for a scene beyond 32 bits.
    pub fn with(scene: &'a Scene, file: &str, cast: Cast<'a>) -> Result<Self, BakeError> {
        let chosen = |list: &[bool], part: usize| list.get(part).copied().unwrap_or(true);
        let receives = |part| chosen(&cast.receives, part) && scene.roles(part).receives;
        let mut gathered = Gathered::default();
        let mut part_starts = vec![0];
        let mut group = 0;
        for (number, part) in scene.parts.iter().enumerate() {
            // A group is a node, or one instance of it: parts of one node follow each other.
            if number > 0 {
                let before = &scene.parts[number - 1];
                group += u32::from((before.node, before.instance) != (part.node, part.instance));
            }
            if receives(number) {
                gathered.add(scene, number, group, chosen(&cast.casts, number));
            }
            part_starts.push(gathered.triangles.len() as u32);
        }
        let mesh = weld(Source {
            positions: &gathered.positions,
            normals: &gathered.normals,
            groups: &gathered.groups,
            triangles: &gathered.triangles,
            normal_cosine: SAME_NORMAL_COSINE,
        })?
        .mesh;
        if !mesh.triangle_ids().any(|t| mesh.area(t) > 0.0) {
            let file = file.to_owned();
            let has_area = scene.parts.iter().any(|part| part.area() > 0.0);
            return Err(if has_area {
                BakeError::AllLeftOut { file }
            } else {
                BakeError::NothingToBake { file }
            });
        }
        let mut others = Vec::new();
        let dark =
            (0..scene.parts.len()).filter(|&p| !receives(p)).map(|p| (scene, p, chosen(&cast.casts, p)));
        let extra = cast.occluders.iter().flat_map(|s| (0..s.parts.len()).map(move |p| (*s, p, true)));
        for (scene, part, casts) in dark.chain(extra) {
            others.push(Other { first: gathered.triangles.len() as u32, scene, part });
            gathered.add(scene, part, 0, casts);
        }
        let world = if others.is_empty() { None } else { Some(joined(&mesh, &gathered)?) };
        let (mut casters, mut casts) = (None, Vec::new());
        if gathered.casts.contains(&false) {
            casts = gathered.casts;
            casters = Some(without(world.as_ref().unwrap_or(&mesh), &casts)?);
        }
        let (adjacency, fans) = (Adjacency::new(&mesh), Fans::new(&mesh));
        let (flags, turned) = (gathered.flags, OnceLock::new());
        let lit = (0..scene.parts.len()).map(receives).collect();
        Ok(Self {
            scene,
            mesh,
            adjacency,
            fans,
            part_starts,
            lit,
            world,
            casters,
            others,
            flags,
            casts,
            turned,
        })
    }

    /// Everything that light meets, and more that it does not: triangles have the same numbers as in the light mesh.
    pub fn world(&self) -> &Mesh {
        self.world.as_ref().unwrap_or(&self.mesh)
    }

    /// What rays are traced against: the world, without what stands in nobody's way.
    pub fn casters(&self) -> &Mesh {
        self.casters.as_ref().unwrap_or_else(|| self.world())
    }

    /// The part of the scene that a triangle of the light mesh belongs to, and its number there.
    pub fn part_of(&self, triangle: TriangleId) -> (usize, usize) {
        let part = self.part_starts.partition_point(|&start| start <= triangle.0) - 1;
        (part, (triangle.0 - self.part_starts[part]) as usize)
    }

    /// Where any triangle of the world comes from.
    fn source_of(&self, triangle: TriangleId) -> (&Scene, usize, usize) {
        if triangle.index() < self.mesh.triangle_count() {
            let (part, local) = self.part_of(triangle);
            return (self.scene, part, local);
        }
        let other = &self.others[self.others.partition_point(|o| o.first <= triangle.0) - 1];
        (other.scene, other.part, (triangle.0 - other.first) as usize)
    }

    /// What any triangle of the world looks like at a point, see [`Scene::triangle_finish`].
    pub fn finish(&self, triangle: TriangleId, barycentric: [f32; 2]) -> Finish {
        let (scene, part, local) = self.source_of(triangle);
        scene.triangle_finish(part, local, barycentric)
    }

    /// Whether a part gets light.
    pub fn is_lit(&self, part: usize) -> bool {
        self.lit[part]
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

    /// The shading normal on the side that gets light.
    pub fn lit_normal(&self, point: SurfacePoint) -> Vec3 {
        let normal = self.mesh.shading_normal(point);
        if self.flags(point.triangle).turned { -normal } else { normal }
    }

    /// The same of many points.
    pub fn lit_normals(&self, points: &[SurfacePoint]) -> Vec<Vec3> {
        points.par_iter().map(|&p| self.lit_normal(p)).collect()
    }

    /// The triangles of a part.
    pub fn triangles_of_part(&self, part: usize) -> impl ExactSizeIterator<Item = TriangleId> + use<> {
        (self.part_starts[part]..self.part_starts[part + 1]).map(TriangleId)
    }
}

impl Surface<'_> {
    /// Finds the double-sided sheets whose front faces the inside of something, and from then on asks for the light on
    /// their backs: see `sides.rs`. To be called once.
    ///
    /// - `distance`: what is farther away does not darken, in units of the mesh; may be infinite
    pub fn turn_hidden_sheets(&self, tracer: &Tracer<'_>, distance: f32, lighting: &Lighting) {
        // A second call finds the same and changes nothing.
        let _ = self.turned.set(sides::turned(self, tracer, distance, lighting));
    }

    /// Whether two triangles of the world are of one node, or one instance of it.
    pub(crate) fn is_same_node(&self, a: TriangleId, b: TriangleId) -> bool {
        let node = |triangle| {
            let (scene, part, _) = self.source_of(triangle);
            (std::ptr::from_ref(scene), scene.parts[part].node, scene.parts[part].instance)
        };
        node(a) == node(b)
    }
}

impl Surfaces for Surface<'_> {
    fn flags(&self, triangle: TriangleId) -> SurfaceFlags {
        let turned = self.turned.get().and_then(|turned| turned.get(triangle.index()));
        let turned = turned.copied().unwrap_or(false);
        SurfaceFlags { turned, ..self.flags[triangle.index()] }
    }

    fn opacity(&self, triangle: TriangleId, barycentric: [f32; 2]) -> f32 {
        let (scene, part, local) = self.source_of(triangle);
        scene.triangle_opacity(part, local, barycentric)
    }

    fn albedo(&self, triangle: TriangleId, barycentric: [f32; 2]) -> Vec3 {
        let (scene, part, local) = self.source_of(triangle);
        scene.triangle_albedo(part, local, barycentric).into()
    }

    fn emission(&self, triangle: TriangleId, barycentric: [f32; 2]) -> Vec3 {
        // What no ray meets lights nothing.
        if self.casts.get(triangle.index()) == Some(&false) {
            return Vec3::ZERO;
        }
        let (scene, part, local) = self.source_of(triangle);
        scene.triangle_emission(part, local, barycentric).into()
    }

    fn transmission(&self, triangle: TriangleId, barycentric: [f32; 2]) -> Vec3 {
        let (scene, part, local) = self.source_of(triangle);
        scene.triangle_transmission(part, local, barycentric).into()
    }
}

/// The light mesh, and behind it all that was gathered after it.
fn joined(mesh: &Mesh, gathered: &Gathered) -> Result<Mesh, BakeError> {
    let (mut positions, mut normals) = (mesh.positions.clone(), mesh.normals.clone());
    let mut triangles = mesh.triangles.clone();
    // Light vertices stand for the gathered ones that they were welded from; the rest comes as it is.
    let rest = &gathered.triangles[triangles.len()..];
    let first = rest.iter().flatten().min().copied().unwrap_or_default();
    let offset = positions.len() as u32;
    positions.extend_from_slice(&gathered.positions[first as usize..]);
    normals.extend_from_slice(&gathered.normals[first as usize..]);
    triangles.extend(rest.iter().map(|corners| corners.map(|v| VertexId(v - first + offset))));
    Ok(Mesh::new(positions, normals, triangles)?)
}

/// A mesh whose triangles are shrunk to nothing where they stand in nobody's way.
fn without(mesh: &Mesh, casts: &[bool]) -> Result<Mesh, BakeError> {
    let mut triangles = mesh.triangles.clone();
    for (corners, _) in triangles.iter_mut().zip(casts).filter(|(_, casts)| !**casts) {
        *corners = [corners[0]; 3];
    }
    Ok(Mesh::new(mesh.positions.clone(), mesh.normals.clone(), triangles)?)
}
