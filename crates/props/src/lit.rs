//! Scenes with light of their own: closed forms, the Cornell box, rooms, and one for each way in which light leaks.

use std::f64::consts::{FRAC_PI_4, TAU};

use glam::{DVec3, Quat, Vec3};

use crate::model::{Assembly, Light, LightKind, Material, NodeId, Place, Surface};
use crate::shapes::{Detail, cuboid, lathe, quad, rectangle, rounded_box, wall};
use crate::{car, seat};

pub(crate) const WHITE: [f32; 3] = [0.7; 3];

/// A sun of `lux`, shining from `from` towards the origin.
pub(crate) fn sun(scene: &mut Assembly, lux: f32, from: Vec3) {
    let light = Light { name: "sun", color: [1.0; 3], intensity: lux, kind: LightKind::Sun };
    scene.light(light, Place::aimed(from, Vec3::ZERO));
}

pub(crate) fn floor(size: f64, steps: usize) -> Surface {
    let corner = DVec3::new(-0.5 * size, 0.0, -0.5 * size);
    rectangle(corner, DVec3::Z * size, DVec3::X * size, [steps; 2])
}

/// A ball, `steps` edges along an eighth of its equator.
pub(crate) fn ball(radius: f64, steps: usize) -> Surface {
    let detail = Detail { per_metre: steps as f64 / (FRAC_PI_4 * radius), only_count: false };
    // Nothing is left between the rounded edges of this box.
    rounded_box(&detail, DVec3::splat(radius), radius, steps)
}

/// The Cornell box as it was measured (Cornell University Program of Computer Graphics, "The Cornell Box: Data", 1998):
/// 0.55 m wide, its walls a little askew, the lamp flush in a hole of the ceiling. The open side looks to +z; the
/// origin is on the floor below the middle. `size` is the number of squares along a wall.
///
/// Reflectances are the measured spectra as linear RGB; the lamp has their color and 17 000 cd/m2 in its red.
pub fn cornell(size: usize) -> Assembly {
    let mut scene = Assembly::default();
    let white = scene.material(Material::matte("white", [0.725, 0.71, 0.68]));
    let red = scene.material(Material::matte("red", [0.63, 0.065, 0.05]));
    let green = scene.material(Material::matte("green", [0.14, 0.45, 0.091]));
    let lamp = Material::matte("lamp", [0.78; 3]).glowing([17_000.0, 12_000.0, 4_000.0]);
    let lamp = scene.material(lamp);
    let root = scene.node("cornell", None, None, Place::default());
    // The data has x to the left and z to the back, in millimetres.
    let at = |[x, y, z]: [f64; 3]| DVec3::new(278.0 - x, y, 279.6 - z) * 1e-3;
    let steps = |length: f64| ((length * 1e3 * size as f64 / 555.0).round() as usize).max(1);
    let sheet = |corners: [[f64; 3]; 4]| {
        let [a, b, c, d] = corners.map(at);
        quad([a, b, c, d], [steps(a.distance(b)), steps(a.distance(d))])
    };
    let floor = sheet([[552.8, 0.0, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, 559.2], [549.6, 0.0, 559.2]]);
    scene.part("floor", floor, white, Some(root));
    let (high, deep) = (548.8, 559.2);
    let (xs, zs) = ([0.0, 213.0, 343.0, 556.0], [0.0, 227.0, 332.0, deep]);
    let panel = |i: usize, k: usize| {
        let corners = [[xs[i], zs[k]], [xs[i + 1], zs[k]], [xs[i + 1], zs[k + 1]], [xs[i], zs[k + 1]]];
        sheet(corners.map(|[x, z]| [x, high, z]))
    };
    let mut ceiling = Surface::default();
    for (i, k) in (0..9).map(|n| (n % 3, n / 3)).filter(|&cell| cell != (1, 1)) {
        ceiling.append(panel(i, k));
    }
    scene.part("ceiling", ceiling, white, Some(root));
    scene.part("lamp", panel(1, 1), lamp, Some(root));
    let back = [[549.6, 0.0, deep], [0.0, 0.0, deep], [0.0, high, deep], [556.0, high, deep]];
    scene.part("back_wall", sheet(back), white, Some(root));
    let right = [[0.0, 0.0, deep], [0.0, 0.0, 0.0], [0.0, high, 0.0], [0.0, high, deep]];
    scene.part("right_wall", sheet(right), green, Some(root));
    let left = [[552.8, 0.0, 0.0], [549.6, 0.0, deep], [556.0, high, deep], [556.0, high, 0.0]];
    scene.part("left_wall", sheet(left), red, Some(root));
    for (name, high, top) in [
        ("short_block", 165.0, [[130.0, 65.0], [82.0, 225.0], [240.0, 272.0], [290.0, 114.0]]),
        ("tall_block", 330.0, [[423.0, 247.0], [265.0, 296.0], [314.0, 456.0], [472.0, 406.0]]),
    ] {
        let mut block = sheet(top.map(|[x, z]| [x, high, z]));
        for k in 0..4 {
            let ([px, pz], [qx, qz]) = (top[k], top[(k + 1) % 4]);
            block.append(sheet([[px, 0.0, pz], [qx, 0.0, qz], [qx, high, qz], [px, high, pz]]));
        }
        scene.part(name, block, white, Some(root));
    }
    scene
}

/// A closed room of which every surface, a ball and a turned box in it as well, has albedo 1/2 and gives off
/// 100 cd/m2: the irradiance is pi x 100 / (1 - 1/2) = 628.3 lux everywhere. `size` is the number of squares along
/// a wall.
pub fn furnace(size: usize) -> Assembly {
    let mut scene = Assembly::default();
    let glow = scene.material(Material::matte("glow", [0.5; 3]).glowing([100.0; 3]));
    let room = cuboid(DVec3::new(-1.0, 0.0, -1.0), DVec3::new(1.0, 2.0, 1.0), [size; 3]);
    scene.part("room", room.flipped(), glow, None);
    let turn = Quat::from_rotation_y(0.4) * Quat::from_rotation_x(0.3);
    let some = [size.div_ceil(3); 3];
    let block = cuboid(DVec3::splat(-0.3), DVec3::splat(0.3), some).turned(turn);
    scene.part("block", block.moved(DVec3::new(-0.4, 0.8, -0.2)), glow, None);
    scene.part("ball", ball(0.3, size.div_ceil(3)).moved(DVec3::new(0.5, 0.4, 0.4)), glow, None);
    scene
}

/// A floor of four metres below a disk of radius 0.5 at a height of 1, which gives off 1000 cd/m2 downwards and
/// reflects nothing: below its middle the irradiance is pi x 1000 / 5 = 628.3 lux. `size` is the number of squares
/// along the floor.
pub fn disk_light(size: usize) -> Assembly {
    let mut scene = Assembly::default();
    let white = scene.material(Material::matte("white", WHITE));
    let glow = scene.material(Material::matte("glow", [0.0; 3]).glowing([1000.0; 3]));
    scene.part("floor", floor(4.0, size), white, None);
    // As many sides as look round, and as far out as gives them the disk's area.
    const SIDES: u32 = 96;
    let angle = TAU / f64::from(SIDES);
    let radius = 0.5 * (angle / angle.sin()).sqrt();
    let corner = |i: u32| {
        let (sin, cos) = (angle * f64::from(i)).sin_cos();
        DVec3::new(radius * cos, 1.0, radius * sin).as_vec3()
    };
    let disk = Surface {
        positions: (0..SIDES).map(corner).chain([Vec3::Y]).collect(),
        normals: vec![Vec3::NEG_Y; SIDES as usize + 1],
        triangles: (0..SIDES).map(|i| [SIDES, i, (i + 1) % SIDES]).collect(),
        count: SIDES as usize,
        ..Surface::default()
    };
    scene.part("disk", disk, glow, None);
    scene
}

/// A room of 4 x 2.6 x 3 metres with one window to +z, glazed, a table and a ball: nothing but the sun and, where
/// the bake has one, the environment lights it. `size` is the number of squares per metre.
pub fn window(size: usize) -> Assembly {
    let mut scene = Assembly::default();
    let detail = Detail { per_metre: size as f64, only_count: false };
    let plaster = scene.material(Material::matte("plaster", [0.8, 0.78, 0.74]));
    let boards = scene.material(Material::matte("boards", [0.42, 0.27, 0.15]));
    let wood = scene.material(Material::matte("wood", [0.55, 0.4, 0.25]));
    let blue = scene.material(Material::matte("blue", [0.1, 0.2, 0.6]));
    let mut pane = Material::new("pane", [0.95, 0.98, 0.97], 0.0, 0.0);
    pane.transmission = 1.0;
    let pane = scene.material(pane);
    let root = scene.node("window", None, None, Place::default());
    let (width, height, depth, thick) = (4.0, 2.6, 3.0, 0.25);
    let (x, z) = (0.5 * width, 0.5 * depth);
    let steps = |length: f64| detail.steps(length, 1);
    let slab = |low: f64, high: f64| {
        let (low, high) = (DVec3::new(-x - thick, low, -z - thick), DVec3::new(x + thick, high, z + thick));
        cuboid(low, high, [steps(high.x - low.x), steps(high.y - low.y), steps(high.z - low.z)])
    };
    scene.part("floor", slab(-0.2, 0.0), boards, Some(root));
    scene.part("ceiling", slab(height, height + 0.2), plaster, Some(root));
    let (left, right, low, high) = (1.4, 2.9, 0.9, 2.1);
    let opening = [left + thick, low, right + thick, high];
    let front = wall(&detail, [width + 2.0 * thick, height], thick, &[opening]);
    let front = front.moved(DVec3::new(-x - thick, 0.0, z + thick));
    scene.part("front_wall", front, plaster, Some(root));
    let back = wall(&detail, [width + 2.0 * thick, height], thick, &[]);
    scene.part("back_wall", back.moved(DVec3::new(-x - thick, 0.0, -z)), plaster, Some(root));
    let quarter = Quat::from_rotation_y(std::f32::consts::FRAC_PI_2);
    let side = wall(&detail, [depth, height], thick, &[]).turned(quarter);
    scene.part("left_wall", side.clone().moved(DVec3::new(-x, 0.0, z)), plaster, Some(root));
    scene.part("right_wall", side.moved(DVec3::new(x + thick, 0.0, z)), plaster, Some(root));
    let bar = |low: [f64; 3], high: [f64; 3]| {
        let (low, high) = (DVec3::from_array(low), DVec3::from_array(high));
        cuboid(low, high, (high - low).to_array().map(steps))
    };
    let (left, right, middle) = (left - x, right - x, 0.5 * (left + right) - x);
    let (near, far) = (z + 0.1, z + 0.16);
    let bars = [
        bar([left, low, near], [right, low + 0.05, far]),
        bar([left, high - 0.05, near], [right, high, far]),
        bar([left, low + 0.05, near], [left + 0.05, high - 0.05, far]),
        bar([right - 0.05, low + 0.05, near], [right, high - 0.05, far]),
        bar([middle - 0.02, low + 0.05, near], [middle + 0.02, high - 0.05, far]),
    ];
    let frame = bars.into_iter().fold(Surface::default(), Surface::and);
    scene.part("frame", frame, wood, Some(root));
    let glass = bar([left + 0.05, low + 0.05, z + 0.126], [right - 0.05, high - 0.05, z + 0.134]);
    scene.part("pane", glass, pane, Some(root));
    let sill = bar([left - 0.05, low - 0.03, z - 0.2], [right + 0.05, low, z]);
    scene.part("sill", sill, wood, Some(root));
    let mut table = bar([-0.6, 0.72, -0.4], [0.6, 0.75, 0.4]);
    for (x, z) in [(-0.55, -0.35), (0.55, -0.35), (-0.55, 0.35), (0.55, 0.35)] {
        table.append(bar([x - 0.03, 0.0, z - 0.03], [x + 0.03, 0.72, z + 0.03]));
    }
    scene.part("table", table, wood, Some(root));
    scene.part("ball", ball(0.15, 6).moved(DVec3::new(0.2, 0.9, 0.0)), blue, Some(root));
    sun(&mut scene, 40_000.0, Vec3::new(0.5, 0.9, 1.2));
    scene
}

/// What leaks or goes black in careless bakes, under a sun, each in a node of its own: a closed hut of walls six
/// millimetres thick whose floor runs on outside; a cube on the floor and one against it; a sheet that lies in the
/// floor's plane; a ball that touches; half a ball open to one side and seen from both; a mirrored cube; a sheet
/// modelled twice. `size` is the number of squares per metre.
pub fn leaks(size: usize) -> Assembly {
    let mut scene = Assembly::default();
    let detail = Detail { per_metre: size as f64, only_count: false };
    let white = scene.material(Material::matte("white", WHITE));
    let mut both = Material::matte("white_both_sides", WHITE);
    both.double_sided = true;
    let both = scene.material(both);
    let root = scene.node("leaks", None, None, Place::default());
    let coarse = 4 * size.div_ceil(2);
    scene.part("floor", floor(4.0, coarse), white, Some(root));

    // Walls do not stand on the floor's vertices, and the roof lies on them.
    let hut = scene.node("hut", None, Some(root), Place::at(-0.87, 0.0, -0.83));
    let (side, high, thick) = (1.1, 0.8, 0.006);
    let panel = wall(&detail, [side, high], thick, &[]).moved(DVec3::new(-0.5 * side, 0.0, 0.5 * side));
    for (name, turns) in [("front", 0.0), ("right", 1.0), ("back", 2.0), ("left", 3.0)] {
        let turn = Quat::from_rotation_y(turns * std::f32::consts::FRAC_PI_2);
        scene.part(format!("hut_{name}"), panel.clone().turned(turn), white, Some(hut));
    }
    let half = DVec3::new(0.5 * side, 0.0, 0.5 * side);
    let roof_steps = detail.steps(side, 1);
    let roof = cuboid(-half, half + DVec3::Y * thick, [roof_steps, 1, roof_steps]);
    scene.part("hut_roof", roof.moved(DVec3::Y * high), white, Some(hut));

    let cube = cuboid(DVec3::new(-0.2, 0.0, -0.2), DVec3::new(0.2, 0.4, 0.2), [4; 3]);
    let cube = scene.mesh("cube", cube, white);
    scene.node("on_the_floor", Some(cube), Some(root), Place::at(0.53, 0.0, -0.97));
    scene.node("face_to_face", Some(cube), Some(root), Place::at(0.93, 0.0, -0.97));
    let mirror = Place { scale: Vec3::new(1.0, 1.0, -1.0), ..Place::at(1.5, 0.0, -0.3) };
    scene.node("mirrored", Some(cube), Some(root), mirror);
    let decal = rectangle(DVec3::new(0.1, 0.0, 0.2), DVec3::Z * 0.5, DVec3::X * 0.5, [3; 2]);
    scene.part("in_the_floor", decal, white, Some(root));
    scene.part("touching", ball(0.2, 5).moved(DVec3::new(0.35, 0.2, 0.45)), white, Some(root));
    let bowl: &[(f64, f64)] = &[(0.0, -0.25), (0.18, -0.18), (0.25, 0.0)];
    let lying = Place { rotation: Quat::from_rotation_x(1.2), ..Place::at(-0.9, 0.26, 1.0) };
    let round = Detail { per_metre: 16.0, only_count: false };
    let bowl = scene.mesh("bowl", lathe(&round, 24, &[bowl]).upright(), both);
    scene.node("open_bowl", Some(bowl), Some(root), lying);
    let sheet = rectangle(DVec3::new(0.9, 0.0, 1.2), DVec3::X * 0.6, DVec3::Y * 0.5, [4; 2]);
    let twice = sheet.clone().and(sheet.flipped());
    scene.part("back_to_back", twice, white, Some(root));
    sun(&mut scene, 10_000.0, Vec3::new(0.8, 1.0, 0.6));
    scene
}

/// A sun, a point and a spot over a box and a ball on a floor. `size` is the number of squares along the floor.
pub fn punctual(size: usize) -> Assembly {
    let mut scene = Assembly::default();
    let white = scene.material(Material::matte("white", WHITE));
    let root = scene.node("punctual", None, None, Place::default());
    scene.part("floor", floor(4.0, size), white, Some(root));
    let block = cuboid(DVec3::new(-0.7, 0.0, -0.4), DVec3::new(-0.2, 0.5, 0.1), [6; 3]);
    scene.part("block", block, white, Some(root));
    scene.part("ball", ball(0.3, 6).moved(DVec3::new(0.6, 0.3, 0.2)), white, Some(root));
    sun(&mut scene, 500.0, Vec3::new(-0.6, 1.0, 0.3));
    let point = Light { name: "point", color: [1.0, 0.6, 0.3], intensity: 400.0, kind: LightKind::Point };
    scene.light(point, Place::at(0.1, 1.0, 0.9));
    let kind = LightKind::Spot { inner: 0.25, outer: 0.4 };
    let spot = Light { name: "spot", color: [0.4, 0.6, 1.0], intensity: 2500.0, kind };
    scene.light(spot, Place::aimed(Vec3::new(1.5, 1.8, -1.2), Vec3::new(0.4, 0.0, 0.0)));
    scene
}

/// The car of [`crate::car`] on a floor of twelve metres under a sun, for soft shadows.
pub fn car_studio(triangles: usize) -> Assembly {
    const STEPS: usize = 48;
    let mut scene = car::car(triangles - 2 * STEPS * STEPS);
    let grey = scene.material(Material::matte("floor", [0.4; 3]));
    scene.part("floor", floor(12.0, STEPS), grey, None);
    sun(&mut scene, 10_000.0, Vec3::new(0.7, 1.0, 0.5));
    scene
}

/// The seat of [`crate::seat`] in a room of three metres, lit by one large bright panel at its side: most of its
/// light comes from walls, floor and ceiling.
pub fn seat_room(triangles: usize) -> Assembly {
    let mut scene = seat::seat(triangles - 12 * ROOM_STEPS * ROOM_STEPS - 2);
    add_room(&mut scene, ROOM_STEPS);
    scene
}

/// The room of [`seat_room`] without the seat: given as occluders, only the seat is baked. `size` is the number of
/// squares along a wall.
pub fn room(size: usize) -> Assembly {
    let mut scene = Assembly::default();
    add_room(&mut scene, size);
    scene
}

/// Squares along a wall of the seat's room.
const ROOM_STEPS: usize = 24;

fn add_room(scene: &mut Assembly, steps: usize) {
    let white = scene.material(Material::matte("wall", [0.75, 0.74, 0.7]));
    let warm = scene.material(Material::matte("warm_wall", [0.6, 0.32, 0.18]));
    let carpet = scene.material(Material::matte("carpet", [0.3, 0.28, 0.25]));
    let glow = scene.material(Material::matte("panel", [0.8; 3]).glowing([2500.0, 2600.0, 2800.0]));
    let room: NodeId = scene.node("room", None, None, Place::default());
    let (x, y, z) = (DVec3::X * 3.0, DVec3::Y * 2.4, DVec3::Z * 3.0);
    let corner = DVec3::new(-1.5, 0.0, -1.5);
    let steps = [steps; 2];
    for (name, from, a, b, material) in [
        ("room_floor", corner, z, x, carpet),
        ("ceiling", corner + y, x, z, white),
        ("back_wall", corner, x, y, white),
        ("front_wall", corner + x + z, -x, y, white),
        ("left_wall", corner, y, z, white),
        ("right_wall", corner + x, z, y, warm),
    ] {
        scene.part(name, rectangle(from, a, b, steps), material, Some(room));
    }
    let panel = rectangle(DVec3::new(-1.49, 0.8, -0.7), DVec3::Y * 1.2, DVec3::Z * 1.6, [1; 2]);
    scene.part("panel", panel, glow, Some(room));
}
