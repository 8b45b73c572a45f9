//! What the file stores beside the codes: the images of each layer, quantized as they are written, and how a viewer
//! shows a point from codes and images.

use lightkiln_encode::{
    AtlasView, Coordinates, Form, LightCode, Table, Texels, clamp, decode, decode_coordinates,
};
use lightkiln_light::{Curve, Scale};
use lightkiln_scene::{Profile, srgb};
use lightkiln_texel::image::quantize;
use lightkiln_texel::{Atlas, PngDepth};

use crate::BakeError;
use crate::layers::{BakedLayer, Layers};

/// What the numbers of a page stand for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Encoding {
    /// Unit values.
    Unit,
    /// Light as a share of an intensity, in the file as sRGB, which a GPU turns linear before it filters: the form of
    /// MOZ_lightmap.
    Srgb {
        /// The light of a texel of 1, in the unit of the layer.
        intensity: f32,
        /// What unit values mean.
        scale: Scale,
    },
}

impl Encoding {
    /// What a lookup filters, of a number of the image.
    pub fn from_image(self, number: f32) -> f32 {
        match self {
            Self::Unit => number,
            Self::Srgb { .. } => srgb::linear(number),
        }
    }

    /// The number of the image, of what a lookup filters.
    pub fn to_image(self, texel: f32) -> f32 {
        match self {
            Self::Unit => texel,
            Self::Srgb { .. } => srgb::encoded(texel),
        }
    }

    /// The unit value of what a lookup gives.
    #[inline]
    pub fn unit(self, looked_up: f32) -> f32 {
        match self {
            Self::Unit => looked_up,
            Self::Srgb { intensity, scale } => scale.to_unit(looked_up * intensity),
        }
    }

    /// What a lookup filters, of a unit value.
    fn texel(self, unit: f32) -> f32 {
        match self {
            Self::Unit => unit,
            Self::Srgb { intensity, scale } => scale.from_unit(unit) / intensity,
        }
    }
}

/// The images of one layer.
#[derive(Clone, Debug)]
pub struct StoredLayer {
    /// Its channels.
    pub channels: usize,
    /// Bits of a stored number.
    pub depth: PngDepth,
    /// Pages, each row-major, with 1 or 3 numbers a texel as a lookup filters them, from whole steps of the depth.
    pub pages: Vec<Vec<f32>>,
    /// What these numbers stand for.
    pub encoding: Encoding,
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
    /// What corners say where no shader reads codes, in plain profiles.
    pub coordinates: Option<Coordinates>,
}

impl StoredLayer {
    /// A page as the file has it: the numbers of its image, `0..=1`.
    pub fn image(&self, page: usize) -> Vec<f32> {
        self.pages[page].iter().map(|&texel| self.encoding.to_image(texel)).collect()
    }

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

/// 8 bits are enough while half of their step is at most a fifth of the bound. Viewers without our shader know no others.
fn depth_of(layer: &BakedLayer, max_error: f32, profile: Profile) -> PngDepth {
    let wide = max_error * layer.error_unit() < 2.5 / 255.0;
    if wide && !profile.is_plain() { PngDepth::Sixteen } else { PngDepth::Eight }
}

/// Bytes of a texel on the GPU over all layers, before there is an atlas.
pub fn expected_texel_bytes(layers: &Layers, max_error: f32, profile: Profile) -> u64 {
    layers.layers.iter().map(|l| texel_bytes(l.layer.channels, depth_of(l, max_error, profile))).sum()
}

impl Stored {
    /// Quantizes an atlas of all channels, layer by layer, as the image writer does.
    pub fn new(atlas: &Atlas, layers: &Layers, max_error: f32, profile: Profile) -> Self {
        let coordinates = match profile {
            Profile::Eta | Profile::Texcoord => None,
            Profile::Stock => Some(Coordinates::with_strip(atlas.size)),
            Profile::Lightmap => Some(Coordinates::plain(atlas.size)),
        };
        let all = layers.channels();
        let of_layer = |layer: &BakedLayer| {
            let depth = depth_of(layer, max_error, profile);
            let steps = match depth {
                PngDepth::Eight => 255,
                PngDepth::Sixteen => 65535,
            };
            let stored = |value: f32| quantize(value, steps) as f32 / steps as f32;
            let padding = stored_channels(layer.layer.channels) - layer.layer.channels;
            let units = |page: &Vec<f32>| -> Vec<f32> {
                let own = |texel: &[f32]| -> Vec<f32> {
                    let own = texel[layer.channels()].iter().copied();
                    own.chain(std::iter::repeat_n(0.0, padding)).collect()
                };
                page.chunks_exact(all).flat_map(own).collect()
            };
            let mut pages: Vec<Vec<f32>> = atlas.pages.iter().map(units).collect();
            let encoding = encoding_of(layer, profile, &pages);
            for value in pages.iter_mut().flatten() {
                *value = encoding.from_image(stored(encoding.to_image(encoding.texel(*value))));
            }
            if let Some(coordinates) = coordinates.filter(|c| c.strip.is_some()) {
                pages.resize(pages.len().max(1), Vec::new());
                pages.iter_mut().for_each(|page| page.extend(coordinates.strip_texels()));
            }
            let (channels, clamp) = (layer.layer.channels, layer.unit_clamp());
            StoredLayer { channels, depth, pages, encoding, table: None, clamp }
        };
        let size = coordinates.map_or(atlas.size, |c| c.size);
        Self { size, layers: layers.layers.iter().map(of_layer).collect(), coordinates }
    }

    /// Texels of all pages of a layer.
    pub fn texels(&self) -> u64 {
        let pages = self.layers.first().map_or(0, |layer| layer.pages.len()) as u64;
        pages * u64::from(self.size[0]) * u64::from(self.size[1])
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
        if let Some(coordinates) = &self.coordinates {
            let corners = codes(0).map(|code| coordinates.of(code));
            return self.show_at(views, coordinates, corners, barycentric, out);
        }
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

    /// The same, from the coordinates of the corners.
    pub fn show_at(
        &self,
        views: &[AtlasView<'_>],
        coordinates: &Coordinates,
        corners: [[u16; 2]; 3],
        barycentric: [f32; 2],
        out: &mut [f32],
    ) {
        let corners = corners.map(|corner| coordinates.position(corner));
        let mut first = 0;
        for (layer, view) in self.layers.iter().zip(views) {
            let own = &mut out[first..first + layer.channels];
            decode_coordinates(corners, barycentric, view, own);
            own.iter_mut().for_each(|value| *value = layer.encoding.unit(*value));
            first += layer.channels;
        }
    }
}

/// Light without an upper end is stored for viewers as a share of the brightest texel; all else in unit values.
fn encoding_of(layer: &BakedLayer, profile: Profile, pages: &[Vec<f32>]) -> Encoding {
    match (profile, layer.scale.curve) {
        (Profile::Lightmap, Curve::Log { white }) => {
            let brightest = pages.iter().flatten().fold(0.0, |most: f32, &unit| most.max(unit));
            let intensity = layer.scale.from_unit(brightest);
            let intensity = if intensity > 0.0 { intensity } else { white };
            Encoding::Srgb { intensity, scale: layer.scale }
        }
        _ => Encoding::Unit,
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
        let stored = Stored::new(&atlas, &layers, 0.03, Profile::Eta);
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
