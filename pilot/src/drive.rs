//! Driving to a pose, and from pose to pose. Every early end of a drive stops the robot.

mod meanwhile;
mod pose_follower;

pub use meanwhile::meanwhile;

use crate::mapping::mapper_pose;
use fw_core::eeprom::Config;
use fw_core::wire::{Field, Report};
use host_link::board_io::BoardIo;
use host_link::error::Error;
use host_link::pose::Pose;
use host_link::session::{CommandRequest, Session, VelocityRequest};
use host_link::snapshot::Snapshot;
use pose_follower::PoseFollower;
use std::collections::VecDeque;

/// When a drive counts as done.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ArrivalCriteria {
    /// How near the target, millimetres.
    pub tolerance_mm: f64,
    /// How near its rotation, degrees.
    pub tolerance_deg: f64,
    /// Seconds the drive may take; none: [`ArrivalCriteria::allowance_s`] by its length.
    pub timeout_s: Option<f64>,
}

impl Default for ArrivalCriteria {
    fn default() -> Self {
        Self {
            tolerance_mm: 5.0,
            tolerance_deg: 1.0,
            timeout_s: None,
        }
    }
}

/// Frames in a row without a valid reply after which a robot does not drive on blindly: a fifth of a second at
/// 40 Hz, less than its own stop deadline.
pub const MAX_UNANSWERED: u32 = 8;

/// Slowest average a drive is given time for, millimetres a second; of a slow configuration half its speed.
const SLOWEST_MM_S: f64 = 40.0;

/// Time for turning and settling on top, seconds …
const SETTLING_S: f64 = 15.0;
/// … and this far at the configured yaw rate, degrees.
const TURNING_DEG: f64 = 720.0;

/// The robot is at rest when nothing moved for this long, microseconds …
const REST_US: u64 = 250_000;
/// … by more than this, millimetres …
const REST_MM: f64 = 0.3;
/// … and this, degrees.
const REST_DEG: f64 = 0.1;

impl ArrivalCriteria {
    /// Seconds a drive over `mm` may take when no time-out is given.
    pub fn allowance_s(&self, mm: f64, config: &Config) -> f64 {
        let limits = config.velocity_limits();
        let slowest_mm_s = SLOWEST_MM_S.min(f64::from(limits.speed_mm_s.max(1)) / 2.0);
        let yaw_deg_s = f64::from(limits.yaw_rate.max(1)) / 4_294_967_296.0 * 360.0;
        let turning_s = SETTLING_S.max(TURNING_DEG / yaw_deg_s);
        self.timeout_s.unwrap_or(turning_s + mm / slowest_mm_s)
    }
}

/// A drive that ended at its target.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Arrival {
    /// The reported pose.
    pub pose: Pose,
    /// Distance to the target, millimetres.
    pub off_mm: f64,
    /// Rotation to the target, degrees, signed.
    pub off_deg: f64,
    /// Seconds it took.
    pub seconds: f64,
}

/// Drives to `target` and returns when the robot stands there within the criteria and at rest.
/// `watch` gets the snapshot after every valid report.
///
/// # Errors
/// Those of [`Session::exchange`]; [`Error::WrongMode`], [`Error::Fault`], [`Error::NotReached`].
/// On each of them, and on a panic of `watch`, the robot is stopped first.
pub fn go_to(
    session: &mut Session<'_>,
    target: Pose,
    criteria: &ArrivalCriteria,
    mut watch: impl FnMut(&Snapshot),
) -> Result<Arrival, Error> {
    follow(session, target, criteria, |session, report, _| {
        if report.is_some() {
            watch(session.snapshot());
        }
        Ok(())
    })
}

/// Ends a stop, where the mode has a pose to drive to.
///
/// # Errors
/// Those of [`Session::resume`]; [`Error::WrongMode`].
pub fn resume_to_pose(session: &mut Session<'_>) -> Result<(), Error> {
    let mode = session.config().mode();
    if !mode.has(Field::Position) && !mode.has(Field::Velocity) {
        return Err(Error::WrongMode(mode.name(), "position to drive to"));
    }
    session.resume()
}

/// Reads the EEPROM and starts exchanging frames.
///
/// # Errors
/// Those of [`Session::open`] and [`check_rate`].
pub fn open_session(
    io: &mut BoardIo,
    rate_hz: u32,
    ready_timeout_ms: u32,
) -> Result<Session<'_>, Error> {
    let session = Session::open(io, rate_hz, ready_timeout_ms)?;
    check_rate(rate_hz, session.config())?;
    Ok(session)
}

/// The stop deadline must survive the loss of a frame.
///
/// # Errors
/// [`Error::Usage`].
pub fn check_rate(rate_hz: u32, config: &Config) -> Result<(), Error> {
    let deadline_ms = u32::from(config.stop_deadline().0);
    let least = 2000_u32.div_ceil(deadline_ms.max(1));
    if rate_hz >= least {
        return Ok(());
    }
    Err(Error::Usage(format!(
        "--rate {rate_hz}: frames would come {} ms apart, and the stop deadline is {deadline_ms} ms; accepted is {least} or more",
        1000 / rate_hz.max(1)
    )))
}

/// [`go_to`] whose `watch` is also called for frames without a valid reply, with the velocity that was sent, and
/// may end the drive.
///
/// # Errors
/// Those of [`go_to`] and of `watch`; the robot is stopped first.
pub fn follow<'m>(
    session: &mut Session<'m>,
    target: Pose,
    criteria: &ArrivalCriteria,
    mut watch: impl FnMut(
        &mut Session<'m>,
        Option<&Report>,
        Option<VelocityRequest>,
    ) -> Result<(), Error>,
) -> Result<Arrival, Error> {
    resume_to_pose(session)?;
    let mode = session.config().mode();
    let begun_us = session.now_us();
    let from = session.snapshot().pose.unwrap_or_default();
    let seconds = criteria.allowance_s(from.distance_mm(target), session.config());
    let mut request = CommandRequest {
        target: Some(target),
        ..CommandRequest::default()
    };
    // Where the frame carries a velocity, the pose is followed here.
    let mut follower = mode
        .has(Field::Velocity)
        .then(|| PoseFollower::new(target, criteria, session.config()));
    let (mut rest, mut still, mut rests) = (RestDetector::default(), false, 0);
    let mut moving = StopOnDrop::new(session);
    loop {
        if let Some(follower) = &mut follower {
            let snapshot = moving.session.snapshot();
            let time_s = seconds_since(begun_us, snapshot.time_us);
            let pose = snapshot.pose.unwrap_or_default();
            let (forward_mm_s, yaw_rate_deg_s) =
                follower.step(time_s, pose, snapshot.obstacle_limited, still);
            request.velocity = Some(VelocityRequest {
                forward_mm_s,
                yaw_rate_deg_s,
                ..VelocityRequest::default()
            });
        }
        let report = moving.exchange(&request)?;
        watch(moving.session, report.as_ref(), request.velocity)?;
        if let Some(report) = report {
            let session = &*moving.session;
            session.ensure_drivable(report.state, report.faults)?;
            let snapshot = moving.session.snapshot();
            let pose = Pose::from_code(report.pose);
            let (off_mm, off_deg) = (pose.distance_mm(target), pose.rotation_to_deg(target));
            let near = off_mm <= criteria.tolerance_mm && off_deg.abs() <= criteria.tolerance_deg;
            let came_to_rest = !still;
            still = rest.settled(snapshot.time_us, pose);
            rests += u32::from(still && came_to_rest && near);
            let exact = follower.as_ref().is_none_or(|one| one.reaches(pose));
            let ended = follower.as_ref().is_none_or(PoseFollower::stands);
            if still && ended && near && (exact || rests > CORRECTIONS) {
                moving.arrived = true;
                return Ok(Arrival {
                    pose,
                    off_mm,
                    off_deg,
                    seconds: seconds_since(begun_us, snapshot.time_us),
                });
            }
        }
        let now_us = moving.session.now_us();
        if seconds_since(begun_us, now_us) > seconds {
            let snapshot = moving.session.snapshot();
            let pose = snapshot.pose.unwrap_or_default();
            return Err(Error::NotReached {
                seconds,
                off_mm: pose.distance_mm(target),
                off_deg: pose.rotation_to_deg(target),
                obstacle: snapshot.obstacle_limited,
            });
        }
    }
}

/// Drives the way-points in turn, coming to rest at each. `reached` gets the index and the
/// arrival of each.
///
/// # Errors
/// Those of [`go_to`].
pub fn tour(
    session: &mut Session<'_>,
    way: &[Pose],
    criteria: &ArrivalCriteria,
    mut watch: impl FnMut(&Snapshot),
    mut reached: impl FnMut(usize, &Arrival),
) -> Result<(), Error> {
    for (index, &target) in way.iter().enumerate() {
        let arrival = go_to(session, target, criteria, &mut watch)?;
        reached(index, &arrival);
    }
    Ok(())
}

#[allow(clippy::cast_precision_loss)] // exact below 285 years
pub(crate) fn seconds_since(begun_us: u64, now_us: u64) -> f64 {
    now_us.saturating_sub(begun_us) as f64 / 1e6
}

/// Stops the robot when dropped before it arrived.
pub struct StopOnDrop<'s, 'm> {
    /// The session to drive in.
    pub session: &'s mut Session<'m>,
    arrived: bool,
}

impl<'s, 'm> StopOnDrop<'s, 'm> {
    /// Stops the robot when this is dropped.
    pub fn new(session: &'s mut Session<'m>) -> Self {
        let arrived = false;
        Self { session, arrived }
    }

    /// Exchanges a frame of the drive. After [`MAX_UNANSWERED`] the velocity is zero.
    ///
    /// # Errors
    /// Those of [`Session::exchange`]; [`Error::Restarted`].
    pub fn exchange(&mut self, request: &CommandRequest) -> Result<Option<Report>, Error> {
        let mut request = *request;
        if let (Some(velocity), Err(_)) = (
            &mut request.velocity,
            self.session.check_answered(MAX_UNANSWERED),
        ) {
            (velocity.forward_mm_s, velocity.yaw_rate_deg_s) = (0.0, 0.0);
        }
        let report = self.session.exchange(&request)?;
        if self.session.snapshot().restarted {
            return Err(Error::Restarted);
        }
        Ok(report)
    }
}

impl Drop for StopOnDrop<'_, '_> {
    fn drop(&mut self) {
        if !self.arrived {
            self.session.stop();
        }
    }
}

/// Length of the window of the measured speed, reports.
const SPEED_WINDOW: usize = 5;

/// The forward speed over the last reports.
#[derive(Default)]
pub struct SpeedMeter(VecDeque<(f64, Pose)>);

impl SpeedMeter {
    /// Takes a report's time, s, and pose; mm/s.
    pub fn update(&mut self, time_s: f64, pose: Pose) -> f64 {
        self.0.push_back((time_s, pose));
        if self.0.len() > SPEED_WINDOW {
            self.0.pop_front();
        }
        let (then_s, then) = self.0[0];
        let behind_mm = mapper_pose(then).relative_to(&mapper_pose(pose)).x_mm;
        -behind_mm / (time_s - then_s).max(0.01)
    }
}

/// How often a robot that rests near enough is brought nearer, to the configured tolerances: every turn on
/// the spot moves it by a millimetre or so.
const CORRECTIONS: u32 = 3;

/// The poses of the last quarter of a second.
#[derive(Default)]
struct RestDetector(VecDeque<(u64, Pose)>);

impl RestDetector {
    /// Notes a pose; whether nothing moved since [`REST_US`] ago.
    fn settled(&mut self, now_us: u64, pose: Pose) -> bool {
        let moved = |&(_, old): &(u64, Pose)| {
            old.distance_mm(pose) > REST_MM || old.rotation_to_deg(pose).abs() > REST_DEG
        };
        if self.0.iter().any(moved) {
            self.0.clear();
        }
        self.0.push_back((now_us, pose));
        let rests = |&(since, _): &(u64, Pose)| now_us.saturating_sub(since) >= REST_US;
        self.0.front().is_some_and(rests)
    }
}

#[cfg(test)]
mod tests;
