//! Several signals baked as one: they share samples, charts and the layout of the atlas.

use lightkiln_mesh::SurfacePoint;

use crate::{Layer, Signal};

/// The layers of several signals, one after the other.
///
/// Batch `b` of the whole is batch `b` of each, in order, with the same key; signals tell their rays apart by
/// themselves.
pub struct Combined<'a> {
    parts: Vec<Box<dyn Signal + 'a>>,
    layers: Vec<Layer>,
}

impl<'a> Combined<'a> {
    /// - `parts`: at least one, in the order of the layers; the share of backs comes from the first
    pub fn new(parts: Vec<Box<dyn Signal + 'a>>) -> Self {
        let layers = parts.iter().flat_map(|part| part.layers()).cloned().collect();
        Self { parts, layers }
    }
}

impl Signal for Combined<'_> {
    fn layers(&self) -> &[Layer] {
        &self.layers
    }

    /// The fewest rays that a part has: a part that needs none counts as if it had very many.
    fn rays_per_batch(&self) -> u32 {
        self.parts.iter().map(|part| part.rays_per_batch()).min().unwrap_or(1)
    }

    fn rays_of_layer(&self, mut layer: usize) -> u32 {
        for part in &self.parts {
            match layer.checked_sub(part.layers().len()) {
                Some(next) => layer = next,
                None => return part.rays_of_layer(layer),
            }
        }
        self.rays_per_batch()
    }

    fn batch(&self, point: SurfacePoint, key: u64, batch: u32, out: &mut [f32]) -> f32 {
        let mut rest = out;
        let mut backs = None;
        for part in &self.parts {
            let (own, others) = rest.split_at_mut(part.channels());
            backs.get_or_insert(part.batch(point, key, batch, own));
            rest = others;
        }
        backs.unwrap_or(0.0)
    }
}

#[cfg(test)]
mod tests {
    use lightkiln_mesh::TriangleId;

    use super::*;
    use crate::Domain;

    struct Constant(Vec<f32>, f32, [Layer; 1]);

    impl Constant {
        fn boxed(name: &str, values: &[f32], backs: f32) -> Box<dyn Signal> {
            let layer = Layer { name: name.to_owned(), channels: values.len(), domain: Domain::Hdr };
            Box::new(Self(values.to_vec(), backs, [layer]))
        }
    }

    impl Signal for Constant {
        fn layers(&self) -> &[Layer] {
            &self.2
        }
        fn rays_per_batch(&self) -> u32 {
            10 * self.0.len() as u32
        }
        fn batch(&self, _: SurfacePoint, key: u64, batch: u32, out: &mut [f32]) -> f32 {
            for (out, value) in out.iter_mut().zip(&self.0) {
                *out = value + key as f32 + batch as f32;
            }
            self.1
        }
    }

    #[test]
    fn combined_signals_stand_side_by_side() {
        let both = Combined::new(vec![
            Constant::boxed("a", &[1.0, 2.0, 3.0], 0.25),
            Constant::boxed("b", &[4.0], 0.75),
        ]);
        let names: Vec<_> = both.layers().iter().map(|l| l.name.as_str()).collect();
        assert_eq!((names, both.channels(), both.rays_per_batch()), (vec!["a", "b"], 4, 10));
        let mut out = [0.0; 4];
        let point = SurfacePoint { triangle: TriangleId(0), barycentric: [0.0; 2] };
        assert_eq!(both.batch(point, 10, 100, &mut out), 0.25);
        assert_eq!(out, [111.0, 112.0, 113.0, 114.0]);
    }

    #[test]
    fn combined_layers_keep_the_noise_of_their_own_rays() {
        let layer = |rays| {
            let layer = Layer::scalar("a");
            Box::new(Steady([layer], rays)) as Box<dyn Signal>
        };
        let points = [SurfacePoint { triangle: TriangleId(0), barycentric: [0.0; 2] }; 3];
        let estimate = |signal: &dyn Signal| {
            let mut estimates = crate::Estimates::new(3, signal.channels());
            estimates.refine(signal, &points, &[1, 2, 3], &[4; 3]);
            estimates
        };
        let both = estimate(&Combined::new(vec![layer(1 << 24), layer(16)]));
        for (channel, rays) in [1 << 24, 16].into_iter().enumerate() {
            let alone = estimate(layer(rays).as_ref());
            assert_eq!(both.variance_of_mean(1, channel), alone.variance_of_mean(1, 0));
        }
        assert!(both.variance_of_mean(1, 0) < 1e-8 && both.variance_of_mean(1, 1) > 1e-4);
    }

    /// The same value at every look.
    struct Steady([Layer; 1], u32);

    impl Signal for Steady {
        fn layers(&self) -> &[Layer] {
            &self.0
        }
        fn rays_per_batch(&self) -> u32 {
            self.1
        }
        fn batch(&self, _: SurfacePoint, _: u64, _: u32, out: &mut [f32]) -> f32 {
            out.fill(0.5);
            0.0
        }
    }

    #[test]
    fn combined_of_nothing_has_no_channels() {
        let nothing = Combined::new(Vec::new());
        let point = SurfacePoint { triangle: TriangleId(0), barycentric: [0.0; 2] };
        assert_eq!((nothing.channels(), nothing.batch(point, 0, 0, &mut [])), (0, 0.0));
    }
}
