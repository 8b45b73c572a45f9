//! What a baked file shows, read back as a viewer shows it.

use std::path::Path;

use glam::Vec3;
use lightkiln_bake::{FileLight, Opened, Opening};
use lightkiln_mesh::{SurfacePoint, random};

/// A point of the surface and its light.
#[derive(Debug)]
pub struct Shown {
    /// The node that draws it.
    pub node: String,
    /// Where it is.
    pub place: Vec3,
    /// Where its triangle faces.
    pub facing: Vec3,
    /// Its shading normal.
    pub normal: Vec3,
    /// All channels of all layers, in their units.
    pub values: Vec<f32>,
}

/// The light in the middle of every triangle that has any.
pub fn shown(path: &Path) -> Vec<Shown> {
    shown_at(path, 1)
}

/// The light at some points of every triangle that has any: the first of them is its middle.
pub fn shown_at(path: &Path, points: u32) -> Vec<Shown> {
    let opened =
        Opened::read(path, Opening { needs_light: true, ..Opening::default() }).expect("a baked file");
    let surface = opened.scenery.surface("out.glb", &opened.options).expect("a surface");
    let light = FileLight::read(&surface, "out.glb").expect("light");
    let views = light.views().expect("images");
    let mut all = Vec::new();
    for triangle in surface.mesh.triangle_ids().filter(|&t| surface.mesh.area(t) > 0.0) {
        for k in 0..points {
            let square = random::unit2(random::hash(0, triangle.0.into(), k.into(), 0));
            let barycentric = if k == 0 { [1.0 / 3.0; 2] } else { random::square_to_triangle(square) };
            let point = SurfacePoint { triangle, barycentric };
            let mut units = vec![0.0; light.layers.channels()];
            light.show(&views, point, &mut units);
            all.push(Shown {
                node: surface.scene.part_name(surface.part_of(triangle).0),
                place: surface.mesh.position(point),
                facing: surface.mesh.geometric_normal(triangle),
                normal: surface.mesh.shading_normal(point),
                values: units.iter().enumerate().map(|(c, &u)| light.layers.from_unit(c, u)).collect(),
            });
        }
    }
    all
}

/// The mean of some numbers.
pub fn mean(values: impl Iterator<Item = f32> + Clone) -> f32 {
    values.clone().sum::<f32>() / values.count() as f32
}
