//! A car.
use crate::model::Assembly;
/// A car.
pub fn car(_size: usize) -> Assembly {
    Assembly::default()
}
