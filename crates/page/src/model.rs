//! A baked scene as the viewer takes it: one block of little-endian numbers, and a JSON that says where in it what lies.
//!
//! Whoever makes it has read the scene already, so that Draco, meshopt and quantized files, skins, instances and morph
//! targets need nothing in the browser. Positions are in world space.

use serde::Serialize;
use serde_json::{Map, Value, json};

use lightkiln_encode::LightCode;

use crate::charts::charts;

/// A layer of light.
#[derive(Clone, Debug, Default)]
pub struct LayerModel {
    /// What it is.
    pub signal: String,
    /// Numbers of a value, 1 to 3.
    pub channels: usize,
    /// `linear` or `log`.
    pub curve: String,
    /// Values at stored 0 and 1.
    pub range: [f32; 2],
    /// What counts as white, with `log`; else 0.
    pub white: f32,
    /// The uniform `scale` of the shaders: P(low), P(high) - P(low), white.
    pub scale: [f32; 3],
    /// What values are clamped to after interpolation, if they are.
    pub clamp: Option<[f32; 2]>,
    /// Unit of the range.
    pub unit: String,
    /// Per vertex.
    pub codes: Vec<LightCode>,
    /// Per vertex: least-squares values alone, packed; empty when nobody knows them.
    pub vertex_codes: Vec<LightCode>,
    /// The same light with texels everywhere, when it was traced.
    pub full: Option<FullTexture>,
    /// Bits of a stored number: 8 or 16.
    pub bits: u32,
    /// Pages in their order, 1 or 3 numbers a texel, `0..=1`.
    pub pages: Vec<Vec<f32>>,
    /// The table that codes name entries of: rows of 256 colors, 1 or 3 numbers each, `0..=1`.
    pub table: Option<Vec<f32>>,
}

/// A layer as a lightmap over everything, to compare with.
#[derive(Clone, Debug, Default)]
pub struct FullTexture {
    /// Per vertex.
    pub codes: Vec<LightCode>,
    /// As [`LayerModel::pages`], in 8 bits, of [`Model::full_size`] texels.
    pub pages: Vec<Vec<f32>>,
}

/// Triangles that are drawn alike.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Group {
    /// How many triangles, from where the group before ends.
    pub triangles: u32,
    /// Whether their backs are drawn.
    pub double_sided: bool,
    /// Index into [`Model::textures`].
    pub texture: Option<usize>,
    /// Where alpha is less there is nothing; 0 for what is opaque.
    pub cutoff: f32,
}

/// An image on surfaces.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Texture {
    /// Index into [`Model::images`].
    pub image: usize,
    /// What lies outside, along u and v: `repeat`, `mirror` or `clamp`.
    pub wrap: [&'static str; 2],
}

/// An image file that browsers know.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Image {
    /// Its media type.
    pub kind: &'static str,
    /// The file.
    pub bytes: Vec<u8>,
}

/// The error of what the file shows at a point.
#[derive(Clone, Copy, Debug, Default)]
pub struct ErrorPoint {
    /// Where.
    pub at: [f32; 3],
    /// Of the surface there.
    pub normal: [f32; 3],
    /// Whether it is seen from behind, too.
    pub double_sided: bool,
    /// Above 0 where it is too bright.
    pub error: f32,
}

/// A baked scene.
#[derive(Clone, Debug, Default)]
pub struct Model {
    /// The file's name.
    pub name: String,
    /// Names of the parts.
    pub part_names: Vec<String>,
    /// Per vertex, world space.
    pub positions: Vec<[f32; 3]>,
    /// Per vertex, of unit length or zero.
    pub normals: Vec<[f32; 3]>,
    /// Per vertex: what the base color texture is multiplied with, linear, and alpha.
    pub base_colors: Vec<[f32; 4]>,
    /// Per vertex: texture coordinates; empty without textures.
    pub uvs: Vec<[f32; 2]>,
    /// Per vertex: index into `part_names`.
    pub parts: Vec<u32>,
    /// Per vertex: what viewers see that do not know the extension, linear; empty without a fallback.
    pub fallback: Vec<[f32; 3]>,
    /// Corners as numbers of vertices, group after group.
    pub triangles: Vec<[u32; 3]>,
    /// Which triangles are drawn alike; together they have all.
    pub groups: Vec<Group>,
    /// Base color textures.
    pub textures: Vec<Texture>,
    /// Their images.
    pub images: Vec<Image>,
    /// Whether there is any light yet: while a bake runs, the codes of the only layer mean nothing at first.
    pub is_lit: bool,
    /// At least one.
    pub layers: Vec<LayerModel>,
    /// Width and height of a page in texels, 0 without texture triangles.
    pub page_size: [u32; 2],
    /// Width and height of a page of the full texture in texels.
    pub full_size: [u32; 2],
    /// Width of a texel on the surface.
    pub texel_size: f32,
    /// The error bound.
    pub max_error: f32,
    /// Points with their errors; empty when nothing was traced.
    pub errors: Vec<ErrorPoint>,
    /// Surface area over points.
    pub area_per_error: f32,
    /// Figures for the corner: whatever the page shows of a report.
    pub figures: Map<String, Value>,
}

/// Where a section lies in the block.
#[derive(Serialize)]
struct Section {
    offset: usize,
    bytes: usize,
}

/// The block while it grows.
#[derive(Default)]
struct Block {
    bytes: Vec<u8>,
    sections: Map<String, Value>,
}

impl Block {
    /// Adds a section, at a multiple of 4 bytes.
    fn add(&mut self, name: String, bytes: impl IntoIterator<Item = u8>) {
        let offset = self.bytes.len();
        self.bytes.extend(bytes);
        let section = Section { offset, bytes: self.bytes.len() - offset };
        self.bytes.resize(self.bytes.len().next_multiple_of(4), 0);
        self.sections.insert(name, serde_json::to_value(section).expect("plain numbers"));
    }

    fn floats<'a>(&mut self, name: &str, values: impl IntoIterator<Item = &'a f32>) {
        self.add(name.to_owned(), values.into_iter().flat_map(|v| v.to_le_bytes()));
    }

    fn codes(&mut self, name: String, codes: &[LightCode]) {
        self.add(name, codes.iter().flat_map(|c| c.0).flat_map(u16::to_le_bytes));
    }

    /// Numbers `0..=1` as 8 or 16 bits.
    fn image(&mut self, name: String, values: &[f32], bits: u32) {
        match bits {
            16 => self.add(name, values.iter().flat_map(|&v| ((v * 65535.0).round() as u16).to_le_bytes())),
            _ => self.add(name, values.iter().map(|&v| byte(v))),
        }
    }
}

fn byte(value: f32) -> u8 {
    (value.clamp(0.0, 1.0) * 255.0).round() as u8
}

/// Numbers `-1..=1` as signed bytes.
fn signed_bytes([x, y, z]: [f32; 3], w: f32) -> [u8; 4] {
    [x, y, z, w].map(|n| (n.clamp(-1.0, 1.0) * 127.0).round() as i8 as u8)
}

/// The root keeps dark colors apart in 8 bits; the page squares them.
fn root_byte(linear: f32) -> u8 {
    byte(linear.max(0.0).sqrt())
}

impl Model {
    /// The description and the block.
    pub fn pack(&self) -> (Value, Vec<u8>) {
        let mut block = Block::default();
        let indices = &self.triangles;
        let (chart_count, chart_of) =
            charts(indices, self.layers.first().map_or(&[], |l| l.codes.as_slice()));
        block.floats("positions", self.positions.iter().flatten());
        block.add("normals".into(), self.normals.iter().flat_map(|&n| signed_bytes(n, 0.0)));
        let rooted = |c: &[f32; 4]| [root_byte(c[0]), root_byte(c[1]), root_byte(c[2]), byte(c[3])];
        block.add("baseColors".into(), self.base_colors.iter().flat_map(rooted));
        if !self.uvs.is_empty() {
            block.floats("uvs", self.uvs.iter().flatten());
        }
        let ids = chart_of.iter().zip(&self.parts).flat_map(|(&chart, &part)| [chart, part]);
        block.add("ids".into(), ids.flat_map(u32::to_le_bytes));
        block.add("indices".into(), indices.iter().flatten().flat_map(|v| v.to_le_bytes()));
        if !self.fallback.is_empty() {
            // As it stands in the file: linear bytes.
            let plain = |c: &[f32; 3]| [byte(c[0]), byte(c[1]), byte(c[2]), 255];
            block.add("fallback".into(), self.fallback.iter().flat_map(plain));
        }
        if !self.errors.is_empty() {
            let numbers = self.errors.iter().flat_map(|e| e.at.into_iter().chain([e.error]));
            block.add("errors".into(), numbers.flat_map(f32::to_le_bytes));
            let sides =
                self.errors.iter().map(|e| signed_bytes(e.normal, f32::from(u8::from(e.double_sided))));
            block.add("errorNormals".into(), sides.flatten());
        }
        let layers: Vec<Value> = self.layers.iter().enumerate().map(|(n, l)| l.pack(n, &mut block)).collect();
        let [low, high] = self.bounds();
        let texture = indices.iter().filter(|c| self.texture_corners(c) == 3).count();
        let mixed = indices.iter().filter(|c| matches!(self.texture_corners(c), 1 | 2)).count();
        let description = json!({
            "name": self.name,
            "parts": self.part_names,
            "vertices": self.positions.len(),
            "triangles": indices.len(),
            "groups": self.groups.iter().map(|g| json!({
                "triangles": g.triangles, "doubleSided": g.double_sided, "texture": g.texture, "cutoff": g.cutoff,
            })).collect::<Vec<_>>(),
            "textures": self.textures.iter().map(|t| json!({
                "image": self.images.get(t.image).map(|image| image.name(t.image)), "wrap": t.wrap,
            })).collect::<Vec<_>>(),
            "lit": self.is_lit,
            "classes": { "texture": texture, "mixed": mixed, "color": indices.len() - texture - mixed },
            "charts": chart_count,
            "bounds": [low, high],
            "pageSize": self.page_size,
            "fullSize": self.full_size,
            "texelSize": self.texel_size,
            "maxError": self.max_error,
            "areaPerError": self.area_per_error,
            "layers": layers,
            "figures": self.figures,
            "sections": block.sections,
        });
        (description, block.bytes)
    }

    fn texture_corners(&self, corners: &[u32; 3]) -> usize {
        let Some(first) = self.layers.first() else { return 0 };
        corners.iter().filter(|&&v| !first.codes[v as usize].is_color()).count()
    }

    /// Corners of the box around all triangles; zeros around none.
    fn bounds(&self) -> [[f32; 3]; 2] {
        let mut bounds = [[f32::INFINITY; 3], [f32::NEG_INFINITY; 3]];
        for &vertex in self.triangles.iter().flatten() {
            for (k, &x) in self.positions[vertex as usize].iter().enumerate() {
                bounds[0][k] = bounds[0][k].min(x);
                bounds[1][k] = bounds[1][k].max(x);
            }
        }
        if bounds[0][0].is_finite() { bounds } else { [[0.0; 3]; 2] }
    }
}

impl Image {
    /// The name of an image's file in the site.
    pub fn name(&self, number: usize) -> String {
        format!("image{number}.{}", self.kind.rsplit('/').next().unwrap_or_default())
    }
}

impl LayerModel {
    fn pack(&self, number: usize, block: &mut Block) -> Value {
        block.codes(format!("codes{number}"), &self.codes);
        if !self.vertex_codes.is_empty() {
            block.codes(format!("vertexCodes{number}"), &self.vertex_codes);
        }
        for (page, values) in self.pages.iter().enumerate() {
            block.image(format!("page{number}_{page}"), values, self.bits);
        }
        if let Some(full) = &self.full {
            block.codes(format!("fullCodes{number}"), &full.codes);
            for (page, values) in full.pages.iter().enumerate() {
                block.image(format!("full{number}_{page}"), values, 8);
            }
        }
        let form = match (&self.table, self.channels) {
            (Some(table), _) => {
                block.image(format!("table{number}"), table, 8);
                "table"
            }
            (None, 1) => "scalar",
            (None, _) => "rgb",
        };
        json!({
            "signal": self.signal,
            "channels": self.channels,
            "numbers": if self.channels == 1 { 1 } else { 3 },
            "curve": self.curve,
            "range": self.range,
            "white": self.white,
            "scale": self.scale,
            "clamp": self.clamp,
            "unit": self.unit,
            "form": form,
            "bits": self.bits,
            "pages": self.pages.len(),
            "fullPages": self.full.as_ref().map_or(0, |full| full.pages.len()),
        })
    }
}

#[cfg(test)]
pub(crate) mod testing {
    use super::*;

    /// A texture triangle and a mixed one, with an atlas of one page.
    pub fn model() -> Model {
        let place = |u, v| LightCode::texture([u, v]).expect("in range");
        Model {
            name: "a<b>.glb".into(),
            part_names: vec!["floor".into()],
            positions: vec![[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 2.0, 0.0], [-1.0, 0.0, 0.5]],
            normals: vec![[0.0, 0.0, 1.0]; 4],
            base_colors: vec![[0.25, 1.0, 0.0, 1.0]; 4],
            parts: vec![0; 4],
            triangles: vec![[0, 1, 2], [0, 2, 3]],
            groups: [false, true]
                .map(|double_sided| Group { triangles: 1, double_sided, ..Group::default() })
                .to_vec(),
            is_lit: true,
            layers: vec![LayerModel {
                signal: "ambientOcclusion".into(),
                channels: 1,
                curve: "linear".into(),
                range: [0.0, 1.0],
                scale: [0.0, 1.0, 0.0],
                codes: vec![place(1.0, 1.0), place(3.0, 1.0), place(1.0, 3.0), LightCode::color(1.0)],
                bits: 8,
                pages: vec![vec![0.5; 16]],
                ..LayerModel::default()
            }],
            page_size: [4, 4],
            texel_size: 0.5,
            max_error: 0.03,
            ..Model::default()
        }
    }
}

#[cfg(test)]
mod tests {
    use super::testing::model;
    use super::*;

    fn section<'a>(json: &Value, block: &'a [u8], name: &str) -> &'a [u8] {
        let at = |key: &str| json["sections"][name][key].as_u64().expect(name) as usize;
        assert_eq!(at("offset") % 4, 0, "{name}");
        &block[at("offset")..at("offset") + at("bytes")]
    }

    #[test]
    fn pack_puts_every_number_where_it_says() {
        let (json, block) = model().pack();
        let positions = section(&json, &block, "positions");
        assert_eq!(positions.len(), 4 * 12);
        assert_eq!(positions[28..32], 2.0_f32.to_le_bytes());
        assert_eq!(section(&json, &block, "normals")[..4], [0, 0, 127, 0]);
        // The square root of the color.
        assert_eq!(section(&json, &block, "baseColors")[..4], [128, 255, 0, 255]);
        assert_eq!(
            section(&json, &block, "codes0"),
            [8, 0, 8, 0, 24, 0, 8, 0, 8, 0, 24, 0, 255, 255, 0, 128]
        );
        assert_eq!(section(&json, &block, "page0_0"), [128; 16]);
        assert_eq!(section(&json, &block, "indices")[12..16], 0_u32.to_le_bytes());
        // Chart and part of each vertex.
        assert_eq!(section(&json, &block, "ids")[..12], [1, 0, 0, 0, 0, 0, 0, 0, 1, 0, 0, 0]);
        assert_eq!(json["classes"], json!({ "texture": 1, "mixed": 1, "color": 0 }));
        assert_eq!(json["bounds"], json!([[-1.0, 0.0, 0.0], [1.0, 2.0, 0.5]]));
        assert_eq!(json["groups"][1]["doubleSided"], true);
        assert!(json["sections"]["fallback"].is_null() && json["sections"]["vertexCodes0"].is_null());
    }

    #[test]
    fn pack_of_sixteen_bits_and_tables_says_so() {
        let mut model = model();
        model.layers[0].bits = 16;
        model.layers[0].table = Some(vec![1.0; 256]);
        let (json, block) = model.pack();
        assert_eq!(section(&json, &block, "page0_0").len(), 32);
        assert_eq!(section(&json, &block, "table0"), [255; 256]);
        assert_eq!((&json["layers"][0]["form"], &json["layers"][0]["bits"]), (&json!("table"), &json!(16)));
    }

    #[test]
    fn pack_of_nothing_is_small_and_sound() {
        let (json, block) = Model::default().pack();
        assert_eq!(block.len(), 0);
        assert_eq!((&json["triangles"], &json["bounds"][1][2]), (&json!(0), &json!(0.0)));
    }
}
