//! The cases of section 4.3 and those that it leaves out (DESIGN.md, "The mixed triangles"), each drawn.
//! `#` marks texture triangles.

use lightkiln_mesh::{TriangleId, VertexId};
use proptest::prelude::*;

use crate::testing::{Board, random_board};
use crate::{EncodeError, LightCode, encode};

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
}
