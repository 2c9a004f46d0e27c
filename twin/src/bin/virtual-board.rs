//! The virtual board on its own: runs a firmware in real time, prints its log, and serves a
//! debugger.
//!
//! With `--gdb` the core waits for the debugger before its first instruction, unless `--run` is
//! given. The address it listens on is printed first.
#![forbid(unsafe_code)]

use std::error::Error;
use std::io::Write;
use std::net::TcpListener;
use std::num::NonZeroU64;
use std::path::PathBuf;
use std::process::ExitCode;
use std::time::{Duration, Instant};

use clap::Parser;
use twin::plant::{Imperfections, Params};
use twin::{Board, Debugger, Options};

/// Virtual time between two reads of the log.
const STEP: Duration = Duration::from_millis(5);

/// Runs a firmware on the virtual board in real time.
#[derive(Parser)]
struct Arguments {
    /// The firmware's ELF file; without one the core sleeps
    #[arg(long)]
    elf: Option<PathBuf>,
    /// File with the EEPROM's contents
    #[arg(long)]
    eeprom: Option<PathBuf>,
    /// Seed of everything random
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// A world without imperfections
    #[arg(long)]
    ideal: bool,
    /// Listens for a debugger on ADDRESS:PORT; port 0 takes any free one
    #[arg(long, value_name = "ADDRESS:PORT")]
    gdb: Option<String>,
    /// Does not wait for the debugger
    #[arg(long)]
    run: bool,
    /// Instructions a microsecond, printed at the start
    #[arg(long, default_value_t = Options::default().mips)]
    mips: NonZeroU64,
}

fn read(path: Option<&PathBuf>) -> Result<Vec<u8>, String> {
    path.map_or(Ok(Vec::new()), |path| {
        std::fs::read(path).map_err(|error| format!("{}: {error}", path.display()))
    })
}

fn run(arguments: &Arguments) -> Result<(), Box<dyn Error>> {
    let elf = read(arguments.elf.as_ref())?;
    let mut out = std::io::stdout();
    let debugger = match &arguments.gdb {
        Some(address) => {
            let listener = TcpListener::bind(address);
            let listener = listener.map_err(|error| format!("{address}: {error}"))?;
            println!("gdb: {}", listener.local_addr()?);
            out.flush()?;
            Some(Debugger {
                listener,
                wait: !arguments.run,
            })
        }
        None => None,
    };
    let imperfections = if arguments.ideal {
        Imperfections::none()
    } else {
        Imperfections::default()
    };
    let options = Options {
        seed: arguments.seed,
        params: Params {
            imperfections,
            ..Params::default()
        },
        mips: arguments.mips,
        debugger,
        ..Options::with_eeprom(read(arguments.eeprom.as_ref())?)
    };
    println!("core: {} instructions a microsecond", arguments.mips);
    let board = Board::new(&elf, options)?;
    let mut shown = 0;
    let mut due = Instant::now();
    loop {
        let step = u64::try_from(STEP.as_nanos()).unwrap_or(u64::MAX);
        if let Err(ended) = board.try_run_ns(step) {
            println!("{ended}");
            return Ok(());
        }
        let log = board.uart_from(shown);
        out.write_all(&log).and_then(|()| out.flush())?;
        shown += log.len();
        due += STEP;
        match due.checked_duration_since(Instant::now()) {
            Some(early) => std::thread::sleep(early),
            None => due = Instant::now(),
        }
    }
}

fn main() -> ExitCode {
    match run(&Arguments::parse()) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("virtual-board: {error}");
            ExitCode::from(2)
        }
    }
}
