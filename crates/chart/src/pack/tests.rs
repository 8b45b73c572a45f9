//! What the packers promise, on charts made here.

use super::*;
use lightkiln_mesh::{TriangleId, VertexId};
use proptest::prelude::*;

/// A chart from triangles in texels of its grid, size derived: multiples of 4 with the gutter around.
fn chart(triangles: &[[[f32; 2]; 3]], gutter: u32) -> Chart {
    let uv: Vec<Vec2> = triangles.iter().flatten().map(|&p| Vec2::from(p)).collect();
    let high = uv.iter().fold(Vec2::ZERO, |high, &p| high.max(p)) + gutter as f32;
    let count = triangles.len() as u32;
    Chart {
        triangles: (0..count).map(TriangleId).collect(),
        vertices: (0..3 * count).map(VertexId).collect(),
        corners: (0..count).map(|t| [3 * t, 3 * t + 1, 3 * t + 2]).collect(),
        uv,
        size: [high.x, high.y].map(|texels| (texels.ceil() as u32).next_multiple_of(BLOCK)),
    }
}

/// A rectangle of `width` x `height` texels behind a gutter of 2.
fn rectangle(width: f32, height: f32) -> Chart {
    let (low, x, y) = (2.0, 2.0 + width, 2.0 + height);
    chart(&[[[low, low], [x, low], [x, y]], [[low, low], [x, y], [low, y]]], 2)
}

/// A square ring with a hole: `outer` texels a side, 4 wide.
fn ring(outer: f32) -> Chart {
    let (a, b) = (2.0, 2.0 + outer);
    let mut sides = Vec::new();
    for [x0, y0, x1, y1] in [[a, a, b, a + 4.0], [a, b - 4.0, b, b], [a, a, a + 4.0, b], [b - 4.0, a, b, b]] {
        sides.push([[x0, y0], [x1, y0], [x1, y1]]);
        sides.push([[x0, y0], [x1, y1], [x0, y1]]);
    }
    chart(&sides, 2)
}

fn packers() -> Vec<Packer> {
    Packer::ALL.to_vec()
}

/// The charts here have a gutter of 2.
fn options(packer: Packer) -> PackOptions {
    PackOptions { gutter: 2, packer, ..PackOptions::default() }
}

#[test]
fn pack_nothing_gives_no_pages() {
    for packer in packers() {
        let packing = pack(&[], &options(packer)).unwrap();
        assert_eq!(packing, Packing::default());
        assert_eq!(fill_rate(&[], &packing), 1.0);
    }
}

#[test]
fn pack_one_chart_takes_its_size() {
    for packer in packers() {
        let charts = [rectangle(20.0, 9.0)];
        let packing = pack(&charts, &options(packer)).unwrap();
        check(&charts, &packing, 2).unwrap();
        assert_eq!(packing.page_texels(), 24 * 16, "{packer:?}");
        assert_eq!(chart_texels(&charts), 180.0);
    }
}

#[test]
fn pack_chart_without_triangles_takes_no_block() {
    let mut nothing = rectangle(3.0, 3.0);
    nothing.corners.clear();
    nothing.triangles.clear();
    let charts = [nothing.clone(), rectangle(12.0, 4.0), nothing];
    let packing = pack(&charts, &options(Packer::Blocks)).unwrap();
    check(&charts, &packing, 2).unwrap();
    assert_eq!(packing.page_texels(), 16 * 8);
}

#[test]
fn pack_many_single_blocks_fills_95_percent() {
    let charts = vec![chart(&[[[1.0, 1.0], [3.0, 1.0], [1.0, 3.0]]], 1); 10_007];
    let options = PackOptions { gutter: 1, ..PackOptions::default() };
    let packing = pack(&charts, &options).unwrap();
    check(&charts, &packing, 1).unwrap();
    assert!(block_fill(&charts, &packing, 1).unwrap() > 0.95, "{packing:?}");
}

#[test]
fn pack_small_charts_fill_the_hole_of_a_ring() {
    let mut charts = vec![rectangle(4.0, 4.0); 20];
    charts.push(ring(60.0));
    let packing = pack(&charts, &options(Packer::Blocks)).unwrap();
    check(&charts, &packing, 2).unwrap();
    assert_eq!(packing.page_size, [64, 64]);
}

#[test]
fn pack_chart_larger_than_a_page_is_refused_with_numbers() {
    for packer in packers() {
        let charts = [rectangle(4.0, 4.0), rectangle(300.0, 4.0)];
        let options = PackOptions { max_page: 256, ..options(packer) };
        let error = pack(&charts, &options).unwrap_err();
        assert_eq!(error, PackError::ChartTooLarge { chart: 1, size: [304, 8], page: [256, 256] });
    }
}

#[test]
fn pack_full_pages_open_new_ones() {
    let charts = vec![rectangle(60.0, 60.0); 10];
    let options = PackOptions { max_page: 128, ..options(Packer::Blocks) };
    let packing = pack(&charts, &options).unwrap();
    check(&charts, &packing, 2).unwrap();
    assert_eq!((packing.pages, packing.page_size), (3, [128, 128]));
}

#[test]
fn pack_more_than_the_stack_is_refused() {
    let charts = vec![rectangle(60.0, 60.0); 32 * 2];
    let options = PackOptions { max_page: 64, ..options(Packer::Blocks) };
    let error = pack(&charts, &options).unwrap_err();
    assert_eq!(error, PackError::AtlasFull { texels: 64 * 4096, limit: 64 * 4092 });
    assert!(error.to_string().contains("detail 1.1 times"), "{error}");
}

#[test]
fn pack_malformed_charts_are_refused() {
    let good = rectangle(4.0, 4.0);
    let mut nan = good.clone();
    nan.uv[0].x = f32::NAN;
    let mut outside = good.clone();
    outside.uv[1].y = 99.0;
    let mut corner = good.clone();
    corner.corners[0][2] = 6;
    let mut size = good.clone();
    size.size[0] += 1;
    for bad in [nan, outside, corner, size] {
        let charts = [good.clone(), bad];
        assert_eq!(pack(&charts, &options(Packer::Blocks)), Err(PackError::Malformed { chart: 1 }));
    }
}

#[test]
fn check_finds_what_breaks_the_block_rule() {
    let charts = [rectangle(4.0, 4.0), rectangle(4.0, 4.0)];
    let at = |origin| Placement { page: 0, origin, turned: false };
    let packing = |placements| Packing { placements, page_size: [16, 8], pages: 1 };
    assert_eq!(check(&charts, &packing(vec![at([0, 0]), at([8, 0])]), 2), Ok(()));
    for bad in [[4, 0], [12, 0], [6, 0], [u32::MAX - 3, 0]] {
        let result = check(&charts, &packing(vec![at([0, 0]), at(bad)]), 2);
        assert_eq!(result, Err(PackError::Overlap { chart: 1 }), "{bad:?}");
    }
    let short = check(&charts, &packing(vec![at([0, 0])]), 2);
    assert_eq!(short, Err(PackError::Count { placements: 1, charts: 2 }));
}

#[test]
fn footprint_of_a_diagonal_strip_leaves_the_corners_free() {
    let strip =
        chart(&[[[2.0, 2.0], [38.0, 36.0], [38.0, 38.0]], [[2.0, 2.0], [38.0, 38.0], [36.0, 38.0]]], 2);
    let footprint = footprint(&strip, 0, 2).unwrap();
    assert_eq!(footprint.size(), [10, 10]);
    assert!(!footprint.contains(9, 0) && !footprint.contains(0, 9));
    assert!(footprint.contains(0, 0) && footprint.contains(9, 9));
    assert!(footprint.count() < 50, "{}", footprint.count());
}

#[test]
fn footprint_of_degenerate_triangles_is_what_they_touch() {
    let point = chart(&[[[6.0, 6.0]; 3]], 2);
    assert_eq!(footprint(&point, 0, 2).unwrap().iter().collect::<Vec<_>>(), [[1, 1]]);
    let segment = chart(&[[[2.0, 2.0], [10.0, 2.0], [6.0, 2.0]]], 2);
    assert_eq!(footprint(&segment, 0, 2).unwrap().count(), 3);
}

#[test]
fn placed_uv_turned_keeps_orientation_and_texels() {
    let size = [12, 8];
    let placement = Placement { page: 0, origin: [20, 40], turned: true };
    let triangle = [[2.0, 2.0], [9.0, 3.0], [4.0, 6.0]].map(|p| placed_uv(Vec2::from(p), size, placement));
    let [a, b, c] = triangle.map(Vec2::from);
    assert_eq!((b - a).perp_dot(c - a), 26.0);
    assert_eq!(triangle[0], [26.0, 42.0]);
    for (i, j) in [(0, 0), (11, 7), (3, 5)] {
        let [x, y] = placed_uv(Vec2::new(i as f32 + 0.5, j as f32 + 0.5), size, placement);
        let texel = placed_texel([i, j], size, placement);
        assert_eq!([x, y], texel.map(|t| t as f32 + 0.5));
        assert!(texel[0] - 20 < 8 && texel[1] - 40 < 12);
    }
}

prop_compose! {
    /// A few triangles in a box of up to 60 x 60 texels, on the grid of eighths, slivers and points included.
    fn any_chart()(extent in [1_u32..480, 1_u32..480], count in 1_usize..5)
        (points in prop::collection::vec(prop::array::uniform2(0.0_f32..1.0), 3 * count), extent in Just(extent))
    -> Chart {
        let place = |p: [f32; 2]| [0, 1].map(|axis| 2.0 + (p[axis] * extent[axis] as f32).floor() / 8.0);
        let triangles: Vec<[[f32; 2]; 3]> = points.chunks(3).map(|t| [place(t[0]), place(t[1]), place(t[2])]).collect();
        chart(&triangles, 2)
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]

    #[test]
    fn footprint_holds_every_texel_that_a_lookup_reads(chart in any_chart(), gutter in 0_u32..3, weights in prop::array::uniform2(0.0_f32..1.0)) {
        let footprint = footprint(&chart, 0, gutter).unwrap();
        let [u, v] = lightkiln_mesh::random::square_to_triangle(weights);
        for corners in &chart.corners {
            let [a, b, c] = corners.map(|vertex| chart.uv[vertex as usize]);
            let low = (a + u * (b - a) + v * (c - a) - 0.5).floor().as_uvec2();
            for (i, j) in [(0, 0), (1, 0), (0, 1), (1, 1)] {
                prop_assert!(footprint.contains_texel(low.x + i, low.y + j));
            }
        }
    }

    #[test]
    fn footprint_four_turns_are_none(chart in any_chart()) {
        let footprint = footprint(&chart, 0, 2).unwrap();
        prop_assert_eq!(footprint.turned().turned().turned().turned(), footprint);
    }

    #[test]
    fn pack_any_charts_keeps_the_block_rule(charts in prop::collection::vec(any_chart(), 1..60), narrow in any::<bool>()) {
        for packer in packers() {
            let max_page = if narrow { 128 } else { MAX_PAGE };
            let options = PackOptions { max_page, ..options(packer) };
            let packing = match pack(&charts, &options) {
                Ok(packing) => packing,
                Err(error) => { prop_assert!(packer != Packer::Blocks, "{error}"); continue; }
            };
            check(&charts, &packing, 2).unwrap();
            prop_assert!(packing.page_size.iter().all(|&s| s <= max_page && s % BLOCK == 0));
            prop_assert_eq!(&pack(&charts, &options).unwrap(), &packing);
            let fill = block_fill(&charts, &packing, 2).unwrap();
            prop_assert!(fill <= 1.0 && fill_rate(&charts, &packing) <= 4.0 * fill);
        }
    }

    #[test]
    fn pack_one_thread_and_many_agree(charts in prop::collection::vec(any_chart(), 1..40)) {
        let one = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
        let alone = one.install(|| pack(&charts, &options(Packer::Blocks)));
        prop_assert_eq!(alone, pack(&charts, &options(Packer::Blocks)));
    }
}
