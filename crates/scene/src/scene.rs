//! What the rest of the program sees of a file: parts in world space, materials, warnings.

use std::collections::BTreeMap;
use std::path::Path;
use std::rc::Rc;

use glam::{DVec3, Vec3};
use serde_json::Value;

use crate::document::{Document, MESHOPT, index, list};
use crate::draco::{self, DRACO};
use crate::error::{Place, SceneError, Warning, Warnings};
use crate::geometry::{LocalPool, Source, read_pools};
use crate::instances::INSTANCING;
use crate::lightmap;
use crate::lights::{PunctualLight, read_lights};
use crate::lookup::{Attributes, Lookup};
use crate::material::{Material, read_materials};
use crate::nodes::{Nodes, place_of};
use crate::pose::{Posed, placements, pose, read_skin};
use crate::roles::{Roles, node_roles, read_roles};
use crate::undo::undo;
use crate::variants;

/// How to read.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ReadOptions {
    /// The scene of the file to read; `None` takes the file's default, or its first.
    pub scene: Option<usize>,
    /// More triangles than this, all instances counted, are refused before they are allocated.
    pub max_triangles: usize,
    /// Whether textures and vertex colors are read for [`Scene::triangle_albedo`], [`Scene::triangle_emission`] and
    /// [`Scene::triangle_transmission`], which takes time and memory; without, these know factors alone.
    /// Lights that make no sense are errors with it, and are left out without.
    pub surfaces: bool,
    /// Whether textures of metalness, roughness and occlusion are read for [`Scene::triangle_finish`], which wants
    /// `surfaces` as well; without, it knows factors alone.
    pub finish: bool,
    /// What KHR_materials_transmission does.
    pub glass: Glass,
    /// The variant (KHR_materials_variants) whose materials are shown, by its name; `None` takes the primitives' own.
    pub variant: Option<String>,
}

impl Default for ReadOptions {
    fn default() -> Self {
        Self {
            scene: None,
            max_triangles: 1 << 28,
            surfaces: false,
            finish: false,
            glass: Glass::Tinted,
            variant: None,
        }
    }
}

/// What light does at surfaces with KHR_materials_transmission.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Glass {
    /// It passes straight through, tinted by the base color: the windows of a car cast no black shadows.
    #[default]
    Tinted,
    /// It is stopped: transmission is taken as 0, for ambient occlusion as well. Holes stay holes.
    Opaque,
}

/// A read scene. It keeps the file, so that [`crate::write`] can put light into it and leave the rest alone.
#[derive(Debug)]
pub struct Scene {
    /// Pools of vertices, in the order in which the node graph visits them.
    pub parts: Vec<Part>,
    /// The materials of the file, in its order.
    pub materials: Vec<Material>,
    /// The punctual lights of the nodes that are drawn, in the order in which the node graph visits them.
    pub lights: Vec<PunctualLight>,
    /// What was read otherwise than the file says, counted.
    pub warnings: Vec<Warning>,
    pub(crate) document: Document,
    /// The JSON before a former bake was undone.
    pub(crate) baked: Option<Value>,
    pub(crate) sources: Vec<PartSource>,
}

/// One pool of glTF vertices drawn by one node (or one GPU instance): the primitives of a mesh that share all
/// their attribute accessors.
#[derive(Clone, Debug)]
pub struct Part {
    /// The node.
    pub node: usize,
    /// Its mesh.
    pub mesh: usize,
    /// The GPU instance, with EXT_mesh_gpu_instancing.
    pub instance: Option<u32>,
    /// Primitive numbers within the mesh, triangles only, ascending.
    pub primitives: Vec<usize>,
    /// World space, one per vertex of the pool.
    pub positions: Vec<Vec3>,
    /// World space, one per vertex: of unit length, or zero at vertices without any area around them. Where the
    /// file gives none, the pool has one vertex per corner and flat normals.
    pub normals: Vec<Vec3>,
    /// Vertices of the pool, counter-clockwise from the front in world space.
    pub triangles: Vec<[u32; 3]>,
    /// Index into `primitives`, one per triangle, ascending.
    pub triangle_primitives: Vec<u32>,
    /// One per entry of `primitives`: index into [`Scene::materials`].
    pub primitive_materials: Vec<Option<usize>>,
}

impl Part {
    /// The area of all its triangles, in squared units of the file.
    pub fn area(&self) -> f64 {
        self.triangles.iter().map(|&corners| 0.5 * area_vector(&self.positions, corners).length()).sum()
    }
}

/// What lies behind a part in the file.
#[derive(Clone, Debug)]
pub(crate) struct PartSource {
    /// glTF vertices per triangle, in the part's winding; `None` when they are `Part::triangles` themselves.
    pub corners: Option<Vec<[u32; 3]>>,
    /// glTF vertices of the pool.
    pub vertices: usize,
    /// Whether the part's winding is that of the file turned round.
    pub mirrored: bool,
    /// Per primitive.
    pub lookups: Vec<Lookup>,
    /// Per primitive.
    pub roles: Vec<Roles>,
    /// Whether an animation moves it.
    pub moves: bool,
}

/// What a ray needs to know of a triangle before it looks closer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TriangleFlags {
    /// Whether [`Scene::triangle_opacity`] may be below 1 somewhere.
    pub translucent: bool,
    /// Whether the back is drawn too.
    pub double_sided: bool,
}

impl Scene {
    /// Reads a `.gltf` or `.glb` file with all that belongs to it.
    ///
    /// # Errors
    /// [`SceneError`]: what is wrong, with [`SceneError::place`] and [`SceneError::remedy`].
    pub fn read(path: &Path, options: &ReadOptions) -> Result<Self, SceneError> {
        let read = || {
            let bytes = std::fs::read(path).map_err(|source| SceneError::Io {
                action: "read",
                path: path.to_owned(),
                source,
                place: Box::default(),
            })?;
            Self::from_document(Document::parse(bytes, Some(path))?, options)
        };
        read().map_err(|e| e.at(|p| p.file = Some(path.to_owned())))
    }

    /// Reads a file that lies in memory; nothing outside of it is opened.
    ///
    /// # Errors
    /// As [`Scene::read`]; [`SceneError::NoData`] for buffers that are files.
    pub fn read_bytes(bytes: &[u8], options: &ReadOptions) -> Result<Self, SceneError> {
        Self::from_document(Document::parse(bytes.to_vec(), None)?, options)
    }

    fn from_document(mut document: Document, options: &ReadOptions) -> Result<Self, SceneError> {
        let mut warnings = Warnings::default();
        check_required(&document.root)?;
        let before = lightmap::is_baked(&document.root).then(|| document.root.clone());
        if undo(&mut document.root) {
            warnings.add("the light of an earlier bake is replaced", 1, Place::default());
        }
        let variant = variants::find(&document, options.variant.as_deref())?;
        let nodes = Nodes::read(&document, options.scene, &mut warnings)?;
        let meshes = document.list("meshes").len();
        let mut drawn = Vec::new();
        let mut uses = vec![0_usize; meshes];
        for &node in &nodes.visited {
            let json = &document.list("nodes")[node];
            if let Some(mesh) =
                index(json, "mesh", meshes).map_err(|e| e.at(|p| *p = place_of(&document, node)))?
            {
                uses[mesh] += 1;
                drawn.push((node, mesh));
            }
        }
        let used: Vec<bool> = uses.iter().map(|&n| n > 0).collect();
        draco::decode_all(&mut document, &used)?;
        let shown = variants::used_materials(&document, &used, variant);
        let materials = read_materials(&document, &shown, options, &mut warnings)?;
        let lights = read_lights(&document, &nodes, options.surfaces, &mut warnings)?;
        let node_roles = node_roles(&document, &nodes.visited, &nodes.parent, &mut warnings)?;
        let mesh_roles = read_roles(&document, "meshes", &mut warnings)?;
        let material_roles = read_roles(&document, "materials", &mut warnings)?;
        let mut reader = Reader {
            document: &document,
            source: Source { document: &document, materials: &materials, variant, options },
            nodes: &nodes,
            roles: [node_roles, mesh_roles, material_roles],
            uses,
            pools: BTreeMap::new(),
            attributes: Attributes::default(),
            triangles: 0,
            parts: Vec::new(),
            sources: Vec::new(),
            warnings,
        };
        for (node, mesh) in drawn {
            reader.node(node, mesh).map_err(|e| {
                e.at(|p| {
                    let named = place_of(&document, node);
                    (p.node, p.node_name) = (named.node, named.node_name);
                })
            })?;
        }
        let Reader { parts, sources, warnings, .. } = reader;
        Ok(Self { parts, materials, lights, warnings: warnings.0, document, baked: before, sources })
    }

    /// Whether a triangle may let light through, and whether its back is drawn.
    pub fn triangle_flags(&self, part: usize, triangle: usize) -> TriangleFlags {
        let part = &self.parts[part];
        let material = part.primitive_materials[part.triangle_primitives[triangle] as usize];
        material.map(|m| &self.materials[m]).map_or(
            TriangleFlags { translucent: false, double_sided: false },
            |m| TriangleFlags { translucent: m.is_translucent(), double_sided: m.double_sided },
        )
    }

    /// The glTF vertices of a part's triangle, in the part's winding. They differ from [`Part::triangles`] only
    /// where normals are missing.
    pub fn gltf_corners(&self, part: usize, triangle: usize) -> [u32; 3] {
        match &self.sources[part].corners {
            Some(corners) => corners[triangle],
            None => self.parts[part].triangles[triangle],
        }
    }

    /// How many glTF vertices a part's pool has.
    pub fn gltf_vertex_count(&self, part: usize) -> usize {
        self.sources[part].vertices
    }
}

/// Refuses files that cannot be understood without an extension that is not read.
fn check_required(root: &Value) -> Result<(), SceneError> {
    const KNOWN: [&str; 4] = [DRACO, INSTANCING, "KHR_mesh_quantization", lightmap::EXTENSION];
    // These say how surfaces look or are lit, or describe the file; none moves a triangle.
    const HARMLESS: [&str; 13] = [
        "KHR_materials_",
        "KHR_texture_",
        "KHR_lights_",
        "KHR_xmp",
        "KHR_animation_pointer",
        "KHR_node_visibility",
        "KHR_audio",
        "EXT_texture_",
        "EXT_lights_",
        "MSFT_texture_",
        "KHR_node_selectability",
        "KHR_node_hoverability",
        "KHR_interactivity",
    ];
    for name in list(root, "extensionsRequired").iter().filter_map(Value::as_str) {
        let known = KNOWN.contains(&name) || MESHOPT.contains(&name);
        if !known && !HARMLESS.iter().any(|h| name.starts_with(h)) {
            let what = format!("the required extension {name}");
            let remedy = "export without this extension, for example with gltf-transform or gltfpack";
            return Err(SceneError::Unsupported { what, remedy, place: Box::default() });
        }
    }
    Ok(())
}

/// The state of reading parts.
struct Reader<'a> {
    document: &'a Document,
    source: Source<'a>,
    nodes: &'a Nodes,
    /// Of nodes, meshes and materials.
    roles: [Vec<Roles>; 3],
    /// How often each mesh is still to be read.
    uses: Vec<usize>,
    pools: BTreeMap<usize, Rc<Vec<LocalPool>>>,
    attributes: Attributes,
    triangles: usize,
    parts: Vec<Part>,
    sources: Vec<PartSource>,
    warnings: Warnings,
}

impl Reader<'_> {
    fn node(&mut self, node: usize, mesh: usize) -> Result<(), SceneError> {
        let pools = match self.pools.remove(&mesh) {
            Some(pools) => pools,
            None => Rc::new(read_pools(&self.source, mesh, &mut self.attributes, &mut self.warnings)?),
        };
        self.uses[mesh] -= 1;
        if self.uses[mesh] > 0 {
            self.pools.insert(mesh, Rc::clone(&pools));
        }
        let json = &self.document.list("nodes")[node];
        let mesh_json = &self.document.list("meshes")[mesh];
        let skin = match index(json, "skin", self.document.list("skins").len())? {
            Some(skin) => {
                self.warnings.add("skins are baked at rest", 1, place_of(self.document, node));
                Some(read_skin(self.document, skin, self.nodes)?)
            }
            None => None,
        };
        let moves = skin.as_ref().map_or(self.nodes.moves[node], |s| s.moves);
        for (instance, world) in placements(self.document, json, self.nodes.world[node])? {
            for pool in pools.iter() {
                self.triangles += pool.corners.len();
                let limit = self.source.options.max_triangles;
                if self.triangles > limit {
                    return Err(SceneError::TooLarge {
                        what: "triangles, instances counted",
                        count: self.triangles as u64,
                        limit: limit as u64,
                        place: Box::default(),
                    });
                }
                let posed =
                    pose(self.document, pool, json, mesh_json, world, skin.as_ref(), &mut self.warnings)
                        .map_err(|e| {
                            e.at(|p| {
                                let named =
                                    crate::geometry::primitive_place(self.document, mesh, pool.primitives[0]);
                                (p.mesh, p.mesh_name, p.primitive) =
                                    (named.mesh, named.mesh_name, named.primitive);
                            })
                        })?;
                self.part([node, mesh], instance, pool, posed, moves);
            }
        }
        Ok(())
    }

    fn part(
        &mut self,
        [node, mesh]: [usize; 2],
        instance: Option<u32>,
        pool: &LocalPool,
        posed: Posed,
        moves: bool,
    ) {
        let mirrored = posed.mirrored;
        let turn = |[a, b, c]: [u32; 3]| if mirrored { [a, c, b] } else { [a, b, c] };
        let corners: Vec<[u32; 3]> = pool.corners.iter().map(|&t| turn(t)).collect();
        let vertices = posed.positions.len();
        let mut part = Part {
            node,
            mesh,
            instance,
            primitives: pool.primitives.clone(),
            positions: posed.positions,
            normals: Vec::new(),
            triangles: Vec::new(),
            triangle_primitives: pool.triangle_primitives.clone(),
            primitive_materials: pool.materials.clone(),
        };
        let corners = match posed.normals {
            Some(normals) => {
                part.normals = normals;
                part.triangles = corners;
                let replaced = repair_normals(&mut part);
                if replaced > 0 {
                    let place = Place { mesh: Some(mesh), ..place_of(self.document, node) };
                    self.warnings.add("normals of no length are replaced by geometric ones", replaced, place);
                }
                None
            }
            None => {
                flatten(&mut part, &corners);
                Some(corners)
            }
        };
        let [node_roles, mesh_roles, material_roles] = &self.roles;
        let roles = |m: &Option<usize>| {
            node_roles[node].and(mesh_roles[mesh]).and(m.map_or(Roles::BOTH, |m| material_roles[m]))
        };
        let roles = pool.materials.iter().map(roles).collect();
        let lookups = pool.lookups.clone();
        self.sources.push(PartSource { corners, vertices, mirrored, lookups, roles, moves });
        self.parts.push(part);
    }
}

/// Twice the area vector of a triangle.
fn area_vector(positions: &[Vec3], corners: [u32; 3]) -> DVec3 {
    let [a, b, c] = corners.map(|v| positions[v as usize].as_dvec3());
    (b - a).cross(c - a)
}

/// Gives vertices whose normal is zero or not finite the area-weighted mean of their triangles'. Returns how
/// many there were.
fn repair_normals(part: &mut Part) -> usize {
    let broken = |n: &Vec3| !n.is_finite() || *n == Vec3::ZERO;
    let mut used = vec![false; part.normals.len()];
    part.triangles.iter().flatten().for_each(|&v| used[v as usize] = true);
    let count = part.normals.iter().zip(&used).filter(|(n, used)| broken(n) && **used).count();
    if part.normals.iter().any(broken) {
        let mut sums: BTreeMap<u32, DVec3> = BTreeMap::new();
        for &corners in &part.triangles {
            for v in corners.into_iter().filter(|&v| broken(&part.normals[v as usize])) {
                *sums.entry(v).or_default() += area_vector(&part.positions, corners);
            }
        }
        part.normals.iter_mut().filter(|n| broken(n)).for_each(|n| *n = Vec3::ZERO);
        for (v, sum) in sums {
            part.normals[v as usize] = sum.normalize_or_zero().as_vec3();
        }
    }
    count
}

/// Makes one vertex per corner, with the normal of its triangle.
fn flatten(part: &mut Part, corners: &[[u32; 3]]) {
    let shared = std::mem::take(&mut part.positions);
    part.positions.reserve_exact(corners.len() * 3);
    part.normals.reserve_exact(corners.len() * 3);
    part.triangles.reserve_exact(corners.len());
    for (t, &triangle) in corners.iter().enumerate() {
        let normal = area_vector(&shared, triangle).normalize_or_zero().as_vec3();
        part.positions.extend(triangle.map(|v| shared[v as usize]));
        part.normals.extend([normal; 3]);
        part.triangles.push([0, 1, 2].map(|k| (3 * t) as u32 + k));
    }
}
