//! The default room's tour in an ideal world: the reported poses, and the map as `robot map` makes it of them.

use std::error::Error;
use std::path::Path;

use host_link::board_io::BoardIo;
use host_link::pose::Pose;
use host_link::session::{RATE_HZ, Session};
use mapper::{map_iou, map_plot};
use pilot::drive::{self, ArrivalCriteria};
use pilot::exploring::Localisation;
use pilot::mapping::{BODY_MM, RangeSample, reported_pose};
use robot_tests::exploration::{CELL_MM, READY_MS, TOLERANCE_MM};
use robot_tests::truth_track::TruthTrack;
use serde_json::{Value, json};
use twin::Board;
use twin::plant::Room;

use super::Timer;

/// Drives the tour; leaves the map and the trajectory in `out`; returns the figures.
pub fn run(
    machine: &mut BoardIo,
    board: &Board,
    room: &Room,
    out: &Path,
) -> Result<Value, Box<dyn Error>> {
    let mut session = Session::open(machine, RATE_HZ, READY_MS)?;
    let mut truth = TruthTrack::new(board);
    let (mut samples, mut true_path) = (Vec::new(), Vec::new());
    // Distance and turn to the truth at the tick, and at the frame's end: worst of each, and the last.
    let (mut worst, mut last) = ([[0.0_f64; 2]; 2], [0.0; 2]);
    let way: Vec<Pose> = room.tour.iter().map(reported_pose).collect();
    let timer = Timer::start(board);
    drive::tour(
        &mut session,
        &way,
        &ArrivalCriteria::default(),
        |snapshot| {
            let Some(sample) = RangeSample::of(snapshot) else {
                return;
            };
            let poses = truth.sample(board);
            for (worst, pose) in worst.iter_mut().zip(&poses).rev() {
                let pose = reported_pose(pose);
                last = [
                    sample.pose.distance_mm(pose),
                    sample.pose.rotation_to_deg(pose).abs(),
                ];
                *worst = [worst[0].max(last[0]), worst[1].max(last[1])];
            }
            samples.push(sample);
            true_path.push(poses[0]);
        },
        |index, arrival| {
            let (pose, number, count) = (arrival.pose, index + 1, way.len());
            println!(
                "     {number:2}/{count}  ({:6.0}, {:6.0}) mm, {:4.0}°  off by {:.1} mm, {:.2}°  after {:.1} s",
                pose.x_mm,
                pose.y_mm,
                pose.rotation_deg,
                arrival.off_mm,
                arrival.off_deg,
                arrival.seconds
            );
        },
    )?;
    let mut figures = timer.figures(board);
    // The default room's frame is the robot's: where it stood at its reset.
    let walls = room.visible_surfaces();
    let mut localisation = Localisation::new(session.config(), BODY_MM, CELL_MM);
    for sample in &samples {
        localisation.observe(sample);
    }
    let grid = localisation.localiser.grid();
    localisation.save_maps(&out.join("map"))?;
    std::fs::write(out.join("map.png"), map_plot::map(grid)?)?;
    let path = &localisation.path;
    let trajectory = map_plot::trajectory(grid, path, &true_path, &walls)?;
    std::fs::write(out.join("trajectory.png"), trajectory)?;
    let score = map_iou(grid, &walls, TOLERANCE_MM);
    super::extend(
        &mut figures,
        json!({
            "way_points": way.len(),
            "frames_sent": session.statistics().frames,
            "frames_accepted": session.statistics().accepted,
            "frames_rejected": session.statistics().rejected,
            "position_error_mm_max": worst[0][0],
            "heading_error_deg_max": worst[0][1],
            "position_error_mm_max_with_latency": worst[1][0],
            "heading_error_deg_max_with_latency": worst[1][1],
            "position_error_mm_end": last[0],
            "heading_error_deg_end": last[1],
            "map_iou": score.iou,
            "map_precision": score.precision,
            "map_recall": score.recall,
        }),
    );
    Ok(figures)
}
