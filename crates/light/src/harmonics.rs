//! Irradiance as a function of the normal, in real spherical harmonics.
//!
//! Ramamoorthi and Hanrahan 2001, "An Efficient Representation for Irradiance Environment Maps": the irradiance of a
//! normal is the radiance convolved with a clamped cosine, so its coefficients are those of the radiance times pi,
//! 2 pi / 3 and pi / 4 for the bands 0, 1 and 2 (eq. 8). Nine numbers keep 99 % of the energy of any light.

use std::f32::consts::PI;

use glam::Vec3;

/// Coefficients of three bands.
pub const COEFFICIENTS: usize = 9;

/// The harmonics in a direction of unit length, in the order of bands and within them of `m = -l..=l`:
/// 1; y, z, x; xy, yz, 3 z^2 - 1, xz, x^2 - y^2, times their constants (eq. 3).
pub fn basis(d: Vec3) -> [f32; COEFFICIENTS] {
    [
        0.282_094_8,
        0.488_602_5 * d.y,
        0.488_602_5 * d.z,
        0.488_602_5 * d.x,
        1.092_548_4 * d.x * d.y,
        1.092_548_4 * d.y * d.z,
        0.315_391_57 * (3.0 * d.z * d.z - 1.0),
        1.092_548_4 * d.x * d.z,
        0.546_274_2 * (d.x * d.x - d.y * d.y),
    ]
}

/// What the clamped cosine makes of a coefficient of radiance.
pub fn cosine_factor(coefficient: usize) -> f32 {
    match coefficient {
        0 => PI,
        1..4 => 2.0 * PI / 3.0,
        _ => PI / 4.0,
    }
}

/// Irradiance of a surface with this normal, lux; the coefficients may be 1, 4 or 9.
pub fn irradiance(coefficients: &[Vec3], normal: Vec3) -> Vec3 {
    coefficients.iter().zip(basis(normal)).map(|(&c, b)| c * b).sum()
}
