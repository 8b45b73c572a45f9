//! KHR_materials_variants: other materials for the same primitives, chosen by the name of a variant.

use std::collections::BTreeSet;

use serde_json::Value;

use crate::document::{Document, extension, index, list, name, whole};
use crate::error::SceneError;
use crate::scene::Scene;

pub(crate) const VARIANTS: &str = "KHR_materials_variants";

/// The names of a document's variants; variants without a name have an empty one.
fn names(document: &Document) -> Vec<String> {
    extension(&document.root, VARIANTS)
        .map(|e| list(e, "variants").iter().map(|v| name(v).unwrap_or_default()).collect())
        .unwrap_or_default()
}

/// The number of the variant that was asked for.
pub(crate) fn find(document: &Document, wanted: Option<&str>) -> Result<Option<usize>, SceneError> {
    let Some(wanted) = wanted else { return Ok(None) };
    let names = names(document);
    match names.iter().position(|n| n == wanted) {
        Some(found) => Ok(Some(found)),
        None => Err(SceneError::NoVariant { name: wanted.to_owned(), names, place: Box::default() }),
    }
}

/// The material of a primitive under a variant: its own when the variant says nothing of it.
pub(crate) fn material_of(
    document: &Document,
    primitive: &Value,
    variant: Option<usize>,
) -> Result<Option<usize>, SceneError> {
    let materials = document.list("materials").len();
    if let Some(variant) = variant {
        let mappings = extension(primitive, VARIANTS).map_or(&[][..], |e| list(e, "mappings"));
        let meant = |m: &&Value| list(m, "variants").iter().any(|v| whole(v) == Some(variant as u64));
        if let Some(mapping) = mappings.iter().find(meant) {
            return index(mapping, "material", materials);
        }
    }
    index(primitive, "material", materials)
}

/// Materials that some of the meshes show. What is wrong with a reference is said where the mesh is read.
pub(crate) fn used_materials(
    document: &Document,
    used_meshes: &[bool],
    variant: Option<usize>,
) -> BTreeSet<usize> {
    let meshes = document.list("meshes").iter().zip(used_meshes).filter(|(_, used)| **used);
    meshes
        .flat_map(|(mesh, _)| list(mesh, "primitives"))
        .filter_map(|p| material_of(document, p, variant).ok().flatten())
        .collect()
}

impl Scene {
    /// The names of the file's material variants, in its order; for [`crate::ReadOptions::variant`].
    pub fn variants(&self) -> Vec<String> {
        names(&self.document)
    }
}
