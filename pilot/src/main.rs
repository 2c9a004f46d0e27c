//! `robot`: configures, drives and maps with the robot, real or virtual.
#![forbid(unsafe_code)]

mod cli;

use std::process::ExitCode;

fn main() -> ExitCode {
    cli::main()
}
