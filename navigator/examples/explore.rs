//! Explores the default room with some seeds and prints a table:
//! `cargo run --release -p navigator --example explore -- FIRST LAST [FOLDER]`
#![allow(
    clippy::cast_precision_loss,
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss
)]

#[path = "../tests/closed_loop/mod.rs"]
mod closed_loop;

use std::{env, error::Error, fs, path::PathBuf};

use mapper::map_plot;
use plant::Room;

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = env::args().skip(1).collect();
    let number = |nth: usize| arguments.get(nth).map_or(Ok(1), |text| text.parse::<u64>());
    println!("room seed | done collisions contact coverage iou home path minutes ms/s slowest");
    for seed in number(0)?..=number(1)? {
        let run = closed_loop::explore(&Room::two_rooms(), seed, |_| None);
        println!(
            "default {seed} | {:?} {} {:.0} {:.3} {:.3} {:.0} {:.1} {:.1} {:.2} {:.1}",
            run.outcome,
            run.collisions,
            run.fastest_contact_mm_s,
            run.coverage,
            run.iou,
            run.end.x_mm.hypot(run.end.y_mm),
            run.path_mm / 1000.0,
            run.minutes,
            run.host.as_secs_f64() * 1000.0 / (run.minutes * 60.0),
            run.slowest_step.as_secs_f64() * 1000.0,
        );
        if let Some(folder) = arguments.get(2).map(PathBuf::from) {
            fs::create_dir_all(&folder)?;
            let plot = map_plot::trajectory(&run.grid, &run.truth, &run.truth, &run.walls)?;
            fs::write(folder.join(format!("default-{seed}.png")), plot)?;
        }
    }
    Ok(())
}
