//! What a primitive looks like without any light, as a viewer on a GPU takes it: factors and colors of vertices, and the
//! base color texture as the image file that it is.

use serde_json::Value;

use crate::document::list;
use crate::error::SceneError;
use crate::geometry::{attribute, open};
use crate::material::{AlphaMode, base_color};
use crate::scene::Scene;
use crate::texture::{Mapping, Wrap, texture_of};

/// The looks of a primitive.
#[derive(Clone, Debug)]
pub struct Appearance {
    /// Base color factor: linear red, green and blue, and alpha, `0..=1`.
    pub factor: [f32; 4],
    /// How alpha is used.
    pub alpha_mode: AlphaMode,
    /// Colors that the factor is multiplied with, per glTF vertex of the part's pool; empty where there are none.
    pub colors: Vec<[f32; 4]>,
    /// What both are multiplied with.
    pub texture: Option<BaseTexture>,
}

/// A base color texture on a primitive.
#[derive(Clone, Debug)]
pub struct BaseTexture {
    /// Number of the image, for [`Scene::image_file`].
    pub image: usize,
    /// What lies outside of the image, along u and v.
    pub wrap: [Wrap; 2],
    /// Texture coordinates with KHR_texture_transform applied, per glTF vertex of the part's pool.
    pub uv: Vec<[f32; 2]>,
}

impl Scene {
    /// The looks of a primitive of a part; they do not depend on [`ReadOptions::surfaces`](crate::ReadOptions::surfaces).
    /// Textures that browsers do not know (KTX2, AVIF, DDS) are left out.
    ///
    /// - `primitive`: index into [`Part::primitives`](crate::Part::primitives)
    ///
    /// # Errors
    /// References and accessors that are faulty.
    pub fn appearance(&self, part: usize, primitive: usize) -> Result<Appearance, SceneError> {
        let document = &self.document;
        let owner = &self.parts[part];
        let json = &list(&document.list("meshes")[owner.mesh], "primitives")[owner.primitives[primitive]];
        let material = owner.primitive_materials[primitive];
        let none = Value::Null;
        let material_json = material.map_or(&none, |m| &document.list("materials")[m]);
        let (factor, info) = base_color(material_json);
        let vertices = self.gltf_vertex_count(part);
        let mut texture = None;
        if let Some(info) = info
            && let Some((entry, Some(image))) = texture_of(document, info)?
        {
            let mapping = Mapping::read(document, info, entry)?;
            let semantic = format!("TEXCOORD_{}", mapping.set);
            if let Some(accessor) = attribute(document, json, &semantic)? {
                let elements = open(document, accessor, &semantic, 2..=2, Some(vertices))?;
                let uv = (0..vertices).map(|v| mapping.transformed(elements.floats(v))).collect();
                texture = Some(BaseTexture { image, wrap: mapping.wrap(), uv });
            }
        }
        let mut colors = Vec::new();
        if let Some(accessor) = attribute(document, json, "COLOR_0")? {
            let elements = open(document, accessor, "COLOR_0", 3..=4, Some(vertices))?;
            let given = |v, c| (c < elements.layout.width).then(|| elements.f32(v, c));
            let unit = |v, c| given(v, c).filter(|x| x.is_finite()).map_or(1.0, |x| x.clamp(0.0, 1.0));
            colors = (0..vertices).map(|v| [0, 1, 2, 3].map(|c| unit(v, c))).collect();
        }
        let alpha_mode = material.map_or(AlphaMode::Opaque, |m| self.materials[m].alpha_mode);
        Ok(Appearance { factor: factor.map(|f| f.clamp(0.0, 1.0)), alpha_mode, colors, texture })
    }

    /// The media type and the bytes of an image of the file as they are; none for what browsers do not know and for what
    /// cannot be read.
    pub fn image_file(&self, image: usize) -> Option<(&'static str, Vec<u8>)> {
        let bytes = self.document.image(image).ok()?;
        let kind = match image::guess_format(&bytes).ok()? {
            image::ImageFormat::Png => "image/png",
            image::ImageFormat::Jpeg => "image/jpeg",
            image::ImageFormat::WebP => "image/webp",
            _ => return None,
        };
        Some((kind, bytes))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::ReadOptions;

    /// A triangle with colors, a turned and masked texture, and no image that a browser would show.
    fn scene() -> Scene {
        let mut bytes = Vec::new();
        let floats = [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 1.0_f32];
        floats.iter().for_each(|f| bytes.extend_from_slice(&f.to_le_bytes()));
        bytes.extend_from_slice(&[255, 0, 0, 128, 0, 255, 0, 255, 0, 0, 255, 255]);
        let data = |bytes: &[u8]| {
            use base64::Engine as _;
            base64::engine::general_purpose::STANDARD.encode(bytes)
        };
        let json = serde_json::json!({
            "asset": { "version": "2.0" },
            "scenes": [{ "nodes": [0] }], "nodes": [{ "mesh": 0 }],
            "meshes": [{ "primitives": [{ "material": 0,
                "attributes": { "POSITION": 0, "TEXCOORD_0": 1, "COLOR_0": 2 } }] }],
            "materials": [{ "alphaMode": "MASK", "pbrMetallicRoughness": {
                "baseColorFactor": [0.5, 1.0, 1.0, 1.0],
                "baseColorTexture": { "index": 0, "extensions":
                    { "KHR_texture_transform": { "offset": [0.5, 0.0], "scale": [2.0, 1.0] } } } } }],
            "textures": [{ "source": 0, "sampler": 0 }], "samplers": [{ "wrapS": 33071 }],
            "images": [{ "mimeType": "image/png", "bufferView": 3 }],
            "accessors": [
                { "bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3" },
                { "bufferView": 1, "componentType": 5126, "count": 3, "type": "VEC2" },
                { "bufferView": 2, "componentType": 5121, "normalized": true, "count": 3, "type": "VEC4" }],
            "bufferViews": [
                { "buffer": 0, "byteLength": 36 },
                { "buffer": 0, "byteOffset": 36, "byteLength": 24 },
                { "buffer": 0, "byteOffset": 60, "byteLength": 12 },
                { "buffer": 0, "byteLength": 8 }],
            "buffers": [{ "byteLength": bytes.len(),
                "uri": format!("data:application/octet-stream;base64,{}", data(&bytes)) }],
        });
        Scene::read_bytes(json.to_string().as_bytes(), &ReadOptions::default()).expect("sound")
    }

    #[test]
    fn appearance_is_what_a_gpu_needs_of_the_file() {
        let scene = scene();
        let looks = scene.appearance(0, 0).expect("sound");
        assert_eq!(looks.factor, [0.5, 1.0, 1.0, 1.0]);
        assert_eq!(looks.alpha_mode, AlphaMode::Mask { cutoff: 0.5 });
        assert_eq!(looks.colors[0], [1.0, 0.0, 0.0, 128.0 / 255.0]);
        let texture = looks.texture.expect("a texture");
        assert_eq!((texture.image, texture.wrap), (0, [Wrap::Clamp, Wrap::Repeat]));
        assert_eq!(texture.uv, [[0.5, 0.0], [2.5, 0.0], [0.5, 1.0]]);
        assert!(scene.image_file(0).is_none() && scene.image_file(7).is_none());
    }
}
