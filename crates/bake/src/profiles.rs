//! What each profile can hold (docs/PROFILES.md), found out before anything is traced.

use lightkiln_light::{Domain, Layer};
use lightkiln_scene::Profile;

use crate::BakeError;
use crate::lighting::LightOptions;
use crate::options::{BakeBounds, BakeOptions};

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
