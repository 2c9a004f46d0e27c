//! Explores the default room and the generated rooms of some seeds, and prints a table:
//! `cargo run --release -p navigator --example explore -- default|rooms FIRST LAST [SWEEP_DEG [FOLDER]]`
#![allow(clippy::cast_precision_loss)]

#[path = "../tests/closed_loop/mod.rs"]
mod closed_loop;

use std::{env, error::Error, fs, path::PathBuf};

use mapper::map_plot;
use navigator::Config;
use plant::{Room, room};

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = env::args().skip(1).collect();
    let [kind, first, last, more @ ..] = &arguments[..] else {
        return Err("default|rooms FIRST LAST [SWEEP_DEG [FOLDER]]".into());
    };
    let sweep_deg = more
        .first()
        .map_or(Ok(0.0), |degrees| degrees.parse::<f64>())?;
    let config = Config {
        sweep_half_width_rad: sweep_deg.to_radians(),
        ..Config::default()
    };
    println!(
        "room seed | outcome collisions coverage iou median worst heading home path minutes ms/s slowest"
    );
    for seed in first.parse::<u64>()?..=last.parse()? {
        let room = if kind == "rooms" {
            room::generate(seed)
        } else {
            Room::two_rooms()
        };
        let run =
            closed_loop::explore(&room, seed, config, &mut closed_loop::localiser(), |_| None);
        let errors = run.errors();
        let (median_mm, worst_mm) = (errors.position_mm_median, errors.position_mm_max);
        let heading_deg = errors.heading_deg_max;
        println!(
            "{kind} {seed} | {:?} {} {:.3} {:.3} {median_mm:.0} {worst_mm:.0} {heading_deg:.1} {:.0} {:.1} {:.1} {:.2} {:.1}",
            run.outcome,
            run.collisions.len(),
            run.coverage,
            run.iou,
            run.end.x_mm.hypot(run.end.y_mm),
            run.path_mm / 1000.0,
            run.minutes,
            run.host.as_secs_f64() * 1000.0 / (run.minutes * 60.0),
            run.slowest_step.as_secs_f64() * 1000.0,
        );
        for hit in &run.collisions {
            println!(
                "  {:.0} s {:.0} mm/s at {:.1?}",
                hit.time_s, hit.speed_mm_s, hit.pose
            );
        }
        if let Some(folder) = more.get(1).map(PathBuf::from) {
            fs::create_dir_all(&folder)?;
            let plot = map_plot::trajectory(&run.grid, &run.estimate, &run.truth, &run.walls)?;
            fs::write(folder.join(format!("{kind}-{seed}.png")), plot)?;
        }
    }
    Ok(())
}
