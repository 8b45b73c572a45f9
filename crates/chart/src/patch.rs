//! A patch: connected triangles on the way to become a chart. Which triangles still hang together is kept
//! per half-edge, so that cutting is forgetting; vertices are numbered from that, one per fan.
//!
//! Because each fan has a vertex of its own, a patch is always a surface with border curves, whatever the
//! mesh does at pinch vertices and non-manifold edges, and its Euler characteristic tells its shape.

use std::cmp::Reverse;
use std::collections::BinaryHeap;

use glam::DVec3;
use lightkiln_mesh::{Adjacency, EdgeKind, Mesh, TriangleId, VertexId};

/// No half-edge on the other side.
pub(crate) const CUT: u32 = u32::MAX;

/// Connected triangles with vertices of their own. Half-edge `3 t + e` runs from corner `e` to `e + 1`.
#[derive(Clone, Debug)]
pub(crate) struct Patch {
    /// Ascending.
    pub(crate) triangles: Vec<TriangleId>,
    /// Per half-edge: the half-edge on the other side, or [`CUT`].
    pub(crate) twins: Vec<u32>,
    /// Per triangle: patch vertices, one per fan.
    pub(crate) corners: Vec<[u32; 3]>,
    /// Per patch vertex: the light vertex.
    pub(crate) vertices: Vec<VertexId>,
    /// Per patch vertex: on the border.
    pub(crate) border: Vec<bool>,
}

/// The half-edge after this one in its triangle.
#[inline]
pub(crate) fn next(half: u32) -> u32 {
    if half % 3 == 2 { half - 2 } else { half + 1 }
}

impl Patch {
    /// Gathers triangles (ascending, connected over `adjacency`).
    pub(crate) fn new(mesh: &Mesh, adjacency: &Adjacency, triangles: Vec<TriangleId>) -> Self {
        let twins = triangles
            .iter()
            .flat_map(|&t| (0..3).map(move |edge| (t, edge)))
            .map(|(t, edge)| match adjacency.across(t, edge) {
                EdgeKind::Interior { triangle, edge } if triangle != t => {
                    triangles.binary_search(&triangle).map_or(CUT, |at| at as u32 * 3 + u32::from(edge))
                }
                _ => CUT,
            })
            .collect();
        let mut patch =
            Self { triangles, twins, corners: Vec::new(), vertices: Vec::new(), border: Vec::new() };
        patch.number(mesh);
        patch
    }

    /// Number of triangles.
    pub(crate) fn len(&self) -> usize {
        self.triangles.len()
    }

    /// Numbers the vertices anew: corners that meet across an uncut edge are one vertex.
    fn number(&mut self, mesh: &Mesh) {
        let mut parent: Vec<u32> = (0..self.twins.len() as u32).collect();
        fn root(parent: &mut [u32], mut v: u32) -> u32 {
            while parent[v as usize] != v {
                parent[v as usize] = parent[parent[v as usize] as usize];
                v = parent[v as usize];
            }
            v
        }
        for half in 0..self.twins.len() as u32 {
            let twin = self.twins[half as usize];
            if twin != CUT && twin > half {
                for (a, b) in [(half, next(twin)), (next(half), twin)] {
                    let (ra, rb) = (root(&mut parent, a), root(&mut parent, b));
                    parent[ra.max(rb) as usize] = ra.min(rb);
                }
            }
        }
        let mut number = vec![u32::MAX; self.twins.len()];
        self.vertices.clear();
        self.corners.clear();
        for (at, &t) in self.triangles.iter().enumerate() {
            let light = mesh.triangles[t.index()];
            let corner = |c: usize| {
                let r = root(&mut parent, (at * 3 + c) as u32) as usize;
                if number[r] == u32::MAX {
                    number[r] = self.vertices.len() as u32;
                    self.vertices.push(light[c]);
                }
                number[r]
            };
            self.corners.push([0, 1, 2].map(corner));
        }
        self.border = vec![false; self.vertices.len()];
        for half in 0..self.twins.len() as u32 {
            if self.twins[half as usize] == CUT {
                let (a, b) = (self.tail(half), self.head(half));
                self.border[a as usize] = true;
                self.border[b as usize] = true;
            }
        }
    }

    /// The vertex where a half-edge starts.
    #[inline]
    pub(crate) fn tail(&self, half: u32) -> u32 {
        self.corners[half as usize / 3][half as usize % 3]
    }

    /// The vertex where a half-edge ends.
    #[inline]
    pub(crate) fn head(&self, half: u32) -> u32 {
        self.tail(next(half))
    }

    /// Vertices - edges + triangles: 1 for a disk, 2 for a closed sphere, 0 for a tube or a torus.
    pub(crate) fn euler(&self) -> i64 {
        let halves = self.twins.len() as i64;
        let cut = self.twins.iter().filter(|&&t| t == CUT).count() as i64;
        self.vertices.len() as i64 - (cut + (halves - cut) / 2) + self.len() as i64
    }

    /// The border curves, as half-edges in order; each vertex lies on at most one of them, once.
    pub(crate) fn loops(&self) -> Vec<Vec<u32>> {
        let mut from = vec![CUT; self.vertices.len()];
        for half in (0..self.twins.len() as u32).filter(|&h| self.twins[h as usize] == CUT) {
            from[self.tail(half) as usize] = half;
        }
        let mut loops = Vec::new();
        for start in 0..from.len() {
            let mut curve = Vec::new();
            let mut vertex = start;
            while from[vertex] != CUT {
                let half = std::mem::replace(&mut from[vertex], CUT);
                curve.push(half);
                vertex = self.head(half) as usize;
            }
            if !curve.is_empty() {
                loops.push(curve);
            }
        }
        loops
    }

    /// Splits into the connected sets of triangles with equal labels.
    pub(crate) fn components(&self, label: &[u32]) -> Vec<Vec<TriangleId>> {
        let mut seen = vec![false; self.len()];
        let mut sets = Vec::new();
        let mut stack = Vec::new();
        for start in 0..self.len() {
            if std::mem::replace(&mut seen[start], true) {
                continue;
            }
            let mut set = Vec::new();
            stack.push(start);
            while let Some(at) = stack.pop() {
                set.push(self.triangles[at]);
                for half in at * 3..at * 3 + 3 {
                    let twin = self.twins[half];
                    if twin != CUT {
                        let other = twin as usize / 3;
                        if label[other] == label[at] && !std::mem::replace(&mut seen[other], true) {
                            stack.push(other);
                        }
                    }
                }
            }
            set.sort_unstable();
            sets.push(set);
        }
        sets
    }

    /// Cuts until the patch is a disk and returns how many edges were cut; `None` for a closed sphere, which
    /// has no border to start from and must be split.
    ///
    /// Holes are joined with the outer border by shortest paths of edges; what is left are handles, which
    /// are cut along the edges that a spanning tree of the triangles does not cross, without dangling ends
    /// (the cut graph of Gu, Gortler and Hoppe 2002, section 3.1).
    pub(crate) fn cut_to_disk(&mut self, mesh: &Mesh) -> Option<usize> {
        let before = self.twins.iter().filter(|&&t| t == CUT).count();
        if self.euler() != 1 {
            let loops = self.loops();
            if loops.len() > 1 {
                self.join_holes(mesh, &loops);
                self.number(mesh);
            }
        }
        if self.euler() != 1 {
            if self.euler() == 2 {
                return None;
            }
            self.cut_handles();
            self.number(mesh);
        }
        let after = self.twins.iter().filter(|&&t| t == CUT).count();
        (self.euler() == 1).then_some((after - before) / 2)
    }

    fn cut(&mut self, half: u32) {
        let twin = std::mem::replace(&mut self.twins[half as usize], CUT);
        if twin != CUT {
            self.twins[twin as usize] = CUT;
        }
    }

    /// Grows from the longest border over edges; each time another border is met, the way there is cut and
    /// becomes a place to grow from.
    fn join_holes(&mut self, mesh: &Mesh, loops: &[Vec<u32>]) {
        let place = |v: u32| mesh.positions[self.vertices[v as usize].index()].as_dvec3();
        let length = |half: u32| place(self.tail(half)).distance(place(self.head(half)));
        let mut curve_of = vec![u32::MAX; self.vertices.len()];
        for (number, curve) in loops.iter().enumerate() {
            for &half in curve {
                curve_of[self.tail(half) as usize] = number as u32;
            }
        }
        let lengths: Vec<f64> = loops.iter().map(|c| c.iter().map(|&h| length(h)).sum()).collect();
        let outer = (0..loops.len()).fold(0, |best, i| if lengths[i] > lengths[best] { i } else { best });
        let (starts, halves) = self.outgoing();
        let mut joined = vec![false; loops.len()];
        let mut distance = vec![f64::INFINITY; self.vertices.len()];
        let mut came = vec![CUT; self.vertices.len()];
        let mut queue = BinaryHeap::new();
        let mut cuts = Vec::new();
        let mut sources: Vec<u32> = loops[outer].iter().map(|&h| self.tail(h)).collect();
        joined[outer] = true;
        let mut open = loops.len() - 1;
        loop {
            for v in sources.drain(..) {
                distance[v as usize] = 0.0;
                came[v as usize] = CUT;
                queue.push(Reverse((0_u64, v)));
            }
            if open == 0 {
                break;
            }
            let Some(Reverse((bits, v))) = queue.pop() else { break };
            if bits != distance[v as usize].to_bits() {
                continue;
            }
            let curve = curve_of[v as usize];
            if curve != u32::MAX && !joined[curve as usize] {
                joined[curve as usize] = true;
                open -= 1;
                let mut at = v;
                while came[at as usize] != CUT {
                    let half = came[at as usize];
                    cuts.push(half);
                    at = self.tail(half);
                    sources.push(at);
                }
                sources.extend(loops[curve as usize].iter().map(|&h| self.tail(h)));
                continue;
            }
            for &half in &halves[starts[v as usize] as usize..starts[v as usize + 1] as usize] {
                let to = self.head(half);
                let far = distance[v as usize] + length(half);
                if far < distance[to as usize] {
                    distance[to as usize] = far;
                    came[to as usize] = half;
                    queue.push(Reverse((far.to_bits(), to)));
                }
            }
        }
        for half in cuts {
            self.cut(half);
        }
    }

    /// The uncut half-edges that leave each vertex, in compressed rows.
    fn outgoing(&self) -> (Vec<u32>, Vec<u32>) {
        let mut starts = vec![0_u32; self.vertices.len() + 1];
        let uncut = || (0..self.twins.len() as u32).filter(|&h| self.twins[h as usize] != CUT);
        for half in uncut() {
            starts[self.tail(half) as usize + 1] += 1;
        }
        for v in 0..self.vertices.len() {
            starts[v + 1] += starts[v];
        }
        let mut fill = starts.clone();
        let mut halves = vec![0; starts[self.vertices.len()] as usize];
        for half in uncut() {
            let at = &mut fill[self.tail(half) as usize];
            halves[*at as usize] = half;
            *at += 1;
        }
        (starts, halves)
    }

    /// Cuts every edge that a breadth-first tree of the triangles does not cross, then takes back the cuts
    /// that end in the open.
    fn cut_handles(&mut self) {
        let mut crossed = vec![false; self.twins.len()];
        let mut seen = vec![false; self.len()];
        let mut order = vec![0_u32];
        seen[0] = true;
        let mut head = 0;
        while head < order.len() {
            let at = order[head];
            head += 1;
            for half in at * 3..at * 3 + 3 {
                let twin = self.twins[half as usize];
                if twin != CUT && !std::mem::replace(&mut seen[twin as usize / 3], true) {
                    crossed[half as usize] = true;
                    crossed[twin as usize] = true;
                    order.push(twin / 3);
                }
            }
        }
        let (starts, halves) = self.outgoing();
        let row = |v: u32| &halves[starts[v as usize] as usize..starts[v as usize + 1] as usize];
        // Interior vertices: each cut edge leaves its vertex once, so counting rows counts cut edges.
        let mut degree: Vec<u32> = (0..self.vertices.len() as u32)
            .map(|v| row(v).iter().filter(|&&h| !crossed[h as usize]).count() as u32)
            .collect();
        let mut ends: Vec<u32> = (0..self.vertices.len() as u32)
            .filter(|&v| degree[v as usize] == 1 && !self.border[v as usize])
            .collect();
        while let Some(v) = ends.pop() {
            if degree[v as usize] != 1 {
                continue;
            }
            let Some(&half) = row(v).iter().find(|&&h| !crossed[h as usize]) else { continue };
            crossed[half as usize] = true;
            crossed[self.twins[half as usize] as usize] = true;
            let other = self.head(half);
            degree[v as usize] -= 1;
            degree[other as usize] = degree[other as usize].saturating_sub(1);
            if degree[other as usize] == 1 && !self.border[other as usize] {
                ends.push(other);
            }
        }
        for half in 0..self.twins.len() as u32 {
            if !crossed[half as usize] {
                self.cut(half);
            }
        }
    }

    /// Positions of the patch vertices relative to the first one, in texels.
    pub(crate) fn places(&self, mesh: &Mesh, texel_size: f32) -> Vec<DVec3> {
        let origin = mesh.positions[self.vertices[0].index()].as_dvec3();
        let scale = 1.0 / f64::from(texel_size);
        let place = |v: &VertexId| (mesh.positions[v.index()].as_dvec3() - origin) * scale;
        self.vertices.iter().map(place).collect()
    }
}
