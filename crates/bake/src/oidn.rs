//! Texels through Open Image Denoise: the charts of a round side by side on one sheet.
//!
//! The sheet is not the atlas: every chart stands in a frame of its own light, wide enough that no window of the error
//! estimate sees two charts and that the network sees no edge where a chart ends. What it sees of other charts lies
//! behind two frames.
//!
//! Harmonics beyond the first are filtered as shares of the first, which is filtered before them.

use glam::Vec3;
use lightkiln_light::Estimates;
use lightkiln_light::denoise::Denoised;
use lightkiln_light::oidn::{Lightmap, OidnError, denoise, find, image};
use lightkiln_texel::ChartTexels;
use lightkiln_texel::fill::push_pull;

use crate::BakeError;
use crate::layers::{Layers, NoisyLayer, UnitLight};

/// Texels around each chart that continue its light.
const FRAME: u32 = 8;

/// Colors of a texel.
const RGB: usize = 3;

impl From<OidnError> for BakeError {
    fn from(error: OidnError) -> Self {
        match error {
            OidnError::Missing { .. } => Self::NoDenoiser {
                why: error.to_string(),
                remedy: "install Open Image Denoise 2 (https://www.openimagedenoise.org), or name its library in the \
                         environment variable LIGHTKILN_OIDN, or choose --denoiser own",
            },
            OidnError::Version { .. } => Self::NoDenoiser {
                why: error.to_string(),
                remedy: "install version 2 (https://www.openimagedenoise.org), or name its library in the environment \
                         variable LIGHTKILN_OIDN, or choose --denoiser own",
            },
            OidnError::NoMemory { .. } => Self::DenoiserFailed {
                why: error.to_string(),
                remedy: "choose --denoiser own, which works on charts of any size, or ask for less: a larger --detail",
            },
            OidnError::Failed { .. } => {
                Self::DenoiserFailed { why: error.to_string(), remedy: "choose --denoiser own" }
            }
        }
    }
}

/// Whether the library is there.
///
/// # Errors
/// [`BakeError::NoDenoiser`].
pub fn check() -> Result<(), BakeError> {
    Ok(find()?)
}

/// The light of the texels with a lift, chart after chart.
///
/// # Errors
/// [`BakeError::NoDenoiser`], [`BakeError::DenoiserFailed`].
pub fn texels(
    layers: &Layers,
    texels: &[ChartTexels],
    normals: Vec<Vec3>,
    estimates: &Estimates,
) -> Result<UnitLight, BakeError> {
    let sheet = Sheet::new(texels, |i| estimates.valid(i));
    layers.filtered_light(normals, estimates, |noisy| sheet.denoise(noisy))
}

/// A chart's place on the sheet, with its frame.
struct Place {
    origin: [u32; 2],
    size: [u32; 2],
}

/// Charts side by side.
struct Sheet {
    size: [u32; 2],
    places: Vec<Place>,
    /// The texel of each point.
    texels: Vec<usize>,
    /// Whether a point knows its own light.
    known: Vec<bool>,
}

impl Sheet {
    /// Lays charts out in rows of falling height, about as wide as high.
    ///
    /// - `valid`: of a point: whether it lies outside other geometry
    fn new(texels: &[ChartTexels], valid: impl Fn(usize) -> bool) -> Self {
        let framed = |t: &ChartTexels| t.size.map(|s| s + 2 * FRAME);
        let area: u64 = texels.iter().map(framed).map(|[w, h]| u64::from(w) * u64::from(h)).sum();
        let widest = texels.iter().map(|t| framed(t)[0]).max().unwrap_or(0);
        let width = widest.max((area as f64).sqrt().ceil() as u32);
        let mut order: Vec<usize> = (0..texels.len()).collect();
        order.sort_by_key(|&chart| std::cmp::Reverse(texels[chart].size[1]));
        let mut places: Vec<Place> =
            texels.iter().map(|t| Place { origin: [0; 2], size: framed(t) }).collect();
        let (mut x, mut y, mut row) = (0, 0, 0);
        for chart in order {
            let [own_width, own_height] = places[chart].size;
            if x + own_width > width {
                (x, y, row) = (0, y + row, 0);
            }
            places[chart].origin = [x, y];
            (x, row) = (x + own_width, row.max(own_height));
        }
        let mut sheet = Self { size: [width, y + row], places, texels: Vec::new(), known: Vec::new() };
        for (chart, t) in texels.iter().enumerate() {
            let first = sheet.texels.len();
            for (texel, _) in t.lift.iter().enumerate().filter(|(_, lift)| lift.is_some()) {
                let [i, j] = [texel as u32 % t.size[0], texel as u32 / t.size[0]];
                sheet.known.push(valid(sheet.texels.len()));
                sheet.texels.push(sheet.texel(chart, [i + FRAME, j + FRAME]));
            }
            // A chart that lies inside other geometry as a whole keeps the light that it has.
            if !sheet.known[first..].contains(&true) {
                sheet.known[first..].fill(true);
            }
        }
        sheet
    }

    /// The texel of the sheet at a place within a chart's frame.
    fn texel(&self, chart: usize, [i, j]: [u32; 2]) -> usize {
        let [x, y] = self.places[chart].origin;
        (y + j) as usize * self.size[0] as usize + (x + i) as usize
    }

    /// Filters a layer; points x channels.
    fn denoise(&self, noisy: NoisyLayer<'_>) -> Result<Denoised, BakeError> {
        let texels = self.size[0] as usize * self.size[1] as usize;
        let (mut values, mut variances) = (image(self.size)?, image(self.size)?);
        let mut halves = [image(self.size)?, image(self.size)?];
        let own_halves = noisy.halves.expect("texels are measured in halves");
        let (mut lit, mut measured) = (vec![false; texels], vec![false; texels]);
        let channel = |color: usize| color.min(noisy.channels - 1);
        let unit = |at: usize| noisy.first.map_or(1.0, |first| first[at]);
        for (i, (&texel, &known)) in self.texels.iter().zip(&self.known).enumerate() {
            for color in 0..RGB {
                let at = i * noisy.channels + channel(color);
                values[texel * RGB + color] = noisy.values[at] / unit(at);
                for (half, own) in halves.iter_mut().zip(own_halves) {
                    half[texel * RGB + color] = own[at] / unit(at);
                }
                variances[texel * RGB + color] = noisy.variances[at] / unit(at).powi(2);
            }
            let are_finite = |all: &[f32]| all[texel * RGB..(texel + 1) * RGB].iter().all(|x| x.is_finite());
            lit[texel] = known && are_finite(&values) && halves.iter().all(|half| are_finite(half));
            measured[texel] = lit[texel] && are_finite(&variances);
        }
        halves.iter_mut().for_each(|half| self.fill(half, &lit));
        let filtered = denoise(Lightmap {
            size: self.size,
            halves: halves.each_ref().map(Vec::as_slice),
            values: &values,
            variances: &variances,
            measured: &measured,
            directional: noisy.first.is_some(),
        })?;
        let mut denoised = Denoised { values: noisy.values.to_vec(), variances: noisy.variances.to_vec() };
        for (i, &texel) in self.texels.iter().enumerate() {
            for channel in 0..noisy.channels {
                let (at, from) = (i * noisy.channels + channel, texel * RGB + channel);
                // Where there is no light it comes from nowhere.
                if unit(at) > 0.0 {
                    denoised.values[at] = filtered.values[from] * unit(at);
                    denoised.variances[at] = filtered.variances[from] * unit(at).powi(2);
                }
            }
        }
        Ok(denoised)
    }

    /// Continues the light of each chart into its frame, and all frames into what is left.
    fn fill(&self, values: &mut [f32], lit: &[bool]) {
        let mut covered = vec![false; lit.len()];
        for (chart, place) in self.places.iter().enumerate() {
            let [width, height] = place.size;
            let texels: Vec<usize> =
                (0..width * height).map(|k| self.texel(chart, [k % width, k / width])).collect();
            let own: Vec<bool> = texels.iter().map(|&texel| lit[texel]).collect();
            let mut light: Vec<f32> =
                texels.iter().flat_map(|&texel| &values[texel * RGB..(texel + 1) * RGB]).copied().collect();
            if push_pull(place.size, RGB, &mut light, &own) {
                for (&texel, light) in texels.iter().zip(light.chunks_exact(RGB)) {
                    values[texel * RGB..(texel + 1) * RGB].copy_from_slice(light);
                    covered[texel] = true;
                }
            }
        }
        if !push_pull(self.size, RGB, values, &covered) {
            values.fill(0.0);
        }
    }
}

#[cfg(test)]
mod tests {
    use lightkiln_mesh::{SurfacePoint, TriangleId};

    use super::*;

    /// A chart whose texels are lifted where `lifted` says so.
    fn chart(size: [u32; 2], lifted: impl Fn(u32, u32) -> bool) -> ChartTexels {
        let point = SurfacePoint { triangle: TriangleId(0), barycentric: [0.2, 0.2] };
        let lift =
            (0..size[0] * size[1]).map(|k| lifted(k % size[0], k / size[0]).then_some(point)).collect();
        ChartTexels { size, lift, ..ChartTexels::default() }
    }

    #[test]
    fn sheet_gives_every_lifted_texel_a_place_and_every_chart_a_frame() {
        let charts: Vec<ChartTexels> =
            [[4, 8], [32, 4], [8, 8], [4, 4], [20, 12]].map(|size| chart(size, |i, j| i + j > 0)).into();
        let sheet = Sheet::new(&charts, |_| true);
        let mut texels = sheet.texels.clone();
        texels.sort_unstable();
        texels.dedup();
        assert_eq!(texels.len(), charts.iter().map(ChartTexels::shown).sum::<usize>());
        for (a, p) in sheet.places.iter().enumerate() {
            assert!((0..2).all(|k| p.origin[k] + p.size[k] <= sheet.size[k]), "chart {a} leaves the sheet");
            for (b, q) in sheet.places.iter().enumerate().skip(a + 1) {
                let apart = |k: usize| {
                    p.origin[k] + p.size[k] <= q.origin[k] || q.origin[k] + q.size[k] <= p.origin[k]
                };
                assert!(apart(0) || apart(1), "charts {a} and {b} meet");
            }
        }
    }

    #[test]
    fn sheet_frames_charts_with_their_own_light() {
        let charts = [chart([8, 8], |i, _| i < 4), chart([8, 4], |_, _| true), chart([4, 4], |_, _| false)];
        // The first point is inside other geometry, and so is the whole second chart.
        let sheet = Sheet::new(&charts, |i| (1..32).contains(&i));
        assert!(!sheet.known[0] && sheet.known[1..].iter().all(|known| *known));
        let texels = (sheet.size[0] * sheet.size[1]) as usize;
        let (mut values, mut lit) = (vec![f32::NAN; texels * RGB], vec![false; texels]);
        for (i, &texel) in sheet.texels.iter().enumerate() {
            lit[texel] = sheet.known[i];
            values[texel * RGB..(texel + 1) * RGB].fill(if i < 32 { 1.0 } else { 3.0 });
        }
        sheet.fill(&mut values, &lit);
        assert!(values.iter().all(|v| (1.0..=3.0).contains(v)));
        for (chart, light) in [(0, 1.0), (1, 3.0)] {
            let [width, height] = sheet.places[chart].size;
            let all = (0..width * height).map(|k| values[RGB * sheet.texel(chart, [k % width, k / width])]);
            assert!(all.into_iter().all(|v| (v - light).abs() < 1e-5), "chart {chart}");
        }
        let empty = Sheet::new(&[], |_| true);
        empty.fill(&mut [], &[]);
    }
}
