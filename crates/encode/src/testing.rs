//! A flat board for the tests: triangles in the plane, charts cut out of it by hand, and an atlas that shows
//! one picture, so that all places of a point of the board read the same.

use glam::{Vec2, Vec3};
use lightkiln_chart::Chart;
use lightkiln_chart::pack::{Packing, Placement, placed_texel};
use lightkiln_mesh::{Adjacency, EdgeKind, Mesh, TriangleId, VertexId, random};

use crate::{AtlasView, Codes, EncodeError, EncodeReport, Texels, atlas_position, decode_scalar, encode};

/// Texels per unit of the board.
pub const SCALE: f32 = 4.0;
const GUTTER: u32 = 2;

pub struct Board {
    pub mesh: Mesh,
    pub adjacency: Adjacency,
    /// The chart of each triangle; `None` for color triangles.
    pub chart_of: Vec<Option<u32>>,
    /// Per vertex.
    pub values: Vec<f32>,
}

/// Charts, packing and the picture in the pages.
pub struct Atlas {
    pub charts: Vec<Chart>,
    pub packing: Packing,
    pub pages: Vec<Vec<f32>>,
}

impl Board {
    /// Corners are multiples of 1/32, so that charts lie on the grid of the codes.
    pub fn new(corners: &[[f32; 2]], triangles: &[[u32; 3]], chart_of: &[Option<u32>]) -> Self {
        let positions: Vec<Vec3> = corners.iter().map(|&[x, y]| Vec3::new(x, y, 0.0)).collect();
        let normals = vec![Vec3::Z; positions.len()];
        let triangles = triangles.iter().map(|t| t.map(VertexId)).collect();
        let mesh = Mesh::new(positions, normals, triangles).expect("a board");
        let adjacency = Adjacency::new(&mesh);
        let values =
            (0..mesh.vertex_count() as u64).map(|v| random::unit(random::hash(7, v, 0, 0))).collect();
        Self { mesh, adjacency, chart_of: chart_of.to_vec(), values }
    }

    pub fn is_texture(&self) -> Vec<bool> {
        self.chart_of.iter().map(Option::is_some).collect()
    }

    /// Cuts the charts out and places them one under the other, every other one turned. `page_size` must hold
    /// each of them.
    pub fn atlas(&self, page_size: [u32; 2]) -> Atlas {
        let count = self.chart_of.iter().flatten().max().map_or(0, |&last| last + 1);
        let mut charts = Vec::new();
        let mut placements = Vec::new();
        let mut pages = vec![vec![0.5; (page_size[0] * page_size[1]) as usize]];
        let mut row = 0;
        for number in 0..count {
            let (chart, low) = self.cut(number);
            let turned = number % 2 == 1;
            let height = chart.size[usize::from(!turned)];
            if row + height > page_size[1] {
                pages.push(vec![0.5; (page_size[0] * page_size[1]) as usize]);
                row = 0;
            }
            let placement = Placement { page: pages.len() as u32 - 1, origin: [0, row], turned };
            row += height;
            for j in 0..chart.size[1] {
                for i in 0..chart.size[0] {
                    let [x, y] = placed_texel([i, j], chart.size, placement);
                    let on_board = [low[0] + i as i64, low[1] + j as i64].map(|k| k as u64);
                    let value = random::unit(random::hash(3, on_board[0], on_board[1], 0));
                    pages.last_mut().expect("one page at least")[(y * page_size[0] + x) as usize] = value;
                }
            }
            charts.push(chart);
            placements.push(placement);
        }
        let packing = Packing { placements, page_size, pages: pages.len() as u32 };
        Atlas { charts, packing, pages }
    }

    /// One chart, and the texel of the board in its corner.
    fn cut(&self, number: u32) -> (Chart, [i64; 2]) {
        let triangles: Vec<TriangleId> =
            self.mesh.triangle_ids().filter(|t| self.chart_of[t.index()] == Some(number)).collect();
        let mut vertices: Vec<VertexId> =
            triangles.iter().flat_map(|t| self.mesh.triangles[t.index()]).collect();
        vertices.sort_unstable();
        vertices.dedup();
        let corners = triangles
            .iter()
            .map(|t| {
                self.mesh.triangles[t.index()].map(|v| vertices.binary_search(&v).expect("listed") as u32)
            })
            .collect();
        let at: Vec<Vec2> =
            vertices.iter().map(|v| self.mesh.positions[v.index()].truncate() * SCALE).collect();
        let low = at.iter().fold(Vec2::INFINITY, |low, &p| low.min(p)).floor() - GUTTER as f32;
        let high = at.iter().fold(Vec2::NEG_INFINITY, |high, &p| high.max(p)).ceil() + GUTTER as f32;
        let size = (high - low).to_array().map(|texels| (texels as u32).next_multiple_of(4));
        let uv = at.iter().map(|&p| p - low).collect();
        (Chart { triangles, vertices, corners, uv, size }, low.to_array().map(|texel| texel as i64))
    }

    pub fn encode(&self, atlas: &Atlas) -> Result<(Codes, EncodeReport), EncodeError> {
        let view = atlas.view();
        encode(
            &self.mesh,
            &self.adjacency,
            &self.is_texture(),
            &atlas.charts,
            &atlas.packing,
            &self.values,
            1,
            &|chart, vertex, out| {
                view.read(atlas_position(&atlas.charts, &atlas.packing, chart, vertex), out);
            },
            None,
        )
    }

    /// Largest difference between what two triangles show along an edge that they share.
    pub fn largest_seam(&self, codes: &Codes, atlas: &Atlas) -> f32 {
        let view = atlas.view();
        let mut largest = 0.0_f32;
        for t in self.mesh.triangle_ids() {
            for edge in 0..3 {
                let EdgeKind::Interior { triangle: across, edge: back } = self.adjacency.across(t, edge)
                else {
                    continue;
                };
                for step in 0..=16 {
                    let s = step as f32 / 16.0;
                    let shown = [(t, edge, s), (across, back as usize, 1.0 - s)].map(|(t, edge, s)| {
                        let mut weights = [0.0; 3];
                        weights[edge] = 1.0 - s;
                        weights[(edge + 1) % 3] += s;
                        decode_scalar(codes.of_triangle(&self.mesh, t), [weights[1], weights[2]], &view)
                    });
                    largest = largest.max((shown[0] - shown[1]).abs());
                }
            }
        }
        largest
    }

    /// Cases and continuity at once: encodes, checks the seams, and gives codes and report.
    pub fn check(&self) -> (Codes, EncodeReport) {
        let atlas = self.atlas([64, 64]);
        let (codes, report) = self.encode(&atlas).expect("fits");
        let seam = self.largest_seam(&codes, &atlas);
        assert!(seam < 1e-4, "a seam of {seam}");
        assert!(report.readback_spread < 1e-5, "{report:?}");
        (codes, report)
    }
}

impl Atlas {
    pub fn view(&self) -> AtlasView<'_> {
        let pages = self.pages.iter().map(|page| Texels::F32(page)).collect();
        AtlasView::new(self.packing.page_size, 1, pages).expect("whole pages")
    }
}

/// A board of `n` × `n` squares, two triangles each, the diagonals and the inner corners moved at random.
pub fn random_board(n: u32, seed: u64) -> Board {
    let bits = |a: u64, b: u64| random::hash(seed, a, b, 1);
    let mut corners = Vec::new();
    for y in 0..=n {
        for x in 0..=n {
            // Multiples of 1/32 within a quarter of a square.
            let shift = |axis| (bits(u64::from(y * (n + 1) + x), axis) % 17) as f32 / 32.0 - 0.25;
            corners.push([x as f32 + shift(0), y as f32 + shift(1)]);
        }
    }
    let mut triangles = Vec::new();
    for y in 0..n {
        for x in 0..n {
            let a = y * (n + 1) + x;
            let (b, c, d) = (a + 1, a + n + 2, a + n + 1);
            if bits(u64::from(a), 2) & 1 == 0 {
                triangles.extend([[a, b, c], [a, c, d]]);
            } else {
                triangles.extend([[a, b, d], [b, c, d]]);
            }
        }
    }
    Board::new(&corners, &triangles, &vec![None; triangles.len()])
}
