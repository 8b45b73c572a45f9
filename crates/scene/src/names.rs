//! What a scene and its errors are called: names of parts, files that were read, kinds of errors.

use std::fmt;
use std::path::PathBuf;

use crate::document::{list, name};
use crate::error::{SceneError, Warning};
use crate::scene::Scene;
use crate::uri;

/// Kinds of errors, as far as a program treats them differently.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ErrorKind {
    /// A file cannot be read or written.
    Files,
    /// The request does not fit the file: a scene that it does not have, an output name that is none.
    Request,
    /// The input needs something that is not supported.
    Unsupported,
    /// The input is invalid.
    Invalid,
}

impl SceneError {
    /// What kind of error this is.
    pub fn kind(&self) -> ErrorKind {
        match self {
            Self::Io { .. } => ErrorKind::Files,
            Self::OutputName { .. }
            | Self::NoScene { .. }
            | Self::NoVariant { .. }
            | Self::NoMatch { .. } => ErrorKind::Request,
            Self::Unsupported { .. } => ErrorKind::Unsupported,
            _ => ErrorKind::Invalid,
        }
    }
}

impl fmt::Display for Warning {
    /// Writes `3 x skin posed at rest (first: nodes[4] "column")`.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.count > 1 {
            write!(f, "{} x ", self.count)?;
        }
        f.write_str(&self.message)?;
        match (self.place.is_empty(), self.count) {
            (true, _) => Ok(()),
            (false, 1) => write!(f, " ({})", self.place),
            (false, _) => write!(f, " (first: {})", self.place),
        }
    }
}

impl Scene {
    /// What a part is called for people: the name of its node, else that of its mesh, else the node's number.
    ///
    /// # Panics
    /// For a part that the scene does not have.
    pub fn part_name(&self, part: usize) -> String {
        let part = &self.parts[part];
        let of = |key: &str, index: usize| self.document.list(key).get(index).and_then(name);
        let name = of("nodes", part.node).or_else(|| of("meshes", part.mesh));
        let name = name.unwrap_or_else(|| format!("node {}", part.node));
        match part.instance {
            Some(instance) => format!("{name} #{instance}"),
            None => name,
        }
    }

    /// Every file that was read: the scene itself, its buffers and its images. Empty for a scene from memory.
    pub fn inputs(&self) -> Vec<PathBuf> {
        let Some(path) = &self.document.path else { return Vec::new() };
        let mut inputs = vec![path.clone()];
        for key in ["buffers", "images"] {
            for object in list(&self.document.root, key) {
                let Some(uri) = object.get("uri").and_then(serde_json::Value::as_str) else { continue };
                if let (false, Ok(relative)) = (uri::is_data(uri), uri::relative_path(uri, key)) {
                    inputs.push(path.with_file_name(relative));
                }
            }
        }
        inputs
    }
}
