//! Light into the file: one attribute, one extension, the atlas and a fallback; all else as it came.
//!
//! For each pool the distinct (glTF vertex, code) pairs are found (`split`). Where no vertex carries two codes
//! the accessors stay shared between primitives, meshes and instances and only `_LIGHTUV` and the fallback are
//! added; elsewhere the pool gets accessors of its own, whose first vertices are the original ones.
//! docs/FORMAT.md is the description for readers of the result.

use std::collections::BTreeMap;
use std::ffi::OsStr;
use std::path::{Path, PathBuf};

use serde_json::{Map, Value, json};

use crate::accessor::{Component, layout};
use crate::container;
use crate::document::{BufferSource, Document, MESHOPT, array, extension, index, list, object};
use crate::draco::DRACO;
use crate::error::{SceneError, Warning, Warnings};
use crate::garbage;
use crate::geometry::{attribute, primitive_place, triangle_mode};
use crate::instances::{self, INSTANCING};
use crate::lightmap::{ATTRIBUTE, COLOR, EXTENSION, ORIGINAL_COLOR, remove_extension};
use crate::nodes::place_of;
use crate::output::Staged;
use crate::scene::{PartLight, Scene, check_light};
use crate::split::{Split, split};
use crate::uri;

/// What viewers that do not know the extension show.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Fallback {
    /// The light multiplied into `COLOR_0`, 8 bits, linear.
    Color0,
    /// Nothing.
    None,
}

/// The pages of the atlas, as PNG files.
#[derive(Clone, Debug, Default)]
pub struct AtlasFiles {
    /// One PNG file each, in order.
    pub pages: Vec<Vec<u8>>,
}

/// The root object of the extension; `pages` is filled in by [`write`].
#[derive(Clone, Debug, Default)]
pub struct ExtensionInfo {
    /// A JSON object (docs/LIGHTKILN_lightmap.schema.json).
    pub root: Value,
}

/// The light of a scene.
#[derive(Clone, Debug)]
pub struct BakedLight {
    /// One per [`Scene::parts`], in that order.
    pub parts: Vec<PartLight>,
    /// The atlas, if there are texture triangles.
    pub atlas: Option<AtlasFiles>,
    /// The extension's root object.
    pub extension: ExtensionInfo,
    /// What other viewers show.
    pub fallback: Fallback,
}

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

/// What a write did.
#[derive(Clone, Debug, Default)]
pub struct Written {
    /// All files, the scene last.
    pub files: Vec<WrittenFile>,
    /// One per part.
    pub parts: Vec<PartWritten>,
    /// Bytes of the `_LIGHTUV` attributes.
    pub light_bytes: u64,
    /// Bytes of the fallback `COLOR_0`.
    pub fallback_bytes: u64,
    /// Bytes of the atlas images.
    pub atlas_bytes: u64,
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
/// A `.gltf` gets its bytes in `<stem>.bin` and its atlas in `<stem>.lightkiln.<page>.png` beside it. Files
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
    check_light(scene, &light.parts, light.fallback == Fallback::Color0)?;
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
    patch.atlas(path)?;
    patch.finish(path)
}

/// What appended bytes are for: each purpose gets one buffer view.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum Purpose {
    Light,
    Fallback,
    Vertices { stride: usize },
    Indices { size: usize },
    Page { number: usize },
}

struct Patch<'a> {
    scene: &'a Scene,
    document: &'a Document,
    light: &'a BakedLight,
    glb: bool,
    /// The buffer that takes what is added.
    main: usize,
    root: Value,
    /// The mesh that each part is written to.
    mesh_of: Vec<usize>,
    /// The instances of the node that was expanded last.
    instances: Option<(usize, Vec<instances::Instance>)>,
    /// View number and bytes per purpose.
    views: Vec<(Purpose, Vec<u8>)>,
    first_view: usize,
    /// Draco accessors that are plain by now.
    plain: BTreeMap<usize, ()>,
    staged: Staged,
    written: Written,
    warnings: Warnings,
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
        let root = document.root.clone();
        let first_view = list(&root, "bufferViews").len();
        Ok(Self {
            scene,
            document,
            light,
            glb,
            main,
            root,
            mesh_of: Vec::new(),
            instances: None,
            views: Vec::new(),
            first_view,
            plain: BTreeMap::new(),
            staged: Staged::default(),
            written: Written::default(),
            warnings: Warnings::default(),
        })
    }

    /// Gives every node and GPU instance with light a mesh of its own.
    fn meshes(&mut self) -> Result<(), SceneError> {
        let parts = &self.scene.parts;
        let nodes = self.document.list("nodes");
        let meshes = self.document.list("meshes").len();
        let mut lit = vec![false; nodes.len()];
        parts.iter().for_each(|p| lit[p.node] = true);
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
    fn forget_extension(&mut self, name: &str) {
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

    /// Appends bytes for a purpose; returns the view and the offset in it.
    fn append(&mut self, purpose: Purpose, bytes: &[u8]) -> (usize, usize) {
        let at = match self.views.iter().position(|(p, _)| *p == purpose) {
            Some(at) => at,
            None => {
                self.views.push((purpose, Vec::new()));
                self.views.len() - 1
            }
        };
        let data = &mut self.views[at].1;
        let offset = data.len();
        data.extend_from_slice(bytes);
        (self.first_view + at, offset)
    }

    fn new_accessor(&mut self, purpose: Purpose, bytes: &[u8], mut json: Value) -> usize {
        let (view, offset) = self.append(purpose, bytes);
        let map = object(&mut json);
        for key in ["bufferView", "byteOffset", "sparse"] {
            map.shift_remove(key);
        }
        let mut out = Map::new();
        out.insert("bufferView".to_owned(), view.into());
        if offset > 0 {
            out.insert("byteOffset".to_owned(), offset.into());
        }
        out.append(map);
        let accessors = array(&mut self.root, "accessors");
        accessors.push(Value::Object(out));
        accessors.len() - 1
    }

    /// Puts the light of a part onto its primitives.
    fn part(&mut self, number: usize) -> Result<(), SceneError> {
        let (part, source) = (&self.scene.parts[number], &self.scene.sources[number]);
        let light = &self.light.parts[number];
        let corners = (0..part.triangles.len()).map(|t| self.scene.gltf_corners(number, t));
        let split = split(source.vertices, corners, &light.corner_codes, &light.corner_fallback);
        let first = self.primitive(part.mesh, part.primitives[0]).clone();
        let original_color =
            attribute(self.document, &first, COLOR)?.filter(|_| self.light.fallback == Fallback::Color0);
        let original_stride = self.stride(&first)?;
        if split.added.is_empty() {
            self.draco_to_plain(number)?;
        } else {
            self.split_pool(number, &first, &split)?;
        }
        let codes: Vec<u8> = split.codes.iter().flatten().flat_map(|c| c.to_le_bytes()).collect();
        self.written.light_bytes += codes.len() as u64;
        let template = json!({"componentType": 5123, "count": split.codes.len(), "type": "VEC2"});
        let codes = self.new_accessor(Purpose::Light, &codes, template);
        let color = match self.light.fallback {
            Fallback::Color0 => Some(self.fallback(&split, original_color)?),
            Fallback::None => None,
        };
        for &primitive in &part.primitives {
            let json = &mut array(&mut array(&mut self.root, "meshes")[self.mesh_of[number]], "primitives")
                [primitive];
            let attributes = object(object(json).entry("attributes").or_insert(Value::Null));
            let mut ours = Map::new();
            ours.insert("attribute".to_owned(), ATTRIBUTE.into());
            ours.insert("lightmap".to_owned(), 0.into());
            if let Some((color, _)) = color {
                if let Some(original) = attributes.insert(COLOR.to_owned(), color.into()) {
                    attributes.insert(ORIGINAL_COLOR.to_owned(), original);
                    ours.insert("color0".to_owned(), ORIGINAL_COLOR.into());
                }
                ours.insert("fallback".to_owned(), COLOR.into());
            }
            attributes.insert(ATTRIBUTE.to_owned(), codes.into());
            let extensions = object(object(json).entry("extensions").or_insert(Value::Null));
            extensions.insert(EXTENSION.to_owned(), Value::Object(ours));
        }
        self.written.parts.push(PartWritten {
            original_vertices: source.vertices,
            added_vertices: split.added.len(),
            original_stride,
            stride: original_stride + 4 + if color.is_some() { 4 } else { 0 },
        });
        Ok(())
    }

    fn primitive(&self, mesh: usize, primitive: usize) -> &'a Value {
        &list(&self.document.list("meshes")[mesh], "primitives")[primitive]
    }

    /// Every accessor of a vertex: attributes, then morph targets.
    fn vertex_accessors(primitive: &Value) -> Vec<usize> {
        let objects = primitive.get("attributes").into_iter().chain(list(primitive, "targets"));
        let numbers = objects.filter_map(Value::as_object).flat_map(Map::values);
        numbers.filter_map(crate::document::whole).map(|n| n as usize).collect()
    }

    fn stride(&self, primitive: &Value) -> Result<usize, SceneError> {
        let accessors = self.document.list("accessors");
        Self::vertex_accessors(primitive).iter().map(|&a| Ok(layout(&accessors[a])?.size)).sum()
    }

    /// The bytes of an accessor's elements at a stride of a multiple of four, followed by copies of some.
    fn packed(&self, accessor: usize, added: &[u32]) -> Result<(Vec<u8>, usize), SceneError> {
        let elements = self.document.elements(accessor)?;
        let stride = elements.layout.size.next_multiple_of(4);
        let mut bytes = Vec::with_capacity((elements.count() + added.len()) * stride);
        for v in (0..elements.count()).chain(added.iter().map(|&v| v as usize)) {
            bytes.extend_from_slice(elements.raw(v));
            bytes.resize(bytes.len().next_multiple_of(4), 0);
        }
        Ok((bytes, stride))
    }

    /// Writes out what Draco decoded for a part whose vertices stay as they are.
    fn draco_to_plain(&mut self, number: usize) -> Result<(), SceneError> {
        let part = &self.scene.parts[number];
        for &primitive in &part.primitives {
            let json = self.primitive(part.mesh, primitive);
            if extension(json, DRACO).is_none() {
                continue;
            }
            self.leave_draco(number, primitive);
            for accessor in Self::vertex_accessors(json) {
                if self.document.decoded.contains_key(&accessor) && self.plain.insert(accessor, ()).is_none()
                {
                    let (bytes, stride) = self.packed(accessor, &[])?;
                    self.make_plain(accessor, Purpose::Vertices { stride }, &bytes)?;
                }
            }
            if let Some(accessor) = index(json, "indices", self.document.list("accessors").len())?
                && let Some(bytes) = self.document.decoded.get(&accessor)
                && self.plain.insert(accessor, ()).is_none()
            {
                let size = layout(&self.document.list("accessors")[accessor])?.size;
                self.make_plain(accessor, Purpose::Indices { size }, bytes)?;
            }
        }
        Ok(())
    }

    fn leave_draco(&mut self, number: usize, primitive: usize) {
        let mesh = &mut array(&mut self.root, "meshes")[self.mesh_of[number]];
        remove_extension(&mut array(mesh, "primitives")[primitive], DRACO);
        self.written.plain_draco += 1;
    }

    /// Gives an accessor without data a view.
    fn make_plain(&mut self, accessor: usize, purpose: Purpose, bytes: &[u8]) -> Result<(), SceneError> {
        let (view, offset) = self.append(purpose, bytes);
        self.written.geometry_bytes += bytes.len() as u64;
        let bounds = self.bounds(accessor)?;
        let json = object(&mut array(&mut self.root, "accessors")[accessor]);
        json.insert("bufferView".to_owned(), view.into());
        json.insert("byteOffset".to_owned(), offset.into());
        set_bounds(json, bounds);
        Ok(())
    }

    /// The true bounds of a Draco accessor: the file states those from before quantization.
    fn bounds(&self, accessor: usize) -> Result<Option<[Vec<f64>; 2]>, SceneError> {
        if !self.document.decoded.contains_key(&accessor) {
            return Ok(None);
        }
        let elements = self.document.elements(accessor)?;
        let width = elements.layout.width;
        let mut bounds = [vec![f64::INFINITY; width], vec![f64::NEG_INFINITY; width]];
        for v in 0..elements.count() {
            for c in 0..width {
                // Bounds are stated before normalization.
                let x = match elements.layout.component {
                    Component::F32 => f64::from(elements.f32(v, c)),
                    Component::I8 | Component::I16 => f64::from(elements.u32(v, c) as i32),
                    _ => f64::from(elements.u32(v, c)),
                };
                bounds[0][c] = bounds[0][c].min(x);
                bounds[1][c] = bounds[1][c].max(x);
            }
        }
        Ok(Some(bounds).filter(|b| b.iter().flatten().all(|x| x.is_finite())))
    }

    /// Gives a part's pool accessors of its own, with the added vertices at their ends.
    fn split_pool(&mut self, number: usize, first: &Value, split: &Split) -> Result<(), SceneError> {
        let part = &self.scene.parts[number];
        let mut renamed: BTreeMap<usize, usize> = BTreeMap::new();
        let views = self.document.list("bufferViews");
        let mut compressed = false;
        for old in Self::vertex_accessors(first) {
            if renamed.contains_key(&old) {
                continue;
            }
            let mut json = self.document.list("accessors")[old].clone();
            let view = index(&json, "bufferView", views.len())?;
            compressed |= view.is_some_and(|v| MESHOPT.iter().any(|m| extension(&views[v], m).is_some()));
            let (bytes, stride) = self.packed(old, &split.added)?;
            self.written.geometry_bytes += bytes.len() as u64;
            let bounds = self.bounds(old)?;
            let count = bytes.len() / stride.max(1);
            let map = object(&mut json);
            map.insert("count".to_owned(), count.into());
            set_bounds(map, bounds);
            renamed.insert(old, self.new_accessor(Purpose::Vertices { stride }, &bytes, json));
        }
        self.written.plain_meshopt += usize::from(compressed);
        let mut start = 0;
        for (local, &primitive) in part.primitives.iter().enumerate() {
            let end =
                start + part.triangle_primitives[start..].iter().take_while(|&&p| p == local as u32).count();
            let indices = self.split_indices(number, primitive, split, start..end)?;
            if extension(self.primitive(part.mesh, primitive), DRACO).is_some() {
                self.leave_draco(number, primitive);
            }
            let mesh = &mut array(&mut self.root, "meshes")[self.mesh_of[number]];
            let json = object(&mut array(mesh, "primitives")[primitive]);
            let rename = |v: &mut Value| {
                if let Some(new) = crate::document::whole(v).and_then(|n| renamed.get(&(n as usize))) {
                    *v = (*new).into();
                }
            };
            if let Some(attributes) = json.get_mut("attributes").and_then(Value::as_object_mut) {
                attributes.values_mut().for_each(rename);
            }
            for target in json.get_mut("targets").and_then(Value::as_array_mut).into_iter().flatten() {
                target.as_object_mut().into_iter().flat_map(Map::values_mut).for_each(rename);
            }
            if let Some(indices) = indices {
                json.insert("indices".to_owned(), indices.into());
                if json.get("mode").is_some_and(|m| crate::document::whole(m) != Some(4)) {
                    json.insert("mode".to_owned(), 4.into());
                }
            }
            start = end;
        }
        Ok(())
    }

    /// New indices of a primitive, or `None` where its own stay right.
    fn split_indices(
        &mut self,
        number: usize,
        primitive: usize,
        split: &Split,
        triangles: std::ops::Range<usize>,
    ) -> Result<Option<usize>, SceneError> {
        let (part, source) = (&self.scene.parts[number], &self.scene.sources[number]);
        let json = self.primitive(part.mesh, primitive);
        let accessors = self.document.list("accessors");
        let old = index(json, "indices", accessors.len())?;
        let changed = triangles.clone().any(|t| split.corners[t] != self.scene.gltf_corners(number, t));
        // Draco indices have no view of their own; without indices, the count of vertices is that of corners.
        if let Some(old) = old
            && !changed
            && !self.document.decoded.contains_key(&old)
        {
            return Ok(None);
        }
        debug_assert!(triangle_mode(json).is_ok());
        let largest = split.corners[triangles.clone()].iter().flatten().copied().max().unwrap_or(0);
        let before = match old {
            Some(old) => layout(&accessors[old])?.component,
            None => Component::U16,
        };
        // The largest value of each type restarts primitives and cannot be used.
        let component = match before {
            Component::U8 if largest < 255 => Component::U8,
            Component::U8 | Component::U16 if largest < 65535 => Component::U16,
            _ => Component::U32,
        };
        let mut bytes = Vec::with_capacity(triangles.len() * 3 * component.size());
        for t in triangles.clone() {
            let [a, b, c] = split.corners[t];
            for v in if source.mirrored { [a, c, b] } else { [a, b, c] } {
                bytes.extend_from_slice(&v.to_le_bytes()[..component.size()]);
            }
        }
        self.written.geometry_bytes += bytes.len() as u64;
        let code = match component {
            Component::U8 => 5121,
            Component::U16 => 5123,
            _ => 5125,
        };
        let template = json!({"componentType": code, "count": triangles.len() * 3, "type": "SCALAR"});
        Ok(Some(self.new_accessor(Purpose::Indices { size: component.size() }, &bytes, template)))
    }

    /// The fallback `COLOR_0` of a part: the light times the color that was there. Returns accessor and width.
    fn fallback(&mut self, split: &Split, original: Option<usize>) -> Result<(usize, usize), SceneError> {
        let colors = original.map(|a| self.document.elements(a)).transpose()?;
        let width = colors.as_ref().map_or(3, |c| c.layout.width.clamp(3, 4));
        let byte = |v: f32| (v.clamp(0.0, 1.0) * 255.0).round() as u8;
        let mut bytes = Vec::with_capacity(split.codes.len() * 4);
        for (v, &light) in split.fallback.iter().enumerate() {
            let from = if v < split.codes.len() - split.added.len() {
                v
            } else {
                split.added[v - (split.codes.len() - split.added.len())] as usize
            };
            let color = |c: usize| match &colors {
                Some(colors) if c < colors.layout.width => {
                    Some(colors.f32(from, c)).filter(|x| x.is_finite()).unwrap_or(1.0)
                }
                _ => 1.0,
            };
            (0..3).for_each(|c| bytes.push(byte(light * color(c))));
            bytes.push(if width == 4 { byte(color(3)) } else { 0 });
        }
        self.written.fallback_bytes += bytes.len() as u64;
        let kind = if width == 4 { "VEC4" } else { "VEC3" };
        let template =
            json!({"componentType": 5121, "normalized": true, "count": split.codes.len(), "type": kind});
        Ok((self.new_accessor(Purpose::Fallback, &bytes, template), width))
    }

    /// Adds the pages of the atlas and the root object.
    fn atlas(&mut self, path: &Path) -> Result<(), SceneError> {
        let pages = self.light.atlas.as_ref().map_or(&[][..], |a| a.pages.as_slice());
        let mut textures = Vec::new();
        if !pages.is_empty() {
            let samplers = array(&mut self.root, "samplers");
            samplers.push(json!({"magFilter": 9729, "minFilter": 9729, "wrapS": 33071, "wrapT": 33071}));
            let sampler = samplers.len() - 1;
            for (number, png) in pages.iter().enumerate() {
                self.written.atlas_bytes += png.len() as u64;
                let image = if self.glb {
                    let (view, _) = self.append(Purpose::Page { number }, png);
                    json!({"mimeType": "image/png", "bufferView": view})
                } else {
                    let name = format!("{}.lightkiln.{number}.png", stem(path));
                    self.staged.write(&path.with_file_name(&name), png)?;
                    json!({"mimeType": "image/png", "uri": uri::encode(&name)})
                };
                let images = array(&mut self.root, "images");
                images.push(image);
                let source = images.len() - 1;
                let all = array(&mut self.root, "textures");
                all.push(json!({"sampler": sampler, "source": source}));
                textures.push(Value::from(all.len() - 1));
            }
        }
        let mut ours = self.light.extension.root.clone();
        object(&mut ours).insert("pages".to_owned(), Value::Array(textures));
        let extensions = object(object(&mut self.root).entry("extensions").or_insert(Value::Null));
        extensions.insert(EXTENSION.to_owned(), ours);
        let used = array(&mut self.root, "extensionsUsed");
        if !used.iter().any(|e| e.as_str() == Some(EXTENSION)) {
            used.push(EXTENSION.into());
        }
        Ok(())
    }

    /// Puts the buffer together and writes all files.
    fn finish(mut self, path: &Path) -> Result<Written, SceneError> {
        if self.written.plain_draco > 0 {
            let place = crate::error::Place::default();
            self.warnings.add(
                "Draco primitives are written without compression",
                self.written.plain_draco,
                place,
            );
            if !garbage::primitives_use(&self.root, DRACO) {
                self.forget_extension(DRACO);
            }
        }
        // The new views, without their offsets yet.
        let views: Vec<Value> =
            self.views.iter().map(|(purpose, bytes)| view_json(*purpose, self.main, bytes.len())).collect();
        if !views.is_empty() {
            array(&mut self.root, "bufferViews").extend(views);
        }
        let before = self.scene.baked.as_ref().unwrap_or(&self.document.root);
        let new_views = self.views.len();
        let length = self.document.buffers.get(self.main).map_or(0, |b| b.bytes.len() as u64);
        let dropped = garbage::collect(before, &mut self.root, self.main, length);
        self.written.wasted_bytes = dropped.wasted;
        self.written.dropped_bytes = dropped.cuts.iter().map(|(a, b)| b - a).sum();
        let empty = Vec::new();
        let old = self.document.buffers.get(self.main).map_or(&empty, |b| &b.bytes);
        let mut bytes = garbage::cut(old, &dropped.cuts);
        let first = list(&self.root, "bufferViews").len() - new_views;
        for (i, (_, data)) in self.views.iter().enumerate() {
            bytes.resize(bytes.len().next_multiple_of(4), 0);
            array(&mut self.root, "bufferViews")[first + i]["byteOffset"] = bytes.len().into();
            bytes.extend_from_slice(data);
        }
        self.drop_meshopt();
        let has_buffer = !bytes.is_empty() || !self.document.buffers.is_empty();
        let bin_name = self.bin_name(path);
        if has_buffer {
            let buffers = array(&mut self.root, "buffers");
            if buffers.len() <= self.main {
                buffers.push(json!({}));
            }
            let buffer = object(&mut buffers[self.main]);
            if self.glb {
                buffer.shift_remove("uri");
            } else {
                buffer.insert("uri".to_owned(), uri::encode(&bin_name).into());
            }
            buffer.insert("byteLength".to_owned(), bytes.len().into());
        }
        self.copy_resources(path)?;
        if self.glb {
            let json = to_json(&self.root, false)?;
            let file = container::join(&json, has_buffer.then_some(&bytes[..]), &self.document.chunks)?;
            self.staged.write(path, &file)?;
        } else {
            if has_buffer {
                self.staged.write(&path.with_file_name(&bin_name), &bytes)?;
            }
            self.staged.write(path, &to_json(&self.root, true)?)?;
        }
        let files = self.staged.publish()?;
        let mut written = self.written;
        written.files = files.into_iter().map(|(path, bytes)| WrittenFile { path, bytes }).collect();
        written.warnings = self.warnings.0;
        Ok(written)
    }

    /// Forgets meshopt when no view is compressed any more.
    fn drop_meshopt(&mut self) {
        for name in MESHOPT {
            let listed = list(&self.root, "extensionsUsed").iter().any(|e| e.as_str() == Some(name));
            let used = list(&self.root, "bufferViews").iter().any(|v| extension(v, name).is_some());
            if !listed || used {
                continue;
            }
            let named = |root: &Value, b: usize| {
                list(root, "bufferViews")
                    .iter()
                    .any(|v| v.get("buffer").and_then(Value::as_u64) == Some(b as u64))
            };
            while let Some(last) = list(&self.root, "buffers").len().checked_sub(1) {
                let fallback = extension(&list(&self.root, "buffers")[last], name).is_some();
                let placeholder =
                    self.document.buffers.get(last).is_some_and(|b| b.source == BufferSource::Fallback);
                if last == self.main || !fallback || !placeholder || named(&self.root, last) {
                    break;
                }
                array(&mut self.root, "buffers").pop();
            }
            if !list(&self.root, "buffers").iter().any(|b| extension(b, name).is_some()) {
                self.forget_extension(name);
            }
        }
    }

    /// The name of the binary file, which no other resource may have.
    fn bin_name(&self, path: &Path) -> String {
        let plain = format!("{}.bin", stem(path));
        let clash = self
            .resources()
            .any(|(owner, relative)| owner != Some(self.main) && relative == Path::new(&plain));
        if clash { format!("{}.lightkiln.bin", stem(path)) } else { plain }
    }

    /// Files that the scene refers to: the buffer's number, or `None` for an image, and the path.
    fn resources(&self) -> impl Iterator<Item = (Option<usize>, PathBuf)> + '_ {
        let relative = |v: &Value| {
            let text = v.get("uri").and_then(Value::as_str).filter(|u| !uri::is_data(u))?;
            uri::relative_path(text, "a resource").ok()
        };
        let buffers = self.document.list("buffers").iter().enumerate();
        let buffers = buffers.filter_map(move |(i, b)| Some((Some(i), relative(b)?)));
        buffers.chain(self.document.list("images").iter().filter_map(move |i| Some((None, relative(i)?))))
    }

    /// Copies what the scene refers to beside the output, where it is not there yet.
    fn copy_resources(&mut self, path: &Path) -> Result<(), SceneError> {
        let folder =
            |p: &Path| p.parent().filter(|f| !f.as_os_str().is_empty()).unwrap_or(Path::new(".")).to_owned();
        let Some(from) = self.document.path.as_deref().map(folder) else { return Ok(()) };
        let to = folder(path);
        let real = |p: &Path| p.canonicalize().unwrap_or_else(|_| p.to_owned());
        if real(&from) == real(&to) {
            return Ok(());
        }
        let wanted: std::collections::BTreeSet<PathBuf> =
            self.resources().filter(|(owner, _)| *owner != Some(self.main)).map(|(_, path)| path).collect();
        for relative in wanted {
            let (source, target) = (from.join(&relative), to.join(&relative));
            let failed = |action, path: &Path, source| SceneError::Io {
                action,
                path: path.to_owned(),
                source,
                place: Box::default(),
            };
            let bytes = match std::fs::read(&source) {
                Ok(bytes) => bytes,
                Err(e) if e.kind() == std::io::ErrorKind::NotFound => {
                    self.warnings.add(
                        "images that the scene names do not exist",
                        1,
                        crate::error::Place::default(),
                    );
                    continue;
                }
                Err(e) => return Err(failed("read", &source, e)),
            };
            match std::fs::read(&target) {
                Ok(there) if there == bytes => {}
                Ok(_) => {
                    let exists =
                        std::io::Error::new(std::io::ErrorKind::AlreadyExists, "another file has that name");
                    return Err(failed("copy a resource to", &target, exists));
                }
                Err(_) => self.staged.write(&target, &bytes)?,
            }
        }
        Ok(())
    }
}

fn stem(path: &Path) -> String {
    path.file_stem().unwrap_or_default().to_string_lossy().into_owned()
}

fn set_bounds(json: &mut Map<String, Value>, bounds: Option<[Vec<f64>; 2]>) {
    let Some([low, high]) = bounds else { return };
    for (key, values) in [("min", low), ("max", high)] {
        if json.contains_key(key) {
            json.insert(key.to_owned(), values.into());
        }
    }
}

fn view_json(purpose: Purpose, buffer: usize, length: usize) -> Value {
    let mut json = json!({"buffer": buffer, "byteOffset": 0, "byteLength": length});
    let stride = match purpose {
        Purpose::Light | Purpose::Fallback => Some(4),
        Purpose::Vertices { stride } => Some(stride),
        Purpose::Indices { .. } | Purpose::Page { .. } => None,
    };
    if let Some(stride) = stride {
        json["byteStride"] = stride.into();
        json["target"] = 34962.into();
    } else if matches!(purpose, Purpose::Indices { .. }) {
        json["target"] = 34963.into();
    }
    json
}

fn to_json(root: &Value, pretty: bool) -> Result<Vec<u8>, SceneError> {
    let json = if pretty { serde_json::to_vec_pretty(root) } else { serde_json::to_vec(root) };
    json.map_err(|source| SceneError::Json { source, place: Box::default() })
}
