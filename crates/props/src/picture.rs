//! An image on a flat mesh that follows it: what Kavan 2011, figure 8 shows, with an image and a mesh of our own.
//!
//! Deviation: the paper's mesh is a progressive mesh (Hoppe 1996). Ours is made by bisection of right-angled triangles,
//! where three corner colors say least of the image.

use std::collections::BTreeMap;

use glam::Vec3;

use crate::PropsError;
use crate::model::{Assembly, Material, Surface};

/// Pixels along a side of the image, as many as in the paper.
const PIXELS: u32 = 298;
/// Lattice steps along a side of the mesh.
const LATTICE: u32 = 1 << 12;
/// Places along a side at which a triangle looks at the image.
const LOOKS: u32 = 12;

/// A square metre of image, upright and facing the front, of about `size` triangles.
pub fn picture(size: usize) -> Result<Assembly, PropsError> {
    let mut scene = Assembly::default();
    let mut material = Material::new("picture", [1.0; 3], 0.0, 1.0);
    material.texture = Some(image_png()?);
    let material = scene.material(material);
    let (points, triangles) = Bisection::of_image(size);
    let unit = |p: [u32; 2]| p.map(|v| v as f32 / LATTICE as f32);
    let surface = Surface {
        positions: points.iter().map(|&p| unit(p)).map(|[x, y]| Vec3::new(x - 0.5, 1.0 - y, 0.0)).collect(),
        normals: vec![Vec3::Z; points.len()],
        uvs: points.iter().map(|&p| unit(p)).collect(),
        count: triangles.len(),
        triangles,
    };
    scene.part("picture", surface, material, None);
    Ok(scene)
}

/// The color at a place of the image, `0..=1` from the left and from the top, as sRGB values: sky, a sun, hills, water
/// and a striped balloon.
fn color(x: f64, y: f64) -> [f64; 3] {
    let mix = |a: [f64; 3], b: [f64; 3], t: f64| [0, 1, 2].map(|c| a[c] + (b[c] - a[c]) * t.clamp(0.0, 1.0));
    // A soft step of about two pixels.
    let inside = |distance: f64| distance * f64::from(PIXELS) * 0.5 + 0.5;
    let mut c = mix([0.24, 0.42, 0.76], [0.98, 0.82, 0.62], y * 1.5);
    let sun = 0.075 - (x - 0.24).hypot(y - 0.3);
    c = mix(c, [1.0, 0.93, 0.7], (-30.0 * (-sun).max(0.0)).exp() * 0.6);
    c = mix(c, [1.0, 0.97, 0.86], inside(sun));
    for (number, (base, height)) in [(0.58, 0.06), (0.64, 0.05), (0.72, 0.035)].into_iter().enumerate() {
        let f = 5.0 + 4.0 * number as f64;
        let ridge = base + height * ((f * x + 1.7 * number as f64).sin() + 0.4 * (2.7 * f * x).sin());
        let shade = 0.25 + 0.12 * number as f64;
        c = mix(c, [0.45 - shade, 0.62 - 0.8 * shade, 0.55 - 0.7 * shade], inside(y - ridge));
    }
    let wave =
        0.5 + 0.5 * (64.0 * (y - 0.8) / (0.3 + 2.0 * (y - 0.8).max(0.0)) + 1.5 * (9.0 * x).sin()).sin();
    c = mix(c, mix([0.16, 0.3, 0.46], [0.62, 0.7, 0.74], 0.7 * wave), inside(y - 0.8));
    let (dx, dy) = ((x - 0.66) / 0.17, (y - 0.36) / 0.2);
    let around = dx.hypot(dy);
    let turn = (dx / (1.0 - dy * dy).max(0.05).sqrt()).clamp(-1.0, 1.0).asin();
    let stripe = if (turn * 3.0).rem_euclid(2.0) < 1.0 { [0.82, 0.16, 0.14] } else { [0.96, 0.9, 0.78] };
    let light = 0.55 + 0.45 * (1.0 - 0.6 * (dx + 0.35).hypot(dy + 0.3));
    c = mix(c, stripe.map(|s| s * light), inside((1.0 - around) * 0.18));
    c = mix(c, [0.3, 0.2, 0.12], inside(0.035 - (x - 0.66).abs().max((y - 0.65).abs())));
    let rope = ((x - 0.66).abs() - 0.03 - 0.16 * (0.61 - y)).abs();
    mix(c, [0.2, 0.16, 0.12], if (0.54..0.615).contains(&y) { inside(0.002 - rope) } else { 0.0 })
}

fn image_png() -> Result<Vec<u8>, PropsError> {
    let at = |i: u32| (f64::from(i) + 0.5) / f64::from(PIXELS);
    let pixels: Vec<u8> = (0..PIXELS * PIXELS)
        .flat_map(|i| color(at(i % PIXELS), at(i / PIXELS)))
        .map(|v| (v.clamp(0.0, 1.0) * 255.0).round() as u8)
        .collect();
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, PIXELS, PIXELS);
    encoder.set_color(png::ColorType::Rgb);
    encoder.set_depth(png::BitDepth::Eight);
    let mut writer = encoder.write_header()?;
    writer.write_image_data(&pixels)?;
    writer.finish()?;
    Ok(bytes)
}

/// Right-angled triangles on a lattice: corner 0 has the right angle, the edge from 1 to 2 is cut.
#[derive(Default)]
struct Bisection {
    points: Vec<[u32; 2]>,
    number: BTreeMap<[u32; 2], u32>,
    triangles: Vec<[u32; 3]>,
    errors: Vec<f64>,
    /// The triangle that has a directed edge.
    owner: BTreeMap<[u32; 2], usize>,
}

impl Bisection {
    fn of_image(size: usize) -> (Vec<[u32; 2]>, Vec<[u32; 3]>) {
        let mut mesh = Self::default();
        let [a, b, c, d] = [[0, 0], [0, LATTICE], [LATTICE, LATTICE], [LATTICE, 0]].map(|p| mesh.point(p));
        for t in [[b, c, a], [d, a, c]] {
            mesh.triangles.push(t);
            mesh.errors.push(0.0);
            mesh.put(mesh.triangles.len() - 1, t);
        }
        while mesh.triangles.len() < size {
            let worst = (0..mesh.errors.len()).max_by(|&a, &b| mesh.errors[a].total_cmp(&mesh.errors[b]));
            mesh.cut(worst.unwrap_or(0));
        }
        (mesh.points, mesh.triangles)
    }

    fn point(&mut self, place: [u32; 2]) -> u32 {
        let next = self.points.len() as u32;
        let number = *self.number.entry(place).or_insert(next);
        if number == next {
            self.points.push(place);
        }
        number
    }

    fn put(&mut self, at: usize, t: [u32; 3]) {
        self.triangles[at] = t;
        self.errors[at] = self.error(t);
        for e in 0..3 {
            self.owner.insert([t[e], t[(e + 1) % 3]], at);
        }
    }

    /// Cuts a triangle and the one across its longest edge, which is first cut itself until that is its longest too.
    fn cut(&mut self, at: usize) {
        let [_, a, b] = self.triangles[at];
        let across = loop {
            match self.owner.get(&[b, a]).copied() {
                Some(other) if self.triangles[other][1..] != [b, a] => self.cut(other),
                other => break other,
            }
        };
        let (p, q) = (self.points[a as usize], self.points[b as usize]);
        let middle = self.point([0, 1].map(|k| (p[k] + q[k]) / 2));
        for half in [Some(at), across].into_iter().flatten() {
            let [right, from, to] = self.triangles[half];
            self.owner.remove(&[from, to]);
            self.triangles.push([0; 3]);
            self.errors.push(0.0);
            self.put(half, [middle, right, from]);
            self.put(self.triangles.len() - 1, [middle, to, right]);
        }
    }

    /// How much the image differs from what the colors at the corners say, over the area.
    fn error(&self, t: [u32; 3]) -> f64 {
        let corners = t.map(|v| self.points[v as usize].map(|x| f64::from(x) / f64::from(LATTICE)));
        let colors = corners.map(|[x, y]| color(x, y));
        let mut sum = 0.0;
        for i in 0..LOOKS {
            for j in 0..LOOKS - i {
                let (u, v) =
                    ((f64::from(i) + 0.33) / f64::from(LOOKS), (f64::from(j) + 0.33) / f64::from(LOOKS));
                let weights = [1.0 - u - v, u, v];
                let at = [0, 1].map(|k| (0..3).map(|c| weights[c] * corners[c][k]).sum::<f64>());
                let seen = color(at[0], at[1]);
                sum += (0..3)
                    .map(|k| (seen[k] - (0..3).map(|c| weights[c] * colors[c][k]).sum::<f64>()).powi(2))
                    .sum::<f64>();
            }
        }
        let [a, b, c] = corners;
        let area = ((b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])).abs() / 2.0;
        sum * area / f64::from(LOOKS * (LOOKS + 1) / 2)
    }
}
