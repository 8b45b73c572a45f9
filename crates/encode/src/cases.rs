//! The cases of section 4.3 and those that it leaves out (DESIGN.md, "The mixed triangles"), each drawn.
//! `#` marks texture triangles.

use lightkiln_mesh::{TriangleId, VertexId};
use proptest::prelude::*;

use crate::testing::{Board, random_board};
use crate::{
    AtlasView, Codes, EncodeError, EncodeReport, Form, LightCode, Texels, atlas_position, decode, encode,
};

fn kinds(codes: [LightCode; 3]) -> [bool; 3] {
    codes.map(LightCode::is_color)
}

/// An atlas that reads 0.5 everywhere.
fn half(_chart: usize, _vertex: usize, out: &mut [f32]) {
    out.fill(0.5);
}

#[test]
fn mixed_paper_figure_6() {
    // v0----v2----v4        # = (0, 1, 2); (2, 1, 3) has the chart edge 1-2; (2, 3, 4) hangs on 2 alone;
    //   \ # /  \  /  \      (4, 3, 5) has three color-vertices.
    //    v1----v3----v5
    let corners = [[0.0, 2.0], [1.0, 0.0], [2.0, 2.0], [3.0, 0.0], [4.0, 2.0], [5.0, 0.0]];
    let board =
        Board::new(&corners, &[[0, 1, 2], [2, 1, 3], [2, 3, 4], [4, 3, 5]], &[Some(0), None, None, None]);
    let (codes, report) = board.check();
    let of = |t| codes.of_triangle(&board.mesh, TriangleId(t));
    assert_eq!(kinds(of(0)), [false; 3]);
    assert_eq!(kinds(of(1)), [false, false, true]);
    assert_eq!([of(1)[0], of(1)[1]], [of(0)[2], of(0)[1]]);
    assert_eq!(kinds(of(2)), [false, true, true]);
    assert_eq!(kinds(of(3)), [true; 3]);
    assert_eq!(
        (report.texture_triangles, report.chart_edge_two, report.lone, report.plain),
        (1, 1, 1, 1),
        "{report:?}"
    );
    // Nothing needs a second code, so nothing is listed.
    assert_eq!((report.code_pairs, codes.override_count(), codes.bytes()), (6, 0, 24));
    assert_eq!(codes.of_vertex(VertexId(5)).value().map(|v| (v - board.values[5]).abs() < 1e-5), Some(true));
}

#[test]
fn mixed_three_texture_vertices_without_chart_edge_copies_two() {
    //  v3---v4   v5---v6      (0, 1, 2) is a color triangle; a texture triangle hangs on each corner
    //    \# /     \# /
    //     v0-------v1
    //       \     /
    //         v2
    //        / #\
    //      v7---v8
    let corners = [
        [2.0, 4.0],
        [6.0, 4.0],
        [4.0, 2.0],
        [1.0, 6.0],
        [3.0, 6.0],
        [5.0, 6.0],
        [7.0, 6.0],
        [3.0, 0.0],
        [5.0, 0.0],
    ];
    let triangles = [[0, 2, 1], [0, 4, 3], [1, 6, 5], [2, 7, 8]];
    let board = Board::new(&corners, &triangles, &[None, Some(0), Some(1), Some(2)]);
    let (codes, report) = board.check();
    let own = codes.of_triangle(&board.mesh, TriangleId(0));
    assert_eq!(kinds(own).iter().filter(|&&color| color).count(), 2);
    assert_eq!((report.split_three, report.copies_elsewhere, report.copies_at_chart_edges), (1, 2, 0));
    assert_eq!(report.code_pairs, 9 + 2);
}

#[test]
fn mixed_two_whose_edge_is_on_no_texture_triangle_copies_one() {
    //  v4 ------- v5        # = (0, 4, 2) and (1, 3, 5) hang on v0 and v1; the edge v0-v1 lies between the color
    //  | \       / |        triangles (0, 1, 6) above and (0, 7, 1) below, which share one copy.
    //  | #\ v6  /# |
    //  |   v0-v1   |
    //  v2   v7    v3
    let corners =
        [[3.0, 2.0], [5.0, 2.0], [0.0, 1.0], [8.0, 1.0], [0.0, 4.0], [8.0, 4.0], [4.0, 4.0], [4.0, 0.0]];
    let triangles = [[0, 4, 2], [1, 3, 5], [0, 1, 6], [0, 7, 1]];
    let board = Board::new(&corners, &triangles, &[Some(0), Some(0), None, None]);
    let (codes, report) = board.check();
    assert_eq!((report.split_two, report.copies_elsewhere), (2, 1));
    let [above, below] = [2, 3].map(|t| codes.of_triangle(&board.mesh, TriangleId(t)));
    // v1 is copied (the partner of v0, which has one pair), v0 keeps its place in both.
    assert_eq!(kinds(above), [false, true, true]);
    assert_eq!(kinds(below), [false, true, true]);
    assert_eq!((above[0], above[1]), (below[0], below[2]));
    assert_eq!(report.code_pairs, 8 + 1);
}

#[test]
fn mixed_two_in_different_charts_follow_the_chart_edge() {
    //  v3----v2----v5       two charts, # and +, with the seam 1-2; (1, 0, 4) has the chart edge 0-1 of #, (1, 4, 6)
    //  | #  /| \ + |        the chart edge 6-1 of +: v1 shows a place of each.
    //  | /#  |  +\ |
    //  v0----v1----v6
    //    \   |   /
    //        v4
    let corners = [[0.0, 4.0], [4.0, 4.0], [4.0, 8.0], [0.0, 8.0], [4.0, 0.0], [8.0, 8.0], [8.0, 4.0]];
    let triangles = [[0, 1, 2], [0, 2, 3], [1, 6, 2], [2, 6, 5], [1, 0, 4], [1, 4, 6]];
    let board = Board::new(&corners, &triangles, &[Some(0), Some(0), Some(1), Some(1), None, None]);
    let (codes, report) = board.check();
    let of = |t| codes.of_triangle(&board.mesh, TriangleId(t));
    assert_eq!(kinds(of(4)), [false, false, true]);
    assert_eq!([of(4)[0], of(4)[1]], [of(0)[1], of(0)[0]]);
    assert_eq!(kinds(of(5)), [false, true, false]);
    assert_eq!([of(5)[0], of(5)[2]], [of(2)[0], of(2)[1]]);
    assert_ne!(of(4)[0], of(5)[0]);
    assert_eq!((report.chart_edge_two, report.seam_vertices, report.texture_vertices), (2, 2, 6));
    // Seven vertices, and second places of v1 and v2.
    assert_eq!(report.code_pairs, 9);
}

#[test]
fn mixed_two_in_different_charts_without_chart_edge_copies_one() {
    // As `mixed_two_whose_edge_is_on_no_texture_triangle_copies_one`, in two charts.
    let corners = [[3.0, 2.0], [5.0, 2.0], [0.0, 1.0], [8.0, 1.0], [0.0, 4.0], [8.0, 4.0], [4.0, 4.0]];
    let board = Board::new(&corners, &[[0, 4, 2], [1, 3, 5], [0, 1, 6]], &[Some(0), Some(1), None]);
    let (codes, report) = board.check();
    assert_eq!((report.split_two, report.copies_elsewhere), (1, 1));
    assert_eq!(kinds(codes.of_triangle(&board.mesh, TriangleId(2))), [false, true, true]);
}

#[test]
fn mixed_chart_edge_with_third_texture_vertex_copies_the_third() {
    //  v0----v1            # = (0, 2, 1): its edge 2-1 is the chart edge of (1, 2, 3), whose third corner hangs on
    //  | # / |             another texture triangle, (3, 4, 5).
    //  |  /  |
    //  v2----v3
    //        | \#
    //        v4-v5
    let corners = [[0.0, 6.0], [3.0, 6.0], [0.0, 3.0], [3.0, 3.0], [3.0, 0.0], [6.0, 0.0]];
    let board = Board::new(&corners, &[[0, 2, 1], [1, 2, 3], [3, 4, 5]], &[Some(0), None, Some(0)]);
    let (codes, report) = board.check();
    let own = codes.of_triangle(&board.mesh, TriangleId(1));
    assert_eq!(kinds(own), [false, false, true]);
    assert_eq!((report.chart_edge_three, report.copies_at_chart_edges, report.copies_elsewhere), (1, 1, 0));
    assert_eq!(report.code_pairs, 7);
}

#[test]
fn mixed_existing_copy_is_used_again() {
    // v3 is copied for (1, 2, 3) as above; (3, 7, 6) has the texture-vertices v3 and v6 and no chart edge: the
    // copy of v3 serves it too and v6 keeps its place.
    let corners = [
        [0.0, 6.0],
        [3.0, 6.0],
        [0.0, 3.0],
        [3.0, 3.0],
        [3.0, 0.0],
        [6.0, 0.0],
        [6.0, 6.0],
        [7.0, 3.0],
        [7.0, 8.0],
        [4.0, 8.0],
    ];
    let triangles = [[0, 2, 1], [1, 2, 3], [3, 4, 5], [3, 7, 6], [6, 8, 9]];
    let board = Board::new(&corners, &triangles, &[Some(0), None, Some(1), None, Some(2)]);
    let (codes, report) = board.check();
    assert_eq!((report.split_two, report.copies_at_chart_edges, report.copies_elsewhere), (1, 1, 0));
    assert_eq!(kinds(codes.of_triangle(&board.mesh, TriangleId(3))), [true, true, false]);
}

#[test]
fn mixed_several_chart_edges_follow_the_longest() {
    // (1, 2, 3) between two texture triangles: the notch that `fill_notches` would have filled.
    let corners = [[0.0, 2.0], [2.0, 2.0], [2.0, 0.0], [8.0, 0.0], [8.0, 2.0]];
    let board = Board::new(&corners, &[[0, 2, 1], [1, 2, 3], [1, 3, 4]], &[Some(0), None, Some(0)]);
    let atlas = board.atlas([64, 64]);
    let (codes, report) = board.encode(&atlas).expect("fits");
    assert_eq!((report.several_chart_edges, report.chart_edge_three), (1, 1));
    let own = codes.of_triangle(&board.mesh, TriangleId(1));
    assert_eq!(kinds(own), [false, true, false]);
}

#[test]
fn mixed_degenerate_and_non_manifold_do_not_panic() {
    // (0, 0, 1), (0, 1, 0) and (2, 2, 2) have no area; three triangles stand on the edge 0-1.
    let corners = [[0.0, 0.0], [4.0, 0.0], [0.0, 4.0], [0.0, -4.0], [4.0, 4.0]];
    let triangles = [[0, 1, 2], [0, 0, 1], [0, 1, 0], [2, 2, 2], [1, 0, 3], [0, 1, 4], [4, 4, 2], [2, 4, 4]];
    for texture in 0..triangles.len() {
        let mut chart_of = [None; 8];
        chart_of[texture] = Some(0);
        let (codes, report) = Board::new(&corners, &triangles, &chart_of).check();
        assert_eq!(report.texture_triangles, 1);
        assert!(codes.bytes() > 0);
    }
    let (codes, report) = Board::new(&[], &[], &[]).check();
    assert_eq!((codes.bytes(), report.code_pairs), (0, 0));
}

#[test]
fn mixed_detached_vertices_show_their_value() {
    // (1, 3, 2) beside the texture triangle (0, 1, 2): a chart edge 1-2, of which one end or both are detached.
    let corners = [[0.0, 0.0], [2.0, 0.0], [0.0, 2.0], [2.0, 2.0]];
    let board = Board::new(&corners, &[[0, 1, 2], [1, 3, 2]], &[Some(0), None]);
    let atlas = board.atlas([64, 64]);
    let run = |detached: &[bool]| {
        let (mesh, adjacency, is_texture) = (&board.mesh, &board.adjacency, board.is_texture());
        let (charts, packing) = (&atlas.charts, &atlas.packing);
        encode(mesh, adjacency, &is_texture, charts, packing, &board.values, 1, &half, Some(detached))
    };
    for (detached, is_color, count) in [
        ([false; 4], [false, true, false], 0),
        ([false, true, false, false], [true, true, false], 1),
        ([false, true, true, true], [true; 3], 2),
    ] {
        let (codes, report) = run(&detached).expect("fits");
        let own = codes.of_triangle(&board.mesh, TriangleId(1));
        assert_eq!((kinds(own), report.detached), (is_color, count), "{detached:?}");
        for (code, v) in own.iter().zip([1, 3, 2]).filter(|(code, _)| code.is_color()) {
            assert_eq!(*code, LightCode::color(board.values[v]), "vertex {v}");
        }
        assert_eq!(
            kinds(codes.of_triangle(&board.mesh, TriangleId(0))),
            [false; 3],
            "the chart keeps its places"
        );
    }
    assert!(matches!(run(&[true]), Err(EncodeError::Length { what: "detached", .. })));
}

#[test]
fn encode_places_at_the_limits_fit_and_beyond_do_not() {
    let corners = [[0.0, 0.0], [2.0, 0.0], [0.0, 2.0]];
    let board = Board::new(&corners, &[[0, 1, 2]], &[Some(0)]);
    let mut atlas = board.atlas([64, 64]);
    // The chart is 12 x 12 texels and its triangle reaches from 2 to 10.
    atlas.packing.page_size = [8192, 2048];
    let mut encode_at = |page, origin| {
        atlas.packing.placements[0].page = page;
        atlas.packing.placements[0].origin = origin;
        let is_texture = board.is_texture();
        let (mesh, adjacency) = (&board.mesh, &board.adjacency);
        encode(mesh, adjacency, &is_texture, &atlas.charts, &atlas.packing, &board.values, 1, &half, None)
    };
    let (codes, _) = encode_at(1, [8180, 2036]).expect("the last corner");
    assert_eq!(codes.of_vertex(VertexId(1)).position(), Some([8190.0, 2048.0 + 2038.0]));
    let error = encode_at(2, [0, 0]).expect_err("4096 rows and more");
    assert_eq!(
        error,
        EncodeError::Position { chart: 0, page: 2, x: 2.0, y: 4098.0, limit_x: 8191.875, limit_y: 4095.875 }
    );
    assert!(error.to_string().contains("(2, 4098)"), "{error}");
    assert!(matches!(encode_at(0, [8184, 0]), Err(EncodeError::Position { x: 8194.0, .. })));
}

#[test]
fn encode_refuses_what_does_not_fit() {
    let corners = [[0.0, 0.0], [2.0, 0.0], [0.0, 2.0], [2.0, 2.0]];
    let board = Board::new(&corners, &[[0, 1, 2], [1, 3, 2]], &[Some(0), None]);
    let atlas = board.atlas([64, 64]);
    let run = |is_texture: &[bool], charts: &[_], values: &[f32]| {
        encode(&board.mesh, &board.adjacency, is_texture, charts, &atlas.packing, values, 1, &half, None)
            .expect_err("a fault")
    };
    let good = [true, false];
    assert!(matches!(run(&[true], &atlas.charts, &board.values), EncodeError::Length { count: 1, .. }));
    assert!(matches!(run(&good, &[], &board.values), EncodeError::Length { what: "placements", .. }));
    assert!(matches!(
        run(&[true, true], &atlas.charts, &board.values),
        EncodeError::Uncharted { triangle: 1 }
    ));
    assert!(matches!(run(&[false, false], &atlas.charts, &board.values), EncodeError::ChartTriangle { .. }));
    let mut twice = atlas.charts.clone();
    twice[0].triangles.push(TriangleId(0));
    twice[0].corners.push([0, 1, 2]);
    assert!(matches!(run(&good, &twice, &board.values), EncodeError::ChartTriangle { triangle: 0, .. }));
    let mut other = atlas.charts.clone();
    other[0].corners[0] = [0, 2, 1];
    assert!(matches!(run(&good, &other, &board.values), EncodeError::ChartTriangle { .. }));
    // Only the values of color-vertices are read: v3 is the only one.
    let nan = [f32::NAN, f32::NAN, f32::NAN, f32::NAN];
    assert!(matches!(run(&good, &atlas.charts, &nan), EncodeError::NotFinite { vertex: 3, .. }));
}

#[test]
fn encode_clamps_and_counts() {
    let corners = [[0.0, 0.0], [2.0, 0.0], [0.0, 2.0]];
    let mut board = Board::new(&corners, &[[0, 1, 2]], &[None]);
    board.values = vec![-0.5, 0.5, 1.5];
    let (codes, report) = board.check();
    assert_eq!(report.clamped, 2);
    assert_eq!(codes.of_vertex(VertexId(2)), LightCode::color(1.0));
}

/// Encodes three channels: `values` per vertex, and an atlas whose channels are `shades` times the board's picture.
fn encode_rgb(board: &Board, values: &[[f32; 3]], shades: [f32; 3]) -> (Codes, EncodeReport, Vec<Vec<f32>>) {
    let atlas = board.atlas([64, 64]);
    let pages: Vec<Vec<f32>> =
        atlas.pages.iter().map(|page| page.iter().flat_map(|&v| shades.map(|s| s * v)).collect()).collect();
    let view = view_rgb(&pages);
    let (charts, packing) = (&atlas.charts, &atlas.packing);
    let read = |chart: usize, vertex: usize, out: &mut [f32]| {
        view.read(atlas_position(charts, packing, chart, vertex), out);
    };
    let (mesh, adjacency) = (&board.mesh, &board.adjacency);
    let values = values.as_flattened();
    let (codes, report) =
        encode(mesh, adjacency, &board.is_texture(), charts, packing, values, 3, &read, None).expect("fits");
    drop(view);
    (codes, report, pages)
}

fn view_rgb(pages: &[Vec<f32>]) -> AtlasView<'_> {
    AtlasView::new([64, 64], 3, pages.iter().map(|page| Texels::F32(page)).collect()).expect("whole pages")
}

/// A random board of textured and other triangles without notches.
fn textured_board(seed: u64, n: u32, charts: u64, share: f64) -> Board {
    let mut board = random_board(n, seed);
    for t in board.mesh.triangle_ids() {
        let hash = lightkiln_mesh::random::hash(seed, u64::from(t.0), 5, 5);
        let textured = f64::from(lightkiln_mesh::random::unit(hash)) < share;
        board.chart_of[t.index()] = textured.then_some((hash % charts) as u32);
    }
    // Every chart number is used, or a chart would be empty.
    for chart in 0..charts as usize {
        board.chart_of[chart] = Some(chart as u32);
    }
    fill_notches(&mut board);
    board
}

#[test]
fn encode_rgb_shows_its_channels() {
    let board = textured_board(4, 8, 2, 0.12);
    let values: Vec<[f32; 3]> = board.values.iter().map(|&v| [v, 1.0 - v, 0.25]).collect();
    let (codes, report, pages) = encode_rgb(&board, &values, [1.0, 0.5, 0.0]);
    assert!(report.plain > 0 && report.copies_at_chart_edges + report.copies_elsewhere > 0, "{report:?}");
    let (grey, _) = board.encode(&board.atlas([64, 64])).expect("fits");
    let view = view_rgb(&pages);
    let (tabled, table) = codes.to_table(3, 0.01).expect("few colors");
    for t in board.mesh.triangle_ids() {
        let own = codes.of_triangle(&board.mesh, t);
        // The same structure as one channel, and the same places.
        for (code, grey) in own.iter().zip(grey.of_triangle(&board.mesh, t)) {
            assert_eq!(code.position(), grey.position());
        }
        let (mut packed, mut from_table) = ([0.0; 3], [0.0; 3]);
        decode(own, [0.2, 0.3], &view, &Form::packed(3), &mut packed);
        decode(tabled.of_triangle(&board.mesh, t), [0.2, 0.3], &view, &Form::Table(&table), &mut from_table);
        for c in 0..3 {
            assert!((packed[c] - from_table[c]).abs() < 0.011, "{packed:?} {from_table:?}");
        }
        if own.iter().all(|code| code.is_color()) && board.chart_of[t.index()].is_none() {
            let copied = own.iter().zip(board.mesh.triangles[t.index()]).any(|(code, v)| {
                let rgb = code.rgb().expect("a color");
                (rgb[0] - values[v.index()][0]).abs() > 1e-3
            });
            assert!(copied || (packed[0] + packed[1] - 1.0).abs() < 2e-3 && (packed[2] - 0.25).abs() < 1e-3);
        }
    }
}

#[test]
fn encode_channels_are_one_to_three() {
    let board = random_board(2, 1);
    let atlas = board.atlas([64, 64]);
    for (channels, count) in [(0, 0), (4, 4)] {
        let values = vec![0.5; board.mesh.vertex_count() * count];
        let (mesh, adjacency, is_texture) = (&board.mesh, &board.adjacency, board.is_texture());
        let (charts, packing) = (&atlas.charts, &atlas.packing);
        let error = encode(mesh, adjacency, &is_texture, charts, packing, &values, channels, &half, None);
        assert_eq!(error.expect_err("a fault"), EncodeError::Channels { channels });
    }
    // A decoded layer of more channels than a code has is black there.
    let mut out = [9.0; 4];
    let none = AtlasView::new([0, 0], 1, vec![]).expect("empty");
    decode([LightCode::color_rgb([1.0; 3]); 3], [0.2, 0.2], &none, &Form::Rgb, &mut out);
    assert!(out[..3].iter().all(|v| (v - 1.0).abs() < 1e-6) && out[3] == 0.0, "{out:?}");
}

/// Color triangles with two texture neighbours become texture triangles of a neighbour's chart.
fn fill_notches(board: &mut Board) {
    loop {
        let notch = board.mesh.triangle_ids().find_map(|t| {
            let beside: Vec<u32> =
                board.adjacency.neighbors(t).filter_map(|(_, n)| board.chart_of[n.index()]).collect();
            (board.chart_of[t.index()].is_none() && beside.len() >= 2).then(|| (t, beside[0]))
        });
        let Some((t, chart)) = notch else { return };
        board.chart_of[t.index()] = Some(chart);
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(512))]

    /// Along every edge of a random board, both triangles show the same, over several pages.
    #[test]
    fn decode_random_board_has_no_seam(
        seed in 0..u64::MAX,
        n in 2..9_u32,
        charts in 1..7_u64,
        share in 0.0_f64..0.7,
        page_rows in 3..17_u32,
    ) {
        let board = textured_board(seed, n, charts, share);
        let atlas = board.atlas([48, page_rows.max(12) * 4]);
        let (codes, report) = board.encode(&atlas).expect("fits");
        prop_assert_eq!(report.several_chart_edges, 0);
        prop_assert_eq!(report.largest_rounding, 0.0);
        let seam = board.largest_seam(&codes, &atlas);
        // Places reach a few hundred rows; f32 keeps them to 1e-5 texels.
        prop_assert!(seam < 4e-4, "a seam of {}", seam);
        for (t, own) in board.mesh.triangle_ids().zip(codes.iter(&board.mesh)) {
            prop_assert_eq!(own, codes.of_triangle(&board.mesh, t));
            // Never two places but in a texture triangle or along one chart edge.
            let places = own.iter().filter(|code| !code.is_color()).count();
            let charted = board.chart_of[t.index()].is_some();
            let chart_edge = board.adjacency.neighbors(t).any(|(_, n)| board.chart_of[n.index()].is_some());
            let allowed = if charted { 3 } else { 1 + usize::from(chart_edge) };
            prop_assert!(places <= allowed, "{} places", places);
        }
    }

    /// Which corner is a color, which places there are, who differs from its vertex, how many codes a vertex has: none
    /// of it depends on values, so all layers of a bake split alike.
    #[test]
    fn encode_structure_does_not_depend_on_values(
        seed in 0..u64::MAX,
        n in 2..7_u32,
        charts in 1..4_u64,
        share in 0.0_f64..0.7,
        flat in any::<bool>(),
    ) {
        let board = textured_board(seed, n, charts, share);
        // Random light, and light that is the same everywhere, black or white: codes of color copies then are equal
        // to those of other vertices.
        let random: Vec<[f32; 3]> = board.values.iter().map(|&v| [v, v * v, 1.0 - v]).collect();
        let constant = vec![[f32::from(u8::from(flat)); 3]; board.values.len()];
        let (one, one_report, _) = encode_rgb(&board, &random, [1.0, 0.5, 0.25]);
        let (other, other_report, _) = encode_rgb(&board, &constant, [0.0; 3]);
        prop_assert_eq!(one.override_count(), other.override_count());
        let (one_table, _) = one.to_table(3, 0.2).expect("few colors");
        for t in board.mesh.triangle_ids() {
            let places = |codes: &Codes| codes.of_triangle(&board.mesh, t).map(LightCode::position);
            prop_assert_eq!(places(&one), places(&other));
            prop_assert_eq!(places(&one), places(&one_table));
        }
        let structure = |report: EncodeReport| EncodeReport { clamped: 0, readback_spread: 0.0, ..report };
        prop_assert_eq!(structure(one_report), structure(other_report));
    }
}
