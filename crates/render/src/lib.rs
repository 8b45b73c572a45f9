//! Pictures of a bake, by rays on the CPU: small and simple, for reports, tests and eyes.
//!
//! One ray through each of four places of a pixel finds what a viewer would see (back faces of single-sided
//! triangles and thin glass are looked through); a function turns each hit into a color. The functions for
//! baked light, reference, classes and error live with their callers: they need nothing from here but the hit.
//!
//! | module | what |
//! |---|---|
//! | [`camera`] | where a picture is taken from |
//! | [`picture`] | pixels, sheets of pictures, PNG |

pub mod camera;
pub mod picture;

pub use camera::{Camera, View};
pub use picture::{Picture, RenderError, render};
