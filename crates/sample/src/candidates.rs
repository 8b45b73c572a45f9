//! Stratified candidates for Poisson-disk samples.
//!
//! Two sets. *Area* candidates stand systematically along the cumulative area of each sheet's triangles, about
//! six per squared radius, and follow a low-discrepancy sequence within a triangle (Roberts' R2, a Kronecker
//! sequence in two dimensions). *Piece* candidates come after them: each triangle is cut at its longest edge
//! until no edge is longer than the radius, and each piece has one. A rejected piece candidate has a sample
//! within the radius, and any point of its piece is no further from it than the radius: hence no point of the
//! surface is more than two radii from a sample, on needles and wires too, where area candidates are rare.

use glam::{DVec3, Vec3};
use lightkiln_mesh::{Mesh, TriangleId, random};
use rayon::prelude::*;

use crate::{MAX_CANDIDATES, SampleError, SampleOptions};

/// Area candidates per squared radius.
const AREA_CANDIDATES: f64 = 6.0;
/// Piece candidates are numbered from here on.
pub(crate) const FIRST_PIECE: u32 = 1 << 31;
/// Sheets are taken together until they have this many candidates.
const GROUP_CANDIDATES: u64 = 6_000_000;

/// Distinguishes the random numbers of this crate that are keyed by the same triangle and number.
#[derive(Clone, Copy)]
pub(crate) enum Stream {
    Origin = 1,
    Along,
    Inside,
    Piece,
    Priority,
    Fresh,
}

impl Stream {
    pub(crate) fn hash(self, seed: u64, a: u64, b: u64) -> u64 {
        random::hash(seed, a, b, self as u64)
    }
}

/// The triangles that have an area, sheet by sheet, and their cumulative area.
pub(crate) struct Surface {
    /// Ascending by sheet, then by triangle.
    pub triangles: Vec<u32>,
    /// Area before each of `triangles`, and the total at the end.
    pub cumulative: Vec<f64>,
}

impl Surface {
    pub fn new(mesh: &Mesh, sheet_of: &[u32]) -> Self {
        let mut sized: Vec<(u32, u32, f64)> = (0..mesh.triangle_count() as u32)
            .into_par_iter()
            .map(|t| (sheet_of[t as usize], t, mesh.area(TriangleId(t))))
            .filter(|&(_, _, area)| area > 0.0)
            .collect();
        sized.par_sort_unstable_by_key(|&(sheet, t, _)| (sheet, t));
        let mut sum = 0.0;
        let mut cumulative = Vec::with_capacity(sized.len() + 1);
        cumulative.push(0.0);
        cumulative.extend(sized.iter().map(|&(_, _, area)| {
            sum += area;
            sum
        }));
        Self { triangles: sized.iter().map(|&(_, t, _)| t).collect(), cumulative }
    }

    pub fn area(&self) -> f64 {
        self.cumulative[self.triangles.len()]
    }
}

/// Point `n` of the R2 sequence shifted by a random offset, in the unit square.
pub(crate) fn r2(offset: u64, n: u32) -> [f32; 2] {
    // Fixed point: 2^32 times 1/g and 1/g^2, where g^3 = g + 1.
    let x = (offset as u32).wrapping_add(n.wrapping_mul(3_242_174_889));
    let y = ((offset >> 32) as u32).wrapping_add(n.wrapping_mul(2_447_445_414));
    [x, y].map(|w| (w >> 8) as f32 * (1.0 / 16_777_216.0))
}

/// One candidate, with the place in the grid that it is sorted by.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Candidate {
    pub block: u64,
    pub sheet: u32,
    pub triangle: u32,
    pub number: u32,
    pub barycentric: [f32; 2],
}

/// How candidates are laid out: checked limits, groups of sheets, and the grid of cells one radius wide.
pub(crate) struct Plan {
    pub seed: u64,
    pub radius: f32,
    /// Ranges of `Surface::triangles`; no sheet is in two of them.
    pub groups: Vec<std::ops::Range<usize>>,
    origin: DVec3,
    cells_per_unit: f64,
    /// Shift of the systematic sequence along the cumulative area, `0..1`.
    along: f64,
    candidates_per_area: f64,
}

impl Plan {
    pub fn new(
        mesh: &Mesh,
        sheet_of: &[u32],
        surface: &Surface,
        options: &SampleOptions,
    ) -> Result<Self, SampleError> {
        let radius = f64::from(options.radius);
        let SampleOptions { seed, .. } = *options;
        let check = |candidates: f64| {
            if candidates <= MAX_CANDIDATES as f64 {
                Ok(())
            } else {
                let candidates = candidates.min(u64::MAX as f64) as u64;
                Err(SampleError::TooMany { radius: options.radius, candidates, limit: MAX_CANDIDATES })
            }
        };
        // Area and longest edge bound the number of pieces from below; checked first, so that counting the
        // pieces themselves ends.
        let candidates_per_area = AREA_CANDIDATES / (radius * radius);
        let edges: Vec<f64> = surface
            .triangles
            .par_iter()
            .map(|&t| (longest_edge(&mesh.corners(TriangleId(t)).map(Vec3::as_dvec3)).1 / radius).ceil())
            .collect();
        check(surface.area() * candidates_per_area * 1.7)?;
        check(edges.iter().sum())?;
        drop(edges);

        let along = f64::from(random::unit(Stream::Along.hash(seed, 0, 0)));
        let shift = random::unit2(Stream::Origin.hash(seed, 0, 0));
        let shift = DVec3::new(f64::from(shift[0]), f64::from(shift[1]), f64::from(shift[0] * shift[1]));
        let mut plan = Self {
            seed,
            radius: options.radius,
            groups: Vec::new(),
            // A random shift keeps vertices at round coordinates off the walls between cells.
            origin: mesh.bounds().0.as_dvec3() - shift * radius,
            cells_per_unit: 1.0 / radius,
            along,
            candidates_per_area,
        };
        let counts: Vec<u32> = (0..surface.triangles.len())
            .into_par_iter()
            .map(|i| {
                let area = plan.area_candidates(surface, i);
                area + plan.pieces(mesh, surface.triangles[i], area, |_, _| {})
            })
            .collect();
        check(counts.iter().map(|&n| f64::from(n)).sum())?;
        plan.groups = groups(surface, sheet_of, &counts);
        Ok(plan)
    }

    /// The cell of the grid that a position lies in.
    pub fn cell(&self, position: Vec3) -> [i64; 3] {
        let p = (position.as_dvec3() - self.origin) * self.cells_per_unit;
        [p.x.floor() as i64, p.y.floor() as i64, p.z.floor() as i64]
    }

    /// Number of area candidates of the `i`-th sized triangle.
    fn area_candidates(&self, surface: &Surface, i: usize) -> u32 {
        let before = |j: usize| (surface.cumulative[j] * self.candidates_per_area + self.along).floor();
        (before(i + 1) - before(i)) as u32
    }

    /// Visits the piece candidates of a triangle, `(number, barycentric)`, and returns how many there are.
    fn pieces(
        &self,
        mesh: &Mesh,
        triangle: u32,
        area_candidates: u32,
        mut visit: impl FnMut(u32, [f32; 2]),
    ) -> u32 {
        let corners = mesh.corners(TriangleId(triangle)).map(Vec3::as_dvec3);
        let limit = f64::from(self.radius);
        if area_candidates > 0 && longest_edge(&corners).1 <= limit {
            return 0; // any of its area candidates does the work of its only piece
        }
        let mut number = FIRST_PIECE;
        let unit = [DVec3::X, DVec3::Y, DVec3::Z];
        cut(&corners, &unit, limit, 0, &mut |weights: &[DVec3; 3]| {
            let hash = Stream::Piece.hash(self.seed, u64::from(triangle), u64::from(number));
            let [u, v] = random::square_to_triangle(random::unit2(hash));
            let at =
                weights[0] * f64::from(1.0 - u - v) + weights[1] * f64::from(u) + weights[2] * f64::from(v);
            visit(number, inside([at.y as f32, at.z as f32]));
            number += 1;
        });
        number - FIRST_PIECE
    }

    /// All candidates of a group of sheets, in no particular order.
    pub fn candidates(
        &self,
        mesh: &Mesh,
        sheet_of: &[u32],
        surface: &Surface,
        group: std::ops::Range<usize>,
    ) -> Vec<Candidate> {
        group
            .into_par_iter()
            .fold(Vec::new, |mut list, i| {
                let triangle = surface.triangles[i];
                let id = TriangleId(triangle);
                let mut push = |number: u32, barycentric: [f32; 2]| {
                    let position = mesh.position(lightkiln_mesh::SurfacePoint { triangle: id, barycentric });
                    let block = crate::poisson::block_of(self.cell(position));
                    let sheet = sheet_of[triangle as usize];
                    list.push(Candidate { block, sheet, triangle, number, barycentric });
                };
                let count = self.area_candidates(surface, i);
                let offset = Stream::Inside.hash(self.seed, u64::from(triangle), 0);
                for n in 0..count {
                    push(n, random::square_to_triangle(r2(offset, n)));
                }
                self.pieces(mesh, triangle, count, push);
                list
            })
            .reduce(Vec::new, |mut a, mut b| {
                if a.len() < b.len() {
                    std::mem::swap(&mut a, &mut b); // order is of no matter, they are sorted
                }
                a.append(&mut b);
                a
            })
    }
}

/// Ranges of sized triangles that hold whole sheets, with about [`GROUP_CANDIDATES`] each.
fn groups(surface: &Surface, sheet_of: &[u32], counts: &[u32]) -> Vec<std::ops::Range<usize>> {
    let mut groups = Vec::new();
    let (mut start, mut held) = (0, 0_u64);
    let sheet = |i: usize| sheet_of[surface.triangles[i] as usize];
    for (i, &count) in counts.iter().enumerate() {
        if held >= GROUP_CANDIDATES && sheet(i) != sheet(i - 1) {
            groups.push(start..i);
            (start, held) = (i, 0);
        }
        held += u64::from(count);
    }
    if start < counts.len() {
        groups.push(start..counts.len());
    }
    groups
}

/// Number and length of the longest edge; edge `e` runs from corner `e` to the next.
fn longest_edge(corners: &[DVec3; 3]) -> (usize, f64) {
    let mut longest = (0, 0.0);
    for e in 0..3 {
        let length = corners[e].distance_squared(corners[(e + 1) % 3]);
        if length > longest.1 {
            longest = (e, length);
        }
    }
    (longest.0, longest.1.sqrt())
}

/// Cuts a triangle at its longest edge until no edge is longer than `limit`; visits the pieces' corners as
/// weights of the original corners. The depth is bounded: each two cuts halve the longest edge or better.
fn cut(
    corners: &[DVec3; 3],
    weights: &[DVec3; 3],
    limit: f64,
    depth: u32,
    visit: &mut impl FnMut(&[DVec3; 3]),
) {
    let (edge, length) = longest_edge(corners);
    if length <= limit || depth >= 96 {
        return visit(weights);
    }
    let (a, b, c) = (edge, (edge + 1) % 3, (edge + 2) % 3);
    let middle = corners[a].midpoint(corners[b]);
    let weight = weights[a].midpoint(weights[b]);
    for end in [a, b] {
        // The order of corners is kept, so that both halves face the same way.
        let half = |p: &[DVec3; 3], m: DVec3| if end == a { [p[a], m, p[c]] } else { [m, p[b], p[c]] };
        cut(&half(corners, middle), &half(weights, weight), limit, depth + 1, visit);
    }
}

/// Brings barycentric coordinates back where rounding took them out of the triangle.
fn inside([u, v]: [f32; 2]) -> [f32; 2] {
    let u = u.clamp(0.0, 1.0);
    [u, v.clamp(0.0, 1.0 - u)]
}
