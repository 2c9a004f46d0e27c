//! A room explored by the release ELF on the virtual board, and the comparison with the truth, which
//! the robot never sees.

use std::error::Error;
use std::ops::ControlFlow;

use fw_core::eeprom::{Field, fields};
use host_link::board_io::BoardIo;
use host_link::session::{RATE_HZ, Session};
use host_link::settings::Settings;
use host_link::statistics::LinkStatistics;
use mapper::evaluation::{
    best_alignment, coverage, in_estimate_frame, pose_error_series, pose_errors, start_alignment,
};
use mapper::line_plot::{self, Curve, Panel};
use mapper::{PlotError, map_iou, map_plot};
use navigator::{Explorer, Outcome};
use pilot::exploring::{self, Drive, Localisation};
use serde::Serialize;
use twin::plant::{Imperfections, Mount, Pose2, Room};
use twin::{Board, Options};

use crate::truth_track::TruthTrack;

/// Cells of the map, millimetres.
pub const CELL_MM: f64 = 25.0;
/// How near an occupied cell and a wall must be to agree, millimetres.
pub const TOLERANCE_MM: f64 = 100.0;
/// How much longer one core of a Raspberry Pi 3B+ (Cortex-A53, 1.4 GHz) takes than one of this computer.
/// An estimate, not measured: the ratio of their single-core results in Geekbench 5, about 100 against 1,000 to
/// 1,200 of a server core of 2021, and half as much again for floating point on an in-order core.
pub const PI_RATIO: f64 = 18.0;
/// How long READY may take, milliseconds.
pub const READY_MS: u32 = 1_000;

/// Changes of the sample configuration for exploring: the front sensor on its servo, which sees the slanted
/// walls that fixed sensors miss.
pub const CHANGES: [(&Field, u64); 1] = [(fields::SERVO, 1)];

/// The sample configuration with [`CHANGES`].
///
/// # Errors
/// Where it is not accepted.
pub fn settings() -> Result<Settings, host_link::error::Error> {
    Settings::sample()?.with(&CHANGES)
}

/// A virtual robot at the start of a room, its world as imperfect as the seed says.
#[must_use]
pub fn options(room: &Room, imperfections: Imperfections, seed: u64) -> Options {
    let mut options = Options::default().in_room(room.clone());
    (options.seed, options.params.imperfections) = (seed, imperfections);
    options
}

/// Gives the virtual robot a body of this radius, mm, with the rangefinders at its rim.
pub fn set_body(options: &mut Options, radius_mm: f64) {
    options.params.chassis.radius_mm = radius_mm;
    options.params.mounts = Mount::on_body(radius_mm, 20.0);
}

/// A virtual robot configured for exploring.
///
/// # Errors
/// Where the board cannot be made.
pub fn configured_board(elf: &[u8], mut options: Options) -> Result<Board, Box<dyn Error>> {
    options.eeprom = Some(settings()?.image().0.to_vec());
    Ok(Board::new(elf, options)?)
}

/// A run, with the truth beside it.
pub struct Exploration {
    /// Estimates, maps and the recording.
    pub localisation: Localisation,
    /// How the plan ended; none if the drive ended by an error.
    pub drive: Result<Drive, host_link::error::Error>,
    /// The link's counters.
    pub link: LinkStatistics,
    /// The true pose in the room's frame at the last tick before each report's frame …
    truth: Vec<Pose2>,
    /// … and at the end of its frame.
    late: Vec<Pose2>,
    times_s: Vec<f64>,
}

/// Explores from where the robot stands.
///
/// # Errors
/// Where the session cannot be opened. What ends the drive is part of the result.
pub fn explore(
    io: &mut BoardIo,
    board: &Board,
    mut watch: impl FnMut(&exploring::Step<'_>),
) -> Result<Exploration, Box<dyn Error>> {
    let mut session = Session::open(io, RATE_HZ, READY_MS)?;
    let config = session.config();
    let body_mm = board.world(|world| world.params().chassis.radius_mm);
    let mut localisation = Localisation::new(config, body_mm, CELL_MM);
    let mut plan = Explorer::new(exploring::navigator_config(config, body_mm)?);
    let mut track = TruthTrack::new(board);
    let (mut truth, mut late, mut times_s) = (Vec::new(), Vec::new(), Vec::new());
    let drive = exploring::drive(&mut session, &mut localisation, &mut plan, |step| {
        let [then, now] = track.sample(board);
        truth.push(then);
        late.push(now);
        times_s.push(exploring::observation(&step.sample).time_s);
        watch(step);
        ControlFlow::Continue(())
    });
    let link = session.statistics();
    Ok(Exploration {
        localisation,
        drive,
        link,
        truth,
        late,
        times_s,
    })
}

/// The figures of a run; keys of `report.json`.
#[derive(Clone, Debug, Serialize)]
#[allow(missing_docs)] // the keys say it, docs/pilot.md explains them
pub struct Figures {
    pub completed: bool,
    pub stops: u32,
    pub map_iou: f64,
    pub map_precision: f64,
    pub map_recall: f64,
    pub coverage: f64,
    pub position_error_mm_median: f64,
    pub position_error_mm_max: f64,
    pub position_error_mm_end: f64,
    pub heading_error_deg_max: f64,
    pub heading_error_deg_end: f64,
    pub position_error_mm_max_with_latency: f64,
    pub heading_error_deg_max_with_latency: f64,
    pub map_iou_start_frame: f64,
    pub coverage_start_frame: f64,
    pub position_error_mm_median_start_frame: f64,
    pub position_error_mm_max_start_frame: f64,
    pub heading_error_deg_max_start_frame: f64,
    pub raw_map_iou: f64,
    pub raw_position_error_mm_median: f64,
    pub raw_position_error_mm_max: f64,
    pub raw_heading_error_deg_max: f64,
    pub raw_error_ratio: f64,
    pub host_ms_per_robot_second: f64,
    pub pi_core_share: f64,
    pub frames_sent: u64,
    pub frames_accepted: u32,
    pub frames_rejected: u32,
}

impl Exploration {
    /// Compares the run with the room, in which it took place.
    #[must_use]
    pub fn figures(&self, room: &Room) -> Figures {
        let (path, truth) = (&self.localisation.path, &self.truth);
        let grid = self.localisation.localiser.grid();
        let (surfaces, floor) = (room.visible_surfaces(), room.reachable_floor());
        let aligned = best_alignment(path, truth);
        let at_start = path.first().zip(truth.first());
        let at_start = at_start.map_or(aligned, |(pose, truth)| start_alignment(pose, truth));
        let score = map_iou(grid, &in_estimate_frame(&surfaces, &aligned), TOLERANCE_MM);
        let start_score = map_iou(grid, &in_estimate_frame(&surfaces, &at_start), TOLERANCE_MM);
        let [errors, late, start] = [
            (truth, &aligned),
            (&self.late, &aligned),
            (truth, &at_start),
        ]
        .map(|(truth, alignment)| pose_errors(path, truth, alignment));
        let (end_mm, end_deg) = pose_error_series(path, truth, &aligned)
            .last()
            .unwrap_or_default();
        let trace = &self.localisation.trace;
        let raw_aligned = best_alignment(trace, truth);
        let raw = pose_errors(trace, truth, &raw_aligned);
        let raw_surfaces = in_estimate_frame(&surfaces, &raw_aligned);
        let raw_grid = self.localisation.raw.grid();
        let seconds = self.times_s.last().zip(self.times_s.first());
        let seconds = seconds.map_or(1.0, |(end, begin)| (end - begin).max(1.0));
        let busy = self.localisation.busy.as_secs_f64() / seconds;
        let drive = self.drive.as_ref().ok();
        Figures {
            completed: drive.is_some_and(|drive| drive.outcome == Outcome::Complete),
            stops: drive.map_or(0, |drive| drive.stops),
            map_iou: score.iou,
            map_precision: score.precision,
            map_recall: score.recall,
            coverage: coverage(grid, &floor, &aligned),
            position_error_mm_median: errors.position_mm_median,
            position_error_mm_max: errors.position_mm_max,
            position_error_mm_end: end_mm,
            heading_error_deg_max: errors.heading_deg_max,
            heading_error_deg_end: end_deg,
            position_error_mm_max_with_latency: late.position_mm_max,
            heading_error_deg_max_with_latency: late.heading_deg_max,
            map_iou_start_frame: start_score.iou,
            coverage_start_frame: coverage(grid, &floor, &at_start),
            position_error_mm_median_start_frame: start.position_mm_median,
            position_error_mm_max_start_frame: start.position_mm_max,
            heading_error_deg_max_start_frame: start.heading_deg_max,
            raw_map_iou: map_iou(raw_grid, &raw_surfaces, TOLERANCE_MM).iou,
            raw_position_error_mm_median: raw.position_mm_median,
            raw_position_error_mm_max: raw.position_mm_max,
            raw_heading_error_deg_max: raw.heading_deg_max,
            raw_error_ratio: raw.position_mm_max / errors.position_mm_max.max(1e-3),
            host_ms_per_robot_second: busy * 1000.0,
            pi_core_share: busy * PI_RATIO,
            frames_sent: self.link.frames,
            frames_accepted: self.link.accepted,
            frames_rejected: self.link.rejected,
        }
    }

    /// The corrected map under the estimated and the true path and the true walls, as a PNG file.
    ///
    /// # Errors
    /// If it cannot be drawn.
    pub fn trajectory_plot(&self, room: &Room) -> Result<Vec<u8>, PlotError> {
        let path = &self.localisation.path;
        let aligned = best_alignment(path, &self.truth);
        let truth = self.truth.iter().map(|pose| pose.relative_to(&aligned));
        let truth: Vec<Pose2> = truth.collect();
        let walls = in_estimate_frame(&room.visible_surfaces(), &aligned);
        map_plot::trajectory(self.localisation.localiser.grid(), path, &truth, &walls)
    }

    /// The errors of position and heading over time, with correction and by odometry alone, as a PNG file.
    ///
    /// # Errors
    /// If it cannot be drawn.
    pub fn error_plot(&self) -> Result<Vec<u8>, PlotError> {
        let begin_s = self.times_s.first().copied().unwrap_or_default();
        let series = [
            ("corrected", &self.localisation.path),
            ("odometry alone", &self.localisation.trace),
        ]
        .map(|(name, path)| {
            let aligned = best_alignment(path, &self.truth);
            let errors: Vec<_> = pose_error_series(path, &self.truth, &aligned).collect();
            (name, errors)
        });
        let panel = |title: &str, value: fn(&(f64, f64)) -> f64| Panel {
            title: title.into(),
            curves: series
                .iter()
                .map(|(name, errors)| Curve {
                    name: (*name).into(),
                    points: self
                        .times_s
                        .iter()
                        .zip(errors)
                        .map(|(time_s, error)| (time_s - begin_s, value(error)))
                        .collect(),
                })
                .collect(),
        };
        line_plot::draw(&[
            panel("position error, mm, over seconds", |error| error.0),
            panel("heading error, degrees, over seconds", |error| error.1),
        ])
    }
}
