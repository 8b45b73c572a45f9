//! The buffer and the files of a written scene.

use std::path::{Path, PathBuf};

use serde_json::{Value, json};

use crate::container;
use crate::document::{BufferSource, MESHOPT, array, extension, list, object};
use crate::draco::DRACO;
use crate::error::{Place, SceneError};
use crate::garbage;
use crate::uri;
use crate::write::{Patch, Purpose, Written, WrittenFile};

impl Patch<'_> {
    /// Puts the buffer together and writes all files.
    pub(crate) fn finish(mut self, path: &Path) -> Result<Written, SceneError> {
        if self.written.plain_draco > 0 {
            let place = Place::default();
            self.warnings.add(
                "Draco primitives are written without compression",
                self.written.plain_draco,
                place,
            );
            if !garbage::primitives_use(&self.root, DRACO) {
                self.forget_extension(DRACO);
            }
        }
        // The new views, without their offsets yet.
        let views: Vec<Value> =
            self.views.iter().map(|(purpose, bytes)| view_json(*purpose, self.main, bytes.len())).collect();
        if !views.is_empty() {
            array(&mut self.root, "bufferViews").extend(views);
        }
        let before = self.scene.baked.as_ref().unwrap_or(&self.document.root);
        let new_views = self.views.len();
        let length = self.document.buffers.get(self.main).map_or(0, |b| b.bytes.len() as u64);
        let dropped = garbage::collect(before, &mut self.root, self.main, length);
        self.written.wasted_bytes = dropped.wasted;
        self.written.dropped_bytes = dropped.cuts.iter().map(|(a, b)| b - a).sum();
        let empty = Vec::new();
        let old = self.document.buffers.get(self.main).map_or(&empty, |b| &b.bytes);
        let mut bytes = garbage::cut(old, &dropped.cuts);
        let first = list(&self.root, "bufferViews").len() - new_views;
        for (i, (_, data)) in self.views.iter().enumerate() {
            bytes.resize(bytes.len().next_multiple_of(4), 0);
            array(&mut self.root, "bufferViews")[first + i]["byteOffset"] = bytes.len().into();
            bytes.extend_from_slice(data);
        }
        self.drop_meshopt();
        let has_buffer = !bytes.is_empty() || !self.document.buffers.is_empty();
        let bin_name = self.bin_name(path);
        if has_buffer {
            let buffers = array(&mut self.root, "buffers");
            if buffers.len() <= self.main {
                buffers.push(json!({}));
            }
            let buffer = object(&mut buffers[self.main]);
            if self.glb {
                buffer.shift_remove("uri");
            } else {
                buffer.insert("uri".to_owned(), uri::encode(&bin_name).into());
            }
            buffer.insert("byteLength".to_owned(), bytes.len().into());
        }
        self.copy_resources(path)?;
        if self.glb {
            let json = to_json(&self.root, false)?;
            let file = container::join(&json, has_buffer.then_some(&bytes[..]), &self.document.chunks)?;
            self.staged.write(path, &file)?;
        } else {
            if has_buffer {
                self.staged.write(&path.with_file_name(&bin_name), &bytes)?;
            }
            self.staged.write(path, &to_json(&self.root, true)?)?;
        }
        let files = self.staged.publish()?;
        let mut written = self.written;
        written.files = files.into_iter().map(|(path, bytes)| WrittenFile { path, bytes }).collect();
        written.warnings = self.warnings.0;
        Ok(written)
    }

    /// Forgets meshopt when no view is compressed any more.
    fn drop_meshopt(&mut self) {
        for name in MESHOPT {
            let listed = list(&self.root, "extensionsUsed").iter().any(|e| e.as_str() == Some(name));
            let used = list(&self.root, "bufferViews").iter().any(|v| extension(v, name).is_some());
            if !listed || used {
                continue;
            }
            let named = |root: &Value, b: usize| {
                list(root, "bufferViews")
                    .iter()
                    .any(|v| v.get("buffer").and_then(Value::as_u64) == Some(b as u64))
            };
            while let Some(last) = list(&self.root, "buffers").len().checked_sub(1) {
                let fallback = extension(&list(&self.root, "buffers")[last], name).is_some();
                let placeholder =
                    self.document.buffers.get(last).is_some_and(|b| b.source == BufferSource::Fallback);
                if last == self.main || !fallback || !placeholder || named(&self.root, last) {
                    break;
                }
                array(&mut self.root, "buffers").pop();
            }
            if !list(&self.root, "buffers").iter().any(|b| extension(b, name).is_some()) {
                self.forget_extension(name);
            }
        }
    }

    /// The name of the binary file, which no other resource may have; beside the input not even the buffer that
    /// the new one stands for, because the input still needs it.
    fn bin_name(&self, path: &Path) -> String {
        let plain = format!("{}.bin", stem(path));
        let beside = self.document.path.as_deref().is_some_and(|input| same_folder(input, path));
        let clash = self
            .resources()
            .any(|(owner, relative)| (beside || owner != Some(self.main)) && relative == Path::new(&plain));
        if clash { format!("{}.lightkiln.bin", stem(path)) } else { plain }
    }

    /// Files that the scene refers to: the buffer's number, or `None` for an image, and the path.
    fn resources(&self) -> impl Iterator<Item = (Option<usize>, PathBuf)> + '_ {
        let relative = |v: &Value| {
            let text = v.get("uri").and_then(Value::as_str).filter(|u| !uri::is_data(u))?;
            uri::relative_path(text, "a resource").ok()
        };
        let buffers = self.document.list("buffers").iter().enumerate();
        let buffers = buffers.filter_map(move |(i, b)| Some((Some(i), relative(b)?)));
        let images = &list(&self.root, "images")[..self.kept_images];
        buffers.chain(images.iter().filter_map(move |i| Some((None, relative(i)?))))
    }

    /// Copies what the scene refers to beside the output, where it is not there yet.
    fn copy_resources(&mut self, path: &Path) -> Result<(), SceneError> {
        let Some(input) = self.document.path.as_deref().filter(|input| !same_folder(input, path)) else {
            return Ok(());
        };
        let (from, to) = (folder(input), folder(path));
        let wanted: std::collections::BTreeSet<PathBuf> =
            self.resources().filter(|(owner, _)| *owner != Some(self.main)).map(|(_, path)| path).collect();
        for relative in wanted {
            let (source, target) = (from.join(&relative), to.join(&relative));
            let failed = |action, path: &Path, source| SceneError::Io {
                action,
                path: path.to_owned(),
                source,
                place: Box::default(),
            };
            let bytes = match std::fs::read(&source) {
                Ok(bytes) => bytes,
                Err(e) if e.kind() == std::io::ErrorKind::NotFound => {
                    self.warnings.add("images that the scene names do not exist", 1, Place::default());
                    continue;
                }
                Err(e) => return Err(failed("read", &source, e)),
            };
            match std::fs::read(&target) {
                Ok(there) if there == bytes => {}
                Ok(_) => {
                    let exists =
                        std::io::Error::new(std::io::ErrorKind::AlreadyExists, "another file has that name");
                    return Err(failed("copy a resource to", &target, exists));
                }
                Err(_) => self.staged.write(&target, &bytes)?,
            }
        }
        Ok(())
    }
}

fn folder(path: &Path) -> &Path {
    path.parent().filter(|f| !f.as_os_str().is_empty()).unwrap_or(Path::new("."))
}

fn same_folder(a: &Path, b: &Path) -> bool {
    let real = |p: &Path| folder(p).canonicalize().unwrap_or_else(|_| folder(p).to_owned());
    real(a) == real(b)
}

/// The name of a file without its ending.
pub(crate) fn stem(path: &Path) -> String {
    path.file_stem().unwrap_or_default().to_string_lossy().into_owned()
}

fn view_json(purpose: Purpose, buffer: usize, length: usize) -> Value {
    let mut json = json!({"buffer": buffer, "byteOffset": 0, "byteLength": length});
    let stride = match purpose {
        Purpose::Fallback => Some(4),
        Purpose::Light { stride, .. } | Purpose::Vertices { stride } => Some(stride),
        Purpose::Indices { .. } | Purpose::Image { .. } => None,
    };
    if let Some(stride) = stride {
        json["byteStride"] = stride.into();
        json["target"] = 34962.into();
    } else if matches!(purpose, Purpose::Indices { .. }) {
        json["target"] = 34963.into();
    }
    json
}

fn to_json(root: &Value, pretty: bool) -> Result<Vec<u8>, SceneError> {
    let json = if pretty { serde_json::to_vec_pretty(root) } else { serde_json::to_vec(root) };
    json.map_err(|source| SceneError::Json { source, place: Box::default() })
}
