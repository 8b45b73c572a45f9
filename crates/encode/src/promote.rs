//! Promotion: color triangles that cost fewer bytes as texture triangles.
//!
//! "Promote the triangle or split the vertex, whichever costs fewer bytes" (DESIGN.md, "The mixed
//! triangles"). A color copy is one more vertex in the file. It vanishes only when *every* triangle that
//! demands it becomes a texture triangle, so the price of the copy is compared with the texels of all of
//! them together. Promoting makes new chart edges and new texture-vertices, so this goes round: promote, fill
//! the notches that arise, choose the copies anew, until nothing more is cheaper. The cheapest state met on
//! the way is what is returned; it never costs more than promoting nothing.

use lightkiln_mesh::{Adjacency, Mesh, TriangleId, VertexId};

use crate::mixed::{self, Case, Copies};

/// What vertices and texels cost.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PromotionPrices {
    /// Bytes of one more vertex in the file: the strides of its attributes, light code included.
    pub vertex_bytes: f64,
    /// World units per texel.
    pub texel_size: f32,
    /// Bytes of one texel: 1 for 8 bits, 0.5 for BC4.
    pub texel_bytes: f64,
    /// Texels of all mip levels per texel of level 0: 4/3, or 1 without mips.
    pub mips: f64,
    /// Share of the atlas that charts fill, gutters included, `0..=1`.
    pub fill: f64,
    /// Texels of gutter around charts.
    pub gutter: u32,
}

/// Rounds after which the search ends; each takes two passes over the triangles. Real borders settle in two
/// or three rounds.
const MAX_ROUNDS: usize = 32;

/// The color triangles to add to the texture triangles before charting, ascending.
///
/// - `is_texture`: T; not changed
/// - returns: triangles that are cheaper as texture, and those that `classify::fill_notches` would add
///   (color triangles with two texture neighbours over interior edges) before or because of them
///
/// A slice that is not one entry per triangle gives an empty list.
pub fn promotions(
    mesh: &Mesh,
    adjacency: &Adjacency,
    is_texture: &[bool],
    prices: &PromotionPrices,
) -> Vec<TriangleId> {
    if is_texture.len() != mesh.triangle_count() {
        return Vec::new();
    }
    let mut state = is_texture.to_vec();
    fill_notches(adjacency, &mut state, mesh.triangle_ids().collect());
    // Bytes of the texels bought so far, beyond the first notches, which are given.
    let mut texels = 0.0;
    let mut best = (f64::INFINITY, state.clone());
    for _ in 0..MAX_ROUNDS {
        let is_place = mixed::texture_vertices(mesh, &state);
        let copies = Copies::choose(mesh, adjacency, &state, &is_place);
        let total = texels + (copies.at_chart_edges + copies.elsewhere) as f64 * prices.vertex_bytes;
        if total < best.0 {
            best = (total, state.clone());
        }
        let chosen = cheaper_as_texture(mesh, adjacency, &state, &is_place, &copies, prices);
        if chosen.is_empty() {
            break;
        }
        for &t in &chosen {
            texels += texel_price(mesh, adjacency, &state, prices, t);
            state[t.index()] = true;
        }
        let around = chosen.iter().flat_map(|&t| adjacency.neighbors(t)).map(|(_, t)| t).collect();
        for t in fill_notches(adjacency, &mut state, around) {
            // Without its own mark, as it stood when it was filled: two of its edges are chart edges.
            state[t.index()] = false;
            texels += texel_price(mesh, adjacency, &state, prices, t);
            state[t.index()] = true;
        }
    }
    mesh.triangle_ids().filter(|t| best.1[t.index()] && !is_texture[t.index()]).collect()
}

/// The triangles whose copies cost more than their texels, ascending.
fn cheaper_as_texture(
    mesh: &Mesh,
    adjacency: &Adjacency,
    state: &[bool],
    is_place: &[bool],
    copies: &Copies,
    prices: &PromotionPrices,
) -> Vec<TriangleId> {
    let mut demands: Vec<(VertexId, TriangleId, f64)> = Vec::new();
    for t in mesh.triangle_ids() {
        let case = mixed::case_of(mesh, adjacency, state, is_place, t);
        if !matches!(case, Case::ChartEdge { third: true, .. } | Case::Split) {
            continue;
        }
        let corners = mesh.triangles[t.index()];
        let mut copied: Vec<VertexId> =
            (0..3).filter(|&c| copies.at_corner(mesh, t, case, c)).map(|c| corners[c]).collect();
        copied.sort_unstable();
        copied.dedup();
        // A triangle that demands two copies shares its texels between them.
        let price = texel_price(mesh, adjacency, state, prices, t) / copied.len() as f64;
        demands.extend(copied.into_iter().map(|v| (v, t, price)));
    }
    demands.sort_unstable_by_key(|&(v, t, _)| (v, t));
    let mut chosen: Vec<TriangleId> = demands
        .chunk_by(|a, b| a.0 == b.0)
        .filter(|run| run.iter().map(|&(_, _, price)| price).sum::<f64>() < prices.vertex_bytes)
        .flat_map(|run| run.iter().map(|&(_, t, _)| t))
        .collect();
    chosen.sort_unstable();
    chosen.dedup();
    chosen
}

/// Bytes that a triangle takes in the atlas: its texels, and the gutter along the border that it adds to the
/// chart beside it. A triangle beside none is a chart of its own, of one 4 × 4 block at least.
fn texel_price(
    mesh: &Mesh,
    adjacency: &Adjacency,
    state: &[bool],
    prices: &PromotionPrices,
    triangle: TriangleId,
) -> f64 {
    let texel = f64::from(prices.texel_size);
    let gutter = f64::from(prices.gutter);
    let corners = mesh.corners(triangle);
    let mut beside_chart = [false; 3];
    for (edge, across) in adjacency.neighbors(triangle) {
        beside_chart[edge] = state[across.index()];
    }
    let border: f64 = (0..3)
        .map(|edge| {
            let length = f64::from(corners[edge].distance(corners[(edge + 1) % 3]));
            if beside_chart[edge] { -length } else { length }
        })
        .sum();
    let mut texels = mesh.area(triangle) / (texel * texel) + gutter * (border / texel).max(0.0);
    if beside_chart == [false; 3] {
        texels = (texels + 4.0 * gutter * gutter).max(16.0);
    }
    let price = texels * prices.texel_bytes * prices.mips / prices.fill;
    // Prices that are none promote nothing.
    if price.is_finite() { price.max(0.0) } else { f64::INFINITY }
}

/// Promotes color triangles with two texture neighbours or more, to a fixed point; returns them. `open`: those
/// to look at first.
fn fill_notches(adjacency: &Adjacency, state: &mut [bool], mut open: Vec<TriangleId>) -> Vec<TriangleId> {
    let mut filled = Vec::new();
    while let Some(t) = open.pop() {
        let beside = |(_, n): &(usize, TriangleId)| state[n.index()] && *n != t;
        if !state[t.index()] && adjacency.neighbors(t).filter(beside).count() >= 2 {
            state[t.index()] = true;
            filled.push(t);
            open.extend(adjacency.neighbors(t).map(|(_, n)| n));
        }
    }
    filled
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{Board, random_board};
    use proptest::prelude::*;

    const PRICES: PromotionPrices = PromotionPrices {
        vertex_bytes: 24.0,
        texel_size: 1.0,
        texel_bytes: 1.0,
        mips: 1.0,
        fill: 1.0,
        gutter: 0,
    };

    /// The drawing of `cases::mixed_chart_edge_with_third_texture_vertex_copies_the_third`: (1, 2, 3) is half a
    /// square of 3 x 3 units beside a chart, with a copy at v3.
    fn third() -> Board {
        let corners = [[0.0, 6.0], [3.0, 6.0], [0.0, 3.0], [3.0, 3.0], [3.0, 0.0], [6.0, 0.0]];
        Board::new(&corners, &[[0, 2, 1], [1, 2, 3], [3, 4, 5]], &[Some(0), None, Some(0)])
    }

    fn of(board: &Board, prices: &PromotionPrices) -> Vec<TriangleId> {
        promotions(&board.mesh, &board.adjacency, &board.is_texture(), prices)
    }

    #[test]
    fn promote_whichever_costs_fewer_bytes() {
        let board = third();
        // 4.5 texels against 24 bytes, and against 4.
        assert_eq!(of(&board, &PRICES), [TriangleId(1)]);
        assert_eq!(of(&board, &PromotionPrices { vertex_bytes: 4.0, ..PRICES }), []);
        // At a texel of a fifth of a unit 112 texels; mips, a poor fill and gutters weigh the same way.
        assert_eq!(of(&board, &PromotionPrices { texel_size: 0.2, ..PRICES }), []);
        assert_eq!(of(&board, &PromotionPrices { fill: 0.1, ..PRICES }), []);
        assert_eq!(of(&board, &PromotionPrices { texel_bytes: 8.0, ..PRICES }), []);
        assert_eq!(of(&board, &PromotionPrices { gutter: 20, ..PRICES }), []);
    }

    #[test]
    fn promote_notches_are_part_of_it() {
        let corners = [[0.0, 2.0], [2.0, 2.0], [2.0, 0.0], [8.0, 0.0], [8.0, 2.0]];
        let board = Board::new(&corners, &[[0, 2, 1], [1, 2, 3], [1, 3, 4]], &[Some(0), None, Some(0)]);
        let dear = PromotionPrices { vertex_bytes: 0.0, ..PRICES };
        assert_eq!(of(&board, &dear), [TriangleId(1)]);
    }

    #[test]
    fn promote_bad_input_promotes_nothing() {
        let board = third();
        for texel_size in [0.0, -0.0, f32::NAN, f32::INFINITY] {
            let _ = of(&board, &PromotionPrices { texel_size, ..PRICES });
        }
        assert_eq!(of(&board, &PromotionPrices { texel_size: 0.0, ..PRICES }), []);
        assert_eq!(of(&board, &PromotionPrices { fill: 0.0, ..PRICES }), []);
        assert_eq!(promotions(&board.mesh, &board.adjacency, &[true], &PRICES), []);
    }

    fn copies(board: &Board, state: &[bool]) -> usize {
        let is_place = mixed::texture_vertices(&board.mesh, state);
        let copies = Copies::choose(&board.mesh, &board.adjacency, state, &is_place);
        copies.at_chart_edges + copies.elsewhere
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(64))]

        /// The result has no notches and costs no more than filling the notches alone.
        #[test]
        fn promote_never_costs_more(seed in 0..u64::MAX, n in 2..12_u32, share in 0.0_f32..0.5, bytes in 0.0_f64..12.0) {
            let board = random_board(n, seed);
            let state: Vec<bool> = (0..board.mesh.triangle_count() as u64)
                .map(|t| lightkiln_mesh::random::unit(lightkiln_mesh::random::hash(seed, t, 8, 8)) < share)
                .collect();
            let prices = PromotionPrices { vertex_bytes: bytes, ..PRICES };
            let mut notched = state.clone();
            fill_notches(&board.adjacency, &mut notched, board.mesh.triangle_ids().collect());
            let mut after = state.clone();
            for t in promotions(&board.mesh, &board.adjacency, &state, &prices) {
                prop_assert!(!after[t.index()]);
                after[t.index()] = true;
            }
            prop_assert!(fill_notches(&board.adjacency, &mut after, board.mesh.triangle_ids().collect()).is_empty());
            prop_assert!((0..state.len()).all(|t| after[t] >= notched[t]));
            let bought: f64 =
                board.mesh.triangle_ids().filter(|t| after[t.index()] && !notched[t.index()]).map(|t| board.mesh.area(t)).sum();
            let saved = (copies(&board, &notched) as f64 - copies(&board, &after) as f64) * bytes;
            prop_assert!(bought <= saved + 1e-6, "{} bytes of texels for {} bytes of copies", bought, saved);
        }
    }
}
