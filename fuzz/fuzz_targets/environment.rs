//! Any bytes: an error or an environment map, never a panic and never more memory than they deserve.
//!
//! `cargo +nightly fuzz run environment` (from the repository root). `crates/scene/tests/environment.rs` does a part
//! of this with the stable compiler.
#![no_main]

use libfuzzer_sys::fuzz_target;
use lightkiln_scene::decode_environment;

fuzz_target!(|bytes: &[u8]| {
    if let Ok(map) = decode_environment(bytes) {
        assert_eq!(map.pixels.len(), map.width * map.height);
        assert!(map.pixels.iter().flatten().all(|x| x.is_finite() && *x >= 0.0));
    }
});
