//! The distribution of an error: what a table row needs.

use serde::{Deserialize, Serialize};

/// Bins of [`ErrorSummary::histogram`].
pub const BINS: usize = 20;

/// Where the second bin begins. Each is a factor of the root of 2 wide, the last one is open.
pub const FIRST_EDGE: f32 = 1.0 / 1024.0;

/// The errors that a bin holds: from the first number on, below the second.
pub fn bin_range(bin: usize) -> [f32; 2] {
    let edge = |bin: usize| FIRST_EDGE * 2.0_f32.powf((bin as f32 - 1.0) / 2.0);
    [if bin == 0 { 0.0 } else { edge(bin) }, if bin + 1 >= BINS { f32::INFINITY } else { edge(bin + 1) }]
}

/// Distribution of absolute errors at points that stand for equal areas.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "camelCase")]
pub struct ErrorSummary {
    /// How many points.
    pub points: usize,
    /// Root of the mean square.
    pub rmse: f32,
    /// Half of the points have at most this error.
    pub median: f32,
    /// 99 % of the points have at most this error.
    pub p99: f32,
    /// 99.9 % of the points have at most this error.
    pub p999: f32,
    /// The largest error.
    pub max: f32,
    /// Root mean square of the references' own noise, which all of the above contain.
    pub noise: f32,
    /// Points by the size of their error, see [`bin_range`].
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub histogram: Option<[u32; BINS]>,
}

impl ErrorSummary {
    /// Sums up errors (any sign) and the standard errors of their references.
    ///
    /// Errors that are not finite count as infinitely large: they must not vanish from a report.
    pub fn new(errors: impl IntoIterator<Item = (f32, f32)>) -> Self {
        let (mut sizes, mut square, mut noise) = (Vec::new(), 0.0_f64, 0.0_f64);
        for (error, sigma) in errors {
            let size = if error.is_finite() { error.abs() } else { f32::INFINITY };
            square += f64::from(size) * f64::from(size);
            noise += f64::from(sigma) * f64::from(sigma);
            sizes.push(size);
        }
        if sizes.is_empty() {
            return Self::default();
        }
        sizes.sort_unstable_by(f32::total_cmp);
        let count = sizes.len();
        Self {
            points: count,
            rmse: (square / count as f64).sqrt() as f32,
            median: quantile(&sizes, 0.5),
            p99: quantile(&sizes, 0.99),
            p999: quantile(&sizes, 0.999),
            max: sizes[count - 1],
            noise: (noise / count as f64).sqrt() as f32,
            histogram: Some(histogram(&sizes)),
        }
    }
}

/// Counts sorted sizes bin by bin.
fn histogram(sorted: &[f32]) -> [u32; BINS] {
    let below = |bin: usize| sorted.partition_point(|&size| size < bin_range(bin)[0]);
    std::array::from_fn(|bin| {
        let end = if bin + 1 == BINS { sorted.len() } else { below(bin + 1) };
        (end - below(bin)) as u32
    })
}

/// The smallest value that at least a share `q` of the sorted values do not exceed.
pub fn quantile(sorted: &[f32], q: f64) -> f32 {
    match sorted {
        [] => 0.0,
        _ => sorted[((sorted.len() as f64 * q).ceil() as usize).clamp(1, sorted.len()) - 1],
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn summary_of_known_errors_has_known_quantiles() {
        let summary = ErrorSummary::new((1..=1000).map(|i| (-(i as f32) / 1000.0, 0.01)));
        assert_eq!((summary.points, summary.median, summary.p99, summary.max), (1000, 0.5, 0.99, 1.0));
        assert_eq!(summary.p999, 0.999);
        assert!((summary.rmse - 0.5775).abs() < 1e-3 && (summary.noise - 0.01).abs() < 1e-6);
    }

    #[test]
    fn summary_counts_every_point_in_the_bin_of_its_size() {
        let sizes = [0.0, 0.0009, 0.001, 0.3, -0.3, 0.51, 7.0, f32::NAN];
        let histogram = ErrorSummary::new(sizes.map(|e| (e, 0.0))).histogram.unwrap();
        assert_eq!(histogram.iter().sum::<u32>(), 8);
        assert_eq!((histogram[0], histogram[1], histogram[BINS - 1]), (2, 1, 3));
        for (bin, &count) in histogram.iter().enumerate() {
            let [from, to] = bin_range(bin);
            assert!(count != 2 || bin == 0 || (from <= 0.3 && 0.3 < to));
            assert!(bin == 0 || from == bin_range(bin - 1)[1]);
        }
        assert_eq!(bin_range(BINS - 1), [0.5, f32::INFINITY]);
    }

    #[test]
    fn summary_with_nan_is_not_hidden() {
        assert_eq!(ErrorSummary::new([(f32::NAN, 0.0), (0.1, 0.0)]).max, f32::INFINITY);
    }

    #[test]
    fn summary_of_nothing_is_zero() {
        assert_eq!(ErrorSummary::new([]), ErrorSummary::default());
        assert_eq!(quantile(&[], 0.5), 0.0);
    }
}
