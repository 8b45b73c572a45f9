//! Constants, linear signals, and what must not change the answer.

mod common;

use common::{adjacency, at, mesh, position, scatter, sheet};
use glam::{Quat, Vec3};
use lightkiln_fit::{Bounds, FitOptions, Held, Mass, Method, Observations, Regularizer, fit};
use lightkiln_mesh::{Mesh, Source, weld};
use proptest::prelude::*;

fn ours(alpha: f32) -> FitOptions {
    FitOptions { alpha, ..FitOptions::default() }
}

fn fit_function(m: &Mesh, per: usize, seed: u64, o: &FitOptions, f: impl Fn(glam::DVec3) -> f64) -> Vec<f32> {
    let (points, weights) = scatter(m, per, seed);
    let values: Vec<f32> = points.iter().map(|&p| f(position(m, p)) as f32).collect();
    let observations = Observations { points: &points, weights: &weights, values: &values, channels: 1 };
    fit(m, &adjacency(m), &observations, None, o).expect("fits").values
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 24, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn constant_signal_is_exact(n in 2_u32..12, per in 1_usize..4, seed: u64, value in -3.0_f32..3.0) {
        let m = sheet(n, 0.6, seed);
        for method in [Method::Ours, Method::LeastSquares { mass: Mass::Sampled }, Method::Average, Method::PointSample] {
            for alpha in [0.0, 0.1] {
                let values = fit_function(&m, per, seed, &FitOptions { method, ..ours(alpha) }, |_| f64::from(value));
                for v in values {
                    prop_assert!((v - value).abs() <= 1e-6 * value.abs(), "{method:?}: {v} for {value}");
                }
            }
        }
    }

    #[test]
    fn linear_signal_is_exact(n in 2_u32..12, per in 3_usize..6, seed: u64, a in -1.0_f64..1.0, b in -1.0_f64..1.0) {
        let m = sheet(n, 0.6, seed);
        for alpha in [0.0, 1.0] {
            let values = fit_function(&m, per, seed, &ours(alpha), |p| a * p.x + b * p.y + 0.5);
            for (v, p) in values.iter().zip(&m.positions) {
                let want = a * f64::from(p.x) + b * f64::from(p.y) + 0.5;
                prop_assert!((f64::from(*v) - want).abs() <= 2e-5, "{v} for {want}");
            }
        }
    }

    #[test]
    fn scale_and_rigid_motion_change_nothing(n in 3_u32..9, seed: u64) {
        let m = sheet(n, 0.6, seed);
        let signal = |p: glam::DVec3| (5.0 * p.x).sin() * (3.0 * p.y).cos();
        let (points, weights) = scatter(&m, 2, seed);
        let values: Vec<f32> = points.iter().map(|&p| signal(position(&m, p)) as f32).collect();
        let run = |m: &Mesh, scale: f32, regularizer| {
            let weights: Vec<f32> = weights.iter().map(|w| w * scale * scale).collect();
            let observations = Observations { points: &points, weights: &weights, values: &values, channels: 1 };
            fit(m, &adjacency(m), &observations, None, &FitOptions { regularizer, ..ours(0.1) }).expect("fits").values
        };
        let turn = Quat::from_euler(glam::EulerRot::XYZ, 0.3, 1.1, 2.0);
        for regularizer in [Regularizer::None, Regularizer::Gradient, Regularizer::EdgePrinted, Regularizer::Edge, Regularizer::Both] {
            let before = run(&m, 1.0, regularizer);
            for (scale, rotation) in [(1000.0, Quat::IDENTITY), (1.0, turn), (0.001, turn)] {
                let mut moved = m.clone();
                moved.positions.iter_mut().for_each(|p| *p = rotation * (*p * scale));
                for (a, b) in before.iter().zip(run(&moved, scale, regularizer)) {
                    prop_assert!((a - b).abs() <= 2e-4, "{regularizer:?} x {scale}: {a} and {b}");
                }
            }
        }
    }

    #[test]
    fn order_of_welding_changes_nothing(n in 3_u32..9, seed: u64) {
        // The same soup of triangles welded front to back and back to front.
        let m = sheet(n, 0.6, seed);
        let (points, weights) = scatter(&m, 2, seed);
        let values: Vec<f32> = points.iter().map(|&p| position(&m, p).x.sin() as f32).collect();
        let soup: Vec<Vec3> = m.triangle_ids().flat_map(|t| m.corners(t)).collect();
        let welded = |order: &[usize]| {
            let positions: Vec<Vec3> = order.iter().map(|&i| soup[i]).collect();
            let mut place = vec![0; soup.len()];
            for (at, &i) in order.iter().enumerate() {
                place[i] = at as u32;
            }
            let triangles: Vec<[u32; 3]> = place.chunks_exact(3).map(|c| [c[0], c[1], c[2]]).collect();
            weld(Source {
                positions: &positions,
                normals: &vec![Vec3::Z; soup.len()],
                groups: &vec![0; soup.len()],
                triangles: &triangles,
                normal_cosine: 1.0,
            })
            .expect("a valid mesh")
            .mesh
        };
        let forward: Vec<usize> = (0..soup.len()).collect();
        let backward: Vec<usize> = (0..soup.len()).rev().collect();
        let observations = Observations { points: &points, weights: &weights, values: &values, channels: 1 };
        let found = [forward, backward].map(|order| {
            let m = welded(&order);
            let values = fit(&m, &adjacency(&m), &observations, None, &ours(0.1)).expect("fits").values;
            m.triangles.iter().flatten().map(|v| values[v.index()]).collect::<Vec<f32>>()
        });
        for (a, b) in found[0].iter().zip(&found[1]) {
            prop_assert!((a - b).abs() <= 1e-6, "{a} and {b}");
        }
    }

    #[test]
    fn order_of_vertices_triangles_and_observations_changes_nothing(n in 3_u32..9, seed: u64) {
        let m = sheet(n, 0.6, seed);
        let (points, weights) = scatter(&m, 2, seed);
        let values: Vec<f32> = points.iter().map(|&p| position(&m, p).x.sin() as f32).collect();
        let observations = Observations { points: &points, weights: &weights, values: &values, channels: 1 };
        let before = fit(&m, &adjacency(&m), &observations, None, &ours(0.1)).expect("fits").values;
        // Everything backwards.
        let (vertices, triangles) = (m.vertex_count() as u32, m.triangle_count() as u32);
        let mut turned = m.clone();
        turned.positions.reverse();
        turned.triangles.reverse();
        for corners in &mut turned.triangles {
            *corners = corners.map(|v| lightkiln_mesh::VertexId(vertices - 1 - v.0));
        }
        let points: Vec<_> = points.iter().rev().map(|p| at(triangles - 1 - p.triangle.0, p.barycentric[0], p.barycentric[1])).collect();
        let weights: Vec<f32> = weights.iter().rev().copied().collect();
        let values: Vec<f32> = values.iter().rev().copied().collect();
        let observations = Observations { points: &points, weights: &weights, values: &values, channels: 1 };
        let after = fit(&turned, &adjacency(&turned), &observations, None, &ours(0.1)).expect("fits").values;
        for (a, b) in before.iter().zip(after.iter().rev()) {
            prop_assert!((a - b).abs() <= 1e-6);
        }
    }
}

#[test]
fn one_triangle_with_one_observation_takes_its_value() {
    let m = mesh(vec![Vec3::ZERO, Vec3::X, Vec3::Y], &[[0, 1, 2]]);
    let observations =
        Observations { points: &[at(0, 0.01, 0.01)], weights: &[0.5], values: &[0.7], channels: 1 };
    let values = fit(&m, &adjacency(&m), &observations, None, &ours(0.0)).expect("fits").values;
    assert!(values.iter().all(|v| (v - 0.7).abs() < 1e-6), "{values:?}");
}

#[test]
fn degenerate_input_is_counted_and_never_wild() {
    // A good quad, a zero-area triangle, a collapsed one, a sheet nobody sees, an isolated vertex.
    let p = |x: f32, y: f32| Vec3::new(x, y, 0.0);
    let m = mesh(
        vec![
            p(0.0, 0.0),
            p(1.0, 0.0),
            p(1.0, 1.0),
            p(0.0, 1.0),
            p(2.0, 0.0),
            p(3.0, 0.0),
            p(2.5, 0.0),
            p(5.0, 5.0),
            p(6.0, 5.0),
            p(5.0, 6.0),
            p(9.0, 9.0),
            p(1.0, 1.0),
        ],
        &[[0, 1, 2], [0, 2, 3], [4, 5, 6], [1, 1, 2], [7, 8, 9], [2, 11, 11], [6, 6, 6]],
    );
    let points = [
        at(0, 0.3, 0.3),
        at(1, 0.3, 0.3),
        at(0, 0.1, 0.8),
        at(1, f32::NAN, 0.1),
        at(2, 0.2, 0.2),
        at(1, 0.2, 0.2),
    ];
    let values = [0.5, 0.25, f32::NAN, 0.1, 0.75, 100.0];
    let weights = [0.5, 0.5, 0.1, 0.1, 0.1, 0.0];
    let observations = Observations { points: &points, weights: &weights, values: &values, channels: 1 };
    for method in [
        Method::Ours,
        Method::LeastSquares { mass: Mass::Sampled },
        Method::LeastSquares { mass: Mass::Analytic },
        Method::Average,
        Method::PointSample,
    ] {
        for regularizer in [
            Regularizer::None,
            Regularizer::Gradient,
            Regularizer::EdgePrinted,
            Regularizer::Edge,
            Regularizer::Both,
        ] {
            let options = FitOptions { method, regularizer, ..ours(0.1) };
            let fitted = fit(&m, &adjacency(&m), &observations, None, &options).expect("fits");
            assert!(
                fitted.values.iter().all(|v| (-0.5..=1.5).contains(v)),
                "{options:?}: {:?}",
                fitted.values
            );
            assert_eq!(fitted.report.not_finite_observations, 2);
            assert_eq!(fitted.report.ignored_observations, 1);
            assert_eq!(fitted.report.isolated_vertices, 1);
            assert_eq!(fitted.report.undetermined_vertices, 3);
            assert_eq!(fitted.report.degenerate_triangles, 4);
            assert_eq!(fitted.report.unseen_triangles, 4);
            assert_eq!(fitted.report.single_triangles, 1);
            assert_eq!(fitted.report.coincident_vertices, 4);
        }
    }
}

#[test]
fn empty_mesh_and_no_observations_are_fine() {
    let none = Observations { points: &[], weights: &[], values: &[], channels: 2 };
    let m = Mesh::default();
    assert!(fit(&m, &adjacency(&m), &none, None, &ours(0.1)).expect("fits").values.is_empty());
    let m = sheet(3, 0.0, 0);
    let fitted = fit(&m, &adjacency(&m), &none, None, &ours(0.1)).expect("fits");
    assert_eq!(fitted.values, vec![1.0; 18]);
    assert_eq!(fitted.report.undetermined_sheets, 1);
}

#[test]
fn far_observation_does_not_shoot() {
    // The far corner of the last triangle is seen once, from afar, with an outlier.
    let p = |x: f32, y: f32| Vec3::new(x, y, 0.0);
    let m = mesh(vec![p(0.0, 0.0), p(1.0, 0.0), p(0.0, 1.0), p(1.0, 1.0)], &[[0, 1, 2], [1, 3, 2]]);
    let mut points: Vec<_> =
        (0..9).map(|k| at(0, 0.1 + 0.1 * (k % 3) as f32, 0.1 + 0.1 * (k / 3) as f32)).collect();
    let mut values = vec![0.5; 9];
    points.push(at(1, 0.02, 0.49));
    values.push(0.6);
    let weights = vec![0.05; 10];
    let observations = Observations { points: &points, weights: &weights, values: &values, channels: 1 };
    let fitted = fit(&m, &adjacency(&m), &observations, None, &ours(0.0)).expect("fits");
    assert!(fitted.values.iter().all(|v| (0.3..0.9).contains(v)), "{:?}", fitted.values);
}

#[test]
fn held_vertices_keep_their_values_and_pull_their_neighbours() {
    let m = sheet(6, 0.4, 3);
    let (points, weights) = scatter(&m, 3, 1);
    let values: Vec<f32> = points.iter().map(|&p| position(&m, p).x as f32).collect();
    let observations = Observations { points: &points, weights: &weights, values: &values, channels: 1 };
    let mut flags = vec![false; m.vertex_count()];
    let mut given = vec![f32::NAN; m.vertex_count()];
    for v in 0..6 {
        flags[v] = true;
        given[v] = m.positions[v].x;
    }
    let held = Held { vertices: &flags, values: &given };
    let fitted = fit(&m, &adjacency(&m), &observations, Some(&held), &ours(0.0)).expect("fits");
    for (v, p) in fitted.values.iter().zip(&m.positions) {
        assert!((v - p.x).abs() < 2e-6);
    }
    assert_eq!(fitted.report.held_vertices, 6);
}

#[test]
fn clamp_counts_what_was_outside() {
    let m = sheet(4, 0.0, 0);
    let (points, weights) = scatter(&m, 4, 1);
    let values: Vec<f32> = points.iter().map(|&p| position(&m, p).x as f32 * 2.0 - 0.5).collect();
    let observations = Observations { points: &points, weights: &weights, values: &values, channels: 1 };
    let bounds = Bounds::Clamp { low: 0.0, high: 1.0 };
    let fitted =
        fit(&m, &adjacency(&m), &observations, None, &FitOptions { bounds, ..ours(0.0) }).expect("fits");
    assert_eq!((fitted.report.below, fitted.report.above), (4, 4));
    assert!((fitted.report.farthest_outside - 0.5).abs() < 1e-5);
    assert!((fitted.report.mean_outside() - 0.5).abs() < 1e-5);
    assert!(fitted.values.iter().all(|v| (0.0..=1.0).contains(v)));
}

#[test]
fn non_manifold_edges_are_left_out_and_counted() {
    // Three unequal fins on one edge: no regularizer may couple any two of them over it.
    let fin = |x: f32, y: f32, z: f32| Vec3::new(x, y, z);
    let m = mesh(
        vec![Vec3::ZERO, Vec3::Z, fin(1.0, 0.0, 0.4), fin(-0.7, 1.0, 0.5), fin(-0.5, -1.0, 0.6)],
        &[[0, 1, 2], [0, 1, 3], [0, 1, 4]],
    );
    let (points, weights) = scatter(&m, 9, 2);
    // Linear on each fin, with a slope of its own.
    let slope = |t: u32| 0.3 * t as f32 - 0.3;
    let values: Vec<f32> = points.iter().map(|p| 0.5 + slope(p.triangle.0) * p.barycentric[1]).collect();
    let observations = Observations { points: &points, weights: &weights, values: &values, channels: 1 };
    for regularizer in [Regularizer::EdgePrinted, Regularizer::Edge] {
        let options = FitOptions { regularizer, ..ours(100.0) };
        let fitted = fit(&m, &adjacency(&m), &observations, None, &options).expect("fits");
        assert_eq!(fitted.report.non_manifold_edges, 1);
        for (v, value) in fitted.values.iter().enumerate() {
            let want = if v < 2 { 0.5 } else { 0.5 + slope(v as u32 - 2) };
            assert!((value - want).abs() < 1e-5, "{regularizer:?}: {value} for {want}");
        }
    }
}

#[test]
fn sparse_noise_is_never_wild() {
    // Half an observation a triangle and pure noise of 0..=1: the worst that a fit can meet.
    let (mut low, mut high, mut sum2, mut count) = (0.0_f32, 0.0_f32, 0.0, 0.0);
    for seed in 0..40 {
        let m = sheet(14, 0.8, seed);
        let (all, _) = scatter(&m, 1, seed);
        let points: Vec<_> = all.into_iter().step_by(2).collect();
        let weights = vec![1.0 / points.len() as f32; points.len()];
        let values: Vec<f32> = (0..points.len())
            .map(|i| lightkiln_mesh::random::unit(lightkiln_mesh::random::hash(seed, i as u64, 9, 9)))
            .collect();
        let observations = Observations { points: &points, weights: &weights, values: &values, channels: 1 };
        for alpha in [0.0, 0.01] {
            let fitted = fit(&m, &adjacency(&m), &observations, None, &ours(alpha)).expect("fits");
            for v in fitted.values {
                low = low.min(v);
                high = high.max(v);
                sum2 += (v - 0.5) * (v - 0.5);
                count += 1.0;
            }
        }
    }
    let deviation = (sum2 / count).sqrt();
    assert!(low > -1.0 && high < 2.0, "{low}..{high}");
    assert!(deviation < 0.27, "{deviation}: more than the noise itself");
}
