//! The tree that rays walk: 8-wide boxes over blocks of up to eight triangles.
//!
//! obvhs builds a binary tree (PLOC with reinsertion); it is then folded into wide nodes and blocks at the
//! least expected cost by dynamic programming over "the cheapest forest of at most k roots" (Ylitie, Karras
//! and Laine 2017, §3.1; the same recurrence, other costs).
//!
//! Memory: 256 bytes a node and 448 bytes a block; about 100 bytes a triangle.

use glam::{DVec3, Vec3, Vec3A};
use obvhs::{BvhBuildParams, aabb::Aabb, bvh2::Bvh2, bvh2::builder::build_bvh2};

use crate::lanes::WIDTH;

/// Marks a child code as a block of triangles.
pub(crate) const LEAF: u32 = 1 << 31;
/// The code of no child at all.
pub(crate) const NONE: u32 = u32::MAX;
/// The id of an unused lane of a block.
pub(crate) const NO_TRIANGLE: u32 = u32::MAX;

// Expected cost of one visit relative to each other. On the hall of the bench the rays hardly mind: block costs
// from 0.5 to 3 are within noise.
const NODE_COST: f32 = 1.0;
const BLOCK_COST: f32 = 1.2;

/// Eight boxes side by side; a box that is not there is inside out, so that no ray meets it.
#[repr(C, align(64))]
#[derive(Clone, Debug)]
pub(crate) struct Node {
    /// Rows: low x, y, z, then high x, y, z.
    pub bounds: [[f32; WIDTH]; 6],
    /// An inner node's index, or a block's with [`LEAF`] set.
    pub children: [u32; WIDTH],
}

/// Eight triangles side by side; unused lanes hold zeros, which no ray meets because the normal is zero.
#[repr(C, align(64))]
#[derive(Clone, Debug)]
pub(crate) struct Block {
    /// Coordinates of the three corners: `corners[corner][axis]`.
    pub corners: [[[f32; WIDTH]; 3]; 3],
    /// Unit normals, rounded from double precision so that slivers have a good one.
    pub normals: [[f32; WIDTH]; 3],
    /// Mesh triangles, [`NO_TRIANGLE`] in unused lanes.
    pub triangles: [u32; WIDTH],
    /// Bit a lane: the ray goes on behind it, weakened.
    pub translucent: u32,
}

/// Nodes and blocks in the order of a depth-first walk.
#[derive(Clone, Debug)]
pub(crate) struct Tree {
    pub nodes: Vec<Node>,
    pub blocks: Vec<Block>,
    /// Code of the root; [`NONE`] for an empty tree.
    pub root: u32,
}

impl Tree {
    /// Builds the tree over the triangles that have an area.
    ///
    /// - `corners(t)`: corner positions of triangle `t`, of about unit magnitude
    /// - `translucent(t)`: whether rays go on behind it
    pub(crate) fn new(
        count: usize,
        corners: impl Fn(u32) -> [Vec3; 3],
        translucent: impl Fn(u32) -> bool,
    ) -> Self {
        let mut tree = Self { nodes: Vec::new(), blocks: Vec::new(), root: NONE };
        let triangles: Vec<u32> = (0..count as u32).filter(|&t| unit_normal(corners(t)).is_some()).collect();
        if triangles.is_empty() {
            return tree;
        }
        let boxes: Vec<Aabb> = triangles
            .iter()
            .map(|&t| {
                let [a, b, c] = corners(t).map(Vec3A::from);
                Aabb::new(a.min(b).min(c), a.max(b).max(c))
            })
            .collect();
        // Folding chooses the blocks, so the binary tree goes down to single triangles.
        let parameters = BvhBuildParams {
            max_prims_per_leaf: 1,
            post_collapse_reinsertion_batch_ratio_multiplier: 0.0,
            ..BvhBuildParams::medium_build()
        };
        let binary = build_bvh2(&boxes, parameters, &mut std::time::Duration::default());
        drop(boxes);
        Folding::new(&binary).emit(&mut tree, |members, binary| {
            let mut block = Block {
                corners: [[[0.0; WIDTH]; 3]; 3],
                normals: [[0.0; WIDTH]; 3],
                triangles: [NO_TRIANGLE; WIDTH],
                translucent: 0,
            };
            let mut ids = [NO_TRIANGLE; WIDTH];
            for (id, &primitive) in ids.iter_mut().zip(members) {
                *id = triangles[binary.primitive_indices[primitive as usize] as usize];
            }
            // Lanes stand in the order of the mesh, whatever order the builder left.
            ids.sort_unstable();
            for (lane, &triangle) in ids.iter().enumerate().take(members.len()) {
                let positions = corners(triangle);
                let normal = unit_normal(positions).expect("only triangles with an area are in the tree");
                for axis in 0..3 {
                    for (rows, position) in block.corners.iter_mut().zip(positions) {
                        rows[axis][lane] = position[axis];
                    }
                    block.normals[axis][lane] = normal[axis];
                }
                block.triangles[lane] = triangle;
                block.translucent |= u32::from(translucent(triangle)) << lane;
            }
            block
        });
        tree
    }
}

/// The normal of a triangle on its front, or none if the triangle has no area.
fn unit_normal(corners: [Vec3; 3]) -> Option<Vec3> {
    let [a, b, c] = corners.map(Vec3::as_dvec3);
    let normal: DVec3 = (b - a).cross(c - a).normalize_or_zero();
    (normal != DVec3::ZERO).then(|| normal.as_vec3())
}

/// Costs of folding a binary tree.
struct Folding<'a> {
    binary: &'a Bvh2,
    /// Per binary node: triangles below it, saturated just above [`WIDTH`].
    counts: Vec<u8>,
    /// Per binary node: least cost of showing it as at most `k + 1` children of a wide node.
    forests: Vec<[f32; WIDTH - 1]>,
}

impl<'a> Folding<'a> {
    fn new(binary: &'a Bvh2) -> Self {
        let nodes = &binary.nodes;
        // Parents before children, by walking: reinsertion leaves no order of indices to rely on.
        let mut order: Vec<u32> = Vec::with_capacity(nodes.len());
        let mut open = vec![0_u32];
        while let Some(at) = open.pop() {
            order.push(at);
            let node = &nodes[at as usize];
            if !node.is_leaf() {
                open.extend([node.first_index, node.first_index + 1]);
            }
        }
        let mut folding =
            Self { binary, counts: vec![0; nodes.len()], forests: vec![[0.0; WIDTH - 1]; nodes.len()] };
        for &at in order.iter().rev() {
            folding.weigh(at as usize);
        }
        folding
    }

    fn weigh(&mut self, at: usize) {
        let node = &self.binary.nodes[at];
        if node.is_leaf() {
            self.counts[at] = node.prim_count.min(WIDTH as u32 + 1) as u8;
            self.forests[at] = [self.block_cost(at); WIDTH - 1];
            return;
        }
        let (left, right) = (node.first_index as usize, node.first_index as usize + 1);
        self.counts[at] = (self.counts[left] + self.counts[right]).min(WIDTH as u8 + 1);
        let area = node.aabb().half_area();
        let one = self.block_cost(at).min(area * NODE_COST + self.split(left, right, WIDTH).1);
        let mut forest = [one; WIDTH - 1];
        for roots in 2..WIDTH {
            forest[roots - 1] = one.min(self.split(left, right, roots).1);
        }
        self.forests[at] = forest;
    }

    fn block_cost(&self, at: usize) -> f32 {
        if self.counts[at] as usize <= WIDTH {
            self.binary.nodes[at].aabb().half_area() * BLOCK_COST
        } else {
            f32::INFINITY
        }
    }

    /// How many of `roots` go to the left, and the cost.
    fn split(&self, left: usize, right: usize, roots: usize) -> (usize, f32) {
        let cost = |k: usize| self.forests[left][k - 1] + self.forests[right][roots - k - 1];
        let mut best = (1, cost(1));
        for k in 2..roots {
            if cost(k) < best.1 {
                best = (k, cost(k));
            }
        }
        best
    }

    /// Collects the binary nodes that become the children of the wide node `at`.
    fn children(&self, at: usize, children: &mut Vec<u32>) {
        children.clear();
        let node = &self.binary.nodes[at];
        let mut open = [(0_u32, 0_usize); WIDTH];
        let mut len = 0;
        let divide = |node_index: usize, roots: usize, open: &mut [(u32, usize); WIDTH], len: &mut usize| {
            let node = &self.binary.nodes[node_index];
            let (left, right) = (node.first_index as usize, node.first_index as usize + 1);
            let (k, _) = self.split(left, right, roots);
            open[*len] = (right as u32, roots - k);
            open[*len + 1] = (left as u32, k);
            *len += 2;
        };
        if node.is_leaf() {
            children.push(at as u32);
            return;
        }
        divide(at, WIDTH, &mut open, &mut len);
        while len > 0 {
            len -= 1;
            let (index, roots) = open[len];
            let i = index as usize;
            if roots == 1
                || self.binary.nodes[i].is_leaf()
                || self.forests[i][roots - 1] == self.forests[i][0]
            {
                children.push(index);
            } else {
                divide(i, roots, &mut open, &mut len);
            }
        }
    }

    fn is_block(&self, at: usize) -> bool {
        self.counts[at] as usize <= WIDTH && self.forests[at][0] == self.block_cost(at)
    }

    /// The primitives below a binary node of at most [`WIDTH`].
    fn members(&self, at: usize, members: &mut Vec<u32>) {
        members.clear();
        let mut open = vec![at as u32];
        while let Some(at) = open.pop() {
            let node = &self.binary.nodes[at as usize];
            if node.is_leaf() {
                members.extend(node.first_index..node.first_index + node.prim_count);
            } else {
                open.extend([node.first_index + 1, node.first_index]);
            }
        }
    }

    fn emit(&self, tree: &mut Tree, block: impl Fn(&[u32], &Bvh2) -> Block) {
        let (mut children, mut members) = (Vec::with_capacity(WIDTH), Vec::with_capacity(WIDTH));
        // (binary node, wide parent, lane in the parent)
        let mut open = vec![(0_u32, NONE, 0_usize)];
        while let Some((at, parent, lane)) = open.pop() {
            let code = if self.is_block(at as usize) {
                self.members(at as usize, &mut members);
                tree.blocks.push(block(&members, self.binary));
                (tree.blocks.len() - 1) as u32 | LEAF
            } else {
                self.children(at as usize, &mut children);
                let mut node = Node { bounds: [[f32::INFINITY; WIDTH]; 6], children: [NONE; WIDTH] };
                for row in &mut node.bounds[3..] {
                    *row = [f32::NEG_INFINITY; WIDTH];
                }
                let wide = tree.nodes.len() as u32;
                for (lane, &child) in children.iter().enumerate() {
                    let aabb = self.binary.nodes[child as usize].aabb();
                    for axis in 0..3 {
                        node.bounds[axis][lane] = aabb.min[axis];
                        node.bounds[axis + 3][lane] = aabb.max[axis];
                    }
                }
                tree.nodes.push(node);
                open.extend(children.iter().enumerate().rev().map(|(lane, &child)| (child, wide, lane)));
                wide
            };
            if parent == NONE {
                tree.root = code;
            } else {
                tree.nodes[parent as usize].children[lane] = code;
            }
        }
    }
}
