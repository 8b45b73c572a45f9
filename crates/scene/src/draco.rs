//! KHR_draco_mesh_compression: primitives are decoded once into plain accessor data.
//!
//! The bitstream itself is read by the `draco-core` crate (pure Rust, all prediction schemes, edgebreaker
//! standard and valence, sequential).

use std::collections::BTreeMap;

use draco_core::decode_limits::DecodeLimits;
use draco_core::draco_types::DataType;
use draco_core::geometry_attribute::PointAttribute;
use draco_core::geometry_indices::PointIndex;
use draco_core::{DecoderBuffer, Mesh, MeshDecoder};
use serde_json::Value;

use crate::accessor::{Component, layout};
use crate::document::{Document, extension, index, list, whole};
use crate::error::{SceneError, codec, reference, value};
use crate::geometry::primitive_place;

/// The extension.
pub(crate) const DRACO: &str = "KHR_draco_mesh_compression";

/// Decodes the Draco primitives of the meshes that are used.
pub(crate) fn decode_all(document: &mut Document, used: &[bool]) -> Result<(), SceneError> {
    let mut decoded = BTreeMap::new();
    let mut meshes: BTreeMap<usize, Mesh> = BTreeMap::new();
    for (number, mesh) in document.list("meshes").iter().enumerate().filter(|(m, _)| used[*m]) {
        for (p, primitive) in list(mesh, "primitives").iter().enumerate() {
            if let Some(json) = extension(primitive, DRACO) {
                decode_primitive(document, primitive, json, &mut meshes, &mut decoded).map_err(|e| {
                    e.at(|place| {
                        let accessor = place.accessor;
                        *place = primitive_place(document, number, p);
                        place.accessor = accessor;
                    })
                })?;
            }
        }
    }
    document.decoded = decoded;
    Ok(())
}

fn decode_primitive(
    document: &Document,
    primitive: &Value,
    json: &Value,
    meshes: &mut BTreeMap<usize, Mesh>,
    decoded: &mut BTreeMap<usize, Vec<u8>>,
) -> Result<(), SceneError> {
    let view = index(json, "bufferView", document.list("bufferViews").len())?
        .ok_or_else(|| value("bufferView", "missing", "the number of a view"))?;
    if let std::collections::btree_map::Entry::Vacant(entry) = meshes.entry(view) {
        entry.insert(decode(document.view(view)?)?);
    }
    let mesh = &meshes[&view];
    let none = serde_json::Map::new();
    let accessors = document.list("accessors");
    for (semantic, id) in json.get("attributes").and_then(Value::as_object).unwrap_or(&none) {
        let Some(accessor) = crate::geometry::attribute(document, primitive, semantic)? else { continue };
        let id = whole(id).and_then(|i| u32::try_from(i).ok());
        let attribute = id
            .and_then(|i| mesh.attribute_by_unique_id(i))
            .ok_or_else(|| codec("Draco", format!("there is no attribute for {semantic}")))?;
        let bytes = attribute_bytes(attribute, mesh.num_points(), &accessors[accessor])
            .map_err(|e| e.at(|p| p.accessor = Some(accessor)))?;
        decoded.insert(accessor, bytes);
    }
    let Some(accessor) = index(primitive, "indices", accessors.len())? else { return Ok(()) };
    let wanted = layout(&accessors[accessor])?;
    let indices = mesh.faces().iter().flatten().map(|p| p.0);
    if mesh.num_faces() * 3 != wanted.count {
        return Err(codec(
            "Draco",
            format!("{} indices, but the accessor has {}", mesh.num_faces() * 3, wanted.count),
        ));
    }
    let mut bytes = Vec::with_capacity(wanted.count * wanted.size);
    for i in indices {
        let fits = match wanted.component {
            Component::U8 => u8::try_from(i).map(|i| bytes.push(i)).is_ok(),
            Component::U16 => u16::try_from(i).map(|i| bytes.extend(i.to_le_bytes())).is_ok(),
            Component::U32 => {
                bytes.extend(i.to_le_bytes());
                true
            }
            _ => false,
        };
        if !fits {
            return Err(reference("indices", u64::from(i), mesh.num_points()));
        }
    }
    decoded.insert(accessor, bytes);
    Ok(())
}

fn decode(data: &[u8]) -> Result<Mesh, SceneError> {
    let mut mesh = Mesh::new();
    // A face costs at least a fraction of a bit; more than this is a header that lies.
    let most = (data.len() as u64).saturating_mul(256) + 65536;
    let limits = DecodeLimits::default().with_max_points(most).with_max_faces(most);
    let mut buffer = DecoderBuffer::new(data).with_limits(limits);
    MeshDecoder::new().decode(&mut buffer, &mut mesh).map_err(|e| codec("Draco", e.to_string()))?;
    let points = mesh.num_points();
    if let Some(bad) = mesh.faces().iter().flatten().find(|p| p.0 as usize >= points) {
        return Err(reference("a Draco face", u64::from(bad.0), points));
    }
    Ok(mesh)
}

/// The values of all points, packed as the accessor says.
fn attribute_bytes(
    attribute: &PointAttribute,
    points: usize,
    accessor: &Value,
) -> Result<Vec<u8>, SceneError> {
    let wanted = layout(accessor)?;
    if wanted.count != points {
        return Err(codec("Draco", format!("{points} points, but the accessor has {}", wanted.count)));
    }
    let same = matches!(
        (attribute.data_type(), wanted.component),
        (DataType::Int8, Component::I8)
            | (DataType::Uint8, Component::U8)
            | (DataType::Int16, Component::I16)
            | (DataType::Uint16, Component::U16)
            | (DataType::Uint32, Component::U32)
            | (DataType::Float32, Component::F32)
    );
    if !same || usize::from(attribute.num_components()) != wanted.width {
        let found = format!("{:?} x {}", attribute.data_type(), attribute.num_components());
        return Err(codec("Draco", format!("an attribute of {found} does not fit the accessor's type")));
    }
    let stride = usize::try_from(attribute.byte_stride()).unwrap_or(0);
    let data = attribute.buffer().data();
    let mut bytes = Vec::with_capacity(points * wanted.size);
    for point in 0..points {
        let at = attribute.mapped_index(PointIndex(point as u32)).0 as usize;
        let start = at.saturating_mul(stride);
        let element = data.get(start..start.saturating_add(wanted.size));
        bytes.extend_from_slice(element.ok_or_else(|| codec("Draco", "an attribute value is missing"))?);
    }
    Ok(bytes)
}
