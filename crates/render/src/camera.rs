//! Where a picture is taken from: an orbit around the scene's middle.

use glam::Vec3;

/// Directions to look from, as angles of an orbit. Y is up and +Z is the front, as glTF has it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct View {
    /// Degrees around Y: 0 looks at the front, 90 at the side that lies at +X.
    pub azimuth: f32,
    /// Degrees above the horizon, `-90..=90`.
    pub elevation: f32,
}

impl View {
    /// Reads a view's name or `AZIMUTH,ELEVATION`.
    pub fn parse(text: &str) -> Option<Self> {
        let view = |azimuth, elevation| Some(Self { azimuth, elevation });
        match text {
            "front" => view(0.0, 0.0),
            "right" => view(90.0, 0.0),
            "back" => view(180.0, 0.0),
            "left" => view(-90.0, 0.0),
            "top" => view(0.0, 90.0),
            "bottom" => view(0.0, -90.0),
            "three-quarter" => view(35.0, 25.0),
            angles => {
                let (azimuth, elevation) = angles.split_once(',')?;
                let (azimuth, elevation) = (azimuth.trim().parse().ok()?, elevation.trim().parse::<f32>().ok()?);
                let finite = f32::is_finite(azimuth) && elevation.abs() <= 90.0;
                finite.then_some(Self { azimuth, elevation })
            }
        }
    }

    /// Unit vector from the middle of the scene to the eye.
    fn toward_eye(self) -> Vec3 {
        let (azimuth, elevation) = (self.azimuth.to_radians(), self.elevation.to_radians());
        Vec3::new(azimuth.sin() * elevation.cos(), elevation.sin(), azimuth.cos() * elevation.cos())
    }
}

/// A pinhole camera with a square picture.
#[derive(Clone, Copy, Debug)]
pub struct Camera {
    eye: Vec3,
    forward: Vec3,
    right: Vec3,
    up: Vec3,
    half_width: f32,
}

/// Half the opening angle, as a tangent: a long lens, as product pictures have it.
const HALF_ANGLE_TANGENT: f32 = 0.25;

impl Camera {
    /// Frames a sphere around `target` of a radius that fills the picture at `zoom` 1; smaller zooms go closer.
    pub fn framing(target: Vec3, radius: f32, view: View, zoom: f32) -> Self {
        let out = view.toward_eye();
        let distance = (radius * zoom / HALF_ANGLE_TANGENT).max(1e-6);
        let forward = -out;
        // Looking straight up or down, the front of the scene points down or up in the picture.
        let (azimuth_sin, azimuth_cos) = view.azimuth.to_radians().sin_cos();
        let right = Vec3::new(azimuth_cos, 0.0, -azimuth_sin);
        let up = right.cross(forward);
        Self { eye: target + out * distance, forward, right, up, half_width: HALF_ANGLE_TANGENT }
    }

    /// Origin and unit direction of the ray through a place of the picture, `-1..=1` from left and bottom.
    pub fn ray(&self, x: f32, y: f32) -> (Vec3, Vec3) {
        let direction = self.forward + self.half_width * (x * self.right + y * self.up);
        (self.eye, direction.normalize())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn camera_from_the_front_sees_x_to_the_right_and_y_up() {
        for (name, right) in [("front", Vec3::X), ("right", -Vec3::Z), ("back", -Vec3::X), ("left", Vec3::Z)] {
            let camera = Camera::framing(Vec3::ZERO, 1.0, View::parse(name).unwrap(), 1.0);
            assert!(camera.right.abs_diff_eq(right, 1e-6), "{name}");
            assert!(camera.up.abs_diff_eq(Vec3::Y, 1e-6), "{name}");
            let (eye, ahead) = camera.ray(0.0, 0.0);
            assert!((eye + ahead * eye.length()).length() < 1e-4, "{name} looks at the middle");
        }
    }

    #[test]
    fn view_of_nonsense_is_none() {
        assert_eq!(View::parse("sideways"), None);
        assert_eq!(View::parse("10,200"), None);
        assert_eq!(View::parse("nan,0"), None);
        assert_eq!(View::parse("-30, 10"), Some(View { azimuth: -30.0, elevation: 10.0 }));
    }
}
