//! From radiance to what a screen shows.

use glam::Vec3;

/// What becomes of light that is brighter than a screen.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Tone {
    /// Khronos PBR Neutral (Khronos Group 2024): base colors stay what they are, highlights are compressed from 0.76 on
    /// and lose their color on the way to white.
    #[default]
    Neutral,
    /// It is cut off at 1.
    Clip,
}

impl Tone {
    /// - `color`: linear, 1 for white; not below 0
    /// - returns: linear, `0..=1`
    pub fn map(self, color: Vec3) -> Vec3 {
        match self {
            Self::Neutral => neutral(color),
            Self::Clip => color,
        }
        .clamp(Vec3::ZERO, Vec3::ONE)
    }
}

/// Reflectance of a dielectric that faces the eye: what a renderer adds to a base color, and the curve takes away.
const FRESNEL: f32 = 0.04;
/// Where compression begins.
const START: f32 = 0.8 - FRESNEL;
/// How soon highlights lose their color.
const DESATURATION: f32 = 0.15;

fn neutral(color: Vec3) -> Vec3 {
    let least = color.min_element();
    let offset = if least < 2.0 * FRESNEL { least - least * least / (4.0 * FRESNEL) } else { FRESNEL };
    let color = color - offset;
    let peak = color.max_element();
    if peak < START {
        return color;
    }
    let room = 1.0 - START;
    let compressed = 1.0 - room * room / (peak + room - START);
    let kept = 1.0 / (DESATURATION * (peak - compressed) + 1.0);
    Vec3::splat(compressed).lerp(color * (compressed / peak), kept)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn neutral_keeps_base_colors_and_ends_at_white() {
        // A diffuse color with the reflection of a dielectric on it comes out as the color.
        let color = Vec3::new(0.6, 0.3, 0.1);
        assert!(Tone::Neutral.map(color + 0.04).abs_diff_eq(color, 1e-6));
        assert_eq!(Tone::Neutral.map(Vec3::ZERO), Vec3::ZERO);
        // By hand: 0.03 less, peak 9.97, compressed 1 - 0.0576 / 9.45, kept 1 / (0.15 * 8.976 + 1).
        let bright = Tone::Neutral.map(Vec3::new(10.0, 5.0, 0.04));
        assert!((bright.x - 0.993_905).abs() < 1e-5, "{bright}");
        assert!((bright.y - 0.781_48).abs() < 1e-4, "{bright}");
        assert!(Tone::Neutral.map(Vec3::splat(1e6)).abs_diff_eq(Vec3::ONE, 1e-5));
        assert_eq!(Tone::Clip.map(Vec3::new(0.5, 1.5, 0.0)), Vec3::new(0.5, 1.0, 0.0));
    }

    proptest! {
        #[test]
        fn neutral_grows_with_light(gray in 0.0..50.0_f32, more in 0.001..1.0_f32) {
            let [low, high] = [gray, gray + more].map(|x| Tone::Neutral.map(Vec3::splat(x)).x);
            prop_assert!(low <= high && high <= 1.0);
        }
    }
}
