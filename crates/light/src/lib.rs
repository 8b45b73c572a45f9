//! What is baked: rays, visibility and signals.
//!
//! A [`Tracer`] answers rays, a [`Signal`] turns one batch of rays at a point into a value, and [`Estimates`]
//! keeps the running mean and variance of many points.
//!
//! | module | what |
//! |---|---|
//! | [`tracer`] | rays against a mesh, alone and in bundles of one point |
//! | [`origin`] | where the rays of a surface point start |
//! | [`directions`] | a batch of directions: scrambled net, cosine-weighted |
//! | [`signal`] | what a signal is |
//! | [`scale`] | what stored values mean: ranges, and a perceptual curve for light |
//! | [`occlusion`] | ambient occlusion |
//! | [`bent_normal`] | the direction in which a point is open |
//! | [`inside`] | whether a point lies inside other geometry |
//! | [`combined`] | several signals as one |
//! | [`shadow`] | the share of each light that is seen |
//! | [`lights`], [`environment`] | where light comes from, with units |
//! | [`path`] | irradiance: direct, by way of other surfaces, and as a function of the normal |
//! | [`harmonics`] | irradiance as a function of the normal |
//! | `receiver`, `sources`, `emitters` | a point that light arrives at, shadow rays to what shines, triangles that do |
//! | [`estimates`] | means and variances, refined where asked |
//! | [`denoise`] | a joint filter for noisy light on surfaces |
//! | `oidn` | Open Image Denoise, in builds with the feature of that name |
//! | [`analytic`] | occlusion in closed form |
//! | `tree`, `traverse`, `lanes` | the wide tree, its walk, and eight numbers at once |

pub mod analytic;
pub mod bent_normal;
pub mod combined;
pub mod denoise;
pub mod directions;
mod emitters;
pub mod environment;
pub mod estimates;
pub mod harmonics;
pub mod inside;
mod lanes;
pub mod lights;
pub mod occlusion;
#[cfg(feature = "oidn")]
pub mod oidn;
pub mod origin;
pub mod path;
mod receiver;
pub mod scale;
pub mod shadow;
pub mod signal;
mod sources;
pub mod tracer;
mod traverse;
mod tree;

pub use bent_normal::BentNormal;
pub use combined::Combined;
pub use environment::Environment;
pub use estimates::Estimates;
pub use lights::{Light, Lighting};
pub use occlusion::{AmbientOcclusion, Falloff, Ground, OcclusionOptions};
pub use origin::Origin;
pub use path::{Output, PathOptions, PathTraced};
pub use scale::{Curve, Scale};
pub use shadow::{Disk, Shadow, Shadows};
pub use signal::{Domain, Layer, Signal};
pub use tracer::{Hit, Opaque, SurfaceFlags, Surfaces, Tracer};

/// What keeps a mesh from being traced, or light from being used.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum LightError {
    /// More triangles than the tree can number.
    #[error("{triangles} triangles are more than the tree can number")]
    TooLarge {
        /// How many there are.
        triangles: usize,
    },
    /// A light with a number that makes no sense: NaN, below zero, or a direction of no length.
    #[error("light {light}: bad {what}")]
    Light {
        /// Which of the lights.
        light: usize,
        /// What of it.
        what: &'static str,
    },
    /// Radiance below zero or not finite, or an environment without any light.
    #[error("environment: {}", pixel.map_or("no light".to_owned(), |p| format!("bad pixel {p}")))]
    Environment {
        /// The first bad pixel; none where the whole gives no light.
        pixel: Option<usize>,
    },
    /// Pixels that are no image.
    #[error("environment of {width} x {height} with {pixels} pixels")]
    EnvironmentSize {
        /// Pixels in a row.
        width: usize,
        /// Rows.
        height: usize,
        /// How many there are.
        pixels: usize,
    },
}
