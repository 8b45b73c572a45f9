//! Light in materials, for the profiles that need no shader: core `occlusionTexture` and MOZ_lightmap.
//!
//! A texture of a material names the set of texture coordinates that it is looked up with, and primitives have
//! different numbers of sets. So a material that primitives with different sets, or without light, share is copied;
//! the copies stand at the end of their array. The root object of the extension tells what to undo.

use std::collections::{BTreeMap, BTreeSet};

use serde_json::{Map, Value, json};

use crate::document::{array, extension, list, object, whole};
use crate::error::{Place, SceneError};
use crate::images::{foreign_source, image_place};
use crate::lightmap::EXTENSION;
use crate::replace::LIGHTMAPS;
use crate::scene::Scene;
use crate::texture::texture_of;
use crate::undo::remove_extension;
use crate::variants::VARIANTS;
use crate::write::Patch;

/// What a material shows a layer as.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum MaterialTexture {
    /// `occlusionTexture`, at full strength.
    Occlusion,
    /// MOZ_lightmap: irradiance over the intensity.
    Lightmap {
        /// Lux of a texel of 1.
        intensity: f32,
    },
}

const OCCLUSION: &str = "occlusionTexture";

/// The prefix of sets of texture coordinates.
pub(crate) const TEXCOORD: &str = "TEXCOORD_";

/// How many sets of texture coordinates a primitive has, counted from the first without a gap: the number of the next.
pub(crate) fn texcoord_sets(primitive: &Value) -> usize {
    let attributes = primitive.get("attributes");
    (0..).take_while(|n| attributes.is_some_and(|a| a.get(format!("{TEXCOORD}{n}")).is_some())).count()
}

/// The set of texture coordinates that holds a primitive's light.
fn set_of(primitive: &Value) -> Option<u64> {
    let ours = extension(primitive, EXTENSION)?;
    list(ours, "attributes").first()?.as_str()?.strip_prefix(TEXCOORD)?.parse().ok()
}

/// Calls with every place that names a material of a primitive: its own, and those of its variants.
fn each_material(primitive: &mut Value, mut call: impl FnMut(&mut Map<String, Value>)) {
    let Some(primitive) = primitive.as_object_mut() else { return };
    let mappings = primitive.get_mut("extensions").and_then(|e| e.get_mut(VARIANTS)?.get_mut("mappings"));
    for mapping in mappings.and_then(Value::as_array_mut).into_iter().flatten() {
        mapping.as_object_mut().into_iter().for_each(&mut call);
    }
    call(primitive);
}

fn each_primitive(root: &mut Value, mut call: impl FnMut(&mut Value)) {
    if root.get("meshes").is_none() {
        return;
    }
    for mesh in array(root, "meshes") {
        if mesh.get("primitives").is_some() {
            array(mesh, "primitives").iter_mut().for_each(&mut call);
        }
    }
}

fn material_of(owner: &Map<String, Value>) -> Option<usize> {
    owner.get("material").and_then(whole).map(|m| m as usize)
}

impl Patch<'_> {
    /// Lets the materials of all primitives with light show it; returns what undoes that.
    ///
    /// - `textures`: of the layers that have a [`MaterialTexture`]
    pub(crate) fn materials(&mut self, textures: &[(MaterialTexture, usize)]) -> Vec<Value> {
        let shows_occlusion = textures.iter().any(|(t, _)| *t == MaterialTexture::Occlusion);
        let keeps = |material: &Value| {
            self.light.keep_occlusion && shows_occlusion && material.get(OCCLUSION).is_some()
        };
        let kept: Vec<bool> = list(&self.root, "materials").iter().map(keeps).collect();
        // The sets by which the primitives of each material are lit; `None` stands for primitives without light.
        let mut uses: BTreeMap<Option<usize>, BTreeSet<Option<u64>>> = BTreeMap::new();
        each_primitive(&mut self.root, |primitive| {
            let set = set_of(primitive);
            each_material(primitive, |owner| {
                uses.entry(material_of(owner)).or_default().insert(set);
            });
        });
        let (mut undo, mut copies) = (Vec::new(), BTreeMap::new());
        let (mut unlit, mut astray) = (0, 0);
        for (material, sets) in &uses {
            if material.is_some_and(|m| kept.get(m).copied().unwrap_or(true)) {
                continue;
            }
            for &set in sets.iter().flatten() {
                let shared = material.is_none() || sets.len() > 1;
                let materials = array(&mut self.root, "materials");
                let number = if shared {
                    materials.push(material.map_or_else(|| json!({}), |m| materials[m].clone()));
                    copies.insert((*material, set), materials.len() - 1);
                    undo.push(json!({"material": materials.len() - 1, "copyOf": material}));
                    materials.len() - 1
                } else {
                    material.expect("only shared materials are none")
                };
                let json = &mut materials[number];
                unlit += usize::from(shows_occlusion && extension(json, "KHR_materials_unlit").is_some());
                let before = show(json, textures, set);
                let others = object(json).iter().filter(|(key, _)| *key != OCCLUSION);
                astray += usize::from(others.into_iter().any(|(_, value)| looks_up(value, set)));
                if !shared {
                    undo.push(json!({"material": number, "before": before}));
                }
            }
        }
        each_primitive(&mut self.root, |primitive| {
            let Some(set) = set_of(primitive) else { return };
            each_material(primitive, |owner| {
                if let Some(&copy) = copies.get(&(material_of(owner), set)) {
                    owner.insert("material".to_owned(), copy.into());
                }
            });
        });
        let highest = uses.values().flatten().flatten().max().copied().unwrap_or(0);
        if highest > 1 {
            let message = format!(
                "light is in texture coordinates up to TEXCOORD_{highest}: some viewers read no more than two sets"
            );
            self.warnings.add(message, 1, Place::default());
        }
        if astray > 0 {
            let message = "materials look up textures by coordinates that their primitives did not have: viewers may \
                           show these textures by the coordinates of the light now";
            self.warnings.add(message, astray, Place::default());
        }
        if unlit > 0 {
            let message = "materials that are unlit (KHR_materials_unlit) show no occlusion";
            self.warnings.add(message, unlit, Place::default());
        }
        if textures.iter().any(|(t, _)| *t != MaterialTexture::Occlusion) && !uses.is_empty() {
            self.use_extension(LIGHTMAPS[0]);
        }
        undo
    }
}

/// Whether anything within a part of a material looks up a texture by a set of texture coordinates, other than a lightmap.
fn looks_up(value: &Value, set: u64) -> bool {
    let Some(fields) = value.as_object() else { return false };
    let transformed = extension(value, "KHR_texture_transform").and_then(|t| t.get("texCoord"));
    let own = transformed.or_else(|| fields.get("texCoord")).map_or(Some(0), whole);
    (fields.contains_key("index") && own == Some(set))
        || fields.iter().any(|(key, inner)| !LIGHTMAPS.contains(&key.as_str()) && looks_up(inner, set))
}

/// Puts the textures of the layers on a material; returns what stood there, null where nothing did.
fn show(material: &mut Value, textures: &[(MaterialTexture, usize)], set: u64) -> Value {
    let mut before = Map::new();
    for &(texture, number) in textures {
        match texture {
            MaterialTexture::Occlusion => {
                let info = json!({"index": number, "texCoord": set});
                let old = object(material).insert(OCCLUSION.to_owned(), info);
                before.insert(OCCLUSION.to_owned(), old.into());
            }
            MaterialTexture::Lightmap { intensity } => {
                // Another lightmap would add to ours.
                for (name, must) in LIGHTMAPS.into_iter().zip([true, false]) {
                    let old = extension(material, name).cloned();
                    if must || old.is_some() {
                        before.insert(name.to_owned(), old.into());
                    }
                }
                let info = json!({"index": number, "texCoord": set, "intensity": intensity});
                let extensions = object(material).entry("extensions").or_insert(Value::Null);
                object(extensions).insert(LIGHTMAPS[0].to_owned(), info);
                remove_extension(material, LIGHTMAPS[1]);
            }
        }
    }
    Value::Object(before)
}

/// Takes the light out of the materials again; to be called while primitives still tell that they have light.
///
/// - `ours`: the root object of the extension
pub(crate) fn undo_materials(root: &mut Value, ours: &Value) {
    let entries = list(ours, "materials");
    if entries.is_empty() {
        return;
    }
    let count = list(root, "materials").len();
    let number =
        |entry: &Value| entry.get("material").and_then(whole).map(|m| m as usize).filter(|m| *m < count);
    let mut copies = BTreeMap::new();
    for entry in entries {
        let Some(material) = number(entry) else { continue };
        if let Some(original) = entry.get("copyOf") {
            copies.insert(material, whole(original));
            continue;
        }
        let json = &mut array(root, "materials")[material];
        for (key, old) in entry.get("before").and_then(Value::as_object).into_iter().flatten() {
            restore(json, key, old);
        }
    }
    each_primitive(root, |primitive| {
        if set_of(primitive).is_none() {
            return;
        }
        each_material(primitive, |owner| match material_of(owner).and_then(|m| copies.get(&m)) {
            Some(Some(original)) => {
                owner.insert("material".to_owned(), (*original).into());
            }
            Some(None) => {
                owner.shift_remove("material");
            }
            None => {}
        });
    });
    // Elsewhere than at the end they would move the numbers of others.
    let materials = array(root, "materials");
    while materials.len().checked_sub(1).is_some_and(|last| copies.contains_key(&last)) {
        materials.pop();
    }
    if materials.is_empty() {
        object(root).shift_remove("materials");
    }
    let named = |root: &Value| list(root, "materials").iter().any(|m| extension(m, LIGHTMAPS[0]).is_some());
    if !named(root) && root.get("extensionsUsed").is_some() {
        array(root, "extensionsUsed").retain(|e| e.as_str() != Some(LIGHTMAPS[0]));
    }
}

/// Gives a material back what it had under a key, or nothing.
fn restore(material: &mut Value, key: &str, old: &Value) {
    let in_extensions = LIGHTMAPS.contains(&key);
    match (in_extensions, old) {
        (true, Value::Null) => remove_extension(material, key),
        (true, old) => {
            let extensions = object(material).entry("extensions").or_insert(Value::Null);
            object(extensions).insert(key.to_owned(), old.clone());
        }
        (false, Value::Null) => {
            object(material).shift_remove(key);
        }
        (false, old) => {
            object(material).insert(key.to_owned(), old.clone());
        }
    }
}

impl Scene {
    /// Whether each primitive of a part has an occlusion texture of its own.
    ///
    /// # Panics
    /// For a part that the scene does not have.
    pub fn has_occlusion_textures(&self, part: usize) -> Vec<bool> {
        let materials = self.document.list("materials");
        let has = |m: &Option<usize>| m.is_some_and(|m| materials[m].get(OCCLUSION).is_some());
        self.parts[part].primitive_materials.iter().map(has).collect()
    }

    /// Refuses occlusion textures that are to be read and cannot be.
    ///
    /// # Errors
    /// [`SceneError::Unsupported`] for the first whose image is in no format of glTF itself.
    pub fn check_occlusion_textures(&self) -> Result<(), SceneError> {
        let materials = self.document.list("materials");
        let used = self.parts.iter().flat_map(|part| part.primitive_materials.iter().flatten());
        for &material in used.collect::<BTreeSet<_>>() {
            let Some(info) = materials[material].get(OCCLUSION) else { continue };
            if let Some((texture, None)) = texture_of(&self.document, info)? {
                let image = foreign_source(&self.document, texture);
                return Err(SceneError::Unsupported {
                    what: "an occlusion texture in a format that is not read (KTX2, AVIF, DDS)".to_owned(),
                    remedy: "choose --authored-occlusion keep or replace, or export it as PNG, JPEG or WebP",
                    place: image.map(|i| image_place(&self.document, i)).unwrap_or_default().into(),
                });
            }
        }
        Ok(())
    }
}
