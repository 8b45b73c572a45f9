//! Which signal is baked: the choice by name, and the signal behind it.

use std::path::PathBuf;
use std::str::FromStr;

use lightkiln_light::{AmbientOcclusion, Signal, Tracer};

use crate::options::Plan;
use crate::{BakeError, Surface};

/// What is baked.
#[derive(Clone, Debug, Default, PartialEq)]
pub enum SignalChoice {
    /// Ambient occlusion, traced.
    #[default]
    AmbientOcclusion,
    /// An image file on the scene's texture coordinates.
    Texture(PathBuf),
}

/// Names that [`SignalChoice`] reads, for messages.
pub const SIGNALS: &str = "ao";

impl FromStr for SignalChoice {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        match text {
            "ao" => Ok(Self::AmbientOcclusion),
            _ => Err(format!("{text:?} is no signal: use {SIGNALS}")),
        }
    }
}

impl SignalChoice {
    /// The signal on a surface.
    ///
    /// # Errors
    /// What the signal needs and the scene does not have.
    pub fn on<'a>(
        &self,
        surface: &'a Surface<'a>,
        tracer: &'a Tracer<'a>,
        plan: &Plan,
    ) -> Result<Box<dyn Signal + 'a>, BakeError> {
        Ok(Box::new(AmbientOcclusion::new(tracer, &surface.mesh, plan.ao_distance, plan.seed)))
    }
}
