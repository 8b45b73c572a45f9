//! Which light a bake uses: options of the command line and the table `[light]` of a configuration file.

use std::path::PathBuf;

use clap::{Args, ValueEnum};
use lightkiln_bake::lighting::{AreaLight, GroundLevel, LightOptions, Sun};
use lightkiln_bake::moving::Moving;
use serde::{Deserialize, Serialize};

/// The light, and what it meets.
#[derive(Args, Clone, Debug, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields, default)]
#[command(next_help_heading = "Light")]
pub struct LightSettings {
    /// A latitude-longitude image of what surrounds the scene: .hdr, .exr, or .png and .jpg
    #[arg(long, value_name = "FILE", conflicts_with = "sky")]
    pub environment: Option<PathBuf>,
    /// cd/m2 of a texel of 1 [default: 1]
    #[arg(long, value_name = "X")]
    pub environment_intensity: Option<f32>,
    /// Degrees about the vertical [default: 0]
    #[arg(long, value_name = "DEGREES", allow_negative_numbers = true)]
    pub environment_rotation: Option<f32>,
    /// A sky of one radiance in cd/m2, for example 1000 or 900,1000,1200
    #[arg(long, value_name = "L or R,G,B", value_parser = sky)]
    pub sky: Option<[f32; 3]>,
    /// A sun by azimuth (0 in the direction -z, 90 in the direction +x) and elevation, with 100000 lux and its own
    /// size unless told otherwise
    #[arg(long, value_name = "AZIMUTH,ELEVATION[,LUX[,ANGLE]]", allow_hyphen_values = true)]
    pub sun: Option<Sun>,
    /// Leave the lights of the file dark
    #[arg(long)]
    pub no_file_lights: bool,
    /// Radius of the file's point and spot lights, for soft shadows [default: 0]
    #[arg(long, value_name = "METRES")]
    pub light_radius: Option<f32>,
    /// Half of the angle under which the file's directional lights are seen [default: 0]
    #[arg(long, value_name = "DEGREES")]
    pub light_angle: Option<f32>,
    /// How often light is reflected at most [default: 16]
    #[arg(long, value_name = "N")]
    pub bounces: Option<u32>,
    /// What counts as white, in lux: the error bound is a share of the way from black to it [default: 95 % of the lit
    /// surface are darker]
    #[arg(long, value_name = "LUX")]
    pub white: Option<f32>,
    /// What transmissive materials do with light [default: tinted]
    #[arg(long, value_enum)]
    pub glass: Option<GlassName>,
    /// Occlusion fades with distance d of D as (1 - d/D)^P [default: it does not]
    #[arg(long, value_name = "P")]
    pub ao_falloff: Option<f32>,
    /// Occlusion: a floor that is not in the file, at a height or `lowest`: under the lowest vertex
    #[arg(long, value_name = "Y", allow_hyphen_values = true)]
    pub ao_ground: Option<GroundLevel>,
    /// A file whose surfaces stand in the way of light and get none; may be given more than once
    #[arg(long, value_name = "FILE.glb")]
    pub occluders: Vec<PathBuf>,
    /// Only nodes whose name (or that of a node above) matches get light: * and ? stand for any characters
    #[arg(long, value_name = "PATTERN")]
    pub include: Vec<String>,
    /// Nodes that get no light
    #[arg(long, value_name = "PATTERN")]
    pub exclude: Vec<String>,
    /// What becomes of parts that animations move [default: auto]
    #[arg(long, value_enum)]
    pub moving: Option<MovingName>,
    /// Which variant of the materials light meets (KHR_materials_variants)
    #[arg(long, value_name = "NAME")]
    pub variant: Option<String>,
    /// Lights with an area, in a configuration file only.
    #[arg(skip)]
    pub area_lights: Vec<AreaLight>,
}

/// What transmissive materials do.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum GlassName {
    /// Light passes, tinted by the base color
    Tinted,
    /// Light is stopped
    Opaque,
}

/// What becomes of moving parts.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum MovingName {
    /// They are left out, unless they are more than half of the area that gets light
    Auto,
    /// They are baked where they stand
    Keep,
    /// They get no light and stand in nobody's way
    LeaveOut,
}

impl From<MovingName> for Moving {
    fn from(name: MovingName) -> Self {
        match name {
            MovingName::Auto => Self::Auto,
            MovingName::Keep => Self::Keep,
            MovingName::LeaveOut => Self::LeaveOut,
        }
    }
}

fn sky(text: &str) -> Result<[f32; 3], String> {
    let numbers: Option<Vec<f32>> = text.split(',').map(|n| n.trim().parse().ok()).collect();
    match numbers.as_deref() {
        Some(&[gray]) => Ok([gray; 3]),
        Some(&[r, g, b]) => Ok([r, g, b]),
        _ => Err(format!("{text:?} is neither a number nor R,G,B")),
    }
}

impl LightSettings {
    /// These settings, with those of a file where they say nothing.
    pub fn or(self, file: Self) -> Self {
        let list = |own: Vec<String>, file| if own.is_empty() { file } else { own };
        // One kind of surroundings on the command line overrules the other in the file.
        let surrounded = self.environment.is_some() || self.sky.is_some();
        Self {
            environment: self.environment.or(if surrounded { None } else { file.environment }),
            environment_intensity: self.environment_intensity.or(file.environment_intensity),
            environment_rotation: self.environment_rotation.or(file.environment_rotation),
            sky: self.sky.or(if surrounded { None } else { file.sky }),
            sun: self.sun.or(file.sun),
            no_file_lights: self.no_file_lights || file.no_file_lights,
            light_radius: self.light_radius.or(file.light_radius),
            light_angle: self.light_angle.or(file.light_angle),
            bounces: self.bounces.or(file.bounces),
            white: self.white.or(file.white),
            glass: self.glass.or(file.glass),
            ao_falloff: self.ao_falloff.or(file.ao_falloff),
            ao_ground: self.ao_ground.or(file.ao_ground),
            occluders: if self.occluders.is_empty() { file.occluders } else { self.occluders },
            include: list(self.include, file.include),
            exclude: list(self.exclude, file.exclude),
            moving: self.moving.or(file.moving),
            variant: self.variant.or(file.variant),
            area_lights: file.area_lights,
        }
    }

    /// The same as options of a bake.
    pub fn options(&self) -> LightOptions {
        LightOptions {
            falloff: self.ao_falloff,
            ground: self.ao_ground,
            environment: self.environment.clone(),
            environment_intensity: self.environment_intensity,
            environment_rotation: self.environment_rotation,
            sky: self.sky,
            sun: self.sun,
            no_file_lights: self.no_file_lights,
            light_radius: self.light_radius,
            light_angle: self.light_angle,
            area_lights: self.area_lights.clone(),
            bounces: self.bounces,
            opaque_glass: self.glass == Some(GlassName::Opaque),
            occluders: self.occluders.clone(),
            include: self.include.clone(),
            exclude: self.exclude.clone(),
            moving: self.moving.map_or(Moving::Auto, Into::into),
            variant: self.variant.clone(),
            // An option of its own, which is no matter of rays.
            authored_occlusion: None,
        }
    }
}
