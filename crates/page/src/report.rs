//! The report of a bake as one HTML file: pictures, shares, bytes, errors, times, and what to change.
//!
//! It asks for nothing from anywhere: style, charts and pictures are inside, there is no script. A content security
//! policy in the page itself keeps it so whatever a scene calls its nodes.

use std::fmt::Write;

use base64::Engine;
use lightkiln_report::errors::{BINS, bin_range};
use lightkiln_report::table::count;
use lightkiln_report::{ErrorSummary, LightBytes, Report, bytes_text};

use crate::advice::advice;
use crate::html::{escape, table};
use crate::svg::{Bar, Piece, bars, histogram, legend, shares};

/// A picture of the report.
#[derive(Clone, Debug)]
pub struct Figure {
    /// What it shows, in a few words.
    pub title: String,
    /// How to read it.
    pub caption: String,
    /// The picture as a PNG file.
    pub png: Vec<u8>,
}

const STYLE: &str = include_str!("report.css");

/// The page.
pub fn report_page(report: &Report, figures: &[Figure]) -> String {
    let title = escape(&format!("{}, baked", report.input));
    let mut out = format!(
        "<!doctype html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n\
         <meta http-equiv=\"Content-Security-Policy\" content=\"default-src 'none'; img-src data:; style-src 'unsafe-inline'\">\n\
         <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n\
         <meta name=\"color-scheme\" content=\"light dark\">\n\
         <meta name=\"generator\" content=\"{}\">\n<title>{title}</title>\n<style>\n{STYLE}</style>\n</head>\n<body>\n<main>\n",
        escape(&report.generator)
    );
    head(&mut out, report);
    pictures(&mut out, figures);
    section(&mut out, "classes", "Who shows what", &classes(report));
    section(&mut out, "bytes", "Bytes on the GPU", &bytes(report));
    section(&mut out, "errors", "Errors", &errors(report));
    section(&mut out, "advice", "What to change", &changes(report));
    section(&mut out, "meshes", "The largest meshes", &meshes(report));
    section(&mut out, "times", "Stages and times", &times(report));
    section(&mut out, "settings", "Scene and settings", &settings(report));
    section(&mut out, "warnings", "Warnings", &warnings(report));
    let _ = write!(out, "<footer>{}</footer>\n</main>\n</body>\n</html>\n", escape(&report.generator));
    out
}

fn section(out: &mut String, id: &str, title: &str, body: &str) {
    if !body.is_empty() {
        let _ = write!(out, "<section id=\"{id}\">\n<h2>{title}</h2>\n{body}</section>\n");
    }
}

fn percent(share: f64) -> String {
    match share * 100.0 {
        p if p == 0.0 || p >= 10.0 => format!("{p:.0} %"),
        p if p >= 1.0 => format!("{p:.1} %"),
        p => format!("{p:.2} %"),
    }
}

/// How much smaller or larger than something else.
fn against(total: u64, other: u64, what: &str) -> Option<[String; 2]> {
    if total == 0 || other == 0 {
        return None;
    }
    let ratio = total as f64 / other as f64;
    let text =
        if ratio < 1.0 { format!("{:.1} × smaller", 1.0 / ratio) } else { format!("{ratio:.1} × larger") };
    Some([text, format!("than {what} ({})", bytes_text(other))])
}

fn head(out: &mut String, report: &Report) {
    let (bound, hybrid) = (&report.errors.bound, &report.errors.hybrid);
    let (class, verdict) = if bound.kept() { ("kept", "bound kept") } else { ("broken", "bound broken") };
    let _ = write!(
        out,
        "<header>\n<h1>{}</h1>\n<p>{} → <b>{}</b>, {}, {} quality <span class=\"chip {class}\">{verdict}</span></p>\n",
        escape(&report.input),
        escape(&report.input),
        escape(&report.output),
        escape(&report.settings.signal),
        escape(&report.settings.quality)
    );
    let full = report.bytes.full_lightmap.bytes.total();
    let mut tiles = vec![[bytes_text(report.bytes.total), "of light on the GPU".to_owned()]];
    tiles.extend(against(report.bytes.total, full, "one lightmap over everything, computed"));
    tiles.extend(against(report.bytes.total, report.bytes.vertices_only, "light at vertices alone"));
    tiles.push([
        format!("{:.4}", hybrid.rmse),
        format!("RMSE at {} fresh points (noise {:.4})", count(hybrid.points as u64), hybrid.noise),
    ]);
    tiles.push([
        percent(bound.color_share_beyond()),
        format!(
            "of the fresh points in color triangles beyond the bound of {} and its noise; 1 % is tolerated",
            percent(f64::from(bound.limit))
        ),
    ]);
    out.push_str("<ul class=\"tiles\">");
    for [figure, what] in tiles {
        let _ = write!(out, "<li><b>{}</b><span>{}</span></li>", escape(&figure), escape(&what));
    }
    out.push_str("</ul>\n</header>\n");
}

fn pictures(out: &mut String, figures: &[Figure]) {
    if figures.is_empty() {
        return;
    }
    out.push_str("<section id=\"pictures\" class=\"pictures\">\n");
    for figure in figures {
        let data = base64::engine::general_purpose::STANDARD.encode(&figure.png);
        let (title, caption) = (escape(&figure.title), escape(&figure.caption));
        let _ = writeln!(
            out,
            "<figure><img alt=\"{title}\" src=\"data:image/png;base64,{data}\"><figcaption><b>{title}.</b> {caption}</figcaption></figure>"
        );
    }
    out.push_str("</section>\n");
}

fn classes(report: &Report) -> String {
    let classes = &report.classes;
    let piece = |label: &str, class: &lightkiln_report::Class, color| Piece {
        label: label.to_owned(),
        text: format!(
            "{} of the area, {} triangles",
            percent(class.area_share),
            count(class.triangles as u64)
        ),
        value: class.area_share,
        class: color,
    };
    let bar = shares(
        "Shares of the surface by class",
        &[
            piece("texture", &classes.texture, "texture"),
            piece("mixed", &classes.mixed, "mixed"),
            piece("color", &classes.color, "color"),
        ],
    );
    let atlas = &report.atlas;
    let mut notes = format!(
        "<p>Vertex values alone err by more than {:.4} at triangles with {} of the area; closing and checking made {} of it. ",
        classes.decision_bound,
        percent(classes.texture_before_closing.area_share),
        percent(classes.texture.area_share)
    );
    if atlas.charts > 0 {
        let _ = write!(
            notes,
            "They lie in {} charts on {} × {} texels of {} bits, {} page{}; {} of the texels show light. The largest step \
             across a seam went from {:.4} to {:.4}.",
            count(atlas.charts as u64),
            atlas.width,
            atlas.height,
            atlas.bits,
            atlas.pages,
            if atlas.pages == 1 { "" } else { "s" },
            percent(atlas.shown_texels as f64 / atlas.texels.max(1) as f64),
            atlas.seam_before,
            atlas.seam_after
        );
    }
    bar + &notes + "</p>\n"
}

fn kinds(bytes: &LightBytes) -> Vec<Piece> {
    [
        ("vertex attribute", bytes.attribute, "attribute"),
        ("split vertices", bytes.added_vertices, "splits"),
        ("atlas", bytes.atlas, "atlas"),
        ("mip levels", bytes.mips, "mips"),
        ("tables", bytes.tables, "tables"),
    ]
    .into_iter()
    .map(|(label, bytes, class)| Piece {
        label: label.to_owned(),
        text: bytes_text(bytes),
        value: bytes as f64,
        class,
    })
    .collect()
}

fn bytes(report: &Report) -> String {
    let bytes = &report.bytes;
    let only = LightBytes { attribute: bytes.vertices_only, ..LightBytes::default() };
    let bar = |label: &str, light: &LightBytes| Bar {
        label: label.to_owned(),
        total: bytes_text(light.total()),
        pieces: kinds(light),
    };
    let full = &bytes.full_lightmap;
    let chart = bars(
        "Bytes of light by kind",
        &[bar("this file", &bytes.light), bar("vertices only", &only), bar("one full lightmap", &full.bytes)],
    );
    let mut all = kinds(&bytes.light);
    all.retain(|piece| piece.class != "tables" || piece.value > 0.0);
    let notes = format!(
        "<p>The full lightmap is computed from areas, with {} fill of {} and {:.2} vertices for one. Beside the total: the \
         COLOR_0 fallback of {}, and {} of texels that no lookup touches are part of the atlas. The scene's geometry takes \
         {}, the files written {}.{}</p>\n",
        if full.measured { "the measured" } else { "an assumed" },
        percent(full.fill),
        full.vertex_ratio,
        bytes_text(bytes.fallback),
        bytes_text(bytes.atlas_waste),
        bytes_text(bytes.geometry),
        bytes_text(bytes.files),
        match bytes.instances_unshared {
            0 => String::new(),
            n => format!(
                " {} instances were written apart, because each shows light of its own.",
                count(n as u64)
            ),
        }
    );
    chart + &legend(&all) + &notes
}

fn errors(report: &Report) -> String {
    let errors = &report.errors;
    let mut out = error_chart(report);
    let row = |name: &str, e: &ErrorSummary| {
        let mut row = vec![escape(name), count(e.points as u64)];
        row.extend([e.rmse, e.median, e.p99, e.p999, e.max].map(|v| format!("{v:.4}")));
        row
    };
    let mut rows = Vec::new();
    let named = [
        ("light sampled at vertices", errors.point_sampling.as_ref()),
        ("least squares at vertices", errors.least_squares.as_ref()),
        ("this file", Some(&errors.hybrid)),
        ("this file, color triangles", Some(&errors.color)),
        ("this file, texture triangles", Some(&errors.texture)),
    ];
    rows.extend(named.into_iter().filter_map(|(name, e)| e.filter(|e| e.points > 0).map(|e| row(name, e))));
    let head = ["", "points", "RMSE", "median", "99 %", "99.9 %", "max"];
    out += &table("Absolute errors at fresh points, as shares of the range", &head, &rows);
    if errors.layers.len() > 1 {
        let rows: Vec<_> = errors.layers.iter().map(|l| row(&l.signal, &l.hybrid)).collect();
        out += &table("What the file shows, layer by layer", &head, &rows);
    }
    let bound = &errors.bound;
    let _ = writeln!(
        out,
        "<p>Every point was compared with {} rays of its own; their noise of {:.4} is part of all errors. Beyond {} and {} \
         standard errors of noise lie {} of {} samples and {} of {} fresh points in color triangles, and {} of {} in \
         texture triangles. {} points inside other geometry were left out.</p>",
        count(u64::from(errors.rays_per_point)),
        errors.hybrid.noise,
        percent(f64::from(bound.limit)),
        bound.confidence,
        count(bound.samples_beyond as u64),
        count(bound.samples_checked as u64),
        count(bound.color_points_beyond as u64),
        count(bound.color_points as u64),
        count(bound.texture_points_beyond as u64),
        count(bound.texture_points as u64),
        count(errors.hidden_points as u64)
    );
    if !errors.coarse.is_empty() {
        let rows: Vec<_> =
            errors.coarse.iter().map(|c| vec![escape(&c.name), count(c.points as u64)]).collect();
        out += &table("Where texels are too coarse", &["node", "points beyond the bound"], &rows);
    }
    out
}

/// The histogram of what the file shows, over that of vertices alone.
fn error_chart(report: &Report) -> String {
    let errors = &report.errors;
    let of = |e: &ErrorSummary| e.histogram.map(|h| h.map(|n| f64::from(n) / e.points.max(1) as f64));
    let Some(hybrid) = of(&errors.hybrid) else { return String::new() };
    let vertices = errors.least_squares.as_ref().and_then(of);
    let edges: Vec<String> = (1..BINS).map(|bin| short(bin_range(bin)[0])).collect();
    let limit = errors.bound.limit;
    // Bins are equal steps of the logarithm.
    let place = 1.0 + 2.0 * f64::from(limit / bin_range(1)[0]).log2();
    let chart = histogram(
        "Share of the fresh points by the size of their error",
        &hybrid,
        vertices.as_ref().map(|v| v.as_slice()),
        &edges,
        Some((place, &format!("bound {limit}"))),
    );
    let piece =
        |label: &str, class| Piece { label: label.to_owned(), text: String::new(), value: 0.0, class };
    let mut pieces = vec![piece("this file", "hybrid")];
    if vertices.is_some() {
        pieces.push(piece("vertices alone, least squares", "lines"));
    }
    chart + &legend(&pieces)
}

/// A number of two digits.
fn short(value: f32) -> String {
    if value >= 0.1 {
        format!("{value:.2}")
    } else if value >= 0.01 {
        format!("{value:.3}")
    } else {
        format!("{value:.4}")
    }
}

fn changes(report: &Report) -> String {
    let all = advice(report);
    if all.is_empty() {
        return "<p>Nothing that these figures know of would save 3 % of the light.</p>\n".to_owned();
    }
    let mut out = "<ol class=\"advice\">".to_owned();
    for advice in all {
        let saves = advice.saves.map_or(String::new(), |bytes| {
            format!(" <span class=\"chip\">saves about {}</span>", bytes_text(bytes))
        });
        let _ = write!(out, "<li><b>{}</b>{saves}<br>{}</li>", escape(&advice.what), escape(&advice.why));
    }
    out + "</ol>\n<p>Each stands for itself; savings do not add up.</p>\n"
}

fn meshes(report: &Report) -> String {
    let largest = &report.bytes.largest;
    if largest.is_empty() {
        return String::new();
    }
    let total = report.bytes.total.max(1) as f64;
    let row = |c: &lightkiln_report::Contributor| {
        let share = c.bytes as f64 / total;
        let meter = format!(
            "<span class=\"meter\"><i style=\"width:{:.1}%\"></i></span> {}",
            100.0 * share.min(1.0),
            percent(share)
        );
        vec![escape(&c.name), bytes_text(c.bytes), bytes_text(c.texel_bytes), meter]
    };
    let rows: Vec<_> = largest.iter().map(row).collect();
    table("Light by mesh, largest first", &["node", "bytes", "of them texels", "share of all light"], &rows)
}

fn times(report: &Report) -> String {
    let total: f64 = report.stages.iter().map(|s| s.seconds).sum();
    let pieces = |seconds: f64, name: &str| {
        vec![Piece { label: name.to_owned(), text: format!("{seconds:.2} s"), value: seconds, class: "time" }]
    };
    let stages: Vec<Bar> = report
        .stages
        .iter()
        .map(|s| Bar {
            label: s.name.clone(),
            total: format!("{:.2} s", s.seconds),
            pieces: pieces(s.seconds, &s.name),
        })
        .collect();
    let rays = &report.rays;
    let million = |n: u64| format!("{:.1} M", n as f64 / 1e6);
    let mut out = bars("Seconds by stage", &stages);
    let _ = writeln!(
        out,
        "<p>{total:.2} s in all{}. {} Poisson samples and {} more where vertices needed them, {} inside other geometry; {} rays \
         for samples, {} for {} texels, {} for references. A sample's standard error is {:.4} in the median and at most \
         {:.4} at 99 %.</p>",
        report
            .peak_memory_bytes
            .map_or(String::new(), |peak| format!(", {} of memory at the peak", bytes_text(peak))),
        count(rays.poisson_samples as u64),
        count(rays.support_samples as u64),
        count(rays.invalid_samples as u64),
        million(rays.sample_rays),
        million(rays.texel_rays),
        count(rays.shaded_texels as u64),
        million(rays.verify_rays),
        rays.sample_noise_median,
        rays.sample_noise_p99
    );
    out
}

fn settings(report: &Report) -> String {
    let (settings, scene) = (&report.settings, &report.scene);
    let pair = |name: &str, value: String| vec![escape(name), escape(&value)];
    let count = |n: usize| count(n as u64);
    let rows = [
        pair("signal", settings.signal.clone()),
        pair("quality", settings.quality.clone()),
        pair("denoiser", settings.denoiser.clone()),
        pair("error bound", percent(f64::from(settings.max_error))),
        pair("detail", format!("{:.5}", settings.detail)),
        pair("width of a texel", format!("{:.5}", settings.radius)),
        pair("reach of rays", settings.ao_distance.map_or("unbounded".to_owned(), |d| format!("{d:.4}"))),
        pair("seed", settings.seed.to_string()),
        pair("size of the scene", format!("{:.3}", scene.diagonal)),
        pair(
            "triangles",
            format!("{} ({} without area)", count(scene.triangles), count(scene.degenerate_triangles)),
        ),
        pair("glTF vertices", count(scene.gltf_vertices)),
        pair("light vertices", count(scene.light_vertices)),
        pair("nodes and instances", count(scene.instances)),
        pair("connected pieces", count(scene.sheets)),
        pair("surface area", format!("{:.3}", scene.area)),
    ];
    table("Lengths are in units of the file", &["", ""], &rows)
}

fn warnings(report: &Report) -> String {
    if report.warnings.is_empty() {
        return String::new();
    }
    let items: String = report.warnings.iter().map(|w| format!("<li>{}</li>", escape(w))).collect();
    format!("<ul>{items}</ul>\n")
}
