//! Harmonics are judged by what they are for: the irradiance of normals.
//!
//! A coefficient alone is nothing that anybody sees. It may be zero in bright light, where a curve that is made for light
//! would hold it to the precision of darkness, and all coefficients together may be off by less than each allows, or by
//! more. So the error of `irradianceSh` layers is that of `E(n)`, judged on the scale of all light, for the shading normal
//! and for three normals that a normal map may make of it.
//!
//! The coefficients of a point come from the same rays, so the noise of `E(n)` does not follow from theirs. [`Judged`] adds
//! `E(n)` itself to what a signal measures, behind its layers: these channels say how noisy it is, and are not baked.

use std::f32::consts::FRAC_1_SQRT_2;
use std::ops::Range;

use glam::Vec3;
use lightkiln_light::directions::frame;
use lightkiln_light::harmonics::{COEFFICIENTS, basis, irradiance};
use lightkiln_light::{Domain, Layer, Signal};
use lightkiln_mesh::SurfacePoint;

use crate::Surface;

/// How many normals harmonics are judged at.
pub const NORMALS: usize = 4;

/// Channels of light.
const RGB: usize = 3;

/// Judged numbers of one set of harmonics.
pub const JUDGED: usize = NORMALS * RGB;

/// What layers are called that are measured and not baked.
const AT_NORMAL: &str = "irradianceAtNormal";

/// A normal, and three that are tilted by 45 degrees from it, evenly around.
pub fn normals(normal: Vec3) -> [Vec3; NORMALS] {
    let [x, y] = frame(normal);
    let tilted = |[u, v]: [f32; 2]| FRAC_1_SQRT_2 * (normal + u * x + v * y);
    const SIN_60: f32 = 0.866_025_4;
    [normal, tilted([1.0, 0.0]), tilted([-0.5, SIN_60]), tilted([-0.5, -SIN_60])]
}

/// Layers that are the coefficients of one function of the normal.
#[derive(Clone, Debug, PartialEq)]
pub struct Harmonics {
    /// Numbers of the layers.
    pub layers: Range<usize>,
    /// The first of their channels among those of all layers.
    first: usize,
}

impl Harmonics {
    /// Finds them by the names of the layers: `irradianceSh0` and those that count on from it.
    pub fn of<'a>(layers: impl Iterator<Item = &'a Layer>) -> Vec<Self> {
        let mut found: Vec<Self> = Vec::new();
        let mut first = 0;
        for (number, layer) in layers.enumerate() {
            let coefficient = layer.name.strip_prefix("irradianceSh").and_then(|k| k.parse::<usize>().ok());
            match (coefficient.filter(|&k| k < COEFFICIENTS && layer.channels == RGB), found.last_mut()) {
                (Some(0), _) => found.push(Self { layers: number..number + 1, first }),
                (Some(k), Some(last)) if last.layers.end == number && last.layers.len() == k => {
                    last.layers.end += 1;
                }
                _ => {}
            }
            first += layer.channels;
        }
        found
    }

    /// The channel of a coefficient and a color.
    pub fn channel(&self, coefficient: usize, color: usize) -> usize {
        self.first + RGB * coefficient + color
    }

    /// `E(n)` of some normals, lux; `value` gives the channels of all layers in lux.
    pub fn irradiance(&self, normals: [Vec3; NORMALS], value: impl Fn(usize) -> f32) -> [Vec3; NORMALS] {
        let mut coefficients = [Vec3::ZERO; COEFFICIENTS];
        for (k, coefficient) in coefficients.iter_mut().enumerate().take(self.layers.len()) {
            *coefficient = Vec3::from_array(std::array::from_fn(|color| value(self.channel(k, color))));
        }
        normals.map(|normal| irradiance(&coefficients[..self.layers.len()], normal))
    }

    /// The variance of `E(n)` if the noise of the coefficients were independent, for a color; `variance` gives that of the
    /// channels of all layers.
    pub fn independent_variance(&self, normal: Vec3, color: usize, variance: impl Fn(usize) -> f32) -> f32 {
        let basis = basis(normal);
        (0..self.layers.len()).map(|k| basis[k].powi(2) * variance(self.channel(k, color))).sum()
    }
}

/// The layers of a signal that are baked, not only measured.
pub fn baked(signal: &dyn Signal) -> Vec<Layer> {
    signal.layers().iter().filter(|layer| layer.name != AT_NORMAL).cloned().collect()
}

/// A signal that also measures what the errors of its harmonics are judged by: [`JUDGED`] channels for each set, behind
/// its own.
pub struct Judged<'a> {
    signal: Box<dyn Signal + 'a>,
    surface: &'a Surface<'a>,
    layers: Vec<Layer>,
    harmonics: Vec<Harmonics>,
}

impl<'a> Judged<'a> {
    /// The signal itself where it has no harmonics.
    pub fn on(signal: Box<dyn Signal + 'a>, surface: &'a Surface<'a>) -> Box<dyn Signal + 'a> {
        let harmonics = Harmonics::of(signal.layers().iter());
        if harmonics.is_empty() {
            return signal;
        }
        let mut layers = signal.layers().to_vec();
        let at_normal = Layer { name: AT_NORMAL.to_owned(), channels: RGB, domain: Domain::SignedHdr };
        layers.extend(std::iter::repeat_n(at_normal, NORMALS * harmonics.len()));
        Box::new(Self { signal, surface, layers, harmonics })
    }
}

impl Signal for Judged<'_> {
    fn layers(&self) -> &[Layer] {
        &self.layers
    }

    fn rays_per_batch(&self) -> u32 {
        self.signal.rays_per_batch()
    }

    fn batch(&self, point: SurfacePoint, key: u64, batch: u32, out: &mut [f32]) -> f32 {
        let (own, judged) = out.split_at_mut(self.signal.channels());
        let backs = self.signal.batch(point, key, batch, own);
        let normals = normals(self.surface.lit_normal(point));
        for (harmonics, judged) in self.harmonics.iter().zip(judged.chunks_exact_mut(JUDGED)) {
            let at_normals = harmonics.irradiance(normals, |channel| own[channel]);
            for (judged, at_normal) in judged.chunks_exact_mut(RGB).zip(at_normals) {
                judged.copy_from_slice(&at_normal.to_array());
            }
        }
        backs
    }
}

#[cfg(test)]
mod tests {
    use lightkiln_light::harmonics::cosine_factor;
    use lightkiln_light::{Curve, Estimates, Scale};
    use lightkiln_mesh::TriangleId;
    use lightkiln_scene::{ReadOptions, Scene};

    use super::*;
    use crate::layers::Layers;
    use crate::options::BakeBounds;

    fn layers(names: &[&str]) -> Vec<Layer> {
        names.iter().map(|n| Layer { channels: 3, domain: Domain::SignedHdr, ..Layer::scalar(n) }).collect()
    }

    #[test]
    fn harmonics_are_found_among_other_layers() {
        let mut all = layers(&["irradiance", "irradianceSh0", "irradianceSh1", "irradianceSh3"]);
        all.insert(0, Layer::scalar("ambientOcclusion"));
        all.extend(layers(&["irradianceSh0", "irradianceSh1", "irradianceSh2"]));
        let found = Harmonics::of(all.iter());
        assert_eq!(found.iter().map(|h| h.layers.clone()).collect::<Vec<_>>(), [2..4, 5..8]);
        assert_eq!((found[0].channel(0, 0), found[1].channel(2, 1)), (4, 20));
    }

    #[test]
    fn harmonics_are_judged_at_unit_normals_of_one_tilt() {
        for normal in [Vec3::Y, Vec3::NEG_Z, Vec3::new(0.6, 0.0, -0.8)] {
            let [own, tilted @ ..] = normals(normal);
            assert_eq!(own, normal);
            for (k, n) in tilted.iter().enumerate() {
                assert!((n.length() - 1.0).abs() < 1e-6 && (n.dot(normal) - FRAC_1_SQRT_2).abs() < 1e-6);
                let next = tilted[(k + 1) % 3];
                assert!((n.dot(next) - 0.25).abs() < 1e-6, "{n} {next}");
            }
        }
    }

    /// A lamp straight above, behind a haze: harmonics of two bands, in batches whose brightness a key and a number name.
    struct Lamp(Vec<Layer>);

    impl Signal for Lamp {
        fn layers(&self) -> &[Layer] {
            &self.0
        }
        fn rays_per_batch(&self) -> u32 {
            16
        }
        fn batch(&self, _: SurfacePoint, key: u64, batch: u32, out: &mut [f32]) -> f32 {
            // All coefficients are up and down together.
            let facing = 100.0 + key as f32 + if batch.is_multiple_of(2) { 20.0 } else { -20.0 };
            for (k, color) in out.chunks_exact_mut(3).enumerate() {
                color.fill(facing * basis(Vec3::Y)[k] * cosine_factor(k));
            }
            0.0
        }
    }

    #[test]
    fn layers_of_harmonics_are_judged_by_irradiance_and_its_noise() {
        let path = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../../data/half_box.glb");
        let scene = Scene::read(&path, &ReadOptions::default()).expect("a scene");
        let surface = Surface::new(&scene, "half_box.glb").expect("a surface");
        let is_level = |t: &TriangleId| surface.mesh.geometric_normal(*t).y > 0.999;
        let level = surface.mesh.triangle_ids().find(is_level).expect("a floor");
        let of = |k| Layer {
            name: format!("irradianceSh{k}"),
            channels: 3,
            domain: if k == 0 { Domain::Hdr } else { Domain::SignedHdr },
        };
        let signal = Judged::on(Box::new(Lamp((0..4).map(of).collect())), &surface);
        let at = SurfacePoint { triangle: level, barycentric: [0.2, 0.2] };
        let mut estimates = Estimates::new(100, signal.channels());
        let keys: Vec<u64> = (1..=100).collect();
        estimates.refine(signal.as_ref(), &[at; 100], &keys, &[64; 100]);
        let layers = Layers::new(signal.as_ref(), &estimates, &[1.0; 100], None, BakeBounds::Clamp);
        assert!(layers.fit(signal.as_ref()));
        // Two bands see a quarter of what faces the lamp from any normal, and half of its cosine.
        let Curve::Log { white } = layers.layers[3].scale.curve else { panic!("no curve of light") };
        let white = white * basis(Vec3::Y)[0];
        assert!((white - 195.0 * 0.75).abs() < 1e-2, "{white}");
        assert_eq!((layers.channels(), layers.judged(), layers.parts().len()), (12, 12, 1));
        let light = layers.light(surface.lit_normals(&[at; 100]), &estimates);
        let scale = Scale::log(white, 0.0, white);
        let cosine = FRAC_1_SQRT_2;
        for (k, share) in [0.75, 0.25 + 0.5 * cosine].into_iter().enumerate() {
            let judged = light.judged(9)[3 * k];
            assert!((judged - scale.to_unit(110.0 * share)).abs() < 1e-4, "{judged}");
            // The spread is a fifth of 110 lux, of 64 batches; that of single coefficients adds up to less.
            let expected = 20.0 * share / 8.0 * scale.slope(110.0 * share);
            assert!(
                (light.sigma(9)[3 * k] / expected - 1.0).abs() < 0.05,
                "{} {expected}",
                light.sigma(9)[3 * k]
            );
        }
        // Light from the side changes nothing where the normal shows, however large the coefficient.
        let mut shown = light.value(9).to_vec();
        let side = 1e-3 * white;
        let x = layers.from_unit(9, shown[9]) + side;
        shown[9] = layers.to_unit(9, x);
        let mut errors = Vec::new();
        layers.each_error(&shown, &light, 9, |_, error, _| errors.push(error.abs()));
        assert!(errors[0] < 1e-5, "{errors:?}");
        let most = errors.iter().copied().fold(0.0, f32::max);
        let expected = side * basis(Vec3::X)[3] * cosine * scale.slope(110.0 * (0.25 + 0.5 * cosine));
        assert!((0.5 * expected..1.01 * expected).contains(&most), "{most} {expected}");
    }
}
