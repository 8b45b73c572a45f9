//! Texture triangles and color triangles: Schaefer 2012, sections 4.1 (eq. 5) and 4.2 (figure 5).
//!
//! | module | what |
//! |---|---|
//! | [`mod@classify`] | error per triangle and the verdict, with a confidence bound |
//! | [`closing`] | fewer, rounder regions: closing, notches, connected regions |
//! | [`dual`] | the dual graph of a set of triangles, compact |

pub mod classify;
pub mod closing;
pub mod dual;

pub use classify::{ClassifyError, Residuals, Verdict, classify, errors};
pub use closing::{close, fill_notches, regions};
pub use dual::Dual;
