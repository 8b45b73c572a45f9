//! Lights that are not part of the mesh, and all the light of a scene.
//!
//! Units are photometric, each for red, green and blue: illuminance in lux, luminous intensity in candela, radiance
//! (luminance) in cd/m2. Units of length are metres, as glTF says; a scene in other units has other candelas.
//!
//! A light is sampled by points or directions that it is seen in: cones for suns and spheres (Shirley, Wang and
//! Zimmerman 1996), areas for disks and quads. Lights with a radius of 0 are points, and their shadows are hard.

use glam::Vec3;

use crate::directions::{cosine_hemisphere, frame};
use crate::{Environment, LightError};

/// Rec. 709 luminance.
pub(crate) fn luminance(color: Vec3) -> f32 {
    color.dot(Vec3::new(0.2126, 0.7152, 0.0722))
}

/// One light.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Light {
    /// A sun: the same from everywhere.
    Directional {
        /// Towards the light; of any length but zero.
        to_light: Vec3,
        /// On a surface that faces the light, lux.
        illuminance: Vec3,
        /// Half of the angle under which the light is seen, radians, `0.0..=1.5`; 0 for hard shadows.
        angular_radius: f32,
    },
    /// A sphere that shines in all directions, or a point.
    Sphere {
        /// Its middle.
        position: Vec3,
        /// Candela in every direction.
        intensity: Vec3,
        /// Its radius; 0 for a point.
        radius: f32,
        /// Where it has faded out (`KHR_lights_punctual`: times `1 - (distance / range)^4`); infinite if never.
        range: f32,
    },
    /// A sphere or point that shines into a cone.
    Spot {
        /// Its middle.
        position: Vec3,
        /// Where it looks; of any length but zero.
        direction: Vec3,
        /// Candela along the axis.
        intensity: Vec3,
        /// Angle from the axis up to which the light is full, radians.
        inner: f32,
        /// Angle from the axis from which on there is none, above `inner`, at most half pi.
        outer: f32,
        /// Its radius; 0 for a point.
        radius: f32,
        /// As for [`Light::Sphere`].
        range: f32,
    },
    /// A flat disk that shines to one side.
    Disk {
        /// Its middle.
        position: Vec3,
        /// The side to which it shines; of any length but zero.
        direction: Vec3,
        /// Its radius, above 0.
        radius: f32,
        /// cd/m2 in every direction of its side.
        radiance: Vec3,
    },
    /// A parallelogram that shines to the side of `edges[0] x edges[1]`.
    Quad {
        /// One corner.
        corner: Vec3,
        /// From there to the two next ones.
        edges: [Vec3; 2],
        /// cd/m2 in every direction of its side.
        radiance: Vec3,
    },
}

/// A place of a light as seen from a point.
#[derive(Clone, Copy, Debug)]
pub(crate) struct LightSample {
    /// Towards it, of unit length.
    pub direction: Vec3,
    /// How far it is, in the world's units; may be infinite.
    pub distance: f32,
    /// What it would throw on a surface that faces it, lux, if all of the light were there.
    pub illuminance: Vec3,
}

impl Light {
    /// Half of the angle under which the sun is seen, radians.
    pub const SUN_RADIUS: f32 = 0.004_65;

    /// A sun by its place in the sky, with the size of ours.
    ///
    /// - `azimuth`: radians, clockwise seen from above: 0 in the direction -z, a quarter turn in the direction +x
    /// - `elevation`: radians above the horizon; +y is up
    /// - `illuminance`: on a surface that faces it, lux
    pub fn sun(azimuth: f32, elevation: f32, illuminance: Vec3) -> Self {
        let (sin, cos) = f64::from(azimuth).sin_cos();
        let (up, level) = f64::from(elevation).sin_cos();
        let to_light = glam::DVec3::new(level * sin, up, -level * cos).as_vec3();
        Self::Directional { to_light, illuminance, angular_radius: Self::SUN_RADIUS }
    }

    /// What the light gives a surface, lux, if nothing is in the way: exact for lights without size, else the mean of
    /// a few places of it.
    ///
    /// - `normal`: of unit length
    pub fn unshadowed(&self, position: Vec3, normal: Vec3) -> Vec3 {
        let light = self.normalized();
        let steps: u8 = if light.is_hard() { 1 } else { 4 };
        let place = |i| (f32::from(i) + 0.5) / f32::from(steps);
        let places = (0..steps).flat_map(|i| (0..steps).map(move |j| [place(i), place(j)]));
        let seen = places.filter_map(|square| light.sample(position, square));
        let sum: Vec3 = seen.map(|s| s.illuminance * normal.dot(s.direction).max(0.0)).sum();
        sum / f32::from(steps * steps)
    }

    /// One sample is all of it.
    pub(crate) fn is_hard(&self) -> bool {
        match *self {
            Self::Directional { angular_radius, .. } => angular_radius == 0.0,
            Self::Sphere { radius, .. } | Self::Spot { radius, .. } => radius == 0.0,
            Self::Disk { .. } | Self::Quad { .. } => false,
        }
    }

    /// The same with directions of unit length.
    pub(crate) fn normalized(mut self) -> Self {
        match &mut self {
            Self::Directional { to_light: d, .. }
            | Self::Spot { direction: d, .. }
            | Self::Disk { direction: d, .. } => *d = d.as_dvec3().normalize_or_zero().as_vec3(),
            Self::Sphere { .. } | Self::Quad { .. } => {}
        }
        self
    }

    /// The first number that makes no sense: what it is.
    pub fn fault(&self) -> Option<&'static str> {
        let color = |c: Vec3| c.is_finite() && c.min_element() >= 0.0;
        let axis = |d: Vec3| d.is_finite() && d.as_dvec3().length_squared() > 0.0;
        let range = |r: f32| r > 0.0;
        let radius = |r: f32| r.is_finite() && r >= 0.0;
        let checks: &[(bool, &'static str)] = match *self {
            Self::Directional { to_light, illuminance, angular_radius } => &[
                (axis(to_light), "direction"),
                (color(illuminance), "illuminance"),
                ((0.0..=1.5).contains(&angular_radius), "angular radius"),
            ],
            Self::Sphere { position, intensity, radius: r, range: far } => &[
                (position.is_finite(), "position"),
                (color(intensity), "intensity"),
                (radius(r), "radius"),
                (range(far), "range"),
            ],
            Self::Spot { position, direction, intensity, inner, outer, radius: r, range: far } => &[
                (position.is_finite(), "position"),
                (axis(direction), "direction"),
                (color(intensity), "intensity"),
                (inner >= 0.0 && inner < outer, "inner angle"),
                (outer <= std::f32::consts::FRAC_PI_2 + 1e-6, "outer angle"),
                (radius(r), "radius"),
                (range(far), "range"),
            ],
            Self::Disk { position, direction, radius: r, radiance } => &[
                (position.is_finite(), "position"),
                (axis(direction), "direction"),
                (radius(r) && r > 0.0, "radius"),
                (color(radiance), "radiance"),
            ],
            Self::Quad { corner, edges: [u, v], radiance } => &[
                (corner.is_finite(), "position"),
                (u.is_finite() && v.is_finite() && u.cross(v).length_squared() > 0.0, "edges"),
                (color(radiance), "radiance"),
            ],
        };
        checks.iter().find(|(good, _)| !good).map(|&(_, what)| what)
    }

    /// About the illuminance that the light gives a surface, lux, if nothing is in the way; above 0 wherever it gives
    /// any.
    pub(crate) fn importance(&self, position: Vec3, normal: Vec3) -> f32 {
        let sphere = |centre: Vec3, intensity: Vec3, radius: f32, range: f32| {
            let to = centre - position;
            let square = to.length_squared().max(radius * radius).max(f32::MIN_POSITIVE);
            let distance = square.sqrt();
            let cosine = ((normal.dot(to) + radius) / distance).clamp(0.0, 1.0);
            luminance(intensity) * cosine * fade(distance - radius, range) / square
        };
        match *self {
            Self::Directional { to_light, illuminance, angular_radius } => {
                luminance(illuminance) * (normal.dot(to_light) + angular_radius).clamp(0.0, 1.0)
            }
            Self::Sphere { position: centre, intensity, radius, range } => {
                sphere(centre, intensity, radius, range)
            }
            Self::Spot { position: centre, direction, intensity, inner, outer, radius, range } => {
                let share = cone((position - centre).normalize_or_zero().dot(direction), inner, outer);
                share * sphere(centre, intensity, radius, range)
            }
            Self::Disk { position: centre, direction, radius, radiance } => {
                let to = centre - position;
                let height = normal.dot(to) + radius * normal.cross(direction).length();
                if to.dot(direction) >= 0.0 || height <= 0.0 {
                    return 0.0;
                }
                let area = std::f32::consts::PI * radius * radius;
                luminance(radiance) * area / (to.length_squared() + radius * radius)
            }
            Self::Quad { corner, edges: [u, v], radiance } => {
                let to = corner - position;
                let across = u.cross(v);
                let height = normal.dot(to) + normal.dot(u).max(0.0) + normal.dot(v).max(0.0);
                if to.dot(across) >= 0.0 || height <= 0.0 {
                    return 0.0;
                }
                let area = across.length();
                luminance(radiance) * area / ((to + 0.5 * (u + v)).length_squared() + area)
            }
        }
    }

    /// A place of the light: the mean of `illuminance` times cosine over the unit square is the illuminance of a
    /// surface that sees all of it.
    ///
    /// None where it does not shine.
    pub(crate) fn sample(&self, position: Vec3, square: [f32; 2]) -> Option<LightSample> {
        match *self {
            Self::Directional { to_light, illuminance, angular_radius } => {
                if angular_radius == 0.0 {
                    return Some(LightSample { direction: to_light, distance: f32::INFINITY, illuminance });
                }
                let half = (0.5 * angular_radius).sin();
                let height = 2.0 * half * half;
                let direction = in_cone(to_light, height, square);
                // E = radiance pi sin^2, and the cone has 2 pi (1 - cos).
                let illuminance = illuminance * (2.0 / (2.0 - height));
                Some(LightSample { direction, distance: f32::INFINITY, illuminance })
            }
            Self::Sphere { position: centre, intensity, radius, range } => {
                sphere_sample(centre - position, intensity, radius, range, square)
            }
            Self::Spot { position: centre, direction, intensity, inner, outer, radius, range } => {
                let to = centre - position;
                let share = cone(-to.normalize_or_zero().dot(direction), inner, outer);
                if share == 0.0 {
                    return None;
                }
                sphere_sample(to, intensity * share, radius, range, square)
            }
            Self::Disk { position: centre, direction, radius, radiance } => {
                let [x, y] = frame(direction);
                let place = cosine_hemisphere(square);
                let to = centre - position + (x * place.x + y * place.y) * radius;
                area_sample(to, direction * (std::f32::consts::PI * radius * radius), radiance)
            }
            Self::Quad { corner, edges: [u, v], radiance } => {
                area_sample(corner - position + u * square[0] + v * square[1], u.cross(v), radiance)
            }
        }
    }
}

/// - `to`: from the point to the place on the light
/// - `area`: the light's normal times its area
fn area_sample(to: Vec3, area: Vec3, radiance: Vec3) -> Option<LightSample> {
    let square = to.length_squared();
    let distance = square.sqrt();
    let facing = -to.dot(area) / distance;
    (facing > 0.0).then(|| LightSample {
        direction: to / distance,
        distance,
        illuminance: radiance * (facing / square),
    })
}

/// - `to`: from the point to the middle of the sphere
fn sphere_sample(
    to: Vec3,
    intensity: Vec3,
    radius: f32,
    range: f32,
    square: [f32; 2],
) -> Option<LightSample> {
    let squared = to.length_squared();
    let distance = squared.sqrt();
    let intensity = intensity * fade(distance - radius, range);
    if squared == 0.0 || intensity == Vec3::ZERO {
        return None;
    }
    let axis = to / distance;
    if radius == 0.0 {
        return Some(LightSample { direction: axis, distance, illuminance: intensity / squared });
    }
    // Inside the sphere, it is seen all around.
    let sine2 = radius * radius / squared;
    let cosine = if sine2 < 1.0 { (1.0 - sine2).sqrt() } else { -1.0 };
    let height = if sine2 < 1.0 { sine2 / (1.0 + cosine) } else { 2.0 };
    let direction = in_cone(axis, height, square);
    // radiance = intensity / (pi r^2), and the cone has 2 pi (1 - cos).
    let illuminance = intensity * (2.0 * height / (radius * radius));
    let along = direction.dot(to);
    let inside = (along * along - (squared - radius * radius)).max(0.0).sqrt();
    Some(LightSample { direction, distance: (along - inside).max(0.0), illuminance })
}

/// A direction around `axis`, uniform in solid angle.
///
/// - `height`: 1 - cosine of the cone's half angle
fn in_cone(axis: Vec3, height: f32, square: [f32; 2]) -> Vec3 {
    let place = cosine_hemisphere(square);
    let h = height * (place.x * place.x + place.y * place.y);
    let wide = (height * (2.0 - h)).max(0.0).sqrt();
    let [x, y] = frame(axis);
    ((x * place.x + y * place.y) * wide + axis * (1.0 - h)).normalize()
}

/// How much of a light is left at a distance (`KHR_lights_punctual`).
fn fade(distance: f32, range: f32) -> f32 {
    if range.is_infinite() {
        return 1.0;
    }
    (1.0 - (distance / range).powi(4)).clamp(0.0, 1.0)
}

/// How much of a spot light there is off its axis (`KHR_lights_punctual`).
fn cone(cosine: f32, inner: f32, outer: f32) -> f32 {
    let (inner, outer) = (inner.cos(), outer.cos());
    ((cosine - outer) / (inner - outer).max(1e-6)).clamp(0.0, 1.0).powi(2)
}

/// All light of a scene that is not part of its mesh.
#[derive(Clone, Debug, Default)]
pub struct Lighting {
    /// In any order.
    pub lights: Vec<Light>,
    /// What is seen where there is nothing else.
    pub environment: Option<Environment>,
}

impl Lighting {
    /// For scenes that have no light at all, a photographer's: a dome whose radiance goes evenly with height from 100
    /// cd/m2 below to 300 cd/m2 above, and a soft key light of 500 lux (10 degrees in radius) from the front right, 50
    /// degrees above the horizon. A level surface has about 1200 lux; +y is up, and the front looks along +z.
    pub fn studio() -> Self {
        const ROWS: usize = 64;
        let rows = (0..ROWS).map(|row| {
            let y = ((row as f32 + 0.5) / ROWS as f32 * std::f32::consts::PI).cos();
            Vec3::splat(200.0 + 100.0 * y)
        });
        let environment = Environment::lat_long(1, ROWS, rows.collect(), 0.0, 1.0);
        let key = Light::sun(150_f32.to_radians(), 50_f32.to_radians(), Vec3::splat(500.0));
        let key = match key {
            Light::Directional { to_light, illuminance, .. } => {
                Light::Directional { to_light, illuminance, angular_radius: 10_f32.to_radians() }
            }
            other => other,
        };
        Self { lights: vec![key], environment: environment.ok() }
    }

    /// There is no light in here.
    pub fn is_empty(&self) -> bool {
        self.lights.is_empty() && self.environment.is_none()
    }

    /// The lights with directions of unit length; those that give no light are left out.
    ///
    /// # Errors
    /// [`LightError::Light`] for the first light with a number that makes no sense.
    pub(crate) fn checked(&self) -> Result<Vec<Light>, LightError> {
        for (light, what) in self.lights.iter().map(Light::fault).enumerate() {
            if let Some(what) = what {
                return Err(LightError::Light { light, what });
            }
        }
        let shines = |light: &&Light| match **light {
            Light::Directional { illuminance: color, .. }
            | Light::Sphere { intensity: color, .. }
            | Light::Spot { intensity: color, .. }
            | Light::Disk { radiance: color, .. }
            | Light::Quad { radiance: color, .. } => luminance(color) > 0.0,
        };
        Ok(self.lights.iter().filter(shines).map(|light| light.normalized()).collect())
    }
}

#[cfg(test)]
mod tests {
    use std::f32::consts::PI;

    use super::*;

    #[test]
    fn unshadowed_light_has_the_closed_forms() {
        let [below, up] = [Vec3::ZERO, Vec3::Y];
        let near = |light: &Light, lux: f32| {
            let found = light.unshadowed(below, up).x;
            assert!((found - lux).abs() <= 0.03 * lux, "{light:?}: {found}, not {lux}");
        };
        let (position, range) = (Vec3::new(0.0, 2.0, 0.0), f32::INFINITY);
        near(&Light::Sphere { position, intensity: Vec3::splat(100.0), radius: 0.0, range }, 25.0);
        near(&Light::Sphere { position, intensity: Vec3::splat(100.0), radius: 0.3, range }, 25.0);
        near(&Light::sun(1.0, PI / 6.0, Vec3::splat(1000.0)), 500.0);
        // A disk seen from its axis: pi L r^2 / (r^2 + h^2).
        let disk = Light::Disk { position, direction: -up, radius: 1.0, radiance: Vec3::splat(10.0) };
        near(&disk, PI * 10.0 / 5.0);
        assert_eq!(disk.unshadowed(below, -up), Vec3::ZERO);
    }
}
