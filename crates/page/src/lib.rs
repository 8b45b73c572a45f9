//! Pages of a bake: its report as one HTML file, and a viewer that is served on 127.0.0.1 or written as a static
//! site. Nothing here reads a scene: who calls brings figures, pictures and vertices.
//!
//! | module | what |
//! |---|---|
//! | [`report`] | the report as one self-contained file, without scripts |
//! | [`advice`] | what to change to get smaller, from the figures |
//! | [`svg`] | bars and histograms |
//! | [`html`] | text that is safe within markup |
//! | [`model`] | a baked scene as the viewer takes it: two blocks of numbers and a description |
//! | [`charts`] | charts, found again from codes |
//! | [`site`] | the viewer's files |
//! | [`live`] | a site that changes while a bake goes on |
//! | [`server`] | serves a site to this machine and to nobody else |
//!
//! The viewer itself lies in `viewer/`: plain ES modules and WebGL 2 around the functions of `shaders/`, with no
//! framework, so that the page shows what any user of those functions would see.

pub mod advice;
pub mod charts;
pub mod html;
pub mod live;
pub mod model;
pub mod report;
pub mod server;
pub mod site;
pub mod svg;

pub use live::{Live, Phase, Status};
pub use model::{ErrorPoint, FullTexture, Geometry, Group, Image, LayerModel, Model, Texture};
pub use report::{Figure, report_page};
pub use server::Server;
pub use site::Site;
