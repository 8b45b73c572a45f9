//! What is seen where there is nothing else: a constant, or an image of all directions.
//!
//! Bright parts are sampled by a cumulative distribution of rows and one of the texels of each row (Pharr, Jakob and
//! Humphreys 2023, §12.5). What is at most as bright as the mean is left to cosine-weighted rays, which do well there:
//! "MIS compensation" (Karlík et al. 2019, eq. 12). A constant environment is not sampled at all.

use std::f32::consts::{PI, TAU};

use glam::Vec3;

use crate::LightError;
use crate::lights::luminance;

/// Radiance of every direction, in world space; +y is up.
///
/// An image is latitude by longitude: the first row is above, and the middle column shows +x, the one a quarter of
/// the width to the right of it +z. Texels are constant, not interpolated.
///
/// Memory: 16 bytes a texel.
#[derive(Clone, Debug)]
pub struct Environment {
    width: usize,
    height: usize,
    /// cd/m2.
    pixels: Vec<Vec3>,
    /// In turns.
    rotation: f32,
    /// Cosine of the angle from +y at the upper end of each row, and at the lower end of the last.
    levels: Vec<f32>,
    /// Cumulative shares of the rows in what is sampled, from 0 to 1; empty if nothing is.
    rows: Vec<f32>,
    /// The same for the texels of each row, `width + 1` a row.
    columns: Vec<f32>,
    mean: f32,
    /// Integral over directions of the luminance that is sampled.
    sampled: f32,
}

impl Environment {
    /// The same radiance everywhere, cd/m2.
    ///
    /// # Errors
    /// [`LightError::Environment`] for negative numbers, infinity and NaN, and for no light at all.
    pub fn constant(radiance: Vec3) -> Result<Self, LightError> {
        Self::lat_long(1, 1, vec![radiance], 0.0, 1.0)
    }

    /// An image of all directions.
    ///
    /// - `pixels`: row by row, `width * height`, linear
    /// - `rotation`: radians by which the image is turned about +y, counter-clockwise seen from above
    /// - `intensity`: cd/m2 of a texel of 1
    ///
    /// # Errors
    /// [`LightError::EnvironmentSize`] for an empty image and for pixels that do not fit the size,
    /// [`LightError::Environment`] for negative numbers, infinity and NaN, and for no light at all.
    pub fn lat_long(
        width: usize,
        height: usize,
        mut pixels: Vec<Vec3>,
        rotation: f32,
        intensity: f32,
    ) -> Result<Self, LightError> {
        if width == 0 || height == 0 || width.checked_mul(height) != Some(pixels.len()) {
            return Err(LightError::EnvironmentSize { width, height, pixels: pixels.len() });
        }
        if !rotation.is_finite() || !intensity.is_finite() || intensity < 0.0 {
            return Err(LightError::Environment { pixel: None });
        }
        for (pixel, color) in pixels.iter_mut().enumerate() {
            *color *= intensity;
            if !color.is_finite() || color.min_element() < 0.0 {
                return Err(LightError::Environment { pixel: Some(pixel) });
            }
        }
        let levels: Vec<f32> = (0..=height)
            .map(|row| (row as f64 / height as f64 * std::f64::consts::PI).cos() as f32)
            .collect();
        let mut environment = Self {
            width,
            height,
            pixels,
            rotation: rotation / TAU,
            levels,
            rows: Vec::new(),
            columns: Vec::new(),
            mean: 0.0,
            sampled: 0.0,
        };
        environment.mean = environment.integral(luminance) / (4.0 * PI);
        if environment.mean <= 0.0 {
            return Err(LightError::Environment { pixel: None });
        }
        environment.tabulate();
        Ok(environment)
    }

    /// Solid angle of a texel.
    fn solid_angle(&self, row: usize) -> f64 {
        std::f64::consts::TAU * f64::from(self.levels[row] - self.levels[row + 1]) / self.width as f64
    }

    fn integral(&self, of: impl Fn(Vec3) -> f32) -> f32 {
        let rows = self.pixels.chunks(self.width).enumerate();
        rows.map(|(row, texels)| {
            texels.iter().map(|&c| f64::from(of(c))).sum::<f64>() * self.solid_angle(row)
        })
        .sum::<f64>() as f32
    }

    /// The luminance of a color that is left to be sampled.
    fn bright(&self, color: Vec3) -> f32 {
        let above = luminance(color) - self.mean;
        // A little more than the rounding of the mean of equal texels.
        if above > 1e-4 * self.mean { above } else { 0.0 }
    }

    fn tabulate(&mut self) {
        let total = f64::from(self.integral(|color| self.bright(color)));
        if total <= 0.0 {
            return;
        }
        self.sampled = total as f32;
        let mut rows = vec![0.0];
        let mut columns = Vec::with_capacity((self.width + 1) * self.height);
        let mut before = 0.0;
        for (row, texels) in self.pixels.chunks(self.width).enumerate() {
            let sum: f64 = texels.iter().map(|&c| f64::from(self.bright(c))).sum();
            before += sum * self.solid_angle(row);
            rows.push((before / total) as f32);
            let mut left = 0.0;
            columns.push(0.0);
            for &color in texels {
                left += f64::from(self.bright(color));
                columns.push(if sum > 0.0 { (left / sum) as f32 } else { 1.0 });
            }
        }
        (self.rows, self.columns) = (rows, columns);
    }

    /// Mean radiance over all directions, cd/m2 of luminance.
    pub fn mean_luminance(&self) -> f32 {
        self.mean
    }

    /// Mean luminance of what is sampled; 0 if nothing is.
    pub(crate) fn sampled_luminance(&self) -> f32 {
        self.sampled / (4.0 * PI)
    }

    /// What is seen in a direction of unit length, cd/m2.
    pub fn radiance(&self, direction: Vec3) -> Vec3 {
        self.pixels[self.texel(direction)]
    }

    fn texel(&self, direction: Vec3) -> usize {
        let row = if self.height == 1 {
            0
        } else {
            let angle = direction.x.hypot(direction.z).atan2(direction.y);
            ((angle / PI * self.height as f32) as usize).min(self.height - 1)
        };
        let column = if self.width == 1 {
            0
        } else {
            let turn = direction.z.atan2(direction.x) / TAU + 0.5 + self.rotation;
            (((turn - turn.floor()) * self.width as f32) as usize).min(self.width - 1)
        };
        row * self.width + column
    }

    /// What is seen in a direction, and the solid angle density with which [`Self::sample`] gives it.
    pub(crate) fn look(&self, direction: Vec3) -> (Vec3, f32) {
        let radiance = self.radiance(direction);
        let density = if self.sampled > 0.0 { self.bright(radiance) / self.sampled } else { 0.0 };
        (radiance, density)
    }

    /// A direction, its radiance and its density; none if nothing is sampled.
    pub(crate) fn sample(&self, [x, y]: [f32; 2]) -> Option<(Vec3, Vec3, f32)> {
        if self.sampled <= 0.0 {
            return None;
        }
        let (row, down) = find(&self.rows, y);
        let own = &self.columns[row * (self.width + 1)..(row + 1) * (self.width + 1)];
        let (column, across) = find(own, x);
        let level = self.levels[row] + (self.levels[row + 1] - self.levels[row]) * down;
        let turn = (column as f32 + across) / self.width as f32 - 0.5 - self.rotation;
        let (sin, cos) = (turn * TAU).sin_cos();
        let ring = (1.0 - level * level).max(0.0).sqrt();
        let radiance = self.pixels[row * self.width + column];
        Some((Vec3::new(ring * cos, level, ring * sin), radiance, self.bright(radiance) / self.sampled))
    }
}

/// The step of a cumulative distribution that a number falls into, and how far into it.
fn find(cumulative: &[f32], x: f32) -> (usize, f32) {
    let step = cumulative.partition_point(|&c| c <= x).clamp(1, cumulative.len() - 1) - 1;
    let (low, high) = (cumulative[step], cumulative[step + 1]);
    (step, if high > low { ((x - low) / (high - low)).clamp(0.0, 1.0) } else { 0.5 })
}

#[cfg(test)]
mod tests {
    use lightkiln_mesh::random;

    use super::*;

    fn patchy() -> Environment {
        let pixels = (0..24 * 12_u64)
            .map(|i| {
                let h = random::unit(random::hash(6, i, 0, 0));
                Vec3::splat(if h > 0.9 { 40.0 * h } else { h })
            })
            .collect();
        Environment::lat_long(24, 12, pixels, 1.1, 2.0).unwrap()
    }

    #[test]
    fn sampling_gives_the_density_that_it_says() {
        let environment = patchy();
        let mut sum = 0.0;
        let count = 20_000;
        for i in 0..count {
            let (direction, radiance, density) =
                environment.sample(random::unit2(random::hash(1, i, 0, 0))).unwrap();
            assert!((direction.length() - 1.0).abs() < 1e-5);
            // Rounding may move a direction on a texel's border to the next texel.
            if environment.radiance(direction) == radiance {
                assert_eq!(environment.look(direction), (radiance, density));
                sum += 1.0;
            }
        }
        assert!(sum > 0.999 * count as f32);
    }

    #[test]
    fn sampling_integrates_what_is_bright() {
        // The solid angle of all bright texels, by samples and by sum.
        let environment = patchy();
        let count = 200_000;
        let mut by_samples = 0.0_f64;
        for i in 0..count {
            let (_, _, density) = environment.sample(random::unit2(random::hash(1, i, 0, 0))).unwrap();
            by_samples += 1.0 / f64::from(density) / count as f64;
        }
        let by_sum = environment.integral(|color| f32::from(u8::from(environment.bright(color) > 0.0)));
        assert!((by_samples / f64::from(by_sum) - 1.0).abs() < 0.01, "{by_samples} {by_sum}");
    }

    #[test]
    fn image_shows_its_middle_along_x_and_its_first_row_above() {
        let pixels: Vec<Vec3> = (0..8 * 4_u16).map(|i| Vec3::splat(f32::from(i) + 1.0)).collect();
        let at = |environment: &Environment, d: Vec3| environment.radiance(d.normalize()).x as usize - 1;
        let image = |rotation| Environment::lat_long(8, 4, pixels.clone(), rotation, 1.0).unwrap();
        let still = image(0.0);
        assert_eq!(at(&still, Vec3::new(1.0, 0.1, 0.1)), 8 + 4);
        assert_eq!(at(&still, Vec3::new(1.0, 0.1, -0.1)), 8 + 3);
        assert_eq!(at(&still, Vec3::new(-0.1, 0.1, 1.0)), 8 + 6);
        assert_eq!(at(&still, Vec3::new(0.1, -1.0, 0.01)) / 8, 3);
        // A quarter turn counter-clockwise from above takes +x to -z.
        assert_eq!(at(&image(PI / 2.0), Vec3::new(0.1, 0.1, -1.0)), 8 + 4);
    }

    #[test]
    fn constant_is_the_same_everywhere_and_not_sampled() {
        let environment = Environment::constant(Vec3::new(1.0, 2.0, 3.0)).unwrap();
        assert_eq!(environment.radiance(Vec3::NEG_Y), Vec3::new(1.0, 2.0, 3.0));
        assert!(environment.sample([0.3, 0.3]).is_none());
        assert!((environment.mean_luminance() - luminance(Vec3::new(1.0, 2.0, 3.0))).abs() < 1e-5);
    }
}
