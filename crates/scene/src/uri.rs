//! URIs of buffers and images: data URIs, and relative paths inside of the scene's folder.

use std::path::{Component, Path, PathBuf};

use base64::Engine as _;
use base64::alphabet;
use base64::engine::{DecodePaddingMode, GeneralPurpose, GeneralPurposeConfig};

use crate::error::{Place, SceneError};

const BASE64: GeneralPurpose = GeneralPurpose::new(
    &alphabet::STANDARD,
    GeneralPurposeConfig::new()
        .with_decode_allow_trailing_bits(true)
        .with_decode_padding_mode(DecodePaddingMode::Indifferent),
);

/// Whether a URI carries its data itself.
pub(crate) fn is_data(uri: &str) -> bool {
    uri.get(..5).is_some_and(|s| s.eq_ignore_ascii_case("data:"))
}

fn no_data(owner: &str, reason: impl Into<String>) -> SceneError {
    SceneError::NoData { owner: owner.to_owned(), reason: reason.into(), place: Box::default() }
}

/// Undoes percent-encoding. What is no valid escape stays as it is; bytes that are no UTF-8 give `None`.
fn percent_decode(text: &str) -> Option<String> {
    let digit = |b: u8| (b as char).to_digit(16).map(|d| d as u8);
    let (bytes, mut out, mut i) = (text.as_bytes(), Vec::with_capacity(text.len()), 0);
    while i < bytes.len() {
        let escape = match bytes[i..] {
            [b'%', a, b, ..] => digit(a).zip(digit(b)),
            _ => None,
        };
        match escape {
            Some((a, b)) => {
                out.push(a << 4 | b);
                i += 3;
            }
            None => {
                out.push(bytes[i]);
                i += 1;
            }
        }
    }
    String::from_utf8(out).ok()
}

/// The path, relative to the scene's folder, that a URI names.
///
/// # Errors
/// [`SceneError::Outside`] for absolute paths, `..` that leave the folder, and any scheme.
pub(crate) fn relative_path(uri: &str, owner: &str) -> Result<PathBuf, SceneError> {
    let outside = || SceneError::Outside {
        owner: owner.to_owned(),
        uri: uri.chars().take(200).collect(),
        place: Box::default(),
    };
    let decoded = percent_decode(uri).filter(|d| !d.contains('\0')).ok_or_else(outside)?;
    // A scheme or a drive letter: letters, then a colon, before any slash.
    let head = decoded.split(['/', '\\']).next().unwrap_or("");
    let scheme = head.split_once(':').is_some_and(|(s, _)| {
        !s.is_empty() && s.chars().all(|c| c.is_ascii_alphanumeric() || "+-.".contains(c))
    });
    if scheme || decoded.contains("://") || decoded.starts_with(['/', '\\']) {
        return Err(outside());
    }
    let mut path = PathBuf::new();
    for part in Path::new(&decoded.replace('\\', "/")).components() {
        match part {
            Component::Normal(name) => path.push(name),
            Component::CurDir => {}
            Component::ParentDir if path.pop() => {}
            _ => return Err(outside()),
        }
    }
    if path.as_os_str().is_empty() { Err(no_data(owner, "its URI is empty")) } else { Ok(path) }
}

/// The bytes behind a URI; `folder` is the scene's, `None` when only memory may be read.
pub(crate) fn load(uri: &str, owner: &str, folder: Option<&Path>) -> Result<Vec<u8>, SceneError> {
    if is_data(uri) {
        let (head, body) = uri.split_once(',').ok_or_else(|| no_data(owner, "its data URI has no comma"))?;
        let bytes = if head.to_ascii_lowercase().ends_with(";base64") {
            let clean: Vec<u8> = body.bytes().filter(|b| !b.is_ascii_whitespace()).collect();
            BASE64.decode(clean).map_err(|e| no_data(owner, format!("its base64 does not decode: {e}")))?
        } else {
            percent_decode(body).map(String::into_bytes).unwrap_or_else(|| body.as_bytes().to_vec())
        };
        return Ok(bytes);
    }
    let relative = relative_path(uri, owner)?;
    let Some(folder) = folder else {
        return Err(no_data(owner, format!("{} is a file, and only memory is read", relative.display())));
    };
    // A file whose name holds the escapes themselves is found too.
    let plain = folder.join(uri);
    let path = folder.join(&relative);
    let path = if !path.exists() && relative_path(&uri.replace('%', "_"), owner).is_ok() && plain.exists() {
        plain
    } else {
        path
    };
    std::fs::read(&path).map_err(|source| {
        let place = Place { attribute: Some(owner.to_owned()), ..Place::default() };
        SceneError::Io { action: "read", path, source, place: Box::new(place) }
    })
}

/// Writes a file name as a URI: everything but unreserved characters and slashes is escaped.
pub(crate) fn encode(path: &str) -> String {
    let mut out = String::new();
    for b in path.bytes() {
        if b.is_ascii_alphanumeric() || b"-._~/".contains(&b) || b >= 0x80 {
            out.push(b as char);
        } else {
            out += &format!("%{b:02X}");
        }
    }
    if path.is_ascii() {
        out
    } else {
        path.replace('%', "%25").replace(' ', "%20").replace('#', "%23").replace('?', "%3F")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn uri_inside_is_decoded() {
        for (uri, path) in [
            ("a.bin", "a.bin"),
            ("sub%20dir/a%C3%A4.png", "sub dir/aä.png"),
            ("täxt/ü.bin", "täxt/ü.bin"),
            ("./a/../b.bin", "b.bin"),
            ("100%.bin", "100%.bin"),
        ] {
            assert_eq!(relative_path(uri, "buffers[0]").unwrap(), PathBuf::from(path), "{uri}");
        }
    }

    #[test]
    fn uri_outside_is_refused() {
        for uri in [
            "../a.bin",
            "a/../../b",
            "/etc/passwd",
            "file:///etc/passwd",
            "http://x/a",
            "C:\\a",
            "..%2fa.bin",
            "%2fetc/passwd",
            "..\\a",
            "a%00b",
        ] {
            let error = relative_path(uri, "buffers[0]").unwrap_err();
            assert!(matches!(error, SceneError::Outside { .. }), "{uri}: {error}");
        }
    }

    #[test]
    fn uri_data_decodes_with_and_without_padding() {
        assert_eq!(load("data:application/octet-stream;base64,AQID", "b", None).unwrap(), [1, 2, 3]);
        assert_eq!(load("data:;base64,AQI", "b", None).unwrap(), [1, 2]);
        assert_eq!(load("data:;base64,AQI=", "b", None).unwrap(), [1, 2]);
        assert!(load("data:;base64,*", "b", None).is_err());
        assert!(load("data:nothing", "b", None).is_err());
    }

    #[test]
    fn uri_encode_round_trips() {
        for name in ["a b.bin", "a#b?.png", "100%.bin", "ü ä.bin", "x.y-z_~"] {
            assert_eq!(relative_path(&encode(name), "b").unwrap(), PathBuf::from(name));
        }
    }
}
