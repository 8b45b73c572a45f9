//! Punctual lights (KHR_lights_punctual), where the node graph puts them.

use glam::{DMat4, DVec3, Vec3};
use serde_json::Value;

use crate::document::{Document, extension, index, list, name, numbers};
use crate::error::{Place, SceneError, Warnings, value};
use crate::nodes::{Nodes, place_of};

const PUNCTUAL: &str = "KHR_lights_punctual";
/// Light around a scene, which is passed as a file instead.
const IMAGE_BASED: &str = "EXT_lights_image_based";

/// A light without size.
#[derive(Clone, Debug, PartialEq)]
pub struct PunctualLight {
    /// The node that carries it.
    pub node: usize,
    /// The node's name, else the light's.
    pub name: Option<String>,
    /// What kind it is.
    pub kind: LightKind,
    /// Linear RGB, at least 0. The file limits it to 1, many exporters do not.
    pub color: [f32; 3],
    /// Lux for directional lights (on a surface that faces them), candela for the others; at least 0. `color` times
    /// `intensity` is the illuminance or luminous intensity in RGB.
    pub intensity: f32,
    /// World units beyond which the light may be cut off; `None` for no end. Positive.
    pub range: Option<f32>,
    /// World space; without meaning for directional lights.
    pub position: Vec3,
    /// World space, the way the light goes, of unit length; without meaning for point lights.
    pub direction: Vec3,
    /// Whether an animation moves it: it is baked where it stands.
    pub moves: bool,
}

/// Kinds of punctual lights.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum LightKind {
    /// Parallel light from infinitely far.
    Directional,
    /// The same into all directions.
    Point,
    /// A cone around the direction; angles in radians from the axis, `0 <= inner < outer <= pi / 2`. Light is full
    /// inside of the inner cone and falls off to nothing at the outer.
    Spot {
        /// Where the fall-off begins.
        inner: f32,
        /// Where it ends.
        outer: f32,
    },
}

/// Reads the lights of the nodes that are drawn. Lights that make no sense are errors when `strict`, and are left out
/// with a warning otherwise: ambient occlusion has no use of them.
pub(crate) fn read_lights(
    document: &Document,
    nodes: &Nodes,
    strict: bool,
    warnings: &mut Warnings,
) -> Result<Vec<PunctualLight>, SceneError> {
    let none = Value::Null;
    let lights = list(extension(&document.root, PUNCTUAL).unwrap_or(&none), "lights");
    let mut out = Vec::new();
    for &node in &nodes.visited {
        let json = &document.list("nodes")[node];
        let Some(owner) = extension(json, PUNCTUAL) else { continue };
        let read = || -> Result<_, SceneError> {
            let Some(light) = index(owner, "light", lights.len())? else { return Ok(None) };
            let mut light = read_light(&lights[light], nodes.world[node])
                .map_err(|e| e.at(|p| p.attribute = Some(format!("lights[{light}]"))))?;
            light.node = node;
            light.name = name(json).or(light.name);
            light.moves = nodes.moves[node];
            Ok(Some(light))
        };
        let place = || place_of(document, node);
        match read() {
            Ok(light) => out.extend(light),
            Err(e) if strict => {
                return Err(e.at(|p| {
                    let attribute = p.attribute.take();
                    *p = Place { attribute, ..place() };
                }));
            }
            Err(e) => warnings.add(format!("lights that make no sense are left out: {e}"), 1, place()),
        }
    }
    let surrounded = document.list("scenes").iter().any(|s| extension(s, IMAGE_BASED).is_some());
    if strict && surrounded {
        let message = "EXT_lights_image_based is not read: pass the environment as a file";
        warnings.add(message, 1, Place::default());
    }
    let moving: Vec<&PunctualLight> = out.iter().filter(|l| l.moves).collect();
    if let Some(first) = moving.first() {
        let place = place_of(document, first.node);
        warnings.add("animated lights shine from where they stand", moving.len(), place);
    }
    Ok(out)
}

/// A number that must be finite and at least 0, when it is there.
fn positive(owner: &Value, key: &str, default: f64) -> Result<f64, SceneError> {
    let Some(json) = owner.get(key) else { return Ok(default) };
    let fits = |v: &f64| v.is_finite() && *v >= 0.0 && *v <= f64::from(f32::MAX);
    json.as_f64().filter(fits).ok_or_else(|| value(key, json, "a number of at least 0"))
}

fn read_light(json: &Value, world: DMat4) -> Result<PunctualLight, SceneError> {
    let color = match numbers::<3>(json, "color")? {
        Some(color) if color.iter().all(|&c| (0.0..=f64::from(f32::MAX)).contains(&c)) => {
            color.map(|c| c as f32)
        }
        Some(color) => return Err(value("color", format!("{color:?}"), "numbers of at least 0")),
        None => [1.0; 3],
    };
    let kind = match json.get("type").and_then(Value::as_str) {
        Some("directional") => LightKind::Directional,
        Some("point") => LightKind::Point,
        Some("spot") => read_spot(json)?,
        other => return Err(value("type", other.unwrap_or("missing"), "directional, point or spot")),
    };
    let range = match json.get("range") {
        None | Some(Value::Null) => None,
        // Some exporters write 0 for a light without an end.
        Some(_) => Some(positive(json, "range", 0.0)? as f32).filter(|&r| r > 0.0),
    };
    let position = world.transform_point3(DVec3::ZERO).as_vec3();
    // Lights shine along the -z axis of their node; its scale plays no part, but a scale of 0 has no axis.
    let direction = world.transform_vector3(DVec3::NEG_Z).normalize_or_zero().as_vec3();
    if !position.is_finite() {
        return Err(value("its position", position, "finite numbers"));
    }
    if direction == Vec3::ZERO && kind != LightKind::Point {
        return Err(value("the scale of its node", 0, "a direction to shine in"));
    }
    Ok(PunctualLight {
        node: 0,
        name: name(json),
        kind,
        color,
        intensity: positive(json, "intensity", 1.0)? as f32,
        range,
        position,
        direction,
        moves: false,
    })
}

fn read_spot(json: &Value) -> Result<LightKind, SceneError> {
    let none = Value::Null;
    let spot = json.get("spot").unwrap_or(&none);
    let inner = positive(spot, "innerConeAngle", 0.0)?;
    let outer = positive(spot, "outerConeAngle", std::f64::consts::FRAC_PI_4)?;
    // Angles come in single precision from most exporters, so the right angle may be a little more than it is.
    let right = std::f64::consts::FRAC_PI_2;
    if !(1e-6..=right + 1e-3).contains(&outer) {
        return Err(value("spot.outerConeAngle", outer, "more than 0, at most pi / 2"));
    }
    if inner > outer + 1e-3 {
        return Err(value("spot.innerConeAngle", inner, "less than outerConeAngle"));
    }
    let outer = outer.min(right) as f32;
    // A cone without a fall-off is asked for by equal angles; a division needs a difference.
    let inner = (inner as f32).min(outer * (1.0 - 1e-4));
    Ok(LightKind::Spot { inner, outer })
}
