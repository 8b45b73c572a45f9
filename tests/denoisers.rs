//! What takes the noise out of light: our own filter, Open Image Denoise, or nothing.
#![allow(clippy::unwrap_used)] // helpers of tests are tests

mod harness;

use std::path::Path;
#[cfg(feature = "oidn")]
use std::{path::PathBuf, process::Command};

use harness::{Folder, bake_anyhow, command, data, draft, fail, verify};
use serde_json::Value;

/// Texels alone: what vertices are fitted to is filtered by the fit as well.
const LIGHT: [&str; 6] = ["--signal", "indirect", "--samples", "3000", "--profile", "lightmap"];

fn with<'a>(extra: &[&'a str]) -> Vec<&'a str> {
    LIGHT.iter().chain(extra).copied().collect()
}

/// Bakes the light of the small room; gives back the report and the bytes.
fn baked(folder: &Folder, name: &str, extra: &[&str]) -> (Value, Vec<u8>) {
    let output = folder.path(name);
    let report = bake_anyhow(&data("cornell.glb"), &output, &with(extra));
    (report, std::fs::read(output).unwrap())
}

/// The error of what the file shows, with the noise of the references.
fn rmse(report: &Value) -> f64 {
    report["errors"]["hybrid"]["rmse"].as_f64().unwrap()
}

/// A bake with Open Image Denoise that ends with this exit code: what it said in one message, with its remedy.
fn refused(code: i32, folder: &Folder, variables: &[(&str, &Path)]) -> String {
    let before = folder.names();
    let output = folder.path("out.glb");
    let mut run = command(draft(&data("cornell.glb"), &output, &with(&["--denoiser", "oidn"])));
    let output = run.envs(variables.iter().copied()).output().unwrap();
    let said = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(code), "{said}");
    assert_eq!(said.lines().filter(|line| line.starts_with("error: ")).count(), 1, "{said}");
    assert_eq!(folder.names(), before, "something was left behind");
    assert!(said.contains("Open Image Denoise") && said.contains("choose --denoiser own"), "{said}");
    said
}

#[test]
fn denoiser_none_leaves_the_noise_that_our_own_takes_away() {
    let folder = Folder::new("denoiser-none");
    let (own, own_bytes) = baked(&folder, "own.glb", &[]);
    let (named, named_bytes) = baked(&folder, "named.glb", &["--denoiser", "own"]);
    assert_eq!(own_bytes, named_bytes);
    assert_eq!(own["errors"], named["errors"]);
    let (none, none_bytes) = baked(&folder, "none.glb", &["--denoiser", "none"]);
    assert_ne!(own_bytes, none_bytes);
    assert_eq!(["own", "none"], [&own, &none].map(|report| report["settings"]["denoiser"].as_str().unwrap()));
    assert!(rmse(&none) > 1.2 * rmse(&own), "{} {}", rmse(&none), rmse(&own));
    verify(&folder.path("none.glb"));
    // The configuration file says it as well.
    let config = folder.write("bake.toml", "denoiser = \"none\"\n");
    let (_, config_bytes) = baked(&folder, "config.glb", &["--config", config.to_str().unwrap()]);
    assert_eq!(config_bytes, none_bytes);
}

#[test]
fn denoiser_of_an_unknown_name_is_refused() {
    let folder = Folder::new("denoiser-name");
    let said = fail(1, draft(&data("cornell.glb"), &folder.path("out.glb"), &["--denoiser", "magic"]));
    assert!(["own", "oidn", "none"].iter().all(|name| said.contains(name)), "{said}");
    assert!(folder.names().is_empty());
}

#[cfg(not(feature = "oidn"))]
#[test]
fn oidn_that_is_not_part_of_the_build_is_refused() {
    let said = refused(5, &Folder::new("oidn-not-built"), &[]);
    assert!(said.contains("not part of this build") && said.contains("build with --features oidn"), "{said}");
}

#[cfg(feature = "oidn")]
mod built {
    use super::*;

    const LIBRARY: &str = "LIGHTKILN_OIDN";
    const TOLD: &str = "OIDN_STUB";

    /// A library that filters nothing: `tests/oidn/stub.rs`.
    fn stub(folder: &Folder, flags: &[&str]) -> PathBuf {
        let library = folder.path("stub.so");
        let source = concat!(env!("CARGO_MANIFEST_DIR"), "/../../tests/oidn/stub.rs");
        let rustc = std::env::var_os("RUSTC").unwrap_or_else(|| "rustc".into());
        let mut compiler = Command::new(rustc);
        compiler.args(["--edition", "2024", "--crate-type", "cdylib", "-C", "panic=abort", source, "-o"]);
        let output = compiler.arg(&library).args(flags).output().unwrap();
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        library
    }

    /// Nothing was tested: that must be seen.
    #[allow(clippy::print_stdout)] // the only place where a test that passes can say so
    fn skipped(why: &lightkiln_bake::BakeError) {
        println!("!! SKIPPED: {why}");
    }

    #[test]
    fn oidn_whose_library_is_missing_or_another_is_refused() {
        let folder = Folder::new("oidn-missing");
        let nowhere = folder.path("nowhere.so");
        let said = refused(5, &folder, &[(LIBRARY, &nowhere)]);
        assert!(said.contains("nowhere.so") && said.contains("LIGHTKILN_OIDN"), "{said}");
        let text = folder.write("text.so", "not a library");
        assert!(refused(5, &folder, &[(LIBRARY, &text)]).contains("text.so"));
        if cfg!(target_os = "linux") {
            let said = refused(5, &folder, &[(LIBRARY, Path::new("libc.so.6"))]);
            assert!(said.contains("libc.so.6 is another library"), "{said}");
        }
    }

    #[test]
    fn oidn_of_another_version_is_refused() {
        let folder = Folder::new("oidn-version");
        let old = stub(&folder, &["--cfg", "version_1"]);
        let said = refused(5, &folder, &[(LIBRARY, &old)]);
        assert!(said.contains("version 1;") && said.contains("install version 2"), "{said}");
        let new = stub(&folder, &[]);
        let said = refused(5, &folder, &[(LIBRARY, &new), (TOLD, Path::new("version-3"))]);
        assert!(said.contains("version 3;") && said.contains("install version 2"), "{said}");
    }

    #[test]
    fn oidn_that_fails_or_has_no_memory_ends_the_bake_with_its_words() {
        let folder = Folder::new("oidn-fails");
        let library = stub(&folder, &[]);
        let told = |what| [(LIBRARY, library.as_path()), (TOLD, Path::new(what))];
        let said = refused(4, &folder, &told("fault"));
        assert!(said.contains("failed: the stub was told to fail"), "{said}");
        let said = refused(4, &folder, &told("no-memory"));
        assert!(said.contains("no memory for an image of") && said.contains("--detail"), "{said}");
    }

    #[test]
    fn oidn_bakes_through_a_library_that_filters_nothing() {
        let folder = Folder::new("oidn-nothing");
        let library = stub(&folder, &[]);
        let output = folder.path("out.glb");
        let more = ["--denoiser", "oidn", "--json"];
        let run = command(draft(&data("cornell.glb"), &output, &with(&more))).env(LIBRARY, library).output();
        let report: Value = serde_json::from_slice(&run.unwrap().stdout).unwrap();
        assert_eq!(report["settings"]["denoiser"], "oidn");
        let (none, _) = baked(&folder, "none.glb", &["--denoiser", "none"]);
        // Texels keep the light that they have.
        assert!((rmse(&report) / rmse(&none) - 1.0).abs() < 0.05, "{} {}", rmse(&report), rmse(&none));
        verify(&output);
    }

    #[test]
    fn oidn_filters_texels_and_gives_the_same_bytes_for_any_number_of_threads() {
        if let Err(error) = lightkiln_bake::Denoiser::Oidn.check() {
            skipped(&error);
            return;
        }
        let folder = Folder::new("oidn-threads");
        let more = ["--denoiser", "oidn"];
        let (one, one_bytes) = baked(&folder, "one.glb", &[&more[..], &["--threads", "1"]].concat());
        let (_, two_bytes) = baked(&folder, "two.glb", &[&more[..], &["--threads", "2"]].concat());
        assert!(one_bytes == two_bytes, "threads change bytes");
        let (none, none_bytes) = baked(&folder, "none.glb", &["--denoiser", "none"]);
        assert!(one_bytes != none_bytes, "nothing was filtered");
        assert!(rmse(&none) > 1.2 * rmse(&one), "{} {}", rmse(&none), rmse(&one));
        // Harmonics are filtered as shares of the first.
        let sh = ["--signal", "sh1", "--samples", "2000", "--denoiser"];
        let of = |name: &str, denoiser| {
            let report =
                bake_anyhow(&data("cornell.glb"), &folder.path(name), &[&sh[..], &[denoiser]].concat());
            rmse(&report)
        };
        let (oidn, none) = (of("sh.glb", "oidn"), of("sh-none.glb", "none"));
        assert!(oidn < none, "{oidn} {none}");
    }
}
