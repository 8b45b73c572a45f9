//! What a surface sends to the eye: a simple model of the materials of glTF.
//!
//! ```text
//! radiance = (1 - metallic) base / pi E + F L + emission
//! F = F0 + (max(1 - roughness, F0) - F0) (1 - n v)^5        F0 = 0.04 (1 - metallic) + base metallic
//! ```
//!
//! E is the light that arrives, in lux, after occlusion. What is reflected is not known from it, so the dome of the studio (docs/LIGHT.md)
//! stands in for all surroundings, as bright as it has to be to give E: L is its radiance in the mirrored direction,
//! blended with its mean over the hemisphere, `E / pi`, by the roughness. So metals have their color and a horizon, and
//! reflect less where less light arrives; there are no highlights of lamps. F is Schlick's, held down on rough surfaces.

use std::f32::consts::PI;

use glam::Vec3;
use lightkiln_scene::Finish;

/// A dome whose radiance goes evenly with height, 1 at the horizon.
const SLOPE: f32 = 0.5;

/// The radiance of the dome in a direction of unit length, 1 at the horizon.
pub fn dome_radiance(direction: Vec3) -> f32 {
    1.0 + SLOPE * direction.y
}

/// The irradiance of the dome on a surface of that normal.
pub fn dome_irradiance(normal: Vec3) -> f32 {
    PI * (1.0 + SLOPE * 2.0 / 3.0 * normal.y)
}

/// What a material scatters and what it reflects, cd/m², without emission and as if it covered everything and let
/// nothing pass.
///
/// - `normal`: of unit length, on the side that is seen
/// - `to_eye`: of unit length
/// - `light`: E times occlusion, lux
pub fn radiance(finish: &Finish, normal: Vec3, to_eye: Vec3, light: Vec3) -> [Vec3; 2] {
    let Finish { base_color, metallic, roughness, .. } = *finish;
    let base_color = Vec3::from_array(base_color);
    let scattered = base_color * (1.0 - metallic) / PI * light;
    let cosine = normal.dot(to_eye).clamp(0.0, 1.0);
    let facing = Vec3::splat(0.04).lerp(base_color, metallic);
    let grazing = facing.max(Vec3::splat(1.0 - roughness));
    let fresnel = facing + (grazing - facing) * (1.0 - cosine).powi(5);
    let mirrored = (2.0 * normal.dot(to_eye) * normal - to_eye).normalize_or(normal);
    let sharp = dome_radiance(mirrored) / dome_irradiance(normal);
    let seen = sharp + (1.0 / PI - sharp) * roughness;
    [scattered, fresnel * seen * light]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn dome_irradiance_is_the_integral_of_its_radiance() {
        for normal in [Vec3::Y, Vec3::X, -Vec3::Y, Vec3::new(0.6, -0.8, 0.0)] {
            let (mut sum, steps) = (0.0_f64, 400);
            for i in 0..steps {
                for j in 0..steps {
                    let height: f32 = (i as f32 + 0.5) / steps as f32 * 2.0 - 1.0;
                    let around = (j as f32 + 0.5) / steps as f32 * 2.0 * PI;
                    let level = (1.0 - height * height).sqrt();
                    let w = Vec3::new(level * around.cos(), height, level * around.sin());
                    sum += f64::from(dome_radiance(w) * w.dot(normal).max(0.0));
                }
            }
            let integral = sum * f64::from(4.0 * PI) / f64::from(steps * steps);
            assert!((integral as f32 - dome_irradiance(normal)).abs() < 2e-3, "{normal}: {integral}");
        }
    }

    fn finish(base_color: [f32; 3], metallic: f32, roughness: f32) -> Finish {
        let (occlusion, covered, passes, unlit) = (1.0, 1.0, 0.0, false);
        Finish { base_color, metallic, roughness, occlusion, covered, passes, unlit }
    }

    #[test]
    fn finish_without_gloss_scatters_albedo_over_pi() {
        let matt = finish([0.8, 0.4, 0.2], 0.0, 1.0);
        let [scattered, reflected] = radiance(&matt, Vec3::Y, Vec3::Y, Vec3::splat(PI));
        assert!(scattered.abs_diff_eq(Vec3::new(0.8, 0.4, 0.2), 1e-6));
        // F0 times the mean radiance.
        assert!(reflected.abs_diff_eq(Vec3::splat(0.04), 1e-6));
        // At a grazing angle a rough surface reflects no more.
        let [_, grazing] = radiance(&matt, Vec3::Y, Vec3::X, Vec3::splat(PI));
        assert!(grazing.abs_diff_eq(reflected, 1e-6));
    }

    #[test]
    fn finish_of_metal_reflects_its_color_and_the_sky_more_than_the_ground() {
        let gold = finish([1.0, 0.8, 0.3], 1.0, 0.0);
        let light = Vec3::splat(dome_irradiance(Vec3::Z));
        let look = |to_eye: Vec3| radiance(&gold, Vec3::Z, to_eye.normalize(), light);
        let [scattered, sky] = look(Vec3::new(0.0, -1.0, 1.0));
        let [_, ground] = look(Vec3::new(0.0, 1.0, 1.0));
        assert_eq!(scattered, Vec3::ZERO);
        assert!(sky.x > 1.2 * ground.x, "{sky} {ground}");
        assert!((sky.y / sky.x - 0.8).abs() < 0.01);
        let up = dome_radiance(Vec3::new(0.0, 0.5_f32.sqrt(), 0.5_f32.sqrt()));
        assert!((sky.x - up).abs() < 0.01, "{sky} {up}");
    }
}
