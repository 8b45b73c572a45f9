//! The light of a baked file, read back as a viewer reads it: codes, atlas, and the settings of the bake.

use std::borrow::Cow;
use std::path::Path;

use lightkiln_encode::coordinates::STRIP_ROWS;
use lightkiln_encode::{AtlasView, Coordinates, LightCode, Strip, Table};
use lightkiln_light::{Curve, Domain, Layer, Scale, Signal};
use lightkiln_mesh::{SurfacePoint, TriangleId};
use lightkiln_scene::{LayerRead, Profile, Scene};
use lightkiln_texel::{PngDepth, read_png};
use serde::{Deserialize, Serialize};

use crate::layers::{BakedLayer, Layers};
use crate::lighting::{LightOptions, seen_from};
use crate::options::Plan;
use crate::signals::Signals;
use crate::stored::{Encoding, Stored, StoredLayer};
use crate::{BakeError, Surface};

/// What the extension says beside the images: how the light was baked, so that it can be judged.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "camelCase")]
pub struct Extension {
    /// Version of the extension.
    pub version: u64,
    /// Program and version.
    pub generator: String,
    /// How the light stands in the file: the name of a [`Profile`].
    #[serde(default = "eta")]
    pub profile: String,
    /// The rows of the page that hold all values, in the profile `stock`.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub strip: Option<StripInfo>,
    /// Width and height of a page in texels, absent without texture triangles.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub page_size: Option<[u32; 2]>,
    /// Steps of an atlas position per texel, where codes hold positions.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub subtexels: Option<u32>,
    /// The bound.
    pub max_error: f32,
    /// Smallest feature kept, in units of the file.
    pub detail: f32,
    /// Width of a texel, in units of the file.
    pub texel_size: f32,
    /// Seed of the bake.
    pub seed: u64,
    /// How the light was made.
    pub bake: Recipe,
    /// At least one in a file that was read.
    pub layers: Vec<LayerInfo>,
}

/// Files of before there was a choice.
fn eta() -> String {
    Profile::Eta.name().to_owned()
}

/// Where a page holds all values.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct StripInfo {
    /// Its first row.
    pub row: u32,
    /// How many rows it has, all alike.
    pub rows: u32,
    /// The texels from 0 to 1.
    pub texels: u32,
}

impl StripInfo {
    /// What the extension says about a strip.
    pub fn new(strip: Strip) -> Self {
        Self { row: strip.row, rows: STRIP_ROWS, texels: strip.texels }
    }
}

impl Extension {
    /// What corners say, in plain profiles.
    pub fn coordinates(&self) -> Option<Coordinates> {
        let plain = self.profile.parse::<Profile>().is_ok_and(Profile::is_plain);
        let strip = self.strip.filter(|s| s.texels >= 2).map(|s| Strip { row: s.row, texels: s.texels });
        plain.then_some(Coordinates { size: self.page_size.unwrap_or([1, 1]), strip })
    }

    /// Width and rows of all pages on top of each other.
    fn stack(&self, pages: usize) -> [u32; 2] {
        let [width, height] = self.page_size.unwrap_or([1, 1]);
        [width, height * pages.max(1) as u32]
    }

    /// The codes or coordinates of a part's triangles in a layer; none where pairs of floats stand for no code.
    pub fn corners<'a>(&self, read: &'a LayerRead, part: usize) -> Option<Cow<'a, [[[u16; 2]; 3]]>> {
        if read.pairs[part].is_empty() {
            return Some(Cow::Borrowed(&read.parts[part]));
        }
        let stack = self.stack(read.pages.len());
        let channels = read.info.get("channels").and_then(serde_json::Value::as_u64);
        let is_scalar = channels == Some(1) && read.table.is_none();
        let code = |pair: [f32; 2]| LightCode::from_interop(pair, stack, is_scalar).map(|code| code.0);
        let corners = |pairs: &[[f32; 2]; 3]| Some([code(pairs[0])?, code(pairs[1])?, code(pairs[2])?]);
        read.pairs[part].iter().map(corners).collect::<Option<Vec<_>>>().map(Cow::Owned)
    }

    fn read(json: &serde_json::Value, file: &str) -> Result<Self, BakeError> {
        Self::deserialize(json)
            .map_err(|e| BakeError::ReadBack { what: format!("the extension of {file}: {e}") })
    }
}

/// How light was made: enough to trace the same again. Files are named as seen from the folder of the baked file.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "camelCase")]
pub struct Recipe {
    /// The signals, as the command line takes them.
    pub signals: String,
    /// Where rays of occlusion ended, in units of the file; absent if nowhere.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub distance: Option<f32>,
    /// Which light there was and what it met.
    #[serde(default)]
    pub light: LightOptions,
}

impl Recipe {
    /// How a plan makes light, for a file in a folder.
    pub fn new(plan: &Plan, folder: &Path) -> Self {
        Self {
            signals: plan.signals.map_files(|path| seen_from(path, folder)).to_string(),
            distance: plan.ao_distance.is_finite().then_some(plan.ao_distance),
            light: plan.light.map_files(|path| seen_from(path, folder)),
        }
    }

    /// The signals and the light, with files named as seen from here.
    ///
    /// # Errors
    /// [`BakeError::ReadBack`] for signals that this program does not know.
    pub fn read(&self, folder: &Path) -> Result<(Signals, LightOptions), BakeError> {
        let signals: Signals = self.signals.parse().map_err(|what: String| BakeError::ReadBack { what })?;
        let found = |path: &Path| folder.join(path);
        Ok((signals.map_files(found), self.light.map_files(found)))
    }

    /// Where rays of occlusion ended; infinite if nowhere.
    pub fn reach(&self) -> f32 {
        self.distance.unwrap_or(f32::INFINITY)
    }
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
    /// What counts as white, with the curve `log`.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub white: Option<f32>,
    /// What values are clamped to after interpolation, within the range.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub clamp: Option<[f32; 2]>,
    /// Unit of the range.
    pub unit: String,
    /// How texels are stored: unit values if none, or `srgb`, as shares of the intensity.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub encoding: Option<String>,
    /// The light of a texel of 1, in the unit of the range.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub intensity: Option<f32>,
}

impl LayerInfo {
    /// What the extension says about a layer of a bake.
    pub fn new(layer: &BakedLayer, encoding: Encoding) -> Self {
        let (encoding, intensity) = match encoding {
            Encoding::Unit => (None, None),
            Encoding::Srgb { intensity, .. } => (Some("srgb".to_owned()), Some(intensity)),
        };
        let (curve, white) = match layer.scale.curve {
            Curve::Linear => ("linear", None),
            Curve::Log { white } => ("log", Some(white)),
        };
        Self {
            signal: layer.layer.name.clone(),
            channels: layer.layer.channels,
            curve: curve.to_owned(),
            range: [layer.scale.low, layer.scale.high],
            white,
            clamp: layer.clamp,
            unit: if white.is_some() { "lux" } else { "none" }.to_owned(),
            encoding,
            intensity,
        }
    }

    /// What the numbers of the layer's pages stand for; none where the file says what makes no sense.
    pub fn encoding(&self, scale: Scale) -> Option<Encoding> {
        match (self.encoding.as_deref(), self.intensity) {
            (None, None) => Some(Encoding::Unit),
            (Some("srgb"), Some(intensity)) if intensity > 0.0 && intensity.is_finite() => {
                Some(Encoding::Srgb { intensity, scale })
            }
            _ => None,
        }
    }

    /// The layer whose first channel has a number among those of the bake; none where the numbers make no sense.
    fn layer(&self, first: usize) -> Option<BakedLayer> {
        let [low, high] = self.range;
        let shown = self.clamp.unwrap_or(self.range);
        let domain = match (low >= 0.0, self.curve.as_str()) {
            (_, "linear") => Domain::Bounded { low: shown[0], high: shown[1] },
            (true, _) => Domain::Hdr,
            (false, _) => Domain::SignedHdr,
        };
        let scale = match (self.curve.as_str(), self.white) {
            ("linear", _) => Scale::linear(low, high),
            ("log", Some(white)) if white > 0.0 && white.is_finite() => Scale::log(white, low, high),
            _ => return None,
        };
        let sound = (1..=3).contains(&self.channels) && low.is_finite() && high.is_finite() && low < high;
        let sound = sound && low <= shown[0] && shown[0] < shown[1] && shown[1] <= high;
        let layer = Layer { name: self.signal.clone(), channels: self.channels, domain };
        sound.then_some(BakedLayer { layer, scale, clamp: self.clamp, first })
    }
}

/// The light of a baked file.
pub struct FileLight {
    /// What the extension says.
    pub extension: Extension,
    /// Its layers.
    pub layers: Layers,
    /// Its images.
    pub stored: Stored,
    /// How it stands in the file.
    pub profile: Profile,
    /// Per layer, per triangle of the light mesh: the values of the attribute, codes or coordinates.
    corners: Vec<Vec<[[u16; 2]; 3]>>,
}

impl FileLight {
    /// Reads the light of a baked scene and decodes its atlas.
    ///
    /// `file` is the name for messages.
    ///
    /// # Errors
    /// [`BakeError::NotBaked`] for a file without our extension, [`BakeError::ReadBack`] for one whose parts do
    /// not fit each other, and errors of the readers.
    pub fn read(surface: &Surface<'_>, file: &str) -> Result<Self, BakeError> {
        let Some(lightmap) = surface.scene.read_lightmap()? else {
            return Err(BakeError::NotBaked { file: file.to_owned() });
        };
        let faulty = |what: String| BakeError::ReadBack { what };
        let extension = Extension::read(&lightmap.extension, file)?;
        let size = extension.page_size.unwrap_or_default();
        let (mut layers, mut corners, mut images) = (Vec::new(), Vec::new(), Vec::new());
        let mut first = 0;
        for (number, (info, read)) in extension.layers.iter().zip(&lightmap.layers).enumerate() {
            let layer =
                info.layer(first).ok_or_else(|| faulty(format!("layer {number} of {file} has no scale")))?;
            corners.push(layer_corners(surface, &extension, read).map_err(faulty)?);
            let encoding = info
                .encoding(layer.scale)
                .ok_or_else(|| faulty(format!("layer {number} of {file} has no encoding")))?;
            images.push(layer_images(&layer, encoding, read, size)?);
            first += info.channels;
            layers.push(layer);
        }
        if layers.is_empty() {
            return Err(faulty(format!("{file} has no layers")));
        }
        let stored = Stored { size, layers: images, coordinates: extension.coordinates() };
        Ok(Self { extension, layers: Layers::of(layers), stored, profile: lightmap.profile, corners })
    }

    /// Whether the layers hold what a signal measures.
    ///
    /// # Errors
    /// [`BakeError::ReadBack`] if not: layers and recipe of the file contradict each other.
    pub fn expect(&self, signal: &dyn Signal) -> Result<(), BakeError> {
        if self.layers.fit(signal) {
            return Ok(());
        }
        Err(BakeError::ReadBack { what: "layers that the recipe does not make".into() })
    }

    /// How the light of a scene was made, without its light; `file` is the name for messages.
    ///
    /// # Errors
    /// As [`Self::read`].
    pub fn recipe(scene: &Scene, file: &str) -> Result<Recipe, BakeError> {
        match scene.read_extension()? {
            Some(extension) => Ok(Extension::read(extension, file)?.bake),
            None => Err(BakeError::NotBaked { file: file.to_owned() }),
        }
    }

    /// The atlas of each layer as a lookup reads it.
    ///
    /// # Errors
    /// [`BakeError::Encode`] for pages that do not have their size; `read` has checked that.
    pub fn views(&self) -> Result<Vec<AtlasView<'_>>, BakeError> {
        self.stored.views()
    }

    /// Pages of the atlas.
    pub fn pages(&self) -> usize {
        self.stored.layers[0].pages.len()
    }

    /// The codes of a triangle's corners in the first layer; in which of them are colors and which places all layers
    /// are alike.
    pub fn codes(&self, triangle: TriangleId) -> [LightCode; 3] {
        let corners = self.corners[0][triangle.index()];
        match &self.stored.coordinates {
            Some(coordinates) => corners.map(|corner| coordinates.code(corner)),
            None => corners.map(LightCode),
        }
    }

    /// Whether a triangle reads all of its light from the atlas.
    pub fn is_texture(&self, triangle: TriangleId) -> bool {
        self.codes(triangle).iter().all(|code| !code.is_color())
    }

    /// What a GPU shows at a point, in unit values of all layers.
    pub fn show(&self, views: &[AtlasView<'_>], point: SurfacePoint, out: &mut [f32]) {
        let corners = |layer: usize| self.corners[layer][point.triangle.index()];
        match &self.stored.coordinates {
            Some(coordinates) => {
                self.stored.show_at(views, coordinates, corners(0), point.barycentric, out);
            }
            None => self.stored.show(views, |l| corners(l).map(LightCode), point.barycentric, out),
        }
    }
}

/// The codes or coordinates of a layer, triangle by triangle of the light mesh.
fn layer_corners(
    surface: &Surface<'_>,
    extension: &Extension,
    read: &LayerRead,
) -> Result<Vec<[[u16; 2]; 3]>, String> {
    let mut codes = Vec::with_capacity(surface.mesh.triangle_count());
    for (number, part) in surface.scene.parts.iter().enumerate().filter(|(n, _)| surface.is_lit(*n)) {
        let light = extension.corners(read, number).ok_or_else(|| {
            format!("part {number} (node {}) has coordinates that stand for no light", part.node)
        })?;
        if light.len() != part.triangles.len() {
            return Err(format!(
                "part {number} (node {}) has light for {} of {} triangles",
                part.node,
                light.len(),
                part.triangles.len()
            ));
        }
        codes.extend_from_slice(&light);
    }
    Ok(codes)
}

/// The images of a layer.
fn layer_images(
    baked: &BakedLayer,
    encoding: Encoding,
    read: &LayerRead,
    size: [u32; 2],
) -> Result<StoredLayer, BakeError> {
    let mut layer = StoredLayer {
        channels: baked.layer.channels,
        depth: PngDepth::Eight,
        pages: Vec::new(),
        encoding,
        table: None,
        clamp: baked.unit_clamp(),
    };
    let numbers = layer.stored_channels();
    for page in &read.pages {
        let image = read_png(&page.png)?;
        if image.size != size || image.channels as usize != numbers {
            let what = format!(
                "a page of {:?} texels and {} channels where the extension says {size:?} and {numbers}",
                image.size, image.channels
            );
            return Err(BakeError::ReadBack { what });
        }
        if image.bits == 16 {
            layer.depth = PngDepth::Sixteen;
        }
        layer.pages.push(image.values.into_iter().map(|number| encoding.from_image(number)).collect());
    }
    if let Some(table) = &read.table {
        let image = read_png(&table.png)?;
        if image.channels as usize != numbers {
            let what = format!("a table of {} channels where the layer has {numbers}", image.channels);
            return Err(BakeError::ReadBack { what });
        }
        layer.table = Some(Table::read(numbers, &image.values)?);
    }
    Ok(layer)
}
