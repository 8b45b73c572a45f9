//! The extension `LIGHTKILN_lightmap`: reading back what was baked, and undoing a bake before the next one.
//!
//! docs/FORMAT.md describes the extension.

use serde_json::Value;

use crate::accessor::Component;
use crate::document::{Document, array, extension, index, list, object, whole};
use crate::error::{SceneError, codec, value};
use crate::geometry::{attribute, open, primitive_place};
use crate::scene::{PartLight, Scene};

/// The extension's name.
pub const EXTENSION: &str = "LIGHTKILN_lightmap";
/// The vertex attribute that carries the light.
pub const ATTRIBUTE: &str = "_LIGHTUV";
/// Where an original `COLOR_0` is kept while ours stands in its place.
pub const ORIGINAL_COLOR: &str = "_LIGHTKILN_COLOR_0";
/// The attribute that serves as fallback.
pub(crate) const COLOR: &str = "COLOR_0";

/// A page of the atlas as it lies in the file.
#[derive(Clone, Debug, PartialEq)]
pub struct AtlasPage {
    /// The image file, PNG.
    pub png: Vec<u8>,
    /// Its URI, when it is a file beside the scene.
    pub uri: Option<String>,
}

/// The light of a baked file, as written.
#[derive(Clone, Debug)]
pub struct Lightmap {
    /// The root object of the extension.
    pub extension: Value,
    /// The pages of the atlas, in order.
    pub pages: Vec<AtlasPage>,
    /// In the order of [`Scene::parts`]. Parts without light have no codes.
    pub parts: Vec<PartLight>,
}

/// Whether a document carries our light.
pub(crate) fn is_baked(root: &Value) -> bool {
    extension(root, EXTENSION).is_some()
}

/// Takes a bake out of a document: our attributes, textures and extension objects go, an original `COLOR_0`
/// returns. Vertices that were split stay split. Returns whether there was anything to undo.
pub(crate) fn undo(root: &mut Value) -> bool {
    let Some(ours) = extension(root, EXTENSION).cloned() else { return false };
    let empty = |root: &mut Value, key: &str| array(root, key).is_empty();
    if root.get("meshes").is_some() {
        for mesh in array(root, "meshes") {
            if mesh.get("primitives").is_some() {
                array(mesh, "primitives").iter_mut().for_each(undo_primitive);
            }
        }
    }
    remove_extension(root, EXTENSION);
    for key in ["extensionsUsed", "extensionsRequired"] {
        if root.get(key).is_some() {
            array(root, key).retain(|e| e.as_str() != Some(EXTENSION));
            if empty(root, key) {
                object(root).shift_remove(key);
            }
        }
    }
    let pages: Vec<usize> = list(&ours, "pages").iter().filter_map(whole).map(|p| p as usize).collect();
    remove_pages(root, &pages);
    true
}

/// Removes an extension object, and `extensions` itself when nothing is left in it.
pub(crate) fn remove_extension(owner: &mut Value, name: &str) {
    let Some(owner) = owner.as_object_mut() else { return };
    let Some(extensions) = owner.get_mut("extensions").and_then(Value::as_object_mut) else { return };
    extensions.shift_remove(name);
    if extensions.is_empty() {
        owner.shift_remove("extensions");
    }
}

fn undo_primitive(primitive: &mut Value) {
    let Some(ours) = extension(primitive, EXTENSION).cloned() else { return };
    let name = |key: &str| ours.get(key).and_then(Value::as_str);
    let light = name("attribute").unwrap_or(ATTRIBUTE).to_owned();
    if let Some(attributes) = primitive.get_mut("attributes").and_then(Value::as_object_mut) {
        attributes.shift_remove(&light);
        match name("color0") {
            Some(kept) => {
                if let Some(original) = attributes.shift_remove(kept) {
                    attributes.insert(COLOR.to_owned(), original);
                }
            }
            None if name("fallback") == Some(COLOR) => {
                attributes.shift_remove(COLOR);
            }
            None => {}
        }
    }
    remove_extension(primitive, EXTENSION);
}

/// Removes our textures with their images and sampler, as far as they stand at the end of their arrays:
/// elsewhere they would move the numbers of others.
fn remove_pages(root: &mut Value, pages: &[usize]) {
    let count = |root: &Value, key: &str| list(root, key).len();
    let (mut images, mut samplers) = (Vec::new(), Vec::new());
    while let Some(last) = count(root, "textures").checked_sub(1).filter(|t| pages.contains(t)) {
        if let Some(texture) = array(root, "textures").pop() {
            images.extend(texture.get("source").and_then(whole));
            samplers.extend(texture.get("sampler").and_then(whole));
        }
        if last == 0 {
            object(root).shift_remove("textures");
        }
    }
    for (key, role, removed) in [("images", "source", images), ("samplers", "sampler", samplers)] {
        while let Some(last) = count(root, key).checked_sub(1).filter(|&n| removed.contains(&(n as u64))) {
            let used =
                list(root, "textures").iter().any(|t| t.to_string().contains(&format!("\"{role}\":{last}")));
            if used {
                break;
            }
            array(root, key).pop();
            if last == 0 {
                object(root).shift_remove(key);
            }
        }
    }
}

impl Scene {
    /// The light of a file that this program baked; `None` for any other file.
    ///
    /// # Errors
    /// When the attributes or images that the extension names are damaged.
    pub fn read_lightmap(&self) -> Result<Option<Lightmap>, SceneError> {
        let Some(root) = &self.baked else { return Ok(None) };
        let Some(json) = extension(root, EXTENSION) else { return Ok(None) };
        let textures = list(root, "textures");
        let images = list(root, "images");
        let mut pages = Vec::new();
        for page in list(json, "pages") {
            let texture = whole(page)
                .and_then(|t| textures.get(t as usize))
                .ok_or_else(|| value("pages", page, "numbers of textures"))?;
            let image = index(texture, "source", images.len())?
                .ok_or_else(|| value("source", "missing", "the number of an image"))?;
            let uri = images[image].get("uri").and_then(Value::as_str).map(str::to_owned);
            pages.push(AtlasPage { png: self.document.image_of(root, image)?, uri });
        }
        let mut parts = Vec::with_capacity(self.parts.len());
        for part in 0..self.parts.len() {
            parts.push(self.part_light(root, part)?);
        }
        Ok(Some(Lightmap { extension: json.clone(), pages, parts }))
    }

    fn part_light(&self, root: &Value, number: usize) -> Result<PartLight, SceneError> {
        let part = &self.parts[number];
        let mut light = PartLight::default();
        let meshes = list(root, "meshes");
        let primitives = list(&meshes[part.mesh], "primitives");
        let mut opened = Vec::new();
        for &primitive in &part.primitives {
            let json = &primitives[primitive];
            let open_light = || -> Result<_, SceneError> {
                let Some(ours) = extension(json, EXTENSION) else { return Ok(None) };
                let name = ours.get("attribute").and_then(Value::as_str).unwrap_or(ATTRIBUTE);
                let Some(codes) = attribute(&self.document, json, name)? else { return Ok(None) };
                let codes = open(&self.document, codes, name, 2..=2, None)?;
                if codes.layout.component != Component::U16 {
                    return Err(codec(
                        "light",
                        format!("{name} is no longer made of unsigned 16-bit integers"),
                    ));
                }
                let color = match ours.get("fallback").and_then(Value::as_str) {
                    Some(fallback) => attribute(&self.document, json, fallback)?,
                    None => None,
                };
                let color = match color {
                    Some(color) => Some(open(&self.document, color, COLOR, 3..=4, Some(codes.count()))?),
                    None => None,
                };
                Ok(Some((codes, color)))
            };
            let place = primitive_place(&self.document, part.mesh, primitive);
            opened.push(open_light().map_err(|e| e.at(|p| *p = place))?);
        }
        if opened.iter().any(Option::is_none) {
            return Ok(light);
        }
        for triangle in 0..part.triangles.len() {
            let Some((codes, color)) = &opened[part.triangle_primitives[triangle] as usize] else { continue };
            let corners = self.gltf_corners(number, triangle);
            if let Some(&bad) = corners.iter().find(|&&v| v as usize >= codes.count()) {
                return Err(crate::error::reference(ATTRIBUTE, u64::from(bad), codes.count()));
            }
            let corners = corners.map(|v| v as usize);
            light.corner_codes.push(corners.map(|v| [codes.u32(v, 0) as u16, codes.u32(v, 1) as u16]));
            light.corner_fallback.push(corners.map(|v| color.as_ref().map_or(1.0, |c| c.f32(v, 0))));
        }
        Ok(light)
    }
}

impl Document {
    /// An image of another version of the same file's JSON.
    fn image_of(&self, root: &Value, image: usize) -> Result<Vec<u8>, SceneError> {
        let json = &list(root, "images")[image];
        match index(json, "bufferView", list(root, "bufferViews").len())? {
            Some(view) => Ok(self.view(view)?.to_vec()),
            None => self.image_file(json, image),
        }
    }
}
