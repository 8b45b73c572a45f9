//! Welding: glTF vertices that share position and normal become one light vertex.
//!
//! A glTF vertex is split wherever any attribute changes: at UV seams and material borders light is
//! continuous, so these splits vanish here; at creases the normal changes and the split stays (DESIGN.md,
//! "Weld before anything"; Kavan 2011 §3 assumes the same of its meshes).

use std::collections::HashMap;

use glam::Vec3;

use crate::{Mesh, MeshError, VertexId};

/// Vertices and triangles before welding, all nodes of a scene one after the other.
#[derive(Clone, Copy, Debug)]
pub struct Source<'a> {
    /// World positions.
    pub positions: &'a [Vec3],
    /// World shading normals of unit length.
    pub normals: &'a [Vec3],
    /// Only vertices of the same group are welded (a group is a node of the scene).
    pub groups: &'a [u32],
    /// Three source vertices each, counter-clockwise from the front.
    pub triangles: &'a [[u32; 3]],
    /// Normals whose angle has a cosine of at least this are one: 1.0 welds equal normals only.
    pub normal_cosine: f32,
}

/// The light mesh, and where each source vertex went.
#[derive(Clone, Debug)]
pub struct Welded {
    /// The light mesh; its triangles stand in the order of the source.
    pub mesh: Mesh,
    /// One light vertex per source vertex.
    pub light_from_source: Vec<VertexId>,
}

/// Welds a source into the light mesh.
///
/// Light vertices are numbered by their first source vertex and take its position and normal.
///
/// # Errors
/// [`MeshError`] as [`Mesh::new`] has it.
pub fn weld(source: Source<'_>) -> Result<Welded, MeshError> {
    let count = source.positions.len();
    if source.normals.len() != count {
        return Err(MeshError::Normals { normals: source.normals.len(), positions: count });
    }
    if count >= u32::MAX as usize {
        return Err(MeshError::TooLarge { count });
    }
    const END: u32 = u32::MAX;
    // Chains of light vertices at one place, by first of the chain.
    let mut first_at: HashMap<([u32; 3], u32), u32> = HashMap::with_capacity(count);
    let mut next_at: Vec<u32> = Vec::new();
    let mut positions: Vec<Vec3> = Vec::new();
    let mut normals: Vec<Vec3> = Vec::new();
    let mut light_from_source = Vec::with_capacity(count);
    for vertex in 0..count {
        let (position, normal) = (source.positions[vertex], source.normals[vertex]);
        // Adding zero turns -0 into +0, which are one place.
        let place = ((position + Vec3::ZERO).to_array().map(f32::to_bits), source.groups[vertex]);
        let first = first_at.get(&place).copied().unwrap_or(END);
        let mut at = first;
        while at != END && !same_normal(normals[at as usize], normal, source.normal_cosine) {
            at = next_at[at as usize];
        }
        if at == END {
            at = positions.len() as u32;
            positions.push(position);
            normals.push(normal);
            next_at.push(first);
            first_at.insert(place, at);
        }
        light_from_source.push(VertexId(at));
    }
    let triangles = source
        .triangles
        .iter()
        .enumerate()
        .map(|(triangle, corners)| {
            if let Some(&bad) = corners.iter().find(|&&v| v as usize >= count) {
                return Err(MeshError::Index { triangle, vertex: bad, vertices: count });
            }
            Ok(corners.map(|v| light_from_source[v as usize]))
        })
        .collect::<Result<_, _>>()?;
    Ok(Welded { mesh: Mesh::new(positions, normals, triangles)?, light_from_source })
}

fn same_normal(a: Vec3, b: Vec3, cosine: f32) -> bool {
    a == b || a.dot(b) >= cosine
}
