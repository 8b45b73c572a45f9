//! Dropping what a write leaves unused: accessors, buffer views and their bytes; textures, images and samplers.
//!
//! Only objects that the file used before and no longer uses are dropped, and only when no extension is
//! present that might refer to accessors or views in a way unknown here.

use serde_json::Value;

use crate::document::{MESHOPT, array, extension, list, object, whole};
use crate::draco::DRACO;
use crate::instances::INSTANCING;

type Visit<'a> = &'a mut dyn FnMut(&mut Value);

fn each(owner: &mut Value, key: &str, f: Visit<'_>) {
    if let Some(items) = owner.get_mut(key).and_then(Value::as_array_mut) {
        items.iter_mut().for_each(f);
    }
}

fn values(owner: &mut Value, path: &[&str], f: Visit<'_>) {
    let mut at = Some(owner);
    for key in path {
        at = at.and_then(|v| v.get_mut(*key));
    }
    if let Some(object) = at.and_then(Value::as_object_mut) {
        object.values_mut().for_each(f);
    }
}

fn one(owner: &mut Value, path: &[&str], f: Visit<'_>) {
    let mut at = Some(owner);
    for key in path {
        at = at.and_then(|v| v.get_mut(*key));
    }
    at.into_iter().for_each(f);
}

/// Visits every number that names an accessor.
fn accessors(root: &mut Value, f: Visit<'_>) {
    each(root, "meshes", &mut |mesh| {
        each(mesh, "primitives", &mut |primitive| {
            values(primitive, &["attributes"], f);
            one(primitive, &["indices"], f);
            each(primitive, "targets", &mut |target| values(target, &[], f));
        });
    });
    each(root, "skins", &mut |skin| one(skin, &["inverseBindMatrices"], f));
    each(root, "animations", &mut |animation| {
        each(animation, "samplers", &mut |sampler| {
            one(sampler, &["input"], f);
            one(sampler, &["output"], f);
        });
    });
    each(root, "nodes", &mut |node| values(node, &["extensions", INSTANCING, "attributes"], f));
}

/// Visits every number that names a buffer view.
fn views(root: &mut Value, f: Visit<'_>) {
    each(root, "accessors", &mut |accessor| {
        one(accessor, &["bufferView"], f);
        one(accessor, &["sparse", "indices", "bufferView"], f);
        one(accessor, &["sparse", "values", "bufferView"], f);
    });
    each(root, "images", &mut |image| one(image, &["bufferView"], f));
    each(root, "meshes", &mut |mesh| {
        each(mesh, "primitives", &mut |primitive| one(primitive, &["extensions", DRACO, "bufferView"], f));
    });
}

/// Visits every number that names a texture: the `index` of objects in materials and their extensions.
fn textures(root: &mut Value, f: Visit<'_>) {
    fn infos(json: &mut Value, f: Visit<'_>) {
        one(json, &["index"], f);
        match json {
            Value::Object(object) => {
                object.iter_mut().filter(|(key, _)| *key != "extras").for_each(|(_, v)| infos(v, f));
            }
            Value::Array(items) => items.iter_mut().for_each(|v| infos(v, f)),
            _ => {}
        }
    }
    each(root, "materials", &mut |material| infos(material, f));
}

/// Visits every number that names an image.
fn images(root: &mut Value, f: Visit<'_>) {
    each(root, "textures", &mut |texture| {
        one(texture, &["source"], f);
        values(texture, &["extensions"], &mut |extension| one(extension, &["source"], f));
    });
}

/// Visits every number that names a sampler.
fn samplers(root: &mut Value, f: Visit<'_>) {
    each(root, "textures", &mut |texture| one(texture, &["sampler"], f));
}

type Walk = fn(&mut Value, Visit<'_>);

fn used(root: &mut Value, key: &str, walk: Walk) -> Vec<bool> {
    let mut used = vec![false; list(root, key).len()];
    walk(root, &mut |v| {
        if let Some(flag) = whole(v).and_then(|n| used.get_mut(n as usize)) {
            *flag = true;
        }
    });
    used
}

/// Whether all extensions are known not to refer to accessors and views by themselves.
fn is_safe(root: &Value) -> bool {
    const SAFE: [&str; 18] = [
        "KHR_materials_",
        "KHR_texture_",
        "EXT_texture_",
        "MSFT_texture_dds",
        "KHR_lights_punctual",
        "KHR_xmp",
        "KHR_animation_pointer",
        "KHR_node_",
        "KHR_mesh_quantization",
        "EXT_meshopt_compression",
        "KHR_meshopt_compression",
        "LIGHTKILN_lightmap",
        "MOZ_lightmap",
        "EXT_lightmap",
        "MSFT_lod",
        "EXT_mesh_manifold_none",
        "FB_materials_modmap",
        "KHR_interactivity",
    ];
    list(root, "extensionsUsed")
        .iter()
        .filter_map(Value::as_str)
        .all(|name| name == DRACO || name == INSTANCING || SAFE.iter().any(|s| name.starts_with(s)))
}

/// Bytes of a buffer.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
struct Range {
    buffer: u64,
    start: u64,
    end: u64,
}

fn ranges_of(view: &Value) -> Vec<Range> {
    let range = |v: &Value| {
        let number = |key| v.get(key).and_then(whole);
        let start = number("byteOffset").unwrap_or(0);
        Some(Range { buffer: number("buffer")?, start, end: start.saturating_add(number("byteLength")?) })
    };
    let compressed = MESHOPT.iter().filter_map(|name| extension(view, name));
    std::iter::once(view).chain(compressed).filter_map(range).collect()
}

/// What was dropped.
#[derive(Debug, Default)]
pub(crate) struct Dropped {
    /// Bytes of the main buffer that can go: start and end, ascending, each a multiple of 16 long except at the end.
    pub cuts: Vec<(u64, u64)>,
    /// Bytes that are no longer used but stay.
    pub wasted: u64,
}

/// Drops textures, images and samplers that `before` uses and `after` does not, unless an extension might.
pub(crate) fn collect_textures(before: &Value, after: &mut Value) {
    let mut before = before.clone();
    if !is_safe(after) {
        return;
    }
    let walks: [(&str, Walk); 3] = [("textures", textures), ("images", images), ("samplers", samplers)];
    for (key, walk) in walks {
        let was = used(&mut before, key, walk);
        let now = used(after, key, walk);
        let dead: Vec<bool> = was.iter().zip(&now).map(|(was, now)| *was && !now).collect();
        remove(after, key, &dead, walk);
    }
}

/// Drops what `before` uses and `after` does not; `main` is the buffer that will be rewritten, of `length` bytes.
pub(crate) fn collect(before: &Value, after: &mut Value, main: usize, length: u64) -> Dropped {
    let mut before = before.clone();
    let safe = is_safe(after) && is_safe(&before);
    let was = used(&mut before, "accessors", accessors);
    let dropped = |was: &[bool], now: &[bool]| -> Vec<bool> {
        now.iter().enumerate().map(|(i, now)| !now && was.get(i) == Some(&true)).collect()
    };
    let dead = dropped(&was, &used(after, "accessors", accessors));
    if safe {
        remove(after, "accessors", &dead, accessors);
    }
    let was = used(&mut before, "bufferViews", views);
    let dead = dropped(&was, &used(after, "bufferViews", views));
    let old = list(after, "bufferViews").to_vec();
    let mut gone: Vec<Range> = Vec::new();
    let mut kept: Vec<Range> = Vec::new();
    // Views that are new have no bytes in the buffer as it was.
    for (view, dead) in old.iter().zip(&dead).take(was.len()) {
        if *dead { &mut gone } else { &mut kept }.extend(ranges_of(view));
    }
    // Padding up to four bytes goes with what it pads.
    gone.iter_mut().for_each(|r| r.end = (r.end.saturating_add(3) & !3).min(length.max(r.end)));
    let in_main = |r: &Range| r.buffer == main as u64;
    let free =
        subtract(gone.into_iter().filter(in_main).collect(), kept.into_iter().filter(in_main).collect());
    if !safe {
        return Dropped { cuts: Vec::new(), wasted: free.iter().map(|(a, b)| b - a).sum() };
    }
    remove(after, "bufferViews", &dead, views);
    // Offsets keep their alignment when whole multiples of 16 bytes go.
    let whole_blocks = |&(a, b): &(u64, u64)| (a, if b >= length { b } else { a + (b - a) / 16 * 16 });
    let cuts: Vec<(u64, u64)> = free.iter().map(whole_blocks).filter(|(a, b)| a < b).collect();
    let shift = |offset: u64| -> u64 { cuts.iter().filter(|(_, b)| *b <= offset).map(|(a, b)| b - a).sum() };
    let move_back = |v: &mut Value| {
        let offset = v.get("byteOffset").and_then(whole).unwrap_or(0);
        let by = shift(offset);
        if v.get("buffer").and_then(whole) == Some(main as u64) && by > 0 {
            v["byteOffset"] = (offset - by).into();
        }
    };
    each(after, "bufferViews", &mut |view| {
        for name in MESHOPT {
            one(view, &["extensions", name], &mut |v| move_back(v));
        }
        move_back(view);
    });
    let wasted = free.iter().map(|(a, b)| b - a).sum::<u64>() - cuts.iter().map(|(a, b)| b - a).sum::<u64>();
    Dropped { cuts, wasted }
}

/// Removes objects and renumbers the rest.
fn remove(root: &mut Value, key: &str, dead: &[bool], walk: Walk) {
    if !dead.contains(&true) {
        return;
    }
    let mut next = 0_u64;
    let number: Vec<u64> = dead
        .iter()
        .map(|&dead| {
            let n = next;
            next += u64::from(!dead);
            n
        })
        .collect();
    walk(root, &mut |v| {
        if let Some(&n) = whole(v).and_then(|n| number.get(n as usize)) {
            *v = n.into();
        }
    });
    let mut i = 0;
    let items = array(root, key);
    items.retain(|_| {
        i += 1;
        !dead[i - 1]
    });
    if items.is_empty() {
        object(root).shift_remove(key);
    }
}

/// `gone` without `kept`: disjoint, ascending.
fn subtract(mut gone: Vec<Range>, mut kept: Vec<Range>) -> Vec<(u64, u64)> {
    gone.sort_unstable();
    kept.sort_unstable();
    let mut out: Vec<(u64, u64)> = Vec::new();
    let mut done = 0;
    let mut k = 0;
    for g in gone {
        let mut at = g.start.max(done);
        // Kept ranges are sorted by start; those that end before this point may still matter to none after it.
        while k < kept.len() && kept[k].end <= at && kept[k].start <= at {
            k += 1;
        }
        for r in kept[k..].iter().take_while(|r| r.start < g.end) {
            if r.start > at {
                out.push((at, r.start));
            }
            at = at.max(r.end);
        }
        if at < g.end {
            out.push((at, g.end));
        }
        done = done.max(g.end);
    }
    // Touching ranges are one.
    let mut merged: Vec<(u64, u64)> = Vec::new();
    for (a, b) in out {
        match merged.last_mut() {
            Some(last) if last.1 == a => last.1 = b,
            _ => merged.push((a, b)),
        }
    }
    merged
}

/// Takes the cuts out of a buffer.
pub(crate) fn cut(bytes: &[u8], cuts: &[(u64, u64)]) -> Vec<u8> {
    let mut out = Vec::with_capacity(bytes.len());
    let mut at = 0;
    for &(start, end) in cuts {
        let (start, end) = ((start as usize).min(bytes.len()), (end as usize).min(bytes.len()));
        out.extend_from_slice(&bytes[at..start]);
        at = end;
    }
    out.extend_from_slice(&bytes[at..]);
    out
}

/// Whether any primitive still uses an extension.
pub(crate) fn primitives_use(root: &Value, name: &str) -> bool {
    let primitives = list(root, "meshes").iter().flat_map(|m| list(m, "primitives"));
    primitives.into_iter().any(|p| extension(p, name).is_some())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn subtract_leaves_what_nobody_keeps() {
        let r = |start, end| Range { buffer: 0, start, end };
        assert_eq!(subtract(vec![r(0, 100)], vec![]), [(0, 100)]);
        assert_eq!(subtract(vec![r(0, 100)], vec![r(10, 20), r(50, 60)]), [(0, 10), (20, 50), (60, 100)]);
        assert_eq!(subtract(vec![r(0, 50), r(40, 100)], vec![r(0, 5), r(90, 200)]), [(5, 90)]);
        assert_eq!(subtract(vec![r(10, 20)], vec![r(0, 30)]), []);
        assert_eq!(subtract(vec![r(10, 20), r(30, 40)], vec![r(0, 12), r(1, 35)]), [(35, 40)]);
    }

    #[test]
    fn cut_takes_ranges_out() {
        assert_eq!(cut(&[0, 1, 2, 3, 4, 5], &[(1, 3), (5, 6)]), [0, 3, 4]);
    }
}
