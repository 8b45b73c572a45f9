//! Does a flat chart lie over itself? A disk without flips is injective when its border curve is simple, so
//! the border is searched for crossings first; only where there are some are the triangles counted per point
//! of a fine lattice, which tells a touch (the two sides of a cut that closes again) from an overlap.

use glam::DVec2;

/// Whether the closed curve through `points` crosses itself. Touching counts or not, as rounding has it.
pub(crate) fn crosses_itself(points: &[DVec2]) -> bool {
    let count = points.len();
    if count < 4 {
        return false;
    }
    let segment = |i: usize| (points[i], points[(i + 1) % count]);
    // Boxes of runs of 1, 2, 4, ... segments: consecutive segments lie together, so the curve is its own tree.
    let leaves: Vec<(DVec2, DVec2)> = (0..count).map(segment).map(|(a, b)| (a.min(b), a.max(b))).collect();
    let mut levels = vec![leaves];
    while levels[levels.len() - 1].len() > 1 {
        let below = &levels[levels.len() - 1];
        let join = |pair: &[(DVec2, DVec2)]| {
            pair.iter().skip(1).fold(pair[0], |(low, high), b| (low.min(b.0), high.max(b.1)))
        };
        levels.push(below.chunks(2).map(join).collect());
    }
    let mut stack = Vec::new();
    for i in 0..count {
        let (a, b) = segment(i);
        let (low, high) = levels[0][i];
        stack.push((levels.len() - 1, 0));
        while let Some((level, at)) = stack.pop() {
            // Each pair once: only segments after this one.
            if ((at + 1) << level) <= i + 1 {
                continue;
            }
            let (l, h) = levels[level][at];
            if l.x > high.x || l.y > high.y || h.x < low.x || h.y < low.y {
                continue;
            }
            if level > 0 {
                stack.extend(
                    [2 * at, 2 * at + 1]
                        .into_iter()
                        .filter(|&c| c < levels[level - 1].len())
                        .map(|c| (level - 1, c)),
                );
            } else if at > i + 1 && !(i == 0 && at == count - 1) {
                let (c, d) = segment(at);
                if properly_cross(a, b, c, d) {
                    return true;
                }
            }
        }
    }
    false
}

fn properly_cross(a: DVec2, b: DVec2, c: DVec2, d: DVec2) -> bool {
    let side = |p: DVec2, q: DVec2, r: DVec2| (q - p).perp_dot(r - p);
    let (ac, ad) = (side(a, b, c), side(a, b, d));
    let (ca, cb) = (side(c, d, a), side(c, d, b));
    ((ac > 0.0 && ad < 0.0) || (ac < 0.0 && ad > 0.0)) && ((ca > 0.0 && cb < 0.0) || (ca < 0.0 && cb > 0.0))
}

/// The largest lattice that [`covers_twice`] visits; beyond it the lattice is made coarser.
const MOST_POINTS: f64 = 8e6;

/// Whether somewhere a 2 x 2 block of lattice points, `spacing` apart, lies in two triangles at once: that is,
/// whether the map overlaps by more than about `spacing`. Flipped triangles are skipped.
pub(crate) fn covers_twice(triangles: impl Iterator<Item = [DVec2; 3]> + Clone, spacing: f64) -> bool {
    let area: f64 = triangles.clone().map(|x| 0.5 * (x[1] - x[0]).perp_dot(x[2] - x[0]).abs()).sum();
    let spacing = spacing.max((area / MOST_POINTS).sqrt());
    if !(spacing > 0.0 && spacing.is_finite()) {
        return false;
    }
    // Off the grid that charts are snapped to, so that borders do not run along lattice lines.
    let offset = DVec2::new(0.381_966, 0.276_393);
    let mut hits: Vec<(i32, i32)> = Vec::with_capacity((area / (spacing * spacing)) as usize + 16);
    for x in triangles {
        if (x[1] - x[0]).perp_dot(x[2] - x[0]) > 0.0 {
            rasterize(x.map(|p| p / spacing + offset), &mut hits);
        }
    }
    hits.sort_unstable();
    let mut twice: Vec<(i32, i32)> = hits.windows(2).filter(|w| w[0] == w[1]).map(|w| w[0]).collect();
    twice.dedup();
    let also = |x: i32, y: i32| twice.binary_search(&(x, y)).is_ok();
    twice.iter().any(|&(x, y)| also(x + 1, y) && also(x, y + 1) && also(x + 1, y + 1))
}

/// Lists the integer points in a triangle. Points on an edge that two triangles share are in exactly one.
fn rasterize(x: [DVec2; 3], hits: &mut Vec<(i32, i32)>) {
    let low = x[0].y.min(x[1].y).min(x[2].y).ceil() as i32;
    let high = x[0].y.max(x[1].y).max(x[2].y).ceil() as i32;
    for row in low..high {
        let y = f64::from(row);
        let mut ends = [f64::INFINITY, f64::NEG_INFINITY];
        for e in 0..3 {
            // The same end first from both sides of an edge, so that both find the same point.
            let (p, q) = (x[e], x[(e + 1) % 3]);
            let (p, q) = if (p.y, p.x) <= (q.y, q.x) { (p, q) } else { (q, p) };
            if p.y < y && q.y >= y || p.y <= y && q.y > y {
                let at = p.x + (q.x - p.x) * ((y - p.y) / (q.y - p.y));
                ends = [ends[0].min(at), ends[1].max(at)];
            }
        }
        if ends[0] < ends[1] {
            hits.extend((ends[0].ceil() as i32..ends[1].ceil() as i32).map(|column| (row, column)));
        }
    }
}
