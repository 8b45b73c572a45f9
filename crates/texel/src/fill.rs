//! Push-pull: fills what is not covered from what is, by a pyramid of averages (dilation in Schaefer 2012,
//! section 4.2; the pyramid is that of Gortler et al. 1996, section 3.4).

/// One level of the pyramid.
struct Level {
    size: [usize; 2],
    values: Vec<f32>,
    /// 0 = nothing known, 1 = known.
    weights: Vec<f32>,
}

/// Fills all uncovered texels of a grid; covered ones keep their bits.
///
/// - `values`: `size[0] x size[1] x channels`; uncovered entries are ignored and may hold anything
/// - returns: `false` if nothing is covered (then nothing is changed)
///
/// Uncovered texels near covered ones take about their average, distant ones an average of farther ones.
/// Memory: a third more than the values.
pub fn push_pull(size: [u32; 2], channels: usize, values: &mut [f32], covered: &[bool]) -> bool {
    if !covered.iter().any(|&c| c) {
        return false;
    }
    if covered.iter().all(|&c| c) {
        return true;
    }
    let size = size.map(|s| s as usize);
    let weights: Vec<f32> = covered.iter().map(|&c| if c { 1.0 } else { 0.0 }).collect();
    let mut levels: Vec<Level> = Vec::new();
    let mut next = pull(size, channels, values, &weights);
    while next.size != [1, 1] && next.weights.iter().any(|&w| w < 1.0) {
        let above = pull(next.size, channels, &next.values, &next.weights);
        levels.push(next);
        next = above;
    }
    levels.push(next);
    for k in (1..levels.len()).rev() {
        let (fine, coarse) = levels.split_at_mut(k);
        let fine = &mut fine[k - 1];
        push(&coarse[0], channels, fine.size, &mut fine.values, &fine.weights);
    }
    push(&levels[0], channels, size, values, &weights);
    true
}

/// Averages blocks of 2 x 2 by weight.
fn pull(size: [usize; 2], channels: usize, values: &[f32], weights: &[f32]) -> Level {
    let half = size.map(|s| s.div_ceil(2));
    let mut out = Level {
        size: half,
        values: vec![0.0; half[0] * half[1] * channels],
        weights: vec![0.0; half[0] * half[1]],
    };
    for j in 0..size[1] {
        for i in 0..size[0] {
            let texel = j * size[0] + i;
            let weight = weights[texel];
            if weight > 0.0 {
                let parent = (j / 2) * half[0] + i / 2;
                out.weights[parent] += weight;
                for c in 0..channels {
                    out.values[parent * channels + c] += weight * values[texel * channels + c];
                }
            }
        }
    }
    for (parent, weight) in out.weights.iter_mut().enumerate() {
        if *weight > 0.0 {
            for value in &mut out.values[parent * channels..(parent + 1) * channels] {
                *value /= *weight;
            }
            *weight = weight.min(1.0);
        }
    }
    out
}

/// Completes a level from the complete one above it, by bilinear interpolation.
fn push(coarse: &Level, channels: usize, size: [usize; 2], values: &mut [f32], weights: &[f32]) {
    // The parent's two columns (rows) that surround a column (row), the nearer one first: weights 3/4 and 1/4.
    let around = |k: usize, count: usize| {
        let near = k / 2;
        let far = if k.is_multiple_of(2) { near.saturating_sub(1) } else { (near + 1).min(count - 1) };
        (near, far)
    };
    for j in 0..size[1] {
        let (near_row, far_row) = around(j, coarse.size[1]);
        for i in 0..size[0] {
            let texel = j * size[0] + i;
            let weight = weights[texel];
            if weight >= 1.0 {
                continue;
            }
            let (near, far) = around(i, coarse.size[0]);
            for c in 0..channels {
                let at =
                    |row: usize, column: usize| coarse.values[(row * coarse.size[0] + column) * channels + c];
                let above = 0.75 * (0.75 * at(near_row, near) + 0.25 * at(near_row, far))
                    + 0.25 * (0.75 * at(far_row, near) + 0.25 * at(far_row, far));
                let value = &mut values[texel * channels + c];
                *value = if weight > 0.0 { weight * *value + (1.0 - weight) * above } else { above };
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn push_pull_constant_stays_constant() {
        let mut values = vec![f32::NAN; 13 * 7 * 2];
        let mut covered = vec![false; 13 * 7];
        for texel in [0, 40, 41, 90] {
            covered[texel] = true;
            values[texel * 2] = 0.25;
            values[texel * 2 + 1] = -3.0;
        }
        assert!(push_pull([13, 7], 2, &mut values, &covered));
        for pair in values.chunks(2) {
            assert!((pair[0] - 0.25).abs() < 1e-6 && (pair[1] + 3.0).abs() < 1e-5, "{pair:?}");
        }
    }

    #[test]
    fn push_pull_keeps_covered_bits_and_stays_within_range() {
        let values: Vec<f32> = (0..64).map(|k| (k * 37 % 64) as f32 / 63.0).collect();
        let covered: Vec<bool> = (0..64).map(|k| k % 3 == 0).collect();
        let mut filled = values.clone();
        push_pull([8, 8], 1, &mut filled, &covered);
        for k in 0..64 {
            assert!(!covered[k] || filled[k] == values[k]);
            assert!((0.0..=1.0).contains(&filled[k]));
        }
    }

    #[test]
    fn push_pull_without_cover_changes_nothing() {
        let mut values = vec![7.0; 6];
        assert!(!push_pull([3, 2], 1, &mut values, &[false; 6]));
        assert_eq!(values, [7.0; 6]);
        assert!(!push_pull([0, 0], 1, &mut [], &[]));
    }
}
