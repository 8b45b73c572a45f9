//! What is baked: a signal is its layers and a batch of rays at a point.

use lightkiln_mesh::SurfacePoint;

/// Which values a layer can have.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Domain {
    /// Between two numbers. The spread that [`crate::Estimates`] expects before it has seen many batches is that
    /// of yes-or-no rays between these two.
    Bounded {
        /// The least value.
        low: f32,
        /// The greatest.
        high: f32,
    },
    /// Light: at least 0, without an upper end.
    Hdr,
    /// Light with a sign, such as a coefficient of spherical harmonics.
    SignedHdr,
}

/// Up to three channels that are stored together: one attribute and one atlas.
#[derive(Clone, Debug, PartialEq)]
pub struct Layer {
    /// What it is, as the file calls it (docs/FORMAT.md).
    pub name: String,
    /// How many channels, `1..=3`.
    pub channels: usize,
    /// Which values they have.
    pub domain: Domain,
}

impl Layer {
    /// One channel of values in `0..=1`.
    pub fn scalar(name: &str) -> Self {
        Self { name: name.to_owned(), channels: 1, domain: Domain::Bounded { low: 0.0, high: 1.0 } }
    }
}

/// Light as seen from a point of the surface, estimated in independent batches of rays.
pub trait Signal: Sync {
    /// The layers; at least one. Their channels stand one after the other.
    fn layers(&self) -> &[Layer];

    /// How many numbers a point has.
    fn channels(&self) -> usize {
        self.layers().iter().map(|layer| layer.channels).sum()
    }

    /// The least and greatest value of any channel; light has no greatest.
    fn range(&self) -> [f32; 2] {
        self.layers().iter().fold([f32::INFINITY, f32::NEG_INFINITY], |[least, greatest], layer| {
            let [low, high] = match layer.domain {
                Domain::Bounded { low, high } => [low, high],
                Domain::Hdr => [0.0, f32::INFINITY],
                Domain::SignedHdr => [f32::NEG_INFINITY, f32::INFINITY],
            };
            [least.min(low), greatest.max(high)]
        })
    }

    /// Rays of one batch.
    fn rays_per_batch(&self) -> u32;

    /// Rays of one batch that a layer is made of: the noise that is expected of it before it has shown any.
    ///
    /// - `layer`: its number in [`Self::layers`]
    fn rays_of_layer(&self, _layer: usize) -> u32 {
        self.rays_per_batch()
    }

    /// An estimate from one batch, scrambled independently of all others and keyed by `key` and `batch` only.
    ///
    /// - `out`: `channels()` values
    /// - returns the share of probe rays that met back faces first, `0..=1`; 0 for batches other than 0
    fn batch(&self, point: SurfacePoint, key: u64, batch: u32, out: &mut [f32]) -> f32;
}
