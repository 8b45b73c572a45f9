//! What all image formats share, and PNG with 8 or 16 bits a channel.
//!
//! | format | values | where |
//! |---|---|---|
//! | PNG | `0..=1`, 1 to 4 channels of 8 or 16 bits | here |
//! | EXR | any, any number of named channels, 16- or 32-bit floats | [`crate::image_exr`] |
//! | KTX2 | light, shared exponents or 16-bit floats, as a GPU takes it | [`crate::ktx2`] |
//!
//! Values are linear; PNG files carry no gamma, color-space or time chunk, so that readers take the numbers as
//! they are and the same values give the same bytes. Row 0 is v = 0, the first row of the file, as glTF has it.
//! Readers return errors for whatever is damaged, and ask for no more memory than a file of that length can fill.

use std::io::{Cursor, Write};

/// Values as read from a file.
#[derive(Clone, Debug, PartialEq)]
pub struct Image {
    /// Width and height in texels.
    pub size: [u32; 2],
    /// Values per texel.
    pub channels: usize,
    /// What the channels are called: R, G, B, A or Y, or as an EXR names them (`layer.R`).
    pub names: Vec<String>,
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
    /// A value does not fit the format; see [`intensity`].
    #[error("value {index} is {value}, the format holds {low} to {high}")]
    Range {
        /// Index into the values.
        index: usize,
        /// The value.
        value: f32,
        /// The least that the format holds.
        low: f32,
        /// The greatest.
        high: f32,
    },
    /// A file says that it holds more than its length allows.
    #[error("{bytes} bytes cannot hold an image of {} x {} texels with {channels} channels", size[0], size[1])]
    Length {
        /// Width and height.
        size: [u64; 2],
        /// Values per texel.
        channels: usize,
        /// The length of the file.
        bytes: usize,
    },
    /// The PNG coder failed.
    #[error("png could not be written")]
    PngWrite(#[from] png::EncodingError),
    /// The bytes are no PNG that can be read.
    #[error("png could not be read")]
    PngRead(#[from] png::DecodingError),
    /// The EXR coder failed.
    #[error("exr could not be written or read")]
    Exr(#[from] exr::error::Error),
    /// The bytes are no KTX2 file that can be read.
    #[error("ktx2: {what}")]
    Ktx2 {
        /// What is wrong with it.
        what: &'static str,
    },
    /// The KTX2 file could not be written.
    #[error("ktx2 could not be written")]
    Ktx2Write(#[source] std::io::Error),
}

/// Bits per channel of a PNG.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PngDepth {
    /// 8 bits.
    Eight,
    /// 16 bits.
    Sixteen,
}

/// The nearest of `steps + 1` equal steps over 0..=1; ties go up. NaN is 0.
#[inline]
pub fn quantize(value: f32, steps: u32) -> u32 {
    // In double precision, so that 16-bit ties are decided by the value and not by rounding.
    (f64::from(value).clamp(0.0, 1.0) * f64::from(steps) + 0.5).floor() as u32
}

/// The least power of two, at least 1, by which values are divided so that none exceeds `greatest`.
///
/// Light in lux does not fit 16-bit floats nor shared exponents under a bright sun. Divided by a power of two it
/// loses nothing, and viewers multiply it back (`intensity` in MOZ_lightmap). Values that are not finite are passed over.
pub fn intensity(values: &[f32], greatest: f32) -> f32 {
    let most = values.iter().filter(|v| v.is_finite()).fold(0.0_f32, |a, v| a.max(v.abs()));
    let mut intensity = 1.0;
    while most / intensity > greatest && greatest > 0.0 {
        intensity *= 2.0;
    }
    intensity
}

/// That there are as many values as the size says, all finite.
pub(crate) fn check(size: [u32; 2], channels: usize, values: &[f32]) -> Result<(), ImageError> {
    let expected = (size[0] as usize).checked_mul(size[1] as usize).and_then(|n| n.checked_mul(channels));
    if expected == Some(0) || expected != Some(values.len()) {
        return Err(ImageError::Size { size, channels, found: values.len() });
    }
    match values.iter().position(|v| !v.is_finite()) {
        Some(index) => Err(ImageError::NotFinite { index }),
        None => Ok(()),
    }
}

/// That no value lies outside of what a format holds.
pub(crate) fn check_range(values: &[f32], [low, high]: [f32; 2]) -> Result<(), ImageError> {
    match values.iter().position(|v| !(low..=high).contains(v)) {
        Some(index) => Err(ImageError::Range { index, value: values[index], low, high }),
        None => Ok(()),
    }
}

/// That a file of `bytes` can hold that many values.
///
/// - `most`: values per byte in the best case of the format's compression
pub(crate) fn check_length(
    size: [u64; 2],
    channels: usize,
    bytes: usize,
    most: usize,
) -> Result<(), ImageError> {
    let values = size[0].checked_mul(size[1]).and_then(|n| n.checked_mul(channels as u64));
    match values {
        Some(values) if values <= bytes as u64 * most as u64 => Ok(()),
        _ => Err(ImageError::Length { size, channels, bytes }),
    }
}

/// The names of 1 to 4 channels of one image: Y, YA, RGB or RGBA.
pub(crate) fn plain_names(channels: usize) -> &'static [&'static str] {
    match channels {
        1 => &["Y"],
        2 => &["Y", "A"],
        3 => &["R", "G", "B"],
        _ => &["R", "G", "B", "A"],
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
/// [`ImageError::PngRead`], and [`ImageError::Length`] for a header that promises too much.
pub fn read_png(bytes: &[u8]) -> Result<Image, ImageError> {
    let mut decoder = png::Decoder::new(Cursor::new(bytes));
    decoder.set_transformations(png::Transformations::EXPAND);
    let mut reader = decoder.read_info()?;
    // Deflate makes at most 1032 bytes of one; a bit each in the smallest depth.
    let size = [reader.info().width, reader.info().height].map(u64::from);
    check_length(size, 1, bytes.len(), 1032 * 8)?;
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
    let channels = info.color_type.samples();
    let names = plain_names(channels).iter().map(|&n| n.to_owned()).collect();
    Ok(Image { size: [info.width, info.height], channels, names, bits, values })
}

#[cfg(test)]
pub(crate) mod testing {
    use lightkiln_mesh::random;

    pub fn noise(count: usize) -> Vec<f32> {
        (0..count as u64).map(|k| random::unit(random::hash(5, k, 0, 0))).collect()
    }

    /// Calls `read` with a file cut short, with bytes changed, and with bytes taken out.
    pub fn damaged(whole: &[u8], read: impl Fn(&[u8])) {
        for length in (0..whole.len()).step_by(1 + whole.len() / 300) {
            read(&whole[..length]);
        }
        for round in 0..1500_u64 {
            let mut bytes = whole.to_vec();
            let random = |k: u64| random::hash(77, round, k, 0);
            for k in 0..1 + round % 4 {
                // Half of the changes hit the header, where they do most.
                let reach = if k % 2 == 0 { bytes.len() } else { bytes.len().min(160) };
                let at = random(3 * k) as usize % reach;
                bytes[at] = match random(3 * k + 1) % 4 {
                    0 => 0xff,
                    1 => 0,
                    2 => bytes[at] ^ (1 << (random(3 * k + 2) % 8)),
                    _ => random(3 * k + 2) as u8,
                };
            }
            if round % 5 == 0 {
                bytes.remove(random(99) as usize % bytes.len());
            }
            read(&bytes);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::testing::noise;
    use super::*;

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
        // 2^31 - 1 texels a side in 60 bytes.
        let mut huge = Vec::new();
        write_png(&mut huge, [1, 1], 1, PngDepth::Eight, &[0.5]).unwrap();
        huge[16..24].copy_from_slice(&[0x7f, 0xff, 0xff, 0xff, 0x7f, 0xff, 0xff, 0xff]);
        assert!(read_png(&huge).is_err());
    }

    #[test]
    fn png_damaged_is_an_error_or_an_image_but_no_panic() {
        for channels in [1, 3] {
            let mut whole = Vec::new();
            let values = noise(9 * 5 * channels);
            write_png(&mut whole, [9, 5], channels, PngDepth::Sixteen, &values).unwrap();
            testing::damaged(&whole, |bytes| {
                if let Ok(image) = read_png(bytes) {
                    let texels = image.size[0] as usize * image.size[1] as usize;
                    assert_eq!(image.values.len(), texels * image.channels);
                }
            });
        }
    }

    #[test]
    fn intensity_is_the_least_power_of_two() {
        assert_eq!(intensity(&[0.0, 3.0, f32::NAN], 4.0), 1.0);
        assert_eq!(intensity(&[-9.0, 3.0], 4.0), 4.0);
        assert_eq!(intensity(&[130_000.0], 65504.0), 2.0);
        assert_eq!(intensity(&[], 1.0), 1.0);
        assert_eq!(intensity(&[5.0], 0.0), 1.0);
    }

    #[test]
    fn quantize_rounds_to_nearest() {
        assert_eq!(quantize(0.5, 255), 128);
        assert_eq!(quantize(-3.0, 255), 0);
        assert_eq!(quantize(7.0, 65535), 65535);
        assert_eq!(quantize(f32::NAN, 255), 0);
    }
}
