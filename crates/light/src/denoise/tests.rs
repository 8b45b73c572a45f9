//! What the filter leaves of noise on surfaces whose light is known, and what it says of its errors.

use lightkiln_mesh::random;

use super::*;

/// About normally distributed with variance 1: the sum of twelve uniform numbers.
fn noise(key: u64) -> f32 {
    (0..12).map(|k| random::unit(random::hash(key, k, 1, 2))).sum::<f32>() - 6.0
}

/// Jittered points of the unit square, `n` x `n`.
fn square(n: u64) -> Vec<Vec3> {
    (0..n * n)
        .map(|i| {
            let [x, y] = random::unit2(random::hash(3, i, 0, 0));
            Vec3::new((i % n) as f32 + x, (i / n) as f32 + y, 0.0) / n as f32
        })
        .collect()
}

struct Case {
    positions: Vec<Vec3>,
    normals: Vec<Vec3>,
    truth: Vec<f32>,
    values: Vec<f32>,
    variances: Vec<f32>,
    channels: usize,
}

impl Case {
    fn new(
        positions: Vec<Vec3>,
        normal: impl Fn(Vec3) -> Vec3,
        truth: impl Fn(Vec3) -> f32,
        sigma: impl Fn(Vec3) -> f32,
        channels: usize,
    ) -> Self {
        let normals = positions.iter().map(|&p| normal(p)).collect();
        let each = |f: &dyn Fn(Vec3) -> f32| -> Vec<f32> {
            positions.iter().flat_map(|&p| std::iter::repeat_n(f(p), channels)).collect()
        };
        let (truth, sigmas) = (each(&truth), each(&sigma));
        let values = truth.iter().zip(&sigmas).enumerate().map(|(i, (t, s))| t + s * noise(i as u64));
        let (values, variances) = (values.collect(), sigmas.iter().map(|s| s * s).collect());
        Self { positions, normals, truth, values, variances, channels }
    }

    fn denoise(&self, radius: f32) -> Denoised {
        denoise(
            Noisy {
                positions: &self.positions,
                normals: &self.normals,
                values: &self.values,
                variances: &self.variances,
                channels: self.channels,
            },
            radius,
        )
    }

    /// Root mean square of the errors, that of the errors expected, and the share of errors within two of these.
    fn judge(&self, denoised: &Denoised, which: impl Fn(Vec3) -> bool) -> [f32; 3] {
        let (mut error, mut expected, mut covered, mut count) = (0.0, 0.0, 0.0, 0.0);
        for (i, value) in denoised.values.iter().enumerate() {
            if which(self.positions[i / self.channels]) {
                let square = (value - self.truth[i]).powi(2);
                error += square;
                expected += denoised.variances[i];
                covered += f32::from(u8::from(square <= 4.0 * denoised.variances[i]));
                count += 1.0;
            }
        }
        [(error / count).sqrt(), (expected / count).sqrt(), covered / count]
    }
}

fn inner(p: Vec3) -> bool {
    p.truncate().min_element() > 0.05 && p.truncate().max_element() < 0.95
}

const N: u64 = 200;
const RADIUS: f32 = 4.0 / N as f32;

fn flat(truth: impl Fn(Vec3) -> f32, sigma: f32, channels: usize) -> Case {
    Case::new(square(N), |_| Vec3::Z, truth, |_| sigma, channels)
}

#[test]
fn denoise_even_light_leaves_the_noise_of_a_mean_of_its_neighbours() {
    for channels in 1..=3 {
        for slope in [0.0, 1.0] {
            let case = flat(|p| slope * p.x, 0.2, channels);
            let [error, expected, covered] = case.judge(&case.denoise(RADIUS), inner);
            // 50 neighbours with weights 1 - d^2 count as 3/4 of them.
            assert!(error < 0.2 / 37_f32.sqrt() * 1.15, "{channels}, {slope}: {error}");
            assert!((1.0..1.3).contains(&(expected / error)), "{channels}, {slope}: {expected} {error}");
            assert!(covered > 0.95, "{channels}, {slope}: {covered}");
        }
    }
}

#[test]
fn denoise_of_outliers_that_know_it_leaves_no_spots() {
    let mut case = flat(|_| 0.5, 0.01, 1);
    for i in (0..case.values.len()).step_by(97) {
        case.values[i] += 3.0;
        case.variances[i] = 4.0;
    }
    let denoised = case.denoise(RADIUS);
    let worst = denoised.values.iter().map(|v| (v - 0.5).abs()).fold(0.0, f32::max);
    assert!(worst < 0.03, "{worst}");
}

#[test]
fn denoise_keeps_hard_edges_and_covers_truth() {
    let edge = |p: Vec3| p.x + 0.3 * p.y - 0.6;
    for (sigma, most) in [(0.02, 0.4), (0.1, 0.4), (0.25, 1.25)] {
        let case = flat(|p| f32::from(u8::from(edge(p) > 0.0)), sigma, 1);
        let denoised = case.denoise(RADIUS);
        let near = |p: Vec3| inner(p) && edge(p).abs() < 1.0 / N as f32;
        let [error, _, _] = case.judge(&denoised, near);
        assert!(error < most * sigma, "sigma {sigma}: {error} beside the edge");
        let [_, _, covered] = case.judge(&denoised, inner);
        assert!(covered > 0.95, "sigma {sigma}: {covered}");
    }
}

#[test]
fn denoise_of_soft_edges_and_spots_covers_truth() {
    let spot = |p: Vec3| (-1000.0 * (p - Vec3::new(0.5, 0.5, 0.0)).length_squared()).exp();
    let soft = |p: Vec3| ((p.x - 0.5) * 20.0).clamp(0.0, 1.0);
    let steep = |p: Vec3| 5.0 * p.x;
    let cases: [(&str, &dyn Fn(Vec3) -> f32); 3] = [("spot", &spot), ("soft", &soft), ("steep", &steep)];
    for (name, truth) in cases {
        for sigma in [0.02, 0.1] {
            let case = flat(truth, sigma, 3);
            let [error, _, covered] = case.judge(&case.denoise(RADIUS), inner);
            assert!(covered > 0.95 && error < 0.35 * sigma, "{name} at {sigma}: {covered}, {error}");
        }
    }
    // The hard case of the module's page: the filter must not make things worse, nor hide much.
    let waves = |p: Vec3| 0.5 + 0.5 * (40.0 * p.x).sin() * (40.0 * p.y).cos();
    for sigma in [0.01, 0.05] {
        let case = flat(waves, sigma, 1);
        let [error, expected, covered] = case.judge(&case.denoise(RADIUS), inner);
        assert!(
            error < 1.05 * sigma && error < 1.4 * expected && covered > 0.85,
            "{error} {expected} {covered}"
        );
    }
}

#[test]
fn denoise_mixes_neither_across_a_crease_nor_between_sheets() {
    // A floor in the light and a wall in the dark, meeting at x = 0; noise so large that light cannot tell.
    let mut positions = square(N);
    positions.extend(square(N).iter().map(|p| Vec3::new(0.0, p.y, p.x)));
    let wall = |p: Vec3| p.x == 0.0;
    let normal = |p: Vec3| if wall(p) { Vec3::X } else { Vec3::Z };
    let light = |p: Vec3| if wall(p) { 0.45 } else { 0.55 };
    let case = Case::new(positions, normal, light, |_| 0.2, 1);
    let denoised = case.denoise(RADIUS);
    for side in [0.45, 0.55] {
        let along: Vec<usize> = (0..case.truth.len())
            .filter(|&i| case.truth[i] == side && case.positions[i].x + case.positions[i].z < RADIUS / 2.0)
            .collect();
        let mean = along.iter().map(|&i| denoised.values[i]).sum::<f32>() / along.len() as f32;
        assert!((mean - side).abs() < 0.02, "{mean} for {side}");
    }
    // Two sheets, a fifth of a spacing apart, that look away from each other.
    let gap = 0.2 / N as f32;
    let mut positions = square(N);
    positions.extend(square(N).iter().map(|&p| p - gap * Vec3::Z));
    let below = |p: Vec3| p.z < 0.0;
    let normal = |p: Vec3| if below(p) { Vec3::NEG_Z } else { Vec3::Z };
    let case = Case::new(positions, normal, |p| if below(p) { 0.45 } else { 0.55 }, |_| 0.2, 1);
    let [error, _, covered] = case.judge(&case.denoise(RADIUS), inner);
    assert!(error < 0.045 && covered > 0.95, "{error} {covered}");
}

#[test]
fn denoise_leaves_alone_points_as_they_are_and_fills_those_without_light() {
    let mut case = flat(|_| 0.5, 0.1, 2);
    case.positions.push(Vec3::new(7.0, 7.0, 7.0));
    case.normals.push(Vec3::Y);
    case.values.extend([3.0, 4.0]);
    case.variances.extend([0.5, 0.25]);
    let dark = (N * N / 2 + N / 2) as usize;
    case.values[2 * dark..2 * dark + 2].fill(-9.0);
    case.variances[2 * dark..2 * dark + 2].fill(f32::INFINITY);
    let broken = (N * N / 3) as usize;
    case.values[2 * broken] = f32::NAN;
    let denoised = case.denoise(RADIUS);
    let count = case.positions.len();
    assert_eq!(denoised.values[2 * count - 2..], [3.0, 4.0]);
    assert_eq!(denoised.variances[2 * count - 2..], [0.5, 0.25]);
    assert!((denoised.values[2 * dark] - 0.5).abs() < 0.1 && denoised.variances[2 * dark] < 0.003);
    assert!(denoised.values[2 * broken].is_nan());
    assert_eq!(denoised.values.iter().filter(|v| v.is_nan()).count(), 1);
}

#[test]
fn denoise_of_nothing_or_of_one_place_is_finite() {
    let none = Noisy { positions: &[], normals: &[], values: &[], variances: &[], channels: 1 };
    assert!(denoise(none, 1.0).values.is_empty());
    let one = Noisy {
        positions: &[Vec3::ONE; 50],
        normals: &[Vec3::ZERO; 50],
        values: &[1.0; 50],
        variances: &[0.0; 50],
        channels: 1,
    };
    for radius in [0.0, 1e-30, 1.0, f32::INFINITY, f32::NAN] {
        assert_eq!(denoise(one, radius), Denoised { values: vec![1.0; 50], variances: vec![0.0; 50] });
    }
}

#[test]
fn denoise_does_not_depend_on_threads() {
    let case = flat(|p| (9.0 * p.x).sin(), 0.3, 3);
    let run = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| case.denoise(RADIUS))
    };
    assert_eq!(run(1), run(3));
}
