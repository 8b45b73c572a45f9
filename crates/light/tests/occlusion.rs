//! Ambient occlusion against closed forms, and estimates against their own claims.
#![allow(clippy::unwrap_used)]

use glam::{Quat, Vec3};
use lightkiln_light::{AmbientOcclusion, Estimates, Opaque, SurfaceFlags, Surfaces, Tracer, analytic};
use lightkiln_mesh::{Mesh, SurfacePoint, TriangleId, VertexId, random};

struct Builder {
    positions: Vec<Vec3>,
    normals: Vec<Vec3>,
    triangles: Vec<[VertexId; 3]>,
}

impl Builder {
    fn new() -> Self {
        Self { positions: Vec::new(), normals: Vec::new(), triangles: Vec::new() }
    }
    fn polygon(mut self, corners: &[Vec3]) -> Self {
        let base = self.positions.len() as u32;
        let n = (corners[1] - corners[0]).cross(corners[2] - corners[0]).normalize();
        self.positions.extend(corners);
        self.normals.extend(corners.iter().map(|_| n));
        for i in 1..corners.len() as u32 - 1 {
            self.triangles.push([base, base + i, base + i + 1].map(VertexId));
        }
        self
    }
    fn rectangle(self, corner: Vec3, u: Vec3, v: Vec3) -> Self {
        self.polygon(&[corner, corner + u, corner + u + v, corner + v])
    }
    fn sphere(mut self, centre: Vec3, radius: f32, n: u32, outward: bool) -> Self {
        let base = self.positions.len() as u32;
        let pi = std::f32::consts::PI;
        for j in 0..=n {
            for i in 0..2 * n {
                let (a, b) = (i as f32 / n as f32 * pi, j as f32 / n as f32 * pi);
                // The sine of pi is not zero in floats, and would turn the pole inside out.
                let ring = if j % n == 0 { 0.0 } else { b.sin() };
                let d = Vec3::new(ring * a.cos(), b.cos(), ring * a.sin());
                self.positions.push(centre + radius * d);
                self.normals.push(if outward { d } else { -d });
            }
        }
        for j in 0..n {
            for i in 0..2 * n {
                let at = |j: u32, i: u32| base + j * 2 * n + i % (2 * n);
                for t in
                    [[at(j, i), at(j, i + 1), at(j + 1, i)], [at(j, i + 1), at(j + 1, i + 1), at(j + 1, i)]]
                {
                    let t = if outward { t } else { [t[0], t[2], t[1]] };
                    self.triangles.push(t.map(VertexId));
                }
            }
        }
        self
    }
    fn mesh(self) -> Mesh {
        Mesh::new(self.positions, self.normals, self.triangles).unwrap()
    }
}

fn points(triangles: std::ops::Range<u32>, each: u64) -> (Vec<SurfacePoint>, Vec<u64>) {
    let points: Vec<SurfacePoint> = triangles
        .flat_map(|t| {
            (0..each).map(move |k| SurfacePoint {
                triangle: TriangleId(t),
                barycentric: random::square_to_triangle(random::unit2(random::hash(8, t.into(), k, 0))),
            })
        })
        .collect();
    let keys = (0..points.len() as u64).map(|i| random::hash(77, i, 0, 0)).collect();
    (points, keys)
}

fn bake(
    mesh: &Mesh,
    surfaces: &dyn Surfaces,
    distance: f32,
    points: &[SurfacePoint],
    keys: &[u64],
    batches: u16,
) -> Estimates {
    let tracer = Tracer::new(mesh, surfaces).unwrap();
    let signal = AmbientOcclusion::new(&tracer, mesh, distance, 5);
    let mut estimates = Estimates::new(points.len(), 1);
    estimates.refine(&signal, points, keys, &vec![batches; points.len()]);
    estimates
}

/// Shares of points whose error is above two and three of their own sigmas, and root mean square of the ratio.
fn honesty(
    mesh: &Mesh,
    points: &[SurfacePoint],
    keys: &[u64],
    batches: u16,
    truth: impl Fn(Vec3) -> f64,
) -> [f64; 3] {
    let estimates = bake(mesh, &Opaque, f32::INFINITY, points, keys, batches);
    let (mut above_two, mut above_three, mut squares) = (0.0, 0.0, 0.0);
    for (i, &point) in points.iter().enumerate() {
        let error = f64::from(estimates.mean(i)[0]) - truth(mesh.position(point));
        let z = error.abs() / f64::from(estimates.variance_of_mean(i, 0)).sqrt();
        above_two += f64::from(u8::from(z > 2.0));
        above_three += f64::from(u8::from(z > 3.0));
        squares += z * z;
    }
    let count = points.len() as f64;
    [above_two / count, above_three / count, (squares / count).sqrt()]
}

#[test]
fn variance_against_closed_forms_is_honest() {
    // Floors under a rectangle, a wall, a tilted triangle and a grid of slats, over many points.
    let floor = || Builder::new().rectangle(Vec3::new(-3., -3., 0.), Vec3::X * 6.0, Vec3::Y * 6.0);
    let lid =
        [Vec3::new(-1., -1., 0.7), Vec3::new(-1., 1., 0.7), Vec3::new(1., 1., 0.7), Vec3::new(1., -1., 0.7)];
    let wall =
        [Vec3::new(-9., 0.2, 0.), Vec3::new(9., 0.2, 0.), Vec3::new(9., 0.2, 2.), Vec3::new(-9., 0.2, 2.)];
    let tilted = [Vec3::new(0., 0., 0.3), Vec3::new(1.4, 0.3, 1.0), Vec3::new(-0.4, 1.1, 2.0)];
    let slats: Vec<[Vec3; 4]> = (0..24)
        .map(|i| {
            let x = -2.4 + 0.2 * i as f32;
            [
                Vec3::new(x, -3., 1.),
                Vec3::new(x, 3., 1.),
                Vec3::new(x + 0.1, 3., 1.),
                Vec3::new(x + 0.1, -3., 1.),
            ]
        })
        .collect();
    let dots: Vec<[Vec3; 3]> = (0..60)
        .map(|i| {
            let h = |k| random::unit(random::hash(31, i, k, 0));
            let c = Vec3::new(h(0) * 4.0 - 2.0, h(1) * 4.0 - 2.0, 1.0);
            [c, c + Vec3::new(0.2, 0.0, 0.0), c + Vec3::new(0.05, 0.25, 0.0)]
        })
        .collect();
    let scenes: [(&str, Vec<Vec<Vec3>>); 5] = [
        ("lid", vec![lid.to_vec()]),
        ("wall", vec![wall.to_vec()]),
        ("tilted", vec![tilted.to_vec()]),
        ("slats", slats.iter().map(|s| s.to_vec()).collect()),
        ("dots", dots.iter().map(|s| s.to_vec()).collect()),
    ];
    let (points, keys) = points(0..2, 2000);
    for (name, polygons) in scenes {
        let mesh = polygons.iter().fold(floor(), |builder, polygon| builder.polygon(polygon)).mesh();
        let truth =
            |p: Vec3| 1.0 - polygons.iter().map(|q| analytic::polygon_occlusion(p, Vec3::Z, q)).sum::<f64>();
        for batches in [1, 2, 4, 16] {
            let [two, three, spread] = honesty(&mesh, &points, &keys, batches, truth);
            println!("{name:>8} x{batches:<3} >2: {two:.4} >3: {three:.4} rms {spread:.3}");
            assert!(three <= 0.01, "{name} with {batches} batches: {three} above three sigmas");
            assert!(spread < 1.1 && (spread > 0.25), "{name} with {batches} batches: rms {spread}");
        }
    }
}

#[test]
fn occlusion_of_disk_and_sphere_overhead_is_the_closed_form() {
    let small = || Builder::new().rectangle(Vec3::new(-1e-3, -1e-3, 0.), Vec3::X * 2e-3, Vec3::Y * 2e-3);
    let disk: Vec<Vec3> = (0..256)
        .map(|i| Quat::from_rotation_z(i as f32 / 256.0 * std::f32::consts::TAU) * Vec3::new(0.8, 0.0, 1.0))
        .collect();
    let point = [SurfacePoint { triangle: TriangleId(0), barycentric: [0.5, 0.25] }];
    let estimates = bake(&small().polygon(&disk).mesh(), &Opaque, f32::INFINITY, &point, &[3], 2000);
    let expected = 1.0 - analytic::disk_occlusion(1.0, 0.8);
    assert!((f64::from(estimates.mean(0)[0]) - expected).abs() < 2e-3, "{:?} {expected}", estimates.mean(0));

    let centre = Vec3::new(1.2, 0.3, 1.6);
    let mesh = small().sphere(centre, 0.7, 48, true).mesh();
    let estimates = bake(&mesh, &Opaque, f32::INFINITY, &point, &[4], 2000);
    let cosine = f64::from(centre.z / centre.length());
    let expected = 1.0 - analytic::sphere_occlusion(f64::from(centre.length()), 0.7, cosine);
    assert!((f64::from(estimates.mean(0)[0]) - expected).abs() < 2e-3, "{:?} {expected}", estimates.mean(0));
}

#[test]
fn occlusion_inside_closed_box_is_zero_and_valid() {
    let mut builder = Builder::new();
    for axis in [Vec3::X, Vec3::Y, Vec3::Z] {
        let (u, v) = (Vec3::new(axis.z, axis.x, axis.y), Vec3::new(axis.y, axis.z, axis.x));
        // Fronts look inward.
        builder =
            builder.rectangle(-(axis + u + v), u * 2.0, v * 2.0).rectangle(axis - u - v, v * 2.0, u * 2.0);
    }
    let mesh = builder.mesh();
    for t in mesh.triangle_ids() {
        let inward = -mesh.corners(t).iter().sum::<Vec3>();
        assert!(mesh.geometric_normal(t).dot(inward) > 0.0, "the test's own box is inside out");
    }
    let (points, keys) = points(0..12, 50);
    let estimates = bake(&mesh, &Opaque, f32::INFINITY, &points, &keys, 4);
    assert!((0..points.len()).all(|i| estimates.mean(i)[0] == 0.0 && estimates.valid(i)));
    // Nothing within a tenth of a distance that the middle of a face has: open there.
    let middle = [SurfacePoint { triangle: TriangleId(0), barycentric: [0.25, 0.5] }];
    assert_eq!(bake(&mesh, &Opaque, 0.4, &middle, &[1], 8).mean(0)[0], 1.0);
}

#[test]
fn occlusion_on_open_smooth_sphere_is_exactly_one() {
    for (scale, offset) in [(1.0, Vec3::ZERO), (1000.0, Vec3::new(900.0, 1200.0, -500.0)), (1e-3, Vec3::ONE)]
    {
        for n in [6, 40] {
            let mesh = Builder::new().sphere(offset, scale, n, true).mesh();
            let count = mesh.triangle_count() as u32;
            let (points, keys) = points(0..count, 3);
            let estimates = bake(&mesh, &Opaque, f32::INFINITY, &points, &keys, 4);
            for (i, point) in points.iter().enumerate() {
                if mesh.area(point.triangle) > 0.0 {
                    assert_eq!(estimates.mean(i)[0], 1.0, "scale {scale} n {n} {point:?}");
                    assert!(estimates.valid(i));
                }
            }
        }
    }
}

#[test]
fn points_inside_other_geometry_are_not_valid() {
    // A floor that runs through a closed sphere.
    let mesh = Builder::new()
        .rectangle(Vec3::new(-3., -3., 0.), Vec3::X * 6.0, Vec3::Y * 6.0)
        .sphere(Vec3::new(0.3, 0.2, 0.1), 1.0, 24, true)
        .mesh();
    let (points, keys) = points(0..2, 400);
    let estimates = bake(&mesh, &Opaque, 0.5, &points, &keys, 1);
    let mut inside = 0;
    for (i, &point) in points.iter().enumerate() {
        let distance = mesh.position(point).distance(Vec3::new(0.3, 0.2, 0.1));
        if !(0.98..1.0).contains(&distance) {
            assert_eq!(estimates.valid(i), distance > 1.0, "{distance}");
            inside += usize::from(distance < 1.0);
        }
    }
    assert!(inside > 20);

    struct Cloth;
    impl Surfaces for Cloth {
        fn flags(&self, _: TriangleId) -> SurfaceFlags {
            SurfaceFlags { translucent: false, double_sided: true, turned: false }
        }
        fn opacity(&self, _: TriangleId, _: [f32; 2]) -> f32 {
            1.0
        }
    }
    let estimates = bake(&mesh, &Cloth, 0.5, &points, &keys, 1);
    assert!((0..points.len()).all(|i| estimates.valid(i)));
}

#[test]
fn translucent_lid_dims_by_its_opacity() {
    struct Lid;
    impl Surfaces for Lid {
        fn flags(&self, triangle: TriangleId) -> SurfaceFlags {
            SurfaceFlags { translucent: triangle.0 >= 2, double_sided: false, turned: false }
        }
        fn opacity(&self, _: TriangleId, _: [f32; 2]) -> f32 {
            0.4
        }
    }
    let lid = |z: f32| {
        [Vec3::new(-99., -99., z), Vec3::new(-99., 99., z), Vec3::new(99., 99., z), Vec3::new(99., -99., z)]
    };
    let mesh = Builder::new()
        .rectangle(Vec3::new(-0.1, -0.1, 0.), Vec3::X * 0.2, Vec3::Y * 0.2)
        .polygon(&lid(0.01))
        .polygon(&lid(0.02))
        .mesh();
    let (points, keys) = points(0..2, 20);
    for batches in [1, 3] {
        let estimates = bake(&mesh, &Lid, f32::INFINITY, &points, &keys, batches);
        for i in 0..points.len() {
            assert!((estimates.mean(i)[0] - 0.36).abs() < 1e-3, "{}", estimates.mean(i)[0]);
        }
    }
}

fn knot() -> Mesh {
    Builder::new()
        .rectangle(Vec3::new(-3., -3., -0.4), Vec3::X * 6.0, Vec3::Y * 6.0)
        .sphere(Vec3::new(0.3, 0.2, 0.5), 0.7, 16, true)
        .sphere(Vec3::new(-0.9, 0.1, 0.2), 0.6, 16, true)
        .sphere(Vec3::new(-0.2, -1.0, 0.3), 0.5, 16, true)
        .mesh()
}

#[test]
fn estimates_do_not_depend_on_threads_calls_or_path() {
    let mesh = knot();
    let (points, keys) = points(0..mesh.triangle_count() as u32, 1);
    let wanted: Vec<u16> = (0..points.len() as u16).map(|i| i % 5).collect();
    let tracer = Tracer::new(&mesh, &Opaque).unwrap();
    let run = |tracer: &Tracer, threads: usize, steps: u16| {
        let signal = AmbientOcclusion::new(tracer, &mesh, 2.0, 9);
        let mut estimates = Estimates::new(points.len(), 1);
        rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap().install(|| {
            for step in 1..=steps {
                let part: Vec<u16> = wanted.iter().map(|w| w * step / steps).collect();
                estimates.refine(&signal, &points, &keys, &part);
            }
        });
        estimates
    };
    let one = run(&tracer, 1, 1);
    assert_eq!(one, run(&tracer, 2, 1));
    assert_eq!(one, run(&tracer, 2, 3));
    assert_eq!(one, run(&Tracer::new(&mesh, &Opaque).unwrap().portable(), 1, 1));
    let rebuilt = rayon::ThreadPoolBuilder::new()
        .num_threads(1)
        .build()
        .unwrap()
        .install(|| Tracer::new(&mesh, &Opaque).unwrap());
    assert_eq!(one, run(&rebuilt, 2, 1));
    let total: u64 = wanted.iter().map(|&w| u64::from(w) * 16).sum();
    assert_eq!(one.rays(), total);
    assert!((0..points.len()).all(|i| one.batches(i) == wanted[i]));
}

#[test]
fn estimates_of_scaled_mesh_are_nearly_identical() {
    let mesh = knot();
    let (points, keys) = points(0..mesh.triangle_count() as u32, 1);
    let one = bake(&mesh, &Opaque, 2.0, &points, &keys, 2);
    for scale in [1000.0_f32, 0.001, 1024.0] {
        let scaled = Mesh { positions: mesh.positions.iter().map(|p| *p * scale).collect(), ..mesh.clone() };
        let other = bake(&scaled, &Opaque, 2.0 * scale, &points, &keys, 2);
        // One ray in thousands passes an edge by less than rounding.
        let differ = (0..points.len()).filter(|&i| one.mean(i) != other.mean(i)).count();
        assert!(differ <= points.len() / 100, "{differ} of {} at {scale}", points.len());
        if scale == 1024.0 {
            assert_eq!(differ, 0);
        }
    }
}

#[test]
fn estimates_of_moved_mesh_agree_within_noise() {
    let mesh = knot();
    let (points, keys) = points(0..mesh.triangle_count() as u32, 1);
    let turn = Quat::from_euler(glam::EulerRot::XYZ, 0.4, 1.1, -0.6);
    let moved = Mesh {
        positions: mesh.positions.iter().map(|p| turn * *p + Vec3::new(3.0, -40.0, 7.0)).collect(),
        normals: mesh.normals.iter().map(|n| turn * *n).collect(),
        ..mesh.clone()
    };
    let (a, b) =
        (bake(&mesh, &Opaque, 2.0, &points, &keys, 8), bake(&moved, &Opaque, 2.0, &points, &keys, 8));
    let far = (0..points.len())
        .filter(|&i| {
            let sigma = (a.variance_of_mean(i, 0) + b.variance_of_mean(i, 0)).sqrt();
            (a.mean(i)[0] - b.mean(i)[0]).abs() > 3.0 * sigma
        })
        .count();
    assert!(far <= points.len() / 100, "{far} of {}", points.len());
}

#[test]
fn estimates_without_batches_claim_nothing() {
    let estimates = Estimates::new(2, 3);
    assert!(estimates.variance_of_mean(1, 2).is_infinite() && !estimates.valid(0));
    assert_eq!((estimates.mean(1), estimates.rays(), estimates.len()), (&[0.0; 3][..], 0, 2));
}
