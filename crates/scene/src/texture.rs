//! Textures as signals: what a material's image, or an image from a file, shows at a point of a triangle.
//!
//! Images are decoded once and looked up bilinearly at their finest level, with the wrap modes of their sampler,
//! KHR_texture_transform and the set of texture coordinates that the material asks for. Colors come out linear.
//!
//! Deviation: the filters that a sampler names are not looked at; vertex colors are not multiplied in.

use std::collections::BTreeMap;
use std::ops::{Add, Mul, Sub};
use std::path::Path;
use std::sync::Arc;

use serde_json::Value;

use crate::document::{Document, extension, index, integer, list, number, numbers};
use crate::error::{Place, SceneError, codec, value};
use crate::geometry::{attribute, open};
use crate::images::decode;
use crate::material::base_color;
use crate::scene::Scene;
use crate::srgb::linear;

/// What lies outside of an image.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Wrap {
    /// Its edge.
    Clamp,
    /// Its mirror image.
    Mirror,
    /// The image again.
    Repeat,
}

impl Wrap {
    fn texel(self, i: i64, size: usize) -> usize {
        let n = size as i64;
        (match self {
            Self::Clamp => i.clamp(0, n - 1),
            Self::Repeat => i.rem_euclid(n),
            Self::Mirror => {
                let j = i.rem_euclid(2 * n);
                if j < n { j } else { 2 * n - 1 - j }
            }
        }) as usize
    }
}

/// From texture coordinates to texels.
#[derive(Clone, Debug)]
pub(crate) struct Mapping {
    /// The `TEXCOORD_n` that it uses.
    pub set: u64,
    wrap: [Wrap; 2],
    /// Rows of the affine map of texture coordinates (KHR_texture_transform).
    transform: [[f32; 3]; 2],
}

/// The four texels around a point, and where it lies between them.
pub(crate) struct Cell {
    columns: [usize; 2],
    rows: [usize; 2],
    part: [f32; 2],
}

impl Cell {
    /// Bilinear interpolation; `texel` takes column and row.
    pub fn mix<T>(&self, texel: impl Fn(usize, usize) -> T) -> T
    where
        T: Copy + Add<Output = T> + Sub<Output = T> + Mul<f32, Output = T>,
    {
        let mix = |a: T, b: T, t: f32| a + (b - a) * t;
        let row = |y: usize| mix(texel(self.columns[0], y), texel(self.columns[1], y), self.part[0]);
        mix(row(self.rows[0]), row(self.rows[1]), self.part[1])
    }
}

impl Mapping {
    /// The first set as it is, repeated: what a texture has that says nothing.
    fn plain(set: u64) -> Self {
        Self { set, wrap: [Wrap::Repeat; 2], transform: [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]] }
    }

    /// Reads a texture info object and the sampler of the texture that it names.
    pub fn read(document: &Document, info: &Value, texture: &Value) -> Result<Self, SceneError> {
        let samplers = document.list("samplers");
        let none = Value::Null;
        let sampler = index(texture, "sampler", samplers.len())?.map_or(&none, |s| &samplers[s]);
        let wrap = |key| -> Result<Wrap, SceneError> {
            Ok(match integer(sampler, key)?.unwrap_or(10497) {
                33071 => Wrap::Clamp,
                33648 => Wrap::Mirror,
                _ => Wrap::Repeat,
            })
        };
        let mut mapping = Self::plain(integer(info, "texCoord")?.unwrap_or(0));
        mapping.wrap = [wrap("wrapS")?, wrap("wrapT")?];
        if let Some(t) = extension(info, "KHR_texture_transform") {
            mapping.set = integer(t, "texCoord")?.unwrap_or(mapping.set);
            let offset = numbers::<2>(t, "offset")?.unwrap_or([0.0; 2]).map(|v| v as f32);
            let scale = numbers::<2>(t, "scale")?.unwrap_or([1.0; 2]).map(|v| v as f32);
            // Counter-clockwise in an image whose v points down.
            let (sin, cos) = number(t, "rotation", 0.0).sin_cos();
            mapping.transform =
                [[cos * scale[0], sin * scale[1], offset[0]], [-sin * scale[0], cos * scale[1], offset[1]]];
        }
        Ok(mapping)
    }

    /// What lies outside of the image, along u and v.
    pub fn wrap(&self) -> [Wrap; 2] {
        self.wrap
    }

    /// Texture coordinates after KHR_texture_transform.
    pub fn transformed(&self, [u, v]: [f32; 2]) -> [f32; 2] {
        self.transform.map(|[a, b, c]| a * u + b * v + c)
    }

    /// Where texture coordinates lie in an image that repeats for ever, in texels.
    pub fn texel_position(&self, uv: [f32; 2], size: [usize; 2]) -> [f32; 2] {
        let at = self.transformed(uv);
        [at[0] * size[0] as f32, at[1] * size[1] as f32]
    }

    /// Texels that a triangle covers, by the area between its texture coordinates.
    pub fn texel_area(&self, corners: [[f32; 2]; 3], size: [usize; 2]) -> f32 {
        area(corners.map(|uv| self.texel_position(uv, size)))
    }

    /// The texels around a point of an image.
    pub fn cell(&self, uv: [f32; 2], size: [usize; 2]) -> Cell {
        let at = self.texel_position(uv, size);
        let mut pairs = [[0; 2]; 2];
        let mut part = [0.0_f32; 2];
        for k in 0..2 {
            // Huge coordinates have no texel precision left; the cast saturates.
            let x = at[k] - 0.5;
            let x = if x.is_finite() { x.clamp(-1e9, 1e9) } else { 0.0 };
            let first = x.floor() as i64;
            pairs[k] = [first, first + 1].map(|i| self.wrap[k].texel(i, size[k]));
            part[k] = x - x.floor();
        }
        Cell { columns: pairs[0], rows: pairs[1], part }
    }
}

/// The area of a triangle.
fn area([a, b, c]: [[f32; 2]; 3]) -> f32 {
    let area = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);
    if area.is_finite() { area.abs() / 2.0 } else { f32::MAX }
}

/// The texture that a texture info object names, and its image.
pub(crate) fn texture_of<'a>(
    document: &'a Document,
    info: &Value,
) -> Result<Option<(&'a Value, Option<usize>)>, SceneError> {
    let textures = document.list("textures");
    let Some(texture) = index(info, "index", textures.len())?.map(|t| &textures[t]) else { return Ok(None) };
    let count = document.list("images").len();
    let source = match index(texture, "source", count)? {
        Some(source) => Some(source),
        None => match extension(texture, "EXT_texture_webp") {
            Some(webp) => index(webp, "source", count)?,
            None => None,
        },
    };
    Ok(Some((texture, source)))
}

/// Which texture of a material.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Slot {
    /// `baseColorTexture` times `baseColorFactor`: three channels, 1 where there is neither.
    BaseColor,
    /// `occlusionTexture` at its strength: one channel, 1 where there is none.
    Occlusion,
    /// `MOZ_lightmap` or `EXT_lightmap`, an extension of materials: three channels, 0 where there is none.
    Lightmap,
}

/// Textures on the triangles of a scene, ready to be looked up.
pub struct Textures<'a> {
    scene: &'a Scene,
    channels: usize,
    /// Per part, per primitive.
    parts: Vec<Vec<Option<Shown>>>,
}

/// What a primitive shows.
struct Shown {
    base: [f32; 3],
    factor: [f32; 3],
    texture: Option<Lookup>,
}

struct Lookup {
    image: Arc<Image>,
    mapping: Mapping,
    /// Per glTF vertex of the pool.
    uv: Arc<Vec<[f32; 2]>>,
}

struct Image {
    size: [usize; 2],
    texels: Texels,
}

/// Three numbers a texel.
enum Texels {
    Eight(Vec<u8>),
    Sixteen(Vec<u16>),
}

impl Image {
    fn decode(bytes: &[u8]) -> Option<Self> {
        let decoded = decode(bytes)?;
        let size = [decoded.width() as usize, decoded.height() as usize];
        let deep = decoded.color().bytes_per_pixel() / decoded.color().channel_count() > 1;
        let texels = if deep {
            Texels::Sixteen(decoded.into_rgb16().into_raw())
        } else {
            Texels::Eight(decoded.into_rgb8().into_raw())
        };
        Some(Self { size, texels })
    }

    fn get(&self, column: usize, row: usize, channel: usize) -> f32 {
        let at = (row * self.size[0] + column) * 3 + channel;
        match &self.texels {
            Texels::Eight(t) => f32::from(t[at]) / 255.0,
            Texels::Sixteen(t) => f32::from(t[at]) / 65535.0,
        }
    }
}

impl Scene {
    /// The textures of one slot of all materials; `None` when no material has one.
    ///
    /// # Errors
    /// Images that do not exist or do not decode, and whatever is wrong with texture coordinates.
    pub fn textures(&self, slot: Slot) -> Result<Option<Textures<'_>>, SceneError> {
        let mut reader = Reader { scene: self, images: BTreeMap::new(), sets: BTreeMap::new() };
        let mut found = false;
        let mut parts = Vec::with_capacity(self.parts.len());
        for (number, part) in self.parts.iter().enumerate() {
            let mut shown = Vec::with_capacity(part.primitives.len());
            for (primitive, material) in part.primitive_materials.iter().enumerate() {
                let none = Value::Null;
                let json = material.map_or(&none, |m| &self.document.list("materials")[m]);
                let (info, base, factor) = slot.of(json);
                let texture = match info {
                    Some(info) => reader.texture(number, primitive, info)?,
                    None => None,
                };
                found |= texture.is_some();
                // A texture that cannot be looked up is as if it were not there.
                let factor = if texture.is_none() && slot == Slot::Lightmap { [0.0; 3] } else { factor };
                shown.push(Some(Shown { base, factor, texture }));
            }
            parts.push(shown);
        }
        let channels = if slot == Slot::Occlusion { 1 } else { 3 };
        Ok(found.then_some(Textures { scene: self, channels, parts }))
    }

    /// An image file on one set of the scene's texture coordinates, repeated; `None` when no primitive has that set.
    ///
    /// # Errors
    /// [`SceneError::Io`] and [`SceneError::Codec`] for the image, and whatever is wrong with texture coordinates.
    pub fn textured_with(&self, image: &Path, set: u32) -> Result<Option<Textures<'_>>, SceneError> {
        let bytes = std::fs::read(image).map_err(|source| SceneError::Io {
            action: "read",
            path: image.to_owned(),
            source,
            place: Box::default(),
        })?;
        let image = Image::decode(&bytes).ok_or_else(|| codec("image", "it is no PNG, JPEG or WebP"))?;
        let image = Arc::new(image);
        let mut reader = Reader { scene: self, images: BTreeMap::new(), sets: BTreeMap::new() };
        let mut found = false;
        let mut parts = Vec::with_capacity(self.parts.len());
        for (number, part) in self.parts.iter().enumerate() {
            let mut shown = Vec::with_capacity(part.primitives.len());
            for primitive in 0..part.primitives.len() {
                let mapping = Mapping::plain(u64::from(set));
                let uv = reader.coordinates(number, primitive, mapping.set)?;
                found |= uv.is_some();
                shown.push(uv.map(|uv| Shown {
                    base: [0.0; 3],
                    factor: [1.0; 3],
                    texture: Some(Lookup { image: Arc::clone(&image), mapping, uv }),
                }));
            }
            parts.push(shown);
        }
        Ok(found.then_some(Textures { scene: self, channels: 3, parts }))
    }
}

impl Slot {
    /// The texture info of a material, what is added to its texels and what they are multiplied with.
    fn of(self, material: &Value) -> (Option<&Value>, [f32; 3], [f32; 3]) {
        match self {
            Self::BaseColor => {
                let ([r, g, b, _], info) = base_color(material);
                (info, [0.0; 3], [r, g, b])
            }
            Self::Occlusion => {
                let info = material.get("occlusionTexture");
                let strength = info.map_or(1.0, |i| number(i, "strength", 1.0)).clamp(0.0, 1.0);
                (info, [1.0 - strength; 3], [strength; 3])
            }
            Self::Lightmap => {
                let named = |name| extension(material, name);
                let info = named("MOZ_lightmap").or_else(|| named("EXT_lightmap"));
                let intensity = info.map_or(1.0, |i| number(i, "intensity", 1.0));
                (info, [0.0; 3], [intensity; 3])
            }
        }
    }
}

struct Reader<'a> {
    scene: &'a Scene,
    images: BTreeMap<usize, Arc<Image>>,
    /// By accessor.
    sets: BTreeMap<usize, Arc<Vec<[f32; 2]>>>,
}

impl Reader<'_> {
    fn texture(&mut self, part: usize, primitive: usize, info: &Value) -> Result<Option<Lookup>, SceneError> {
        let document = &self.scene.document;
        let Some((texture, Some(source))) = texture_of(document, info)? else { return Ok(None) };
        let mapping = Mapping::read(document, info, texture)?;
        let Some(uv) = self.coordinates(part, primitive, mapping.set)? else { return Ok(None) };
        let image = match self.images.get(&source) {
            Some(known) => Arc::clone(known),
            None => {
                let place = Place { attribute: Some(format!("images[{source}]")), ..Place::default() };
                let decoded = Image::decode(&document.image(source)?)
                    .ok_or_else(|| codec("image", "it is no PNG, JPEG or WebP").at(|p| *p = place))?;
                let image = Arc::new(decoded);
                self.images.insert(source, Arc::clone(&image));
                image
            }
        };
        Ok(Some(Lookup { image, mapping, uv }))
    }

    /// A set of texture coordinates of a primitive, per glTF vertex of its pool.
    fn coordinates(
        &mut self,
        part: usize,
        primitive: usize,
        set: u64,
    ) -> Result<Option<Arc<Vec<[f32; 2]>>>, SceneError> {
        let document = &self.scene.document;
        let owner = &self.scene.parts[part];
        let json = &list(&document.list("meshes")[owner.mesh], "primitives")[owner.primitives[primitive]];
        let semantic = format!("TEXCOORD_{set}");
        let Some(accessor) = attribute(document, json, &semantic)? else { return Ok(None) };
        if let Some(known) = self.sets.get(&accessor) {
            return Ok(Some(Arc::clone(known)));
        }
        let vertices = self.scene.gltf_vertex_count(part);
        let elements = open(document, accessor, &semantic, 2..=2, Some(vertices))?;
        let uv: Vec<[f32; 2]> = (0..vertices).map(|v| elements.floats(v)).collect();
        if uv.iter().flatten().any(|x| !x.is_finite()) {
            return Err(value(semantic, "not finite", "finite numbers"));
        }
        let uv = Arc::new(uv);
        self.sets.insert(accessor, Arc::clone(&uv));
        Ok(Some(uv))
    }
}

impl Textures<'_> {
    /// Numbers a point: 1 or 3.
    pub fn channels(&self) -> usize {
        self.channels
    }

    /// Texels of its image that a part's triangle covers, by the area between its texture coordinates; none where it
    /// shows no image.
    pub fn texels(&self, part: usize, triangle: usize) -> Option<f32> {
        self.texel_corners(part, triangle).map(area)
    }

    /// Where the corners of a part's triangle lie in its image, which may repeat for ever, in texels: texel (i, j) has its
    /// centre at (i + 0.5, j + 0.5). None where it shows no image.
    pub fn texel_corners(&self, part: usize, triangle: usize) -> Option<[[f32; 2]; 3]> {
        let primitive = self.scene.parts[part].triangle_primitives[triangle] as usize;
        let Lookup { image, mapping, uv } = self.parts[part][primitive].as_ref()?.texture.as_ref()?;
        let corners = self.scene.gltf_corners(part, triangle);
        Some(corners.map(|v| mapping.texel_position(uv[v as usize], image.size)))
    }

    /// What a point of a part's triangle shows, linear. False when it shows nothing, having no texture coordinates.
    ///
    /// - `barycentric`: weights of the second and third corner
    /// - `out`: [`Self::channels`] numbers
    pub fn sample(&self, part: usize, triangle: usize, barycentric: [f32; 2], out: &mut [f32]) -> bool {
        let primitive = self.scene.parts[part].triangle_primitives[triangle] as usize;
        let Some(shown) = &self.parts[part][primitive] else { return false };
        let texel: [f32; 3] = match &shown.texture {
            None => [1.0; 3],
            Some(Lookup { image, mapping, uv }) => {
                let corners = self.scene.gltf_corners(part, triangle).map(|v| uv[v as usize]);
                let [v, w] = barycentric;
                let at =
                    [0, 1].map(|k| (1.0 - v - w) * corners[0][k] + v * corners[1][k] + w * corners[2][k]);
                let cell = mapping.cell(at, image.size);
                // Occlusion is linear in the file, colors are not.
                let decode = if self.channels == 1 { |x| x } else { linear };
                std::array::from_fn(|c| cell.mix(|x, y| decode(image.get(x, y, c))))
            }
        };
        for (c, out) in out.iter_mut().enumerate().take(self.channels) {
            *out = shown.base[c] + shown.factor[c] * texel[c];
        }
        true
    }
}
