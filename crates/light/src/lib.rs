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
//! | [`shadow`] | the shadow of a disk that shines |
//! | [`estimates`] | means and variances, refined where asked |
//! | [`analytic`] | occlusion in closed form |
//! | `tree`, `traverse`, `lanes` | the wide tree, its walk, and eight numbers at once |

pub mod analytic;
pub mod bent_normal;
pub mod combined;
pub mod directions;
pub mod estimates;
pub mod inside;
mod lanes;
pub mod occlusion;
pub mod origin;
pub mod scale;
pub mod shadow;
pub mod signal;
pub mod tracer;
mod traverse;
mod tree;

pub use bent_normal::BentNormal;
pub use combined::Combined;
pub use estimates::Estimates;
pub use occlusion::{AmbientOcclusion, Falloff, Ground, OcclusionOptions};
pub use origin::Origin;
pub use scale::{Curve, Scale};
pub use shadow::{Disk, Shadow};
pub use signal::{Domain, Layer, Signal};
pub use tracer::{Hit, Opaque, SurfaceFlags, Surfaces, Tracer};

/// What keeps a mesh from being traced.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum LightError {
    /// More triangles than the tree can number.
    #[error("{triangles} triangles are more than the tree can number")]
    TooLarge {
        /// How many there are.
        triangles: usize,
    },
}
