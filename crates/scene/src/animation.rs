//! Which nodes an animation moves from where they stand at rest.
//!
//! Exporters write channels for every bone and every part, most of which never change. A channel whose every key is the
//! node's own transform moves nothing, and morph weights bend a mesh where it stands.

use serde_json::Value;

use crate::accessor::Elements;
use crate::document::{Document, extension, index, list, numbers, whole};
use crate::error::SceneError;
use crate::geometry::open;

/// A key is the rest pose up to this share of its largest component: what single precision leaves of a transform that
/// was taken apart and put together.
const STILL: f64 = 1e-5;
/// The same for turns, which are often kept in 12 or 16 bits.
const STILL_TURN: f64 = 5e-4;

/// Whether an animation changes the transform of a node, per node; what is above a node does not count.
pub(crate) fn animated_nodes(document: &Document) -> Vec<bool> {
    let nodes = document.list("nodes");
    let mut moves = vec![false; nodes.len()];
    for animation in document.list("animations") {
        for channel in list(animation, "channels") {
            let Some((node, path)) = target(channel) else { continue };
            // A channel that cannot be read may do anything.
            if let Some(json) = nodes.get(node)
                && !moves[node]
            {
                moves[node] = changes(document, animation, channel, json, path).unwrap_or(true);
            }
        }
    }
    moves
}

/// The node that a channel is for, and what of it.
fn target(channel: &Value) -> Option<(usize, &str)> {
    let target = channel.get("target")?;
    match extension(target, "KHR_animation_pointer") {
        // "/nodes/3/translation"
        Some(pointer) => {
            let (node, path) = pointer.get("pointer")?.as_str()?.strip_prefix("/nodes/")?.split_once('/')?;
            Some((node.parse().ok()?, path))
        }
        None => Some((whole(target.get("node")?)? as usize, target.get("path")?.as_str()?)),
    }
}

/// Whether any key of a channel is another transform than that of the node at rest.
fn changes(
    document: &Document,
    animation: &Value,
    channel: &Value,
    node: &Value,
    path: &str,
) -> Result<bool, SceneError> {
    let (rest, still) = match path {
        "translation" => (numbers::<3>(node, path)?.unwrap_or([0.0; 3]).to_vec(), STILL),
        "scale" => (numbers::<3>(node, path)?.unwrap_or([1.0; 3]).to_vec(), STILL),
        "rotation" => (numbers::<4>(node, path)?.unwrap_or([0.0, 0.0, 0.0, 1.0]).to_vec(), STILL_TURN),
        "matrix" => return Ok(true),
        _ => return Ok(false),
    };
    let samplers = list(animation, "samplers");
    let sampler = index(channel, "sampler", samplers.len())?.map(|sampler| &samplers[sampler]);
    let Some(sampler) = sampler.filter(|_| node.get("matrix").is_none()) else { return Ok(true) };
    let Some(output) = index(sampler, "output", document.list("accessors").len())? else { return Ok(true) };
    let keys = open(document, output, "output", rest.len()..=rest.len(), None)?;
    let is_spline = sampler.get("interpolation").and_then(Value::as_str) == Some("CUBICSPLINE");
    Ok(leaves(&keys, is_spline, &rest, still))
}

/// Whether any key is not the rest pose. Splines have a tangent before and after each key, which must be nothing.
fn leaves(keys: &Elements<'_>, is_spline: bool, rest: &[f64], still: f64) -> bool {
    let largest = rest.iter().fold(0.0_f64, |a, v| a.max(v.abs()));
    let near = |element: usize, expected: &dyn Fn(usize) -> f64| {
        (0..rest.len())
            .all(|c| (f64::from(keys.f32(element, c)) - expected(c)).abs() <= (still * largest).max(1e-6))
    };
    let is_rest = |element: usize| {
        // A turn and its negative are the same.
        near(element, &|c| rest[c]) || (rest.len() == 4 && near(element, &|c| -rest[c]))
    };
    (0..keys.count()).any(|element| match (is_spline, element % 3) {
        (true, 0 | 2) => !near(element, &|_| 0.0),
        _ => !is_rest(element),
    })
}
