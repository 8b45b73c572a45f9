//! Charts of whole shapes: every one is a disk without flips or overlap, and covers each triangle once.

mod shapes;

use glam::Vec3;
use lightkiln_chart::{Chart, ChartError, ChartOptions, ChartReport, SUBTEXELS, charts, verify};
use lightkiln_mesh::random::{hash, unit};
use lightkiln_mesh::{Adjacency, Mesh, TriangleId};
use proptest::prelude::*;

fn unwrap(mesh: &Mesh, taken: &[bool], texel: f32) -> (Vec<Chart>, ChartReport) {
    let adjacency = Adjacency::new(mesh);
    let regions = shapes::regions(&adjacency, taken);
    let options = ChartOptions::new(texel);
    let (charts, report) = charts(mesh, &adjacency, &regions, &options).expect("shapes can be charted");
    let mut seen = vec![false; mesh.triangle_count()];
    for chart in &charts {
        verify(chart, mesh).expect("every chart keeps its promises");
        assert!(chart.size.iter().all(|&s| s <= options.max_size));
        assert!(chart.uv.iter().all(|p| p.min_element() >= options.gutter as f32));
        for (p, axis) in chart.uv.iter().flat_map(|p| [(p.x, 0), (p.y, 1)]) {
            assert!(p + options.gutter as f32 <= chart.size[axis] as f32);
        }
        for t in &chart.triangles {
            assert!(!std::mem::replace(&mut seen[t.index()], true));
        }
    }
    assert_eq!(seen, taken);
    assert_eq!(report.charts, charts.len());
    (charts, report)
}

fn all(mesh: &Mesh, texel: f32) -> (Vec<Chart>, ChartReport) {
    unwrap(mesh, &vec![true; mesh.triangle_count()], texel)
}

#[test]
fn charts_flat_region_keeps_its_lengths() {
    let mesh = shapes::plane(20, 50.0);
    let (charts, report) = all(&mesh, 1.0);
    assert_eq!(charts.len(), 1);
    assert!((report.symmetric_dirichlet - 1.0).abs() < 1e-9);
    assert!((report.max_stretch - 1.0).abs() < 1e-6);
    assert_eq!(charts[0].size, [52, 52]);
    let chart = &charts[0];
    for corners in &chart.corners {
        for e in 0..3 {
            let (a, b) = (corners[e] as usize, corners[(e + 1) % 3] as usize);
            let flat = chart.uv[a].distance(chart.uv[b]);
            let true_length =
                mesh.positions[chart.vertices[a].index()].distance(mesh.positions[chart.vertices[b].index()]);
            assert!((flat - true_length).abs() <= 0.18);
        }
    }
}

#[test]
fn charts_turned_rectangle_lies_straight() {
    let turned = glam::Quat::from_euler(glam::EulerRot::XYZ, 0.3, 0.7, 1.1);
    let mesh = shapes::grid(30, 4, [false; 2], |u, v| turned * Vec3::new(u * 60.0, v * 6.0, 0.0) + 100.0);
    let (charts, _) = all(&mesh, 1.0);
    assert_eq!(charts.len(), 1);
    assert_eq!(charts[0].size, [8, 64]);
}

#[test]
fn charts_sphere_becomes_few_disks() {
    for texel in [0.5, 0.05, 0.005] {
        let (charts, report) = all(&shapes::sphere(4), texel);
        assert!(charts.len() <= 6, "{}", charts.len());
        assert!(report.max_stretch <= 2.0);
        assert!((report.chart_area / report.surface_area - 1.0).abs() < 1e-6);
    }
}

#[test]
fn charts_open_tube_is_cut_once_and_unrolled() {
    let (charts, report) = all(&shapes::tube(60, 10, 1.0, 4.0), 0.02);
    assert_eq!(charts.len(), 1);
    assert_eq!(report.cut_edges, 10);
    assert!((report.symmetric_dirichlet - 1.0).abs() < 1e-6, "{report:?}");
    assert!((report.seam_length - 4.0).abs() < 1e-4);
}

#[test]
fn charts_closed_tube_becomes_few_disks() {
    let mut tube = shapes::tube(40, 6, 1.0, 3.0);
    let first = tube.positions.len() as u32;
    tube.positions.extend([Vec3::ZERO, Vec3::Z * 3.0]);
    let mut triangles: Vec<[u32; 3]> = tube.triangles.iter().map(|t| t.map(|v| v.0)).collect();
    for i in 0..40 {
        let next = (i + 1) % 40;
        triangles.push([next, i, first]);
        triangles.push([6 * 40 + i, 6 * 40 + next, first + 1]);
    }
    let (charts, report) = all(&shapes::mesh(tube.positions, triangles), 0.02);
    assert!(charts.len() <= 5, "{report:?}");
}

#[test]
fn charts_torus_becomes_few_disks() {
    let (charts, report) = all(&shapes::torus(24, 2.0, 0.7), 0.05);
    assert!(charts.len() <= 10, "{report:?}");
}

#[test]
fn charts_flat_ring_closes_again_without_seam() {
    let (charts, report) = all(&shapes::annulus(48, 6), 0.01);
    assert_eq!(charts.len(), 1);
    assert_eq!(report.cut_edges, 6);
    assert!((report.symmetric_dirichlet - 1.0).abs() < 1e-6);
    // Both copies of each cut vertex came to the same place.
    let chart = &charts[0];
    for (i, v) in chart.vertices.iter().enumerate() {
        for (j, w) in chart.vertices.iter().enumerate().skip(i + 1) {
            assert!(v != w || chart.uv[i] == chart.uv[j]);
        }
    }
}

#[test]
fn charts_plate_with_holes_is_one_chart() {
    let mesh = shapes::plane(40, 40.0);
    let taken: Vec<bool> = (0..mesh.triangle_count())
        .map(|t| {
            let c = mesh.corners(TriangleId(t as u32)).iter().sum::<Vec3>() / 3.0;
            (c.x % 10.0 - 5.0).hypot(c.y % 10.0 - 5.0) > 2.5
        })
        .collect();
    let (charts, report) = unwrap(&mesh, &taken, 0.5);
    assert_eq!(charts.len(), 1);
    assert!((report.symmetric_dirichlet - 1.0).abs() < 1e-6);
}

#[test]
fn charts_band_with_half_turn_is_cut() {
    let (charts, report) = all(&shapes::moebius(60), 0.02);
    assert!(charts.len() <= 3, "{report:?}");
}

#[test]
fn charts_cube_without_creases_is_unfolded() {
    let (charts, report) = all(&shapes::cube(), 0.1);
    assert!(charts.len() <= 4, "{report:?}");
    assert!(report.max_stretch < 2.0);
}

#[test]
fn charts_fans_at_one_vertex_are_not_connected() {
    // Three fans of two triangles around vertex 0, which touch there only.
    let mut positions = vec![Vec3::ZERO];
    let mut triangles = Vec::new();
    for fan in 0..3_u32 {
        for i in 0..3 {
            let angle = fan as f32 * 2.1 + i as f32 * 0.6;
            positions.push(Vec3::new(angle.cos(), angle.sin(), fan as f32 * 0.2));
        }
        let a = 1 + 3 * fan;
        triangles.extend([[0, a, a + 1], [0, a + 1, a + 2]]);
    }
    let mesh = shapes::mesh(positions, triangles);
    let (charts, _) = all(&mesh, 0.05);
    assert_eq!(charts.len(), 3);
    // A region that the caller believes to be connected is taken apart too.
    let adjacency = Adjacency::new(&mesh);
    let region: Vec<TriangleId> = mesh.triangle_ids().collect();
    let (again, _) = lightkiln_chart::charts(&mesh, &adjacency, &[region], &ChartOptions::new(0.05))
        .expect("pinches are allowed");
    assert_eq!(again, charts);
}

#[test]
fn charts_pinched_ring_repeats_the_vertex() {
    // A ring of triangles that meets itself in one vertex: one region, one fan here and one there.
    let mesh = shapes::plane(6, 6.0);
    let adjacency = Adjacency::new(&mesh);
    for seed in 0..20 {
        let taken: Vec<bool> =
            (0..mesh.triangle_count()).map(|t| unit(hash(seed, t as u64, 0, 0)) < 0.75).collect();
        let regions = shapes::regions(&adjacency, &taken);
        let (charts, report) = unwrap(&mesh, &taken, 0.1);
        assert_eq!(charts.len(), regions.len(), "flat regions stay whole: {report:?}");
    }
}

#[test]
fn charts_hills_hold_together() {
    for (height, noise) in [(0.02, 0.0), (0.1, 0.0), (0.3, 0.0), (0.05, 0.5)] {
        let (charts, report) = all(&shapes::hills(40, 1.0, height, noise), 0.01);
        assert!(charts.len() <= 12, "{report:?}");
    }
}

#[test]
fn charts_slivers_and_zero_areas_stay_finite() {
    // Rows of 1e-6 height between rows of height 1, and columns of no width at all.
    let mesh = shapes::grid(12, 12, [false; 2], |u, v| {
        let step = |x: f32| {
            let i = (x * 12.0).round() as u32;
            (i / 2) as f32 + if i % 2 == 1 { 1e-6 } else { 0.0 }
        };
        let flat = |x: f32| ((x * 12.0).round() as u32 / 3) as f32;
        Vec3::new(flat(u), step(v), 0.02 * flat(u) * step(v))
    });
    for texel in [1.0, 0.1, 0.01] {
        let (charts, report) = all(&mesh, texel);
        assert!(charts.len() <= 4, "{report:?}");
        assert!(report.mean_stretch.is_finite());
    }
}

#[test]
fn charts_degenerate_triangles_alone_are_charts() {
    let p = |x: f32| Vec3::new(x, 0.0, 0.0);
    let positions = vec![p(0.0), p(1.0), p(2.0), p(5.0), p(5.0), p(5.0), p(9.0)];
    let mesh = shapes::mesh(positions, vec![[0, 1, 2], [3, 4, 5], [3, 3, 6], [6, 6, 6]]);
    let (charts, _) = all(&mesh, 0.1);
    assert_eq!(charts.len(), 4);
}

#[test]
fn charts_one_triangle_is_a_chart() {
    let mesh = shapes::mesh(vec![Vec3::ZERO, Vec3::X * 3.0, Vec3::Y * 4.0], vec![[0, 1, 2]]);
    let (charts, report) = all(&mesh, 1.0);
    assert_eq!(charts[0].size, [8, 8]);
    assert_eq!((report.charts, report.vertices, report.collapsed), (1, 3, 0));
}

#[test]
fn charts_two_sides_of_one_triangle_are_parted() {
    let mesh = shapes::mesh(vec![Vec3::ZERO, Vec3::X, Vec3::Y], vec![[0, 1, 2], [0, 2, 1]]);
    assert_eq!(all(&mesh, 0.1).0.len(), 2);
}

#[test]
fn charts_spiral_strip_does_not_overlap() {
    // Three turns of a ramp: each turn lies over the others when it is unfolded.
    let mesh = shapes::grid(180, 2, [false; 2], |u, v| {
        let (s, c) = (u * 3.0 * std::f32::consts::TAU).sin_cos();
        Vec3::new((2.0 - v) * c, (2.0 - v) * s, 0.5 * u)
    });
    let (charts, report) = all(&mesh, 0.02);
    assert!((2..=8).contains(&charts.len()), "{report:?}");
}

#[test]
fn charts_wider_than_the_limit_are_split() {
    let mesh = shapes::plane(32, 100.0);
    let adjacency = Adjacency::new(&mesh);
    let region: Vec<TriangleId> = mesh.triangle_ids().collect();
    let options = ChartOptions { max_size: 64, ..ChartOptions::new(1.0) };
    let (charts, _) = charts(&mesh, &adjacency, &[region], &options).expect("can be split");
    assert!((3..=12).contains(&charts.len()), "{}", charts.len());
    for chart in &charts {
        verify(chart, &mesh).expect("every chart keeps its promises");
        assert!(chart.size.iter().all(|&s| s <= 64));
    }
}

#[test]
fn charts_triangle_wider_than_the_limit_is_shrunk() {
    let mesh = shapes::mesh(vec![Vec3::ZERO, Vec3::X * 900.0, Vec3::Y * 4.0], vec![[0, 1, 2]]);
    let options = ChartOptions { max_size: 128, ..ChartOptions::new(1.0) };
    let (charts, report) =
        charts(&mesh, &Adjacency::new(&mesh), &[vec![TriangleId(0)]], &options).expect("is shrunk");
    assert_eq!(report.shrunk, 1);
    assert!(charts[0].size[1] <= 128 && charts[0].size[1] >= 120);
}

#[test]
fn charts_bad_input_is_refused() {
    let mesh = shapes::plane(2, 1.0);
    let adjacency = Adjacency::new(&mesh);
    let run = |regions: &[Vec<TriangleId>], options| charts(&mesh, &adjacency, regions, &options).map(|_| ());
    let good = ChartOptions::new(0.1);
    assert_eq!(run(&[], good), Ok(()));
    assert_eq!(run(&[vec![]], good), Ok(()));
    assert!(matches!(run(&[], ChartOptions::new(f32::NAN)), Err(ChartError::TexelSize { .. })));
    assert!(matches!(run(&[], ChartOptions { max_size: 3, ..good }), Err(ChartError::MaxSize { .. })));
    assert!(matches!(
        run(&[vec![TriangleId(99)]], good),
        Err(ChartError::Triangle { region: 0, triangle: 99, .. })
    ));
    let twice = [vec![TriangleId(1)], vec![TriangleId(1)]];
    assert!(matches!(run(&twice, good), Err(ChartError::Duplicate { region: 1, triangle: 1 })));
}

#[test]
fn charts_one_thread_and_many_agree() {
    let mesh = shapes::hills(60, 1.0, 0.4, 0.3);
    let adjacency = Adjacency::new(&mesh);
    let taken: Vec<bool> = (0..mesh.triangle_count()).map(|t| unit(hash(3, t as u64, 0, 0)) < 0.8).collect();
    let regions = shapes::regions(&adjacency, &taken);
    let run = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads start");
        pool.install(|| charts(&mesh, &adjacency, &regions, &ChartOptions::new(0.005)).expect("hills chart"))
    };
    assert!(run(1) == run(2));
    let mut backwards = regions.clone();
    backwards.reverse();
    let options = ChartOptions::new(0.005);
    assert_eq!(charts(&mesh, &adjacency, &backwards, &options).expect("hills chart").0, run(2).0);
}

proptest! {
    #![proptest_config(ProptestConfig {
        cases: 48,
        failure_persistence: None,
        rng_seed: proptest::test_runner::RngSeed::Fixed(1),
        ..ProptestConfig::default()
    })]

    #[test]
    fn charts_random_sets_on_noisy_hills_hold(
        seed in any::<u64>(), share in 0.1_f32..1.0, height in 0.0_f32..0.6, noise in 0.0_f32..1.5, texel in 0.002_f32..0.3,
    ) {
        let mesh = shapes::hills(24, 1.0, height, noise);
        let taken: Vec<bool> =
            (0..mesh.triangle_count()).map(|t| unit(hash(seed, t as u64, 0, 0)) < share).collect();
        unwrap(&mesh, &taken, texel);
    }

    #[test]
    fn charts_of_triangle_soup_hold(seed in any::<u64>(), vertices in 4_u64..30, count in 1_u64..60) {
        let number = |i: u64, c: u64| unit(hash(seed, i, c, 1));
        let positions = (0..vertices).map(|i| Vec3::new(number(i, 0), number(i, 1), number(i, 2))).collect();
        let triangles = (0..count)
            .map(|i| [3, 4, 5].map(|c| (hash(seed, i, c, 2) % vertices) as u32))
            .collect();
        let mesh = shapes::mesh(positions, triangles);
        all(&mesh, 0.02);
    }
}

#[test]
fn charts_scaled_keep_their_shape_in_a_grid_of_their_own() {
    let mesh = shapes::hills(24, 1.0, 0.4, 0.3);
    let adjacency = Adjacency::new(&mesh);
    let region: Vec<TriangleId> = mesh.triangle_ids().collect();
    let (charts, _) = charts(&mesh, &adjacency, &[region], &ChartOptions::new(0.01)).expect("hills chart");
    for (chart, factor) in charts.iter().flat_map(|c| [(c, 0.25), (c, 0.8), (c, 1.0)]) {
        let (scaled, shift) = chart.scaled(factor, 1);
        assert_eq!((&scaled.triangles, &scaled.corners), (&chart.triangles, &chart.corners));
        assert!(scaled.size.iter().all(|side| side % 4 == 0));
        for (&here, &there) in chart.uv.iter().zip(&scaled.uv) {
            assert!((here * factor + shift - there).abs().max_element() <= 0.5 / SUBTEXELS as f32 + 1e-4);
            let room = [scaled.size[0] as f32 - 1.0, scaled.size[1] as f32 - 1.0];
            assert!(there.min_element() >= 1.0 && there.x <= room[0] && there.y <= room[1], "{there}");
        }
    }
}
