//! A glTF file as it came: the JSON as a value, the bytes of its buffers, and careful ways to look into both.
//!
//! Nothing here trusts the file: every index is checked against what it indexes, every length against the
//! bytes that are there, before anything is allocated.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;

use serde_json::{Map, Value};

use crate::container::{self, Container};
use crate::error::{SceneError, codec, reference, truncated, value};
use crate::meshopt;
use crate::uri;

/// Extensions that compress buffer views with the meshopt codecs.
pub(crate) const MESHOPT: [&str; 2] = ["EXT_meshopt_compression", "KHR_meshopt_compression"];

/// Where the bytes of a buffer came from.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum BufferSource {
    /// The BIN chunk of a GLB.
    Chunk,
    /// A file beside the scene.
    File,
    /// A data URI.
    Data,
    /// None: a placeholder for what meshopt decompresses.
    Fallback,
}

#[derive(Clone, Debug)]
pub(crate) struct Buffer {
    pub bytes: Vec<u8>,
    pub source: BufferSource,
}

/// A read file.
#[derive(Debug)]
pub(crate) struct Document {
    pub root: Value,
    pub buffers: Vec<Buffer>,
    /// Chunks of a GLB after JSON and BIN.
    pub chunks: Vec<(u32, Vec<u8>)>,
    pub path: Option<PathBuf>,
    /// What Draco decoded, by accessor: tightly packed elements of the accessor's own type.
    pub decoded: BTreeMap<usize, Vec<u8>>,
    views: Vec<OnceLock<Vec<u8>>>,
}

/// The elements of an array property; empty when it is missing.
pub(crate) fn list<'a>(object: &'a Value, key: &str) -> &'a [Value] {
    object.get(key).and_then(Value::as_array).map_or(&[], Vec::as_slice)
}

/// A non-negative integer property. Floats without a fraction count as integers, as JSON has only numbers.
pub(crate) fn integer(object: &Value, key: &str) -> Result<Option<u64>, SceneError> {
    match object.get(key) {
        None => Ok(None),
        Some(v) => match whole(v) {
            Some(n) => Ok(Some(n)),
            None => Err(value(key, v, "a non-negative integer")),
        },
    }
}

/// A JSON number as a non-negative integer.
pub(crate) fn whole(v: &Value) -> Option<u64> {
    v.as_u64().or_else(|| v.as_f64().filter(|f| *f >= 0.0 && f.fract() == 0.0 && *f < 9e15).map(|f| f as u64))
}

/// A property that names an object among `count`.
pub(crate) fn index(object: &Value, key: &str, count: usize) -> Result<Option<usize>, SceneError> {
    match integer(object, key)? {
        None => Ok(None),
        Some(n) if n < count as u64 => Ok(Some(n as usize)),
        Some(n) => Err(reference(key, n, count)),
    }
}

/// A number property with a default; anything that is no finite number counts as missing.
pub(crate) fn number(object: &Value, key: &str, default: f32) -> f32 {
    object.get(key).and_then(Value::as_f64).map(|v| v as f32).filter(|v| v.is_finite()).unwrap_or(default)
}

/// A property that is an array of exactly `N` finite numbers.
pub(crate) fn numbers<const N: usize>(object: &Value, key: &str) -> Result<Option<[f64; N]>, SceneError> {
    let Some(v) = object.get(key) else { return Ok(None) };
    let bad = || value(key, v, "an array of finite numbers of the right length");
    let array = v.as_array().filter(|a| a.len() == N).ok_or_else(bad)?;
    let mut out = [0.0; N];
    for (o, n) in out.iter_mut().zip(array) {
        *o = n.as_f64().filter(|n| n.is_finite()).ok_or_else(bad)?;
    }
    Ok(Some(out))
}

/// An extension object of an object.
pub(crate) fn extension<'a>(object: &'a Value, name: &str) -> Option<&'a Value> {
    object.get("extensions")?.get(name)
}

/// An object's name.
pub(crate) fn name(object: &Value) -> Option<String> {
    object.get("name").and_then(Value::as_str).map(str::to_owned)
}

/// The object behind a value, made one if it is not.
pub(crate) fn object(v: &mut Value) -> &mut Map<String, Value> {
    if !v.is_object() {
        *v = Value::Object(Map::new());
    }
    v.as_object_mut().expect("made an object above")
}

/// An array property, made one if it is missing.
pub(crate) fn array<'a>(owner: &'a mut Value, key: &str) -> &'a mut Vec<Value> {
    let v = object(owner).entry(key).or_insert_with(|| Value::Array(Vec::new()));
    if !v.is_array() {
        *v = Value::Array(Vec::new());
    }
    v.as_array_mut().expect("made an array above")
}

impl Document {
    /// Takes a file apart and loads its buffers. Without a path nothing outside of the bytes is read.
    pub fn parse(bytes: Vec<u8>, path: Option<&Path>) -> Result<Self, SceneError> {
        let Container { json, chunk, chunks } = container::split(bytes)?;
        let root: Value = serde_json::from_slice(&json)
            .map_err(|source| SceneError::Json { source, place: Box::default() })?;
        drop(json);
        if !root.is_object() {
            return Err(value("the root", &root, "an object"));
        }
        let version =
            root.get("asset").and_then(|a| a.get("version")).and_then(Value::as_str).unwrap_or("missing");
        if !version.starts_with("2.") {
            return Err(SceneError::Version { version: version.to_owned(), place: Box::default() });
        }
        let folder = path.map(|p| p.parent().unwrap_or(Path::new("")));
        let mut chunk = chunk;
        let mut buffers = Vec::new();
        for (i, buffer) in list(&root, "buffers").iter().enumerate() {
            buffers.push(load_buffer(buffer, i, &mut chunk, folder)?);
        }
        let views = list(&root, "bufferViews").iter().map(|_| OnceLock::new()).collect();
        Ok(Self { root, buffers, chunks, path: path.map(Path::to_owned), decoded: BTreeMap::new(), views })
    }

    pub fn list(&self, key: &str) -> &[Value] {
        list(&self.root, key)
    }

    /// The bytes of a buffer view, decompressed if need be.
    pub fn view(&self, view: usize) -> Result<&[u8], SceneError> {
        let count = self.list("bufferViews").len();
        let json =
            self.list("bufferViews").get(view).ok_or_else(|| reference("bufferView", view as u64, count))?;
        for name in MESHOPT {
            if let Some(compressed) = extension(json, name) {
                if let Some(bytes) = self.views.get(view).and_then(OnceLock::get) {
                    return Ok(bytes);
                }
                let bytes = self.decompress(compressed)?;
                let slot = self.views.get(view).ok_or_else(|| reference("bufferView", view as u64, count))?;
                return Ok(slot.get_or_init(|| bytes));
            }
        }
        self.range(json, &format!("bufferViews[{view}]"))
    }

    /// The bytes that `buffer`, `byteOffset` and `byteLength` of an object name.
    pub fn range(&self, json: &Value, owner: &str) -> Result<&[u8], SceneError> {
        let buffer = index(json, "buffer", self.buffers.len())?
            .ok_or_else(|| value("buffer", "missing", "the number of a buffer"))?;
        let offset = integer(json, "byteOffset")?.unwrap_or(0);
        let length = integer(json, "byteLength")?
            .ok_or_else(|| value("byteLength", "missing", "a number of bytes"))?;
        let bytes = &self.buffers[buffer].bytes;
        let end = offset.saturating_add(length);
        if end > bytes.len() as u64 {
            return Err(truncated(owner, end, bytes.len() as u64));
        }
        Ok(&bytes[offset as usize..end as usize])
    }

    fn decompress(&self, json: &Value) -> Result<Vec<u8>, SceneError> {
        let data = self.range(json, "a meshopt-compressed view")?;
        let need = |key| integer(json, key)?.ok_or_else(|| value(key, "missing", "an integer"));
        let (count, stride) = (need("count")?, need("byteStride")?);
        let limit = (data.len() as u64 + 64).saturating_mul(2048);
        if count.saturating_mul(stride) > limit {
            return Err(truncated(
                "a meshopt-compressed view",
                count.saturating_mul(stride) / 2048,
                data.len() as u64,
            ));
        }
        let text = |key| json.get(key).and_then(Value::as_str);
        let mode = match text("mode") {
            Some("ATTRIBUTES") => meshopt::Mode::Attributes,
            Some("TRIANGLES") => meshopt::Mode::Triangles,
            Some("INDICES") => meshopt::Mode::Indices,
            other => {
                return Err(value("mode", other.unwrap_or("missing"), "ATTRIBUTES, TRIANGLES or INDICES"));
            }
        };
        let filter = match text("filter") {
            None | Some("NONE") => meshopt::Filter::None,
            Some("OCTAHEDRAL") => meshopt::Filter::Octahedral,
            Some("QUATERNION") => meshopt::Filter::Quaternion,
            Some("EXPONENTIAL") => meshopt::Filter::Exponential,
            Some("COLOR") => meshopt::Filter::Color,
            Some(other) => return Err(value("filter", other, "a filter of the extension")),
        };
        meshopt::decode(data, count as usize, stride as usize, mode, filter).map_err(|e| codec("meshopt", e))
    }

    /// The bytes of an image, from its view, data URI or file.
    pub fn image(&self, image: usize) -> Result<Vec<u8>, SceneError> {
        let images = self.list("images");
        let json = images.get(image).ok_or_else(|| reference("image", image as u64, images.len()))?;
        if let Some(view) = index(json, "bufferView", self.list("bufferViews").len())? {
            return Ok(self.view(view)?.to_vec());
        }
        self.image_file(json, image)
    }

    /// The bytes of an image that has a URI.
    pub fn image_file(&self, json: &Value, image: usize) -> Result<Vec<u8>, SceneError> {
        let text = json.get("uri").and_then(Value::as_str).ok_or_else(|| value("uri", "missing", "a URI"))?;
        let folder = self.path.as_deref().map(|p| p.parent().unwrap_or(Path::new("")));
        uri::load(text, &format!("images[{image}]"), folder)
    }

    /// Total bytes of all buffers: what an element count can be judged by.
    pub fn total_bytes(&self) -> u64 {
        self.buffers.iter().map(|b| b.bytes.len() as u64).sum()
    }
}

fn load_buffer(
    json: &Value,
    number: usize,
    chunk: &mut Option<Vec<u8>>,
    folder: Option<&Path>,
) -> Result<Buffer, SceneError> {
    let owner = format!("buffers[{number}]");
    let length =
        integer(json, "byteLength")?.ok_or_else(|| value("byteLength", "missing", "a number of bytes"))?;
    let fallback = MESHOPT.iter().any(|name| extension(json, name).is_some());
    let (bytes, source) = match json.get("uri") {
        Some(text) => {
            let text = text.as_str().ok_or_else(|| value("uri", text, "a URI"))?;
            let source = if uri::is_data(text) { BufferSource::Data } else { BufferSource::File };
            (uri::load(text, &owner, folder)?, source)
        }
        None => match chunk.take().filter(|_| number == 0) {
            Some(bytes) => (bytes, BufferSource::Chunk),
            None if fallback => return Ok(Buffer { bytes: Vec::new(), source: BufferSource::Fallback }),
            None => {
                let reason = "no uri and no BIN chunk".to_owned();
                return Err(SceneError::NoData { owner, reason, place: Box::default() });
            }
        },
    };
    if (bytes.len() as u64) < length {
        return Err(truncated(owner, length, bytes.len() as u64));
    }
    let mut bytes = bytes;
    // What lies beyond `byteLength` is padding that no view may reach.
    bytes.truncate(length as usize);
    Ok(Buffer { bytes, source })
}
