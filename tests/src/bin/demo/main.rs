//! The whole robot, end to end, without hardware: boots the release ELF on the virtual board with a
//! blank EEPROM, configures it as a user would, lets it explore the default room in an imperfect world
//! and leaves the map, the trajectory and a page of figures. With `--tour` it drives the room's tour in
//! an ideal world instead.
//!
//! Exit code 1 where a bar is missed, 2 on a wrong argument.
#![forbid(unsafe_code)]

mod explore;
mod report;
mod tour;

use std::error::Error;
use std::fs;
use std::path::{Path, PathBuf};
use std::time::Instant;

use clap::Parser;
use fw_core::eeprom::Field;
use host_link::board_io::BoardIo;
use host_link::eeprom;
use host_link::settings::Settings;
use report::Bars;
use robot_tests::exploration;
use robot_tests::stack::Stack;
use robot_tests::test_board;
use serde_json::{Value, json};
use twin::plant::{Imperfections, Room};
use twin::{Board, Options};

/// The configuration that the demo writes, as a user would.
const CONFIGURATION: &str = "host-link/config/first-board.toml";
/// How long READY must stay low with a blank EEPROM, microseconds.
const REFUSAL_US: u64 = 1_000_000;

/// Explores the default room on the virtual board and writes map, trajectory and report.
#[derive(Parser)]
struct Arguments {
    /// The release ELF
    #[arg(long)]
    elf: PathBuf,
    /// Where the files go
    #[arg(long, default_value = "target/demo")]
    out: PathBuf,
    /// Seed of all random numbers
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Drive the room's tour in an ideal world
    #[arg(long)]
    tour: bool,
}

fn main() {
    twin::processor::keep_to_one();
    let missed = run(&Arguments::parse()).unwrap_or_else(|error| vec![error.to_string()]);
    for missed in &missed {
        eprintln!("demo: missed: {missed}");
    }
    std::process::exit(i32::from(!missed.is_empty()));
}

/// Returns the bars that were missed.
fn run(arguments: &Arguments) -> Result<Vec<String>, Box<dyn Error>> {
    let (begun, out) = (Instant::now(), &arguments.out);
    let elf = fs::read(&arguments.elf).map_err(|e| format!("{}: {e}", arguments.elf.display()))?;
    fs::create_dir_all(out)?;
    let room = Room::two_rooms();

    println!("1/4  boot with a blank EEPROM");
    let (world, kind, changes) = if arguments.tour {
        (Imperfections::none(), "tour", &[][..])
    } else {
        (Imperfections::default(), "demo", &exploration::CHANGES[..])
    };
    let (board, stack) = boot_blank(&elf, exploration::options(&room, world, arguments.seed))?;
    println!("2/4  write {CONFIGURATION} to the EEPROM");
    let mut machine = test_board::io(&board);
    let reset_to_ready_ms = configure(&mut machine, changes)?;
    let mut report = if arguments.tour {
        println!("3/4  drive through {} way-points", room.tour.len());
        tour::run(&mut machine, &board, &room, out)?
    } else {
        println!("3/4  explore a room that the robot does not know");
        explore::run(&mut machine, &board, &room, out)?
    };

    println!("4/4  report");
    fs::write(out.join("uart.log"), board.uart())?;
    let unmodelled = board.unmodelled();
    let truth = board.truth();
    extend(
        &mut report,
        json!({
            "seed": arguments.seed,
            "virtual_seconds": seconds(board.now_us()),
            "wall_seconds": begun.elapsed().as_secs_f64(),
            "path_m": truth.path_mm / 1000.0,
            "reset_to_ready_ms": reset_to_ready_ms,
            "collisions": truth.collisions,
            "instructions": board.instructions(),
            "stack_used_bytes": stack.used(&board),
            "unmodelled_registers": unmodelled.len(),
            "unmodelled": unmodelled,
        }),
    );
    let bars = Bars::of(kind)?;
    let missed = bars.missed(&report);
    report["missed_bars"] = json!(missed);
    fs::write(
        out.join("report.json"),
        serde_json::to_string_pretty(&report)? + "\n",
    )?;
    let tour = if arguments.tour { " --tour" } else { "" };
    let command = format!("cargo xtask demo --seed {}{tour}", arguments.seed);
    let page = report::page(&report, &bars, &command);
    fs::write(out.join("report.md"), &page)?;
    println!("\n{page}\nLeft in {}", out.display());
    Ok(missed)
}

/// A blank EEPROM must keep the robot from starting, and the log must say so.
fn boot_blank(elf: &[u8], options: Options) -> Result<(Board, Stack), Box<dyn Error>> {
    let board = Board::new(elf, options)?;
    let stack = Stack::paint(elf, &board)?;
    if board.run_until(REFUSAL_US, 10_000, Board::is_ready) {
        return Err("READY rose without a configuration".into());
    }
    let log = String::from_utf8_lossy(&board.uart()).into_owned();
    let refusal = log
        .lines()
        .find(|line| line.starts_with('E'))
        .ok_or("READY stays low and the log does not say why")?;
    println!("     READY stays low: {refusal}");
    Ok((board, stack))
}

/// Writes the sample configuration with these changes, as `robot eeprom write` does; milliseconds to READY.
fn configure(machine: &mut BoardIo, changes: &[(&Field, u64)]) -> Result<u32, Box<dyn Error>> {
    let settings = Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("..")
        .join(CONFIGURATION);
    let settings = Settings::load(&settings)?.with(changes)?;
    let programmed = eeprom::program(
        machine,
        settings.image(),
        exploration::READY_MS,
        None,
        |_| {},
    )?;
    println!(
        "     {} bytes in {} bursts, READY after {} ms",
        programmed.bytes, programmed.bursts, programmed.ready_ms
    );
    Ok(programmed.ready_ms)
}

/// Adds figures to a report.
fn extend(report: &mut Value, more: Value) {
    if let (Value::Object(report), Value::Object(more)) = (report, more) {
        report.extend(more);
    }
}

/// Virtual and wall time of a drive.
struct Timer(u64, Instant);

impl Timer {
    fn start(board: &Board) -> Self {
        Self(board.now_us(), Instant::now())
    }

    fn figures(&self, board: &Board) -> Value {
        let driving = seconds(board.now_us() - self.0);
        let factor = driving / self.1.elapsed().as_secs_f64();
        json!({"driving_virtual_seconds": driving, "realtime_factor": factor})
    }
}

#[allow(clippy::cast_precision_loss)] // exact below 285 years
fn seconds(us: u64) -> f64 {
    us as f64 / 1e6
}
