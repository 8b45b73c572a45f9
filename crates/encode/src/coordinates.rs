//! Light for viewers that have no shader of ours: texture coordinates of one image, and a strip in it that holds every
//! value.
//!
//! A texture triangle shows its chart, and a color triangle a piece of the *strip*: a row of texels whose values rise
//! linearly from 0 to 1. Interpolating a place on the strip is interpolating the value, so a plain bilinear lookup
//! shows what the color-vertices of section 4.3 (Schaefer 2012) show. No triangle may mix the two kinds.
//!
//! Coordinates are two unsigned 16-bit integers that stand for `0..=1` over the page, the form that core glTF has for
//! texture coordinates: a step of at most 1/16 texel, as a page has at most 4096 texels a side.
//!
//! **The strip** has `n` texels with the values `i / (n - 1)`, whole steps of 8 bits, at `(i + 0.5, row)`: between
//! the centres of the first and the last the bilinear filter is exactly linear. It lies in the last four rows of the
//! page, all alike, and what is right of it repeats its end: rounding, the filter and even two mip levels read
//! nothing else.

use crate::{AtlasView, LightCode};

/// Rows of the strip: a block of 4 x 4 texels, so that block compression and mip levels 1 and 2 mix it with nothing.
pub const STRIP_ROWS: u32 = 4;

/// Texels of the longest strip: one for each value of 8 bits.
pub const LONGEST_STRIP: u32 = 256;

/// Steps of 8 bits between neighbours of a strip: those that divide 255.
const STRIP_STEPS: [u32; 8] = [1, 3, 5, 15, 17, 51, 85, 255];

/// Where a page shows values without charts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Strip {
    /// Its first row.
    pub row: u32,
    /// Its texels.
    pub texels: u32,
}

/// What coordinates mean: the size of the page, and its strip if it has one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Coordinates {
    /// Width and height of the page in texels, strip included.
    pub size: [u32; 2],
    /// The strip.
    pub strip: Option<Strip>,
}

impl Coordinates {
    /// A page of charts alone.
    pub fn plain(size: [u32; 2]) -> Self {
        Self { size, strip: None }
    }

    /// A page of charts of a size, multiples of 4 and perhaps zero, with a strip below them, as long as fits.
    pub fn with_strip([width, height]: [u32; 2]) -> Self {
        let width = if width == 0 { LONGEST_STRIP } else { width };
        let lengths = STRIP_STEPS.iter().map(|step| 255 / step + 1);
        let texels = lengths.clone().find(|&n| n <= width).unwrap_or(2);
        Self { size: [width, height + STRIP_ROWS], strip: Some(Strip { row: height, texels }) }
    }

    /// The texels of the strip's rows, unit values, row-major.
    pub fn strip_texels(&self) -> Vec<f32> {
        let Some(strip) = self.strip else { return Vec::new() };
        let last = strip.texels - 1;
        let row = (0..self.size[0]).map(|i| i.min(last) as f32 / last as f32);
        (0..STRIP_ROWS).flat_map(|_| row.clone()).collect()
    }

    /// The coordinates of a corner. A color without a strip to show it is the page's first corner.
    #[inline]
    pub fn of(&self, code: LightCode) -> [u16; 2] {
        let texels = match (code.position(), self.strip) {
            (Some(position), _) => position,
            (None, Some(strip)) => {
                let value = code.value().unwrap_or_default();
                [0.5 + value * (strip.texels - 1) as f32, (strip.row + STRIP_ROWS / 2) as f32]
            }
            (None, None) => [0.0; 2],
        };
        [0, 1].map(|k| (texels[k] / self.size[k] as f32 * 65535.0).round().clamp(0.0, 65535.0) as u16)
    }

    /// Where coordinates lie, in texels of the page.
    #[inline]
    pub fn position(&self, coordinates: [u16; 2]) -> [f32; 2] {
        [0, 1].map(|k| f32::from(coordinates[k]) / 65535.0 * self.size[k] as f32)
    }

    /// The code that coordinates stand for: a color on the strip, else a place, rounded to the steps of codes.
    pub fn code(&self, coordinates: [u16; 2]) -> LightCode {
        let position = self.position(coordinates);
        match self.strip {
            Some(strip) if position[1] > strip.row as f32 => {
                LightCode::color((position[0] - 0.5) / (strip.texels - 1) as f32)
            }
            _ => LightCode::texture(position).unwrap_or_default(),
        }
    }
}

/// The light that a GPU shows at a point of a triangle: a lookup at interpolated coordinates.
///
/// - `corners`: of the triangle, in texels of the page
/// - `barycentric`: weights of the second and third corner
/// - `out`: a value per channel of the layer
#[inline]
pub fn decode_coordinates(
    corners: [[f32; 2]; 3],
    [second, third]: [f32; 2],
    page: &AtlasView<'_>,
    out: &mut [f32],
) {
    let first = 1.0 - second - third;
    let at = |k: usize| corners[0][k] * first + corners[1][k] * second + corners[2][k] * third;
    page.read([at(0), at(1)], out);
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::Texels;

    /// Steps of a value that 16-bit coordinates keep apart, on a page of a width.
    fn value_steps(width: u32, strip: Strip) -> f32 {
        65535.0 / width as f32 * (strip.texels - 1) as f32
    }

    fn page(coordinates: &Coordinates) -> Vec<f32> {
        let charts = coordinates.size[0] * (coordinates.size[1] - STRIP_ROWS);
        let mut texels: Vec<f32> = (0..charts).map(|i| (i * 7919 % 256) as f32 / 255.0).collect();
        texels.extend(coordinates.strip_texels());
        texels
    }

    #[test]
    fn strip_is_the_longest_that_fits_in_whole_steps() {
        for (width, texels) in
            [(0, 256), (4, 4), (8, 6), (20, 18), (64, 52), (84, 52), (88, 86), (256, 256), (4096, 256)]
        {
            let coordinates = Coordinates::with_strip([width, 16]);
            assert_eq!(coordinates.strip, Some(Strip { row: 16, texels }), "{width}");
            let values = coordinates.strip_texels();
            assert_eq!(values.len() as u32, coordinates.size[0] * STRIP_ROWS);
            assert!(values.iter().all(|v| (v * 255.0 - (v * 255.0).round()).abs() < 1e-4));
            assert_eq!((values[0], values[values.len() - 1]), (0.0, 1.0));
        }
    }

    #[test]
    fn strip_shows_a_gradient_as_interpolated_values_do() {
        for width in [4, 12, 60, 256, 1000, 4096] {
            let coordinates = Coordinates::with_strip([width, 8]);
            let texels = page(&coordinates);
            let view = AtlasView::new(coordinates.size, 1, vec![Texels::F32(&texels)]).expect("a whole page");
            let steps = value_steps(width, coordinates.strip.expect("a strip"));
            for values in [[0.0, 0.5, 1.0], [0.013, 0.014, 0.9], [1.0, 1.0, 1.0], [0.0, 0.0, 0.0]] {
                let corners = values.map(|v| coordinates.position(coordinates.of(LightCode::color(v))));
                for step in 0..=100 {
                    let at = [step as f32 / 200.0, step as f32 / 300.0];
                    let mut shown = [0.0];
                    decode_coordinates(corners, at, &view, &mut shown);
                    let wanted = values[0] * (1.0 - at[0] - at[1]) + values[1] * at[0] + values[2] * at[1];
                    let error = (shown[0] - wanted).abs();
                    assert!(error <= 0.5 / steps + 1e-4, "{width}: {} for {wanted}", shown[0]);
                }
            }
        }
    }

    proptest! {
        /// Places of codes are read back exactly on every page, and colors within a step.
        #[test]
        fn coordinates_of_codes_are_read_back(
            blocks in [1_u32..=1024, 0_u32..=1023], x in 0.0_f32..1.0, y in 0.0_f32..1.0, value in 0.0_f32..=1.0,
        ) {
            let charts = blocks.map(|b| b * 4);
            let coordinates = Coordinates::with_strip(charts);
            let place = LightCode::texture([x * charts[0] as f32, y * charts[1] as f32]).expect("in range");
            let again = coordinates.of(place);
            prop_assert_eq!(coordinates.code(again), place);
            let off = [0, 1].map(|k| coordinates.position(again)[k] - place.position().expect("a place")[k]);
            prop_assert!(off.iter().all(|d| d.abs() <= 0.5 * 4096.0 / 65535.0 + 1e-3), "{off:?}");
            let color = coordinates.of(LightCode::color(value));
            let shown = coordinates.code(color).value().expect("a color");
            let steps = value_steps(coordinates.size[0], coordinates.strip.expect("a strip"));
            prop_assert!((shown - value).abs() <= 0.5 / steps + 1e-4);
            // Half a texel and more from all that is no strip.
            let row = coordinates.position(color)[1] - coordinates.strip.expect("a strip").row as f32;
            prop_assert!((row - 2.0).abs() < 0.1);
        }
    }
}
