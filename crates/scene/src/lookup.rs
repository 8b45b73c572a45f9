//! Vertex attributes by which surfaces are looked up: texture coordinates and vertex colors, read once each.

use std::collections::BTreeMap;
use std::sync::Arc;

use glam::Vec3;
use serde_json::Value;

use crate::document::Document;
use crate::error::SceneError;
use crate::geometry::{attribute, open};
use crate::material::Material;

/// What is needed to look up a primitive's surface, per glTF vertex of its pool. Sets that are not there, or that
/// nobody asks for, are `None`.
#[derive(Clone, Debug, Default)]
pub(crate) struct Lookup {
    /// For base color and coverage.
    pub base: Option<Coordinates>,
    pub glow: Option<Coordinates>,
    pub passes: Option<Coordinates>,
    pub gloss: Option<Coordinates>,
    pub occluded: Option<Coordinates>,
    pub color: Option<Arc<Vec<[u16; 3]>>>,
    pub alpha: Option<Arc<Vec<f32>>>,
}

type Coordinates = Arc<Vec<[f32; 2]>>;

/// A point of a triangle: its glTF vertices and their weights.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Point {
    pub corners: [usize; 3],
    pub weights: [f32; 3],
}

impl Point {
    /// - `barycentric`: weights of the second and third corner
    pub fn new(corners: [u32; 3], [v, w]: [f32; 2]) -> Self {
        Self { corners: corners.map(|c| c as usize), weights: [1.0 - v - w, v, w] }
    }

    /// Texture coordinates; (0, 0) where a primitive has none, as GPUs show it.
    pub fn uv(&self, set: Option<&Coordinates>) -> [f32; 2] {
        let Some(set) = set else { return [0.0; 2] };
        let [a, b, c] = self.corners.map(|v| set[v]);
        let [u, v, w] = self.weights;
        [0, 1].map(|k| u * a[k] + v * b[k] + w * c[k])
    }

    /// Alpha of the vertex colors, 1 where there are none.
    pub fn alpha(&self, lookup: &Lookup) -> f32 {
        let Some(alpha) = &lookup.alpha else { return 1.0 };
        let [a, b, c] = self.corners.map(|v| alpha[v]);
        let [u, v, w] = self.weights;
        u * a + v * b + w * c
    }

    /// Vertex color, linear, 1 where there is none.
    pub fn color(&self, lookup: &Lookup) -> Vec3 {
        let Some(colors) = &lookup.color else { return Vec3::ONE };
        let [a, b, c] = self.corners.map(|v| Vec3::from_array(colors[v].map(|c| f32::from(c) / 65535.0)));
        let [u, v, w] = self.weights;
        u * a + v * b + w * c
    }
}

/// Attributes that were read, by accessor: primitives share them.
#[derive(Debug, Default)]
pub(crate) struct Attributes {
    coordinates: BTreeMap<usize, Coordinates>,
    colors: BTreeMap<usize, Arc<Vec<[u16; 3]>>>,
    alphas: BTreeMap<usize, Arc<Vec<f32>>>,
}

impl Attributes {
    /// What a primitive of a material needs. Vertex colors matter wherever surfaces do.
    pub fn lookup(
        &mut self,
        document: &Document,
        primitive: &Value,
        material: Option<&Material>,
        vertices: usize,
        surfaces: bool,
    ) -> Result<Lookup, SceneError> {
        let mut out = Lookup::default();
        if let Some(m) = material {
            let base = m.base.as_ref().map(|t| &t.mapping).or(m.coverage.as_ref().map(|t| &t.mapping));
            let mut read = |set: Option<u64>| match set {
                Some(set) => self.coordinates(document, primitive, set, vertices),
                None => Ok(None),
            };
            out.base = read(base.map(|m| m.set))?;
            out.glow = read(m.glow.as_ref().map(|t| t.mapping.set))?;
            out.passes = read(m.passes.as_ref().map(|t| t.mapping.set))?;
            out.gloss = read(m.gloss.as_ref().map(|t| t.mapping.set))?;
            out.occluded = read(m.occluded.as_ref().map(|t| t.mapping.set))?;
        }
        let covers = material.is_some_and(Material::is_translucent);
        let Some(accessor) = attribute(document, primitive, "COLOR_0")?.filter(|_| covers || surfaces) else {
            return Ok(out);
        };
        let elements = open(document, accessor, "COLOR_0", 3..=4, Some(vertices))?;
        let unit =
            |v, c| Some(elements.f32(v, c)).filter(|x| x.is_finite()).map_or(1.0, |x| x.clamp(0.0, 1.0));
        if covers && elements.layout.width == 4 {
            let read = || Arc::new((0..vertices).map(|v| unit(v, 3)).collect());
            out.alpha = Some(Arc::clone(self.alphas.entry(accessor).or_insert_with(read)));
        }
        if surfaces {
            let rgb = |v| [0, 1, 2].map(|c| (unit(v, c) * 65535.0).round() as u16);
            let read = || Arc::new((0..vertices).map(rgb).collect());
            out.color = Some(Arc::clone(self.colors.entry(accessor).or_insert_with(read)));
        }
        Ok(out)
    }

    fn coordinates(
        &mut self,
        document: &Document,
        primitive: &Value,
        set: u64,
        vertices: usize,
    ) -> Result<Option<Coordinates>, SceneError> {
        let semantic = format!("TEXCOORD_{set}");
        let Some(accessor) = attribute(document, primitive, &semantic)? else { return Ok(None) };
        // Opened even when it is known: another primitive may have another number of vertices.
        let elements = open(document, accessor, &semantic, 2..=2, Some(vertices))?;
        let read = || Arc::new((0..vertices).map(|v| elements.floats(v)).collect());
        Ok(Some(Arc::clone(self.coordinates.entry(accessor).or_insert_with(read))))
    }
}
