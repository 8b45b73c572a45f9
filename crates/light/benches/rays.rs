//! Rays a second of our walk beside obvhs's own, on the same rays, in one run.
//!
//! `cargo bench -p lightkiln-light --bench rays -- [scene.bin] [max distance] [portable] [quick]`: a scene in the form
//! of little-endian words (vertices, triangles, rays, rays a point; positions; triangles; origin and direction
//! of each ray), or without a path a procedural field of spheres in a box.
#![allow(clippy::print_stdout)]

use std::time::{Duration, Instant};

use glam::{Vec3, Vec3A};
use lightkiln_light::{
    AmbientOcclusion, Environment, Estimates, Light, Lighting, Opaque, Output, PathOptions, PathTraced,
    Signal, Tracer, directions,
};
use lightkiln_mesh::{Mesh, SurfacePoint, TriangleId, VertexId, random};
use obvhs::{
    BvhBuildParams, cwbvh::builder::build_cwbvh_from_tris, ray::Ray, rt_triangle::RtTriangle,
    triangle::Triangle,
};

struct Scene {
    mesh: Mesh,
    rays: Vec<(Vec3, Vec3)>,
    per_point: usize,
}

fn read(path: &str) -> Scene {
    let bytes = std::fs::read(path).expect("the scene can be read");
    let word = |i: usize| -> [u8; 4] { bytes[4 * i..4 * i + 4].try_into().expect("four bytes") };
    let integer = |i: usize| u32::from_le_bytes(word(i));
    let vector = |i: usize| Vec3::from_array([i, i + 1, i + 2].map(|i| f32::from_le_bytes(word(i))));
    let [vertices, triangles, rays, per_point] = [0, 1, 2, 3].map(|i| integer(i) as usize);
    let positions: Vec<Vec3> = (0..vertices).map(|v| vector(4 + 3 * v)).collect();
    let at = 4 + 3 * vertices;
    let triangles_read =
        (0..triangles).map(|t| [0, 1, 2].map(|k| VertexId(integer(at + 3 * t + k)))).collect();
    let at = at + 3 * triangles;
    let rays = (0..rays).map(|r| (vector(at + 6 * r), vector(at + 6 * r + 3))).collect();
    let normals = vec![Vec3::ZERO; positions.len()];
    Scene { mesh: Mesh::new(positions, normals, triangles_read).expect("a mesh"), rays, per_point }
}

fn field() -> Scene {
    let mut positions = Vec::new();
    let mut triangles = Vec::new();
    let mut sphere = |centre: Vec3, radius: f32, n: u32, outward: bool| {
        let first = positions.len() as u32;
        for j in 0..=n {
            for i in 0..=2 * n {
                let (a, b) =
                    (i as f32 / n as f32 * std::f32::consts::PI, j as f32 / n as f32 * std::f32::consts::PI);
                positions.push(centre + radius * Vec3::new(b.sin() * a.cos(), b.cos(), b.sin() * a.sin()));
            }
        }
        for j in 0..n {
            for i in 0..2 * n {
                let a = first + j * (2 * n + 1) + i;
                let b = a + 2 * n + 1;
                for t in [[a, a + 1, b], [a + 1, b + 1, b]] {
                    let t = if outward { t } else { [t[0], t[2], t[1]] };
                    triangles.push(t.map(VertexId));
                }
            }
        }
    };
    sphere(Vec3::ZERO, 12.0, 100, false);
    for i in 0..200_u64 {
        let h = |k| random::unit(random::hash(1, i, k, 0));
        let centre = Vec3::new(h(0) - 0.5, h(1) - 0.5, h(2) - 0.5) * 12.0;
        sphere(centre, 0.2 + h(3), 14, true);
    }
    let normals = vec![Vec3::ZERO; positions.len()];
    let mesh = Mesh::new(positions, normals, triangles).expect("a mesh");
    let mut rays = Vec::new();
    for i in 0..20_000_u64 {
        let triangle = TriangleId((i * mesh.triangle_count() as u64 / 20_000) as u32);
        let n = mesh.geometric_normal(triangle);
        if n == Vec3::ZERO {
            continue;
        }
        let origin = mesh.position(SurfacePoint { triangle, barycentric: [0.3, 0.3] }) + n * 1e-3;
        let [x, y] = directions::frame(n);
        for batch in 0..4 {
            for square in directions::net(random::hash(2, i, batch, 0)) {
                let d = directions::cosine_hemisphere(square);
                rays.push((origin, x * d.x + y * d.y + n * d.z));
            }
        }
    }
    Scene { mesh, rays, per_point: 64 }
}

/// Seconds that this thread has run, where the system says so: a shared machine does not count then.
fn seconds(start: Instant, threads: bool) -> f64 {
    let file =
        if threads { Err(()) } else { std::fs::read_to_string("/proc/thread-self/schedstat").map_err(drop) };
    let nanoseconds = file.ok().and_then(|text| text.split(' ').next()?.parse::<f64>().ok());
    nanoseconds.map_or(start.elapsed().as_secs_f64(), |ns| ns * 1e-9)
}

/// Million rays a second of thread time (of wall time for "threads"): median of five.
fn rate(name: &str, rays: usize, mut run: impl FnMut() -> usize) {
    let mut times = Vec::new();
    let mut hits = 0;
    for _ in 0..5 {
        let start = Instant::now();
        let threads = name.contains("threads");
        let before = seconds(start, threads);
        hits = run();
        times.push(seconds(start, threads) - before);
    }
    times.sort_by(f64::total_cmp);
    println!(
        "{name:<40} {:8.3} Mrays/s   hit {:.6}",
        rays as f64 / times[2] / 1e6,
        hits as f64 / rays as f64
    );
}

fn main() {
    let arguments: Vec<String> = std::env::args().skip(1).filter(|a| a != "--bench").collect();
    let scene = arguments.first().map_or_else(field, |path| read(path));
    let limit: f32 = arguments.get(1).map_or(f32::INFINITY, |a| a.parse().expect("a distance"));
    let Scene { mesh, rays, per_point } = &scene;
    println!("{} triangles, {} rays, {per_point} a point, up to {limit}", mesh.triangle_count(), rays.len());

    let start = Instant::now();
    let tracer = Tracer::new(mesh, &Opaque).expect("a tracer");
    println!(
        "build {:.3} s, {:.1} bytes a triangle",
        start.elapsed().as_secs_f64(),
        tracer.bytes() as f64 / mesh.triangle_count() as f64
    );
    let tracer = if arguments.iter().any(|a| a == "portable") { tracer.portable() } else { tracer };

    let triangles: Vec<Triangle> = mesh
        .triangle_ids()
        .map(|t| {
            let [v0, v1, v2] = mesh.corners(t).map(Vec3A::from);
            Triangle { v0, v1, v2 }
        })
        .collect();
    let start = Instant::now();
    let theirs = build_cwbvh_from_tris(&triangles, BvhBuildParams::medium_build(), &mut Duration::default());
    println!("obvhs build {:.3} s", start.elapsed().as_secs_f64());
    let ordered: Vec<RtTriangle> =
        theirs.primitive_indices.iter().map(|&i| RtTriangle::from(&triangles[i as usize])).collect();

    let quick = arguments.iter().any(|a| a == "quick");
    let by_point = || rays.chunks(*per_point);
    for _ in 0..2 {
        rate("obvhs CWBVH", rays.len(), || {
            rays.iter()
                .filter(|(o, d)| {
                    let ray = Ray::new((*o).into(), (*d).into(), 0.0, limit);
                    !theirs.ray_traverse_miss(ray, |ray, id| ordered[id].intersect(ray))
                })
                .count()
        });
        for size in [16, 32] {
            rate(&format!("ours, bundles of {size}"), rays.len(), || {
                let mut directions = [Vec3::ZERO; 32];
                let mut through = [0.0; 32];
                let mut hits = 0;
                for group in by_point().flat_map(|point| point.chunks(size)) {
                    for (slot, (_, d)) in directions.iter_mut().zip(group) {
                        *slot = *d;
                    }
                    let origin = tracer.origin_at(group[0].0);
                    let through = &mut through[..group.len()];
                    tracer.transmittances(origin, &directions[..group.len()], limit, through);
                    hits += through.iter().filter(|&&t| t == 0.0).count();
                }
                hits
            });
        }
        if quick {
            continue;
        }
        rate("ours, one by one", rays.len(), || {
            let mut through = [0.0];
            rays.iter()
                .filter(|(o, d)| {
                    tracer.transmittances(tracer.origin_at(*o), &[*d], limit, &mut through);
                    through[0] == 0.0
                })
                .count()
        });
    }
    if quick {
        return;
    }
    rate("ours, first hits of 16", rays.len(), || {
        let mut directions = [Vec3::ZERO; 16];
        let mut hits = [None; 16];
        let mut count = 0;
        for group in rays.chunks(16) {
            for (slot, (_, d)) in directions.iter_mut().zip(group) {
                *slot = *d;
            }
            tracer.first_hits(
                tracer.origin_at(group[0].0),
                &directions[..group.len()],
                limit,
                &mut hits[..group.len()],
            );
            count += hits.iter().flatten().count();
        }
        count
    });

    // The signal as a bake runs it: every thread, points on the surface, four batches and one.
    let points: Vec<SurfacePoint> = (0..50_000_u64)
        .map(|i| SurfacePoint {
            triangle: TriangleId((i * mesh.triangle_count() as u64 / 50_000) as u32),
            barycentric: random::square_to_triangle(random::unit2(random::hash(5, i, 0, 0))),
        })
        .collect();
    let keys: Vec<u64> = (0..points.len() as u64).collect();
    let signal = AmbientOcclusion::new(&tracer, mesh, limit, 1);
    for batches in [1, 4, 16] {
        rate(
            &format!("signal, {batches} batches, threads"),
            points.len() * 16 * usize::from(batches),
            || {
                let mut estimates = Estimates::new(points.len(), 1);
                estimates.refine(&signal, &points, &keys, &vec![batches; points.len()]);
                ((1.0 - estimates.means().iter().map(|&m| f64::from(m)).sum::<f64>() / points.len() as f64)
                    * estimates.rays() as f64) as usize
            },
        );
    }
    paths(&tracer, mesh, &points, &keys);
}

/// Paths a second, sixteen a batch: each with a ray at the point, a shadow ray there, and two rays a bounce.
fn paths(tracer: &Tracer<'_>, mesh: &Mesh, points: &[SurfacePoint], keys: &[u64]) {
    let (points, keys) = (&points[..10_000], &keys[..10_000]);
    let lamps = (0..8_u64).map(|i| {
        let h = |k| random::unit(random::hash(2, i, k, 0));
        let position = Vec3::new(h(0) - 0.5, h(1) - 0.5, h(2) - 0.5) * 16.0;
        Light::Sphere { position, intensity: Vec3::splat(1000.0), radius: 0.1, range: f32::INFINITY }
    });
    let lamps = Lighting { lights: lamps.collect(), environment: None };
    let even = Lighting { lights: Vec::new(), environment: Environment::constant(Vec3::ONE).ok() };
    let sun = Lighting { lights: vec![Light::sun(0.5, 0.8, Vec3::splat(1e5))], environment: None };
    for (name, lighting) in [("8 lamps", lamps), ("sky", even), ("sun", sun), ("studio", Lighting::studio())]
    {
        for (what, output, bounces) in [
            ("direct", vec![Output::Direct], 0),
            ("1 bounce", vec![Output::Irradiance], 1),
            ("all", vec![Output::Irradiance], 32),
            ("all, harmonics", vec![Output::Irradiance, Output::Harmonics { bands: 3 }], 32),
        ] {
            let options = PathOptions { bounces, ..PathOptions::default() };
            let signal = PathTraced::new(tracer, mesh, &lighting, &output, options).expect("good lights");
            // On this thread, whose own time counts.
            rate(&format!("paths: {name}, {what}"), points.len() * 16, || {
                let mut out = vec![0.0; signal.channels()];
                let mut dark = 0;
                for (&point, &key) in points.iter().zip(keys) {
                    signal.batch(point, key, 1, &mut out);
                    dark += 16 * usize::from(out[0] == 0.0);
                }
                dark
            });
        }
    }
}
