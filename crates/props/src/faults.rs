//! One scene for each way in which light goes wrong in careless bakes, with that fault and nothing else: docs/FAULTS.md
//! shows them. All are about two metres wide.

use glam::{DVec3, Vec3};

use crate::lit::{WHITE, ball, floor, sun};
use crate::model::{Assembly, Material, MaterialId, Place, Surface};
use crate::shapes::{cuboid, rectangle};

/// Squares along the floors: their lines pass by what stands on them.
const STEPS: usize = 15;

fn white(scene: &mut Assembly, double_sided: bool) -> MaterialId {
    let name = if double_sided { "white_both_sides" } else { "white" };
    scene.material(Material { double_sided, ..Material::matte(name, WHITE) })
}

fn block(low: [f64; 3], high: [f64; 3], steps: [usize; 3]) -> Surface {
    cuboid(DVec3::from_array(low), DVec3::from_array(high), steps)
}

/// Two balls of double-sided material above a floor: the one at -x was modelled with its fronts inside, the one at +x as
/// it should be.
pub fn back_faces() -> Assembly {
    let mut scene = Assembly::default();
    let (one, both) = (white(&mut scene, false), white(&mut scene, true));
    scene.part("floor", floor(2.0, STEPS), one, None);
    let round = ball(0.3, 6);
    let at = |x: f64| DVec3::new(x, 0.32, 0.0);
    scene.part("inside_out", round.clone().flipped().moved(at(-0.45)), both, None);
    scene.part("outside_out", round.moved(at(0.45)), both, None);
    sun(&mut scene, 10_000.0, Vec3::new(0.2, 1.0, 0.7));
    scene
}

/// A leg four centimetres thick that is sunk into a slab by five millimetres. One vertex of the slab, whose squares are
/// 33 cm wide, lies inside the leg.
pub fn inside() -> Assembly {
    let mut scene = Assembly::default();
    let white = white(&mut scene, false);
    scene.part("slab", block([-1.0, -0.1, -1.0], [1.0, 0.0, 1.0], [6, 1, 6]), white, None);
    scene.part("leg", block([-0.02, -0.005, -0.02], [0.02, 0.6, 0.02], [1, 6, 1]), white, None);
    sun(&mut scene, 10_000.0, Vec3::new(0.6, 1.0, 0.3));
    scene
}

/// Two smooth balls of few triangles, 8 and 16 around, under a sun from the side.
pub fn terminator() -> Assembly {
    let mut scene = Assembly::default();
    let white = white(&mut scene, false);
    scene.part("of_8", ball(0.4, 1).moved(DVec3::X * -0.5), white, None);
    scene.part("of_16", ball(0.4, 2).moved(DVec3::X * 0.5), white, None);
    sun(&mut scene, 10_000.0, Vec3::new(0.5, 1.0, 0.9));
    scene
}

/// Three cubes on a floor under a sun: one stands on it, the others are off by four micrometres up and down.
pub fn contact() -> Assembly {
    let mut scene = Assembly::default();
    let white = white(&mut scene, false);
    scene.part("floor", floor(2.0, STEPS), white, None);
    for (name, x, gap) in [("standing", 0.0, 0.0), ("above", -0.6, 4e-6), ("below", 0.6, -4e-6)] {
        let cube = block([x - 0.15, gap, -0.15], [x + 0.15, 0.3 + gap, 0.15], [3; 3]);
        scene.part(name, cube, white, None);
    }
    sun(&mut scene, 10_000.0, Vec3::new(0.3, 1.0, -1.0));
    scene
}

/// A wall two millimetres thick on a floor whose squares run through below it, under a sun from -x.
pub fn thin_wall() -> Assembly {
    let mut scene = Assembly::default();
    let white = white(&mut scene, false);
    scene.part("floor", floor(2.0, STEPS), white, None);
    scene.part("wall", block([0.0, 0.0, -0.8], [0.002, 0.5, 0.8], [1, 5, 16]), white, None);
    sun(&mut scene, 10_000.0, Vec3::new(-1.0, 1.0, 0.0));
    scene
}

/// Faces in one place: a sheet in the plane of the floor, two boxes that run through each other with their tops in one
/// plane, and a sheet modelled twice, back to back.
pub fn coincident() -> Assembly {
    let mut scene = Assembly::default();
    let white = white(&mut scene, false);
    scene.part("floor", floor(2.0, STEPS), white, None);
    let decal = rectangle(DVec3::new(-0.8, 0.0, 0.45), DVec3::Z * 0.4, DVec3::X * 0.5, [3; 2]);
    scene.part("in_the_floor", decal, white, None);
    scene.part("wide_box", block([-0.7, 0.0, -0.5], [0.1, 0.3, 0.1], [4, 2, 3]), white, None);
    scene.part("narrow_box", block([-0.2, 0.0, -0.35], [0.7, 0.3, -0.05], [4, 2, 2]), white, None);
    let sheet = rectangle(DVec3::new(0.2, 0.0, 0.6), DVec3::X * 0.6, DVec3::Y * 0.4, [4; 2]);
    scene.part("back_to_back", sheet.clone().and(sheet.flipped()), white, None);
    sun(&mut scene, 10_000.0, Vec3::new(0.4, 1.0, 0.9));
    scene
}

/// A part at -x and its mirror image at +x, made by a node that scales by -1, under a sun from the front.
pub fn mirrored() -> Assembly {
    let mut scene = Assembly::default();
    let white = white(&mut scene, false);
    scene.part("floor", floor(2.0, STEPS), white, None);
    let part = block([-0.8, 0.0, -0.3], [-0.2, 0.1, 0.3], [6, 1, 6])
        .and(block([-0.8, 0.1, -0.3], [-0.6, 0.5, 0.3], [2, 4, 6]))
        .and(ball(0.12, 3).moved(DVec3::new(-0.38, 0.22, 0.0)));
    let part = scene.mesh("part", part, white);
    scene.node("as_it_is", Some(part), None, Place::default());
    let mirror = Place { scale: Vec3::new(-1.0, 1.0, 1.0), ..Place::default() };
    scene.node("mirrored", Some(part), None, mirror);
    sun(&mut scene, 10_000.0, Vec3::new(0.0, 1.0, 1.0));
    scene
}

/// Two half balls of one double-sided sheet each, open to the top with their rims at a height of 0: the one at -x has its
/// fronts inside, where it is half open everywhere; the one at +x has them outside.
pub fn open_shell() -> Assembly {
    let mut scene = Assembly::default();
    let both = white(&mut scene, true);
    let half = lower_half(&ball(0.4, 6));
    scene.part("fronts_inside", half.clone().flipped().moved(DVec3::X * -0.5), both, None);
    scene.part("fronts_outside", half.moved(DVec3::X * 0.5), both, None);
    sun(&mut scene, 10_000.0, Vec3::new(0.4, 1.0, 0.5));
    scene
}

/// The triangles below a height of 0, with their vertices.
fn lower_half(surface: &Surface) -> Surface {
    let mut half = Surface::default();
    let mut new = vec![None; surface.positions.len()];
    let is_low = |t: &&[u32; 3]| t.iter().map(|&v| surface.positions[v as usize].y).sum::<f32>() < 0.0;
    for t in surface.triangles.iter().filter(is_low) {
        half.triangles.push(t.map(|v| {
            *new[v as usize].get_or_insert_with(|| {
                half.positions.push(surface.positions[v as usize]);
                half.normals.push(surface.normals[v as usize]);
                half.positions.len() as u32 - 1
            })
        }));
    }
    half.count = half.triangles.len();
    half
}
