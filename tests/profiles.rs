//! Profiles: how light stands in a file, what its materials show, and that a new bake takes all of it back.
#![allow(clippy::unwrap_used)] // helpers of tests are tests

mod harness;

use std::path::{Path, PathBuf};

use harness::room::{add_texture, corner};
use harness::{Folder, bake, data, draft, fail, glb, glb_parts, lightkiln, succeed};
use lightkiln_bake::{FileLight, Opened, Opening};
use lightkiln_mesh::{SurfacePoint, TriangleId};
use lightkiln_texel::read_png;
use serde_json::{Value, json};

const SMALL: [&str; 4] = ["--samples", "6000", "--ao-distance", "1"];

fn with<'a>(extra: &[&'a str]) -> Vec<&'a str> {
    SMALL.iter().chain(extra).copied().collect()
}

fn read(path: &Path) -> (Value, Vec<u8>) {
    glb_parts(&std::fs::read(path).unwrap())
}

fn extension(root: &Value) -> &Value {
    &root["extensions"]["LIGHTKILN_lightmap"]
}

fn verify(path: &Path) {
    succeed([
        "verify".as_ref(),
        path.as_os_str(),
        "--points".as_ref(),
        "2000".as_ref(),
        "--rays".as_ref(),
        "256".as_ref(),
        "--quiet".as_ref(),
    ]);
}

/// Elements of an accessor of two 16-bit integers.
fn pairs(root: &Value, binary: &[u8], accessor: &Value) -> Vec<[u16; 2]> {
    let accessor = &root["accessors"][accessor.as_u64().unwrap() as usize];
    assert_eq!((&accessor["componentType"], &accessor["type"]), (&json!(5123), &json!("VEC2")));
    let view = &root["bufferViews"][accessor["bufferView"].as_u64().unwrap() as usize];
    let offset = |v: &Value| v["byteOffset"].as_u64().unwrap_or(0) as usize;
    let start = offset(view) + offset(accessor);
    let number = |at: usize| u16::from_le_bytes([binary[at], binary[at + 1]]);
    (0..accessor["count"].as_u64().unwrap() as usize)
        .map(|v| [number(start + 4 * v), number(start + 4 * v + 2)])
        .collect()
}

fn indices(root: &Value, binary: &[u8], primitive: &Value) -> Vec<usize> {
    let accessor = &root["accessors"][primitive["indices"].as_u64().unwrap() as usize];
    let view = &root["bufferViews"][accessor["bufferView"].as_u64().unwrap() as usize];
    let offset = |v: &Value| v["byteOffset"].as_u64().unwrap_or(0) as usize;
    let start = offset(view) + offset(accessor);
    let wide = accessor["componentType"] == 5125;
    (0..accessor["count"].as_u64().unwrap() as usize)
        .map(|i| {
            let at = start + i * if wide { 4 } else { 2 };
            let low = usize::from(u16::from_le_bytes([binary[at], binary[at + 1]]));
            if wide { low | usize::from(binary[at + 2]) << 16 } else { low }
        })
        .collect()
}

/// The image of a texture.
fn image(root: &Value, binary: &[u8], texture: &Value) -> lightkiln_texel::Image {
    let source = &root["textures"][texture.as_u64().unwrap() as usize]["source"];
    let view = &root["images"][source.as_u64().unwrap() as usize]["bufferView"];
    let view = &root["bufferViews"][view.as_u64().unwrap() as usize];
    let start = view["byteOffset"].as_u64().unwrap() as usize;
    read_png(&binary[start..start + view["byteLength"].as_u64().unwrap() as usize]).unwrap()
}

/// What a file shows in the middle of each triangle and near its corners, as its viewers do.
fn shown(path: &Path) -> Vec<(bool, f32)> {
    let opened = Opened::read(path, Opening { needs_light: true, ..Opening::default() }).unwrap();
    let surface = opened.scenery.surface("file", &opened.options).unwrap();
    let light = FileLight::read(&surface, "file").unwrap();
    let views = light.views().unwrap();
    let mut out = Vec::new();
    for triangle in (0..surface.mesh.triangle_count() as u32).map(TriangleId) {
        for barycentric in [[0.33, 0.33], [0.1, 0.8], [0.02, 0.05]] {
            let mut value = [0.0];
            light.show(&views, SurfacePoint { triangle, barycentric }, &mut value);
            out.push((light.is_texture(triangle), value[0]));
        }
    }
    out
}

fn write(folder: &Folder, name: &str, (json, binary): &(Value, Vec<u8>)) -> PathBuf {
    folder.write(name, glb(json, binary))
}

#[test]
fn stock_triangles_show_the_strip_or_a_chart_and_never_both() {
    let folder = Folder::new("stock-strip");
    let out = folder.path("out.glb");
    let report = bake(&data("contact.glb"), &out, &with(&["--profile", "stock"]));
    let (root, binary) = read(&out);
    let (ours, strip) = (extension(&root), &extension(&root)["strip"]);
    let size = [0, 1].map(|k| ours["pageSize"][k].as_u64().unwrap());
    let page = image(&root, &binary, &ours["layers"][0]["pages"][0]);
    assert_eq!((page.size.map(u64::from), page.channels, page.bits), (size, 1, 8));
    // All values in equal steps, in equal rows, and white behind them.
    let (row, texels) = (strip["row"].as_u64().unwrap() as usize, strip["texels"].as_u64().unwrap() as usize);
    assert_eq!(row + strip["rows"].as_u64().unwrap() as usize, size[1] as usize);
    let width = size[0] as usize;
    for y in row..size[1] as usize {
        for x in 0..width {
            let wanted = x.min(texels - 1) as f32 / (texels - 1) as f32;
            assert!((page.values[y * width + x] - wanted).abs() < 1e-6, "{x} {y}");
        }
    }
    let (mut colors, mut textures) = (0, 0);
    for primitive in
        root["meshes"].as_array().unwrap().iter().flat_map(|m| m["primitives"].as_array().unwrap())
    {
        let coordinates = pairs(&root, &binary, &primitive["attributes"]["TEXCOORD_0"]);
        for triangle in indices(&root, &binary, primitive).chunks(3) {
            let rows = [0, 1, 2].map(|k| f64::from(coordinates[triangle[k]][1]) / 65535.0 * size[1] as f64);
            let on_strip = rows.iter().filter(|r| **r > row as f64 + 1.5).count();
            let on_charts = rows.iter().filter(|r| **r < row as f64 - 0.5).count();
            assert!(on_strip == 3 || on_charts == 3, "{rows:?} around row {row}");
            colors += usize::from(on_strip == 3);
            textures += usize::from(on_charts == 3);
        }
    }
    assert_eq!(report["classes"]["texture"]["triangles"], textures);
    assert_eq!(report["classes"]["color"]["triangles"], colors);
    assert!(colors > 0 && textures > 0);
}

#[test]
fn stock_shows_what_eta_shows_where_both_show_vertex_values() {
    let folder = Folder::new("stock-eta");
    let (stock, eta) = (folder.path("stock.glb"), folder.path("eta.glb"));
    bake(&data("contact.glb"), &stock, &with(&["--profile", "stock"]));
    bake(&data("contact.glb"), &eta, &with(&[]));
    let (opened, mut compared) = (shown(&stock).into_iter().zip(shown(&eta)), 0);
    for ((stock_texture, a), (eta_texture, b)) in opened {
        if !stock_texture && !eta_texture {
            // Both have steps of their own: 1/4096 at worst on the strip. Blends at borders differ by the bound.
            assert!((a - b).abs() < 0.06, "{a} {b}");
            compared += usize::from((a - b).abs() < 3e-4);
        }
    }
    assert!(compared > 4000, "{compared}");
}

#[test]
fn profiles_are_verified_and_their_bytes_are_those_of_the_file() {
    let folder = Folder::new("profiles");
    for (profile, stride, attribute) in [
        ("eta", 4, "_LIGHTUV"),
        ("stock", 4, "TEXCOORD_0"),
        ("texcoord", 8, "TEXCOORD_0"),
        ("lightmap", 4, "TEXCOORD_0"),
    ] {
        let out = folder.path(&format!("{profile}.glb"));
        let report = bake(&data("contact.glb"), &out, &with(&["--profile", profile]));
        assert_eq!(report["settings"]["profile"], profile);
        verify(&out);
        let (root, _) = read(&out);
        let primitives =
            || root["meshes"].as_array().unwrap().iter().flat_map(|m| m["primitives"].as_array().unwrap());
        let vertices: u64 = primitives()
            .map(|p| {
                root["accessors"][p["attributes"][attribute].as_u64().unwrap() as usize]["count"]
                    .as_u64()
                    .unwrap()
            })
            .sum();
        assert_eq!(report["bytes"]["light"]["attribute"], vertices * stride, "{profile}");
        let size = &extension(&root)["pageSize"];
        let texels = size[0].as_u64().unwrap() * size[1].as_u64().unwrap();
        assert_eq!(report["bytes"]["light"]["atlas"], texels, "{profile}");
        let plain = ["stock", "lightmap"].contains(&profile);
        assert!(primitives().all(|p| p["attributes"]["COLOR_0"].is_null() == plain), "{profile}");
        let shows = |m: &Value| m["occlusionTexture"]["index"] == extension(&root)["layers"][0]["pages"][0];
        assert!(root["materials"].as_array().unwrap().iter().all(|m| shows(m) == plain), "{profile}");
        assert_eq!(root["extensionsRequired"], Value::Null);
        let inspected = succeed(["inspect".as_ref(), out.as_os_str(), "--json".as_ref()]);
        let inspected: Value = serde_json::from_str(&inspected).unwrap();
        assert_eq!(inspected["light"]["attribute"], vertices * stride, "{profile}");
        assert_eq!(inspected["light"]["atlas"], texels, "{profile}");
        let classes = folder.path("classes.png");
        let render =
            ["render".as_ref(), out.as_os_str(), "-o".as_ref(), classes.as_os_str(), "--mode".as_ref()];
        succeed(
            render.into_iter().chain(["light,classes,charts", "--size", "64", "--quiet"].map(AsRef::as_ref)),
        );
        let site = folder.path(profile);
        succeed([
            "view".as_ref(),
            out.as_os_str(),
            "--export".as_ref(),
            site.as_os_str(),
            "--quiet".as_ref(),
        ]);
    }
}

#[test]
fn stock_takes_the_next_set_of_texture_coordinates() {
    let folder = Folder::new("sets");
    for sets in 0..=3 {
        let (input, out) = (write(&folder, "in.glb", &corner(sets)), folder.path("out.glb"));
        let report = bake(&input, &out, &with(&["--profile", "stock"]));
        let (root, _) = read(&out);
        let primitive = &root["meshes"][0]["primitives"][0];
        let names: Vec<&String> = primitive["attributes"].as_object().unwrap().keys().collect();
        for set in 0..=sets {
            assert!(names.contains(&&format!("TEXCOORD_{set}")), "{names:?}");
        }
        assert_eq!(names.len(), 3 + sets);
        // The floor of the other scene has no light and keeps the material, so that the corner gets a copy.
        let materials = root["materials"].as_array().unwrap();
        assert_eq!((materials.len(), &primitive["material"]), (2, &json!(1)));
        assert!(materials[0]["occlusionTexture"].is_null());
        assert_eq!(materials[1]["occlusionTexture"]["texCoord"], sets);
        assert_eq!(materials[1]["name"], "plaster");
        assert_eq!(root["meshes"][1]["primitives"][0]["material"], 0);
        let warned = report["warnings"].to_string().contains("TEXCOORD_");
        assert_eq!(warned, sets > 1, "{}", report["warnings"]);
    }
}

#[test]
fn stock_copies_materials_for_primitives_with_different_sets() {
    let folder = Folder::new("copies");
    let (mut json, binary) = corner(1);
    // A second lit mesh without texture coordinates, and one without a material, beside the first.
    let plain = json!({"attributes": {"POSITION": 0, "NORMAL": 1}, "indices": 2, "material": 0});
    let bare = json!({"attributes": {"POSITION": 0, "NORMAL": 1}, "indices": 2});
    json["meshes"] = json!([json["meshes"][0], {"primitives": [plain]}, {"primitives": [bare]}]);
    json["nodes"][2] = json!({"mesh": 1, "translation": [5, 0, 0]});
    json["nodes"].as_array_mut().unwrap().push(json!({"mesh": 2, "translation": [0, 0, 5]}));
    json["scenes"] = json!([{"nodes": [0, 2, 3]}]);
    let (input, out) = (write(&folder, "in.glb", &(json, binary)), folder.path("out.glb"));
    bake(&input, &out, &with(&["--profile", "stock"]));
    let (root, _) = read(&out);
    let material = |mesh: usize| root["meshes"][mesh]["primitives"][0]["material"].as_u64().unwrap() as usize;
    let texcoord = |mesh: usize| &root["materials"][material(mesh)]["occlusionTexture"]["texCoord"];
    assert_eq!([0, 1, 2].map(texcoord), [&json!(1), &json!(0), &json!(0)]);
    assert!(material(0) != material(1) && material(1) != material(2));
    assert_eq!(root["materials"][material(2)].as_object().unwrap().len(), 1, "the default material");
    assert_eq!(root["materials"].as_array().unwrap().len(), 4);
    // Back: the materials are those of the input, and so are their uses.
    let eta = folder.path("eta.glb");
    bake(&out, &eta, &with(&[]));
    let ((before, _), (after, _)) = (read(&input), read(&eta));
    assert_eq!(before["materials"].to_string(), after["materials"].to_string());
    for mesh in 0..3 {
        let [old, new] = [&before, &after].map(|r| &r["meshes"][mesh]["primitives"][0]);
        assert_eq!(old["material"], new["material"], "{mesh}");
        let texcoords = |p: &Value| {
            p["attributes"].as_object().unwrap().keys().filter(|k| k.starts_with("TEXCOORD")).count()
        };
        assert_eq!(texcoords(old), texcoords(new), "{mesh}");
    }
}

#[test]
fn stock_materials_of_variants_follow_and_come_back() {
    let folder = Folder::new("variants");
    let (mut json, binary) = corner(1);
    json["materials"].as_array_mut().unwrap().push(json!({"name": "red"}));
    json["extensionsUsed"].as_array_mut().unwrap().push("KHR_materials_variants".into());
    json["extensions"]["KHR_materials_variants"] = json!({"variants": [{"name": "plain"}, {"name": "red"}]});
    let mappings = json!([{"material": 0, "variants": [0]}, {"material": 1, "variants": [1]}]);
    json["meshes"][0]["primitives"][0]["extensions"] =
        json!({"KHR_materials_variants": {"mappings": mappings}});
    let (input, out) = (write(&folder, "in.glb", &(json, binary)), folder.path("out.glb"));
    bake(&input, &out, &with(&["--profile", "stock"]));
    let (root, _) = read(&out);
    let mappings = &root["meshes"][0]["primitives"][0]["extensions"]["KHR_materials_variants"]["mappings"];
    for mapping in mappings.as_array().unwrap() {
        let material = &root["materials"][mapping["material"].as_u64().unwrap() as usize];
        assert_eq!(material["occlusionTexture"]["texCoord"], 1, "{mapping}");
    }
    // The floor shows the plain one without light, nobody else the red one.
    assert_eq!((&mappings[0]["material"], &mappings[1]["material"]), (&json!(2), &json!(1)));
    let again = folder.path("again.glb");
    bake(&out, &again, &with(&[]));
    let ((before, _), (after, _)) = (read(&input), read(&again));
    assert_eq!(before["materials"].to_string(), after["materials"].to_string());
    let mapped =
        |r: &Value| r["meshes"][0]["primitives"][0]["extensions"]["KHR_materials_variants"].to_string();
    assert_eq!(mapped(&before), mapped(&after));
}

#[test]
fn stock_occlusion_of_the_asset_is_multiplied_kept_or_replaced() {
    let folder = Folder::new("authored");
    let (mut json, mut binary) = corner(1);
    let texture = add_texture(&mut json, &mut binary, 8, |x, _| if x < 4 { 0.2 } else { 0.8 });
    json["extensionsUsed"].as_array_mut().unwrap().push("KHR_texture_transform".into());
    json["materials"][0]["occlusionTexture"] = json!({"index": texture, "strength": 0.5,
        "extensions": {"KHR_texture_transform": {"offset": [0.25, 0]}}});
    // Beside it a wall without a texture, as something must remain with `keep`.
    let wall = json!({"attributes": {"POSITION": 0, "NORMAL": 1}, "indices": 2});
    json["meshes"][1] = json!({"primitives": [wall]});
    json["scenes"][0]["nodes"] = json!([0, 2]);
    json["nodes"][2]["translation"] = json!([9, 0, 0]);
    let input = write(&folder, "in.glb", &(json, binary));
    let bakes = ["multiply", "keep", "replace"].map(|how| {
        let out = folder.path(&format!("{how}.glb"));
        let report = bake(&input, &out, &with(&["--profile", "stock", "--authored-occlusion", how]));
        verify(&out);
        (out, report)
    });
    let [(multiply, _), (keep, kept), (replace, _)] = &bakes;
    let means = [multiply, replace].map(|path| {
        let values: Vec<f32> = shown(path).iter().take(12).map(|(_, v)| *v).collect();
        values.iter().sum::<f32>() / values.len() as f32
    });
    // Half of 0.2 and 0.8 at half strength: 0.6 and 0.9 of it, as far as the points fall into the halves.
    let ratio = means[0] / means[1];
    assert!((0.6..0.9).contains(&ratio), "{means:?}");
    for (path, own) in [(multiply, false), (replace, false), (keep, true)] {
        let (root, _) = read(path);
        let material = &root["materials"][0]["occlusionTexture"];
        assert_eq!(material["index"] == 0, own, "{material}");
        assert_eq!(material["extensions"].is_null(), !own, "{material}");
        assert_eq!(root["meshes"][0]["primitives"][0]["attributes"]["TEXCOORD_1"].is_null(), own);
        let again = folder.path("again.glb");
        bake(path, &again, &with(&[]));
        assert_eq!(read(&input).0["materials"].to_string(), read(&again).0["materials"].to_string());
    }
    assert!(kept["warnings"].to_string().contains("1 primitives keep"), "{}", kept["warnings"]);
}

#[test]
fn stock_warns_of_textures_that_would_show_by_its_coordinates() {
    let folder = Folder::new("astray");
    for (sets, astray) in [(0, true), (1, false)] {
        let (mut json, mut binary) = corner(sets);
        let texture = add_texture(&mut json, &mut binary, 8, |x, _| if x < 4 { 0.2 } else { 0.8 });
        json["materials"][0]["pbrMetallicRoughness"]["baseColorTexture"] = json!({"index": texture});
        let input = write(&folder, "in.glb", &(json, binary));
        let report = bake(&input, &folder.path("out.glb"), &with(&["--profile", "stock"]));
        let warnings = report["warnings"].to_string();
        assert_eq!(warnings.contains("by the coordinates of the light"), astray, "{warnings}");
    }
}

#[test]
fn stock_warns_of_occlusion_finer_than_its_texels() {
    let folder = Folder::new("finer");
    let (mut json, mut binary) = corner(1);
    let texture = add_texture(&mut json, &mut binary, 8, |x, _| if x < 4 { 0.2 } else { 0.8 });
    json["materials"][0]["occlusionTexture"] = json!({"index": texture});
    let input = write(&folder, "in.glb", &(json, binary));
    let coarse = ["--profile", "stock", "--authored-occlusion", "multiply-coarse"];
    for (detail, finer) in [("1", true), ("0.1", false)] {
        let report = bake(
            &input,
            &folder.path("out.glb"),
            &[&coarse[..], &["--detail", detail, "--ao-distance", "1"]].concat(),
        );
        let warnings = report["warnings"].to_string();
        // 8 texels over a metre.
        assert_eq!(warnings.contains("as --detail 0.25000 does"), finer, "{warnings}");
    }
}

#[test]
fn lightmap_of_light_is_in_lux_and_leaves_no_trace() {
    let folder = Folder::new("lux");
    let out = folder.path("out.glb");
    let light = ["--signal", "ao+lightmap", "--sky", "100", "--samples", "6000"];
    let report = bake(&data("contact.glb"), &out, &[&light[..], &["--profile", "lightmap"]].concat());
    assert_eq!(report["classes"]["texture"]["triangles"], report["scene"]["triangles"]);
    verify(&out);
    let (root, binary) = read(&out);
    let layers = &extension(&root)["layers"];
    let material = &root["materials"][0];
    let moz = &material["extensions"]["MOZ_lightmap"];
    assert_eq!((&moz["index"], &moz["intensity"]), (&layers[1]["pages"][0], &layers[1]["intensity"]));
    assert_eq!(material["occlusionTexture"]["index"], layers[0]["pages"][0]);
    assert_eq!(layers[1]["encoding"], "srgb");
    // A sky of 100 cd/m2 lights an open floor with 100 pi lux, and most of this floor is open.
    let mut page = image(&root, &binary, &layers[1]["pages"][0]).values;
    page.sort_unstable_by(f32::total_cmp);
    let median = lightkiln_scene::srgb::linear(page[page.len() / 2]);
    let lux = moz["intensity"].as_f64().unwrap() as f32 * median;
    assert!((lux / (100.0 * std::f32::consts::PI) - 1.0).abs() < 0.1, "{lux} lux");
    assert!(root["extensionsUsed"].to_string().contains("MOZ_lightmap"));
    let again = folder.path("again.glb");
    bake(&out, &again, &with(&[]));
    let ((before, _), (after, _)) = (read(&data("contact.glb")), read(&again));
    assert_eq!(before["materials"].to_string(), after["materials"].to_string());
    assert_eq!(after["extensionsUsed"], json!(["LIGHTKILN_lightmap"]));
    assert_eq!(
        after["images"].as_array().map_or(0, Vec::len),
        extension(&after)["layers"][0]["pages"].as_array().unwrap().len()
    );
}

#[test]
fn lightmap_measures_what_the_report_of_a_hybrid_computes() {
    let folder = Folder::new("computed");
    let out = folder.path("out.glb");
    let bytes = |profile: &str| {
        bake(&data("contact.glb"), &out, &["--samples", "20000", "--profile", profile])["bytes"].clone()
    };
    let (hybrid, full) = (bytes("eta"), bytes("lightmap"));
    let of = |b: &Value, key: &str| b[key].as_f64().unwrap();
    let computed = of(&hybrid["fullLightmap"]["bytes"], "atlas");
    let measured = of(&full["light"], "atlas");
    assert!((computed / measured - 1.0).abs() < 0.25, "computed {computed}, measured {measured}");
    // Of its own charts the computed one knows all.
    let own = of(&full["fullLightmap"]["bytes"], "atlas");
    assert!((own - measured).abs() <= 1.0, "{own} of {measured}");
    assert!(hybrid["total"].as_f64() < full["total"].as_f64());
}

#[test]
fn texcoord_is_the_pair_of_the_paper() {
    let folder = Folder::new("texcoord");
    for signal in ["ao", "ao+lightmap"] {
        let out = folder.path("out.glb");
        bake(
            &data("contact.glb"),
            &out,
            &[
                "--samples",
                "6000",
                "--profile",
                "texcoord",
                "--signal",
                signal,
                "--sky",
                "100",
                "--max-error",
                "0.06",
            ],
        );
        verify(&out);
        let (root, binary) = read(&out);
        let layers = signal.split('+').count();
        let primitive = &root["meshes"][0]["primitives"][0];
        for layer in 0..layers {
            let name = format!("TEXCOORD_{layer}");
            assert_eq!(primitive["extensions"]["LIGHTKILN_lightmap"]["attributes"][layer], name);
            let accessor = &root["accessors"][primitive["attributes"][&name].as_u64().unwrap() as usize];
            assert_eq!((&accessor["componentType"], &accessor["type"]), (&json!(5126), &json!("VEC2")));
            let view = &root["bufferViews"][accessor["bufferView"].as_u64().unwrap() as usize];
            assert_eq!(view["byteStride"], 8);
            let start = view["byteOffset"].as_u64().unwrap() as usize
                + accessor["byteOffset"].as_u64().unwrap_or(0) as usize;
            let float = |at: usize| f32::from_le_bytes(binary[at..at + 4].try_into().unwrap());
            for vertex in 0..accessor["count"].as_u64().unwrap() as usize {
                let [c, two] = [float(start + 8 * vertex), float(start + 8 * vertex + 4)];
                let place = (0.0..=1.0).contains(&c) && (0.0..=1.0).contains(&two);
                let color = if layer == 0 {
                    (0.0..=1.0).contains(&c) && two == 2.0
                } else {
                    c.fract() == 0.0 && two >= 2.0
                };
                assert!(place || color, "{c} {two}");
            }
        }
        // Broken floats are told from light.
        let mut broken = binary.clone();
        let accessor = &root["accessors"][primitive["attributes"]["TEXCOORD_0"].as_u64().unwrap() as usize];
        let view = &root["bufferViews"][accessor["bufferView"].as_u64().unwrap() as usize];
        let start = view["byteOffset"].as_u64().unwrap() as usize;
        broken[start..start + 8].fill(0xff);
        let file = folder.write("broken.glb", glb(&root, &broken));
        let said = fail(4, ["verify".as_ref(), file.as_os_str(), "--quiet".as_ref()]);
        assert!(said.contains("stand for no light"), "{said}");
    }
}

#[test]
fn profiles_refuse_what_they_cannot_hold() {
    let folder = Folder::new("refused");
    let (input, out) = (data("contact.glb"), folder.path("out.glb"));
    for (extra, said) in [
        (&["--profile", "stock", "--signal", "lightmap"][..], "one layer of one channel"),
        (&["--profile", "stock", "--signal", "ao+shadow", "--sun", "30,40"], "one layer of one channel"),
        (&["--profile", "lightmap", "--signal", "bent-normal"], "one occlusion and one light"),
        (&["--profile", "lightmap", "--signal", "sh1"], "one occlusion and one light"),
        (&["--profile", "stock", "--table"], "a table"),
        (&["--profile", "stock", "--bounds", "clamp-after"], "clamped"),
        (&["--authored-occlusion", "keep"], "authored-occlusion"),
        (
            &["--profile", "lightmap", "--signal", "lightmap", "--authored-occlusion", "keep"],
            "authored-occlusion",
        ),
    ] {
        let mut arguments = draft(&input, &out, &["--samples", "500"]);
        arguments.extend(extra.iter().map(std::ffi::OsStr::new));
        let message = fail(1, arguments);
        assert!(message.contains(said) && message.contains("help: "), "{message}");
        assert!(!out.exists());
    }
}

#[test]
fn profiles_give_the_same_bytes_on_any_number_of_threads() {
    let folder = Folder::new("threads");
    for profile in ["stock", "lightmap", "texcoord"] {
        let files = ["1", "2"].map(|threads| {
            let out = folder.path(&format!("{profile}.gltf"));
            bake(&data("instances.glb"), &out, &with(&["--profile", profile, "--threads", threads]));
            [format!("{profile}.gltf"), format!("{profile}.bin"), format!("{profile}.lightkiln.0.png")]
                .map(|name| std::fs::read(folder.path(&name)).unwrap())
        });
        assert!(files[0] == files[1], "{profile}");
        let out = folder.path(&format!("{profile}.gltf"));
        verify(&out);
        // Two nodes share a mesh in the file as read, and have coordinates of their own now.
        let root: Value = serde_json::from_slice(&std::fs::read(&out).unwrap()).unwrap();
        let mut accessors: Vec<u64> = root["meshes"]
            .as_array()
            .unwrap()
            .iter()
            .filter_map(|m| m["primitives"][0]["attributes"]["TEXCOORD_0"].as_u64())
            .collect();
        let count = accessors.len();
        accessors.sort_unstable();
        accessors.dedup();
        assert!(count > 1 && accessors.len() == count, "{profile}: {accessors:?}");
        let shared = lightkiln([
            "bake".as_ref(),
            out.as_os_str(),
            "-o".as_ref(),
            folder.path("x.glb").as_os_str(),
            "--samples".as_ref(),
            "2000".as_ref(),
            "--quality".as_ref(),
            "draft".as_ref(),
            "--quiet".as_ref(),
        ]);
        assert!(shared.status.success(), "{}", String::from_utf8_lossy(&shared.stderr));
        assert!(
            read(&folder.path("x.glb")).0["meshes"]
                .as_array()
                .unwrap()
                .iter()
                .all(|m| m["primitives"][0]["attributes"]["TEXCOORD_0"].is_null())
        );
    }
}
