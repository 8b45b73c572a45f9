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

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::TriangleId;

    fn source<'a>(
        positions: &'a [Vec3],
        normals: &'a [Vec3],
        groups: &'a [u32],
        triangles: &'a [[u32; 3]],
    ) -> Source<'a> {
        Source { positions, normals, groups, triangles, normal_cosine: 0.999 }
    }

    /// Two unit triangles that share an edge, each with its own three vertices.
    const POSITIONS: [Vec3; 6] = [
        Vec3::new(0.0, 0.0, 0.0),
        Vec3::new(1.0, 0.0, 0.0),
        Vec3::new(0.0, 1.0, -0.0),
        Vec3::new(1.0, 0.0, 0.0),
        Vec3::new(1.0, 1.0, 0.0),
        Vec3::new(0.0, 1.0, 0.0),
    ];
    const TRIANGLES: [[u32; 3]; 2] = [[0, 1, 2], [3, 4, 5]];

    #[test]
    fn weld_uv_seam_vanishes() {
        let welded = weld(source(&POSITIONS, &[Vec3::Z; 6], &[0; 6], &TRIANGLES)).unwrap();
        assert_eq!(welded.mesh.vertex_count(), 4);
        assert_eq!(welded.light_from_source[1], welded.light_from_source[3]);
        assert_eq!(welded.light_from_source[2], welded.light_from_source[5], "-0 and +0 are one place");
    }

    #[test]
    fn weld_crease_stays() {
        let normals = [Vec3::Z, Vec3::Z, Vec3::Z, Vec3::X, Vec3::X, Vec3::X];
        assert_eq!(weld(source(&POSITIONS, &normals, &[0; 6], &TRIANGLES)).unwrap().mesh.vertex_count(), 6);
    }

    #[test]
    fn weld_two_nodes_stay_apart() {
        let welded = weld(source(&POSITIONS, &[Vec3::Z; 6], &[0, 0, 0, 1, 1, 1], &TRIANGLES)).unwrap();
        assert_eq!(welded.mesh.vertex_count(), 6);
    }

    #[test]
    fn weld_bad_index_is_an_error() {
        let error = weld(source(&POSITIONS, &[Vec3::Z; 6], &[0; 6], &[[0, 1, 6]])).unwrap_err();
        assert_eq!(error, MeshError::Index { triangle: 0, vertex: 6, vertices: 6 });
    }

    #[test]
    fn weld_nan_is_an_error() {
        let mut positions = POSITIONS;
        positions[4].y = f32::NAN;
        let error = weld(source(&positions, &[Vec3::Z; 6], &[0; 6], &TRIANGLES)).unwrap_err();
        assert!(matches!(error, MeshError::NotFinite { .. }));
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(64))]
        #[test]
        fn weld_keeps_every_corner_in_its_place(places in prop::collection::vec((0..4_i8, 0..4_i8, 0..2_u32), 3..60)) {
            let positions: Vec<Vec3> =
                places.iter().map(|&(x, y, _)| Vec3::new(f32::from(x), f32::from(y), 0.0)).collect();
            let groups: Vec<u32> = places.iter().map(|p| p.2).collect();
            let triangles: Vec<[u32; 3]> =
                (0..positions.len() as u32 / 3).map(|t| [3 * t, 3 * t + 1, 3 * t + 2]).collect();
            let normals = vec![Vec3::Z; positions.len()];
            let welded = weld(source(&positions, &normals, &groups, &triangles)).unwrap();
            for (t, corners) in triangles.iter().enumerate() {
                let there = welded.mesh.corners(TriangleId(t as u32));
                for (corner, &v) in corners.iter().enumerate() {
                    prop_assert_eq!(there[corner], positions[v as usize]);
                }
            }
            let mut distinct: Vec<_> = places.clone();
            distinct.sort_unstable();
            distinct.dedup();
            prop_assert_eq!(welded.mesh.vertex_count(), distinct.len());
        }
    }
}
