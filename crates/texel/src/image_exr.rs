//! EXR: any number of named channels of 16- or 32-bit floats, losslessly compressed.
//!
//! Channels of an unnamed layer are Y, or R, G and B (and A); those of a named layer `direct` are `direct.R` and so
//! on, as programs for compositing group them. What has neither 1, 3 nor 4 channels is numbered.

use std::io::{Cursor, Seek, Write};

use exr::prelude as exr;
use exr::{ReadChannels as _, ReadLayers as _, WritableImage as _};

use crate::image::{Image, ImageError, check, check_length, check_range};

/// Bits per channel of an EXR.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ExrDepth {
    /// 16-bit floats, to 65504.
    Half,
    /// 32-bit floats.
    Single,
}

/// The greatest value of a 16-bit float.
pub const LARGEST_HALF: f32 = 65504.0;

/// Channels that belong together.
#[derive(Clone, Copy, Debug)]
pub struct ExrLayer<'a> {
    /// What it is called; may be empty. Dots, if any, are taken for layers of layers.
    pub name: &'a str,
    /// Values per texel.
    pub channels: usize,
    /// Texels x `channels`, row-major.
    pub values: &'a [f32],
}

impl ExrLayer<'_> {
    fn channel_name(&self, channel: usize) -> String {
        let plain = match self.channels {
            1 => "Y".to_owned(),
            3 | 4 => ["R", "G", "B", "A"][channel].to_owned(),
            // Zero-padded: EXR sorts channels by name.
            _ => format!("{channel:04}"),
        };
        match self.name {
            "" if self.channels == 2 || self.channels > 4 => format!("light.{plain}"),
            "" => plain,
            name => format!("{name}.{plain}"),
        }
    }
}

/// Writes an EXR of one unnamed layer: [`write_exr_layers`].
///
/// - `values`: texels x `channels`, row-major, linear, any range; halves round to nearest
///
/// # Errors
/// As [`write_exr_layers`].
pub fn write_exr(
    out: impl Write + Seek,
    size: [u32; 2],
    channels: usize,
    depth: ExrDepth,
    values: &[f32],
) -> Result<(), ImageError> {
    write_exr_layers(out, size, depth, &[ExrLayer { name: "", channels, values }])
}

/// Writes the channels of all layers into one EXR image.
///
/// # Errors
/// [`ImageError`] where sizes do not fit, a value is not finite or not within what a half holds, two channels have
/// one name, or writing fails.
pub fn write_exr_layers(
    out: impl Write + Seek,
    size: [u32; 2],
    depth: ExrDepth,
    layers: &[ExrLayer<'_>],
) -> Result<(), ImageError> {
    if layers.is_empty() {
        return Err(ImageError::Size { size, channels: 0, found: 0 });
    }
    let mut list = Vec::new();
    for layer in layers {
        check(size, layer.channels, layer.values)?;
        if depth == ExrDepth::Half {
            check_range(layer.values, [-LARGEST_HALF, LARGEST_HALF])?;
        }
        for c in 0..layer.channels {
            let channel = layer.values.iter().skip(c).step_by(layer.channels).copied();
            let samples = match depth {
                ExrDepth::Half => exr::FlatSamples::F16(channel.map(exr::f16::from_f32).collect()),
                ExrDepth::Single => exr::FlatSamples::F32(channel.collect()),
            };
            // Not every string is a name: they are bytes of Latin.
            let name = exr::Text::new_or_none(layer.channel_name(c))
                .ok_or(::exr::error::Error::Invalid("name of a layer".into()))?;
            list.push(exr::AnyChannel::new(name, samples));
        }
    }
    let layer = exr::Layer::new(
        exr::Vec2(size[0] as usize, size[1] as usize),
        exr::LayerAttributes::named("light"),
        exr::Encoding::SMALL_LOSSLESS,
        exr::AnyChannels::sort(list.into()),
    );
    Ok(exr::Image::from_layer(layer).write().non_parallel().to_buffered(out)?)
}

/// Sorts channels by layer, and within it Y, R, G, B, A before all others.
fn rank(name: &str) -> (String, usize, String) {
    let (layer, plain) = name.rsplit_once('.').unwrap_or(("", name));
    let place = ["Y", "R", "G", "B", "A"].iter().position(|n| n.eq_ignore_ascii_case(plain));
    (layer.to_owned(), place.unwrap_or(5), plain.to_owned())
}

/// Reads the first image of an EXR: layers in order of their names, and in each Y, R, G, B, A and then the others.
///
/// # Errors
/// [`ImageError::Exr`], and [`ImageError::Length`] for a header that promises too much.
pub fn read_exr(bytes: &[u8]) -> Result<Image, ImageError> {
    let meta = ::exr::meta::MetaData::read_from_buffered(Cursor::new(bytes), false)?;
    for header in &meta.headers {
        let size = [header.layer_size.0 as u64, header.layer_size.1 as u64];
        // No method of EXR makes more of a byte than ZIP, of which 1032 is the limit.
        check_length(size, header.channels.list.len(), bytes.len(), 1032)?;
    }
    let image = exr::read()
        .no_deep_data()
        .largest_resolution_level()
        .all_channels()
        .first_valid_layer()
        .all_attributes()
        .non_parallel()
        .from_buffered(Cursor::new(bytes))?;
    let layer = image.layer_data;
    let mut list: Vec<_> = layer.channel_data.list.iter().map(|c| (rank(&c.name.to_string()), c)).collect();
    list.sort_by(|a, b| a.0.cmp(&b.0));
    let size = [layer.size.0 as u32, layer.size.1 as u32];
    let mut values = vec![0.0; layer.size.0 * layer.size.1 * list.len()];
    let mut bits = 16;
    for (c, (_, channel)) in list.iter().enumerate() {
        if !matches!(channel.sample_data, exr::FlatSamples::F16(_)) {
            bits = 32;
        }
        // Channels of fewer samples than texels leave zeros.
        for (texel, value) in values.chunks_exact_mut(list.len()).zip(channel.sample_data.values_as_f32()) {
            texel[c] = value;
        }
    }
    let names = list.iter().map(|(_, channel)| channel.name.to_string()).collect();
    Ok(Image { size, channels: list.len(), names, bits, values })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::testing::{damaged, noise};

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
    fn exr_layers_keep_their_names_and_order() {
        let (light, sh) = (noise(4 * 2 * 3), noise(4 * 2 * 9));
        let layers = [
            ExrLayer { name: "direct", channels: 3, values: &light },
            ExrLayer { name: "", channels: 1, values: &light[..8] },
            ExrLayer { name: "sh", channels: 9, values: &sh },
        ];
        let mut bytes = Cursor::new(Vec::new());
        write_exr_layers(&mut bytes, [4, 2], ExrDepth::Single, &layers).unwrap();
        let image = read_exr(bytes.get_ref()).unwrap();
        let names = ["Y", "direct.R", "direct.G", "direct.B", "sh.0000", "sh.0001", "sh.0002"];
        assert_eq!(image.names[..7], names);
        assert_eq!(image.channels, 13);
        for t in 0..8 {
            let texel = &image.values[t * 13..][..13];
            assert_eq!(texel[0], light[t]);
            assert_eq!(texel[1..4], light[3 * t..3 * t + 3]);
            assert_eq!(texel[4..], sh[9 * t..9 * t + 9]);
        }
    }

    #[test]
    fn exr_refuses_what_does_not_fit() {
        let mut out = Cursor::new(Vec::new());
        assert!(read_exr(b"no exr").is_err());
        assert!(write_exr_layers(&mut out, [1, 1], ExrDepth::Half, &[]).is_err());
        let bright = write_exr(&mut out, [2, 1], 1, ExrDepth::Half, &[1.0, 1e5]);
        assert!(matches!(bright, Err(ImageError::Range { index: 1, .. })));
        let twice = ExrLayer { name: "a", channels: 1, values: &[1.0] };
        assert!(write_exr_layers(&mut out, [1, 1], ExrDepth::Half, &[twice, twice]).is_err());
    }

    #[test]
    fn exr_damaged_is_an_error_or_an_image_but_no_panic() {
        for depth in [ExrDepth::Half, ExrDepth::Single] {
            let mut whole = Cursor::new(Vec::new());
            write_exr(&mut whole, [9, 5], 3, depth, &noise(9 * 5 * 3)).unwrap();
            damaged(whole.get_ref(), |bytes| drop(read_exr(bytes)));
        }
    }

    #[test]
    fn exr_of_one_value_passes_the_length_check() {
        for value in [0.0, 0.3] {
            let mut whole = Cursor::new(Vec::new());
            write_exr(&mut whole, [512, 512], 3, ExrDepth::Half, &vec![value; 512 * 512 * 3]).unwrap();
            assert_eq!(read_exr(whole.get_ref()).unwrap().values.len(), 512 * 512 * 3);
        }
    }
}
