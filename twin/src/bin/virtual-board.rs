//! The virtual board on its own: runs a firmware in real time, prints its log, and serves a
//! debugger.
//!
//! `virtual-board --elf FILE [--gdb ADDRESS:PORT] [--eeprom FILE] [--run]`
//!
//! With `--gdb` the core waits for the debugger before its first instruction (unless `--run` says
//! otherwise); port 0 takes any free one. The address it listens on is printed first.
#![forbid(unsafe_code)]

use std::io::Write;
use std::net::TcpListener;
use std::process::ExitCode;
use std::time::{Duration, Instant};

use twin::{Board, Debugger, Options};

/// Virtual time between two looks at the log.
const STEP: Duration = Duration::from_millis(5);

struct Arguments {
    elf: Option<String>,
    eeprom: Option<String>,
    gdb: Option<String>,
    run: bool,
}

fn arguments() -> Result<Arguments, String> {
    let mut given = Arguments {
        elf: None,
        eeprom: None,
        gdb: None,
        run: false,
    };
    let mut words = std::env::args().skip(1);
    while let Some(word) = words.next() {
        let mut value = || words.next().ok_or_else(|| format!("{word} needs a value"));
        match word.as_str() {
            "--elf" => given.elf = Some(value()?),
            "--eeprom" => given.eeprom = Some(value()?),
            "--gdb" => given.gdb = Some(value()?),
            "--run" => given.run = true,
            _ => return Err(format!("{word} is not an option")),
        }
    }
    Ok(given)
}

fn read(path: Option<&String>) -> Result<Vec<u8>, String> {
    path.map_or(Ok(Vec::new()), |path| {
        std::fs::read(path).map_err(|error| format!("{path}: {error}"))
    })
}

fn run() -> Result<(), String> {
    let given = arguments()?;
    let elf = read(given.elf.as_ref())?;
    let debugger = given
        .gdb
        .map(|address| -> Result<Debugger, String> {
            let listener =
                TcpListener::bind(&address).map_err(|error| format!("{address}: {error}"))?;
            let bound = listener.local_addr().map_err(|error| error.to_string())?;
            println!("gdb: {bound}");
            Ok(Debugger {
                listener,
                wait: !given.run,
            })
        })
        .transpose()?;
    // Whoever reads the address waits for it.
    std::io::stdout()
        .flush()
        .map_err(|error| error.to_string())?;
    let options = Options {
        eeprom: Some(read(given.eeprom.as_ref())?),
        debugger,
        ..Options::default()
    };
    let board = Board::new(&elf, options).map_err(|ended| ended.to_string())?;
    let mut shown = 0;
    let mut due = Instant::now();
    loop {
        let step = u64::try_from(STEP.as_nanos()).unwrap_or(u64::MAX);
        if let Err(ended) = board.try_run_ns(step) {
            println!("{ended}");
            return Ok(());
        }
        let log = board.uart_from(shown);
        std::io::stdout()
            .write_all(&log)
            .and_then(|()| std::io::stdout().flush())
            .map_err(|error| error.to_string())?;
        shown += log.len();
        due += STEP;
        match due.checked_duration_since(Instant::now()) {
            Some(early) => std::thread::sleep(early),
            None => due = Instant::now(),
        }
    }
}

fn main() -> ExitCode {
    match run() {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("virtual-board: {error}");
            ExitCode::from(2)
        }
    }
}
