//! The normal matrix, gathered row by row from the triangles around each vertex, in parallel and without maps.

use std::ops::Range;

use glam::{DVec3, Vec3};
use lightkiln_mesh::VertexId;
use rayon::prelude::*;

use crate::elements::{Element, Flap, gradient, unfolded};
use crate::system::{AREA_FLOOR, CHUNK, DAMPING, EDGE_TIE, ENOUGH, GRAPH_TIE, NONE, System};
use crate::{Mass, Method, Regularizer};

/// The symmetric matrix, both halves, in chunks of [`CHUNK`] rows.
#[derive(Debug, Default)]
pub(crate) struct Rows {
    pub chunks: Vec<RowChunk>,
}

#[derive(Debug, Default)]
pub(crate) struct RowChunk {
    starts: Vec<u32>,
    columns: Vec<u32>,
    entries: Vec<f64>,
    diagonal: Vec<f64>,
    /// Entries whose column is a held vertex: row, vertex, entry.
    pub held: Vec<(u32, u32, f64)>,
}

impl Rows {
    /// Columns in ascending order, and entries.
    #[inline]
    pub fn row(&self, unknown: usize) -> (&[u32], &[f64]) {
        let chunk = &self.chunks[unknown / CHUNK];
        let r = unknown % CHUNK;
        let range = chunk.starts[r] as usize..chunk.starts[r + 1] as usize;
        (&chunk.columns[range.clone()], &chunk.entries[range])
    }

    #[inline]
    pub fn diagonal(&self, unknown: usize) -> f64 {
        self.chunks[unknown / CHUNK].diagonal[unknown % CHUNK]
    }

    pub fn entries(&self) -> usize {
        self.chunks.iter().map(|c| c.columns.len()).sum()
    }
}

impl System<'_> {
    /// Gathers all rows.
    pub(crate) fn assemble(&mut self) {
        let unknowns = self.vertex_of.len();
        let chunks = (0..unknowns.div_ceil(CHUNK))
            .into_par_iter()
            .map(|chunk| self.gather(chunk * CHUNK..((chunk + 1) * CHUNK).min(unknowns)))
            .collect();
        self.rows = Rows { chunks };
        self.report.matrix_entries = self.rows.entries();
    }

    fn gather(&self, unknowns: Range<usize>) -> RowChunk {
        let mut chunk = RowChunk::default();
        chunk.starts.push(0);
        chunk.columns.reserve(unknowns.len() * 14);
        chunk.entries.reserve(unknowns.len() * 14);
        let mut row = Accumulator::default();
        for unknown in unknowns {
            self.gather_row(self.vertex_of[unknown], &mut row);
            row.finish();
            let mut diagonal = 0.0;
            for &(vertex, entry) in &row.entries {
                let column = self.unknown_of[vertex as usize];
                if column as usize == unknown {
                    diagonal = entry;
                }
                if column == NONE {
                    chunk.held.push((unknown as u32, vertex, entry));
                } else {
                    chunk.columns.push(column);
                    chunk.entries.push(entry);
                }
            }
            if diagonal <= 0.0 {
                // A vertex whose triangles name nothing else and show nothing: any value will do.
                diagonal = 1.0;
                let at = chunk.columns.iter().rposition(|&c| c as usize == unknown);
                if let Some(at) = at {
                    chunk.entries[at] = diagonal;
                }
            }
            chunk.diagonal.push(diagonal);
            chunk.starts.push(chunk.columns.len() as u32);
        }
        chunk
    }

    /// Everything that couples one vertex to others: entries of its row by vertex.
    fn gather_row(&self, vertex: u32, row: &mut Accumulator) {
        let (mesh, alpha) = (self.mesh, f64::from(self.options.alpha));
        let ours = self.options.method == Method::Ours;
        let analytic = self.options.method == Method::LeastSquares { mass: Mass::Analytic };
        // Also at alpha 0, so that the structure is the same for every alpha.
        let regularizer = self.options.regularizer;
        let edge = matches!(regularizer, Regularizer::Edge | Regularizer::Both);
        row.start(vertex);
        for &t in self.fans.around(VertexId(vertex)) {
            let corners = mesh.triangles[t.index()].map(|v| v.0);
            let slots = corners.map(|v| row.slot(v));
            let places = mesh.corners(t).map(Vec3::as_dvec3);
            let normal = (places[1] - places[0]).cross(places[2] - places[0]);
            let unit = self.sheets[self.sheet_of[t.index()] as usize].unit;
            let area = 0.5 * normal.length();
            if analytic {
                for a in (0..3).filter(|&a| corners[a] == vertex) {
                    slots.iter().for_each(|&b| row.add(b, area / 12.0));
                    row.add(slots[a], area / 12.0);
                }
            } else {
                let mut sums = [0.0; 3];
                for seen in self.observed.in_triangle(t) {
                    let mut here = 0.0;
                    for (&v, b) in corners.iter().zip(seen.barycentric) {
                        here += if v == vertex { b } else { 0.0 };
                    }
                    here *= seen.weight;
                    for (sum, b) in sums.iter_mut().zip(seen.barycentric) {
                        *sum += here * b;
                    }
                }
                for (slot, sum) in slots.into_iter().zip(sums) {
                    row.add(slot, sum);
                }
            }
            let tie = GRAPH_TIE * (area / 3.0 + AREA_FLOOR * unit);
            for (&v, slot) in corners.iter().zip(slots) {
                if v != vertex {
                    row.add(0, tie);
                    row.add(slot, -tie);
                }
            }
            if matches!(regularizer, Regularizer::Gradient | Regularizer::Both) {
                row.add_element(&gradient(mesh, t), alpha);
            }
            if !(ours || edge || regularizer == Regularizer::EdgePrinted) {
                continue;
            }
            for e in 0..3 {
                let Some(flap) = Flap::across(mesh, self.adjacency, t, e) else { continue };
                // Where the vertex is in both triangles the flap is met twice.
                let in_both = vertex != flap.vertices[2] || vertex == flap.vertices[3];
                if in_both && !flap.is_owner() {
                    continue;
                }
                if regularizer == Regularizer::EdgePrinted
                    && let Some(element) = flap.printed(mesh)
                {
                    row.add_element(&element, alpha);
                }
                if !(ours || edge) {
                    continue;
                }
                let (j, k) = ((e + 1) % 3, (e + 2) % 3);
                let across = mesh.positions[flap.vertices[3] as usize].as_dvec3();
                let Some((coefficients, measure, smoothness)) =
                    unfolded([places[e], places[j], places[k], across], normal)
                else {
                    continue;
                };
                let mut weight = if edge { alpha * measure * smoothness } else { 0.0 };
                if ours {
                    let deficit = flap.vertices.iter().map(|&v| self.deficit[v as usize]).fold(0.0, f32::max);
                    let seen = self.observed.count(flap.first) + self.observed.count(flap.second);
                    let few = (ENOUGH / f64::from(seen.max(1))).min(1.0).powi(3);
                    let tie = (DAMPING * f64::from(deficit).max(few)).max(EDGE_TIE);
                    weight += tie * (measure + AREA_FLOOR * EDGE_TIE * unit);
                }
                let mut here = 0.0;
                for (&v, c) in flap.vertices.iter().zip(coefficients) {
                    here += if v == vertex { c } else { 0.0 };
                }
                here *= weight;
                let slots = [slots[e], slots[j], slots[k], row.slot(flap.vertices[3])];
                for (slot, c) in slots.into_iter().zip(coefficients) {
                    row.add(slot, here * c);
                }
            }
        }
    }
}

/// One row while it is gathered.
#[derive(Default)]
struct Accumulator {
    vertex: u32,
    entries: Vec<(u32, f64)>,
}

impl Accumulator {
    /// Rows up to this long are searched, longer ones sorted at the end.
    const SEARCHED: usize = 64;

    fn start(&mut self, vertex: u32) {
        self.vertex = vertex;
        self.entries.clear();
        self.entries.push((vertex, 0.0));
    }

    /// Where entries of a column go; the vertex itself has slot 0.
    #[inline]
    fn slot(&mut self, column: u32) -> usize {
        if self.entries.len() <= Self::SEARCHED
            && let Some(found) = self.entries.iter().position(|e| e.0 == column)
        {
            return found;
        }
        self.entries.push((column, 0.0));
        self.entries.len() - 1
    }

    #[inline]
    fn add(&mut self, slot: usize, entry: f64) {
        self.entries[slot].1 += entry;
    }

    /// Adds this row's share of `scale` times an element.
    #[inline]
    fn add_element(&mut self, element: &Element, scale: f64) {
        let mut here = DVec3::ZERO;
        for (v, c) in element.vertices.iter().zip(element.coefficients) {
            if *v == self.vertex {
                here += c;
            }
        }
        here *= scale * element.weight;
        for (&v, c) in element.vertices.iter().zip(element.coefficients) {
            let slot = self.slot(v);
            self.add(slot, here.dot(c));
        }
    }

    /// Sorts by column and joins equal columns.
    fn finish(&mut self) {
        self.entries.sort_by_key(|e| e.0);
        self.entries.dedup_by(|later, first| {
            let same = later.0 == first.0;
            if same {
                first.1 += later.1;
            }
            same
        });
    }
}
