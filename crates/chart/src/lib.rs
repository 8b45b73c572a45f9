//! Charts: texture triangles are cut into almost developable disks, flattened, and packed into an atlas.
//!
//! Schaefer 2012, section 4.2. No file in this crate knows light: a chart is geometry only.
//!
//! | module | what |
//! |---|---|
//! | [`chart`] | the types that later stages see |
//! | [`pack`] | places charts in pages by the 4 x 4 blocks that they touch |

pub mod chart;
pub mod pack;

pub use chart::{Chart, ChartError, ChartId, SUBTEXELS};
