//! What the file stores beside the codes: the images of each layer, quantized as they are written, and how a viewer
//! shows a point from codes and images.

use lightkiln_encode::{AtlasView, Form, LightCode, Table, Texels, decode};
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
    if max_error * layer.scale.error_unit() < 2.5 / 255.0 { PngDepth::Sixteen } else { PngDepth::Eight }
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
            StoredLayer { channels: layer.layer.channels, depth, pages: pages.collect(), table: None }
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
            first += layer.channels;
        }
    }

    /// What a single code shows.
    pub fn show_code(&self, views: &[AtlasView<'_>], codes: impl Fn(usize) -> LightCode, out: &mut [f32]) {
        self.show(views, |layer| [codes(layer); 3], [0.0, 0.0], out);
    }
}
