//! A web page that draws random triangles with the shaders and compares every pixel with the CPU twin.
//!
//!     cargo run --release -p lightkiln-encode --example gpu_check > check.html
//!
//! Opened in a browser it says, for each program and curve, the largest difference: of linear layers in unit values,
//! of logarithmic ones as a share of the light plus white / 15. Both are rounding errors where the browser filters with
//! full precision (1e-5 at most with SwiftShader); a GPU whose filter has weights of 8 bits comes to 0.01. Without a
//! window: `chromium --headless --use-angle=swiftshader --enable-unsafe-swiftshader --dump-dom check.html`.

#![allow(clippy::print_stdout)] // a page is what it is for

use std::error::Error;
use std::fmt::Write as _;

use glam::Vec3;
use lightkiln_encode::{AtlasView, Form, LightCode, ShaderScale, Table, Texels, decode, unscale};
use lightkiln_light::{Curve, Scale, harmonics};
use lightkiln_mesh::random;

macro_rules! shader {
    ($file:literal) => {
        ($file, include_str!(concat!("../../../../shaders/", $file)))
    };
}

const SHADERS: [(&str, &str); 10] = [
    shader!("lightkiln.vert.glsl"),
    shader!("lightkiln.frag.glsl"),
    shader!("programs/scalar.vert.glsl"),
    shader!("programs/scalar.frag.glsl"),
    shader!("programs/rgb.vert.glsl"),
    shader!("programs/rgb.frag.glsl"),
    shader!("programs/table.vert.glsl"),
    shader!("programs/interop.vert.glsl"),
    shader!("programs/sh.vert.glsl"),
    shader!("programs/sh.frag.glsl"),
];

/// Width and height of a page, and pages.
const SIZE: [u32; 2] = [16, 16];
const PAGES: u32 = 3;
/// Pixels drawn, per side; the triangle covers twice as many.
const PIXELS: u32 = 16;
const CASES: usize = 200;

/// Numbers in `0..1`, the same in every run.
struct Dice(u64);

impl Dice {
    fn roll(&mut self) -> f32 {
        self.0 += 1;
        random::unit(random::hash(self.0, 0, 0, 0))
    }

    fn rgb(&mut self) -> [f32; 3] {
        std::array::from_fn(|_| self.roll())
    }

    fn texels(&mut self, channels: u32) -> Vec<u8> {
        (0..SIZE[0] * SIZE[1] * PAGES * channels).map(|_| (self.roll() * 255.0).round() as u8).collect()
    }
}

fn main() -> Result<(), Box<dyn Error>> {
    let mut dice = Dice(1);
    let grey = dice.texels(1);
    let colored: [Vec<u8>; 4] = std::array::from_fn(|_| dice.texels(3));
    let entries: Vec<f32> = (0..3000).flat_map(|_| dice.rgb()).collect();
    let (table, _) = Table::build(&entries, 3, 0.0)?;
    let grey_view = AtlasView::stacked(SIZE, PAGES, 1, Texels::U8(&grey))?;
    let colored_views: Vec<AtlasView<'_>> = colored
        .iter()
        .map(|texels| AtlasView::stacked(SIZE, PAGES, 3, Texels::U8(texels)))
        .collect::<Result<_, _>>()?;

    let mut cases = String::new();
    for case in 0..CASES {
        let program = ["scalar", "rgb", "table", "interop", "sh"][case % 5];
        let (form, view) = match program {
            "rgb" | "sh" => (Form::Rgb, &colored_views[0]),
            "table" => (Form::Table(&table), &colored_views[0]),
            _ => (Form::Scalar, &grey_view),
        };
        let scale = match (program, case % 2) {
            ("sh", _) => Scale::log(500.0, -3000.0, 3000.0),
            (_, 0) => Scale::log(500.0, 0.0, 2000.0),
            _ => Scale::linear(-0.5, 1.5),
        };
        let white = match scale.curve {
            Curve::Linear => 0.0,
            Curve::Log { white } => white,
        };
        let [low, high] = [scale.low, scale.high].map(|x| scale.perceived(x));
        let uniform = ShaderScale { low, extent: high - low, white };

        // The same places in all layers, in one page, and any of the three corners a color.
        let page = (case as u32 / 5) % PAGES;
        let is_color: [bool; 3] = std::array::from_fn(|_| dice.roll() < 0.5);
        let places = [0; 3].map(|_| {
            let [u, v] = [dice.roll(), dice.roll()].map(|x| 1.0 + 14.0 * x);
            LightCode::texture([u, v + (page * SIZE[1]) as f32]).expect("a small atlas")
        });
        let layers: Vec<[LightCode; 3]> = (0..if program == "sh" { 4 } else { 1 })
            .map(|_| {
                std::array::from_fn(|corner| match (is_color[corner], &form) {
                    (false, _) => places[corner],
                    (true, Form::Scalar) => LightCode::color(dice.roll()),
                    (true, Form::Rgb) => LightCode::color_rgb(dice.rgb()),
                    (true, Form::Table(table)) => {
                        LightCode::color_index((dice.roll() * table.len() as f32) as u32).expect("an entry")
                    }
                })
            })
            .collect();
        let normal = (Vec3::from(dice.rgb()) - 0.5).normalize();

        let shown = |layer: usize, barycentric| {
            let mut out = [0.0; 3];
            let view = if program == "sh" { &colored_views[layer] } else { view };
            decode(layers[layer], barycentric, view, &form, &mut out);
            let out = if matches!(form, Form::Scalar) { [out[0]; 3] } else { out };
            Vec3::from(out.map(|unit| unscale(unit, uniform)))
        };
        let mut expected = Vec::new();
        for pixel in 0..PIXELS * PIXELS {
            let at = [pixel % PIXELS, pixel / PIXELS].map(|i| (i as f32 + 0.5) / (2 * PIXELS) as f32);
            let light = match program {
                "sh" => {
                    let coefficients: Vec<Vec3> = (0..4).map(|layer| shown(layer, at)).collect();
                    harmonics::irradiance(&coefficients, normal).max(Vec3::ZERO)
                }
                _ => shown(0, at),
            };
            expected.extend(light.to_array());
        }
        let attribute = |code: &LightCode| match program {
            "interop" => code.interop([SIZE[0], SIZE[1] * PAGES], &form),
            _ => code.0.map(f32::from),
        };
        let attributes: Vec<Vec<f32>> =
            layers.iter().map(|codes| codes.iter().flat_map(attribute).collect()).collect();
        let scale = [uniform.low, uniform.extent, uniform.white];
        let normal = normal.to_array();
        writeln!(
            cases,
            "{{program: {program:?}, scale: {scale:?}, normal: {normal:?}, attributes: {attributes:?}, \
             expected: {expected:?}}},"
        )?;
    }

    println!("<!doctype html><title>gpu_check</title><pre id=\"result\"></pre><script>\nconst shaders = {{");
    for (file, source) in SHADERS {
        println!("{file:?}: `{}`,", source.replace('`', "'"));
    }
    let (table_size, entries) = table.image();
    println!(
        "}};\nconst size = {SIZE:?}, pages = {PAGES}, pixels = {PIXELS}, grey = {grey:?}, colored = {colored:?};"
    );
    println!("const tableSize = {table_size:?}, table = {entries:?};\nconst cases = [{cases}];");
    println!("{}</script>", include_str!("page.js"));
    Ok(())
}
