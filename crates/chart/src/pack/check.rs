//! What every packing must hold, whoever made it.

use super::footprint::Footprint;
use super::{BLOCK, PackError, Packing, Placement, footprints};
use crate::Chart;

/// The share of the atlas's blocks that charts occupy with their gutters, 0..=1; 1 without pages.
///
/// # Errors
/// [`PackError::Malformed`].
pub fn block_fill(charts: &[Chart], packing: &Packing, gutter: u32) -> Result<f64, PackError> {
    let blocks: u64 = footprints(charts, gutter)?.iter().map(|f| u64::from(f.count())).sum();
    Ok(match packing.page_texels() {
        0 => 1.0,
        texels => (blocks * u64::from(BLOCK * BLOCK)) as f64 / texels as f64,
    })
}

/// Checks that every chart lies on blocks of its own, on an existing page, with its whole grid inside.
///
/// # Errors
/// [`PackError::Overlap`] names the first chart that does not; [`PackError::Count`], [`PackError::Malformed`].
pub fn check(charts: &[Chart], packing: &Packing, gutter: u32) -> Result<(), PackError> {
    check_footprints(&footprints(charts, gutter)?, packing)
}

pub(super) fn check_footprints(footprints: &[Footprint], packing: &Packing) -> Result<(), PackError> {
    if footprints.len() != packing.placements.len() {
        return Err(PackError::Count { placements: packing.placements.len(), charts: footprints.len() });
    }
    let size = packing.page_size.map(|texels| texels / BLOCK);
    let mut pages = vec![Footprint::empty(size); packing.pages as usize];
    for (chart, (footprint, placement)) in footprints.iter().zip(&packing.placements).enumerate() {
        let overlap = PackError::Overlap { chart: chart as u32 };
        let page = pages.get_mut(placement.page as usize).ok_or_else(|| overlap.clone())?;
        if !take(page, footprint, *placement) {
            return Err(overlap);
        }
    }
    Ok(())
}

/// Takes the blocks of a chart, or says that it cannot.
fn take(page: &mut Footprint, footprint: &Footprint, placement: Placement) -> bool {
    let turned;
    let placed = if placement.turned {
        turned = footprint.turned();
        &turned
    } else {
        footprint
    };
    let [x, y] = placement.origin.map(|texels| texels / BLOCK);
    let [width, height] = placed.size();
    let inside = |at: u32, extent: u32, limit: u32| at.checked_add(extent).is_some_and(|end| end <= limit);
    if placement.origin.iter().any(|texels| texels % BLOCK != 0)
        || !inside(x, width, page.size()[0])
        || !inside(y, height, page.size()[1])
    {
        return false;
    }
    placed.iter().all(|[i, j]| {
        let free = !page.contains(x + i, y + j);
        page.insert(x + i, y + j);
        free
    })
}
