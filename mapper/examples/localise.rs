//! The localiser on drives through whole rooms, with its parts switched off one at a time:
//! `cargo run --release -p mapper --example localise -- ROOMS FIRST LAST [SWEEP_DEG [CASE [FOLDER]]]`
//!
//! ROOMS is `default` (the seeds draw robots) or `generated` (they draw rooms, too). Without a case
//! all of them; with a folder the maps are drawn there.

#[path = "../tests/tour/mod.rs"]
mod tour;

use std::{env, error::Error, fs, path::PathBuf};

use mapper::{LocaliserConfig, MatcherConfig, map_plot};
use plant::{Imperfections, Room, room};
use tour::Drive;

fn cases() -> Vec<(&'static str, LocaliserConfig)> {
    let base = LocaliserConfig::default;
    let unweighted = MatcherConfig {
        temperature: 1.0,
        ..MatcherConfig::default()
    };
    vec![
        ("everything", base()),
        ("no gyroscope", base()),
        (
            "no matching",
            LocaliserConfig {
                matcher: None,
                ..base()
            },
        ),
        (
            "no bearings",
            LocaliserConfig {
                bearings: false,
                ..base()
            },
        ),
        (
            "no right angles",
            LocaliserConfig {
                right_angles: false,
                ..base()
            },
        ),
        (
            "readings independent",
            LocaliserConfig {
                matcher: Some(unweighted),
                ..base()
            },
        ),
    ]
}

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = env::args().skip(1).collect();
    let argument = |nth: usize, default: &'static str| {
        arguments
            .get(nth)
            .map_or(default, String::as_str)
            .to_owned()
    };
    let generated = argument(0, "default") == "generated";
    let seeds = argument(1, "1").parse::<u64>()?..=argument(2, "4").parse()?;
    let sweep = argument(3, "0").parse::<f64>()?.to_radians();
    println!(
        "{:20}  seed   iou     P     R  median  worst  heading   raw worst  NEES  minutes  ms/s",
        ""
    );
    for (name, config) in cases() {
        if !name.starts_with(&argument(4, "")) {
            continue;
        }
        for seed in seeds.clone() {
            let room = if generated {
                room::generate(seed)
            } else {
                Room::two_rooms()
            };
            let mut drive = Drive::new(&room, Imperfections::default(), seed, config.clone());
            drive.with_gyro = name != "no gyroscope";
            drive.tour(&room, sweep, 3000.0);
            let r = drive.result(&room);
            println!(
                "{name:20} {seed:5} {:.3} {:.3} {:.3} {:6.0}  {:6.0}  {:6.1}  {:9.0}  {:5.1}  {:5.1}  {:5.2}",
                r.map.iou,
                r.map.precision,
                r.map.recall,
                r.median_mm,
                r.worst_mm,
                r.heading_deg,
                r.raw_worst_mm,
                r.nees,
                r.minutes,
                r.ms_per_s,
            );
            if let Some(folder) = arguments.get(5).map(PathBuf::from) {
                fs::create_dir_all(&folder)?;
                let (grid, walls) = (drive.localiser.grid(), drive.walls(&room));
                let plot = map_plot::trajectory(grid, &drive.column(0), &drive.column(1), &walls)?;
                fs::write(folder.join(format!("{seed}.png")), plot)?;
            }
        }
    }
    Ok(())
}
