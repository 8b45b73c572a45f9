//! Materials as far as light is concerned: what covers, what passes, what is reflected and what is emitted.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use serde_json::Value;

use crate::document::{Document, extension, name, number, numbers};
use crate::error::{SceneError, Warnings};
use crate::images::{self, Channels, Colors, Plane, Sampled, Wanted, foreign_source, image_place};
use crate::scene::{Glass, ReadOptions};
use crate::texture::{Mapping, texture_of};

const GLOSSINESS: &str = "KHR_materials_pbrSpecularGlossiness";

/// How alpha becomes coverage (glTF 2.0, 3.9.4).
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum AlphaMode {
    /// Alpha is ignored.
    Opaque,
    /// Alpha of at least the cutoff covers, less does not.
    Mask {
        /// The cutoff.
        cutoff: f32,
    },
    /// Alpha is the coverage.
    Blend,
}

/// A material of the file.
#[derive(Clone, Debug)]
pub struct Material {
    /// Its name, if it has one.
    pub name: Option<String>,
    /// How alpha is used.
    pub alpha_mode: AlphaMode,
    /// Alpha of the base color factor, 0..=1.
    pub alpha: f32,
    /// Share of the light that passes through the surface (KHR_materials_transmission, factor only), 0..=1; 0 with
    /// [`Glass::Opaque`].
    pub transmission: f32,
    /// Whether both sides are drawn.
    pub double_sided: bool,
    /// The base color factor, linear, 0..=1; the diffuse factor of KHR_materials_pbrSpecularGlossiness where
    /// that is used.
    pub base_color: [f32; 3],
    /// The emissive factor times KHR_materials_emissive_strength, cd/m², at least 0; 0 for unlit materials.
    pub emission: [f32; 3],
    /// KHR_materials_unlit: shows its color whatever the light.
    pub unlit: bool,
    /// The metallic factor, 0..=1; 0 where KHR_materials_pbrSpecularGlossiness is used.
    pub metallic: f32,
    /// The roughness factor, 0..=1; what is missing to 1 in the glossiness factor of that extension.
    pub roughness: f32,
    /// Strength of the occlusion texture, 0..=1.
    pub(crate) occlusion: f32,
    pub(crate) coverage: Option<Sampled<Plane>>,
    pub(crate) base: Option<Sampled<Colors>>,
    pub(crate) glow: Option<Sampled<Colors>>,
    pub(crate) passes: Option<Sampled<Plane>>,
    pub(crate) gloss: Option<Sampled<Colors>>,
    pub(crate) occluded: Option<Sampled<Plane>>,
}

impl Material {
    /// Whether a point of it may cover less than wholly.
    pub fn is_translucent(&self) -> bool {
        self.alpha_mode != AlphaMode::Opaque || self.transmission > 0.0
    }

    /// Whether a point of it may emit light.
    pub fn is_emissive(&self) -> bool {
        self.emission.iter().any(|&e| e > 0.0)
    }

    /// Share of a point that is not a hole, from texture coordinates and vertex alpha; transmission plays no part.
    pub(crate) fn covered(&self, uv: [f32; 2], vertex_alpha: f32) -> f32 {
        let alpha = || {
            let texel = self.coverage.as_ref().map_or(1.0, |t| t.at(uv));
            (self.alpha * texel * vertex_alpha).clamp(0.0, 1.0)
        };
        match self.alpha_mode {
            AlphaMode::Opaque => 1.0,
            AlphaMode::Mask { cutoff } => f32::from(u8::from(alpha() >= cutoff)),
            AlphaMode::Blend => alpha(),
        }
    }
}

/// Base color of a material: the factor, and the texture info. The diffuse color of
/// KHR_materials_pbrSpecularGlossiness comes first, as the extension demands.
pub(crate) fn base_color(material: &Value) -> ([f32; 4], Option<&Value>) {
    let (owner, factor, texture) = match extension(material, GLOSSINESS) {
        Some(glossy) => (Some(glossy), "diffuseFactor", "diffuseTexture"),
        None => (material.get("pbrMetallicRoughness"), "baseColorFactor", "baseColorTexture"),
    };
    let factor = owner.and_then(|o| numbers::<4>(o, factor).ok().flatten());
    (factor.map_or([1.0; 4], |f| f.map(|v| v as f32)), owner.and_then(|o| o.get(texture)))
}

/// The textures of one material: what they name, before any image is decoded.
#[derive(Default)]
struct Slots {
    coverage: Option<(usize, Mapping)>,
    base: Option<(usize, Mapping)>,
    glow: Option<(usize, Mapping)>,
    passes: Option<(usize, Mapping)>,
    gloss: Option<(usize, Mapping)>,
    occluded: Option<(usize, Mapping)>,
}

/// Reads all materials; images are decoded only for materials of `used`, and only where they matter.
pub(crate) fn read_materials(
    document: &Document,
    used: &BTreeSet<usize>,
    options: &ReadOptions,
    warnings: &mut Warnings,
) -> Result<Vec<Material>, SceneError> {
    let mut wanted: BTreeMap<usize, Wanted> = BTreeMap::new();
    let mut out = Vec::new();
    let mut all = Vec::new();
    for (number, json) in document.list("materials").iter().enumerate() {
        let material = read_factors(json, options);
        let mut slots = Slots::default();
        if used.contains(&number) {
            let mut slot = |info: Option<&Value>, want: Wanted| -> Result<_, SceneError> {
                let found = read_slot(document, info, want, warnings)?;
                if let Some((image, _)) = &found {
                    let sum = wanted.entry(*image).or_default();
                    sum.alpha |= want.alpha;
                    sum.color |= want.color;
                    sum.red |= want.red;
                    sum.plain |= want.plain;
                }
                Ok(found)
            };
            let (_, base) = base_color(json);
            if material.alpha_mode != AlphaMode::Opaque {
                slots.coverage = slot(base, Wanted { alpha: true, ..Wanted::default() })?;
            }
            if options.surfaces {
                let color = Wanted { color: true, ..Wanted::default() };
                slots.base = slot(base, color)?;
                if material.is_emissive() {
                    slots.glow = slot(json.get("emissiveTexture"), color)?;
                }
                if material.transmission > 0.0 {
                    let info = extension(json, "KHR_materials_transmission")
                        .and_then(|t| t.get("transmissionTexture"));
                    slots.passes = slot(info, Wanted { red: true, ..Wanted::default() })?;
                }
            }
            if options.finish {
                let info = json.get("pbrMetallicRoughness").and_then(|m| m.get("metallicRoughnessTexture"));
                let glossy = extension(json, GLOSSINESS).is_some();
                let info = info.filter(|_| !glossy);
                slots.gloss = slot(info, Wanted { plain: true, ..Wanted::default() })?;
                let info = json.get("occlusionTexture");
                slots.occluded = slot(info, Wanted { red: true, ..Wanted::default() })?;
            }
        }
        out.push(material);
        all.push(slots);
    }
    let decoded = images::decode_all(document, &wanted, warnings)?;
    for (material, slots) in out.iter_mut().zip(all) {
        material.coverage = sampled(slots.coverage, &decoded, |c| &c.alpha);
        material.base = sampled(slots.base, &decoded, |c| &c.color);
        material.glow = sampled(slots.glow, &decoded, |c| &c.color);
        material.passes = sampled(slots.passes, &decoded, |c| &c.red);
        material.gloss = sampled(slots.gloss, &decoded, |c| &c.plain);
        material.occluded = sampled(slots.occluded, &decoded, |c| &c.red);
    }
    Ok(out)
}

/// What a material says without its textures.
fn read_factors(json: &Value, options: &ReadOptions) -> Material {
    let alpha_mode = match json.get("alphaMode").and_then(Value::as_str) {
        Some("MASK") => AlphaMode::Mask { cutoff: number(json, "alphaCutoff", 0.5) },
        Some("BLEND") => AlphaMode::Blend,
        _ => AlphaMode::Opaque,
    };
    let transmission = match options.glass {
        Glass::Tinted => extension(json, "KHR_materials_transmission")
            .map_or(0.0, |t| number(t, "transmissionFactor", 0.0))
            .clamp(0.0, 1.0),
        Glass::Opaque => 0.0,
    };
    let unlit = extension(json, "KHR_materials_unlit").is_some();
    let strength = extension(json, "KHR_materials_emissive_strength")
        .map_or(1.0, |e| number(e, "emissiveStrength", 1.0))
        .max(0.0);
    let emissive = numbers::<3>(json, "emissiveFactor").ok().flatten().filter(|_| !unlit);
    let [r, g, b, alpha] = base_color(json).0.map(|v| v.clamp(0.0, 1.0));
    let (metallic, roughness) = match extension(json, GLOSSINESS) {
        Some(glossy) => (0.0, 1.0 - number(glossy, "glossinessFactor", 1.0)),
        None => {
            let owner = json.get("pbrMetallicRoughness").unwrap_or(&Value::Null);
            (number(owner, "metallicFactor", 1.0), number(owner, "roughnessFactor", 1.0))
        }
    };
    let occlusion = json.get("occlusionTexture").map_or(1.0, |info| number(info, "strength", 1.0));
    Material {
        name: name(json),
        alpha_mode,
        alpha,
        transmission,
        double_sided: json.get("doubleSided").and_then(Value::as_bool).unwrap_or(false),
        base_color: [r, g, b],
        emission: emissive.unwrap_or([0.0; 3]).map(|e| (e.clamp(0.0, 1e30) as f32 * strength).min(1e30)),
        unlit,
        metallic: metallic.clamp(0.0, 1.0),
        roughness: roughness.clamp(0.0, 1.0),
        occlusion: occlusion.clamp(0.0, 1.0),
        coverage: None,
        base: None,
        glow: None,
        passes: None,
        gloss: None,
        occluded: None,
    }
}

/// The image and the mapping of a texture info.
fn read_slot(
    document: &Document,
    info: Option<&Value>,
    wanted: Wanted,
    warnings: &mut Warnings,
) -> Result<Option<(usize, Mapping)>, SceneError> {
    let Some(info) = info else { return Ok(None) };
    let Some((texture, source)) = texture_of(document, info)? else { return Ok(None) };
    let Some(source) = source else {
        let place = foreign_source(document, texture).map(|image| image_place(document, image));
        images::warn(wanted, place.unwrap_or_default(), warnings);
        return Ok(None);
    };
    Ok(Some((source, Mapping::read(document, info, texture)?)))
}

fn sampled<I>(
    slot: Option<(usize, Mapping)>,
    decoded: &BTreeMap<usize, Option<Channels>>,
    channel: impl Fn(&Channels) -> &Option<Arc<I>>,
) -> Option<Sampled<I>> {
    let (image, mapping) = slot?;
    let image = channel(decoded.get(&image)?.as_ref()?).clone()?;
    Some(Sampled { image, mapping })
}
