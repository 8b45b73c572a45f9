//! The fitting error of a triangle, Schaefer 2012, eq. 5, and what follows from it.
//!
//! Deviation: the paper compares the largest error with the threshold. A maximum over noisy samples exceeds any
//! threshold once there are enough of them, so each error is taken with its uncertainty, and a triangle whose
//! samples do not yet decide stays open until more rays have been traced.

/// What is known of a triangle.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Verdict {
    /// Every sample keeps the bound, noise included: vertex values are enough.
    Color,
    /// Some sample breaks the bound by more than its noise: needs texture.
    Texture,
    /// Noise decides; more rays would tell.
    Open,
}

/// What is wrong with the arrays of [`Residuals`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum ClassifyError {
    /// The arrays per sample differ in length, or from the last triangle start.
    #[error("{errors} errors, {sigmas} sigmas, {valid} valid flags and {samples} samples of triangles")]
    Lengths {
        /// Number of errors.
        errors: usize,
        /// Number of sigmas.
        sigmas: usize,
        /// Number of flags.
        valid: usize,
        /// The last triangle start, 0 if there is none.
        samples: usize,
    },
    /// The triangle starts descend, do not begin at zero, or are empty.
    #[error("start of triangle {triangle} is below the one before it, or not zero at first")]
    Starts {
        /// The triangle.
        triangle: usize,
    },
}

/// How far the fitted vertex values are from the samples, and how well that is known.
#[derive(Clone, Copy, Debug)]
pub struct Residuals<'a> {
    /// First sample of each triangle, and the number of samples at the end: T + 1 entries.
    pub triangle_starts: &'a [u32],
    /// `|f(p) - I(p)|` per sample, the largest over channels, at least 0 (Schaefer eq. 5).
    pub errors: &'a [f32],
    /// Standard deviation of each error's noise, at least 0.
    pub sigmas: &'a [f32],
    /// False for samples that do not count, as those inside other geometry.
    pub valid: &'a [bool],
}

impl<'a> Residuals<'a> {
    /// Checks that the arrays fit each other.
    ///
    /// # Errors
    /// [`ClassifyError`] if they do not.
    pub fn new(
        triangle_starts: &'a [u32],
        errors: &'a [f32],
        sigmas: &'a [f32],
        valid: &'a [bool],
    ) -> Result<Self, ClassifyError> {
        if triangle_starts.first() != Some(&0) {
            return Err(ClassifyError::Starts { triangle: 0 });
        }
        if let Some(before) = triangle_starts.windows(2).position(|w| w[0] > w[1]) {
            return Err(ClassifyError::Starts { triangle: before + 1 });
        }
        let samples = triangle_starts.last().map_or(0, |&n| n as usize);
        if [errors.len(), sigmas.len(), valid.len()] != [samples; 3] {
            let (errors, sigmas, valid) = (errors.len(), sigmas.len(), valid.len());
            return Err(ClassifyError::Lengths { errors, sigmas, valid, samples });
        }
        Ok(Self { triangle_starts, errors, sigmas, valid })
    }

    /// The valid samples of each triangle as `(error, sigma)`.
    fn triangles(&self) -> impl Iterator<Item = impl Iterator<Item = (f32, f32)> + '_> + '_ {
        self.triangle_starts.windows(2).map(|w| {
            (w[0] as usize..w[1] as usize)
                .filter(|&i| self.valid[i])
                .map(|i| (self.errors[i], self.sigmas[i]))
        })
    }
}

/// Decides each triangle.
///
/// - `bound`: the largest error allowed, in units of the signal
/// - `confidence`: how many standard deviations a decision must hold against, at least 0; 0 is the paper's rule
/// - returns: T verdicts. A triangle without valid samples is a color triangle; an error or sigma that is not a
///   number leaves its triangle open.
///
/// # Panics
/// If the arrays do not fit each other: see [`Residuals::new`].
pub fn classify(residuals: &Residuals<'_>, bound: f32, confidence: f32) -> Vec<Verdict> {
    let verdict = |samples: &mut dyn Iterator<Item = (f32, f32)>| {
        let mut verdict = Verdict::Color;
        for (error, sigma) in samples {
            let noise = confidence * sigma;
            if error - noise > bound {
                return Verdict::Texture;
            }
            let keeps = error + noise <= bound;
            if !keeps {
                verdict = Verdict::Open;
            }
        }
        verdict
    };
    residuals.triangles().map(|mut samples| verdict(&mut samples)).collect()
}

/// `E(T)` of Schaefer eq. 5: the largest error among the valid samples of each triangle, 0 if it has none.
///
/// # Panics
/// If the arrays do not fit each other: see [`Residuals::new`].
pub fn errors(residuals: &Residuals<'_>) -> Vec<f32> {
    residuals.triangles().map(|samples| samples.fold(0.0, |largest, (error, _)| error.max(largest))).collect()
}

#[cfg(test)]
mod tests {
    use super::Verdict::{Color, Open, Texture};
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn classify_error_against_noise_decides() {
        // One sample per triangle; the last but one is invalid, the last triangle has none.
        let starts = [0, 1, 2, 3, 4, 5, 5];
        let errors = [0.010, 0.029, 0.031, 0.050, 9.0];
        let sigmas = [0.005, 0.005, 0.005, 0.005, 0.0];
        let valid = [true, true, true, true, false];
        let r = Residuals::new(&starts, &errors, &sigmas, &valid).unwrap();
        assert_eq!(classify(&r, 0.03, 2.0), [Color, Open, Open, Texture, Color, Color]);
        assert_eq!(classify(&r, 0.03, 0.0), [Color, Color, Texture, Texture, Color, Color]);
        assert_eq!(super::errors(&r), [0.010, 0.029, 0.031, 0.050, 0.0, 0.0]);
    }

    #[test]
    fn classify_bound_itself_is_kept() {
        let r = Residuals::new(&[0, 1], &[0.25], &[0.0], &[true]).unwrap();
        assert_eq!(classify(&r, 0.25, 2.0), [Color]);
    }

    #[test]
    fn classify_noise_alone_stays_open() {
        // The signal is fitted exactly; a hundred noisy samples with sigma 0.02 exceed 0.03 here and there.
        let noise = |i: u32| {
            let h = |c| lightkiln_mesh::random::unit(lightkiln_mesh::random::hash(1, u64::from(i), c, 0));
            0.02 * ((0..12).map(h).sum::<f32>() - 6.0)
        };
        let errors: Vec<f32> = (0..100).map(|i| noise(i).abs()).collect();
        assert!(errors.iter().any(|&e| e > 0.03));
        let sigmas = vec![0.02; 100];
        let r = Residuals::new(&[0, 100], &errors, &sigmas, &[true; 100]).unwrap();
        assert_eq!(classify(&r, 0.03, 0.0), [Texture]);
        assert_eq!(classify(&r, 0.03, 3.0), [Open]);
    }

    #[test]
    fn classify_not_a_number_stays_open() {
        let r = Residuals::new(&[0, 2], &[f32::NAN, 0.0], &[0.0, 0.0], &[true; 2]).unwrap();
        assert_eq!(classify(&r, 0.03, 2.0), [Open]);
    }

    #[test]
    fn residuals_that_do_not_fit_are_an_error() {
        assert!(matches!(Residuals::new(&[], &[], &[], &[]), Err(ClassifyError::Starts { triangle: 0 })));
        assert!(matches!(
            Residuals::new(&[0, 2, 1], &[0.0], &[0.0], &[true]),
            Err(ClassifyError::Starts { triangle: 2 })
        ));
        assert!(matches!(
            Residuals::new(&[0, 2], &[0.0], &[0.0], &[true]),
            Err(ClassifyError::Lengths { samples: 2, errors: 1, .. })
        ));
        assert_eq!(classify(&Residuals::new(&[0], &[], &[], &[]).unwrap(), 0.0, 0.0), []);
    }

    proptest! {
        #![proptest_config(ProptestConfig { cases: 64, ..ProptestConfig::default() })]

        #[test]
        fn classify_bound_and_confidence_are_monotone(
            samples in prop::collection::vec((0.0_f32..0.1, 0.0_f32..0.02, any::<bool>()), 0..12),
            bound in 0.0_f32..0.1, more in 0.0_f32..0.05, confidence in 0.0_f32..3.0,
        ) {
            let errors: Vec<f32> = samples.iter().map(|s| s.0).collect();
            let sigmas: Vec<f32> = samples.iter().map(|s| s.1).collect();
            let valid: Vec<bool> = samples.iter().map(|s| s.2).collect();
            let starts = [0, samples.len() as u32];
            let r = Residuals::new(&starts, &errors, &sigmas, &valid).unwrap();
            let rank = |v: Verdict| match v { Color => 0, Open => 1, Texture => 2 };
            let here = classify(&r, bound, confidence)[0];
            prop_assert!(rank(classify(&r, bound + more, confidence)[0]) <= rank(here));
            let surer = classify(&r, bound, confidence + more * 20.0)[0];
            prop_assert!(surer == here || surer == Open);
        }
    }
}
