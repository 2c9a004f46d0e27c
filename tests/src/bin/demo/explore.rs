//! The default room, unknown to the robot, in an imperfect world.

use std::error::Error;
use std::path::Path;

use host_link::board_io::BoardIo;
use mapper::map_plot;
use pilot::mapping::BODY_MM;
use pilot::recording::Recorder;
use robot_tests::exploration;
use serde_json::Value;
use twin::Board;
use twin::plant::Room;

use super::Timer;

/// Reports between two lines of progress: half a minute.
const PROGRESS: u32 = 1200;

/// Explores; leaves maps, trajectory and errors in `out`; returns the figures.
pub fn run(
    machine: &mut BoardIo,
    board: &Board,
    room: &Room,
    out: &Path,
) -> Result<Value, Box<dyn Error>> {
    let timer = Timer::start(board);
    let mut reports = 0;
    // What the demo wrote: to read it again would only cost the robot's time.
    let settings = exploration::settings()?;
    let begun_us = (machine.clock)();
    let mut recorder = Recorder::create(&out.join("recording.mcap"), &settings, BODY_MM, begun_us)?;
    let run = exploration::explore(machine, board, |step| {
        recorder.record(&step.sample, step.snapshot);
        reports += 1;
        if reports % PROGRESS == 0 {
            let (pose, seconds) = (step.estimate.pose, reports / 40);
            println!(
                "     {seconds:4} s  ({:6.0}, {:6.0}) mm, {:4.0}°  {} targets left",
                pose.x_mm,
                pose.y_mm,
                pose.heading_rad.to_degrees(),
                step.targets
            );
        }
    })?;
    let mut figures = timer.figures(board);
    if let Err(error) = &run.drive {
        println!("     ended early: {error}");
    }
    run.localisation.save_maps(&out.join("map"))?;
    let grid = run.localisation.localiser.grid();
    recorder.finish(board.now_us(), grid, run.localisation.odom_in_map())?;
    let map = map_plot::map(grid)?;
    for (name, picture) in [
        ("map.png", map),
        ("trajectory.png", run.trajectory_plot(room)?),
        ("error.png", run.error_plot()?),
    ] {
        std::fs::write(out.join(name), picture)?;
    }
    super::extend(&mut figures, serde_json::to_value(run.figures(room))?);
    Ok(figures)
}
