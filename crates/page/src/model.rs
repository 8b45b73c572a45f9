//! A baked scene as the viewer takes it: two blocks of little-endian numbers, and a JSON that says where in them what lies.
//!
//! Whoever makes it has read the scene already, so that Draco, meshopt and quantized files, skins, instances and morph
//! targets need nothing in the browser. Positions are in world space.
//!
//! One block has the [`Geometry`], the other one the light: while a bake goes on, only light is new. Where light makes
//! several vertices of one, the block of light names those of the geometry that are copied, and the corners that are
//! moved to a copy.

use std::borrow::Cow;
use std::sync::Arc;

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

/// What is drawn, whatever the light on it is.
#[derive(Clone, Debug, Default)]
pub struct Geometry {
    /// The file's name.
    pub name: String,
    /// Names of the parts.
    pub part_names: Vec<String>,
    /// Per vertex, world space.
    pub positions: Vec<[f32; 3]>,
    /// Per vertex, of unit length; zero for that of the triangle around each point.
    pub normals: Vec<[f32; 3]>,
    /// Per vertex: what the base color texture is multiplied with, linear, and alpha.
    pub base_colors: Vec<[f32; 4]>,
    /// Per vertex: texture coordinates; empty without textures.
    pub uvs: Vec<[f32; 2]>,
    /// Corners as numbers of vertices, group after group.
    pub triangles: Vec<[u32; 3]>,
    /// Which triangles are drawn alike; together they have all.
    pub groups: Vec<Group>,
    /// Which triangles are of one part: its index into `part_names` and how many they are, run after run.
    pub parts: Vec<(u32, u32)>,
    /// Base color textures.
    pub textures: Vec<Texture>,
    /// Their images.
    pub images: Vec<Image>,
    /// Corners of the box that the page shows at first.
    pub frame: [[f32; 3]; 2],
}

/// A baked scene.
#[derive(Clone, Debug, Default)]
pub struct Model {
    /// What light lies on. It is sent anew only where it is another one than before.
    pub geometry: Arc<Geometry>,
    /// Vertices beyond those of the geometry: the one there that each is but for its light.
    pub copies: Vec<u32>,
    /// Corners that are at a copy: number of the corner, and of the vertex counting from the first of the geometry.
    pub moved: Vec<[u32; 2]>,
    /// Per vertex: what viewers see that do not know the extension, linear; empty without a fallback.
    pub fallback: Vec<[f32; 3]>,
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

/// What the page gets: a block of numbers, where in it what lies, and what it is told beside.
#[derive(Clone, Debug, Default)]
pub struct Packed {
    /// Members of the description.
    pub about: Map<String, Value>,
    /// Offset and bytes of each section, by its name.
    pub sections: Map<String, Value>,
    /// The block.
    pub bytes: Vec<u8>,
}

impl Packed {
    /// Adds a section, at a multiple of 4 bytes.
    fn add(&mut self, name: &str, bytes: impl IntoIterator<Item = u8>) {
        let offset = self.bytes.len();
        self.bytes.extend(bytes);
        self.sections
            .insert(name.to_owned(), json!({ "offset": offset, "bytes": self.bytes.len() - offset }));
        self.bytes.resize(self.bytes.len().next_multiple_of(4), 0);
    }

    fn floats<'a>(&mut self, name: &str, values: impl IntoIterator<Item = &'a f32>) {
        self.add(name, values.into_iter().flat_map(|v| v.to_le_bytes()));
    }

    fn numbers<'a>(&mut self, name: &str, values: impl IntoIterator<Item = &'a u32>) {
        self.add(name, values.into_iter().flat_map(|v| v.to_le_bytes()));
    }

    fn codes(&mut self, name: &str, codes: &[LightCode]) {
        self.add(name, codes.iter().flat_map(|c| c.0).flat_map(u16::to_le_bytes));
    }

    /// Numbers `0..=1` as 8 or 16 bits.
    fn image(&mut self, name: &str, values: &[f32], bits: u32) {
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

impl Geometry {
    /// What the page gets of it.
    pub fn pack(&self) -> Packed {
        let mut out = Packed::default();
        out.floats("positions", self.positions.iter().flatten());
        out.add("normals", self.normals.iter().flat_map(|&n| signed_bytes(n, 0.0)));
        let rooted = |c: &[f32; 4]| [root_byte(c[0]), root_byte(c[1]), root_byte(c[2]), byte(c[3])];
        out.add("baseColors", self.base_colors.iter().flat_map(rooted));
        if !self.uvs.is_empty() {
            out.floats("uvs", self.uvs.iter().flatten());
        }
        out.numbers("indices", self.triangles.iter().flatten());
        out.about = members(json!({
            "name": self.name,
            "parts": self.part_names,
            "partRuns": self.parts,
            "triangles": self.triangles.len(),
            "groups": self.groups.iter().map(|g| json!({
                "triangles": g.triangles, "doubleSided": g.double_sided, "texture": g.texture, "cutoff": g.cutoff,
            })).collect::<Vec<_>>(),
            "textures": self.textures.iter().map(|t| json!({
                "image": self.images.get(t.image).map(|image| image.name(t.image)), "wrap": t.wrap,
            })).collect::<Vec<_>>(),
            "bounds": self.bounds(),
            "frame": self.frame,
        }));
        out
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

/// The members of an object of JSON.
fn members(value: Value) -> Map<String, Value> {
    match value {
        Value::Object(members) => members,
        _ => Map::new(),
    }
}

impl Model {
    /// What the page gets of it beside the geometry.
    pub fn pack(&self) -> Packed {
        let mut out = Packed::default();
        let indices = self.triangles();
        let (chart_count, chart_of) =
            charts(&indices, self.layers.first().map_or(&[], |l| l.codes.as_slice()));
        out.numbers("copies", &self.copies);
        out.numbers("moved", self.moved.iter().flatten());
        match u16::try_from(chart_count) {
            Ok(0) => {}
            Ok(_) => out.add("charts", chart_of.iter().flat_map(|&c| (c as u16).to_le_bytes())),
            Err(_) => out.numbers("charts", &chart_of),
        }
        if !self.fallback.is_empty() {
            // As it stands in the file: linear bytes.
            let plain = |c: &[f32; 3]| [byte(c[0]), byte(c[1]), byte(c[2]), 255];
            out.add("fallback", self.fallback.iter().flat_map(plain));
        }
        if !self.errors.is_empty() {
            let numbers = self.errors.iter().flat_map(|e| e.at.into_iter().chain([e.error]));
            out.add("errors", numbers.flat_map(f32::to_le_bytes));
            let sides =
                self.errors.iter().map(|e| signed_bytes(e.normal, f32::from(u8::from(e.double_sided))));
            out.add("errorNormals", sides.flatten());
        }
        let layers: Vec<Value> = self.layers.iter().enumerate().map(|(n, l)| l.pack(n, &mut out)).collect();
        let texture = indices.iter().filter(|c| self.texture_corners(c) == 3).count();
        let mixed = indices.iter().filter(|c| matches!(self.texture_corners(c), 1 | 2)).count();
        out.about = members(json!({
            "vertices": self.geometry.positions.len() + self.copies.len(),
            "lit": self.is_lit,
            "classes": { "texture": texture, "mixed": mixed, "color": indices.len() - texture - mixed },
            "charts": chart_count,
            "pageSize": self.page_size,
            "fullSize": self.full_size,
            "texelSize": self.texel_size,
            "maxError": self.max_error,
            "areaPerError": self.area_per_error,
            "layers": layers,
            "figures": self.figures,
        }));
        out
    }

    /// Corners as numbers of vertices, copies among them.
    fn triangles(&self) -> Cow<'_, [[u32; 3]]> {
        let mut triangles = Cow::Borrowed(self.geometry.triangles.as_slice());
        for &[corner, vertex] in &self.moved {
            triangles.to_mut()[corner as usize / 3][corner as usize % 3] = vertex;
        }
        triangles
    }

    fn texture_corners(&self, corners: &[u32; 3]) -> usize {
        let Some(first) = self.layers.first() else { return 0 };
        corners.iter().filter(|&&v| !first.codes[v as usize].is_color()).count()
    }
}

impl Image {
    /// The name of an image's file in the site.
    pub fn name(&self, number: usize) -> String {
        format!("image{number}.{}", self.kind.rsplit('/').next().unwrap_or_default())
    }
}

impl LayerModel {
    fn pack(&self, number: usize, out: &mut Packed) -> Value {
        out.codes(&format!("codes{number}"), &self.codes);
        if !self.vertex_codes.is_empty() {
            out.codes(&format!("vertexCodes{number}"), &self.vertex_codes);
        }
        for (page, values) in self.pages.iter().enumerate() {
            out.image(&format!("page{number}_{page}"), values, self.bits);
        }
        if let Some(full) = &self.full {
            out.codes(&format!("fullCodes{number}"), &full.codes);
            for (page, values) in full.pages.iter().enumerate() {
                out.image(&format!("full{number}_{page}"), values, 8);
            }
        }
        let form = match (&self.table, self.channels) {
            (Some(table), _) => {
                out.image(&format!("table{number}"), table, 8);
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
            geometry: Arc::new(Geometry {
                name: "a<b>.glb".into(),
                part_names: vec!["floor".into()],
                positions: vec![[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 2.0, 0.0], [-1.0, 0.0, 0.5]],
                normals: vec![[0.0, 0.0, 1.0]; 4],
                base_colors: vec![[0.25, 1.0, 0.0, 1.0]; 4],
                triangles: vec![[0, 1, 2], [0, 2, 3]],
                groups: [false, true]
                    .map(|double_sided| Group { triangles: 1, double_sided, ..Group::default() })
                    .to_vec(),
                parts: vec![(0, 2)],
                ..Geometry::default()
            }),
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

    fn section<'a>(packed: &'a Packed, name: &str) -> &'a [u8] {
        let at = |key: &str| packed.sections[name][key].as_u64().expect(name) as usize;
        assert_eq!(at("offset") % 4, 0, "{name}");
        &packed.bytes[at("offset")..at("offset") + at("bytes")]
    }

    #[test]
    fn pack_puts_every_number_where_it_says() {
        let geometry = model().geometry.pack();
        let positions = section(&geometry, "positions");
        assert_eq!(positions.len(), 4 * 12);
        assert_eq!(positions[28..32], 2.0_f32.to_le_bytes());
        assert_eq!(section(&geometry, "normals")[..4], [0, 0, 127, 0]);
        // The square root of the color.
        assert_eq!(section(&geometry, "baseColors")[..4], [128, 255, 0, 255]);
        assert_eq!(section(&geometry, "indices")[12..16], 0_u32.to_le_bytes());
        assert_eq!(geometry.about["bounds"], json!([[-1.0, 0.0, 0.0], [1.0, 2.0, 0.5]]));
        assert_eq!(geometry.about["groups"][1]["doubleSided"], true);
        assert_eq!(geometry.about["partRuns"], json!([[0, 2]]));
        let light = model().pack();
        assert_eq!(section(&light, "codes0"), [8, 0, 8, 0, 24, 0, 8, 0, 8, 0, 24, 0, 255, 255, 0, 128]);
        assert_eq!(section(&light, "page0_0"), [128; 16]);
        // The chart of each vertex.
        assert_eq!(section(&light, "charts"), [1, 0, 1, 0, 1, 0, 0, 0]);
        assert_eq!(light.about["classes"], json!({ "texture": 1, "mixed": 1, "color": 0 }));
        assert!(["fallback", "vertexCodes0"].iter().all(|name| !light.sections.contains_key(*name)));
    }

    #[test]
    fn pack_of_copies_counts_by_the_corners_that_are_moved_to_them() {
        let mut model = model();
        // The second triangle shows vertex values alone.
        model.layers[0].codes.extend([LightCode::color(0.25), LightCode::color(0.5)]);
        (model.copies, model.moved) = (vec![0, 2], vec![[3, 4], [4, 5]]);
        let light = model.pack();
        assert_eq!(light.about["vertices"], 6);
        assert_eq!(light.about["classes"], json!({ "texture": 1, "mixed": 0, "color": 1 }));
        assert_eq!(section(&light, "copies"), [0, 0, 0, 0, 2, 0, 0, 0]);
        assert_eq!(section(&light, "moved")[8..], [4, 0, 0, 0, 5, 0, 0, 0]);
        assert_eq!(section(&light, "charts").len(), 2 * 6);
    }

    #[test]
    fn pack_of_sixteen_bits_and_tables_says_so() {
        let mut model = model();
        model.layers[0].bits = 16;
        model.layers[0].table = Some(vec![1.0; 256]);
        let light = model.pack();
        assert_eq!(section(&light, "page0_0").len(), 32);
        assert_eq!(section(&light, "table0"), [255; 256]);
        let layer = &light.about["layers"][0];
        assert_eq!((&layer["form"], &layer["bits"]), (&json!("table"), &json!(16)));
    }

    #[test]
    fn pack_of_nothing_is_small_and_sound() {
        let (geometry, light) = (Geometry::default().pack(), Model::default().pack());
        assert!(geometry.bytes.is_empty() && light.bytes.is_empty());
        assert_eq!((&geometry.about["triangles"], &geometry.about["bounds"][1][2]), (&json!(0), &json!(0.0)));
    }
}
