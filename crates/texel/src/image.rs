//! Image formats: PNG with 8 or 16 bits a channel, EXR with 16- or 32-bit floats.
//!
//! Values are linear; PNG files carry no gamma, color-space or time chunk, so that readers take the numbers as
//! they are and the same values give the same bytes. Row 0 is v = 0, the first row of the file, as glTF has it.

use exr::prelude as exr;
use exr::{ReadChannels as _, ReadLayers as _, WritableImage as _};
use std::io::{Cursor, Seek, Write};

/// Values as read from a file.
#[derive(Clone, Debug, PartialEq)]
pub struct Image {
    /// Width and height in texels.
    pub size: [u32; 2],
    /// Values per texel.
    pub channels: usize,
    /// Bits per channel in the file.
    pub bits: u32,
    /// Texels x channels, row-major, first row first. From PNG: 0..=1.
    pub values: Vec<f32>,
}

/// What keeps an image from being written or read.
#[derive(Debug, thiserror::Error)]
pub enum ImageError {
    /// The number of values is not width x height x channels, or one of these is zero.
    #[error("{found} values for an image of {} x {} texels with {channels} channels", size[0], size[1])]
    Size {
        /// Width and height.
        size: [u32; 2],
        /// Values per texel.
        channels: usize,
        /// How many values there are.
        found: usize,
    },
    /// PNG holds 1 to 4 channels.
    #[error("png holds 1 to 4 channels, not {channels}")]
    Channels {
        /// Values per texel.
        channels: usize,
    },
    /// A value is NaN or infinite.
    #[error("value {index} is not finite")]
    NotFinite {
        /// Index into the values.
        index: usize,
    },
    /// The PNG coder failed.
    #[error("png could not be written")]
    PngWrite(#[from] png::EncodingError),
    /// The bytes are no PNG that can be read.
    #[error("png could not be read")]
    PngRead(#[from] png::DecodingError),
    /// The EXR coder failed.
    #[error("exr could not be written or read")]
    Exr(#[from] ::exr::error::Error),
}

/// Bits per channel of a PNG.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PngDepth {
    /// 8 bits.
    Eight,
    /// 16 bits.
    Sixteen,
}

/// Bits per channel of an EXR.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ExrDepth {
    /// 16-bit floats.
    Half,
    /// 32-bit floats.
    Single,
}

/// The nearest of `steps + 1` equal steps over 0..=1; ties go up. NaN is 0.
#[inline]
pub fn quantize(value: f32, steps: u32) -> u32 {
    // In double precision, so that 16-bit ties are decided by the value and not by rounding.
    (f64::from(value).clamp(0.0, 1.0) * f64::from(steps) + 0.5).floor() as u32
}

fn check(size: [u32; 2], channels: usize, values: &[f32]) -> Result<(), ImageError> {
    let expected = size[0] as usize * size[1] as usize * channels;
    if expected == 0 || values.len() != expected {
        return Err(ImageError::Size { size, channels, found: values.len() });
    }
    match values.iter().position(|v| !v.is_finite()) {
        Some(index) => Err(ImageError::NotFinite { index }),
        None => Ok(()),
    }
}

/// Writes a PNG: 1 channel gray, 2 gray and alpha, 3 RGB, 4 RGBA.
///
/// - `values`: texels x `channels`, row-major, linear; clamped to 0..=1 and rounded to nearest, no dithering
///
/// The same values give the same bytes.
///
/// # Errors
/// [`ImageError`] where sizes do not fit, a value is not finite, or writing fails.
pub fn write_png(
    out: impl Write,
    size: [u32; 2],
    channels: usize,
    depth: PngDepth,
    values: &[f32],
) -> Result<(), ImageError> {
    let color = match channels {
        1 => png::ColorType::Grayscale,
        2 => png::ColorType::GrayscaleAlpha,
        3 => png::ColorType::Rgb,
        4 => png::ColorType::Rgba,
        _ => return Err(ImageError::Channels { channels }),
    };
    check(size, channels, values)?;
    let mut encoder = png::Encoder::new(out, size[0], size[1]);
    encoder.set_color(color);
    encoder.set_compression(png::Compression::High);
    encoder.set_filter(png::Filter::Adaptive);
    let bytes: Vec<u8> = match depth {
        PngDepth::Eight => {
            encoder.set_depth(png::BitDepth::Eight);
            values.iter().map(|&v| quantize(v, 255) as u8).collect()
        }
        PngDepth::Sixteen => {
            encoder.set_depth(png::BitDepth::Sixteen);
            values.iter().flat_map(|&v| (quantize(v, 65535) as u16).to_be_bytes()).collect()
        }
    };
    let mut writer = encoder.write_header()?;
    writer.write_image_data(&bytes)?;
    Ok(writer.finish()?)
}

/// Reads a PNG of any kind; palettes and low depths are expanded. Values are 0..=1, as stored (no gamma).
///
/// # Errors
/// [`ImageError::PngRead`].
pub fn read_png(bytes: &[u8]) -> Result<Image, ImageError> {
    let mut decoder = png::Decoder::new(Cursor::new(bytes));
    decoder.set_transformations(png::Transformations::EXPAND);
    let mut reader = decoder.read_info()?;
    let length = reader.output_buffer_size().ok_or(png::DecodingError::LimitsExceeded)?;
    let mut data = vec![0; length];
    let info = reader.next_frame(&mut data)?;
    data.truncate(info.buffer_size());
    let (bits, values) = match info.bit_depth {
        png::BitDepth::Sixteen => {
            let value = |b: &[u8]| f32::from(u16::from_be_bytes([b[0], b[1]])) / 65535.0;
            (16, data.chunks_exact(2).map(value).collect())
        }
        _ => (8, data.iter().map(|&b| f32::from(b) / 255.0).collect()),
    };
    Ok(Image { size: [info.width, info.height], channels: info.color_type.samples(), bits, values })
}

/// The names of EXR channels: Y, RGB or RGBA, and numbered ones otherwise.
fn exr_names(channels: usize) -> Vec<String> {
    let named = |names: &[&str]| names.iter().map(|n| (*n).to_owned()).collect();
    match channels {
        1 => named(&["Y"]),
        3 => named(&["R", "G", "B"]),
        4 => named(&["R", "G", "B", "A"]),
        // Zero-padded: EXR sorts channels by name.
        _ => (0..channels).map(|c| format!("light.{c:04}")).collect(),
    }
}

/// Writes an EXR with any number of channels, losslessly compressed.
///
/// - `values`: texels x `channels`, row-major, linear, any range; halves round to nearest
///
/// # Errors
/// [`ImageError`] where sizes do not fit, a value is not finite, or writing fails.
pub fn write_exr(
    out: impl Write + Seek,
    size: [u32; 2],
    channels: usize,
    depth: ExrDepth,
    values: &[f32],
) -> Result<(), ImageError> {
    check(size, channels, values)?;
    let list: Vec<exr::AnyChannel<exr::FlatSamples>> = exr_names(channels)
        .into_iter()
        .enumerate()
        .map(|(c, name)| {
            let channel = values.iter().skip(c).step_by(channels).copied();
            let samples = match depth {
                ExrDepth::Half => exr::FlatSamples::F16(channel.map(exr::f16::from_f32).collect()),
                ExrDepth::Single => exr::FlatSamples::F32(channel.collect()),
            };
            exr::AnyChannel::new(name.as_str(), samples)
        })
        .collect();
    let layer = exr::Layer::new(
        exr::Vec2(size[0] as usize, size[1] as usize),
        exr::LayerAttributes::named("light"),
        exr::Encoding::SMALL_LOSSLESS,
        exr::AnyChannels::sort(list.into()),
    );
    Ok(exr::Image::from_layer(layer).write().non_parallel().to_buffered(out)?)
}

/// Reads the first layer of an EXR. Channels come as [`write_exr`] writes them, others in order of their names.
///
/// # Errors
/// [`ImageError::Exr`].
pub fn read_exr(bytes: &[u8]) -> Result<Image, ImageError> {
    let image = exr::read()
        .no_deep_data()
        .largest_resolution_level()
        .all_channels()
        .first_valid_layer()
        .all_attributes()
        .non_parallel()
        .from_buffered(Cursor::new(bytes))?;
    let layer = image.layer_data;
    let list = layer.channel_data.list;
    let names = exr_names(list.len());
    let find = |name: &str| list.iter().position(|c| c.name.eq_case_insensitive(name));
    let order: Option<Vec<usize>> = names.iter().map(|n| find(n)).collect();
    let order = order.unwrap_or_else(|| (0..list.len()).collect());
    let size = [layer.size.0 as u32, layer.size.1 as u32];
    let mut values = vec![0.0; layer.size.0 * layer.size.1 * list.len()];
    let mut bits = 16;
    for (c, &from) in order.iter().enumerate() {
        if !matches!(list[from].sample_data, exr::FlatSamples::F16(_)) {
            bits = 32;
        }
        for (texel, value) in list[from].sample_data.values_as_f32().enumerate() {
            values[texel * list.len() + c] = value;
        }
    }
    Ok(Image { size, channels: list.len(), bits, values })
}

#[cfg(test)]
mod tests {
    use super::*;
    use lightkiln_mesh::random;

    fn noise(count: usize) -> Vec<f32> {
        (0..count as u64).map(|k| random::unit(random::hash(5, k, 0, 0))).collect()
    }

    #[test]
    fn png_round_trip_is_within_half_a_step() {
        for channels in 1..=4 {
            for (depth, steps) in [(PngDepth::Eight, 255.0), (PngDepth::Sixteen, 65535.0)] {
                let values = noise(13 * 7 * channels);
                let mut bytes = Vec::new();
                write_png(&mut bytes, [13, 7], channels, depth, &values).unwrap();
                let image = read_png(&bytes).unwrap();
                assert_eq!((image.size, image.channels), ([13, 7], channels));
                for (a, b) in values.iter().zip(&image.values) {
                    assert!((a - b).abs() <= 0.5 / steps + 1e-7);
                }
                let mut again = Vec::new();
                write_png(&mut again, [13, 7], channels, depth, &image.values).unwrap();
                assert_eq!(bytes, again, "what was read is written to the same bytes");
                assert!(
                    !bytes
                        .windows(4)
                        .any(|w| [b"gAMA", b"sRGB", b"iCCP", b"tIME"].contains(&w.try_into().unwrap()))
                );
            }
        }
    }

    #[test]
    fn exr_round_trip_is_exact_or_half() {
        for channels in [1, 2, 3, 4, 12] {
            let values: Vec<f32> = noise(5 * 3 * channels).iter().map(|v| v * 40.0 - 7.0).collect();
            for depth in [ExrDepth::Single, ExrDepth::Half] {
                let mut bytes = Cursor::new(Vec::new());
                write_exr(&mut bytes, [5, 3], channels, depth, &values).unwrap();
                let image = read_exr(bytes.get_ref()).unwrap();
                assert_eq!((image.size, image.channels), ([5, 3], channels));
                for (a, b) in values.iter().zip(&image.values) {
                    let step = if depth == ExrDepth::Half { 1e-3 * a.abs() } else { 0.0 };
                    assert!((a - b).abs() <= step, "{a} {b}");
                }
            }
        }
    }

    #[test]
    fn images_refuse_what_does_not_fit() {
        let mut out = Vec::new();
        assert!(matches!(
            write_png(&mut out, [2, 2], 5, PngDepth::Eight, &[]),
            Err(ImageError::Channels { .. })
        ));
        assert!(matches!(
            write_png(&mut out, [2, 2], 1, PngDepth::Eight, &[0.0]),
            Err(ImageError::Size { .. })
        ));
        assert!(matches!(write_png(&mut out, [0, 2], 1, PngDepth::Eight, &[]), Err(ImageError::Size { .. })));
        let nan = write_png(&mut out, [1, 1], 1, PngDepth::Eight, &[f32::NAN]);
        assert!(matches!(nan, Err(ImageError::NotFinite { index: 0 })));
        assert!(matches!(read_png(b"no png"), Err(ImageError::PngRead(_))));
        assert!(read_exr(b"no exr").is_err());
    }

    #[test]
    fn quantize_rounds_to_nearest() {
        assert_eq!(quantize(0.5, 255), 128);
        assert_eq!(quantize(-3.0, 255), 0);
        assert_eq!(quantize(7.0, 65535), 65535);
        assert_eq!(quantize(f32::NAN, 255), 0);
    }
}
