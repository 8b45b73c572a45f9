//! Charts, found again from codes: no two charts share a place in the atlas, so texture triangles that share one are in
//! the same chart.

use lightkiln_encode::LightCode;

/// Numbers the charts of a file.
///
/// - `triangles`: corners as indices into `codes`
/// - `codes`: of the vertices
/// - returns: how many charts there are, and the chart of each vertex, from 1; 0 at color-vertices. Charts are numbered by
///   the first triangle of each. A texture-vertex of mixed triangles alone has a chart only if it shares its place
///   with one.
pub fn charts(triangles: &[[u32; 3]], codes: &[LightCode]) -> (u32, Vec<u32>) {
    let mut places: Vec<[u16; 2]> = codes.iter().filter(|c| !c.is_color()).map(|c| c.0).collect();
    places.sort_unstable();
    places.dedup();
    let place = |vertex: u32| places.binary_search(&codes[vertex as usize].0).ok();
    let mut parents: Vec<u32> = (0..places.len() as u32).collect();
    let whole = |corners: &&[u32; 3]| corners.iter().all(|&v| !codes[v as usize].is_color());
    for corners in triangles.iter().filter(whole) {
        let [a, b, c] = corners.map(|v| place(v).map_or(0, |p| root(&mut parents, p as u32)));
        // The smallest stands for all, so that the result does not depend on the order.
        let least = a.min(b).min(c);
        for other in [a, b, c] {
            parents[other as usize] = least;
        }
    }
    let mut numbers = vec![0; places.len()];
    let mut count = 0;
    for corners in triangles.iter().filter(whole) {
        let Some(at) = place(corners[0]) else { continue };
        let root = root(&mut parents, at as u32) as usize;
        if numbers[root] == 0 {
            count += 1;
            numbers[root] = count;
        }
    }
    let chart = |code: &LightCode| match places.binary_search(&code.0) {
        Ok(at) if !code.is_color() => numbers[root(&mut parents, at as u32) as usize],
        _ => 0,
    };
    (count, codes.iter().map(chart).collect())
}

fn root(parents: &mut [u32], mut at: u32) -> u32 {
    while parents[at as usize] != at {
        parents[at as usize] = parents[parents[at as usize] as usize];
        at = parents[at as usize];
    }
    at
}

#[cfg(test)]
mod tests {
    use super::*;

    fn place(u: f32, v: f32) -> LightCode {
        LightCode::texture([u, v]).expect("in range")
    }

    #[test]
    fn charts_of_two_pieces_are_two_whatever_their_vertices() {
        // Two triangles that share an edge by place but not by vertex, one elsewhere, one that is mixed.
        let codes = [
            place(1.0, 1.0),
            place(4.0, 1.0),
            place(1.0, 4.0),
            place(4.0, 1.0),
            place(4.0, 4.0),
            place(1.0, 4.0),
            place(9.0, 9.0),
            place(12.0, 9.0),
            place(9.0, 12.0),
            LightCode::color(0.5),
        ];
        let (count, charts) = charts(&[[6, 7, 8], [0, 1, 2], [3, 4, 5], [9, 7, 6]], &codes);
        assert_eq!(count, 2);
        assert_eq!(charts, [2, 2, 2, 2, 2, 2, 1, 1, 1, 0]);
    }

    #[test]
    fn charts_of_colors_alone_are_none() {
        let codes = [LightCode::color(0.0); 3];
        assert_eq!(charts(&[[0, 1, 2]], &codes), (0, vec![0; 3]));
        assert_eq!(charts(&[], &[]), (0, vec![]));
    }
}
