//! Contact sheets: pictures in rows and columns, with captions above and legends below.

use glam::{Vec2, Vec3};

use crate::Picture;
use crate::letters::{draw, fitted, width};

/// White between pictures, in pixels.
const GAP: usize = 4;

/// Columns before a sheet wraps, unless more are asked for.
const MOST_COLUMNS: usize = 6;

/// Color of letters.
const INK: Vec3 = Vec3::splat(0.02);

/// Something that explains the colors of a picture.
#[derive(Clone, Debug)]
pub enum Legend {
    /// A bar of colors from left to right.
    Bar {
        /// Colors at equal distances, the first at the left end; linear.
        colors: Vec<Vec3>,
        /// Places, 0 at the left end and 1 at the right, with what stands there. Those without room are left out, the
        /// later ones first.
        marks: Vec<(f32, String)>,
    },
    /// Colors with their names.
    Names(Vec<(Vec3, String)>),
}

/// A picture on a sheet.
#[derive(Clone, Debug)]
pub struct Panel {
    /// The picture.
    pub picture: Picture,
    /// What it is; may be empty. Cut off where it has no room.
    pub caption: String,
    /// What its colors mean.
    pub legend: Option<Legend>,
}

/// Columns for a line of so many pictures: as many, or as makes lines of about equal length if they are more than six.
pub fn columns(row: usize) -> usize {
    row.div_ceil(row.div_ceil(MOST_COLUMNS).max(1)).max(1)
}

/// Pictures in rows of so many, with thin white lines between them, each with its caption above and its legend below.
/// Columns are as wide as their widest picture and rows as high as their highest; smaller ones stand in the upper left
/// corner of their place.
///
/// - `columns`: at least 1
pub fn sheet(panels: &[Panel], columns: usize) -> Picture {
    let columns = columns.clamp(1, panels.len().max(1));
    // Letters of one size, that of the narrowest picture.
    let narrowest = panels.iter().map(|panel| panel.picture.width).min().unwrap_or(0);
    let letter = (narrowest as f32 / 40.0).clamp(7.0, 18.0);
    let any = |has: &dyn Fn(&Panel) -> bool| panels.iter().any(has);
    let strip = |lines: f32| (lines * letter).round() as usize;
    let above = if any(&|panel| !panel.caption.is_empty()) { strip(2.2) } else { 0 };
    let below = if any(&|panel| panel.legend.is_some()) { strip(3.6) } else { 0 };
    let mut widths = vec![0; columns];
    let mut heights = vec![0; panels.len().div_ceil(columns)];
    for (number, Panel { picture, .. }) in panels.iter().enumerate() {
        let (width, height) = (&mut widths[number % columns], &mut heights[number / columns]);
        (*width, *height) = ((*width).max(picture.width), (*height).max(picture.height + above + below));
    }
    let total = |sizes: &[usize]| (sizes.iter().sum::<usize>() + GAP * sizes.len()).saturating_sub(GAP);
    let start = |sizes: &[usize], number: usize| sizes[..number].iter().map(|size| size + GAP).sum::<usize>();
    let mut out = Picture::plain([total(&widths), total(&heights)], Vec3::ONE);
    for (number, panel) in panels.iter().enumerate() {
        let [left, top] = [start(&widths, number % columns), start(&heights, number / columns)];
        out.put(&panel.picture, [left, top + above]);
        let room = panel.picture.width as f32 - letter;
        let at = Vec2::new(left as f32 + 0.5 * letter, top as f32 + 1.6 * letter);
        draw(&mut out, &fitted(&panel.caption, letter, room), at, letter, INK);
        let at = Vec2::new(at.x, (top + above + panel.picture.height) as f32 + 0.6 * letter);
        match &panel.legend {
            Some(Legend::Bar { colors, marks }) => bar(&mut out, colors, marks, at, room, letter),
            Some(Legend::Names(names)) => swatches(&mut out, names, at, room, letter),
            None => {}
        }
    }
    out
}

/// - `at`: the upper left corner
fn bar(out: &mut Picture, colors: &[Vec3], marks: &[(f32, String)], at: Vec2, room: f32, letter: f32) {
    if colors.is_empty() || room < 2.0 {
        return;
    }
    fill(out, [at.x, at.y, at.x + room, at.y + letter], &|share| {
        let place = share * (colors.len() - 1) as f32;
        let first = (place as usize).min(colors.len() - 1);
        colors[first].lerp(colors[(first + 1).min(colors.len() - 1)], place - first as f32)
    });
    let small = 0.8 * letter;
    let mut taken: Vec<[f32; 2]> = Vec::new();
    for (place, text) in marks {
        let (middle, half) = (at.x + place * room, 0.5 * width(text, small));
        let left = (middle - half).clamp(at.x, (at.x + room - 2.0 * half).max(at.x));
        let span = [left, left + 2.0 * half];
        if taken.iter().any(|other| span[0] < other[1] + small && other[0] < span[1] + small) {
            continue;
        }
        taken.push(span);
        let tick = middle.clamp(at.x + 0.5, at.x + room - 0.5);
        fill(out, [tick - 0.5, at.y + letter, tick + 0.5, at.y + 1.5 * letter], &|_| INK);
        draw(out, text, Vec2::new(left, at.y + 1.8 * letter + small), small, INK);
    }
}

/// - `at`: the upper left corner
fn swatches(out: &mut Picture, names: &[(Vec3, String)], at: Vec2, room: f32, letter: f32) {
    // Smaller where they have no room, as long as they can be read.
    let letter = match names.iter().map(|(_, name)| 2.4 * letter + width(name, letter)).sum::<f32>() {
        wide if wide > room => (letter * room / wide).max(5.0),
        _ => letter,
    };
    let mut pen = at.x;
    for (color, name) in names {
        let wide = 1.4 * letter + width(name, letter);
        if pen + wide > at.x + room {
            break;
        }
        fill(out, [pen, at.y, pen + letter, at.y + letter], &|_| *color);
        draw(out, name, Vec2::new(pen + 1.4 * letter, at.y + letter), letter, INK);
        pen += wide + letter;
    }
}

/// Fills a rectangle of left, top, right and bottom; `color` takes the share of the way from left to right.
fn fill(out: &mut Picture, [left, top, right, bottom]: [f32; 4], color: &dyn Fn(f32) -> Vec3) {
    let within = |low: f32, high: f32, size: usize| {
        (low.round().max(0.0) as usize).min(size)..(high.round().max(0.0) as usize).min(size)
    };
    for row in within(top, bottom, out.height) {
        for column in within(left, right, out.width) {
            let share = ((column as f32 + 0.5 - left) / (right - left)).clamp(0.0, 1.0);
            out.pixels[row * out.width + column] = color(share).extend(1.0);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn panel(size: [usize; 2], value: f32, caption: &str) -> Panel {
        let picture = Picture::plain(size, Vec3::splat(value));
        Panel { picture, caption: caption.to_owned(), legend: None }
    }

    #[test]
    fn sheet_of_pictures_has_lines_between() {
        let panels = [panel([3, 2], 0.0, ""), panel([5, 2], 0.5, ""), panel([2, 6], 0.2, "")];
        let row = sheet(&panels[..2], 2);
        assert_eq!((row.width, row.height, row.pixels.len()), (12, 2, 24));
        assert_eq!((row.pixels[2].x, row.pixels[3].x, row.pixels[7].x), (0.0, 1.0, 0.5));
        let wrapped = sheet(&panels, 2);
        assert_eq!((wrapped.width, wrapped.height), (12, 12));
        assert_eq!((wrapped.pixels[6 * 12].x, wrapped.pixels[6 * 12 + 2].x), (0.2, 1.0));
        assert_eq!(sheet(&panels[..1], 7), panels[0].picture);
    }

    #[test]
    fn sheet_columns_wrap_into_lines_of_equal_length() {
        let all: Vec<usize> = [0, 1, 4, 6, 7, 8, 13].into_iter().map(columns).collect();
        assert_eq!(all, [1, 1, 4, 6, 4, 4, 5]);
    }

    #[test]
    fn sheet_with_a_caption_and_a_legend_leaves_the_picture_alone() {
        let mut panels = [panel([160, 40], 0.5, "error"), panel([160, 40], 0.25, "")];
        let colors = vec![Vec3::Z, Vec3::ONE, Vec3::X];
        let marks = [(0.5, "0"), (0.0, "-10 %"), (1.0, "+10 %"), (0.51, "no room")];
        let marks = marks.map(|(place, text)| (place, text.to_owned())).to_vec();
        panels[0].legend = Some(Legend::Bar { colors, marks });
        panels[1].legend = Some(Legend::Names(vec![(Vec3::Y, "texture".to_owned())]));
        let out = sheet(&panels, 2);
        assert_eq!((out.width, out.height), (324, 40 + 15 + 25));
        let at = |column: usize, row: usize| out.pixels[row * out.width + column].truncate();
        assert_eq!((at(0, 15).x, at(159, 54).x, at(164, 15).x), (0.5, 0.5, 0.25));
        // Letters stand in the strip above the first picture only.
        let ink = |columns: std::ops::Range<usize>, rows: std::ops::Range<usize>| {
            rows.flat_map(|row| columns.clone().map(move |column| (column, row)))
                .filter(|&(column, row)| at(column, row).max_element() < 0.3)
                .count()
        };
        assert!(ink(0..160, 0..15) > 20 && ink(164..324, 0..15) == 0);
        // The bar goes from blue by white to red; the swatch is green.
        let row = 55 + 4 + 3;
        assert!(at(5, row).z > 0.95 && at(5, row).x < 0.1);
        assert!(at(80, row).min_element() > 0.95 && at(154, row).x > 0.95 && at(154, row).z < 0.1);
        assert_eq!(at(164 + 6, row), Vec3::Y);
    }
}
