//! Colors in a table, and codes that name its entries: Schaefer 2012, section 4.4, for RGB.
//!
//! Colors closer to each other than a bound share an entry. They are gathered by a grid of whole 8-bit steps over
//! the unit cube, so the table depends neither on the order of the colors nor on how often each occurs, and no
//! color is further from its entry than the bound or half a step of 8 bits.
//!
//! The packed form needs no table and errs less; `docs/CODES.md` has the numbers.

use crate::constants::{TABLE_LIMIT, TABLE_WIDTH};
use crate::{Codes, EncodeError, LightCode};

/// The unique colors of a layer, 8 bits a channel.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Table {
    channels: usize,
    entries: Vec<u8>,
}

impl Table {
    /// Gathers colors.
    ///
    /// - `colors`: N × `channels`, unit values; values outside `0..=1` are clamped, NaN is 0
    /// - `channels`: 1 to 3; a table of two has three, and blue is 0
    /// - `bound`: how far an entry may be from its colors, in any channel; below 1/510 every entry still is off by up
    ///   to 1/510, as it has 8 bits
    /// - returns: the table, its entries ascending, and the entry of each color
    ///
    /// # Errors
    /// [`EncodeError::Channels`]; [`EncodeError::Length`] for colors that are not whole;
    /// [`EncodeError::TableSize`] for more than [`TABLE_LIMIT`] entries.
    pub fn build(colors: &[f32], channels: usize, bound: f32) -> Result<(Self, Vec<u32>), EncodeError> {
        let stored = stored_channels(channels)?;
        if !colors.len().is_multiple_of(channels) {
            let expected = colors.len() / channels * channels;
            return Err(EncodeError::Length { what: "colors", count: colors.len(), expected });
        }
        // A step of the grid holds all that is half of it away from its middle.
        let step = ((bound * 510.0).floor() as u32).clamp(1, 255);
        let level = |value: f32| {
            let steps = (value.clamp(0.0, 1.0) * 255.0 / step as f32).round() as u32;
            (steps * step).min(255) as u8
        };
        let color = |color: &[f32]| -> [u8; 3] {
            std::array::from_fn(|c| color.get(c).map_or(0, |&value| level(value)))
        };
        let all: Vec<[u8; 3]> = colors.chunks_exact(channels).map(color).collect();
        let mut unique = all.clone();
        unique.sort_unstable();
        unique.dedup();
        if unique.len() > TABLE_LIMIT {
            return Err(EncodeError::TableSize { entries: unique.len(), limit: TABLE_LIMIT });
        }
        let index = |color| unique.binary_search(color).expect("every color is in the table") as u32;
        let indices = all.iter().map(index).collect();
        let entries = unique.iter().flat_map(|entry| &entry[..stored]).copied().collect();
        Ok((Self { channels: stored, entries }, indices))
    }

    /// A table as it was read from an image.
    ///
    /// - `texels`: entries × `channels` in `0..=1`, row-major; the last row's padding may be among them
    ///
    /// # Errors
    /// As [`Table::build`].
    pub fn read(channels: usize, texels: &[f32]) -> Result<Self, EncodeError> {
        if stored_channels(channels)? != channels {
            return Err(EncodeError::Channels { channels });
        }
        let (count, entries) = (texels.len(), texels.len() / channels);
        if count != entries * channels {
            return Err(EncodeError::Length {
                what: "texels of a table",
                count,
                expected: entries * channels,
            });
        }
        if entries > TABLE_LIMIT {
            return Err(EncodeError::TableSize { entries, limit: TABLE_LIMIT });
        }
        let entries = texels.iter().map(|value| (value.clamp(0.0, 1.0) * 255.0).round() as u8).collect();
        Ok(Self { channels, entries })
    }

    /// Numbers per entry: 1 or 3.
    pub fn channels(&self) -> usize {
        self.channels
    }

    /// How many entries there are.
    pub fn len(&self) -> usize {
        self.entries.len() / self.channels
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.entries.is_empty()
    }

    /// The color of an entry in `0..=1`; channels that the table does not have are 0, as are entries.
    #[inline]
    pub fn color(&self, index: u32) -> [f32; 3] {
        let from = index as usize * self.channels;
        let entry = self.entries.get(from..from + self.channels).unwrap_or_default();
        std::array::from_fn(|c| entry.get(c).map_or(0.0, |&value| f32::from(value) / 255.0))
    }

    /// The table as an image: its width ([`TABLE_WIDTH`]) and rows, and its texels with [`Table::channels`] numbers of
    /// 8 bits, the last row filled with 0. One row of 0 for an empty table.
    pub fn image(&self) -> ([u32; 2], Vec<u8>) {
        let rows = self.len().div_ceil(TABLE_WIDTH as usize).max(1);
        let mut texels = self.entries.clone();
        texels.resize(rows * TABLE_WIDTH as usize * self.channels, 0);
        ([TABLE_WIDTH, rows as u32], texels)
    }
}

/// Numbers per entry of a table, and per texel of an image.
fn stored_channels(channels: usize) -> Result<usize, EncodeError> {
    match channels {
        1 => Ok(1),
        2 | 3 => Ok(3),
        _ => Err(EncodeError::Channels { channels }),
    }
}

impl Codes {
    /// The same codes with every color as an entry of a table; see [`Table::build`] for the bound.
    ///
    /// Colors come from the packed codes, so their error (1/2046) comes on top of the bound.
    ///
    /// # Errors
    /// [`EncodeError::Channels`] and [`EncodeError::TableSize`].
    pub fn to_table(&self, channels: usize, bound: f32) -> Result<(Self, Table), EncodeError> {
        let stored = stored_channels(channels)?;
        let color = |code: LightCode| match stored {
            1 => code.value().map(|value| [value, 0.0, 0.0]),
            _ => code.rgb(),
        };
        let colors: Vec<f32> =
            self.distinct().filter_map(color).flat_map(|rgb| rgb.into_iter().take(stored)).collect();
        let (table, indices) = Table::build(&colors, stored, bound)?;
        let mut next = indices.into_iter();
        let codes = self.map(|code| match code.is_color() {
            true => next.next().and_then(LightCode::color_index).expect("one entry per color"),
            false => code,
        });
        Ok((codes, table))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn table_close_colors_share_an_entry() {
        let colors = [0.51, 0.51, 0.51, 0.511, 0.509, 0.51, 0.9, 0.51, 0.51];
        let (table, indices) = Table::build(&colors, 3, 0.01).expect("three colors");
        assert_eq!((table.len(), table.channels()), (2, 3));
        assert_eq!(indices, [0, 0, 1]);
        assert_eq!(Table::build(&[], 3, 0.01).expect("none").0.image(), ([256, 1], vec![0; 768]));
        assert_eq!(table.color(2), [0.0; 3]);
    }

    #[test]
    fn table_odd_input_is_clamped_or_refused() {
        let (table, indices) = Table::build(&[f32::NAN, -1.0, 9.0, f32::INFINITY], 1, 0.0).expect("four");
        assert_eq!((table.color(0)[0], table.color(1)[0]), (0.0, 1.0));
        assert_eq!(indices, [0, 0, 1, 1]);
        for bound in [f32::NAN, -1.0, f32::INFINITY] {
            assert!(Table::build(&[0.3, 0.6], 1, bound).expect("any bound").0.len() <= 2);
        }
        assert_eq!(Table::build(&[0.0; 4], 4, 0.1), Err(EncodeError::Channels { channels: 4 }));
        assert!(matches!(Table::build(&[0.0; 4], 3, 0.1), Err(EncodeError::Length { count: 4, .. })));
        assert!(matches!(Table::read(3, &[0.0; 4]), Err(EncodeError::Length { expected: 3, .. })));
        assert_eq!(Table::read(2, &[0.0; 4]), Err(EncodeError::Channels { channels: 2 }));
        let large = vec![0.0; TABLE_LIMIT + 1];
        assert!(matches!(Table::read(1, &large), Err(EncodeError::TableSize { .. })));
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(128))]

        #[test]
        fn table_entries_are_within_the_bound(
            colors in prop::collection::vec(0.0_f32..=1.0, 0..200),
            channels in 1..=3_usize,
            bound in 0.0_f32..0.2,
        ) {
            let colors = &colors[..colors.len() / channels * channels];
            let (table, indices) = Table::build(colors, channels, bound).expect("few colors");
            prop_assert_eq!(indices.len(), colors.len() / channels);
            for (color, &index) in colors.chunks_exact(channels).zip(&indices) {
                for (value, shown) in color.iter().zip(table.color(index)) {
                    prop_assert!((value - shown).abs() <= bound.max(1.0 / 510.0) + 1e-6);
                }
            }
            // Through the image and back, and from the colors in another order.
            let (size, texels) = table.image();
            prop_assert_eq!(texels.len(), size[0] as usize * size[1] as usize * table.channels());
            let unit: Vec<f32> = texels.iter().map(|&value| f32::from(value) / 255.0).collect();
            let read = Table::read(table.channels(), &unit).expect("whole");
            prop_assert!((0..table.len() as u32).all(|i| read.color(i) == table.color(i)));
            let turned: Vec<f32> = colors.chunks_exact(channels).rev().flatten().copied().collect();
            prop_assert_eq!(Table::build(&turned, channels, bound).expect("few colors").0, table);
        }
    }
}
