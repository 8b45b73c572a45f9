//! The errors that estimates of light claim, against those that they have.
#![allow(clippy::unwrap_used, clippy::print_stdout)]

use glam::Vec3;
use lightkiln_light::{
    Environment, Estimates, Light, Lighting, Output, PathOptions, PathTraced, Signal, SurfaceFlags, Surfaces,
    Tracer,
};
use lightkiln_mesh::{Mesh, SurfacePoint, TriangleId, VertexId, random};

/// Boxes: the first is seen from inside, all others from outside.
fn boxes(boxes: &[[Vec3; 2]]) -> Mesh {
    let (mut positions, mut triangles) = (Vec::new(), Vec::new());
    for (i, &[centre, half]) in boxes.iter().enumerate() {
        for axis in 0..3 {
            let u = Vec3::AXES[(axis + 1) % 3] * half;
            let v = Vec3::AXES[(axis + 2) % 3] * half;
            for side in [-1.0, 1.0] {
                let w = Vec3::AXES[axis] * half * side;
                let inward = (side < 0.0) == (i == 0);
                let (u, v) = if inward { (u, v) } else { (v, u) };
                let base = positions.len() as u32;
                positions.extend([w - u - v, w + u - v, w + u + v, w - u + v].map(|p| centre + p));
                triangles.extend([[0, 1, 2], [0, 2, 3]].map(|t: [u32; 3]| t.map(|k| VertexId(base + k))));
            }
        }
    }
    let normals = vec![Vec3::ZERO; positions.len()];
    Mesh::new(positions, normals, triangles).unwrap()
}

/// A room with boxes in it; the last may shine.
fn room() -> Mesh {
    let v = Vec3::new;
    boxes(&[
        [Vec3::ZERO, v(1.5, 1.0, 1.2)],
        [v(-0.6, -0.7, 0.1), v(0.4, 0.28, 0.3)],
        [v(0.7, -0.5, -0.4), v(0.2, 0.48, 0.2)],
        [v(0.2, 0.1, 0.5), v(0.5, 0.03, 0.2)],
        [v(-0.9, 0.3, -0.7), v(0.1, 0.1, 0.1)],
    ])
}

/// Grey; the triangles from `lamp` on shine, and those of the first box's ceiling may be open.
struct Grey {
    lamp: u32,
    open: bool,
}

impl Surfaces for Grey {
    fn flags(&self, t: TriangleId) -> SurfaceFlags {
        // The ceiling is the box's upper side: axis 1, second side.
        SurfaceFlags { translucent: self.open && (6..8).contains(&t.0), ..SurfaceFlags::default() }
    }
    fn opacity(&self, t: TriangleId, _: [f32; 2]) -> f32 {
        if self.flags(t).translucent { 0.0 } else { 1.0 }
    }
    fn emission(&self, t: TriangleId, _: [f32; 2]) -> Vec3 {
        if t.0 >= self.lamp { Vec3::new(300.0, 200.0, 100.0) } else { Vec3::ZERO }
    }
}

struct Case {
    name: &'static str,
    lighting: Lighting,
    surfaces: Grey,
}

fn cases() -> Vec<Case> {
    let pixels = (0..32 * 16_u32).map(|i| {
        Vec3::splat(if (2..4).contains(&(i / 32)) && (10..12).contains(&(i % 32)) { 300.0 } else { 1.0 })
    });
    let patch = Environment::lat_long(32, 16, pixels.collect(), 0.0, 1.0).ok();
    let none = u32::MAX;
    let lit = |lights: &[Light], environment| Lighting { lights: lights.to_vec(), environment };
    let even = Environment::constant(Vec3::ONE).ok();
    let sun = Light::sun(0.7, 1.1, Vec3::splat(1000.0));
    vec![
        Case { name: "lamp", lighting: lit(&[], None), surfaces: Grey { lamp: 48, open: false } },
        Case { name: "sky", lighting: lit(&[], even.clone()), surfaces: Grey { lamp: none, open: true } },
        Case { name: "patch", lighting: lit(&[], patch), surfaces: Grey { lamp: none, open: true } },
        Case { name: "sun", lighting: lit(&[sun], even), surfaces: Grey { lamp: none, open: true } },
    ]
}

#[test]
fn light_is_as_near_as_estimates_say() {
    let mesh = room();
    let outputs = [Output::Direct, Output::Indirect, Output::Irradiance, Output::Harmonics { bands: 2 }];
    let points: Vec<SurfacePoint> = (0..360_u64)
        .map(|i| SurfacePoint {
            triangle: TriangleId((2 * (i / 15)) as u32),
            barycentric: random::square_to_triangle(random::unit2(random::hash(5, i, 0, 0))),
        })
        .collect();
    let keys = |seed| (0..points.len() as u64).map(|i| random::hash(seed, i, 0, 0)).collect::<Vec<_>>();
    for case in cases() {
        let tracer = Tracer::new(&mesh, &case.surfaces).unwrap();
        let signal =
            PathTraced::new(&tracer, &mesh, &case.lighting, &outputs, PathOptions::default()).unwrap();
        let run = |seed, batches| {
            let mut estimates = Estimates::new(points.len(), signal.channels());
            estimates.refine(&signal, &points, &keys(seed), &vec![batches; points.len()]);
            estimates
        };
        let truth = run(1, 250);
        for batches in [1, 2, 4, 32] {
            let tried = run(2, batches);
            let (mut beyond, mut claimed, mut had) = (0, 0.0, 0.0);
            for (i, c) in (0..points.len()).flat_map(|i| (0..signal.channels()).map(move |c| (i, c))) {
                let error = f64::from(tried.mean(i)[c] - truth.mean(i)[c]);
                let own = f64::from(truth.spread_variance_of_mean(i, c));
                let variance = f64::from(tried.variance_of_mean(i, c));
                // Rounding of a sum of some thousand rays.
                let rounding = 1e-5 * f64::from(truth.mean(i)[c].abs()) + 1e-6;
                beyond += usize::from(error.abs() > 3.0 * (variance + own).sqrt() + rounding);
                claimed += variance;
                had += (error * error - own).max(0.0);
            }
            let beyond = beyond as f64 / (points.len() * signal.channels()) as f64;
            let claim = (claimed / had).sqrt();
            println!("{} {batches}: {:.4} beyond three sigma, which is {claim:.2}", case.name, beyond);
            assert!(beyond < 0.01, "{} {batches}: {beyond} beyond three sigma", case.name);
            // A single batch knows nothing of its spread.
            assert!(batches == 1 || claim < 1.5, "{} {batches}: claims {claim} times the error", case.name);
        }
    }
}

/// The floor as an image: what Open Image Denoise says of its errors.
#[cfg(feature = "oidn")]
#[test]
fn light_filtered_by_oidn_is_as_near_as_it_says() {
    use lightkiln_light::oidn::{self, Lightmap};
    if let Err(error) = oidn::find() {
        println!("!! SKIPPED: {error}; {} names it", oidn::VARIABLE);
        return;
    }
    /// The constants of the estimate were chosen on the first two, and the others judged them. One seed is not enough: what
    /// kept the limit on the first did not on the second.
    const SEEDS: [u64; 4] = [2, 3, 10, 11];
    let mesh = room();
    let size = [48_u32, 40];
    // Its two triangles are the fifth and the sixth, with the first corner in common.
    let points: Vec<SurfacePoint> = (0..size[0] * size[1])
        .map(|i| {
            let s = ((i % size[0]) as f32 + 0.5) / size[0] as f32;
            let t = ((i / size[0]) as f32 + 0.5) / size[1] as f32;
            let (triangle, barycentric) = if t <= s { (4, [s - t, t]) } else { (5, [s, t - s]) };
            SurfacePoint { triangle: TriangleId(triangle), barycentric }
        })
        .collect();
    let keys = |seed| (0..points.len() as u64).map(|i| random::hash(seed, i, 0, 0)).collect::<Vec<_>>();
    for case in cases() {
        let tracer = Tracer::new(&mesh, &case.surfaces).unwrap();
        for output in [Output::Direct, Output::Indirect] {
            let signal =
                PathTraced::new(&tracer, &mesh, &case.lighting, &[output], PathOptions::default()).unwrap();
            let run = |seed, batches| {
                let mut estimates = Estimates::in_halves(points.len(), signal.channels());
                estimates.refine(&signal, &points, &keys(seed), &vec![batches; points.len()]);
                estimates
            };
            let truth = run(1, 120);
            for (batches, seed) in [2, 5].into_iter().flat_map(|b| SEEDS.map(|seed| (b, seed))) {
                let tried = run(seed, batches);
                let all = || (0..points.len()).flat_map(|i| (0..3).map(move |c| (i, c)));
                let variances: Vec<f32> = all().map(|(i, c)| tried.variance_of_mean(i, c)).collect();
                // What stands on the floor hides a part of it.
                let measured: Vec<bool> = (0..points.len()).map(|i| tried.valid(i)).collect();
                let [even, odd] = tried.halves().unwrap();
                let map = Lightmap {
                    size,
                    halves: [&even, &odd],
                    values: tried.means(),
                    variances: &variances,
                    measured: &measured,
                    directional: false,
                };
                let filtered = oidn::denoise(map).unwrap();
                let (mut beyond, mut claimed, mut had, mut raw, mut count) = (0, 0.0, 0.0, 0.0, 0);
                for (i, c) in all().filter(|(i, _)| measured[*i] && truth.valid(*i)) {
                    let exact = truth.mean(i)[c];
                    let own = f64::from(truth.spread_variance_of_mean(i, c));
                    let error = f64::from(filtered.values[i * 3 + c] - exact);
                    let variance = f64::from(filtered.variances[i * 3 + c]);
                    beyond +=
                        usize::from(error.abs() > 3.0 * (variance + own).sqrt() + 1e-5 * f64::from(exact));
                    claimed += variance;
                    had += (error * error - own).max(0.0);
                    raw += (f64::from(tried.mean(i)[c] - exact).powi(2) - own).max(0.0);
                    count += 1;
                }
                let (beyond, claim, left) =
                    (f64::from(beyond as u32) / f64::from(count), (claimed / had).sqrt(), (had / raw).sqrt());
                println!(
                    "{} {output:?} {batches} {seed}: {beyond:.4} beyond three sigma, which is {claim:.2}; {left:.2} left",
                    case.name
                );
                assert!(
                    beyond < 0.01,
                    "{} {output:?} {batches} {seed}: {beyond} beyond three sigma",
                    case.name
                );
            }
        }
    }
}
