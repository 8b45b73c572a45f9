//! Pools of vertices: the primitives of a mesh that share all their attributes, as triangles in local space.

use std::collections::BTreeMap;

use glam::Vec3;
use serde_json::Value;

use crate::accessor::{Component, Elements};
use crate::document::{Document, index, integer, list, name, whole};
use crate::error::{Place, SceneError, Warnings, reference, value};
use crate::lookup::{Attributes, Lookup};
use crate::material::Material;
use crate::scene::ReadOptions;
use crate::variants::material_of;

/// What pools are read from, and how.
pub(crate) struct Source<'a> {
    pub document: &'a Document,
    pub materials: &'a [Material],
    pub variant: Option<usize>,
    pub options: &'a ReadOptions,
}

/// A pool in the space of its mesh.
#[derive(Clone, Debug)]
pub(crate) struct LocalPool {
    pub primitives: Vec<usize>,
    pub materials: Vec<Option<usize>>,
    pub lookups: Vec<Lookup>,
    pub positions: Vec<Vec3>,
    pub normals: Option<Vec<Vec3>>,
    /// glTF vertices of the pool, in the winding of the file.
    pub corners: Vec<[u32; 3]>,
    /// Index into `primitives`, per triangle.
    pub triangle_primitives: Vec<u32>,
    /// POSITION and NORMAL accessors of the morph targets.
    pub targets: Vec<[Option<usize>; 2]>,
    /// JOINTS_n and WEIGHTS_n accessors.
    pub influences: Vec<[usize; 2]>,
}

/// The accessor of an attribute of a primitive.
pub(crate) fn attribute(
    document: &Document,
    primitive: &Value,
    semantic: &str,
) -> Result<Option<usize>, SceneError> {
    match primitive.get("attributes") {
        Some(attributes) => index(attributes, semantic, document.list("accessors").len())
            .map_err(|e| e.at(|p| p.attribute = Some(semantic.to_owned()))),
        None => Ok(None),
    }
}

/// Opens the accessor of an attribute; it must have `count` elements if that is given.
pub(crate) fn open<'a>(
    document: &'a Document,
    accessor: usize,
    semantic: &str,
    width: std::ops::RangeInclusive<usize>,
    count: Option<usize>,
) -> Result<Elements<'a>, SceneError> {
    let at = |p: &mut Place| {
        p.accessor = Some(accessor);
        p.attribute = Some(semantic.to_owned());
    };
    let elements = document.elements(accessor).map_err(|e| e.at(at))?;
    if !width.contains(&elements.layout.width) {
        let kind = document.list("accessors")[accessor].get("type").cloned().unwrap_or(Value::Null);
        return Err(value("type", kind, "the type that the attribute needs").at(at));
    }
    match count {
        Some(expected) if expected != elements.count() => {
            let count = elements.count();
            Err(SceneError::Count { count, expected, place: Box::default() }.at(at))
        }
        _ => Ok(elements),
    }
}

/// The place of a primitive.
pub(crate) fn primitive_place(document: &Document, mesh: usize, primitive: usize) -> Place {
    let mesh_name = document.list("meshes").get(mesh).and_then(name);
    Place { mesh: Some(mesh), mesh_name, primitive: Some(primitive), ..Place::default() }
}

/// The mode of a primitive, if it draws triangles.
pub(crate) fn triangle_mode(primitive: &Value) -> Result<Option<u64>, SceneError> {
    match integer(primitive, "mode")?.unwrap_or(4) {
        mode @ 4..=6 => Ok(Some(mode)),
        0..=3 => Ok(None),
        other => Err(value("mode", other, "0 to 6")),
    }
}

/// What primitives of one pool have in common: all attributes and targets.
fn pool_key(primitive: &Value) -> String {
    let mut key = Vec::new();
    let mut put = |prefix: usize, attributes: Option<&Value>| {
        if let Some(object) = attributes.and_then(Value::as_object) {
            key.extend(object.iter().map(|(k, v)| (prefix, k.clone(), v.to_string())));
        }
    };
    put(0, primitive.get("attributes"));
    list(primitive, "targets").iter().enumerate().for_each(|(i, t)| put(i + 1, Some(t)));
    key.sort();
    format!("{key:?}")
}

/// Reads the pools of a mesh.
pub(crate) fn read_pools(
    source: &Source<'_>,
    mesh: usize,
    attributes: &mut Attributes,
    warnings: &mut Warnings,
) -> Result<Vec<LocalPool>, SceneError> {
    let json = &source.document.list("meshes")[mesh];
    let mut pools: Vec<LocalPool> = Vec::new();
    let mut pool_of: BTreeMap<String, usize> = BTreeMap::new();
    for (number, primitive) in list(json, "primitives").iter().enumerate() {
        let place = primitive_place(source.document, mesh, number);
        read_primitive(source, primitive, number, (&mut pools, &mut pool_of), attributes, warnings).map_err(
            |e| {
                e.at(|p| {
                    let (accessor, attribute) = (p.accessor, p.attribute.take());
                    *p = Place { accessor, attribute, ..place };
                })
            },
        )?;
    }
    // Triangles stand in the order of their primitives already: primitives are read in order.
    Ok(pools)
}

fn read_primitive(
    source: &Source<'_>,
    primitive: &Value,
    number: usize,
    (pools, pool_of): (&mut Vec<LocalPool>, &mut BTreeMap<String, usize>),
    attributes: &mut Attributes,
    warnings: &mut Warnings,
) -> Result<(), SceneError> {
    let document = source.document;
    let Some(mode) = triangle_mode(primitive)? else { return Ok(()) };
    let Some(position) = attribute(document, primitive, "POSITION")? else {
        let place = Place { primitive: Some(number), ..Place::default() };
        warnings.add("primitives without POSITION draw nothing and are left as they are", 1, place);
        return Ok(());
    };
    let key = pool_key(primitive);
    let known = pool_of.get(&key).copied();
    let vertices = match known {
        Some(pool) => pools[pool].positions.len(),
        None => open(document, position, "POSITION", 3..=3, None)?.count(),
    };
    let corners = read_corners(document, primitive, mode, vertices, source.options.max_triangles, warnings)?;
    if corners.is_empty() {
        return Ok(());
    }
    let material = material_of(document, primitive, source.variant)?;
    let shown = material.map(|m| &source.materials[m]);
    let lookup = attributes.lookup(document, primitive, shown, vertices, source.options.surfaces)?;
    let at = match known {
        Some(at) => at,
        None => {
            pools.push(read_vertices(document, primitive, position)?);
            pool_of.insert(key, pools.len() - 1);
            pools.len() - 1
        }
    };
    let pool = &mut pools[at];
    let local = pool.primitives.len() as u32;
    pool.primitives.push(number);
    pool.materials.push(material);
    pool.lookups.push(lookup);
    pool.triangle_primitives.resize(pool.corners.len() + corners.len(), local);
    pool.corners.extend(corners);
    Ok(())
}

fn read_vertices(document: &Document, primitive: &Value, position: usize) -> Result<LocalPool, SceneError> {
    let positions = open(document, position, "POSITION", 3..=3, None)?;
    let count = positions.count();
    let read = |elements: &Elements<'_>| {
        (0..count).map(|v| Vec3::from_array(elements.floats(v))).collect::<Vec<_>>()
    };
    let values = read(&positions);
    if let Some(element) = values.iter().position(|p| !p.is_finite()) {
        let value = values[element].to_array();
        return Err(SceneError::NotFinite { element, value, place: Box::default() }.at(|p| {
            p.accessor = Some(position);
            p.attribute = Some("POSITION".to_owned());
        }));
    }
    let normals = match attribute(document, primitive, "NORMAL")? {
        Some(accessor) => Some(read(&open(document, accessor, "NORMAL", 3..=3, Some(count))?)),
        None => None,
    };
    // Every attribute is copied when vertices are split, so every one is opened now, where errors are cheap.
    let none = serde_json::Map::new();
    let attributes = primitive.get("attributes").and_then(Value::as_object).unwrap_or(&none);
    for semantic in attributes.keys() {
        if let Some(accessor) = attribute(document, primitive, semantic)? {
            open(document, accessor, semantic, 1..=16, Some(count))?;
        }
    }
    let mut targets = Vec::new();
    let accessors = document.list("accessors").len();
    for target in list(primitive, "targets") {
        for (semantic, accessor) in target.as_object().unwrap_or(&none) {
            let accessor = whole(accessor).filter(|&a| a < accessors as u64).ok_or_else(|| {
                reference(semantic.as_str(), whole(accessor).unwrap_or(u64::MAX), accessors)
            })?;
            open(document, accessor as usize, semantic, 1..=4, Some(count))?;
        }
        targets.push([index(target, "POSITION", accessors)?, index(target, "NORMAL", accessors)?]);
        for accessor in targets.last().into_iter().flatten().flatten() {
            open(document, *accessor, "target", 3..=3, Some(count))?;
        }
    }
    let mut influences = Vec::new();
    for set in 0.. {
        let joints = attribute(document, primitive, &format!("JOINTS_{set}"))?;
        let weights = attribute(document, primitive, &format!("WEIGHTS_{set}"))?;
        let (Some(joints), Some(weights)) = (joints, weights) else { break };
        open(document, joints, "JOINTS", 4..=4, Some(count))?;
        open(document, weights, "WEIGHTS", 4..=4, Some(count))?;
        influences.push([joints, weights]);
    }
    Ok(LocalPool {
        primitives: Vec::new(),
        materials: Vec::new(),
        lookups: Vec::new(),
        positions: values,
        normals,
        corners: Vec::new(),
        triangle_primitives: Vec::new(),
        targets,
        influences,
    })
}

/// The triangles of a primitive as vertices of its pool, in the winding of the file.
pub(crate) fn read_corners(
    document: &Document,
    primitive: &Value,
    mode: u64,
    vertices: usize,
    max_triangles: usize,
    warnings: &mut Warnings,
) -> Result<Vec<[u32; 3]>, SceneError> {
    let accessor = index(primitive, "indices", document.list("accessors").len())?;
    let indices = match accessor {
        None => None,
        Some(accessor) => {
            let elements = open(document, accessor, "indices", 1..=1, None)?;
            if !matches!(elements.layout.component, Component::U8 | Component::U16 | Component::U32) {
                return Err(value("indices.componentType", "signed or float", "5121, 5123 or 5125"));
            }
            Some((accessor, elements))
        }
    };
    let count = indices.as_ref().map_or(vertices, |(_, e)| e.count());
    let triangles = if mode == 4 { count / 3 } else { count.saturating_sub(2) };
    if triangles > max_triangles {
        return Err(SceneError::TooLarge {
            what: "triangles",
            count: triangles as u64,
            limit: max_triangles as u64,
            place: Box::default(),
        });
    }
    if mode == 4 && !count.is_multiple_of(3) {
        warnings.add("triangle lists whose last triangle is incomplete; it is left out", 1, Place::default());
    }
    let vertex = |element: usize| -> Result<u32, SceneError> {
        let Some((accessor, elements)) = &indices else { return Ok(element as u32) };
        let index = elements.u32(element, 0);
        if index as usize >= vertices {
            return Err(SceneError::VertexIndex { element, index, vertices, place: Box::default() }.at(
                |p| {
                    p.accessor = Some(*accessor);
                    p.attribute = Some("indices".to_owned());
                },
            ));
        }
        Ok(index)
    };
    // The order of strips and fans is that of glTF 2.0, 3.7.2.1.
    (0..triangles)
        .map(|t| {
            let [a, b, c] = match mode {
                4 => [3 * t, 3 * t + 1, 3 * t + 2],
                5 => [t, t + 1 + t % 2, t + 2 - t % 2],
                _ => [t + 1, t + 2, 0],
            };
            Ok([vertex(a)?, vertex(b)?, vertex(c)?])
        })
        .collect()
}
