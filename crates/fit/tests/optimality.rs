//! Least squares is the least; bounds, limits and closed forms.

mod common;

use common::{adjacency, mesh, position, scatter, sheet};
use glam::{DVec3, Vec3};
use lightkiln_fit::{
    Bounds, FitOptions, Mass, Method, Observations, Regularizer, Solver, System, energy, fit, look,
};
use lightkiln_mesh::{Mesh, SurfacePoint, random};
use proptest::prelude::*;

fn options(method: Method, regularizer: Regularizer, alpha: f32) -> FitOptions {
    FitOptions { method, regularizer, alpha, ..FitOptions::default() }
}

const SAMPLED: Method = Method::LeastSquares { mass: Mass::Sampled };

fn noisy(m: &Mesh, points: &[SurfacePoint], seed: u64) -> Vec<f32> {
    points
        .iter()
        .enumerate()
        .map(|(i, &p)| {
            let noise = random::unit(random::hash(seed, i as u64, 5, 5)) - 0.5;
            (0.5 + 0.6 * (9.0 * position(m, p).x).sin()) as f32 + 0.3 * noise
        })
        .collect()
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 16, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn energy_of_least_squares_is_below_any_other(n in 3_u32..9, seed: u64, amount in 0.001_f32..0.5) {
        let m = sheet(n, 0.6, seed);
        let (points, weights) = scatter(&m, 4, seed);
        let values = noisy(&m, &points, seed);
        let observations = Observations { points: &points, weights: &weights, values: &values, channels: 1 };
        let best = fit(&m, &adjacency(&m), &observations, None, &options(SAMPLED, Regularizer::None, 0.0)).expect("fits");
        let e = |x: &[f32]| energy(&m, &observations, None, x).expect("fits")[0].measured;
        let least = e(&best.values);
        for round in 0..8_u64 {
            let other: Vec<f32> = best.values.iter().enumerate()
                .map(|(i, v)| v + amount * (random::unit(random::hash(seed, i as u64, round, 1)) - 0.5)).collect();
            prop_assert!(least <= e(&other) * (1.0 + 1e-6));
        }
        for method in [Method::Average, Method::PointSample, Method::Ours, Method::LeastSquares { mass: Mass::Analytic }] {
            let other = fit(&m, &adjacency(&m), &observations, None, &options(method, Regularizer::None, 0.0)).expect("fits");
            prop_assert!(least <= e(&other.values) * (1.0 + 1e-6));
        }
    }

    #[test]
    fn optimum_satisfies_its_conditions(n in 3_u32..14, seed: u64) {
        let m = sheet(n, 0.6, seed);
        let (points, weights) = scatter(&m, 4, seed);
        let values = noisy(&m, &points, seed);
        let observations = Observations { points: &points, weights: &weights, values: &values, channels: 1 };
        let (low, high) = (0.1, 0.8);
        let with = |bounds| FitOptions { bounds, ..options(SAMPLED, Regularizer::None, 0.0) };
        let fitted = fit(&m, &adjacency(&m), &observations, None, &with(Bounds::Optimum { low, high })).expect("fits");
        prop_assert_eq!(fitted.report.optimum_unmet, 0);
        // Gradient of the energy by vertex, over the diagonal.
        let mut gradient = vec![0.0; m.vertex_count()];
        let mut diagonal = vec![0.0; m.vertex_count()];
        for ((p, w), f) in points.iter().zip(&weights).zip(&values) {
            let [u, v] = p.barycentric.map(f64::from);
            let b = [1.0 - u - v, u, v];
            let corners = m.triangles[p.triangle.index()];
            let g: f64 = corners.iter().zip(b).map(|(c, b)| b * f64::from(fitted.values[c.index()])).sum();
            for (c, b) in corners.iter().zip(b) {
                gradient[c.index()] += f64::from(*w) * b * (g - f64::from(*f));
                diagonal[c.index()] += f64::from(*w) * b * b;
            }
        }
        for (v, value) in fitted.values.iter().enumerate() {
            let g = gradient[v] / diagonal[v];
            let fine = if *value <= low { g >= -1e-6 } else if *value >= high { g <= 1e-6 } else { g.abs() <= 1e-6 };
            prop_assert!(fine, "vertex {v} at {value} with gradient {g}");
            prop_assert!((low..=high).contains(value));
        }
        let clamped = fit(&m, &adjacency(&m), &observations, None, &with(Bounds::Clamp { low, high })).expect("fits");
        let e = |x: &[f32]| energy(&m, &observations, None, x).expect("fits")[0].measured;
        prop_assert!(e(&fitted.values) <= e(&clamped.values) * (1.0 + 1e-6));
        prop_assert_eq!(fitted.report.below + fitted.report.above, clamped.report.below + clamped.report.above);
    }

    #[test]
    fn optimum_under_one_bound_is_the_optimum_under_a_far_one(n in 3_u32..10, seed: u64) {
        let m = sheet(n, 0.6, seed);
        let (points, weights) = scatter(&m, 4, seed);
        let values = noisy(&m, &points, seed);
        let observations = Observations { points: &points, weights: &weights, values: &values, channels: 1 };
        let run = |high| {
            let bounds = Bounds::Optimum { low: 0.3, high };
            let options = FitOptions { bounds, ..options(SAMPLED, Regularizer::None, 0.0) };
            let fitted = fit(&m, &adjacency(&m), &observations, None, &options).expect("fits");
            prop_assert_eq!(fitted.report.optimum_unmet, 0);
            Ok(fitted.values)
        };
        let (open, far) = (run(f32::INFINITY)?, run(50.0)?);
        for (a, b) in open.iter().zip(&far) {
            prop_assert!((a - b).abs() < 1e-5, "{a} and {b}");
        }
    }

    #[test]
    fn solvers_agree(n in 10_u32..40, seed: u64, alpha in 0.0_f32..1.0, channels in 1_usize..26) {
        let m = sheet(n, 0.9, seed);
        let (points, weights) = scatter(&m, 2, seed);
        let values: Vec<f32> = (0..points.len() * channels).map(|i| random::unit(random::hash(seed, i as u64, 0, 0))).collect();
        let observations = Observations { points: &points, weights: &weights, values: &values, channels };
        let run = |solver| {
            fit(&m, &adjacency(&m), &observations, None, &FitOptions { alpha, solver, ..FitOptions::default() }).expect("fits")
        };
        let (direct, iterative) = (run(Solver::Direct), run(Solver::Iterative));
        for (a, b) in direct.values.iter().zip(&iterative.values) {
            prop_assert!((a - b).abs() <= 1e-6, "{a} and {b}: {:?}", iterative.report);
        }
    }
}

#[test]
fn channels_of_one_fit_are_as_if_fitted_alone() {
    const CHANNELS: usize = 108;
    let m = sheet(30, 0.9, 7);
    let (points, weights) = scatter(&m, 2, 7);
    let values: Vec<f32> =
        (0..points.len() * CHANNELS).map(|i| random::unit(random::hash(7, i as u64, 0, 0))).collect();
    for solver in [Solver::Direct, Solver::Iterative] {
        let run = |values: &[f32], channels| {
            let observations = Observations { points: &points, weights: &weights, values, channels };
            let options = FitOptions { alpha: 0.1, solver, ..FitOptions::default() };
            fit(&m, &adjacency(&m), &observations, None, &options).expect("fits").values
        };
        let all = run(&values, CHANNELS);
        for channel in [0, 1, 35, 36, 107] {
            let own: Vec<f32> = values.iter().skip(channel).step_by(CHANNELS).copied().collect();
            for (one, of_all) in run(&own, 1).iter().zip(all.iter().skip(channel).step_by(CHANNELS)) {
                assert!((one - of_all).abs() <= 1e-6, "{solver:?}, channel {channel}: {one} and {of_all}");
            }
        }
    }
}

#[test]
fn strong_gradient_term_gives_the_mean_of_each_sheet() {
    let mut m = sheet(6, 0.5, 1);
    let other = sheet(5, 0.5, 2);
    let base = m.vertex_count() as u32;
    m.positions.extend(other.positions.iter().map(|&p| p + Vec3::Z));
    m.normals.resize(m.positions.len(), Vec3::ZERO);
    m.triangles.extend(other.triangles.iter().map(|t| t.map(|v| lightkiln_mesh::VertexId(v.0 + base))));
    let (points, weights) = scatter(&m, 3, 4);
    let values: Vec<f32> = points.iter().map(|&p| (position(&m, p).x + position(&m, p).z) as f32).collect();
    let observations = Observations { points: &points, weights: &weights, values: &values, channels: 1 };
    for (regularizer, (range, z)) in [Regularizer::Gradient, Regularizer::Both]
        .into_iter()
        .flat_map(|r| [(r, (0..base as usize, 0.0)), (r, (base as usize..m.vertex_count(), 1.0))])
    {
        let fitted = fit(&m, &adjacency(&m), &observations, None, &options(Method::Ours, regularizer, 1e7))
            .expect("fits");
        let (mut sum, mut total) = (0.0, 0.0);
        for ((p, w), f) in points.iter().zip(&weights).zip(&values) {
            if position(&m, *p).z == z {
                sum += w * f;
                total += w;
            }
        }
        for v in &fitted.values[range] {
            assert!((v - sum / total).abs() < 1e-4, "{v} for {}", sum / total);
        }
    }
}

#[test]
fn alpha_without_a_regularizer_is_nothing() {
    let m = sheet(8, 0.5, 1);
    let (points, weights) = scatter(&m, 3, 4);
    let values = noisy(&m, &points, 2);
    let observations = Observations { points: &points, weights: &weights, values: &values, channels: 1 };
    let run = |alpha| {
        let options = options(Method::Ours, Regularizer::None, alpha);
        fit(&m, &adjacency(&m), &observations, None, &options).expect("fits").values
    };
    assert_eq!(run(0.0), run(1e6));
}

#[test]
fn strong_edge_term_gives_the_linear_fit() {
    strong_term_gives_the_linear_fit(Regularizer::Edge, 0.5);
}

#[test]
fn strong_printed_term_gives_the_linear_fit_where_triangles_are_equal() {
    strong_term_gives_the_linear_fit(Regularizer::EdgePrinted, 0.0);
}

fn strong_term_gives_the_linear_fit(regularizer: Regularizer, jitter: f32) {
    let m = sheet(8, jitter, 1);
    let (points, weights) = scatter(&m, 3, 4);
    let values: Vec<f32> = points.iter().map(|&p| (6.0 * position(&m, p).x).sin() as f32).collect();
    let observations = Observations { points: &points, weights: &weights, values: &values, channels: 1 };
    let fitted =
        fit(&m, &adjacency(&m), &observations, None, &options(Method::Ours, regularizer, 1e6)).expect("fits");
    // The linear least-squares fit over the same observations, by its normal equations.
    let mut a = glam::DMat3::ZERO;
    let mut b = DVec3::ZERO;
    for ((p, w), f) in points.iter().zip(&weights).zip(&values) {
        let at = position(&m, *p);
        let row = DVec3::new(at.x, at.y, 1.0);
        a += glam::DMat3::from_cols(row * row.x, row * row.y, row * row.z) * f64::from(*w);
        b += row * f64::from(*w) * f64::from(*f);
    }
    let linear = a.inverse() * b;
    for (v, p) in fitted.values.iter().zip(&m.positions) {
        let want = linear.dot(DVec3::new(f64::from(p.x), f64::from(p.y), 1.0));
        assert!((f64::from(*v) - want).abs() < 1e-4, "{v} for {want}");
    }
}

#[test]
fn linear_functions_cost_nothing_across_folds_under_our_edge_term_only() {
    // Two triangles of unequal size, folded by 60 degrees about their edge; a function linear on the unfolded pair.
    let fold = 60_f32.to_radians();
    let m = mesh(
        vec![
            Vec3::ZERO,
            Vec3::Y,
            Vec3::new(-2.0, 0.3, 0.0),
            Vec3::new(0.5 * fold.cos(), 1.7, 0.5 * fold.sin()),
        ],
        &[[0, 1, 2], [1, 0, 3]],
    );
    let unfolded = [[0.0, 0.0], [0.0, 1.0], [-2.0, 0.3], [0.5, 1.7]];
    let values = unfolded.map(|[x, y]: [f32; 2]| 0.3 * x - 0.7 * y + 0.2);
    let jump = look(&m, &adjacency(&m), &values, 1).expect("fits")[0].gradient_jump;
    assert!(jump < 1e-6, "{jump}");
    // Fitted with a strong edge term, ours keeps the function and the printed one does not.
    let (points, weights) = scatter(&m, 8, 0);
    let observed: Vec<f32> = points
        .iter()
        .map(|p| {
            let [u, v] = p.barycentric;
            let corners = m.triangles[p.triangle.index()].map(|c| values[c.index()]);
            corners[0] * (1.0 - u - v) + corners[1] * u + corners[2] * v
        })
        .collect();
    let observations = Observations { points: &points, weights: &weights, values: &observed, channels: 1 };
    let worst = |regularizer| {
        let fitted = fit(&m, &adjacency(&m), &observations, None, &options(Method::Ours, regularizer, 100.0))
            .expect("fits");
        fitted.values.iter().zip(values).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max)
    };
    assert!(worst(Regularizer::Edge) < 1e-5);
    assert!(worst(Regularizer::EdgePrinted) > 0.05);
}

#[test]
fn edge_term_fades_with_the_fold() {
    // A roof with a kink of the light on its ridge: the steeper, the more of the kink stays under the same alpha.
    let kept = |degrees: f32| {
        let (sin, cos) = degrees.to_radians().sin_cos();
        let m = mesh(
            vec![Vec3::ZERO, Vec3::Y, Vec3::new(-1.0, 0.5, 0.0), Vec3::new(cos, 0.5, sin)],
            &[[0, 1, 2], [1, 0, 3]],
        );
        let (points, weights) = scatter(&m, 24, 3);
        // 0 on the ridge and 1 at both gables.
        let values: Vec<f32> = points.iter().map(|p| p.barycentric[1]).collect();
        let observations = Observations { points: &points, weights: &weights, values: &values, channels: 1 };
        let options = options(Method::Ours, Regularizer::Edge, 0.3);
        let x = fit(&m, &adjacency(&m), &observations, None, &options).expect("fits").values;
        x[2] + x[3] - x[0] - x[1]
    };
    let kinks = [0.0, 30.0, 60.0, 90.0, 120.0].map(kept);
    assert!(kinks[..4].is_sorted_by(|a, b| a < b), "{kinks:?}");
    assert!((kinks[3] - 2.0).abs() < 1e-3 && (kinks[4] - 2.0).abs() < 1e-3, "{kinks:?}");
}

#[test]
fn edge_terms_agree_on_equal_equilateral_triangles_in_a_plane() {
    let h = 0.75_f32.sqrt();
    let m = mesh(
        vec![Vec3::ZERO, Vec3::X, Vec3::new(0.5, h, 0.0), Vec3::new(0.5, -h, 0.0)],
        &[[0, 1, 2], [1, 0, 3]],
    );
    let (points, weights) = scatter(&m, 8, 3);
    let values = noisy(&m, &points, 2);
    let observations = Observations { points: &points, weights: &weights, values: &values, channels: 1 };
    let run =
        |r| fit(&m, &adjacency(&m), &observations, None, &options(SAMPLED, r, 0.3)).expect("fits").values;
    for (a, b) in run(Regularizer::Edge).iter().zip(run(Regularizer::EdgePrinted)) {
        assert!((a - b).abs() < 1e-5, "{a} and {b}");
    }
}

#[test]
fn alpha_changes_as_if_fitted_afresh() {
    let m = sheet(20, 0.7, 5);
    let (points, weights) = scatter(&m, 2, 4);
    let values = noisy(&m, &points, 2);
    let observations = Observations { points: &points, weights: &weights, values: &values, channels: 1 };
    let adjacency = adjacency(&m);
    let mut system =
        System::new(&m, &adjacency, &observations, None, &FitOptions::default()).expect("assembles");
    let mut last = f64::INFINITY;
    for alpha in [10.0, 1.0, 0.1, 0.0] {
        system.set_alpha(alpha).expect("a valid alpha");
        let swept = system.solve().expect("solves");
        let fresh = fit(&m, &adjacency, &observations, None, &FitOptions { alpha, ..FitOptions::default() })
            .expect("fits");
        assert_eq!(swept.values, fresh.values);
        let e = energy(&m, &observations, None, &swept.values).expect("fits")[0].measured;
        assert!(e < last);
        last = e;
    }
}

/// The share of the cosine-weighted hemisphere over a point at distances `a` from a wall and `b` along it that a unit
/// square wall leaves open: Lambert's formula, summed over the edges of the square seen from the point.
fn open_beside_square(point: DVec3, normal: DVec3, square: [DVec3; 4]) -> f64 {
    let around = square.map(|p| (p - point).normalize());
    let sum: f64 = (0..4)
        .map(|i| {
            let (p, q) = (around[i], around[(i + 1) % 4]);
            let cross = p.cross(q);
            let sine = cross.length();
            if sine < 1e-15 { 0.0 } else { sine.atan2(p.dot(q)) * cross.dot(normal) / sine }
        })
        .sum();
    (sum / (2.0 * std::f64::consts::PI)).abs()
}

/// Half Box (Kavan figure 2): three unit squares that meet in a corner, 4 vertices each. `far`: split from the
/// shared corner to the far one, or else between the neighbours.
fn half_box(from_corner: bool, per_side: usize) -> (Mesh, Vec<SurfacePoint>, Vec<f32>, Vec<f32>) {
    let axes = [DVec3::X, DVec3::Y, DVec3::Z];
    let (mut positions, mut triangles) = (Vec::new(), Vec::new());
    for s in 0..3 {
        let (u, v) = (axes[s], axes[(s + 1) % 3]);
        let base = 4 * s as u32;
        positions.extend([DVec3::ZERO, u, u + v, v].map(DVec3::as_vec3));
        let local = if from_corner { [[0, 1, 2], [0, 2, 3]] } else { [[0, 1, 3], [1, 2, 3]] };
        triangles.extend(local.map(|t: [u32; 3]| t.map(|i| i + base)));
    }
    let m = mesh(positions, &triangles);
    let (mut points, mut weights, mut values) = (Vec::new(), Vec::new(), Vec::new());
    // Gauss-Legendre nodes of degree 3 on each small triangle's three midpoints would do; the signal has a
    // logarithmic slope at the walls, so a fine midpoint rule folded onto each triangle is as good.
    for t in m.triangle_ids() {
        let s = t.index() / 2;
        let normal = axes[(s + 2) % 3];
        let (u, v) = (axes[s], axes[(s + 1) % 3]);
        let walls = [[DVec3::ZERO, u, u + normal, normal], [DVec3::ZERO, v, v + normal, normal]];
        let n = per_side;
        for j in 0..n {
            for i in 0..n - j {
                // Upward small triangle, and the downward one beside it.
                for (shift, there) in [(1.0 / 3.0, true), (2.0 / 3.0, i + j + 1 < n)] {
                    if !there {
                        continue;
                    }
                    let b = [(i as f64 + shift) / n as f64, (j as f64 + shift) / n as f64];
                    let p = SurfacePoint { triangle: t, barycentric: b.map(|b| b as f32) };
                    let at = position(&m, p);
                    let closed: f64 = walls.iter().map(|&w| open_beside_square(at, normal, w)).sum();
                    points.push(p);
                    weights.push((0.5 / (n * n) as f64) as f32);
                    values.push((1.0 - closed) as f32);
                }
            }
        }
    }
    (m, points, weights, values)
}

#[test]
fn half_box_matches_the_closed_form() {
    for (from_corner, want, lumped) in
        [(true, [0.2288, 0.5850, 0.9859, 0.5850], 1.414), (false, [0.2065, 0.6074, 0.9636, 0.6074], 0.668)]
    {
        let (m, points, weights, values) = half_box(from_corner, 220);
        let observations = Observations { points: &points, weights: &weights, values: &values, channels: 1 };
        let e = |x: &[f32]| energy(&m, &observations, None, x).expect("fits")[0].measured;
        for method in [Method::Ours, SAMPLED, Method::LeastSquares { mass: Mass::Analytic }] {
            let fitted =
                fit(&m, &adjacency(&m), &observations, None, &options(method, Regularizer::None, 0.0))
                    .expect("fits");
            for (v, value) in fitted.values.iter().enumerate() {
                assert!(
                    (value - want[v % 4]).abs() < 2e-4,
                    "{method:?} {from_corner}: {:?}",
                    &fitted.values[..4]
                );
            }
            assert!((e(&fitted.values) - 0.0694).abs() < 1e-4, "{}", e(&fitted.values));
        }
        let average =
            fit(&m, &adjacency(&m), &observations, None, &options(Method::Average, Regularizer::None, 0.0))
                .expect("fits");
        assert!((e(&average.values) - lumped).abs() < 2e-3, "{}", e(&average.values));
    }
}

#[test]
fn threads_change_no_byte() {
    let m = sheet(120, 0.8, 5);
    let (points, weights) = scatter(&m, 2, 4);
    let values = noisy(&m, &points, 2);
    let observations = Observations { points: &points, weights: &weights, values: &values, channels: 1 };
    let run = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a pool");
        let bounds = Bounds::Optimum { low: 0.1, high: 0.9 };
        pool.install(|| {
            fit(&m, &adjacency(&m), &observations, None, &FitOptions { bounds, ..FitOptions::default() })
                .expect("fits")
        })
    };
    let (one, many) = (run(1), run(5));
    assert_eq!(one.values, many.values);
    assert_eq!(one.report, many.report);
    assert_eq!(one.report.iterative_sheets, 1);
}

/// A sheet in which every tenth vertex all but touches a neighbour.
fn slivers(n: u32) -> Mesh {
    let mut m = sheet(n, 0.6, 9);
    for v in (0..m.vertex_count() - 1).step_by(10).filter(|v| (v + 1) % n as usize != 0) {
        let to = m.positions[v + 1];
        m.positions[v] = to + (m.positions[v] - to) * 1e-3;
    }
    m
}

#[test]
fn blocks_agree_with_the_factor_where_the_diagonal_stalls() {
    let m = slivers(90);
    let (points, weights) = scatter(&m, 3, 4);
    let values = noisy(&m, &points, 2);
    let observations = Observations { points: &points, weights: &weights, values: &values, channels: 1 };
    let run = |solver, memory_limit| {
        let options =
            FitOptions { solver, memory_limit, ..options(Method::Ours, Regularizer::EdgePrinted, 100.0) };
        fit(&m, &adjacency(&m), &observations, None, &options).expect("fits")
    };
    let direct = run(Solver::Direct, None);
    let blocks = run(Solver::Auto, Some(0));
    assert_eq!(blocks.report.iterative_fallbacks, 1, "{:?}", blocks.report);
    for (a, b) in direct.values.iter().zip(&blocks.values) {
        assert!((a - b).abs() < 1e-6, "{a} and {b}");
    }
}

#[test]
fn slivers_do_not_stop_conjugate_gradients_under_our_edge_term() {
    let m = slivers(90);
    let (points, weights) = scatter(&m, 3, 4);
    let values = noisy(&m, &points, 2);
    let observations = Observations { points: &points, weights: &weights, values: &values, channels: 1 };
    for alpha in [0.0, 0.1, 1.0] {
        let run = |solver| {
            fit(
                &m,
                &adjacency(&m),
                &observations,
                None,
                &FitOptions { solver, alpha, ..FitOptions::default() },
            )
            .expect("fits")
        };
        let (direct, iterative) = (run(Solver::Direct), run(Solver::Iterative));
        assert_eq!(iterative.report.iterative_sheets, 1);
        assert!(iterative.report.iterations < 120, "{}", iterative.report.iterations);
        for (a, b) in direct.values.iter().zip(&iterative.values) {
            assert!((a - b).abs() < 1e-6, "{a} and {b}");
        }
    }
}

#[test]
fn pairs_that_slivers_join_do_not_stop_conjugate_gradients() {
    let m = slivers(90);
    let (points, weights) = scatter(&m, 3, 4);
    let channels = 23;
    let columns: Vec<Vec<f32>> = (0..channels as u64).map(|c| noisy(&m, &points, c)).collect();
    let values: Vec<f32> = (0..points.len()).flat_map(|p| columns.iter().map(move |c| c[p])).collect();
    let observations = Observations { points: &points, weights: &weights, values: &values, channels };
    let run = |solver| {
        let options = FitOptions { solver, ..options(Method::Ours, Regularizer::EdgePrinted, 1.0) };
        fit(&m, &adjacency(&m), &observations, None, &options).expect("fits")
    };
    let (direct, iterative) = (run(Solver::Direct), run(Solver::Iterative));
    assert_eq!(iterative.report.iterative_fallbacks, 0, "{:?}", iterative.report);
    assert!(iterative.report.iterations < 150, "{} iterations", iterative.report.iterations);
    for (a, b) in direct.values.iter().zip(&iterative.values) {
        assert!((a - b).abs() < 1e-6, "{a} and {b}");
    }
}
