//! The light of one pool: splitting its vertices where needed, decompressing what must change, and adding the
//! attributes of the layers and the fallback.

use std::collections::BTreeMap;

use serde_json::{Map, Value, json};

use crate::accessor::{Component, layout};
use crate::baked::{Fallback, Pairs};
use crate::document::{MESHOPT, array, extension, index, list, object, whole};
use crate::draco::DRACO;
use crate::error::SceneError;
use crate::geometry::attribute;
use crate::lightmap::{COLOR, EXTENSION, ORIGINAL_COLOR, attribute_name};
use crate::materials::{TEXCOORD, texcoord_sets};
use crate::profile::Profile;
use crate::split::{Split, split};
use crate::undo::remove_extension;
use crate::write::{PartWritten, Patch, Purpose};

impl<'a> Patch<'a> {
    /// Appends bytes for a purpose; returns the view and the offset in it.
    pub(crate) fn append(&mut self, purpose: Purpose, bytes: &[u8]) -> (usize, usize) {
        let at = match self.views.iter().position(|(p, _)| *p == purpose) {
            Some(at) => at,
            None => {
                self.views.push((purpose, Vec::new()));
                self.views.len() - 1
            }
        };
        let data = &mut self.views[at].1;
        let offset = data.len();
        data.extend_from_slice(bytes);
        (self.first_view + at, offset)
    }

    fn new_accessor(&mut self, purpose: Purpose, bytes: &[u8], mut json: Value) -> usize {
        let (view, offset) = self.append(purpose, bytes);
        let map = object(&mut json);
        for key in ["bufferView", "byteOffset", "sparse"] {
            map.shift_remove(key);
        }
        let mut out = Map::new();
        out.insert("bufferView".to_owned(), view.into());
        if offset > 0 {
            out.insert("byteOffset".to_owned(), offset.into());
        }
        out.append(map);
        let accessors = array(&mut self.root, "accessors");
        accessors.push(Value::Object(out));
        accessors.len() - 1
    }

    /// Puts the light of a part onto its primitives, if it has any.
    pub(crate) fn part(&mut self, number: usize) -> Result<(), SceneError> {
        let (part, source) = (&self.scene.parts[number], &self.scene.sources[number]);
        let light = &self.light.parts[number];
        if !light.is_lit() {
            self.written.parts.push(PartWritten::default());
            return Ok(());
        }
        let corners = (0..part.triangles.len()).map(|t| self.scene.gltf_corners(number, t));
        let split = split(source.vertices, corners, &light.corner_codes, &light.corner_fallback);
        let first = self.primitive(part.mesh, part.primitives[0]).clone();
        let original_color =
            attribute(self.document, &first, COLOR)?.filter(|_| self.light.fallback == Fallback::Color0);
        let original_stride = self.stride(&first)?;
        if split.added.is_empty() {
            self.draco_to_plain(number)?;
        } else {
            self.split_pool(number, &first, &split)?;
        }
        let profile = self.light.profile;
        let names = self.attribute_names(&first, split.codes.len());
        let mut codes = Vec::with_capacity(split.codes.len());
        for (layer, of_layer) in split.codes.iter().enumerate() {
            let pairs = self.light.pairs.as_ref().filter(|_| profile == Profile::Texcoord);
            let (bytes, component): (Vec<u8>, _) = match pairs {
                Some(Pairs(pair)) => {
                    (of_layer.iter().flat_map(|&c| pair(layer, c)).flat_map(f32::to_le_bytes).collect(), 5126)
                }
                None => (of_layer.iter().flatten().flat_map(|c| c.to_le_bytes()).collect(), 5123),
            };
            self.written.light_bytes += bytes.len() as u64;
            self.written.layers[layer].attribute_bytes += bytes.len() as u64;
            let mut template = json!({"componentType": component, "count": of_layer.len(), "type": "VEC2"});
            if profile.is_plain() {
                template["normalized"] = true.into();
            }
            let purpose = Purpose::Light { layer, stride: profile.stride() };
            codes.push(self.new_accessor(purpose, &bytes, template));
        }
        let color = match self.light.fallback {
            Fallback::Color0 => Some(self.fallback(&split, original_color)?),
            Fallback::None => None,
        };
        for &primitive in &part.primitives {
            let json = &mut array(&mut array(&mut self.root, "meshes")[self.mesh_of[number]], "primitives")
                [primitive];
            let attributes = object(object(json).entry("attributes").or_insert(Value::Null));
            let mut ours = Map::new();
            ours.insert("attributes".to_owned(), names.clone().into());
            if let Some((color, _)) = color {
                if let Some(original) = attributes.insert(COLOR.to_owned(), color.into()) {
                    attributes.insert(ORIGINAL_COLOR.to_owned(), original);
                    ours.insert("color0".to_owned(), ORIGINAL_COLOR.into());
                }
                ours.insert("fallback".to_owned(), COLOR.into());
            }
            for (name, &accessor) in names.iter().zip(&codes) {
                attributes.insert(name.clone(), accessor.into());
            }
            let extensions = object(object(json).entry("extensions").or_insert(Value::Null));
            extensions.insert(EXTENSION.to_owned(), Value::Object(ours));
        }
        self.written.parts.push(PartWritten {
            original_vertices: source.vertices,
            added_vertices: split.added.len(),
            original_stride,
            stride: original_stride + profile.stride() * codes.len() + if color.is_some() { 4 } else { 0 },
        });
        Ok(())
    }

    /// The attributes with the light of a primitive: our own, or the sets of texture coordinates after its last.
    fn attribute_names(&self, primitive: &Value, count: usize) -> Vec<String> {
        if self.light.profile == Profile::Eta {
            return (0..count).map(attribute_name).collect();
        }
        let first = texcoord_sets(primitive);
        (first..first + count).map(|set| format!("{TEXCOORD}{set}")).collect()
    }

    fn primitive(&self, mesh: usize, primitive: usize) -> &'a Value {
        &list(&self.document.list("meshes")[mesh], "primitives")[primitive]
    }

    /// Every accessor of a vertex: attributes, then morph targets.
    fn vertex_accessors(primitive: &Value) -> Vec<usize> {
        let objects = primitive.get("attributes").into_iter().chain(list(primitive, "targets"));
        let numbers = objects.filter_map(Value::as_object).flat_map(Map::values);
        numbers.filter_map(whole).map(|n| n as usize).collect()
    }

    fn stride(&self, primitive: &Value) -> Result<usize, SceneError> {
        let accessors = self.document.list("accessors");
        Self::vertex_accessors(primitive).iter().map(|&a| Ok(layout(&accessors[a])?.size)).sum()
    }

    /// The bytes of an accessor's elements at a stride of a multiple of four, followed by copies of some.
    fn packed(&self, accessor: usize, added: &[u32]) -> Result<(Vec<u8>, usize), SceneError> {
        let elements = self.document.elements(accessor)?;
        let stride = elements.layout.size.next_multiple_of(4);
        let mut bytes = Vec::with_capacity((elements.count() + added.len()) * stride);
        for v in (0..elements.count()).chain(added.iter().map(|&v| v as usize)) {
            bytes.extend_from_slice(elements.raw(v));
            bytes.resize(bytes.len().next_multiple_of(4), 0);
        }
        Ok((bytes, stride))
    }

    /// Writes out what Draco decoded for a part whose vertices stay as they are.
    fn draco_to_plain(&mut self, number: usize) -> Result<(), SceneError> {
        let part = &self.scene.parts[number];
        for &primitive in &part.primitives {
            let json = self.primitive(part.mesh, primitive);
            if extension(json, DRACO).is_none() {
                continue;
            }
            self.leave_draco(number, primitive);
            for accessor in Self::vertex_accessors(json) {
                if self.document.decoded.contains_key(&accessor) && self.plain.insert(accessor, ()).is_none()
                {
                    let (bytes, stride) = self.packed(accessor, &[])?;
                    self.make_plain(accessor, Purpose::Vertices { stride }, &bytes)?;
                }
            }
            if let Some(accessor) = index(json, "indices", self.document.list("accessors").len())?
                && let Some(bytes) = self.document.decoded.get(&accessor)
                && self.plain.insert(accessor, ()).is_none()
            {
                let size = layout(&self.document.list("accessors")[accessor])?.size;
                self.make_plain(accessor, Purpose::Indices { size }, bytes)?;
            }
        }
        Ok(())
    }

    fn leave_draco(&mut self, number: usize, primitive: usize) {
        let mesh = &mut array(&mut self.root, "meshes")[self.mesh_of[number]];
        remove_extension(&mut array(mesh, "primitives")[primitive], DRACO);
        self.written.plain_draco += 1;
    }

    /// Gives an accessor without data a view.
    fn make_plain(&mut self, accessor: usize, purpose: Purpose, bytes: &[u8]) -> Result<(), SceneError> {
        let (view, offset) = self.append(purpose, bytes);
        self.written.geometry_bytes += bytes.len() as u64;
        let bounds = self.bounds(accessor)?;
        let json = object(&mut array(&mut self.root, "accessors")[accessor]);
        json.insert("bufferView".to_owned(), view.into());
        json.insert("byteOffset".to_owned(), offset.into());
        set_bounds(json, bounds);
        Ok(())
    }

    /// The true bounds of a Draco accessor: the file states those from before quantization.
    fn bounds(&self, accessor: usize) -> Result<Option<[Vec<f64>; 2]>, SceneError> {
        if !self.document.decoded.contains_key(&accessor) {
            return Ok(None);
        }
        let elements = self.document.elements(accessor)?;
        let width = elements.layout.width;
        let [mut low, mut high] = [vec![f64::INFINITY; width], vec![f64::NEG_INFINITY; width]];
        for v in 0..elements.count() {
            for (c, (low, high)) in low.iter_mut().zip(&mut high).enumerate() {
                // Bounds are stated before normalization.
                let x = match elements.layout.component {
                    Component::F32 => f64::from(elements.f32(v, c)),
                    Component::I8 | Component::I16 => f64::from(elements.u32(v, c) as i32),
                    _ => f64::from(elements.u32(v, c)),
                };
                (*low, *high) = (low.min(x), high.max(x));
            }
        }
        Ok(Some([low, high]).filter(|b| b.iter().flatten().all(|x| x.is_finite())))
    }

    /// Gives a part's pool accessors of its own, with the added vertices at their ends.
    fn split_pool(&mut self, number: usize, first: &Value, split: &Split) -> Result<(), SceneError> {
        let part = &self.scene.parts[number];
        let mut renamed: BTreeMap<usize, usize> = BTreeMap::new();
        let views = self.document.list("bufferViews");
        let mut compressed = false;
        for old in Self::vertex_accessors(first) {
            if renamed.contains_key(&old) {
                continue;
            }
            let mut json = self.document.list("accessors")[old].clone();
            let view = index(&json, "bufferView", views.len())?;
            compressed |= view.is_some_and(|v| MESHOPT.iter().any(|m| extension(&views[v], m).is_some()));
            let (bytes, stride) = self.packed(old, &split.added)?;
            self.written.geometry_bytes += bytes.len() as u64;
            let bounds = self.bounds(old)?;
            let count = bytes.len() / stride.max(1);
            let map = object(&mut json);
            map.insert("count".to_owned(), count.into());
            set_bounds(map, bounds);
            renamed.insert(old, self.new_accessor(Purpose::Vertices { stride }, &bytes, json));
        }
        self.written.plain_meshopt += usize::from(compressed);
        let mut start = 0;
        for (local, &primitive) in part.primitives.iter().enumerate() {
            let end =
                start + part.triangle_primitives[start..].iter().take_while(|&&p| p == local as u32).count();
            let indices = self.split_indices(number, primitive, split, start..end)?;
            if extension(self.primitive(part.mesh, primitive), DRACO).is_some() {
                self.leave_draco(number, primitive);
            }
            let mesh = &mut array(&mut self.root, "meshes")[self.mesh_of[number]];
            let json = object(&mut array(mesh, "primitives")[primitive]);
            let rename = |v: &mut Value| {
                if let Some(new) = whole(v).and_then(|n| renamed.get(&(n as usize))) {
                    *v = (*new).into();
                }
            };
            if let Some(attributes) = json.get_mut("attributes").and_then(Value::as_object_mut) {
                attributes.values_mut().for_each(rename);
            }
            for target in json.get_mut("targets").and_then(Value::as_array_mut).into_iter().flatten() {
                target.as_object_mut().into_iter().flat_map(Map::values_mut).for_each(rename);
            }
            if let Some(indices) = indices {
                json.insert("indices".to_owned(), indices.into());
                if json.get("mode").is_some_and(|m| whole(m) != Some(4)) {
                    json.insert("mode".to_owned(), 4.into());
                }
            }
            start = end;
        }
        Ok(())
    }

    /// New indices of a primitive, or `None` where its own stay right.
    fn split_indices(
        &mut self,
        number: usize,
        primitive: usize,
        split: &Split,
        triangles: std::ops::Range<usize>,
    ) -> Result<Option<usize>, SceneError> {
        let (part, source) = (&self.scene.parts[number], &self.scene.sources[number]);
        let json = self.primitive(part.mesh, primitive);
        let accessors = self.document.list("accessors");
        let old = index(json, "indices", accessors.len())?;
        let changed = triangles.clone().any(|t| split.corners[t] != self.scene.gltf_corners(number, t));
        // Draco indices have no view of their own; without indices, the count of vertices is that of corners.
        if let Some(old) = old
            && !changed
            && !self.document.decoded.contains_key(&old)
        {
            return Ok(None);
        }
        let largest = split.corners[triangles.clone()].iter().flatten().copied().max().unwrap_or(0);
        let before = match old {
            Some(old) => layout(&accessors[old])?.component,
            None => Component::U16,
        };
        // The largest value of each type restarts primitives and cannot be used.
        let component = match before {
            Component::U8 if largest < 255 => Component::U8,
            Component::U8 | Component::U16 if largest < 65535 => Component::U16,
            _ => Component::U32,
        };
        let mut bytes = Vec::with_capacity(triangles.len() * 3 * component.size());
        for t in triangles.clone() {
            let [a, b, c] = split.corners[t];
            for v in if source.mirrored { [a, c, b] } else { [a, b, c] } {
                bytes.extend_from_slice(&v.to_le_bytes()[..component.size()]);
            }
        }
        self.written.geometry_bytes += bytes.len() as u64;
        let code = match component {
            Component::U8 => 5121,
            Component::U16 => 5123,
            _ => 5125,
        };
        let template = json!({"componentType": code, "count": triangles.len() * 3, "type": "SCALAR"});
        Ok(Some(self.new_accessor(Purpose::Indices { size: component.size() }, &bytes, template)))
    }

    /// The fallback `COLOR_0` of a part: the light times the color that was there. Returns accessor and width.
    fn fallback(&mut self, split: &Split, original: Option<usize>) -> Result<(usize, usize), SceneError> {
        let colors = original.map(|a| self.document.elements(a)).transpose()?;
        let width = colors.as_ref().map_or(3, |c| c.layout.width.clamp(3, 4));
        let byte = |v: f32| (v.clamp(0.0, 1.0) * 255.0).round() as u8;
        let mut bytes = Vec::with_capacity(split.fallback.len() * 4);
        let originals = split.fallback.len() - split.added.len();
        for (v, light) in split.fallback.iter().enumerate() {
            let from = if v < originals { v } else { split.added[v - originals] as usize };
            let color = |c: usize| match &colors {
                Some(colors) if c < colors.layout.width => {
                    Some(colors.f32(from, c)).filter(|x| x.is_finite()).unwrap_or(1.0)
                }
                _ => 1.0,
            };
            (0..3).for_each(|c| bytes.push(byte(light[c] * color(c))));
            bytes.push(if width == 4 { byte(color(3)) } else { 0 });
        }
        self.written.fallback_bytes += bytes.len() as u64;
        let kind = if width == 4 { "VEC4" } else { "VEC3" };
        let template =
            json!({"componentType": 5121, "normalized": true, "count": split.fallback.len(), "type": kind});
        Ok((self.new_accessor(Purpose::Fallback, &bytes, template), width))
    }
}

fn set_bounds(json: &mut Map<String, Value>, bounds: Option<[Vec<f64>; 2]>) {
    let Some([low, high]) = bounds else { return };
    for (key, values) in [("min", low), ("max", high)] {
        if json.contains_key(key) {
            json.insert(key.to_owned(), values.into());
        }
    }
}
