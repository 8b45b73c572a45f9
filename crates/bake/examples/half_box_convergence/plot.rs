//! One log-log chart as SVG, and nothing else.

use std::fmt::Write as _;

/// A line of the chart; points are (samples, error), both positive.
pub struct Curve {
    pub name: &'static str,
    pub color: &'static str,
    pub dashed: bool,
    pub points: Vec<[f64; 2]>,
}

const WIDTH: f64 = 760.0;
const HEIGHT: f64 = 580.0;
/// Left, top, right and bottom edge of the plotting area.
const FRAME: [f64; 4] = [76.0, 56.0, 736.0, 522.0];
/// Powers of ten along x and y.
const X: [i32; 2] = [2, 5];
const Y: [i32; 2] = [-5, 0];

fn place([samples, error]: [f64; 2]) -> [f64; 2] {
    let [left, top, right, bottom] = FRAME;
    let share = |value: f64, [low, high]: [i32; 2]| (value.log10() - f64::from(low)) / f64::from(high - low);
    // A little room at both ends of x, where counts are not exact.
    let x = (share(samples, X) * 0.94 + 0.03) * (right - left);
    [left + x, bottom - share(error, Y) * (bottom - top)]
}

/// The chart.
pub fn svg(curves: &[Curve]) -> String {
    let mut out = String::new();
    // Writing to a string cannot fail.
    let _ = write(&mut out, curves);
    out
}

fn write(out: &mut String, curves: &[Curve]) -> std::fmt::Result {
    let [left, top, right, bottom] = FRAME;
    writeln!(
        out,
        r##"<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {HEIGHT}" width="{WIDTH}" height="{HEIGHT}" font-family="sans-serif" font-size="13">
<rect width="100%" height="100%" fill="#fff"/>
<text x="{left}" y="24" font-size="15" font-weight="bold" fill="#222">Half box: farthest vertex value from the closed form</text>
<text x="{left}" y="42" fill="#555">mean over 8 sets of samples; solid: split from the shared corner, dashed: the other diagonal</text>"##
    )?;
    for power in X[0]..=X[1] {
        let [x, _] = place([10_f64.powi(power), 1.0]);
        writeln!(out, r##"<path d="M{x:.1} {top}V{bottom}" stroke="#e4e4e4"/>"##)?;
        let label = ["100", "1 000", "10 000", "100 000"][(power - X[0]) as usize];
        writeln!(
            out,
            r##"<text x="{x:.1}" y="{:.1}" text-anchor="middle" fill="#333">{label}</text>"##,
            bottom + 20.0
        )?;
    }
    for power in Y[0]..=Y[1] {
        let [_, y] = place([1.0, 10_f64.powi(power)]);
        writeln!(out, r##"<path d="M{left} {y:.1}H{right}" stroke="#e4e4e4"/>"##)?;
        let label = ["0.00001", "0.0001", "0.001", "0.01", "0.1", "1"][(power - Y[0]) as usize];
        writeln!(
            out,
            r##"<text x="{:.1}" y="{:.1}" text-anchor="end" fill="#333">{label}</text>"##,
            left - 8.0,
            y + 4.5
        )?;
    }
    let (middle, below) = (0.5 * (left + right), bottom + 44.0);
    writeln!(
        out,
        r##"<text x="{middle}" y="{below}" text-anchor="middle" fill="#333">samples on the whole surface (three unit squares)</text>"##
    )?;
    writeln!(out, r##"<path d="M{left} {top}V{bottom}H{right}" fill="none" stroke="#888"/>"##)?;
    for (start, slope, name) in GUIDES {
        let at = |samples: f64| [samples, start * (samples / 100.0).powf(slope)];
        let ([x1, y1], [x2, y2]) = (place(at(100.0)), place(at(1e5)));
        writeln!(
            out,
            r##"<path d="M{x1:.1} {y1:.1}L{x2:.1} {y2:.1}" stroke="#999" stroke-dasharray="2 4"/>"##
        )?;
        // Below the line at its end.
        let (x, y) = (x2 - 8.0, y2 + 14.0);
        writeln!(out, r##"<text x="{x:.1}" y="{y:.1}" text-anchor="end" fill="#777">{name}</text>"##)?;
    }
    for curve in curves {
        let points: Vec<String> =
            curve.points.iter().map(|&p| place(p)).map(|[x, y]| format!("{x:.1},{y:.1}")).collect();
        let dashes = if curve.dashed { r##" stroke-dasharray="6 4""## } else { "" };
        let color = curve.color;
        writeln!(
            out,
            r##"<polyline points="{}" fill="none" stroke="{color}" stroke-width="2"{dashes}/>"##,
            points.join(" ")
        )?;
        for point in points {
            let (x, y) = point.split_once(',').unwrap_or_default();
            writeln!(out, r##"<circle cx="{x}" cy="{y}" r="3" fill="{color}"/>"##)?;
        }
    }
    for (row, curve) in curves.iter().filter(|c| !c.dashed).enumerate() {
        let (x, y) = (right - 290.0, top + 22.0 + 20.0 * row as f64);
        writeln!(out, r##"<path d="M{x} {y}h26" stroke="{}" stroke-width="3"/>"##, curve.color)?;
        writeln!(out, r##"<text x="{}" y="{:.1}" fill="#333">{}</text>"##, x + 34.0, y + 4.5, curve.name)?;
    }
    writeln!(out, "</svg>")
}

/// Straight lines to compare slopes with: error at 100 samples, slope, name.
const GUIDES: [(f64, f64, &str); 2] = [(0.006, -0.5, "slope −1/2"), (0.006, -0.75, "slope −3/4")];
