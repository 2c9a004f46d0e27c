//! `stack-bound firmware.elf` prints the bound with its calls; see the README.

use std::path::PathBuf;
use std::process::ExitCode;

use clap::Parser;
use stack_bound::{Options, bound};

/// The worst-case stack use of a Cortex-M ELF, with the calls that lead there
#[derive(Parser)]
#[command(version)]
struct Arguments {
    /// The ELF, with symbols
    elf: PathBuf,
    #[command(flatten)]
    options: Options,
}

fn main() -> ExitCode {
    let arguments = Arguments::parse();
    let elf = std::fs::read(&arguments.elf).map_err(|error| error.to_string());
    let bound = |elf: Vec<u8>| bound(&elf, &arguments.options).map_err(|error| error.to_string());
    let why = match elf.and_then(bound) {
        Err(error) => error,
        Ok(report) => {
            println!("{report}");
            if report.worst() <= report.reserved {
                return ExitCode::SUCCESS;
            }
            "the stack can overflow".into()
        }
    };
    eprintln!("stack-bound: {}: {why}", arguments.elf.display());
    ExitCode::FAILURE
}
