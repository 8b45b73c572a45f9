//! The packed attribute `_LIGHTUV`: two unsigned 16-bit integers, 4 bytes a vertex.
//!
//! ```text
//!                  first integer (16 bits)        second integer: bit 15 | bits 14..0
//! color-vertex     round(value * 65535)           1 | 0 (spare)
//! texture-vertex   u * 8                          0 | v * 8
//! ```
//!
//! `u` and `v` are in texels; `v` runs through the stack of pages, so page `p` begins at `p * page_height`.
//! Codes reach 8191.875 texels to the right and 4095.875 rows of the stack.
//!
//! Deviation: the paper puts `(c, 2)` into a pair of floats, 8 bytes; [`LightCode::interop`] gives that form
//! for engines that drop attributes of their own name. For RGB the paper indexes a table in a texture. A
//! color-vertex has 31 bits beside the flag and a scalar uses 16 of them, so an RGB value fits in place
//! (10 + 11 + 10 bits) without a table, without another fetch and without a change to texture-vertices.

use crate::constants::{COLOR_FLAG, COLOR_STEPS, INTEROP_COLOR, SUBTEXELS};

/// What one corner shows: a value, or a place in the atlas. See the [module](self) for the bits.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Default)]
#[repr(transparent)]
pub struct LightCode(pub [u16; 2]);

impl LightCode {
    /// Largest place that a code can name, in texels: `[u, v]`.
    pub const LIMIT: [f32; 2] =
        [u16::MAX as f32 / SUBTEXELS as f32, (COLOR_FLAG - 1) as f32 / SUBTEXELS as f32];

    /// A color-vertex. Values outside `0..=1` are clamped, NaN is 0.
    #[inline]
    pub fn color(value: f32) -> Self {
        Self([(value.clamp(0.0, 1.0) * f32::from(COLOR_STEPS)).round() as u16, COLOR_FLAG])
    }

    /// A texture-vertex at a place of the stack of pages, in texels, rounded to the nearest 1/8.
    /// `None` beyond [`LightCode::LIMIT`], below 0 and for NaN.
    #[inline]
    pub fn texture([u, v]: [f32; 2]) -> Option<Self> {
        let [x, y] = [u, v].map(|texels| (texels * SUBTEXELS as f32).round());
        let fits = x >= 0.0 && x <= f32::from(u16::MAX) && y >= 0.0 && y < f32::from(COLOR_FLAG);
        fits.then_some(Self([x as u16, y as u16]))
    }

    /// Whether this is a color-vertex.
    #[inline]
    pub fn is_color(self) -> bool {
        self.0[1] & COLOR_FLAG != 0
    }

    /// The value of a color-vertex in `0..=1`; `None` for a texture-vertex.
    #[inline]
    pub fn value(self) -> Option<f32> {
        self.is_color().then(|| f32::from(self.0[0]) / f32::from(COLOR_STEPS))
    }

    /// The place of a texture-vertex in the stack of pages, in texels; `None` for a color-vertex.
    #[inline]
    pub fn position(self) -> Option<[f32; 2]> {
        (!self.is_color()).then(|| self.0.map(|x| f32::from(x) / SUBTEXELS as f32))
    }

    /// The paper's own form, a pair of floats: `(c, 2)`, or texture coordinates in the unit square of the
    /// stack of pages. `stack` is its width and its rows, in texels.
    pub fn interop(self, stack: [u32; 2]) -> [f32; 2] {
        match self.position() {
            Some([u, v]) => [u / stack[0] as f32, v / stack[1] as f32],
            None => [f32::from(self.0[0]) / f32::from(COLOR_STEPS), INTEROP_COLOR],
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn code_limits_are_kept() {
        assert_eq!(LightCode::LIMIT, [8191.875, 4095.875]);
        assert_eq!(LightCode::texture(LightCode::LIMIT), Some(LightCode([65535, 32767])));
        assert_eq!(LightCode::texture([0.0, 0.0]), Some(LightCode([0, 0])));
        assert_eq!(LightCode::texture([8192.0, 1.0]), None);
        assert_eq!(LightCode::texture([1.0, 4096.0]), None);
        assert_eq!(LightCode::texture([-0.125, 1.0]), None);
        assert_eq!(LightCode::texture([f32::NAN, 1.0]), None);
        assert_eq!(LightCode::texture([1.0, f32::INFINITY]), None);
    }

    #[test]
    fn code_color_is_clamped() {
        assert_eq!(LightCode::color(-1.0).value(), Some(0.0));
        assert_eq!(LightCode::color(1.0).value(), Some(1.0));
        assert_eq!(LightCode::color(7.0).value(), Some(1.0));
        assert_eq!(LightCode::color(f32::NAN).value(), Some(0.0));
        assert_eq!(LightCode::color(0.5).position(), None);
    }

    #[test]
    fn code_interop_is_unit_square_or_two() {
        assert_eq!(LightCode::color(1.0).interop([8, 16]), [1.0, 2.0]);
        let corner = LightCode::texture([4.0, 16.0]).expect("in range");
        assert_eq!(corner.interop([8, 16]), [0.5, 1.0]);
        assert_eq!(corner.value(), None);
    }

    proptest! {
        #[test]
        fn code_round_trip_is_within_half_a_step(value in 0.0_f32..=1.0, u in 0.0_f32..8191.9, v in 0.0_f32..4095.9) {
            let shown = LightCode::color(value).value().expect("a color");
            prop_assert!((shown - value).abs() <= 0.5 / 65535.0 + 1e-7);
            let [x, y] = LightCode::texture([u, v]).expect("in range").position().expect("a place");
            prop_assert!((x - u).abs() <= 0.5 / 8.0 && (y - v).abs() <= 0.5 / 8.0);
        }
    }
}
