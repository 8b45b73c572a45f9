//! Images of materials: each is decoded once, and only the channels that somebody looks at are kept, 8 bits a
//! channel.
//!
//! Colors, and metalness with roughness, are kept at no more than [`COLOR_TEXELS`] texels a side: they feed bounced
//! light, which has no use of finer detail, and a file with sixty images of 4096² would fill memory by them alone.
//! Coverage and transmission keep every texel, as they draw the outlines of shadows.

use std::collections::BTreeMap;
use std::io::Cursor;
use std::sync::{Arc, LazyLock};

use glam::Vec3;
use image::ImageFormat;
use rayon::prelude::*;

use crate::document::{Document, extension, name};
use crate::error::{Place, SceneError, Warnings};
use crate::srgb::{self, linear};
use crate::texture::Mapping;

/// Texels a side beyond which colors are averaged down.
const COLOR_TEXELS: usize = 1024;

/// The 256 values of an 8-bit sRGB channel, linear.
static LINEAR: LazyLock<[f32; 256]> = LazyLock::new(|| std::array::from_fn(|i| linear(i as f32 / 255.0)));

/// Channels of an image that somebody looks at.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Wanted {
    pub alpha: bool,
    pub color: bool,
    pub red: bool,
    /// All three channels, which are no color.
    pub plain: bool,
}

/// A decoded image, as far as it was wanted.
#[derive(Clone, Debug, Default)]
pub(crate) struct Channels {
    pub alpha: Option<Arc<Plane>>,
    pub color: Option<Arc<Colors>>,
    pub red: Option<Arc<Plane>>,
    pub plain: Option<Arc<Colors>>,
}

/// One channel, linear.
#[derive(Debug)]
pub(crate) struct Plane {
    size: [usize; 2],
    values: Vec<u8>,
}

/// Three channels.
#[derive(Debug)]
pub(crate) struct Colors {
    size: [usize; 2],
    coding: Coding,
    values: Vec<[u8; 3]>,
}

/// What the 8 bits of a channel are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Coding {
    /// sRGB, as colors are.
    Color,
    /// A share, as the file has it.
    Plain,
}

impl Coding {
    fn decode(self, rgb: [u8; 3]) -> Vec3 {
        Vec3::from_array(match self {
            Self::Color => rgb.map(|c| LINEAR[usize::from(c)]),
            Self::Plain => rgb.map(|c| f32::from(c) / 255.0),
        })
    }

    fn encode(self, value: Vec3) -> [u8; 3] {
        match self {
            Self::Color => value.to_array().map(encoded),
            Self::Plain => value.to_array().map(|v| (v.clamp(0.0, 1.0) * 255.0).round() as u8),
        }
    }
}

/// An image and how a material looks it up: bilinearly, at the level that is kept.
#[derive(Debug)]
pub(crate) struct Sampled<I> {
    pub image: Arc<I>,
    pub mapping: Mapping,
}

impl<I> Clone for Sampled<I> {
    fn clone(&self) -> Self {
        Self { image: Arc::clone(&self.image), mapping: self.mapping.clone() }
    }
}

impl Sampled<Plane> {
    /// 0..=1.
    pub fn at(&self, uv: [f32; 2]) -> f32 {
        let size = self.image.size;
        self.mapping.cell(uv, size).mix(|x, y| f32::from(self.image.values[y * size[0] + x]) / 255.0)
    }
}

impl Sampled<Colors> {
    /// Linear, 0..=1.
    pub fn at(&self, uv: [f32; 2]) -> Vec3 {
        let size = self.image.size;
        let texel = |x, y| self.image.coding.decode(self.image.values[y * size[0] + x]);
        self.mapping.cell(uv, size).mix(texel)
    }

    /// Texels that a triangle covers, by the area between its texture coordinates.
    pub fn texels(&self, corners: [[f32; 2]; 3]) -> f32 {
        self.mapping.texel_area(corners, self.image.size)
    }
}

/// Decodes images in parallel; `None` for those that cannot be, with a warning that names the first.
///
/// # Errors
/// What is wrong with the file beyond the image: views and references that do not exist, paths outside of it.
pub(crate) fn decode_all(
    document: &Document,
    wanted: &BTreeMap<usize, Wanted>,
    warnings: &mut Warnings,
) -> Result<BTreeMap<usize, Option<Channels>>, SceneError> {
    let wanted: Vec<(usize, Wanted)> = wanted.iter().map(|(&image, &wanted)| (image, wanted)).collect();
    let decoded: Vec<Result<Option<Channels>, SceneError>> = wanted
        .par_iter()
        .map(|&(image, wanted)| match document.image(image) {
            Ok(bytes) => Ok(decode(&bytes).map(|pixels| channels(&pixels, wanted))),
            Err(SceneError::NoData { .. } | SceneError::Io { .. }) => Ok(None),
            Err(error) => Err(error),
        })
        .collect();
    let mut out = BTreeMap::new();
    for ((image, wanted), decoded) in wanted.into_iter().zip(decoded) {
        let decoded = decoded.map_err(|e| e.at(|p| *p = image_place(document, image)))?;
        if decoded.is_none() {
            warn(wanted, image_place(document, image), warnings);
        }
        out.insert(image, decoded);
    }
    Ok(out)
}

/// Warns of an image that no use can be made of.
pub(crate) fn warn(wanted: Wanted, place: Place, warnings: &mut Warnings) {
    if wanted.alpha {
        warnings.add("alpha of textures that cannot be decoded is taken as 1", 1, place.clone());
    }
    if wanted.color || wanted.red || wanted.plain {
        let message =
            "textures that cannot be decoded (no PNG, JPEG or WebP) are left out; their factor is used";
        warnings.add(message, 1, place);
    }
}

/// The place of an image, with its name.
pub(crate) fn image_place(document: &Document, image: usize) -> Place {
    let json = document.list("images").get(image);
    let text = |key: &str| json?.get(key)?.as_str().filter(|t| t.len() < 200 && !t.starts_with("data:"));
    let called = json.and_then(name).or_else(|| text("uri").or_else(|| text("mimeType")).map(str::to_owned));
    let attribute = match called {
        Some(called) => format!("images[{image}] \"{called}\""),
        None => format!("images[{image}]"),
    };
    Place { attribute: Some(attribute), ..Place::default() }
}

/// The image of a texture that has none in a format of glTF itself: KTX2, AVIF, DDS.
pub(crate) fn foreign_source(document: &Document, texture: &serde_json::Value) -> Option<usize> {
    ["KHR_texture_basisu", "EXT_texture_avif", "MSFT_texture_dds", "EXT_texture_astc"].iter().find_map(
        |name| {
            let count = document.list("images").len();
            crate::document::index(extension(texture, name)?, "source", count).ok().flatten()
        },
    )
}

/// Decodes an image of glTF: PNG, JPEG or WebP; `None` when it cannot be decoded.
pub(crate) fn decode(bytes: &[u8]) -> Option<image::DynamicImage> {
    let format = image::guess_format(bytes).ok()?;
    if !matches!(format, ImageFormat::Png | ImageFormat::Jpeg | ImageFormat::WebP) {
        return None;
    }
    let mut reader = image::ImageReader::with_format(Cursor::new(bytes), format);
    let mut limits = image::Limits::default();
    limits.max_image_width = Some(32768);
    limits.max_image_height = Some(32768);
    limits.max_alloc = Some(1 << 30);
    reader.limits(limits);
    let decoded = reader.decode().ok()?;
    (decoded.width() > 0 && decoded.height() > 0).then_some(decoded)
}

fn channels(pixels: &image::DynamicImage, wanted: Wanted) -> Channels {
    let size = [pixels.width() as usize, pixels.height() as usize];
    let mut out = Channels::default();
    let has_alpha = pixels.color().has_alpha();
    if wanted.alpha && !has_alpha {
        out.alpha = Some(Arc::new(Plane { size: [1, 1], values: vec![255] }));
    }
    if wanted.alpha && has_alpha {
        let values = pixels.to_rgba8().pixels().map(|p| p.0[3]).collect();
        out.alpha = Some(Arc::new(Plane { size, values }));
    }
    if wanted.color || wanted.red || wanted.plain {
        let rgb = pixels.to_rgb8();
        if wanted.red {
            let values = rgb.pixels().map(|p| p.0[0]).collect();
            out.red = Some(Arc::new(Plane { size, values }));
        }
        let all = |coding| Some(Arc::new(averaged(size, coding, rgb.pixels().map(|p| p.0).collect())));
        if wanted.color {
            out.color = all(Coding::Color);
        }
        if wanted.plain {
            out.plain = all(Coding::Plain);
        }
    }
    out
}

/// Means over whole blocks, taken of linear values, until no side is too long.
fn averaged(size: [usize; 2], coding: Coding, values: Vec<[u8; 3]>) -> Colors {
    let block = size.map(|n| n.div_ceil(COLOR_TEXELS));
    if block == [1, 1] {
        return Colors { size, coding, values };
    }
    let small = [0, 1].map(|k| size[k].div_ceil(block[k]));
    let mut out = Vec::with_capacity(small[0] * small[1]);
    for y in 0..small[1] {
        for x in 0..small[0] {
            let [left, top] = [x * block[0], y * block[1]];
            let [right, bottom] = [(left + block[0]).min(size[0]), (top + block[1]).min(size[1])];
            let mut sum = Vec3::ZERO;
            for row in top..bottom {
                for &rgb in &values[row * size[0] + left..row * size[0] + right] {
                    sum += coding.decode(rgb);
                }
            }
            let mean = sum / ((right - left) * (bottom - top)) as f32;
            out.push(coding.encode(mean));
        }
    }
    Colors { size: small, coding, values: out }
}

/// The 8-bit sRGB value of a linear one.
fn encoded(linear: f32) -> u8 {
    (srgb::encoded(linear).clamp(0.0, 1.0) * 255.0).round() as u8
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn images_encoded_undoes_linear() {
        for i in 0..=255_u8 {
            assert_eq!(encoded(LINEAR[usize::from(i)]), i);
        }
    }

    #[test]
    fn images_averaged_keeps_the_light() {
        // Columns of black and white: half the light, not half the code.
        let size = [2 * COLOR_TEXELS, 3];
        let column = |i| [if i % 2 == 0 { 255 } else { 0 }; 3];
        let values: Vec<[u8; 3]> = (0..size[0] * size[1]).map(column).collect();
        let small = averaged(size, Coding::Color, values.clone());
        assert_eq!(small.size, [COLOR_TEXELS, 3]);
        assert!(small.values.iter().all(|v| *v == [188; 3]));
        let plain = averaged(size, Coding::Plain, values);
        assert!(plain.values.iter().all(|v| *v == [128; 3]));
        let odd = averaged([COLOR_TEXELS + 1, 1], Coding::Color, vec![[9, 9, 9]; COLOR_TEXELS + 1]);
        assert_eq!(odd.size, [COLOR_TEXELS / 2 + 1, 1]);
        assert!(odd.values.iter().all(|v| *v == [9; 3]));
    }

    #[test]
    fn images_decode_refuses_other_formats() {
        assert!(decode(b"").is_none());
        assert!(decode(b"#?RADIANCE\n").is_none());
        assert!(decode(&[0xab, b'K', b'T', b'X', b' ', b'2', b'0']).is_none());
    }
}
