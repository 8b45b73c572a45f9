//! glTF in and out: the only crate that knows the file format.
//!
//! Reading keeps the file's JSON as a document and decodes only what light needs: triangles in world space,
//! normals, coverage. Writing patches that document: an attribute and an atlas for each layer of light, one
//! extension and a fallback are added, and all else leaves as it came (DESIGN.md, "Keep the user's asset"). docs/FORMAT.md describes
//! what is added.
//!
//! | module | what |
//! |---|---|
//! | [`scene`](Scene) | the public picture: parts, materials, warnings |
//! | `container`, `uri`, `document` | GLB chunks, files and data URIs, views into the JSON |
//! | `accessor`, `meshopt`, `draco` | elements of buffers, compressed or not |
//! | `nodes`, `instances`, `pose` | the node graph, GPU instances, skins and morph targets at rest |
//! | `animation` | what moves |
//! | `geometry`, `lookup` | pools of vertices as triangles; texture coordinates and vertex colors |
//! | `material`, `images`, `variants` | materials with their images |
//! | `surface` | what a point reflects, emits and lets through |
//! | `appearance` | base colors and their images, for viewers |
//! | `lights`, `environment`, `cameras` | punctual lights, environment maps, cameras |
//! | `roles` | who casts and receives; parts chosen by name |
//! | `texture` | textures as signals |
//! | [`srgb`] | the curve of colors in images |
//! | `footprint` | bytes of vertices, sizes of images |
//! | `names` | names of parts, files and kinds of errors |
//! | `lightmap`, `undo` | reading light back, undoing a former bake |
//! | `baked` | light as the writer takes it |
//! | `profile` | how light stands in a file |
//! | `write`, `pools`, `split` | patching the document; vertices with two codes |
//! | `materials` | light that materials show |
//! | `replace` | what the light replaces |
//! | `assemble`, `garbage`, `output` | the buffer, what is dropped from it, and files that appear whole |

mod accessor;
mod animation;
mod appearance;
mod assemble;
mod baked;
mod cameras;
mod container;
mod document;
mod draco;
mod environment;
mod error;
mod footprint;
mod garbage;
mod geometry;
mod images;
mod instances;
mod lightmap;
mod lights;
mod lookup;
mod material;
mod materials;
mod meshopt;
mod names;
mod nodes;
mod output;
mod pools;
mod pose;
mod profile;
mod replace;
mod roles;
mod scene;
mod split;
pub mod srgb;
mod surface;
mod texture;
mod undo;
mod uri;
mod variants;
mod write;

pub use appearance::{Appearance, BaseTexture};
pub use baked::{BakedLight, ExtensionInfo, Fallback, LayerFiles, Pairs, PartLight};
pub use cameras::{Projection, SceneCamera};
pub use environment::{Environment, decode_environment, read_environment};
pub use error::{Place, SceneError, Warning};
pub use footprint::ImageSize;
pub use lightmap::{
    ATTRIBUTE, EXTENSION, LayerRead, LightImage, Lightmap, ORIGINAL_COLOR, VERSION, attribute_name,
};
pub use lights::{LightKind, PunctualLight};
pub use material::{AlphaMode, Material};
pub use materials::MaterialTexture;
pub use names::ErrorKind;
pub use profile::Profile;
pub use roles::Roles;
pub use scene::{Glass, Part, ReadOptions, Scene, TriangleFlags};
pub use surface::{EmissiveTriangle, Finish, MAX_ALBEDO};
pub use texture::{Slot, Textures, Wrap};
pub use write::{LayerWritten, PartWritten, Written, WrittenFile, write};
