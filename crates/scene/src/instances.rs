//! EXT_mesh_gpu_instancing: one node that draws its mesh many times.

use glam::{DMat4, DQuat, DVec3};
use serde_json::Value;

use crate::document::{Document, index};
use crate::error::{SceneError, value};
use crate::geometry::open;
use crate::nodes::transform;

/// The extension.
pub(crate) const INSTANCING: &str = "EXT_mesh_gpu_instancing";

/// Placement of one instance below its node.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Instance {
    pub translation: Option<[f32; 3]>,
    pub rotation: Option<[f32; 4]>,
    pub scale: Option<[f32; 3]>,
}

impl Instance {
    pub fn matrix(&self) -> DMat4 {
        transform(
            self.translation.map_or(DVec3::ZERO, |t| DVec3::from_array(t.map(f64::from))),
            self.rotation.map_or(DQuat::IDENTITY, |r| DQuat::from_array(r.map(f64::from))),
            self.scale.map_or(DVec3::ONE, |s| DVec3::from_array(s.map(f64::from))),
        )
    }
}

/// Reads the instances of a node from its extension object.
pub(crate) fn read(document: &Document, json: &Value) -> Result<Vec<Instance>, SceneError> {
    let attributes = json.get("attributes").ok_or_else(|| value("attributes", "missing", "an object"))?;
    let mut count = None;
    let mut get = |semantic: &str, width: usize| {
        let Some(accessor) = index(attributes, semantic, document.list("accessors").len())? else {
            return Ok(None);
        };
        let elements = open(document, accessor, semantic, width..=width, count)?;
        count = Some(elements.count());
        Ok::<_, SceneError>(Some(elements))
    };
    let translation = get("TRANSLATION", 3)?;
    let rotation = get("ROTATION", 4)?;
    let scale = get("SCALE", 3)?;
    let count = match count {
        Some(count) => count,
        // Custom attributes alone draw that many copies in one place.
        None => {
            let first = attributes.as_object().and_then(|o| o.keys().next().cloned()).unwrap_or_default();
            match index(attributes, &first, document.list("accessors").len())? {
                Some(accessor) => document.elements(accessor)?.count(),
                None => 0,
            }
        }
    };
    Ok((0..count)
        .map(|i| Instance {
            translation: translation.as_ref().map(|e| e.floats(i)),
            rotation: rotation.as_ref().map(|e| e.floats(i)),
            scale: scale.as_ref().map(|e| e.floats(i)),
        })
        .collect())
}
