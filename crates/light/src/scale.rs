//! What a stored value means: the way from a signal's own numbers to `0..=1` and back.
//!
//! Everything after the rays works in these *unit* values: the fit, the bound, the texels and the codes, and the
//! GPU interpolates them. A bounded signal is scaled linearly. Light has no upper end, and 3 % of its largest value
//! would leave nothing of the shadows; it goes through a logarithmic curve, in which equal steps look about equal:
//!
//! ```text
//! P(x) = sign(x) ln(1 + 15 |x| / white) / ln(16)
//! ```
//!
//! White maps to 1. Below white / 15 the curve is about linear and above logarithmic, as the transfer curve of a
//! display; what is brighter than white goes on above 1. An error bound is a share of the way from black to white:
//! 3 % allow 0.6 % of white in black, 17 % of the value at white / 15, and 9 % at white and above.

/// How light becomes a perceived value.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Curve {
    /// As it is.
    Linear,
    /// Logarithmic, see the [module](self).
    Log {
        /// The value that a display shows as white, above 0.
        white: f32,
    },
}

/// Where the logarithmic curve bends: at `white / KNEE`.
pub const KNEE: f32 = 15.0;

/// The curve of a layer and the range that its stored values cover.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Scale {
    /// The curve.
    pub curve: Curve,
    /// The signal's value at 0.
    pub low: f32,
    /// The signal's value at 1; above `low`.
    pub high: f32,
}

impl Scale {
    /// Stored values are the signal's own.
    pub const UNIT: Self = Self { curve: Curve::Linear, low: 0.0, high: 1.0 };

    /// A linear scale.
    pub fn linear(low: f32, high: f32) -> Self {
        Self { curve: Curve::Linear, low, high }
    }

    /// A logarithmic scale.
    pub fn log(white: f32, low: f32, high: f32) -> Self {
        Self { curve: Curve::Log { white }, low, high }
    }

    /// `P(x)`: in the signal's unit for linear scales, 1 at white for logarithmic ones.
    #[inline]
    pub fn perceived(&self, x: f32) -> f32 {
        match self.curve {
            Curve::Linear => x,
            Curve::Log { white } => ((KNEE * x.abs() / white).ln_1p() / KNEE.ln_1p()).copysign(x),
        }
    }

    fn extent(&self) -> f32 {
        self.perceived(self.high) - self.perceived(self.low)
    }

    /// The stored value of a signal's value, in `0..=1` within the range and beyond it outside.
    #[inline]
    pub fn to_unit(&self, x: f32) -> f32 {
        (self.perceived(x) - self.perceived(self.low)) / self.extent()
    }

    /// The signal's value of a stored one.
    #[inline]
    pub fn from_unit(&self, unit: f32) -> f32 {
        let p = self.perceived(self.low) + unit * self.extent();
        match self.curve {
            Curve::Linear => p,
            Curve::Log { white } => ((p.abs() * KNEE.ln_1p()).exp_m1() * white / KNEE).copysign(p),
        }
    }

    /// How much the stored value changes with the signal: turns a small standard error into one of unit values.
    #[inline]
    pub fn slope(&self, x: f32) -> f32 {
        let slope = match self.curve {
            Curve::Linear => 1.0,
            Curve::Log { white } => KNEE / ((white + KNEE * x.abs()) * KNEE.ln_1p()),
        };
        slope / self.extent()
    }

    /// Unit values in one unit of error: the bound of a bake is a share of the range for linear scales, and a share
    /// of the way from black to white for logarithmic ones.
    #[inline]
    pub fn error_unit(&self) -> f32 {
        match self.curve {
            Curve::Linear => 1.0,
            Curve::Log { .. } => 1.0 / self.extent(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn scale_log_is_zero_at_black_and_one_at_white() {
        let scale = Scale::log(500.0, 0.0, 500.0);
        assert_eq!(scale.to_unit(0.0), 0.0);
        assert!((scale.to_unit(500.0) - 1.0).abs() < 1e-6);
        assert!((scale.error_unit() - 1.0).abs() < 1e-6);
        let wide = Scale::log(500.0, -8000.0, 8000.0);
        assert!((wide.to_unit(0.0) - 0.5).abs() < 1e-6);
        assert!(wide.error_unit() < 0.5);
    }

    #[test]
    fn scale_log_allows_what_the_module_says() {
        let scale = Scale::log(1.0, 0.0, 1.0);
        assert!((scale.from_unit(0.03) - 0.0058).abs() < 1e-4);
        assert!((scale.from_unit(1.03) - 1.0 - 0.093).abs() < 2e-3);
        let dim = 1.0 / KNEE;
        assert!(scale.from_unit(scale.to_unit(dim) + 0.03) / dim < 1.18);
    }

    proptest! {
        #[test]
        fn scale_round_trip_and_slope(x in -50.0_f32..50.0, white in 0.01_f32..100.0, log in any::<bool>()) {
            let scale = if log { Scale::log(white, -50.0, 50.0) } else { Scale::linear(-50.0, 50.0) };
            let unit = scale.to_unit(x);
            prop_assert!((-1e-6..=1.000_001).contains(&unit));
            prop_assert!((scale.from_unit(unit) - x).abs() < 1e-3 * (1.0 + x.abs()));
            let step = 1e-2 * (x.abs() + 0.1 * white);
            let slope = (scale.to_unit(x + step) - scale.to_unit(x - step)) / (2.0 * step);
            prop_assert!((slope / scale.slope(x) - 1.0).abs() < 0.1, "{slope} {}", scale.slope(x));
        }
    }
}
