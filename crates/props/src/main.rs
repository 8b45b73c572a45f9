//! `lightkiln-props NAME [--size N] [--diagonal corner|other] -o FILE`, or `--list`.
#![allow(clippy::print_stdout, clippy::print_stderr)]

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use clap::{Parser, ValueEnum};
use lightkiln_props::{Diagonal, RECIPES, scene_with};

/// Makes the project's own scenes.
#[derive(Parser)]
#[command(name = "lightkiln-props", version)]
struct Arguments {
    /// The scene to make; see --list
    #[arg(required_unless_present = "list")]
    name: Option<String>,
    /// How large; what it counts depends on the scene
    #[arg(long)]
    size: Option<usize>,
    /// Which diagonal splits the squares of half_box
    #[arg(long, default_value = "corner")]
    diagonal: DiagonalArgument,
    /// The .glb file to write
    #[arg(short, long, required_unless_present = "list")]
    output: Option<PathBuf>,
    /// Lists the scenes
    #[arg(long)]
    list: bool,
}

#[derive(Clone, Copy, ValueEnum)]
enum DiagonalArgument {
    Corner,
    Other,
}

fn main() -> ExitCode {
    let arguments = Arguments::parse();
    if arguments.list {
        for r in RECIPES {
            let size = match r.sizes {
                (0, 0) => String::new(),
                (a, b) => format!(" [--size {a}..={b} {}, default {}]", r.size_is, r.default_size),
            };
            println!("{:12} {}{size}", r.name, r.about);
        }
        return ExitCode::SUCCESS;
    }
    let (Some(name), Some(output)) = (arguments.name, arguments.output) else { return ExitCode::FAILURE };
    let diagonal = match arguments.diagonal {
        DiagonalArgument::Corner => Diagonal::Corner,
        DiagonalArgument::Other => Diagonal::Other,
    };
    let bytes = match scene_with(&name, arguments.size, diagonal) {
        Ok(bytes) => bytes,
        Err(error) => {
            eprintln!("error: {error}\n  help: --list names the scenes and their sizes");
            return ExitCode::from(2);
        }
    };
    if let Err(error) = write_whole(&output, &bytes) {
        eprintln!("error: {error}\n  in {}", output.display());
        return ExitCode::FAILURE;
    }
    ExitCode::SUCCESS
}

/// Writes beside the file and renames, so that it appears whole or not at all.
fn write_whole(path: &Path, bytes: &[u8]) -> std::io::Result<()> {
    let mut beside = path.as_os_str().to_owned();
    beside.push(".part");
    let written = std::fs::write(&beside, bytes).and_then(|()| std::fs::rename(&beside, path));
    if written.is_err() {
        std::fs::remove_file(&beside).ok();
    }
    written
}
