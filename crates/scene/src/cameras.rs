//! Cameras of the file, where the node graph puts them (glTF 2.0, 3.10).

use glam::{DVec3, Vec3};
use serde_json::Value;

use crate::document::{index, name, number};
use crate::error::{Place, SceneError, Warnings, value};
use crate::nodes::{Nodes, place_of};
use crate::scene::Scene;

/// A camera that a node carries.
#[derive(Clone, Debug, PartialEq)]
pub struct SceneCamera {
    /// The node that carries it.
    pub node: usize,
    /// The node's name, else the camera's.
    pub name: Option<String>,
    /// World space.
    pub position: Vec3,
    /// World space, the way it looks, of unit length.
    pub forward: Vec3,
    /// World space, up in the picture, of unit length and at right angles to `forward`.
    pub up: Vec3,
    /// What it shows.
    pub projection: Projection,
    /// World units along `forward` before which nothing is shown, at least 0.
    pub near: f32,
    /// World units along `forward` beyond which nothing is shown; may be infinite.
    pub far: f32,
}

/// How space becomes a picture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Projection {
    /// Far things are small.
    Perspective {
        /// Angle from the lower to the upper edge of the picture, radians, above 0 and below pi.
        vertical_angle: f32,
        /// Width over height of the picture, where the file says one.
        aspect: Option<f32>,
    },
    /// Far things are as large as near ones.
    Orthographic {
        /// Half of the width and of the height that is shown, world units, above 0.
        half: [f32; 2],
    },
}

impl Projection {
    /// Width over height of the picture, where the file says one.
    pub fn aspect(&self) -> Option<f32> {
        match *self {
            Self::Perspective { aspect, .. } => aspect,
            Self::Orthographic { half: [x, y] } => Some(x / y),
        }
    }
}

impl Scene {
    /// The cameras of the nodes that are drawn, in the order in which the node graph visits them.
    ///
    /// Scale of their nodes plays no part.
    ///
    /// - `scene`: the scene that was read ([`ReadOptions::scene`](crate::ReadOptions::scene))
    ///
    /// # Errors
    /// Cameras that make no sense, with their node.
    pub fn cameras(&self, scene: Option<usize>) -> Result<Vec<SceneCamera>, SceneError> {
        let document = &self.document;
        let nodes = Nodes::read(document, scene, &mut Warnings::default())?;
        let cameras = document.list("cameras");
        let mut out = Vec::new();
        for &node in &nodes.visited {
            let json = &document.list("nodes")[node];
            let read = || -> Result<_, SceneError> {
                let Some(camera) = index(json, "camera", cameras.len())? else { return Ok(None) };
                let read = read_camera(&cameras[camera])
                    .map_err(|e| e.at(|p| p.attribute = Some(format!("cameras[{camera}]"))))?;
                let (projection, [near, far]) = read;
                let world = nodes.world[node];
                let axis = |axis: DVec3| world.transform_vector3(axis).normalize_or_zero();
                let forward = axis(DVec3::NEG_Z);
                let right = forward.cross(axis(DVec3::Y)).normalize_or_zero();
                if right == DVec3::ZERO || !world.is_finite() {
                    return Err(value("the transform of its node", 0, "two directions"));
                }
                Ok(Some(SceneCamera {
                    node,
                    name: name(json).or_else(|| name(&cameras[camera])),
                    position: world.transform_point3(DVec3::ZERO).as_vec3(),
                    forward: forward.as_vec3(),
                    up: right.cross(forward).as_vec3(),
                    projection,
                    near,
                    far,
                }))
            };
            let read = read().map_err(|e| {
                e.at(|p| {
                    let attribute = p.attribute.take();
                    *p = Place { attribute, ..place_of(document, node) };
                })
            });
            out.extend(read?);
        }
        Ok(out)
    }
}

fn read_camera(json: &Value) -> Result<(Projection, [f32; 2]), SceneError> {
    let none = Value::Null;
    let kind = json.get("type").and_then(Value::as_str).unwrap_or("missing");
    let owner = json.get(kind).unwrap_or(&none);
    let positive = |key: &str| {
        let found = number(owner, key, 0.0);
        if found > 0.0 { Ok(found) } else { Err(value(key, found, "more than 0")) }
    };
    let projection = match kind {
        "perspective" => {
            let vertical_angle = positive("yfov")?;
            if vertical_angle >= std::f32::consts::PI {
                return Err(value("yfov", vertical_angle, "less than pi"));
            }
            let aspect = owner.get("aspectRatio").map(|_| positive("aspectRatio")).transpose()?;
            Projection::Perspective { vertical_angle, aspect }
        }
        "orthographic" => {
            // Exporters write negative magnifications for pictures that are turned over; nobody shows them so.
            let half = |key| match number(owner, key, 0.0).abs() {
                0.0 => Err(value(key, 0.0, "another number than 0")),
                half => Ok(half),
            };
            Projection::Orthographic { half: [half("xmag")?, half("ymag")?] }
        }
        other => return Err(value("type", other, "perspective or orthographic")),
    };
    let near = number(owner, "znear", 0.0).max(0.0);
    let far = number(owner, "zfar", f32::INFINITY);
    let far = if far > near { far } else { f32::INFINITY };
    Ok((projection, [near, far]))
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;
    use crate::ReadOptions;

    fn cameras(cameras: Value, nodes: Value) -> Result<Vec<SceneCamera>, SceneError> {
        let scene: Vec<usize> = vec![0];
        let file = json!({"asset": {"version": "2.0"}, "cameras": cameras, "nodes": nodes,
            "scenes": [{"nodes": scene}]});
        Scene::read_bytes(file.to_string().as_bytes(), &ReadOptions::default()).unwrap().cameras(None)
    }

    #[test]
    fn cameras_stand_where_their_node_does() {
        // A quarter turn about y: the camera looks along -x. Scale changes nothing.
        let half = std::f32::consts::FRAC_1_SQRT_2;
        let nodes = json!([
            {"children": [1], "translation": [1, 2, 3], "scale": [2, 5, 2]},
            {"camera": 0, "name": "door", "rotation": [0, half, 0, half], "translation": [1, 0, 0]}
        ]);
        let file = json!([{"type": "perspective", "perspective": {"yfov": 1.0, "znear": 0.1}}]);
        let found = cameras(file, nodes).unwrap();
        assert_eq!((found.len(), found[0].node, found[0].name.as_deref()), (1, 1, Some("door")));
        assert!(found[0].position.abs_diff_eq(Vec3::new(3.0, 2.0, 3.0), 1e-6));
        assert!(found[0].forward.abs_diff_eq(-Vec3::X, 1e-6) && found[0].up.abs_diff_eq(Vec3::Y, 1e-6));
        assert_eq!((found[0].near, found[0].far), (0.1, f32::INFINITY));
        assert_eq!(found[0].projection, Projection::Perspective { vertical_angle: 1.0, aspect: None });
    }

    #[test]
    fn cameras_orthographic_have_an_aspect() {
        let file = json!([{"type": "orthographic",
            "orthographic": {"xmag": 4, "ymag": -2, "znear": 0, "zfar": 9}, "name": "plan"}]);
        let found = cameras(file, json!([{"camera": 0}])).unwrap();
        assert_eq!((found[0].projection.aspect(), found[0].far), (Some(2.0), 9.0));
        assert_eq!(found[0].name.as_deref(), Some("plan"));
    }

    #[test]
    fn cameras_that_make_no_sense_are_errors_with_their_place() {
        for bad in [
            json!({"type": "perspective", "perspective": {"yfov": 0}}),
            json!({"type": "perspective", "perspective": {"yfov": 4}}),
            json!({"type": "orthographic", "orthographic": {"xmag": 1}}),
            json!({"type": "fisheye"}),
            json!({}),
        ] {
            let error = cameras(json!([bad]), json!([{"camera": 0}])).unwrap_err();
            assert!(error.place().to_string().contains("cameras[0]"), "{bad}: {}", error.place());
        }
        assert!(cameras(json!([]), json!([{"camera": 0}])).is_err());
    }
}
