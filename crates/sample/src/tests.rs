use glam::Vec3;
use lightkiln_mesh::{Mesh, SurfacePoint, TriangleId, VertexId, random, sheets};
use proptest::prelude::*;

use crate::*;

fn mesh(positions: Vec<Vec3>, triangles: Vec<[u32; 3]>) -> Mesh {
    let normals = vec![Vec3::Z; positions.len()];
    Mesh::new(positions, normals, triangles.into_iter().map(|t| t.map(VertexId)).collect()).unwrap()
}

/// `n` x `m` quads over a rectangle of the plane z = `z`, each cut in two.
fn grid(n: u32, m: u32, size: [f32; 2], z: f32) -> Mesh {
    let at = |i: u32, j: u32| j * (n + 1) + i;
    let mut positions = Vec::new();
    let mut triangles = Vec::new();
    for j in 0..=m {
        for i in 0..=n {
            positions.push(Vec3::new(size[0] * i as f32 / n as f32, size[1] * j as f32 / m as f32, z));
            if i < n && j < m {
                triangles.push([at(i, j), at(i + 1, j), at(i + 1, j + 1)]);
                triangles.push([at(i, j), at(i + 1, j + 1), at(i, j + 1)]);
            }
        }
    }
    mesh(positions, triangles)
}

fn sphere(rows: u32) -> Mesh {
    let columns = rows * 2;
    let mut m = grid(columns, rows, [std::f32::consts::TAU, std::f32::consts::PI], 0.0);
    for p in &mut m.positions {
        let (b, a) = (p.x, p.y);
        *p = Vec3::new(a.sin() * b.cos(), a.sin() * b.sin(), a.cos());
    }
    for corners in &mut m.triangles {
        // The last column is the first one.
        *corners = corners.map(|v| if v.0 % (columns + 1) == columns { VertexId(v.0 - columns) } else { v });
    }
    m
}

/// A closed box, all corners shared.
fn slab(size: Vec3) -> Mesh {
    let corner = |i: u32| Vec3::new((i & 1) as f32, (i >> 1 & 1) as f32, (i >> 2) as f32) * size;
    let quads = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
    let triangles = quads.iter().flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]]).collect();
    mesh((0..8).map(corner).collect(), triangles)
}

fn soup(count: u32, seed: u64, size: f32) -> Mesh {
    let at = |i: u32, k: u64| {
        let place = |c: u64| random::unit(random::hash(seed, u64::from(i / 3), c, 9)) * 2.0;
        let jitter = |c: u64| (random::unit(random::hash(seed, u64::from(i), c, k)) - 0.5) * size;
        Vec3::new(place(0) + jitter(0), place(1) + jitter(1), place(2) + jitter(2))
    };
    let positions = (0..count * 3).map(|i| at(i, 1)).collect();
    // Every fourth triangle hangs on its predecessor, so that some sheets have more than one.
    let triangle = |t: u32| [if t % 4 == 1 { t * 3 - 1 } else { t * 3 }, t * 3 + 1, t * 3 + 2];
    mesh(positions, (0..count).map(triangle).collect())
}

fn sampled(mesh: &Mesh, radius: f32, seed: u64) -> Samples {
    poisson_disk(mesh, &SampleOptions { radius, seed }).unwrap()
}

/// All that is promised, checked the slow way.
fn check(mesh: &Mesh, samples: &Samples) {
    let (sheet_of, count) = sheets(mesh);
    let radius = samples.radius;
    let scale = mesh.bounds().1.abs().max(mesh.bounds().0.abs()).max_element();
    let rounding = radius * 1e-5 + scale * 1e-6;
    let at: Vec<Vec3> = samples.points.iter().map(|&p| mesh.position(p)).collect();
    let normals: Vec<Vec3> = samples.points.iter().map(|p| mesh.geometric_normal(p.triangle)).collect();
    let sheet: Vec<u32> = samples.points.iter().map(|p| sheet_of[p.triangle.index()]).collect();
    for i in 0..samples.len() {
        let [u, v] = samples.points[i].barycentric;
        assert!(u >= 0.0 && v >= 0.0 && u + v <= 1.0 + 1e-6);
        assert!(i == 0 || samples.points[i - 1].triangle <= samples.points[i].triangle);
        assert!(samples.of_triangle(samples.points[i].triangle).contains(&i));
        for j in 0..i {
            if !samples.support[i] && !samples.support[j] && sheet[i] == sheet[j] {
                let near = at[i].distance(at[j]) < radius - rounding;
                assert!(!near || normals[i].dot(normals[j]) <= 1e-6, "samples {j} and {i}");
            }
        }
    }
    // Every point of the surface has a sample of its sheet within two radii.
    let (fresh, _) = fresh_points(mesh, 2000, 77);
    let corners = mesh.triangle_ids().filter(|&t| mesh.area(t) > 0.0).flat_map(|triangle| {
        [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]].map(|barycentric| SurfacePoint { triangle, barycentric })
    });
    for p in fresh.into_iter().chain(corners) {
        let (place, own) = (mesh.position(p), sheet_of[p.triangle.index()]);
        let near =
            (0..samples.len()).any(|i| sheet[i] == own && at[i].distance(place) <= 2.0 * radius + rounding);
        assert!(near, "a hole around {place}");
    }
    // Every vertex with a sized triangle sees a sample.
    let mut sized = vec![false; mesh.vertex_count()];
    let mut seen = vec![false; mesh.vertex_count()];
    for t in mesh.triangle_ids() {
        for v in mesh.triangles[t.index()] {
            sized[v.index()] |= mesh.area(t) > 0.0;
            seen[v.index()] |= !samples.of_triangle(t).is_empty();
        }
    }
    assert_eq!(sized, seen.iter().zip(&sized).map(|(a, b)| *a && *b).collect::<Vec<_>>());
    // Areas of each sheet add up.
    let mut given = vec![0.0; count];
    let mut whole = vec![0.0; count];
    samples.areas.iter().zip(&sheet).for_each(|(&a, &s)| given[s as usize] += f64::from(a));
    mesh.triangle_ids().for_each(|t| whole[sheet_of[t.index()] as usize] += mesh.area(t));
    for (given, whole) in given.iter().zip(&whole) {
        assert!((given - whole).abs() <= 1e-5 * whole, "{given} of {whole}");
    }
}

#[test]
fn poisson_single_triangle_keeps_distance_and_leaves_no_hole() {
    let m = mesh(vec![Vec3::ZERO, Vec3::X, Vec3::Y], vec![[0, 1, 2]]);
    for radius in [0.02, 0.1, 0.5, 3.0] {
        let samples = sampled(&m, radius, 3);
        check(&m, &samples);
        assert!(!samples.is_empty());
    }
    assert_eq!(sampled(&m, 3.0, 3).len(), 1);
}

#[test]
fn poisson_sphere_keeps_every_promise() {
    for (rows, radius) in [(6, 0.08), (40, 0.1), (60, 0.4)] {
        let m = sphere(rows);
        check(&m, &sampled(&m, radius, 1));
    }
}

#[test]
fn poisson_thin_slab_sides_do_not_disturb_each_other() {
    let m = slab(Vec3::new(1.0, 1.0, 0.002));
    let samples = sampled(&m, 0.05, 5);
    check(&m, &samples);
    let side = |z: f32| samples.points.iter().filter(|p| m.geometric_normal(p.triangle).z == z).count();
    let alone = sampled(&grid(1, 1, [1.0, 1.0], 0.0), 0.05, 5).len();
    for z in [-1.0, 1.0] {
        assert!(side(z).abs_diff(alone) < alone / 10, "{} of {alone}", side(z));
    }
}

#[test]
fn poisson_tiny_triangles_are_served_by_few_supports() {
    let m = grid(60, 60, [1.0, 1.0], 0.0);
    let samples = sampled(&m, 0.2, 2);
    check(&m, &samples);
    let supports = samples.support.iter().filter(|s| **s).count();
    assert!(supports < m.vertex_count() / 2, "{supports} for {} vertices", m.vertex_count());
    assert!(supports > m.vertex_count() / 4);
}

#[test]
fn poisson_wire_has_no_hole() {
    // 100 long and a millionth wide: far less area than one candidate's share.
    let m = grid(1, 1, [100.0, 1e-4], 0.0);
    let samples = sampled(&m, 1.0, 2);
    check(&m, &samples);
    assert!(samples.len() > 40);
}

#[test]
fn poisson_zero_area_triangles_get_no_sample() {
    let mut m = grid(4, 4, [1.0, 1.0], 0.0);
    let lone = m.positions.len() as u32;
    m.positions.extend([Vec3::X * 2.0, Vec3::X * 3.0, Vec3::X * 4.0]);
    m.normals.extend([Vec3::Z; 3]);
    for t in [[0, 0, 1], [0, 1, 2], [7, 7, 7], [lone, lone + 1, lone + 2]] {
        m.triangles.push(t.map(VertexId));
    }
    let samples = sampled(&m, 0.1, 4);
    check(&m, &samples);
    assert!((32..36).all(|t| samples.of_triangle(TriangleId(t)).is_empty()));
}

#[test]
fn poisson_empty_mesh_gives_nothing() {
    let samples = sampled(&Mesh::default(), 1.0, 0);
    assert!(samples.is_empty());
    assert_eq!(samples.triangle_starts(), [0]);
    assert_eq!(fresh_points(&Mesh::default(), 10, 0).0.len(), 0);
    assert_eq!(radius_for(&Mesh::default(), 10), 1.0);
}

#[test]
fn poisson_bad_radius_is_an_error() {
    let m = grid(1, 1, [1.0, 1.0], 0.0);
    for radius in [0.0, -1.0, f32::NAN, f32::INFINITY] {
        let error = poisson_disk(&m, &SampleOptions { radius, seed: 0 }).unwrap_err();
        assert!(matches!(error, SampleError::Radius { .. }));
    }
    let error = poisson_disk(&m, &SampleOptions { radius: 1e-5, seed: 0 }).unwrap_err();
    assert!(matches!(error, SampleError::TooMany { candidates, .. } if candidates > MAX_CANDIDATES));
    assert!(error.to_string().contains("0.00001"));
    // A needle whose area alone would pass.
    let needle = grid(1, 1, [1e5, 1e-7], 0.0);
    assert!(poisson_disk(&needle, &SampleOptions { radius: 1e-4, seed: 0 }).is_err());
}

#[test]
fn poisson_scaled_mesh_gives_scaled_samples() {
    let m = sphere(20);
    let mut large = m.clone();
    large.positions.iter_mut().for_each(|p| *p *= 1000.0);
    let (a, b) = (sampled(&m, 0.1, 8), sampled(&large, 100.0, 8));
    // Rounding may flip a few decisions at distances next to the radius; each one touches its surroundings.
    let same = a.points.iter().filter(|p| b.points.contains(p)).count();
    assert!(same * 100 >= a.len() * 98, "{same} of {}", a.len());
    assert!(a.len().abs_diff(b.len()) * 100 <= a.len());
    // A power of two has no rounding.
    large.positions.iter_mut().zip(&m.positions).for_each(|(p, q)| *p = *q * 1024.0);
    assert_eq!(sampled(&large, 0.1 * 1024.0, 8).points, a.points);
}

#[test]
fn poisson_any_number_of_threads_gives_the_same() {
    let m = sphere(30);
    let with = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| sampled(&m, 0.02, 6))
    };
    let one = with(1);
    assert_eq!(one, with(2));
    assert_eq!(one, with(7));
    assert_ne!(one.points, sampled(&m, 0.02, 7).points);
}

#[test]
fn radius_for_gives_about_the_samples_asked_for() {
    for m in [sphere(10), sphere(60), grid(3, 5, [3.0, 1.0], 0.0)] {
        let samples = sampled(&m, radius_for(&m, 20_000), 1);
        let poisson = samples.support.iter().filter(|s| !**s).count();
        assert!(poisson.abs_diff(20_000) < 600, "{poisson}");
    }
}

#[test]
fn samples_keys_are_distinct() {
    let m = sphere(12);
    let mut keys = sampled(&m, 0.05, 1).keys;
    let count = keys.len();
    keys.extend(fresh_points(&m, 1000, 1).1);
    keys.sort_unstable();
    keys.dedup();
    assert_eq!(keys.len(), count + 1000);
}

#[test]
fn fresh_points_follow_area() {
    // Two sheets, one nine times as large.
    let mut m = grid(3, 3, [3.0, 3.0], 0.0);
    let small = grid(1, 1, [1.0, 1.0], 5.0);
    let first = m.positions.len() as u32;
    m.positions.extend(&small.positions);
    m.normals.extend(&small.normals);
    m.triangles.extend(small.triangles.iter().map(|t| t.map(|v| VertexId(v.0 + first))));
    let (points, keys) = fresh_points(&m, 1000, 4);
    assert_eq!((points.len(), keys.len()), (1000, 1000));
    let on_small = points.iter().filter(|p| p.triangle.0 >= 18).count();
    assert!(on_small.abs_diff(100) <= 1, "{on_small}");
    assert!(points.is_sorted_by_key(|p| p.triangle));
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 24, ..ProptestConfig::default() })]

    #[test]
    fn poisson_random_soup_keeps_every_promise(seed in any::<u64>(), size in 0.05_f32..1.5, radius in 0.05_f32..0.5) {
        let m = soup(40, seed, size);
        check(&m, &sampled(&m, radius, seed));
    }
}
