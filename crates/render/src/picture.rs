//! Pixels: what each place of a picture sees, and PNG.
//!
//! Rays through one point are traced in bundles of neighbours. Edges are smooth: where a pixel differs from one of its
//! neighbours it is seen again from four places within it.

use glam::{Vec3, Vec4};
use lightkiln_light::{Hit, Surfaces, Tracer};
use lightkiln_scene::srgb;
use rayon::prelude::*;

use crate::{Camera, Ray, RenderError, Sight};

/// Linear RGB times coverage, and the coverage (premultiplied alpha), row by row from the top.
#[derive(Clone, Debug, PartialEq)]
pub struct Picture {
    /// Pixels per row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// `width * height` colors; `0..=1` in what is to be shown on a screen.
    pub pixels: Vec<Vec4>,
}

/// Where a pixel is seen from more than one place within it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Smoothing {
    /// Where it differs from its neighbours. Things narrower than a pixel may be missed.
    Edges,
    /// Everywhere: for colors with noise, or on no scale on which a difference means something.
    Everywhere,
}

/// Places within a pixel, rotated so that edges of all slopes are smooth.
pub const PLACES: [[f32; 2]; 4] = [[0.375, 0.125], [0.875, 0.375], [0.125, 0.625], [0.625, 0.875]];

/// The middle of a pixel.
const MIDDLE: [f32; 2] = [0.5; 2];

/// Colors that are farther apart than this differ. They are compared by their square roots, which is about what eyes do:
/// six steps of 8 bits.
const DIFFERENT: f32 = 0.024;

/// Pixels that are traced together, across and down: with one place each as many rays as the tracer takes at once.
const TILE: [usize; 2] = [8, 4];

/// What a picture on a screen shows where it sees nothing: a wall that neither open nor closed light is lost against.
pub const BACKGROUND: Vec3 = Vec3::new(0.28, 0.32, 0.38);

/// The color of what covers a line of sight first; nothing where nothing does.
pub fn covering(color: impl Fn(&Hit, &Ray) -> Vec3 + Sync) -> impl Fn(Sight<'_>) -> Vec4 + Sync {
    move |sight| {
        let ray = sight.ray;
        sight.first_covering().map_or(Vec4::ZERO, |hit| color(&hit, &ray).extend(1.0))
    }
}

/// What is pictured, and what it looks like.
pub struct Subject<'a> {
    /// Rays against it.
    pub tracer: &'a Tracer<'a>,
    /// What its triangles are.
    pub surfaces: &'a dyn Surfaces,
    /// Linear RGB times coverage, and the coverage, of what lies along a line of sight.
    pub color: &'a (dyn Fn(Sight<'a>) -> Vec4 + Sync),
}

/// Renders a picture.
///
/// - `size`: width and height in pixels
pub fn render(subject: &Subject<'_>, camera: &Camera, size: [usize; 2], smoothing: Smoothing) -> Picture {
    let [width, height] = size;
    let mut picture = Picture { width, height, pixels: vec![Vec4::ZERO; width * height] };
    if smoothing == Smoothing::Edges {
        let all = vec![true; width * height];
        see(subject, camera, &mut picture, &all, &[MIDDLE]);
    }
    let again = match smoothing {
        Smoothing::Edges => picture.edges(),
        Smoothing::Everywhere => vec![true; width * height],
    };
    see(subject, camera, &mut picture, &again, &PLACES);
    picture
}

/// Puts the mean of what is seen from the places into the wanted pixels.
fn see(subject: &Subject<'_>, camera: &Camera, picture: &mut Picture, wanted: &[bool], places: &[[f32; 2]]) {
    let [width, height] = [picture.width, picture.height];
    let [across, down] = TILE;
    let tiles = [width.div_ceil(across), height.div_ceil(down)];
    let seen: Vec<Vec<(usize, Vec4)>> = (0..tiles[0] * tiles[1])
        .into_par_iter()
        .map(|tile| {
            let [left, top] = [tile % tiles[0] * across, tile / tiles[0] * down];
            let rows = (top..(top + down).min(height)).map(|row| row * width);
            let pixels = rows.flat_map(|row| row + left..row + (left + across).min(width));
            let pixels: Vec<usize> = pixels.filter(|&pixel| wanted[pixel]).collect();
            let ray = |pixel: usize, [dx, dy]: [f32; 2]| {
                let [column, row] = [(pixel % width) as f32, (pixel / width) as f32];
                let x = (column + dx) / width as f32 * 2.0 - 1.0;
                let y = 1.0 - (row + dy) / height as f32 * 2.0;
                camera.ray(x, y)
            };
            let rays = pixels.iter().flat_map(|&pixel| places.iter().map(move |&place| ray(pixel, place)));
            let rays: Vec<_> = rays.collect();
            let firsts = match camera.pinhole().filter(|_| !rays.is_empty()) {
                Some(eye) => {
                    let directions: Vec<Vec3> = rays.iter().map(|ray| ray.direction).collect();
                    let mut hits = vec![None; rays.len()];
                    let origin = subject.tracer.origin_at(eye);
                    subject.tracer.first_hits(origin, &directions, f32::INFINITY, &mut hits);
                    hits.into_iter().map(Some).collect()
                }
                None => vec![None; rays.len()],
            };
            let colors = rays.into_iter().zip(firsts).map(|(ray, first)| {
                (subject.color)(Sight::new(subject.tracer, subject.surfaces, ray, first))
            });
            let colors: Vec<Vec4> = colors.collect();
            let mean = |colors: &[Vec4]| colors.iter().sum::<Vec4>() / places.len() as f32;
            pixels.into_iter().zip(colors.chunks(places.len()).map(mean)).collect()
        })
        .collect();
    for (pixel, color) in seen.into_iter().flatten() {
        picture.pixels[pixel] = color;
    }
}

impl Picture {
    /// A picture of one color.
    pub fn plain(size: [usize; 2], color: Vec3) -> Self {
        let [width, height] = size;
        Self { width, height, pixels: vec![color.extend(1.0); width * height] }
    }

    /// Pixels that differ from one of the eight around them.
    fn edges(&self) -> Vec<bool> {
        let looks: Vec<Vec4> = self.pixels.iter().map(|p| p.max(Vec4::ZERO).powf(0.5)).collect();
        let differ = |a: usize, b: usize| (looks[a] - looks[b]).abs().max_element() > DIFFERENT;
        let mut out = vec![false; looks.len()];
        let mut compare = |a: usize, b: usize| {
            if differ(a, b) {
                (out[a], out[b]) = (true, true);
            }
        };
        for row in 0..self.height {
            for column in 0..self.width {
                let pixel = row * self.width + column;
                let (right, below) = (column + 1 < self.width, row + 1 < self.height);
                if right {
                    compare(pixel, pixel + 1);
                }
                if below {
                    compare(pixel, pixel + self.width);
                }
                if right && below {
                    compare(pixel, pixel + self.width + 1);
                    compare(pixel + 1, pixel + self.width);
                }
            }
        }
        out
    }

    /// The picture before a background.
    #[must_use]
    pub fn over(mut self, background: Vec3) -> Self {
        for pixel in &mut self.pixels {
            *pixel += (1.0 - pixel.w) * background.extend(1.0);
        }
        self
    }

    /// Copies a picture into this one; what lies outside is left out.
    ///
    /// - `at`: column and row of its upper left corner
    pub fn put(&mut self, picture: &Self, at: [usize; 2]) {
        let width = picture.width.min(self.width.saturating_sub(at[0]));
        for row in 0..picture.height.min(self.height.saturating_sub(at[1])) {
            let from = &picture.pixels[row * picture.width..][..width];
            self.pixels[(at[1] + row) * self.width + at[0]..][..width].copy_from_slice(from);
        }
    }

    /// The picture as an 8-bit sRGB PNG, with alpha where it does not cover everything.
    ///
    /// # Errors
    /// [`RenderError::Png`].
    pub fn to_png(&self) -> Result<Vec<u8>, RenderError> {
        let mut bytes = Vec::new();
        let mut encoder = png::Encoder::new(&mut bytes, self.width as u32, self.height as u32);
        let opaque = self.pixels.iter().all(|p| p.w >= 1.0);
        encoder.set_color(if opaque { png::ColorType::Rgb } else { png::ColorType::Rgba });
        encoder.set_depth(png::BitDepth::Eight);
        let mut writer = encoder.write_header()?;
        let mut data = Vec::with_capacity(self.pixels.len() * 4);
        for pixel in &self.pixels {
            let color = if pixel.w > 0.0 { pixel.truncate() / pixel.w } else { Vec3::ZERO };
            data.extend(color.to_array().map(code));
            if !opaque {
                data.push((pixel.w.clamp(0.0, 1.0) * 255.0).round() as u8);
            }
        }
        writer.write_image_data(&data)?;
        writer.finish()?;
        Ok(bytes)
    }
}

/// The 8-bit sRGB code of a linear value.
fn code(linear: f32) -> u8 {
    (srgb::encoded(linear.min(1.0)) * 255.0).round() as u8
}

#[cfg(test)]
mod tests {
    use lightkiln_light::Opaque;
    use lightkiln_mesh::{Mesh, VertexId};

    use super::*;
    use crate::Lens;

    #[test]
    fn code_of_known_values_matches_the_standard() {
        assert_eq!((code(0.0), code(1.0), code(0.215_86), code(2.0), code(-1.0)), (0, 255, 128, 255, 0));
    }

    #[test]
    fn png_of_a_picture_is_transparent_where_it_covers_nothing() {
        let mut picture = Picture::plain([2, 2], Vec3::splat(0.3));
        let opaque = picture.to_png().unwrap();
        assert_eq!((&opaque[1..4], opaque[25]), (&b"PNG"[..], 2));
        picture.pixels[1] = Vec4::ZERO;
        assert_eq!(picture.to_png().unwrap()[25], 6);
        assert_eq!(picture.over(Vec3::splat(0.3)), Picture::plain([2, 2], Vec3::splat(0.3)));
    }

    #[test]
    fn put_beyond_the_edge_is_cut_off() {
        let mut sheet = Picture::plain([4, 3], Vec3::ZERO);
        sheet.put(&Picture::plain([3, 3], Vec3::ONE), [2, 1]);
        let ones = sheet.pixels.iter().filter(|p| p.x == 1.0).count();
        assert_eq!((ones, sheet.pixels[6].x), (4, 1.0));
    }

    /// A square from -1 to 1 in the plane z = 0 that looks along +z, a little turned.
    fn square(turn: f32) -> Mesh {
        let corner = |x: f32, y: f32| glam::Quat::from_rotation_z(turn) * Vec3::new(x, y, 0.0);
        let positions = vec![corner(-1.0, -1.0), corner(1.0, -1.0), corner(1.0, 1.0), corner(-1.0, 1.0)];
        let triangles = [[0, 1, 2], [0, 2, 3]].map(|t| t.map(VertexId)).to_vec();
        Mesh::new(positions, vec![Vec3::Z; 4], triangles).unwrap()
    }

    fn look(lens: Lens) -> Camera {
        Camera::looking(4.0 * Vec3::Z, Vec3::ZERO, lens).unwrap()
    }

    #[test]
    fn edges_are_as_smooth_as_if_everything_was() {
        let mesh = square(0.3);
        let tracer = Tracer::new(&mesh, &Opaque).unwrap();
        let subject = Subject { tracer: &tracer, surfaces: &Opaque, color: &covering(|_, _| Vec3::ONE) };
        for lens in [Lens::Pinhole([0.4, 0.3]), Lens::Parallel([1.6, 1.2])] {
            let some = render(&subject, &look(lens), [37, 27], Smoothing::Edges);
            let every = render(&subject, &look(lens), [37, 27], Smoothing::Everywhere);
            assert_eq!(some, every);
            let partial = every.pixels.iter().filter(|p| p.w > 0.0 && p.w < 1.0).count();
            assert!(partial > 40, "{partial}");
            // The square has half of the width and height that is shown, about.
            let covered: f32 = every.pixels.iter().map(|p| p.w).sum();
            assert!((covered / (37.0 * 27.0) - 4.0 / (3.2 * 2.4)).abs() < 0.01, "{covered}");
        }
    }

    #[test]
    fn pictures_show_what_lies_within_the_depths() {
        let mesh = square(0.0);
        let tracer = Tracer::new(&mesh, &Opaque).unwrap();
        let subject = Subject { tracer: &tracer, surfaces: &Opaque, color: &covering(|_, _| Vec3::ONE) };
        let lens = Lens::Pinhole([0.1; 2]);
        let shown = |depths, way: f32| {
            let eye = way * 4.0 * Vec3::Z;
            let camera = Camera::oriented(eye, -way * Vec3::Z, Vec3::Y, lens, depths).unwrap();
            render(&subject, &camera, [3, 3], Smoothing::Edges).pixels[4].w
        };
        assert_eq!(shown([0.0, f32::INFINITY], 1.0), 1.0);
        assert_eq!(shown([4.5, f32::INFINITY], 1.0), 0.0);
        assert_eq!(shown([0.0, 3.5], 1.0), 0.0);
        // The back of a single-sided square is not drawn.
        assert_eq!(shown([0.0, f32::INFINITY], -1.0), 0.0);
    }
}
