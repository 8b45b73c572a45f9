//! The shell: panels, glass, lamps and trim.

use std::f64::consts::{PI, TAU};

use glam::{DVec3, Quat};

use super::{Builder, axle};
use crate::shapes::{bent, curve, lathe, panel, patch, rounded_box, table, tube};

pub(super) const FRONT_AXLE: f64 = 1.40;
pub(super) const REAR_AXLE: f64 = -1.30;
pub(super) const WHEEL_RADIUS: f64 = 0.33;
const ARCH: f64 = 0.385;
/// Half the gap between two panels; hems take a millimetre or so off it.
const GAP: f64 = 0.0035;
const SHEET: f64 = 0.0025;
const PANE: f64 = 0.004;

fn v(x: f64, y: f64, z: f64) -> DVec3 {
    DVec3::new(x, y, z)
}

/// Half the width of the body at a place of its side.
fn half_width(x: f64, z: f64) -> f64 {
    let plan = table(
        &[(-2.3, 0.74), (-2.0, 0.835), (-1.3, 0.91), (0.0, 0.895), (1.4, 0.905), (1.985, 0.83), (2.3, 0.7)],
        x,
    );
    let profile =
        table(&[(0.12, 0.93), (0.3, 0.975), (0.55, 1.0), (0.75, 0.99), (0.92, 0.945), (1.1, 0.9)], z);
    // A line pressed along the doors.
    plan * profile + 0.007 * (-((z - 0.70 - 0.02 * x) / 0.025).powi(2)).exp()
}

/// Upper inner edge of the side: hood gap, window sill, trunk gap.
fn edge(x: f64) -> DVec3 {
    let y = table(
        &[
            (-2.2, 0.6),
            (-1.75, 0.66),
            (-1.2, 0.775),
            (0.0, 0.79),
            (0.85, 0.77),
            (1.1, 0.69),
            (1.6, 0.66),
            (2.12, 0.56),
        ],
        x,
    );
    let z = table(
        &[
            (-2.2, 0.955),
            (-1.75, 0.985),
            (-1.3, 0.985),
            (0.0, 0.945),
            (0.9, 0.92),
            (1.6, 0.86),
            (1.985, 0.775),
            (2.15, 0.735),
        ],
        x,
    );
    v(x, y, z)
}

/// The side of the body: `t` runs up from 0 at the sill over the shoulder to 1 at [`edge`].
pub(super) fn side(x: f64, t: f64) -> DVec3 {
    let top = edge(x);
    let at = |z: f64, inward: f64| v(x, half_width(x, z) - inward, z);
    let belt = top.z - 0.035;
    let shoulder = at(belt + 0.025, 0.03).lerp(top, 0.25);
    let section = [
        at(0.2, 0.0),
        at(0.2 + 0.35 * (belt - 0.2), 0.0),
        at(0.2 + 0.7 * (belt - 0.2), 0.0),
        at(belt, 0.0),
        shoulder,
        top,
    ];
    curve(&section, t)
}

/// The `t` at which the side has height `z`, below the shoulder.
fn side_at_height(x: f64, z: f64) -> f64 {
    let (mut low, mut high) = (0.0, 0.75);
    for _ in 0..30 {
        let middle = 0.5 * (low + high);
        if side(x, middle).z < z { low = middle } else { high = middle }
    }
    0.5 * (low + high)
}

/// Lower edge of a fender between two x: along the sill, up, over the wheel, down, along the sill; `s` runs from one
/// to the other. Returns `(x, z)`, and the x of the upper edge that belongs to it: such that the lines between lower
/// and upper edge do not cross.
fn around_arch(s: f64, from: f64, to: f64, axle: f64, low: [f64; 2]) -> ([f64; 2], f64) {
    let direction = (to - from).signum();
    let (a, b) = (axle - direction * ARCH, axle + direction * ARCH);
    let foot = WHEEL_RADIUS - 0.09;
    let mut along = s;
    let (near, far) = ((from - a) / 3.0, (to - b) / 3.0);
    for (share, p, q, above) in [
        (0.12, [from, low[0]], [a, foot], [from, a + 2.0 * near]),
        (0.06, [a, foot], [a, WHEEL_RADIUS], [a + 2.0 * near, a + near]),
        (0.64, [a, WHEEL_RADIUS], [b, WHEEL_RADIUS], [a + near, b + far]),
        (0.06, [b, WHEEL_RADIUS], [b, foot], [b + far, b + 2.0 * far]),
        (0.12, [b, foot], [to, low[1]], [b + 2.0 * far, to]),
    ] {
        let k = (along / share).min(1.0);
        along -= share;
        if along > 1e-12 {
            continue;
        }
        let top = above[0] + (above[1] - above[0]) * k;
        if share > 0.5 {
            let (sin, cos) = (PI * k).sin_cos();
            return ([axle - direction * ARCH * cos, WHEEL_RADIUS + ARCH * sin], top);
        }
        return ([p[0] + (q[0] - p[0]) * k, p[1] + (q[1] - p[1]) * k], top);
    }
    ([to, low[1]], to)
}

/// Front of the car at `s` across (-1 right, 1 left) and height `z`.
fn front(s: f64, z: f64) -> DVec3 {
    let nose =
        table(&[(0.15, 0.16), (0.22, 0.21), (0.36, 0.27), (0.55, 0.265), (0.66, 0.22), (0.75, 0.14)], z);
    v(1.985 + nose * (1.0 - s.abs().powf(2.6)), s * half_width(1.985, z), z)
}

/// Rear of the car.
fn rear(s: f64, z: f64) -> DVec3 {
    let tail = table(&[(0.18, 0.14), (0.3, 0.22), (0.5, 0.25), (0.62, 0.22), (0.9, 0.18), (0.97, 0.16)], z);
    v(-2.0 - tail * (1.0 - s.abs().powf(2.8)), s * half_width(-2.0, z), z)
}

/// Edge of the roof on the left: down the front pillar, along the roof, down the rear pillar.
fn rail(x: f64) -> DVec3 {
    let y = table(&[(-1.78, 0.66), (-1.05, 0.575), (-0.3, 0.585), (0.28, 0.58), (1.0, 0.70)], x);
    let z = table(
        &[
            (-1.78, 0.985),
            (-1.45, 1.15),
            (-1.05, 1.315),
            (-0.3, 1.385),
            (0.28, 1.345),
            (0.65, 1.15),
            (1.02, 0.915),
        ],
        x,
    );
    v(x, y, z)
}

pub(super) fn panels(b: &mut Builder) {
    let d = b.detail;
    let paint = b.is.paint;
    b.group("panels");
    // Seen from the left the front is to the left: u runs from the front to the rear.
    let door = |from: f64, to: f64| {
        move |u: f64, t: f64| {
            let x = from + (to - from) * u;
            let low = side_at_height(x, 0.26);
            side(x, low + (1.0 - low) * t)
        }
    };
    for (name, from, to) in
        [("front_door", 0.93 - GAP, -0.04 + GAP), ("rear_door", -0.04 - GAP, -0.845 + GAP)]
    {
        b.pair(name, panel(&d, [12, 12], SHEET, &door(from, to)), paint);
        // The inner lining, some centimetres further in.
        let lining = |u: f64, t: f64| {
            let p = door(from - 0.03, to + 0.03)(u, t * 0.93);
            v(p.x, p.y - 0.07, p.z)
        };
        b.pair(&format!("{name}_lining"), panel(&d, [8, 8], 0.006, &lining), b.is.cloth);
    }
    let fender = |from: f64, to: f64, axle: f64, low: [f64; 2]| {
        move |u: f64, t: f64| {
            let ([x, z], top) = around_arch(u, from, to, axle, low);
            let bottom = side_at_height(x, z);
            side(x + (top - x) * t, bottom + (1.0 - bottom) * t)
        }
    };
    let front_fender = fender(1.98 - GAP, 0.93 + GAP, FRONT_AXLE, [0.345, 0.26]);
    b.pair("front_fender", panel(&d, [80, 12], SHEET, &front_fender), paint);
    let quarter = fender(-0.845 - GAP, -1.995 + GAP, REAR_AXLE, [0.26, 0.345]);
    b.pair("rear_quarter", panel(&d, [80, 12], SHEET, &quarter), paint);
    for (name, axle) in [("front", FRONT_AXLE), ("rear", REAR_AXLE)] {
        let lip = move |t: f64| {
            let (sin, cos) = (PI * (0.02 + 0.96 * t)).sin_cos();
            let (x, z) = (axle + (ARCH - 0.004) * cos, WHEEL_RADIUS + (ARCH - 0.004) * sin);
            v(x, half_width(x, z) - 0.012, z)
        };
        b.pair(&format!("{name}_arch_lip"), tube(&d, [24, 8], 0.006, false, &lip), b.is.black);
    }
    let sill = bent(rounded_box(&d, v(0.93, 0.05, 0.045), 0.03, 3), |p, _| {
        let x = p.x + 0.045;
        v(x, p.y + half_width(x, 0.2) - 0.055, p.z + 0.205)
    });
    b.pair("sill", sill, paint);

    let hood = |u: f64, t: f64| {
        let s = 2.0 * t - 1.0;
        let across = 1.0 - s * s;
        let shape = |x: f64| {
            let e = edge(x);
            let crease = 0.008 * (-((s.abs() - 0.62) / 0.06).powi(2)).exp();
            v(x, s * (e.y - 2.0 * GAP), e.z + 0.042 * across * (1.0 - u * u) + crease * (1.0 - u))
        };
        let x0 = 1.05 + 0.10 * across;
        let y = s * edge(1.98).y;
        let x1 = front(y / half_width(1.985, 0.735), 0.735).x - 0.012;
        shape(x0 + (x1 - x0) * u)
    };
    b.add("hood", panel(&d, [16, 16], SHEET, &hood), paint);
    let cowl = |u: f64, t: f64| {
        let s = 2.0 * t - 1.0;
        let x = 0.99 + 0.10 * (1.0 - s * s) + 0.05 * u;
        v(x, s * (edge(x).y - 2.0 * GAP), 0.905 + 0.03 * (1.0 - s * s) - 0.01 * u)
    };
    b.add("cowl", panel(&d, [3, 16], SHEET, &cowl), b.is.black);
    let roof = |u: f64, t: f64| {
        let s = 2.0 * t - 1.0;
        let x = -1.04 + (0.27 + 0.05 * (1.0 - s * s) + 1.04) * u;
        let r = rail(x.min(0.28));
        v(x, s * (r.y - 0.012), r.z + 0.018 + 0.035 * (1.0 - s * s))
    };
    b.add("roof", panel(&d, [16, 16], SHEET, &roof), paint);
    let trunk = |u: f64, t: f64| {
        let s = 2.0 * t - 1.0;
        let across = 1.0 - s * s;
        let y = s * edge(-2.0).y;
        let x0 = rear(y / half_width(-2.0, 0.96), 0.96).x + 0.008;
        let x1 = -1.80 - 0.05 * across;
        let x = x0 + (x1 - x0) * u;
        let e = edge(x);
        v(x, s * (e.y - 2.0 * GAP), e.z + 0.02 * across * u)
    };
    b.add("trunk_lid", panel(&d, [8, 16], SHEET, &trunk), paint);

    // Strips below hood and trunk lid end where these do.
    let strip = |surface: fn(f64, f64) -> DVec3, s: [f64; 2], low: f64| {
        move |u: f64, t: f64| {
            let s = s[0] + (s[1] - s[0]) * u;
            let top = edge(surface(s, low + 0.05).x).z - 0.006;
            surface(s, low + (top - low) * t)
        }
    };
    // Front and rear: rectangles of (s, z) on one surface each.
    let on = |surface: fn(f64, f64) -> DVec3, s: [f64; 2], z: [f64; 2], inset: f64| {
        move |u: f64, t: f64| {
            let p = surface(s[0] + (s[1] - s[0]) * u, z[0] + (z[1] - z[0]) * t);
            v(p.x - inset * p.x.signum(), p.y, p.z)
        }
    };
    b.add("front_bumper", panel(&d, [24, 6], 0.004, &on(front, [-1.0, 1.0], [0.19, 0.345], 0.0)), paint);
    b.pair("front_corner", panel(&d, [10, 8], 0.004, &on(front, [0.5, 0.998], [0.352, 0.553], 0.0)), paint);
    b.add("nose", panel(&d, [16, 4], SHEET, &strip(front, [-0.495, 0.495], 0.632)), paint);
    b.pair("brow", panel(&d, [10, 2], SHEET, &strip(front, [0.5, 0.998], 0.697)), paint);
    // Between hood, fender and brow; the same behind.
    let across = |x: f64, y: f64| {
        let (mut low, mut high) = (0.75, 1.0);
        for _ in 0..30 {
            let middle = 0.5 * (low + high);
            if side(x, middle).y > y { low = middle } else { high = middle }
        }
        v(x, y, side(x, low).z)
    };
    let deck = |u: f64, t: f64| {
        let s = 0.72 + 0.275 * t;
        let end = strip(front, [s, s], 0.697)(0.0, 1.0);
        across(1.981, end.y).lerp(end - v(0.004, 0.0, 0.0), u)
    };
    b.pair("front_deck", panel(&d, [4, 8], SHEET, &deck), paint);
    let deck = |u: f64, t: f64| {
        let s = 0.735 + 0.26 * t;
        let end = strip(rear, [s, s], 0.884)(0.0, 1.0);
        (end + v(0.004, 0.0, 0.0)).lerp(across(-1.996, end.y), u)
    };
    b.pair("rear_deck", panel(&d, [4, 8], SHEET, &deck), paint);
    b.add("rear_bumper", panel(&d, [24, 10], 0.004, &on(rear, [1.0, -1.0], [0.22, 0.56], 0.0)), paint);
    b.add("trunk_face", panel(&d, [16, 8], SHEET, &strip(rear, [0.44, -0.44], 0.566)), paint);
    b.pair("rear_corner", panel(&d, [10, 4], SHEET, &on(rear, [0.998, 0.447], [0.566, 0.696], 0.0)), paint);
    b.pair("rear_brow", panel(&d, [10, 2], SHEET, &strip(rear, [0.998, 0.447], 0.884)), paint);
    let diffuser = bent(rounded_box(&d, v(0.08, 0.5, 0.02), 0.012, 2), |p, _| {
        v(p.x - 2.12 + 0.15 * p.y * p.y, p.y, p.z + 0.215 - 0.4 * p.x)
    });
    b.add("diffuser", diffuser, b.is.black);
    let splitter = bent(rounded_box(&d, v(0.07, 0.72, 0.009), 0.007, 2), |p, _| {
        v(p.x + front(p.y / half_width(1.985, 0.19), 0.19).x - 0.03, p.y, p.z + 0.176)
    });
    b.add("splitter", splitter, b.is.black);
    b.add(
        "grille_back",
        panel(&d, [8, 4], 0.004, &on(front, [-0.49, 0.49], [0.355, 0.626], 0.09)),
        b.is.black,
    );
    for i in 0..9 {
        let z = 0.378 + 0.0285 * f64::from(i);
        let slat = tube(&d, [16, 8], 0.006, false, &|t| {
            let p = front(-0.47 + 0.94 * t, z);
            v(p.x - 0.022, p.y, p.z)
        });
        b.add(&format!("grille_slat_{i}"), slat, b.is.chrome);
    }
    let frame = tube(&d, [48, 8], 0.008, true, &|t| {
        let (sin, cos) = (TAU * t).sin_cos();
        let round = |c: f64| c.signum() * c.abs().powf(0.35);
        let p = front(-0.482 * round(cos), 0.4915 + 0.128 * round(sin));
        v(p.x - 0.006, p.y, p.z)
    });
    b.add("grille_frame", frame, b.is.chrome);
}

pub(super) fn glass(b: &mut Builder) {
    let d = b.detail;
    b.group("glass");
    let screen = |u: f64, t: f64| {
        let s = 2.0 * u - 1.0;
        let across = 1.0 - s * s;
        let low = v(0.985 + 0.10 * across, 0.655 * s, 0.925 + 0.03 * across);
        let high = v(0.295 + 0.05 * across, 0.55 * s, 1.352 + 0.03 * across);
        low.lerp(high, t) + v(0.5, 0.0, 0.86) * (0.035 * (PI * t).sin() * (0.35 + 0.65 * across))
    };
    b.add("windscreen", panel(&d, [16, 12], PANE, &screen), b.is.glass);
    let back = |u: f64, t: f64| {
        let s = 1.0 - 2.0 * u;
        let across = 1.0 - s * s;
        let low = v(-1.775 - 0.05 * across, 0.625 * s, 0.99 + 0.015 * across);
        let high = v(-1.065, 0.545 * s, 1.33 + 0.032 * across);
        low.lerp(high, t) + v(-0.45, 0.0, 0.89) * (0.03 * (PI * t).sin() * (0.35 + 0.65 * across))
    };
    b.add("rear_window", panel(&d, [16, 12], PANE, &back), b.is.glass);
    let window = |from: f64, to: f64| {
        move |u: f64, t: f64| {
            let x = from + (to - from) * u;
            let (low, high) = (edge(x) + v(0.0, -0.012, 0.012), rail(x) + v(0.0, 0.0, -0.024));
            low.lerp(high, t) + v(0.0, 0.018 * (PI * t).sin(), 0.0)
        }
    };
    for (name, from, to) in [("front", 0.84, -0.012), ("rear", -0.068, -0.82), ("quarter", -0.86, -1.52)] {
        b.pair(&format!("{name}_window"), panel(&d, [10, 6], PANE, &window(from, to)), b.is.glass);
        let seal = tube(&d, [16, 6], 0.006, false, &move |t| window(from, to)(t, 0.0) + v(0.0, 0.0, -0.008));
        b.pair(&format!("{name}_window_seal"), seal, b.is.rubber);
    }
    b.pair("middle_pillar", panel(&d, [2, 8], 0.02, &window(-0.018, -0.062)), b.is.black);
    b.pair("rear_divider", panel(&d, [2, 8], 0.015, &window(-0.826, -0.854)), b.is.black);
    let rail = tube(&d, [48, 12], 0.026, false, &|t| rail(1.03 - 2.82 * t));
    b.pair("roof_rail", rail, b.is.paint);
}

pub(super) fn lamps(b: &mut Builder) {
    let d = b.detail;
    b.group("lamps");
    let cover = |u: f64, t: f64| front(0.505 + 0.485 * u, 0.561 + 0.129 * t);
    b.pair("headlamp_cover", panel(&d, [10, 6], 0.003, &cover), b.is.glass);
    let housing = |u: f64, t: f64| {
        let p = front(0.51 + 0.47 * u, 0.566 + 0.12 * t);
        v(p.x - 0.10 + 0.06 * (2.0 * t - 1.0).powi(4), p.y - 0.01, p.z)
    };
    b.pair("headlamp_housing", panel(&d, [8, 6], 0.003, &housing), b.is.black);
    let forward = Quat::from_rotation_y(std::f32::consts::FRAC_PI_2);
    for (i, s) in [0.60, 0.76].into_iter().enumerate() {
        let at = front(s, 0.625) - v(0.055, 0.0, 0.0);
        let bowl: [&[(f64, f64)]; 3] = [
            &[(0.0, -0.034), (0.03, -0.02), (0.046, 0.012)],
            &[(0.046, 0.012), (0.043, 0.012)],
            &[(0.043, 0.012), (0.027, -0.017), (0.0, -0.03)],
        ];
        b.pair(&format!("reflector_{i}"), lathe(&d, 20, &bowl).turned(forward).moved(at), b.is.chrome);
        let bulb: &[(f64, f64)] = &[(0.0, -0.02), (0.012, -0.008), (0.014, 0.004), (0.0, 0.014)];
        b.pair(&format!("bulb_{i}"), lathe(&d, 14, &[bulb]).turned(forward).moved(at), b.is.lamp);
    }
    let fog: [&[(f64, f64)]; 2] =
        [&[(0.0, -0.02), (0.034, -0.01), (0.036, 0.008)], &[(0.036, 0.008), (0.0, 0.016)]];
    let at = front(0.72, 0.42);
    b.pair("fog_lamp", lathe(&d, 20, &fog).turned(forward).moved(at), b.is.lamp);
    let tail = |u: f64, t: f64| rear(0.995 - 0.545 * u, 0.703 + 0.174 * t);
    b.pair("tail_lamp_cover", panel(&d, [10, 6], 0.003, &tail), b.is.red_glass);
    let inside = |u: f64, t: f64| {
        let p = rear(0.985 - 0.525 * u, 0.71 + 0.16 * t);
        v(p.x + 0.06, p.y - 0.01, p.z)
    };
    b.pair("tail_lamp_housing", panel(&d, [8, 6], 0.003, &inside), b.is.chrome);
    for i in 0..3 {
        let at = rear(0.9 - 0.16 * f64::from(i), 0.79) + v(0.035, 0.0, 0.0);
        let bulb: &[(f64, f64)] = &[(0.0, -0.014), (0.016, -0.006), (0.016, 0.006), (0.0, 0.014)];
        b.pair(&format!("tail_bulb_{i}"), lathe(&d, 12, &[bulb]).turned(forward).moved(at), b.is.lamp);
    }
    let brake = bent(rounded_box(&d, v(0.008, 0.16, 0.01), 0.006, 2), |p, _| v(p.x - 1.12, p.y, p.z + 1.345));
    b.add("high_brake_lamp", brake, b.is.red_glass);
    let marker = |u: f64, t: f64| {
        let (x, z) = (0.99 - 0.06 * u, 0.62 + 0.022 * t);
        let x = x + 0.06;
        v(x, half_width(x, z) + 0.004, z)
    };
    b.pair("side_marker", panel(&d, [3, 2], 0.004, &marker), b.is.lamp);
}

pub(super) fn trim(b: &mut Builder) {
    let d = b.detail;
    b.group("trim");
    for (name, x) in [("front", 0.10), ("rear", -0.75)] {
        let handle = bent(rounded_box(&d, v(0.085, 0.009, 0.012), 0.008, 4), |p, _| {
            let arch = 0.032 * (1.0 - (p.x / 0.085).powi(4));
            v(p.x + x, p.y + half_width(p.x + x, 0.79) + arch - 0.006, p.z + 0.79)
        });
        b.pair(&format!("{name}_handle"), handle, b.is.chrome);
    }
    // Mirrors: a shell, the glass in it and a foot.
    let shell = bent(rounded_box(&d, v(0.06, 0.105, 0.065), 0.05, 6), |p, n| {
        let round = 0.03 * n.x.max(0.0) * (1.0 - (p.y / 0.105).powi(2));
        v(
            p.x * 0.85 + round - 0.25 * (p.y - 0.1) * 0.3 + 0.74,
            p.y + 1.0,
            p.z * (1.0 - 0.8 * (p.y / 0.105) * 0.25) + 1.005,
        )
    });
    b.pair("mirror_shell", shell, b.is.paint);
    let mirror = |u: f64, t: f64| v(0.682 - 0.004 * u, 1.08 - 0.165 * u, 0.96 + 0.085 * t);
    b.pair("mirror_glass", panel(&d, [6, 4], 0.003, &mirror), b.is.chrome);
    let foot = tube(&d, [8, 10], 0.014, false, &|t| v(0.76, 0.80 + 0.12 * t, 0.945 + 0.025 * t));
    b.pair("mirror_foot", foot, b.is.black);
    // Wipers lie on the cowl.
    for (i, y) in [0.42, -0.12].into_iter().enumerate() {
        let on = |s: f64, lift: f64| {
            let across = 1.0 - s * s;
            let p = v(0.985 + 0.10 * across, 0.655 * s, 0.925 + 0.03 * across);
            p + v(0.01, 0.0, 0.03 + lift)
        };
        let blade = tube(&d, [20, 6], 0.006, false, &|t| on((y + 0.12 - 0.5 * t) / 0.655, 0.02));
        b.add(&format!("wiper_blade_{i}"), blade, b.is.rubber);
        let arm = tube(&d, [10, 8], 0.007, false, &|t| {
            let p = on((y + 0.16 - 0.3 * t) / 0.655, 0.035);
            v(p.x + 0.03 * (1.0 - t), p.y, p.z + 0.012 * (PI * t).sin())
        });
        b.add(&format!("wiper_arm_{i}"), arm, b.is.black);
    }
    let fin = bent(rounded_box(&d, v(0.07, 0.014, 0.03), 0.012, 4), |p, _| {
        let up = (p.z + 0.03) / 0.06;
        v(p.x * (1.0 - 0.6 * up) - 0.03 * up - 0.88, p.y * (1.0 - 0.5 * up), p.z + 1.425)
    });
    b.add("aerial", fin, b.is.black);
    for (name, surface, z, back) in
        [("front", front as fn(f64, f64) -> DVec3, 0.27, false), ("rear", rear, 0.66, true)]
    {
        let plate = move |u: f64, t: f64| {
            let y = if back { 0.26 - 0.52 * u } else { 0.52 * u - 0.26 };
            let x = surface(0.0, z).x;
            v(x + 0.012 * x.signum(), y, z - 0.055 + 0.11 * t)
        };
        b.add(&format!("{name}_plate"), panel(&d, [8, 3], 0.002, &plate), b.is.plate);
    }
    let forward = Quat::from_rotation_y(std::f32::consts::FRAC_PI_2);
    let badge: [&[(f64, f64)]; 3] = [
        &[(0.0, -0.004), (0.04, -0.004)],
        &[(0.04, -0.004), (0.042, 0.002)],
        &[(0.042, 0.002), (0.036, 0.006), (0.0, 0.01)],
    ];
    let badge = lathe(&d, 24, &badge);
    b.add(
        "front_badge",
        badge.clone().turned(forward).moved(front(0.0, 0.685) + v(0.006, 0.0, 0.0)),
        b.is.chrome,
    );
    b.add(
        "rear_badge",
        badge.turned(forward.inverse()).moved(rear(0.0, 0.86) - v(0.006, 0.0, 0.0)),
        b.is.chrome,
    );
    let cap: [&[(f64, f64)]; 3] =
        [&[(0.0, -0.003), (0.075, -0.003)], &[(0.075, -0.003), (0.077, 0.0)], &[(0.077, 0.0), (0.0, 0.003)]];
    let cap = lathe(&d, 24, &cap).turned(axle().inverse());
    let at = v(-1.30, -half_width(-1.30, 0.84) - 0.004, 0.84);
    b.add("fuel_flap", cap.moved(at), b.is.paint);
    let headliner = |u: f64, t: f64| {
        let s = 2.0 * t - 1.0;
        let r = rail(-0.98 + 1.2 * u);
        v(r.x, -s * (r.y - 0.03), r.z - 0.012 + 0.03 * (1.0 - s * s))
    };
    b.add("headliner", patch(&d, [8, 8], &headliner), b.is.cloth);
    let inner_mirror = rounded_box(&d, v(0.012, 0.11, 0.03), 0.011, 4).moved(v(0.36, 0.0, 1.27));
    b.add("inner_mirror", inner_mirror, b.is.black);
}
