//! The light of a baked file, read back as a viewer reads it: codes, atlas, and the settings of the bake.

use lightkiln_encode::{AtlasView, LightCode, Texels, decode_scalar};
use lightkiln_mesh::{SurfacePoint, TriangleId};
use lightkiln_scene::Scene;
use serde::{Deserialize, Serialize};

use crate::BakeError;

/// What the extension says beside the images: how the light was baked, so that it can be judged.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "camelCase")]
pub struct Extension {
    /// Version of the extension.
    pub version: u64,
    /// Program and version.
    pub generator: String,
    /// Width and height of a page in texels, absent without texture triangles.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub page_size: Option<[u32; 2]>,
    /// Steps of an atlas position per texel.
    pub subtexels: u32,
    /// The bound.
    pub max_error: f32,
    /// Smallest feature kept, in units of the file.
    pub detail: f32,
    /// Width of a texel, in units of the file.
    pub texel_size: f32,
    /// Seed of the bake.
    pub seed: u64,
    /// At least one in a file that was read.
    pub layers: Vec<LayerInfo>,
}

/// What the extension says about a layer.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "camelCase")]
pub struct LayerInfo {
    /// What the values are.
    pub signal: String,
    /// Numbers of a value, 1 to 3.
    pub channels: usize,
    /// How values lie between the ends of the range: `linear` or `log`.
    pub curve: String,
    /// Smallest and largest value.
    pub range: [f32; 2],
    /// Unit of the range.
    pub unit: String,
    /// Rays ended here, in units of the file; absent if nowhere.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub distance: Option<f32>,
}

/// The light of a baked file.
pub struct FileLight {
    /// What the extension says.
    pub extension: Extension,
    /// Per triangle of the light mesh.
    codes: Vec<[LightCode; 3]>,
    pages: Vec<Vec<f32>>,
    size: [u32; 2],
    /// Bits of a texel in the file.
    pub bits: u32,
}

impl FileLight {
    /// Reads the light of a baked scene and decodes its atlas.
    ///
    /// `file` is the name for messages.
    ///
    /// # Errors
    /// [`BakeError::NotBaked`] for a file without our extension, [`BakeError::ReadBack`] for one whose parts do
    /// not fit each other, and errors of the readers.
    pub fn read(scene: &Scene, file: &str) -> Result<Self, BakeError> {
        let Some(lightmap) = scene.read_lightmap()? else {
            return Err(BakeError::NotBaked { file: file.to_owned() });
        };
        let faulty = |what: String| BakeError::ReadBack { what };
        let extension: Extension = serde_json::from_value(lightmap.extension)
            .map_err(|e| faulty(format!("the extension of {file}: {e}")))?;
        let [layer] = &lightmap.layers[..] else {
            return Err(faulty(format!("{} layers of light in {file}", lightmap.layers.len())));
        };
        let mut codes = Vec::with_capacity(scene.parts.iter().map(|p| p.triangles.len()).sum());
        for (number, (part, light)) in scene.parts.iter().zip(&layer.parts).enumerate() {
            if light.len() != part.triangles.len() {
                return Err(faulty(format!(
                    "part {number} (node {}) has light for {} of {} triangles",
                    part.node,
                    light.len(),
                    part.triangles.len()
                )));
            }
            codes.extend(light.iter().map(|corners| corners.map(LightCode)));
        }
        let size = extension.page_size.unwrap_or_default();
        let (mut pages, mut bits) = (Vec::new(), 8);
        for page in &layer.pages {
            let image = lightkiln_texel::read_png(&page.png)?;
            if image.size != size || image.channels != 1 {
                return Err(faulty(format!(
                    "a page of {:?} texels and {} channels where the extension says {size:?} and 1",
                    image.size, image.channels
                )));
            }
            bits = image.bits;
            pages.push(image.values);
        }
        Ok(Self { extension, codes, pages, size, bits })
    }

    /// The atlas as a lookup reads it.
    ///
    /// # Errors
    /// [`BakeError::Encode`] for pages that do not have their size; `read` has checked that.
    pub fn view(&self) -> Result<AtlasView<'_>, BakeError> {
        let pages = self.pages.iter().map(|page| Texels::F32(page)).collect();
        Ok(AtlasView::new(self.size, 1, pages)?)
    }

    /// Where the rays of the light ended.
    pub fn distance(&self) -> f32 {
        self.extension.layers.first().and_then(|l| l.distance).unwrap_or(f32::INFINITY)
    }

    /// Pages of the atlas.
    pub fn pages(&self) -> usize {
        self.pages.len()
    }

    /// The codes of a triangle's corners.
    pub fn codes(&self, triangle: TriangleId) -> [LightCode; 3] {
        self.codes[triangle.index()]
    }

    /// Whether a triangle reads all of its light from the atlas.
    pub fn is_texture(&self, triangle: TriangleId) -> bool {
        self.codes(triangle).iter().all(|code| !code.is_color())
    }

    /// What a GPU shows at a point.
    pub fn show(&self, view: &AtlasView<'_>, point: SurfacePoint) -> f32 {
        decode_scalar(self.codes(point.triangle), point.barycentric, view)
    }
}
