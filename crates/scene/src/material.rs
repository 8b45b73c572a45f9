//! Materials as far as light passes through them: alpha, transmission, and which sides are drawn.

use std::collections::BTreeMap;
use std::io::Cursor;
use std::sync::Arc;

use serde_json::Value;

use crate::document::{Document, extension, index, integer, name, number, numbers};
use crate::error::{Place, SceneError, Warnings};

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
    /// The `TEXCOORD_n` that it uses.
    pub set: u64,
    wrap: [Wrap; 2],
    /// Rows of the affine map of texture coordinates (KHR_texture_transform).
    transform: [[f32; 3]; 2],
}

#[derive(Debug)]
struct AlphaImage {
    size: [usize; 2],
    alpha: Vec<u8>,
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Wrap {
    Clamp,
    Mirror,
    Repeat,
}

impl Wrap {
    fn texel(self, i: i64, size: usize) -> usize {
        let n = size as i64;
        (match self {
            Self::Clamp => i.clamp(0, n - 1),
            Self::Repeat => i.rem_euclid(n),
            Self::Mirror => {
                let j = i.rem_euclid(2 * n);
                if j < n { j } else { 2 * n - 1 - j }
            }
        }) as usize
    }
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
    fn sample(&self, [u, v]: [f32; 2]) -> f32 {
        let at = self.transform.map(|[a, b, c]| a * u + b * v + c);
        let mut cell = [0_i64; 2];
        let mut part = [0.0_f32; 2];
        for k in 0..2 {
            // Huge coordinates have no texel precision left; the cast saturates.
            let x = at[k] * self.image.size[k] as f32 - 0.5;
            let x = if x.is_finite() { x.clamp(-1e9, 1e9) } else { 0.0 };
            cell[k] = x.floor() as i64;
            part[k] = x - x.floor();
        }
        let [w, h] = self.image.size;
        let texel = |dx: i64, dy: i64| {
            let x = self.wrap[0].texel(cell[0] + dx, w);
            let y = self.wrap[1].texel(cell[1] + dy, h);
            f32::from(self.image.alpha[y * w + x]) / 255.0
        };
        let mix = |a: f32, b: f32, t: f32| a + (b - a) * t;
        mix(mix(texel(0, 0), texel(1, 0), part[0]), mix(texel(0, 1), texel(1, 1), part[0]), part[1])
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
    let textures = document.list("textures");
    let Some(texture) = index(info, "index", textures.len())?.map(|t| &textures[t]) else { return Ok(None) };
    let count = document.list("images").len();
    let source = match index(texture, "source", count)? {
        Some(source) => Some(source),
        None => match extension(texture, "EXT_texture_webp") {
            Some(webp) => index(webp, "source", count)?,
            None => None,
        },
    };
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
    let samplers = document.list("samplers");
    let none = Value::Null;
    let sampler = index(texture, "sampler", samplers.len())?.map_or(&none, |s| &samplers[s]);
    let wrap = |key| -> Result<Wrap, SceneError> {
        Ok(match integer(sampler, key)?.unwrap_or(10497) {
            33071 => Wrap::Clamp,
            33648 => Wrap::Mirror,
            _ => Wrap::Repeat,
        })
    };
    let mut set = integer(info, "texCoord")?.unwrap_or(0);
    let mut transform = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
    if let Some(t) = extension(info, "KHR_texture_transform") {
        set = integer(t, "texCoord")?.unwrap_or(set);
        let offset = numbers::<2>(t, "offset")?.unwrap_or([0.0; 2]).map(|v| v as f32);
        let scale = numbers::<2>(t, "scale")?.unwrap_or([1.0; 2]).map(|v| v as f32);
        // Counter-clockwise in an image whose v points down.
        let (sin, cos) = number(t, "rotation", 0.0).sin_cos();
        transform =
            [[cos * scale[0], sin * scale[1], offset[0]], [-sin * scale[0], cos * scale[1], offset[1]]];
    }
    Ok(Some(AlphaTexture { image, set, wrap: [wrap("wrapS")?, wrap("wrapT")?], transform }))
}

/// Decodes the alpha of an image; `None` when it cannot be decoded.
fn decode_alpha(bytes: &[u8]) -> Option<AlphaImage> {
    let mut reader = image::ImageReader::new(Cursor::new(bytes)).with_guessed_format().ok()?;
    let mut limits = image::Limits::default();
    limits.max_image_width = Some(32768);
    limits.max_image_height = Some(32768);
    limits.max_alloc = Some(1 << 30);
    reader.limits(limits);
    let decoded = reader.decode().ok()?;
    let size = [decoded.width() as usize, decoded.height() as usize];
    if size.contains(&0) {
        return None;
    }
    let alpha = if decoded.color().has_alpha() {
        decoded.to_rgba8().pixels().map(|p| p.0[3]).collect()
    } else {
        return Some(AlphaImage { size: [1, 1], alpha: vec![255] });
    };
    Some(AlphaImage { size, alpha })
}
