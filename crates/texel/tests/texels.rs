//! Lift, stitch and compose together, against signals in closed form.

mod shapes;

use glam::{Vec2, Vec3};
use lightkiln_chart::pack::{PackOptions, Packing, Placement, pack, placed_uv};
use lightkiln_chart::{Chart, ChartOptions, charts};
use lightkiln_mesh::{Adjacency, Mesh, SurfacePoint, VertexId, random};
use lightkiln_texel::*;
use proptest::prelude::*;
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
    assert!(beyond >= 6, "{beyond}");
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

/// A signal with detail of about 5 texels of side 0.1, as a bake has it.
fn smooth(p: Vec3) -> f32 {
    0.5 + 0.3 * p.x * p.y + 0.2 * (3.0 * p.z).sin()
}

/// A shadow's edge that crosses the seams of `cylinder`.
fn step(p: Vec3) -> f32 {
    let across = (p.z - 0.9 - 0.3 * p.y) / 0.15;
    (0.5 + across).clamp(0.0, 1.0)
}

#[test]
fn stitch_cube_with_linear_signal_agrees_everywhere() {
    let (mesh, charts) = cube(3, 12.0);
    let texels = lifted(&mesh, &charts);
    let mut values = shade(&mesh, &texels, linear);
    let report = stitch(&mesh, &charts, &texels, &mut values, 1, &StitchOptions::default()).unwrap();
    let (error, _) = errors(&mesh, &charts, &values, linear);
    assert_eq!((report.seams, report.clusters, report.unsolved), (12 * 3, 1, 0));
    assert!(report.seam_after.max < 1e-5 && report.vertex_after.max < 1e-5, "{report:?}");
    assert!(error < 1e-4, "{error}");
}

/// Two grids that do not line up cannot agree on a curved signal for nothing: a strong pull gives agreement to
/// 1e-4, the default one an error that is no larger than without stitching.
#[test]
fn stitch_cylinder_agrees_along_seams() {
    let (mesh, charts) = cylinder(48, 6, 0.1, 0.5);
    let texels = lifted(&mesh, &charts);
    let stitched = |signal: fn(Vec3) -> f32, seam_weight: f32, vertex_weight: f32| {
        let mut values = shade(&mesh, &texels, signal);
        let options = StitchOptions { seam_weight, vertex_weight, ..Default::default() };
        let report = stitch(&mesh, &charts, &texels, &mut values, 1, &options).unwrap();
        (report, errors(&mesh, &charts, &values, signal).1)
    };
    let (_, plain) = stitched(smooth, 0.0, 0.0);
    let (report, error) = stitched(smooth, 1e4, 1e5);
    assert!(report.seam_before.max > 1e-3 && report.seam_after.max < 1e-4, "{report:?}");
    assert!(error < 1.3 * plain, "{error} {plain}");
    let defaults = StitchOptions::default();
    let (report, error) = stitched(smooth, defaults.seam_weight, defaults.vertex_weight);
    assert!(error < 1.02 * plain && report.vertex_after.max < 1e-5, "{error} {plain}");
    let (_, plain) = stitched(step, 0.0, 0.0);
    let (report, error) = stitched(step, defaults.seam_weight, defaults.vertex_weight);
    assert!(report.seam_after.rms < 0.5 * report.seam_before.rms, "{report:?}");
    assert!(error < 1.1 * plain, "{error} {plain}");
}

/// Samples spread evenly over a mesh, so many per square unit.
fn samples(mesh: &Mesh, density: f64, signal: fn(Vec3) -> f32) -> (Vec<SurfacePoint>, Vec<f32>, Vec<f32>) {
    let (mut points, mut areas, mut values) = (Vec::new(), Vec::new(), Vec::new());
    for triangle in mesh.triangle_ids() {
        let area = mesh.area(triangle);
        let count = (density * area).round() as u64;
        for k in 0..count {
            let square = random::unit2(random::hash(3, u64::from(triangle.0), k, 0));
            let point = SurfacePoint { triangle, barycentric: random::square_to_triangle(square) };
            points.push(point);
            areas.push((area / count as f64) as f32);
            values.push(signal(mesh.position(point)));
        }
    }
    (points, areas, values)
}

#[test]
fn observations_lower_the_error() {
    let (mesh, charts) = cylinder(48, 6, 0.1, 0.5);
    let texels = lifted(&mesh, &charts);
    let error = |signal: fn(Vec3) -> f32, per_texel: f64| {
        let mut values = shade(&mesh, &texels, signal);
        let (points, areas, seen) = samples(&mesh, per_texel / 0.01, signal);
        let observations = Observations::from_samples(&mesh, &charts, &points, &areas, &seen, 1).unwrap();
        assert_eq!(observations.uv.len(), points.len());
        let total: f32 = observations.weights.iter().sum();
        // Weights are areas in texels.
        assert!(points.is_empty() || (total - mesh.total_area() as f32 / 0.01).abs() < 0.02 * total);
        let options = StitchOptions { observations: Some(&observations), ..Default::default() };
        let report = stitch(&mesh, &charts, &texels, &mut values, 1, &options).unwrap();
        assert!(points.is_empty() || report.observed[1] < report.observed[0]);
        errors(&mesh, &charts, &values, signal).1
    };
    // Measured: 0.00127 to 0.00086, and 0.0224 to 0.0204.
    assert!(error(smooth, 1.0) < 0.75 * error(smooth, 0.0));
    assert!(error(step, 1.0) < 0.95 * error(step, 0.0));
}

#[test]
fn stitch_fills_invalid_texels_from_their_chart() {
    let (mesh, charts) = cylinder(24, 6, 0.1, 0.3);
    let texels = lifted(&mesh, &charts);
    let mut values = shade(&mesh, &texels, |p| 0.5 + 0.1 * p.z);
    // A hole, single texels, and the other chart entirely.
    let mut valid: Vec<Vec<bool>> = texels.iter().map(|t| vec![true; t.len()]).collect();
    let [width, height] = charts[0].size;
    let mut invalid = 0;
    for texel in 0..texels[0].len() {
        let (i, j) = (texel as u32 % width, texel as u32 / width);
        let hole = i > width / 3 && i < width / 2 && j > height / 3 && j < height / 2;
        if hole || texel % 17 == 0 {
            invalid += usize::from(texels[0].lift[texel].is_some());
            values[0][texel] = if texel % 2 == 0 { f32::NAN } else { -1e6 };
            valid[0][texel] = texel % 2 == 0; // NaN is found without being told
        }
    }
    valid[1].fill(false);
    values[1].fill(0.25);
    let options = StitchOptions { valid: Some(&valid), ..Default::default() };
    let report = stitch(&mesh, &charts, &texels, &mut values, 1, &options).unwrap();
    assert_eq!((report.filled, report.unfilled), (invalid, texels[1].shown()));
    for (texel, value) in values[0].iter().enumerate() {
        if texels[0].lift[texel].is_some() {
            assert!((0.2..0.8).contains(value), "texel {texel}: {value}");
        }
    }
}

#[test]
fn stitch_holds_what_it_is_told() {
    let (mesh, charts) = sheared_sheet();
    let texels = lifted(&mesh, &charts);
    let mut values = shade(&mesh, &texels, |_| 0.5);
    let uv = (charts[0].uv[0] + charts[0].uv[1]) / 2.0;
    let holds = [Hold { chart: 0, uv, value: vec![0.75], weight: 1e5 }];
    let options = StitchOptions { holds: &holds, ..Default::default() };
    stitch(&mesh, &charts, &texels, &mut values, 1, &options).unwrap();
    let mut out = [0.0];
    lookup(charts[0].size, 1, &values[0], uv, &mut out);
    assert!((out[0] - 0.75).abs() < 1e-3, "{out:?}");
}

/// A signal that falls to 0 right at the seams: extrapolation leaves the range, and what is clamped still
/// agrees.
#[test]
fn stitch_within_a_range_still_agrees() {
    let (mesh, charts) = cube(3, 11.0);
    let texels = lifted(&mesh, &charts);
    let signal = |p: Vec3| {
        let [a, b, c] = p.abs().to_array();
        (4.0 * (0.5 - a.min(b).max(a.max(b).min(c)))).clamp(0.0, 1.0)
    };
    let shaded = shade(&mesh, &texels, signal);
    let run = |range: [f32; 2]| {
        let mut values = shaded.clone();
        let options = StitchOptions { range, ..Default::default() };
        let report = stitch(&mesh, &charts, &texels, &mut values, 1, &options).unwrap();
        (report, errors(&mesh, &charts, &values, signal), values)
    };
    let (_, _, free) = run(StitchOptions::default().range);
    let (report, error, values) = run([0.0, 1.0]);
    let least = |values: &[Vec<f32>]| {
        let shown = values.iter().zip(&texels).flat_map(|(v, t)| v.iter().zip(&t.lift));
        shown.filter(|(_, lift)| lift.is_some()).map(|(v, _)| *v).fold(f32::INFINITY, f32::min)
    };
    assert!(least(&free) < -0.01 && least(&values) >= 0.0);
    // Clamped only, both differ by 0.09; the price is a largest error of 0.23 instead of 0.12 at the corners.
    assert!(report.vertex_after.max < 1e-4 && report.seam_after.max < 0.02, "{report:?}");
    assert!(error.1 < 0.04, "{error:?}");
}

#[test]
fn stitch_channels_are_independent() {
    let (mesh, charts) = cylinder(24, 4, 0.15, 0.3);
    let texels = lifted(&mesh, &charts);
    let one = |signal: fn(Vec3) -> f32| {
        let mut values = shade(&mesh, &texels, signal);
        stitch(&mesh, &charts, &texels, &mut values, 1, &StitchOptions::default()).unwrap();
        values
    };
    let (left, right) = (shade(&mesh, &texels, smooth), shade(&mesh, &texels, step));
    let mut both: Vec<Vec<f32>> =
        left.iter().zip(&right).map(|(a, b)| a.iter().zip(b).flat_map(|(a, b)| [*a, *b]).collect()).collect();
    stitch(&mesh, &charts, &texels, &mut both, 2, &StitchOptions::default()).unwrap();
    let read = vertex_readback(&charts, &both, 2);
    for (channel, signal) in [smooth as fn(Vec3) -> f32, step].into_iter().enumerate() {
        let single = vertex_readback(&charts, &one(signal), 1);
        for (both, single) in read.iter().flatten().skip(channel).step_by(2).zip(single.iter().flatten()) {
            assert!((both - single).abs() < 1e-5);
        }
    }
}

fn composed(charts: &[Chart], texels: &[ChartTexels], values: &[Vec<f32>], packing: &Packing) -> Atlas {
    compose(charts, texels, values, 1, packing).expect("the packing is sound")
}

#[test]
fn compose_turns_and_does_not_mirror() {
    let (mesh, charts) = cylinder(24, 6, 0.1, 0.3);
    let texels = lifted(&mesh, &charts);
    let mut values = shade(&mesh, &texels, |p| 0.5 + 0.2 * p.x + 0.1 * p.y + 0.1 * p.z);
    stitch(&mesh, &charts, &texels, &mut values, 1, &StitchOptions::default()).unwrap();
    let height = charts[0].size[0];
    let placements = vec![
        Placement { page: 1, origin: [8, 4], turned: true },
        Placement { page: 0, origin: [4, 12], turned: false },
    ];
    let page_size =
        [(charts[0].size[1] + 8).max(charts[1].size[0] + 4), (height + 4).max(charts[1].size[1] + 12)];
    let packing = Packing { placements, page_size: page_size.map(|s| s.next_multiple_of(4)), pages: 2 };
    let atlas = composed(&charts, &texels, &values, &packing);
    for (c, chart) in charts.iter().enumerate() {
        for corners in &chart.corners {
            let uv = corners.iter().map(|&v| chart.uv[v as usize]).sum::<Vec2>() / 3.0;
            let placement = packing.placements[c];
            let (mut own, mut placed) = ([0.0], [0.0]);
            lookup(chart.size, 1, &values[c], uv, &mut own);
            let at = Vec2::from(placed_uv(uv, chart.size, placement));
            lookup(atlas.size, 1, &atlas.pages[placement.page as usize], at, &mut placed);
            assert!((own[0] - placed[0]).abs() < 1e-5, "chart {c}: {own:?} {placed:?}");
        }
    }
    assert_eq!(atlas.shown, texels.iter().map(|t| t.shown() as u64).sum::<u64>());
    assert_eq!(atlas.texels, packing.page_texels());
    assert_eq!(atlas.shown + atlas.gutter + atlas.waste(), atlas.texels);
    assert!(atlas.pages.iter().flatten().all(|v| v.is_finite()));
}

/// Chart after chart with its own constant: every texel of mip levels 0, 1 and 2 within a chart's blocks has
/// that constant, so no level mixes charts.
#[test]
fn compose_mips_show_one_chart_per_block() {
    let (mesh, charts) = cube(3, 11.0);
    let texels = lifted(&mesh, &charts);
    let values: Vec<Vec<f32>> = texels
        .iter()
        .enumerate()
        .map(|(c, t)| t.lift.iter().map(|p| p.map_or(f32::NAN, |_| (c + 1) as f32)).collect())
        .collect();
    let packing = pack(&charts, &PackOptions::default()).unwrap();
    let atlas = composed(&charts, &texels, &values, &packing);
    let blocks = atlas.size[0] / 4;
    let mut seen = vec![0; charts.len()];
    for level in 0..=2 {
        let (size, mip) = atlas.mip(0, level);
        for (texel, &value) in mip.iter().enumerate() {
            let (i, j) = (texel as u32 % size[0], texel as u32 / size[0]);
            let block = ((j << level) / 4 * blocks + (i << level) / 4) as usize;
            let owner = atlas.owners[0][block];
            if owner != Atlas::FREE {
                assert!(
                    (value - (owner + 1) as f32).abs() < 1e-5,
                    "level {level}: {value} in a block of {owner}"
                );
                seen[owner as usize] += 1;
            }
        }
    }
    assert!(seen.iter().all(|&s| s > 0));
}

#[test]
fn compose_refuses_charts_that_share_a_block_or_leave_the_page() {
    let (mesh, charts) = cube(2, 8.0);
    let texels = lifted(&mesh, &charts);
    let values: Vec<Vec<f32>> = texels.iter().map(|t| vec![0.0; t.len()]).collect();
    let all = |origin| vec![Placement { page: 0, origin, turned: false }; 6];
    let shared = Packing { placements: all([0, 0]), page_size: [64, 64], pages: 1 };
    assert!(matches!(compose(&charts, &texels, &values, 1, &shared), Err(TexelError::SharedBlock { .. })));
    let outside = Packing { placements: all([60, 0]), page_size: [64, 64], pages: 1 };
    assert!(matches!(
        compose(&charts, &texels, &values, 1, &outside),
        Err(TexelError::Placement { chart: 0 })
    ));
    let page = Packing { placements: all([0, 0]), page_size: [64, 64], pages: 0 };
    assert!(matches!(compose(&charts, &texels, &values, 1, &page), Err(TexelError::Placement { chart: 0 })));
}

#[test]
fn empty_input_gives_empty_output() {
    let mesh = Mesh::default();
    assert!(lifted(&mesh, &[]).is_empty());
    let report = stitch(&mesh, &[], &[], &mut [], 1, &StitchOptions::default()).unwrap();
    assert_eq!(report, StitchReport::default());
    let atlas = composed(&[], &[], &[], &Packing::default());
    assert_eq!((atlas.texels, atlas.pages.len()), (0, 0));
    assert!(vertex_readback(&[], &[], 3).is_empty());
    let (mesh, _) = sheared_sheet();
    let empty = Chart { triangles: vec![], vertices: vec![], corners: vec![], uv: vec![], size: [4, 4] };
    let texels = lifted(&mesh, std::slice::from_ref(&empty));
    assert_eq!(texels[0].shown(), 0);
    let mut values = vec![vec![f32::NAN; 16]];
    stitch(&mesh, &[empty], &texels, &mut values, 1, &StitchOptions::default()).unwrap();
    assert!(values[0].iter().all(|v| v.is_finite()));
}

#[test]
fn input_that_does_not_fit_is_refused() {
    let (mesh, charts) = sheared_sheet();
    let texels = lifted(&mesh, &charts);
    let options = StitchOptions::default();
    let run = |charts: &[Chart], values: &mut [Vec<f32>], channels, options: &StitchOptions| {
        stitch(&mesh, charts, &texels, values, channels, options).unwrap_err()
    };
    let mut values = vec![vec![0.0; texels[0].len()]];
    assert!(matches!(run(&charts, &mut values, 0, &options), TexelError::Channels { .. }));
    assert!(matches!(run(&charts, &mut values, 2, &options), TexelError::Length { what: "values", .. }));
    let holds = [Hold { chart: 3, uv: Vec2::ONE, value: vec![0.0], weight: 1.0 }];
    let held = StitchOptions { holds: &holds, ..StitchOptions::default() };
    assert!(matches!(run(&charts, &mut values, 1, &held), TexelError::Hold { hold: 0 }));
    for fault in 0..3 {
        let mut chart = charts[0].clone();
        match fault {
            0 => chart.uv[0].x = f32::NAN,
            1 => chart.corners[0][1] = 99,
            _ => chart.triangles[0].0 = 12345,
        }
        assert_eq!(lifted(&mesh, std::slice::from_ref(&chart))[0].shown(), 0);
        assert!(matches!(run(&[chart], &mut values, 1, &options), TexelError::Chart { chart: 0, .. }));
    }
}

#[test]
fn keys_do_not_depend_on_other_charts() {
    let (mesh, charts) = cylinder(24, 4, 0.1, 0.2);
    let both = lifted(&mesh, &charts);
    let second = lifted(&mesh, &charts[1..]);
    assert_eq!(both[1], second[0]);
    let mut keys: Vec<u64> = both.iter().flat_map(|t| t.keys.clone()).collect();
    keys.sort_unstable();
    keys.dedup();
    assert_eq!(keys.len(), both[0].len() + both[1].len());
}

#[test]
fn one_and_two_threads_give_the_same_bits() {
    let bake = || {
        let (mesh, charts) = cube(4, 21.0);
        let texels = lifted(&mesh, &charts);
        let mut values = shade(&mesh, &texels, smooth);
        let (points, areas, seen) = samples(&mesh, 400.0, smooth);
        let observations = Observations::from_samples(&mesh, &charts, &points, &areas, &seen, 1).unwrap();
        let options = StitchOptions { observations: Some(&observations), ..Default::default() };
        let report = stitch(&mesh, &charts, &texels, &mut values, 1, &options).unwrap();
        let atlas = composed(&charts, &texels, &values, &pack(&charts, &PackOptions::default()).unwrap());
        let bits: Vec<u32> = atlas.pages.iter().flatten().map(|v| v.to_bits()).collect();
        (report, bits)
    };
    let pool = |threads| rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
    assert_eq!(pool(1).install(bake), pool(2).install(bake));
}

/// A globe with collapsed triangles at its poles, cut into charts as a bake cuts it.
#[test]
fn globe_in_real_charts_reads_as_the_signal() {
    let (segments, rings) = (96, 48);
    let mesh = grid(segments, rings, true, |i, j| {
        let (sin, cos) = (std::f32::consts::TAU * i as f32 / segments as f32).sin_cos();
        let (ring, z) = (std::f32::consts::PI * (j as f32 / rings as f32 - 0.5)).sin_cos();
        Vec3::new(cos * z, sin * z, ring)
    });
    let adjacency = Adjacency::new(&mesh);
    let region: Vec<_> = mesh.triangle_ids().collect();
    let texel = 0.02;
    let (charts, _) = charts(&mesh, &adjacency, &[region], &ChartOptions::new(texel)).unwrap();
    let texels = lifted(&mesh, &charts);
    for texels in &texels {
        for outside in texels.outside.iter().filter(|o| o.reached) {
            // What lies beyond lies near.
            let point = mesh.position(texels.lift[outside.texel as usize].unwrap());
            assert!((point.length() - 1.0).abs() < 0.01);
        }
    }
    let signal = |p: Vec3| 0.5 + 0.3 * (5.0 * p.x).sin() * (4.0 * p.y).cos() + 0.1 * p.z;
    let mut values = shade(&mesh, &texels, signal);
    let report = stitch(&mesh, &charts, &texels, &mut values, 1, &StitchOptions::default()).unwrap();
    let (max, rms) = errors(&mesh, &charts, &values, signal);
    // Bilinear error alone: texel^2 / 8 times the second derivatives, about 0.001, in places of a chart that is
    // stretched twofold four times that.
    assert!(max < 0.006 && rms < 5e-4, "{max} {rms}");
    assert!(report.seams > 0 && report.seam_after.max < 5e-4, "{report:?}");
    let packing = pack(&charts, &PackOptions::default()).unwrap();
    let atlas = composed(&charts, &texels, &values, &packing);
    assert!(atlas.pages.iter().flatten().all(|v| (-0.1..1.1).contains(v)));
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::with_cases(60) })]

    /// Meshes and charts of any shape, folded, flipped, degenerate and non-manifold: nothing panics, nothing is
    /// NaN, every texel that is shown has a point of the mesh.
    #[test]
    fn any_chart_is_lifted_and_stitched(
        points in prop::collection::vec((0.0_f32..1.0, 0.0_f32..1.0, 0_u8..3), 3..12),
        faces in prop::collection::vec((0_usize..12, 0_usize..12, 0_usize..12), 1..12),
        places in prop::collection::vec((16_u32..160, 16_u32..120), 12),
        charted in prop::collection::vec(0_u8..3, 12),
    ) {
        let n = points.len();
        let positions = points.iter().map(|p| Vec3::new(p.0, p.1, f32::from(p.2) * 0.3)).collect();
        let triangles = faces.iter().map(|f| [f.0, f.1, f.2].map(|v| VertexId((v % n) as u32))).collect();
        let mesh = Mesh::new(positions, vec![Vec3::Z; n], triangles).unwrap();
        let charts: Vec<Chart> = (0..2)
            .map(|c| {
                let own = (0..faces.len() as u32).filter(|&t| charted[t as usize] == c);
                let mut chart = chart_of(&mesh, own, |v| {
                    let (x, y) = places[v.0 as usize];
                    Vec2::new(x as f32, y as f32) / 8.0
                });
                if chart.triangles.is_empty() {
                    chart.size = [4, 4];
                }
                chart
            })
            .collect();
        let texels = lifted(&mesh, &charts);
        for point in texels.iter().flat_map(|t| t.lift.iter().flatten()) {
            prop_assert!(point.weights().iter().all(|w| (-1e-6..=1.0).contains(w)), "{point:?}");
        }
        let mut values = shade(&mesh, &texels, smooth);
        let report = stitch(&mesh, &charts, &texels, &mut values, 1, &StitchOptions::default()).unwrap();
        prop_assert_eq!(report.unsolved, 0);
        prop_assert!(values.iter().flatten().all(|v| v.is_finite()));
        prop_assert!(!report.seam_after.rms.is_nan() && !report.vertex_after.rms.is_nan());
    }
}
