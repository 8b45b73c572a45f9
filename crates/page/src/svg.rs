//! Bars and histograms as inline SVG. Colors are classes, which the page's style sheet paints for light, dark and
//! paper.

use std::fmt::Write;

use crate::html::escape;

/// A part of a bar.
#[derive(Clone, Debug)]
pub struct Piece {
    /// What it is, for the legend and for hovering.
    pub label: String,
    /// Its value as text.
    pub text: String,
    /// Its length, at least 0.
    pub value: f64,
    /// Class of its color, a word of this crate.
    pub class: &'static str,
}

/// A bar of several pieces.
#[derive(Clone, Debug)]
pub struct Bar {
    /// What stands before it.
    pub label: String,
    /// What stands behind it.
    pub total: String,
    /// From left to right.
    pub pieces: Vec<Piece>,
}

impl Bar {
    fn length(&self) -> f64 {
        self.pieces.iter().map(|p| p.value.max(0.0)).sum()
    }
}

const WIDTH: f64 = 720.0;
const LABEL: f64 = 170.0;
const TOTAL: f64 = 110.0;
const ROW: f64 = 30.0;

/// Bars under each other at one scale, labelled on the left, with their totals on the right.
pub fn bars(title: &str, bars: &[Bar]) -> String {
    let longest = bars.iter().map(Bar::length).fold(0.0, f64::max);
    let room = WIDTH - LABEL - TOTAL;
    let mut out = open(title, WIDTH, ROW * bars.len() as f64);
    for (row, bar) in bars.iter().enumerate() {
        let top = row as f64 * ROW;
        let middle = top + ROW / 2.0 + 4.5;
        let (label, total) = (escape(&bar.label), escape(&bar.total));
        let _ = write!(out, "<text x=\"{:.1}\" y=\"{middle:.1}\" class=\"end\">{label}</text>", LABEL - 10.0);
        let mut x = LABEL;
        for piece in &bar.pieces {
            let width = if longest > 0.0 { piece.value.max(0.0) / longest * room } else { 0.0 };
            rect(&mut out, piece, [x, top + 4.0, width, ROW - 8.0]);
            x += width;
        }
        let _ = write!(out, "<text x=\"{:.1}\" y=\"{middle:.1}\">{total}</text>", x + 8.0);
    }
    out.push_str("</svg>\n");
    wide(&out)
}

/// One bar over the whole width, whose pieces are shares of it, with a legend under it.
pub fn shares(title: &str, pieces: &[Piece]) -> String {
    let total: f64 = pieces.iter().map(|p| p.value.max(0.0)).sum();
    let mut out = open(title, WIDTH, 34.0);
    let mut x = 0.0;
    for piece in pieces {
        let width = if total > 0.0 { piece.value.max(0.0) / total * WIDTH } else { 0.0 };
        rect(&mut out, piece, [x, 0.0, width, 34.0]);
        x += width;
    }
    out.push_str("</svg>\n");
    out + &legend(pieces)
}

/// What the colors of pieces mean, with their values.
pub fn legend(pieces: &[Piece]) -> String {
    let mut out = "<ul class=\"legend\">".to_owned();
    for piece in pieces {
        let (label, text) = (escape(&piece.label), escape(&piece.text));
        let gap = if text.is_empty() { "" } else { " " };
        let _ = write!(out, "<li><i class=\"{}\"></i>{label}{gap}<b>{text}</b></li>", piece.class);
    }
    out + "</ul>\n"
}

/// Bins as columns, and a second series as a stepped line over them. `edges` are the labels between bins, one less
/// than bins; `mark` is a place along the axis, in bins, with its label.
pub fn histogram(
    title: &str,
    columns: &[f64],
    line: Option<&[f64]>,
    edges: &[String],
    mark: Option<(f64, &str)>,
) -> String {
    const HEIGHT: f64 = 180.0;
    const LEFT: f64 = 44.0;
    let top = columns.iter().chain(line.unwrap_or_default()).copied().fold(0.0, f64::max).max(1e-9);
    let step = (WIDTH - LEFT) / columns.len().max(1) as f64;
    let y = |share: f64| 18.0 + (1.0 - share / top) * (HEIGHT - 18.0);
    let mut out = open(title, WIDTH, HEIGHT + 34.0);
    for share in [0.5 * top, top] {
        let (at, percent) = (y(share), share * 100.0);
        let _ = write!(
            out,
            "<path d=\"M{LEFT} {at:.1}H{WIDTH}\" class=\"grid\"/>\
             <text x=\"{:.1}\" y=\"{:.1}\" class=\"end small\">{percent:.0} %</text>",
            LEFT - 6.0,
            at + 4.0
        );
    }
    for (bin, &share) in columns.iter().enumerate() {
        let x = LEFT + bin as f64 * step;
        let piece = Piece {
            label: format!("bin {}", bin + 1),
            text: format!("{:.2} %", share * 100.0),
            value: share,
            class: "hybrid",
        };
        rect(&mut out, &piece, [x + 1.0, y(share), step - 2.0, HEIGHT - y(share)]);
    }
    if let Some(line) = line {
        let mut path = format!("M{LEFT} {HEIGHT}");
        for (bin, &share) in line.iter().enumerate() {
            let x = LEFT + bin as f64 * step;
            let _ = write!(path, "L{x:.1} {0:.1}H{1:.1}", y(share), x + step);
        }
        let _ = write!(out, "<path d=\"{path}V{HEIGHT}\" class=\"line\"/>");
    }
    let _ = write!(out, "<path d=\"M{LEFT} {HEIGHT}H{WIDTH}\" class=\"axis\"/>");
    for (number, edge) in edges.iter().enumerate().filter(|(n, _)| n % 2 == 0) {
        let x = LEFT + (number + 1) as f64 * step;
        let edge = escape(edge);
        let _ =
            write!(out, "<text x=\"{x:.1}\" y=\"{:.1}\" class=\"middle small\">{edge}</text>", HEIGHT + 18.0);
    }
    if let Some((at, label)) = mark {
        let x = LEFT + at.clamp(0.0, columns.len() as f64) * step;
        let (anchor, text_x) = if x > WIDTH * 0.7 { ("end", x - 6.0) } else { ("start", x + 6.0) };
        let _ = write!(
            out,
            "<path d=\"M{x:.1} 4V{HEIGHT}\" class=\"mark\"/>\
             <text x=\"{text_x:.1}\" y=\"14\" class=\"{anchor} small\">{}</text>",
            escape(label)
        );
    }
    out.push_str("</svg>\n");
    wide(&out)
}

/// On a small screen a chart keeps a size at which its text can be read, and is moved under the finger.
fn wide(svg: &str) -> String {
    format!("<div class=\"scroll\">{svg}</div>\n")
}

fn open(title: &str, width: f64, height: f64) -> String {
    let title = escape(title);
    format!(
        "<svg viewBox=\"0 0 {width} {height}\" role=\"img\" aria-label=\"{title}\"><title>{title}</title>"
    )
}

fn rect(out: &mut String, piece: &Piece, [x, y, width, height]: [f64; 4]) {
    if width <= 0.0 || height <= 0.0 {
        return;
    }
    let _ = write!(
        out,
        "<rect x=\"{x:.1}\" y=\"{y:.1}\" width=\"{width:.1}\" height=\"{height:.1}\" class=\"{}\"><title>{} {}</title></rect>",
        piece.class,
        escape(&piece.label),
        escape(&piece.text)
    );
}

#[cfg(test)]
mod tests {
    use super::*;

    fn piece(label: &str, value: f64) -> Piece {
        Piece { label: label.to_owned(), text: String::new(), value, class: "color" }
    }

    #[test]
    fn shares_of_a_bar_fill_its_width() {
        let svg = shares("all", &[piece("a", 1.0), piece("<b>", 3.0), piece("none", 0.0)]);
        assert!(svg.contains("width=\"180.0\"") && svg.contains("width=\"540.0\""), "{svg}");
        assert_eq!(svg.matches("<rect").count(), 2);
        assert!(!svg.contains("<b>b") && svg.contains("&lt;b&gt;"));
    }

    #[test]
    fn bars_of_nothing_have_no_length() {
        let bar = Bar { label: "x".into(), total: "0 B".into(), pieces: vec![piece("a", 0.0)] };
        let svg = bars("none", &[bar]);
        assert!(!svg.contains("<rect") && !svg.contains("NaN"), "{svg}");
    }

    #[test]
    fn histogram_marks_the_bound_within_the_picture() {
        let svg = histogram("h", &[0.5, 0.5], Some(&[1.0, 0.0]), &["1".into()], Some((7.0, "bound")));
        assert!(svg.contains("M720.0 4V180") && svg.matches("<rect").count() == 2, "{svg}");
    }
}
