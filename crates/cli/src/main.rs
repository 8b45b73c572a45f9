//! The `lightkiln` program: arguments, files, messages.
//!
//! | module | what |
//! |---|---|
//! | [`arguments`] | the command line and the configuration file |
//! | [`commands`] | one function per command |
//! | [`progress`] | bars on a terminal, plain lines elsewhere |
//! | [`pictures`] | the command `render` |
//! | [`stations`] | where pictures are taken from |
//! | [`studio`], [`shaded`] | what they show of one scene |
//! | [`view`] | the command `view`, and the report as a page |
//! | [`preview`] | `bake --preview`, and what stops a bake |
//! | [`shape`] | what the page draws of a scene |
//! | [`vertices`] | the commands `compare` and `fit` |
//! | [`messages`] | errors with place and remedy, exit codes |
//! | [`files`] | outputs that appear whole or not at all |

mod arguments;
mod commands;
mod files;
mod light;
mod messages;
mod pictures;
mod preview;
mod progress;
mod shaded;
mod shape;
mod stations;
mod studio;
mod vertices;
mod view;

use std::process::ExitCode;

use clap::Parser;

fn main() -> ExitCode {
    let arguments = match arguments::Arguments::try_parse() {
        Ok(arguments) => arguments,
        Err(error) => return messages::usage(&error),
    };
    match commands::run(arguments) {
        Ok(code) => code.into(),
        Err(failure) => messages::fail(&failure),
    }
}
