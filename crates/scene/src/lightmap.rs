//! The extension `LIGHTKILN_lightmap`: its names, and reading back what was baked.
//!
//! docs/FORMAT.md describes the extension.

use serde_json::{Map, Value};

use crate::accessor::{Component, Elements};
use crate::document::{Document, extension, index, list, whole};
use crate::error::{SceneError, codec, reference, value};
use crate::geometry::{attribute, open, primitive_place};
use crate::materials::TEXCOORD;
use crate::profile::Profile;
use crate::scene::Scene;

/// The extension's name.
pub const EXTENSION: &str = "LIGHTKILN_lightmap";
/// The version of the format that is written and read. Version 1 is only recognized, so that a new bake can take
/// its place.
pub const VERSION: u64 = 2;
/// The vertex attribute that carries the first layer of light.
pub const ATTRIBUTE: &str = "_LIGHTUV";
/// Where an original `COLOR_0` is kept while ours stands in its place.
pub const ORIGINAL_COLOR: &str = "_LIGHTKILN_COLOR_0";
/// The attribute that serves as fallback.
pub(crate) const COLOR: &str = "COLOR_0";

/// The vertex attribute that carries a layer: `_LIGHTUV`, `_LIGHTUV_1`, `_LIGHTUV_2` ...
pub fn attribute_name(layer: usize) -> String {
    if layer == 0 { ATTRIBUTE.to_owned() } else { format!("{ATTRIBUTE}_{layer}") }
}

/// An image of the light as it lies in the file.
#[derive(Clone, Debug, PartialEq)]
pub struct LightImage {
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
    /// How the light stands in the file.
    pub profile: Profile,
    /// At least one.
    pub layers: Vec<LayerRead>,
}

/// A layer of a baked file.
#[derive(Clone, Debug)]
pub struct LayerRead {
    /// The layer's object in the extension.
    pub info: Map<String, Value>,
    /// The pages of the atlas, in order.
    pub pages: Vec<LightImage>,
    /// The table of colors, where codes are numbers of its entries.
    pub table: Option<LightImage>,
    /// In the order of [`Scene::parts`]: per triangle, per corner. Empty for parts without light. In plain profiles
    /// these are coordinates, `0..=65535` over the page, and the same in all layers.
    pub parts: Vec<Vec<[[u16; 2]; 3]>>,
    /// The same in [`Profile::Texcoord`], whose pairs stand for codes; `parts` then has no triangles.
    pub pairs: Vec<Vec<[[f32; 2]; 3]>>,
}

/// The accessor of a primitive, if it has one.
type Found<'a> = Result<Option<Elements<'a>>, SceneError>;

/// Whether a document carries our light, of any version.
pub(crate) fn is_baked(root: &Value) -> bool {
    extension(root, EXTENSION).is_some()
}

/// Whether an attribute's name is that of a layer.
pub(crate) fn is_layer_name(name: &str) -> bool {
    name.strip_prefix(ATTRIBUTE).is_some_and(|rest| {
        rest.is_empty()
            || rest.strip_prefix('_').is_some_and(|number| {
                !number.is_empty() && !number.starts_with('0') && number.bytes().all(|b| b.is_ascii_digit())
            })
    })
}

/// Refuses formats that are not read.
fn check_version(json: &Value) -> Result<(), SceneError> {
    let found = json.get("version").unwrap_or(&Value::Null);
    let (what, remedy) = match whole(found) {
        Some(VERSION) => return Ok(()),
        Some(version) if version > VERSION => {
            (format!("light of format version {version}"), "use a newer lightkiln, or bake again")
        }
        Some(version) if version > 0 => {
            (format!("light baked by an older version (format {version}, this is {VERSION})"), "bake again")
        }
        _ => return Err(value("version", found, "the version of the light's format")),
    };
    Err(SceneError::Unsupported { what, remedy, place: Box::default() })
}

/// How light stands in the file; the first profile where nothing is said.
fn profile_of(json: &Value) -> Result<Profile, SceneError> {
    let Some(found) = json.get("profile") else { return Ok(Profile::Eta) };
    let profile = found.as_str().and_then(|name| name.parse().ok());
    profile.ok_or_else(|| value("profile", found, "eta, stock, texcoord or lightmap"))
}

impl Scene {
    /// What the extension of a file that this program baked says, without its light; `None` for any other file.
    ///
    /// # Errors
    /// [`SceneError::Unsupported`] for light of another version.
    pub fn read_extension(&self) -> Result<Option<&Value>, SceneError> {
        let Some(json) = self.baked.as_ref().and_then(|root| extension(root, EXTENSION)) else {
            return Ok(None);
        };
        check_version(json)?;
        Ok(Some(json))
    }

    /// The light of a file that this program baked; `None` for any other file.
    ///
    /// # Errors
    /// [`SceneError::Unsupported`] for light of another version; others when the attributes or images that the
    /// extension names are damaged.
    pub fn read_lightmap(&self) -> Result<Option<Lightmap>, SceneError> {
        let Some(root) = &self.baked else { return Ok(None) };
        let Some(json) = self.read_extension()? else { return Ok(None) };
        let profile = profile_of(json)?;
        let mut layers = Vec::new();
        for (number, layer) in list(json, "layers").iter().enumerate() {
            layers.push(self.layer(root, number, layer, profile)?);
        }
        if layers.is_empty() {
            let found = json.get("layers").unwrap_or(&Value::Null);
            return Err(value("layers", found, "an array of layers, at least one"));
        }
        if let Some(other) = layers.iter().find(|l| l.pages.len() != layers[0].pages.len()) {
            return Err(value("pages", other.pages.len(), "as many as in the first layer"));
        }
        for part in 0..self.parts.len() {
            self.part_codes(root, part, &mut layers, profile)?;
        }
        Ok(Some(Lightmap { extension: json.clone(), profile, layers }))
    }

    /// What the fallback `COLOR_0` of a baked file holds, in the order of [`Scene::parts`]: linear RGB per triangle,
    /// per corner; empty for parts without a fallback.
    ///
    /// # Errors
    /// When the attribute is damaged.
    pub fn read_fallback(&self) -> Result<Vec<Vec<[[f32; 3]; 3]>>, SceneError> {
        let Some(root) = &self.baked else { return Ok(vec![Vec::new(); self.parts.len()]) };
        let read = |part| {
            let opened = self.open_all(root, part, &|json, ours| {
                if ours.get("fallback").is_none() {
                    return Ok(None);
                }
                match attribute(&self.document, json, COLOR)? {
                    Some(color) => open(&self.document, color, COLOR, 3..=4, None).map(Some),
                    None => Ok(None),
                }
            })?;
            let Some(colors) = opened else { return Ok(Vec::new()) };
            self.corners_of(part, &colors, |colors, v| [0, 1, 2].map(|c| colors.f32(v, c)))
        };
        (0..self.parts.len()).map(read).collect()
    }

    /// A layer's object and images.
    fn layer(
        &self,
        root: &Value,
        number: usize,
        json: &Value,
        profile: Profile,
    ) -> Result<LayerRead, SceneError> {
        let info = json.as_object().ok_or_else(|| value("a layer", json, "an object"))?.clone();
        let name = json.get("attribute").unwrap_or(&Value::Null);
        if profile == Profile::Eta && name.as_str() != Some(&attribute_name(number)) {
            return Err(value("attribute", name, "the name that belongs to the layer's number"));
        }
        let channels = json.get("channels").unwrap_or(&Value::Null);
        if !whole(channels).is_some_and(|n| (1..=3).contains(&n)) {
            return Err(value("channels", channels, "1, 2 or 3"));
        }
        let pages = json.get("pages").unwrap_or(&Value::Null);
        let pages = pages.as_array().ok_or_else(|| value("pages", pages, "an array of textures"))?;
        let pages = pages.iter().map(|p| self.light_image(root, "pages", p)).collect::<Result<_, _>>()?;
        let table = match (json.get("codes").and_then(Value::as_str), json.get("table")) {
            (Some("packed"), None) if !profile.is_plain() => None,
            (Some("coordinates"), None) if profile.is_plain() => None,
            (Some("table"), Some(table)) => Some(self.light_image(root, "table", table)?),
            _ => {
                let found = json.get("codes").unwrap_or(&Value::Null);
                return Err(value("codes", found, "packed without a table, table with one, or coordinates"));
            }
        };
        let parts = self.parts.len();
        Ok(LayerRead {
            info,
            pages,
            table,
            parts: Vec::with_capacity(parts),
            pairs: Vec::with_capacity(parts),
        })
    }

    fn light_image(&self, root: &Value, role: &str, texture: &Value) -> Result<LightImage, SceneError> {
        let images = list(root, "images");
        let texture = whole(texture)
            .and_then(|t| list(root, "textures").get(t as usize))
            .ok_or_else(|| value(role, texture, "the number of a texture"))?;
        let image = index(texture, "source", images.len())?
            .ok_or_else(|| value("source", "missing", "the number of an image"))?;
        let uri = images[image].get("uri").and_then(Value::as_str).map(str::to_owned);
        Ok(LightImage { png: self.document.image_of(root, image)?, uri })
    }

    /// Adds a part's codes to all layers.
    fn part_codes(
        &self,
        root: &Value,
        part: usize,
        layers: &mut [LayerRead],
        profile: Profile,
    ) -> Result<(), SceneError> {
        let count = profile.attributes(layers.len());
        for number in 0..count {
            let opened = self.open_all(root, part, &|json, ours| {
                let names = ours.get("attributes").unwrap_or(&Value::Null);
                let named = names.as_array().filter(|n| n.len() == count).and_then(|n| n[number].as_str());
                let fits = |name: &&str| match profile {
                    Profile::Eta => **name == attribute_name(number),
                    _ => name.starts_with(TEXCOORD),
                };
                let name = named.filter(fits).ok_or_else(|| {
                    value("attributes", names, "the attributes of all layers, in their order")
                })?;
                let codes = attribute(&self.document, json, name)?
                    .ok_or_else(|| value(name, "missing", "an attribute of the primitive"))?;
                let codes = open(&self.document, codes, name, 2..=2, None)?;
                let (component, called) = match profile {
                    Profile::Texcoord => (Component::F32, "floats"),
                    _ => (Component::U16, "unsigned 16-bit integers"),
                };
                if codes.layout.component != component {
                    return Err(codec("light", format!("{name} is no longer made of {called}")));
                }
                Ok(Some(codes))
            })?;
            let (mut codes, mut pairs) = (Vec::new(), Vec::new());
            match opened {
                Some(light) if profile == Profile::Texcoord => {
                    pairs = self.corners_of(part, &light, |light, v| [0, 1].map(|c| light.f32(v, c)))?;
                }
                Some(light) => {
                    codes =
                        self.corners_of(part, &light, |light, v| [0, 1].map(|c| light.u32(v, c) as u16))?;
                }
                None => {}
            }
            layers[number].parts.push(codes);
            layers[number].pairs.push(pairs);
        }
        // One attribute for all layers.
        let shared = layers[0].parts.last().cloned().unwrap_or_default();
        for layer in &mut layers[count..] {
            layer.parts.push(shared.clone());
            layer.pairs.push(Vec::new());
        }
        Ok(())
    }

    /// Opens an accessor of every primitive of a part; `None` when a primitive has no light, or not that accessor.
    ///
    /// - `find`: takes a primitive and its extension object
    fn open_all<'a>(
        &'a self,
        root: &Value,
        part: usize,
        find: &dyn Fn(&Value, &Value) -> Found<'a>,
    ) -> Result<Option<Vec<Elements<'a>>>, SceneError> {
        let part = &self.parts[part];
        let primitives = list(&list(root, "meshes")[part.mesh], "primitives");
        let mut opened = Vec::with_capacity(part.primitives.len());
        for &primitive in &part.primitives {
            let json = &primitives[primitive];
            let Some(ours) = extension(json, EXTENSION) else { return Ok(None) };
            let found = find(json, ours).map_err(|e| {
                e.at(|p| {
                    let inner = std::mem::replace(p, primitive_place(&self.document, part.mesh, primitive));
                    (p.accessor, p.attribute) = (inner.accessor, inner.attribute);
                })
            })?;
            match found {
                Some(found) => opened.push(found),
                None => return Ok(None),
            }
        }
        Ok(Some(opened))
    }

    /// What the accessors of a part's primitives hold at the corners of its triangles.
    fn corners_of<T>(
        &self,
        part: usize,
        opened: &[Elements<'_>],
        get: impl Fn(&Elements<'_>, usize) -> T,
    ) -> Result<Vec<[T; 3]>, SceneError> {
        let primitives = &self.parts[part].triangle_primitives;
        let mut out = Vec::with_capacity(primitives.len());
        for (triangle, &primitive) in primitives.iter().enumerate() {
            let elements = &opened[primitive as usize];
            let corners = self.gltf_corners(part, triangle);
            if let Some(&bad) = corners.iter().find(|&&v| v as usize >= elements.count()) {
                return Err(reference("a vertex with light", u64::from(bad), elements.count()));
            }
            out.push(corners.map(|v| get(elements, v as usize)));
        }
        Ok(out)
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn layer_names_are_their_own_and_no_others() {
        assert!((0..20).all(|n| is_layer_name(&attribute_name(n))));
        for name in
            ["_LIGHTUV_0", "_LIGHTUV_", "_LIGHTUV1", "_LIGHTUV_x", "_LIGHT", "POSITION", "_LIGHTUV_01"]
        {
            assert!(!is_layer_name(name), "{name}");
        }
    }
}
