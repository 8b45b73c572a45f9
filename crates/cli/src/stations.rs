//! Where pictures are taken from, as the command line says it.

use glam::Vec3;
use lightkiln_bake::BakeError;
use lightkiln_mesh::Mesh;
use lightkiln_render::{Camera, Lens, View, frame};
use lightkiln_scene::{Projection, Scene, SceneCamera};

use crate::messages::{Exit, Failure};

/// A place to look from, before the scene is known.
#[derive(Clone, Debug, PartialEq)]
pub enum Station {
    /// An orbit that frames the scene.
    Orbit(View),
    /// A camera of the file, by name or number.
    Camera(String),
    /// A place, and what is looked at, if not the middle of the scene.
    Eye(Vec3, Option<Vec3>),
}

/// Where pictures are taken from.
#[derive(Clone, Debug)]
pub struct Stations {
    /// With their names for captions.
    pub list: Vec<(String, Station)>,
    /// What orbits have in the middle, if not the scene.
    pub target: Option<Vec3>,
    /// Angle from the lower to the upper edge of the picture, radians; none for a lens of each station's own.
    pub angle: Option<f32>,
    /// 2 shows half as much.
    pub zoom: f32,
    /// Width in pixels.
    pub width: usize,
    /// Height in pixels; that of the station if none.
    pub height: Option<usize>,
}

/// A camera and its picture.
#[derive(Clone, Copy, Debug)]
pub struct Shot {
    /// The camera.
    pub camera: Camera,
    /// Width and height in pixels.
    pub size: [usize; 2],
}

/// Half the opening angle of an orbit, as a tangent: a long lens, as product pictures have it.
pub const LONG_LENS: f32 = 0.25;

/// The opening angle at an eye, in degrees, if none is given.
const USUAL_ANGLE: f32 = 45.0;

impl Stations {
    /// The whole scene from the usual side in a square picture.
    pub fn usual(width: usize) -> Self {
        let list = vec![(String::new(), Station::Orbit(View::THREE_QUARTER))];
        Self { list, target: None, angle: None, zoom: 1.0, width, height: None }
    }

    /// The cameras for a scene.
    ///
    /// - `scene`: which of its file's
    ///
    /// # Errors
    /// A camera that the file does not have, or that makes no sense.
    pub fn shots(&self, file: &Scene, scene: Option<usize>, mesh: &Mesh) -> Result<Vec<Shot>, Failure> {
        self.list.iter().map(|(_, station)| self.shot(station, file, scene, mesh)).collect()
    }

    fn shot(
        &self,
        station: &Station,
        file: &Scene,
        scene: Option<usize>,
        mesh: &Mesh,
    ) -> Result<Shot, Failure> {
        let sized = |aspect: Option<f32>| {
            let height = aspect.map_or(self.width as f32, |aspect| self.width as f32 / aspect).round();
            [self.width, self.height.unwrap_or((height as usize).clamp(1, MOST_PIXELS))]
        };
        // Angles are measured upwards, whatever the shape of the picture.
        let pinhole =
            |tangent: f32, [width, height]: [usize; 2]| [tangent * width as f32 / height as f32, tangent];
        let tangent = |angle: f32| (angle / 2.0).tan();
        let (size, camera) = match station {
            Station::Orbit(view) => {
                let size = sized(None);
                let lens = pinhole(self.angle.map_or(LONG_LENS, tangent), size);
                let camera = framing(mesh, self.target, *view, lens, self.zoom);
                return Ok(Shot { camera, size });
            }
            Station::Eye(eye, at) => {
                let [low, high] = frame_of(mesh);
                let size = sized(None);
                let angle = self.angle.unwrap_or(USUAL_ANGLE.to_radians());
                let lens = Lens::Pinhole(pinhole(tangent(angle), size));
                (size, Camera::looking(*eye, at.unwrap_or((low + high) / 2.0), lens))
            }
            Station::Camera(wanted) => {
                let found = named(wanted, file.cameras(scene).map_err(BakeError::from)?)?;
                let size = sized(found.projection.aspect());
                let lens = match found.projection {
                    Projection::Perspective { vertical_angle, .. } => {
                        Lens::Pinhole(pinhole(tangent(self.angle.unwrap_or(vertical_angle)), size))
                    }
                    Projection::Orthographic { half: [_, up] } => Lens::Parallel(pinhole(up, size)),
                };
                let depths = [found.near, found.far];
                (size, Camera::oriented(found.position, found.forward, found.up, lens, depths))
            }
        };
        let camera = camera.map_err(|error| {
            Failure::new(Exit::Usage, error.to_string()).remedy("give --eye and --look two different points")
        })?;
        Ok(Shot { camera: camera.zoomed(self.zoom), size })
    }
}

/// A camera that frames a mesh, but for what went astray.
pub fn framing(mesh: &Mesh, target: Option<Vec3>, view: View, lens: [f32; 2], zoom: f32) -> Camera {
    let [low, high] = frame_of(mesh);
    let is_within = |p: &Vec3| p.cmpge(low).all() && p.cmple(high).all();
    let points: Vec<Vec3> = mesh.positions.iter().copied().filter(is_within).collect();
    Camera::framing(&points, target, view, lens, zoom)
}

fn frame_of(mesh: &Mesh) -> [Vec3; 2] {
    frame(mesh.triangles.len(), |t| mesh.triangles[t].map(|v| mesh.positions[v.index()]))
}

/// Reads `X,Y,Z`.
///
/// # Errors
/// Anything but three finite numbers.
pub fn xyz(text: &str) -> Result<Vec3, String> {
    let read = |t: &str| t.trim().parse::<f32>().ok().filter(|v| v.is_finite());
    match text.split(',').map(read).collect::<Option<Vec<f32>>>().as_deref() {
        Some(&[x, y, z]) => Ok(Vec3::new(x, y, z)),
        _ => Err("write it as three numbers: X,Y,Z".into()),
    }
}

/// Most pixels a side.
pub const MOST_PIXELS: usize = 8192;

/// The camera of that name; of that number, if none has the name.
fn named(wanted: &str, mut cameras: Vec<SceneCamera>) -> Result<SceneCamera, Failure> {
    let by_name = cameras.iter().position(|camera| camera.name.as_deref() == Some(wanted));
    let by_number = || wanted.parse().ok().filter(|&number: &usize| number < cameras.len());
    if let Some(found) = by_name.or_else(by_number) {
        return Ok(cameras.swap_remove(found));
    }
    let names = cameras.iter().enumerate().map(|(number, camera)| match &camera.name {
        Some(name) => format!("{number} {name:?}"),
        None => number.to_string(),
    });
    let names: Vec<String> = names.collect();
    let failure = Failure::new(Exit::Usage, format!("the file has no camera {wanted:?}"));
    Err(failure.remedy(if names.is_empty() {
        "it has none at all: use --view, or --eye with --look".to_owned()
    } else {
        format!("it has {}", names.join(", "))
    }))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn xyz_reads_three_numbers() {
        assert_eq!(xyz("-1, 0.5,2"), Ok(Vec3::new(-1.0, 0.5, 2.0)));
        assert!(xyz("1,2").is_err() && xyz("1,2,x").is_err() && xyz("1,2,inf").is_err());
    }
}
