//! Who takes part in the light: parts chosen by name, and what `extras` say of casting and receiving.
//!
//! `"extras": {"lightkiln": {"cast": false, "receive": false}}` may stand on nodes, meshes and materials. A node
//! speaks for all nodes below it that do not speak for themselves; a mesh or a material that says `false` says so
//! for everything that shows it. The flat forms `lightkiln_cast` and `lightkiln_receive` mean the same, because
//! modelling programs write flat properties; 0 and 1 are taken for `false` and `true`.

use serde_json::Value;

use crate::document::{Document, list, name, whole};
use crate::error::{Place, SceneError, Warnings, value};
use crate::scene::Scene;

/// What a surface does with light.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Roles {
    /// Whether it stands in the way of light.
    pub casts: bool,
    /// Whether light is baked onto it.
    pub receives: bool,
}

impl Roles {
    pub(crate) const BOTH: Self = Self { casts: true, receives: true };

    pub(crate) fn and(self, other: Self) -> Self {
        Self { casts: self.casts && other.casts, receives: self.receives && other.receives }
    }
}

/// What the extras of an object say: for each role nothing, or yes or no.
fn stated(json: &Value, warnings: &mut Warnings) -> Result<[Option<bool>; 2], SceneError> {
    let Some(extras) = json.get("extras") else { return Ok([None; 2]) };
    let none = Value::Null;
    let ours = extras.get("lightkiln").unwrap_or(&none);
    for key in ours.as_object().into_iter().flat_map(|o| o.keys()) {
        if key != "cast" && key != "receive" {
            let message = format!("extras.lightkiln.{key} is not known and does nothing");
            warnings.add(message, 1, Place::default());
        }
    }
    let mut out = [None; 2];
    for (out, key) in out.iter_mut().zip(["cast", "receive"]) {
        let flat = format!("lightkiln_{key}");
        let found = ours.get(key).map(|v| (format!("extras.lightkiln.{key}"), v));
        let Some((field, json)) = found.or_else(|| extras.get(&flat).map(|v| (format!("extras.{flat}"), v)))
        else {
            continue;
        };
        *out = match (json.as_bool(), whole(json)) {
            (Some(flag), _) => Some(flag),
            (None, Some(flag @ 0..=1)) => Some(flag == 1),
            _ => return Err(value(field, json, "true or false")),
        };
    }
    Ok(out)
}

/// The roles that the objects of an array give to what shows them.
pub(crate) fn read_roles(
    document: &Document,
    key: &str,
    warnings: &mut Warnings,
) -> Result<Vec<Roles>, SceneError> {
    let read = |(number, json): (usize, &Value)| {
        let at = |p: &mut Place| p.attribute = Some(format!("{key}[{number}]"));
        let [casts, receives] = stated(json, warnings).map_err(|e| e.at(at))?.map(|s| s.unwrap_or(true));
        Ok(Roles { casts, receives })
    };
    document.list(key).iter().enumerate().map(read).collect()
}

/// The roles of nodes: what they say themselves, else what the node above says.
///
/// - `visited`: nodes of the scene, parents first
pub(crate) fn node_roles(
    document: &Document,
    visited: &[usize],
    parent: &[Option<usize>],
    warnings: &mut Warnings,
) -> Result<Vec<Roles>, SceneError> {
    let nodes = document.list("nodes");
    let mut out = vec![Roles::BOTH; nodes.len()];
    for &node in visited {
        let above = parent[node].map_or(Roles::BOTH, |p| out[p]);
        let [casts, receives] = stated(&nodes[node], warnings)
            .map_err(|e| e.at(|p| *p = crate::nodes::place_of(document, node)))?;
        out[node] =
            Roles { casts: casts.unwrap_or(above.casts), receives: receives.unwrap_or(above.receives) };
    }
    Ok(out)
}

/// Whether a name matches a pattern: `*` stands for any characters, `?` for any one, all else for itself.
fn matches(pattern: &str, name: &str) -> bool {
    let (pattern, name): (Vec<char>, Vec<char>) = (pattern.chars().collect(), name.chars().collect());
    let (mut p, mut n) = (0, 0);
    // Where to go on when a star takes one character more.
    let mut retry = None;
    while n < name.len() {
        match pattern.get(p) {
            Some('*') => {
                p += 1;
                retry = Some((p, n));
            }
            Some(&c) if c == '?' || c == name[n] => (p, n) = (p + 1, n + 1),
            _ => match retry {
                Some((after, from)) => {
                    retry = Some((after, from + 1));
                    (p, n) = (after, from + 1);
                }
                None => return false,
            },
        }
    }
    pattern[p..].iter().all(|&c| c == '*')
}

impl Scene {
    /// What a part does with light: a role is lost only when all its primitives lose it.
    ///
    /// # Panics
    /// For a part that the scene does not have.
    pub fn roles(&self, part: usize) -> Roles {
        let none = Roles { casts: false, receives: false };
        self.sources[part]
            .roles
            .iter()
            .fold(none, |sum, r| Roles { casts: sum.casts || r.casts, receives: sum.receives || r.receives })
    }

    /// What a triangle does with light: primitives of one part may differ by their materials.
    ///
    /// # Panics
    /// For a triangle that the scene does not have.
    pub fn triangle_roles(&self, part: usize, triangle: usize) -> Roles {
        self.sources[part].roles[self.parts[part].triangle_primitives[triangle] as usize]
    }

    /// Whether a part moves, per part: an animation takes its node or a node above away from where it stands in the
    /// file, or a joint of its skin. It is read where it stands. Parts that are morphed stay in place and do not count.
    pub fn moving_parts(&self) -> Vec<bool> {
        self.sources.iter().map(|s| s.moves).collect()
    }

    /// Chooses parts by the names of their nodes and of all nodes above these; a node without a name is called as
    /// [`Self::part_name`] says. `*` stands for any characters and `?` for any one.
    ///
    /// - `include`: parts that match one of these are chosen; when there are none, all parts are
    /// - `exclude`: parts that match one of these are not chosen after all
    /// - returns: per part, whether it is chosen
    ///
    /// # Errors
    /// [`SceneError::NoMatch`] for a pattern that matches no part.
    pub fn select(&self, include: &[String], exclude: &[String]) -> Result<Vec<bool>, SceneError> {
        let nodes = self.document.list("nodes");
        let mut parent = vec![None; nodes.len()];
        for (number, node) in nodes.iter().enumerate() {
            for child in list(node, "children").iter().filter_map(whole) {
                if let Some(slot) = parent.get_mut(child as usize) {
                    *slot = Some(number);
                }
            }
        }
        let names: Vec<Vec<String>> = self
            .parts
            .iter()
            .map(|part| {
                let own = name(&nodes[part.node]);
                let own = own.or_else(|| self.document.list("meshes").get(part.mesh).and_then(name));
                let mut names = vec![own.unwrap_or_else(|| format!("node {}", part.node))];
                // Reading has refused cycles.
                let mut at = parent[part.node];
                while let Some(node) = at {
                    names.extend(name(&nodes[node]));
                    at = parent[node];
                }
                names
            })
            .collect();
        let hits = |pattern: &String| -> Result<Vec<bool>, SceneError> {
            let hits: Vec<bool> = names.iter().map(|n| n.iter().any(|n| matches(pattern, n))).collect();
            if hits.contains(&true) {
                return Ok(hits);
            }
            Err(SceneError::NoMatch { pattern: pattern.clone(), place: Box::default() }
                .at(|p| p.file.clone_from(&self.document.path)))
        };
        let mut chosen = vec![include.is_empty(); self.parts.len()];
        for pattern in include {
            chosen.iter_mut().zip(hits(pattern)?).for_each(|(c, hit)| *c |= hit);
        }
        for pattern in exclude {
            chosen.iter_mut().zip(hits(pattern)?).for_each(|(c, hit)| *c &= !hit);
        }
        Ok(chosen)
    }
}

#[cfg(test)]
mod tests {
    use super::matches;

    #[test]
    fn roles_patterns_match_whole_names() {
        for (pattern, name, expected) in [
            ("wheel", "wheel", true),
            ("wheel", "wheel.001", false),
            ("wheel*", "wheel.001", true),
            ("*heel*", "wheel.001", true),
            ("*.00?", "wheel.001", true),
            ("?", "", false),
            ("*", "", true),
            ("**", "x", true),
            ("a*b*c", "aXbYbZc", true),
            ("a*b*c", "aXbYbZ", false),
            ("r?d", "räd", true),
            ("", "", true),
            ("", "a", false),
            ("a*", "*", false),
        ] {
            assert_eq!(matches(pattern, name), expected, "{pattern} {name}");
        }
    }
}
