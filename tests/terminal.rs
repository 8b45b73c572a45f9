//! What the program prints and where: configuration, colours, pipes, help.
#![allow(clippy::unwrap_used, clippy::print_stdout)] // helpers of tests are tests

mod harness;

use std::process::{Command, Stdio};

use harness::{Folder, command, data, draft, fail, lightkiln, succeed};

#[test]
fn print_config_reads_back_as_the_same_settings() {
    let folder = Folder::new("config");
    let settings = [
        "--max-error",
        "0.02",
        "--detail",
        "0.25",
        "--seed",
        "7",
        "--fallback",
        "none",
        "--max-bytes",
        "2MiB",
        "--ao-distance",
        "inf",
        "--exr",
    ];
    let (input, out) = (data("half_box.glb"), folder.path("out.glb"));
    let print = |extra: &[&str]| {
        let mut arguments = draft(&input, &out, extra);
        arguments.push("--print-config".as_ref());
        succeed(arguments)
    };
    let text = print(&settings);
    for line in
        ["max-error = 0.02", "detail = 0.25", "quality = \"draft\"", "ao-distance = inf", "exr = true"]
    {
        assert!(text.lines().any(|l| l == line), "{line} is missing: {text}");
    }
    let config = folder.write("c.toml", &text);
    assert_eq!(print(&["--config", config.to_str().unwrap()]), text);
    // The command line wins, and a number of samples takes the place of a detail.
    let other = print(&["--config", config.to_str().unwrap(), "--samples", "9"]);
    assert!(other.contains("samples = 9") && !other.contains("detail"), "{other}");
    assert!(!out.exists());
}

#[test]
fn config_with_a_fault_is_named_by_line() {
    let folder = Folder::new("bad-config");
    let (input, out) = (data("half_box.glb"), folder.path("out.glb"));
    for (name, line, fault) in [
        ("unknown.toml", "maxerror = 0.1", "maxerror"),
        ("negative.toml", "samples = -5", "-5"),
        ("huge.toml", "seed = 99999999999999999999999999", ""),
        ("type.toml", "exr = \"yes\"", ""),
        ("choice.toml", "quality = \"best\"", "best"),
        ("bytes.toml", "max-bytes = \"2 parsecs\"", "parsecs"),
        ("syntax.toml", "detail = = 1", ""),
    ] {
        let config = folder.write(name, format!("# settings\n\n{line}\n"));
        let said = fail(1, draft(&input, &out, &["--config", config.to_str().unwrap()]));
        assert!(
            said.contains(&format!("{name}:3")) && said.contains(fault) && said.contains("help: "),
            "{said}"
        );
        assert!(!out.exists(), "{name}");
    }
    for (line, fault) in [
        ("max-error = 1e30", "--max-error"),
        ("max-error = -0.5", "--max-error"),
        ("detail = nan", "--detail"),
        ("detail = inf", "--detail"),
        ("ao-distance = -inf", "--ao-distance"),
        ("samples = 0", "--samples"),
        ("scene = 4000000000", "4000000000"),
        ("samples = 1\ndetail = 1.0", "exclude"),
    ] {
        let config = folder.write("values.toml", line);
        let said = fail(1, draft(&input, &out, &["--config", config.to_str().unwrap()]));
        assert!(said.contains(fault) && said.contains("help: "), "{line}: {said}");
        assert!(!out.exists(), "{line}");
    }
    for line in ["samples = 9000000000000000000", "detail = 1e-30"] {
        let config = folder.write("values.toml", line);
        let said = fail(4, draft(&input, &out, &["--config", config.to_str().unwrap()]));
        assert!(said.contains("larger --detail or fewer --samples"), "{line}: {said}");
        assert!(!out.exists(), "{line}");
    }
    let said = fail(2, draft(&input, &out, &["--config", "nowhere.toml"]));
    assert!(said.contains("nowhere.toml"), "{said}");
}

#[test]
fn print_into_a_closed_pipe_is_no_failure() {
    let folder = Folder::new("pipe");
    let (input, out) = (data("half_box.glb"), folder.path("out.glb"));
    let mut child = command(draft(&input, &out, &["--json"])).stdout(Stdio::piped()).spawn().unwrap();
    drop(child.stdout.take());
    assert_eq!(child.wait().unwrap().code(), Some(0));
    assert!(out.exists());
    for arguments in [["--help"], ["--version"]] {
        let mut child = command(arguments).stdout(Stdio::piped()).spawn().unwrap();
        drop(child.stdout.take());
        assert_eq!(child.wait().unwrap().code(), Some(0), "{arguments:?}");
    }
}

#[test]
fn print_onto_a_full_disk_is_a_failure() {
    let full = || std::fs::File::options().write(true).open("/dev/full").unwrap();
    let input = data("half_box.glb");
    let output = command(["inspect".as_ref(), input.as_os_str()]).stdout(full()).output().unwrap();
    assert_eq!(output.status.code(), Some(2), "{}", String::from_utf8_lossy(&output.stderr));
}

#[test]
fn quiet_bake_says_nothing() {
    let folder = Folder::new("quiet");
    let (input, out) = (data("half_box.glb"), folder.path("out.glb"));
    let output = lightkiln(draft(&input, &out, &[]));
    assert!(output.status.success() && output.stdout.is_empty() && output.stderr.is_empty(), "{output:?}");
}

/// What the program writes to a terminal; none where `script` of util-linux is missing.
fn on_a_terminal(line: &str, no_color: bool) -> Option<String> {
    let mut script = Command::new("script");
    script.args(["-qec", line, "/dev/null"]).stdin(Stdio::null()).env("TERM", "xterm").env_remove("NO_COLOR");
    if no_color {
        script.env("NO_COLOR", "1");
    }
    let output = script.output().ok()?;
    Some(String::from_utf8_lossy(&output.stdout).into_owned())
}

#[test]
fn colors_on_a_terminal_only_and_never_with_no_color() {
    let line = format!("'{}' inspect nowhere.glb", env!("CARGO_BIN_EXE_lightkiln"));
    let Some(said) = on_a_terminal(&line, false) else {
        println!("no `script` to make a terminal with: skipped");
        return;
    };
    assert!(said.contains("\u{1b}[1;31merror:"), "{said:?}");
    let said = on_a_terminal(&line, true).unwrap();
    assert!(said.contains("error:") && !said.contains('\u{1b}'), "{said:?}");
    assert!(!fail(2, ["inspect", "nowhere.glb"]).contains('\u{1b}'));
}

#[test]
fn help_tells_the_exit_codes() {
    let help = succeed(["--help"]);
    for code in (0..=7).chain([130]) {
        assert!(help.contains(&format!("{code} ")), "{code} is missing: {help}");
    }
}
