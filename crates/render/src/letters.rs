//! Letters for captions: single strokes on a grid, drawn as what lies near them, so that they are smooth at any size.
//!
//! The shapes are our own. A glyph is a list of strokes with `;` between them. A stroke is a list of points of two digits
//! each, x and y in base 36: 4 is the baseline, c (12) the height of an x, g (16) that of capitals. Strokes after `~`
//! are rounded by cutting corners (Chaikin 1974), those after `o` also closed.

use glam::{Vec2, Vec3};

use crate::Picture;

/// Height of capitals in the units of the grid.
const CAPITAL: f32 = 12.0;
const BASELINE: f32 = 4.0;
/// From one letter to the next.
const SPACING: f32 = 4.5;
const SPACE: f32 = 6.0;
/// Of a stroke.
const WEIGHT: f32 = 1.7;
/// Times that corners are cut.
const CUTS: usize = 3;

/// What stands for all that has no glyph.
const UNKNOWN: &str = "040g6g6404";

const GLYPHS: [(char, &str); 96] = [
    ('a', "o6c0c0464;6c64"),
    ('b', "0g04;o0c6c6404"),
    ('c', "~6b5c0c045465"),
    ('d', "6g64;o6c0c0464"),
    ('e', "0868;~686c0c045465"),
    ('f', "~5g2g2d;2d24;0c4c"),
    ('g', "o6c0c0464;6c63;~63602001"),
    ('h', "0g04;~0a0c6c69;6964"),
    ('i', "040c;0g0g"),
    ('j', "2c22;~222000;2g2g"),
    ('k', "0g04;5c07;2964"),
    ('l', "0g04"),
    ('m', "0c04;~0a0c5c59;5954;~5a5caca9;a9a4"),
    ('n', "0c04;~0a0c6c69;6964"),
    ('o', "o0c7c7404"),
    ('p', "0c00;o0c6c6404"),
    ('q', "6c60;o6c0c0464"),
    ('r', "0c04;~0a0c4c"),
    ('s', "~5b4c0c0858541405"),
    ('t', "2g26;~262454;0c5c"),
    ('u', "0c07;~07046467;6c64"),
    ('v', "0c346c"),
    ('w', "0c244b648c"),
    ('x', "0c64;6c04"),
    ('y', "0c34;6c10"),
    ('z', "0c6c0464"),
    ('A', "044g84;1878"),
    ('B', "0g04;~0g3g7g7a3a0a;~0a3a8a843404"),
    ('C', "~8d7g0g047487"),
    ('D', "0g04;~0g3g9g943404"),
    ('E', "7g0g0474;0a6a"),
    ('F', "7g0g04;0a6a"),
    ('G', "~8d7g0g04748489;898a5a"),
    ('H', "0g04;8g84;0a8a"),
    ('I', "0g04"),
    ('J', "5g58;~58540407"),
    ('K', "0g04;7g09;3c84"),
    ('L', "0g0464"),
    ('M', "040g57aga4"),
    ('N', "040g848g"),
    ('O', "o0g9g9404"),
    ('P', "040g;~0g3g8g893909"),
    ('Q', "o0g9g9404;67a3"),
    ('R', "040g;~0g3g8g893909;4984"),
    ('S', "~7e6g0g0a7a741406"),
    ('T', "0g8g;4g44"),
    ('U', "0g08;~08048488;888g"),
    ('V', "0g448g"),
    ('W', "0g345e74ag"),
    ('X', "0g84;8g04"),
    ('Y', "0g4a8g;4a44"),
    ('Z', "0g8g0484"),
    ('0', "o0g7g7404"),
    ('1', "1d4g44"),
    ('2', "~0d1g7g7b2704;0474"),
    ('3', "~0e1g7g7a3a;~3a7a741406"),
    ('4', "545g0777"),
    ('5', "6g1g0a;~0a2b7b741406"),
    ('6', "o0b7b7404;~6g0e07"),
    ('7', "0g7g24"),
    ('8', "o0g7g7a0a;o0a7a7404"),
    ('9', "o0g7g7909;~7d7614"),
    ('.', "0404"),
    (',', "1402"),
    (':', "0404;0b0b"),
    (';', "1402;1b1b"),
    ('!', "0g08;0404"),
    ('?', "~0e1g6g6b3b38;3434"),
    ('\'', "0g0c"),
    ('"', "0g0c;3g3c"),
    ('-', "0959"),
    ('+', "0989;4d45"),
    ('=', "0b7b;0777"),
    ('_', "0383"),
    ('/', "026h"),
    ('\\', "0h62"),
    ('(', "~3h0e0532"),
    (')', "~0h3e3502"),
    ('[', "3h0h0232"),
    (']', "0h3h3202"),
    ('{', "~4h2h2a0a;~0a2a2242"),
    ('}', "~0h2h2a4a;~4a2a2202"),
    ('<', "6d0965"),
    ('>', "0d6905"),
    ('|', "0h02"),
    ('*', "3g3a;0e6b;6e0b"),
    ('#', "244g;648g;0d9d;0797"),
    ('%', "049g;o0g4g4b0b;o59999454"),
    ('&', "840d;~0d0g5g5d0a;~0a07047489"),
    ('@', "~8449404g0g04a0"),
    ('~', "~092c476a"),
    ('^', "0d3g6d"),
    ('`', "0g2e"),
    ('$', "~7e6g0g0a7a741406;4i42"),
    ('°', "o0g4g4c0c"),
    ('×', "0d75;7d05"),
];

/// The strokes of a letter, each a line of points.
fn strokes(letter: char) -> Vec<Vec<Vec2>> {
    let glyph = GLYPHS.iter().find(|(known, _)| *known == letter).map_or(UNKNOWN, |(_, glyph)| glyph);
    let stroke = |text: &str| {
        let (points, round, closed) = match text.as_bytes() {
            [b'~', points @ ..] => (points, true, false),
            [b'o', points @ ..] => (points, true, true),
            points => (points, false, false),
        };
        let digit = |byte: u8| char::from(byte).to_digit(36).unwrap_or(0) as f32;
        let points = points.chunks_exact(2).map(|pair| Vec2::new(digit(pair[0]), digit(pair[1]) - BASELINE));
        let mut line: Vec<Vec2> = points.collect();
        for _ in 0..if round { CUTS } else { 0 } {
            line = cut(&line, closed);
        }
        if closed {
            line.extend(line.first().copied());
        }
        line
    };
    glyph.split(';').map(stroke).collect()
}

/// Cuts every corner at a quarter of its sides.
fn cut(line: &[Vec2], closed: bool) -> Vec<Vec2> {
    let mut out = Vec::with_capacity(2 * line.len());
    let sides = if closed { line.len() } else { line.len() - 1 };
    for i in 0..sides {
        let (a, b) = (line[i], line[(i + 1) % line.len()]);
        out.extend([a.lerp(b, 0.25), a.lerp(b, 0.75)]);
    }
    if !closed {
        (out[0], out[2 * sides - 1]) = (line[0], line[line.len() - 1]);
    }
    out
}

/// How far the pen moves for a letter.
fn advance(letter: char) -> f32 {
    if letter == ' ' {
        return SPACE;
    }
    let widest = strokes(letter).into_iter().flatten().fold(0.0, |most: f32, point| most.max(point.x));
    widest + SPACING
}

/// The width of a line of text in pixels.
///
/// - `height`: of a capital, in pixels
pub fn width(text: &str, height: f32) -> f32 {
    let units = text.chars().map(advance).sum::<f32>() - SPACING;
    (units.max(0.0) + WEIGHT) * height / CAPITAL
}

/// As much of a text as has room, with dots where something is left out.
pub fn fitted(text: &str, height: f32, room: f32) -> String {
    if width(text, height) <= room {
        return text.to_owned();
    }
    let letters: Vec<char> = text.chars().collect();
    let cut = |kept: usize| letters[..kept].iter().collect::<String>() + "...";
    (0..letters.len()).rev().map(cut).find(|text| width(text, height) <= room).unwrap_or_default()
}

/// Draws a line of text.
///
/// - `at`: left end of the baseline, in pixels from the upper left corner of the picture
/// - `height`: of a capital, in pixels
pub fn draw(picture: &mut Picture, text: &str, at: Vec2, height: f32, color: Vec3) {
    let scale = height / CAPITAL;
    let mut pen = at.x + 0.5 * WEIGHT * scale;
    for letter in text.chars() {
        if letter != ' ' {
            for stroke in strokes(letter) {
                let points = stroke.iter().map(|p| Vec2::new(pen + p.x * scale, at.y - p.y * scale));
                draw_stroke(picture, &points.collect::<Vec<_>>(), WEIGHT * scale, color);
            }
        }
        pen += advance(letter) * scale;
    }
}

/// Draws a line through points, with round ends.
fn draw_stroke(picture: &mut Picture, points: &[Vec2], width: f32, color: Vec3) {
    let reach = 0.5 * width + 0.5;
    let low = points.iter().copied().fold(Vec2::INFINITY, Vec2::min) - reach;
    let high = points.iter().copied().fold(Vec2::NEG_INFINITY, Vec2::max) + reach;
    let within = |low: f32, high: f32, size: usize| {
        (low.max(0.0) as usize).min(size)..(high.max(0.0).ceil() as usize).min(size)
    };
    for row in within(low.y, high.y, picture.height) {
        for column in within(low.x, high.x, picture.width) {
            let middle = Vec2::new(column as f32 + 0.5, row as f32 + 0.5);
            let near = |side: &[Vec2]| {
                let along = side[1] - side[0];
                let share = (middle - side[0]).dot(along) / along.length_squared().max(1e-9);
                middle.distance(side[0] + along * share.clamp(0.0, 1.0))
            };
            let distance = points.windows(2).map(near).fold(f32::INFINITY, f32::min);
            let cover = (reach - distance).clamp(0.0, 1.0);
            let pixel = &mut picture.pixels[row * picture.width + column];
            *pixel = pixel.lerp(color.extend(1.0), cover);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn letters_of_ascii_all_have_a_shape_of_their_own() {
        let mut seen = std::collections::BTreeSet::new();
        for letter in '!'..='~' {
            let glyph = GLYPHS.iter().find(|(known, _)| *known == letter);
            let (_, glyph) = glyph.unwrap_or_else(|| panic!("{letter}"));
            assert!(letter == 'l' || letter == 'I' || letter == '|' || seen.insert(glyph), "{letter}");
            assert!(glyph.split(';').all(|stroke| stroke.trim_start_matches(['~', 'o']).len() >= 4));
            for point in strokes(letter).into_iter().flatten() {
                assert!((0.0..=12.0).contains(&point.x) && (-4.0..=14.0).contains(&point.y), "{letter}");
            }
        }
    }

    #[test]
    fn text_is_drawn_where_its_width_says() {
        let (text, height) = ("Lightkiln 0.03 %", 12.0);
        let mut picture = Picture::plain([200, 30], Vec3::ONE);
        draw(&mut picture, text, Vec2::new(5.0, 20.0), height, Vec3::ZERO);
        let dark = |column: usize| (0..30).any(|row| picture.pixels[row * 200 + column].x < 0.5);
        let columns: Vec<usize> = (0..200).filter(|&column| dark(column)).collect();
        let (first, last) = (columns[0] as f32, columns[columns.len() - 1] as f32);
        assert!((5.0..7.0).contains(&first), "{first}");
        assert!((last - 5.0 - width(text, height)).abs() < 2.0, "{last}");
        // Letters beyond an edge are cut off.
        draw(&mut picture, text, Vec2::new(190.0, 2.0), height, Vec3::ZERO);
        draw(&mut picture, text, Vec2::new(-40.0, 33.0), height, Vec3::ZERO);
    }

    #[test]
    fn text_without_room_ends_in_dots() {
        let text = "a long name of a file";
        assert_eq!(fitted(text, 10.0, 1000.0), text);
        let short = fitted(text, 10.0, 60.0);
        assert!(short.ends_with("...") && text.starts_with(short.trim_end_matches('.')), "{short}");
        assert!(width(&short, 10.0) <= 60.0);
        assert_eq!(fitted(text, 10.0, 2.0), "");
    }
}
