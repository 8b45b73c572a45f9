//! Packing through `uvunwrap`: one mesh per chart, whose islands it repacks (one texel stands for one block).

use super::footprint::Footprint;
use super::{PackError, PackOptions, Packing, rigid};
use ::uvunwrap::{Density, MeshInput, Options, generate};
use std::collections::BTreeMap;

/// A shape as unit squares that share their corners.
struct Squares {
    positions: Vec<[f32; 3]>,
    uv: Vec<[f32; 2]>,
    indices: Vec<u32>,
}

impl Squares {
    fn new(shape: &Footprint) -> Self {
        let mut squares = Self { positions: Vec::new(), uv: Vec::new(), indices: Vec::new() };
        let mut corners = BTreeMap::new();
        for [x, y] in shape.iter() {
            let [a, b, c, d] = [[x, y], [x + 1, y], [x + 1, y + 1], [x, y + 1]].map(|corner| {
                *corners.entry(corner).or_insert_with(|| {
                    let [x, y] = corner.map(|blocks| blocks as f32);
                    squares.positions.push([x, y, 0.0]);
                    squares.uv.push([x, y]);
                    squares.uv.len() as u32 - 1
                })
            });
            squares.indices.extend([a, b, c, a, c, d]);
        }
        squares
    }
}

pub(super) fn pack(footprints: &[Footprint], options: &PackOptions) -> Result<Packing, PackError> {
    rigid::pack(footprints, options, place)
}

fn place(shapes: &[Footprint]) -> Option<Vec<Option<[i64; 2]>>> {
    let squares: Vec<Squares> = shapes.iter().map(Squares::new).collect();
    let meshes: Vec<MeshInput> = squares
        .iter()
        .map(|s| MeshInput { existing_uvs: Some(&s.uv), ..MeshInput::new(&s.positions, &s.indices) })
        .collect();
    let options = Options {
        density: Density::Fixed { texels_per_unit: 1.0, page_size: None },
        padding: 0,
        allow_rotation: false,
        ..Options::default()
    };
    let atlas = generate(&meshes, &options).ok()?;
    let size = [atlas.width as f32, atlas.height as f32];
    let places = atlas.meshes.iter().zip(&squares).map(|(mesh, squares)| {
        let pairs = mesh.vertices.iter().map(|vertex| {
            let from = squares.uv[vertex.xref as usize];
            (from, [vertex.uv[0] * size[0], vertex.uv[1] * size[1]])
        });
        translation(pairs).map(|moved| moved.map(|blocks| blocks.round() as i64))
    });
    Some(places.collect())
}

/// The one translation that takes every point of `from` to its partner in `to`, within a tenth of a block.
fn translation(pairs: impl Iterator<Item = ([f32; 2], [f32; 2])>) -> Option<[f32; 2]> {
    let mut common: Option<[f32; 2]> = None;
    for (from, to) in pairs {
        let moved = [to[0] - from[0], to[1] - from[1]];
        let [x, y] = *common.get_or_insert(moved);
        if (moved[0] - x).abs() > 0.1 || (moved[1] - y).abs() > 0.1 {
            return None;
        }
    }
    common
}
