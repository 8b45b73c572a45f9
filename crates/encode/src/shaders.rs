//! The files in `shaders/`: they have our constants, and both languages are valid.

use glam::Vec3;
use lightkiln_light::harmonics;
use naga::valid::{Capabilities, ValidationFlags, Validator};
use naga::{Module, ShaderStage};

use crate::constants::{FRAGMENT_CONSTANTS, VERTEX_CONSTANTS};

const VERTEX: &str = include_str!("../../../shaders/lightkiln.vert.glsl");
const FRAGMENT: &str = include_str!("../../../shaders/lightkiln.frag.glsl");
const WGSL: &str = include_str!("../../../shaders/lightkiln.wgsl");
const PROGRAMS: &str = include_str!("../../../shaders/programs/programs.wgsl");

/// What stands before the functions and the program in GLSL ES.
const HEAD: &str = "#version 300 es\nprecision highp float;\n";

macro_rules! program {
    ($stage:ident, $functions:ident, $file:literal) => {
        (ShaderStage::$stage, $functions, include_str!(concat!("../../../shaders/programs/", $file)), $file)
    };
}

/// Stage, functions and main of each program.
const GLSL_PROGRAMS: [(ShaderStage, &str, &str, &str); 9] = [
    program!(Vertex, VERTEX, "scalar.vert.glsl"),
    program!(Fragment, FRAGMENT, "scalar.frag.glsl"),
    program!(Fragment, FRAGMENT, "clamped.frag.glsl"),
    program!(Vertex, VERTEX, "rgb.vert.glsl"),
    program!(Fragment, FRAGMENT, "rgb.frag.glsl"),
    program!(Vertex, VERTEX, "table.vert.glsl"),
    program!(Vertex, VERTEX, "interop.vert.glsl"),
    program!(Vertex, VERTEX, "sh.vert.glsl"),
    program!(Fragment, FRAGMENT, "sh.frag.glsl"),
];

/// Name and numbers of each constant that a shader declares, in GLSL or in WGSL.
fn constants(source: &str) -> Vec<(&str, Vec<f64>)> {
    source
        .lines()
        .filter_map(|line| line.strip_prefix("const "))
        .map(|declaration| {
            let (name, value) = declaration.trim_end_matches(';').split_once(" = ").expect("name = value");
            let name = name.split([' ', ':']).find(|word| word.contains('_')).expect("a name");
            let inner = value.split_once('(').map_or(value, |(_, inner)| inner.trim_end_matches(')'));
            let number = |number: &str| number.trim_end_matches('u').parse().expect("a number");
            (name, inner.split(", ").map(number).collect())
        })
        .collect()
}

#[test]
fn shader_constants_are_ours() {
    let ours = |constants: &[(&'static str, &[f64])]| -> Vec<(&'static str, Vec<f64>)> {
        constants.iter().map(|&(name, numbers)| (name, numbers.to_vec())).collect()
    };
    assert_eq!(constants(VERTEX), ours(&VERTEX_CONSTANTS));
    assert_eq!(constants(FRAGMENT), ours(&FRAGMENT_CONSTANTS));
    assert_eq!(constants(WGSL), ours(&[VERTEX_CONSTANTS, FRAGMENT_CONSTANTS].concat()));
    // And nothing else may say them: other lines of code hold small numbers only.
    for source in [VERTEX, FRAGMENT, WGSL] {
        let code =
            source.lines().filter(|line| !line.starts_with("const ") && !line.trim_start().starts_with("//"));
        for line in code {
            let words = line.split(|c: char| !c.is_ascii_alphanumeric() && c != '.' && c != '_');
            let mut numbers = words.filter_map(|word| word.parse::<f64>().ok());
            assert!(numbers.all(|number| number <= 9.0 && number.fract() == 0.0), "{line}");
        }
    }
}

#[test]
fn shader_harmonics_are_those_of_the_light() {
    let factor = |name: &str| {
        let named = FRAGMENT_CONSTANTS.iter().find(|(constant, _)| constant.ends_with(name));
        named.expect("a constant").1[0] as f32
    };
    let [constant, linear, product] = ["CONSTANT", "LINEAR", "PRODUCT"].map(factor);
    let [axis, difference] = ["AXIS", "DIFFERENCE"].map(factor);
    let n = Vec3::new(0.48, -0.6, 0.64);
    // As the shaders have them: sh[k] times these.
    let ours = [
        constant,
        linear * n.y,
        linear * n.z,
        linear * n.x,
        product * (n.x * n.y),
        product * (n.y * n.z),
        axis * (3.0 * n.z * n.z - 1.0),
        product * (n.x * n.z),
        difference * (n.x * n.x - n.y * n.y),
    ];
    for (ours, light) in ours.iter().zip(harmonics::basis(n)) {
        assert!((ours - light).abs() < 1e-6, "{ours} {light}");
    }
    // The statements themselves, in both languages.
    for source in [FRAGMENT, WGSL] {
        for statement in [
            "LIGHTKILN_SH_LINEAR * (sh[1] * n.y + sh[2] * n.z + sh[3] * n.x)",
            "LIGHTKILN_SH_LINEAR * (sh[1] * normal.y + sh[2] * normal.z + sh[3] * normal.x)",
            "LIGHTKILN_SH_PRODUCT * (sh[4] * (n.x * n.y) + sh[5] * (n.y * n.z) + sh[7] * (n.x * n.z))",
            "LIGHTKILN_SH_AXIS * sh[6] * (3.0 * n.z * n.z - 1.0)",
            "LIGHTKILN_SH_DIFFERENCE * sh[8] * (n.x * n.x - n.y * n.y)",
        ] {
            assert!(source.contains(statement), "{statement}");
        }
    }
}

#[test]
fn shader_functions_are_named_for_us() {
    // They go into materials of other people.
    for source in [VERTEX, FRAGMENT] {
        assert!(!source.contains("#version") && !source.contains("precision ") && !source.contains("main("));
        let outside = source.lines().filter(|line| line.ends_with(") {") && !line.starts_with(' '));
        for line in outside {
            assert!(line.contains(" lightkilnVertex") || line.contains(" lightkilnLight"), "{line}");
        }
    }
    // Both languages have the same functions.
    let names = |source: &str, before: &str| -> Vec<String> {
        let mut names: Vec<String> = source
            .lines()
            .filter(|line| line.ends_with('{') && !line.starts_with([' ', '/']))
            .filter_map(|line| line.split_once(before)?.1.split_once('(').map(|(name, _)| name.to_owned()))
            .collect();
        names.sort_unstable();
        names
    };
    let glsl = names(&[VERTEX, FRAGMENT].concat(), " ");
    assert!(glsl.len() > 10);
    // WGSL has no macros: what they make of a function in GLSL is another one.
    let mut wgsl = names(WGSL, "fn ");
    wgsl.retain(|name| !name.ends_with("Plain"));
    assert_eq!(glsl, wgsl);
}

fn validate(module: &Module) {
    let mut validator = Validator::new(ValidationFlags::all(), Capabilities::empty());
    validator.validate(module).expect("valid");
}

#[test]
fn shader_wgsl_is_valid() {
    let source = [WGSL, PROGRAMS].concat();
    let module =
        naga::front::wgsl::parse_str(&source).unwrap_or_else(|e| panic!("{}", e.emit_to_string(&source)));
    validate(&module);
    let names: Vec<&str> = module.entry_points.iter().map(|entry| entry.name.as_str()).collect();
    let expected = [
        "vertex_scalar",
        "vertex_interop",
        "fragment_scalar",
        "fragment_plain",
        "fragment_clamped",
        "vertex_rgb",
        "vertex_table",
        "fragment_rgb",
        "fragment_clamped_rgb",
        "vertex_sh",
        "fragment_sh",
    ];
    assert_eq!(names, expected);
}

/// GLSL ES 3.00 as the Vulkan GLSL that naga reads: the version, no default precisions, locations for what
/// goes in and out (by order), a block around each uniform, and samplers apart from their textures. What the
/// functions do stays as it is, word for word.
///
/// - `pages`: the atlas's kind of texture, `2D` or `2DArray`
fn vulkan_from_es(source: &str, pages: &str) -> String {
    // naga has no macros for qualified types.
    let source = source
        .replace("#define LIGHTKILN_ATLAS", "//")
        .replace("LIGHTKILN_ATLAS", &format!("highp sampler{pages}"));
    let mut locations = [0, 0, 0];
    let mut located = |which: usize| {
        locations[which] += 1;
        locations[which] - 1
    };
    let mut lines = Vec::new();
    for line in source.lines() {
        let words: Vec<&str> = line.split([' ', ';']).collect();
        lines.push(match words[..] {
            ["#version", "300", "es"] => "#version 450".to_owned(),
            ["precision", ..] => String::new(),
            ["uniform", "highp", kind, name, ..] => {
                let kind = kind.trim_start_matches("sampler");
                let (texels, sampler) = (located(2), located(2));
                format!(
                    "layout(set = 0, binding = {texels}) uniform texture{kind} {name}_texels;\n\
                     layout(set = 0, binding = {sampler}) uniform sampler {name}_sampler;\n\
                     #define {name} {name}_texels, {name}_sampler"
                )
            }
            ["uniform", kind, name, ..] => {
                let binding = located(2);
                let block = name.trim_end_matches(|c: char| !c.is_ascii_lowercase());
                format!("layout(set = 0, binding = {binding}) uniform Block_{block} {{ {kind} {name}; }};")
            }
            ["in", ..] => format!("layout(location = {}) {line}", located(0)),
            ["out", ..] => format!("layout(location = {}) {line}", located(1)),
            _ => [(pages, "atlas"), ("2D", "table")].iter().fold(line.to_owned(), |line, (kind, name)| {
                let pair = format!("{name}_texels, {name}_sampler");
                line.replace(
                    &format!("highp sampler{kind} {name}"),
                    &format!("texture{kind} {name}_texels, sampler {name}_sampler"),
                )
                .replace(&format!("texture({name}"), &format!("texture(sampler{kind}({pair})"))
                .replace(&format!("textureLod({name}"), &format!("textureLod(sampler{kind}({pair})"))
                .replace(&format!("textureSize({name}"), &format!("textureSize(sampler{kind}({pair})"))
                .replace(&format!("texelFetch({name}"), &format!("texelFetch(sampler{kind}({pair})"))
                .replace(&format!("({name},"), &format!("({pair},"))
            }),
        });
    }
    lines.join("\n")
}

#[test]
fn shader_glsl_is_valid() {
    let [page, level] = ["#define LIGHTKILN_ONE_PAGE\n", "#define LIGHTKILN_ONE_LEVEL\n"];
    let macros = [String::new(), page.to_owned(), level.to_owned(), page.to_owned() + level];
    for ((stage, functions, main, file), macros) in
        macros.iter().flat_map(|macros| GLSL_PROGRAMS.map(|program| (program, macros.as_str())))
    {
        let pages = if macros.contains(page) { "2D" } else { "2DArray" };
        let source = vulkan_from_es(&[HEAD, macros, functions, main].concat(), pages);
        let module = naga::front::glsl::Frontend::default()
            .parse(&naga::front::glsl::Options::from(stage), &source)
            .unwrap_or_else(|e| panic!("{file}: {}", e.emit_to_string(&source)));
        validate(&module);
        assert_eq!(module.entry_points.len(), 1, "{file}");
    }
}

#[test]
fn shader_stages_fit_each_other() {
    let lines = |main: &str, word: &str| -> Vec<String> {
        let declared = main.lines().filter_map(|line| line.strip_prefix(word));
        declared.map(|line| line.split(';').next().unwrap_or_default().to_owned()).collect()
    };
    let main = |file: &str| GLSL_PROGRAMS.iter().find(|program| program.3 == file).expect("a program").2;
    for (vertex, fragment) in
        [("scalar", "scalar"), ("interop", "scalar"), ("rgb", "rgb"), ("table", "rgb"), ("sh", "sh")]
    {
        let out = lines(main(&format!("{vertex}.vert.glsl")), "out ");
        assert_eq!(out, lines(main(&format!("{fragment}.frag.glsl")), "in "), "{vertex}");
        assert!(out.len() >= 2);
    }
}

#[test]
fn shader_lookup_has_a_level_of_its_own_where_there_are_levels() {
    // An implicit derivative inside of the branch is undefined; WGSL refuses it, GLSL does not.
    let (before, lookup) = FRAGMENT.split_once("#ifdef LIGHTKILN_ONE_LEVEL\n").expect("a lookup");
    assert!(!before.contains("texture(") && !before.contains("dFd"));
    let (plain, leveled) = lookup.split_once("#else\n").expect("two lookups");
    assert_eq!(plain.trim(), "return texture(atlas, at).rgb;");
    assert!(leveled.contains("return textureLod(atlas, at, level).rgb;") && !leveled.contains("texture("));
    // Derivatives are taken before each branch, and nowhere else.
    for function in leveled.split("place.z > LIGHTKILN_ETA_EPSILON").take(2) {
        assert_eq!(function.matches("dFdx(place)").count(), 1);
    }
    assert_eq!(FRAGMENT.matches("dFd").count(), 4);
}
