//! Environment maps: light from infinitely far, as a latitude-longitude image.
//!
//! Radiance HDR and OpenEXR hold radiance; PNG, JPEG and WebP are taken for sRGB, with a warning, because they
//! cut off what is bright. Deviation: primaries other than those of sRGB (EXR `chromaticities`, HDR `PRIMARIES`) are
//! taken for these, and so is anything that is no latitude-longitude image.

use std::io::Cursor;
use std::path::Path;

use image::codecs::hdr::HdrDecoder;
use image::codecs::openexr::OpenExrDecoder;
use image::{DynamicImage, ImageDecoder, ImageFormat, ImageReader, Limits};

use crate::error::{Place, SceneError, Warning, Warnings};
use crate::srgb::linear;

/// More pixels than this are refused: 16384 x 8192, 1.5 GiB.
const MAX_PIXELS: u64 = 1 << 27;

/// An environment map.
#[derive(Clone, Debug, PartialEq)]
pub struct Environment {
    /// Pixels around the horizon, at least 1.
    pub width: usize,
    /// Pixels from zenith to nadir, at least 1.
    pub height: usize,
    /// Linear RGB, finite, at least 0; row by row from the zenith (+y), as in the image.
    pub pixels: Vec<[f32; 3]>,
    /// What may not be as it was meant.
    pub warnings: Vec<Warning>,
}

/// Reads an environment map: Radiance HDR or OpenEXR; PNG, JPEG and WebP with a warning.
///
/// # Errors
/// [`SceneError::Io`] for files that cannot be read, [`SceneError::Environment`] for anything that is no such image,
/// [`SceneError::EnvironmentPixel`] for the first pixel that is NaN, infinite or negative, and
/// [`SceneError::TooLarge`].
pub fn read_environment(path: &Path) -> Result<Environment, SceneError> {
    let read = || {
        let bytes = std::fs::read(path).map_err(|source| SceneError::Io {
            action: "read",
            path: path.to_owned(),
            source,
            place: Box::default(),
        })?;
        decode_environment(&bytes)
    };
    read().map_err(|e| e.at(|p| p.file = Some(path.to_owned())))
}

/// [`read_environment`] from memory.
///
/// # Errors
/// As there, but for reading.
pub fn decode_environment(bytes: &[u8]) -> Result<Environment, SceneError> {
    let mut warnings = Warnings::default();
    let decoded = if bytes.starts_with(b"#?") {
        decode_radiance(bytes)?
    } else {
        match image::guess_format(bytes) {
            Ok(ImageFormat::OpenExr) => {
                let decoder = OpenExrDecoder::with_alpha_preference(Cursor::new(bytes), Some(false));
                pixels(decoder.map_err(|e| broken("OpenEXR", &e))?, "OpenEXR", bytes)?
            }
            Ok(format @ (ImageFormat::Png | ImageFormat::Jpeg | ImageFormat::WebP)) => {
                let message = "the environment is an image of 8 or 16 bits, taken for sRGB: what is brighter than white is cut off";
                warnings.add(message, 1, Place::default());
                let name = match format {
                    ImageFormat::Png => "PNG",
                    ImageFormat::Jpeg => "JPEG",
                    _ => "WebP",
                };
                let reader = ImageReader::with_format(Cursor::new(bytes), format);
                let (size, values) =
                    pixels(reader.into_decoder().map_err(|e| broken(name, &e))?, name, bytes)?;
                (size, values.into_iter().map(|p| p.map(linear)).collect())
            }
            _ if bytes.is_empty() => return Err(wrong("the file is empty")),
            _ if bytes.starts_with(b"version https://git-lfs") => {
                return Err(wrong("it is a Git LFS pointer, not the file itself"));
            }
            _ => return Err(wrong("it is neither Radiance HDR nor OpenEXR, nor PNG, JPEG or WebP")),
        }
    };
    let ([width, height], pixels) = decoded;
    if let Some(bad) = pixels.iter().position(|p| !p.iter().all(|c| c.is_finite() && *c >= 0.0)) {
        let (x, y) = (bad % width, bad / width);
        return Err(SceneError::EnvironmentPixel { x, y, value: pixels[bad], place: Box::default() });
    }
    if width != 2 * height {
        let message = format!(
            "the environment has {width} x {height} pixels, not twice as many across as down: it is taken for a \
             latitude-longitude image nevertheless"
        );
        warnings.add(message, 1, Place::default());
    }
    if pixels.iter().all(|p| *p == [0.0; 3]) {
        warnings.add("the environment is black", 1, Place::default());
    }
    Ok(Environment { width, height, pixels, warnings: warnings.0 })
}

fn wrong(reason: impl Into<String>) -> SceneError {
    SceneError::Environment { reason: reason.into(), place: Box::default() }
}

fn broken(name: &str, error: &dyn std::fmt::Display) -> SceneError {
    let mut text = error.to_string().replace('\n', " ");
    if let Some((end, _)) = text.char_indices().nth(200) {
        text.truncate(end);
    }
    wrong(format!("the {name} data does not decode: {text}"))
}

type Pixels = ([usize; 2], Vec<[f32; 3]>);

fn decode_radiance(bytes: &[u8]) -> Result<Pixels, SceneError> {
    let decoder = HdrDecoder::new_nonstrict(Cursor::new(bytes)).map_err(|e| broken("Radiance", &e))?;
    let header = decoder.metadata();
    // The file says what its pixels were multiplied by.
    let exposure = header.exposure.unwrap_or(1.0);
    let color = header.color_correction.unwrap_or((1.0, 1.0, 1.0));
    let scale = [color.0, color.1, color.2].map(|c| 1.0 / (c * exposure));
    if scale.iter().any(|s| !s.is_finite() || *s <= 0.0) {
        return Err(wrong(format!("its EXPOSURE ({exposure}) or COLORCORR is no positive number")));
    }
    let (size, mut values) = pixels(decoder, "Radiance", bytes)?;
    for value in &mut values {
        *value = [0, 1, 2].map(|c| value[c] * scale[c]);
    }
    Ok((size, values))
}

/// Decodes into three floats a pixel, after a look at the size.
fn pixels(mut decoder: impl ImageDecoder, name: &str, bytes: &[u8]) -> Result<Pixels, SceneError> {
    let (width, height) = decoder.dimensions();
    let count = u64::from(width) * u64::from(height);
    if count == 0 {
        return Err(wrong(format!("it has {width} x {height} pixels")));
    }
    if count > MAX_PIXELS {
        let limit = MAX_PIXELS;
        return Err(SceneError::TooLarge {
            what: "pixels of an environment",
            count,
            limit,
            place: Box::default(),
        });
    }
    // Nothing compresses this well but a header that lies.
    if count / 4096 > bytes.len() as u64 {
        return Err(wrong(format!("it promises {width} x {height} pixels in {} bytes", bytes.len())));
    }
    let mut limits = Limits::default();
    limits.max_alloc = Some(4 << 30);
    decoder.set_limits(limits).map_err(|e| broken(name, &e))?;
    let decoded = DynamicImage::from_decoder(decoder).map_err(|e| broken(name, &e))?.into_rgb32f().into_raw();
    let values = decoded.chunks_exact(3).map(|p| [p[0], p[1], p[2]]).collect();
    Ok(([width as usize, height as usize], values))
}
