//! Observations sorted by triangle, with those that say nothing (weight 0, not finite) left out.

use lightkiln_mesh::{Mesh, SurfacePoint, TriangleId};
use rayon::prelude::*;

use crate::FitError;

/// Observations looked at by one thread at a time.
const CHUNK: usize = 4096;

/// Values of the signal at points of the surface.
#[derive(Clone, Copy, Debug)]
pub struct Observations<'a> {
    /// Where: S points, in any order.
    pub points: &'a [SurfacePoint],
    /// The surface area that each point stands for: S; 0 is ignored.
    pub weights: &'a [f32],
    /// What was seen there: S × C, linear.
    pub values: &'a [f32],
    /// C, at least 1.
    pub channels: usize,
}

/// Observations that count, in rows of one triangle each.
pub(crate) struct ByTriangle<'a> {
    all: Observations<'a>,
    starts: Vec<u32>,
    order: Vec<u32>,
    pub not_finite: usize,
    pub ignored: usize,
}

/// One observation as the assembly sees it.
#[derive(Clone, Copy)]
pub(crate) struct Seen {
    pub index: u32,
    pub weight: f64,
    pub barycentric: [f64; 3],
}

impl<'a> ByTriangle<'a> {
    pub fn new(mesh: &Mesh, all: Observations<'a>) -> Result<Self, FitError> {
        let (points, channels) = (all.points.len(), all.channels);
        if channels == 0
            || all.weights.len() != points
            || Some(all.values.len()) != points.checked_mul(channels)
        {
            return Err(FitError::Observations {
                points,
                weights: all.weights.len(),
                values: all.values.len(),
                channels,
            });
        }
        if points >= u32::MAX as usize {
            return Err(FitError::TooLarge { count: points });
        }
        let triangles = mesh.triangle_count();
        let finite: Vec<bool> = (all.points, all.weights, all.values.par_chunks_exact(channels))
            .into_par_iter()
            .with_min_len(CHUNK)
            .map(|(point, weight, values)| {
                weight.is_finite()
                    && point.barycentric.iter().all(|b| b.is_finite())
                    && values.iter().fold(true, |all, v| all & v.is_finite())
            })
            .collect();
        let (mut not_finite, mut ignored) = (0, 0);
        let mut starts = vec![0_u32; triangles + 1];
        let mut sorted = true;
        let mut last = 0;
        let mut counts = Vec::with_capacity(points);
        for (index, (point, finite)) in all.points.iter().zip(finite).enumerate() {
            let triangle = point.triangle.index();
            if triangle >= triangles {
                return Err(FitError::Triangle { observation: index, triangle, triangles });
            }
            let weight = all.weights[index];
            not_finite += usize::from(!finite);
            ignored += usize::from(finite && weight <= 0.0);
            let counted = finite && weight > 0.0;
            counts.push(counted);
            if counted {
                sorted &= triangle >= last;
                last = triangle;
                starts[triangle + 1] += 1;
            }
        }
        for t in 0..triangles {
            starts[t + 1] += starts[t];
        }
        let mut order;
        if sorted {
            order = (0..points as u32).filter(|&i| counts[i as usize]).collect();
        } else {
            order = vec![0; starts[triangles] as usize];
            let mut fill = starts.clone();
            for index in (0..points).filter(|&i| counts[i]) {
                let at = &mut fill[all.points[index].triangle.index()];
                order[*at as usize] = index as u32;
                *at += 1;
            }
        }
        Ok(Self { all, starts, order, not_finite, ignored })
    }

    /// How many observations count.
    pub fn len(&self) -> usize {
        self.order.len()
    }

    pub fn channels(&self) -> usize {
        self.all.channels
    }

    /// How many observations a triangle has.
    #[inline]
    pub fn count(&self, triangle: TriangleId) -> u32 {
        self.starts[triangle.index() + 1] - self.starts[triangle.index()]
    }

    /// The observations in a triangle, in the order of the caller.
    #[inline]
    pub fn in_triangle(&self, triangle: TriangleId) -> impl ExactSizeIterator<Item = Seen> + '_ {
        let t = triangle.index();
        self.order[self.starts[t] as usize..self.starts[t + 1] as usize].iter().map(|&index| {
            let [u, v] = self.all.points[index as usize].barycentric.map(f64::from);
            Seen {
                index,
                weight: f64::from(self.all.weights[index as usize]),
                barycentric: [1.0 - u - v, u, v],
            }
        })
    }

    /// All values of one observation.
    #[inline]
    pub fn values(&self, index: u32) -> &[f32] {
        let at = index as usize * self.all.channels;
        &self.all.values[at..at + self.all.channels]
    }
}
