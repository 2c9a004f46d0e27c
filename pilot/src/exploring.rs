//! A robot that finds its own way: every report goes to the localiser, its estimate and map to the
//! plan, and the plan's velocity to the robot.
//!
//! Nothing here knows the room: the loop is the same on the real robot and on the virtual one.

mod config;
mod stops;

pub use config::{ensure_velocity, localiser_config, navigator_config};

use crate::drive::{SpeedMeter, StopOnDrop, meanwhile, seconds_since};
use crate::mapping::{self, Files, RangeSample};
use cpu_time::ThreadTime;
use fw_core::eeprom::Config;
use fw_core::types::Faults;
use fw_core::wire::{Order, Report};
use host_link::error::Error;
use host_link::file;
use host_link::pose::Pose;
use host_link::session::{CommandRequest, Session, VelocityRequest};
use host_link::snapshot::Snapshot;
use mapper::{Grid, Localiser, LocaliserConfig, Observation, Pose2, PoseEstimate};
use navigator::{Action, Explorer, GoTo, Outcome, Status, Velocity};
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use std::time::Duration;
use stops::Stops;

/// Chooses the next velocity: exploring, or going to a point.
pub trait Plan: Send {
    /// Takes a frame: the map as it is now and the robot's report.
    fn step(&mut self, grid: &Grid, status: &Status) -> Action;

    /// Targets that were left when the last one was chosen.
    fn targets(&self) -> usize {
        1
    }
    /// Sends an explorer home.
    fn recall(&mut self) {}
}

impl Plan for Explorer {
    fn step(&mut self, grid: &Grid, status: &Status) -> Action {
        Explorer::step(self, grid, status)
    }

    fn targets(&self) -> usize {
        Explorer::targets(self)
    }

    fn recall(&mut self) {
        Explorer::recall(self);
    }
}

impl Plan for GoTo {
    fn step(&mut self, grid: &Grid, status: &Status) -> Action {
        GoTo::step(self, grid, status)
    }
}

/// Where the robot is and what it has seen, and beside it the map and the path by odometry alone.
pub struct Localisation {
    /// The estimate and the corrected map.
    pub localiser: Localiser,
    /// Looks for the robot on a saved map.
    pub on_map: Option<Localiser>,
    /// The map by odometry alone.
    pub raw: Localiser,
    /// Every estimated pose, in order.
    pub path: Vec<Pose2>,
    /// Every reported pose, in order.
    pub trace: Vec<Pose2>,
    /// Time of this computer's core that localising and planning took.
    pub busy: Duration,
}

impl Localisation {
    /// A new map of a robot of this configuration and a body of this radius, mm.
    pub fn new(config: &Config, body_mm: f64, cell_mm: f64) -> Self {
        let localiser = Localiser::new(localiser_config(config, body_mm, cell_mm));
        Self::with(localiser, config, body_mm, cell_mm)
    }

    /// What this localiser says.
    pub fn with(localiser: Localiser, config: &Config, body_mm: f64, cell_mm: f64) -> Self {
        let raw = LocaliserConfig {
            corrects: false,
            ..localiser_config(config, body_mm, cell_mm)
        };
        Self {
            localiser,
            on_map: None,
            raw: Localiser::new(raw),
            path: Vec::new(),
            trace: Vec::new(),
            busy: Duration::ZERO,
        }
    }

    /// Takes one report.
    // Requirement: DOC-1-2
    pub fn observe(&mut self, sample: &RangeSample) -> PoseEstimate {
        let begun = ThreadTime::now();
        let observation = observation(sample);
        self.localiser.observe(&observation);
        if let Some(on_map) = &mut self.on_map {
            on_map.observe(&observation);
        }
        let estimate = self.localiser.estimate();
        self.busy += begun.elapsed();
        self.raw.observe(&observation);
        self.path.push(estimate.pose);
        self.trace.push(observation.odometry);
        estimate
    }

    /// The origin of the reported poses in the corrected map.
    pub fn odom_in_map(&self) -> Pose {
        let reported = self.trace.last().copied().unwrap_or_default();
        mapping::odom_in_map(&self.localiser.estimate().pose, &reported)
    }

    /// Length of the reported way, mm.
    pub fn path_mm(&self) -> f64 {
        let steps = self.trace.array_windows();
        steps.map(|[from, to]| from.distance_mm(to)).sum()
    }

    /// Writes the corrected map under the estimated path, and with [`raw_stem`] the one by odometry alone under the
    /// reported path.
    ///
    /// # Errors
    /// [`Error::Unwritable`].
    pub fn save_maps(&self, stem: &Path) -> Result<[Files; 2], Error> {
        Ok([
            mapping::save_map(self.localiser.grid(), &self.path, stem)?,
            mapping::save_map(self.raw.grid(), &self.trace, &raw_stem(stem))?,
        ])
    }
}

/// Of the map by odometry alone.
pub fn raw_stem(out: &Path) -> PathBuf {
    file::with_suffix(out, "-raw")
}

/// What a frame led to, for the display.
pub struct Step<'a> {
    /// The report.
    pub sample: RangeSample,
    /// Everything reported so far.
    pub snapshot: &'a Snapshot,
    /// Where the robot is in the map's frame.
    pub estimate: PoseEstimate,
    /// The map.
    pub grid: &'a Grid,
    /// Targets left.
    pub targets: usize,
    /// The robot is found on the saved map.
    pub located: bool,
}

/// How a drive ended.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Drive {
    /// The plan's end.
    pub outcome: Outcome,
    /// Seconds on the board's clock.
    pub seconds: f64,
    /// Stops that the plan answered.
    pub stops: u32,
}

impl Drive {
    /// # Errors
    /// [`Error::Incomplete`] with `what` is left undone, where the plan ended early.
    pub fn ensure_complete(&self, what: &'static str) -> Result<(), Error> {
        let reason = match self.outcome {
            Outcome::Complete => return Ok(()),
            Outcome::TimeLimit => "the time ran out; `explore --timeout` gives it more",
            Outcome::Recalled => "the battery is low; charge it and start again",
            Outcome::Unreachable => "the map shows no way; look for an obstacle and start again",
        };
        Err(Error::Incomplete {
            what,
            reason,
            seconds: self.seconds,
        })
    }
}

/// Drives by the plan until it is done, or until `watch`, which gets every valid report, breaks off what
/// then counts as complete.
///
/// # Errors
/// Those of [`Session::exchange`]; [`Error::Fault`] on a fault that no plan can answer. The robot is stopped in
/// every case.
pub fn drive(
    session: &mut Session<'_>,
    localisation: &mut Localisation,
    plan: &mut impl Plan,
    mut watch: impl FnMut(&Step<'_>) -> ControlFlow<()>,
) -> Result<Drive, Error> {
    session.resume()?;
    let mut runner = PlanRunner::new(session.now_us());
    let mut moving = StopOnDrop::new(session);
    let mut request = CommandRequest::default();
    loop {
        let Some(report) = moving.exchange(&request)? else {
            continue;
        };
        let session = &mut *moving.session;
        session.poll_log();
        let Some(sample) = RangeSample::of(session.snapshot()) else {
            continue;
        };
        let think = || {
            let estimate = localisation.observe(&sample);
            let begun = ThreadTime::now();
            let grid = localisation.localiser.grid();
            let next = runner.step(plan, grid, estimate, &sample, &report);
            localisation.busy += begun.elapsed();
            next.map(|next| (estimate, next))
        };
        let (estimate, next) = meanwhile(session, request.velocity, think, |_| Ok(()))??;
        let on_map = localisation.on_map.as_ref();
        let frame = Step {
            sample,
            snapshot: session.snapshot(),
            estimate,
            grid: localisation.localiser.grid(),
            targets: plan.targets(),
            located: on_map.is_some_and(Localiser::is_located),
        };
        let watched = watch(&frame);
        request = match (next, watched) {
            (ControlFlow::Break(drive), _) => return Ok(drive),
            (_, ControlFlow::Break(())) => return Ok(runner.end(Outcome::Complete)),
            (ControlFlow::Continue(next), _) => next,
        };
    }
}

/// Follows a plan frame by frame.
pub struct PlanRunner {
    begun_us: u64,
    time_s: f64,
    stops: Stops,
    speed: SpeedMeter,
}

impl PlanRunner {
    /// Begins at this time on the board's clock, microseconds.
    pub fn new(begun_us: u64) -> Self {
        Self {
            begun_us,
            time_s: 0.0,
            stops: Stops::default(),
            speed: SpeedMeter::default(),
        }
    }

    /// Takes a valid report with its sample, the estimate and the map that it led to; what to send next, or
    /// how the drive ended.
    ///
    /// # Errors
    /// [`Error::Fault`] on a fault that no plan can answer.
    pub fn step(
        &mut self,
        plan: &mut (impl Plan + ?Sized),
        grid: &Grid,
        estimate: PoseEstimate,
        sample: &RangeSample,
        report: &Report,
    ) -> Result<ControlFlow<Drive, CommandRequest>, Error> {
        self.time_s = seconds_since(self.begun_us, sample.time_us);
        let status = Status {
            time_s: self.time_s,
            estimate,
            speed_mm_s: self.speed.update(self.time_s, sample.pose),
            ranges_mm: sample.ranges_mm,
            front_bearing_rad: sample.bearing_deg.unwrap_or_default().to_radians(),
            obstacle_limited: report.obstacle_limited,
            stop: self.stops.update(report, sample, self.time_s)?,
        };
        if report.faults.intersects(Faults::BATTERY_LOW) {
            plan.recall();
        }
        Ok(match plan.step(grid, &status) {
            Action::Drive(velocity) => ControlFlow::Continue(CommandRequest {
                velocity: Some(velocity_request(velocity)),
                clear_faults: report.faults & Faults::SLIP,
                ..CommandRequest::default()
            }),
            Action::Resume => ControlFlow::Continue(CommandRequest {
                order: Order::Resume,
                clear_faults: report.faults,
                ..CommandRequest::default()
            }),
            Action::Done(outcome) => ControlFlow::Break(self.end(outcome)),
        })
    }

    /// The drive up to the last report.
    fn end(&self, outcome: Outcome) -> Drive {
        Drive {
            outcome,
            seconds: self.time_s,
            stops: self.stops.count,
        }
    }
}

/// Explorations in search of a place on a map, at most.
const ROUNDS: u32 = 4;

/// Explores until the robot knows where it stands on a saved map. `watch` gets every valid report.
///
/// # Errors
/// Those of [`drive`].
pub fn locate(
    session: &mut Session<'_>,
    on_map: &mut Localiser,
    body_mm: f64,
    mut watch: impl FnMut(&Step<'_>),
) -> Result<Drive, Error> {
    let cell_mm = on_map.grid().cell_mm();
    let mut again = 1..ROUNDS;
    loop {
        let config = session.config();
        let mut around = Localisation {
            on_map: Some(on_map.clone()),
            ..Localisation::new(config, body_mm, cell_mm)
        };
        let mut plan = Explorer::new(navigator_config(config, body_mm)?);
        let driven = drive(session, &mut around, &mut plan, |step| {
            watch(step);
            if step.located {
                return ControlFlow::Break(());
            }
            ControlFlow::Continue(())
        })?;
        if let Some(sought) = around.on_map {
            *on_map = sought;
        }
        // A small room is explored before it is recognised.
        let is_lost = driven.outcome == Outcome::Complete && !on_map.is_located();
        if !is_lost || again.next().is_none() {
            return Ok(driven);
        }
    }
}

fn velocity_request(velocity: Velocity) -> VelocityRequest {
    VelocityRequest {
        forward_mm_s: velocity.forward_mm_s,
        yaw_rate_deg_s: velocity.yaw_rate_rad_s.to_degrees(),
        sweep_half_width_deg: velocity.sweep_half_width_rad.to_degrees(),
    }
}

/// A report as the localiser takes it.
pub fn observation(sample: &RangeSample) -> Observation {
    Observation {
        time_s: seconds_since(0, sample.time_us),
        odometry: mapping::mapper_pose(sample.pose),
        gyro_rad: sample.gyro_deg.map(f64::to_radians),
        ranges_mm: sample.ranges_mm,
        front_bearing_rad: sample.bearing_deg.map(f64::to_radians),
    }
}
