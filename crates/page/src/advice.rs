//! What to change to get smaller, or closer to the light: rules over the figures of a report.
//!
//! Each piece of advice says what it is worth in bytes, and what it is known from. What was measured is told apart
//! from what is an estimate; a rule that has nothing to say, or that would save less than [`WORTH_SAYING`] of the
//! light, keeps silent.

use lightkiln_report::errors::{BINS, bin_range};
use lightkiln_report::table::count;
use lightkiln_report::{Report, bytes_text};

/// Savings below this share of the light's bytes are not worth a line.
pub const WORTH_SAYING: f64 = 0.03;

/// One thing to change.
#[derive(Clone, Debug, PartialEq)]
pub struct Advice {
    /// Bytes that it saves, about; none where it costs some or cannot be told.
    pub saves: Option<u64>,
    /// What to do.
    pub what: String,
    /// The numbers behind it.
    pub why: String,
}

/// The error up to which a scalar layer has texels of 16 bits: half a step of 8 bits is then more than a fifth of it.
const EIGHT_BITS_FROM: f32 = 2.5 / 255.0;

/// Everything that the figures suggest, the largest saving first.
pub fn advice(report: &Report) -> Vec<Advice> {
    let rules = [
        larger_detail,
        larger_bound,
        eight_bits,
        level_zero,
        unused_texels,
        seams,
        fallback,
        largest,
        vertices_enough,
        coarse_texels,
    ];
    let mut all: Vec<Advice> = rules.iter().filter_map(|rule| rule(report)).collect();
    let least = (report.bytes.total as f64 * WORTH_SAYING) as u64;
    all.retain(|a| a.saves.is_none_or(|bytes| bytes > least));
    all.sort_by_key(|a| std::cmp::Reverse(a.saves));
    all
}

fn texel_bytes(report: &Report) -> u64 {
    report.bytes.light.atlas + report.bytes.light.mips
}

fn percent(part: u64, whole: u64) -> f64 {
    if whole == 0 { 0.0 } else { 100.0 * part as f64 / whole as f64 }
}

fn larger_detail(report: &Report) -> Option<Advice> {
    let texels = texel_bytes(report);
    let detail = report.settings.detail * std::f32::consts::SQRT_2;
    (texels > 0).then(|| Advice {
        saves: Some(texels / 2),
        what: format!("keep less detail: --detail {} instead of {}", digits(detail), digits(report.settings.detail)),
        why: format!(
            "texels take {} ({:.0} % of the light) and are as many as the square of 1 / detail: a detail larger by the root \
             of 2 halves them. Estimate: it takes the same triangles for texture.",
            bytes_text(texels),
            percent(texels, report.bytes.total)
        ),
    })
}

/// The edge between bins that is nearest to a bound, and the shares of the points whose error is at least that and at
/// least twice that: bins are half a doubling wide.
fn shares_beyond(histogram: &[u32; BINS], bound: f32) -> Option<(f32, [f64; 2])> {
    let distance = |&bin: &usize| (bin_range(bin)[0] / bound).log2().abs();
    let bin = (1..BINS - 2).min_by(|a, b| distance(a).total_cmp(&distance(b)))?;
    let total: u32 = histogram.iter().sum();
    let share = |from: usize| {
        histogram.iter().skip(from).map(|&n| f64::from(n)).sum::<f64>() / f64::from(total.max(1))
    };
    (distance(&bin) <= 0.5 && total > 0).then(|| (bin_range(bin)[0], [share(bin), share(bin + 2)]))
}

fn larger_bound(report: &Report) -> Option<Advice> {
    let bound = report.settings.max_error;
    let histogram = report.errors.least_squares.as_ref()?.histogram?;
    let (edge, [now, then]) = shares_beyond(&histogram, bound)?;
    let texels = texel_bytes(report);
    if texels == 0 || now <= 0.0 || then >= now {
        return None;
    }
    Some(Advice {
        saves: Some((texels as f64 * (1.0 - then / now)) as u64),
        what: format!("allow twice the error: --max-error {}", digits(2.0 * bound)),
        why: format!(
            "vertex values alone err by more than {} at {:.2} % of the fresh points and by more than {} at {:.2} %. \
             Estimate: texels shrink as these shares do.",
            digits(edge),
            100.0 * now,
            digits(2.0 * edge),
            100.0 * then
        ),
    })
}

/// A number of three digits, as a command line takes it.
fn digits(value: f32) -> String {
    if value <= 0.0 || !value.is_finite() {
        return value.to_string();
    }
    let decimals = (2 - value.log10().floor() as i32).max(0) as usize;
    let text = format!("{value:.decimals$}");
    match text.contains('.') {
        true => text.trim_end_matches('0').trim_end_matches('.').to_owned(),
        false => text,
    }
}

fn eight_bits(report: &Report) -> Option<Advice> {
    // Where light is logarithmic the limit lies elsewhere, and the report does not say where.
    let is_linear = ["ao", "ambientOcclusion", "shadow"].contains(&report.settings.signal.as_str());
    if !is_linear || report.atlas.bits != 16 || report.settings.max_error >= EIGHT_BITS_FROM {
        return None;
    }
    Some(Advice {
        saves: Some(texel_bytes(report) / 2),
        what: "allow an error of 1 %: --max-error 0.01".to_owned(),
        why: format!(
            "texels have 16 bits because half a step of 8 bits (0.2 %) would be more than a fifth of the bound of {:.2} %. \
             From {:.2} % on they have 8.",
            100.0 * report.settings.max_error,
            100.0 * EIGHT_BITS_FROM
        ),
    })
}

fn level_zero(report: &Report) -> Option<Advice> {
    let mips = report.bytes.light.mips;
    (mips > 0).then(|| Advice {
        saves: Some(mips),
        what: "upload the atlas without mip levels".to_owned(),
        why: format!(
            "a full chain takes {} and is counted in, so that the comparison with a lightmap is fair. The file's sampler asks \
             for none; where the scene is not seen from afar none is needed.",
            bytes_text(mips)
        ),
    })
}

fn unused_texels(report: &Report) -> Option<Advice> {
    let (waste, atlas) = (report.bytes.atlas_waste, report.bytes.light.atlas);
    if percent(waste, atlas) < 30.0 || report.atlas.charts == 0 {
        return None;
    }
    let mean = report.atlas.shown_texels / report.atlas.charts as u64;
    Some(Advice {
        saves: None,
        what: "look at what the charts are made of".to_owned(),
        why: format!(
            "{} of the atlas's {} ({:.0} %) hold no light. Its {} charts have {mean} texels on average, and each owns whole \
             blocks of 4 x 4; small charts come from small or broken pieces of surface.",
            bytes_text(waste),
            bytes_text(atlas),
            percent(waste, atlas),
            count(report.atlas.charts as u64)
        ),
    })
}

fn seams(report: &Report) -> Option<Advice> {
    let (drawn, light) = (report.scene.gltf_vertices as u64, report.scene.light_vertices as u64);
    if drawn == 0 || light * 3 > drawn * 2 {
        return None;
    }
    let saves = (report.bytes.light.attribute as f64 * (1.0 - light as f64 / drawn as f64)) as u64;
    Some(Advice {
        saves: Some(saves),
        what: "weld the vertices of the input".to_owned(),
        why: format!(
            "{} glTF vertices stand at {} places with a normal of their own, and each carries the light's 4 bytes a layer. At \
             most this is saved: vertices that differ in texture coordinates have to stay.",
            count(drawn),
            count(light)
        ),
    })
}

fn fallback(report: &Report) -> Option<Advice> {
    let bytes = report.bytes.fallback;
    (bytes > 0).then(|| Advice {
        saves: Some(bytes),
        what: "leave the fallback away: --fallback none".to_owned(),
        why: format!(
            "COLOR_0 takes {} of the file, which the total above does not count. Viewers that do not know the extension show \
             no light then.",
            bytes_text(bytes)
        ),
    })
}

fn largest(report: &Report) -> Option<Advice> {
    let first = report.bytes.largest.first()?;
    let share = percent(first.bytes, report.bytes.total);
    (share >= 40.0 && report.bytes.largest.len() > 1).then(|| Advice {
        saves: None,
        what: format!("look at {} first", first.name),
        why: format!(
            "it takes {} of {} ({share:.0} %), of that {} in texels.",
            bytes_text(first.bytes),
            bytes_text(report.bytes.total),
            bytes_text(first.texel_bytes)
        ),
    })
}

fn vertices_enough(report: &Report) -> Option<Advice> {
    let least = report.errors.least_squares.as_ref()?;
    let saved = report.bytes.total.checked_sub(report.bytes.vertices_only).filter(|&b| b > 0)?;
    (least.points > 0 && least.p99 < 2.0 * report.settings.max_error).then(|| Advice {
        saves: Some(saved),
        what: format!("go without texels: --max-error {}", digits(least.p99)),
        why: format!(
            "vertex values alone err by at most {:.3} at 99 % of the fresh points and by at most {:.3} anywhere among them; \
             they cost {}. At that bound nearly all triangles show them.",
            least.p99,
            least.max,
            bytes_text(report.bytes.vertices_only)
        ),
    })
}

/// The one rule that asks for more bytes: where the light is not what was promised.
fn coarse_texels(report: &Report) -> Option<Advice> {
    let bound = &report.errors.bound;
    let share = percent(bound.texture_points_beyond as u64, bound.texture_points as u64);
    (share >= 1.0).then(|| Advice {
        saves: None,
        what: format!("to be closer to the light: --detail {}", digits(report.settings.detail / 2.0)),
        why: format!(
            "{share:.1} % of the fresh points in texture triangles lie beyond the bound, because texels are too coarse there. \
             Half the detail costs about four times their {}.",
            bytes_text(texel_bytes(report))
        ),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn digits_are_three_at_any_size() {
        assert_eq!(
            [0.000_551, 0.03, 0.060_000_1, 1.0, 1234.5].map(digits),
            ["0.000551", "0.03", "0.06", "1", "1234"]
        );
        assert_eq!(digits(0.0), "0");
    }

    #[test]
    fn shares_beyond_a_bound_are_those_of_the_nearest_edge() {
        let mut histogram = [0; BINS];
        histogram[10] = 60; // from 0.022 on
        histogram[11] = 30; // from 0.031 on
        histogram[13] = 10; // from 0.0625 on
        assert_eq!(shares_beyond(&histogram, 0.03), Some((0.031_25, [0.4, 0.1])));
        assert_eq!(shares_beyond(&histogram, 1e-6), None);
        assert_eq!(shares_beyond(&[0; BINS], 0.03), None);
    }
}
