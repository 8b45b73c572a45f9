//! Falloff and ground against closed forms.
#![allow(clippy::unwrap_used)]

use glam::Vec3;
use lightkiln_light::{
    AmbientOcclusion, BentNormal, Estimates, Falloff, Ground, OcclusionOptions, Opaque, Signal, SurfaceFlags,
    Surfaces, Tracer,
};
use lightkiln_mesh::{Mesh, SurfacePoint, TriangleId, VertexId};

/// A rectangle about `centre`, with the front that `u x v` has; after it, level panes at the given heights.
fn patch(centre: Vec3, u: Vec3, v: Vec3, panes: &[f32]) -> Mesh {
    let corners =
        |centre: Vec3, u: Vec3, v: Vec3| [centre - u - v, centre + u - v, centre + u + v, centre - u + v];
    let mut positions = corners(centre, u, v).to_vec();
    let mut normals = vec![u.cross(v).normalize(); 4];
    for &height in panes {
        positions.extend(corners(Vec3::Y * height, Vec3::X * 100.0, Vec3::Z * 100.0));
        normals.extend([Vec3::NEG_Y; 4]);
    }
    let rectangles = 0..positions.len() as u32 / 4;
    let triangles =
        rectangles.flat_map(|r| [[0, 1, 2], [0, 2, 3]].map(|t: [u32; 3]| t.map(|k| VertexId(4 * r + k))));
    Mesh::new(positions, normals, triangles.collect()).unwrap()
}

const MIDDLE: SurfacePoint = SurfacePoint { triangle: TriangleId(0), barycentric: [0.0, 0.5] };

fn estimate(signal: &dyn Signal, batches: u16) -> Estimates {
    let mut estimates = Estimates::new(1, signal.channels());
    estimates.refine(signal, &[MIDDLE], &[4], &[batches]);
    estimates
}

fn occlusion(mesh: &Mesh, surfaces: &dyn Surfaces, options: OcclusionOptions) -> (f64, bool) {
    let tracer = Tracer::new(mesh, surfaces).unwrap();
    let estimates = estimate(&AmbientOcclusion::with_options(&tracer, mesh, options, 1), 1000);
    (f64::from(estimates.mean(0)[0]), estimates.valid(0))
}

/// Openness under endless level panes, by the midpoint rule over the cosine.
fn under_panes(heights: &[f64], opacity: f64, distance: f64, power: f64) -> f64 {
    let steps = 100_000;
    (0..steps)
        .map(|i| {
            let cosine = (f64::from(i) + 0.5) / f64::from(steps);
            let through: f64 = heights
                .iter()
                .map(|h| 1.0 - opacity * (1.0 - h / cosine / distance).max(0.0).powf(power))
                .product();
            2.0 * cosine * through / f64::from(steps)
        })
        .sum()
}

struct Panes(f32);

impl Surfaces for Panes {
    fn flags(&self, triangle: TriangleId) -> SurfaceFlags {
        SurfaceFlags { translucent: triangle.0 >= 2, ..SurfaceFlags::default() }
    }
    fn opacity(&self, _: TriangleId, _: [f32; 2]) -> f32 {
        self.0
    }
}

#[test]
fn falloff_under_a_lid_is_the_closed_form() {
    let mesh = patch(Vec3::ZERO, Vec3::Z * 0.1, Vec3::X * 0.1, &[0.3]);
    for power in [0.5, 1.0, 2.0] {
        let falloff = Falloff::Smooth { power };
        let options = OcclusionOptions { distance: 1.0, falloff, ground: None };
        let (value, valid) = occlusion(&mesh, &Opaque, options);
        let expected = under_panes(&[0.3], 1.0, 1.0, f64::from(power));
        assert!((value - expected).abs() < 2e-3 && valid, "{power}: {value} {expected}");
        // Nothing within reach, and everything in touch.
        assert_eq!(occlusion(&mesh, &Opaque, OcclusionOptions { distance: 0.25, ..options }).0, 1.0);
        let hard = OcclusionOptions { distance: f32::INFINITY, ..options };
        assert!(occlusion(&mesh, &Opaque, hard).0 < 1e-6);
    }
}

#[test]
fn falloff_behind_panes_dims_each_by_its_distance() {
    let mesh = patch(Vec3::ZERO, Vec3::Z * 0.1, Vec3::X * 0.1, &[0.5, 0.2]);
    let falloff = Falloff::Smooth { power: 2.0 };
    let options = OcclusionOptions { distance: 2.0, falloff, ground: None };
    let (value, valid) = occlusion(&mesh, &Panes(0.6), options);
    let expected = under_panes(&[0.2, 0.5], 0.6, 2.0, 2.0);
    assert!((value - expected).abs() < 2e-3 && valid, "{value} {expected}");
}

#[test]
fn ground_beside_a_wall_is_half_of_what_it_sees() {
    // A wall that looks along +x at height 0.5 above a ground at -1.
    let mesh = patch(Vec3::Y * -0.5, Vec3::Y * 0.1, Vec3::Z * 0.1, &[]);
    assert_eq!(mesh.geometric_normal(TriangleId(0)), Vec3::X);
    let ground = Some(Ground::Height(-1.0));
    let (value, valid) = occlusion(&mesh, &Opaque, OcclusionOptions { ground, ..Default::default() });
    assert!((value - 0.5).abs() < 2e-3 && valid, "{value}");
    let near = OcclusionOptions { ground, distance: 0.49, ..Default::default() };
    assert_eq!(occlusion(&mesh, &Opaque, near).0, 1.0);
    // What is open above the ground is a half: the bent normal points up and out equally.
    let tracer = Tracer::new(&mesh, &Opaque).unwrap();
    let options = OcclusionOptions { ground, ..Default::default() };
    let estimates = estimate(&BentNormal::new(&tracer, &mesh, options, 1), 1000);
    let bent = estimates.mean(0);
    assert!((bent[0] - 0.5).abs() < 3e-3 && (bent[1] - 1.0 / std::f32::consts::PI).abs() < 3e-3, "{bent:?}");
}

#[test]
fn ground_under_a_bottom_is_an_endless_pane() {
    let mesh = patch(Vec3::ZERO, Vec3::X * 0.1, Vec3::Z * 0.1, &[]);
    assert_eq!(mesh.geometric_normal(TriangleId(0)), Vec3::NEG_Y);
    let options = OcclusionOptions {
        distance: 1.0,
        falloff: Falloff::Smooth { power: 1.0 },
        ground: Some(Ground::Height(-0.25)),
    };
    let (value, valid) = occlusion(&mesh, &Opaque, options);
    assert!((value - (1.0 - 0.75 * 0.75)).abs() < 2e-3 && valid, "{value}");
    // Standing on it: closed, and part of the surface.
    let lowest = OcclusionOptions { ground: Some(Ground::Lowest), ..options };
    assert_eq!(occlusion(&mesh, &Opaque, lowest), (0.0, true));
    // Below it: inside.
    let sunk = OcclusionOptions { ground: Some(Ground::Height(0.01)), ..options };
    assert_eq!(occlusion(&mesh, &Opaque, sunk), (0.0, false));
}
