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
                let (azimuth, elevation) =
                    (azimuth.trim().parse().ok()?, elevation.trim().parse::<f32>().ok()?);
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

/// How much more than the points a picture shows.
const MARGIN: f32 = 1.06;

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
    /// Frames points so that they fill the picture but for a margin; a `zoom` of 2 shows half as much of them.
    /// The picture's middle is that of the points, or `target`.
    pub fn framing(points: &[Vec3], target: Option<Vec3>, view: View, zoom: f32) -> Self {
        let forward = -view.toward_eye();
        // Looking straight up or down, the front of the scene points down or up in the picture.
        let (azimuth_sin, azimuth_cos) = view.azimuth.to_radians().sin_cos();
        let right = Vec3::new(azimuth_cos, 0.0, -azimuth_sin);
        let up = right.cross(forward);
        // In the camera's axes, the middle of the extent across and along the view.
        let axes = |p: Vec3| Vec3::new(p.dot(right), p.dot(up), p.dot(forward));
        let (low, high) = points.iter().fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(low, high), &p| {
            (low.min(axes(p)), high.max(axes(p)))
        });
        let middle = if low.is_finite() { (low + high) / 2.0 } else { Vec3::ZERO };
        let middle = target.map_or(middle, axes);
        // As far away as each point asks for, to lie within the opening.
        let distance = points.iter().map(|&p| {
            let from_middle = axes(p) - middle;
            from_middle.x.abs().max(from_middle.y.abs()) * MARGIN / HALF_ANGLE_TANGENT - from_middle.z
        });
        let distance = distance.fold(0.0, f32::max).max(1e-6);
        let half_width = HALF_ANGLE_TANGENT / zoom;
        let centre = middle.x * right + middle.y * up + middle.z * forward;
        Self { eye: centre - forward * distance, forward, right, up, half_width }
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
        for (name, right) in [("front", Vec3::X), ("right", -Vec3::Z), ("back", -Vec3::X), ("left", Vec3::Z)]
        {
            let camera = Camera::framing(&[Vec3::ONE, -Vec3::ONE], None, View::parse(name).unwrap(), 1.0);
            assert!(camera.right.abs_diff_eq(right, 1e-6), "{name}");
            assert!(camera.up.abs_diff_eq(Vec3::Y, 1e-6), "{name}");
            let (eye, ahead) = camera.ray(0.0, 0.0);
            assert!((eye + ahead * eye.length()).length() < 1e-4, "{name} looks at the middle");
        }
    }

    #[test]
    fn camera_shows_all_points_at_zoom_one() {
        let points = [Vec3::new(3.0, 1.0, -2.0), Vec3::new(-1.0, 0.0, 5.0), Vec3::new(0.0, -4.0, 0.0)];
        for view in ["front", "top", "three-quarter", "-120,-40"] {
            let camera = Camera::framing(&points, None, View::parse(view).unwrap(), 1.0);
            for p in points {
                let seen = p - camera.eye;
                let (depth, x, y) = (seen.dot(camera.forward), seen.dot(camera.right), seen.dot(camera.up));
                assert!(depth > 0.0 && x.abs().max(y.abs()) <= camera.half_width * depth, "{view}: {p}");
            }
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
