//! The viewer's files: the page and its modules, which are part of the program, and a model.

use std::collections::BTreeMap;
use std::path::Path;

use serde_json::Value;

use crate::model::{Image, Model};

/// A file of a site.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct File {
    /// Its media type.
    pub kind: &'static str,
    /// What is in it.
    pub bytes: Vec<u8>,
}

/// Files by name. There are no folders.
#[derive(Clone, Debug, Default)]
pub struct Site {
    /// By name, without a slash.
    pub files: BTreeMap<String, File>,
}

/// The page and its modules.
const PAGE: [(&str, &str, &str); 9] = [
    ("index.html", "text/html; charset=utf-8", include_str!("../viewer/index.html")),
    ("viewer.css", "text/css; charset=utf-8", include_str!("../viewer/viewer.css")),
    ("main.js", SCRIPT, include_str!("../viewer/main.js")),
    ("model.js", SCRIPT, include_str!("../viewer/model.js")),
    ("camera.js", SCRIPT, include_str!("../viewer/camera.js")),
    ("renderer.js", SCRIPT, include_str!("../viewer/renderer.js")),
    ("shaders.js", SCRIPT, include_str!("../viewer/shaders.js")),
    ("legend.js", SCRIPT, include_str!("../viewer/legend.js")),
    ("live.js", SCRIPT, include_str!("../viewer/live.js")),
];

const SCRIPT: &str = "text/javascript; charset=utf-8";

/// The functions that any viewer of such files needs, as they lie in the repository.
const SHADERS: [(&str, &str); 2] = [
    ("VERTEX", include_str!("../../../shaders/lightkiln.vert.glsl")),
    ("FRAGMENT", include_str!("../../../shaders/lightkiln.frag.glsl")),
];

impl Site {
    /// The viewer of a model.
    pub fn new(model: &Model) -> Self {
        let mut site = Self::page(false);
        site.put_model(&model.images, model.pack(), 0);
        site
    }

    /// The viewer of a bake that has no model yet.
    pub fn of_bake() -> Self {
        Self::page(true)
    }

    /// The page and its modules. `live`: whether there are events that it can follow.
    fn page(live: bool) -> Self {
        let mut site = Self::default();
        site.add("mode.js", SCRIPT, format!("export const LIVE = {live}\n").into());
        for (name, kind, text) in PAGE {
            site.add(name, kind, text.into());
        }
        let text = |source: &str| serde_json::to_string(source).expect("text is JSON");
        let shaders = SHADERS.map(|(name, source)| format!("export const {name} = {};\n", text(source)));
        site.add("lightkiln.js", SCRIPT, shaders.concat().into());
        site
    }

    /// Puts a model, packed, in the place of the one before, whose block stays one version longer for those who know its
    /// name already.
    ///
    /// - `version`: its number, one more than that of the model before; 0 for a model that stays
    pub fn put_model(&mut self, images: &[Image], (mut description, block): (Value, Vec<u8>), version: u32) {
        let name = |version: u32| match version {
            0 => "model.bin".to_owned(),
            _ => format!("model-{version}.bin"),
        };
        description["block"] = name(version).into();
        self.add("model.json", "application/json", description.to_string().into());
        self.add(&name(version), "application/octet-stream", block);
        if version > 2 {
            self.files.remove(&name(version - 2));
        }
        for (number, image) in images.iter().enumerate() {
            let name = image.name(number);
            if self.files.get(&name).is_none_or(|known| known.bytes != image.bytes) {
                self.add(&name, image.kind, image.bytes.clone());
            }
        }
    }

    fn add(&mut self, name: &str, kind: &'static str, bytes: Vec<u8>) {
        self.files.insert(name.to_owned(), File { kind, bytes });
    }

    /// The file that a path of a request names; nothing but whole names of files is found.
    pub fn at(&self, path: &str) -> Option<&File> {
        let name = path.strip_prefix('/')?;
        self.files.get(if name.is_empty() { "index.html" } else { name })
    }

    /// Writes the site into a folder, which is made if it is missing. Other files there stay.
    ///
    /// # Errors
    /// What the system says.
    pub fn export(&self, folder: &Path) -> std::io::Result<()> {
        std::fs::create_dir_all(folder)?;
        self.files.iter().try_for_each(|(name, file)| std::fs::write(folder.join(name), &file.bytes))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::testing::model;

    #[test]
    fn site_finds_files_by_their_whole_names_only() {
        let site = Site::new(&model());
        assert_eq!(site.at("/"), site.at("/index.html"));
        assert!(site.at("/model.bin").is_some());
        let others = [
            "",
            "index.html",
            "//index.html",
            "/../Cargo.toml",
            "/..%2fCargo.toml",
            "/./index.html",
            "/etc/passwd",
        ];
        for path in others {
            assert!(site.at(path).is_none(), "{path}");
        }
    }

    #[test]
    fn site_modules_import_what_is_there_and_nothing_from_elsewhere() {
        let site = Site::new(&model());
        for (name, file) in &site.files {
            let Ok(text) = std::str::from_utf8(&file.bytes) else { continue };
            if !file.kind.starts_with("text/") {
                continue;
            }
            assert!(!text.contains("http://") && !text.contains("https://"), "{name} reaches out");
            for import in text.lines().filter(|l| l.starts_with("import ")) {
                let from = import.split('\'').nth(1).expect("a module").trim_start_matches("./");
                assert!(site.files.contains_key(from), "{name} imports {from}");
            }
        }
    }

    #[test]
    fn site_shaders_are_those_of_the_repository() {
        let site = Site::new(&model());
        let text = String::from_utf8(site.files["lightkiln.js"].bytes.clone()).expect("text");
        let vertex =
            text.lines().next().and_then(|l| l.strip_prefix("export const VERTEX = ")).expect("first");
        let source: String = serde_json::from_str(vertex.trim_end_matches(';')).expect("a string");
        assert_eq!(source, SHADERS[0].1);
        assert!(text.contains("lightkilnLightTexel"));
    }

    #[test]
    fn site_export_writes_every_file() {
        let folder = std::env::temp_dir().join(format!("lightkiln-site-{}", std::process::id()));
        let site = Site::new(&model());
        site.export(&folder).expect("written");
        for (name, file) in &site.files {
            assert_eq!(&std::fs::read(folder.join(name)).expect("there"), &file.bytes);
        }
        std::fs::remove_dir_all(&folder).expect("removed");
    }
}
