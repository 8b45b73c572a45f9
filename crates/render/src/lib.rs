//! Pictures of a bake, by rays on the CPU: small and simple, for reports, tests and eyes.
//!
//! Rays through the places of a pixel find what a viewer would see; a function turns each line of sight into a color.
//! The functions for baked light, reference, classes and error live with their callers: they need nothing from here but
//! the surfaces along the line.
//!
//! | module | what |
//! |---|---|
//! | [`camera`] | where a picture is taken from |
//! | [`sight`] | what lies along a ray, front to back |
//! | [`picture`] | pixels, PNG |
//! | [`shade`], [`tone`] | materials in a light, and what a screen shows of them |
//! | [`sheet`], [`letters`] | pictures in rows and columns, with captions and legends |

pub mod camera;
mod error;
pub mod frame;
pub mod letters;
pub mod picture;
pub mod shade;
pub mod sheet;
pub mod sight;
pub mod tone;

pub use camera::{Camera, Lens, Ray, View};
pub use error::RenderError;
pub use frame::frame;
pub use picture::{Picture, Smoothing, Subject, render};
pub use sheet::{Legend, Panel, sheet};
pub use sight::Sight;
pub use tone::Tone;
