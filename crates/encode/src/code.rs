//! The packed attribute `_LIGHTUV`: two unsigned 16-bit integers, 4 bytes a vertex.
//!
//! ```text
//!                  first integer (16 bits)        second integer: bit 15 | bits 14..0
//! color-vertex     low 16 bits of a color         1 | high 15 bits of a color
//! texture-vertex   u * 8                          0 | v * 8
//!
//! the 31 bits of a color:
//! scalar           round(value * 65535)
//! RGB              round(r * 1023) << 21 | round(g * 2047) << 10 | round(b * 1023)
//! table            number of an entry of a table of colors, see [`Table`](crate::Table)
//! ```
//!
//! `u` and `v` are in texels; `v` runs through the stack of pages, so page `p` begins at `p * page_height`.
//! Codes reach 8191.875 texels to the right and 4095.875 rows of the stack. Which of the three colors a layer
//! has is no part of the code: all its codes are alike, and [`Form`](crate::Form) says it.
//!
//! Deviation: the paper (section 4.4) puts `(c, 2)` into a pair of floats, 8 bytes; [`LightCode::interop`] gives
//! that form for engines that drop attributes of their own name. For RGB the paper's `c` is a place in a texture
//! of colors: that is the table. The 31 bits beside the flag hold an RGB color in place, without a table and
//! without a fetch in the vertex stage; `docs/CODES.md` compares the two.

use crate::Form;
use crate::constants::{
    COLOR_FLAG, COLOR_STEPS, INTEROP_COLOR, LOW_BITS, RGB_SHIFTS, RGB_STEPS, SUBTEXELS, TABLE_LIMIT,
};

/// What one corner shows: a color, or a place in the atlas. See the [module](self) for the bits.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Default)]
#[repr(transparent)]
pub struct LightCode(pub [u16; 2]);

impl LightCode {
    /// Largest place that a code can name, in texels: `[u, v]`.
    pub const LIMIT: [f32; 2] =
        [u16::MAX as f32 / SUBTEXELS as f32, (COLOR_FLAG - 1) as f32 / SUBTEXELS as f32];

    /// A color-vertex of a scalar layer. Values outside `0..=1` are clamped, NaN is 0.
    #[inline]
    pub fn color(value: f32) -> Self {
        Self::from_bits(steps(value, u32::from(COLOR_STEPS)))
    }

    /// A color-vertex of an RGB layer. Values outside `0..=1` are clamped, NaN is 0.
    #[inline]
    pub fn color_rgb(rgb: [f32; 3]) -> Self {
        Self::from_bits((0..3).fold(0, |bits, c| bits | steps(rgb[c], RGB_STEPS[c]) << RGB_SHIFTS[c]))
    }

    /// A color-vertex of a layer of `values.len()` channels: scalar for one, RGB for two (blue is 0) and three.
    /// Channels after the third are dropped.
    #[inline]
    pub fn color_of(values: &[f32]) -> Self {
        match *values {
            [value] => Self::color(value),
            _ => Self::color_rgb(std::array::from_fn(|c| values.get(c).copied().unwrap_or(0.0))),
        }
    }

    /// A color-vertex of a table: the number of its entry. `None` for [`TABLE_LIMIT`] and above.
    #[inline]
    pub fn color_index(index: u32) -> Option<Self> {
        ((index as usize) < TABLE_LIMIT).then(|| Self::from_bits(index))
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

    /// The value of a color-vertex of a scalar layer in `0..=1`; `None` for a texture-vertex.
    #[inline]
    pub fn value(self) -> Option<f32> {
        self.is_color().then(|| f32::from(self.0[0]) / f32::from(COLOR_STEPS))
    }

    /// The value of a color-vertex of an RGB layer, each channel in `0..=1`; `None` for a texture-vertex.
    #[inline]
    pub fn rgb(self) -> Option<[f32; 3]> {
        let bits = self.bits()?;
        Some(std::array::from_fn(|c| (bits >> RGB_SHIFTS[c] & RGB_STEPS[c]) as f32 / RGB_STEPS[c] as f32))
    }

    /// The number of a color-vertex's entry in the table of its layer; `None` for a texture-vertex.
    #[inline]
    pub fn index(self) -> Option<u32> {
        self.bits()
    }

    /// The place of a texture-vertex in the stack of pages, in texels; `None` for a color-vertex.
    #[inline]
    pub fn position(self) -> Option<[f32; 2]> {
        (!self.is_color()).then(|| self.0.map(|x| f32::from(x) / SUBTEXELS as f32))
    }

    /// The paper's own form, a pair of floats: `(c, 2)`, or texture coordinates in the unit square of the stack
    /// of pages. `stack` is its width and its rows, in texels.
    ///
    /// `c` is the value of a scalar layer, or the number of an entry of a table: more does not fit in one
    /// float. Packed RGB is `(low 16 bits, 2 + high 15 bits)`: a second coordinate of 2 or more marks a color in
    /// all forms, and every float here is exact.
    pub fn interop(self, stack: [u32; 2], form: &Form<'_>) -> [f32; 2] {
        let Some(bits) = self.bits() else {
            let [u, v] = self.0.map(|x| f32::from(x) / SUBTEXELS as f32);
            return [u / stack[0] as f32, v / stack[1] as f32];
        };
        match form {
            Form::Scalar => [f32::from(self.0[0]) / f32::from(COLOR_STEPS), INTEROP_COLOR],
            Form::Rgb => [f32::from(self.0[0]), INTEROP_COLOR + (bits >> LOW_BITS) as f32],
            Form::Table(_) => [bits as f32, INTEROP_COLOR],
        }
    }

    /// The code that a pair of floats of [`Self::interop`] stands for; `None` for pairs that stand for none.
    ///
    /// - `is_scalar`: whether colors are values of a scalar layer, and no packed RGB or numbers of entries
    pub fn from_interop([x, y]: [f32; 2], stack: [u32; 2], is_scalar: bool) -> Option<Self> {
        if !(x.is_finite() && y.is_finite()) {
            return None;
        }
        if y < INTEROP_COLOR {
            let position = [x * stack[0] as f32, y * stack[1] as f32];
            let code = Self::texture(position)?;
            let [u, v] = code.position()?;
            let near = |a: f32, b: f32| (a - b).abs() < 0.25 / SUBTEXELS as f32;
            return (near(u, position[0]) && near(v, position[1])).then_some(code);
        }
        if is_scalar {
            return (y == INTEROP_COLOR && (0.0..=1.0).contains(&x)).then(|| Self::color(x));
        }
        let whole =
            |n: f32, limit: u32| (n >= 0.0 && n.fract() == 0.0 && n < limit as f32).then_some(n as u32);
        let high = whole(y - INTEROP_COLOR, u32::from(COLOR_FLAG))?;
        let low = whole(x, if high == 0 { TABLE_LIMIT as u32 } else { 1 << LOW_BITS })?;
        Some(Self::from_bits((high << LOW_BITS) + low))
    }

    /// The 31 bits beside the flag.
    #[inline]
    fn bits(self) -> Option<u32> {
        self.is_color().then(|| u32::from(self.0[1] & !COLOR_FLAG) << LOW_BITS | u32::from(self.0[0]))
    }

    #[inline]
    fn from_bits(bits: u32) -> Self {
        Self([bits as u16, COLOR_FLAG | (bits >> LOW_BITS) as u16])
    }
}

/// The nearest of `steps` equal steps; NaN is 0.
#[inline]
fn steps(value: f32, steps: u32) -> u32 {
    (value.clamp(0.0, 1.0) * steps as f32).round() as u32
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Table;
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
        assert_eq!(LightCode::color(1.0).interop([8, 16], &Form::Scalar), [1.0, 2.0]);
        let corner = LightCode::texture([4.0, 16.0]).expect("in range");
        for form in [Form::Scalar, Form::Rgb] {
            assert_eq!(corner.interop([8, 16], &form), [0.5, 1.0]);
        }
        assert_eq!((corner.value(), corner.rgb(), corner.index()), (None, None, None));
        let table = Table::build(&[0.5], 1, 0.0).expect("one entry").0;
        let entry = LightCode::color_index(70_000).expect("in range");
        assert_eq!(entry.interop([8, 16], &Form::Table(&table)), [70_000.0, 2.0]);
        let white = LightCode::color_rgb([1.0; 3]).interop([8, 16], &Form::Rgb);
        assert_eq!(white, [65535.0, 2.0 + 32767.0]);
    }

    #[test]
    fn code_of_pairs_that_stand_for_none_is_none() {
        let none = |pair, is_scalar| LightCode::from_interop(pair, [8, 8], is_scalar).is_none();
        for pair in [[f32::NAN, 2.0], [0.5, f32::INFINITY], [-0.1, 0.5], [0.5, -0.1], [1.0 / 128.0, 0.5]] {
            assert!(none(pair, true) && none(pair, false), "{pair:?}");
        }
        assert!(none([0.5, 3.0], true) && none([1.5, 2.0], true));
        assert!(none([0.5, 2.0], false) && none([65536.0, 3.0], false) && none([1.0, 2.5], false));
    }

    #[test]
    fn code_bits_are_those_of_the_format() {
        assert_eq!(LightCode::color(1.0), LightCode([65535, 0x8000]));
        // r = 1023, g = 0, b = 0 and so on.
        assert_eq!(LightCode::color_rgb([1.0, 0.0, 0.0]), LightCode([0, 0x8000 | (1023 << 5)]));
        assert_eq!(LightCode::color_rgb([0.0, 1.0, 0.0]), LightCode([63 << 10, 0x8000 | 31]));
        assert_eq!(LightCode::color_rgb([0.0, 0.0, 1.0]), LightCode([1023, 0x8000]));
        assert_eq!(LightCode::color_index(0x0001_0002), Some(LightCode([2, 0x8001])));
        assert_eq!(LightCode::color_index(TABLE_LIMIT as u32), None);
        assert_eq!(LightCode::color_of(&[0.3]), LightCode::color(0.3));
        assert_eq!(LightCode::color_of(&[0.3, 0.4]), LightCode::color_rgb([0.3, 0.4, 0.0]));
        assert_eq!(LightCode::color_of(&[0.3, 0.4, 0.5, 0.6]), LightCode::color_rgb([0.3, 0.4, 0.5]));
        assert_eq!(LightCode::color_of(&[]), LightCode::color_rgb([0.0; 3]));
    }

    #[test]
    fn code_rgb_is_clamped() {
        let [low, high] = [f32::NEG_INFINITY, f32::INFINITY];
        assert_eq!(LightCode::color_rgb([low, high, f32::NAN]).rgb(), Some([0.0, 1.0, 0.0]));
        assert_eq!(LightCode::color_rgb([-0.1, 1.1, 7.0]).rgb(), Some([0.0, 1.0, 1.0]));
    }

    proptest! {
        #[test]
        fn code_round_trip_is_within_half_a_step(value in 0.0_f32..=1.0, u in 0.0_f32..8191.9, v in 0.0_f32..4095.9) {
            let shown = LightCode::color(value).value().expect("a color");
            prop_assert!((shown - value).abs() <= 0.5 / 65535.0 + 1e-7);
            let [x, y] = LightCode::texture([u, v]).expect("in range").position().expect("a place");
            prop_assert!((x - u).abs() <= 0.5 / 8.0 && (y - v).abs() <= 0.5 / 8.0);
        }

        #[test]
        fn code_rgb_round_trip_is_within_half_a_step(r in 0.0_f32..=1.0, g in 0.0_f32..=1.0, b in 0.0_f32..=1.0) {
            let code = LightCode::color_rgb([r, g, b]);
            prop_assert!(code.is_color() && code.position().is_none());
            let shown = code.rgb().expect("a color");
            for ((shown, value), steps) in shown.iter().zip([r, g, b]).zip(RGB_STEPS) {
                prop_assert!((shown - value).abs() <= 0.5 / steps as f32 + 1e-7);
            }
            // What is shown is a fixed point, so packing twice changes nothing.
            prop_assert_eq!(LightCode::color_rgb(shown), code);
        }

        #[test]
        fn code_interop_round_trip_is_exact(
            bits in 0..1_u32 << 31, x in any::<u16>(), y in 0..COLOR_FLAG, width in 1_u32..=1024, height in 1_u32..=1023,
        ) {
            let stack = [width * 4, height * 4];
            let table = Table::build(&[0.5], 1, 0.0).expect("one entry").0;
            let scalar = LightCode([x, COLOR_FLAG]);
            let entry = LightCode::color_index(bits % TABLE_LIMIT as u32).expect("in range");
            for (code, form) in
                [(scalar, Form::Scalar), (LightCode::from_bits(bits), Form::Rgb), (entry, Form::Table(&table))]
            {
                let is_scalar = matches!(form, Form::Scalar);
                prop_assert_eq!(LightCode::from_interop(code.interop(stack, &form), stack, is_scalar), Some(code));
            }
            let place = LightCode([x % (stack[0] * 8) as u16, y % (stack[1] * 8) as u16]);
            for is_scalar in [true, false] {
                let pair = place.interop(stack, &Form::Scalar);
                prop_assert_eq!(LightCode::from_interop(pair, stack, is_scalar), Some(place));
            }
        }

        #[test]
        fn code_index_round_trip_is_exact(index in 0..TABLE_LIMIT as u32) {
            let code = LightCode::color_index(index).expect("in range");
            prop_assert_eq!((code.index(), code.position()), (Some(index), None));
            prop_assert_eq!(index as f32 as u32, index);
        }
    }
}
