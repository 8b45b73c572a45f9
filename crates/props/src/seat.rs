//! An upholstered car seat: quilted cushions with grooves, bolsters, piping, buttons, headrest, trim and rails.
//!
//! Drawn with x to the front, y to the left and z up; the origin is on the floor under the cushion.

use glam::{DVec3, Quat};

use crate::model::{Assembly, Material, MaterialId, Place, Surface};
use crate::shapes::{Detail, bent, lathe, panel, rounded_box, tube, with_triangles};

/// What a part of the seat is made of.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stuff {
    /// Quilted middle parts.
    Leather,
    /// Bolsters and headrest.
    Side,
    /// Piping and buttons.
    Trim,
    /// Covers and levers.
    Plastic,
    /// Rails, posts and frame.
    Steel,
}

/// One part, in the frame of the seat, or in that of its leaning back.
pub struct Part {
    /// Its name.
    pub name: String,
    /// Its shape, y up.
    pub surface: Surface,
    /// What it is made of.
    pub stuff: Stuff,
    /// Whether it belongs to the backrest, whose frame has its origin at the hinge.
    pub in_back: bool,
}

/// The materials of a seat, in the order of [`Stuff`].
pub type Materials = [MaterialId; 5];

/// The hinge of the backrest, y up, and how far it leans.
pub fn hinge() -> Place {
    Place { rotation: Quat::from_rotation_x(-0.36), ..Place::at(0.0, 0.40, -0.21) }
}

/// A seat of about `triangles` triangles.
pub fn seat(triangles: usize) -> Assembly {
    with_triangles(triangles, |detail| {
        let mut scene = Assembly::default();
        let materials = materials(&mut scene);
        let root = scene.node("seat", None, None, Place::default());
        let back = scene.node("backrest", None, Some(root), hinge());
        for part in parts(detail) {
            let parent = if part.in_back { back } else { root };
            scene.part(part.name, part.surface, materials[part.stuff as usize], Some(parent));
        }
        scene
    })
}

/// Adds the materials of a seat.
pub fn materials(scene: &mut Assembly) -> Materials {
    [
        Material::new("seat_leather", [0.32, 0.17, 0.09], 0.0, 0.55),
        Material::new("seat_side", [0.045, 0.045, 0.05], 0.0, 0.6),
        Material::new("seat_trim", [0.6, 0.55, 0.45], 0.0, 0.6),
        Material::new("seat_plastic", [0.03, 0.03, 0.03], 0.0, 0.5),
        Material::new("seat_steel", [0.45, 0.45, 0.47], 1.0, 0.4),
    ]
    .map(|m| scene.material(m))
}

fn smooth(low: f64, high: f64, x: f64) -> f64 {
    let t = ((x - low) / (high - low)).clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

/// Height of a quilted surface over its plane: diamonds of width `cell` puffed up between stitched grooves.
fn quilt(a: f64, b: f64, cell: f64) -> f64 {
    let line = |s: f64| {
        let s = s / cell;
        ((s - s.round()).abs() * cell, (std::f64::consts::PI * s).sin().powi(2))
    };
    let ((d0, p0), (d1, p1)) = (line(a + b), line(a - b));
    let groove = |d: f64| 0.004 * (-(d / 0.006).powi(2)).exp();
    0.007 * (p0 * p1).cbrt() - groove(d0).max(groove(d1))
}

/// Height of channels stitched across.
fn channels(a: f64, width: f64) -> f64 {
    0.012 * (std::f64::consts::PI * a / width).sin().abs().sqrt()
}

/// Where the middle part of the backrest is bent: forward at the loins, back at the shoulders.
fn back_curve(z: f64) -> f64 {
    0.035 * (-((z - 0.17) / 0.16).powi(2)).exp() - 0.10 * (z - 0.1).max(0.0).powi(2)
}

/// All parts of a seat.
pub fn parts(detail: &Detail) -> Vec<Part> {
    let mut list = Vec::new();
    base(detail, &mut |name, surface, stuff| list.push((name, surface, stuff, false)));
    back(detail, &mut |name, surface, stuff| list.push((name, surface, stuff, true)));
    list.into_iter()
        .map(|(name, surface, stuff, in_back): (String, Surface, Stuff, bool)| Part {
            name,
            surface: surface.upright(),
            stuff,
            in_back,
        })
        .collect()
}

type Add<'a> = &'a mut dyn FnMut(String, Surface, Stuff);

fn base(detail: &Detail, add: Add<'_>) {
    let v = DVec3::new;
    let offset = v(0.03, 0.0, 0.36);
    // Rises to the front by as much as thighs ask for.
    let rise = |x: f64| 0.12 * x + 0.10 * x * x;
    let half = v(0.225, 0.158, 0.07);
    let middle = bent(rounded_box(detail, half, 0.035, 4), |p, n| {
        let border = smooth(0.0, 0.03, half.x - p.x.abs()) * smooth(0.0, 0.03, half.y - p.y.abs());
        let up = smooth(0.6, 0.95, n.z) * border;
        let sag = -0.018 * (-(p.x * p.x + p.y * p.y) / 0.02).exp() + 0.012;
        p + n * up * quilt(p.x, p.y, 0.085) + DVec3::Z * (rise(p.x) + up * sag) + offset
    });
    add("cushion_middle".into(), middle, Stuff::Leather);
    let front = bent(rounded_box(detail, v(0.055, 0.158, 0.06), 0.045, 5), |p, n| {
        let up = smooth(0.2, 0.9, n.z.max(n.x)) * smooth(0.0, 0.02, 0.158 - p.y.abs());
        let x = p.x + 0.29;
        v(x, p.y, p.z + rise(x) - 0.015) + n * up * 0.008 + offset
    });
    add("cushion_front".into(), front, Stuff::Leather);
    for (name, side) in [("left", 1.0), ("right", -1.0)] {
        let bolster = bent(rounded_box(detail, v(0.29, 0.056, 0.085), 0.05, 6), |p, n| {
            let bulge = 0.03 * smooth(-0.3, 0.3, p.z / 0.085) * (1.0 - (p.x / 0.29).powi(4));
            let seam = 0.004 * (-((p.x - 0.12) / 0.004).powi(2)).exp();
            let lean = -0.25 * (p.z + 0.02) * side;
            let x = p.x + 0.06;
            v(x, p.y - lean, p.z + bulge + rise(x) + 0.02) - n * seam + v(0.0, side * 0.222, 0.0) + offset
        });
        add(format!("cushion_bolster_{name}"), bolster, Stuff::Side);
        let piping = |t: f64| {
            let x = -0.19 + 0.52 * t;
            v(x, side * 0.166, rise(x) + 0.071 - 0.02 * (2.0 * t - 1.0).powi(6)) + offset
        };
        add(format!("cushion_piping_{name}"), tube(detail, [24, 8], 0.0055, false, &piping), Stuff::Trim);
        let cover = bent(rounded_box(detail, v(0.27, 0.012, 0.06), 0.012, 3), |p, _| {
            let taper = 1.0 - 0.35 * smooth(0.0, 0.27, p.x);
            v(p.x, p.y, p.z * taper) + v(0.02, side * 0.27, 0.27)
        });
        add(format!("side_cover_{name}"), cover, Stuff::Plastic);
        rails(detail, name, side, add);
    }
    for (i, x) in [-0.17, 0.2].into_iter().enumerate() {
        let bar = tube(detail, [6, 10], 0.014, false, &|t| v(x, 0.46 * (t - 0.5), 0.2));
        add(format!("cross_tube_{i}"), bar, Stuff::Steel);
    }
    let pan = panel(detail, [6, 6], 0.004, &|s, t| {
        let (x, y) = (0.5 * s - 0.22, 0.44 * t - 0.22);
        v(x, y, 0.285 + rise(x) - 0.02 * (1.0 - (y / 0.22).powi(2)))
    });
    add("seat_pan".into(), pan, Stuff::Steel);
    let lever = bent(rounded_box(detail, v(0.07, 0.009, 0.013), 0.008, 3), |p, _| {
        p + v(0.1, 0.292 + 0.3 * p.x * p.x, 0.29 + 0.4 * p.x * p.x)
    });
    add("recline_lever".into(), lever, Stuff::Plastic);
    let knob: [&[(f64, f64)]; 3] = [
        &[(0.0, -0.012), (0.03, -0.012)],
        &[(0.03, -0.012), (0.026, 0.012)],
        &[(0.026, 0.012), (0.0, 0.014)],
    ];
    let knob = lathe(detail, 20, &knob).turned(Quat::from_rotation_x(-std::f32::consts::FRAC_PI_2));
    add("recline_knob".into(), knob.moved(v(-0.2, 0.295, 0.36)), Stuff::Plastic);
    let buckle = rounded_box(detail, v(0.018, 0.011, 0.045), 0.008, 3).moved(v(-0.16, -0.30, 0.42));
    add("belt_buckle".into(), buckle, Stuff::Plastic);
    let stalk = tube(detail, [6, 8], 0.007, false, &|t| v(-0.16, -0.30, 0.25 + 0.13 * t));
    add("belt_stalk".into(), stalk, Stuff::Steel);
}

fn rails(detail: &Detail, name: &str, side: f64, add: Add<'_>) {
    let v = DVec3::new;
    let y = side * 0.21;
    for (part, half, z) in [("lower", v(0.30, 0.024, 0.014), 0.055), ("upper", v(0.24, 0.016, 0.016), 0.085)]
    {
        let rail = rounded_box(detail, half, 0.006, 2).moved(v(0.0, y, z));
        add(format!("rail_{part}_{name}"), rail, Stuff::Steel);
    }
    for (i, x) in [-0.27, 0.27].into_iter().enumerate() {
        let foot = rounded_box(detail, v(0.03, 0.028, 0.02), 0.008, 2).moved(v(x, y, 0.0205));
        add(format!("rail_foot_{name}_{i}"), foot, Stuff::Steel);
        let bolt: [&[(f64, f64)]; 3] =
            [&[(0.0, 0.0), (0.010, 0.0)], &[(0.010, 0.0), (0.010, 0.008)], &[(0.010, 0.008), (0.0, 0.009)]];
        add(
            format!("rail_bolt_{name}_{i}"),
            lathe(detail, 6, &bolt).moved(v(x * 1.07, y, 0.042)),
            Stuff::Steel,
        );
    }
    for (i, x) in [-0.17, 0.2].into_iter().enumerate() {
        let post = rounded_box(detail, v(0.025, 0.006, 0.075), 0.005, 2).moved(v(x, y, 0.175));
        add(format!("riser_{name}_{i}"), post, Stuff::Steel);
    }
}

fn back(detail: &Detail, add: Add<'_>) {
    let v = DVec3::new;
    let half = v(0.05, 0.155, 0.25);
    let centre = 0.27;
    let middle = bent(rounded_box(detail, half, 0.03, 4), |p, n| {
        let border = smooth(0.0, 0.03, half.z - p.z.abs()) * smooth(0.0, 0.03, half.y - p.y.abs());
        let out = smooth(0.6, 0.95, n.x) * border;
        let z = p.z + centre;
        v(p.x + back_curve(z) + out * channels(p.z + half.z, 0.0625), p.y, z)
    });
    add("back_middle".into(), middle, Stuff::Leather);
    let shoulder = bent(rounded_box(detail, v(0.05, 0.215, 0.075), 0.045, 5), |p, n| {
        let z = p.z + centre + half.z + 0.082;
        let out = smooth(0.5, 0.95, n.x) * smooth(0.0, 0.05, 0.215 - p.y.abs());
        let narrow = 1.0 - 0.22 * smooth(-0.075, 0.075, p.z);
        v(p.x + back_curve(z) + out * 0.6 * quilt(p.z, p.y, 0.085), p.y * narrow, z)
    });
    add("back_shoulder".into(), shoulder, Stuff::Leather);
    for (name, side) in [("left", 1.0), ("right", -1.0)] {
        let bolster = bent(rounded_box(detail, v(0.085, 0.054, 0.27), 0.05, 6), |p, n| {
            let z = p.z + centre + 0.01;
            let high = smooth(-0.1, 0.27, p.z);
            let forward =
                smooth(-0.02, 0.085, p.x) * 0.05 * (1.0 - 0.7 * high) * (1.0 - (p.z / 0.27).powi(4));
            let seam = 0.004 * (-((p.z - 0.1) / 0.004).powi(2)).exp();
            v(p.x * (1.0 - 0.35 * high) + forward + back_curve(z) + 0.012, p.y - 0.2 * side * forward, z)
                - n * seam
                + v(0.0, side * 0.216, 0.0)
        });
        add(format!("back_bolster_{name}"), bolster, Stuff::Side);
        let piping = |t: f64| {
            let z = 0.04 + 0.46 * t;
            v(back_curve(z) + 0.052, side * 0.162, z)
        };
        add(format!("back_piping_{name}"), tube(detail, [24, 8], 0.0055, false, &piping), Stuff::Trim);
        let post = tube(detail, [8, 10], 0.0065, false, &|t| {
            let z = 0.62 + 0.16 * t;
            v(back_curve(0.62) + 0.02 * t, side * 0.07, z)
        });
        add(format!("headrest_post_{name}"), post, Stuff::Steel);
        let sleeve: [&[(f64, f64)]; 3] =
            [&[(0.0, 0.0), (0.016, 0.0)], &[(0.016, 0.0), (0.013, 0.014)], &[(0.013, 0.014), (0.0, 0.014)]];
        let at = v(back_curve(0.62), side * 0.07, 0.672);
        add(format!("headrest_sleeve_{name}"), lathe(detail, 14, &sleeve).moved(at), Stuff::Plastic);
    }
    let headrest = bent(rounded_box(detail, v(0.045, 0.13, 0.085), 0.042, 6), |p, n| {
        let border = smooth(0.0, 0.03, 0.085 - p.z.abs()) * smooth(0.0, 0.03, 0.13 - p.y.abs());
        let dent = -0.014 * (-(p.y * p.y + p.z * p.z) / 0.004).exp() * smooth(0.5, 0.95, n.x);
        let seam = 0.004 * (-((p.y.abs() - 0.085) / 0.004).powi(2)).exp() * smooth(0.3, 0.8, n.x) * border;
        v(p.x + dent + 0.9 * p.y * p.y, p.y, p.z) - n * seam + v(back_curve(0.62) + 0.02, 0.0, 0.82)
    });
    add("headrest".into(), headrest, Stuff::Side);
    let shell = panel(detail, [8, 12], 0.004, &|s, t| {
        // Seen from behind, the left of the seat is to the left.
        let (y, z) = (0.5 - s, 0.02 + 0.60 * t);
        let width = 0.5 - 0.1 * smooth(0.3, 0.6, z);
        v(back_curve(z) - 0.095 + 0.32 * y * y, y * width, z)
    });
    add("back_shell".into(), shell, Stuff::Plastic);
    // Buttons sit where the shoulder's grooves cross.
    for i in 0..5 {
        let y = (f64::from(i) - 2.0) * 0.085;
        let z = centre + half.z + 0.082;
        let button: &[(f64, f64)] = &[(0.0, -0.004), (0.008, -0.001), (0.006, 0.003), (0.0, 0.005)];
        let button = lathe(detail, 12, &[button]).turned(Quat::from_rotation_y(std::f32::consts::FRAC_PI_2));
        add(format!("button_{i}"), button.moved(v(back_curve(z) + 0.049, y * 0.89, z)), Stuff::Trim);
    }
}
