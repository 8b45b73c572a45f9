//! What the page draws of a scene, apart from its light: vertices, looks, and which triangles are drawn alike. Light is put
//! on it as codes of corners, from a file or from a bake that is still going on.

use std::collections::BTreeMap;

use lightkiln_bake::file_light::LayerInfo;
use lightkiln_bake::{BakeError, Surface};
use lightkiln_encode::LightCode;
use lightkiln_light::{Curve, Scale};
use lightkiln_mesh::TriangleId;
use lightkiln_page::{Group, Image, LayerModel, Model, Texture};
use lightkiln_scene::{AlphaMode, Appearance, Scene, Wrap};

/// Coverage below which nothing is drawn: of a triangle, where transmission makes it glass that the page looks through, and
/// of a point of a material that blends.
const THIN: f32 = 0.25;

/// Places of a triangle at which its coverage is looked up: weights of its second and third corner.
const PLACES: [[f32; 2]; 7] =
    [[0.33, 0.33], [0.1, 0.1], [0.8, 0.1], [0.1, 0.8], [0.45, 0.1], [0.1, 0.45], [0.45, 0.45]];

/// A scene as the page draws it, without light.
#[derive(Default)]
pub struct Shape {
    /// Everything that light does not change. Its vertices are those of the file, one for each primitive that uses them.
    bare: Model,
    /// The part and the number there of each triangle, in the order in which they are drawn.
    sources: Vec<(usize, usize)>,
}

/// What tells groups apart: sidedness, texture, and the bits of the cutoff.
type Looks = (bool, Option<usize>, u32);

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
        let mut bare = Model { name: file.to_owned(), is_lit: true, ..Model::default() };
        let mut seen = Seen::default();
        let mut grouped: BTreeMap<Looks, Vec<Drawn>> = BTreeMap::new();
        for (number, part) in scene.parts.iter().enumerate() {
            bare.part_names.push(scene.part_name(number));
            let looks: Vec<Appearance> = (0..part.primitives.len())
                .map(|primitive| scene.appearance(number, primitive))
                .collect::<Result<_, _>>()?;
            let textures: Vec<Option<usize>> =
                looks.iter().map(|l| seen.texture(scene, &mut bare, l)).collect();
            // The vertex of the model for each vertex of the part, primitive by primitive: they follow each other.
            let mut made = vec![u32::MAX; part.positions.len()];
            let mut current = None;
            for (triangle, &corners) in part.triangles.iter().enumerate() {
                let primitive = part.triangle_primitives[triangle] as usize;
                if current.replace(primitive) != Some(primitive) {
                    made.fill(u32::MAX);
                }
                let flags = scene.triangle_flags(number, triangle);
                let covers = |&place: &[f32; 2]| scene.triangle_opacity(number, triangle, place) >= THIN;
                if flags.translucent && !PLACES.iter().any(covers) {
                    continue;
                }
                let looks = &looks[primitive];
                let of_file = scene.gltf_corners(number, triangle);
                let vertices = [0, 1, 2].map(|corner| {
                    let (vertex, of_file) = (corners[corner] as usize, of_file[corner] as usize);
                    if made[vertex] == u32::MAX {
                        made[vertex] = bare.positions.len() as u32;
                        bare.positions.push(part.positions[vertex].to_array());
                        bare.normals.push(part.normals[vertex].to_array());
                        bare.parts.push(number as u32);
                        let color = looks.colors.get(of_file).copied().unwrap_or([1.0; 4]);
                        bare.base_colors.push(std::array::from_fn(|c| looks.factor[c] * color[c]));
                        let texture = looks.texture.as_ref();
                        bare.uvs.push(texture.map_or([0.0; 2], |texture| texture.uv[of_file]));
                    }
                    made[vertex]
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
        if bare.textures.is_empty() {
            bare.uvs.clear();
        }
        Ok(Self { bare, sources })
    }

    /// The scene with light on it. Vertices whose corners show different things become several.
    ///
    /// - `fallback`: per part, per triangle: what viewers see at its corners that do not know the extension; empty if
    ///   nothing
    /// - returns: the model, whose layers are still to be filled in, and the codes of its vertices, set by set
    pub fn lit(&self, sets: &[CodeSet], fallback: &[Vec<[[f32; 3]; 3]>]) -> (Model, Vec<Vec<LightCode>>) {
        let bare = &self.bare;
        // First vertex of the new model for each bare one, and the next for the same one.
        let (mut first, mut next): (Vec<u32>, Vec<u32>) = (vec![u32::MAX; bare.positions.len()], Vec::new());
        let (mut origins, mut own): (Vec<u32>, Vec<Vec<LightCode>>) =
            (Vec::new(), vec![Vec::new(); sets.len()]);
        let (mut shown, mut triangles) = (Vec::new(), Vec::with_capacity(bare.triangles.len()));
        let mut of_corners = vec![[LightCode::default(); 3]; sets.len()];
        let has_fallback = fallback.iter().any(|part| !part.is_empty());
        for (corners, &(part, triangle)) in bare.triangles.iter().zip(&self.sources) {
            of_corners.iter_mut().zip(sets).for_each(|(out, set)| *out = set.at(part, triangle));
            let plain = fallback.get(part).and_then(|part| part.get(triangle)).unwrap_or(&[[1.0; 3]; 3]);
            triangles.push([0, 1, 2].map(|k| {
                let bare_vertex = corners[k] as usize;
                let mut at = first[bare_vertex];
                while at != u32::MAX && (0..sets.len()).any(|set| own[set][at as usize] != of_corners[set][k])
                {
                    at = next[at as usize];
                }
                if at == u32::MAX {
                    at = origins.len() as u32;
                    origins.push(bare_vertex as u32);
                    own.iter_mut().zip(&of_corners).for_each(|(own, corners)| own.push(corners[k]));
                    next.push(std::mem::replace(&mut first[bare_vertex], at));
                    if has_fallback {
                        shown.push(plain[k]);
                    }
                }
                at
            }));
        }
        fn chosen<T: Copy>(of: &[T], origins: &[u32]) -> Vec<T> {
            if of.is_empty() { Vec::new() } else { origins.iter().map(|&o| of[o as usize]).collect() }
        }
        let model = Model {
            name: bare.name.clone(),
            part_names: bare.part_names.clone(),
            positions: chosen(&bare.positions, &origins),
            normals: chosen(&bare.normals, &origins),
            base_colors: chosen(&bare.base_colors, &origins),
            uvs: chosen(&bare.uvs, &origins),
            parts: chosen(&bare.parts, &origins),
            fallback: shown,
            triangles,
            groups: bare.groups.clone(),
            textures: bare.textures.clone(),
            images: bare.images.clone(),
            is_lit: true,
            ..Model::default()
        };
        (model, own)
    }
}

/// Images and textures that the model has already.
#[derive(Default)]
struct Seen {
    /// By their number in the file: that in the model, if browsers know them.
    images: BTreeMap<usize, Option<usize>>,
}

impl Seen {
    /// The number of a primitive's texture in the model.
    fn texture(&mut self, scene: &Scene, model: &mut Model, looks: &Appearance) -> Option<usize> {
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
