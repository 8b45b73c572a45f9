//! Sheets: pictures in rows and columns.

use glam::Vec3;

use crate::Picture;

/// White between pictures, in pixels.
const GAP: usize = 4;

/// Pictures in rows of so many, with thin white lines between them. Columns are as wide as their widest picture and rows
/// as high as their highest; smaller ones stand in the upper left corner of their place.
///
/// - `columns`: at least 1
pub fn sheet(pictures: &[Picture], columns: usize) -> Picture {
    let columns = columns.clamp(1, pictures.len().max(1));
    let mut widths = vec![0; columns];
    let mut heights = vec![0; pictures.len().div_ceil(columns)];
    for (number, picture) in pictures.iter().enumerate() {
        let (width, height) = (&mut widths[number % columns], &mut heights[number / columns]);
        (*width, *height) = ((*width).max(picture.width), (*height).max(picture.height));
    }
    let total = |sizes: &[usize]| (sizes.iter().sum::<usize>() + GAP * sizes.len()).saturating_sub(GAP);
    let start = |sizes: &[usize], number: usize| sizes[..number].iter().map(|size| size + GAP).sum::<usize>();
    let mut out = Picture::plain([total(&widths), total(&heights)], Vec3::ONE);
    for (number, picture) in pictures.iter().enumerate() {
        out.put(picture, [start(&widths, number % columns), start(&heights, number / columns)]);
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sheet_of_pictures_has_lines_between() {
        let plain = |size, value: f32| Picture::plain(size, Vec3::splat(value));
        let pictures = [plain([3, 2], 0.0), plain([5, 2], 0.5), plain([2, 6], 0.2)];
        let row = sheet(&pictures[..2], 2);
        assert_eq!((row.width, row.height, row.pixels.len()), (12, 2, 24));
        assert_eq!((row.pixels[2].x, row.pixels[3].x, row.pixels[7].x), (0.0, 1.0, 0.5));
        let wrapped = sheet(&pictures, 2);
        assert_eq!((wrapped.width, wrapped.height), (12, 12));
        assert_eq!((wrapped.pixels[6 * 12].x, wrapped.pixels[6 * 12 + 2].x), (0.2, 1.0));
        assert_eq!(sheet(&pictures[..1], 7), pictures[0]);
    }
}
