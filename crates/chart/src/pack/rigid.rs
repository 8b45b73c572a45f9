//! Packers of others, held to our promises.
//!
//! They are given the block footprints as shapes, not the triangles: every corner is then a whole number of
//! blocks, so what some of them do to small charts (stretch to whole texels, turn to the smallest box) has nothing to
//! act on, and a place is a translation of whole blocks. A shape in several pieces, which they would pack
//! apart, is given as a full rectangle, and so is, in a second try, one that comes back turned. The result passes the same check as ours or is refused.
//!
//! Charts are laid down first, longer side along x; the packers' own turns stay off, because one mirrors and
//! the other makes half turns, which a [`Placement`] does not have.

use super::check::check_footprints;
use super::footprint::Footprint;
use super::{BLOCK, PackError, PackOptions, Packing, Placement, limits};

/// Packs shapes with `place`, which gives per shape the page position of block (0, 0) of its grid, or `None` where it
/// was not kept rigid.
pub(super) fn pack(
    footprints: &[Footprint],
    options: &PackOptions,
    place: impl Fn(&[Footprint]) -> Option<Vec<Option<[i64; 2]>>>,
) -> Result<Packing, PackError> {
    let charts: Vec<usize> = (0..footprints.len()).filter(|&chart| footprints[chart].count() > 0).collect();
    let is_turned = |chart: usize| footprints[chart].size()[1] > footprints[chart].size()[0];
    let lay_down = |chart: usize| match is_turned(chart) {
        true => footprints[chart].turned(),
        false => footprints[chart].clone(),
    };
    let refused = PackError::Refused { packer: options.packer };
    let shape = |chart: usize| {
        let shape = lay_down(chart);
        if is_connected(&shape) { shape } else { rectangle(shape.size()) }
    };
    let mut shapes: Vec<Footprint> = charts.iter().map(|&chart| shape(chart)).collect();
    let mut places = place(&shapes).ok_or_else(|| refused.clone())?;
    let usable = |place: &Option<[i64; 2]>| place.is_some_and(|[x, y]| x >= 0 && y >= 0);
    if !places.iter().all(usable) {
        for (shape, _) in shapes.iter_mut().zip(&places).filter(|(_, place)| !usable(place)) {
            *shape = rectangle(shape.size());
        }
        places = place(&shapes).ok_or_else(|| refused.clone())?;
    }
    let mut packing = Packing {
        placements: vec![Placement { page: 0, origin: [0, 0], turned: false }; footprints.len()],
        page_size: [0, 0],
        pages: 1,
    };
    for ((&chart, shape), place) in charts.iter().zip(&shapes).zip(places) {
        let place = place.and_then(|[x, y]| Some([u32::try_from(x).ok()?, u32::try_from(y).ok()?]));
        let origin = place.ok_or_else(|| refused.clone())?.map(|blocks| blocks.saturating_mul(BLOCK));
        let [width, height] = shape.size().map(|blocks| blocks * BLOCK);
        grow(&mut packing.page_size, [origin[0].saturating_add(width), origin[1].saturating_add(height)]);
        packing.placements[chart] = Placement { page: 0, origin, turned: is_turned(chart) };
    }
    for nothing in footprints.iter().filter(|footprint| footprint.count() == 0) {
        grow(&mut packing.page_size, nothing.size().map(|blocks| blocks * BLOCK));
    }
    let limits = limits(options);
    let page = [limits.width * BLOCK, limits.height * BLOCK];
    if packing.page_size[0] > page[0] || packing.page_size[1] > page[1] {
        return Err(PackError::PageTooLarge { size: packing.page_size, page });
    }
    check_footprints(footprints, &packing)?;
    Ok(packing)
}

fn grow(page_size: &mut [u32; 2], to: [u32; 2]) {
    *page_size = [page_size[0].max(to[0]), page_size[1].max(to[1])];
}

/// Whether every taken block can be reached from every other through common sides.
fn is_connected(shape: &Footprint) -> bool {
    let mut reached = Footprint::empty(shape.size());
    let mut open: Vec<[u32; 2]> = shape.iter().take(1).collect();
    while let Some([x, y]) = open.pop() {
        if shape.contains(x, y) && !reached.contains(x, y) {
            reached.insert(x, y);
            open.extend([[x + 1, y], [x, y + 1], [x.wrapping_sub(1), y], [x, y.wrapping_sub(1)]]);
        }
    }
    reached == *shape
}

fn rectangle(size: [u32; 2]) -> Footprint {
    let mut rectangle = Footprint::empty(size);
    for y in 0..size[1] {
        for x in 0..size[0] {
            rectangle.insert(x, y);
        }
    }
    rectangle
}
