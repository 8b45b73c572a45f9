//! The half box without a single sample: its light by Lambert's formula, its vertex values and errors by
//! quadrature (Kavan 2011, eq. 1 and 3-8). Used by the test `half_box` and by the example that draws
//! docs/half_box.svg.

use glam::{DVec3, Vec3};
use lightkiln_light::analytic::polygon_occlusion;
use lightkiln_mesh::{Mesh, SurfacePoint};

/// What a vertex of a square is: the corner that all squares share, one of its two neighbours in the square, or
/// the corner opposite to it. The discriminants count them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Place {
    Corner,
    Neighbour,
    Far,
}

/// The square in the plane where coordinate `k` is 0.
fn square(k: usize) -> [Vec3; 4] {
    let axis = |i: usize| Vec3::from_array([0, 1, 2].map(|c| if c == i % 3 { 1.0 } else { 0.0 }));
    let (a, b) = (axis(k + 1), axis(k + 2));
    [Vec3::ZERO, a, a + b, b]
}

/// The open share of the hemisphere over a place on the square of plane `k`: what the two others leave.
fn openness_on(k: usize, place: Vec3) -> f64 {
    let normal = Vec3::from_array([0, 1, 2].map(|c| if c == k { 1.0 } else { 0.0 }));
    1.0 - [1, 2].map(|other| polygon_occlusion(place, normal, &square((k + other) % 3))).iter().sum::<f64>()
}

/// The plane that a triangle of the half box lies in.
fn plane(mesh: &Mesh, point: SurfacePoint) -> usize {
    let normal = mesh.geometric_normal(point.triangle).to_array();
    (0..3).find(|&k| normal[k] > 0.999).expect("the squares face along the axes")
}

/// Ambient occlusion at a point of the half box, distance unbounded.
pub fn openness(mesh: &Mesh, point: SurfacePoint) -> f64 {
    openness_on(plane(mesh, point), mesh.position(point))
}

/// The same at every point, in single precision, as observations.
pub fn observed(mesh: &Mesh, points: &[SurfacePoint]) -> Vec<f32> {
    points.iter().map(|&p| openness(mesh, p) as f32).collect()
}

/// What each vertex is.
pub fn places(mesh: &Mesh) -> Vec<Place> {
    let place = |p: &Vec3| match p.element_sum().round() as u32 {
        0 => Place::Corner,
        1 => Place::Neighbour,
        _ => Place::Far,
    };
    mesh.positions.iter().map(place).collect()
}

/// A node of the quadrature.
struct Node {
    corners: [usize; 3],
    weights: [f64; 3],
    area: f64,
    openness: f64,
}

/// The half box integrated.
pub struct Exact {
    nodes: Vec<Node>,
    /// Gram matrix (eq. 4), right-hand side (eq. 5) and the integral of each hat.
    mass: Vec<Vec<f64>>,
    rhs: Vec<f64>,
    hats: Vec<f64>,
    /// The four vertices of each square: the two on the diagonal, then the other two.
    flaps: Vec<[usize; 4]>,
}

impl Exact {
    /// Integrates with `order` squared Gauss points in each sixth of a triangle.
    ///
    /// The light depends on the *direction* from which a corner is approached, so each triangle is cut at its
    /// middle and at the middles of its edges into six pieces with one corner each, and each piece is
    /// integrated as a square that is collapsed there: then the integrand is smooth.
    pub fn new(mesh: &Mesh, order: usize) -> Self {
        let rule = gauss(order);
        let mut nodes = Vec::new();
        for triangle in mesh.triangle_ids() {
            let ids = mesh.triangles[triangle.index()].map(|v| v.index());
            let places = mesh.corners(triangle).map(Vec3::as_dvec3);
            let k = plane(mesh, SurfacePoint { triangle, barycentric: [0.3; 2] });
            for i in 0..3 {
                for side in [1, 2] {
                    let mut edge = [0.0; 3];
                    (edge[i], edge[(i + side) % 3]) = (0.5, 0.5);
                    for &(r, by_r) in &rule {
                        for &(w, by_w) in &rule {
                            let mut weights = edge.map(|e| r * (w * e + (1.0 - w) / 3.0));
                            weights[i] += 1.0 - r;
                            let place: DVec3 = places.iter().zip(weights).map(|(&p, w)| p * w).sum();
                            nodes.push(Node {
                                corners: ids,
                                weights,
                                // A sixth of the triangle, twice that as a parallelogram, times the collapse.
                                area: mesh.area(triangle) / 3.0 * r * by_r * by_w,
                                openness: openness_on(k, place.as_vec3()),
                            });
                        }
                    }
                }
            }
        }
        let count = mesh.vertex_count();
        let mut exact = Self {
            nodes,
            mass: vec![vec![0.0; count]; count],
            rhs: vec![0.0; count],
            hats: vec![0.0; count],
            flaps: flaps(mesh),
        };
        for node in &exact.nodes {
            for (&i, hat) in node.corners.iter().zip(node.weights) {
                exact.rhs[i] += node.area * hat * node.openness;
                exact.hats[i] += node.area * hat;
                for (&j, other) in node.corners.iter().zip(node.weights) {
                    exact.mass[i][j] += node.area * hat * other;
                }
            }
        }
        exact
    }

    /// The least-squares values (eq. 7), one per vertex.
    pub fn least_squares(&self) -> Vec<f64> {
        self.regularized(0.0)
    }

    /// The minimum of the same integral plus `alpha` times the edge term of `lightkiln_fit`, which on a square
    /// split into halves is `4/√3 (half the sum at the diagonal - half the sum at the others)²`.
    pub fn regularized(&self, alpha: f64) -> Vec<f64> {
        let mut matrix = self.mass.clone();
        for flap in &self.flaps {
            let row = [0.5, 0.5, -0.5, -0.5];
            for (&i, a) in flap.iter().zip(row) {
                for (&j, b) in flap.iter().zip(row) {
                    matrix[i][j] += alpha * 4.0 / 3.0_f64.sqrt() * a * b;
                }
            }
        }
        // Gauss-Seidel: converges for every positive definite matrix, and 12 unknowns are few.
        let mut values = vec![0.0; self.rhs.len()];
        for _ in 0..2000 {
            for i in 0..values.len() {
                let others: f64 =
                    (0..values.len()).filter(|&j| j != i).map(|j| matrix[i][j] * values[j]).sum();
                values[i] = (self.rhs[i] - others) / matrix[i][i];
            }
        }
        values
    }

    /// The averages (eq. 8), one per vertex.
    pub fn averages(&self) -> Vec<f64> {
        self.rhs.iter().zip(&self.hats).map(|(b, hat)| b / hat).collect()
    }

    /// The error of vertex values: eq. 1 times 100, over the area, as table 1 prints it.
    pub fn error(&self, values: &[f64]) -> f64 {
        self.mean(|openness, shown| 100.0 * (openness - shown).powi(2), values)
    }

    /// What `rays` independent rays at each sample add to the error: the mean of `p (1 - p) / rays`, times 100.
    pub fn noise_of_independent_rays(&self, rays: u32) -> f64 {
        let nothing = vec![0.0; self.rhs.len()];
        self.mean(|p, _| 100.0 * p * (1.0 - p) / f64::from(rays), &nothing)
    }

    fn mean(&self, of: impl Fn(f64, f64) -> f64, values: &[f64]) -> f64 {
        let sum: f64 = self
            .nodes
            .iter()
            .map(|n| {
                let shown = n.corners.iter().zip(n.weights).map(|(&v, w)| w * values[v]).sum();
                n.area * of(n.openness, shown)
            })
            .sum();
        sum / self.hats.iter().sum::<f64>()
    }
}

/// The two vertices that both halves of a square share, then the other two, for each square.
fn flaps(mesh: &Mesh) -> Vec<[usize; 4]> {
    let triangles: Vec<[usize; 3]> = mesh.triangles.iter().map(|t| t.map(|v| v.index())).collect();
    let mut flaps = Vec::new();
    for (n, first) in triangles.iter().enumerate() {
        for second in &triangles[n + 1..] {
            let shared: Vec<usize> = first.iter().copied().filter(|v| second.contains(v)).collect();
            if let &[i, j] = &shared[..] {
                let opposite = |t: &[usize; 3]| t.iter().sum::<usize>() - i - j;
                flaps.push([i, j, opposite(first), opposite(second)]);
            }
        }
    }
    flaps
}

/// Points and weights of Gauss and Legendre on `0..1`.
fn gauss(order: usize) -> Vec<(f64, f64)> {
    let n = order as f64;
    let legendre = |x: f64| {
        let (mut before, mut value) = (1.0, x);
        for k in 2..=order {
            let k = k as f64;
            (before, value) = (value, ((2.0 * k - 1.0) * x * value - (k - 1.0) * before) / k);
        }
        (value, n * (before - x * value) / (1.0 - x * x))
    };
    (0..order)
        .map(|i| {
            let mut x = (std::f64::consts::PI * (i as f64 + 0.75) / (n + 0.5)).cos();
            for _ in 0..20 {
                let (value, slope) = legendre(x);
                x -= value / slope;
            }
            let slope = legendre(x).1;
            (0.5 * (x + 1.0), 1.0 / ((1.0 - x * x) * slope * slope))
        })
        .collect()
}

/// The largest difference of any vertex from the exact values.
pub fn farthest(values: &[f32], exact: &[f64]) -> f64 {
    values.iter().zip(exact).map(|(&v, e)| (f64::from(v) - e).abs()).fold(0.0, f64::max)
}
