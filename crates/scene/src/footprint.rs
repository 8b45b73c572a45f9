//! What the geometry and the textures of a file cost on a GPU.

use crate::accessor::layout;
use crate::document::list;
use crate::scene::Scene;

/// The size of an image of the file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ImageSize {
    /// Its name, its URI or its number.
    pub name: String,
    /// Width and height in pixels; `None` for a format that is not read.
    pub pixels: Option<[u32; 2]>,
}

impl Scene {
    /// Bytes of one glTF vertex of a part: all attributes and morph targets, each padded to four bytes. The
    /// light of an earlier bake is not counted.
    ///
    /// # Panics
    /// For a part that the scene does not have.
    pub fn vertex_stride(&self, part: usize) -> usize {
        let part = &self.parts[part];
        let primitive = &list(&self.document.list("meshes")[part.mesh], "primitives")[part.primitives[0]];
        let accessors = self.document.list("accessors");
        let targets = list(primitive, "targets").iter();
        let maps = targets.chain(primitive.get("attributes")).filter_map(serde_json::Value::as_object);
        let named = maps.flat_map(|map| map.values()).filter_map(serde_json::Value::as_u64);
        let size =
            |a: u64| accessors.get(a as usize).and_then(|json| layout(json).ok()).map_or(0, |l| l.size);
        named.map(|a| size(a).next_multiple_of(4)).sum()
    }

    /// Whether a file that was baked already carries the `COLOR_0` fallback.
    pub fn has_fallback(&self) -> bool {
        let Some(baked) = &self.baked else { return false };
        list(baked, "meshes").iter().flat_map(|m| list(m, "primitives")).any(|primitive| {
            crate::document::extension(primitive, crate::lightmap::EXTENSION)
                .is_some_and(|ours| ours.get("fallback").is_some())
        })
    }

    /// The images that the materials use, in the order of the file.
    pub fn image_sizes(&self) -> Vec<ImageSize> {
        let images = self.document.list("images");
        images
            .iter()
            .enumerate()
            .map(|(number, json)| {
                let text = |key: &str| json.get(key).and_then(serde_json::Value::as_str);
                let uri = text("uri").filter(|uri| !crate::uri::is_data(uri));
                let name = text("name").or(uri).map_or_else(|| format!("image {number}"), str::to_owned);
                let bytes = self.document.image(number).ok();
                let size = |bytes: Vec<u8>| {
                    let reader =
                        image::ImageReader::new(std::io::Cursor::new(bytes)).with_guessed_format().ok()?;
                    reader.into_dimensions().ok()
                };
                ImageSize { name, pixels: bytes.and_then(size).map(|(w, h)| [w, h]) }
            })
            .collect()
    }
}
