//! A floor and a wall that meet, as a `.gltf` with everything around it that a bake must leave alone.

use lightkiln_texel::{PngDepth, write_png};
use serde_json::{Value, json};

/// The scene's JSON, with its buffer in `buffer_uri`, and that buffer.
///
/// Node 0 is the room; node 1 a camera; node 2 a second floor that only scene 1 shows.
pub fn room(buffer_uri: &str) -> (Value, Vec<u8>) {
    // Two unit squares each of which has four vertices: y = 0, and z = 0.
    let positions = [
        [0.0, 0.0, 0.0],
        [1.0, 0.0, 0.0],
        [1.0, 0.0, 1.0],
        [0.0, 0.0, 1.0],
        [0.0, 0.0, 0.0],
        [1.0, 0.0, 0.0],
        [1.0, 1.0, 0.0],
        [0.0, 1.0, 0.0_f32],
    ];
    let normals = [[[0.0, 1.0, 0.0]; 4], [[0.0, 0.0, 1.0_f32]; 4]];
    let indices: [u16; 12] = [0, 2, 1, 0, 3, 2, 4, 5, 6, 4, 6, 7];
    let mut binary = Vec::new();
    let floats = |values: &[f32], binary: &mut Vec<u8>| {
        values.iter().for_each(|v| binary.extend(v.to_le_bytes()));
    };
    floats(positions.as_flattened(), &mut binary);
    floats(normals.as_flattened().as_flattened(), &mut binary);
    indices.iter().for_each(|i| binary.extend(i.to_le_bytes()));
    floats(&[0.0, 1.0], &mut binary); // times
    floats(&[0.0, 0.0, 0.0, 1.0, 0.0, 0.7, 0.0, 0.7], &mut binary); // rotations
    let json = json!({
        "asset": {"version": "2.0", "generator": "by hand", "copyright": "© nobody", "extras": {"année": 1.10}},
        "extensionsUsed": ["ACME_notes", "KHR_materials_ior"],
        "extensions": {"ACME_notes": {"text": "of a kind that nobody knows", "numbers": [1e-7, 0.1, 3]}},
        "scene": 0,
        "scenes": [{"nodes": [0, 1], "name": "room"}, {"nodes": [2], "name": "floor"}],
        "nodes": [
            {"mesh": 0, "name": "corner", "extras": {"tags": ["a", null]}, "extensions": {"ACME_notes": {"id": 4}}},
            {"camera": 0, "translation": [0.5, 0.5, 3.0]},
            {"mesh": 1, "name": "floor"},
        ],
        "cameras": [{"type": "perspective", "perspective": {"yfov": 0.7, "znear": 0.01}}],
        "meshes": [
            {"name": "corner", "extras": {"lod": 0}, "primitives": [
                {"attributes": {"POSITION": 0, "NORMAL": 1}, "indices": 2, "material": 0, "extras": {"kept": true}}]},
            {"primitives": [{"attributes": {"POSITION": 0, "NORMAL": 1}, "indices": 3, "material": 0}]},
        ],
        "materials": [{
            "name": "plaster",
            "pbrMetallicRoughness": {"baseColorFactor": [0.8, 0.7, 0.6, 1.0], "roughnessFactor": 0.123456789},
            "extensions": {"KHR_materials_ior": {"ior": 1.45}},
            "doubleSided": true,
        }],
        "animations": [{
            "name": "turn",
            "channels": [{"sampler": 0, "target": {"node": 1, "path": "rotation"}}],
            "samplers": [{"input": 4, "output": 5, "interpolation": "STEP"}],
        }],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": 8, "type": "VEC3", "min": [0, 0, 0], "max": [1, 1, 1]},
            {"bufferView": 1, "componentType": 5126, "count": 8, "type": "VEC3"},
            {"bufferView": 2, "componentType": 5123, "count": 12, "type": "SCALAR"},
            {"bufferView": 2, "componentType": 5123, "count": 6, "type": "SCALAR"},
            {"bufferView": 3, "componentType": 5126, "count": 2, "type": "SCALAR", "min": [0], "max": [1]},
            {"bufferView": 3, "byteOffset": 8, "componentType": 5126, "count": 2, "type": "VEC4", "name": "turns"},
        ],
        "bufferViews": [
            {"buffer": 0, "byteLength": 96, "target": 34962},
            {"buffer": 0, "byteOffset": 96, "byteLength": 96, "target": 34962},
            {"buffer": 0, "byteOffset": 192, "byteLength": 24, "target": 34963},
            {"buffer": 0, "byteOffset": 216, "byteLength": 40},
        ],
        "buffers": [{"uri": buffer_uri, "byteLength": 256}],
    });
    (json, binary)
}

/// The corner of a room with sets of texture coordinates, 0 to 1 over both of its squares.
pub fn corner(sets: usize) -> (Value, Vec<u8>) {
    let (mut json, mut binary) = room("room.bin");
    let uv = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0_f32]];
    let start = binary.len();
    for _ in 0..2 {
        uv.iter().flatten().for_each(|v| binary.extend(v.to_le_bytes()));
    }
    let list = |json: &mut Value, key: &str, new: Value| {
        let list = json[key].as_array_mut().expect("a list");
        list.push(new);
        list.len() - 1
    };
    let view = list(&mut json, "bufferViews", json!({"buffer": 0, "byteOffset": start, "byteLength": 64}));
    for set in 0..sets {
        let accessor = json!({"bufferView": view, "componentType": 5126, "count": 8, "type": "VEC2"});
        let accessor = list(&mut json, "accessors", accessor);
        for mesh in 0..2 {
            json["meshes"][mesh]["primitives"][0]["attributes"][format!("TEXCOORD_{set}")] = accessor.into();
        }
    }
    json["buffers"][0] = json!({"byteLength": binary.len()});
    (json, binary)
}

/// Adds a gray image, so many texels wide and high, and its texture.
pub fn add_texture(
    json: &mut Value,
    binary: &mut Vec<u8>,
    side: u32,
    value: impl Fn(u32, u32) -> f32,
) -> usize {
    let texels: Vec<f32> = (0..side * side).map(|t| value(t % side, t / side)).collect();
    let mut png = Vec::new();
    write_png(&mut png, [side; 2], 1, PngDepth::Eight, &texels).expect("a small image");
    binary.resize(binary.len().next_multiple_of(4), 0);
    let view = json["bufferViews"].as_array_mut().expect("a list");
    view.push(json!({"buffer": 0, "byteOffset": binary.len(), "byteLength": png.len()}));
    let view = view.len() - 1;
    binary.extend(png);
    json["images"] = json!([{"bufferView": view, "mimeType": "image/png"}]);
    json["textures"] = json!([{"source": 0}]);
    json["buffers"][0]["byteLength"] = binary.len().into();
    0
}
