//! What is baked: a signal is a number of channels, a range, and a batch of rays at a point.

use lightkiln_mesh::SurfacePoint;

/// Light as seen from a point of the surface, estimated in independent batches of rays.
pub trait Signal: Sync {
    /// How many numbers a point has.
    fn channels(&self) -> usize;

    /// Rays of one batch.
    fn rays_per_batch(&self) -> u32;

    /// The least and greatest value that a batch can give. The spread that [`crate::Estimates`] expects before
    /// it has seen many batches is that of yes-or-no rays between these two.
    fn range(&self) -> [f32; 2] {
        [0.0, 1.0]
    }

    /// An estimate from one batch, scrambled independently of all others and keyed by `key` and `batch` only.
    ///
    /// - `out`: `channels()` values
    /// - returns the share of probe rays that met back faces first, `0..=1`; 0 for batches other than 0
    fn batch(&self, point: SurfacePoint, key: u64, batch: u32, out: &mut [f32]) -> f32;
}
