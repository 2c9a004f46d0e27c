//! Generated rooms, or one from a file, explored by the release ELF in an imperfect world, two at a time, as a table.
#![forbid(unsafe_code)]

use std::error::Error;
use std::path::{Path, PathBuf};
use std::sync::Mutex;
use std::sync::atomic::{AtomicU64, Ordering};
use std::{fs, thread};

use clap::Parser;
use pilot::virtual_board::load_room;
use robot_tests::exploration::{self, Figures, PI_RATIO};
use robot_tests::test_board;
use serde::Serialize;
use twin::Options;
use twin::plant::{Imperfections, Room, room};

/// Rooms at a time.
const THREADS: usize = 2;

/// Explores generated rooms and prints a table.
#[derive(Parser)]
struct Arguments {
    /// The release ELF
    #[arg(long)]
    elf: PathBuf,
    /// Seeds of the rooms and of their worlds, the last included
    #[arg(long, value_name = "A..B", value_parser = seeds)]
    seeds: (u64, u64),
    /// A room of this file in the seeds' worlds, instead of generated rooms
    #[arg(long, value_name = "FILE")]
    room: Option<PathBuf>,
    /// Uncalibrated robots: wheels and track off by up to 1 %, the gyroscope by 3 %
    #[arg(long)]
    uncalibrated: bool,
    /// Imperfections of the world that are switched off, such as sill,gyro
    #[arg(long, value_name = "NAME,…", value_delimiter = ',')]
    without: Vec<String>,
    /// Radius of the robots' body, mm
    #[arg(long, default_value_t = 100.0)]
    body_radius: f64,
    /// Where the table and a picture of each run go
    #[arg(long, default_value = "target/explore-bench")]
    out: PathBuf,
}

fn seeds(text: &str) -> Result<(u64, u64), String> {
    let ends = text.split_once("..").and_then(|(from, to)| {
        let ends = (from.parse().ok()?, to.parse().ok()?);
        (ends.0 <= ends.1).then_some(ends)
    });
    ends.ok_or_else(|| "accepted is A..B, like 1..10".into())
}

/// One room's row.
#[derive(Serialize)]
struct Row {
    seed: u64,
    collisions: u32,
    fastest_contact_mm_s: f64,
    virtual_minutes: f64,
    floor_m2: f64,
    #[serde(flatten)]
    figures: Figures,
}

fn main() -> Result<(), Box<dyn Error>> {
    let arguments = Arguments::parse();
    let elf = fs::read(&arguments.elf)?;
    let room = arguments.room.as_deref().map(load_room).transpose()?;
    let world = if arguments.uncalibrated {
        Imperfections::uncalibrated()
    } else {
        Imperfections::default()
    };
    let off = |world: Imperfections, name: &String| world.without(name);
    let world = arguments.without.iter().try_fold(world, off);
    let world = world.map_err(|accepted| format!("--without: {accepted}"))?;
    fs::create_dir_all(&arguments.out)?;
    let (next, last) = (AtomicU64::new(arguments.seeds.0), arguments.seeds.1);
    let rows = Mutex::new(Vec::new());
    thread::scope(|scope| {
        for _ in 0..THREADS {
            scope.spawn(|| {
                twin::processor::keep_to_one();
                loop {
                    let seed = next.fetch_add(1, Ordering::Relaxed);
                    if seed > last {
                        return;
                    }
                    let room = room.clone().unwrap_or_else(|| room::generate(seed));
                    let mut options = exploration::options(&room, world, seed);
                    exploration::set_body(&mut options, arguments.body_radius);
                    let row = explore(&elf, &room, options, &arguments.out);
                    let row = row.map_err(|error| format!("seed {seed}: {error}"));
                    eprintln!("{}", row.as_ref().map_or_else(Clone::clone, line));
                    rows.lock().expect("no thread panics").push(row);
                }
            });
        }
    });
    let rows: Result<Vec<Row>, String> = rows.into_inner()?.into_iter().collect();
    let mut rows = rows?;
    rows.sort_by_key(|row| row.seed);
    let table = table(&rows);
    fs::write(arguments.out.join("table.md"), &table)?;
    let json = serde_json::to_string_pretty(&rows)? + "\n";
    fs::write(arguments.out.join("table.json"), json)?;
    println!("{table}");
    Ok(())
}

fn explore(elf: &[u8], room: &Room, options: Options, out: &Path) -> Result<Row, Box<dyn Error>> {
    let seed = options.seed;
    let board = exploration::configured_board(elf, options)?;
    let mut io = test_board::io(&board);
    let run = exploration::explore(&mut io, &board, |_| ())?;
    if let Err(error) = &run.drive {
        eprintln!("seed {seed} ended early: {error}");
    }
    let picture = run.trajectory_plot(room)?;
    fs::write(out.join(format!("trajectory-{seed}.png")), picture)?;
    let truth = board.truth();
    #[allow(clippy::cast_precision_loss)] // minutes, cells
    Ok(Row {
        seed,
        collisions: truth.collisions,
        fastest_contact_mm_s: board.world(|world| {
            let speeds = world.collisions().iter().map(|contact| contact.speed_mm_s);
            speeds.fold(0.0, f64::max)
        }),
        virtual_minutes: board.now_us() as f64 / 60e6,
        floor_m2: room.reachable_floor().len() as f64 * 625e-6,
        figures: run.figures(room),
    })
}

const HEAD: &str = "| seed | floor, m² | completed | collisions | coverage | map_iou | position, mm, median / worst \
| heading, ° | odometry alone, worst mm / times / map_iou | minutes | host ms/s |\n|---|---|---|---|---|---|---|---|---|---|---|\n";

fn line(row: &Row) -> String {
    let figures = &row.figures;
    format!(
        "| {} | {:.1} | {} | {} | {:.3} | {:.2} | {:.0} / {:.0} | {:.1} | {:.0} / {:.0} / {:.2} | {:.1} | {:.1} |",
        row.seed,
        row.floor_m2,
        if figures.completed { "yes" } else { "no" },
        row.collisions,
        figures.coverage,
        figures.map_iou,
        figures.position_error_mm_median,
        figures.position_error_mm_max,
        figures.heading_error_deg_max,
        figures.raw_position_error_mm_max,
        figures.raw_error_ratio,
        figures.raw_map_iou,
        row.virtual_minutes,
        figures.host_ms_per_robot_second,
    )
}

/// The bar of the map's agreement that a good room keeps.
const MAP_IOU: f64 = 0.8;

fn table(rows: &[Row]) -> String {
    let lines: Vec<String> = rows.iter().map(line).collect();
    let good =
        |row: &&Row| row.figures.completed && row.collisions == 0 && row.figures.map_iou >= MAP_IOU;
    let ms = rows.iter().map(|row| row.figures.host_ms_per_robot_second);
    let worst_ms = ms.fold(0.0, f64::max);
    format!(
        "{HEAD}{}\n\n{} of {} completed without a collision and with map_iou ≥ {MAP_IOU}. Mapping and planning \
         take at most {worst_ms:.1} ms a robot's second on this computer, {:.1} % of one core of a Pi 3B+ at an \
         estimated ratio of {PI_RATIO}.\n",
        lines.join("\n"),
        rows.iter().filter(good).count(),
        rows.len(),
        worst_ms * PI_RATIO / 10.0,
    )
}
