//! Outputs that appear whole or not at all.

use std::fs::OpenOptions;
use std::io::Write;
use std::path::{Path, PathBuf};

use crate::messages::{Exit, Failure};

/// Writes a file under another name in the same folder and renames it when it is whole. What is no regular
/// file, such as `/dev/stdout` or a pipe, is written to as it is.
///
/// # Errors
/// A message that names the file; nothing is left behind.
pub fn write_whole(path: &Path, bytes: &[u8]) -> Result<(), Failure> {
    let written = if is_device(path) {
        OpenOptions::new().write(true).open(path).and_then(|mut file| file.write_all(bytes))
    } else {
        lightkiln_bake::output::write_whole(path, bytes)
    };
    written.map_err(|error| Failure::writing(path, &error))
}

/// Makes sure before any work is done that outputs can be written: each has a folder, none is an input, and no
/// two are the same file.
///
/// # Errors
/// The first output that is not so.
pub fn check_outputs(inputs: &[&Path], outputs: &[&Path]) -> Result<(), Failure> {
    let mut taken: Vec<PathBuf> = inputs.iter().filter_map(|path| path.canonicalize().ok()).collect();
    for &path in outputs {
        let folder = path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
        let real = folder.canonicalize().map_err(|error| {
            Failure::new(Exit::Files, format!("cannot write to the folder {}: {error}", folder.display()))
                .place(path.display().to_string())
                .remedy("make the folder first")
        })?;
        let Some(name) = path.file_name().filter(|_| !path.is_dir()) else {
            return Err(Failure::new(Exit::Usage, "the output is a folder")
                .place(path.display().to_string())
                .remedy("name a file in it"));
        };
        let real = path.canonicalize().unwrap_or_else(|_| real.join(name));
        if taken.contains(&real) && !is_device(&real) {
            return Err(Failure::new(Exit::Usage, "the output is the same file as another one")
                .place(path.display().to_string())
                .remedy("give it another name, such as NAME.baked.glb"));
        }
        taken.push(real);
    }
    Ok(())
}

/// Whether a path leads to something that is neither file nor folder: a device, a pipe, a socket.
fn is_device(path: &Path) -> bool {
    path.metadata().is_ok_and(|there| !there.is_file() && !there.is_dir())
}

/// A dependency file in the syntax of make: all outputs left of the colon, all inputs right of it.
pub fn depfile(outputs: &[PathBuf], inputs: &[PathBuf]) -> String {
    let list = |paths: &[PathBuf]| paths.iter().map(|p| escape(p)).collect::<Vec<_>>().join(" ");
    let mut text = format!("{}: {}\n", list(outputs), list(inputs));
    // An empty rule per input keeps make going when one of them is deleted.
    for input in inputs {
        text.push_str(&format!("{}:\n", escape(input)));
    }
    text
}

fn escape(path: &Path) -> String {
    path.to_string_lossy().replace('$', "$$").replace('#', "\\#").replace(' ', "\\ ").replace(':', "\\:")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn depfile_with_spaces_is_escaped() {
        let text = depfile(&["a b.glb".into(), "r.json".into()], &["in $1.gltf".into(), "t.png".into()]);
        assert_eq!(text, "a\\ b.glb r.json: in\\ $$1.gltf t.png\nin\\ $$1.gltf:\nt.png:\n");
    }

    #[test]
    fn write_whole_into_missing_folder_leaves_nothing() {
        let path = std::env::temp_dir().join("lightkiln-no-such-folder").join("x.json");
        assert!(write_whole(&path, b"x").is_err());
        assert!(!path.exists());
    }
}
