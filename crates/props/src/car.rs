//! A car: some hundred parts with gaps between its panels, of any number of triangles.
//!
//! Drawn with x to the front, y to the left and z up, the origin on the ground between the axles. The left half is
//! drawn and mirrored. All panels of a side lie on one surface, [`body::side`], and are cut from it with a
//! clearance of some millimetres, as in a real car.

mod body;
mod chassis;

use glam::{Quat, Vec3};

use crate::model::{Alpha, Assembly, Material, MaterialId, NodeId, Place, Surface};
use crate::seat;
use crate::shapes::{Detail, with_triangles};

/// The materials of the car.
struct Palette {
    paint: MaterialId,
    black: MaterialId,
    chrome: MaterialId,
    steel: MaterialId,
    rubber: MaterialId,
    alloy: MaterialId,
    glass: MaterialId,
    red_glass: MaterialId,
    lamp: MaterialId,
    cloth: MaterialId,
    plate: MaterialId,
}

impl Palette {
    fn new(scene: &mut Assembly) -> Self {
        let mut add = |name, color, metallic, roughness| {
            scene.material(Material::new(name, color, metallic, roughness))
        };
        let paint = add("paint", [0.32, 0.02, 0.03], 0.3, 0.35);
        let black = add("black_plastic", [0.02, 0.02, 0.022], 0.0, 0.6);
        let chrome = add("chrome", [0.8, 0.8, 0.8], 1.0, 0.1);
        let steel = add("steel", [0.3, 0.3, 0.31], 1.0, 0.5);
        let rubber = add("rubber", [0.015, 0.015, 0.015], 0.0, 0.9);
        let alloy = add("alloy", [0.6, 0.61, 0.63], 1.0, 0.3);
        let lamp = add("lamp", [0.9, 0.9, 0.88], 0.0, 0.3);
        let cloth = add("cloth", [0.08, 0.075, 0.07], 0.0, 0.95);
        let plate = add("plate", [0.75, 0.75, 0.7], 0.0, 0.6);
        let mut glass = |name, color| {
            let mut m = Material::new(name, [0.0; 3], 0.0, 0.05);
            m.color = color;
            m.alpha = Alpha::Blend;
            scene.material(m)
        };
        let clear = glass("glass", [0.55, 0.62, 0.6, 0.25]);
        let red_glass = glass("red_glass", [0.5, 0.01, 0.01, 0.6]);
        Self { paint, black, chrome, steel, rubber, alloy, glass: clear, red_glass, lamp, cloth, plate }
    }
}

/// A car of about `triangles` triangles, counted as drawn: its wheels and seats are instances.
pub fn car(triangles: usize) -> Assembly {
    with_triangles(triangles, build)
}

fn build(detail: &Detail) -> Assembly {
    let mut builder = Builder::new(*detail);
    body::panels(&mut builder);
    body::glass(&mut builder);
    body::lamps(&mut builder);
    body::trim(&mut builder);
    chassis::wheels(&mut builder);
    chassis::underbody(&mut builder);
    chassis::cabin(&mut builder);
    seats(&mut builder);
    builder.scene
}

/// The scene in the making; shapes come in the car's frame and are turned y up here.
struct Builder {
    scene: Assembly,
    detail: Detail,
    is: Palette,
    root: NodeId,
    group: NodeId,
}

impl Builder {
    fn new(detail: Detail) -> Self {
        let mut scene = Assembly::default();
        let is = Palette::new(&mut scene);
        let root = scene.node("car", None, None, Place::default());
        Self { scene, detail, is, root, group: root }
    }

    /// What follows hangs on a new node.
    fn group(&mut self, name: &str) {
        self.group = self.scene.node(name, None, Some(self.root), Place::default());
    }

    fn add(&mut self, name: &str, surface: Surface, material: MaterialId) {
        self.scene.part(name, surface.upright(), material, Some(self.group));
    }

    /// Adds a part of the left half and its mirror image.
    fn pair(&mut self, name: &str, surface: Surface, material: MaterialId) {
        self.add(&format!("{name}_right"), surface.clone().mirrored(1), material);
        self.add(&format!("{name}_left"), surface, material);
    }
}

/// Four seats that share their meshes.
fn seats(b: &mut Builder) {
    let detail = Detail { per_metre: b.detail.per_metre * 0.7, ..b.detail };
    let materials = seat::materials(&mut b.scene);
    let parts: Vec<_> = seat::parts(&detail)
        .into_iter()
        .map(|p| {
            let mesh = b.scene.mesh(p.name.clone(), p.surface, materials[p.stuff as usize]);
            (p.name, mesh, p.in_back)
        })
        .collect();
    for (name, x, z) in [
        ("seat_driver", 0.37, 0.18),
        ("seat_passenger", -0.37, 0.18),
        ("seat_rear_left", 0.34, -0.68),
        ("seat_rear_right", -0.34, -0.68),
    ] {
        let place = Place { scale: Vec3::splat(0.86), ..Place::at(x, 0.235, z) };
        let root = b.scene.node(name, None, Some(b.root), place);
        let back = b.scene.node(format!("{name}_backrest"), None, Some(root), seat::hinge());
        for (part, mesh, in_back) in &parts {
            let parent = if *in_back { back } else { root };
            b.scene.node(format!("{name}_{part}"), Some(*mesh), Some(parent), Place::default());
        }
    }
}

/// Turns an axis along z to point left, as lathes for wheels need it.
fn axle() -> Quat {
    Quat::from_rotation_x(-std::f32::consts::FRAC_PI_2)
}
