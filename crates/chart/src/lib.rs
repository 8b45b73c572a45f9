//! Charts: texture triangles are cut into almost developable disks, flattened, and packed into an atlas.
//!
//! Schaefer 2012, section 4.2. No file in this crate knows light: a chart is geometry only.
//!
//! | module | what |
//! |---|---|
//! | [`chart`] | the types that later stages see |
//! | [`unwrap`] | regions to charts: flatten, judge, split until it holds |
//! | `patch` | what hangs together; cutting to a disk |
//! | `segment` | splitting into almost developable pieces (D-Charts) |
//! | `merge` | putting pieces together again |
//! | `arap` | flattening a disk (ARAP, on `cholesky`) |
//! | `quality` | flips, stretch and their repair |
//! | `overlap` | does a flat chart lie over itself |
//! | `place` | scale, turn, snap to the texel grid |
//! | [`check`] | the promises of a finished chart |
//! | [`pack`] | places charts in pages by the 4 x 4 blocks that they touch |

mod arap;
pub mod chart;
pub mod check;
mod cholesky;
mod merge;
mod overlap;
pub mod pack;
mod patch;
mod place;
mod quality;
mod segment;
pub mod unwrap;

pub use chart::{Chart, ChartError, ChartId, SUBTEXELS};
pub use check::{ChartFault, verify};
pub use unwrap::{ChartOptions, ChartReport, charts};
