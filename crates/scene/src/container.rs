//! The GLB container (glTF 2.0 specification, chapter 4), and telling it from plain JSON.

use crate::error::SceneError;

const MAGIC: &[u8] = b"glTF";
const JSON: u32 = 0x4e4f_534a;
const BIN: u32 = 0x004e_4942;

/// A file taken apart.
pub(crate) struct Container {
    pub json: Vec<u8>,
    pub chunk: Option<Vec<u8>>,
    /// Chunks that only their makers know; kept.
    pub chunks: Vec<(u32, Vec<u8>)>,
}

fn damaged(reason: impl Into<String>) -> SceneError {
    SceneError::Container { reason: reason.into(), place: Box::default() }
}

/// Splits a GLB into its chunks; anything else is taken for JSON.
pub(crate) fn split(bytes: Vec<u8>) -> Result<Container, SceneError> {
    if !bytes.starts_with(MAGIC) {
        let text = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(&bytes);
        return match text.iter().find(|b| !b.is_ascii_whitespace()) {
            Some(b'{') => Ok(Container { json: text.to_vec(), chunk: None, chunks: Vec::new() }),
            None => Err(damaged("the file is empty")),
            Some(_) if text.starts_with(b"version https://git-lfs") => {
                Err(damaged("it is a Git LFS pointer, not the file itself"))
            }
            Some(_) => Err(damaged("it begins neither with { nor with glTF")),
        };
    }
    let word = |at: usize| -> Option<u32> {
        let b = bytes.get(at..at.checked_add(4)?)?;
        Some(u32::from_le_bytes([b[0], b[1], b[2], b[3]]))
    };
    let short = || damaged("the GLB header is cut off");
    let (version, length) = (word(4).ok_or_else(short)?, word(8).ok_or_else(short)? as usize);
    if version != 2 {
        return Err(damaged(format!("GLB container version {version} is not 2")));
    }
    if length > bytes.len() {
        return Err(damaged(format!("the header promises {length} bytes, but there are {}", bytes.len())));
    }
    let (mut json, mut chunk, mut chunks) = (None, None, Vec::new());
    let mut at = 12;
    while at + 8 <= length {
        let (size, kind) = (word(at).ok_or_else(short)? as usize, word(at + 4).ok_or_else(short)?);
        let body = at + 8;
        let end = body.checked_add(size).filter(|&e| e <= length);
        let Some(end) = end else {
            return Err(damaged(format!(
                "a chunk of {size} bytes at byte {at} runs past the end ({length})"
            )));
        };
        match kind {
            JSON if json.is_none() => json = Some(bytes[body..end].to_vec()),
            BIN if chunk.is_none() => chunk = Some(body..end),
            _ => chunks.push((kind, bytes[body..end].to_vec())),
        }
        at = end;
    }
    let json = json.ok_or_else(|| damaged("there is no JSON chunk"))?;
    // The chunk is most of the file: it keeps the file's memory.
    let chunk = chunk.map(|range| {
        let mut bytes = bytes;
        bytes.truncate(range.end);
        bytes.drain(..range.start);
        bytes
    });
    Ok(Container { json, chunk, chunks })
}

/// Puts a GLB together; chunks are padded to four bytes.
///
/// # Errors
/// When it would exceed the 4 GiB that a GLB can hold.
pub(crate) fn join(
    json: &[u8],
    chunk: Option<&[u8]>,
    chunks: &[(u32, Vec<u8>)],
) -> Result<Vec<u8>, SceneError> {
    let padded = |n: usize| n.div_ceil(4) * 4;
    let mut total = 12 + 8 + padded(json.len());
    total += chunk.map_or(0, |c| 8 + padded(c.len()));
    total += chunks.iter().map(|(_, c)| 8 + padded(c.len())).sum::<usize>();
    let Ok(length) = u32::try_from(total) else {
        return Err(SceneError::TooLarge {
            what: "bytes for a GLB",
            count: total as u64,
            limit: u32::MAX.into(),
            place: Box::default(),
        });
    };
    let mut out = Vec::with_capacity(total);
    out.extend_from_slice(MAGIC);
    out.extend_from_slice(&2_u32.to_le_bytes());
    out.extend_from_slice(&length.to_le_bytes());
    let mut put = |kind: u32, data: &[u8], pad: u8| {
        let end = padded(data.len());
        out.extend_from_slice(&(end as u32).to_le_bytes());
        out.extend_from_slice(&kind.to_le_bytes());
        out.extend_from_slice(data);
        out.resize(out.len() + end - data.len(), pad);
    };
    put(JSON, json, b' ');
    if let Some(chunk) = chunk {
        put(BIN, chunk, 0);
    }
    chunks.iter().for_each(|(kind, data)| put(*kind, data, 0));
    Ok(out)
}
