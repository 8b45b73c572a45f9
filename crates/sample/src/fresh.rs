//! Fresh points: where the last stage compares the decoded light with new rays, at points that no fit has seen.

use lightkiln_mesh::{Mesh, SurfacePoint, TriangleId, random, sheets};

use crate::candidates::{Stream, Surface, r2};

/// Area-uniform, stratified points with their keys, sorted by triangle.
///
/// The surface is laid out sheet by sheet and cut into `count` strata of equal area with one point in each, so
/// that a sheet gets its share of points up to one at either end. Points and keys are independent of those of
/// [`poisson_disk`](crate::poisson_disk) with the same seed. A mesh without area gets no points.
pub fn fresh_points(mesh: &Mesh, count: usize, seed: u64) -> (Vec<SurfacePoint>, Vec<u64>) {
    let sheet_of = sheets(mesh).0;
    let surface = Surface::new(mesh, &sheet_of);
    if surface.triangles.is_empty() || count == 0 {
        return (Vec::new(), Vec::new());
    }
    let stratum = surface.area() / count as f64;
    let mut hits: Vec<u32> = Vec::with_capacity(count);
    let mut i = 0;
    for n in 0..count {
        let jitter = f64::from(random::unit(Stream::Fresh.hash(seed, n as u64, 0)));
        let along = (n as f64 + jitter) * stratum;
        while i + 1 < surface.triangles.len() && surface.cumulative[i + 1] <= along {
            i += 1;
        }
        hits.push(surface.triangles[i]);
    }
    hits.sort_unstable();
    let mut points = Vec::with_capacity(count);
    let mut keys = Vec::with_capacity(count);
    for run in hits.chunk_by(|a, b| a == b) {
        let triangle = TriangleId(run[0]);
        let offset = Stream::Fresh.hash(seed, u64::from(run[0]), 1);
        for n in 0..run.len() as u32 {
            points.push(SurfacePoint { triangle, barycentric: random::square_to_triangle(r2(offset, n)) });
            keys.push(Stream::Fresh.hash(offset, u64::from(run[0]), u64::from(n) + 2));
        }
    }
    (points, keys)
}
