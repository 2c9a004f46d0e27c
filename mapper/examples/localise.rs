//! The localiser on drives through whole rooms, with its parts switched off one at a time.
//!
//! `cargo run --release -p mapper --example localise -- [FIRST..LAST seed] [sweep in degrees]`

#[path = "../tests/tour/mod.rs"]
mod tour;

use mapper::LocaliserConfig;
use plant::{Imperfections, Room};
use tour::Drive;

fn main() {
    let arguments: Vec<String> = std::env::args().collect();
    let (first, last) = arguments
        .get(1)
        .and_then(|range| range.split_once(".."))
        .map_or((1, 4), |(a, b)| (a.parse().unwrap(), b.parse().unwrap()));
    let sweep: f64 = arguments
        .get(2)
        .map_or(0.0, |degrees| degrees.parse().unwrap());
    let only = arguments.get(3).map_or("", |s| s.as_str());
    println!(
        "{:20}  seed   iou     P     R  median  worst  heading   raw worst  NEES  minutes  ms/s",
        ""
    );
    let env = |name: &str| std::env::var(name).ok().and_then(|v| v.parse::<f64>().ok());
    let base = || {
        let mut config = LocaliserConfig::default();
        let m = config.matcher.as_mut().unwrap();
        if let Some(v) = env("DRIFT") {
            m.drift = v
        }
        if let Some(v) = env("TEMP") {
            m.temperature = v
        }
        if let Some(v) = env("SURF") {
            m.surface_mm = v
        }
        if let Some(v) = env("AGE") {
            config.range_age_s = v
        }
        if let Some(v) = env("LEN") {
            config.stretch_mm = v
        }
        config
    };
    let cases: [(&str, LocaliserConfig); 4] = [
        ("everything", base()),
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
        ("temperature 1", {
            let mut c = base();
            c.matcher.as_mut().unwrap().temperature = 1.0;
            c
        }),
    ];
    for (name, config) in cases {
        if !name.starts_with(only) {
            continue;
        }
        for seed in first..=last {
            let room = Room::two_rooms();
            let mut drive = Drive::new(&room, Imperfections::default(), seed, config.clone());
            drive.tour(&room, sweep.to_radians());
            let r = drive.result(&room);
            println!(
                "{name:20} {seed:5} {:.3} {:.3} {:.3} {:6.0}  {:6.0}  {:6.1}  {:9.0}  {:5.1}  {:5.1}  {:5.2}",
                r.map.iou, r.map.precision, r.map.recall, r.median_mm, r.worst_mm, r.heading_deg,
                r.raw_worst_mm, r.nees, r.minutes, r.ms_per_s,
            );
        }
    }
}
