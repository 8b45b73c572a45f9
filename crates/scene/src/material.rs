//! Materials as far as light passes through them: alpha, transmission, and which sides are drawn.

use std::collections::BTreeMap;
use std::sync::Arc;

use serde_json::Value;

use crate::document::{Document, extension, name, number, numbers};
use crate::error::{Place, SceneError, Warnings};
use crate::texture::{Mapping, decode, texture_of};

/// How alpha becomes coverage (glTF 2.0, 3.9.4).
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum AlphaMode {
    /// Alpha is ignored.
    Opaque,
    /// Alpha of at least the cutoff covers, less does not.
    Mask {
        /// The cutoff.
        cutoff: f32,
    },
    /// Alpha is the coverage.
    Blend,
}

/// A material of the file.
#[derive(Clone, Debug)]
pub struct Material {
    /// Its name, if it has one.
    pub name: Option<String>,
    /// How alpha is used.
    pub alpha_mode: AlphaMode,
    /// Alpha of the base color factor, 0..=1.
    pub alpha: f32,
    /// Share of the light that passes through the surface (KHR_materials_transmission, factor only), 0..=1.
    pub transmission: f32,
    /// Whether both sides are drawn.
    pub double_sided: bool,
    pub(crate) texture: Option<AlphaTexture>,
}

/// The alpha channel of a base color texture, as it is sampled.
#[derive(Clone, Debug)]
pub(crate) struct AlphaTexture {
    image: Arc<AlphaImage>,
    pub mapping: Mapping,
}

#[derive(Debug)]
struct AlphaImage {
    size: [usize; 2],
    alpha: Vec<u8>,
}

impl Material {
    /// Whether a point of it may cover less than wholly.
    pub fn is_translucent(&self) -> bool {
        self.alpha_mode != AlphaMode::Opaque || self.transmission > 0.0
    }

    /// Coverage for texture coordinates and vertex alpha.
    pub(crate) fn coverage(&self, uv: Option<[f32; 2]>, vertex_alpha: f32) -> f32 {
        let texel = match (&self.texture, uv) {
            (Some(texture), Some(uv)) => texture.sample(uv),
            (Some(texture), None) => texture.sample([0.0, 0.0]),
            _ => 1.0,
        };
        let alpha = (self.alpha * texel * vertex_alpha).clamp(0.0, 1.0);
        let covered = match self.alpha_mode {
            AlphaMode::Opaque => 1.0,
            AlphaMode::Mask { cutoff } => f32::from(u8::from(alpha >= cutoff)),
            AlphaMode::Blend => alpha,
        };
        covered * (1.0 - self.transmission)
    }
}

impl AlphaTexture {
    /// Bilinear alpha of the finest level.
    fn sample(&self, uv: [f32; 2]) -> f32 {
        let size = self.image.size;
        self.mapping.cell(uv, size).mix(|x, y| f32::from(self.image.alpha[y * size[0] + x]) / 255.0)
    }
}

/// Reads all materials; images are decoded only where alpha matters.
pub(crate) fn read_materials(
    document: &Document,
    warnings: &mut Warnings,
) -> Result<Vec<Material>, SceneError> {
    let mut images: BTreeMap<usize, Option<Arc<AlphaImage>>> = BTreeMap::new();
    let mut out = Vec::new();
    for json in document.list("materials") {
        let none = Value::Null;
        let pbr = json.get("pbrMetallicRoughness").unwrap_or(&none);
        let alpha_mode = match json.get("alphaMode").and_then(Value::as_str) {
            Some("MASK") => AlphaMode::Mask { cutoff: number(json, "alphaCutoff", 0.5) },
            Some("BLEND") => AlphaMode::Blend,
            _ => AlphaMode::Opaque,
        };
        let factor = numbers::<4>(pbr, "baseColorFactor").ok().flatten().map_or(1.0, |f| f[3] as f32);
        let transmission = extension(json, "KHR_materials_transmission")
            .map_or(0.0, |t| number(t, "transmissionFactor", 0.0))
            .clamp(0.0, 1.0);
        let texture = match (alpha_mode, pbr.get("baseColorTexture")) {
            (AlphaMode::Opaque, _) | (_, None) => None,
            (_, Some(info)) => read_texture(document, info, &mut images, warnings)?,
        };
        out.push(Material {
            name: name(json),
            alpha_mode,
            alpha: factor.clamp(0.0, 1.0),
            transmission,
            double_sided: json.get("doubleSided").and_then(Value::as_bool).unwrap_or(false),
            texture,
        });
    }
    Ok(out)
}

fn read_texture(
    document: &Document,
    info: &Value,
    images: &mut BTreeMap<usize, Option<Arc<AlphaImage>>>,
    warnings: &mut Warnings,
) -> Result<Option<AlphaTexture>, SceneError> {
    let Some((texture, source)) = texture_of(document, info)? else { return Ok(None) };
    let Some(source) = source else {
        warnings.add("alpha of textures that cannot be decoded is taken as 1", 1, Place::default());
        return Ok(None);
    };
    let image = match images.get(&source) {
        Some(known) => known.clone(),
        None => {
            let decoded = document.image(source).map(|bytes| decode_alpha(&bytes));
            let decoded = match decoded {
                Ok(Some(image)) => Some(Arc::new(image)),
                Ok(None) | Err(SceneError::NoData { .. } | SceneError::Io { .. }) => {
                    let what = format!("images[{source}]");
                    let place = Place { attribute: Some(what), ..Place::default() };
                    warnings.add("alpha of textures that cannot be decoded is taken as 1", 1, place);
                    None
                }
                Err(error) => return Err(error),
            };
            images.insert(source, decoded.clone());
            decoded
        }
    };
    let Some(image) = image else { return Ok(None) };
    Ok(Some(AlphaTexture { image, mapping: Mapping::read(document, info, texture)? }))
}

/// Decodes the alpha of an image; `None` when it cannot be decoded.
fn decode_alpha(bytes: &[u8]) -> Option<AlphaImage> {
    let decoded = decode(bytes)?;
    let size = [decoded.width() as usize, decoded.height() as usize];
    let alpha = if decoded.color().has_alpha() {
        decoded.to_rgba8().pixels().map(|p| p.0[3]).collect()
    } else {
        return Some(AlphaImage { size: [1, 1], alpha: vec![255] });
    };
    Some(AlphaImage { size, alpha })
}
