//! The files in `shaders/`: they have our constants, and both languages are valid.

use naga::valid::{Capabilities, ValidationFlags, Validator};
use naga::{Module, ShaderStage};

use crate::constants::SHADER_CONSTANTS;

const VERTEX: &str = include_str!("../../../shaders/eta_blend.vert.glsl");
const FRAGMENT: &str = include_str!("../../../shaders/eta_blend.frag.glsl");
const WGSL: &str = include_str!("../../../shaders/eta_blend.wgsl");

/// Name and value of each constant that a shader declares.
fn constants(source: &str) -> Vec<(&str, f64)> {
    source
        .lines()
        .filter_map(|line| line.strip_prefix("const "))
        .map(|declaration| {
            let (name, value) = declaration.trim_end_matches(';').split_once(" = ").expect("name = value");
            let name = name.trim_start_matches("float ").trim_end_matches(": f32");
            (name, value.parse().expect("a number"))
        })
        .collect()
}

#[test]
fn shader_constants_are_ours() {
    assert_eq!(constants(WGSL), SHADER_CONSTANTS);
    assert_eq!(constants(VERTEX), SHADER_CONSTANTS[..3]);
    assert_eq!(constants(FRAGMENT), SHADER_CONSTANTS[3..]);
    // And nothing else may say them: each number stands in one line of each file.
    for source in [WGSL, VERTEX, FRAGMENT] {
        let code = source.lines().filter(|line| !line.trim_start().starts_with("//"));
        for number in ["32768", "65535", "65536", "0.0000"] {
            assert!(code.clone().filter(|line| line.contains(number)).count() <= 1, "{number}");
        }
    }
}

fn validate(module: &Module) {
    let mut validator = Validator::new(ValidationFlags::all(), Capabilities::empty());
    validator.validate(module).expect("valid");
}

#[test]
fn shader_wgsl_is_valid() {
    let module = naga::front::wgsl::parse_str(WGSL).unwrap_or_else(|e| panic!("{}", e.emit_to_string(WGSL)));
    validate(&module);
    let names: Vec<&str> = module.entry_points.iter().map(|entry| entry.name.as_str()).collect();
    assert_eq!(names, ["vertex_main", "fragment_main"]);
}

/// GLSL ES 3.00 as the Vulkan GLSL that naga reads: the version, no default precisions, locations for what
/// goes in and out (by order), a block around uniforms, and a sampler apart from its texture. Functions stay
/// as they are, word for word.
fn vulkan_from_es(source: &str) -> String {
    let mut locations = [0, 0];
    let mut located = |which: usize, line: &str| {
        locations[which] += 1;
        format!("layout(location = {}) {line}", locations[which] - 1)
    };
    let mut lines = Vec::new();
    for line in source.lines() {
        let words: Vec<&str> = line.split([' ', ';']).collect();
        lines.push(match words[..] {
            ["#version", "300", "es"] => "#version 450".to_owned(),
            ["precision", ..] => String::new(),
            ["uniform", "sampler2DArray", name, ..] => format!(
                "layout(set = 0, binding = 1) uniform texture2DArray {name}_texels;\n\
                 layout(set = 0, binding = 2) uniform sampler {name}_sampler;\n\
                 #define {name} sampler2DArray({name}_texels, {name}_sampler)"
            ),
            ["uniform", kind, name, ..] => {
                format!("layout(set = 0, binding = 0) uniform Uniforms {{ {kind} {name}; }};")
            }
            ["in", ..] => located(0, line),
            ["out", ..] => located(1, line),
            _ => line.to_owned(),
        });
    }
    lines.join("\n")
}

#[test]
fn shader_glsl_is_valid() {
    for (stage, source) in [(ShaderStage::Vertex, VERTEX), (ShaderStage::Fragment, FRAGMENT)] {
        // GLSL ES wants the version first, and a precision for floats before the first of them.
        assert!(source.starts_with("#version 300 es\n"));
        assert!(source.contains("\nprecision highp float;\n"));
        let source = vulkan_from_es(source);
        let module = naga::front::glsl::Frontend::default()
            .parse(&naga::front::glsl::Options::from(stage), &source)
            .unwrap_or_else(|e| panic!("{}", e.emit_to_string(&source)));
        validate(&module);
        assert_eq!(module.entry_points.len(), 1);
    }
}

#[test]
fn shader_lookup_has_a_level_of_its_own() {
    // An implicit derivative inside the branch is undefined; WGSL refuses it, GLSL does not.
    assert!(FRAGMENT.contains("textureGrad(") && !FRAGMENT.contains("texture("));
    let branch = FRAGMENT.split("if (eta >").nth(1).expect("a branch");
    assert!(!branch.split("return").next().expect("its end").contains("dFd"));
}
