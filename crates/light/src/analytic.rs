//! Occlusion in closed form, for tests and for scenes whose truth must be known.
//!
//! All functions give the cosine-weighted share of the hemisphere over a point that an occluder covers,
//! `0..=1`: the form factor from a differential area. What is left to 1 is the ambient occlusion value.

use glam::{DVec3, Vec3};

/// Share of the hemisphere over `point` that a flat polygon covers (Lambert 1760; Baum, Rushmeier and Winget
/// 1989, eq. 3): half the mean over its edges of the angle that the edge spans, times the cosine between the
/// normal and the plane through point and edge.
///
/// - `normal`: of any length but zero
/// - `polygon`: corners in order, either way round; may be concave; what is below the horizon is clipped off
pub fn polygon_occlusion(point: Vec3, normal: Vec3, polygon: &[Vec3]) -> f64 {
    let (point, normal) = (point.as_dvec3(), normal.as_dvec3().normalize_or_zero());
    let corners: Vec<DVec3> = polygon.iter().map(|p| p.as_dvec3() - point).collect();
    // Clipped at the horizon: edges that run along it close the outline, also of concave polygons, where
    // those that are run to and fro cancel.
    let mut clipped = Vec::with_capacity(corners.len() + 4);
    for (i, &a) in corners.iter().enumerate() {
        let b = corners[(i + 1) % corners.len()];
        let (high_a, high_b) = (a.dot(normal), b.dot(normal));
        if high_a >= 0.0 {
            clipped.push(a);
        }
        if (high_a > 0.0 && high_b < 0.0) || (high_a < 0.0 && high_b > 0.0) {
            clipped.push(a + (b - a) * (high_a / (high_a - high_b)));
        }
    }
    let sum: f64 = (0..clipped.len())
        .map(|i| {
            let (a, b) = (clipped[i], clipped[(i + 1) % clipped.len()]);
            let cross = a.cross(b);
            let sine = cross.length();
            if sine > 0.0 { sine.atan2(a.dot(b)) * normal.dot(cross) / sine } else { 0.0 }
        })
        .sum();
    (sum.abs() / std::f64::consts::TAU).min(1.0)
}

/// Share that an endless wall covers, which stands upright on the plane of the point.
///
/// - `distance`: of the point from the wall, `>= 0`
/// - `height`: of the wall above the point, `>= 0`, may be infinite
pub fn wall_occlusion(distance: f64, height: f64) -> f64 {
    if distance == 0.0 || height.is_infinite() {
        return if height > 0.0 { 0.5 } else { 0.0 };
    }
    0.5 * (1.0 - distance / distance.hypot(height))
}

/// Share that a disk covers, which lies parallel to the plane, straight above the point.
pub fn disk_occlusion(height: f64, radius: f64) -> f64 {
    radius * radius / (radius * radius + height * height)
}

/// Share that a sphere covers, which is wholly above the horizon.
///
/// - `cosine`: between the normal and the direction of the centre
pub fn sphere_occlusion(distance: f64, radius: f64, cosine: f64) -> f64 {
    cosine * (radius / distance).powi(2)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn polygon_right_above_in_many_corners_is_a_disk() {
        let polygon: Vec<Vec3> = (0..4000)
            .map(|i| {
                let a = f64::from(i) / 4000.0 * std::f64::consts::TAU;
                Vec3::new(2.0 * a.cos() as f32, 2.0 * a.sin() as f32, 3.0)
            })
            .collect();
        let covered = polygon_occlusion(Vec3::ZERO, Vec3::Z, &polygon);
        assert!((covered - disk_occlusion(3.0, 2.0)).abs() < 1e-5, "{covered}");
    }

    #[test]
    fn polygon_crossing_the_horizon_counts_above_it_only() {
        let wall = |low: f32| {
            [
                Vec3::new(-1e5, 1.0, low),
                Vec3::new(1e5, 1.0, low),
                Vec3::new(1e5, 1.0, 2.0),
                Vec3::new(-1e5, 1.0, 2.0),
            ]
        };
        let expected = wall_occlusion(1.0, 2.0);
        for low in [0.0, -0.1, -5.0] {
            let covered = polygon_occlusion(Vec3::ZERO, Vec3::Z, &wall(low));
            assert!((covered - expected).abs() < 1e-4, "from {low}: {covered}, not {expected}");
        }
        let below = wall(-5.0).map(|p| p - Vec3::Z * 2.0);
        assert_eq!(polygon_occlusion(Vec3::ZERO, Vec3::Z, &below), 0.0);
    }

    #[test]
    fn polygon_concave_across_the_horizon_is_the_sum_of_its_parts() {
        // A U upside down over the horizon: two legs reach below it.
        let y = 1.0;
        let p = |x: f32, z: f32| Vec3::new(x, y, z);
        let whole =
            [p(-2., -1.), p(-1., -1.), p(-1., 1.), p(1., 1.), p(1., -1.), p(2., -1.), p(2., 2.), p(-2., 2.)];
        let parts = [
            vec![p(-2., 0.), p(-1., 0.), p(-1., 1.), p(-2., 1.)],
            vec![p(1., 0.), p(2., 0.), p(2., 1.), p(1., 1.)],
            vec![p(-2., 1.), p(2., 1.), p(2., 2.), p(-2., 2.)],
        ];
        let sum: f64 = parts.iter().map(|part| polygon_occlusion(Vec3::ZERO, Vec3::Z, part)).sum();
        assert!((polygon_occlusion(Vec3::ZERO, Vec3::Z, &whole) - sum).abs() < 1e-9);
    }

    #[test]
    fn polygon_closed_box_covers_everything() {
        let c = |i: u32| {
            Vec3::new((i & 1) as f32, (i >> 1 & 1) as f32, (i >> 2 & 1) as f32) * 2.0
                - Vec3::new(0.7, 1.2, 0.0)
        };
        let faces = [[4, 5, 7, 6], [0, 1, 5, 4], [2, 3, 7, 6], [0, 2, 6, 4], [1, 3, 7, 5]];
        let sum: f64 = faces.iter().map(|f| polygon_occlusion(Vec3::ZERO, Vec3::Z, &f.map(c))).sum();
        assert!((sum - 1.0).abs() < 1e-9, "{sum}");
    }

    #[test]
    fn polygon_degenerate_or_empty_covers_nothing() {
        assert_eq!(polygon_occlusion(Vec3::ZERO, Vec3::Z, &[]), 0.0);
        assert_eq!(polygon_occlusion(Vec3::ZERO, Vec3::Z, &[Vec3::X, Vec3::Z]), 0.0);
        assert_eq!(polygon_occlusion(Vec3::ZERO, Vec3::Z, &[Vec3::ZERO; 3]), 0.0);
        assert_eq!(polygon_occlusion(Vec3::ZERO, Vec3::ZERO, &[Vec3::X, Vec3::Y, Vec3::Z]), 0.0);
    }
}
