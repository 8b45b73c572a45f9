//! One more sample in chosen triangles: where the light turned out to change more within a triangle than its
//! samples can tell.

use lightkiln_mesh::{Fans, Mesh, SurfacePoint, TriangleId, random};

use crate::{Samples, areas};

/// Places that a new sample may take: the middle, towards the corners, towards the edges.
const PLACES: [[f32; 2]; 7] = [
    [1.0 / 3.0, 1.0 / 3.0],
    [0.125, 0.125],
    [0.75, 0.125],
    [0.125, 0.75],
    [0.4375, 0.125],
    [0.4375, 0.4375],
    [0.125, 0.4375],
];

/// Added samples are numbered from here within their triangle; neither Poisson nor support samples are.
const FIRST_NUMBER: u64 = 1 << 40;

impl Samples {
    /// These samples and one more in each of some triangles, as far from those that are there as one of seven
    /// places allows. The areas are shared out anew.
    ///
    /// - `triangles`: ascending, each at most once
    /// - `seed`: that of the samples
    /// - returns: the samples, and for each its former number, none for the new ones
    #[must_use]
    pub fn denser(&self, mesh: &Mesh, triangles: &[TriangleId], seed: u64) -> (Self, Vec<Option<u32>>) {
        let count = self.len() + triangles.len();
        let mut from = Vec::with_capacity(count);
        let mut points = Vec::with_capacity(count);
        let mut keys = Vec::with_capacity(count);
        let mut starts = Vec::with_capacity(mesh.triangle_count() + 1);
        starts.push(0);
        let mut chosen = triangles.iter().copied().peekable();
        for t in mesh.triangle_ids() {
            let own = self.of_triangle(t);
            from.extend(own.clone().map(|i| Some(i as u32)));
            points.extend_from_slice(&self.points[own.clone()]);
            keys.extend_from_slice(&self.keys[own.clone()]);
            if chosen.next_if_eq(&t).is_some() {
                from.push(None);
                points.push(farthest(mesh, t, &self.points[own.clone()]));
                keys.push(random::hash(seed, u64::from(t.0), FIRST_NUMBER + own.len() as u64, 0));
            }
            starts.push(points.len() as u32);
        }
        let support = from.iter().map(|f| f.is_none_or(|f| self.support[f as usize])).collect();
        let areas = areas::areas(mesh, &Fans::new(mesh), &points, &starts);
        (Self { points, keys, areas, support, radius: self.radius, starts }, from)
    }
}

/// The place of a triangle whose nearest sample is farthest away.
fn farthest(mesh: &Mesh, triangle: TriangleId, samples: &[SurfacePoint]) -> SurfacePoint {
    let distance = |barycentric: [f32; 2]| {
        let position = mesh.position(SurfacePoint { triangle, barycentric });
        samples.iter().map(|&s| mesh.position(s).distance_squared(position)).fold(f32::INFINITY, f32::min)
    };
    let mut best = (distance(PLACES[0]), PLACES[0]);
    for place in &PLACES[1..] {
        let far = distance(*place);
        if far > best.0 {
            best = (far, *place);
        }
    }
    SurfacePoint { triangle, barycentric: best.1 }
}

#[cfg(test)]
mod tests {
    use glam::Vec3;
    use lightkiln_mesh::VertexId;

    use super::*;
    use crate::{SampleOptions, poisson_disk};

    #[test]
    fn denser_keeps_samples_and_total_area() {
        let positions = (0..9).map(|i| Vec3::new((i % 3) as f32, (i / 3) as f32, 0.0)).collect();
        let square = |x: u32, y: u32| {
            let a = y * 3 + x;
            [[a, a + 1, a + 4], [a, a + 4, a + 3]].map(|t| t.map(VertexId))
        };
        let triangles = [square(0, 0), square(1, 0), square(0, 1), square(1, 1)].concat();
        let mesh = Mesh::new(positions, vec![Vec3::Z; 9], triangles).unwrap();
        let samples = poisson_disk(&mesh, &SampleOptions { radius: 0.5, seed: 3 }).unwrap();
        let chosen = [TriangleId(1), TriangleId(7)];
        let (denser, from) = samples.denser(&mesh, &chosen, 3);
        assert_eq!(denser.len(), samples.len() + 2);
        for t in mesh.triangle_ids() {
            let more = usize::from(chosen.contains(&t));
            assert_eq!(denser.of_triangle(t).len(), samples.of_triangle(t).len() + more);
        }
        for (new, old) in from.iter().enumerate() {
            if let Some(old) = old.map(|o| o as usize) {
                assert_eq!((denser.points[new], denser.keys[new]), (samples.points[old], samples.keys[old]));
            } else {
                assert!(denser.support[new]);
            }
        }
        assert!((denser.areas.iter().sum::<f32>() - 4.0).abs() < 1e-4);
        let mut keys = denser.keys.clone();
        keys.sort_unstable();
        keys.dedup();
        assert_eq!(keys.len(), denser.len(), "every sample has rays of its own");
    }
}
