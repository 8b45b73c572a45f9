//! Which light there is, and what stands in its way: everything beside the geometry that decides a bake's values.
//!
//! The options are kept in the baked file as they were given, so that a later look at it traces the same light.

use std::path::{Path, PathBuf};

use glam::Vec3;
use lightkiln_light::{Environment, Falloff, Ground, Light, Lighting, OcclusionOptions};
use lightkiln_scene::{Glass, LightKind, PunctualLight, ReadOptions, Scene, read_environment};
use serde::{Deserialize, Serialize};

use crate::BakeError;
use crate::moving::{Moving, MovingParts};
use crate::surface::Cast;

/// What light there is and what it meets. The defaults are those of a file that says all by itself.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "camelCase", deny_unknown_fields, default)]
pub struct LightOptions {
    /// Occlusion: exponent of a smooth falloff, above 0; none for a hard end at the distance.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub falloff: Option<f32>,
    /// Occlusion: a level floor that is not in the file.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub ground: Option<GroundLevel>,
    /// A latitude-longitude image of what surrounds the scene.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub environment: Option<PathBuf>,
    /// cd/m2 of a texel of 1; 1 if none.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub environment_intensity: Option<f32>,
    /// Degrees about the vertical, counter-clockwise seen from above.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub environment_rotation: Option<f32>,
    /// A sky of one radiance, cd/m2.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub sky: Option<[f32; 3]>,
    /// A sun.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub sun: Option<Sun>,
    /// Leaves the lights of the file dark.
    #[serde(skip_serializing_if = "is_false")]
    pub no_file_lights: bool,
    /// Radius of the point and spot lights of the file, which have none: soft shadows.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub light_radius: Option<f32>,
    /// Half of the angle under which directional lights of the file are seen, degrees.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub light_angle: Option<f32>,
    /// Lights with an area.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub area_lights: Vec<AreaLight>,
    /// Surfaces that may reflect light on its way; [`DEFAULT_BOUNCES`] if none.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub bounces: Option<u32>,
    /// Transmissive materials stop light.
    #[serde(skip_serializing_if = "is_false")]
    pub opaque_glass: bool,
    /// Files whose surfaces stand in the way of light and get none.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub occluders: Vec<PathBuf>,
    /// Nodes that get light, by name; all if empty.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub include: Vec<String>,
    /// Nodes that do not.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub exclude: Vec<String>,
    /// What becomes of parts that an animation moves. A file says only whether they were left out.
    #[serde(
        rename = "leaveOutMoving",
        default = "Moving::kept",
        skip_serializing_if = "Moving::is_not_left_out"
    )]
    pub moving: Moving,
    /// The variant of the materials.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub variant: Option<String>,
    /// Occlusion textures that the file has already, where materials show ours; none where they do not.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub authored_occlusion: Option<AuthoredOcclusion>,
}

/// What becomes of the occlusion textures of a file when materials are to show ours: they have room for one.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum AuthoredOcclusion {
    /// What is baked is ours times theirs, at their strength. Where theirs has finer texels, so has what is baked.
    #[default]
    Multiply,
    /// The same with texels of one width everywhere.
    MultiplyCoarse,
    /// Materials that have one keep it and show none of ours.
    Keep,
    /// Ours takes its place.
    Replace,
}

impl AuthoredOcclusion {
    /// Whether what is baked is ours times theirs.
    pub fn is_multiplied(self) -> bool {
        matches!(self, Self::Multiply | Self::MultiplyCoarse)
    }
}

fn is_false(flag: &bool) -> bool {
    !flag
}

/// How often light is reflected, unless it is told otherwise: a closed room of albedo 0.7 then misses 0.2 % of its light,
/// one of 0.8 2 %.
pub const DEFAULT_BOUNCES: u32 = 16;

/// Where a floor lies.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(untagged)]
pub enum GroundLevel {
    /// At this height.
    Height(f32),
    /// Under the lowest vertex.
    Lowest(Lowest),
}

/// The word `lowest`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub enum Lowest {
    /// Under the lowest vertex.
    #[default]
    #[serde(rename = "lowest")]
    Lowest,
}

impl std::str::FromStr for GroundLevel {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        if text == "lowest" {
            return Ok(Self::Lowest(Lowest::Lowest));
        }
        match text.parse::<f32>() {
            Ok(height) if height.is_finite() => Ok(Self::Height(height)),
            _ => Err(format!("{text:?} is neither a height nor `lowest`")),
        }
    }
}

/// A sun.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "camelCase", deny_unknown_fields)]
pub struct Sun {
    /// Degrees, clockwise seen from above: 0 in the direction -z, 90 in the direction +x.
    pub azimuth: f32,
    /// Degrees above the horizon.
    pub elevation: f32,
    /// On a surface that faces it, lux.
    #[serde(default = "Sun::bright")]
    pub illuminance: f32,
    /// Half of the angle under which it is seen, degrees.
    #[serde(default = "Sun::size")]
    pub angle: f32,
}

impl Sun {
    /// The sun at noon.
    fn bright() -> f32 {
        100_000.0
    }

    fn size() -> f32 {
        Light::SUN_RADIUS.to_degrees()
    }
}

impl std::str::FromStr for Sun {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let numbers: Option<Vec<f32>> =
            text.split(',').map(|n| n.trim().parse().ok().filter(|n: &f32| n.is_finite())).collect();
        let of = |azimuth, elevation, illuminance, angle| Self { azimuth, elevation, illuminance, angle };
        match numbers.as_deref() {
            Some(&[azimuth, elevation]) => Ok(of(azimuth, elevation, Self::bright(), Self::size())),
            Some(&[azimuth, elevation, lux]) => Ok(of(azimuth, elevation, lux, Self::size())),
            Some(&[azimuth, elevation, lux, angle]) => Ok(of(azimuth, elevation, lux, angle)),
            _ => Err(format!("{text:?} is no sun: AZIMUTH,ELEVATION[,LUX[,ANGLE]] in degrees")),
        }
    }
}

/// A light with an area: a disk or a parallelogram that shines to one side, or a sphere.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "shape", rename_all = "lowercase", deny_unknown_fields)]
pub enum AreaLight {
    /// A disk.
    Disk {
        /// Its middle.
        position: [f32; 3],
        /// The side to which it shines.
        direction: [f32; 3],
        /// Its radius, in units of the file.
        radius: f32,
        /// cd/m2.
        radiance: [f32; 3],
    },
    /// A parallelogram.
    Quad {
        /// One corner.
        corner: [f32; 3],
        /// From there to the two next ones; it shines to the side of their cross product.
        edges: [[f32; 3]; 2],
        /// cd/m2.
        radiance: [f32; 3],
    },
    /// A sphere.
    Sphere {
        /// Its middle.
        position: [f32; 3],
        /// Its radius, in units of the file.
        radius: f32,
        /// Candela in every direction.
        intensity: [f32; 3],
    },
}

impl AreaLight {
    fn light(&self) -> Light {
        match *self {
            Self::Disk { position, direction, radius, radiance } => Light::Disk {
                position: position.into(),
                direction: direction.into(),
                radius,
                radiance: radiance.into(),
            },
            Self::Quad { corner, edges, radiance } => {
                Light::Quad { corner: corner.into(), edges: edges.map(Vec3::from), radiance: radiance.into() }
            }
            Self::Sphere { position, radius, intensity } => Light::Sphere {
                position: position.into(),
                intensity: intensity.into(),
                radius,
                range: f32::INFINITY,
            },
        }
    }
}

impl LightOptions {
    /// How a scene is read for this light; `surfaces` where colors matter.
    pub fn read_options(&self, scene: Option<usize>, surfaces: bool) -> ReadOptions {
        ReadOptions {
            scene,
            surfaces,
            glass: if self.opaque_glass { Glass::Opaque } else { Glass::Tinted },
            variant: self.variant.clone(),
            ..ReadOptions::default()
        }
    }

    /// What occludes, up to a distance.
    pub fn occlusion(&self, distance: f32) -> OcclusionOptions {
        OcclusionOptions {
            distance,
            falloff: self.falloff.map_or(Falloff::Hard, |power| Falloff::Smooth { power }),
            ground: self.ground.map(|ground| match ground {
                GroundLevel::Height(height) => Ground::Height(height),
                GroundLevel::Lowest(_) => Ground::Lowest,
            }),
        }
    }

    /// The lights of a scene and of these options, without its shining surfaces.
    ///
    /// # Errors
    /// [`BakeError::Option`] and [`BakeError::AreaLight`] for numbers out of their range, [`BakeError::Scene`] for an
    /// environment that cannot be read, [`BakeError::Environment`] for one that has no light, [`BakeError::Light`] for
    /// other light that makes no sense.
    pub fn lighting(&self, scene: &Scene) -> Result<Lighting, BakeError> {
        self.check()?;
        let mut lights = Vec::new();
        if !self.no_file_lights {
            lights.extend(scene.lights.iter().map(|light| self.punctual(light)));
        }
        if let Some(sun) = self.sun {
            let radians = [sun.azimuth, sun.elevation, sun.angle].map(f32::to_radians);
            lights.push(match Light::sun(radians[0], radians[1], Vec3::splat(sun.illuminance)) {
                Light::Directional { to_light, illuminance, .. } => {
                    Light::Directional { to_light, illuminance, angular_radius: radians[2] }
                }
                other => other,
            });
        }
        lights.extend(self.area_lights.iter().map(AreaLight::light));
        Ok(Lighting { lights, environment: self.surroundings()? })
    }

    /// The scenes that stand in the way of light.
    ///
    /// # Errors
    /// [`BakeError::Scene`] for a file that cannot be read.
    pub fn read_occluders(&self, surfaces: bool) -> Result<Vec<Scene>, BakeError> {
        let options = ReadOptions { variant: None, ..self.read_options(None, surfaces) };
        Ok(self.occluders.iter().map(|path| Scene::read(path, &options)).collect::<Result<_, _>>()?)
    }

    /// Which parts get light and which stand in its way.
    ///
    /// # Errors
    /// [`BakeError::Scene`] for a pattern that matches no node.
    pub fn cast<'a>(&self, scene: &Scene, occluders: &'a [Scene]) -> Result<Cast<'a>, BakeError> {
        let mut cast = Cast {
            receives: self.receives(scene)?,
            casts: Vec::new(),
            occluders: occluders.iter().collect(),
        };
        let moving = MovingParts::new(scene, &cast.receives, self.moving);
        if moving.left_out {
            cast.casts = moving.moves.iter().map(|moves| !moves).collect();
            cast.receives.iter_mut().zip(moving.moves).for_each(|(receives, moves)| *receives &= !moves);
        }
        Ok(cast)
    }

    /// The parts of a scene that an animation moves, and what becomes of them.
    ///
    /// # Errors
    /// As [`Self::cast`].
    pub fn moving_parts(&self, scene: &Scene) -> Result<MovingParts, BakeError> {
        Ok(MovingParts::new(scene, &self.receives(scene)?, self.moving))
    }

    /// Which parts get light, if they do not move.
    fn receives(&self, scene: &Scene) -> Result<Vec<bool>, BakeError> {
        let mut receives = scene.select(&self.include, &self.exclude)?;
        if self.authored_occlusion == Some(AuthoredOcclusion::Keep) {
            for (part, receives) in receives.iter_mut().enumerate() {
                *receives &= scene.has_occlusion_textures(part).contains(&false);
            }
        }
        Ok(receives)
    }

    fn surroundings(&self) -> Result<Option<Environment>, BakeError> {
        let rotation = self.environment_rotation.unwrap_or(0.0).to_radians();
        let intensity = self.environment_intensity.unwrap_or(1.0);
        if let Some(path) = &self.environment {
            let image = read_environment(path)?;
            let pixels = image.pixels.into_iter().map(Vec3::from).collect();
            let environment = Environment::lat_long(image.width, image.height, pixels, rotation, intensity);
            return environment
                .map(Some)
                .map_err(|source| BakeError::Environment { path: path.clone(), source });
        }
        Ok(self.sky.map(|radiance| Environment::constant(radiance.into())).transpose()?)
    }

    fn punctual(&self, light: &PunctualLight) -> Light {
        let power = Vec3::from(light.color) * light.intensity;
        let range = light.range.unwrap_or(f32::INFINITY);
        let radius = self.light_radius.unwrap_or(0.0);
        match light.kind {
            LightKind::Directional => Light::Directional {
                to_light: -light.direction,
                illuminance: power,
                angular_radius: self.light_angle.unwrap_or(0.0).to_radians(),
            },
            LightKind::Point => Light::Sphere { position: light.position, intensity: power, radius, range },
            LightKind::Spot { inner, outer } => Light::Spot {
                position: light.position,
                direction: light.direction,
                intensity: power,
                inner,
                outer,
                radius,
                range,
            },
        }
    }

    fn check(&self) -> Result<(), BakeError> {
        let check =
            |name: &'static str, value: Option<f32>, range: &'static str, holds: fn(f32) -> bool| match value
                .filter(|v| !(v.is_finite() && holds(*v)))
            {
                Some(value) => Err(BakeError::Option { name, value: value.to_string(), range }),
                None => Ok(()),
            };
        let at_least_0 = |v: f32| v >= 0.0;
        check("--ao-falloff", self.falloff, "above 0 and finite", |v| v > 0.0)?;
        check("--environment-intensity", self.environment_intensity, "above 0 and finite", |v| v > 0.0)?;
        check("--environment-rotation", self.environment_rotation, "a finite number of degrees", |_| true)?;
        check("--light-radius", self.light_radius, "at least 0 and finite", at_least_0)?;
        check("--light-angle", self.light_angle, "between 0 and 85 degrees", |v| (0.0..=85.0).contains(&v))?;
        for sky in self.sky.into_iter().flatten() {
            check("--sky", Some(sky), "at least 0 and finite", at_least_0)?;
        }
        if let Some(sun) = self.sun {
            check("--sun", Some(sun.illuminance), "of an illuminance of at least 0", at_least_0)?;
            check("--sun", Some(sun.elevation), "between -90 and 90 degrees high", |v| v.abs() <= 90.0)?;
            check("--sun", Some(sun.angle), "between 0 and 85 degrees in radius", |v| {
                (0.0..=85.0).contains(&v)
            })?;
        }
        for (number, light) in self.area_lights.iter().enumerate() {
            if let Some(what) = light.light().fault() {
                return Err(BakeError::AreaLight { number, what });
            }
        }
        if self.environment.is_some() && self.sky.is_some() {
            return Err(BakeError::Option {
                name: "--sky",
                value: "given beside --environment".into(),
                range: "the only surroundings",
            });
        }
        Ok(())
    }

    /// The same options with file names as seen from another folder: that of the baked file when it is written, the
    /// one that `folder` leads to when it is read.
    #[must_use]
    pub fn map_files(&self, map: impl Fn(&Path) -> PathBuf) -> Self {
        Self {
            environment: self.environment.as_deref().map(&map),
            occluders: self.occluders.iter().map(|path| map(path)).collect(),
            ..self.clone()
        }
    }

    /// Every file that these options name.
    pub fn files(&self) -> impl Iterator<Item = &PathBuf> {
        self.environment.iter().chain(&self.occluders)
    }
}

/// A path as seen from a folder, with `..` where needed; the path itself where the two have nothing in common.
pub fn seen_from(path: &Path, folder: &Path) -> PathBuf {
    let whole = |p: &Path| std::path::absolute(p).unwrap_or_else(|_| p.to_owned());
    let (path, folder) = (whole(path), whole(folder));
    let shared = path.components().zip(folder.components()).take_while(|(a, b)| a == b).count();
    if shared == 0 {
        return path;
    }
    let up = folder.components().skip(shared).map(|_| std::path::Component::ParentDir);
    up.chain(path.components().skip(shared)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn options_of_a_file_are_read_back() {
        let text = r#"{"ground":"lowest","sun":{"azimuth":30,"elevation":40},"sky":[1,2,3],"bounces":2,
            "areaLights":[{"shape":"disk","position":[0,1,0],"direction":[0,-1,0],"radius":0.5,"radiance":[9,9,9]}]}"#;
        let options: LightOptions = serde_json::from_str(text).unwrap();
        assert_eq!(options.sun.map(|s| s.illuminance), Some(100_000.0));
        assert_eq!(options.ground, Some(GroundLevel::Lowest(Lowest::Lowest)));
        let again: LightOptions = serde_json::from_str(&serde_json::to_string(&options).unwrap()).unwrap();
        assert_eq!(again, options);
        assert_eq!(serde_json::to_string(&LightOptions::default()).unwrap(), "{}");
        assert!(serde_json::from_str::<LightOptions>(r#"{"suns":1}"#).is_err());
    }

    #[test]
    fn options_out_of_range_are_refused() {
        let refused = |options: LightOptions| options.check().is_err();
        assert!(refused(LightOptions { falloff: Some(0.0), ..Default::default() }));
        assert!(refused(LightOptions { sky: Some([1.0, f32::NAN, 1.0]), ..Default::default() }));
        assert!(refused(LightOptions { light_angle: Some(90.0), ..Default::default() }));
        let sun = "10,20,-5".parse().unwrap();
        assert!(refused(LightOptions { sun: Some(sun), ..Default::default() }));
        assert!("10".parse::<Sun>().is_err() && "10,x".parse::<Sun>().is_err());
        assert!("floor".parse::<GroundLevel>().is_err());
    }

    #[test]
    fn path_seen_from_a_folder_leads_back() {
        let seen = |path: &str, folder: &str| seen_from(Path::new(path), Path::new(folder));
        assert_eq!(seen("a/sky.hdr", "a"), Path::new("sky.hdr"));
        assert_eq!(seen("a/sky.hdr", "b/c"), Path::new("../../a/sky.hdr"));
    }
}
