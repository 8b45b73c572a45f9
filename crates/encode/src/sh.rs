//! Irradiance from spherical harmonics, for normal maps: the twin of `lightkilnLightSh1` and `..Sh2`.
//!
//! The layers `irradianceSh<k>` hold, per color, the coefficients `c_k` of the irradiance that arrives at each unit
//! normal: `E(n) = sum of c_k Y_k(n)`, with the real orthonormal basis of [`basis`] in the axes of the glTF scene.
//! The cosine is in the coefficients already. Bands 0 and 1 (four layers) or 0 to 2 (nine layers).
//!
//! Ramamoorthi and Hanrahan 2001, *An efficient representation for irradiance environment maps*, section 3.

use crate::constants::{SH_AXIS, SH_CONSTANT, SH_DIFFERENCE, SH_LINEAR, SH_PRODUCT};

/// The nine functions of bands 0 to 2 at a unit vector: `1; y, z, x; xy, yz, 3z² - 1, xz, x² - y²`, each by its factor.
#[inline]
pub fn basis([x, y, z]: [f32; 3]) -> [f32; 9] {
    let [constant, linear, product] = [SH_CONSTANT, SH_LINEAR, SH_PRODUCT].map(|factor| factor as f32);
    [
        constant,
        linear * y,
        linear * z,
        linear * x,
        product * (x * y),
        product * (y * z),
        SH_AXIS as f32 * (3.0 * z * z - 1.0),
        product * (x * z),
        SH_DIFFERENCE as f32 * (x * x - y * y),
    ]
}

/// The irradiance at a unit normal, never negative.
///
/// - `coefficients`: of one color, in the signal's unit; 4 or 9 of them, others beyond are ignored
#[inline]
pub fn irradiance(coefficients: &[f32], normal: [f32; 3]) -> f32 {
    coefficients.iter().zip(basis(normal)).map(|(c, y)| c * y).sum::<f32>().max(0.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Midpoints of equal areas of the sphere.
    fn sphere() -> impl Iterator<Item = [f32; 3]> {
        let (rows, columns) = (64, 64);
        (0..rows * columns).map(move |i| {
            let z = 1.0 - 2.0 * ((i / columns) as f32 + 0.5) / rows as f32;
            let (sin, cos) =
                (std::f32::consts::TAU * ((i % columns) as f32 + 0.5) / columns as f32).sin_cos();
            let r = (1.0 - z * z).sqrt();
            [r * cos, r * sin, z]
        })
    }

    #[test]
    fn sh_basis_is_orthonormal() {
        let area = 4.0 * std::f64::consts::PI / 4096.0;
        for a in 0..9 {
            for b in 0..9 {
                let sum: f64 = sphere().map(basis).map(|y| f64::from(y[a]) * f64::from(y[b])).sum();
                let expected = f64::from(u8::from(a == b));
                assert!((sum * area - expected).abs() < 2e-3, "{a} {b}: {}", sum * area);
            }
        }
    }

    #[test]
    fn sh_light_from_above_is_what_lambert_says() {
        // Radiance max(z, 0): its projection by the sum above, times pi, 2 pi / 3 and pi / 4 for the cosine. Facing up
        // it gives 2 pi / 3 of irradiance, facing down 0; bands 0 to 2 come close to both.
        let area = 4.0 * std::f32::consts::PI / 4096.0;
        let mut c = [0.0_f32; 9];
        for d in sphere() {
            for (c, y) in c.iter_mut().zip(basis(d)) {
                *c += y * d[2].max(0.0) * area;
            }
        }
        for (k, c) in c.iter_mut().enumerate() {
            *c *= std::f32::consts::PI * [1.0, 2.0 / 3.0, 2.0 / 3.0, 2.0 / 3.0].get(k).unwrap_or(&0.25);
        }
        let up = irradiance(&c, [0.0, 0.0, 1.0]);
        assert!((up / (std::f32::consts::TAU / 3.0) - 1.0).abs() < 0.02, "{up}");
        assert!(irradiance(&c, [0.0, 0.0, -1.0]) < 0.05 * up);
        assert_eq!(irradiance(&[-1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0]), 0.0);
        assert_eq!(irradiance(&[], [0.0, 1.0, 0.0]), 0.0);
    }
}
