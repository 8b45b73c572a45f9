//! The viewer's files: the page and its modules, which are part of the program, and a model.

use std::collections::BTreeMap;
use std::io::Write;
use std::path::Path;
use std::sync::Arc;

use flate2::Compression;
use flate2::write::GzEncoder;
use serde_json::{Map, Value, json};

use crate::model::{Geometry, Model, Packed};

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
    pub files: BTreeMap<String, Arc<File>>,
    /// Names of the blocks that are shown, and of those that were shown before.
    blocks: [[String; 2]; 2],
    /// The geometry that is shown.
    geometry: Option<Arc<Laid>>,
    /// Whether blocks are compressed.
    compresses: bool,
}

/// A geometry as it lies in a site: its block is a file there.
#[derive(Debug)]
pub(crate) struct Laid {
    geometry: Arc<Geometry>,
    about: Map<String, Value>,
    sections: Map<String, Value>,
    file: Arc<File>,
    version: u32,
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

/// Names of the blocks of a model.
const BLOCKS: [&str; 2] = ["geometry", "light"];

const SCRIPT: &str = "text/javascript; charset=utf-8";

/// The functions that any viewer of such files needs, as they lie in the repository.
const SHADERS: [(&str, &str); 2] = [
    ("VERTEX", include_str!("../../../shaders/lightkiln.vert.glsl")),
    ("FRAGMENT", include_str!("../../../shaders/lightkiln.frag.glsl")),
];

impl Site {
    /// The viewer of a model, to be served on this machine.
    pub fn new(model: &Model) -> Self {
        Self::of(model, false)
    }

    /// The viewer of a model, to be exported: its blocks are compressed.
    pub fn for_export(model: &Model) -> Self {
        Self::of(model, true)
    }

    fn of(model: &Model, compresses: bool) -> Self {
        let mut site = Self::page(false, compresses);
        site.put_model(Laid::new(&model.geometry, compresses, 0), model.pack(), 0);
        site
    }

    /// The viewer of a bake that has no model yet.
    pub fn of_bake() -> Self {
        Self::page(true, false)
    }

    /// The page and its modules.
    ///
    /// - `is_live`: whether there are events that it can follow
    fn page(is_live: bool, compresses: bool) -> Self {
        let mut site = Self { compresses, ..Self::default() };
        site.add(
            "mode.js",
            SCRIPT,
            format!("export const LIVE = {is_live}\nexport const COMPRESSED = {compresses}\n").into(),
        );
        for (name, kind, text) in PAGE {
            site.add(name, kind, text.into());
        }
        let text = |source: &str| serde_json::to_string(source).expect("text is JSON");
        let shaders = SHADERS.map(|(name, source)| format!("export const {name} = {};\n", text(source)));
        site.add("lightkiln.js", SCRIPT, shaders.concat().into());
        site
    }

    /// The geometry that is shown, if that is this one.
    pub(crate) fn shown(&self, geometry: &Arc<Geometry>) -> Option<Arc<Laid>> {
        self.geometry.clone().filter(|laid| Arc::ptr_eq(&laid.geometry, geometry))
    }

    /// Puts a model in the place of the one before, whose blocks stay one version longer for those who know their names
    /// already.
    ///
    /// - `light`: of the model, packed
    /// - `version`: its number, one more than that of the model before; 0 for a model that stays
    pub(crate) fn put_model(&mut self, geometry: Arc<Laid>, light: Packed, version: u32) {
        let versions = [geometry.version, version];
        let names = [0, 1].map(|block| match versions[block] {
            0 => format!("{}.bin", BLOCKS[block]),
            version => format!("{}-{version}.bin", BLOCKS[block]),
        });
        let sections = geometry.sections.iter().map(|(name, at)| (name, at, 0));
        let sections = sections.chain(light.sections.iter().map(|(name, at)| (name, at, 1)));
        let in_block = |(name, at, block): (&String, &Value, usize)| {
            (name.clone(), json!({ "block": block, "offset": at["offset"], "bytes": at["bytes"] }))
        };
        let mut about = geometry.about.clone();
        about.extend(light.about);
        about.insert("sections".to_owned(), sections.map(in_block).collect::<Map<_, _>>().into());
        about.insert("blocks".to_owned(), json!(names));
        self.add("model.json", "application/json", Value::Object(about).to_string().into());
        self.files.insert(names[0].clone(), Arc::clone(&geometry.file));
        self.files.insert(names[1].clone(), block_file(light.bytes, self.compresses).into());
        let [shown, before] = &mut self.blocks;
        let gone = std::mem::replace(before, std::mem::replace(shown, names));
        for name in gone.iter().filter(|&name| !shown.contains(name) && !before.contains(name)) {
            self.files.remove(name);
        }
        for (number, image) in geometry.geometry.images.iter().enumerate() {
            let name = image.name(number);
            if self.files.get(&name).is_none_or(|known| known.bytes != image.bytes) {
                self.add(&name, image.kind, image.bytes.clone());
            }
        }
        self.geometry = Some(geometry);
    }

    fn add(&mut self, name: &str, kind: &'static str, bytes: Vec<u8>) {
        self.files.insert(name.to_owned(), File { kind, bytes }.into());
    }

    /// The file that a path of a request names; nothing but whole names of files is found.
    pub fn at(&self, path: &str) -> Option<&Arc<File>> {
        let name = path.strip_prefix('/')?;
        self.files.get(if name.is_empty() { "index.html" } else { name })
    }

    /// Whether a path names the light that is shown.
    pub(crate) fn shows(&self, path: &str) -> bool {
        path.strip_prefix('/') == Some(&self.blocks[0][1])
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

impl Laid {
    /// Packs a geometry.
    ///
    /// - `compresses`: whether its site does
    /// - `version`: of the first model that has it
    pub(crate) fn new(geometry: &Arc<Geometry>, compresses: bool, version: u32) -> Arc<Self> {
        let Packed { about, sections, bytes } = geometry.pack();
        let (geometry, file) = (Arc::clone(geometry), block_file(bytes, compresses).into());
        Arc::new(Self { geometry, about, sections, file, version })
    }
}

/// The version of the block that a path names; none if it names none, or that of a model that stays.
pub(crate) fn version_of(path: &str) -> Option<u32> {
    let name = path.strip_prefix('/')?.strip_suffix(".bin")?;
    let version = BLOCKS.iter().find_map(|block| name.strip_prefix(block)?.strip_prefix('-'))?;
    version.parse().ok().filter(|&version| version > 0)
}

/// A block as a file. Over the net gzip is worth its time, on one machine it is not; the page undoes it itself, so that no
/// server needs to know.
fn block_file(bytes: Vec<u8>, compresses: bool) -> File {
    let compressed = |bytes: &[u8]| {
        let mut out = GzEncoder::new(Vec::new(), Compression::default());
        out.write_all(bytes).and_then(|()| out.finish()).expect("memory takes everything")
    };
    File { kind: "application/octet-stream", bytes: if compresses { compressed(&bytes) } else { bytes } }
}

#[cfg(test)]
mod tests {
    use std::io::Read;

    use super::*;
    use crate::model::testing::model;

    #[test]
    fn site_finds_files_by_their_whole_names_only() {
        let site = Site::new(&model());
        assert_eq!(site.at("/"), site.at("/index.html"));
        assert!(site.at("/geometry.bin").is_some() && site.at("/light.bin").is_some());
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
    fn site_blocks_are_compressed_for_export_alone() {
        let model = model();
        let (served, exported) = (Site::new(&model), Site::for_export(&model));
        for (name, bytes) in
            [("geometry.bin", model.geometry.pack().bytes), ("light.bin", model.pack().bytes)]
        {
            let mut unpacked = Vec::new();
            let mut packed = flate2::read::GzDecoder::new(exported.files[name].bytes.as_slice());
            packed.read_to_end(&mut unpacked).expect("gzip");
            assert!(unpacked == bytes && served.files[name].bytes == bytes, "{name}");
        }
        let others = |site: &Site| -> Vec<String> {
            site.files.keys().filter(|name| site.files[*name] != served.files[*name]).cloned().collect()
        };
        assert_eq!(others(&exported), ["geometry.bin", "light.bin", "mode.js"]);
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
