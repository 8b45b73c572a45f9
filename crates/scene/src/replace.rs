//! Taking out of a document what the light replaces: textures that held light before.

use serde_json::Value;

use crate::document::{array, object};
use crate::garbage;
use crate::texture::Slot;
use crate::undo::remove_extension;

/// Extensions of materials that hold a lightmap.
pub(crate) const LIGHTMAPS: [&str; 2] = ["MOZ_lightmap", "EXT_lightmap"];

/// Removes the textures of some slots from all materials, and with them what nothing else uses: images, samplers, and
/// extensions from their lists.
pub(crate) fn remove_slots(root: &mut Value, slots: &[Slot]) {
    if slots.is_empty() || root.get("materials").is_none() {
        return;
    }
    let before = root.clone();
    for material in array(root, "materials") {
        for slot in slots {
            remove_slot(material, *slot);
        }
    }
    if slots.contains(&Slot::Lightmap) {
        for key in ["extensionsUsed", "extensionsRequired"] {
            if root.get(key).is_some() {
                let names = array(root, key);
                names.retain(|n| !n.as_str().is_some_and(|n| LIGHTMAPS.contains(&n)));
                if names.is_empty() {
                    object(root).shift_remove(key);
                }
            }
        }
    }
    garbage::collect_textures(&before, root);
}

fn remove_slot(material: &mut Value, slot: Slot) {
    let from = match slot {
        Slot::BaseColor => material.get_mut("pbrMetallicRoughness").map(|p| (p, "baseColorTexture")),
        Slot::Occlusion => Some((material, "occlusionTexture")),
        Slot::Lightmap => {
            LIGHTMAPS.iter().for_each(|name| remove_extension(material, name));
            None
        }
    };
    if let Some((owner, key)) = from
        && let Some(owner) = owner.as_object_mut()
    {
        owner.shift_remove(key);
    }
}
