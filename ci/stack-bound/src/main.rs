//! `stack-bound firmware.elf`: prints the worst case with its calls; exit code 1 where it has none
//! or exceeds a limit.

use std::path::PathBuf;
use std::process::ExitCode;

use clap::Parser;
use stack_bound::{Options, bound};

/// The worst-case stack use of a Cortex-M ELF, with the calls that lead there.
#[derive(Parser)]
#[command(version)]
struct Arguments {
    /// The ELF, with symbols.
    elf: PathBuf,
    /// The stack's addresses, `LOW..TOP`; by default from cortex-m-rt's symbols.
    #[arg(long, value_name = "LOW..TOP", value_parser = range)]
    stack: Option<std::ops::Range<u32>>,
    /// The start of the RAM, where the stack must end so that an overflow faults.
    #[arg(long, value_parser = number)]
    ram_start: Option<u32>,
    /// The vector table's address; by default a symbol's.
    #[arg(long, value_parser = number)]
    vectors: Option<u32>,
    /// The priority bits that the chip implements.
    #[arg(long, default_value_t = 8, value_parser = clap::value_parser!(u32).range(1..=8))]
    priority_bits: u32,
    /// The possible callees of an indirect call, `CALLER=CALLEE,CALLEE`.
    #[arg(long, value_parser = calls)]
    call: Vec<(String, Vec<String>)>,
    /// Fail above this many bytes.
    #[arg(long)]
    at_most: Option<u32>,
}

fn number(text: &str) -> Result<u32, std::num::ParseIntError> {
    match text.strip_prefix("0x") {
        Some(hex) => u32::from_str_radix(hex, 16),
        None => text.parse(),
    }
}

fn range(text: &str) -> Result<std::ops::Range<u32>, String> {
    let (low, top) = text.split_once("..").ok_or("not LOW..TOP")?;
    let number = |text| number(text).map_err(|error| error.to_string());
    Ok(number(low)?..number(top)?)
}

fn calls(text: &str) -> Result<(String, Vec<String>), &'static str> {
    let (caller, callees) = text.split_once('=').ok_or("not CALLER=CALLEE,CALLEE")?;
    Ok((
        caller.to_owned(),
        callees.split(',').map(str::to_owned).collect(),
    ))
}

fn main() -> ExitCode {
    let arguments = Arguments::parse();
    let options = Options {
        stack: arguments.stack,
        ram_start: arguments.ram_start,
        vectors: arguments.vectors,
        priority_bits: arguments.priority_bits,
        calls: arguments.call.into_iter().collect(),
    };
    let elf = std::fs::read(&arguments.elf).map_err(|error| error.to_string());
    let report = elf.and_then(|elf| bound(&elf, &options).map_err(|error| error.to_string()));
    match report {
        Ok(report) => {
            println!("{report}");
            let limit = arguments.at_most.unwrap_or(report.reserved);
            if report.worst() <= limit {
                return ExitCode::SUCCESS;
            }
            eprintln!("stack-bound: {} bytes exceed {limit}", report.worst());
        }
        Err(error) => eprintln!("stack-bound: {}: {error}", arguments.elf.display()),
    }
    ExitCode::FAILURE
}
