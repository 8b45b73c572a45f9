//! Lift, stitch and compose together, against signals in closed form.

mod shapes;

use glam::{Vec2, Vec3};
use lightkiln_chart::Chart;
use lightkiln_chart::pack::{PackOptions, Packing, Placement, pack, placed_uv};
use lightkiln_mesh::{Adjacency, Mesh, random};
use lightkiln_texel::*;
use shapes::{chart_of, cube, cylinder, errors, grid, quads, shade};

fn lifted(mesh: &Mesh, charts: &[Chart]) -> Vec<ChartTexels> {
    lift(mesh, &Adjacency::new(mesh), charts, 7)
}

/// A sheet whose chart is a sheared, turned copy of it, so that no border follows the texel rows.
fn sheared_sheet() -> (Mesh, Vec<Chart>) {
    let mesh = grid(4, 3, false, |i, j| Vec3::new(i as f32, j as f32, 0.0) * 0.1);
    let chart = chart_of(&mesh, 0..24, |v| {
        let (i, j) = ((v.0 % 5) as f32, (v.0 / 5) as f32);
        Vec2::new(5.125 * i - 1.75 * j, 1.375 * i + 4.5 * j)
    });
    (mesh, vec![chart])
}

fn linear(p: Vec3) -> f32 {
    0.3 + 0.7 * p.x - 0.4 * p.y + 0.2 * p.z
}

#[test]
fn lift_shows_what_lookups_read() {
    for (mesh, charts) in [sheared_sheet(), cylinder(24, 6, 0.1, 0.4), cube(3, 11.0)] {
        let texels = lifted(&mesh, &charts);
        let values = shade(&mesh, &texels, |_| 1.0);
        // NaN in any texel that a lookup reads would show.
        let (max, _) =
            errors(&mesh, &charts, &values.iter().map(|v| zero_weight_nan(v)).collect::<Vec<_>>(), |_| 1.0);
        assert!(max < 1e-5, "{max}");
    }
    fn zero_weight_nan(values: &[f32]) -> Vec<f32> {
        // Rounding on the border may read a texel with a weight of 1e-7.
        values.iter().map(|v| if v.is_nan() { 10.0 } else { *v }).collect()
    }
}

#[test]
fn lift_goes_on_over_smooth_borders() {
    // The chart is the left half of a plane; its texels beyond the border lie on the right half.
    let mesh = grid(40, 20, false, |i, j| Vec3::new(i as f32, j as f32, 0.0) * 0.025);
    let charts = vec![chart_of(&mesh, quads(40, 0..20, 5..15), |v| {
        let p = mesh.positions[v.index()];
        Vec2::new(p.x, p.y) * 20.0
    })];
    let texels = lifted(&mesh, &charts);
    let mut beyond = 0;
    let low = charts[0].uv[0] - {
        let p = mesh.positions[charts[0].vertices[0].index()];
        Vec2::new(p.x, p.y) * 20.0
    };
    for outside in &texels[0].outside {
        let centre = texels[0].centre(outside.texel);
        let expected = (centre - low) / 20.0;
        let found = mesh.position(texels[0].lift[outside.texel as usize].unwrap());
        // The mesh ends at x = 0 only.
        assert_eq!(outside.reached, expected.x >= 0.0, "{outside:?}");
        if outside.reached {
            assert!(found.distance(expected.extend(0.0)) < 1e-4, "{outside:?} {found} {expected}");
            beyond += 1;
        } else {
            assert!(found.x.abs() < 1e-6 && (found.y - expected.y).abs() < 1e-4);
        }
    }
    assert!(beyond >= 20, "{beyond}");
}

#[test]
fn stitch_linear_signal_is_exact_up_to_the_border() {
    let (mesh, charts) = sheared_sheet();
    let texels = lifted(&mesh, &charts);
    let mut values = shade(&mesh, &texels, linear);
    let (before, _) = errors(&mesh, &charts, &fill_nan(&values), linear);
    let report = stitch(&mesh, &charts, &texels, &mut values, 1, &StitchOptions::default()).unwrap();
    let (after, _) = errors(&mesh, &charts, &values, linear);
    assert!(before > 1e-3 && after < 2e-5, "{before} {after}");
    assert_eq!((report.seams, report.clusters, report.unsolved), (0, 1, 0));
}

fn fill_nan(values: &[Vec<f32>]) -> Vec<Vec<f32>> {
    values.iter().map(|v| v.iter().map(|&x| if x.is_nan() { 0.0 } else { x }).collect()).collect()
}

#[test]
fn stitch_cube_with_linear_signal_agrees_everywhere() {
    let (mesh, charts) = cube(3, 11.0);
    let texels = lifted(&mesh, &charts);
    let mut values = shade(&mesh, &texels, linear);
    let report = stitch(&mesh, &charts, &texels, &mut values, 1, &StitchOptions::default()).unwrap();
    println!("{report:?} {:?}", errors(&mesh, &charts, &values, linear));
    assert_eq!((report.seams, report.clusters), (12 * 3, 1));
}

#[test]
fn stitch_cylinder_agrees_along_seams() {
    let (mesh, charts) = cylinder(48, 6, 0.1, 0.0);
    let texels = lifted(&mesh, &charts);
    let signal = |p: Vec3| 0.5 + 0.3 * p.x * p.y + 0.2 * (3.0 * p.z).sin();
    for weight in [0.0, 1.0, 10.0, 100.0, 1e4] {
        let mut values = shade(&mesh, &texels, signal);
        let before = errors(&mesh, &charts, &fill_nan(&values), signal);
        let options = StitchOptions { seam_weight: weight, ..Default::default() };
        let report = stitch(&mesh, &charts, &texels, &mut values, 1, &options).unwrap();
        println!("{weight}: {before:?} {:?}\n   {report:?}", errors(&mesh, &charts, &values, signal));
    }
    let (mesh, charts) = cylinder(48, 6, 0.1, 0.5);
    let texels = lifted(&mesh, &charts);
    let signal = |p: Vec3| if p.z > 0.9 + 0.3 * p.y { 1.0 } else { 0.0 };
    for weight in [0.0, 1.0, 10.0, 100.0, 1e4] {
        let mut values = shade(&mesh, &texels, signal);
        let options = StitchOptions { seam_weight: weight, ..Default::default() };
        let report = stitch(&mesh, &charts, &texels, &mut values, 1, &options).unwrap();
        println!("step {weight}: {:?}\n   {report:?}", errors(&mesh, &charts, &values, signal));
    }
}
