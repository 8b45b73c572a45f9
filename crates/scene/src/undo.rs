//! Taking a bake out of a document before the next one; light of every version that was ever written.

use serde_json::Value;

use crate::document::{array, extension, list, object, whole};
use crate::lightmap::{ATTRIBUTE, COLOR, EXTENSION, is_layer_name};
use crate::materials::{TEXCOORD, undo_materials};

/// Takes a bake out of a document: our attributes, textures and extension objects go, an original `COLOR_0`
/// returns. Vertices that were split stay split. Returns whether there was anything to undo.
pub(crate) fn undo(root: &mut Value) -> bool {
    let Some(ours) = extension(root, EXTENSION).cloned() else { return false };
    let empty = |root: &mut Value, key: &str| array(root, key).is_empty();
    undo_materials(root, &ours);
    if root.get("meshes").is_some() {
        for mesh in array(root, "meshes") {
            if mesh.get("primitives").is_some() {
                array(mesh, "primitives").iter_mut().for_each(undo_primitive);
            }
        }
    }
    remove_extension(root, EXTENSION);
    for key in ["extensionsUsed", "extensionsRequired"] {
        if root.get(key).is_some() {
            array(root, key).retain(|e| e.as_str() != Some(EXTENSION));
            if empty(root, key) {
                object(root).shift_remove(key);
            }
        }
    }
    // Version 1 had the pages of its one layer in the root object.
    let owners = std::iter::once(&ours).chain(list(&ours, "layers"));
    let textures = owners.flat_map(|o| list(o, "pages").iter().chain(o.get("table")));
    let textures: Vec<usize> = textures.filter_map(whole).map(|t| t as usize).collect();
    remove_textures(root, &textures);
    true
}

/// Removes an extension object, and `extensions` itself when nothing is left in it.
pub(crate) fn remove_extension(owner: &mut Value, name: &str) {
    let Some(owner) = owner.as_object_mut() else { return };
    let Some(extensions) = owner.get_mut("extensions").and_then(Value::as_object_mut) else { return };
    extensions.shift_remove(name);
    if extensions.is_empty() {
        owner.shift_remove("extensions");
    }
}

fn undo_primitive(primitive: &mut Value) {
    let Some(ours) = extension(primitive, EXTENSION).cloned() else { return };
    let name = |key: &str| ours.get(key).and_then(Value::as_str);
    // `attributes` is of version 2, `attribute` of version 1.
    let named = list(&ours, "attributes").iter().chain(ours.get("attribute")).filter_map(Value::as_str);
    let named: Vec<&str> = named.filter(|n| is_layer_name(n) || n.starts_with(TEXCOORD)).collect();
    if let Some(attributes) = primitive.get_mut("attributes").and_then(Value::as_object_mut) {
        attributes.shift_remove(ATTRIBUTE);
        for light in named {
            attributes.shift_remove(light);
        }
        match name("color0") {
            Some(kept) => {
                if let Some(original) = attributes.shift_remove(kept) {
                    attributes.insert(COLOR.to_owned(), original);
                }
            }
            None if name("fallback") == Some(COLOR) => {
                attributes.shift_remove(COLOR);
            }
            None => {}
        }
    }
    remove_extension(primitive, EXTENSION);
}

/// Removes our textures with their images and samplers, as far as they stand at the end of their arrays:
/// elsewhere they would move the numbers of others.
fn remove_textures(root: &mut Value, ours: &[usize]) {
    let count = |root: &Value, key: &str| list(root, key).len();
    let (mut images, mut samplers) = (Vec::new(), Vec::new());
    while let Some(last) = count(root, "textures").checked_sub(1).filter(|t| ours.contains(t)) {
        if let Some(texture) = array(root, "textures").pop() {
            images.extend(texture.get("source").and_then(whole));
            samplers.extend(texture.get("sampler").and_then(whole));
        }
        if last == 0 {
            object(root).shift_remove("textures");
        }
    }
    for (key, role, removed) in [("images", "source", images), ("samplers", "sampler", samplers)] {
        while let Some(last) = count(root, key).checked_sub(1).filter(|&n| removed.contains(&(n as u64))) {
            let used =
                list(root, "textures").iter().any(|t| t.to_string().contains(&format!("\"{role}\":{last}")));
            if used {
                break;
            }
            array(root, key).pop();
            if last == 0 {
                object(root).shift_remove(key);
            }
        }
    }
}
