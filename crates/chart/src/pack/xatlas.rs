//! Packing through xatlas (`xatlas-rs-v2`): one UV mesh per chart, in texels, aligned to its 4 x 4 blocks.
//!
//! xatlas moves charts by half a texel and stretches them to whole blocks less one texel; a shape of n
//! blocks is therefore given an extent of 4 n - 1 texels: a square of 3 texels for each block and bridges of 1 texel
//! between neighbours. Turns are off (it mirrors), and every buffer lives until the end (it compares addresses).
//! Places are read from its image of chart numbers: for UV meshes it leaves the type of a chart unset, and the
//! binding's `meshes` panics on what happens to be there.

use super::footprint::Footprint;
use super::{BLOCK, PackError, PackOptions, Packing, rigid};
use xatlas_rs_v2::{ChartOptions, IndexData, MeshData, UvMeshDecl, Xatlas};

/// A shape as squares and bridges, four vertices per block.
struct Squares {
    uv: Vec<[f32; 2]>,
    indices: Vec<u32>,
}

impl Squares {
    fn new(shape: &Footprint) -> Self {
        let mut squares = Self { uv: Vec::new(), indices: Vec::new() };
        let [width, height] = shape.size();
        // First vertex of each block of the row below and of this row.
        let mut below = vec![None; width as usize];
        for y in 0..height {
            let mut row = vec![None; width as usize];
            for x in (0..width).filter(|&x| shape.contains(x, y)) {
                let first = squares.uv.len() as u32;
                let (low_x, low_y) = ((BLOCK * x) as f32, (BLOCK * y) as f32);
                let (high_x, high_y) = (low_x + 3.0, low_y + 3.0);
                squares.uv.extend([[low_x, low_y], [high_x, low_y], [high_x, high_y], [low_x, high_y]]);
                squares.quad([first, first + 1, first + 2, first + 3]);
                if let Some(left) = x.checked_sub(1).and_then(|x| row[x as usize]) {
                    let left: u32 = left;
                    squares.quad([left + 1, first, first + 3, left + 2]);
                }
                if let Some(under) = below[x as usize] {
                    let under: u32 = under;
                    squares.quad([under + 3, under + 2, first + 1, first]);
                }
                row[x as usize] = Some(first);
            }
            below = row;
        }
        squares
    }

    fn quad(&mut self, [a, b, c, d]: [u32; 4]) {
        self.indices.extend([a, b, c, a, c, d]);
    }
}

pub(super) fn pack(footprints: &[Footprint], options: &PackOptions) -> Result<Packing, PackError> {
    rigid::pack(footprints, options, place)
}

fn place(shapes: &[Footprint]) -> Option<Vec<Option<[i64; 2]>>> {
    let squares: Vec<Squares> = shapes.iter().map(Squares::new).collect();
    let mut atlas = Xatlas::new();
    for square in &squares {
        let declaration = UvMeshDecl {
            vertex_uv_data: Some(MeshData::WithStride {
                data: bytemuck::cast_slice(&square.uv),
                stride: size_of::<[f32; 2]>() as u32,
            }),
            face_material_data: None,
            index_data: Some(IndexData::U32(&square.indices)),
        };
        atlas.add_uv_mesh(&declaration).ok()?;
    }
    atlas.compute_charts(&ChartOptions::default());
    atlas.pack_charts(&xatlas_rs_v2::PackOptions {
        texels_per_unit: 1.0,
        bilinear: false,
        block_align: true,
        brute_force: true,
        rotate_charts_to_axis: false,
        rotate_charts: false,
        create_image: true,
        ..xatlas_rs_v2::PackOptions::default()
    });
    if atlas.chart_count() as usize != shapes.len() || atlas.atlas_count() != 1 {
        return None;
    }
    let corners = lowest_texels(atlas.image()?, atlas.width() as usize, shapes.len());
    let places = corners.into_iter().zip(shapes).map(|(corner, shape)| {
        let (texels, blocks) = (corner?, shape.lowest()?);
        Some([0, 1].map(|axis| i64::from(texels[axis] / BLOCK) - i64::from(blocks[axis])))
    });
    Some(places.collect())
}

/// Per chart, the least x and y of its texels in an image of chart numbers.
fn lowest_texels(image: &[u32], width: usize, charts: usize) -> Vec<Option<[u32; 2]>> {
    const HAS_CHART: u32 = 1 << 31;
    const CHART: u32 = (1 << 29) - 1;
    let mut lowest: Vec<Option<[u32; 2]>> = vec![None; charts];
    for (y, row) in image.chunks(width.max(1)).enumerate() {
        for (x, &texel) in row.iter().enumerate().filter(|(_, texel)| **texel & HAS_CHART != 0) {
            if let Some(lowest) = lowest.get_mut((texel & CHART) as usize) {
                let [low_x, low_y] = lowest.get_or_insert([x as u32, y as u32]);
                (*low_x, *low_y) = ((*low_x).min(x as u32), (*low_y).min(y as u32));
            }
        }
    }
    lowest
}
