//! Who takes the noise out of light that paths bring: our own filter, Intel's, or nobody.
//!
//! Ours works on points of surfaces, so it is what samples get, whichever is chosen for texels. Open Image Denoise works on
//! images, and takes a library that is not part of the program (the feature `oidn`). How many rays are traced does
//! not depend on the choice.

use glam::Vec3;
use lightkiln_light::Estimates;
use lightkiln_light::denoise::{Noisy, denoise};
use lightkiln_mesh::SurfacePoint;
use lightkiln_texel::ChartTexels;
use rayon::prelude::*;

use crate::layers::{Layers, UnitLight};
use crate::{BakeError, Surface};

/// What filters light.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Denoiser {
    /// [`lightkiln_light::denoise`], for samples and for texels.
    #[default]
    Own,
    /// Open Image Denoise for texels; samples are filtered by our own.
    Oidn,
    /// Nothing: light as it was traced.
    None,
}

impl Denoiser {
    /// The name that the command line and the report use.
    pub fn name(self) -> &'static str {
        match self {
            Self::Own => "own",
            Self::Oidn => "oidn",
            Self::None => "none",
        }
    }

    /// Finds out before any work whether it is there.
    ///
    /// # Errors
    /// [`BakeError::NoDenoiser`].
    pub fn check(self) -> Result<(), BakeError> {
        if self == Self::Oidn { oidn::check() } else { Ok(()) }
    }

    /// What texels are measured with.
    pub fn estimates_of_texels(self, layers: &Layers, points: usize, channels: usize) -> Estimates {
        if self == Self::Oidn && layers.are_filtered() {
            Estimates::in_halves(points, channels)
        } else {
            Estimates::new(points, channels)
        }
    }

    /// The light of samples.
    ///
    /// - `radius`: of our own filter, in units of the mesh
    ///
    /// # Errors
    /// Those of [`Self::texels`].
    pub fn samples(
        self,
        surface: &Surface<'_>,
        layers: &Layers,
        points: &[SurfacePoint],
        estimates: &Estimates,
        radius: f32,
    ) -> Result<UnitLight, BakeError> {
        let normals = surface.lit_normals(points);
        if self == Self::None || !layers.are_filtered() {
            return Ok(layers.light(normals, estimates));
        }
        let positions: Vec<Vec3> = points.par_iter().map(|&p| surface.mesh.position(p)).collect();
        layers.filtered_light(normals, estimates, |noisy| {
            let noisy = Noisy {
                positions: &positions,
                normals: noisy.normals,
                values: noisy.values,
                variances: noisy.variances,
                channels: noisy.channels,
            };
            Ok(denoise(noisy, radius))
        })
    }

    /// The light of the texels with a lift, chart after chart.
    ///
    /// - `points`: those that are lifted
    /// - `estimates`: [`Self::estimates_of_texels`]
    /// - `radius`: of our own filter, in units of the mesh
    ///
    /// # Errors
    /// [`BakeError::NoDenoiser`], [`BakeError::DenoiserFailed`].
    pub fn texels(
        self,
        surface: &Surface<'_>,
        layers: &Layers,
        texels: &[ChartTexels],
        points: &[SurfacePoint],
        estimates: &Estimates,
        radius: f32,
    ) -> Result<UnitLight, BakeError> {
        if self == Self::Oidn && layers.are_filtered() {
            return oidn::texels(layers, texels, surface.lit_normals(points), estimates);
        }
        self.samples(surface, layers, points, estimates, radius)
    }
}

#[cfg(feature = "oidn")]
use crate::oidn;

/// What stands in for it in a build without the feature.
#[cfg(any(test, not(feature = "oidn")))]
mod without {
    use super::*;

    pub fn check() -> Result<(), BakeError> {
        Err(BakeError::NoDenoiser {
            why: "Open Image Denoise is not part of this build".to_owned(),
            remedy: "build with --features oidn (cargo build --release -p lightkiln-cli --features oidn), or \
                     choose --denoiser own",
        })
    }

    #[cfg(not(feature = "oidn"))]
    pub fn texels(
        _: &Layers,
        _: &[ChartTexels],
        _: Vec<Vec3>,
        _: &Estimates,
    ) -> Result<UnitLight, BakeError> {
        Err(check().expect_err("it is not part of this build"))
    }
}

#[cfg(not(feature = "oidn"))]
use without as oidn;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn oidn_that_is_not_part_of_a_build_says_how_to_build_it() {
        let error = without::check().unwrap_err();
        assert!(error.to_string().contains("not part of this build"));
        assert!(error.remedy().unwrap().contains("--features oidn"));
        assert!(Denoiser::Own.check().is_ok() && Denoiser::None.check().is_ok());
        if cfg!(not(feature = "oidn")) {
            assert_eq!(Denoiser::Oidn.check().unwrap_err().to_string(), error.to_string());
        }
    }
}
