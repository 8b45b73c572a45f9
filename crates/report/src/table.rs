//! The report as a table of text, at most 100 columns wide. No colors: the program adds them.

use std::fmt::Write;

use crate::{BoundCheck, Class, ErrorSummary, Errors, Report, bytes_text};

/// Renders a report for a terminal.
pub fn render(report: &Report) -> String {
    let mut out = String::new();
    settings(&mut out, report);
    classes(&mut out, report);
    rays(&mut out, report);
    errors(&mut out, &report.errors);
    bytes(&mut out, report);
    stages(&mut out, report);
    for warning in &report.warnings {
        line(&mut out, "warning", warning);
    }
    out
}

fn line(out: &mut String, label: &str, text: &str) {
    let _ = writeln!(out, "{label:<12} {text}");
}

/// 1234567 as `1,234,567`.
pub fn count(n: u64) -> String {
    let digits = n.to_string();
    let mut out = String::with_capacity(digits.len() + digits.len() / 3);
    for (i, digit) in digits.chars().enumerate() {
        if i > 0 && (digits.len() - i).is_multiple_of(3) {
            out.push(',');
        }
        out.push(digit);
    }
    out
}

fn settings(out: &mut String, report: &Report) {
    let (settings, scene) = (&report.settings, &report.scene);
    line(out, "scene", &format!("{} -> {}", report.input, report.output));
    line(
        out,
        "",
        &format!(
            "{} triangles, {} glTF vertices welded to {} light vertices, {} instances",
            count(scene.triangles as u64),
            count(scene.gltf_vertices as u64),
            count(scene.light_vertices as u64),
            count(scene.instances as u64),
        ),
    );
    let distance = settings.ao_distance.map_or("unbounded".to_owned(), |d| format!("{d:.4}"));
    line(
        out,
        "light",
        &format!(
            "{}, profile {}, {} quality, bound {:.1} %, detail {:.5} (size {:.3}), distance {distance}, seed {}",
            settings.signal,
            settings.profile,
            settings.quality,
            settings.max_error * 100.0,
            settings.detail,
            scene.diagonal,
            settings.seed
        ),
    );
}

fn classes(out: &mut String, report: &Report) {
    let classes = &report.classes;
    let row = |class: &Class| {
        format!(
            "{:>11} triangles {:>7.2} % of the area",
            count(class.triangles as u64),
            class.area_share * 100.0
        )
    };
    line(
        out,
        "texture",
        &format!(
            "{} ({:.2} % err by more than {:.4})",
            row(&classes.texture),
            classes.texture_before_closing.area_share * 100.0,
            classes.decision_bound
        ),
    );
    line(out, "mixed", &row(&classes.mixed));
    line(out, "color", &row(&classes.color));
    let atlas = &report.atlas;
    if atlas.charts > 0 {
        line(
            out,
            "atlas",
            &format!(
                "{} charts, {} x {} texels of {} bits on {} page(s), {:.0} % shown, seams {:.4} -> {:.4}",
                count(atlas.charts as u64),
                atlas.width,
                atlas.height,
                atlas.bits,
                atlas.pages,
                100.0 * atlas.shown_texels as f64 / (atlas.texels.max(1)) as f64,
                atlas.seam_before,
                atlas.seam_after,
            ),
        );
    }
}

fn rays(out: &mut String, report: &Report) {
    let rays = &report.rays;
    line(
        out,
        "samples",
        &format!(
            "{} Poisson + {} where vertices need more, {} inside geometry; noise {:.4} median, {:.4} at 99 %",
            count(rays.poisson_samples as u64),
            count(rays.support_samples as u64),
            count(rays.invalid_samples as u64),
            rays.sample_noise_median,
            rays.sample_noise_p99,
        ),
    );
    if rays.sample_rays == 0 {
        return;
    }
    line(
        out,
        "rays",
        &format!(
            "{} M for samples, {} M for {} texels, {} M to verify",
            rays.sample_rays / 1_000_000,
            rays.texel_rays / 1_000_000,
            count(rays.shaded_texels as u64),
            rays.verify_rays / 1_000_000,
        ),
    );
}

/// Renders errors alone, as `verify` prints them.
pub fn errors_table(all: &Errors) -> String {
    let mut out = String::new();
    errors(&mut out, all);
    out
}

fn errors(out: &mut String, errors: &Errors) {
    line(
        out,
        "errors",
        &match errors.rays_per_point {
            0 => format!("at {} fresh points against the image:", count(errors.hybrid.points as u64)),
            rays => format!(
                "at {} fresh points against {rays} rays each (noise {:.4}):",
                count(errors.hybrid.points as u64),
                errors.hybrid.noise
            ),
        },
    );
    let _ = writeln!(out, "{:<27}{:>9}{:>9}{:>9}{:>9}{:>9}", "", "RMSE", "median", "99 %", "99.9 %", "max");
    error_row(out, "point sampling at vertices", errors.point_sampling.as_ref());
    error_row(out, "least squares at vertices", errors.least_squares.as_ref());
    error_row(out, "hybrid, as the file shows", Some(&errors.hybrid));
    error_row(out, "  in color triangles", Some(&errors.color));
    error_row(out, "  in texture triangles", Some(&errors.texture));
    if errors.layers.len() > 1 {
        for layer in &errors.layers {
            error_row(out, &format!("  {}", layer.signal), Some(&layer.hybrid));
        }
    }
    line(out, "bound", &bound_text(&errors.bound));
    if !errors.coarse.is_empty() {
        let nodes: Vec<String> =
            errors.coarse.iter().take(3).map(|c| format!("{} ({})", c.name, c.points)).collect();
        line(out, "", &format!("most of these are in {}", nodes.join(", ")));
    }
}

/// One row of the error table.
fn error_row(out: &mut String, name: &str, errors: Option<&ErrorSummary>) {
    let Some(e) = errors.filter(|e| e.points > 0) else { return };
    let _ = writeln!(
        out,
        "{name:<27}{:>9.4}{:>9.4}{:>9.4}{:>9.4}{:>9.4}",
        e.rmse, e.median, e.p99, e.p999, e.max
    );
}

fn bound_text(bound: &BoundCheck) -> String {
    let verdict = if bound.kept() { "kept" } else { "BROKEN" };
    let mut text = format!(
        "{verdict}: {:.1} % (+ {} sigma of noise) is exceeded at {} of {} samples and {} of {} fresh points in color triangles",
        bound.limit * 100.0,
        bound.confidence,
        count(bound.samples_beyond as u64),
        count(bound.samples_checked as u64),
        count(bound.color_points_beyond as u64),
        count(bound.color_points as u64),
    );
    if bound.texture_points_beyond > 0 {
        let _ = write!(
            text,
            "\n{:<12} texels are too coarse for the signal at {} of {} fresh points in texture triangles; a smaller --detail helps",
            "",
            count(bound.texture_points_beyond as u64),
            count(bound.texture_points as u64)
        );
    }
    text
}

fn bytes(out: &mut String, report: &Report) {
    let bytes = &report.bytes;
    let light = &bytes.light;
    line(
        out,
        "bytes",
        &format!(
            "{} on the GPU: attribute {}, {} added vertices {}, atlas {} + mips {} (of it unused {})",
            bytes_text(bytes.total),
            bytes_text(light.attribute),
            count(bytes.added_vertices),
            bytes_text(light.added_vertices),
            bytes_text(light.atlas),
            bytes_text(light.mips),
            bytes_text(bytes.atlas_waste),
        ),
    );
    if bytes.instances_unshared > 0 {
        let lost = count(bytes.instances_unshared as u64);
        line(out, "", &format!("{lost} instances were written apart, because each shows light of its own"));
    }
    let full = &bytes.full_lightmap;
    let versus = |other: u64| {
        if other == 0 { String::new() } else { format!(" ({:.2} x)", bytes.total as f64 / other as f64) }
    };
    line(
        out,
        "",
        &format!(
            "one full lightmap at this density: {}{}, computed from areas and {} fill of {:.0} %",
            bytes_text(full.bytes.total()),
            versus(full.bytes.total()),
            if full.measured { "the measured" } else { "an assumed" },
            full.fill * 100.0
        ),
    );
    line(
        out,
        "",
        &format!(
            "vertices only: {}{}; COLOR_0 fallback {}; files {}",
            bytes_text(bytes.vertices_only),
            versus(bytes.vertices_only),
            bytes_text(bytes.fallback),
            bytes_text(bytes.files)
        ),
    );
}

fn stages(out: &mut String, report: &Report) {
    let total: f64 = report.stages.iter().map(|s| s.seconds).sum();
    let list: Vec<String> = report.stages.iter().map(|s| format!("{} {:.2}", s.name, s.seconds)).collect();
    line(out, "seconds", &format!("{total:.2}: {}", list.join(", ")));
    if let Some(peak) = report.peak_memory_bytes {
        line(out, "memory", &format!("{} at its peak", bytes_text(peak)));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn count_groups_by_thousands() {
        assert_eq!(count(7), "7");
        assert_eq!(count(1234), "1,234");
        assert_eq!(count(13_578_000), "13,578,000");
    }
}
