//! Where a picture is taken from: an orbit around the scene, a place, or a camera of a file.

use glam::Vec3;

use crate::RenderError;

/// Directions to look from, as angles of an orbit. Y is up and +Z is the front, as glTF has it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct View {
    /// Degrees around Y: 0 looks at the front, 90 at the side that lies at +X.
    pub azimuth: f32,
    /// Degrees above the horizon, `-90..=90`.
    pub elevation: f32,
}

impl View {
    /// Names of views, with what they stand for.
    pub const NAMES: [(&str, Self); 7] = [
        ("front", Self { azimuth: 0.0, elevation: 0.0 }),
        ("back", Self { azimuth: 180.0, elevation: 0.0 }),
        ("left", Self { azimuth: -90.0, elevation: 0.0 }),
        ("right", Self { azimuth: 90.0, elevation: 0.0 }),
        ("top", Self { azimuth: 0.0, elevation: 90.0 }),
        ("bottom", Self { azimuth: 0.0, elevation: -90.0 }),
        ("three-quarter", Self::THREE_QUARTER),
    ];

    /// From the front right and above, where most is seen of most things.
    pub const THREE_QUARTER: Self = Self { azimuth: 35.0, elevation: 25.0 };

    /// Reads a view's name or `AZIMUTH,ELEVATION`.
    pub fn parse(text: &str) -> Option<Self> {
        Self::parse_list(text).filter(|views| views.len() == 1).map(|views| views[0].1)
    }

    /// Reads views with commas between them, each with its text: `front,35,20,top` is three.
    pub fn parse_list(text: &str) -> Option<Vec<(String, Self)>> {
        let mut views = Vec::new();
        let mut words = text.split(',').map(str::trim);
        while let Some(word) = words.next() {
            if let Some((_, view)) = Self::NAMES.iter().find(|(name, _)| *name == word) {
                views.push((word.to_owned(), *view));
                continue;
            }
            let next = words.next()?;
            let (azimuth, elevation) = (word.parse::<f32>().ok()?, next.parse::<f32>().ok()?);
            if !azimuth.is_finite() || !(-90.0..=90.0).contains(&elevation) {
                return None;
            }
            views.push((format!("{word},{next}"), Self { azimuth, elevation }));
        }
        Some(views)
    }

    /// Unit vector from the middle of the scene to the eye.
    fn toward_eye(self) -> Vec3 {
        let (azimuth, elevation) = (self.azimuth.to_radians(), self.elevation.to_radians());
        Vec3::new(azimuth.sin() * elevation.cos(), elevation.sin(), azimuth.cos() * elevation.cos())
    }
}

/// How much more than the points a picture shows.
const MARGIN: f32 = 1.06;

/// From where rays of a picture start, and how they spread.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Lens {
    /// All through one point: tangents of half the opening angles, across and up.
    Pinhole([f32; 2]),
    /// All parallel: half of the width and height that is shown, in units of the scene.
    Parallel([f32; 2]),
}

/// A camera.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Camera {
    eye: Vec3,
    forward: Vec3,
    right: Vec3,
    up: Vec3,
    lens: Lens,
    depths: [f32; 2],
}

/// A line of sight.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ray {
    /// Where it starts.
    pub origin: Vec3,
    /// Of unit length.
    pub direction: Vec3,
    /// Distances between which things are shown; the second may be infinite.
    pub span: [f32; 2],
}

impl Camera {
    /// Frames points so that they fill the picture but for a margin; a `zoom` of 2 shows half as much of them.
    /// The picture's middle is that of the points, or `target`.
    ///
    /// - `lens`: tangents of half the opening angles, across and up, before the zoom
    pub fn framing(points: &[Vec3], target: Option<Vec3>, view: View, lens: [f32; 2], zoom: f32) -> Self {
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
            (from_middle.x.abs() / lens[0]).max(from_middle.y.abs() / lens[1]) * MARGIN - from_middle.z
        });
        let distance = distance.fold(0.0, f32::max).max(1e-6);
        let centre = middle.x * right + middle.y * up + middle.z * forward;
        let eye = centre - forward * distance;
        Self { eye, forward, right, up, lens: Lens::Pinhole(lens), depths: [0.0, f32::INFINITY] }.zoomed(zoom)
    }

    /// Looks from one point to another, with +y up in the picture, or -z where it looks straight up or down.
    ///
    /// # Errors
    /// [`RenderError::Camera`] for points that are one.
    pub fn looking(eye: Vec3, at: Vec3, lens: Lens) -> Result<Self, RenderError> {
        let forward = (at.as_dvec3() - eye.as_dvec3()).normalize_or_zero().as_vec3();
        let level = Vec3::new(forward.x, 0.0, forward.z);
        let up = if level.length() > 1e-6 { Vec3::Y } else { Vec3::NEG_Z };
        Self::oriented(eye, forward, up, lens, [0.0, f32::INFINITY])
    }

    /// Looks along a direction.
    ///
    /// - `up`: of any length but zero, not along `forward`
    /// - `depths`: distances along `forward` between which things are shown
    ///
    /// # Errors
    /// [`RenderError::Camera`] for directions or an opening that make no sense.
    pub fn oriented(
        eye: Vec3,
        forward: Vec3,
        up: Vec3,
        lens: Lens,
        depths: [f32; 2],
    ) -> Result<Self, RenderError> {
        let forward = forward.normalize_or_zero();
        let right = forward.cross(up).normalize_or_zero();
        let (Lens::Pinhole(half) | Lens::Parallel(half)) = lens;
        let fault = |what| Err(RenderError::Camera { what });
        if !eye.is_finite() {
            return fault("its place is not finite");
        }
        if forward == Vec3::ZERO {
            return fault("it looks at its own place");
        }
        if right == Vec3::ZERO {
            return fault("it looks straight along what is up");
        }
        if !half.iter().all(|h| h.is_finite() && *h > 0.0) {
            return fault("it has no opening");
        }
        Ok(Self { eye, forward, right, up: right.cross(forward), lens, depths })
    }

    /// The same with a picture that shows a part of what it did: half of it at 2.
    #[must_use]
    pub fn zoomed(mut self, zoom: f32) -> Self {
        let (Lens::Pinhole(half) | Lens::Parallel(half)) = &mut self.lens;
        *half = half.map(|h| h / zoom);
        self
    }

    /// The direction in which it looks, of unit length.
    pub fn forward(&self) -> Vec3 {
        self.forward
    }

    /// The point through which all rays pass, if there is one.
    pub(crate) fn pinhole(&self) -> Option<Vec3> {
        matches!(self.lens, Lens::Pinhole(_)).then_some(self.eye)
    }

    /// The line of sight through a place of the picture, `-1..=1` from left and bottom.
    pub fn ray(&self, x: f32, y: f32) -> Ray {
        match self.lens {
            Lens::Pinhole([across, up]) => {
                let direction = self.forward + across * x * self.right + up * y * self.up;
                // Depths are along the camera's axis, distances along the ray.
                let length = direction.length();
                Ray {
                    origin: self.eye,
                    direction: direction / length,
                    span: self.depths.map(|depth| depth * length),
                }
            }
            Lens::Parallel([across, up]) => Ray {
                origin: self.eye + across * x * self.right + up * y * self.up,
                direction: self.forward,
                span: self.depths,
            },
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A lens for square pictures.
    const LONG: [f32; 2] = [0.25; 2];

    fn view(name: &str) -> View {
        View::parse(name).unwrap()
    }

    #[test]
    fn camera_from_the_front_sees_x_to_the_right_and_y_up() {
        for (name, right) in [("front", Vec3::X), ("right", -Vec3::Z), ("back", -Vec3::X), ("left", Vec3::Z)]
        {
            let camera = Camera::framing(&[Vec3::ONE, -Vec3::ONE], None, view(name), LONG, 1.0);
            assert!(camera.right.abs_diff_eq(right, 1e-6), "{name}");
            assert!(camera.up.abs_diff_eq(Vec3::Y, 1e-6), "{name}");
            let ahead = camera.ray(0.0, 0.0);
            let past = ahead.origin + ahead.direction * ahead.origin.length();
            assert!(past.length() < 1e-4, "{name} looks at the middle");
        }
    }

    #[test]
    fn camera_shows_all_points_at_zoom_one() {
        let points = [Vec3::new(3.0, 1.0, -2.0), Vec3::new(-1.0, 0.0, 5.0), Vec3::new(0.0, -4.0, 0.0)];
        for name in ["front", "top", "three-quarter", "-120,-40"] {
            for lens in [LONG, [0.5, 0.25], [0.1, 0.3]] {
                let camera = Camera::framing(&points, None, view(name), lens, 1.0);
                for p in points {
                    let seen = p - camera.eye;
                    let (depth, x, y) =
                        (seen.dot(camera.forward), seen.dot(camera.right), seen.dot(camera.up));
                    let inside = x.abs() <= lens[0] * depth && y.abs() <= lens[1] * depth;
                    assert!(depth > 0.0 && inside, "{name}: {p}");
                }
            }
        }
    }

    #[test]
    fn camera_with_an_eye_sees_what_it_looks_at_in_the_middle() {
        let [eye, at] = [Vec3::new(1.0, 2.0, 3.0), Vec3::new(-4.0, 0.5, 1.0)];
        let camera = Camera::looking(eye, at, Lens::Pinhole([1.0, 0.5])).unwrap();
        let ray = camera.ray(0.0, 0.0);
        assert!((ray.origin + ray.direction * (at - eye).length()).abs_diff_eq(at, 1e-5));
        // Half a right angle to the side, and less up.
        assert!((camera.ray(1.0, 0.0).direction.dot(ray.direction) - 0.5_f32.sqrt()).abs() < 1e-6);
        assert!(camera.ray(0.0, 1.0).direction.y > ray.direction.y);
        let down = Camera::looking(Vec3::Y, Vec3::ZERO, Lens::Pinhole(LONG)).unwrap();
        assert_eq!((down.up, down.right), (Vec3::NEG_Z, Vec3::X));
        assert!(Camera::looking(eye, eye, Lens::Pinhole(LONG)).is_err());
        assert!(Camera::looking(eye, at, Lens::Pinhole([0.0, 1.0])).is_err());
        assert!(Camera::looking(Vec3::NAN, at, Lens::Pinhole(LONG)).is_err());
    }

    #[test]
    fn camera_of_parallel_rays_shows_its_width_and_its_depths() {
        let lens = Lens::Parallel([2.0, 1.0]);
        let camera = Camera::oriented(Vec3::Z, Vec3::NEG_Z, Vec3::Y, lens, [0.5, 3.0]).unwrap();
        let ray = camera.zoomed(2.0).ray(1.0, -1.0);
        assert_eq!((ray.origin, ray.direction), (Vec3::new(1.0, -0.5, 1.0), Vec3::NEG_Z));
        assert_eq!(ray.span, [0.5, 3.0]);
        let wide = Lens::Pinhole([1.0, 1.0]);
        let camera = Camera::oriented(Vec3::Z, Vec3::NEG_Z, Vec3::Y, wide, [0.5, 3.0]).unwrap();
        // At the edge, a plane at a depth is farther away.
        assert!((camera.ray(1.0, 0.0).span[0] - 0.5 * 2.0_f32.sqrt()).abs() < 1e-6);
    }

    #[test]
    fn view_list_reads_names_and_angles() {
        assert_eq!(View::parse("sideways"), None);
        assert_eq!(View::parse("10,200"), None);
        assert_eq!(View::parse("nan,0"), None);
        assert_eq!(View::parse("10"), None);
        assert_eq!(View::parse(""), None);
        assert_eq!(View::parse("front,top"), None);
        let views = View::parse_list("front,-30, 10,top").unwrap();
        assert_eq!(views.iter().map(|v| v.0.as_str()).collect::<Vec<_>>(), ["front", "-30,10", "top"]);
        assert_eq!(views[1].1, View { azimuth: -30.0, elevation: 10.0 });
    }
}
