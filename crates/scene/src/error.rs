//! What can be wrong with a file, where in it, and what to do about it.

use std::fmt;
use std::path::PathBuf;

/// Where in a file something was found. Fields that are not known yet, or do not apply, are `None`.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Place {
    /// The file.
    pub file: Option<PathBuf>,
    /// Number of the node.
    pub node: Option<usize>,
    /// Name of the node.
    pub node_name: Option<String>,
    /// Number of the mesh.
    pub mesh: Option<usize>,
    /// Name of the mesh.
    pub mesh_name: Option<String>,
    /// Number of the primitive within the mesh.
    pub primitive: Option<usize>,
    /// Number of the accessor.
    pub accessor: Option<usize>,
    /// The vertex attribute (`POSITION`, ...) or other role of the accessor.
    pub attribute: Option<String>,
}

impl Place {
    /// Whether nothing at all is known.
    pub fn is_empty(&self) -> bool {
        *self == Self::default()
    }
}

impl fmt::Display for Place {
    /// Writes `data/hall.glb, meshes[3].primitives[0].POSITION (accessors[7], mesh "hall", nodes[4] "column")`.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut comma = "";
        if let Some(file) = &self.file {
            write!(f, "{}", file.display())?;
            comma = ", ";
        }
        let mut path = String::new();
        if let Some(mesh) = self.mesh {
            path = format!("meshes[{mesh}]");
            if let Some(primitive) = self.primitive {
                path += &format!(".primitives[{primitive}]");
            }
        }
        if let Some(attribute) = &self.attribute {
            if !path.is_empty() {
                path.push('.');
            }
            path += attribute;
        }
        let mut notes = Vec::new();
        if let Some(accessor) = self.accessor {
            notes.push(format!("accessors[{accessor}]"));
        }
        if let Some(name) = &self.mesh_name {
            notes.push(format!("mesh \"{name}\""));
        }
        match (self.node, &self.node_name) {
            (Some(node), Some(name)) => notes.push(format!("nodes[{node}] \"{name}\"")),
            (Some(node), None) => notes.push(format!("nodes[{node}]")),
            _ => {}
        }
        if path.is_empty() && !notes.is_empty() {
            path = notes.remove(0);
        }
        if !path.is_empty() {
            write!(f, "{comma}{path}")?;
        }
        if !notes.is_empty() {
            write!(f, " ({})", notes.join(", "))?;
        }
        Ok(())
    }
}

/// Everything that keeps a scene from being read or written.
///
/// `Display` says what is wrong; [`SceneError::place`] says where, [`SceneError::remedy`] what to do.
#[derive(Debug, thiserror::Error)]
#[allow(missing_docs)] // the messages say what the fields are
pub enum SceneError {
    /// The operating system refused to read or write a file.
    #[error("cannot {action} {path}: {source}", path = path.display())]
    Io { action: &'static str, path: PathBuf, source: std::io::Error, place: Box<Place> },
    /// The file is neither JSON nor a GLB container, or the container is damaged.
    #[error("not a glTF file: {reason}")]
    Container { reason: String, place: Box<Place> },
    /// The JSON does not parse.
    #[error("the JSON does not parse: {source}")]
    Json { source: serde_json::Error, place: Box<Place> },
    /// A glTF version that is not 2.x.
    #[error("glTF version {version} is not 2.0")]
    Version { version: String, place: Box<Place> },
    /// A URI that leaves the scene's folder or asks for the network.
    #[error("{owner} points outside of the scene's folder: {uri}")]
    Outside { owner: String, uri: String, place: Box<Place> },
    /// A buffer without data.
    #[error("{owner} has no data: {reason}")]
    NoData { owner: String, reason: String, place: Box<Place> },
    /// Fewer bytes than promised.
    #[error("{owner} needs {needed} bytes, but there are {available}")]
    Truncated { owner: String, needed: u64, available: u64, place: Box<Place> },
    /// A number that names an object that does not exist.
    #[error("{field} is {index}, but there are only {count}")]
    Reference { field: String, index: u64, count: usize, place: Box<Place> },
    /// A scene was asked for that the file does not have.
    #[error("scene {scene} was asked for, but the file has {count}, counted from 0")]
    NoScene { scene: usize, count: usize, place: Box<Place> },
    /// A property that is missing or has a value that glTF does not allow.
    #[error("{field} is {found}, expected {expected}")]
    Value { field: String, found: String, expected: &'static str, place: Box<Place> },
    /// A triangle names a vertex that does not exist.
    #[error("index {element} names vertex {index}, but there are only {vertices}")]
    VertexIndex { element: usize, index: u32, vertices: usize, place: Box<Place> },
    /// A coordinate is NaN or infinite.
    #[error("element {element} is not finite: {value:?}")]
    NotFinite { element: usize, value: [f32; 3], place: Box<Place> },
    /// Attributes of one primitive that do not have the same number of elements.
    #[error("{count} elements, but POSITION has {expected}")]
    Count { count: usize, expected: usize, place: Box<Place> },
    /// A node is its own ancestor.
    #[error("the node is its own ancestor")]
    Cycle { place: Box<Place> },
    /// A node hangs below two parents, or twice in a scene.
    #[error("the node has two parents: {first} and {second}")]
    TwoParents { first: String, second: String, place: Box<Place> },
    /// An extension or codec that is not read.
    #[error("{what} is not supported")]
    Unsupported { what: String, remedy: &'static str, place: Box<Place> },
    /// Compressed data that does not decode.
    #[error("{codec} data does not decode: {reason}")]
    Codec { codec: &'static str, reason: String, place: Box<Place> },
    /// More than memory or 32-bit ids can hold.
    #[error("{count} {what}, the limit is {limit}")]
    TooLarge { what: &'static str, count: u64, limit: u64, place: Box<Place> },
    /// Light that does not belong to this scene, or a path that cannot be written to.
    #[error("{what}: {count}, expected {expected}")]
    Light { what: &'static str, count: usize, expected: usize, place: Box<Place> },
    /// A material variant was asked for that the file does not have.
    #[error("variant \"{name}\" was asked for, but the file has {}", listed(names))]
    NoVariant { name: String, names: Vec<String>, place: Box<Place> },
    /// A pattern that matches no part.
    #[error("no node with triangles, and no node above one, is called {pattern:?}")]
    NoMatch { pattern: String, place: Box<Place> },
    /// An environment that is no image, or none that is read.
    #[error("not an environment map: {reason}")]
    Environment { reason: String, place: Box<Place> },
    /// A pixel of an environment that is no light.
    #[error(
        "pixel ({x}, {y}) of the environment, counted from 0 at the top left, is {value:?}, not finite and at least 0"
    )]
    EnvironmentPixel { x: usize, y: usize, value: [f32; 3], place: Box<Place> },
    /// An output path without `.glb` or `.gltf`.
    #[error("{path} ends neither in .glb nor in .gltf", path = path.display())]
    OutputName { path: PathBuf, place: Box<Place> },
}

macro_rules! every_place {
    ($self:expr) => {
        match $self {
            SceneError::Io { place, .. }
            | SceneError::Container { place, .. }
            | SceneError::Json { place, .. }
            | SceneError::Version { place, .. }
            | SceneError::Outside { place, .. }
            | SceneError::NoData { place, .. }
            | SceneError::Truncated { place, .. }
            | SceneError::Reference { place, .. }
            | SceneError::NoScene { place, .. }
            | SceneError::Value { place, .. }
            | SceneError::VertexIndex { place, .. }
            | SceneError::NotFinite { place, .. }
            | SceneError::Count { place, .. }
            | SceneError::Cycle { place }
            | SceneError::TwoParents { place, .. }
            | SceneError::Unsupported { place, .. }
            | SceneError::Codec { place, .. }
            | SceneError::TooLarge { place, .. }
            | SceneError::Light { place, .. }
            | SceneError::NoVariant { place, .. }
            | SceneError::NoMatch { place, .. }
            | SceneError::Environment { place, .. }
            | SceneError::EnvironmentPixel { place, .. }
            | SceneError::OutputName { place, .. } => place,
        }
    };
}

impl SceneError {
    /// Where in the file.
    pub fn place(&self) -> &Place {
        every_place!(self)
    }

    /// Adds to the place, from the inside out: `f` sets what it knows.
    pub(crate) fn at(mut self, f: impl FnOnce(&mut Place)) -> Self {
        let place = every_place!(&mut self);
        f(place);
        self
    }

    /// What to do about it.
    pub fn remedy(&self) -> &'static str {
        match self {
            Self::Io { action: "read", .. } => "check that the file is there and may be read",
            Self::Io { .. } => "check that the folder exists, is writable and has room",
            Self::Container { .. } | Self::Json { .. } | Self::Truncated { .. } => {
                "export the file again, or fetch it again if it was cut off"
            }
            Self::Version { .. } => "export as glTF 2.0",
            Self::Outside { .. } => "put the file beside or below the scene, or pack everything into a .glb",
            Self::NoData { .. } => "give the buffer its data, or pack everything into a .glb",
            Self::NoScene { .. } => "name one of the file's scenes",
            Self::Reference { .. } | Self::Value { .. } | Self::Count { .. } => {
                "run gltf-validator on the file and export it again"
            }
            Self::VertexIndex { .. } => "remove the triangle in the source mesh and export again",
            Self::NotFinite { .. } => "remove or repair the vertex in the source mesh and export again",
            Self::Cycle { .. } | Self::TwoParents { .. } => "give every node one parent, then export again",
            Self::Unsupported { remedy, .. } => remedy,
            Self::Codec { .. } => "compress the file again, or pass the uncompressed one",
            Self::TooLarge { .. } => "split the scene into several files",
            Self::Light { .. } => "bake the scene that is written, not another one",
            Self::NoVariant { .. } => "name one of the file's variants, or none",
            Self::NoMatch { .. } => {
                "look for the name in the program that exported the file; * stands for any characters"
            }
            Self::Environment { .. } => "pass a latitude-longitude image, Radiance .hdr or OpenEXR",
            Self::EnvironmentPixel { .. } => "repair or clamp the pixel in an image editor",
            Self::OutputName { .. } => "name the output .glb or .gltf",
        }
    }
}

/// Names for a sentence.
fn listed(names: &[String]) -> String {
    if names.is_empty() { "none".to_owned() } else { names.join(", ") }
}

/// Shorthands that leave the place to be filled in by the callers.
pub(crate) fn reference(field: impl Into<String>, index: u64, count: usize) -> SceneError {
    SceneError::Reference { field: field.into(), index, count, place: Box::default() }
}

pub(crate) fn value(
    field: impl Into<String>,
    found: impl fmt::Display,
    expected: &'static str,
) -> SceneError {
    let mut found = found.to_string();
    if found.len() > 60 {
        let end = (0..=60).rev().find(|&i| found.is_char_boundary(i)).unwrap_or(0);
        found.truncate(end);
        found.push_str("...");
    }
    SceneError::Value { field: field.into(), found, expected, place: Box::default() }
}

pub(crate) fn truncated(owner: impl Into<String>, needed: u64, available: u64) -> SceneError {
    SceneError::Truncated { owner: owner.into(), needed, available, place: Box::default() }
}

pub(crate) fn codec(codec: &'static str, reason: impl Into<String>) -> SceneError {
    SceneError::Codec { codec, reason: reason.into(), place: Box::default() }
}

/// A kind of thing that was read otherwise than the file says, and how often.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Warning {
    /// What, in one line.
    pub message: String,
    /// How many objects it concerns.
    pub count: usize,
    /// The first of them.
    pub place: Place,
}

/// Collects warnings: equal messages are counted, the first place is kept.
#[derive(Debug, Default)]
pub(crate) struct Warnings(pub Vec<Warning>);

impl Warnings {
    pub fn add(&mut self, message: impl Into<String>, count: usize, place: Place) {
        let message = message.into();
        match self.0.iter_mut().find(|w| w.message == message) {
            Some(warning) => warning.count += count,
            None => self.0.push(Warning { message, count, place }),
        }
    }
}
