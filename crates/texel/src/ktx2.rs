//! KTX2: textures as a GPU takes them, without supercompression (KTX File Format Specification 2.0).
//!
//! | format | channels | range |
//! |---|---|---|
//! | [`Ktx2Format::Rgb9e5`] | R, G, B with a shared exponent, 4 bytes a texel | 0 to 65408 |
//! | [`Ktx2Format::R16f`] | R, 2 bytes | -65504 to 65504 |
//! | [`Ktx2Format::Rgba16f`] | R, G, B, A, 8 bytes; A is 1 where three channels are given | -65504 to 65504 |
//!
//! One level; several pages become the layers of an array texture. A mip chain is left to the loader, for the atlas
//! may show no level beyond the second (docs/FORMAT.md). Values are linear, and the data format descriptor says so.

use std::io::Write;

use exr::prelude::f16;

use crate::image::{Image, ImageError, check, check_range};
use crate::image_exr::LARGEST_HALF;
use crate::rgb9e5;

const IDENTIFIER: [u8; 12] = [0xab, b'K', b'T', b'X', b' ', b'2', b'0', 0xbb, b'\r', b'\n', 0x1a, b'\n'];
/// Identifier, 9 numbers of the header, 4 + 2 x 2 of the index.
const HEADER: usize = 12 + 9 * 4 + 4 * 4 + 2 * 8;
/// One level of three 64-bit numbers.
const LEVELS: usize = 24;

/// What a texel holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Ktx2Format {
    /// `VK_FORMAT_E5B9G9R9_UFLOAT_PACK32`.
    Rgb9e5,
    /// `VK_FORMAT_R16_SFLOAT`.
    R16f,
    /// `VK_FORMAT_R16G16B16A16_SFLOAT`.
    Rgba16f,
}

impl Ktx2Format {
    /// Its number in Vulkan.
    pub fn vulkan(self) -> u32 {
        match self {
            Self::Rgb9e5 => 123,
            Self::R16f => 76,
            Self::Rgba16f => 97,
        }
    }

    fn from_vulkan(number: u32) -> Option<Self> {
        [Self::Rgb9e5, Self::R16f, Self::Rgba16f].into_iter().find(|f| f.vulkan() == number)
    }

    /// Bytes of a texel.
    pub fn texel_bytes(self) -> usize {
        match self {
            Self::Rgb9e5 => 4,
            Self::R16f => 2,
            Self::Rgba16f => 8,
        }
    }

    /// The least and greatest value; see [`crate::image::intensity`] for light that exceeds it.
    pub fn range(self) -> [f32; 2] {
        match self {
            Self::Rgb9e5 => [0.0, rgb9e5::LARGEST],
            Self::R16f | Self::Rgba16f => [-LARGEST_HALF, LARGEST_HALF],
        }
    }

    fn channels(self) -> usize {
        match self {
            Self::Rgb9e5 => 3,
            Self::R16f => 1,
            Self::Rgba16f => 4,
        }
    }

    /// Bytes of the unit that a big-endian reader would swap.
    fn type_bytes(self) -> u32 {
        if self == Self::Rgb9e5 { 4 } else { 2 }
    }

    fn texel(self, values: &[f32], out: &mut Vec<u8>) {
        match self {
            Self::Rgb9e5 => out.extend(rgb9e5::pack([values[0], values[1], values[2]]).to_le_bytes()),
            Self::R16f | Self::Rgba16f => {
                let opaque = (values.len() == 3).then_some(1.0);
                let all = values.iter().copied().chain(opaque);
                all.for_each(|v| out.extend(f16::from_f32(v).to_le_bytes()));
            }
        }
    }

    /// The samples of the data format descriptor (Khronos Data Format 1.3, section 5.12 ff.): bit offset, bits, channel
    /// with its flags, and the numbers that stand for the ends of the range.
    fn samples(self) -> Vec<[u32; 5]> {
        const EXPONENT: u32 = 0x20;
        const SIGNED_FLOAT: u32 = 0x40 | 0x80;
        const ALPHA: u32 = 15;
        let half = |offset: u32, channel: u32| {
            [offset, 16, channel | SIGNED_FLOAT, (-1.0_f32).to_bits(), 1.0_f32.to_bits()]
        };
        match self {
            // Mantissa and exponent of each channel; 8448 and 15, 31 are the standard's own numbers for this format.
            Self::Rgb9e5 => {
                (0..3).flat_map(|c| [[9 * c, 9, c, 0, 8448], [27, 5, c | EXPONENT, 15, 31]]).collect()
            }
            Self::R16f => vec![half(0, 0)],
            Self::Rgba16f => vec![half(0, 0), half(16, 1), half(32, 2), half(48, ALPHA)],
        }
    }

    /// The data format descriptor with its total size in front.
    fn descriptor(self) -> Vec<u8> {
        const VERSION: u32 = 2;
        const MODEL_RGBSDA: u32 = 1;
        const PRIMARIES_BT709: u32 = 1;
        const TRANSFER_LINEAR: u32 = 1;
        let samples = self.samples();
        let block = 24 + 16 * samples.len() as u32;
        let mut words = vec![
            block + 4,
            0,
            block << 16 | VERSION,
            TRANSFER_LINEAR << 16 | PRIMARIES_BT709 << 8 | MODEL_RGBSDA,
            0,
            self.texel_bytes() as u32,
            0,
        ];
        for [offset, bits, channel, lower, upper] in samples {
            words.extend([channel << 24 | (bits - 1) << 16 | offset, 0, lower, upper]);
        }
        words.into_iter().flat_map(u32::to_le_bytes).collect()
    }
}

/// Writes one level of one texture, or of an array where there are several pages.
///
/// - `channels`: 3 for RGB9E5, 1 for R16, 3 or 4 for RGBA16
/// - `pages`: each texels x `channels`, row-major, first row first (`KTXorientation` is `rd`)
///
/// The same values give the same bytes.
///
/// # Errors
/// [`ImageError`] where sizes or channels do not fit, a value is not finite or outside of [`Ktx2Format::range`], or
/// writing fails.
pub fn write_ktx2(
    mut out: impl Write,
    size: [u32; 2],
    channels: usize,
    format: Ktx2Format,
    pages: &[&[f32]],
) -> Result<(), ImageError> {
    if pages.is_empty() || !(channels == format.channels() || channels == 3 && format == Ktx2Format::Rgba16f)
    {
        return Err(ImageError::Size { size, channels, found: pages.iter().map(|p| p.len()).sum() });
    }
    for page in pages {
        check(size, channels, page)?;
        check_range(page, format.range())?;
    }
    let descriptor = format.descriptor();
    let entries = key_values(&[
        ("KTXorientation", "rd"),
        ("KTXwriter", concat!("lightkiln ", env!("CARGO_PKG_VERSION"))),
    ]);
    let descriptor_at = HEADER + LEVELS;
    let entries_at = descriptor_at + descriptor.len();
    // To the least common multiple of a texel and 4, and no further.
    let data_at = (entries_at + entries.len()).next_multiple_of(format.texel_bytes().max(4));
    let data_bytes = pages.iter().map(|p| p.len() / channels * format.texel_bytes()).sum::<usize>() as u64;
    let layers = if pages.len() > 1 { pages.len() as u32 } else { 0 };

    let mut head = IDENTIFIER.to_vec();
    let numbers = [format.vulkan(), format.type_bytes(), size[0], size[1], 0, layers, 1, 1, 0];
    let places = [descriptor_at, descriptor.len(), entries_at, entries.len()].map(|n| n as u32);
    head.extend(numbers.into_iter().chain(places).flat_map(u32::to_le_bytes));
    // No global data, then the level.
    head.extend([0, 0, data_at as u64, data_bytes, data_bytes].into_iter().flat_map(u64::to_le_bytes));
    head.extend(descriptor);
    head.extend(entries);
    head.resize(data_at, 0);
    out.write_all(&head).map_err(ImageError::Ktx2Write)?;
    let mut row = Vec::new();
    for texels in pages.iter().flat_map(|page| page.chunks(size[0] as usize * channels)) {
        row.clear();
        texels.chunks_exact(channels).for_each(|texel| format.texel(texel, &mut row));
        out.write_all(&row).map_err(ImageError::Ktx2Write)?;
    }
    Ok(())
}

/// Keys in ascending order with their text, each padded to 4 bytes.
fn key_values(entries: &[(&str, &str)]) -> Vec<u8> {
    let mut bytes = Vec::new();
    for (key, value) in entries {
        bytes.extend((key.len() as u32 + value.len() as u32 + 2).to_le_bytes());
        bytes.extend([key.as_bytes(), &[0], value.as_bytes(), &[0]].concat());
        bytes.resize(bytes.len().next_multiple_of(4), 0);
    }
    bytes
}

/// Reads the first level of what [`write_ktx2`] writes; other formats, cubes, volumes and compressed files are errors.
///
/// - returns the format and one image for each layer
///
/// # Errors
/// [`ImageError::Ktx2`].
pub fn read_ktx2(bytes: &[u8]) -> Result<(Ktx2Format, Vec<Image>), ImageError> {
    let wrong = |what: &'static str| ImageError::Ktx2 { what };
    if bytes.len() < HEADER + LEVELS || bytes[..12] != IDENTIFIER {
        return Err(wrong("no header"));
    }
    let word = |at: usize| {
        let bytes = bytes.get(at..at + 4).and_then(|b| b.try_into().ok());
        bytes.map(u32::from_le_bytes).ok_or(wrong("cut short"))
    };
    let long = |at: usize| Ok::<_, ImageError>(u64::from(word(at)?) | u64::from(word(at + 4)?) << 32);
    let mut numbers = [0; 13];
    for (k, number) in numbers.iter_mut().enumerate() {
        *number = word(12 + 4 * k)?;
    }
    let [vulkan, type_bytes, width, height, depth, layers, faces, _levels, scheme, ..] = numbers;
    let format = Ktx2Format::from_vulkan(vulkan).ok_or(wrong("another texel format"))?;
    if width == 0 || height == 0 || depth != 0 || faces != 1 {
        return Err(wrong("not a two-dimensional texture"));
    }
    if scheme != 0 {
        return Err(wrong("supercompressed"));
    }
    let [descriptor_at, descriptor_bytes] = [numbers[9], numbers[10]].map(|n| n as usize);
    let descriptor = bytes.get(descriptor_at..descriptor_at.saturating_add(descriptor_bytes));
    if descriptor != Some(&format.descriptor()) || type_bytes != format.type_bytes() {
        return Err(wrong("data format descriptor does not fit the texel format"));
    }
    let count = u64::from(layers.max(1));
    let page_bytes = u64::from(width) * u64::from(height);
    let page_bytes = page_bytes.checked_mul(format.texel_bytes() as u64).ok_or(wrong("too large"))?;
    let [at, length] = [long(HEADER)?, long(HEADER + 8)?];
    if page_bytes.checked_mul(count) != Some(length) {
        return Err(wrong("level has another length than its size asks for"));
    }
    let end = at.checked_add(length).filter(|&end| end <= bytes.len() as u64).ok_or(wrong("cut short"))?;
    let data = &bytes[at as usize..end as usize];
    let names: &[&str] = if format == Ktx2Format::R16f { &["R"] } else { &["R", "G", "B", "A"] };
    let image = |page: &[u8]| Image {
        size: [width, height],
        channels: format.channels(),
        names: names[..format.channels()].iter().map(|&n| n.to_owned()).collect(),
        bits: if format == Ktx2Format::Rgb9e5 { 9 } else { 16 },
        values: match format {
            Ktx2Format::Rgb9e5 => page
                .chunks_exact(4)
                .flat_map(|b| rgb9e5::unpack(u32::from_le_bytes([b[0], b[1], b[2], b[3]])))
                .collect(),
            _ => page.chunks_exact(2).map(|b| f16::from_le_bytes([b[0], b[1]]).to_f32()).collect(),
        },
    };
    Ok((format, data.chunks_exact(page_bytes as usize).map(image).collect()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::testing::{damaged, noise};

    fn written(format: Ktx2Format, channels: usize, pages: usize) -> (Vec<u8>, Vec<Vec<f32>>) {
        let all: Vec<f32> = noise(7 * 5 * channels * pages).iter().map(|v| v * 30.0).collect();
        let pages: Vec<Vec<f32>> = all.chunks(7 * 5 * channels).map(<[f32]>::to_vec).collect();
        let views: Vec<&[f32]> = pages.iter().map(Vec::as_slice).collect();
        let mut bytes = Vec::new();
        write_ktx2(&mut bytes, [7, 5], channels, format, &views).unwrap();
        (bytes, pages)
    }

    #[test]
    fn ktx2_round_trip_is_within_a_step() {
        for (format, channels) in [
            (Ktx2Format::Rgb9e5, 3),
            (Ktx2Format::R16f, 1),
            (Ktx2Format::Rgba16f, 3),
            (Ktx2Format::Rgba16f, 4),
        ] {
            for count in [1, 3] {
                let (bytes, pages) = written(format, channels, count);
                let (read_format, images) = read_ktx2(&bytes).unwrap();
                assert_eq!((read_format, images.len()), (format, count));
                for (image, page) in images.iter().zip(&pages) {
                    assert_eq!(image.size, [7, 5]);
                    for (texel, from) in image.values.chunks(image.channels).zip(page.chunks(channels)) {
                        let most = from.iter().fold(0.0_f32, |a, &b| a.max(b));
                        let step = if format == Ktx2Format::Rgb9e5 { most / 512.0 } else { most / 2048.0 };
                        assert!(from.iter().zip(texel).all(|(a, b)| (a - b).abs() <= step));
                        assert!(image.channels == channels || texel[3] == 1.0);
                    }
                }
            }
        }
    }

    #[test]
    fn ktx2_layout_is_what_the_specification_asks_for() {
        let (bytes, _) = written(Ktx2Format::Rgb9e5, 3, 1);
        let word = |at: usize| u32::from_le_bytes(bytes[at..at + 4].try_into().unwrap());
        assert_eq!([word(12), word(16), word(20), word(24)], [123, 4, 7, 5]);
        // A texture that is no array has no layers, one face, one level.
        assert_eq!([word(28), word(32), word(36), word(40), word(44)], [0, 0, 1, 1, 0]);
        // The descriptor follows the levels: 4 bytes, a block of 24, six samples of 16.
        assert_eq!([word(48), word(52)], [104, 4 + 24 + 6 * 16]);
        assert_eq!(word(104), 4 + 24 + 6 * 16);
        // Data is aligned to the texel and ends the file.
        let at = word(HEADER) as usize;
        assert_eq!((at % 4, at + 7 * 5 * 4), (0, bytes.len()));
    }

    #[test]
    fn ktx2_refuses_what_does_not_fit() {
        let write =
            |channels, format, pages: &[&[f32]]| write_ktx2(Vec::new(), [1, 1], channels, format, pages);
        assert!(matches!(write(1, Ktx2Format::Rgb9e5, &[&[0.0]]), Err(ImageError::Size { .. })));
        assert!(matches!(write(3, Ktx2Format::R16f, &[&[0.0; 3]]), Err(ImageError::Size { .. })));
        assert!(matches!(write(1, Ktx2Format::R16f, &[]), Err(ImageError::Size { .. })));
        assert!(matches!(
            write(3, Ktx2Format::Rgb9e5, &[&[0.0, -1.0, 0.0]]),
            Err(ImageError::Range { index: 1, .. })
        ));
        assert!(matches!(write(1, Ktx2Format::R16f, &[&[1e5]]), Err(ImageError::Range { .. })));
        assert!(matches!(write(1, Ktx2Format::R16f, &[&[f32::NAN]]), Err(ImageError::NotFinite { .. })));
        assert!(matches!(read_ktx2(b"no ktx2"), Err(ImageError::Ktx2 { .. })));
    }

    #[test]
    fn ktx2_damaged_is_an_error_or_images_but_no_panic() {
        for (format, channels) in [(Ktx2Format::Rgb9e5, 3), (Ktx2Format::R16f, 1)] {
            let (whole, _) = written(format, channels, 2);
            damaged(&whole, |bytes| drop(read_ktx2(bytes)));
        }
    }
}
