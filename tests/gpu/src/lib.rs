//! Triangles with codes, and what a GPU must show of them: the CPU twin's word ([`lightkiln_encode::decode()`]) for
//! every pixel.
//!
//! | user | GPU |
//! |---|---|
//! | `tests/vulkan.rs` | the WGSL, by wgpu on Vulkan |
//! | `page.rs` with `page.js` and `web.test.mjs` | the GLSL, by WebGL 2 in a browser, with the macros for cheaper lookups and without |
//!
//! Two kinds of cases: random triangles with texels, colors and scales of every form, large and small enough to read
//! the second mip level; and a board with every case of Schaefer et al. 2012, section 4.3, and a seam, on an atlas of
//! a linear function, which the picture must then show throughout.

use glam::Vec3;
use lightkiln_encode::decode::{Varyings, fragment, interpolate, vertex};
use lightkiln_encode::{AtlasView, Form, LightCode, ShaderScale, Table, Texels, clamp, unscale};
use lightkiln_light::{Curve, Scale, harmonics};
use lightkiln_mesh::random;
use serde::Serialize;

/// Width and height of a page, in texels.
pub const SIZE: [u32; 2] = [64, 64];
/// Pages of random texels; two of the board's charts come after them.
const RANDOM_PAGES: u32 = 3;
/// Pages of the atlas.
pub const PAGES: u32 = RANDOM_PAGES + 2;
/// Pixels of a picture, per side.
pub const PIXELS: u32 = 16;
/// Largest difference in stored units: one step of 8 bits.
pub const BOUND: f32 = 1.0 / 255.0;
/// How far from the levels' ends the ideal level must lie for a pixel to be compared: GPUs may be off by that much.
const LEVEL_MARGIN: f32 = 0.5;
/// Random triangles; the boards come after them.
pub const RANDOM_CASES: usize = 600;

/// A vertex and a fragment stage of `shaders/programs`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Program {
    /// One channel, packed.
    Scalar,
    /// Three channels, packed.
    Rgb,
    /// Three channels, colors in a table.
    Table,
    /// One channel, the form `(c, 2)`.
    Interop,
    /// One channel, clamped after interpolation.
    Clamped,
    /// Four layers of harmonics and a normal.
    Sh,
}

impl Program {
    /// All of them.
    pub const ALL: [Self; 6] = [Self::Scalar, Self::Rgb, Self::Table, Self::Interop, Self::Clamped, Self::Sh];

    /// How many layers it reads.
    pub fn layers(self) -> usize {
        if self == Self::Sh { 4 } else { 1 }
    }

    /// Whether its atlas has one channel.
    pub fn is_grey(self) -> bool {
        matches!(self, Self::Scalar | Self::Interop | Self::Clamped)
    }
}

/// An atlas with two mip levels that have nothing to do with each other, so that the wrong one shows.
#[derive(Debug, Serialize)]
pub struct Atlas {
    /// Numbers per texel.
    pub channels: u32,
    /// 8 bits a number: pages, one under the other, of `SIZE` and of half that.
    pub levels: [Vec<u8>; 2],
}

impl Atlas {
    fn view(&self, level: usize) -> AtlasView<'_> {
        AtlasView::stacked(SIZE.map(|n| n >> level), PAGES, self.channels, Texels::U8(&self.levels[level]))
            .expect("whole pages")
    }
}

/// What all cases share.
#[derive(Debug, Serialize)]
pub struct Textures {
    /// Of programs with one channel.
    pub grey: Atlas,
    /// Of the layers of others.
    pub colored: [Atlas; 4],
    /// Width and height of the table's image.
    pub table_size: [u32; 2],
    /// RGB, 8 bits.
    pub table: Vec<u8>,
}

/// Triangles in a picture.
#[derive(Debug, Serialize)]
pub struct Case {
    /// What draws them.
    pub program: Program,
    /// `P(low)`, `P(high) - P(low)`, white or 0: the same for all layers.
    pub scale: [f32; 3],
    /// Clamp of [`Program::Clamped`], in the signal's unit.
    pub ends: [f32; 2],
    /// A unit vector, for harmonics.
    pub normal: [f32; 3],
    /// Three a triangle, in clip space.
    pub positions: Vec<[f32; 2]>,
    /// Of each layer, as many as positions: codes, or pairs of the interop form.
    pub attributes: Vec<Vec<[f32; 2]>>,
    /// Light in the signal's unit, row by row from the bottom (clip space's lower end); `None` where nothing is
    /// drawn or where the pixel's middle lies on an edge or between two levels.
    pub expected: Vec<Option<[f32; 3]>>,
    /// The same without mip levels: all pages, one under the other, as one page of one level.
    pub plain: Vec<Option<[f32; 3]>>,
}

impl Case {
    /// How far drawn light is from what is expected, as stored: in steps of 1 from one end of the range to the other.
    ///
    /// - `drawn`: RGBA per pixel, in the order of `expected`
    /// - `expected`: that or `plain`
    /// - returns: the largest difference, infinite where a number is NaN, and how many pixels were compared
    pub fn difference(&self, drawn: &[[f32; 4]], expected: &[Option<[f32; 3]>]) -> (f32, usize) {
        let [_, extent, white] = self.scale;
        let scale = if white > 0.0 { Scale::log(white, 0.0, white) } else { Scale::UNIT };
        let mut largest = 0.0_f32;
        let mut compared = 0;
        for (drawn, expected) in drawn.iter().zip(expected) {
            let Some(expected) = expected else { continue };
            compared += 1;
            for channel in 0..3 {
                let [a, b] = [drawn[channel], expected[channel]].map(|x| scale.perceived(x));
                let difference = (a - b).abs() / extent;
                largest = largest.max(if difference.is_nan() { f32::INFINITY } else { difference });
            }
        }
        (largest, compared)
    }
}

/// The textures and all cases, the same in every run.
pub fn cases() -> (Textures, Vec<Case>) {
    let mut dice = Dice(1);
    let entries: Vec<f32> = (0..3000).flat_map(|_| dice.rgb()).collect();
    let (table, _) = Table::build(&entries, 3, 0.0).expect("few enough entries");
    let (table_size, table_texels) = table.image();
    let textures = Textures {
        grey: dice.atlas(1),
        colored: std::array::from_fn(|_| dice.atlas(3)),
        table_size,
        table: table_texels,
    };
    let mut cases: Vec<Case> =
        (0..RANDOM_CASES).map(|number| random_case(number, &mut dice, &textures, &table)).collect();
    for program in [Program::Scalar, Program::Rgb, Program::Interop, Program::Clamped] {
        cases.push(board_case(program, &textures));
    }
    (textures, cases)
}

/// Numbers in `0..1`.
struct Dice(u64);

impl Dice {
    fn roll(&mut self) -> f32 {
        self.0 += 1;
        random::unit(random::hash(self.0, 0, 0, 0))
    }

    fn rgb(&mut self) -> [f32; 3] {
        std::array::from_fn(|_| self.roll())
    }

    /// Random but for the board's pages. Neighbours differ by a third of the range at most, for filters may have
    /// weights of 8 bits, whose error grows with that.
    fn atlas(&mut self, channels: u32) -> Atlas {
        let mut levels = [0, 1].map(|level| {
            let waves: Vec<[f32; 3]> = (0..channels).map(|_| self.rgb()).collect();
            let mut texels = Vec::new();
            for row in 0..(SIZE[1] >> level) * PAGES {
                for column in 0..SIZE[0] >> level {
                    for [by_row, by_column, phase] in &waves {
                        let angle = 0.15 * (by_row * row as f32 + by_column * column as f32) + 6.0 * phase;
                        texels.push(((0.4 + 0.4 * angle.sin() + 0.2 * self.roll()) * 255.0).round() as u8);
                    }
                }
            }
            texels
        });
        for (level, texels) in levels.iter_mut().enumerate() {
            let [width, height] = SIZE.map(|n| n >> level);
            for chart in [0, 1] {
                for (row, column) in (0..height).flat_map(|row| (0..width).map(move |column| (row, column))) {
                    let place = [column, row].map(|i| (i as f32 + 0.5) * (1 << level) as f32);
                    let pixel = board_pixel(chart, place);
                    let from = (((RANDOM_PAGES + chart) * height + row) * width + column) * channels;
                    for channel in 0..channels {
                        let value = board_light(channel as usize, pixel);
                        texels[(from + channel) as usize] = (value * 255.0).round() as u8;
                    }
                }
            }
        }
        Atlas { channels, levels }
    }
}

/// One triangle with texels of one page, and any of the corners a color.
fn random_case(number: usize, dice: &mut Dice, textures: &Textures, table: &Table) -> Case {
    let program = Program::ALL[number % Program::ALL.len()];
    let round = number / Program::ALL.len();
    let form = match program {
        Program::Rgb | Program::Sh => Form::Rgb,
        Program::Table => Form::Table(table),
        _ => Form::Scalar,
    };
    let scale = match (program, round % 2) {
        // Sums of coefficients have no scale of their own, so that a step means something with a linear one only.
        (Program::Sh, _) => Scale::linear(-0.5, 1.5),
        (_, 0) => Scale::log(500.0, 0.0, 2000.0),
        _ => Scale::linear(-0.5, 1.5),
    };
    let page = round as u32 % RANDOM_PAGES;
    // Twice the picture and a few texels, so that they are magnified, or a part of it and many, so that they are minified.
    let [side, spread] = [[2 * PIXELS, 12], [PIXELS / 2, SIZE[0] - 2]][round / 2 % 2].map(|n| n as f32);
    let is_color = [1, 2, 4].map(|corner| (round / 4) & corner != 0);
    let corner = SIZE.map(|size| 1.0 + ((size - 2) as f32 - spread) * dice.roll());
    let places = [0; 3].map(|_| {
        let [u, v] = corner.map(|from| from + spread * dice.roll());
        LightCode::texture([u, v + (page * SIZE[1]) as f32]).expect("a small atlas")
    });
    let layers = (0..program.layers())
        .map(|_| {
            let codes = [0, 1, 2].map(|corner| match (is_color[corner], &form) {
                (false, _) => places[corner],
                (true, Form::Scalar) => LightCode::color(dice.roll()),
                (true, Form::Rgb) => LightCode::color_rgb(dice.rgb()),
                (true, Form::Table(table)) => {
                    LightCode::color_index((dice.roll() * table.len() as f32) as u32).expect("an entry")
                }
            });
            vec![codes]
        })
        .collect();
    let triangle = [[0.0, 0.0], [side, 0.0], [0.0, side]];
    let normal = (Vec3::from(dice.rgb()) - 0.5).normalize();
    drawn(program, scale, normal, &[triangle], layers, &form, textures)
}

/// Where on the picture a place of the board's page lies, two pixels to a texel: two charts, the second one turned by a
/// quarter.
fn board_pixel(chart: u32, [u, v]: [f32; 2]) -> [f32; 2] {
    if chart == 0 { [2.0 * u - 32.0, 2.0 * v - 32.0] } else { [2.0 * v - 32.0, 80.0 - 2.0 * u] }
}

/// The inverse of [`board_pixel`], in the stack of pages.
fn board_place(chart: u32, [x, y]: [f32; 2]) -> [f32; 2] {
    let [u, v] = if chart == 0 { [x / 2.0 + 16.0, y / 2.0 + 16.0] } else { [40.0 - y / 2.0, x / 2.0 + 16.0] };
    [u, v + ((RANDOM_PAGES + chart) * SIZE[1]) as f32]
}

/// The light of the board at a place of the picture, in pixels: linear over the picture and some way beyond it.
pub fn board_light(channel: usize, [x, y]: [f32; 2]) -> f32 {
    let [by_x, by_y] = [[0.4, 0.15], [-0.2, 0.35], [0.1, -0.45]][channel];
    let [x, y] = [x, y].map(|p| p / PIXELS as f32 - 0.5);
    (0.5 + by_x * x + by_y * y).clamp(0.0, 1.0)
}

/// Every kind of triangle of section 4.3, in pixels:
///
/// ```text
///     v6
///    / # \        # = texture triangles: (0, 1, 2) in one chart, (0, 2, 6) in another, with a seam between them;
///  v0----v2----v4    (2, 1, 3) has the chart edge 1-2; (2, 3, 4) hangs on 2 alone; (4, 3, 5) has three colors
///   | # /  \  /  \
///   v1-----v3----v5
/// ```
fn board_case(program: Program, textures: &Textures) -> Case {
    let corners = [[0.0, 10.0], [0.0, 0.0], [6.0, 10.0], [8.0, 0.0], [12.0, 10.0], [16.0, 0.0], [3.0, 16.0]];
    let form = if program.is_grey() { Form::Scalar } else { Form::Rgb };
    let color = |corner: usize| {
        let light = [0, 1, 2].map(|channel| board_light(channel, corners[corner]));
        if program.is_grey() { LightCode::color(light[0]) } else { LightCode::color_rgb(light) }
    };
    let place = |chart: u32, corner: usize| {
        LightCode::texture(board_place(chart, corners[corner])).expect("a small atlas")
    };
    let codes = vec![
        [place(0, 0), place(0, 1), place(0, 2)],
        [place(1, 0), place(1, 2), place(1, 6)],
        [place(0, 2), place(0, 1), color(3)],
        [place(0, 2), color(3), color(4)],
        [color(4), color(3), color(5)],
    ];
    let triangles =
        [[0, 1, 2], [0, 2, 6], [2, 1, 3], [2, 3, 4], [4, 3, 5]].map(|triangle| triangle.map(|v| corners[v]));
    drawn(program, Scale::UNIT, Vec3::Z, &triangles, vec![codes], &form, textures)
}

/// The CPU twin's picture.
///
/// - `triangles`: corners in pixels
/// - `layers`: of each layer, codes of each triangle
fn drawn(
    program: Program,
    scale: Scale,
    normal: Vec3,
    triangles: &[[[f32; 2]; 3]],
    layers: Vec<Vec<[LightCode; 3]>>,
    form: &Form<'_>,
    textures: &Textures,
) -> Case {
    let white = match scale.curve {
        Curve::Linear => 0.0,
        Curve::Log { white } => white,
    };
    let [low, high] = [scale.low, scale.high].map(|x| scale.perceived(x));
    let uniform = ShaderScale { low, extent: high - low, white };
    let ends = [0.3, 0.7].map(|unit| scale.from_unit(unit));
    let atlas = |layer: usize| if program.is_grey() { &textures.grey } else { &textures.colored[layer] };
    let shown = |layer: usize, triangle: usize, weights: [f32; 3], level: usize| {
        let corners = layers[layer][triangle].map(|code| vertex(code, form));
        let mut at = interpolate(corners, weights);
        at.position = at.position.map(|texels| texels / (1 << level) as f32);
        let unit = fragment(at, &atlas(layer).view(level));
        let unit = if program.is_grey() { [unit[0]; 3] } else { unit };
        let light = unit.map(|unit| unscale(unit, uniform));
        Vec3::from(if program == Program::Clamped { light.map(|light| clamp(light, ends)) } else { light })
    };
    let light = |triangle: usize, weights: [f32; 3], level: usize| {
        let light = match program {
            Program::Sh => {
                let coefficients: Vec<Vec3> = (0..4).map(|k| shown(k, triangle, weights, level)).collect();
                harmonics::irradiance(&coefficients, normal).max(Vec3::ZERO)
            }
            _ => shown(0, triangle, weights, level),
        };
        light.to_array()
    };
    // Of each pixel, the triangle that covers it, and where.
    let covered: Vec<Option<(usize, [f32; 3])>> = (0..PIXELS * PIXELS)
        .map(|pixel| {
            let middle = [pixel % PIXELS, pixel / PIXELS].map(|i| i as f32 + 0.5);
            triangles
                .iter()
                .map(|triangle| barycentric(*triangle, middle))
                .enumerate()
                .find(|(_, weights)| weights.iter().all(|weight| *weight > 1e-3))
        })
        .collect();
    let level_at = |triangle: usize, weights: [f32; 3]| {
        level(layers[0][triangle].map(|code| vertex(code, form)), weights, triangles[triangle])
    };
    let leveled = |(triangle, weights)| Some(light(triangle, weights, level_at(triangle, weights)?));
    let expected = covered.iter().map(|at| at.and_then(leveled)).collect();
    let plain = covered.iter().map(|at| at.map(|(triangle, weights)| light(triangle, weights, 0))).collect();
    let attribute = |code: &LightCode| match program {
        Program::Interop => code.interop([SIZE[0], SIZE[1] * PAGES], form),
        _ => code.0.map(f32::from),
    };
    Case {
        program,
        scale: [uniform.low, uniform.extent, uniform.white],
        ends,
        normal: normal.to_array(),
        positions: triangles.iter().flatten().map(|p| p.map(|x| 2.0 * x / PIXELS as f32 - 1.0)).collect(),
        attributes: layers.iter().map(|codes| codes.iter().flatten().map(attribute).collect()).collect(),
        expected,
        plain,
    }
}

fn barycentric([a, b, c]: [[f32; 2]; 3], p: [f32; 2]) -> [f32; 3] {
    let cross =
        |o: [f32; 2], p: [f32; 2], q: [f32; 2]| (p[0] - o[0]) * (q[1] - o[1]) - (p[1] - o[1]) * (q[0] - o[0]);
    let area = cross(a, b, c);
    [cross(p, b, c) / area, cross(p, c, a) / area, cross(p, a, b) / area]
}

/// Which mip level a pixel reads: `None` when it reads both. The derivatives of `UV / eta` by the quotient rule.
fn level(corners: [Varyings<3>; 3], weights: [f32; 3], triangle: [[f32; 2]; 3]) -> Option<usize> {
    let at = interpolate(corners, weights);
    if at.eta <= lightkiln_encode::constants::ETA_EPSILON {
        return Some(0);
    }
    let origin = barycentric(triangle, [0.0, 0.0]);
    let texels_per_pixel = [[1.0, 0.0], [0.0, 1.0]].map(|step| {
        let change: [f32; 3] = {
            let stepped = barycentric(triangle, step);
            std::array::from_fn(|k| stepped[k] - origin[k])
        };
        let by = interpolate(corners, change);
        let rate: [f32; 2] =
            std::array::from_fn(|k| (by.position[k] - at.position[k] / at.eta * by.eta) / at.eta);
        rate[0].hypot(rate[1])
    });
    match texels_per_pixel[0].max(texels_per_pixel[1]).log2() {
        level if level < -LEVEL_MARGIN => Some(0),
        level if level > 1.0 + LEVEL_MARGIN => Some(1),
        _ => None,
    }
}
