//! Accessors: typed views of bytes, with every layout that glTF allows (interleaved, strided, sparse,
//! normalized, quantized, compressed).

use std::borrow::Cow;

use serde_json::Value;

use crate::document::{Document, index, integer};
use crate::error::{SceneError, reference, truncated, value};

/// The number type of a component.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Component {
    I8,
    U8,
    I16,
    U16,
    U32,
    F32,
}

impl Component {
    pub fn from_code(code: u64) -> Option<Self> {
        Some(match code {
            5120 => Self::I8,
            5121 => Self::U8,
            5122 => Self::I16,
            5123 => Self::U16,
            5125 => Self::U32,
            5126 => Self::F32,
            _ => return None,
        })
    }

    pub fn size(self) -> usize {
        match self {
            Self::I8 | Self::U8 => 1,
            Self::I16 | Self::U16 => 2,
            Self::U32 | Self::F32 => 4,
        }
    }
}

/// What an accessor's JSON says about one element.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Layout {
    pub component: Component,
    /// Components of an element.
    pub width: usize,
    pub normalized: bool,
    pub count: usize,
    /// Bytes of an element, with the padding that matrices of small components have.
    pub size: usize,
}

/// Elements that can be read without further checks.
#[derive(Clone, Debug)]
pub(crate) struct Elements<'a> {
    pub layout: Layout,
    bytes: Cow<'a, [u8]>,
    stride: usize,
}

impl Elements<'_> {
    pub fn count(&self) -> usize {
        self.layout.count
    }

    /// The bytes of an element.
    pub fn raw(&self, element: usize) -> &[u8] {
        &self.bytes[element * self.stride..element * self.stride + self.layout.size]
    }

    /// A component as an integer; floats are truncated.
    pub fn u32(&self, element: usize, component: usize) -> u32 {
        let size = self.layout.component.size();
        let b = &self.raw(element)[component * size..(component + 1) * size];
        match self.layout.component {
            Component::I8 => b[0] as i8 as u32,
            Component::U8 => u32::from(b[0]),
            Component::I16 => i16::from_le_bytes([b[0], b[1]]) as u32,
            Component::U16 => u32::from(u16::from_le_bytes([b[0], b[1]])),
            Component::U32 => u32::from_le_bytes([b[0], b[1], b[2], b[3]]),
            Component::F32 => f32::from_le_bytes([b[0], b[1], b[2], b[3]]) as u32,
        }
    }

    /// A component as a float; normalized integers are mapped to 0..=1 or -1..=1 (glTF 2.0, 3.6.2.2).
    #[inline]
    pub fn f32(&self, element: usize, component: usize) -> f32 {
        let size = self.layout.component.size();
        let b = &self.raw(element)[component * size..(component + 1) * size];
        let (v, one) = match self.layout.component {
            Component::F32 => return f32::from_le_bytes([b[0], b[1], b[2], b[3]]),
            Component::I8 => (f32::from(b[0] as i8), 127.0),
            Component::U8 => (f32::from(b[0]), 255.0),
            Component::I16 => (f32::from(i16::from_le_bytes([b[0], b[1]])), 32767.0),
            Component::U16 => (f32::from(u16::from_le_bytes([b[0], b[1]])), 65535.0),
            Component::U32 => (u32::from_le_bytes([b[0], b[1], b[2], b[3]]) as f32, 4_294_967_295.0),
        };
        if self.layout.normalized { (v / one).max(-1.0) } else { v }
    }

    /// The first `N` components of an element.
    #[inline]
    pub fn floats<const N: usize>(&self, element: usize) -> [f32; N] {
        std::array::from_fn(|c| self.f32(element, c))
    }
}

/// Reads what an accessor says of itself.
pub(crate) fn layout(json: &Value) -> Result<Layout, SceneError> {
    let code = integer(json, "componentType")?.unwrap_or(0);
    let component = Component::from_code(code)
        .ok_or_else(|| value("componentType", code, "5120 to 5123, 5125 or 5126"))?;
    let kind = json.get("type").and_then(Value::as_str).unwrap_or("missing");
    let (width, columns) = match kind {
        "SCALAR" => (1, 1),
        "VEC2" => (2, 1),
        "VEC3" => (3, 1),
        "VEC4" => (4, 1),
        "MAT2" => (4, 2),
        "MAT3" => (9, 3),
        "MAT4" => (16, 4),
        _ => return Err(value("type", kind, "SCALAR, VEC2 to VEC4 or MAT2 to MAT4")),
    };
    // Columns of matrices begin at multiples of four bytes.
    let column = width / columns * component.size();
    let size = if columns > 1 { column.next_multiple_of(4) * columns } else { column };
    let count = integer(json, "count")?.ok_or_else(|| value("count", "missing", "a number of elements"))?;
    if count >= u64::from(u32::MAX) {
        return Err(SceneError::TooLarge {
            what: "elements",
            count,
            limit: u32::MAX.into(),
            place: Box::default(),
        });
    }
    let normalized = json.get("normalized").and_then(Value::as_bool).unwrap_or(false);
    Ok(Layout { component, width, normalized, count: count as usize, size })
}

impl Document {
    /// Opens an accessor.
    ///
    /// # Errors
    /// Anything that is wrong with it; the place names the accessor.
    pub fn elements(&self, accessor: usize) -> Result<Elements<'_>, SceneError> {
        self.open(accessor).map_err(|e| e.at(|p| p.accessor = Some(accessor)))
    }

    fn open(&self, accessor: usize) -> Result<Elements<'_>, SceneError> {
        let accessors = self.list("accessors");
        let json =
            accessors.get(accessor).ok_or_else(|| reference("accessor", accessor as u64, accessors.len()))?;
        let layout = layout(json)?;
        if let Some(bytes) = self.decoded.get(&accessor) {
            return strided(Cow::Borrowed(bytes), 0, layout.size, layout, "Draco data");
        }
        let views = self.list("bufferViews").len();
        let base = match index(json, "bufferView", views)? {
            Some(view) => {
                let offset = integer(json, "byteOffset")?.unwrap_or(0);
                let stride = match integer(&self.list("bufferViews")[view], "byteStride")? {
                    Some(stride) if stride < layout.size as u64 => {
                        return Err(value("byteStride", stride, "at least the size of an element"));
                    }
                    Some(stride) => stride,
                    None => layout.size as u64,
                };
                let bytes = self.view(view)?;
                let owner = format!("accessors[{accessor}]");
                if offset > bytes.len() as u64 || stride > bytes.len().max(layout.size) as u64 {
                    return Err(truncated(owner, offset.saturating_add(stride), bytes.len() as u64));
                }
                strided(Cow::Borrowed(bytes), offset as usize, stride as usize, layout, &owner)?
            }
            None => {
                let limit = self.total_bytes() + (1 << 20);
                if layout.count as u64 > limit {
                    return Err(SceneError::TooLarge {
                        what: "elements without data",
                        count: layout.count as u64,
                        limit,
                        place: Box::default(),
                    });
                }
                let bytes = Cow::Owned(vec![0; layout.count * layout.size]);
                Elements { layout, bytes, stride: layout.size }
            }
        };
        match json.get("sparse") {
            Some(sparse) => self.substitute(&base, sparse),
            None => Ok(base),
        }
    }

    /// Carries out `sparse`: some elements of the base are replaced.
    fn substitute(&self, base: &Elements<'_>, sparse: &Value) -> Result<Elements<'static>, SceneError> {
        let layout = base.layout;
        let count = integer(sparse, "count")?.unwrap_or(0);
        if count > layout.count as u64 {
            return Err(reference("sparse.count", count, layout.count));
        }
        let part = |key: &'static str, layout: Layout| -> Result<Elements<'_>, SceneError> {
            let json = sparse.get(key).ok_or_else(|| value(key, "missing", "an object"))?;
            let view = index(json, "bufferView", self.list("bufferViews").len())?
                .ok_or_else(|| value("bufferView", "missing", "the number of a view"))?;
            let offset = integer(json, "byteOffset")?.unwrap_or(0).min(usize::MAX as u64 / 2) as usize;
            strided(Cow::Borrowed(self.view(view)?), offset, layout.size, layout, key)
        };
        let code = sparse.get("indices").map_or(Ok(None), |i| integer(i, "componentType"))?.unwrap_or(0);
        let component = Component::from_code(code)
            .filter(|c| matches!(c, Component::U8 | Component::U16 | Component::U32))
            .ok_or_else(|| value("sparse.indices.componentType", code, "5121, 5123 or 5125"))?;
        let count = count as usize;
        let indices = part(
            "indices",
            Layout { component, width: 1, normalized: false, count, size: component.size() },
        )?;
        let values = part("values", Layout { count, ..layout })?;
        let mut bytes = Vec::with_capacity(layout.count * layout.size);
        (0..layout.count).for_each(|i| bytes.extend_from_slice(base.raw(i)));
        for i in 0..count {
            let at = indices.u32(i, 0) as usize;
            if at >= layout.count {
                return Err(reference("sparse.indices", at as u64, layout.count));
            }
            bytes[at * layout.size..(at + 1) * layout.size].copy_from_slice(values.raw(i));
        }
        Ok(Elements { layout, bytes: Cow::Owned(bytes), stride: layout.size })
    }
}

/// Elements at a stride, after checking that the last one lies within the bytes.
fn strided<'a>(
    bytes: Cow<'a, [u8]>,
    offset: usize,
    stride: usize,
    layout: Layout,
    owner: &str,
) -> Result<Elements<'a>, SceneError> {
    let needed = match layout.count {
        0 => offset as u64,
        n => (n as u64 - 1)
            .saturating_mul(stride as u64)
            .saturating_add(layout.size as u64)
            .saturating_add(offset as u64),
    };
    if needed > bytes.len() as u64 {
        return Err(truncated(owner, needed, bytes.len() as u64));
    }
    let bytes = match bytes {
        Cow::Borrowed(b) => Cow::Borrowed(&b[offset..]),
        Cow::Owned(mut b) => Cow::Owned(b.split_off(offset)),
    };
    Ok(Elements { layout, bytes, stride })
}
