//! What the page draws of a scene, apart from its light: vertices, looks, and which triangles are drawn alike. Light is put
//! on it as codes of corners, from a file or from a bake that is still going on.

use std::array::from_fn;
use std::collections::{BTreeMap, HashMap};
use std::sync::Arc;

use glam::Vec3;
use lightkiln_bake::file_light::LayerInfo;
use lightkiln_bake::{BakeError, Surface};
use lightkiln_encode::LightCode;
use lightkiln_light::{Curve, Scale};
use lightkiln_mesh::TriangleId;
use lightkiln_page::{Geometry, Group, Image, LayerModel, Model, Texture};
use lightkiln_render::frame;
use lightkiln_scene::{AlphaMode, Appearance, Part, Scene, Wrap};

/// Coverage below which nothing is drawn: of a triangle, where transmission makes it glass that the page looks through, and
/// of a point of a material that blends.
const THIN: f32 = 0.25;

/// Places of a triangle at which its coverage is looked up: weights of its second and third corner.
const PLACES: [[f32; 2]; 7] =
    [[0.33, 0.33], [0.1, 0.1], [0.8, 0.1], [0.1, 0.8], [0.45, 0.1], [0.1, 0.45], [0.45, 0.45]];

/// A scene as the page draws it, without light.
#[derive(Default)]
pub struct Shape {
    /// Everything that light does not change.
    geometry: Arc<Geometry>,
    /// The part and the number there of each triangle, in the order in which they are drawn.
    sources: Vec<(usize, usize)>,
}

/// What tells groups apart: sidedness, texture, and the bits of the cutoff.
type Looks = (bool, Option<usize>, u32);

/// What tells vertices of a part apart: the bits of position, normal, base color and texture coordinates.
type Vertex = [u32; 12];

/// A triangle of a group.
struct Drawn {
    /// Its part, and its number there.
    source: (usize, usize),
    /// Its vertices in the model.
    vertices: [u32; 3],
}

/// Codes on a scene: one attribute of the model.
pub struct CodeSet {
    /// Per part, per triangle, of its corners; nothing for parts without light.
    pub parts: Vec<Vec<[LightCode; 3]>>,
    /// What those show.
    pub unlit: LightCode,
}

impl CodeSet {
    /// The codes of the triangles that a surface has of its scene.
    pub fn of(surface: &Surface<'_>, unlit: LightCode, codes: impl Fn(TriangleId) -> [LightCode; 3]) -> Self {
        let of_part = |part| surface.triangles_of_part(part).map(&codes).collect();
        Self { parts: (0..surface.scene.parts.len()).map(of_part).collect(), unlit }
    }

    fn at(&self, part: usize, triangle: usize) -> [LightCode; 3] {
        let codes = self.parts.get(part).and_then(|part| part.get(triangle));
        codes.copied().unwrap_or([self.unlit; 3])
    }
}

impl Shape {
    /// Gathers a scene.
    ///
    /// - `file`: its name
    ///
    /// # Errors
    /// Attributes and references that are faulty.
    pub fn new(scene: &Scene, file: &str) -> Result<Self, BakeError> {
        let mut bare = Geometry { name: file.to_owned(), ..Geometry::default() };
        let mut seen = Seen::default();
        let mut grouped: BTreeMap<Looks, Vec<Drawn>> = BTreeMap::new();
        for (number, part) in scene.parts.iter().enumerate() {
            bare.part_names.push(scene.part_name(number));
            let looks: Vec<Appearance> = (0..part.primitives.len())
                .map(|primitive| scene.appearance(number, primitive))
                .collect::<Result<_, _>>()?;
            let textures: Vec<Option<usize>> =
                looks.iter().map(|l| seen.texture(scene, &mut bare, l)).collect();
            let is_flat = flat_vertices(part);
            let mut made: HashMap<Vertex, u32> = HashMap::new();
            for (triangle, &corners) in part.triangles.iter().enumerate() {
                let primitive = part.triangle_primitives[triangle] as usize;
                let flags = scene.triangle_flags(number, triangle);
                let covers = |&place: &[f32; 2]| scene.triangle_opacity(number, triangle, place) >= THIN;
                if flags.translucent && !PLACES.iter().any(covers) {
                    continue;
                }
                let looks = &looks[primitive];
                let of_file = scene.gltf_corners(number, triangle);
                let vertices = [0, 1, 2].map(|corner| {
                    let (vertex, of_file) = (corners[corner] as usize, of_file[corner] as usize);
                    let color = looks.colors.get(of_file).copied().unwrap_or([1.0; 4]);
                    let base_color: [f32; 4] = from_fn(|c| looks.factor[c] * color[c]);
                    // Without a picture it does not matter where on it.
                    let texture = looks.texture.as_ref().filter(|_| textures[primitive].is_some());
                    let uv = texture.map_or([0.0; 2], |texture| texture.uv[of_file]);
                    let position = part.positions[vertex].to_array();
                    let normal = if is_flat[vertex] { [0.0; 3] } else { part.normals[vertex].to_array() };
                    let numbers = [&position[..], &normal, &base_color, &uv].concat();
                    let key: Vertex = from_fn(|n| numbers[n].to_bits());
                    *made.entry(key).or_insert_with(|| {
                        bare.positions.push(position);
                        bare.normals.push(normal);
                        bare.base_colors.push(base_color);
                        bare.uvs.push(uv);
                        bare.positions.len() as u32 - 1
                    })
                });
                let cutoff = match looks.alpha_mode {
                    AlphaMode::Opaque => 0.0,
                    AlphaMode::Mask { cutoff } => cutoff,
                    AlphaMode::Blend => THIN,
                };
                let key = (flags.double_sided, textures[primitive], cutoff.max(0.0).to_bits());
                grouped.entry(key).or_default().push(Drawn { source: (number, triangle), vertices });
            }
        }
        let mut sources = Vec::new();
        for ((double_sided, texture, cutoff), triangles) in grouped {
            bare.groups.push(Group {
                triangles: triangles.len() as u32,
                double_sided,
                texture,
                cutoff: f32::from_bits(cutoff),
            });
            bare.triangles.extend(triangles.iter().map(|drawn| drawn.vertices));
            sources.extend(triangles.iter().map(|drawn| drawn.source));
        }
        let in_runs = |a: &(usize, usize), b: &(usize, usize)| a.0 == b.0;
        bare.parts = sources.chunk_by(in_runs).map(|run| (run[0].0 as u32, run.len() as u32)).collect();
        let corners = |t: usize| bare.triangles[t].map(|v| Vec3::from(bare.positions[v as usize]));
        bare.frame = frame(bare.triangles.len(), corners).map(|corner| corner.to_array());
        if bare.textures.is_empty() {
            bare.uvs.clear();
        }
        Ok(Self { geometry: bare.into(), sources })
    }

    /// The scene with light on it. Of vertices whose corners show different things, copies are made.
    ///
    /// - `fallback`: per part, per triangle: what viewers see at its corners that do not know the extension; empty if
    ///   nothing
    /// - returns: the model, whose layers are still to be filled in, and the codes of its vertices, set by set
    pub fn lit(&self, sets: &[CodeSet], fallback: &[Vec<[[f32; 3]; 3]>]) -> (Model, Vec<Vec<LightCode>>) {
        let geometry = &self.geometry;
        let count = geometry.positions.len();
        // Whether a vertex has its codes, and the next one in the same place.
        let (mut is_taken, mut next) = (vec![false; count], vec![u32::MAX; count]);
        let mut own = vec![vec![LightCode::default(); count]; sets.len()];
        let has_fallback = fallback.iter().any(|part| !part.is_empty());
        let mut shown = if has_fallback { vec![[1.0; 3]; count] } else { Vec::new() };
        let (mut copies, mut moved) = (Vec::new(), Vec::new());
        let mut of_corners = vec![[LightCode::default(); 3]; sets.len()];
        for (number, (corners, &(part, triangle))) in geometry.triangles.iter().zip(&self.sources).enumerate()
        {
            of_corners.iter_mut().zip(sets).for_each(|(out, set)| *out = set.at(part, triangle));
            let plain = fallback.get(part).and_then(|part| part.get(triangle)).unwrap_or(&[[1.0; 3]; 3]);
            for (k, &vertex) in corners.iter().enumerate() {
                let mut at = vertex as usize;
                let differs = |own: &[Vec<LightCode>], at: usize| {
                    own.iter().zip(&of_corners).any(|(own, corners)| own[at] != corners[k])
                };
                while is_taken[at] && differs(&own, at) {
                    if next[at] == u32::MAX {
                        next[at] = is_taken.len() as u32;
                        copies.push(vertex);
                        is_taken.push(false);
                        next.push(u32::MAX);
                        own.iter_mut().for_each(|own| own.push(LightCode::default()));
                        shown.extend(has_fallback.then_some([1.0; 3]));
                    }
                    at = next[at] as usize;
                }
                if !is_taken[at] {
                    is_taken[at] = true;
                    own.iter_mut().zip(&of_corners).for_each(|(own, corners)| own[at] = corners[k]);
                    if has_fallback {
                        shown[at] = plain[k];
                    }
                }
                if at != vertex as usize {
                    moved.push([3 * number as u32 + k as u32, at as u32]);
                }
            }
        }
        let geometry = Arc::clone(geometry);
        (Model { geometry, copies, moved, fallback: shown, is_lit: true, ..Model::default() }, own)
    }
}

/// How far from a triangle's own direction the normals of a flat one may be, as a cosine: what bytes do not tell apart.
const FLAT: f32 = 1.0 - 1e-6;

/// Per vertex of a part: whether all its triangles are flat. The page knows the normals of these by itself, and vertices
/// that are one but for normals become one; the geometry of a file without normals is a third as large.
fn flat_vertices(part: &Part) -> Vec<bool> {
    let mut is_flat = vec![true; part.positions.len()];
    for corners in &part.triangles {
        let [a, b, c] = corners.map(|v| part.positions[v as usize]);
        let own = (b - a).cross(c - a).normalize_or_zero();
        if own != Vec3::ZERO && corners.iter().any(|&v| part.normals[v as usize].dot(own) < FLAT) {
            corners.iter().for_each(|&v| is_flat[v as usize] = false);
        }
    }
    is_flat
}

/// Images and textures that the model has already.
#[derive(Default)]
struct Seen {
    /// By their number in the file: that in the model, if browsers know them.
    images: BTreeMap<usize, Option<usize>>,
}

impl Seen {
    /// The number of a primitive's texture in the model.
    fn texture(&mut self, scene: &Scene, model: &mut Geometry, looks: &Appearance) -> Option<usize> {
        let texture = looks.texture.as_ref()?;
        let image = *self.images.entry(texture.image).or_insert_with(|| {
            let (kind, bytes) = scene.image_file(texture.image)?;
            model.images.push(Image { kind, bytes });
            Some(model.images.len() - 1)
        });
        let wrap = texture.wrap.map(|wrap| match wrap {
            Wrap::Clamp => "clamp",
            Wrap::Mirror => "mirror",
            Wrap::Repeat => "repeat",
        });
        let texture = Texture { image: image?, wrap };
        let known = model.textures.iter().position(|t| *t == texture);
        Some(known.unwrap_or_else(|| {
            model.textures.push(texture);
            model.textures.len() - 1
        }))
    }
}

/// What unit values mean.
pub fn scale(info: &LayerInfo) -> Scale {
    let [low, high] = info.range;
    match info.white.filter(|&white| info.curve == "log" && white > 0.0) {
        Some(white) => Scale::log(white, low, high),
        None => Scale::linear(low, high),
    }
}

/// A layer of the model from what the file says of it, without codes and images.
pub fn layer(info: LayerInfo) -> LayerModel {
    let ([low, high], scale) = (info.range, scale(&info));
    let white = match scale.curve {
        Curve::Log { white } => white,
        Curve::Linear => 0.0,
    };
    LayerModel {
        channels: info.channels,
        range: info.range,
        white,
        scale: [scale.perceived(low), scale.perceived(high) - scale.perceived(low), white],
        clamp: info.clamp,
        bits: 8,
        signal: info.signal,
        curve: info.curve,
        unit: info.unit,
        ..LayerModel::default()
    }
}

/// The code of what gets no light: as bright as white.
pub fn unlit(layer: &LayerModel) -> LightCode {
    let white = if layer.white > 0.0 { (1.0 - layer.scale[0]) / layer.scale[1] } else { 1.0 };
    LightCode::color_of(&vec![white; layer.channels])
}
