//! The whole robot, end to end, without hardware: boots the release ELF on the virtual board with a
//! blank EEPROM, configures it as a user would, drives the default room's tour at 40 frames a second
//! and leaves the map, the trajectory and a page of figures.
//!
//! `demo --elf PATH [--out DIRECTORY] [--seed N]`; exit code 1 where a bar is missed, 2 on a wrong
//! argument.
#![forbid(unsafe_code)]

mod pose_error;
mod report;

use std::error::Error;
use std::fs;
use std::path::{Path, PathBuf};
use std::time::Instant;

use clap::Parser;
use fw_core::eeprom::fields;
use fw_core::wire::Mode;
use host_link::board_io::{BoardIo, Interrupt};
use host_link::drive::{self, ArrivalCriteria};
use host_link::eeprom;
use host_link::pose::Pose;
use host_link::session::{Session, RATE_HZ};
use host_link::settings::Settings;
use host_link::statistics::LinkStatistics;
use mapper::{map_iou, map_plot, MapScore};
use pilot::mapping::{mapper_config, Mapping, RangeSample};
use pilot::virtual_board;
use pose_error::PoseErrors;
use report::Report;
use robot_tests::stack::Stack;
use twin::plant::Room;
use twin::{Board, Options};

/// The configuration that the demo writes, as a user would.
const CONFIGURATION: &str = "host-link/config/first-board.toml";
/// How long READY must stay low with a blank EEPROM, microseconds.
const REFUSAL_US: u64 = 1_000_000;
/// How long READY may take after the configuration is written, milliseconds.
const READY_MS: u32 = 1_000;
/// The Pi's SPI clock, hertz.
const SPI_HZ: u32 = 8_000_000;
/// Cells of the map, millimetres.
const CELL_MM: f64 = 25.0;
/// How near an occupied cell and a wall must be to agree, millimetres.
const TOLERANCE_MM: f64 = 100.0;

/// Drives the default room's tour on the virtual board and writes map, trajectory and report.
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
}

fn main() {
    let arguments = Arguments::parse();
    match run(&arguments) {
        Ok(report) if report.missed_bars.is_empty() => {}
        Ok(report) => {
            for missed in report.missed_bars {
                eprintln!("demo: missed: {missed}");
            }
            std::process::exit(1);
        }
        Err(error) => {
            eprintln!("demo: {error}");
            std::process::exit(1);
        }
    }
}

fn run(arguments: &Arguments) -> Result<Report, Box<dyn Error>> {
    let wall = Instant::now();
    let elf = fs::read(&arguments.elf).map_err(|e| format!("{}: {e}", arguments.elf.display()))?;
    fs::create_dir_all(&arguments.out)?;
    let room = Room::two_rooms();

    println!("1/5  boot with a blank EEPROM");
    let (board, stack) = boot_blank(&elf, arguments.seed, &room)?;
    println!("2/5  write {CONFIGURATION} to the EEPROM");
    let mut machine = virtual_board::board_io(&board, SPI_HZ, Interrupt::new());
    let reset_to_ready_ms = configure(&mut machine)?;
    println!(
        "3/5  drive {:.1} m through {} way-points",
        room.tour_length_mm() / 1000.0,
        room.tour.len()
    );
    let drive = drive_tour(&mut machine, &board, &room)?;
    println!("4/5  draw the map");
    let score = draw(&drive, &board, &room, &arguments.out)?;

    println!("5/5  report");
    let unmodelled = board.unmodelled();
    let truth = board.truth();
    let mut report = Report {
        seed: arguments.seed,
        virtual_seconds: seconds(board.now_us()),
        wall_seconds: wall.elapsed().as_secs_f64(),
        realtime_factor: drive.virtual_seconds / drive.wall_seconds,
        driving_virtual_seconds: drive.virtual_seconds,
        path_m: truth.path_mm / 1000.0,
        way_points: room.tour.len(),
        frames_sent: drive.link.frames,
        frames_accepted: drive.link.accepted,
        frames_rejected: drive.link.rejected,
        reset_to_ready_ms,
        position_error_mm_max: drive.errors.worst_mm,
        heading_error_deg_max: drive.errors.worst_deg,
        position_error_mm_max_with_latency: drive.errors.late_mm,
        heading_error_deg_max_with_latency: drive.errors.late_deg,
        position_error_mm_end: drive.errors.last_mm,
        heading_error_deg_end: drive.errors.last_deg,
        map_iou: score.iou,
        map_precision: score.precision,
        map_recall: score.recall,
        collisions: truth.collisions,
        instructions: board.instructions(),
        stack_used_bytes: stack.used(&board),
        unmodelled_registers: unmodelled.lines.len(),
        unmodelled: unmodelled.lines,
        missed_bars: Vec::new(),
    };
    report.missed_bars = report.missed();
    let json = serde_json::to_string_pretty(&report)? + "\n";
    fs::write(arguments.out.join("report.json"), json)?;
    let page = report.page();
    fs::write(arguments.out.join("report.md"), &page)?;
    println!("\n{page}\nLeft in {}", arguments.out.display());
    Ok(report)
}

/// A blank EEPROM must keep the robot from starting, and the log must say so.
fn boot_blank(elf: &[u8], seed: u64, room: &Room) -> Result<(Board, Stack), Box<dyn Error>> {
    let board = Board::new(
        elf,
        Options {
            seed,
            room: room.clone(),
            ..Options::default()
        },
    )?;
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

/// Writes the first board's configuration as `robot eeprom write` does, in Guarded Normal: every tick
/// refreshes its replies; milliseconds to READY.
fn configure(machine: &mut BoardIo) -> Result<u32, Box<dyn Error>> {
    let settings = Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("..")
        .join(CONFIGURATION);
    let guarded = (fields::MODE, u64::from(Mode::GuardedNormal.code()));
    let settings = Settings::load(&settings)?.with(&[guarded])?;
    let programmed = eeprom::program(machine, settings.image(), READY_MS, None, |_| {})?;
    println!(
        "     {} bytes in {} bursts, READY after {} ms",
        programmed.bytes, programmed.bursts, programmed.ready_ms
    );
    Ok(programmed.ready_ms)
}

/// The result of a drive.
struct Drive {
    survey: Mapping,
    errors: PoseErrors,
    link: LinkStatistics,
    virtual_seconds: f64,
    wall_seconds: f64,
}

fn drive_tour(machine: &mut BoardIo, board: &Board, room: &Room) -> Result<Drive, Box<dyn Error>> {
    let mut session = Session::open(machine, RATE_HZ, READY_MS)?;
    let mut survey = Mapping::new(mapper_config(session.config(), CELL_MM));
    let mut errors = PoseErrors::new(board, room);
    let way: Vec<Pose> = room.tour.iter().map(|pose| place(*pose)).collect();
    let begun_us = board.now_us();
    let begun = Instant::now();
    drive::tour(
        &mut session,
        &way,
        &ArrivalCriteria::default(),
        |_, snapshot| {
            if let Some(look) = RangeSample::of(snapshot) {
                errors.record(board, look.pose);
                survey.add(&look);
            }
        },
        |index, arrival| {
            println!(
                "     {:2}/{}  ({:6.0}, {:6.0}) mm, {:4.0}°  off by {:.1} mm, {:.2}°  after {:.1} s",
                index + 1,
                way.len(),
                arrival.pose.x_mm,
                arrival.pose.y_mm,
                arrival.pose.rotation_deg,
                arrival.off_mm,
                arrival.off_deg,
                arrival.seconds
            );
        },
    )?;
    Ok(Drive {
        link: session.statistics(),
        survey,
        errors,
        virtual_seconds: seconds(board.now_us() - begun_us),
        wall_seconds: begun.elapsed().as_secs_f64(),
    })
}

/// Writes the map, the trajectory and the log; compares the map with the true walls.
fn draw(drive: &Drive, board: &Board, room: &Room, out: &Path) -> Result<MapScore, Box<dyn Error>> {
    // The robot's frame: where it stood at its reset.
    let walls = room.relative_to_start().visible_surfaces();
    let grid = drive.survey.mapper().grid();
    drive.survey.save_map(&out.join("map"))?;
    fs::write(out.join("map.png"), map_plot::map(grid)?)?;
    let trajectory = map_plot::trajectory(
        grid,
        &drive.errors.estimate,
        &drive.errors.true_path,
        &walls,
    )?;
    fs::write(out.join("trajectory.png"), trajectory)?;
    fs::write(out.join("uart.log"), board.uart())?;
    Ok(map_iou(grid, &walls, TOLERANCE_MM))
}

fn place(pose: twin::plant::Pose2) -> Pose {
    Pose::new(pose.x_mm, pose.y_mm, pose.heading_rad.to_degrees())
}

#[allow(clippy::cast_precision_loss)] // exact below 285 years
fn seconds(us: u64) -> f64 {
    us as f64 / 1e6
}
