//! The quadratic terms of the fit, one small element at a time: gradient and edge regularizers
//! (Kavan 2011, eq. 10-13), the edge term of ours, and the ties that hold what no observation sees.
//!
//! Every element is `weight · |Σ cᵢ xᵢ|²` over three or four vertices, with `weight` in units of area, so that
//! scaling a mesh scales the data and all terms alike.

use glam::DVec3;
use lightkiln_mesh::{Adjacency, EdgeKind, Mesh, TriangleId};

/// One quadratic term: `weight · |Σ coefficients[i] · x[vertices[i]]|²`. A vertex may be named twice.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Element {
    pub vertices: [u32; 4],
    pub coefficients: [DVec3; 4],
    pub weight: f64,
}

/// Four vertices around an interior edge: the edge `i`-`j`, and the corners opposite to it.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Flap {
    pub first: TriangleId,
    pub second: TriangleId,
    /// `i`, `j`, the corner of `first` opposite to the edge, the corner of `second` opposite to it.
    pub vertices: [u32; 4],
}

impl Flap {
    /// The flap over edge `edge` of `triangle`, if that edge is an interior one between two triangles.
    #[inline]
    pub fn across(mesh: &Mesh, adjacency: &Adjacency, triangle: TriangleId, edge: usize) -> Option<Self> {
        let EdgeKind::Interior { triangle: other, edge: other_edge } = adjacency.across(triangle, edge)
        else {
            return None;
        };
        if other == triangle {
            return None;
        }
        let corners = mesh.triangles[triangle.index()];
        let opposite = mesh.triangles[other.index()][(other_edge as usize + 2) % 3];
        let [i, j, k] = [corners[edge], corners[(edge + 1) % 3], corners[(edge + 2) % 3]];
        Some(Self { first: triangle, second: other, vertices: [i.0, j.0, k.0, opposite.0] })
    }

    /// Whether this side speaks for the flap where both sides are met: the triangle with the lower number.
    #[inline]
    pub fn is_owner(&self) -> bool {
        self.first < self.second
    }

    #[inline]
    fn positions(&self, mesh: &Mesh) -> [DVec3; 4] {
        self.vertices.map(|v| mesh.positions[v as usize].as_dvec3())
    }

    /// Our edge term: how far the value where the segment between the opposite corners crosses the edge,
    /// after unfolding the two triangles into one plane, is from the edge's own value there.
    ///
    /// With heights `h` and feet `s` of the opposite corners over the edge, the jump of the normal derivative
    /// is `r / (h₁ h₂ / (h₁ + h₂))` with `r = c₁ x_k + c₂ x_l - (1 - s) x_i - s x_j`, `c₁ = h₂ / (h₁ + h₂)`,
    /// `c₂ = h₁ / (h₁ + h₂)`, `s = c₁ s₁ + c₂ s₂`. The term is `r²` times the harmonic mean of the areas, with
    /// the factor that makes it equal to eq. 13 on two equal equilateral triangles in one plane.
    ///
    /// Deviation from eq. 13: both gradients are scaled alike, and compared after unfolding, so that linear
    /// functions cost nothing; coefficients never exceed 1 and the weight never exceeds 16 / √3 ≈ 9.2
    /// times the smaller area, so that slivers neither blow up the term nor the condition of the system.
    ///
    /// This is the term without what [`unfolded`] says of folds.
    #[inline]
    pub fn unfolded(&self, mesh: &Mesh) -> Option<Element> {
        let places = self.positions(mesh);
        let [i, j, k, _] = places;
        let (row, weight, _) = unfolded(places, (j - i).cross(k - i))?;
        let coefficients = row.map(|c| DVec3::new(c, 0.0, 0.0));
        Some(Element { vertices: self.vertices, coefficients, weight })
    }

    /// The edge term as printed: `(a_t + a_u) |√a_t ∇g_t - √a_u ∇g_u|²` (eq. 13), gradients as vectors of space.
    /// `None` where either triangle has no area and thus no gradient.
    #[inline]
    pub fn printed(&self, mesh: &Mesh) -> Option<Element> {
        let [i, j, k, l] = self.positions(mesh);
        let first = scaled_gradients([i, j, k])?;
        let second = scaled_gradients([j, i, l])?;
        let coefficients = [first.0[0] - second.0[1], first.0[1] - second.0[0], first.0[2], -second.0[2]];
        Some(Element { vertices: self.vertices, coefficients, weight: first.1 + second.1 })
    }
}

/// Coefficients and weight of [`Flap::unfolded`] from the places of `i`, `j`, `k`, `l` and the normal of `i j k`, as long as
/// twice its area; and the smoothness of the edge: the cosine of the fold, 0 from a right angle on.
///
/// A regularizer weighs an edge by its smoothness: where the surface folds the light has a kink too, and taking that
/// away is no smoothing but an error (measured in `docs/KAVAN.md`).
#[inline]
pub(crate) fn unfolded([i, j, k, l]: [DVec3; 4], normal_k: DVec3) -> Option<([f64; 4], f64, f64)> {
    const EQUAL_TO_PRINTED_ON_EQUILATERAL: f64 = 2.309_401_076_758_503; // 4 / √3
    let edge = j - i;
    let length2 = edge.length_squared();
    if length2 <= 0.0 {
        return None;
    }
    let normal_l = (l - i).cross(edge);
    let (area_k, area_l) = (normal_k.length(), normal_l.length());
    let sum = area_k + area_l; // twice the areas: the heights up to a common factor
    if sum <= 0.0 {
        return None;
    }
    let (from_k, from_l) = (area_l / sum, area_k / sum);
    let s = (from_k * edge.dot(k - i) + from_l * edge.dot(l - i)) / length2;
    let scale = 1.0 / s.abs().max((1.0 - s).abs()).max(1.0);
    let row = [(s - 1.0) * scale, -s * scale, from_k * scale, from_l * scale];
    let product = area_k * area_l;
    let smoothness = if product > 0.0 { (normal_k.dot(normal_l) / product).clamp(0.0, 1.0) } else { 0.0 };
    Some((row, EQUAL_TO_PRINTED_ON_EQUILATERAL * 2.0 * product / sum, smoothness))
}

/// `√a ∇h` of the three hat functions, and the area `a` (eq. 11). `None` for a triangle without area.
fn scaled_gradients([a, b, c]: [DVec3; 3]) -> Option<([DVec3; 3], f64)> {
    let double_area_vector = (b - a).cross(c - a);
    let double_area = double_area_vector.length();
    // Below this, rounding of the corners decides the direction of the gradient.
    let longest2 = (b - a).length_squared().max((c - b).length_squared()).max((a - c).length_squared());
    if double_area <= 1e-12 * longest2 || double_area <= f64::MIN_POSITIVE {
        return None;
    }
    let unit = double_area_vector / double_area;
    let area = 0.5 * double_area;
    let factor = 1.0 / (2.0 * area.sqrt());
    Some(([c - b, a - c, b - a].map(|edge| unit.cross(edge) * factor), area))
}

/// The gradient term of a triangle, `a_t |√a_t ∇g_t|²` (eq. 12): its entry for two corners is a quarter of
/// the scalar product of the edges opposite to them, which needs no division and no area.
#[inline]
pub(crate) fn gradient(mesh: &Mesh, triangle: TriangleId) -> Element {
    let [a, b, c] = mesh.corners(triangle).map(glam::Vec3::as_dvec3);
    let [i, j, k] = mesh.triangles[triangle.index()].map(|v| v.0);
    Element { vertices: [i, j, k, k], coefficients: [c - b, a - c, b - a, DVec3::ZERO], weight: 0.25 }
}
