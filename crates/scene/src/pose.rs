//! Where the vertices of a pool stand in the world: node transforms, skins and morph targets at rest.

use glam::{DMat3, DMat4, DVec3, Vec3};
use serde_json::Value;

use crate::document::{Document, index, list, whole};
use crate::error::{Place, SceneError, Warnings, reference, value};
use crate::geometry::{LocalPool, open};
use crate::nodes::Nodes;

/// World positions and normals of a pool's vertices.
pub(crate) struct Posed {
    pub positions: Vec<Vec3>,
    /// Not normalized yet; absent when the file has none.
    pub normals: Option<Vec<Vec3>>,
    /// Whether the transform mirrors, so that the winding turns round.
    pub mirrored: bool,
}

/// The joints of a skin.
pub(crate) struct Skin {
    matrices: Vec<DMat4>,
    /// Whether an animation moves one of them.
    pub moves: bool,
}

/// What carries normals: the matrix of cofactors, which is the inverse transpose up to a positive factor, and
/// exists for singular matrices too.
fn normal_matrix(m: DMat3) -> DMat3 {
    let sign = if m.determinant() < 0.0 { -1.0 } else { 1.0 };
    let (a, b, c) = (m.x_axis, m.y_axis, m.z_axis);
    DMat3::from_cols(b.cross(c), c.cross(a), a.cross(b)) * sign
}

/// The matrices that carry vertices from bind space into the world.
pub(crate) fn read_skin(document: &Document, skin: usize, nodes: &Nodes) -> Result<Skin, SceneError> {
    let json = &document.list("skins")[skin];
    let joints = list(json, "joints")
        .iter()
        .map(|v| match whole(v) {
            Some(n) if n < nodes.world.len() as u64 => Ok(n as usize),
            Some(n) => Err(reference("skin.joints", n, nodes.world.len())),
            None => Err(value("skin.joints", v, "numbers of nodes")),
        })
        .collect::<Result<Vec<_>, _>>()?;
    let inverse = match index(json, "inverseBindMatrices", document.list("accessors").len())? {
        Some(accessor) => {
            let elements = open(document, accessor, "inverseBindMatrices", 16..=16, None)?;
            if elements.count() < joints.len() {
                let (count, expected) = (elements.count(), joints.len());
                return Err(SceneError::Count { count, expected, place: Box::default() });
            }
            Some(elements)
        }
        None => None,
    };
    let matrix = |(i, &joint): (usize, &usize)| {
        let bind = inverse
            .as_ref()
            .map_or(DMat4::IDENTITY, |e| DMat4::from_cols_array(&e.floats::<16>(i).map(f64::from)));
        nodes.world[joint] * bind
    };
    let moves = joints.iter().any(|&j| nodes.moves[j]);
    Ok(Skin { matrices: joints.iter().enumerate().map(matrix).collect(), moves })
}

/// Poses a pool as one node (or instance) shows it.
pub(crate) fn pose(
    document: &Document,
    pool: &LocalPool,
    node: &Value,
    mesh: &Value,
    world: DMat4,
    skin: Option<&Skin>,
    warnings: &mut Warnings,
) -> Result<Posed, SceneError> {
    let morphed = morph(document, pool, node, mesh, warnings)?;
    let (positions, normals) = match &morphed {
        Some((positions, normals)) => (positions.as_slice(), normals.as_deref()),
        None => (pool.positions.as_slice(), pool.normals.as_deref()),
    };
    let posed = match skin.filter(|_| !pool.influences.is_empty()) {
        Some(skin) => skinned(document, pool, positions, normals, skin)?,
        None => {
            let linear = DMat3::from_mat4(world);
            let carry = normal_matrix(linear);
            Posed {
                positions: positions.iter().map(|p| world.transform_point3(p.as_dvec3()).as_vec3()).collect(),
                normals: normals.map(|n| n.iter().map(|n| direction(carry * n.as_dvec3())).collect()),
                mirrored: linear.determinant() < 0.0,
            }
        }
    };
    if let Some(element) = posed.positions.iter().position(|p| !p.is_finite()) {
        let value = posed.positions[element].to_array();
        return Err(SceneError::NotFinite { element, value, place: Box::default() }
            .at(|p| p.attribute = Some("POSITION in world space".to_owned())));
    }
    Ok(posed)
}

/// Scaled to unit length in double precision, so that tiny and huge scales survive.
fn direction(v: DVec3) -> Vec3 {
    v.normalize_or_zero().as_vec3()
}

type Arrays = (Vec<Vec3>, Option<Vec<Vec3>>);

/// Applies the default weights of morph targets; `None` when there is nothing to apply.
fn morph(
    document: &Document,
    pool: &LocalPool,
    node: &Value,
    mesh: &Value,
    warnings: &mut Warnings,
) -> Result<Option<Arrays>, SceneError> {
    if pool.targets.is_empty() {
        return Ok(None);
    }
    warnings.add("morph targets are baked at their default weights", 1, Place::default());
    let weights = if node.get("weights").is_some() { list(node, "weights") } else { list(mesh, "weights") };
    let weights: Vec<f32> = weights.iter().map(|w| w.as_f64().unwrap_or(0.0) as f32).collect();
    if weights.iter().all(|&w| w == 0.0) {
        return Ok(None);
    }
    let (mut positions, mut normals) = (pool.positions.clone(), pool.normals.clone());
    let count = positions.len();
    for (&[position, normal], &weight) in pool.targets.iter().zip(&weights) {
        if let Some(accessor) = position {
            let offsets = open(document, accessor, "POSITION", 3..=3, Some(count))?;
            positions
                .iter_mut()
                .enumerate()
                .for_each(|(v, p)| *p += weight * Vec3::from_array(offsets.floats(v)));
        }
        if let (Some(accessor), Some(normals)) = (normal, normals.as_mut()) {
            let offsets = open(document, accessor, "NORMAL", 3..=3, Some(count))?;
            normals
                .iter_mut()
                .enumerate()
                .for_each(|(v, n)| *n += weight * Vec3::from_array(offsets.floats(v)));
        }
    }
    Ok(Some((positions, normals)))
}

/// Linear blend skinning (glTF 2.0, 3.7.3.3); the transform of the node itself plays no part.
fn skinned(
    document: &Document,
    pool: &LocalPool,
    positions: &[Vec3],
    normals: Option<&[Vec3]>,
    skin: &Skin,
) -> Result<Posed, SceneError> {
    let count = positions.len();
    let mut blended = vec![[0.0_f64; 16]; count];
    let mut totals = vec![0.0_f64; count];
    for &[joints, weights] in &pool.influences {
        let joint_values = open(document, joints, "JOINTS", 4..=4, Some(count))?;
        let weight_values = open(document, weights, "WEIGHTS", 4..=4, Some(count))?;
        for v in 0..count {
            for k in 0..4 {
                let weight = f64::from(weight_values.f32(v, k));
                if weight == 0.0 || !weight.is_finite() {
                    continue;
                }
                let joint = joint_values.u32(v, k) as usize;
                let matrix = skin.matrices.get(joint).ok_or_else(|| {
                    reference("a joint", joint as u64, skin.matrices.len()).at(|p| p.accessor = Some(joints))
                })?;
                for (sum, m) in blended[v].iter_mut().zip(matrix.to_cols_array()) {
                    *sum += weight * m;
                }
                totals[v] += weight;
            }
        }
    }
    let matrix = |v: usize| {
        // Weights need not sum to one after quantization.
        if totals[v] == 0.0 {
            DMat4::IDENTITY
        } else {
            DMat4::from_cols_array(&blended[v].map(|m| m / totals[v]))
        }
    };
    let mirrored =
        (0..count).filter(|&v| DMat3::from_mat4(matrix(v)).determinant() < 0.0).count() * 2 > count;
    let normals = normals.map(|n| {
        let carry = |v: usize| normal_matrix(DMat3::from_mat4(matrix(v)));
        n.iter().enumerate().map(|(v, n)| direction(carry(v) * n.as_dvec3())).collect()
    });
    let positions = positions
        .iter()
        .enumerate()
        .map(|(v, p)| matrix(v).transform_point3(p.as_dvec3()).as_vec3())
        .collect();
    Ok(Posed { positions, normals, mirrored })
}

/// A node's placement: where it is drawn, once or per GPU instance.
pub(crate) fn placements(
    document: &Document,
    node: &Value,
    world: DMat4,
) -> Result<Vec<(Option<u32>, DMat4)>, SceneError> {
    match crate::document::extension(node, crate::instances::INSTANCING) {
        None => Ok(vec![(None, world)]),
        Some(json) => Ok(crate::instances::read(document, json)?
            .into_iter()
            .enumerate()
            .map(|(i, local)| (Some(i as u32), world * local.matrix()))
            .collect()),
    }
}
