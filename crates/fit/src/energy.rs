//! What a fit costs: the error as the paper prints it, with the noise of the observations named apart, and the
//! contrast and gradient jumps that regularization trades it for.

use lightkiln_mesh::{Adjacency, Mesh};

use crate::elements::Flap;
use crate::observations::ByTriangle;
use crate::{FitError, Observations};

/// The error of one channel: `100 ∫ (f - g)² / area` (Kavan eq. 1 as table 1 prints it), over observations.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Energy {
    /// As measured, with the noise of the observations in it.
    pub measured: f64,
    /// What the observations' own variance contributes: `100 Σ w σ² / Σ w`.
    pub noise: f64,
}

impl Energy {
    /// The error without the noise: an unbiased estimate where the observations were not used in the fit,
    /// and a little too small where they were.
    pub fn of_fit(&self) -> f64 {
        self.measured - self.noise
    }
}

/// The error of vertex values against observations, per channel.
///
/// - `values`: V × C
/// - `variances`: S × C, the variance of each observed value, if known
///
/// # Errors
/// [`FitError::Observations`] for arrays that do not fit each other.
pub fn energy(
    mesh: &Mesh,
    observations: &Observations<'_>,
    variances: Option<&[f32]>,
    values: &[f32],
) -> Result<Vec<Energy>, FitError> {
    energy_shown(mesh, observations, variances, values, None)
}

/// [`energy`] where interpolated values are clamped to a range before they are shown
/// ([`crate::Bounds::ClampAfterInterpolation`]).
///
/// # Errors
/// As [`energy`].
pub fn energy_shown(
    mesh: &Mesh,
    observations: &Observations<'_>,
    variances: Option<&[f32]>,
    values: &[f32],
    shown: Option<(f32, f32)>,
) -> Result<Vec<Energy>, FitError> {
    // Not `clamp`, which refuses a range that is none.
    let (low, high) = shown.map_or((f64::NEG_INFINITY, f64::INFINITY), |(l, h)| (l.into(), h.into()));
    let observed = ByTriangle::new(mesh, *observations)?;
    let channels = observed.channels();
    if values.len() != mesh.vertex_count() * channels
        || variances.is_some_and(|v| v.len() != observations.values.len())
    {
        return Err(FitError::Values { values: values.len(), vertices: mesh.vertex_count(), channels });
    }
    let mut total = 0.0;
    let mut energies = vec![Energy::default(); channels];
    for t in mesh.triangle_ids() {
        let corners = mesh.triangles[t.index()];
        for seen in observed.in_triangle(t) {
            total += seen.weight;
            for (c, (energy, &f)) in energies.iter_mut().zip(observed.values(seen.index)).enumerate() {
                let g: f64 = corners
                    .iter()
                    .zip(seen.barycentric)
                    .map(|(v, b)| b * f64::from(values[v.index() * channels + c]))
                    .sum();
                let g = g.max(low).min(high);
                energy.measured += seen.weight * (f64::from(f) - g).powi(2);
                if let Some(variances) = variances {
                    energy.noise += seen.weight * f64::from(variances[seen.index as usize * channels + c]);
                }
            }
        }
    }
    if total > 0.0 {
        for energy in &mut energies {
            energy.measured *= 100.0 / total;
            energy.noise *= 100.0 / total;
        }
    }
    Ok(energies)
}

/// How a channel of vertex values looks, apart from its error.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Look {
    /// Standard deviation of the interpolated values over the surface.
    pub contrast: f64,
    /// Root mean square over the surface of the gradient jumps over interior edges, in units of the value (the edge
    /// term of ours, per area, folds and all).
    pub gradient_jump: f64,
}

/// Contrast and gradient jumps of vertex values, per channel.
///
/// - `values`: V × C
///
/// # Errors
/// [`FitError::Values`] if `values` does not fit the mesh.
pub fn look(
    mesh: &Mesh,
    adjacency: &Adjacency,
    values: &[f32],
    channels: usize,
) -> Result<Vec<Look>, FitError> {
    if channels == 0 || values.len() != mesh.vertex_count() * channels {
        return Err(FitError::Values { values: values.len(), vertices: mesh.vertex_count(), channels });
    }
    let area = mesh.total_area();
    if area <= 0.0 {
        return Ok(vec![Look::default(); channels]);
    }
    let looks = (0..channels).map(|c| {
        let value = |v: usize| f64::from(values[v * channels + c]);
        let (mut mean, mut square, mut jumps) = (0.0, 0.0, 0.0);
        for t in mesh.triangle_ids() {
            let a = mesh.area(t);
            let [x, y, z] = mesh.triangles[t.index()].map(|v| value(v.index()));
            mean += a * (x + y + z) / 3.0;
            square += a * (x * x + y * y + z * z + x * y + y * z + z * x) / 6.0;
            for e in 0..3 {
                let flap = Flap::across(mesh, adjacency, t, e).filter(Flap::is_owner);
                if let Some(element) = flap.and_then(|f| f.unfolded(mesh)) {
                    let r: f64 = element
                        .vertices
                        .iter()
                        .zip(element.coefficients)
                        .map(|(&v, k)| k.x * value(v as usize))
                        .sum();
                    jumps += element.weight * r * r;
                }
            }
        }
        let mean = mean / area;
        Look { contrast: (square / area - mean * mean).max(0.0).sqrt(), gradient_jump: (jumps / area).sqrt() }
    });
    Ok(looks.collect())
}
