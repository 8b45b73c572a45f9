//! Outputs that appear whole or not at all.

use std::io::Write;
use std::path::{Path, PathBuf};

use crate::messages::Failure;

/// Writes a file under another name in the same folder and renames it when it is whole.
///
/// # Errors
/// A message that names the file; nothing is left behind.
pub fn write_whole(path: &Path, bytes: &[u8]) -> Result<(), Failure> {
    let mut name = path.file_name().unwrap_or_default().to_owned();
    name.push(format!(".{}.part", std::process::id()));
    let part = path.with_file_name(name);
    let written = std::fs::File::create(&part)
        .and_then(|mut file| file.write_all(bytes).and_then(|()| file.sync_all()))
        .and_then(|()| std::fs::rename(&part, path));
    written.map_err(|error| {
        // The part may not exist; either way there is nothing more to do about it.
        let _ = std::fs::remove_file(&part);
        Failure::writing(path, &error)
    })
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
