//! Maps the default room on the modelled robot and writes the pictures:
//! `cargo run --release -p mapper --example room -- FOLDER [SEED]`
#![allow(clippy::cast_precision_loss, clippy::cast_possible_truncation)] // a drive's few numbers

#[path = "../tests/drive/mod.rs"]
mod drive;

use mapper::{map_iou, map_plot, ros};
use plant::{Params, Room};
use std::{env, error::Error, fs, path::PathBuf};

fn main() -> Result<(), Box<dyn Error>> {
    let folder = PathBuf::from(
        env::args()
            .nth(1)
            .unwrap_or_else(|| "target/room".to_owned()),
    );
    let seed = env::args().nth(2).map_or(Ok(1), |seed| seed.parse())?;
    let drive = drive::tour(&Room::two_rooms(), Params::default(), seed);
    let grid = drive.mapper.grid();
    fs::create_dir_all(&folder)?;
    fs::write(folder.join("map.png"), map_plot::map(grid)?)?;
    fs::write(folder.join("map.pgm"), ros::pgm(grid))?;
    fs::write(folder.join("map.yaml"), ros::yaml(grid, "map.pgm"))?;
    let overlay = map_plot::trajectory(grid, &drive.estimate, &drive.truth, &drive.walls)?;
    fs::write(folder.join("trajectory.png"), overlay)?;
    println!(
        "path {:.1} m in {:.0} s",
        drive.world.path_mm() / 1000.0,
        drive.world.time_s()
    );
    println!("collisions {}", drive.world.collisions().len());
    println!("readings {:?}", drive.mapper.counters());
    println!("map {:.3?}", map_iou(grid, &drive.walls, 100.0));
    Ok(())
}
