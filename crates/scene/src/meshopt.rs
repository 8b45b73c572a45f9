//! Decoder of EXT_meshopt_compression, written from the extension's bitstream description
//! (KhronosGroup/glTF, extensions/2.0/Vendor/EXT_meshopt_compression, appendices A and B) and, for vertex
//! codec version 1, that of KHR_meshopt_compression.
//!
//! Three codecs (attributes, triangles, indices) and four filters (octahedral, quaternion, exponential, color).
//! Corrupt data gives an error, never a panic; nothing is allocated that the input could not fill.

/// What a compressed view holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Mode {
    /// Vertex attributes of `stride` bytes.
    Attributes,
    /// Triangle lists.
    Triangles,
    /// Any sequence of indices.
    Indices,
}

/// What is done to attributes after decoding.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Filter {
    /// Nothing.
    None,
    /// Octahedral unit vectors in 4 x i8 or 4 x i16.
    Octahedral,
    /// Unit quaternions in 4 x i16.
    Quaternion,
    /// Floats of 24 bits of mantissa and 8 bits of exponent.
    Exponential,
    /// Colours as luma and chroma in 4 x u8 or 4 x u16 (KHR_meshopt_compression).
    Color,
}

/// Decodes `count` elements of `stride` bytes.
///
/// # Errors
/// A reason, in words, when the data are damaged or the stride does not fit the mode.
pub fn decode(
    data: &[u8],
    count: usize,
    stride: usize,
    mode: Mode,
    filter: Filter,
) -> Result<Vec<u8>, &'static str> {
    match mode {
        Mode::Attributes => {
            let mut out = attributes(data, count, stride)?;
            match filter {
                Filter::None => {}
                Filter::Octahedral => octahedral(&mut out, stride)?,
                Filter::Quaternion => quaternion(&mut out, stride)?,
                Filter::Exponential => exponential(&mut out, stride)?,
                Filter::Color => color(&mut out, stride)?,
            }
            Ok(out)
        }
        _ if filter != Filter::None => Err("indices cannot have a filter"),
        Mode::Triangles => pack_indices(&triangles(data, count)?, stride),
        Mode::Indices => pack_indices(&sequence(data, count)?, stride),
    }
}

const TRUNCATED: &str = "the stream ends early";

fn pack_indices(indices: &[u32], stride: usize) -> Result<Vec<u8>, &'static str> {
    let mut out = Vec::with_capacity(indices.len() * stride);
    match stride {
        2 => {
            for &i in indices {
                let narrow = u16::try_from(i).map_err(|_| "an index does not fit 16 bits")?;
                out.extend_from_slice(&narrow.to_le_bytes());
            }
        }
        4 => indices.iter().for_each(|i| out.extend_from_slice(&i.to_le_bytes())),
        _ => return Err("indices need a stride of 2 or 4"),
    }
    Ok(out)
}

/// A cursor that fails at the end.
struct Bytes<'a>(&'a [u8]);

impl<'a> Bytes<'a> {
    fn take(&mut self, n: usize) -> Result<&'a [u8], &'static str> {
        let (head, rest) = self.0.split_at_checked(n).ok_or(TRUNCATED)?;
        self.0 = rest;
        Ok(head)
    }

    fn byte(&mut self) -> Result<u8, &'static str> {
        Ok(self.take(1)?[0])
    }

    /// A number of 7 bits a byte, least significant first, at most five bytes.
    fn varint(&mut self) -> Result<u32, &'static str> {
        let mut result = 0_u32;
        for shift in (0..35).step_by(7) {
            let byte = self.byte()?;
            result |= u32::from(byte & 127).wrapping_shl(shift);
            if byte < 128 {
                return Ok(result);
            }
        }
        Err("a number has more than five bytes")
    }
}

fn attributes(data: &[u8], count: usize, stride: usize) -> Result<Vec<u8>, &'static str> {
    if stride == 0 || stride > 256 || !stride.is_multiple_of(4) {
        return Err("attributes need a stride of 4 to 256 bytes, a multiple of 4");
    }
    let (&header, body) = data.split_first().ok_or(TRUNCATED)?;
    let version = match header {
        0xa0 => 0,
        0xa1 => 1,
        _ => return Err("not a vertex stream, or one of a later version"),
    };
    // The tail holds the first vertex, and the channel modes in version 1; it is padded at its front.
    let tail_data = stride + if version == 1 { stride / 4 } else { 0 };
    let tail = tail_data.max(if version == 1 { 24 } else { 32 });
    if body.len() < tail {
        return Err(TRUNCATED);
    }
    let (blocks, tail_bytes) = body.split_at(body.len() - tail);
    let (mut last, channels) = if version == 1 {
        let start = tail - tail_data;
        (tail_bytes[start..start + stride].to_vec(), &tail_bytes[start + stride..])
    } else {
        (tail_bytes[tail - stride..].to_vec(), &[][..])
    };
    let block_elements = ((8192 / stride) & !15).min(256);
    // A block of version 1 may take a control byte for every four byte planes; version 0 two bits a group.
    let most = if version == 1 { 4 * 256 } else { 64 };
    if (count as u64).saturating_mul(stride as u64) > (blocks.len() as u64 + 1).saturating_mul(most) + 65536 {
        return Err(TRUNCATED);
    }
    let mut out = vec![0_u8; count * stride];
    let mut bytes = Bytes(blocks);
    let mut planes = [[0_u8; 256]; 4];
    let mut first = 0;
    while first < count {
        let elements = block_elements.min(count - first);
        let groups = elements.div_ceil(16);
        let control = bytes.take(if version == 1 { stride / 4 } else { 0 })?;
        for word in 0..stride / 4 {
            let modes = control.get(word).copied().unwrap_or(0);
            for (k, plane) in planes.iter_mut().enumerate() {
                let bits = if version == 1 {
                    match (modes >> (2 * k)) & 3 {
                        0 => Some([0, 1, 2, 4]),
                        1 => Some([1, 2, 4, 8]),
                        2 => {
                            plane[..elements].fill(0);
                            continue;
                        }
                        _ => None,
                    }
                } else {
                    Some([0, 2, 4, 8])
                };
                match bits {
                    Some(bits) => byte_plane(&mut bytes, plane, groups, bits)?,
                    None => plane[..elements].copy_from_slice(bytes.take(elements)?),
                }
            }
            let channel = channels.get(word).copied().unwrap_or(0);
            undo_deltas(&planes, &mut last, &mut out[first * stride..], word, stride, elements, channel)?;
        }
        first += elements;
    }
    if !bytes.0.is_empty() {
        return Err("bytes are left over");
    }
    Ok(out)
}

/// Decodes one byte of up to 256 elements: two header bits for each group of 16 say how many bits a byte has.
fn byte_plane(
    bytes: &mut Bytes<'_>,
    plane: &mut [u8; 256],
    groups: usize,
    widths: [u32; 4],
) -> Result<(), &'static str> {
    let header = bytes.take(groups.div_ceil(4))?;
    for group in 0..groups {
        let width = widths[usize::from(header[group / 4] >> (2 * (group % 4)) & 3)];
        let out = &mut plane[group * 16..group * 16 + 16];
        match width {
            0 => out.fill(0),
            8 => out.copy_from_slice(bytes.take(16)?),
            _ => {
                let packed = bytes.take(2 * width as usize)?;
                let sentinel = (1_u8 << width) - 1;
                let per_byte = 8 / width as usize;
                for (i, value) in out.iter_mut().enumerate() {
                    let byte = packed[i / per_byte];
                    // Elements of one bit stand least significant first, wider ones most significant first.
                    let slot = i % per_byte;
                    let shift = if width == 1 { slot as u32 } else { 8 - width * (slot as u32 + 1) };
                    let small = byte >> shift & sentinel;
                    *value = if small == sentinel { bytes.byte()? } else { small };
                }
            }
        }
    }
    Ok(())
}

/// Turns four byte planes of differences into bytes of elements, starting from the last element.
fn undo_deltas(
    planes: &[[u8; 256]; 4],
    last: &mut [u8],
    out: &mut [u8],
    word: usize,
    stride: usize,
    elements: usize,
    channel: u8,
) -> Result<(), &'static str> {
    let at = word * 4;
    let unzigzag8 = |v: u8| (v >> 1) ^ (v & 1).wrapping_neg();
    match channel & 3 {
        0 => {
            for (k, plane) in planes.iter().enumerate() {
                let mut value = last[at + k];
                for (i, &delta) in plane[..elements].iter().enumerate() {
                    value = value.wrapping_add(unzigzag8(delta));
                    out[i * stride + at + k] = value;
                }
                last[at + k] = value;
            }
        }
        1 => {
            for half in 0..2 {
                let k = at + 2 * half;
                let mut value = u16::from_le_bytes([last[k], last[k + 1]]);
                for i in 0..elements {
                    let v = u16::from_le_bytes([planes[2 * half][i], planes[2 * half + 1][i]]);
                    value = value.wrapping_add((v >> 1) ^ (v & 1).wrapping_neg());
                    out[i * stride + k..i * stride + k + 2].copy_from_slice(&value.to_le_bytes());
                }
                last[k..k + 2].copy_from_slice(&value.to_le_bytes());
            }
        }
        2 => {
            let rotation = u32::from(channel >> 4);
            let mut value = u32::from_le_bytes([last[at], last[at + 1], last[at + 2], last[at + 3]]);
            for i in 0..elements {
                let v = u32::from_le_bytes([planes[0][i], planes[1][i], planes[2][i], planes[3][i]]);
                value ^= v.rotate_right(rotation);
                out[i * stride + at..i * stride + at + 4].copy_from_slice(&value.to_le_bytes());
            }
            last[at..at + 4].copy_from_slice(&value.to_le_bytes());
        }
        _ => return Err("an unknown channel mode"),
    }
    Ok(())
}

/// Triangle lists: an edge FIFO and a vertex FIFO, both of 16 entries.
fn triangles(data: &[u8], count: usize) -> Result<Vec<u32>, &'static str> {
    if !count.is_multiple_of(3) {
        return Err("a triangle list needs a multiple of three indices");
    }
    let (&header, body) = data.split_first().ok_or(TRUNCATED)?;
    if header != 0xe1 {
        return Err("not a triangle stream, or one of another version");
    }
    let faces = count / 3;
    if body.len() < faces.saturating_add(16) {
        return Err(TRUNCATED);
    }
    let (codes, rest) = body.split_at(faces);
    let (extra, table) = rest.split_at(rest.len() - 16);
    let mut extra = Bytes(extra);
    let mut edges = [[0_u32; 2]; 16];
    let mut vertices = [0_u32; 16];
    let (mut edge_at, mut vertex_at) = (0_usize, 0_usize);
    let (mut next, mut last) = (0_u32, 0_u32);
    let mut out = Vec::with_capacity(count);

    fn push<T>(fifo: &mut [T; 16], at: &mut usize, value: T) {
        fifo[*at] = value;
        *at = (*at + 1) & 15;
    }
    fn fresh(next: &mut u32) -> u32 {
        let v = *next;
        *next = v.wrapping_add(1);
        v
    }
    fn delta(extra: &mut Bytes<'_>, last: &mut u32) -> Result<u32, &'static str> {
        let v = extra.varint()?;
        *last = last.wrapping_add((v >> 1) ^ (v & 1).wrapping_neg());
        Ok(*last)
    }

    for &code in codes {
        let (high, low) = (usize::from(code >> 4), usize::from(code & 15));
        if high < 15 {
            let [a, b] = edges[edge_at.wrapping_sub(1).wrapping_sub(high) & 15];
            let c = match low {
                0 => {
                    let c = fresh(&mut next);
                    push(&mut vertices, &mut vertex_at, c);
                    c
                }
                1..=12 => vertices[vertex_at.wrapping_sub(1).wrapping_sub(low) & 15],
                13 | 14 => {
                    last = if low == 13 { last.wrapping_sub(1) } else { last.wrapping_add(1) };
                    push(&mut vertices, &mut vertex_at, last);
                    last
                }
                _ => {
                    let c = delta(&mut extra, &mut last)?;
                    push(&mut vertices, &mut vertex_at, c);
                    c
                }
            };
            push(&mut edges, &mut edge_at, [c, b]);
            push(&mut edges, &mut edge_at, [a, c]);
            out.extend_from_slice(&[a, b, c]);
            continue;
        }
        let aux = if low < 14 { table[low] } else { extra.byte()? };
        let (fb, fc) = (usize::from(aux >> 4), usize::from(aux & 15));
        // A literal zero byte means that the whole mesh starts over.
        if low >= 14 && aux == 0 {
            next = 0;
        }
        let explicit_a = low == 15;
        let mut a = if explicit_a { 0 } else { fresh(&mut next) };
        let (b_new, c_new) = (fb == 0, fc == 0);
        let b = match fb {
            0 => fresh(&mut next),
            15 if low >= 14 => 0,
            _ => vertices[vertex_at.wrapping_sub(fb) & 15],
        };
        let c = match fc {
            0 => fresh(&mut next),
            15 if low >= 14 => 0,
            _ => vertices[vertex_at.wrapping_sub(fc) & 15],
        };
        let (mut b, mut c) = (b, c);
        let (b_explicit, c_explicit) = (low >= 14 && fb == 15, low >= 14 && fc == 15);
        if explicit_a {
            a = delta(&mut extra, &mut last)?;
        }
        if b_explicit {
            b = delta(&mut extra, &mut last)?;
        }
        if c_explicit {
            c = delta(&mut extra, &mut last)?;
        }
        push(&mut vertices, &mut vertex_at, a);
        if b_new || b_explicit {
            push(&mut vertices, &mut vertex_at, b);
        }
        if c_new || c_explicit {
            push(&mut vertices, &mut vertex_at, c);
        }
        push(&mut edges, &mut edge_at, [b, a]);
        push(&mut edges, &mut edge_at, [c, b]);
        push(&mut edges, &mut edge_at, [a, c]);
        out.extend_from_slice(&[a, b, c]);
    }
    if !extra.0.is_empty() {
        return Err("bytes are left over");
    }
    Ok(out)
}

/// Index sequences: differences to one of two running values.
fn sequence(data: &[u8], count: usize) -> Result<Vec<u32>, &'static str> {
    let (&header, body) = data.split_first().ok_or(TRUNCATED)?;
    if header != 0xd1 {
        return Err("not an index stream, or one of another version");
    }
    if body.len() < count.saturating_add(4) {
        return Err(TRUNCATED);
    }
    let mut bytes = Bytes(&body[..body.len() - 4]);
    let mut last = [0_u32; 2];
    let mut out = Vec::with_capacity(count);
    for _ in 0..count {
        let v = bytes.varint()?;
        let base = &mut last[(v & 1) as usize];
        let v = v >> 1;
        *base = base.wrapping_add((v >> 1) ^ (v & 1).wrapping_neg());
        out.push(*base);
    }
    if !bytes.0.is_empty() {
        return Err("bytes are left over");
    }
    Ok(out)
}

fn octahedral(data: &mut [u8], stride: usize) -> Result<(), &'static str> {
    fn unit(x: i32, y: i32, one: i32, max: f32) -> [i32; 3] {
        let one = if one == 0 { 1.0 } else { one as f32 };
        let (mut x, mut y) = (x as f32 / one, y as f32 / one);
        let z = 1.0 - x.abs() - y.abs();
        let fold = (-z).max(0.0);
        x -= if x >= 0.0 { fold } else { -fold };
        y -= if y >= 0.0 { fold } else { -fold };
        let scale = max / (x * x + y * y + z * z).sqrt();
        [x, y, z].map(|v| {
            let v = v * scale;
            (v + if v >= 0.0 { 0.5 } else { -0.5 }) as i32
        })
    }
    match stride {
        4 => {
            for e in data.chunks_exact_mut(4) {
                let v = unit(i32::from(e[0] as i8), i32::from(e[1] as i8), i32::from(e[2] as i8), 127.0);
                (0..3).for_each(|k| e[k] = v[k] as i8 as u8);
            }
        }
        8 => {
            for e in data.chunks_exact_mut(8) {
                let get = |k: usize| i32::from(i16::from_le_bytes([e[2 * k], e[2 * k + 1]]));
                let v = unit(get(0), get(1), get(2), 32767.0);
                (0..3).for_each(|k| e[2 * k..2 * k + 2].copy_from_slice(&(v[k] as i16).to_le_bytes()));
            }
        }
        _ => return Err("the octahedral filter needs a stride of 4 or 8"),
    }
    Ok(())
}

fn quaternion(data: &mut [u8], stride: usize) -> Result<(), &'static str> {
    if stride != 8 {
        return Err("the quaternion filter needs a stride of 8");
    }
    for e in data.chunks_exact_mut(8) {
        let get = |k: usize| i32::from(i16::from_le_bytes([e[2 * k], e[2 * k + 1]]));
        let step = std::f32::consts::FRAC_1_SQRT_2 / (get(3) | 3) as f32;
        let v = [0, 1, 2].map(|k| get(k) as f32 * step);
        let w = (1.0 - v.iter().map(|c| c * c).sum::<f32>()).max(0.0).sqrt();
        let largest = (get(3) & 3) as usize;
        for (k, c) in [v[0], v[1], v[2], w].into_iter().enumerate() {
            let at = (largest + 1 + k) % 4;
            let rounded = (c * 32767.0 + if c >= 0.0 { 0.5 } else { -0.5 }) as i16;
            e[2 * at..2 * at + 2].copy_from_slice(&rounded.to_le_bytes());
        }
    }
    Ok(())
}

fn exponential(data: &mut [u8], stride: usize) -> Result<(), &'static str> {
    if !stride.is_multiple_of(4) {
        return Err("the exponential filter needs a stride that is a multiple of 4");
    }
    for e in data.chunks_exact_mut(4) {
        let v = i32::from_le_bytes([e[0], e[1], e[2], e[3]]);
        let (mantissa, exponent) = (v << 8 >> 8, v >> 24);
        // A power of two that may be denormal: computed in double precision, then rounded once.
        let value = (f64::from(mantissa) * f64::from(exponent).exp2()) as f32;
        e.copy_from_slice(&value.to_le_bytes());
    }
    Ok(())
}

/// Luma and chroma to RGBA; the highest set bit of alpha says how many bits the components have.
fn color(data: &mut [u8], stride: usize) -> Result<(), &'static str> {
    fn rgba([y, co, cg, alpha]: [i32; 4], max: f32) -> [i32; 4] {
        let scale = alpha | alpha >> 1;
        let scale = scale | scale >> 2;
        let scale = scale | scale >> 4;
        let scale = scale | scale >> 8;
        let a = ((alpha << 1) & scale) | (alpha & 1);
        let step = max / scale.max(1) as f32;
        [y + co - cg, y + cg, y - co - cg, a].map(|v| (v as f32 * step + 0.5) as i32)
    }
    match stride {
        4 => {
            for e in data.chunks_exact_mut(4) {
                let v = [i32::from(e[0]), i32::from(e[1] as i8), i32::from(e[2] as i8), i32::from(e[3])];
                let out = rgba(v, 255.0);
                (0..4).for_each(|k| e[k] = out[k] as u8);
            }
        }
        8 => {
            for e in data.chunks_exact_mut(8) {
                let get = |k: usize| u16::from_le_bytes([e[2 * k], e[2 * k + 1]]);
                let signed = |k: usize| i32::from(get(k) as i16);
                let out = rgba([i32::from(get(0)), signed(1), signed(2), i32::from(get(3))], 65535.0);
                (0..4).for_each(|k| e[2 * k..2 * k + 2].copy_from_slice(&(out[k] as u16).to_le_bytes()));
            }
        }
        _ => return Err("the color filter needs a stride of 4 or 8"),
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sequence_example_of_the_specification_decodes() {
        // Written by hand: 5, 6, 3 on the first running value, then 4 zero bytes of tail.
        let zigzag = |d: i32| ((d << 1) ^ (d >> 31)) as u32;
        let mut data = vec![0xd1];
        for d in [5, 1, -3] {
            data.push((zigzag(d) << 1) as u8);
        }
        data.extend([0; 4]);
        assert_eq!(sequence(&data, 3), Ok(vec![5, 6, 3]));
        assert!(sequence(&data[..4], 3).is_err());
    }

    #[test]
    fn triangles_strip_of_two_decodes() {
        // First code: all three vertices new through the table; second: newest edge and a new vertex.
        let mut data = vec![0xe1, 0xf0, 0x00];
        data.extend([0; 16]);
        let out = triangles(&data, 6).unwrap();
        assert_eq!(&out[..3], &[0, 1, 2]);
        assert_eq!(out[5], 3);
    }

    /// Streams of the reference encoder (versions 0 and 1) with what the reference decoder makes of them.
    #[test]
    fn reference_streams_decode_bit_for_bit() {
        let cases: serde_json::Value =
            serde_json::from_str(include_str!("../tests/data/meshopt.json")).unwrap();
        let cases = cases.as_array().unwrap();
        assert!(cases.len() > 15);
        for case in cases {
            let text = |key: &str| case[key].as_str().unwrap();
            let bytes = |key: &str| -> Vec<u8> {
                let hex = text(key);
                (0..hex.len()).step_by(2).map(|i| u8::from_str_radix(&hex[i..i + 2], 16).unwrap()).collect()
            };
            let number = |key: &str| case[key].as_u64().unwrap() as usize;
            let mode = match text("mode") {
                "ATTRIBUTES" => Mode::Attributes,
                "TRIANGLES" => Mode::Triangles,
                _ => Mode::Indices,
            };
            let filter = match text("filter") {
                "OCTAHEDRAL" => Filter::Octahedral,
                "QUATERNION" => Filter::Quaternion,
                "EXPONENTIAL" => Filter::Exponential,
                "COLOR" => Filter::Color,
                _ => Filter::None,
            };
            let data = bytes("data");
            let out = decode(&data, number("count"), number("stride"), mode, filter);
            assert!(out == Ok(bytes("expected")), "{}: {:?}", text("name"), out.err());
        }
    }

    #[test]
    fn garbage_never_panics() {
        let mut state = 1_u64;
        for round in 0..20_000 {
            let mut data: Vec<u8> = (0..round % 200)
                .map(|_| {
                    state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
                    (state >> 56) as u8
                })
                .collect();
            if let Some(first) = data.first_mut() {
                *first = [0xa0, 0xa1, 0xe1, 0xd1][round % 4];
            }
            for mode in [Mode::Attributes, Mode::Triangles, Mode::Indices] {
                let all = [
                    Filter::None,
                    Filter::Octahedral,
                    Filter::Quaternion,
                    Filter::Exponential,
                    Filter::Color,
                ];
                for filter in all {
                    let _ = decode(&data, round % 64, [4, 8, 12, 2, 256][round % 5], mode, filter);
                }
            }
        }
    }
}
