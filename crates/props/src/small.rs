//! Scenes of a few triangles, each for one feature.

use glam::{DVec3, Quat, Vec3};

use crate::model::{Alpha, Assembly, Material, Place, Surface};
use crate::shapes::{Detail, cuboid, lathe, panel, rectangle};
use crate::{Diagonal, PropsError};

fn matte(scene: &mut Assembly, name: &'static str, color: [f32; 3]) -> crate::model::MaterialId {
    scene.material(Material::new(name, color, 0.0, 0.9))
}

fn ground(size: f64, steps: usize) -> Surface {
    let corner = DVec3::new(-0.5 * size, 0.0, -0.5 * size);
    rectangle(corner, DVec3::Z * size, DVec3::X * size, [steps, steps])
}

/// Three unit squares meeting in the origin, in the planes x = 0, y = 0 and z = 0, facing the octant where all
/// coordinates are positive. Each square has four vertices of its own.
///
/// With a and b the axes that follow the square's normal in cyclic order (for the square x = 0: y and z), its
/// vertices are O, a, a + b, b. [`Diagonal::Corner`] splits it from O to a + b, [`Diagonal::Other`] from a to b.
pub fn half_box(diagonal: Diagonal) -> Assembly {
    let mut scene = Assembly::default();
    let white = matte(&mut scene, "white", [0.8; 3]);
    let mut surface = Surface { count: 6, ..Surface::default() };
    for k in 0..3 {
        let axis = |i: usize| Vec3::from_array([0, 1, 2].map(|c| if c == i % 3 { 1.0 } else { 0.0 }));
        let (a, b) = (axis(k + 1), axis(k + 2));
        let first = surface.positions.len() as u32;
        surface.positions.extend([Vec3::ZERO, a, a + b, b]);
        surface.normals.extend([axis(k); 4]);
        let split = match diagonal {
            Diagonal::Corner => [[0, 1, 2], [0, 2, 3]],
            Diagonal::Other => [[0, 1, 3], [1, 2, 3]],
        };
        surface.triangles.extend(split.map(|t| t.map(|v: u32| v + first)));
    }
    scene.part("half_box", surface, white, None);
    scene
}

/// A room of two metres, open to the front (+z), with a tall and a low box and a light under the ceiling. `size`
/// is the number of squares along a wall.
pub fn cornell_box(size: usize) -> Assembly {
    let mut scene = Assembly::default();
    let white = matte(&mut scene, "white", [0.73, 0.73, 0.71]);
    let red = matte(&mut scene, "red", [0.6, 0.06, 0.06]);
    let green = matte(&mut scene, "green", [0.12, 0.45, 0.1]);
    let mut lamp = Material::new("lamp", [0.8; 3], 0.0, 0.9);
    lamp.emissive = [1.0, 0.9, 0.7];
    let lamp = scene.material(lamp);
    let (x, y, z) = (DVec3::X * 2.0, DVec3::Y * 2.0, DVec3::Z * 2.0);
    let corner = DVec3::new(-1.0, 0.0, -1.0);
    let root = scene.node("cornell_box", None, None, Place::default());
    let steps = [size, size];
    for (name, from, a, b, material) in [
        ("floor", corner, z, x, white),
        ("ceiling", corner + y, x, z, white),
        ("back_wall", corner, x, y, white),
        ("left_wall", corner, y, z, red),
        ("right_wall", corner + x, z, y, green),
    ] {
        scene.part(name, rectangle(from, a, b, steps), material, Some(root));
    }
    let steps = |length: f64| ((length * size as f64 / 2.0).round() as usize).max(1);
    for (name, half, height, place, angle) in [
        ("tall_box", 0.29, 1.2, Vec3::new(-0.36, 0.0, -0.32), 0.3_f32),
        ("low_box", 0.29, 0.6, Vec3::new(0.36, 0.0, 0.3), -0.29),
    ] {
        let (low, high) = (DVec3::new(-half, 0.0, -half), DVec3::new(half, height, half));
        let shape = cuboid(low, high, [steps(2.0 * half), steps(height), steps(2.0 * half)]);
        let mesh = scene.mesh(name, shape, white);
        let rotation = Quat::from_rotation_y(angle);
        let place = Place { translation: place, rotation, ..Place::default() };
        scene.node(name, Some(mesh), Some(root), place);
    }
    let from = DVec3::new(-0.25, 1.995, -0.2);
    let light = rectangle(from, DVec3::X * 0.5, DVec3::Z * 0.4, [steps(0.5), steps(0.4)]);
    scene.part("light", light, lamp, Some(root));
    scene
}

/// A floor and a wall, unit squares of `size` x `size` quads, meeting in the x axis; each has its own vertices.
pub fn l_shape(size: usize) -> Assembly {
    let mut scene = Assembly::default();
    let white = matte(&mut scene, "white", [0.8; 3]);
    let floor = rectangle(DVec3::ZERO, DVec3::Z, DVec3::X, [size, size]);
    let wall = rectangle(DVec3::ZERO, DVec3::X, DVec3::Y, [size, size]);
    scene.part("l_shape", floor.and(wall), white, None);
    scene
}

/// A column on a plane with the counts of Krivanek 2004, figure 1: a plane of 9 x 9 quads (100 vertices, 162
/// triangles), a shaft of 19 sides with both ends (76, 72) and a slab on top (24, 12).
pub fn column() -> Assembly {
    let mut scene = Assembly::default();
    let stone = matte(&mut scene, "stone", [0.7, 0.68, 0.62]);
    let (sides, radius, height) = (19_u32, 0.3_f32, 2.0_f32);
    let mut shaft = Surface { count: 72, ..Surface::default() };
    let ring = |i: u32, y: f32| {
        let (sin, cos) = (std::f32::consts::TAU * i as f32 / sides as f32).sin_cos();
        Vec3::new(radius * sin, y, radius * cos)
    };
    // Two rings for the mantle, then one for each end.
    for (y, normal) in [(0.0, None), (height, None), (0.0, Some(-Vec3::Y)), (height, Some(Vec3::Y))] {
        for i in 0..sides {
            let p = ring(i, y);
            shaft.positions.push(p);
            shaft.normals.push(normal.unwrap_or_else(|| Vec3::new(p.x, 0.0, p.z).normalize()));
        }
    }
    for i in 0..sides {
        let (a, b) = (i, (i + 1) % sides);
        shaft.triangles.extend([[a, b, b + sides], [a, b + sides, a + sides]]);
    }
    for i in 1..sides - 1 {
        let (low, high) = (2 * sides, 3 * sides);
        shaft.triangles.extend([[low, low + i + 1, low + i], [high, high + i, high + i + 1]]);
    }
    let half = 0.42;
    let top = f64::from(height);
    let slab = cuboid(DVec3::new(-half, top, -half), DVec3::new(half, top + 0.25, half), [1; 3]);
    let root = scene.node("column", None, None, Place::default());
    scene.part("plane", ground(6.0, 9), stone, Some(root));
    scene.part("shaft", shaft, stone, Some(root));
    scene.part("slab", slab, stone, Some(root));
    scene
}

/// A bracket of two plates and a knob, the same mesh five times: as it is, turned, mirrored, scaled unevenly, and
/// mirrored and scaled below a turned parent.
pub fn instances() -> Assembly {
    let mut scene = Assembly::default();
    let grey = matte(&mut scene, "ground", [0.5; 3]);
    let steel = scene.material(Material::new("steel", [0.56, 0.57, 0.58], 1.0, 0.4));
    scene.part("ground", ground(4.0, 16), grey, None);
    let detail = Detail { per_metre: 30.0, only_count: false };
    let foot = cuboid(DVec3::new(-0.3, 0.0, -0.2), DVec3::new(0.3, 0.05, 0.2), [6, 1, 4]);
    let back = cuboid(DVec3::new(-0.3, 0.05, -0.2), DVec3::new(-0.25, 0.5, 0.2), [1, 5, 4]);
    let side: &[(f64, f64)] = &[(0.08, 0.0), (0.08, 0.1)];
    let dome: &[(f64, f64)] = &[(0.08, 0.1), (0.056, 0.156), (0.0, 0.18)];
    let knob = lathe(&detail, 16, &[&[(0.0, 0.0), (0.08, 0.0)], side, dome]).upright();
    let knob = knob.moved(DVec3::new(0.15, 0.05, 0.08));
    let bracket = scene.mesh("bracket", foot.and(back).and(knob), steel);
    let quarter = Quat::from_rotation_y(1.0);
    scene.node("as_it_is", Some(bracket), None, Place::at(-1.0, 0.0, -0.8));
    let turned = Place { rotation: quarter, ..Place::at(0.2, 0.0, -0.9) };
    scene.node("turned", Some(bracket), None, turned);
    let mirrored = Place { scale: Vec3::new(-1.0, 1.0, 1.0), ..Place::at(-1.0, 0.0, 0.8) };
    scene.node("mirrored", Some(bracket), None, mirrored);
    let stretched = Place { scale: Vec3::new(1.0, 2.0, 0.5), ..Place::at(0.3, 0.0, 0.3) };
    scene.node("stretched", Some(bracket), None, stretched);
    let parent =
        scene.node("turned_group", None, None, Place { rotation: quarter, ..Place::at(1.2, 0.0, 0.9) });
    let both = Place { scale: Vec3::new(0.8, 1.5, -0.7), ..Place::default() };
    scene.node("mirrored_and_stretched", Some(bracket), Some(parent), both);
    scene
}

/// Wire mesh drawn by an alpha mask on single quads, between round posts.
///
/// # Errors
/// [`PropsError::Texture`] if the mask cannot be encoded.
pub fn fence() -> Result<Assembly, PropsError> {
    let mut scene = Assembly::default();
    let earth = matte(&mut scene, "ground", [0.35, 0.3, 0.22]);
    let steel = scene.material(Material::new("post", [0.4, 0.42, 0.43], 1.0, 0.5));
    let mut wire = Material::new("wire", [0.55, 0.57, 0.58], 0.8, 0.5);
    wire.alpha = Alpha::Mask(0.5);
    wire.double_sided = true;
    wire.texture = Some(wire_png(64)?);
    let wire = scene.material(wire);
    let root = scene.node("fence", None, None, Place::default());
    scene.part("ground", ground(6.0, 24), earth, Some(root));
    let mut card = rectangle(DVec3::new(0.0, 0.1, 0.0), DVec3::X * 1.5, DVec3::Y * 1.2, [1, 1]);
    card.uvs = vec![[0.0, 8.0], [10.0, 8.0], [0.0, 0.0], [10.0, 0.0]];
    let card = scene.mesh("card", card, wire);
    let detail = Detail { per_metre: 20.0, only_count: false };
    let post: [&[(f64, f64)]; 3] = [
        &[(0.0, 0.0), (0.03, 0.0)],
        &[(0.03, 0.0), (0.03, 1.36)],
        &[(0.03, 1.36), (0.02, 1.385), (0.0, 1.395)],
    ];
    let post = scene.mesh("post", lathe(&detail, 12, &post).upright(), steel);
    for i in 0..4 {
        let x = -2.25 + 1.5 * i as f32;
        scene.node(format!("post_{i}"), Some(post), Some(root), Place::at(x, 0.0, 0.0));
        if i < 3 {
            scene.node(format!("card_{i}"), Some(card), Some(root), Place::at(x, 0.0, 0.0));
        }
    }
    Ok(scene)
}

/// Two crossing diagonals of wire, opaque where alpha is high; tiles in both directions.
fn wire_png(size: u32) -> Result<Vec<u8>, PropsError> {
    let mut pixels = Vec::with_capacity((size * size * 4) as usize);
    for y in 0..size {
        for x in 0..size {
            let at = |c: u32| (f64::from(c) + 0.5) / f64::from(size);
            // Distance to the lines x = y and x = 1 - y, both repeated.
            let line = |s: f64| (s - s.round()).abs() * std::f64::consts::FRAC_1_SQRT_2;
            let distance = line(at(x) - at(y)).min(line(at(x) + at(y)));
            let alpha = ((0.09 - distance) * 24.0 + 0.5).clamp(0.0, 1.0);
            let shade = (255.0 - 900.0 * distance).clamp(120.0, 255.0) as u8;
            pixels.extend([shade, shade, shade, (alpha * 255.0).round() as u8]);
        }
    }
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, size, size);
    encoder.set_color(png::ColorType::Rgba);
    encoder.set_depth(png::BitDepth::Eight);
    let mut writer = encoder.write_header()?;
    writer.write_image_data(&pixels)?;
    writer.finish()?;
    Ok(bytes)
}

/// A closed wall of four millimetres standing on the ground, with a shelf on its front: one side is dark where the
/// other is not. `size` is the number of squares per metre.
pub fn thin_wall(size: usize) -> Assembly {
    let mut scene = Assembly::default();
    let white = matte(&mut scene, "white", [0.8; 3]);
    let detail = Detail { per_metre: size as f64, only_count: false };
    let root = scene.node("thin_wall", None, None, Place::default());
    scene.part("ground", ground(3.0, 3 * size), white, Some(root));
    let wall = panel(&detail, [1, 1], 0.004, &|u, v| DVec3::new(2.0 * u - 1.0, 0.003 + v, 0.002));
    scene.part("wall", wall, white, Some(root));
    let shelf = cuboid(DVec3::new(-0.6, 0.5, 0.002), DVec3::new(0.6, 0.52, 0.3), [size.max(2), 1, 4]);
    scene.part("shelf", shelf, white, Some(root));
    scene
}

/// Cubes that touch: one stands on the plane exactly, one hovers a millimetre above it, one is sunk into it, and
/// two run into each other. `scale` multiplies all lengths.
pub fn contact(scale: f64) -> Assembly {
    let mut scene = Assembly::default();
    let white = matte(&mut scene, "white", [0.8; 3]);
    let root = scene.node("contact", None, None, Place::default());
    scene.part("plane", ground(4.0 * scale, 20), white, Some(root));
    let half = 0.25;
    for (name, x, y, z) in [
        ("standing", -1.0, half, -0.8),
        ("hovering", 0.2, half + 0.001, -0.9),
        ("sunk", 1.2, 0.1, -0.6),
        ("first_of_two", -0.4, half, 0.7),
        ("second_of_two", -0.12, half + 0.11, 0.84),
    ] {
        let centre = DVec3::new(x, y, z);
        let cube = cuboid((centre - half) * scale, (centre + half) * scale, [4; 3]);
        scene.part(name, cube, white, Some(root));
    }
    scene
}
