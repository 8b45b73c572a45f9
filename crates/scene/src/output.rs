//! Files that appear whole or not at all.

use std::fs::{self, File};
use std::io::Write as _;
use std::path::{Path, PathBuf};

use crate::error::SceneError;

fn failed(action: &'static str, path: &Path, source: std::io::Error) -> SceneError {
    SceneError::Io { action, path: path.to_owned(), source, place: Box::default() }
}

/// Files written under temporary names; those that are not published vanish with it.
#[derive(Debug, Default)]
pub(crate) struct Staged {
    files: Vec<(PathBuf, PathBuf, u64)>,
}

impl Staged {
    /// Writes a file beside its place, under a name of its own.
    pub fn write(&mut self, path: &Path, bytes: &[u8]) -> Result<(), SceneError> {
        let folder = path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
        fs::create_dir_all(folder).map_err(|e| failed("create the folder", folder, e))?;
        let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        let temporary = folder.join(format!(".{name}.{}.tmp", std::process::id()));
        self.files.push((temporary.clone(), path.to_owned(), bytes.len() as u64));
        let write = || {
            let mut file = File::create(&temporary)?;
            file.write_all(bytes)?;
            file.sync_all()
        };
        write().map_err(|e| failed("write", path, e))
    }

    /// Gives all files their names, in the order in which they were written.
    pub fn publish(mut self) -> Result<Vec<(PathBuf, u64)>, SceneError> {
        let mut done = Vec::with_capacity(self.files.len());
        while !self.files.is_empty() {
            let (temporary, path, bytes) = &self.files[0];
            fs::rename(temporary, path).map_err(|e| failed("write", path, e))?;
            done.push((path.clone(), *bytes));
            self.files.remove(0);
        }
        Ok(done)
    }
}

impl Drop for Staged {
    fn drop(&mut self) {
        for (temporary, ..) in &self.files {
            let _ = fs::remove_file(temporary);
        }
    }
}
