//! The user's program: see [`vibroimpact::cli`].

use std::process::ExitCode;

fn main() -> ExitCode {
    ExitCode::from(vibroimpact::cli::main(std::env::args_os()))
}
