//! The surface area that each sample stands for: `a_p` of Schaefer eq. 2.
//!
//! The samples of a triangle share its area equally. A triangle without samples gives its area to one sample
//! near it: ownership spreads from the triangles that have samples over shared vertices, a ring at a time, and a
//! triangle of the next ring takes the nearest of its neighbours' owners.

use glam::Vec3;
use lightkiln_mesh::{Fans, Mesh, SurfacePoint, TriangleId};
use rayon::prelude::*;

const NONE: u32 = u32::MAX;

/// One area per sample. `points` are sorted by triangle, `starts` has T + 1 entries.
pub(crate) fn areas(mesh: &Mesh, fans: &Fans, points: &[SurfacePoint], starts: &[u32]) -> Vec<f32> {
    let owners = owners(mesh, fans, points, starts);
    let mut areas = vec![0.0_f64; points.len()];
    for t in mesh.triangle_ids() {
        let area = mesh.area(t);
        let own = starts[t.index()] as usize..starts[t.index() + 1] as usize;
        if !own.is_empty() {
            let share = area / own.len() as f64;
            areas[own].iter_mut().for_each(|a| *a += share);
        } else if owners[t.index()] != NONE {
            areas[owners[t.index()] as usize] += area;
        }
    }
    areas.into_iter().map(|a| a as f32).collect()
}

/// The sample that each triangle without samples gives its area to. A triangle with samples names its first;
/// one whose sheet has none names none.
fn owners(mesh: &Mesh, fans: &Fans, points: &[SurfacePoint], starts: &[u32]) -> Vec<u32> {
    let range = |t: TriangleId| starts[t.index()]..starts[t.index() + 1];
    let mut owners: Vec<u32> =
        mesh.triangle_ids().map(|t| if range(t).is_empty() { NONE } else { range(t).start }).collect();
    let mut reached = vec![false; mesh.vertex_count()];
    let mut queued: Vec<bool> = owners.iter().map(|&o| o != NONE).collect();
    let mut ring: Vec<TriangleId> = mesh.triangle_ids().filter(|t| queued[t.index()]).collect();
    while !ring.is_empty() {
        let mut next = Vec::new();
        for t in ring {
            for v in mesh.triangles[t.index()] {
                if std::mem::replace(&mut reached[v.index()], true) {
                    continue;
                }
                for &n in fans.around(v) {
                    if !std::mem::replace(&mut queued[n.index()], true) {
                        next.push(n);
                    }
                }
            }
        }
        // The ring is still unowned while its owners are sought, so their order is of no matter.
        let found: Vec<u32> = next
            .par_iter()
            .map(|&t| {
                let [a, b, c] = mesh.corners(t);
                let middle: Vec3 = (a + b + c) / 3.0;
                let mut best = (f32::INFINITY, NONE);
                for v in mesh.triangles[t.index()] {
                    for &n in fans.around(v) {
                        let own = range(n);
                        let inherited = owners[n.index()];
                        // Its own samples, or else the one that it inherited.
                        let offered =
                            if own.is_empty() && inherited != NONE { inherited..inherited + 1 } else { own };
                        for s in offered {
                            let distance = mesh.position(points[s as usize]).distance_squared(middle);
                            best = if best.1 == NONE || (distance, s) < best { (distance, s) } else { best };
                        }
                    }
                }
                best.1
            })
            .collect();
        for (t, owner) in next.iter().zip(found) {
            owners[t.index()] = owner;
        }
        ring = next;
    }
    owners
}
