//! Small glTF files built in code.
#![allow(dead_code)] // every test file uses another part

use lightkiln_scene::{
    BakedLight, ExtensionInfo, Fallback, LayerFiles, PartLight, ReadOptions, Scene, SceneError,
};
use serde_json::{Value, json};

/// A file with one buffer.
#[derive(Clone)]
pub struct Gltf {
    pub json: Value,
    pub bin: Vec<u8>,
}

impl Gltf {
    pub fn new() -> Self {
        let json = json!({
            "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}], "nodes": [{"mesh": 0, "name": "first"}],
            "meshes": [{"name": "quad", "primitives": []}], "accessors": [], "bufferViews": [], "buffers": [{"byteLength": 0}]
        });
        Self { json, bin: Vec::new() }
    }

    pub fn push(&mut self, key: &str, value: Value) -> usize {
        let array =
            self.json.as_object_mut().unwrap().entry(key).or_insert(json!([])).as_array_mut().unwrap();
        array.push(value);
        array.len() - 1
    }

    pub fn view(&mut self, bytes: &[u8]) -> usize {
        let offset = self.bin.len();
        self.bin.extend_from_slice(bytes);
        self.bin.resize(self.bin.len().next_multiple_of(4), 0);
        self.push("bufferViews", json!({"buffer": 0, "byteOffset": offset, "byteLength": bytes.len()}))
    }

    pub fn accessor(&mut self, component: u64, kind: &str, count: usize, bytes: &[u8]) -> usize {
        let view = self.view(bytes);
        self.push(
            "accessors",
            json!({"bufferView": view, "componentType": component, "type": kind, "count": count}),
        )
    }

    pub fn floats(&mut self, kind: &str, values: &[f32]) -> usize {
        let width = match kind {
            "SCALAR" => 1,
            "VEC2" => 2,
            "VEC3" => 3,
            "VEC4" => 4,
            _ => 16,
        };
        let bytes: Vec<u8> = values.iter().flat_map(|v| v.to_le_bytes()).collect();
        self.accessor(5126, kind, values.len() / width, &bytes)
    }

    pub fn indices(&mut self, values: &[u16]) -> usize {
        let bytes: Vec<u8> = values.iter().flat_map(|v| v.to_le_bytes()).collect();
        self.accessor(5123, "SCALAR", values.len(), &bytes)
    }

    pub fn primitive(&mut self, primitive: Value) -> usize {
        let primitives = self.json["meshes"][0]["primitives"].as_array_mut().unwrap();
        primitives.push(primitive);
        primitives.len() - 1
    }

    /// A unit square in the plane z = 0, facing +z, of two triangles.
    pub fn quad() -> Self {
        let mut g = Self::new();
        let p = g.floats("VEC3", &QUAD);
        let n = g.floats("VEC3", &[0., 0., 1., 0., 0., 1., 0., 0., 1., 0., 0., 1.]);
        let i = g.indices(&[0, 1, 2, 2, 1, 3]);
        g.json["accessors"][p]["min"] = json!([0.0, 0.0, 0.0]);
        g.json["accessors"][p]["max"] = json!([1.0, 1.0, 0.0]);
        g.primitive(json!({"attributes": {"POSITION": p, "NORMAL": n}, "indices": i}));
        g
    }

    pub fn glb(&self) -> Vec<u8> {
        let mut root = self.json.clone();
        if root["buffers"][0].is_object() {
            root["buffers"][0]["byteLength"] = self.bin.len().into();
        }
        glb(&serde_json::to_vec(&root).unwrap(), &self.bin)
    }

    pub fn read(&self) -> Result<Scene, SceneError> {
        Scene::read_bytes(&self.glb(), &ReadOptions::default())
    }
}

pub const QUAD: [f32; 12] = [0., 0., 0., 1., 0., 0., 0., 1., 0., 1., 1., 0.];

pub fn glb(json: &[u8], bin: &[u8]) -> Vec<u8> {
    let mut json = json.to_vec();
    json.resize(json.len().next_multiple_of(4), b' ');
    let mut bin = bin.to_vec();
    bin.resize(bin.len().next_multiple_of(4), 0);
    let mut out = b"glTF".to_vec();
    out.extend(2_u32.to_le_bytes());
    out.extend(((28 + json.len() + bin.len()) as u32).to_le_bytes());
    for (kind, data) in [(0x4e4f_534a_u32, &json), (0x004e_4942, &bin)] {
        out.extend((data.len() as u32).to_le_bytes());
        out.extend(kind.to_le_bytes());
        out.extend(data);
    }
    out
}

/// The JSON of a GLB file.
pub fn json_of(glb: &[u8]) -> Value {
    let length = u32::from_le_bytes([glb[12], glb[13], glb[14], glb[15]]) as usize;
    serde_json::from_slice(&glb[20..20 + length]).unwrap()
}

pub fn png(image: &image::RgbaImage) -> Vec<u8> {
    let mut out = std::io::Cursor::new(Vec::new());
    image.write_to(&mut out, image::ImageFormat::Png).unwrap();
    out.into_inner()
}

/// One layer of one page: one code for each triangle (they split shared vertices), or one for each glTF vertex
/// (nothing splits). The fallback is (1/2, 1/4, 1).
pub fn light(scene: &Scene, by_triangle: bool) -> BakedLight {
    let parts = (0..scene.parts.len()).map(|part| PartLight {
        corner_codes: vec![codes(scene, part, |t, v| [if by_triangle { t } else { v }, 0x8000])],
        corner_fallback: vec![[[0.5, 0.25, 1.0]; 3]; scene.parts[part].triangles.len()],
    });
    BakedLight {
        parts: parts.collect(),
        layers: vec![layer("ambientOcclusion", 1, 1)],
        extension: ExtensionInfo { root: json!({"generator": "a test"}) },
        fallback: Fallback::Color0,
        ..BakedLight::default()
    }
}

/// The codes of a part: of a triangle and a glTF vertex.
pub fn codes(scene: &Scene, part: usize, code: impl Fn(u16, u16) -> [u16; 2]) -> Vec<[[u16; 2]; 3]> {
    let triangles = 0..scene.parts[part].triangles.len();
    triangles.map(|t| scene.gltf_corners(part, t).map(|v| code(t as u16, v as u16))).collect()
}

/// A layer of black pages.
pub fn layer(signal: &str, channels: usize, pages: usize) -> LayerFiles {
    let info = json!({"signal": signal, "channels": channels, "curve": "linear", "range": [0, 1]});
    LayerFiles {
        pages: vec![png(&image::RgbaImage::new(4, 4)); pages],
        info: info.as_object().unwrap().clone(),
        ..LayerFiles::default()
    }
}

/// A scalar layer, an RGB layer with a logarithmic curve, and one with a table; all have two pages.
pub fn three_layers(scene: &Scene) -> BakedLight {
    let mut light = light(scene, true);
    for (number, part) in light.parts.iter_mut().enumerate() {
        // The first layer has a code per triangle, the second one per vertex, the third one in all.
        part.corner_codes.push(codes(scene, number, |_, v| [v, 0x9000]));
        part.corner_codes.push(codes(scene, number, |_, _| [7, 0x8000]));
    }
    let table = LayerFiles { table: Some(png(&image::RgbaImage::new(256, 1))), ..layer("bentNormal", 3, 2) };
    light.layers = vec![layer("ambientOcclusion", 1, 2), layer("irradiance", 3, 2), table];
    let log = json!({"curve": "log", "white": 500.0, "range": [0.0, 4000.0], "unit": "lux"});
    light.layers[1].info.extend(log.as_object().unwrap().clone());
    light
}

/// A folder that goes away again.
pub struct Folder(pub std::path::PathBuf);

impl Folder {
    pub fn new(name: &str) -> Self {
        let path = std::env::temp_dir().join(format!("lightkiln-{name}-{}", std::process::id()));
        let _ = std::fs::remove_dir_all(&path);
        std::fs::create_dir_all(&path).unwrap();
        Self(path)
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        let _ = std::fs::remove_dir_all(&self.0);
    }
}

/// A file with about everything in it: morph targets, a skin, sparse and quantized accessors, GPU instances,
/// masked and blended materials, strips, lines, animation, unknown extensions and extras.
pub fn rich() -> Gltf {
    let mut g = Gltf::quad();
    let uv = g.accessor(5123, "VEC2", 4, &[0, 0, 0, 0, 255, 255, 0, 0, 0, 0, 255, 255, 255, 255, 255, 255]);
    g.json["accessors"][uv]["normalized"] = true.into();
    let color = g.floats("VEC4", &[1., 0.5, 0.25, 1., 1., 1., 1., 0.5, 1., 1., 1., 1., 1., 1., 1., 0.]);
    let target = g.floats("VEC3", &[0.0; 12]);
    let values = g.view(&[0, 0, 128, 63, 0, 0, 0, 0, 0, 0, 0, 0]);
    let at = g.view(&[2]);
    g.json["accessors"][target]["sparse"] = json!({
        "count": 1, "indices": {"bufferView": at, "componentType": 5121}, "values": {"bufferView": values}});
    let joints = g.accessor(5121, "VEC4", 4, &[0, 1, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 1, 1, 0, 0]);
    let weights = g.floats("VEC4", &[0.5, 0.5, 0., 0., 1., 0., 0., 0., 0.5, 0.5, 0., 0., 0.3, 0.3, 0., 0.]);
    let mut image = image::RgbaImage::new(4, 4);
    image.pixels_mut().enumerate().for_each(|(i, p)| p.0 = [255, 255, 255, (i * 17) as u8]);
    let image = g.view(&png(&image));
    g.push("images", json!({"bufferView": image, "mimeType": "image/png"}));
    g.push("samplers", json!({"wrapS": 33648, "wrapT": 33071}));
    g.push("textures", json!({"source": 0, "sampler": 0}));
    let info =
        json!({"index": 0, "extensions": {"KHR_texture_transform": {"scale": [2, 2], "rotation": 0.5}}});
    g.push("materials", json!({"alphaMode": "MASK", "pbrMetallicRoughness": {"baseColorTexture": info}, "extras": {"a": 1.5}}));
    g.push(
        "materials",
        json!({"alphaMode": "BLEND", "doubleSided": true,
        "extensions": {"KHR_materials_transmission": {"transmissionFactor": 0.5}}}),
    );
    let primitive = &mut g.json["meshes"][0]["primitives"][0];
    primitive["material"] = 0.into();
    primitive["attributes"]["TEXCOORD_0"] = uv.into();
    primitive["attributes"]["COLOR_0"] = color.into();
    primitive["attributes"]["JOINTS_0"] = joints.into();
    primitive["attributes"]["WEIGHTS_0"] = weights.into();
    primitive["targets"] = json!([{"POSITION": target}]);
    let mut second = primitive.clone();
    second["material"] = 1.into();
    second["mode"] = 5.into();
    second["indices"] = g.indices(&[0, 1, 2, 3]).into();
    g.primitive(second);
    let lines = g.indices(&[0, 1]);
    g.primitive(json!({"attributes": {"POSITION": 0}, "indices": lines, "mode": 1}));
    g.json["meshes"][0]["weights"] = json!([0.5]);
    let bind =
        g.floats("MAT4", &[[1., 0., 0., 0., 0., 1., 0., 0., 0., 0., 1., 0., 0., 0., 0., 1.]; 2].concat());
    g.push("skins", json!({"joints": [2, 3], "inverseBindMatrices": bind}));
    g.json["nodes"] = json!([
        {"mesh": 0, "name": "first", "skin": 0, "children": [1], "scale": [1, 2, -3]},
        {"mesh": 0, "name": "second", "translation": [1, 2, 3], "extras": {"keep": [1, 2, 3]}},
        {"name": "joint", "translation": [0, 0, 1], "children": [3]},
        {"name": "joint2", "rotation": [0.0, 0.0, 0.707, 0.707]},
        {"mesh": 0, "extensions": {"EXT_mesh_gpu_instancing": {"attributes": {}}}}
    ]);
    g.json["scenes"] = json!([{"nodes": [0, 2, 4]}]);
    let move_to = g.floats("VEC3", &[0., 0., 0., 5., 0., 0.]);
    let turn = g.accessor(5122, "VEC4", 2, &[0, 0, 0, 0, 0, 0, 255, 127, 0, 0, 0, 0, 255, 127, 0, 0]);
    g.json["accessors"][turn]["normalized"] = true.into();
    g.json["nodes"][4]["extensions"]["EXT_mesh_gpu_instancing"]["attributes"] =
        json!({"TRANSLATION": move_to, "ROTATION": turn});
    let times = g.floats("SCALAR", &[0., 1.]);
    g.push(
        "animations",
        json!({"channels": [{"sampler": 0, "target": {"node": 1, "path": "translation"}}],
        "samplers": [{"input": times, "output": move_to}]}),
    );
    g.json["extensionsUsed"] = json!([
        "KHR_texture_transform",
        "KHR_materials_transmission",
        "EXT_mesh_gpu_instancing",
        "VENDOR_unknown"
    ]);
    g.json["extensionsRequired"] = json!(["EXT_mesh_gpu_instancing"]);
    g.json["extensions"] = json!({"VENDOR_unknown": {"z": 1, "a": [0.1, 1e-7, 123456789012345678_u64]}});
    g
}
