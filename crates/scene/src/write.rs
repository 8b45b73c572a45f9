//! Light into the file: an attribute and an atlas for each layer, one extension and a fallback; all else as it
//! came.
//!
//! For each pool the distinct tuples (glTF vertex, code of each layer) are found (`split`). Where no vertex carries
//! two the accessors stay shared between primitives, meshes and instances and only the attributes of the layers and
//! the fallback are added; elsewhere the pool gets accessors of its own, whose first vertices are the original ones.
//! docs/FORMAT.md is the description for readers of the result.

use std::collections::BTreeMap;
use std::ffi::OsStr;
use std::path::{Path, PathBuf};

use serde_json::{Map, Value, json};

use crate::assemble::stem;
use crate::baked::{BakedLight, check_light};
use crate::document::{BufferSource, Document, array, extension, index, list, object, whole};
use crate::error::{SceneError, Warning, Warnings};
use crate::geometry::primitive_place;
use crate::instances::{self, INSTANCING};
use crate::lightmap::{EXTENSION, VERSION, attribute_name};
use crate::nodes::place_of;
use crate::output::Staged;
use crate::profile::Profile;
use crate::replace::remove_slots;
use crate::scene::Scene;
use crate::undo::remove_extension;
use crate::uri;

/// A file that was written.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct WrittenFile {
    /// Where.
    pub path: PathBuf,
    /// How long.
    pub bytes: u64,
}

/// The vertices of a part, before and after.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct PartWritten {
    /// glTF vertices of the pool as read.
    pub original_vertices: usize,
    /// Vertices added because they carry more than one code.
    pub added_vertices: usize,
    /// Bytes of one vertex in the file as read: the element sizes of all attributes and morph targets.
    pub original_stride: usize,
    /// The same as written, with the light attribute and the fallback.
    pub stride: usize,
}

/// What a layer takes in the file.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct LayerWritten {
    /// Bytes of its attributes.
    pub attribute_bytes: u64,
    /// Bytes of the images of its atlas.
    pub atlas_bytes: u64,
    /// Bytes of the image of its table.
    pub table_bytes: u64,
}

/// What a write did.
#[derive(Clone, Debug, Default)]
pub struct Written {
    /// All files, the scene last.
    pub files: Vec<WrittenFile>,
    /// One per part.
    pub parts: Vec<PartWritten>,
    /// One per layer.
    pub layers: Vec<LayerWritten>,
    /// Bytes of the attributes of all layers.
    pub light_bytes: u64,
    /// Bytes of the fallback `COLOR_0`.
    pub fallback_bytes: u64,
    /// Bytes of the atlas images of all layers.
    pub atlas_bytes: u64,
    /// Bytes of the tables of all layers.
    pub table_bytes: u64,
    /// Bytes of vertices and indices that were written anew because vertices were split or decompressed.
    pub geometry_bytes: u64,
    /// Bytes of the input's buffer that are no longer used and were dropped.
    pub dropped_bytes: u64,
    /// Bytes that are no longer used but had to stay.
    pub wasted_bytes: u64,
    /// Meshes that were copied because several nodes used them.
    pub cloned_meshes: usize,
    /// GPU instances that became nodes.
    pub expanded_instances: usize,
    /// Draco primitives that were written plain.
    pub plain_draco: usize,
    /// Pools that had meshopt-compressed views and were written plain.
    pub plain_meshopt: usize,
    /// The same in words.
    pub warnings: Vec<Warning>,
}

/// Writes a scene with its light to a `.glb` or `.gltf`.
///
/// A `.gltf` gets its bytes in `<stem>.bin` and its atlas in `<stem>.lightkiln.<page>.png` beside it; further layers
/// are `<stem>.lightkiln_<layer>.<page>.png`, tables have `table` in place of a page. Files
/// that the scene refers to are copied beside the output when the folder differs, unless they are there already.
/// Every file appears by rename, the scene last; after an error nothing is left behind that a scene refers to.
///
/// # Errors
/// [`SceneError`], for light that does not fit the scene and files that cannot be written.
pub fn write(scene: &Scene, light: &BakedLight, path: &Path) -> Result<Written, SceneError> {
    write_inner(scene, light, path).map_err(|e| {
        let file = scene.document.path.clone();
        e.at(|p| p.file = p.file.take().or(file))
    })
}

fn write_inner(scene: &Scene, light: &BakedLight, path: &Path) -> Result<Written, SceneError> {
    let extension = path.extension().and_then(OsStr::to_str).map(str::to_ascii_lowercase);
    let glb = match extension.as_deref() {
        Some("glb") => true,
        Some("gltf") => false,
        _ => return Err(SceneError::OutputName { path: path.to_owned(), place: Box::default() }),
    };
    check_light(scene, light)?;
    let mut patch = Patch::new(scene, light, glb)?;
    patch.meshes()?;
    for part in 0..scene.parts.len() {
        patch.part(part).map_err(|e| {
            let part = &scene.parts[part];
            e.at(|p| {
                let (accessor, attribute) = (p.accessor, p.attribute.take());
                *p = primitive_place(&scene.document, part.mesh, part.primitives[0]);
                (p.accessor, p.attribute) = (accessor, attribute);
            })
        })?;
    }
    patch.layers(path)?;
    patch.finish(path)
}

/// What appended bytes are for: each purpose gets one buffer view.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Purpose {
    Light { layer: usize, stride: usize },
    Fallback,
    Vertices { stride: usize },
    Indices { size: usize },
    Image { number: usize },
}

/// A document on its way to being written.
pub(crate) struct Patch<'a> {
    pub scene: &'a Scene,
    pub document: &'a Document,
    pub light: &'a BakedLight,
    pub glb: bool,
    /// The buffer that takes what is added.
    pub main: usize,
    pub root: Value,
    /// Images of the asset; those of the light stand behind them.
    pub kept_images: usize,
    /// The mesh that each part is written to.
    pub mesh_of: Vec<usize>,
    /// The instances of the node that was expanded last.
    pub instances: Option<(usize, Vec<instances::Instance>)>,
    /// View number and bytes per purpose.
    pub views: Vec<(Purpose, Vec<u8>)>,
    pub first_view: usize,
    /// Draco accessors that are plain by now.
    pub plain: BTreeMap<usize, ()>,
    pub staged: Staged,
    pub written: Written,
    pub warnings: Warnings,
}

impl<'a> Patch<'a> {
    fn new(scene: &'a Scene, light: &'a BakedLight, glb: bool) -> Result<Self, SceneError> {
        let document = &scene.document;
        let is_fallback = |b: &crate::document::Buffer| b.source == BufferSource::Fallback;
        let main = if glb {
            0
        } else {
            document.buffers.iter().position(|b| !is_fallback(b)).unwrap_or(document.buffers.len())
        };
        if document.buffers.get(main).is_some_and(is_fallback) {
            return Err(SceneError::Unsupported {
                what: "writing a .glb whose first buffer is a meshopt fallback".to_owned(),
                remedy: "write a .gltf",
                place: Box::default(),
            });
        }
        let mut root = document.root.clone();
        remove_slots(&mut root, &light.remove);
        let kept_images = list(&root, "images").len();
        let first_view = list(&root, "bufferViews").len();
        Ok(Self {
            scene,
            document,
            light,
            glb,
            main,
            root,
            kept_images,
            mesh_of: Vec::new(),
            instances: None,
            views: Vec::new(),
            first_view,
            plain: BTreeMap::new(),
            staged: Staged::default(),
            written: Written {
                layers: vec![LayerWritten::default(); light.layers.len()],
                ..Written::default()
            },
            warnings: Warnings::default(),
        })
    }

    /// Gives every node and GPU instance with light a mesh of its own.
    fn meshes(&mut self) -> Result<(), SceneError> {
        let parts = &self.scene.parts;
        let nodes = self.document.list("nodes");
        let meshes = self.document.list("meshes").len();
        let mut lit = vec![false; nodes.len()];
        let with_light = parts.iter().zip(&self.light.parts).filter(|(_, light)| light.is_lit());
        with_light.for_each(|(part, _)| lit[part.node] = true);
        // A mesh that an unlit node shows too must stay as it is.
        let mut taken = vec![false; meshes];
        for (node, json) in nodes.iter().enumerate().filter(|(n, _)| !lit[*n]) {
            if let Some(mesh) =
                index(json, "mesh", meshes).map_err(|e| e.at(|p| *p = place_of(self.document, node)))?
            {
                taken[mesh] = true;
            }
        }
        for (number, part) in parts.iter().enumerate() {
            if !lit[part.node] {
                self.mesh_of.push(part.mesh);
                continue;
            }
            let same = number
                .checked_sub(1)
                .filter(|&before| (parts[before].node, parts[before].instance) == (part.node, part.instance));
            if let Some(before) = same {
                self.mesh_of.push(self.mesh_of[before]);
                continue;
            }
            let mesh = if std::mem::replace(&mut taken[part.mesh], true) {
                let copy = self.document.list("meshes")[part.mesh].clone();
                let meshes = array(&mut self.root, "meshes");
                meshes.push(copy);
                self.written.cloned_meshes += 1;
                meshes.len() - 1
            } else {
                part.mesh
            };
            self.mesh_of.push(mesh);
            match part.instance {
                None => array(&mut self.root, "nodes")[part.node]["mesh"] = mesh.into(),
                Some(instance) => self.expand(part.node, instance, mesh)?,
            }
        }
        if self.written.expanded_instances > 0 {
            let uses = list(&self.root, "nodes").iter().any(|n| extension(n, INSTANCING).is_some());
            if !uses {
                self.forget_extension(INSTANCING);
            }
        }
        Ok(())
    }

    /// Makes a GPU instance a child of its node.
    fn expand(&mut self, node: usize, instance: u32, mesh: usize) -> Result<(), SceneError> {
        let original = &self.document.list("nodes")[node];
        if self.instances.as_ref().is_none_or(|(of, _)| *of != node) {
            let Some(json) = extension(original, INSTANCING) else { return Ok(()) };
            self.instances = Some((node, instances::read(self.document, json)?));
        }
        let Some(placed) = self.instances.as_ref().and_then(|(_, all)| all.get(instance as usize).copied())
        else {
            return Ok(());
        };
        let mut child = Map::new();
        child.insert("mesh".to_owned(), mesh.into());
        for key in ["skin", "weights"] {
            if let Some(v) = original.get(key) {
                child.insert(key.to_owned(), v.clone());
            }
        }
        let float = |v: &f32| Value::from(f64::from(*v));
        if let Some(t) = placed.translation {
            child.insert("translation".to_owned(), t.iter().map(float).collect());
        }
        if let Some(r) = placed.rotation {
            // Quantized rotations are only nearly of unit length; glTF asks nodes for unit ones.
            let r = r.map(f64::from);
            let length = r.iter().map(|c| c * c).sum::<f64>().sqrt();
            let unit = if length > 0.0 { r.map(|c| c / length) } else { [0.0, 0.0, 0.0, 1.0] };
            child.insert("rotation".to_owned(), unit.iter().map(|&c| Value::from(c)).collect());
        }
        if let Some(s) = placed.scale {
            child.insert("scale".to_owned(), s.iter().map(float).collect());
        }
        let nodes = array(&mut self.root, "nodes");
        nodes.push(Value::Object(child));
        let number = nodes.len() - 1;
        let parent = &mut nodes[node];
        for key in ["mesh", "skin", "weights"] {
            object(parent).shift_remove(key);
        }
        remove_extension(parent, INSTANCING);
        array(parent, "children").push(number.into());
        self.written.expanded_instances += 1;
        self.warnings.add(
            "GPU instances became nodes, so that each has its own light",
            1,
            place_of(self.document, node),
        );
        Ok(())
    }

    /// Removes an extension's name from the lists.
    pub fn forget_extension(&mut self, name: &str) {
        for key in ["extensionsUsed", "extensionsRequired"] {
            if self.root.get(key).is_none() {
                continue;
            }
            let names = array(&mut self.root, key);
            names.retain(|n| n.as_str() != Some(name));
            if names.is_empty() {
                object(&mut self.root).shift_remove(key);
            }
        }
    }

    /// Adds the images of all layers, lets materials show them in plain profiles, and adds the root object.
    fn layers(&mut self, path: &Path) -> Result<(), SceneError> {
        let light = self.light;
        let pages = light.layers.iter().any(|l| !l.pages.is_empty()).then(|| self.sampler(LINEAR));
        // The entries of a table must not be mixed.
        let tables = light.layers.iter().any(|l| l.table.is_some()).then(|| self.sampler(NEAREST));
        let mut layers = Vec::with_capacity(light.layers.len());
        let mut shown = Vec::new();
        for (number, layer) in light.layers.iter().enumerate() {
            let mut ours = layer.info.clone();
            let codes = match (light.profile.is_plain(), &layer.table) {
                (true, _) => "coordinates",
                (false, Some(_)) => "table",
                (false, None) => "packed",
            };
            if light.profile == Profile::Eta {
                ours.insert("attribute".to_owned(), attribute_name(number).into());
            }
            ours.insert("codes".to_owned(), codes.into());
            let mut textures = Vec::with_capacity(layer.pages.len());
            for (page, png) in layer.pages.iter().enumerate() {
                self.written.layers[number].atlas_bytes += png.len() as u64;
                textures.push(Value::from(self.texture(path, number, &page.to_string(), png, pages)?));
            }
            if let (Some(texture), Some(page)) = (layer.texture, textures.first().and_then(whole)) {
                shown.push((texture, page as usize));
            }
            ours.insert("pages".to_owned(), Value::Array(textures));
            ours.shift_remove("table");
            if let Some(png) = &layer.table {
                self.written.layers[number].table_bytes = png.len() as u64;
                ours.insert("table".to_owned(), self.texture(path, number, "table", png, tables)?.into());
            }
            layers.push(Value::Object(ours));
        }
        self.written.atlas_bytes = self.written.layers.iter().map(|l| l.atlas_bytes).sum();
        self.written.table_bytes = self.written.layers.iter().map(|l| l.table_bytes).sum();
        let mut ours = Map::new();
        ours.insert("version".to_owned(), VERSION.into());
        for (key, v) in light.extension.root.as_object().into_iter().flatten() {
            ours.entry(key).or_insert_with(|| v.clone());
        }
        ours.insert("layers".to_owned(), Value::Array(layers));
        if light.profile.is_plain() {
            ours.insert("materials".to_owned(), self.materials(&shown).into());
        }
        let extensions = object(object(&mut self.root).entry("extensions").or_insert(Value::Null));
        extensions.insert(EXTENSION.to_owned(), Value::Object(ours));
        self.use_extension(EXTENSION);
        Ok(())
    }

    /// Lists an extension as used.
    pub fn use_extension(&mut self, name: &str) {
        let used = array(&mut self.root, "extensionsUsed");
        if !used.iter().any(|e| e.as_str() == Some(name)) {
            used.push(name.into());
        }
    }

    /// Adds a sampler that clamps and has no mipmaps.
    fn sampler(&mut self, filter: u32) -> usize {
        let samplers = array(&mut self.root, "samplers");
        samplers.push(json!({"magFilter": filter, "minFilter": filter, "wrapS": 33071, "wrapT": 33071}));
        samplers.len() - 1
    }

    /// Adds an image of a layer with its texture; beside a `.gltf` it is a file. Returns the texture.
    fn texture(
        &mut self,
        path: &Path,
        layer: usize,
        name: &str,
        png: &[u8],
        sampler: Option<usize>,
    ) -> Result<usize, SceneError> {
        let image = if self.glb {
            let number = list(&self.root, "images").len();
            let (view, _) = self.append(Purpose::Image { number }, png);
            json!({"mimeType": "image/png", "bufferView": view})
        } else {
            let of_layer = if layer == 0 { String::new() } else { format!("_{layer}") };
            let name = format!("{}.lightkiln{of_layer}.{name}.png", stem(path));
            self.staged.write(&path.with_file_name(&name), png)?;
            json!({"mimeType": "image/png", "uri": uri::encode(&name)})
        };
        let images = array(&mut self.root, "images");
        images.push(image);
        let source = images.len() - 1;
        let textures = array(&mut self.root, "textures");
        textures.push(json!({"sampler": sampler, "source": source}));
        Ok(textures.len() - 1)
    }
}

/// Filters of glTF samplers.
const NEAREST: u32 = 9728;
const LINEAR: u32 = 9729;
