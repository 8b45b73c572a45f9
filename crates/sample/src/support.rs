//! Support samples: on CAD meshes most triangles are far smaller than the radius, and a light vertex whose
//! triangles hold no sample would be missing from the fit's equations (DESIGN.md, "Least squares that cannot go
//! wrong").

use lightkiln_mesh::{Fans, Mesh, TriangleId, VertexId};

use crate::{Placed, SUPPORT_NUMBER};

/// The support samples that a mesh needs beside `placed`: one at the middle of a triangle serves its corners.
///
/// Greedy in the order of vertices: of the unserved vertex' triangles that have an area, the one with the most
/// unserved corners, then the largest, then the first.
pub(crate) fn missing(mesh: &Mesh, fans: &Fans, placed: &[Placed]) -> Vec<Placed> {
    let mut served = vec![false; mesh.vertex_count()];
    for p in placed {
        for v in mesh.triangles[p.triangle as usize] {
            served[v.index()] = true;
        }
    }
    let mut supports = Vec::new();
    for v in 0..mesh.vertex_count() {
        if served[v] {
            continue;
        }
        let mut best: Option<(usize, f64, TriangleId)> = None;
        for &t in fans.around(VertexId(v as u32)) {
            let unserved = mesh.triangles[t.index()].iter().filter(|v| !served[v.index()]).count();
            if best.is_some_and(|b| unserved < b.0) {
                continue;
            }
            let area = mesh.area(t);
            if area > 0.0 && best.is_none_or(|b| (unserved, area) > (b.0, b.1)) {
                best = Some((unserved, area, t));
            }
        }
        if let Some((_, _, t)) = best {
            for v in mesh.triangles[t.index()] {
                served[v.index()] = true;
            }
            let third = 1.0 / 3.0;
            supports.push(Placed { triangle: t.0, number: SUPPORT_NUMBER, barycentric: [third, third] });
        }
    }
    supports
}
