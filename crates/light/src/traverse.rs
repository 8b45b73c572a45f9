//! The walk of a bundle of rays that start at one point.
//!
//! A node is fetched once for all rays of the bundle that reach it: its boxes are moved to the common origin
//! once, then each ray tests eight boxes in one step. The same holds for triangles: everything that depends on
//! origin and triangle only (edge planes, distance of the plane) is computed once per block, and a ray is left
//! with four dot products. Children are visited from near to far, by their distance from the origin.
//!
//! The triangle test takes the sign of the ray against the planes through the origin and each edge, computed
//! from sum and difference of the edge's ends (exactly opposite for the two triangles of an edge, so that no
//! ray slips between them), and widened by the rounding error, so that none slips through a vertex either.
//! Boxes are widened as Ize 2013, "Robust BVH Ray Traversal", §3 does, so that no box is missed.

use crate::lanes::{Kernel, Lanes, WIDTH};
use crate::tree::{Block, LEAF, NONE, Node, Tree};

/// Most rays in a bundle.
pub(crate) const BUNDLE: usize = 32;

/// Rounding of three products and two sums, on both sides of the comparison (Ize 2013, eq. 4).
const WIDEN: f32 = 1.000_000_5;
/// Directions are kept this far from zero, so that no reciprocal is infinite.
const SMALLEST: f32 = 1e-18;
/// Error of an edge plane against a ray, relative to edge length times distance (L-infinity norms).
const EDGE_ERROR: f32 = 1.0 / 2_097_152.0;

/// Rays from one point, in normalized coordinates.
pub(crate) struct Bundle {
    pub origin: [f32; 3],
    pub count: usize,
    pub directions: [[f32; 3]; BUNDLE],
    /// How far each ray looks; 0 once it is decided.
    pub limits: [f32; BUNDLE],
}

impl Bundle {
    pub(crate) fn new(origin: [f32; 3]) -> Self {
        Self { origin, count: 0, directions: [[0.0; 3]; BUNDLE], limits: [0.0; BUNDLE] }
    }

    pub(crate) fn push(&mut self, direction: [f32; 3], limit: f32) {
        self.directions[self.count] = direction;
        self.limits[self.count] = limit;
        self.count += 1;
    }
}

/// What to do when a ray meets triangles of a block.
pub(crate) trait Visitor {
    /// Returns how far the ray still looks: 0 ends it.
    ///
    /// - `lanes`: the triangles met, one bit each, in front of `limit`
    /// - `t`: distances along the ray; `edges[k]`: weight of corner `k`, not normalized
    fn meet<L: Lanes>(
        &mut self,
        ray: usize,
        limit: f32,
        block: &Block,
        lanes: u32,
        t: L,
        edges: [L; 3],
    ) -> f32;
}

/// The walk as a kernel.
pub(crate) struct Walk<'a, V> {
    pub tree: &'a Tree,
    pub bundle: &'a mut Bundle,
    pub visitor: &'a mut V,
}

/// Reciprocal direction, and which row of a node's bounds the ray enters and leaves by on each axis.
#[derive(Clone, Copy, Default)]
struct PreparedRay {
    inverse: [f32; 3],
    near: [u8; 3],
    far: [u8; 3],
}

impl<V: Visitor> Kernel for Walk<'_, V> {
    type Output = ();

    #[inline(always)]
    fn run<L: Lanes>(self) {
        let Self { tree, bundle, visitor } = self;
        if tree.root == NONE || bundle.count == 0 {
            return;
        }
        let mut rays = [PreparedRay::default(); BUNDLE];
        for (ray, &direction) in rays.iter_mut().zip(&bundle.directions[..bundle.count]) {
            *ray = prepare(direction);
        }
        let origin = bundle.origin.map(L::splat);
        let mut alive = (0..bundle.count).fold(0_u32, |m, r| m | (u32::from(bundle.limits[r] > 0.0) << r));
        let mut stack = Stack::new();
        stack.push(tree.root, alive);
        while let Some((code, mask)) = stack.pop() {
            let mask = mask & alive;
            if mask == 0 {
                continue;
            }
            if code & LEAF != 0 {
                let block = &tree.blocks[(code & !LEAF) as usize];
                alive &= !meet_block(block, origin, bundle, mask, visitor);
            } else {
                let node = &tree.nodes[code as usize];
                // Eight rows, so that an index of three bits needs no check.
                let rows: [L; 8] = std::array::from_fn(|r| L::load(&node.bounds[r % 6]).sub(origin[r % 3]));
                let mut reached = [0_u64; BUNDLE / 8];
                let mut any = 0;
                for (group, reached) in reached.iter_mut().enumerate() {
                    let mut rest = mask >> (8 * group) & 0xff;
                    while rest != 0 {
                        let lane = rest.trailing_zeros() as usize & 7;
                        rest &= rest - 1;
                        let r = 8 * group + lane;
                        let ray = &rays[r];
                        let inverse = ray.inverse.map(L::splat);
                        let near = ray.near.map(|row| rows[row as usize & 7]);
                        let far = ray.far.map(|row| rows[row as usize & 7]);
                        let enter = near[0]
                            .mul(inverse[0])
                            .max(near[1].mul(inverse[1]))
                            .max(near[2].mul(inverse[2]).max(L::splat(0.0)));
                        let leave = far[0]
                            .mul(inverse[0])
                            .min(far[1].mul(inverse[1]))
                            .min(far[2].mul(inverse[2]).min(L::splat(bundle.limits[r])));
                        let hit = enter.le(leave.mul(L::splat(WIDEN)));
                        *reached |= SPREAD[hit as usize & 0xff] << lane;
                        any |= hit;
                    }
                }
                push_children::<L>(node, &rows, &reached, any, &mut stack);
            }
        }
    }
}

#[inline(always)]
fn prepare(direction: [f32; 3]) -> PreparedRay {
    let inverse = direction.map(|d| 1.0 / if d.abs() < SMALLEST { SMALLEST.copysign(d) } else { d });
    let near = std::array::from_fn(|axis| if inverse[axis] > 0.0 { axis as u8 } else { axis as u8 + 3 });
    let far = std::array::from_fn(|axis| if inverse[axis] > 0.0 { axis as u8 + 3 } else { axis as u8 });
    PreparedRay { inverse, near, far }
}

/// Bit `k` of the index at bit 0 of byte `k`: one ray's hits, ready to be shifted to the ray's place.
static SPREAD: [u64; 256] = {
    let mut table = [0; 256];
    let mut bits = 0;
    while bits < 256 {
        let mut k = 0;
        while k < 8 {
            table[bits] |= (bits as u64 >> k & 1) << (8 * k);
            k += 1;
        }
        bits += 1;
    }
    table
};

/// Pushes the children that some ray meets, the farthest first.
///
/// - `reached[g]`: byte `k` has a bit for each ray of group `g` that meets child `k`
#[inline(always)]
fn push_children<L: Lanes>(
    node: &Node,
    rows: &[L; 8],
    reached: &[u64; BUNDLE / 8],
    any: u32,
    stack: &mut Stack,
) {
    if any == 0 {
        return;
    }
    let mut push = |child: u32| {
        let child = child & 7;
        let rays = reached.iter().rev().fold(0, |mask, &r| mask << 8 | (r >> (8 * child) & 0xff) as u32);
        stack.push(node.children[child as usize], rays);
    };
    if any & (any - 1) == 0 {
        push(any.trailing_zeros());
        return;
    }
    let zero = L::splat(0.0);
    let outside = |axis: usize| rows[axis].max(rows[axis + 3].neg()).max(zero);
    let (x, y, z) = (outside(0), outside(1), outside(2));
    let distances = x.mul(x).add(y.mul(y)).add(z.mul(z)).store();
    // Insertion, the farthest first. Bits of positive floats order as the floats do; the lowest three, which
    // say nothing here, name the child.
    let mut order = [0_u32; WIDTH];
    let mut len = 0;
    let mut rest = any;
    while rest != 0 {
        let child = rest.trailing_zeros() & 7;
        rest &= rest - 1;
        let key = distances[child as usize].to_bits() & !7 | child;
        let mut at = len & 7;
        while at > 0 && order[at - 1] < key {
            order[at] = order[at - 1];
            at -= 1;
        }
        order[at] = key;
        len += 1;
    }
    for &key in &order[..len.min(WIDTH)] {
        push(key);
    }
}

/// Tests rays against a block; returns the rays that are decided.
#[inline(always)]
fn meet_block<L: Lanes, V: Visitor>(
    block: &Block,
    origin: [L; 3],
    bundle: &mut Bundle,
    mask: u32,
    visitor: &mut V,
) -> u32 {
    let corner = |k: usize| -> [L; 3] {
        std::array::from_fn(|axis| L::load(&block.corners[k][axis]).sub(origin[axis]))
    };
    let (a, b, c) = (corner(0), corner(1), corner(2));
    let (plane_a, size_a) = edge_plane(b, c);
    let (plane_b, size_b) = edge_plane(c, a);
    let (plane_c, size_c) = edge_plane(a, b);
    let error = size_a.max(size_b).max(size_c).mul(L::splat(EDGE_ERROR));
    let normal: [L; 3] = std::array::from_fn(|axis| L::load(&block.normals[axis]));
    let height = dot(a, normal);
    let mut decided = 0;
    let mut rest = mask;
    while rest != 0 {
        let r = rest.trailing_zeros() as usize % BUNDLE;
        rest &= rest - 1;
        let direction = bundle.directions[r].map(L::splat);
        let edges = [dot(plane_a, direction), dot(plane_b, direction), dot(plane_c, direction)];
        let low = edges[0].min(edges[1]).min(edges[2]);
        let high = edges[0].max(edges[1]).max(edges[2]);
        let inside = error.neg().le(low) | high.le(error);
        if inside == 0 {
            continue;
        }
        let t = height.div(dot(normal, direction));
        let limit = bundle.limits[r];
        let lanes = inside & L::splat(0.0).lt(t) & t.le(L::splat(limit));
        if lanes != 0 {
            bundle.limits[r] = visitor.meet(r, limit, block, lanes, t, edges);
            decided |= u32::from(bundle.limits[r] <= 0.0) << r;
        }
    }
    decided
}

/// Normal of the plane through the origin and an edge, twice `p x q`, and the magnitude of its terms.
#[inline(always)]
fn edge_plane<L: Lanes>(p: [L; 3], q: [L; 3]) -> ([L; 3], L) {
    let edge: [L; 3] = std::array::from_fn(|axis| q[axis].sub(p[axis]));
    let sum: [L; 3] = std::array::from_fn(|axis| q[axis].add(p[axis]));
    let plane = [
        sum[1].mul(edge[2]).sub(sum[2].mul(edge[1])),
        sum[2].mul(edge[0]).sub(sum[0].mul(edge[2])),
        sum[0].mul(edge[1]).sub(sum[1].mul(edge[0])),
    ];
    (plane, largest(edge).mul(largest(sum)))
}

#[inline(always)]
fn largest<L: Lanes>(v: [L; 3]) -> L {
    v[0].abs().max(v[1].abs()).max(v[2].abs())
}

#[inline(always)]
fn dot<L: Lanes>(a: [L; 3], b: [L; 3]) -> L {
    a[0].mul(b[0]).add(a[1].mul(b[1])).add(a[2].mul(b[2]))
}

/// Subtrees still to visit: an array for every tree met in practice, and a heap beyond it for any other.
struct Stack {
    near: [(u32, u32); 192],
    len: usize,
    beyond: Vec<(u32, u32)>,
}

impl Stack {
    #[inline(always)]
    fn new() -> Self {
        Self { near: [(0, 0); 192], len: 0, beyond: Vec::new() }
    }

    #[inline(always)]
    fn push(&mut self, code: u32, mask: u32) {
        if let Some(slot) = self.near.get_mut(self.len) {
            *slot = (code, mask);
            self.len += 1;
        } else {
            self.spill(code, mask);
        }
    }

    #[cold]
    fn spill(&mut self, code: u32, mask: u32) {
        self.beyond.push((code, mask));
    }

    #[inline(always)]
    fn pop(&mut self) -> Option<(u32, u32)> {
        if !self.beyond.is_empty() {
            return self.beyond.pop();
        }
        self.len = self.len.checked_sub(1)?;
        self.near.get(self.len).copied()
    }
}
