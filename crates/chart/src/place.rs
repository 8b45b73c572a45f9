//! From a flattening to the chart's own texel grid: scale, turn, move, snap.
//!
//! Deviation: Schaefer 2012, section 4.2, turns a chart so that its largest extent lies in y and takes its
//! width in texels as width / radius. Here the chart is turned so that its bounding rectangle needs the
//! fewest 4 x 4 blocks (over the edges of its convex hull), the longer side in y: the blocks are what an
//! atlas is packed and compressed by. One density holds for all charts: texel = `texel_size`.

use glam::{DVec2, Vec2};

use crate::chart::SUBTEXELS;

/// Where a chart lies in its grid.
pub(crate) struct Placed {
    /// Per vertex: texels, multiples of `1 / SUBTEXELS`.
    pub(crate) uv: Vec<Vec2>,
    /// Multiples of 4.
    pub(crate) size: [u32; 2],
}

/// Texels that a chart of this extent takes, gutters included.
pub(crate) fn size_for(extent: f64, gutter: u32) -> u32 {
    // Snapping comes later; until then a rounding error must not cost a block.
    let extent = (extent * f64::from(SUBTEXELS)).round() / f64::from(SUBTEXELS);
    let texels = (extent + f64::from(2 * gutter)).ceil().clamp(1.0, f64::from(u32::MAX / 8)) as u32;
    texels.next_multiple_of(4)
}

/// Turns and moves a flattening (texels) into its grid.
pub(crate) fn place(uv: &[DVec2], gutter: u32) -> Placed {
    let hull = hull(uv);
    let turn = best_turn(&hull, gutter);
    let turned: Vec<DVec2> = uv.iter().map(|p| turn.rotate(*p)).collect();
    let low = turned.iter().fold(DVec2::INFINITY, |a, &b| a.min(b));
    let high = turned.iter().fold(DVec2::NEG_INFINITY, |a, &b| a.max(b));
    let extent = high - low;
    // Half a texel in, a straight border runs through texel centres and a thin strip shows the fewest
    // texels; where that would cost a block, the chart starts at the gutter itself.
    let start = [extent.x, extent.y].map(|e| {
        let wanted = size_for(e + 0.5, gutter);
        f64::from(gutter) + if wanted == size_for(e, gutter) { 0.5 } else { 0.0 }
    });
    let steps = f64::from(SUBTEXELS);
    let offset = DVec2::from_array(start) - low;
    let uv: Vec<Vec2> = turned.iter().map(|&p| (((p + offset) * steps).round() / steps).as_vec2()).collect();
    let size = [0, 1].map(|axis| {
        let high = uv.iter().map(|p| p[axis]).fold(0.0, f32::max);
        size_for(f64::from(high) - f64::from(gutter), gutter)
    });
    Placed { uv, size }
}

/// Convex hull, counter-clockwise, by Andrew's monotone chain.
fn hull(points: &[DVec2]) -> Vec<DVec2> {
    let mut sorted = points.to_vec();
    sorted.sort_by(|a, b| a.x.total_cmp(&b.x).then(a.y.total_cmp(&b.y)));
    sorted.dedup();
    if sorted.len() < 3 {
        return sorted;
    }
    let mut hull: Vec<DVec2> = Vec::new();
    for pass in 0..2 {
        let base = hull.len();
        let mut add = |p: DVec2| {
            while hull.len() >= base + 2 {
                let [.., a, b] = hull.as_slice() else { break };
                if (*b - *a).perp_dot(p - *a) > 0.0 {
                    break;
                }
                hull.pop();
            }
            hull.push(p);
        };
        if pass == 0 {
            sorted.iter().copied().for_each(&mut add)
        } else {
            sorted.iter().rev().copied().for_each(&mut add)
        }
        hull.pop();
    }
    hull
}

/// The rotation after which the bounding rectangle takes the fewest blocks, then the least area; its longer
/// side in y.
fn best_turn(hull: &[DVec2], gutter: u32) -> DVec2 {
    let mut best = (u64::MAX, f64::INFINITY, DVec2::X);
    // Long hulls come from round charts, for which the direction hardly matters.
    let step = hull.len().div_ceil(256).max(1);
    let mut consider = |along: DVec2| {
        let Some(along) = along.try_normalize() else { return };
        // Multiplying by (-i conj) lays `along` onto the y axis.
        let turn = DVec2::new(along.y, along.x);
        let (mut low, mut high) = (DVec2::INFINITY, DVec2::NEG_INFINITY);
        for &p in hull {
            let q = turn.rotate(p);
            (low, high) = (low.min(q), high.max(q));
        }
        let extent = high - low;
        let turn = if extent.x > extent.y { turn.perp() } else { turn };
        let blocks = u64::from(size_for(extent.x, gutter)) * u64::from(size_for(extent.y, gutter));
        let area = extent.x * extent.y;
        // Equal up to rounding: the earlier edge stays.
        if blocks < best.0 || blocks == best.0 && area < best.1 * (1.0 - 1e-9) {
            best = (blocks, area, turn);
        }
    };
    for i in (0..hull.len()).step_by(step) {
        consider(hull[(i + 1) % hull.len()] - hull[i]);
    }
    best.2
}
