//! Averages and point samples: what the paper compares least squares to.

use lightkiln_mesh::{Fans, Mesh, VertexId, sheets};

use crate::observations::ByTriangle;
use crate::system::{check, coincides, hat};
use crate::{Bounds, Fit, FitError, FitOptions, FitReport, Held, Method, Observations};

/// Values by [`Method::Average`] (Kavan eq. 8) or [`Method::PointSample`].
///
/// Vertices that see no observation take the mean of their neighbours, ring by ring; what no ring reaches
/// takes the neutral value.
///
/// # Errors
/// As [`crate::fit`].
pub fn fit(
    mesh: &Mesh,
    observations: &Observations<'_>,
    held: Option<&Held<'_>>,
    options: &FitOptions,
) -> Result<Fit, FitError> {
    check(mesh, observations, held, options)?;
    let observed = ByTriangle::new(mesh, *observations)?;
    let fans = Fans::new(mesh);
    let channels = observed.channels();
    let vertices = mesh.vertex_count();
    let is_held = |v: usize| held.is_some_and(|h| h.vertices[v]);
    let mut report = FitReport {
        observations: observed.len(),
        ignored_observations: observed.ignored,
        not_finite_observations: observed.not_finite,
        ..FitReport::default()
    };
    let (sheet_of, sheets) = sheets(mesh);
    let mut triangles = vec![0_usize; sheets];
    for t in mesh.triangle_ids() {
        triangles[sheet_of[t.index()] as usize] += 1;
        report.degenerate_triangles += usize::from(mesh.area(t) <= 0.0);
        report.unseen_triangles += usize::from(observed.count(t) == 0);
    }
    report.single_triangles = triangles.iter().filter(|&&n| n == 1).count();
    report.coincident_vertices = (0..vertices as u32).filter(|&v| coincides(mesh, &fans, v)).count();
    let mut sums = vec![0.0_f64; vertices * channels];
    let mut known = vec![false; vertices];
    for v in 0..vertices {
        let out = &mut sums[v * channels..(v + 1) * channels];
        if let Some(held) = held.filter(|h| h.vertices[v]) {
            for (out, &value) in out.iter_mut().zip(&held.values[v * channels..]) {
                *out = f64::from(value);
            }
            known[v] = true;
            report.held_vertices += 1;
            continue;
        }
        let around = fans.around(VertexId(v as u32));
        report.isolated_vertices += usize::from(around.is_empty());
        let mut total = 0.0;
        let mut nearest: Option<(f64, u32)> = None;
        for &t in around {
            for seen in observed.in_triangle(t) {
                if options.method == Method::PointSample {
                    let [a, b, c] = mesh.corners(t).map(glam::Vec3::as_dvec3);
                    let [wa, wb, wc] = seen.barycentric;
                    let point = a * wa + b * wb + c * wc;
                    let distance2 = point.distance_squared(mesh.positions[v].as_dvec3());
                    if nearest.is_none_or(|n| distance2 < n.0) {
                        nearest = Some((distance2, seen.index));
                    }
                } else {
                    let weight = seen.weight * hat(mesh, t, v as u32, seen.barycentric);
                    total += weight;
                    for (out, &value) in out.iter_mut().zip(observed.values(seen.index)) {
                        *out += weight * f64::from(value);
                    }
                }
            }
        }
        if let Some((_, index)) = nearest {
            for (out, &value) in out.iter_mut().zip(observed.values(index)) {
                *out = f64::from(value);
            }
            known[v] = true;
        } else if total > 0.0 {
            out.iter_mut().for_each(|out| *out /= total);
            known[v] = true;
        }
        report.unseen_vertices += usize::from(!known[v] && !around.is_empty());
        report.unknowns += 1;
    }
    fill(mesh, &fans, &mut sums, &mut known, channels);
    let neutral = neutral(&observed, observations, options);
    for v in (0..vertices).filter(|&v| !known[v]) {
        sums[v * channels..(v + 1) * channels].copy_from_slice(&neutral);
        report.undetermined_vertices += usize::from(!fans.around(VertexId(v as u32)).is_empty());
    }
    let mut values: Vec<f32> = sums.iter().map(|&s| s as f32).collect();
    if let Some((low, high)) = options.bounds.range() {
        report.clamp_after_interpolation = matches!(options.bounds, Bounds::ClampAfterInterpolation { .. });
        for v in (0..vertices).filter(|&v| !is_held(v)) {
            for value in &mut values[v * channels..(v + 1) * channels] {
                report.count_outside(*value, low, high);
                if !report.clamp_after_interpolation {
                    *value = value.clamp(low, high);
                }
            }
        }
    }
    Ok(Fit { values, report })
}

/// Grows known values ring by ring: each round, unknown vertices take the mean of their known neighbours.
fn fill(mesh: &Mesh, fans: &Fans, values: &mut [f64], known: &mut [bool], channels: usize) {
    let mut open: Vec<usize> =
        (0..known.len()).filter(|&v| !known[v] && !fans.around(VertexId(v as u32)).is_empty()).collect();
    while !open.is_empty() {
        let mut found = Vec::new();
        for &v in &open {
            let mut mean = vec![0.0; channels];
            let mut count = 0.0;
            for &t in fans.around(VertexId(v as u32)) {
                for w in mesh.triangles[t.index()].iter().filter(|w| known[w.index()]) {
                    count += 1.0;
                    for (m, value) in mean.iter_mut().zip(&values[w.index() * channels..]) {
                        *m += value;
                    }
                }
            }
            if count > 0.0 {
                mean.iter_mut().for_each(|m| *m /= count);
                found.push((v, mean));
            }
        }
        if found.is_empty() {
            return;
        }
        for (v, mean) in found {
            values[v * channels..(v + 1) * channels].copy_from_slice(&mean);
            known[v] = true;
        }
        open.retain(|&v| !known[v]);
    }
}

fn neutral(observed: &ByTriangle<'_>, all: &Observations<'_>, options: &FitOptions) -> Vec<f64> {
    let channels = observed.channels();
    if let Some(value) = options.neutral {
        return vec![f64::from(value); channels];
    }
    let mut sums = vec![0.0; channels];
    let mut total = 0.0;
    for triangle in 0..all.points.iter().map(|p| p.triangle.index() + 1).max().unwrap_or(0) {
        for seen in observed.in_triangle(lightkiln_mesh::TriangleId(triangle as u32)) {
            total += seen.weight;
            for (sum, &value) in sums.iter_mut().zip(observed.values(seen.index)) {
                *sum += seen.weight * f64::from(value);
            }
        }
    }
    sums.iter().map(|s| if total > 0.0 { s / total } else { 1.0 }).collect()
}
