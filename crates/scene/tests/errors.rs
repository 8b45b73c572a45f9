//! One clear error each, with the place where it is.
#![allow(clippy::unwrap_used, clippy::print_stdout)] // helpers of tests are tests

mod common;

use common::{Folder, Gltf, glb, light, rich};
use lightkiln_scene::{ReadOptions, Scene, SceneError, write};
use serde_json::json;

fn fails(g: &Gltf) -> SceneError {
    let error = g.read().unwrap_err();
    assert!(!error.remedy().is_empty());
    error
}

/// The message and the place in one line.
fn text(error: &SceneError) -> String {
    format!("{error} in {}", error.place())
}

#[test]
fn error_position_not_finite_names_its_place() {
    let mut g = Gltf::quad();
    g.bin[16..20].copy_from_slice(&f32::NAN.to_le_bytes());
    let error = fails(&g);
    assert!(matches!(error, SceneError::NotFinite { element: 1, .. }), "{error}");
    let place = error.place();
    assert_eq!(
        (place.node, place.mesh, place.primitive, place.accessor),
        (Some(0), Some(0), Some(0), Some(0))
    );
    assert!(
        text(&error)
            .ends_with("meshes[0].primitives[0].POSITION (accessors[0], mesh \"quad\", nodes[0] \"first\")"),
        "{}",
        text(&error)
    );
}

#[test]
fn error_vertex_index_names_primitive_and_value() {
    let mut g = Gltf::quad();
    let i = g.indices(&[0, 1, 9]);
    g.json["meshes"][0]["primitives"][0]["indices"] = i.into();
    let error = fails(&g);
    assert!(matches!(error, SceneError::VertexIndex { element: 2, index: 9, vertices: 4, .. }), "{error}");
    assert_eq!(error.place().primitive, Some(0));
}

#[test]
fn error_graph_cycles_and_two_parents() {
    let mut g = Gltf::quad();
    g.json["nodes"] =
        json!([{"mesh": 0, "children": [1]}, {"children": [2]}, {"children": [1], "name": "loop"}]);
    assert!(matches!(fails(&g), SceneError::TwoParents { .. }));
    g.json["nodes"] = json!([{"mesh": 0}, {"children": [2]}, {"children": [1], "name": "loop"}]);
    assert!(matches!(fails(&g), SceneError::Cycle { .. }));
    g.json["nodes"] = json!([{"mesh": 0, "children": [0]}]);
    assert!(matches!(fails(&g), SceneError::Cycle { .. }));
    g.json["nodes"] = json!([{"mesh": 0}]);
    g.json["scenes"][0]["nodes"] = json!([0, 0]);
    assert!(matches!(fails(&g), SceneError::TwoParents { .. }));
}

#[test]
fn error_references_out_of_range() {
    for pointer in [
        "/nodes/0/mesh",
        "/meshes/0/primitives/0/indices",
        "/meshes/0/primitives/0/attributes/POSITION",
        "/accessors/0/bufferView",
        "/bufferViews/0/buffer",
        "/scenes/0/nodes/0",
        "/scene",
    ] {
        let mut g = Gltf::quad();
        *g.json.pointer_mut(pointer).unwrap() = 77.into();
        let error = fails(&g);
        assert!(matches!(error, SceneError::Reference { index: 77, .. }), "{pointer}: {error}");
    }
    let mut g = Gltf::quad();
    g.json["meshes"][0]["primitives"][0]["material"] = 3.into();
    assert!(matches!(fails(&g), SceneError::Reference { index: 3, count: 0, .. }));
}

#[test]
fn error_absurd_counts_are_found_before_allocating() {
    for count in [5_u64, 1 << 31, u64::from(u32::MAX), u64::MAX] {
        let mut g = Gltf::quad();
        g.json["accessors"][0]["count"] = count.into();
        let error = fails(&g);
        assert!(
            matches!(error, SceneError::Truncated { .. } | SceneError::TooLarge { .. }),
            "{count}: {error}"
        );
    }
    let mut g = Gltf::quad();
    g.json["accessors"][0] = json!({"componentType": 5126, "type": "VEC3", "count": 4_000_000_000_u64});
    assert!(matches!(fails(&g), SceneError::TooLarge { .. }));
    let mut g = Gltf::quad();
    g.json["bufferViews"][0]["extensions"] = json!({"EXT_meshopt_compression": {
        "buffer": 0, "byteOffset": 0, "byteLength": 40, "byteStride": 12, "count": 4_000_000_000_u64, "mode": "ATTRIBUTES"}});
    assert!(matches!(fails(&g), SceneError::Truncated { .. }));
}

#[test]
fn error_counts_of_attributes_differ() {
    let mut g = Gltf::quad();
    g.json["accessors"][1]["count"] = 3.into();
    let error = fails(&g);
    assert!(matches!(error, SceneError::Count { count: 3, expected: 4, .. }), "{error}");
    assert_eq!(error.place().attribute.as_deref(), Some("NORMAL"));
}

#[test]
fn error_containers() {
    let bytes = Gltf::quad().glb();
    let read = |b: &[u8]| Scene::read_bytes(b, &ReadOptions::default());
    for end in [0, 4, 11, 12, 19, 30, bytes.len() - 1] {
        assert!(matches!(read(&bytes[..end]), Err(SceneError::Container { .. })), "{end}");
    }
    assert!(matches!(read(b"version https://git-lfs.github.com/spec/v1"), Err(SceneError::Container { .. })));
    assert!(matches!(read(b"{\"asset\": "), Err(SceneError::Json { .. })));
    assert!(matches!(read(b"{\"asset\": {\"version\": \"1.0\"}}"), Err(SceneError::Version { .. })));
    let mut old = bytes.clone();
    old[4] = 1;
    assert!(matches!(read(&old), Err(SceneError::Container { .. })));
    let deep = format!("{{\"asset\":{{\"version\":\"2.0\"}},\"x\":{}}}", "[".repeat(100_000));
    assert!(matches!(read(deep.as_bytes()), Err(SceneError::Json { .. })));
}

#[test]
fn error_buffers_missing_outside_or_short() {
    let folder = Folder::new("errors");
    let path = folder.0.join("scene.gltf");
    let mut g = Gltf::quad();
    g.json["buffers"][0]["byteLength"] = g.bin.len().into();
    let mut read = |uri: &str| {
        g.json["buffers"][0]["uri"] = uri.into();
        std::fs::write(&path, serde_json::to_vec(&g.json).unwrap()).unwrap();
        Scene::read(&path, &ReadOptions::default()).unwrap_err()
    };
    let missing = read("missing.bin");
    assert!(matches!(missing, SceneError::Io { .. }), "{missing}");
    assert_eq!(missing.place().file.as_deref(), Some(path.as_path()));
    assert!(matches!(read("../x.bin"), SceneError::Outside { .. }));
    assert!(matches!(read("https://x.org/x.bin"), SceneError::Outside { .. }));
    std::fs::write(folder.0.join("short.bin"), [0; 8]).unwrap();
    assert!(matches!(read("short.bin"), SceneError::Truncated { available: 8, .. }));
    assert!(matches!(
        Scene::read(&folder.0.join("none.glb"), &ReadOptions::default()),
        Err(SceneError::Io { .. })
    ));
    let no_chunk = glb(&serde_json::to_vec(&Gltf::quad().json).unwrap(), &[]);
    assert!(Scene::read_bytes(&no_chunk, &ReadOptions::default()).is_err());
}

#[test]
fn error_required_extensions() {
    let mut g = Gltf::quad();
    g.json["extensionsRequired"] =
        json!(["KHR_texture_basisu", "KHR_materials_unlit", "KHR_texture_transform"]);
    assert!(g.read().is_ok());
    g.json["extensionsRequired"] = json!(["VENDOR_geometry"]);
    let error = fails(&g);
    assert!(error.to_string().contains("VENDOR_geometry"), "{error}");
}

#[test]
fn error_damaged_draco() {
    let mut g = Gltf::quad();
    let view = g.view(b"DRACO\x02\x02\x01\x01 and then nothing");
    g.json["meshes"][0]["primitives"][0]["extensions"] =
        json!({"KHR_draco_mesh_compression": {"bufferView": view, "attributes": {"POSITION": 0}}});
    let error = fails(&g);
    assert!(matches!(error, SceneError::Codec { codec: "Draco", .. }), "{error}");
    assert_eq!(error.place().primitive, Some(0));
}

#[test]
fn error_light_that_does_not_fit() {
    let folder = Folder::new("unfit");
    let scene = Gltf::quad().read().unwrap();
    let mut wrong = light(&scene, true);
    wrong.parts[0].corner_codes[0].pop();
    let out = folder.0.join("out.glb");
    assert!(matches!(write(&scene, &wrong, &out), Err(SceneError::Light { count: 1, expected: 2, .. })));
    assert!(matches!(
        write(&scene, &light(&scene, true), &folder.0.join("out.obj")),
        Err(SceneError::OutputName { .. })
    ));
    let other = rich().read().unwrap();
    assert!(matches!(write(&other, &light(&scene, true), &out), Err(SceneError::Light { .. })));
    assert_eq!(std::fs::read_dir(&folder.0).unwrap().count(), 0);
}
