//! What a bake has so far, for those who watch it: borrowed, and shown as the shader would show the file.

use lightkiln_encode::LightCode;
use lightkiln_mesh::TriangleId;

use crate::layers::Layers;
use crate::options::Plan;
use crate::rounds::Shown;
use crate::stored::Stored;
use crate::surface::Surface;

/// What the file would show if the bake ended now.
pub struct Snapshot<'a> {
    /// The welded scene.
    pub surface: &'a Surface<'a>,
    /// What is being baked.
    pub plan: &'a Plan,
    /// Its light, as soon as there is any.
    pub light: Option<SnapshotLight<'a>>,
}

/// The light of a [`Snapshot`].
pub struct SnapshotLight<'a> {
    /// What its layers are.
    pub layers: &'a Layers,
    /// Unit values of the light vertices, vertices x channels.
    pub values: &'a [f32],
    /// Charts, texels and codes, once there are any.
    pub shown: Option<&'a Shown>,
}

impl Snapshot<'_> {
    /// The codes of a triangle's corners in a layer, by its vertex values alone; none before there is light.
    pub fn vertex_codes(&self, layer: usize, triangle: TriangleId) -> Option<[LightCode; 3]> {
        let light = self.light.as_ref()?;
        let (channels, own) = (light.layers.channels(), light.layers.layers[layer].channels());
        let corner = |vertex: lightkiln_mesh::VertexId| {
            LightCode::color_of(&light.values[vertex.index() * channels..][own.clone()])
        };
        Some(self.surface.mesh.triangles[triangle.index()].map(corner))
    }

    /// The codes of a triangle's corners in a layer, as the file would have them; none before anything is encoded.
    pub fn codes(&self, layer: usize, triangle: TriangleId) -> Option<[LightCode; 3]> {
        let shown = self.light.as_ref()?.shown?;
        Some(shown.codes[layer].of_triangle(&self.surface.mesh, triangle))
    }

    /// The images of the layers, once there are any.
    pub fn stored(&self) -> Option<&Stored> {
        self.light.as_ref()?.shown.map(|shown| &shown.stored)
    }
}
