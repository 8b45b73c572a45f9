//! The transfer curve of sRGB (IEC 61966-2-1), which images of colors are stored through.

/// The linear value of an encoded one.
#[inline]
pub fn linear(encoded: f32) -> f32 {
    if encoded <= 0.040_45 { encoded / 12.92 } else { ((encoded + 0.055) / 1.055).powf(2.4) }
}

/// The encoded value of a linear one; below 0 as at 0.
#[inline]
pub fn encoded(linear: f32) -> f32 {
    if linear <= 0.003_130_8 { linear.max(0.0) * 12.92 } else { 1.055 * linear.powf(1.0 / 2.4) - 0.055 }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn srgb_round_trip_keeps_all_steps_of_8_bits_apart() {
        for step in 0..=255 {
            let value = step as f32 / 255.0;
            assert!((encoded(linear(value)) - value).abs() < 1e-5, "{step}");
        }
        assert_eq!((encoded(-1.0), linear(0.0)), (0.0, 0.0));
    }
}
