//! What the cases are, before any GPU draws them: the CPU twin shows the board's light, and every mix of corners is there.

use lightkiln_gpu::{BOUND, PIXELS, Program, RANDOM_CASES, board_light, cases};

#[test]
fn board_shows_its_linear_light_across_seams_and_blends() {
    let (_, cases) = cases();
    for case in &cases[RANDOM_CASES..] {
        let mut compared = 0;
        for (pixel, expected) in case.expected.iter().enumerate() {
            let Some(expected) = expected else { continue };
            compared += 1;
            let middle = [pixel as u32 % PIXELS, pixel as u32 / PIXELS].map(|i| i as f32 + 0.5);
            for (channel, shown) in expected.iter().enumerate() {
                let light = board_light(if case.program.is_grey() { 0 } else { channel }, middle);
                let light = if case.program == Program::Clamped { light.clamp(0.3, 0.7) } else { light };
                assert!((shown - light).abs() < BOUND, "{:?}, {middle:?}: {shown} {light}", case.program);
            }
        }
        assert!(compared > 120, "{compared} pixels");
    }
}

#[test]
fn cases_cover_every_mix_of_corners_in_both_levels() {
    let (textures, cases) = cases();
    for program in Program::ALL {
        // By how many corners are colors, and whether texels are minified.
        let mut seen = [[0; 2]; 4];
        for case in cases[..RANDOM_CASES].iter().filter(|case| case.program == program) {
            let limit = if program == Program::Interop { 2.0 } else { 32768.0 };
            let colors = case.attributes[0].iter().filter(|pair| pair[1] >= limit).count();
            let is_small = case.positions[1][0] < 1.0;
            seen[colors][usize::from(is_small)] += case.expected.iter().flatten().count();
        }
        for (colors, [large, small]) in seen.into_iter().enumerate() {
            assert!(large > 200 && small > 20, "{program:?} with {colors} colors: {large}, {small} pixels");
        }
    }
    assert_eq!(textures.grey.levels[1].len(), textures.grey.levels[0].len() / 4);
}
