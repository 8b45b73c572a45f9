//! The tracer against brute force, its two paths against each other, and its starts against themselves.
#![allow(clippy::unwrap_used)]

use glam::{DVec3, Quat, Vec3};
use lightkiln_light::{
    AmbientOcclusion, Estimates, Hit, Opaque, Origin, SurfaceFlags, Surfaces, Tracer, directions,
};
use lightkiln_mesh::{Mesh, SurfacePoint, TriangleId, VertexId, random};
use proptest::prelude::*;

fn mesh(positions: Vec<Vec3>, triangles: &[[u32; 3]]) -> Mesh {
    let normals = vec![Vec3::ZERO; positions.len()];
    Mesh::new(positions, normals, triangles.iter().map(|t| t.map(VertexId)).collect()).unwrap()
}

fn number(seed: u64, a: u64, b: u64) -> f32 {
    random::unit(random::hash(seed, a, b, 0)) * 2.0 - 1.0
}

fn vector(seed: u64, a: u64) -> Vec3 {
    Vec3::new(number(seed, a, 0), number(seed, a, 1), number(seed, a, 2))
}

/// Triangles anywhere, some of them slivers, some on a grid (so that axis-aligned rays meet edges), some twice.
fn soup(seed: u64, count: u64) -> Mesh {
    let mut positions = Vec::new();
    for t in 0..count {
        let size = 0.5 * 0.3_f32.powi((t % 4) as i32);
        let centre = vector(seed, 10 * t);
        let mut corners = [1, 2, 3].map(|k| centre + size * vector(seed, 10 * t + k));
        match t % 7 {
            2 => corners[2] = corners[0].lerp(corners[1], 0.4) + 1e-5 * vector(seed, 10 * t + 4),
            3 => corners = corners.map(|p| (p * 4.0).round() / 4.0),
            4 => corners[2] = corners[1],
            _ => {}
        }
        positions.extend(corners);
    }
    let triangles: Vec<[u32; 3]> = (0..count as u32).map(|t| [3 * t, 3 * t + 1, 3 * t + 2]).collect();
    mesh(positions, &triangles)
}

/// First hit in double precision, and how near it comes to an edge (in weights).
fn brute(mesh: &Mesh, origin: Vec3, direction: Vec3) -> (Option<(f64, u32)>, f64) {
    let (o, d) = (origin.as_dvec3(), direction.as_dvec3());
    let mut best: Option<(f64, u32)> = None;
    let mut doubt = f64::INFINITY;
    for t in mesh.triangle_ids() {
        let [a, b, c] = mesh.corners(t).map(Vec3::as_dvec3);
        let n = (b - a).cross(c - a);
        let det = d.dot(n);
        if n == DVec3::ZERO || det == 0.0 {
            continue;
        }
        let distance = (a - o).dot(n) / det;
        let p = o + d * distance;
        let weight = |x: DVec3, y: DVec3| (y - x).cross(p - x).dot(n) / n.length() / (y - x).length();
        let inside = weight(a, b).min(weight(b, c)).min(weight(c, a));
        if distance > -1e-5 {
            // Close to an edge, to the start or edge-on: single precision may see it either way.
            doubt = doubt.min((inside.abs() / 1e-4).max(if inside > -1e-4 { 0.0 } else { 1.0 }));
            if inside > -1e-4 {
                doubt = doubt.min((det.abs() / n.length() / d.length()) / 1e-3).min(distance.abs() / 1e-5);
            }
        }
        if distance > 0.0 && inside >= 0.0 && best.is_none_or(|(least, _)| distance < least) {
            best = Some((distance, t.0));
        }
    }
    (best, doubt)
}

#[test]
fn closest_on_soups_equals_brute_force() {
    let (mut compared, mut met) = (0, 0);
    for seed in 0..12 {
        let mesh = soup(seed, [1, 2, 7, 9, 60, 300][seed as usize % 6]);
        let tracer = Tracer::new(&mesh, &Opaque).unwrap();
        for ray in 0..600 {
            let origin = 1.5 * vector(seed + 100, ray);
            let mut direction = vector(seed + 200, ray);
            match ray % 6 {
                0 => {
                    direction = [Vec3::X, Vec3::NEG_X, Vec3::Y, Vec3::NEG_Y, Vec3::Z, Vec3::NEG_Z]
                        [ray as usize / 6 % 6]
                }
                1 => direction.y = 0.0,
                2..=4 => {
                    let t = TriangleId((ray / 6) as u32 % mesh.triangle_count() as u32);
                    let barycentric =
                        random::square_to_triangle(random::unit2(random::hash(seed, ray, 9, 9)));
                    direction = mesh.position(SurfacePoint { triangle: t, barycentric }) - origin;
                }
                _ => {}
            }
            let (expected, doubt) = brute(&mesh, origin, direction);
            let hit = tracer.closest(origin, direction, f32::INFINITY);
            if doubt < 1.0 {
                continue;
            }
            compared += 1;
            met += usize::from(expected.is_some());
            assert_eq!(
                hit.map(|h| h.triangle.0),
                expected.map(|(_, t)| t),
                "seed {seed} ray {ray} doubt {doubt}"
            );
            let (Some(hit), Some((distance, t))) = (hit, expected) else { continue };
            assert!(
                (f64::from(hit.distance) - distance).abs() < 1e-4 * (1.0 + distance),
                "{} {distance}",
                hit.distance
            );
            let front = direction.dot(mesh.geometric_normal(TriangleId(t))) < 0.0;
            assert_eq!(hit.back, !front);
            let point = SurfacePoint { triangle: hit.triangle, barycentric: hit.barycentric };
            assert!(mesh.position(point).distance(origin + direction * hit.distance) < 1e-3);
        }
    }
    assert!(compared > 4000 && met > 1000, "{compared} compared, {met} met");
}

#[test]
fn transmittance_agrees_with_first_hit() {
    for seed in 0..6 {
        let mesh = soup(seed, 200);
        let tracer = Tracer::new(&mesh, &Opaque).unwrap();
        for point in 0..100 {
            let origin = tracer.origin_at(vector(seed + 300, point));
            // More than a bundle, and not a multiple of it.
            let directions: Vec<Vec3> = (0..37).map(|r| vector(seed + 400, 100 * point + r)).collect();
            for limit in [f32::INFINITY, 0.4] {
                let (mut through, mut hits) = ([7.0; 37], [None; 37]);
                tracer.transmittances(origin, &directions, limit, &mut through);
                tracer.first_hits(origin, &directions, limit, &mut hits);
                for ray in 0..37 {
                    assert_eq!(through[ray], if hits[ray].is_some() { 0.0 } else { 1.0 });
                    assert!(hits[ray].is_none_or(|h: Hit| h.distance <= limit));
                    let alone = tracer.closest(vector(seed + 300, point), directions[ray], limit);
                    assert_eq!(alone, hits[ray], "a bundle is many single rays");
                }
            }
        }
    }
}

#[test]
fn paths_on_soups_are_bit_identical() {
    for seed in 0..10 {
        let mesh = soup(seed, 400);
        let fast = Tracer::new(&mesh, &Opaque).unwrap();
        let portable = Tracer::new(&mesh, &Opaque).unwrap().portable();
        for point in 0..100 {
            let origin = fast.origin_at(vector(seed + 500, point));
            let directions: Vec<Vec3> = (0..16).map(|r| vector(seed + 600, 16 * point + r)).collect();
            let (mut a, mut b) = ([None; 16], [None; 16]);
            fast.first_hits(origin, &directions, f32::INFINITY, &mut a);
            portable.first_hits(origin, &directions, f32::INFINITY, &mut b);
            let bits = |hits: [Option<Hit>; 16]| {
                hits.map(|h| {
                    h.map(|h| (h.triangle, h.barycentric.map(f32::to_bits), h.distance.to_bits(), h.back))
                })
            };
            assert_eq!(bits(a), bits(b));
        }
    }
}

fn icosphere(levels: u32) -> Mesh {
    let g = (1.0 + 5_f32.sqrt()) / 2.0;
    let mut positions: Vec<Vec3> = [
        [-1., g, 0.],
        [1., g, 0.],
        [-1., -g, 0.],
        [1., -g, 0.],
        [0., -1., g],
        [0., 1., g],
        [0., -1., -g],
        [0., 1., -g],
        [g, 0., -1.],
        [g, 0., 1.],
        [-g, 0., -1.],
        [-g, 0., 1.],
    ]
    .map(|p| Vec3::from_array(p).normalize())
    .to_vec();
    let mut triangles: Vec<[u32; 3]> = vec![
        [0, 11, 5],
        [0, 5, 1],
        [0, 1, 7],
        [0, 7, 10],
        [0, 10, 11],
        [1, 5, 9],
        [5, 11, 4],
        [11, 10, 2],
        [10, 7, 6],
        [7, 1, 8],
        [3, 9, 4],
        [3, 4, 2],
        [3, 2, 6],
        [3, 6, 8],
        [3, 8, 9],
        [4, 9, 5],
        [2, 4, 11],
        [6, 2, 10],
        [8, 6, 7],
        [9, 8, 1],
    ];
    for _ in 0..levels {
        let mut middles = std::collections::BTreeMap::new();
        let mut middle = |a: u32, b: u32| {
            *middles.entry((a.min(b), a.max(b))).or_insert_with(|| {
                positions.push((positions[a as usize] + positions[b as usize]).normalize());
                positions.len() as u32 - 1
            })
        };
        triangles = triangles
            .iter()
            .flat_map(|&[a, b, c]| {
                let [ab, bc, ca] = [middle(a, b), middle(b, c), middle(c, a)];
                [[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]
            })
            .collect();
    }
    let normals = positions.clone();
    Mesh::new(positions, normals, triangles.iter().map(|t| t.map(VertexId)).collect()).unwrap()
}

#[test]
fn closed_sphere_from_inside_has_no_pinholes() {
    // Rays at vertices, edges and points of edges, from many starts, near and far from the surface.
    for (scale, offset) in [(1.0, Vec3::ZERO), (300.0, Vec3::new(500.0, -900.0, 40.0)), (0.01, Vec3::ONE)] {
        let sphere = icosphere(3);
        let positions: Vec<Vec3> = sphere.positions.iter().map(|p| *p * scale + offset).collect();
        let mesh = Mesh { positions, ..sphere };
        let tracer = Tracer::new(&mesh, &Opaque).unwrap();
        let mut misses = 0;
        for start in 0..24 {
            let reach = if start < 12 { 0.5 } else { 0.56 };
            let origin = vector(9, start) * reach * scale + offset;
            for triangle in mesh.triangle_ids() {
                let corners = mesh.corners(triangle);
                for k in 0..3 {
                    let (a, b) = (corners[k], corners[(k + 1) % 3]);
                    for share in [0.0, 0.5, 0.37] {
                        let hit = tracer.closest(origin, a.lerp(b, share) - origin, f32::INFINITY);
                        misses += usize::from(hit.is_none());
                    }
                }
            }
        }
        assert_eq!(misses, 0, "scale {scale}");
    }
}

#[test]
fn empty_and_degenerate_meshes_trace_to_misses() {
    let line = mesh(vec![Vec3::ZERO, Vec3::X, Vec3::X * 2.0], &[[0, 1, 2], [0, 0, 1], [2, 2, 2]]);
    for mesh in [Mesh::default(), mesh(vec![Vec3::ONE], &[]), line] {
        let tracer = Tracer::new(&mesh, &Opaque).unwrap();
        assert_eq!(tracer.closest(Vec3::ZERO, Vec3::X, f32::INFINITY), None);
        let mut through = [0.0; 3];
        tracer.transmittances(
            tracer.origin_at(Vec3::Y),
            &[Vec3::X, Vec3::ZERO, Vec3::NAN],
            1.0,
            &mut through,
        );
        assert_eq!(through, [1.0; 3]);
        if !mesh.triangles.is_empty() {
            let mut estimates = Estimates::new(1, 1);
            let point = SurfacePoint { triangle: TriangleId(0), barycentric: [0.2, 0.2] };
            estimates.refine(&AmbientOcclusion::new(&tracer, &mesh, 1.0, 0), &[point], &[1], &[3]);
            assert!(!estimates.valid(0) && estimates.mean(0)[0].is_finite());
        }
    }
}

#[test]
fn tree_of_any_depth_is_walked() {
    // Triangles in a geometric series make the binary tree a chain.
    let mut positions = Vec::new();
    for i in 0..120 {
        let s = 1.8_f32.powi(-i);
        positions.extend([Vec3::new(s, s, 0.0), Vec3::new(s * 1.1, s, 0.0), Vec3::new(s, s * 1.1, s * 0.1)]);
    }
    let triangles: Vec<[u32; 3]> = (0..120).map(|t| [3 * t, 3 * t + 1, 3 * t + 2]).collect();
    let mesh = mesh(positions, &triangles);
    let tracer = Tracer::new(&mesh, &Opaque).unwrap();
    for t in 0..20 {
        let triangle = TriangleId(t);
        let [a, b, c] = mesh.corners(triangle);
        let (middle, n) = ((a + b + c) / 3.0, mesh.geometric_normal(triangle));
        let size = a.distance(b);
        assert_eq!(tracer.closest(middle + n * size, -n, size * 2.0).map(|h| h.triangle), Some(triangle));
    }
}

struct Glass(f32);

impl Surfaces for Glass {
    fn flags(&self, triangle: TriangleId) -> SurfaceFlags {
        SurfaceFlags { translucent: triangle.0 % 2 == 1, double_sided: false, turned: false }
    }
    fn opacity(&self, triangle: TriangleId, barycentric: [f32; 2]) -> f32 {
        assert!(triangle.0 % 2 == 1, "asked for translucent triangles only");
        assert!(barycentric.iter().all(|b| (0.0..=1.0).contains(b)));
        self.0
    }
}

#[test]
fn translucent_panes_multiply_and_opaque_ones_end() {
    let pane = |z: f32| [Vec3::new(-1., -1., z), Vec3::new(1., -1., z), Vec3::new(0., 1., z)];
    // Triangle 0 is opaque and aside; 1, 3, 5 are panes; 2, 4 opaque and aside, 6 opaque behind all.
    let aside = pane(0.0).map(|p| p + Vec3::X * 10.0);
    let positions: Vec<Vec3> = [aside, pane(1.0), aside, pane(2.0), aside, pane(3.0), pane(4.0)].concat();
    let triangles: Vec<[u32; 3]> = (0..7).map(|t| [3 * t, 3 * t + 1, 3 * t + 2]).collect();
    let mesh = mesh(positions, &triangles);
    let glass = Glass(0.25);
    let tracer = Tracer::new(&mesh, &glass).unwrap();
    for (limit, expected) in [(0.5, 1.0), (1.5, 0.75), (2.5, 0.75 * 0.75), (3.5, 0.421_875), (5.0, 0.0)] {
        let mut through = [9.0];
        tracer.transmittances(tracer.origin_at(Vec3::ZERO), &[Vec3::Z], limit, &mut through);
        assert!((through[0] - expected).abs() < 1e-6, "{limit}: {} not {expected}", through[0]);
    }
}

/// A point of each kind on a triangle: middle, edges, corners.
const PLACES: [[f32; 2]; 7] =
    [[0.33, 0.33], [0.0, 0.5], [0.5, 0.0], [0.5, 0.5], [0.0, 0.0], [1.0, 0.0], [0.0, 1.0]];

fn hemisphere(n: Vec3, key: u64) -> [Vec3; 16] {
    let [x, y] = directions::frame(n);
    directions::net(random::hash(11, key, 0, 0)).map(|s| {
        let d = directions::cosine_hemisphere(s);
        x * d.x + y * d.y + n * d.z
    })
}

#[test]
fn origin_on_flat_fan_of_slivers_meets_nothing() {
    // A disk of needles and of caps, tilted, large and far out: no ray may meet its own plane's neighbours.
    for (turn, offset, scale) in [
        (Quat::IDENTITY, Vec3::ZERO, 1.0),
        (Quat::from_euler(glam::EulerRot::XYZ, 0.3, 0.7, 0.2), Vec3::new(1.0, 2.0, 3.0), 0.4),
        (Quat::from_euler(glam::EulerRot::XYZ, 1.3, -0.7, 0.9), Vec3::new(1000.0, -700.0, 300.0), 250.0),
    ] {
        let count = 400_u32;
        let mut positions = vec![Vec3::ZERO];
        for i in 0..count {
            let a = i as f32 / count as f32 * std::f32::consts::TAU;
            positions.push(Vec3::new(a.cos(), a.sin(), 0.0));
        }
        // Needles from the middle, and caps that fan out from vertex 1.
        let mut triangles: Vec<[u32; 3]> = (0..count / 2).map(|i| [0, i + 1, i + 2]).collect();
        triangles.extend((count / 2 + 1..count).map(|i| [count / 2 + 1, i, i + 1]).skip(1));
        let far = [Vec3::new(50.0, 0.0, -20.0), Vec3::new(50.0, 1.0, -20.0), Vec3::new(51.0, 0.0, -20.0)];
        let base = positions.len() as u32;
        positions.extend(far);
        triangles.push([base, base + 1, base + 2]);
        let exact = mesh(positions.clone(), &triangles);
        let mesh = mesh(positions.iter().map(|p| turn * *p * scale + offset).collect(), &triangles);
        let tracer = Tracer::new(&mesh, &Opaque).unwrap();
        let (mut met, mut worst) = (0, 0.0_f32);
        for t in 0..triangles.len() as u32 - 1 {
            for (k, barycentric) in PLACES.into_iter().enumerate() {
                let point = SurfacePoint { triangle: TriangleId(t), barycentric };
                let Some((origin, n)) = Origin::on_surface(&tracer, &mesh, point) else { continue };
                // Rounding bends a thin triangle's plane: rays stay clear of the horizon by more than that.
                let flat = turn * Vec3::Z;
                for d in hemisphere(n, u64::from(t) * 16 + k as u64) {
                    if d.dot(flat) < 0.02 || d.dot(n) < 0.02 {
                        continue;
                    }
                    let mut through = [1.0];
                    tracer.transmittances(origin, &[d], f32::INFINITY, &mut through);
                    if through[0] == 0.0 {
                        met += 1;
                        worst = worst.max(d.dot(flat));
                    }
                }
            }
        }
        assert_eq!(met, 0, "worst elevation {worst}, {} triangles", exact.triangle_count());
    }
}

fn cuboid(low: Vec3, high: Vec3, positions: &mut Vec<Vec3>, triangles: &mut Vec<[u32; 3]>) {
    let base = positions.len() as u32;
    positions.extend(
        (0..8).map(|i| Vec3::select(glam::BVec3::new(i & 1 == 1, i & 2 == 2, i & 4 == 4), high, low)),
    );
    for [a, b, c, d] in [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]] {
        triangles.extend([[a, b, c], [a, c, d]].map(|t: [u32; 3]| t.map(|v| v + base)));
    }
}

#[test]
fn thin_wall_and_contact_do_not_leak() {
    // A plate of 1e-4 of the scene standing on a floor, in metres and in millimetres, near and far from zero.
    for (scale, offset) in [(1.0, Vec3::ZERO), (1000.0, Vec3::ZERO), (1000.0, Vec3::new(1500.0, 0.0, 800.0))]
    {
        let (mut positions, mut triangles) = (Vec::new(), Vec::new());
        cuboid(Vec3::new(-0.5, -0.1, -0.5), Vec3::new(0.5, 0.0, 0.5), &mut positions, &mut triangles);
        cuboid(Vec3::new(0.0, 0.0, -0.5), Vec3::new(1e-4, 0.4, 0.5), &mut positions, &mut triangles);
        let mesh = mesh(positions.iter().map(|p| *p * scale + offset).collect(), &triangles);
        let tracer = Tracer::new(&mesh, &Opaque).unwrap();
        // On the plate: its own back is 1e-4 away, but no ray from its front starts behind it.
        // Its bottom lies in the floor and sees nothing else.
        for t in (12..24).filter(|t| t / 2 != 8) {
            for (k, barycentric) in PLACES.into_iter().enumerate() {
                let point = SurfacePoint { triangle: TriangleId(t), barycentric };
                let (origin, n) = Origin::on_surface(&tracer, &mesh, point).unwrap();
                for d in hemisphere(n, u64::from(t) * 16 + k as u64) {
                    let mut hit = [None];
                    tracer.first_hits(origin, &[d], f32::INFINITY, &mut hit);
                    assert!(hit[0].is_none_or(|h| !h.back), "triangle {t} place {k} sees a back");
                }
            }
        }
        // On the floor beside the plate, ever closer: rays into it are met, rays away from it are free.
        for gap in [1e-2, 1e-4, 1e-5, 3e-6] {
            for side in [-1.0_f32, 1.0] {
                let x = if side < 0.0 { -gap } else { 1e-4 + gap };
                let above = Vec3::new(x, 0.05, 0.1) * scale + offset;
                let down = tracer.closest(above, Vec3::NEG_Y, f32::INFINITY).unwrap();
                assert!(down.triangle.0 < 12);
                let point = SurfacePoint { triangle: down.triangle, barycentric: down.barycentric };
                let (origin, _) = Origin::on_surface(&tracer, &mesh, point).unwrap();
                for d in hemisphere(Vec3::Y, down.triangle.0.into()) {
                    let mut through = [0.5];
                    tracer.transmittances(origin, &[d], f32::INFINITY, &mut through);
                    let rise = d.y * gap / d.x.abs().max(1e-9);
                    if d.x * side > 1e-3 {
                        assert_eq!(through[0], 1.0, "gap {gap} side {side}");
                    } else if d.x * side < -1e-3 && rise < 0.3 && (0.1 + d.z / d.x.abs() * gap).abs() < 0.45 {
                        assert_eq!(through[0], 0.0, "gap {gap} side {side} scale {scale} {d}");
                    }
                }
            }
        }
    }
}

#[test]
fn origin_on_concave_edge_sees_the_neighbour() {
    // Floor and wall share an edge that the points lie on exactly: a half of the floor's view is wall.
    let e = 100.0;
    let positions = vec![
        Vec3::new(-e, 0.0, 0.0),
        Vec3::new(e, 0.0, 0.0),
        Vec3::new(e, e, 0.0),
        Vec3::new(-e, e, 0.0),
        Vec3::new(e, 0.0, e),
        Vec3::new(-e, 0.0, e),
    ];
    let mesh = mesh(positions, &[[0, 1, 2], [0, 2, 3], [1, 0, 4], [0, 5, 4]]);
    let tracer = Tracer::new(&mesh, &Opaque).unwrap();
    let signal = AmbientOcclusion::new(&tracer, &mesh, f32::INFINITY, 1);
    let points: Vec<SurfacePoint> = (1..40)
        .map(|i| SurfacePoint { triangle: TriangleId(0), barycentric: [0.3 + 0.01 * i as f32, 0.0] })
        .collect();
    let keys: Vec<u64> = (0..points.len() as u64).collect();
    let mut estimates = Estimates::new(points.len(), 1);
    estimates.refine(&signal, &points, &keys, &vec![16; points.len()]);
    for i in 0..points.len() {
        assert!((estimates.mean(i)[0] - 0.5).abs() < 0.03, "{}", estimates.mean(i)[0]);
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn rays_at_scales_of_two_are_the_same(seed in 0_u64..1000, exponent in -12_i32..12) {
        let one = soup(seed, 60);
        let scale = (exponent as f32).exp2();
        let other = Mesh { positions: one.positions.iter().map(|p| *p * scale).collect(), ..one.clone() };
        let (a, b) = (Tracer::new(&one, &Opaque).unwrap(), Tracer::new(&other, &Opaque).unwrap());
        for ray in 0..40 {
            let (origin, direction) = (vector(seed + 1, ray), vector(seed + 2, ray));
            let (x, y) = (a.closest(origin, direction, 2.0), b.closest(origin * scale, direction, 2.0 * scale));
            prop_assert_eq!(x.map(|h| (h.triangle, h.barycentric)), y.map(|h| (h.triangle, h.barycentric)));
        }
    }
}
