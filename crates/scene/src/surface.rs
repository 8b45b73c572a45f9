//! Surfaces as a path tracer asks for them: what a point reflects, emits and lets through.
//!
//! With [`ReadOptions::surfaces`](crate::ReadOptions::surfaces) textures and vertex colors are looked up;
//! without, factors alone are. All values are linear; nothing here depends on directions:
//!
//! - Bounced light is diffuse, with the base color, for metals as well: what a metal reflects is tinted by its
//!   base color as what a dielectric scatters is, and a bake that took metals for black would lose the light
//!   around chrome and brass. Deviation from glTF 2.0, appendix B: no Fresnel term, no gloss.
//! - KHR_materials_unlit shows its color whatever the light. Its color is taken for albedo, and it emits nothing.
//! - Light that passes goes straight on, tinted by the base color, wherever it comes from: no refraction, and no
//!   KHR_materials_volume. The metallic share of a surface, which glTF keeps from transmitting, is not looked at.

use glam::Vec3;
use rayon::prelude::*;

use crate::images::{Colors, Plane, Sampled};
use crate::lookup::{Lookup, Point};
use crate::material::Material;
use crate::scene::Scene;

/// No surface reflects more than this share of the light: a closed room of white walls needs an end.
pub const MAX_ALBEDO: f32 = 0.95;

/// Lookups along each side of a triangle when its mean emission is taken, at most.
const EMISSION_STEPS: f32 = 16.0;

/// A triangle that emits light.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EmissiveTriangle {
    /// Number of the part.
    pub part: u32,
    /// Number of the triangle within the part.
    pub triangle: u32,
    /// Mean of [`Scene::triangle_emission`] over its area, cd/m², about: for choosing among triangles.
    pub mean_emission: [f32; 3],
}

/// What a point of a triangle looks like: its material after all textures and vertex colors.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Finish {
    /// Linear RGB, 0..=1.
    pub base_color: [f32; 3],
    /// 0 for dielectrics, 1 for metals.
    pub metallic: f32,
    /// 0 for mirrors, 1 for what has no gloss.
    pub roughness: f32,
    /// What the occlusion texture leaves of light from all around, 0..=1.
    pub occlusion: f32,
    /// Share that is not a hole, 0..=1.
    pub covered: f32,
    /// Share of the light on the covered part that passes through, 0..=1.
    pub passes: f32,
    /// KHR_materials_unlit: shows its color whatever the light.
    pub unlit: bool,
}

impl Scene {
    /// What a point of a triangle looks like; white without a material. Emission is [`Self::triangle_emission`].
    ///
    /// - `barycentric`: weights of the second and third corner
    ///
    /// Deviation from KHR_materials_pbrSpecularGlossiness: its specular color and its texture are not looked at.
    pub fn triangle_finish(&self, part: usize, triangle: usize, barycentric: [f32; 2]) -> Finish {
        let (material, lookup) = self.surface(part, triangle);
        let point = Point::new(self.gltf_corners(part, triangle), barycentric);
        let base_color = base_color(material, lookup, &point).clamp(Vec3::ZERO, Vec3::ONE).to_array();
        let plain = Finish {
            base_color,
            metallic: 0.0,
            roughness: 1.0,
            occlusion: 1.0,
            covered: 1.0,
            passes: 0.0,
            unlit: false,
        };
        material.map_or(plain, |material| {
            let at = |texture: &Sampled<Colors>| texture.at(point.uv(lookup.gloss.as_ref()));
            let gloss = material.gloss.as_ref().map_or(Vec3::ONE, at);
            let at = |texture: &Sampled<Plane>| texture.at(point.uv(lookup.occluded.as_ref()));
            let occluded = material.occluded.as_ref().map_or(1.0, at);
            Finish {
                base_color,
                metallic: material.metallic * gloss.z,
                roughness: material.roughness * gloss.y,
                occlusion: 1.0 + material.occlusion * (occluded - 1.0),
                covered: material.covered(point.uv(lookup.base.as_ref()), point.alpha(lookup)),
                passes: passes(material, lookup, &point),
                unlit: material.unlit,
            }
        })
    }

    /// Coverage of a point of a triangle, 0..=1: alpha of MASK and BLEND materials times what transmission does not
    /// let through; 1 for opaque ones.
    ///
    /// - `barycentric`: weights of the second and third corner
    ///
    /// Deviation: texture levels below the finest are not looked at, and transmission textures only with
    /// [`ReadOptions::surfaces`](crate::ReadOptions::surfaces).
    pub fn triangle_opacity(&self, part: usize, triangle: usize, barycentric: [f32; 2]) -> f32 {
        let (Some(material), lookup) = self.surface(part, triangle) else { return 1.0 };
        if !material.is_translucent() {
            return 1.0;
        }
        let point = Point::new(self.gltf_corners(part, triangle), barycentric);
        let covered = material.covered(point.uv(lookup.base.as_ref()), point.alpha(lookup));
        covered * (1.0 - passes(material, lookup, &point))
    }

    /// Of the light that [`Self::triangle_opacity`] keeps at a point, the share that is reflected diffusely: linear
    /// RGB, 0..=[`MAX_ALBEDO`].
    ///
    /// - `barycentric`: weights of the second and third corner
    pub fn triangle_albedo(&self, part: usize, triangle: usize, barycentric: [f32; 2]) -> [f32; 3] {
        let (material, lookup) = self.surface(part, triangle);
        let point = Point::new(self.gltf_corners(part, triangle), barycentric);
        base_color(material, lookup, &point).clamp(Vec3::ZERO, Vec3::splat(MAX_ALBEDO)).to_array()
    }

    /// Luminance that a point of a triangle's front emits (of its back too, where that is drawn): linear RGB, cd/m².
    /// Coverage is multiplied in: holes emit nothing.
    ///
    /// - `barycentric`: weights of the second and third corner
    pub fn triangle_emission(&self, part: usize, triangle: usize, barycentric: [f32; 2]) -> [f32; 3] {
        let (Some(material), lookup) = self.surface(part, triangle) else { return [0.0; 3] };
        if !material.is_emissive() {
            return [0.0; 3];
        }
        let point = Point::new(self.gltf_corners(part, triangle), barycentric);
        emission(material, lookup, &point).to_array()
    }

    /// Share of the light that passes a point straight through: linear RGB, 0..=1. Holes let all of it through;
    /// KHR_materials_transmission, with its texture, lets it through tinted by the base color. At most
    /// `1 - opacity`; what is missing to that is lost in the tint.
    ///
    /// 0 wherever [`Self::triangle_flags`] say that the triangle is not translucent.
    ///
    /// - `barycentric`: weights of the second and third corner
    pub fn triangle_transmission(&self, part: usize, triangle: usize, barycentric: [f32; 2]) -> [f32; 3] {
        let (Some(material), lookup) = self.surface(part, triangle) else { return [0.0; 3] };
        if !material.is_translucent() {
            return [0.0; 3];
        }
        let point = Point::new(self.gltf_corners(part, triangle), barycentric);
        let covered = material.covered(point.uv(lookup.base.as_ref()), point.alpha(lookup));
        let passes = passes(material, lookup, &point);
        let tinted =
            if passes > 0.0 { base_color(Some(material), lookup, &point) * passes } else { Vec3::ZERO };
        (Vec3::splat(1.0 - covered) + covered * tinted).clamp(Vec3::ZERO, Vec3::ONE).to_array()
    }

    /// The triangles that emit light, in order of parts and triangles.
    ///
    /// Emissive textures are averaged over each triangle by lookups at about each of their texels, at most 256 a
    /// triangle; triangles where all of these are black are left out. A spot of light between the lookups of a
    /// large triangle may be missed: [`Self::triangle_emission`] knows of it nevertheless.
    pub fn emissive_triangles(&self) -> Vec<EmissiveTriangle> {
        let mut out = Vec::new();
        for (number, part) in self.parts.iter().enumerate() {
            let emits = |m: &Option<usize>| m.is_some_and(|m| self.materials[m].is_emissive());
            if !part.primitive_materials.iter().any(emits) {
                continue;
            }
            let found = (0..part.triangles.len()).into_par_iter().filter_map(|triangle| {
                let (material, lookup) = self.surface(number, triangle);
                let material = material.filter(|m| m.is_emissive())?;
                let mean = mean_emission(material, lookup, self.gltf_corners(number, triangle));
                let (part, triangle) = (number as u32, triangle as u32);
                let listed = EmissiveTriangle { part, triangle, mean_emission: mean.to_array() };
                (mean.max_element() > 0.0).then_some(listed)
            });
            out.par_extend(found);
        }
        out
    }

    /// The material of a triangle and the attributes by which it is looked up.
    fn surface(&self, part: usize, triangle: usize) -> (Option<&Material>, &Lookup) {
        let primitive = self.parts[part].triangle_primitives[triangle] as usize;
        let material = self.parts[part].primitive_materials[primitive].map(|m| &self.materials[m]);
        (material, &self.sources[part].lookups[primitive])
    }
}

/// Base color, linear, 0..=1; white without a material.
fn base_color(material: Option<&Material>, lookup: &Lookup, point: &Point) -> Vec3 {
    let own = match material {
        Some(Material { base: Some(texture), base_color, .. }) => {
            Vec3::from_array(*base_color) * texture.at(point.uv(lookup.base.as_ref()))
        }
        Some(material) => Vec3::from_array(material.base_color),
        None => Vec3::ONE,
    };
    own * point.color(lookup)
}

/// Share of the light on the covered part that the material lets through, before it is tinted.
fn passes(material: &Material, lookup: &Lookup, point: &Point) -> f32 {
    let texel = || material.passes.as_ref().map_or(1.0, |t| t.at(point.uv(lookup.passes.as_ref())));
    if material.transmission > 0.0 { material.transmission * texel() } else { 0.0 }
}

fn emission(material: &Material, lookup: &Lookup, point: &Point) -> Vec3 {
    let texel = material.glow.as_ref().map_or(Vec3::ONE, |t| t.at(point.uv(lookup.glow.as_ref())));
    let covered = material.covered(point.uv(lookup.base.as_ref()), point.alpha(lookup));
    Vec3::from_array(material.emission) * texel * covered
}

fn mean_emission(material: &Material, lookup: &Lookup, corners: [u32; 3]) -> Vec3 {
    let texels = match (&material.glow, &lookup.glow) {
        (Some(texture), Some(uv)) => texture.texels(corners.map(|v| uv[v as usize])),
        _ => 1.0,
    };
    // Alpha has a finer texture than emission, and needs it less.
    let holes = if material.is_translucent() { 16.0 } else { 1.0 };
    let steps = texels.max(holes).sqrt().ceil().clamp(1.0, EMISSION_STEPS) as u32;
    // The centroids of steps² small triangles of the same area.
    let mut sum = Vec3::ZERO;
    let step = 1.0 / steps as f32;
    for i in 0..steps {
        for j in 0..steps - i {
            let [x, y] = [i as f32, j as f32];
            sum += emission(
                material,
                lookup,
                &Point::new(corners, [(x + 1.0 / 3.0) * step, (y + 1.0 / 3.0) * step]),
            );
            if i + j + 1 < steps {
                let at = [(x + 2.0 / 3.0) * step, (y + 2.0 / 3.0) * step];
                sum += emission(material, lookup, &Point::new(corners, at));
            }
        }
    }
    sum / (steps * steps) as f32
}
