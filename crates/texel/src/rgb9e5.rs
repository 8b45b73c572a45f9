//! Three channels in 32 bits: mantissas of 9 bits with one exponent of 5 bits (EXT_texture_shared_exponent, which
//! Vulkan and KTX call E5B9G9R9).
//!
//! A channel is mantissa x 2^(exponent - 15 - 9), mantissas at bits 0, 9 and 18, the exponent at bit 27. The largest
//! channel keeps 8 bits behind its leading one, so its relative error is below 2^-9 (from 2^-16 on); the others have
//! its absolute error.

/// Bits of a mantissa.
const MANTISSA: i32 = 9;
/// What is taken from the stored exponent.
const BIAS: i32 = 15;
/// The greatest value: 511 / 512 x 2^16.
pub const LARGEST: f32 = 65408.0;

/// 2^`power` for powers of normal numbers.
fn exp2(power: i32) -> f64 {
    f64::from_bits(((1023 + power) as u64) << 52)
}

/// Packs red, green and blue. Negative values and NaN become 0, what is above [`LARGEST`] becomes it.
pub fn pack(rgb: [f32; 3]) -> u32 {
    let rgb = rgb.map(|c| if c.is_nan() { 0.0 } else { f64::from(c.clamp(0.0, LARGEST)) });
    let most = rgb[0].max(rgb[1]).max(rgb[2]);
    // The floor of the logarithm stands in the bits; 0 and everything small take the lowest exponent.
    let floor_log2 = ((most.to_bits() >> 52) as i32 - 1023).max(-BIAS - 1);
    let round = |value: f64, exponent: i32| (value / exp2(exponent - BIAS - MANTISSA) + 0.5).floor() as u32;
    let mut exponent = floor_log2 + 1 + BIAS;
    if round(most, exponent) == 1 << MANTISSA {
        exponent += 1;
    }
    let [r, g, b] = rgb.map(|c| round(c, exponent));
    (exponent as u32) << 27 | b << 18 | g << 9 | r
}

/// The three channels of a packed texel; every bit pattern has a value.
pub fn unpack(bits: u32) -> [f32; 3] {
    let step = exp2((bits >> 27) as i32 - BIAS - MANTISSA);
    [0, 9, 18].map(|shift| (f64::from(bits >> shift & 0x1ff) * step) as f32)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn rgb9e5_known_values() {
        assert_eq!(pack([0.0; 3]), 0);
        // 1 = 256 x 2^(16 - 24).
        assert_eq!(pack([1.0, 0.5, 0.0]), 16 << 27 | 128 << 9 | 256);
        assert_eq!(pack([LARGEST; 3]), u32::MAX);
        assert_eq!(pack([f32::INFINITY, f32::NAN, -3.0]), 31 << 27 | 511);
        assert_eq!(unpack(u32::MAX), [LARGEST; 3]);
        // 511.75 steps round up to the next exponent.
        assert_eq!(unpack(pack([511.75, 0.0, 0.0])), [512.0, 0.0, 0.0]);
    }

    proptest! {
        #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::with_cases(2000) })]

        #[test]
        fn rgb9e5_round_trip_keeps_the_largest_channel(
            power in -16.0..15.99_f32, shares in prop::array::uniform3(0.0..=1.0_f32), first in 0..3_usize,
        ) {
            let mut rgb = shares.map(|s| s * power.exp2());
            rgb[first] = power.exp2().min(LARGEST);
            let back = unpack(pack(rgb));
            let most = rgb[first];
            prop_assert!((back[first] - most).abs() < most / 512.0);
            for (a, b) in rgb.iter().zip(back) {
                prop_assert!((a - b).abs() <= most / 512.0);
            }
        }

        #[test]
        fn rgb9e5_values_of_texels_are_kept(bits in any::<u32>()) {
            // Several patterns may stand for one value; the value survives.
            let rgb = unpack(bits);
            prop_assert_eq!(unpack(pack(rgb)), rgb);
        }
    }
}
