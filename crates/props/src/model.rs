//! What a scene is made of before it becomes a file.

use glam::{DVec3, Quat, Vec3};

/// Triangles with positions and normals, counter-clockwise from the front.
#[derive(Clone, Debug, Default)]
pub struct Surface {
    /// Positions in metres.
    pub positions: Vec<Vec3>,
    /// Unit normals, one per position.
    pub normals: Vec<Vec3>,
    /// Texture coordinates, one per position, or none at all.
    pub uvs: Vec<[f32; 2]>,
    /// Three positions each.
    pub triangles: Vec<[u32; 3]>,
    /// How many triangles it has; counted even where a [`crate::shapes::Detail`] only plans.
    pub count: usize,
}

impl Surface {
    /// Adds another surface behind this one.
    pub fn append(&mut self, other: Self) {
        let first = self.positions.len() as u32;
        self.positions.extend(other.positions);
        self.normals.extend(other.normals);
        self.uvs.extend(other.uvs);
        self.triangles.extend(other.triangles.iter().map(|t| t.map(|v| v + first)));
        self.count += other.count;
    }

    /// Both surfaces as one.
    #[must_use]
    pub fn and(mut self, other: Self) -> Self {
        self.append(other);
        self
    }

    /// The surface moved by `offset`.
    #[must_use]
    pub fn moved(mut self, offset: DVec3) -> Self {
        self.positions.iter_mut().for_each(|p| *p += offset.as_vec3());
        self
    }

    /// The surface turned about the origin.
    #[must_use]
    pub fn turned(mut self, rotation: Quat) -> Self {
        self.positions.iter_mut().for_each(|p| *p = rotation * *p);
        self.normals.iter_mut().for_each(|n| *n = (rotation * *n).normalize());
        self
    }

    /// The mirror image in the plane where coordinate `axis` is 0; it faces the right way.
    #[must_use]
    pub fn mirrored(mut self, axis: usize) -> Self {
        for v in self.positions.iter_mut().chain(&mut self.normals) {
            v[axis] = -v[axis];
        }
        self.triangles.iter_mut().for_each(|t| t.swap(1, 2));
        self
    }

    /// The surface seen from its other side.
    #[must_use]
    pub fn flipped(mut self) -> Self {
        self.normals.iter_mut().for_each(|n| *n = -*n);
        self.triangles.iter_mut().for_each(|t| t.swap(1, 2));
        self
    }

    /// The surface with y up and z to the front, from the frame in which cars and seats are drawn: x to the
    /// front, y to the left, z up.
    #[must_use]
    pub fn upright(mut self) -> Self {
        for v in self.positions.iter_mut().chain(&mut self.normals) {
            *v = Vec3::new(v.y, v.z, v.x);
        }
        self
    }
}

/// How a surface looks: a glTF material.
#[derive(Clone, Debug)]
pub struct Material {
    /// Its name.
    pub name: &'static str,
    /// Linear color and alpha.
    pub color: [f32; 4],
    /// 0 for paint and cloth, 1 for metals.
    pub metallic: f32,
    /// 0 for mirrors, 1 for chalk.
    pub roughness: f32,
    /// Light that it gives off, each channel `0..=1`.
    pub emissive: [f32; 3],
    /// What `emissive` is multiplied by: KHR_materials_emissive_strength, cd/m2.
    pub emissive_strength: f32,
    /// Share of light that goes straight through: KHR_materials_transmission.
    pub transmission: f32,
    /// What alpha means.
    pub alpha: Alpha,
    /// Whether its back is seen.
    pub double_sided: bool,
    /// The bytes of a PNG that multiplies the color.
    pub texture: Option<Vec<u8>>,
}

/// What a material's alpha means.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Alpha {
    /// Nothing.
    Opaque,
    /// Holes below the cutoff.
    Mask(f32),
    /// Glass.
    Blend,
}

impl Material {
    /// An opaque material.
    pub fn new(name: &'static str, color: [f32; 3], metallic: f32, roughness: f32) -> Self {
        let [r, g, b] = color;
        Self {
            name,
            color: [r, g, b, 1.0],
            metallic,
            roughness,
            emissive: [0.0; 3],
            emissive_strength: 1.0,
            transmission: 0.0,
            alpha: Alpha::Opaque,
            double_sided: false,
            texture: None,
        }
    }

    /// A rough dielectric: what light baking takes every material for.
    pub fn matte(name: &'static str, color: [f32; 3]) -> Self {
        Self::new(name, color, 0.0, 1.0)
    }

    /// The material giving off light.
    ///
    /// - `luminance`: cd/m2 in each channel
    #[must_use]
    pub fn glowing(mut self, luminance: [f32; 3]) -> Self {
        let strength = luminance.into_iter().fold(0.0, f32::max);
        self.emissive = luminance.map(|l| l / strength);
        self.emissive_strength = strength;
        self
    }
}

/// A light without extent (KHR_lights_punctual). It shines along -z of its node.
#[derive(Clone, Debug)]
pub struct Light {
    /// Its name.
    pub name: &'static str,
    /// Linear color.
    pub color: [f32; 3],
    /// Lux of a sun, candela of the others.
    pub intensity: f32,
    /// What it is.
    pub kind: LightKind,
}

/// The kinds of [`Light`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum LightKind {
    /// From infinitely far.
    Sun,
    /// In all directions.
    Point,
    /// In a cone.
    Spot {
        /// Half the angle within which it is at its brightest, radians.
        inner: f32,
        /// Half the angle beyond which it is dark.
        outer: f32,
    },
}

/// A light of an [`Assembly`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct LightId(pub usize);

/// A material of an [`Assembly`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct MaterialId(pub usize);

/// A mesh of an [`Assembly`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct MeshId(pub usize);

/// A node of an [`Assembly`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct NodeId(pub usize);

/// A glTF mesh: surfaces with their materials.
#[derive(Clone, Debug)]
pub struct Mesh {
    /// Its name.
    pub name: String,
    /// One primitive each.
    pub primitives: Vec<(Surface, MaterialId)>,
}

/// Where a node stands in its parent: scaled, then turned, then moved.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Place {
    /// Moved by.
    pub translation: Vec3,
    /// Turned by.
    pub rotation: Quat,
    /// Scaled by; negative mirrors.
    pub scale: Vec3,
}

impl Default for Place {
    fn default() -> Self {
        Self { translation: Vec3::ZERO, rotation: Quat::IDENTITY, scale: Vec3::ONE }
    }
}

impl Place {
    /// Moved only.
    pub fn at(x: f32, y: f32, z: f32) -> Self {
        Self { translation: Vec3::new(x, y, z), ..Self::default() }
    }

    /// At `from`, with -z towards `to`: how lights are aimed.
    pub fn aimed(from: Vec3, to: Vec3) -> Self {
        let rotation = Quat::from_rotation_arc(Vec3::NEG_Z, (to - from).normalize());
        Self { translation: from, rotation, ..Self::default() }
    }
}

/// A glTF node.
#[derive(Clone, Debug)]
pub struct Node {
    /// Its name.
    pub name: String,
    /// What it draws.
    pub mesh: Option<MeshId>,
    /// What it shines with.
    pub light: Option<LightId>,
    /// The node that it hangs on.
    pub parent: Option<NodeId>,
    /// Where it stands.
    pub place: Place,
}

/// A whole scene.
#[derive(Clone, Debug, Default)]
pub struct Assembly {
    /// Materials.
    pub materials: Vec<Material>,
    /// Meshes.
    pub meshes: Vec<Mesh>,
    /// Lights.
    pub lights: Vec<Light>,
    /// Nodes; a parent stands before its children.
    pub nodes: Vec<Node>,
}

impl Assembly {
    /// Adds a material.
    pub fn material(&mut self, material: Material) -> MaterialId {
        self.materials.push(material);
        MaterialId(self.materials.len() - 1)
    }

    /// Adds a mesh of one surface.
    pub fn mesh(&mut self, name: impl Into<String>, surface: Surface, material: MaterialId) -> MeshId {
        self.meshes.push(Mesh { name: name.into(), primitives: vec![(surface, material)] });
        MeshId(self.meshes.len() - 1)
    }

    /// Adds a node.
    pub fn node(
        &mut self,
        name: impl Into<String>,
        mesh: Option<MeshId>,
        parent: Option<NodeId>,
        place: Place,
    ) -> NodeId {
        self.nodes.push(Node { name: name.into(), mesh, light: None, parent, place });
        NodeId(self.nodes.len() - 1)
    }

    /// Adds a mesh of one surface and a node of the same name that draws it where it is.
    pub fn part(
        &mut self,
        name: impl Into<String>,
        surface: Surface,
        material: MaterialId,
        parent: Option<NodeId>,
    ) -> NodeId {
        let name = name.into();
        let mesh = self.mesh(name.clone(), surface, material);
        self.node(name, Some(mesh), parent, Place::default())
    }

    /// Adds a light and a node of the same name.
    pub fn light(&mut self, light: Light, place: Place) -> NodeId {
        let node = self.node(light.name, None, None, place);
        self.nodes[node.0].light = Some(LightId(self.lights.len()));
        self.lights.push(light);
        node
    }

    /// Triangles drawn by all nodes.
    pub fn triangle_count(&self) -> usize {
        let of = |m: MeshId| self.meshes[m.0].primitives.iter().map(|(s, _)| s.count).sum::<usize>();
        self.nodes.iter().filter_map(|n| n.mesh).map(of).sum()
    }
}
