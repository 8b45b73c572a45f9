//! The mesh itself: flat arrays with 32-bit ids.

use glam::{DVec3, Vec3};

/// A light vertex: an index into [`Mesh::positions`] and [`Mesh::normals`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
#[repr(transparent)]
pub struct VertexId(pub u32);

/// A triangle: an index into [`Mesh::triangles`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
#[repr(transparent)]
pub struct TriangleId(pub u32);

impl VertexId {
    /// The index as an array index.
    #[inline]
    pub fn index(self) -> usize {
        self.0 as usize
    }
}

impl TriangleId {
    /// The index as an array index.
    #[inline]
    pub fn index(self) -> usize {
        self.0 as usize
    }
}

/// A point of the surface: a triangle and two barycentric coordinates.
///
/// `barycentric` holds the weights of the second and third corner, each in `0..=1` with a sum of at most 1.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SurfacePoint {
    /// The triangle that the point lies in.
    pub triangle: TriangleId,
    /// Weights of the triangle's second and third corner.
    pub barycentric: [f32; 2],
}

impl SurfacePoint {
    /// The weights of all three corners; they sum to 1 up to rounding.
    #[inline]
    pub fn weights(self) -> [f32; 3] {
        let [u, v] = self.barycentric;
        [1.0 - u - v, u, v]
    }
}

/// What makes three arrays no mesh.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum MeshError {
    /// There are not as many normals as positions.
    #[error("{normals} normals for {positions} positions")]
    Normals {
        /// Number of normals.
        normals: usize,
        /// Number of positions.
        positions: usize,
    },
    /// A triangle names a vertex that does not exist.
    #[error("triangle {triangle} names vertex {vertex} of {vertices}")]
    Index {
        /// The triangle.
        triangle: usize,
        /// The vertex that it names.
        vertex: u32,
        /// How many vertices there are.
        vertices: usize,
    },
    /// A coordinate is NaN or infinite.
    #[error("vertex {vertex} has a position or normal that is not finite")]
    NotFinite {
        /// The vertex.
        vertex: usize,
    },
    /// More triangles or vertices than 32-bit ids can name.
    #[error("{count} elements do not fit 32-bit ids")]
    TooLarge {
        /// How many there are.
        count: usize,
    },
}

/// Indexed triangles in world space.
///
/// Triangles are counter-clockwise seen from the front. Degenerate triangles are allowed (they have no area
/// and no normal); every other fault is found by [`Mesh::new`].
#[derive(Clone, Debug, Default)]
pub struct Mesh {
    /// One per light vertex, in units of the file (metres, as glTF says).
    pub positions: Vec<Vec3>,
    /// One per light vertex: the shading normal, of unit length, or zero where the file gives none.
    pub normals: Vec<Vec3>,
    /// Three light vertices each.
    pub triangles: Vec<[VertexId; 3]>,
}

impl Mesh {
    /// Checks and keeps the three arrays.
    ///
    /// # Errors
    /// [`MeshError`] for arrays that do not fit each other, unknown vertices, NaN and infinity.
    pub fn new(
        positions: Vec<Vec3>,
        normals: Vec<Vec3>,
        triangles: Vec<[VertexId; 3]>,
    ) -> Result<Self, MeshError> {
        let vertices = positions.len();
        if normals.len() != vertices {
            return Err(MeshError::Normals { normals: normals.len(), positions: vertices });
        }
        let largest = vertices.max(triangles.len());
        if largest >= u32::MAX as usize {
            return Err(MeshError::TooLarge { count: largest });
        }
        if let Some(vertex) = (0..vertices).find(|&v| !positions[v].is_finite() || !normals[v].is_finite()) {
            return Err(MeshError::NotFinite { vertex });
        }
        for (triangle, corners) in triangles.iter().enumerate() {
            if let Some(bad) = corners.iter().find(|v| v.index() >= vertices) {
                return Err(MeshError::Index { triangle, vertex: bad.0, vertices });
            }
        }
        Ok(Self { positions, normals, triangles })
    }

    /// Number of light vertices.
    pub fn vertex_count(&self) -> usize {
        self.positions.len()
    }

    /// Number of triangles.
    pub fn triangle_count(&self) -> usize {
        self.triangles.len()
    }

    /// All triangles, in order.
    pub fn triangle_ids(&self) -> impl ExactSizeIterator<Item = TriangleId> + use<> {
        (0..self.triangles.len() as u32).map(TriangleId)
    }

    /// The three corner positions of a triangle.
    #[inline]
    pub fn corners(&self, triangle: TriangleId) -> [Vec3; 3] {
        self.triangles[triangle.index()].map(|v| self.positions[v.index()])
    }

    /// Twice the area times the unit normal, computed in double precision so that slivers keep theirs.
    #[inline]
    pub fn area_vector(&self, triangle: TriangleId) -> DVec3 {
        let [a, b, c] = self.corners(triangle).map(Vec3::as_dvec3);
        (b - a).cross(c - a)
    }

    /// Area in square units, 0 for a degenerate triangle.
    #[inline]
    pub fn area(&self, triangle: TriangleId) -> f64 {
        0.5 * self.area_vector(triangle).length()
    }

    /// Unit normal of the triangle's plane on its front, or zero if the triangle has no area.
    #[inline]
    pub fn geometric_normal(&self, triangle: TriangleId) -> Vec3 {
        self.area_vector(triangle).normalize_or_zero().as_vec3()
    }

    /// Position of a point on the surface.
    #[inline]
    pub fn position(&self, point: SurfacePoint) -> Vec3 {
        let [a, b, c] = self.corners(point.triangle);
        let [wa, wb, wc] = point.weights();
        a * wa + b * wb + c * wc
    }

    /// Interpolated shading normal of a point, of unit length; the geometric normal where the corners have
    /// none or cancel out. Zero only where the triangle has no area either.
    #[inline]
    pub fn shading_normal(&self, point: SurfacePoint) -> Vec3 {
        let [a, b, c] = self.triangles[point.triangle.index()].map(|v| self.normals[v.index()]);
        let [wa, wb, wc] = point.weights();
        let sum = a * wa + b * wb + c * wc;
        if sum.length_squared() > 1e-12 { sum.normalize() } else { self.geometric_normal(point.triangle) }
    }

    /// Smallest and largest corner over all positions; both zero for an empty mesh.
    pub fn bounds(&self) -> (Vec3, Vec3) {
        let mut positions = self.positions.iter();
        let Some(&first) = positions.next() else { return (Vec3::ZERO, Vec3::ZERO) };
        positions.fold((first, first), |(low, high), &p| (low.min(p), high.max(p)))
    }

    /// Sum of all triangle areas.
    pub fn total_area(&self) -> f64 {
        self.triangle_ids().map(|t| self.area(t)).sum()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn right_angle(size: f32) -> Mesh {
        let positions = vec![Vec3::ZERO, Vec3::X * size, Vec3::Y * size];
        Mesh::new(positions, vec![Vec3::Z; 3], vec![[0, 1, 2].map(VertexId)]).unwrap()
    }

    #[test]
    fn area_of_a_right_angle_is_half_the_square() {
        for size in [1e-3, 1.0, 1e3] {
            let area = right_angle(size).area(TriangleId(0));
            assert!((area / f64::from(size).powi(2) - 0.5).abs() < 1e-6);
        }
    }

    #[test]
    fn normal_of_counter_clockwise_faces_the_viewer() {
        assert_eq!(right_angle(1.0).geometric_normal(TriangleId(0)), Vec3::Z);
    }

    #[test]
    fn normal_of_a_degenerate_triangle_is_zero() {
        let mesh = Mesh::new(vec![Vec3::X; 3], vec![Vec3::ZERO; 3], vec![[0, 1, 2].map(VertexId)]).unwrap();
        assert_eq!(mesh.geometric_normal(TriangleId(0)), Vec3::ZERO);
        let point = SurfacePoint { triangle: TriangleId(0), barycentric: [0.2, 0.2] };
        assert_eq!(mesh.shading_normal(point), Vec3::ZERO);
    }

    #[test]
    fn position_of_barycentric_corners_is_exact() {
        let mesh = right_angle(2.0);
        for (barycentric, expected) in [([0.0, 0.0], Vec3::ZERO), ([1.0, 0.0], Vec3::X * 2.0)] {
            assert_eq!(mesh.position(SurfacePoint { triangle: TriangleId(0), barycentric }), expected);
        }
    }
}
