//! What the file stores beside the codes: the images of each layer, quantized as they are written, and how a viewer
//! shows a point from codes and images.

use lightkiln_encode::{AtlasView, Form, LightCode, Table, Texels, clamp, decode};
use lightkiln_texel::image::quantize;
use lightkiln_texel::{Atlas, PngDepth};

use crate::BakeError;
use crate::layers::{BakedLayer, Layers};

/// The images of one layer.
#[derive(Clone, Debug)]
pub struct StoredLayer {
    /// Its channels.
    pub channels: usize,
    /// Bits of a stored number.
    pub depth: PngDepth,
    /// Pages, each row-major, with 1 or 3 numbers a texel in whole steps of the depth.
    pub pages: Vec<Vec<f32>>,
    /// The colors that codes name, if they do.
    pub table: Option<Table>,
    /// What is clamped to after interpolation, in unit values.
    pub clamp: Option<[f32; 2]>,
}

/// The images of all layers.
#[derive(Clone, Debug)]
pub struct Stored {
    /// Width and height of a page.
    pub size: [u32; 2],
    /// In the order of the attributes.
    pub layers: Vec<StoredLayer>,
}

impl StoredLayer {
    /// Numbers of a texel: 1, or 3 for two and three channels.
    pub fn stored_channels(&self) -> usize {
        stored_channels(self.channels)
    }

    /// Bits of a stored number.
    pub fn bits(&self) -> u32 {
        match self.depth {
            PngDepth::Eight => 8,
            PngDepth::Sixteen => 16,
        }
    }

    /// Bytes of a texel on the GPU, which has no texels of three numbers.
    pub fn texel_bytes(&self) -> u64 {
        texel_bytes(self.channels, self.depth)
    }

    /// Bytes of the table on the GPU.
    pub fn table_bytes(&self) -> u64 {
        let texels = |table: &Table| table.image().0.map(u64::from).iter().product::<u64>();
        let texel = if self.stored_channels() == 1 { 1 } else { 4 };
        self.table.as_ref().map_or(0, |table| texels(table) * texel)
    }

    fn view(&self, size: [u32; 2]) -> Result<AtlasView<'_>, BakeError> {
        let pages = self.pages.iter().map(|page| Texels::F32(page)).collect();
        Ok(AtlasView::new(size, self.stored_channels() as u32, pages)?)
    }

    fn form(&self) -> Form<'_> {
        self.table.as_ref().map_or_else(|| Form::packed(self.channels), Form::Table)
    }
}

fn stored_channels(channels: usize) -> usize {
    if channels == 1 { 1 } else { 3 }
}

fn texel_bytes(channels: usize, depth: PngDepth) -> u64 {
    let numbers = if channels == 1 { 1 } else { 4 };
    match depth {
        PngDepth::Eight => numbers,
        PngDepth::Sixteen => numbers * 2,
    }
}

/// 8 bits are enough while half of their step is at most a fifth of the bound.
fn depth_of(layer: &BakedLayer, max_error: f32) -> PngDepth {
    if max_error * layer.error_unit() < 2.5 / 255.0 { PngDepth::Sixteen } else { PngDepth::Eight }
}

/// Bytes of a texel on the GPU over all layers, before there is an atlas.
pub fn expected_texel_bytes(layers: &Layers, max_error: f32) -> u64 {
    layers.layers.iter().map(|l| texel_bytes(l.layer.channels, depth_of(l, max_error))).sum()
}

impl Stored {
    /// Quantizes an atlas of all channels, layer by layer, as the image writer does.
    pub fn new(atlas: &Atlas, layers: &Layers, max_error: f32) -> Self {
        let all = layers.channels();
        let of_layer = |layer: &BakedLayer| {
            let depth = depth_of(layer, max_error);
            let steps = match depth {
                PngDepth::Eight => 255,
                PngDepth::Sixteen => 65535,
            };
            let padding = stored_channels(layer.layer.channels) - layer.layer.channels;
            let texel = |texel: &[f32]| -> Vec<f32> {
                let own = texel[layer.channels()].iter().map(|&v| quantize(v, steps) as f32 / steps as f32);
                own.chain(std::iter::repeat_n(0.0, padding)).collect()
            };
            let pages = atlas.pages.iter().map(|page| page.chunks_exact(all).flat_map(texel).collect());
            let (channels, clamp) = (layer.layer.channels, layer.unit_clamp());
            StoredLayer { channels, depth, pages: pages.collect(), table: None, clamp }
        };
        Self { size: atlas.size, layers: layers.layers.iter().map(of_layer).collect() }
    }

    /// Bytes of a texel on the GPU, over all layers.
    pub fn texel_bytes(&self) -> u64 {
        self.layers.iter().map(StoredLayer::texel_bytes).sum()
    }

    /// The atlas of each layer as a lookup reads it.
    ///
    /// # Errors
    /// [`BakeError::Encode`] for pages that do not have their size.
    pub fn views(&self) -> Result<Vec<AtlasView<'_>>, BakeError> {
        self.layers.iter().map(|layer| layer.view(self.size)).collect()
    }

    /// What a GPU shows at a point of a triangle, in unit values of all layers.
    ///
    /// - `views`: of [`Self::views`]
    /// - `codes`: of the triangle's corners in each layer
    pub fn show(
        &self,
        views: &[AtlasView<'_>],
        codes: impl Fn(usize) -> [LightCode; 3],
        barycentric: [f32; 2],
        out: &mut [f32],
    ) {
        let mut first = 0;
        for (number, (layer, view)) in self.layers.iter().zip(views).enumerate() {
            let own = &mut out[first..first + layer.channels];
            decode(codes(number), barycentric, view, &layer.form(), own);
            if let Some(ends) = layer.clamp {
                own.iter_mut().for_each(|value| *value = clamp(*value, ends));
            }
            first += layer.channels;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use lightkiln_light::{Layer, Scale};

    #[test]
    fn stored_clamp_after_interpolation_is_the_clamp_of_what_is_interpolated() {
        let layers = Layers::of(vec![BakedLayer {
            layer: Layer::scalar("ambientOcclusion"),
            scale: Scale::linear(-0.25, 1.25),
            clamp: Some([0.0, 1.0]),
            first: 0,
        }]);
        let atlas = Atlas {
            size: [4, 4],
            channels: 1,
            pages: vec![vec![0.05; 16]],
            owners: vec![vec![0]],
            texels: 16,
            shown: 16,
            gutter: 0,
        };
        let stored = Stored::new(&atlas, &layers, 0.03);
        let views = stored.views().expect("whole pages");
        let mut free = stored.clone();
        free.layers[0].clamp = None;
        let place = LightCode::texture([2.0, 2.0]).expect("in range");
        let (mut low, mut high) = (0, 0);
        for codes in [[0.0, 0.5, 1.0].map(LightCode::color), [LightCode::color(0.1), place, place]] {
            for step in 0..=10 {
                let at = [step as f32 / 20.0, step as f32 / 20.0];
                let (mut shown, mut wide) = ([0.0], [0.0]);
                stored.show(&views, |_| codes, at, &mut shown);
                free.show(&views, |_| codes, at, &mut wide);
                let ends = [0.0, 1.0].map(|x| layers.to_unit(0, x));
                assert_eq!(shown[0], wide[0].clamp(ends[0], ends[1]));
                low += usize::from(wide[0] < ends[0]);
                high += usize::from(wide[0] > ends[0]);
            }
        }
        assert!(low > 0 && high > 0);
    }
}
