//! The GLB container: a header, a JSON chunk and a binary chunk (glTF 2.0, chapter 4).

use glam::Vec3;
use serde_json::{Map, Value, json};

use crate::PropsError;
use crate::model::{Alpha, Assembly, Light, LightKind, Material, Place, Surface};

const ARRAY_BUFFER: u32 = 34962;
const ELEMENT_ARRAY_BUFFER: u32 = 34963;
const FLOAT: u32 = 5126;
const UNSIGNED_SHORT: u32 = 5123;
const UNSIGNED_INT: u32 = 5125;

/// The binary chunk and what points into it.
#[derive(Default)]
struct Buffer {
    bytes: Vec<u8>,
    views: Vec<Value>,
    accessors: Vec<Value>,
}

impl Buffer {
    fn view(&mut self, target: Option<u32>, write: impl FnOnce(&mut Vec<u8>)) -> usize {
        let start = self.bytes.len();
        write(&mut self.bytes);
        let mut view = json!({ "buffer": 0, "byteOffset": start, "byteLength": self.bytes.len() - start });
        if let Some(target) = target {
            view["target"] = json!(target);
        }
        while !self.bytes.len().is_multiple_of(4) {
            self.bytes.push(0);
        }
        self.views.push(view);
        self.views.len() - 1
    }

    fn accessor(&mut self, mut accessor: Value, view: usize) -> usize {
        accessor["bufferView"] = json!(view);
        self.accessors.push(accessor);
        self.accessors.len() - 1
    }

    fn vectors(&mut self, vectors: &[Vec3], with_bounds: bool) -> usize {
        let view = self.view(Some(ARRAY_BUFFER), |bytes| {
            vectors.iter().for_each(|v| v.to_array().iter().for_each(|x| bytes.extend(x.to_le_bytes())));
        });
        let mut accessor = json!({ "componentType": FLOAT, "count": vectors.len(), "type": "VEC3" });
        if with_bounds {
            let low = vectors.iter().fold(Vec3::INFINITY, |a, &b| a.min(b));
            let high = vectors.iter().fold(Vec3::NEG_INFINITY, |a, &b| a.max(b));
            accessor["min"] = json!(low.to_array());
            accessor["max"] = json!(high.to_array());
        }
        self.accessor(accessor, view)
    }

    fn primitive(&mut self, surface: &Surface, material: usize) -> Value {
        let mut attributes = Map::new();
        attributes.insert("POSITION".into(), json!(self.vectors(&surface.positions, true)));
        attributes.insert("NORMAL".into(), json!(self.vectors(&surface.normals, false)));
        if !surface.uvs.is_empty() {
            let view = self.view(Some(ARRAY_BUFFER), |bytes| {
                surface.uvs.iter().flatten().for_each(|x| bytes.extend(x.to_le_bytes()));
            });
            let uvs = json!({ "componentType": FLOAT, "count": surface.uvs.len(), "type": "VEC2" });
            attributes.insert("TEXCOORD_0".into(), json!(self.accessor(uvs, view)));
        }
        let short = surface.positions.len() < 65_535;
        let view = self.view(Some(ELEMENT_ARRAY_BUFFER), |bytes| {
            for &i in surface.triangles.iter().flatten() {
                if short {
                    bytes.extend((i as u16).to_le_bytes());
                } else {
                    bytes.extend(i.to_le_bytes());
                }
            }
        });
        let kind = if short { UNSIGNED_SHORT } else { UNSIGNED_INT };
        let indices =
            json!({ "componentType": kind, "count": surface.triangles.len() * 3, "type": "SCALAR" });
        json!({
            "attributes": attributes,
            "indices": self.accessor(indices, view),
            "material": material,
            "mode": 4,
        })
    }
}

/// Writes a scene as a .glb file.
///
/// # Errors
/// [`PropsError::TooLarge`] for more than 4 GiB, and whatever writing JSON may meet.
pub fn write(assembly: &Assembly) -> Result<Vec<u8>, PropsError> {
    let mut buffer = Buffer::default();
    let meshes: Vec<Value> = assembly
        .meshes
        .iter()
        .map(|mesh| {
            let primitives: Vec<Value> =
                mesh.primitives.iter().map(|(surface, m)| buffer.primitive(surface, m.0)).collect();
            json!({ "name": mesh.name, "primitives": primitives })
        })
        .collect();
    let mut images = Vec::new();
    let mut materials = Vec::new();
    for m in &assembly.materials {
        let mut value = material(m);
        if let Some(png) = &m.texture {
            value["pbrMetallicRoughness"]["baseColorTexture"] = json!({ "index": images.len() });
            let view = buffer.view(None, |bytes| bytes.extend_from_slice(png));
            images.push(json!({ "name": m.name, "bufferView": view, "mimeType": "image/png" }));
        }
        materials.push(value);
    }
    let nodes: Vec<Value> = (0..assembly.nodes.len()).map(|i| node(assembly, i)).collect();
    let roots: Vec<usize> = (0..nodes.len()).filter(|&i| assembly.nodes[i].parent.is_none()).collect();
    let mut document = json!({
        "asset": { "version": "2.0", "generator": "lightkiln-props" },
        "scene": 0,
        "scenes": [{ "nodes": roots }],
        "nodes": nodes,
        "meshes": meshes,
        "materials": materials,
        "accessors": buffer.accessors,
        "bufferViews": buffer.views,
        "buffers": [{ "byteLength": buffer.bytes.len() }],
    });
    if !images.is_empty() {
        document["textures"] = (0..images.len()).map(|i| json!({ "sampler": 0, "source": i })).collect();
        document["samplers"] =
            json!([{ "magFilter": 9729, "minFilter": 9987, "wrapS": 10497, "wrapT": 10497 }]);
        document["images"] = json!(images);
    }
    if !assembly.lights.is_empty() {
        let lights: Vec<Value> = assembly.lights.iter().map(light).collect();
        document["extensions"] = json!({ "KHR_lights_punctual": { "lights": lights } });
    }
    let used = [
        ("KHR_lights_punctual", !assembly.lights.is_empty()),
        ("KHR_materials_emissive_strength", assembly.materials.iter().any(|m| m.emissive_strength != 1.0)),
        ("KHR_materials_transmission", assembly.materials.iter().any(|m| m.transmission > 0.0)),
    ];
    let used: Vec<&str> = used.into_iter().filter_map(|(name, is)| is.then_some(name)).collect();
    if !used.is_empty() {
        document["extensionsUsed"] = json!(used);
    }
    container(&document, buffer.bytes)
}

fn light(light: &Light) -> Value {
    let mut value = json!({ "name": light.name, "color": light.color, "intensity": light.intensity });
    value["type"] = match light.kind {
        LightKind::Sun => json!("directional"),
        LightKind::Point => json!("point"),
        LightKind::Spot { inner, outer } => {
            value["spot"] = json!({ "innerConeAngle": inner, "outerConeAngle": outer });
            json!("spot")
        }
    };
    value
}

fn container(document: &Value, binary: Vec<u8>) -> Result<Vec<u8>, PropsError> {
    let mut text = serde_json::to_vec(document)?;
    while !text.len().is_multiple_of(4) {
        text.push(b' ');
    }
    let total = 12 + 8 + text.len() as u64 + 8 + binary.len() as u64;
    let limit = u64::from(u32::MAX);
    if total > limit {
        return Err(PropsError::TooLarge { bytes: total, limit });
    }
    let mut out = Vec::with_capacity(total as usize);
    out.extend(b"glTF");
    for word in [2, total as u32, text.len() as u32] {
        out.extend(word.to_le_bytes());
    }
    out.extend(b"JSON");
    out.extend(text);
    out.extend((binary.len() as u32).to_le_bytes());
    out.extend(b"BIN\0");
    out.extend(binary);
    Ok(out)
}

fn material(m: &Material) -> Value {
    let mut value = json!({
        "name": m.name,
        "pbrMetallicRoughness": {
            "baseColorFactor": m.color,
            "metallicFactor": m.metallic,
            "roughnessFactor": m.roughness,
        },
    });
    if m.emissive != [0.0; 3] {
        value["emissiveFactor"] = json!(m.emissive);
    }
    if m.emissive_strength != 1.0 {
        value["extensions"]["KHR_materials_emissive_strength"] =
            json!({ "emissiveStrength": m.emissive_strength });
    }
    if m.transmission > 0.0 {
        value["extensions"]["KHR_materials_transmission"] = json!({ "transmissionFactor": m.transmission });
    }
    match m.alpha {
        Alpha::Opaque => {}
        Alpha::Mask(cutoff) => {
            value["alphaMode"] = json!("MASK");
            value["alphaCutoff"] = json!(cutoff);
        }
        Alpha::Blend => value["alphaMode"] = json!("BLEND"),
    }
    if m.double_sided {
        value["doubleSided"] = json!(true);
    }
    value
}

fn node(assembly: &Assembly, i: usize) -> Value {
    let node = &assembly.nodes[i];
    let mut value = json!({ "name": node.name });
    if let Some(mesh) = node.mesh {
        value["mesh"] = json!(mesh.0);
    }
    if let Some(light) = node.light {
        value["extensions"] = json!({ "KHR_lights_punctual": { "light": light.0 } });
    }
    let default = Place::default();
    if node.place.translation != default.translation {
        value["translation"] = json!(node.place.translation.to_array());
    }
    if node.place.rotation != default.rotation {
        value["rotation"] = json!(node.place.rotation.to_array());
    }
    if node.place.scale != default.scale {
        value["scale"] = json!(node.place.scale.to_array());
    }
    let children: Vec<usize> =
        (0..assembly.nodes.len()).filter(|&c| assembly.nodes[c].parent.is_some_and(|p| p.0 == i)).collect();
    if !children.is_empty() {
        value["children"] = json!(children);
    }
    value
}
