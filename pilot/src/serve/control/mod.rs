//! The control loop: one thread owns the robot, answers the clients once a frame and publishes it.

mod lending;
mod map;
mod publishing;
mod requests;

use super::hub::{Client, ClientId, Event};
use super::pacer::Pacer;
use super::protocol::{Activity, Failure, Frame, Message};
use super::tiles::Tiles;
use crate::drive::{self, ArrivalCriteria, StopOnDrop, meanwhile};
use crate::exploring::{self, Plan, PlanRunner};
use crate::hints;
use crate::mapping::{self, RangeSample};
use fw_core::eeprom::Config;
use fw_core::types::Faults;
use fw_core::wire::Report;
use host_link::board_io::BoardIo;
use host_link::eeprom::journal::Journal;
use host_link::error::{Error, Exit};
use host_link::log::Lines;
use host_link::pose::Pose;
use host_link::session::{CommandRequest, Session, VelocityRequest};
use lending::Loan;
use map::Map;
use mapper::Localiser;
use std::collections::BTreeMap;
use std::ops::ControlFlow;
use std::sync::mpsc::Receiver;
use std::time::{Duration, Instant};

/// Cells of the map, mm.
pub const CELL_MM: f64 = 25.0;
/// Frames between two looks for advice.
const ADVICE_FRAMES: u32 = 20;
/// Frames in which the STM's log must have shown its end.
const LOG_FRAMES: u64 = 100;
/// Time between two attempts to reach a robot that does not answer …
const RETRY: Duration = Duration::from_secs(1);
/// … and how long each awaits `STM_READY`, ms: meanwhile no client is answered.
const READY_MS: u32 = 100;

/// How to serve.
#[derive(Clone, Debug)]
pub struct Options {
    /// Frames per second.
    pub rate_hz: u32,
    /// How long to await `STM_READY` for the first time, ms.
    pub ready_timeout_ms: u32,
    /// How much faster than real time virtual time passes; none: as the board's clock does by itself.
    pub speed: Option<f64>,
    /// Radius of the robot's body, mm.
    pub body_mm: f64,
    /// Of an EEPROM write that a client which borrowed the robot may leave unfinished.
    pub journal: Option<Journal>,
}

/// What a client has made the robot do.
enum Motion {
    /// The latest velocity of [`Server::velocity`].
    Velocity,
    Pose(Pose),
    Plan(Activity, Box<dyn Plan>),
    /// The stop order alone.
    Stop,
    /// Clears the latched faults.
    Clear,
}

/// What follows.
enum Next {
    Motion(Motion),
    /// The lines and buses are the client's.
    Lend,
}

impl Motion {
    const fn activity(&self) -> Activity {
        match self {
            Self::Velocity => Activity::Drive,
            Self::Pose(_) => Activity::Goto,
            Self::Plan(activity, _) => *activity,
            Self::Stop | Self::Clear => Activity::Idle,
        }
    }
}

/// The right to drive.
struct Lease {
    client: ClientId,
    name: String,
    length: Duration,
    /// On this computer's clock: it shows that the client lives. None: the robot is lent.
    ends: Option<Instant>,
}

impl Lease {
    fn is_over(&self) -> bool {
        self.ends.is_some_and(|ends| Instant::now() >= ends)
    }
}

struct Server {
    events: Receiver<Event>,
    clients: BTreeMap<ClientId, Client>,
    lease: Option<Lease>,
    loan: Option<Loan>,
    activity: Activity,
    velocity: VelocityRequest,
    /// What to do when the present motion has ended.
    next: Option<Next>,
    /// Why the present motion must end.
    cancelled: Option<Error>,
    config: Option<Config>,
    body_mm: f64,
    map: Map,
    tiles: Tiles,
    /// The latest, and when; none before the first of a map.
    pose: Option<(u64, Pose)>,
    targets: usize,
    advice: Vec<String>,
    frames: u32,
    latest: Option<Frame>,
    log: Lines,
    pacer: Pacer,
}

/// Serves until Ctrl-C.
///
/// # Errors
/// Those of [`Session::open`] the first time; later ones are shown to the clients, and the robot is tried
/// again every second.
pub fn run(io: &mut BoardIo, options: &Options, events: Receiver<Event>) -> Result<(), Error> {
    let mut server = Server {
        events,
        clients: BTreeMap::new(),
        lease: None,
        loan: None,
        activity: Activity::Idle,
        velocity: VelocityRequest::default(),
        next: None,
        cancelled: None,
        config: None,
        body_mm: options.body_mm,
        map: Map::default(),
        tiles: Tiles::default(),
        pose: None,
        targets: 0,
        advice: Vec::new(),
        frames: 0,
        latest: None,
        log: Lines::default(),
        pacer: Pacer::new(options.speed),
    };
    let interrupt = io.interrupt.clone();
    let ready_by = Instant::now() + Duration::from_millis(options.ready_timeout_ms.into());
    loop {
        let ended = match drive::open_session(io, options.rate_hz, READY_MS) {
            Ok(mut session) => server.serve(&mut session),
            Err(error) if server.latest.is_some() => Err(error),
            Err(error @ Error::NotReady(_)) if Instant::now() < ready_by => Err(error),
            Err(Error::NotReady(_)) => return Err(Error::NotReady(options.ready_timeout_ms)),
            Err(error) => return Err(error),
        };
        let ended = ended.and_then(|()| server.lend(io, options));
        let Err(error) = ended else {
            continue;
        };
        let again = Instant::now() + RETRY;
        while Instant::now() < again {
            if matches!(server.next, Some(Next::Lend)) && server.lend(io, options).is_ok() {
                break;
            }
            if interrupt.check().is_err() {
                return Ok(());
            }
            server.unreachable(&error);
            std::thread::sleep(Duration::from_millis(50));
        }
    }
}

impl Server {
    /// Frames until the robot is to be lent.
    ///
    /// # Errors
    /// Why the link has ended.
    fn serve(&mut self, session: &mut Session<'_>) -> Result<(), Error> {
        self.config = Some(session.config().clone());
        // What was advised is of the session before.
        self.frames = 0;
        loop {
            match self.next.take() {
                None => {
                    let report = session.exchange(&CommandRequest::default())?;
                    self.frame(session, report.as_ref())?;
                }
                Some(Next::Lend) => return Ok(()),
                Some(Next::Motion(motion)) => self.perform(session, motion)?,
            }
        }
    }

    /// Performs a motion to its end.
    ///
    /// # Errors
    /// What ends the session, too.
    fn perform(&mut self, session: &mut Session<'_>, motion: Motion) -> Result<(), Error> {
        (self.activity, self.cancelled) = (motion.activity(), None);
        if !matches!(motion, Motion::Velocity) {
            self.velocity = VelocityRequest::default();
        }
        let begun_us = session.now_us();
        let outcome = match motion {
            Motion::Velocity => self.follow_velocity(session),
            Motion::Pose(target) => {
                let watch = |session: &mut Session<'_>, report: Option<&Report>, velocity| {
                    self.velocity = Option::unwrap_or_default(velocity);
                    self.frame(session, report)
                };
                drive::follow(session, target, &ArrivalCriteria::default(), watch).map(|_| ())
            }
            Motion::Plan(_, mut plan) => self.follow_plan(session, &mut *plan),
            Motion::Stop => {
                session.stop();
                Ok(())
            }
            Motion::Clear => self.clear_faults(session),
        };
        let activity = std::mem::take(&mut self.activity);
        let seconds = drive::seconds_since(begun_us, session.now_us());
        (self.cancelled, self.targets) = (None, 0);
        self.report_end(activity, outcome.as_ref().err(), seconds);
        if self.next.is_none() {
            self.lease = None;
        }
        if session.take_restart() {
            self.pose = None;
        }
        match outcome {
            Err(error) if matches!(error.exit(), Exit::Link | Exit::Interrupted) => Err(error),
            _ => Ok(()),
        }
    }

    /// Reports the end of a motion to the client that drives.
    fn report_end(&mut self, activity: Activity, error: Option<&Error>, seconds: f64) {
        let done = Message::Done {
            activity,
            error: error.map(Failure::from),
            seconds,
        };
        if let (Some(lease), true) = (&self.lease, activity != Activity::Idle) {
            self.send_to(lease.client, &done);
        }
    }

    fn follow_velocity(&mut self, session: &mut Session<'_>) -> Result<(), Error> {
        session.resume()?;
        let mut moving = StopOnDrop::new(session);
        loop {
            let request = CommandRequest {
                velocity: Some(self.velocity),
                clear_faults: Faults::SLIP,
                ..CommandRequest::default()
            };
            let report = moving.exchange(&request)?;
            let outcome = self.frame(moving.session, report.as_ref());
            // A command to stand ends with its lease.
            let stands = self.velocity == VelocityRequest::default();
            if outcome.is_err() && stands && self.lease.as_ref().is_some_and(Lease::is_over) {
                return Ok(());
            }
            outcome?;
            if let Some(report) = report {
                let (state, faults) = (report.state, report.faults);
                moving.session.ensure_drivable(state, faults)?;
            }
        }
    }

    fn follow_plan(&mut self, session: &mut Session<'_>, plan: &mut dyn Plan) -> Result<(), Error> {
        session.resume()?;
        let mut runner = PlanRunner::new(session.now_us());
        let mut moving = StopOnDrop::new(session);
        let mut request = CommandRequest::default();
        loop {
            let report = moving.exchange(&request)?;
            self.frame(moving.session, report.as_ref())?;
            let sample = RangeSample::of(moving.session.snapshot());
            let (Some(report), Some(sample)) = (report, sample) else {
                continue;
            };
            let Some(localiser) = self.map.localiser.take() else {
                continue;
            };
            let (grid, estimate) = (localiser.grid(), localiser.estimate());
            let think = || runner.step(plan, grid, estimate, &sample, &report);
            let next = meanwhile(moving.session, request.velocity, think, |session| {
                self.show(session)
            });
            self.map.localiser = Some(localiser);
            match next?? {
                ControlFlow::Continue(next) => request = next,
                ControlFlow::Break(drive) => {
                    return drive.ensure_complete("the drive is not complete");
                }
            }
            self.velocity = request.velocity.unwrap_or_default();
            self.targets = plan.targets();
        }
    }

    fn clear_faults(&mut self, session: &mut Session<'_>) -> Result<(), Error> {
        let request = CommandRequest {
            clear_faults: Faults::ALL_BITS,
            ..CommandRequest::default()
        };
        for _ in 0..3 {
            let report = session.exchange(&request)?;
            self.frame(session, report.as_ref())?;
        }
        Ok(())
    }

    /// After each frame: the map, the clients, the lease.
    ///
    /// # Errors
    /// Why the present motion must end.
    fn frame(&mut self, session: &mut Session<'_>, report: Option<&Report>) -> Result<(), Error> {
        let sample = RangeSample::of(session.snapshot());
        if let Some(sample) = sample.filter(|_| report.is_some()) {
            let jumps = |(us, pose)| session.snapshot().has_jumped_since(us, pose);
            let is_new = self.pose.is_none_or(jumps);
            self.pose = Some((sample.time_us, sample.pose));
            if session.take_restart() || is_new {
                let settings = exploring::localiser_config(session.config(), self.body_mm, CELL_MM);
                self.map = Map::default();
                self.map.put(Localiser::new(settings));
                self.new_map();
            }
            self.map.waiting.push(exploring::observation(&sample));
            if self.loan.is_some() && session.io().real_time {
                // A borrower's frames wait for nothing.
                self.map.collect(false);
                self.show(session)?;
                self.map.work_beside();
                return Ok(());
            }
            self.map.collect(true);
            let mut observed = Ok(());
            if let Some(mut localiser) = self.map.localiser.take() {
                let waiting = std::mem::take(&mut self.map.waiting);
                let observe = || waiting.iter().for_each(|one| localiser.observe(one));
                let velocity = (self.activity != Activity::Idle).then_some(self.velocity);
                observed = meanwhile(session, velocity, observe, |session| self.show(session));
                self.map.put(localiser);
            }
            observed?;
        }
        self.show(session)
    }

    /// # Errors
    /// Why the present motion must end.
    fn show(&mut self, session: &mut Session<'_>) -> Result<(), Error> {
        let log = session.poll_log();
        if let Some(loan) = &mut self.loan {
            loan.keep_log(&log);
        }
        let config = session.config();
        if self.frames.is_multiple_of(ADVICE_FRAMES) {
            self.advice = hints::diagnose(session.snapshot(), config);
            // Its first lines may still come.
            if session.statistics().frames >= LOG_FRAMES {
                let (snapshot, unread) = (session.snapshot(), session.log_error());
                self.advice.extend(hints::no_log(snapshot, unread));
            }
        }
        self.latest = Some(Frame {
            robot: session.snapshot().clone(),
            estimate: self.map.estimate,
            activity: self.activity,
            driver: self.lease.as_ref().map(|lease| lease.name.clone()),
            targets: self.targets,
            advice: self.advice.clone(),
            error: None,
            clients: self.clients.len(),
            rangefinders: mapping::sensor_poses(config, self.body_mm),
            stop_deadline_ms: config.stop_deadline().0,
        });
        self.publish(&log);
        self.pacer.wait(session.now_us());
        self.handle_events();
        self.cancelled.take().map_or(Ok(()), Err)
    }
}
