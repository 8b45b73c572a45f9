//! What carries the shell: wheels, underbody and the fittings of the cabin.

use std::f64::consts::{PI, TAU};

use glam::{DVec3, Quat};

use super::body::{FRONT_AXLE, REAR_AXLE, WHEEL_RADIUS};
use super::{Builder, axle};
use crate::model::{MeshId, Place};
use crate::shapes::{bent, lathe, panel, rounded_box, table, tube};

fn v(x: f64, y: f64, z: f64) -> DVec3 {
    DVec3::new(x, y, z)
}

const SPOKES: usize = 10;
const NUTS: usize = 5;
const TRACK: f32 = 0.775;

/// Four wheels that share their meshes; those on the right are turned about the vertical.
pub(super) fn wheels(b: &mut Builder) {
    let d = b.detail;
    let mesh = |b: &mut Builder, name: &str, surface: crate::model::Surface, material| {
        let surface = surface.turned(axle()).upright();
        b.scene.mesh(name, surface, material)
    };
    // The axis is z here, outside is z > 0.
    let tread = 0.33;
    let mut tyre: Vec<Vec<(f64, f64)>> = vec![vec![
        (0.208, -0.085),
        (0.222, -0.105),
        (0.262, -0.117),
        (0.300, -0.112),
        (0.322, -0.096),
        (tread, -0.078),
    ]];
    let mut z = -0.078;
    for groove in [-0.045, 0.0, 0.045] {
        let (a, c, deep) = (groove - 0.005, groove + 0.005, tread - 0.008);
        tyre.extend([vec![(tread, z), (tread, a)], vec![(tread, a), (deep, a + 0.001)]]);
        tyre.extend([vec![(deep, a + 0.001), (deep, c - 0.001)], vec![(deep, c - 0.001), (tread, c)]]);
        z = c;
    }
    tyre.push(vec![(tread, z), (tread, 0.078)]);
    tyre.push(vec![
        (tread, 0.078),
        (0.322, 0.096),
        (0.300, 0.112),
        (0.262, 0.117),
        (0.222, 0.105),
        (0.208, 0.085),
    ]);
    tyre.push(vec![(0.208, 0.085), (0.208, -0.085)]);
    let spans: Vec<&[(f64, f64)]> = tyre.iter().map(Vec::as_slice).collect();
    let tyre = mesh(b, "tyre", lathe(&d, 48, &spans), b.is.rubber);
    let barrel: [&[(f64, f64)]; 4] = [
        &[(0.212, -0.10), (0.200, -0.085), (0.190, -0.05), (0.190, 0.05), (0.204, 0.085), (0.214, 0.104)],
        &[(0.214, 0.104), (0.206, 0.108), (0.199, 0.100)],
        &[(0.199, 0.100), (0.184, 0.05), (0.184, -0.05), (0.194, -0.09), (0.205, -0.104)],
        &[(0.205, -0.104), (0.212, -0.10)],
    ];
    let barrel = mesh(b, "rim_barrel", lathe(&d, 48, &barrel), b.is.alloy);
    let spoke = bent(rounded_box(&d, v(0.068, 0.013, 0.011), 0.009, 3), |p, _| {
        let r = p.x + 0.126;
        let wide = 1.0 + 0.5 * ((r - 0.12) / 0.07).powi(2);
        v(r, p.y * wide, p.z + 0.085 - 0.020 * (1.0 - (r - 0.058) / 0.136).powi(2))
    });
    let spoke = mesh(b, "spoke", spoke, b.is.alloy);
    let hub: [&[(f64, f64)]; 4] = [
        &[(0.0, -0.06), (0.072, -0.06)],
        &[(0.072, -0.06), (0.074, 0.05), (0.070, 0.066)],
        &[(0.070, 0.066), (0.034, 0.072)],
        &[(0.034, 0.072), (0.030, 0.084), (0.0, 0.088)],
    ];
    let hub = mesh(b, "hub", lathe(&d, 32, &hub), b.is.alloy);
    let nut: [&[(f64, f64)]; 3] = [
        &[(0.0, 0.060), (0.0095, 0.060)],
        &[(0.0095, 0.060), (0.0095, 0.080)],
        &[(0.0095, 0.080), (0.0, 0.084)],
    ];
    let nut = mesh(b, "wheel_nut", lathe(&d, 6, &nut).moved(v(0.052, 0.0, 0.0)), b.is.chrome);
    let disc: [&[(f64, f64)]; 5] = [
        &[(0.0, -0.035), (0.158, -0.035)],
        &[(0.158, -0.035), (0.158, -0.010)],
        &[(0.158, -0.010), (0.082, -0.010)],
        &[(0.082, -0.010), (0.080, 0.030)],
        &[(0.080, 0.030), (0.0, 0.030)],
    ];
    let disc = mesh(b, "brake_disc", lathe(&d, 40, &disc), b.is.steel);
    let caliper = bent(rounded_box(&d, v(0.028, 0.075, 0.036), 0.012, 3), |p, _| {
        let (sin, cos) = (p.y / 0.14).sin_cos();
        v((0.138 + p.x) * cos, (0.138 + p.x) * sin, p.z - 0.022)
    });
    let caliper = mesh(b, "caliper", caliper, b.is.paint);
    for (name, x, left) in [
        ("wheel_front_left", FRONT_AXLE, true),
        ("wheel_front_right", FRONT_AXLE, false),
        ("wheel_rear_left", REAR_AXLE, true),
        ("wheel_rear_right", REAR_AXLE, false),
    ] {
        let y = if left { TRACK } else { -TRACK };
        let rotation = if left { Quat::IDENTITY } else { Quat::from_rotation_y(std::f32::consts::PI) };
        let place = Place { rotation, ..Place::at(y, WHEEL_RADIUS as f32, x as f32) };
        let wheel = b.scene.node(name, None, Some(b.root), place);
        let mut put = |part: &str, mesh: MeshId, turn: f32| {
            // The axle points to the left, which is x once y is up.
            let place = Place { rotation: Quat::from_rotation_x(turn), ..Place::default() };
            b.scene.node(format!("{name}_{part}"), Some(mesh), Some(wheel), place);
        };
        for (part, mesh) in
            [("tyre", tyre), ("rim", barrel), ("hub", hub), ("disc", disc), ("caliper", caliper)]
        {
            put(part, mesh, 0.0);
        }
        for i in 0..SPOKES {
            put(&format!("spoke_{i}"), spoke, std::f32::consts::TAU * i as f32 / SPOKES as f32);
        }
        for i in 0..NUTS {
            put(&format!("nut_{i}"), nut, std::f32::consts::TAU * (i as f32 + 0.25) / NUTS as f32);
        }
    }
}

pub(super) fn underbody(b: &mut Builder) {
    let d = b.detail;
    b.group("underbody");
    // The floor with its tunnel, between the axles.
    let floor = |u: f64, t: f64| {
        let (x, y) = (-0.88 + 1.86 * u, 1.56 * t - 0.78);
        let tunnel = 0.14 * (-(y / 0.11).powi(4)).exp();
        let ribs = 0.006 * (TAU * x / 0.16).sin().powi(2) * (1.0 - (-(y / 0.16).powi(4)).exp());
        v(x, y, 0.21 + tunnel + ribs)
    };
    b.add("floor", panel(&d, [24, 24], 0.003, &floor), b.is.steel);
    let boot = |u: f64, t: f64| {
        v(-2.1 + 1.2 * u, 1.06 * t - 0.53, 0.40 - 0.12 * table(&[(0.2, 0.0), (0.8, 1.0)], 1.0 - u))
    };
    b.add("boot_floor", panel(&d, [12, 12], 0.003, &boot), b.is.steel);
    let wall = |u: f64, t: f64| v(1.0 + 0.04 * (PI * t).sin(), 0.62 - 1.24 * u, 0.30 + 0.58 * t);
    b.add("firewall", panel(&d, [10, 8], 0.003, &wall), b.is.steel);
    for (name, x) in [("front", FRONT_AXLE), ("rear", REAR_AXLE)] {
        // Liners arch over the wheels and look down.
        let liner = move |u: f64, t: f64| {
            let (sin, cos) = (PI * (0.04 + 0.92 * u)).sin_cos();
            v(x - 0.372 * cos, 0.56 + 0.30 * t, WHEEL_RADIUS + 0.368 * sin)
        };
        b.pair(&format!("{name}_liner"), panel(&d, [20, 6], 0.003, &liner), b.is.black);
        let beam = tube(&d, [10, 12], 0.028, false, &move |t| v(x, 1.30 * (t - 0.5), 0.30));
        b.add(&format!("{name}_beam"), beam, b.is.steel);
        let spring = tube(&d, [96, 8], 0.007, false, &move |t| {
            let (sin, cos) = (TAU * 6.0 * t).sin_cos();
            v(x + 0.055 * cos, 0.60 + 0.055 * sin, 0.36 + 0.26 * t)
        });
        b.pair(&format!("{name}_spring"), spring, b.is.paint);
        let damper: [&[(f64, f64)]; 5] = [
            &[(0.0, 0.34), (0.024, 0.34)],
            &[(0.024, 0.34), (0.024, 0.5)],
            &[(0.024, 0.5), (0.011, 0.5)],
            &[(0.011, 0.5), (0.011, 0.64)],
            &[(0.011, 0.64), (0.0, 0.64)],
        ];
        b.pair(&format!("{name}_damper"), lathe(&d, 16, &damper).moved(v(x, 0.60, 0.0)), b.is.steel);
        for (i, ahead) in [0.16, -0.16].into_iter().enumerate() {
            let arm = tube(&d, [8, 10], 0.015, false, &move |t| {
                v(x + ahead * (1.0 - t), 0.28 + 0.38 * t, 0.245 + 0.03 * t)
            });
            b.pair(&format!("{name}_arm_{i}"), arm, b.is.steel);
        }
    }
    let pipe = tube(&d, [48, 12], 0.026, false, &|t| {
        let x = 0.9 - 2.3 * t;
        v(
            x,
            0.22 * table(&[(-1.4, 1.0), (-1.0, 1.0), (-0.7, 0.0), (0.9, 0.0)], x),
            0.235 + 0.04 * table(&[(-1.4, 1.0), (-1.0, 1.0), (-0.8, 0.0)], x),
        )
    });
    b.add("exhaust_pipe", pipe, b.is.steel);
    let muffler = rounded_box(&d, v(0.18, 0.30, 0.075), 0.07, 5).moved(v(-1.72, 0.05, 0.285));
    b.add("muffler", muffler, b.is.steel);
    let backward = Quat::from_rotation_y(-std::f32::consts::FRAC_PI_2);
    let tip: [&[(f64, f64)]; 4] = [
        &[(0.034, 0.0), (0.038, 0.26)],
        &[(0.038, 0.26), (0.034, 0.262)],
        &[(0.034, 0.262), (0.031, 0.004)],
        &[(0.031, 0.004), (0.034, 0.0)],
    ];
    b.pair("exhaust_tip", lathe(&d, 24, &tip).turned(backward).moved(v(-1.92, 0.48, 0.26)), b.is.chrome);
    let tank = rounded_box(&d, v(0.20, 0.38, 0.08), 0.06, 4).moved(v(-0.66, -0.30, 0.13));
    b.add("fuel_tank", tank, b.is.black);
    let engine = rounded_box(&d, v(0.26, 0.28, 0.17), 0.05, 4).moved(v(1.45, 0.0, 0.52));
    b.add("engine", engine, b.is.steel);
    let cover = bent(rounded_box(&d, v(0.22, 0.24, 0.03), 0.02, 4), |p, n| {
        p + n * 0.006 * (TAU * p.y / 0.08).sin() * n.z.max(0.0) + v(1.45, 0.0, 0.72)
    });
    b.add("engine_cover", cover, b.is.black);
    let radiator = rounded_box(&d, v(0.02, 0.32, 0.14), 0.008, 2).moved(v(1.95, 0.0, 0.47));
    b.add("radiator", radiator, b.is.steel);
    let battery = rounded_box(&d, v(0.12, 0.085, 0.09), 0.01, 2).moved(v(1.2, 0.42, 0.62));
    b.add("battery", battery, b.is.black);
    let steering = tube(&d, [12, 10], 0.014, false, &|t| v(1.22, 1.1 * (t - 0.5), 0.30));
    b.add("steering_rack", steering, b.is.steel);
}

pub(super) fn cabin(b: &mut Builder) {
    let d = b.detail;
    b.group("cabin");
    let dash = bent(rounded_box(&d, v(0.17, 0.66, 0.13), 0.07, 6), |p, n| {
        let hood = 0.035 * (-((p.y - 0.37) / 0.16).powi(4)).exp() * n.z.max(0.0);
        v(p.x + 0.75 - 0.05 * (p.z / 0.13) * (1.0 - p.x / 0.17), p.y, p.z + hood + 0.76)
    });
    b.add("dashboard", dash, b.is.black);
    let console = bent(rounded_box(&d, v(0.42, 0.085, 0.09), 0.03, 4), |p, _| {
        v(p.x + 0.17, p.y, p.z + 0.43 + 0.25 * (p.x + 0.1).max(0.0).powi(2))
    });
    b.add("console", console, b.is.black);
    let knob: &[(f64, f64)] = &[(0.0, 0.0), (0.012, 0.02), (0.014, 0.09), (0.026, 0.115), (0.0, 0.135)];
    b.add("gear_lever", lathe(&d, 16, &[knob]).moved(v(0.36, 0.0, 0.55)), b.is.black);
    // The wheel lies in a plane that leans towards the driver.
    let centre = v(0.46, 0.37, 0.86);
    let (right, up) = (v(0.0, 1.0, 0.0), v(0.42, 0.0, 0.91));
    let rim = tube(&d, [48, 12], 0.014, true, &|t| {
        let (sin, cos) = (TAU * t).sin_cos();
        centre + 0.18 * (right * cos + up * sin)
    });
    b.add("steering_wheel", rim, b.is.rubber);
    for (i, angle) in [0.1, PI - 0.1, 1.5 * PI].into_iter().enumerate() {
        let way = right * angle.cos() + up * angle.sin();
        let spoke = tube(&d, [8, 8], 0.011, false, &|t| {
            centre + v(0.02, 0.0, -0.01) * (1.0 - t) + way * (0.03 + 0.148 * t)
        });
        b.add(&format!("steering_spoke_{i}"), spoke, b.is.black);
    }
    let column =
        tube(&d, [10, 12], 0.03, false, &|t| centre + v(0.02, 0.0, -0.01) + v(0.91, 0.0, -0.42) * (0.28 * t));
    b.add("steering_column", column, b.is.black);
    for (i, y) in [0.30, 0.39, 0.48].into_iter().enumerate() {
        let pedal = rounded_box(&d, v(0.008, 0.028, 0.035), 0.006, 2).moved(v(0.86, y, 0.38));
        b.add(&format!("pedal_{i}"), pedal, b.is.rubber);
    }
    for i in 0..4 {
        let y = [-0.55, -0.08, 0.08, 0.57][i];
        let backward = Quat::from_rotation_y(-std::f32::consts::FRAC_PI_2);
        let vent: [&[(f64, f64)]; 3] = [
            &[(0.0, -0.01), (0.036, -0.01)],
            &[(0.036, -0.01), (0.038, 0.008)],
            &[(0.038, 0.008), (0.03, 0.010), (0.0, 0.004)],
        ];
        b.add(
            &format!("vent_{i}"),
            lathe(&d, 20, &vent).turned(backward).moved(v(0.585, y, 0.80)),
            b.is.chrome,
        );
    }
    let shelf = |u: f64, t: f64| v(-1.68 + 0.42 * u, 1.08 * t - 0.54, 0.93);
    b.add("parcel_shelf", panel(&d, [6, 10], 0.01, &shelf), b.is.cloth);
    let rear_wall = |u: f64, t: f64| v(-1.24 - 0.10 * t, 0.52 - 1.04 * u, 0.36 + 0.54 * t);
    b.add("rear_wall", panel(&d, [10, 8], 0.01, &rear_wall), b.is.cloth);
    for (side, y) in [("left", 0.37), ("right", -0.37)] {
        let visor = rounded_box(&d, v(0.07, 0.16, 0.008), 0.007, 2).moved(v(0.24, y, 1.335));
        b.add(&format!("visor_{side}"), visor, b.is.cloth);
        let carpet = move |u: f64, t: f64| v(0.36 + 0.5 * u, y - 0.22 + 0.44 * t, 0.245);
        b.add(&format!("mat_{side}"), panel(&d, [6, 6], 0.008, &carpet), b.is.cloth);
    }
}
