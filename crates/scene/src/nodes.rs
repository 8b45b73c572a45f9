//! The node graph: who hangs below whom, where everything stands, and what moves.

use glam::{DMat4, DQuat, DVec3};
use serde_json::Value;

use crate::animation::animated_nodes;
use crate::document::{Document, extension, index, list, name, numbers, whole};
use crate::error::{Place, SceneError, Warnings, reference, value};

/// The graph of a file, checked to be a forest.
#[derive(Debug)]
pub(crate) struct Nodes {
    /// World from local, per node.
    pub world: Vec<DMat4>,
    /// Nodes of the scene, parents first, in the order of the file.
    pub visited: Vec<usize>,
    /// The node above, per node.
    pub parent: Vec<Option<usize>>,
    /// Whether an animation moves the node or one above, per node.
    pub moves: Vec<bool>,
}

/// The place of a node.
pub(crate) fn place_of(document: &Document, node: usize) -> Place {
    let node_name = document.list("nodes").get(node).and_then(name);
    Place { node: Some(node), node_name, ..Place::default() }
}

/// The children of a node or the roots of a scene, checked.
fn children(owner: &Value, key: &str, count: usize) -> Result<Vec<usize>, SceneError> {
    list(owner, key)
        .iter()
        .map(|v| match whole(v) {
            Some(n) if n < count as u64 => Ok(n as usize),
            Some(n) => Err(reference(key, n, count)),
            None => Err(value(key, v, "numbers of nodes")),
        })
        .collect()
}

impl Nodes {
    pub fn read(
        document: &Document,
        scene: Option<usize>,
        warnings: &mut Warnings,
    ) -> Result<Self, SceneError> {
        let nodes = document.list("nodes");
        let at = |node: usize| {
            move |e: SceneError| e.at(|p| *p = Place { file: p.file.take(), ..place_of(document, node) })
        };
        let mut parent = vec![None; nodes.len()];
        let mut below = Vec::with_capacity(nodes.len());
        for (number, node) in nodes.iter().enumerate() {
            let list = children(node, "children", nodes.len()).map_err(at(number))?;
            for &child in &list {
                if let Some(first) = parent[child].replace(number) {
                    return Err(two_parents(format!("nodes[{first}]"), format!("nodes[{number}]")))
                        .map_err(at(child));
                }
            }
            below.push(list);
        }
        let order =
            parents_first(&parent).map_err(|node| at(node)(SceneError::Cycle { place: Box::default() }))?;
        let mut world = vec![DMat4::IDENTITY; nodes.len()];
        for &node in &order {
            let local = local_transform(&nodes[node]).map_err(at(node))?;
            world[node] = parent[node].map_or(local, |p: usize| world[p] * local);
        }
        let scenes = document.list("scenes");
        let wanted = match scene {
            Some(scene) if scene >= scenes.len() => {
                return Err(SceneError::NoScene { scene, count: scenes.len(), place: Box::default() });
            }
            Some(n) => Some(n),
            None => index(&document.root, "scene", scenes.len())?.or((!scenes.is_empty()).then_some(0)),
        };
        let roots = match wanted {
            Some(n) => children(&scenes[n], "nodes", nodes.len())?,
            None => (0..nodes.len()).filter(|&n| parent[n].is_none()).collect(),
        };
        let mut listed = vec![false; nodes.len()];
        for &root in &roots {
            let scene = || format!("scenes[{}]", wanted.unwrap_or(0));
            if let Some(p) = parent[root] {
                return Err(two_parents(scene(), format!("nodes[{p}]"))).map_err(at(root));
            }
            if std::mem::replace(&mut listed[root], true) {
                return Err(two_parents(scene(), scene())).map_err(at(root));
            }
        }
        let mut visited = Vec::new();
        let mut stack: Vec<usize> = roots.into_iter().rev().collect();
        while let Some(node) = stack.pop() {
            let hidden = extension(&nodes[node], "KHR_node_visibility")
                .is_some_and(|e| e.get("visible").and_then(Value::as_bool) == Some(false));
            if hidden {
                warnings.add("hidden nodes are left out of the bake", 1, place_of(document, node));
                continue;
            }
            visited.push(node);
            stack.extend(below[node].iter().rev());
        }
        let mut moves = animated_nodes(document);
        for node in order {
            moves[node] |= parent[node].is_some_and(|p| moves[p]);
        }
        Ok(Self { world, visited, parent, moves })
    }
}

fn two_parents(first: String, second: String) -> SceneError {
    SceneError::TwoParents { first, second, place: Box::default() }
}

/// An order in which parents come before their children, or a node on a cycle.
fn parents_first(parent: &[Option<usize>]) -> Result<Vec<usize>, usize> {
    let mut order = Vec::with_capacity(parent.len());
    let mut state = vec![0_u8; parent.len()];
    let mut chain = Vec::new();
    for start in 0..parent.len() {
        let mut at = Some(start);
        while let Some(node) = at.filter(|&n| state[n] == 0) {
            state[node] = 1;
            chain.push(node);
            at = parent[node];
        }
        if let Some(node) = at.filter(|&n| state[n] == 1) {
            return Err(node);
        }
        while let Some(node) = chain.pop() {
            state[node] = 2;
            order.push(node);
        }
    }
    Ok(order)
}

fn local_transform(node: &Value) -> Result<DMat4, SceneError> {
    if let Some(matrix) = numbers::<16>(node, "matrix")? {
        return Ok(DMat4::from_cols_array(&matrix));
    }
    let translation = numbers::<3>(node, "translation")?.map_or(DVec3::ZERO, DVec3::from_array);
    let rotation = numbers::<4>(node, "rotation")?.map_or(DQuat::IDENTITY, DQuat::from_array);
    let scale = numbers::<3>(node, "scale")?.map_or(DVec3::ONE, DVec3::from_array);
    Ok(transform(translation, rotation, scale))
}

/// Translation times rotation times scale; a rotation of no length is none.
pub(crate) fn transform(translation: DVec3, rotation: DQuat, scale: DVec3) -> DMat4 {
    let length = rotation.length();
    let rotation = if length > 0.0 && length.is_finite() { rotation / length } else { DQuat::IDENTITY };
    DMat4::from_scale_rotation_translation(scale, rotation, translation)
}
