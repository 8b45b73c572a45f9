//! The light of a scene as the writer takes it, and whether it belongs to the scene.

use std::sync::Arc;

use serde_json::{Map, Value};

use crate::error::{SceneError, value};
use crate::materials::MaterialTexture;
use crate::nodes::place_of;
use crate::profile::Profile;
use crate::scene::Scene;
use crate::texture::Slot;

/// What viewers that do not know the extension show.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Fallback {
    /// The light multiplied into `COLOR_0`: RGB, 8 bits, linear.
    #[default]
    Color0,
    /// Nothing.
    None,
}

/// One layer of light: its images and what the extension says about it.
#[derive(Clone, Debug, Default)]
pub struct LayerFiles {
    /// The pages of the atlas, one PNG file each, in order. Empty when there are no texture triangles.
    pub pages: Vec<Vec<u8>>,
    /// The table of colors as a PNG file, where the codes are numbers of its entries.
    pub table: Option<Vec<u8>>,
    /// The layer's object (docs/LIGHTKILN_lightmap.schema.json); [`write`] fills in `attribute`, `codes`, `pages` and
    /// `table`.
    pub info: Map<String, Value>,
    /// What materials show the layer as, in plain profiles.
    pub texture: Option<MaterialTexture>,
}

/// From a code of a layer to the pair of floats that stands for it ([`Profile::Texcoord`]).
#[derive(Clone)]
pub struct Pairs(pub Arc<dyn Fn(usize, [u16; 2]) -> [f32; 2] + Send + Sync>);

impl std::fmt::Debug for Pairs {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("Pairs")
    }
}

/// The root object of the extension; [`write`] fills in `version` and `layers`.
#[derive(Clone, Debug, Default)]
pub struct ExtensionInfo {
    /// A JSON object (docs/LIGHTKILN_lightmap.schema.json).
    pub root: Value,
}

/// The light of a scene.
#[derive(Clone, Debug, Default)]
pub struct BakedLight {
    /// One per [`Scene::parts`], in that order.
    pub parts: Vec<PartLight>,
    /// At least one, in the order of [`PartLight::corner_codes`].
    pub layers: Vec<LayerFiles>,
    /// The extension's root object.
    pub extension: ExtensionInfo,
    /// How the light stands in the file.
    pub profile: Profile,
    /// What stands for codes in [`Profile::Texcoord`].
    pub pairs: Option<Pairs>,
    /// Materials with an occlusion texture of their own keep it and show no occlusion of ours, in plain profiles.
    pub keep_occlusion: bool,
    /// What other viewers show.
    pub fallback: Fallback,
    /// Textures of the asset that the light replaces; they leave all materials. Usually empty.
    pub remove: Vec<Slot>,
}

/// The light of a part, corner by corner.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PartLight {
    /// Per attribute, per triangle, per corner: its value. There is one for each layer, and in plain profiles one for
    /// all. Without any the part has no light and stays as it is.
    pub corner_codes: Vec<Vec<[[u16; 2]; 3]>>,
    /// Per triangle, per corner: linear RGB, 0..=1, shown by `COLOR_0` in viewers that do not know the extension.
    /// May be empty when nothing is written there.
    pub corner_fallback: Vec<[[f32; 3]; 3]>,
}

impl PartLight {
    /// Whether there is any: a part without stays as it is.
    pub fn is_lit(&self) -> bool {
        !self.corner_codes.is_empty()
    }
}

/// The codes of a part's triangles, per layer: per triangle, per corner.
pub(crate) type LayerCodes = [Vec<[[u16; 2]; 3]>];

/// Checks that light belongs to the scene.
pub(crate) fn check_light(scene: &Scene, light: &BakedLight) -> Result<(), SceneError> {
    let wrong = |what, count, expected| SceneError::Light { what, count, expected, place: Box::default() };
    let Some(first) = light.layers.first() else { return Err(wrong("layers of light", 0, 1)) };
    if let Some(other) = light.layers.iter().find(|l| l.pages.len() != first.pages.len()) {
        return Err(wrong("pages of a layer", other.pages.len(), first.pages.len()));
    }
    if light.parts.len() != scene.parts.len() {
        return Err(wrong("parts with light", light.parts.len(), scene.parts.len()));
    }
    if light.profile.is_plain() && first.pages.len() != 1 {
        return Err(wrong("pages of light that materials show", first.pages.len(), 1));
    }
    let colors = light.fallback == Fallback::Color0;
    let attributes = light.profile.attributes(light.layers.len());
    for (part, of_scene) in light.parts.iter().zip(&scene.parts) {
        check_part(part, of_scene.triangles.len(), attributes, colors)
            .map_err(|e| e.at(|p| *p = place_of(&scene.document, of_scene.node)))?;
    }
    Ok(())
}

fn check_part(part: &PartLight, triangles: usize, attributes: usize, colors: bool) -> Result<(), SceneError> {
    if !part.is_lit() {
        return Ok(());
    }
    let same = |what, count, expected| {
        let wrong = SceneError::Light { what, count, expected, place: Box::default() };
        if count == expected { Ok(()) } else { Err(wrong) }
    };
    same("attributes with codes", part.corner_codes.len(), attributes)?;
    for codes in &part.corner_codes {
        same("triangles with codes", codes.len(), triangles)?;
    }
    if let Some(triangle) = other_place(&part.corner_codes) {
        let what = format!("the layout of triangle {triangle}");
        return Err(value(what, "not that of layer 0 in another layer", "one layout for all layers"));
    }
    if colors {
        same("triangles with fallback colours", part.corner_fallback.len(), triangles)?;
        if part.corner_fallback.iter().flatten().flatten().any(|v| !v.is_finite()) {
            return Err(value("a fallback colour", "not finite", "0 to 1"));
        }
    }
    Ok(())
}

/// The first triangle with a corner that reads the atlas at different places, or in some layers only.
fn other_place(codes: &LayerCodes) -> Option<usize> {
    let (first, others) = codes.split_first()?;
    let place = |code: [u16; 2]| (code[1] < 0x8000).then_some(code);
    let differs = |a: &[[u16; 2]; 3], b: &[[u16; 2]; 3]| (0..3).any(|k| place(a[k]) != place(b[k]));
    others.iter().filter_map(|other| first.iter().zip(other).position(|(a, b)| differs(a, b))).min()
}
