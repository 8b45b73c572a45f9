//! Assembly, factor, solve and memory on tori and interiors, in one run.
//!
//! `cargo bench -p lightkiln-fit -- [small|large|huge|ratios]`; each line is a median of three where a run takes
//! less than two seconds. `ratios` takes one and 36 channels in turns and the least of each.
#![allow(clippy::print_stdout, missing_docs)]

use std::f32::consts::TAU;
use std::time::Instant;

use glam::Vec3;
use lightkiln_fit::{FitOptions, Observations, Regularizer, Solver, System};
use lightkiln_mesh::{Adjacency, Mesh, SurfacePoint, VertexId, random};

fn noise(a: u64, b: u64) -> f32 {
    random::unit(random::hash(1, a, b, 0))
}

/// A bumpy torus of `n` × `n` vertices; `slivers`: the share of vertices pulled to within a ten-thousandth of a
/// neighbour.
fn torus(n: usize, slivers: f32) -> Mesh {
    let mut positions = Vec::with_capacity(n * n);
    for j in 0..n {
        for i in 0..n {
            let id = (j * n + i) as u64;
            let u = (i as f32 + 0.35 * noise(id, 0)) / n as f32 * TAU;
            let w = (j as f32 + 0.35 * noise(id, 1)) / n as f32 * TAU;
            let r =
                0.6 + 0.05 * (5.0 * u).sin() * (7.0 * w).cos() + 0.02 * (40.0 * u).sin() * (37.0 * w).cos();
            positions.push(Vec3::new(
                (1.0 + r * w.cos()) * u.cos(),
                r * w.sin(),
                (1.0 + r * w.cos()) * u.sin(),
            ));
        }
    }
    for v in 0..positions.len() {
        if noise(v as u64, 2) < slivers {
            let to = positions[v / n * n + (v + 1) % n];
            positions[v] = to + (positions[v] - to) * 1e-3;
        }
    }
    let mut triangles = Vec::with_capacity(2 * n * n);
    for j in 0..n {
        for i in 0..n {
            let q = |i: usize, j: usize| VertexId(((j % n) * n + i % n) as u32);
            let [a, b, c, d] = [q(i, j), q(i + 1, j), q(i + 1, j + 1), q(i, j + 1)];
            if noise((j * n + i) as u64, 3) < 0.5 {
                triangles.extend([[a, b, c], [a, c, d]]);
            } else {
                triangles.extend([[a, b, d], [b, c, d]]);
            }
        }
    }
    mesh(positions, triangles)
}

fn mesh(positions: Vec<Vec3>, triangles: Vec<[VertexId; 3]>) -> Mesh {
    let normals = vec![Vec3::ZERO; positions.len()];
    Mesh::new(positions, normals, triangles).expect("a valid mesh")
}

/// An interior of about `target` vertices: walls, and spheres whose poles are fans of needles.
fn interior(target: usize) -> Mesh {
    let (mut positions, mut triangles) = (Vec::new(), Vec::new());
    let mut grid = |nu: usize, nv: usize, at: &dyn Fn(f32, f32) -> Vec3| {
        let base = positions.len();
        for j in 0..=nv {
            for i in 0..=nu {
                positions.push(at(i as f32 / nu as f32, j as f32 / nv as f32));
            }
        }
        for j in 0..nv {
            for i in 0..nu {
                let q = |i: usize, j: usize| VertexId((base + j * (nu + 1) + i) as u32);
                let [a, b, c, d] = [q(i, j), q(i + 1, j), q(i + 1, j + 1), q(i, j + 1)];
                triangles.extend([[a, b, c], [a, c, d]]);
            }
        }
    };
    let wall = ((target / 12) as f32).sqrt() as usize;
    for w in 0..6_u64 {
        grid(wall, wall, &|u, v| {
            let bump = 0.02 * (31.0 * u + w as f32).sin() * (27.0 * v).cos();
            Vec3::new(u * 10.0, v * 10.0, 10.0 * w as f32 + bump)
        });
    }
    let spheres = 24;
    let m = ((target / 2 / spheres) as f32).sqrt() as usize;
    for s in 0..spheres {
        grid(m, m, &|u, v| {
            let (phi, theta) = (u * TAU, v * TAU / 2.0);
            let r = 1.0 + 0.05 * (9.0 * phi).sin() * (8.0 * theta).sin();
            Vec3::new(
                r * phi.cos() * theta.sin() + 3.0 * s as f32,
                r * theta.cos(),
                r * phi.sin() * theta.sin(),
            )
        });
    }
    mesh(positions, triangles)
}

/// Area-uniform random points, about `per` a triangle, as a Poisson sampling would give.
fn scatter(m: &Mesh, per: f64) -> (Vec<SurfacePoint>, Vec<f32>) {
    let density = per * m.triangle_count() as f64 / m.total_area();
    let (mut points, mut weights) = (Vec::new(), Vec::new());
    for t in m.triangle_ids() {
        let wanted = m.area(t) * density;
        let count = (wanted + f64::from(noise(u64::from(t.0), 11))) as usize;
        for k in 0..count {
            let hash = random::hash(2, u64::from(t.0), k as u64, 0);
            points.push(SurfacePoint {
                triangle: t,
                barycentric: random::square_to_triangle(random::unit2(hash)),
            });
            weights.push((1.0 / density) as f32);
        }
    }
    (points, weights)
}

fn peak_mb() -> f64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = status.lines().find(|l| l.starts_with("VmHWM")).unwrap_or("");
    line.split_whitespace().nth(1).and_then(|kb| kb.parse::<f64>().ok()).unwrap_or(f64::NAN) / 1024.0
}

/// Seconds that all threads were on a processor so far: what a loaded machine cannot stretch.
fn cpu_seconds() -> f64 {
    let tasks = std::fs::read_dir("/proc/self/task").into_iter().flatten().flatten();
    let nanoseconds = tasks.filter_map(|task| {
        let text = std::fs::read_to_string(task.path().join("schedstat")).ok()?;
        text.split_whitespace().next()?.parse::<f64>().ok()
    });
    nanoseconds.sum::<f64>() * 1e-9
}

/// `count` sheets of two triangles each, as CAD parts with flat shading have.
fn confetti(count: usize) -> Mesh {
    let (mut positions, mut triangles) = (Vec::new(), Vec::new());
    for q in 0..count {
        let at = Vec3::new((q % 1000) as f32 * 2.0, (q / 1000) as f32 * 2.0, 0.0);
        let base = positions.len() as u32;
        positions.extend([Vec3::ZERO, Vec3::X, Vec3::new(1.0, 1.0, 0.3), Vec3::Y].map(|p| p + at));
        triangles.extend([[0, 1, 2], [0, 2, 3]].map(|t: [u32; 3]| t.map(|i| VertexId(base + i))));
    }
    mesh(positions, triangles)
}

/// Values of `channels` smooth functions at points.
fn signals(m: &Mesh, points: &[SurfacePoint], channels: usize) -> Vec<f32> {
    let at = |&p: &SurfacePoint| {
        let p = m.position(p);
        (0..channels).map(move |c| 0.5 + 0.4 * (3.0 * p.x + c as f32).sin() * (4.0 * p.y).cos())
    };
    points.iter().flat_map(at).collect()
}

/// What 36 channels cost beside one: both in turns, and the least of each, so that other work on the machine hits
/// neither alone.
fn ratio(name: &str, m: &Mesh, repeats: usize, options: &FitOptions) {
    const CHANNELS: [usize; 2] = [1, 36];
    let adjacency = Adjacency::new(m);
    let (points, weights) = scatter(m, 2.0);
    let values = CHANNELS.map(|channels| signals(m, &points, channels));
    // Wall and processor seconds: all, assembly, factor and solution.
    let mut least = [[[f64::INFINITY; 2]; 4]; 2];
    let mut iterations = [0; 2];
    for _ in 0..repeats {
        for (k, channels) in CHANNELS.into_iter().enumerate() {
            let observations =
                Observations { points: &points, weights: &weights, values: &values[k], channels };
            let now = || [start_of_time().elapsed().as_secs_f64(), cpu_seconds()];
            let mut marks = vec![now()];
            let mut system = System::new(m, &adjacency, &observations, None, options).expect("assembles");
            marks.push(now());
            system.factor().expect("factors");
            marks.push(now());
            iterations[k] = system.solve().expect("solves").report.iterations;
            marks.push(now());
            for (stage, (from, to)) in [(0, 3), (0, 1), (1, 2), (2, 3)].into_iter().enumerate() {
                for clock in 0..2 {
                    let taken = marks[to][clock] - marks[from][clock];
                    least[k][stage][clock] = least[k][stage][clock].min(taken);
                }
            }
        }
    }
    let stages = |k: usize| {
        let [all, assembly, factor, solve] = least[k].map(|s| format!("{:6.3} ({:6.3})", s[0], s[1]));
        format!("{all} = {assembly} + {factor} + {solve}, {} it", iterations[k])
    };
    println!(
        "{name:<14} {:>8} v, wall (processor) s, least of {repeats}: 1 channel {}; 36 channels {}; ratio {:.2} ({:.2})",
        m.vertex_count(),
        stages(0),
        stages(1),
        least[1][0][0] / least[0][0][0],
        least[1][0][1] / least[0][0][1],
    );
}

/// When the program started, for the clocks.
fn start_of_time() -> Instant {
    static START: std::sync::OnceLock<Instant> = std::sync::OnceLock::new();
    *START.get_or_init(Instant::now)
}

fn measure(name: &str, m: &Mesh, channels: &[usize], options: &FitOptions) {
    let adjacency = Adjacency::new(m);
    let (points, weights) = scatter(m, 2.0);
    let mut one = f64::NAN;
    for &channels in channels {
        let values = signals(m, &points, channels);
        let observations = Observations { points: &points, weights: &weights, values: &values, channels };
        let before = peak_mb();
        let mut times = Vec::new();
        let mut last = None;
        for _ in 0..3 {
            let (start, cpu) = (Instant::now(), cpu_seconds());
            let mut system = System::new(m, &adjacency, &observations, None, options).expect("assembles");
            let assembled = start.elapsed().as_secs_f64();
            system.factor().expect("factors");
            let factored = start.elapsed().as_secs_f64();
            let fit = system.solve().expect("solves");
            let total = start.elapsed().as_secs_f64();
            times.push((total, assembled, factored - assembled, total - factored, cpu_seconds() - cpu));
            last = Some(fit.report);
            if total > 2.0 {
                break;
            }
        }
        times.sort_by(|a, b| a.0.total_cmp(&b.0));
        let (total, assembly, factor, solve, cpu) = times[times.len() / 2];
        if channels == 1 {
            one = total;
        }
        let r = last.expect("ran");
        println!(
            "{name:<22} {:>8} v {channels:>3} ch: total {total:7.3} = assembly {assembly:6.3} + factor {factor:6.3} + solve {solve:6.3} s, cpu {cpu:6.2} s, x{:4.1}; \
             sheets dense {} factor {} pcg {} ({} it) fell back {}; damped {}; +{:.0} MB, est {:.0} MB, nnz {:.1}/v, L {:.1}/v",
            m.vertex_count(),
            total / one,
            r.dense_sheets,
            r.factored_sheets,
            r.iterative_sheets,
            r.iterations,
            r.iterative_fallbacks,
            r.damped_vertices,
            peak_mb() - before,
            r.memory_bytes as f64 / 1048576.0,
            r.matrix_entries as f64 / m.vertex_count() as f64,
            r.factor_entries as f64 / m.vertex_count() as f64,
        );
    }
}

fn main() {
    let size = std::env::args().skip(1).find(|a| !a.starts_with('-')).unwrap_or_else(|| "small".into());
    let ours = FitOptions::default();
    let direct = FitOptions { solver: Solver::Direct, ..ours };
    let strong = FitOptions { alpha: 0.1, ..ours };
    let printed = FitOptions { alpha: 0.1, regularizer: Regularizer::EdgePrinted, ..ours };
    match size.as_str() {
        "huge" => {
            measure("torus 7.5M", &torus(2739, 0.0), &[1], &ours);
            measure("slivers 7.5M", &torus(2739, 0.1), &[1], &ours);
        }
        "ratios" => {
            ratio("torus 72k", &torus(268, 0.0), 15, &ours);
            ratio("slivers 72k", &torus(268, 0.1), 15, &ours);
            ratio("interior 45k", &interior(45_000), 15, &ours);
            ratio("torus 1M", &torus(1000, 0.0), 5, &ours);
            ratio("slivers 1M", &torus(1000, 0.1), 5, &ours);
        }
        "confetti" => measure("confetti", &confetti(300_000), &[1, 3], &ours),
        "printed" => {
            measure("slivers 1M printed", &torus(1000, 0.1), &[1], &printed);
        }
        "large" => {
            measure("torus 1M", &torus(1000, 0.0), &[1, 3, 36], &ours);
            measure("slivers 1M", &torus(1000, 0.1), &[1], &ours);
            measure("interior 1M", &interior(1_000_000), &[1], &ours);
        }
        _ => {
            for (name, m) in [
                ("torus 72k", torus(268, 0.0)),
                ("slivers 72k", torus(268, 0.1)),
                ("interior 45k", interior(45_000)),
            ] {
                measure(name, &m, &[1, 3, 36], &ours);
                measure(&format!("{name} alpha 0.1"), &m, &[1], &strong);
                measure(&format!("{name} printed"), &m, &[1], &printed);
                measure(&format!("{name} direct"), &m, &[1, 36], &direct);
            }
        }
    }
}
