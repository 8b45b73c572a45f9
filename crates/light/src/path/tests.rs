//! The two ways to find the sky and shining surfaces, alone and together.

use lightkiln_mesh::{TriangleId, VertexId};

use super::*;
use crate::sources::Strategy;
use crate::{Environment, Estimates, SurfaceFlags, Surfaces};

/// A floor, a wall beside it and a small lamp above; grey, but for the lamp.
struct Corner;

impl Surfaces for Corner {
    fn flags(&self, _: TriangleId) -> SurfaceFlags {
        SurfaceFlags::default()
    }
    fn opacity(&self, _: TriangleId, _: [f32; 2]) -> f32 {
        1.0
    }
    fn emission(&self, t: TriangleId, [u, v]: [f32; 2]) -> Vec3 {
        // One lamp shines unevenly, its brightest place between those that are looked up.
        if t.0 >= 4 { Vec3::new(40.0, 50.0, 60.0) * (0.2 + u * v) } else { Vec3::ZERO }
    }
}

fn corner() -> Mesh {
    let v = Vec3::new;
    let quads = [
        [v(-1.0, 0.0, -1.0), v(-1.0, 0.0, 1.0), v(1.0, 0.0, 1.0), v(1.0, 0.0, -1.0)],
        [v(-1.0, 0.0, -1.0), v(1.0, 0.0, -1.0), v(1.0, 2.0, -1.0), v(-1.0, 2.0, -1.0)],
        [v(-0.2, 0.6, -0.5), v(0.3, 0.6, -0.5), v(0.3, 0.5, 0.1), v(-0.2, 0.5, 0.1)],
    ];
    let positions: Vec<Vec3> = quads.concat();
    let triangles =
        (0..3).flat_map(|q| [[0, 1, 2], [0, 2, 3]].map(|t| t.map(|k: u32| VertexId(4 * q + k)))).collect();
    let normals = vec![Vec3::ZERO; positions.len()];
    Mesh::new(positions, normals, triangles).unwrap()
}

fn points() -> (Vec<SurfacePoint>, Vec<u64>) {
    let places = [[0.3, 0.3], [0.1, 0.7], [0.6, 0.2]];
    let points: Vec<SurfacePoint> = (0..4)
        .flat_map(|t| places.map(|barycentric| SurfacePoint { triangle: TriangleId(t), barycentric }))
        .collect();
    let keys = (0..points.len() as u64).map(|i| random::hash(4, i, 0, 0)).collect();
    (points, keys)
}

/// Means and standard errors of all outputs.
fn bake(lighting: &Lighting, strategy: Strategy, batches: u16) -> Vec<[f32; 2]> {
    let mesh = corner();
    let tracer = Tracer::new(&mesh, &Corner).unwrap();
    let outputs = [Output::Direct, Output::Indirect, Output::Harmonics { bands: 2 }];
    let mut signal = PathTraced::new(&tracer, &mesh, lighting, &outputs, PathOptions::default()).unwrap();
    signal.sources.strategy = strategy;
    let (points, keys) = points();
    let mut estimates = Estimates::new(points.len(), signal.channels());
    estimates.refine(&signal, &points, &keys, &vec![batches; points.len()]);
    (0..points.len())
        .flat_map(|i| (0..estimates.channels).map(move |c| (i, c)))
        .map(|(i, c)| [estimates.mean(i)[c], estimates.spread_variance_of_mean(i, c).sqrt()])
        .collect()
}

/// Both kinds of rays alone and together have the same means; returns the noise of each.
fn compare(lighting: &Lighting) -> [f32; 3] {
    const BATCHES: u16 = 400;
    let all = [Strategy::Both, Strategy::Lights, Strategy::Hemisphere].map(|s| bake(lighting, s, BATCHES));
    let (mut beyond, mut noise) = (0, [0.0; 3]);
    for (i, &[value, sigma]) in all[0].iter().enumerate() {
        for alone in &all[1..] {
            let [other, other_sigma] = alone[i];
            let sigma = sigma.hypot(other_sigma);
            assert!((value - other).abs() < 6.0 * sigma + 0.02, "{i}: {value}, {other} +- {sigma}");
            beyond += usize::from((value - other).abs() > 3.0 * sigma + 1e-3);
        }
        for (noise, values) in noise.iter_mut().zip(&all) {
            *noise += values[i][1].powi(2);
        }
    }
    assert!(beyond * 50 <= 2 * all[0].len(), "{beyond} of {} beyond three sigma", 2 * all[0].len());
    noise
}

#[test]
fn emitters_by_lights_by_hemisphere_and_by_both_are_the_same() {
    let [both, lights, hemisphere] = compare(&Lighting::default());
    assert!(both < 1.1 * lights && both < 0.5 * hemisphere, "{both} {lights} {hemisphere}");
}

#[test]
fn sky_by_lights_by_hemisphere_and_by_both_is_the_same() {
    // A dim sky with a bright patch.
    let pixels: Vec<Vec3> = (0..32 * 16_u32)
        .map(|i| {
            let sun = (3..5).contains(&(i / 32)) && (10..12).contains(&(i % 32));
            if sun { Vec3::new(400.0, 300.0, 200.0) } else { Vec3::splat(0.5 + (i % 7) as f32 * 0.5) }
        })
        .collect();
    let environment = Environment::lat_long(32, 16, pixels, 0.7, 1.0).unwrap();
    let lighting = Lighting { lights: Vec::new(), environment: Some(environment) };
    // What is as dim as the mean is not sampled, so lights alone cannot be compared.
    let (both, hemisphere) =
        (bake(&lighting, Strategy::Both, 400), bake(&lighting, Strategy::Hemisphere, 400));
    let mut noise = [0.0; 2];
    for (&[value, sigma], [other, other_sigma]) in both.iter().zip(hemisphere) {
        let both = sigma.hypot(other_sigma);
        assert!((value - other).abs() < 5.0 * both + 0.02, "{value}, {other} +- {both}");
        noise[0] += sigma.powi(2);
        noise[1] += other_sigma.powi(2);
    }
    assert!(noise[0] < 0.3 * noise[1], "{noise:?}");
}
