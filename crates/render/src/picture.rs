//! Pixels: what each place of a picture sees, sheets of pictures, PNG.

use glam::Vec3;
use lightkiln_light::{Hit, Surfaces, Tracer};
use rayon::prelude::*;

use crate::Camera;

/// What keeps a picture from being made.
#[derive(Debug, thiserror::Error)]
pub enum RenderError {
    /// Pictures of different heights cannot stand side by side.
    #[error("pictures of {heights:?} pixels' height do not stand side by side")]
    Heights {
        /// Heights in pixels.
        heights: Vec<usize>,
    },
    /// The PNG encoder refused.
    #[error("png: {0}")]
    Png(#[from] png::EncodingError),
}

/// Linear RGB, row by row from the top.
#[derive(Clone, Debug, PartialEq)]
pub struct Picture {
    /// Pixels per row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// `width * height` colors, linear, `0..=1` where nothing glows.
    pub pixels: Vec<Vec3>,
}

/// What a picture shows where it sees nothing: a wall that neither open nor closed light is lost against.
const BACKGROUND: Vec3 = Vec3::new(0.28, 0.32, 0.38);

/// Places within a pixel, rotated so that edges of all slopes are smooth.
const PLACES: [[f32; 2]; 4] = [[0.375, 0.125], [0.875, 0.375], [0.125, 0.625], [0.625, 0.875]];

/// Surfaces that a ray looks through before it gives up.
const MOST_LAYERS: usize = 64;

/// Renders a square picture; `color` turns what a pixel sees into linear RGB.
pub fn render(
    tracer: &Tracer<'_>,
    surfaces: &dyn Surfaces,
    camera: &Camera,
    size: usize,
    color: &(dyn Fn(&Hit) -> Vec3 + Sync),
) -> Picture {
    let pixels = (0..size * size)
        .into_par_iter()
        .map(|pixel| {
            let (column, row) = (pixel % size, pixel / size);
            let seen = PLACES.map(|[dx, dy]| {
                let x = (column as f32 + dx) / size as f32 * 2.0 - 1.0;
                let y = 1.0 - (row as f32 + dy) / size as f32 * 2.0;
                let (origin, direction) = camera.ray(x, y);
                first_visible(tracer, surfaces, origin, direction).map_or(BACKGROUND, |hit| color(&hit))
            });
            seen.iter().sum::<Vec3>() / PLACES.len() as f32
        })
        .collect();
    Picture { width: size, height: size, pixels }
}

/// The first hit that a viewer would show: no back of a single-sided triangle, nothing mostly transparent.
fn first_visible(tracer: &Tracer<'_>, surfaces: &dyn Surfaces, origin: Vec3, direction: Vec3) -> Option<Hit> {
    let mut start = 0.0_f32;
    for _ in 0..MOST_LAYERS {
        let mut hit = tracer.closest(origin + direction * start, direction, f32::INFINITY)?;
        hit.distance += start;
        let flags = surfaces.flags(hit.triangle);
        let culled = hit.back && !flags.double_sided;
        let thin = flags.translucent && surfaces.opacity(hit.triangle, hit.barycentric) < 0.5;
        if !culled && !thin {
            return Some(hit);
        }
        start = hit.distance * (1.0 + 1e-6) + 1e-7;
    }
    None
}

impl Picture {
    /// Pictures of one height side by side, with a thin white line between them.
    ///
    /// # Errors
    /// [`RenderError::Heights`].
    pub fn row(pictures: &[Self]) -> Result<Self, RenderError> {
        const LINE: usize = 4;
        let heights: Vec<usize> = pictures.iter().map(|p| p.height).collect();
        if heights.windows(2).any(|w| w[0] != w[1]) {
            return Err(RenderError::Heights { heights });
        }
        let height = heights.first().copied().unwrap_or(0);
        let width = pictures.iter().map(|p| p.width + LINE).sum::<usize>().saturating_sub(LINE);
        let mut pixels = Vec::with_capacity(width * height);
        for row in 0..height {
            for (number, picture) in pictures.iter().enumerate() {
                if number > 0 {
                    pixels.extend([Vec3::ONE; LINE]);
                }
                pixels.extend_from_slice(&picture.pixels[row * picture.width..(row + 1) * picture.width]);
            }
        }
        Ok(Self { width, height, pixels })
    }

    /// The picture as an 8-bit sRGB PNG.
    ///
    /// # Errors
    /// [`RenderError::Png`].
    pub fn to_png(&self) -> Result<Vec<u8>, RenderError> {
        let mut bytes = Vec::new();
        let mut encoder = png::Encoder::new(&mut bytes, self.width as u32, self.height as u32);
        encoder.set_color(png::ColorType::Rgb);
        encoder.set_depth(png::BitDepth::Eight);
        let mut writer = encoder.write_header()?;
        let data: Vec<u8> = self.pixels.iter().flat_map(|p| p.to_array().map(srgb)).collect();
        writer.write_image_data(&data)?;
        writer.finish()?;
        Ok(bytes)
    }
}

/// The 8-bit sRGB code of a linear value (IEC 61966-2-1).
fn srgb(linear: f32) -> u8 {
    let value = linear.clamp(0.0, 1.0);
    let encoded = if value <= 0.003_130_8 { 12.92 * value } else { 1.055 * value.powf(1.0 / 2.4) - 0.055 };
    (encoded * 255.0).round() as u8
}

#[cfg(test)]
mod tests {
    use super::*;

    fn plain(width: usize, height: usize, value: f32) -> Picture {
        Picture { width, height, pixels: vec![Vec3::splat(value); width * height] }
    }

    #[test]
    fn row_of_pictures_has_a_line_between() {
        let row = Picture::row(&[plain(3, 2, 0.0), plain(5, 2, 0.5)]).unwrap();
        assert_eq!((row.width, row.height, row.pixels.len()), (12, 2, 24));
        assert_eq!((row.pixels[2].x, row.pixels[3].x, row.pixels[7].x), (0.0, 1.0, 0.5));
        assert!(Picture::row(&[plain(1, 2, 0.0), plain(1, 3, 0.0)]).is_err());
    }

    #[test]
    fn srgb_of_known_values_matches_the_standard() {
        assert_eq!((srgb(0.0), srgb(1.0), srgb(0.215_86), srgb(2.0)), (0, 255, 128, 255));
    }

    #[test]
    fn png_of_a_picture_has_its_signature() {
        assert_eq!(&plain(2, 2, 0.3).to_png().unwrap()[1..4], b"PNG");
    }
}
