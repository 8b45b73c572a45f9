//! What each profile can hold (docs/PROFILES.md), found out before anything is traced.

use lightkiln_light::{Domain, Layer};
use lightkiln_mesh::TriangleId;
use lightkiln_scene::{Profile, Scene, Slot};

use crate::lighting::{AuthoredOcclusion, LightOptions};
use crate::options::{BakeBounds, BakeOptions, Plan};
use crate::{BakeError, Surface};

impl BakeOptions {
    /// Which light there is and what it meets, with what becomes of occlusion that the file has already: decided only
    /// where materials show ours.
    ///
    /// # Errors
    /// [`BakeError::Profile`] for a choice about materials in a profile that leaves them alone.
    pub(crate) fn light_of_profile(&self) -> Result<LightOptions, BakeError> {
        let asked = self.light.authored_occlusion;
        let shows_occlusion = self.profile.is_plain() && self.signals.has_scalar();
        if asked.is_some() && !shows_occlusion {
            let what = "a choice of --authored-occlusion: materials do not show this light as occlusion";
            let remedy =
                "choose --profile stock or lightmap with --signal ao, or leave --authored-occlusion away";
            return Err(self.refused(what, remedy));
        }
        let authored_occlusion = shows_occlusion.then(|| asked.unwrap_or_default());
        Ok(LightOptions { authored_occlusion, ..self.light.clone() })
    }

    /// Refuses layers and options that the profile has no room for.
    ///
    /// # Errors
    /// [`BakeError::Profile`].
    pub(crate) fn check_profile(&self, layers: &[Layer]) -> Result<(), BakeError> {
        if !self.profile.is_plain() {
            return Ok(());
        }
        if self.table {
            return Err(self.refused("a table", "leave --table away: no vertex names a color"));
        }
        if self.bounds == BakeBounds::ClampAfter {
            return Err(self.refused("values to be clamped later", "choose --bounds clamp or optimum"));
        }
        let is_scalar = |l: &&Layer| l.channels == 1 && matches!(l.domain, Domain::Bounded { .. });
        let is_light = |l: &&Layer| l.channels == 3 && l.domain == Domain::Hdr;
        let scalars = layers.iter().filter(is_scalar).count();
        let lights = layers.iter().filter(is_light).count();
        let known = scalars + lights == layers.len();
        match self.profile {
            Profile::Stock if !(known && scalars == 1 && lights == 0) => Err(self.refused(
                &format!("{}: it has room for one layer of one channel", self.signals),
                "choose --signal ao, shadow or occlusion, or --profile eta or lightmap",
            )),
            Profile::Lightmap if !(known && scalars <= 1 && lights <= 1) => Err(self.refused(
                &format!("{}: materials show one occlusion and one light in lux", self.signals),
                "choose one of ao, shadow and occlusion, one of lightmap, direct and indirect, or --profile eta",
            )),
            _ => Ok(()),
        }
    }

    fn refused(&self, what: &str, remedy: &'static str) -> BakeError {
        BakeError::Profile { profile: self.profile.name(), what: what.to_owned(), remedy }
    }
}

/// What is worth a word of occlusion that the file has already.
///
/// # Errors
/// [`BakeError::Scene`] for images that cannot be read.
pub(crate) fn remarks(surface: &Surface<'_>, plan: &Plan) -> Result<Vec<String>, BakeError> {
    match plan.light.authored_occlusion {
        Some(AuthoredOcclusion::MultiplyCoarse) => {
            Ok(finer_than_texels(surface, plan)?.into_iter().collect())
        }
        Some(AuthoredOcclusion::Keep) => Ok(kept(surface.scene).into_iter().collect()),
        Some(AuthoredOcclusion::Multiply | AuthoredOcclusion::Replace) | None => Ok(Vec::new()),
    }
}

/// The primitives that keep their own occlusion.
fn kept(scene: &Scene) -> Option<String> {
    let own = |part| scene.has_occlusion_textures(part).into_iter().filter(|has| *has).count();
    let kept: usize = (0..scene.parts.len()).map(own).sum();
    (kept > 0).then(|| {
        format!(
            "{kept} primitives keep the occlusion textures of their materials and show none of this light"
        )
    })
}

/// Whether the occlusion textures of the file have more detail than the texels of this bake can hold.
fn finer_than_texels(surface: &Surface<'_>, plan: &Plan) -> Result<Option<String>, BakeError> {
    let Some(textures) = surface.scene.textures(Slot::Occlusion)? else { return Ok(None) };
    let of_triangle = |t: TriangleId| {
        let (part, triangle) = surface.part_of(t);
        Some((surface.mesh.area(t), f64::from(textures.texels(part, triangle)?)))
    };
    let sum = |a: (f64, f64), b: (f64, f64)| (a.0 + b.0, a.1 + b.1);
    let (area, texels) = surface.mesh.triangle_ids().filter_map(of_triangle).fold((0.0, 0.0), sum);
    let width = (area / texels) as f32;
    let width = width.sqrt();
    Ok((width < plan.radius).then(|| {
        format!(
            "the occlusion textures of the file have texels of {width:.5} on the average, finer than those of this \
             bake, {:.5}: detail between them is lost where the errors below say so; --authored-occlusion \
             multiply keeps it, as --detail {:.5} does, keep leaves these materials alone",
            plan.radius,
            2.0 * width
        )
    }))
}
