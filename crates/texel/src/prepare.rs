//! What each texel's shaded value is worth, before texels are solved for: invalid ones are filled, those beyond
//! the end of the surface extrapolated.

use crate::fill::push_pull;
use crate::lift::{ChartTexels, Outside, centre};
use glam::{DMat3, DVec3, Vec2};

/// How a texel came by its value.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Trust {
    /// Shaded at its centre, inside the chart.
    Centre,
    /// Shaded at its centre, on the surface beyond the border.
    Beyond,
    /// Extrapolated from its neighbours: the surface ends before its centre.
    Extrapolated,
    /// Filled from its neighbours (also: not shown at all).
    Filled,
}

/// A texel's point that is not its centre: the lookup there is known.
#[derive(Clone, Copy, Debug)]
pub(crate) struct End {
    pub at: Vec2,
    pub weight: f32,
}

/// The shaded texels of a chart.
pub(crate) struct Shaded {
    pub trust: Vec<Trust>,
    /// Per texel, about 1; empty: all 1.
    pub confidence: Vec<f32>,
    pub ends: Vec<End>,
    /// Ends x channels.
    pub end_values: Vec<f32>,
    pub filled: usize,
    pub unfilled: usize,
}

/// Texels from which an extrapolation is made: this far in both axes.
const WINDOW: i64 = 2;

/// Sorts the texels of a chart by trust, fills and extrapolates; slices have been checked.
pub(crate) fn prepare(
    texels: &ChartTexels,
    values: &mut [f32],
    channels: usize,
    valid: Option<&[bool]>,
    variances: Option<&[f32]>,
) -> Shaded {
    let count = texels.len();
    let good = |texel: usize, values: &[f32]| {
        texels.lift[texel].is_some()
            && valid.is_none_or(|v| v[texel])
            && values[texel * channels..(texel + 1) * channels].iter().all(|v| v.is_finite())
    };
    let mut trust: Vec<Trust> =
        (0..count).map(|t| if good(t, values) { Trust::Centre } else { Trust::Filled }).collect();
    let confidence = variances.map_or(Vec::new(), |v| confidence(v, &trust));
    let mut shaded = Shaded {
        trust: Vec::new(),
        confidence,
        ends: Vec::new(),
        end_values: Vec::new(),
        filled: 0,
        unfilled: 0,
    };
    let mut ending: Vec<Outside> = Vec::new();
    for &outside in &texels.outside {
        let texel = outside.texel as usize;
        if trust[texel] != Trust::Centre {
            continue;
        }
        if outside.reached {
            trust[texel] = Trust::Beyond;
        } else {
            trust[texel] = Trust::Extrapolated;
            let weight = shaded.confidence.get(texel).copied().unwrap_or(1.0);
            shaded.ends.push(End { at: outside.at, weight });
            shaded.end_values.extend_from_slice(&values[texel * channels..(texel + 1) * channels]);
            ending.push(outside);
        }
    }
    extrapolate(texels, values, channels, &trust, &ending, &shaded.end_values);
    let covered: Vec<bool> = trust.iter().map(|&t| t != Trust::Filled).collect();
    let missing = (0..count).filter(|&t| texels.lift[t].is_some() && !covered[t]).count();
    if missing > 0 && push_pull(texels.size, channels, values, &covered) {
        shaded.filled = missing;
    } else {
        shaded.unfilled = missing;
        // Nothing to fill from: keep what was shaded, and let no NaN out.
        values.iter_mut().filter(|v| !v.is_finite()).for_each(|v| *v = 0.0);
    }
    shaded.trust = trust;
    shaded
}

/// Inverse variances relative to the mean, within a factor of 10.
fn confidence(variances: &[f32], trust: &[Trust]) -> Vec<f32> {
    let known = |v: f32| if v.is_finite() && v > 0.0 { v } else { 0.0 };
    let used = || variances.iter().zip(trust).filter(|(_, t)| **t == Trust::Centre).map(|(&v, _)| known(v));
    let mean = used().map(f64::from).sum::<f64>() as f32 / used().count().max(1) as f32;
    let weight = |v: f32| if mean > 0.0 { (mean / known(v).max(0.1 * mean)).clamp(0.1, 10.0) } else { 1.0 };
    variances.iter().map(|&v| weight(v)).collect()
}

/// Gives each ending texel the value that a plane through the shaded points around it has at its centre.
fn extrapolate(
    texels: &ChartTexels,
    values: &mut [f32],
    channels: usize,
    trust: &[Trust],
    ending: &[Outside],
    end_values: &[f32],
) {
    let size = texels.size;
    let mut found = vec![0.0_f32; ending.len() * channels];
    let mut right = vec![DVec3::ZERO; channels];
    for (k, end) in ending.iter().enumerate() {
        let c = centre(size, end.texel);
        let mut matrix = DMat3::ZERO;
        right.fill(DVec3::ZERO);
        let mut add = |at: Vec2, value: &[f32]| {
            let d = (at - c).as_dvec2();
            let weight = (-0.5 * d.length_squared()).exp();
            let basis = DVec3::new(1.0, d.x, d.y);
            matrix += DMat3::from_cols(basis * basis.x, basis * basis.y, basis * basis.z) * weight;
            for (right, &value) in right.iter_mut().zip(value) {
                *right += basis * (weight * f64::from(value));
            }
        };
        let (i, j) = (i64::from(end.texel % size[0]), i64::from(end.texel / size[0]));
        for y in (j - WINDOW).max(0)..=(j + WINDOW).min(i64::from(size[1]) - 1) {
            for x in (i - WINDOW).max(0)..=(i + WINDOW).min(i64::from(size[0]) - 1) {
                let texel = y as usize * size[0] as usize + x as usize;
                match trust[texel] {
                    Trust::Centre | Trust::Beyond => {
                        add(centre(size, texel as u32), &values[texel * channels..(texel + 1) * channels]);
                    }
                    Trust::Extrapolated => {
                        if let Ok(other) = ending.binary_search_by_key(&(texel as u32), |e| e.texel) {
                            add(ending[other].at, &end_values[other * channels..(other + 1) * channels]);
                        }
                    }
                    Trust::Filled => {}
                }
            }
        }
        // Where all points lie on one line, the plane is level across it.
        let ridge = 1e-7 * matrix.x_axis.x;
        matrix.y_axis.y += ridge;
        matrix.z_axis.z += ridge;
        let inverse = matrix.inverse();
        for channel in 0..channels {
            let fitted = (inverse * right[channel]).x as f32;
            let clamped = end_values[k * channels + channel];
            found[k * channels + channel] = if fitted.is_finite() { fitted } else { clamped };
        }
    }
    for (end, found) in ending.iter().zip(found.chunks(channels.max(1))) {
        values[end.texel as usize * channels..][..channels].copy_from_slice(found);
    }
}
