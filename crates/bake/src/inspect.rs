//! What a baked or unbaked file costs on the GPU, without baking anything.

use std::fmt::Write;
use std::path::Path;

use lightkiln_report::table::count;
use lightkiln_report::{Contributor, LightBytes, bytes_text};
use lightkiln_scene::{Profile, ReadOptions, Scene};
use serde::Serialize;

use crate::file_light::Extension;
use crate::rounds::light_stride;
use crate::stored::StoredLayer;
use crate::{BakeError, FileLight, Surface, file_name};

/// The memory budget of a file.
#[derive(Clone, Debug, Serialize)]
#[serde(rename_all = "camelCase")]
pub struct Inspection {
    /// The file's name.
    pub file: String,
    /// Its length.
    pub file_bytes: u64,
    /// Triangles drawn.
    pub triangles: u64,
    /// glTF vertices drawn.
    pub vertices: u64,
    /// Vertices and indices without light; what instances share is counted once.
    pub geometry: u64,
    /// Images of the materials, uncompressed with mips, and how many of them.
    pub textures: u64,
    /// How many images.
    pub images: usize,
    /// How the light was baked, if it was.
    pub baked: Option<Extension>,
    /// What the light costs, if there is any. Vertices that a bake added cannot be told from others here and
    /// count as geometry.
    pub light: Option<LightBytes>,
    /// The `COLOR_0` fallback.
    pub fallback: u64,
    /// Share of the triangles that read the atlas.
    pub texture_triangles: u64,
    /// The largest nodes, by light if there is any, else by geometry.
    pub largest: Vec<Contributor>,
    /// Pages of the atlas, and width and height of one.
    pub atlas: Option<(usize, [u32; 2])>,
}

/// How many nodes an inspection names.
const LARGEST: usize = 10;

/// Reads a file and adds up what it costs.
///
/// # Errors
/// Errors of the readers.
pub fn inspect(path: &Path) -> Result<Inspection, BakeError> {
    let scene = Scene::read(path, &ReadOptions::default())?;
    let file = file_name(path);
    let recipe = match FileLight::recipe(&scene, &file) {
        Ok(recipe) => Some(recipe),
        Err(BakeError::NotBaked { .. }) => None,
        Err(error) => return Err(error),
    };
    // What is not baked counts as a whole.
    let surface = match &recipe {
        Some(recipe) => Surface::with(&scene, &file, recipe.light.cast(&scene, &[])?)?,
        None => Surface::new(&scene, &file)?,
    };
    let light = recipe.map(|_| FileLight::read(&surface, &file)).transpose()?;
    let vertices: u64 = (0..scene.parts.len()).map(|p| scene.gltf_vertex_count(p) as u64).sum();
    let images = scene.image_sizes();
    let pixels = images.iter().filter_map(|i| i.pixels).map(|[w, h]| u64::from(w) * u64::from(h));
    let textures = pixels.map(|n| n * 4 + LightBytes::mips_of(n * 4)).sum();
    let light_bytes = light.as_ref().map(|light| {
        let atlas = light.stored.texels() * light.stored.texel_bytes();
        LightBytes {
            attribute: vertices * light_stride(light.profile, light.stored.layers.len()),
            added_vertices: 0,
            atlas,
            mips: LightBytes::mips_of(atlas),
            tables: light.stored.layers.iter().map(StoredLayer::table_bytes).sum(),
        }
    });
    let texture_triangles = match &light {
        Some(light) => surface.mesh.triangle_ids().filter(|&t| light.is_texture(t)).count() as u64,
        None => 0,
    };
    let inputs = scene.inputs();
    let length = |path: &std::path::PathBuf| std::fs::metadata(path).map_or(0, |m| m.len());
    Ok(Inspection {
        file,
        file_bytes: inputs.iter().map(length).sum(),
        triangles: surface.mesh.triangle_count() as u64,
        vertices,
        geometry: geometry(&scene).iter().map(|c| c.bytes).sum(),
        textures,
        images: images.len(),
        fallback: if scene.has_fallback() { vertices * 4 } else { 0 },
        texture_triangles,
        largest: largest(&scene),
        atlas: light.as_ref().and_then(|l| l.extension.page_size.map(|size| (l.pages(), size))),
        baked: light.map(|l| l.extension),
        light: light_bytes,
    })
}

/// Vertices and indices of each part; parts that share them with an earlier one count nothing.
fn geometry(scene: &Scene) -> Vec<Contributor> {
    let mut counted = std::collections::BTreeSet::new();
    scene
        .parts
        .iter()
        .enumerate()
        .map(|(number, part)| {
            let vertices = scene.gltf_vertex_count(number);
            let index = if vertices > usize::from(u16::MAX) { 4 } else { 2 };
            let own = counted.insert((part.mesh, part.primitives.clone()));
            let bytes = vertices * scene.vertex_stride(number) + part.triangles.len() * 3 * index;
            Contributor {
                name: scene.part_name(number),
                bytes: if own { bytes as u64 } else { 0 },
                texel_bytes: 0,
            }
        })
        .collect()
}

fn largest(scene: &Scene) -> Vec<Contributor> {
    let mut all: Vec<Contributor> = Vec::new();
    for contributor in geometry(scene) {
        match all.last_mut().filter(|last| last.name == contributor.name) {
            Some(last) => last.bytes += contributor.bytes,
            None => all.push(contributor),
        }
    }
    all.sort_by(|a, b| b.bytes.cmp(&a.bytes).then_with(|| a.name.cmp(&b.name)));
    all.truncate(LARGEST);
    all
}

impl Inspection {
    /// What the light takes in all, if there is any.
    pub fn light_bytes(&self) -> Option<u64> {
        self.light.map(|light| light.total())
    }

    /// As JSON, indented, with a final newline.
    pub fn to_json(&self) -> String {
        let mut text = serde_json::to_string_pretty(self).expect("plain numbers and strings");
        text.push('\n');
        text
    }

    /// As a table for a terminal.
    pub fn to_text(&self) -> String {
        let mut out = String::new();
        let mut line = |label: &str, text: String| {
            let _ = writeln!(out, "{label:<12} {text}");
        };
        line("file", format!("{}, {} on disk", self.file, bytes_text(self.file_bytes)));
        line("geometry", {
            let (triangles, vertices) = (count(self.triangles), count(self.vertices));
            format!("{triangles} triangles, {vertices} vertices, {}", bytes_text(self.geometry))
        });
        line(
            "textures",
            format!("{} images, {} uncompressed with mips", self.images, bytes_text(self.textures)),
        );
        match (&self.baked, self.light) {
            (Some(baked), Some(light)) => {
                line(
                    "light",
                    format!(
                        "{}, profile {}, bound {:.1} %, detail {:.5}, by {}",
                        baked
                            .layers
                            .iter()
                            .map(|layer| layer.signal.as_str())
                            .collect::<Vec<_>>()
                            .join(" + "),
                        baked.profile,
                        baked.max_error * 100.0,
                        baked.detail,
                        baked.generator
                    ),
                );
                let total = bytes_text(light.total());
                let [attribute, atlas, mips] = [light.attribute, light.atlas, light.mips].map(bytes_text);
                line("", format!("{total}: attribute {attribute}, atlas {atlas} + mips {mips}"));
                if let Some((pages, [width, height])) = self.atlas {
                    let triangles = count(self.texture_triangles);
                    line(
                        "",
                        format!(
                            "{triangles} texture triangles, {pages} page(s) of {width} x {height} texels"
                        ),
                    );
                }
                if self.fallback > 0 {
                    line("", format!("COLOR_0 fallback {}", bytes_text(self.fallback)));
                }
            }
            _ => {
                let bytes = bytes_text(self.vertices * light_stride(Profile::Eta, 1));
                line("light", format!("no light of ours; a value at every vertex would take {bytes}"));
            }
        }
        for contributor in &self.largest {
            line("node", format!("{:>12}  {}", bytes_text(contributor.bytes), contributor.name));
        }
        out
    }
}
