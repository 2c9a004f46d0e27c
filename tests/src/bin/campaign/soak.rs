//! One robot for many hours in a generated room and an imperfect world: it explores, stands under command or is left
//! alone, with faults in every other of these phases.
//!
//! In a phase without faults it must report none, map its room and stay where it stands; whatever happened before,
//! it must go on without a power cycle.

use std::error::Error;

use fw_core::types::Faults;
use fw_core::wire::{Order, State};
use host_link::board_io::BoardIo;
use host_link::session::{CommandRequest, RATE_HZ, Session};
use navigator::Outcome;
use plant::{Imperfections, Rng, Sides, room};
use robot_tests::exploration::{self, READY_MS};
use robot_tests::test_board;
use twin::Board;

use crate::faults::{After, CRYSTAL, Cause, KINDS, Kind, reset};

/// Without a load, charged: the battery never runs down.
const CELLS_V: [f64; 2] = [3.9, 3.9];
/// From one fault to the next, and how long each lasts, seconds: least and range.
const PAUSE_S: [f64; 2] = [5.0, 60.0];
const LASTS_S: [f64; 2] = [0.2, 4.0];
/// Standing and being left alone, seconds: least and range.
const REST_S: [usize; 2] = [60, 840];
/// A silent Pi, longer than the stop deadline, microseconds.
const SILENCE_US: u64 = 400_000;
/// A second at 40 Hz.
const CLEARING_FRAMES: u32 = 40;
/// A contact that is faster was no touch, mm/s.
const TOUCH_MM_S: f64 = 20.0;
/// What a sound robot may report: a wheel slips over a sill; a gyroscope that lied once is lost until a turn.
const HARMLESS: Faults = Faults::SLIP.union(Faults::GYRO_LOST);

fn between(random: &mut Rng, [least, range]: [f64; 2]) -> f64 {
    least + range * random.unit()
}

fn charge(board: &Board) {
    board.set_faults(|faults| faults.cells_v = Some(CELLS_V));
}

/// Faults that come and go while the robot is used.
struct Disturbance {
    board: Board,
    random: Rng,
    /// The fault that is on, and its end, s of virtual time.
    on: Option<(&'static Kind, f64)>,
    next_s: f64,
    met: Vec<&'static Kind>,
    findings: Vec<String>,
}

impl Disturbance {
    fn new(board: &Board, random: &mut Rng) -> Self {
        let mut random = Rng::new(random.next_u64());
        let next_s = seconds(board) + between(&mut random, PAUSE_S);
        Self {
            board: board.clone(),
            random,
            on: None,
            next_s,
            met: Vec::new(),
            findings: Vec::new(),
        }
    }

    /// Begins or ends a fault, if it is time.
    fn look(&mut self) {
        let now_s = seconds(&self.board);
        if let Some((kind, end_s)) = self.on
            && now_s >= end_s
        {
            self.end(kind);
        }
        if self.on.is_some() || now_s < self.next_s {
            return;
        }
        let kind = &KINDS[self.random.below(KINDS.len())];
        // For good, and with another ELF.
        if kind.0 == CRYSTAL {
            return;
        }
        self.met.push(kind);
        if let Cause::Frames(_) = kind.1 {
            self.silence();
            self.next_s = now_s + between(&mut self.random, PAUSE_S);
        } else {
            kind.1.set(&self.board, true);
            self.on = Some((kind, now_s + between(&mut self.random, LASTS_S)));
        }
    }

    /// Whatever the link suffers, it is silent to the robot.
    fn silence(&mut self) {
        self.board.run_us(SILENCE_US);
        let duty = self.board.truth().duty;
        if duty != Sides::default() {
            self.findings
                .push(format!("motors on after a silent link: {duty:?}"));
        }
    }

    fn end(&mut self, kind: &Kind) {
        kind.1.set(&self.board, false);
        charge(&self.board);
        self.on = None;
        self.next_s = seconds(&self.board) + between(&mut self.random, PAUSE_S);
    }
}

#[expect(clippy::cast_precision_loss, reason = "days")]
fn seconds(board: &Board) -> f64 {
    board.now_us() as f64 / 1e6
}

/// What a robot does in a phase.
#[derive(Clone, Copy, Debug)]
enum Phase {
    Explore,
    Stand,
    /// The Pi is off.
    Alone,
}

/// The robot and its room.
pub struct Soak {
    board: Board,
    io: BoardIo,
    random: Rng,
    explored: u32,
    disturbed: u32,
    findings: u32,
}

impl Soak {
    pub fn new(elf: &[u8], seed: u64) -> Result<Self, Box<dyn Error>> {
        let room = room::generate(seed);
        let options = exploration::options(&room, Imperfections::default(), seed);
        let board = exploration::configured_board(elf, options)?;
        charge(&board);
        Ok(Self {
            io: test_board::io(&board),
            board,
            random: Rng::stream(seed, 0x50A4),
            explored: 0,
            disturbed: 0,
            findings: 0,
        })
    }

    /// Uses the robot for these hours of virtual time; whether there was no finding.
    pub fn run(mut self, hours: f64) -> bool {
        let mut number = 0;
        while seconds(&self.board) < hours * 3600.0 {
            let phase = match self.random.below(4) {
                0 | 1 => Phase::Explore,
                2 => Phase::Stand,
                _ => Phase::Alone,
            };
            let disturb = self.random.below(2) == 0;
            let disturbance = disturb.then(|| Disturbance::new(&self.board, &mut self.random));
            number += 1;
            if !self.phase(number, phase, disturbance) {
                break;
            }
        }
        println!(
            "{:.2} virtual hours, {number} phases, {} rooms explored without faults, {} faults; findings: {}",
            seconds(&self.board) / 3600.0,
            self.explored,
            self.disturbed,
            self.findings
        );
        self.findings == 0
    }

    /// One phase; whether the robot could begin it.
    fn phase(&mut self, number: u32, phase: Phase, mut disturbance: Option<Disturbance>) -> bool {
        let begin_s = seconds(&self.board);
        let resets = self.board.resets().len();
        let contacts = self.board.truth().collisions;
        let log = self.board.uart().len();
        let recovered = self.recover();
        let goes_on = recovered.is_ok();
        let result = recovered.and_then(|()| match phase {
            Phase::Explore => self.explore(disturbance.as_mut()),
            Phase::Stand => self.stand(disturbance.as_mut()),
            Phase::Alone => {
                let rest_us = self.rest_us();
                self.board.run_us(rest_us);
                Ok(())
            }
        });
        let mut findings = Vec::new();
        let mut met = Vec::new();
        if let (Some(mut disturbance), true) = (disturbance, goes_on) {
            if let Some((kind, _)) = disturbance.on {
                disturbance.end(kind);
            }
            findings = disturbance.findings;
            met = disturbance.met;
            self.disturbed += u32::try_from(met.len()).unwrap_or(u32::MAX);
        } else {
            findings.extend(result.err().map(|error| error.to_string()));
            let fast = move |world: &mut plant::World| {
                let speeds = world.collisions().iter().map(|contact| contact.speed_mm_s);
                speeds.skip(contacts as usize).fold(0.0, f64::max)
            };
            let fast = self.board.world(fast);
            if fast > TOUCH_MM_S {
                findings.push(format!("a collision at {fast:.0} mm/s"));
            }
            if self.board.resets().len() > resets {
                findings.push("a reset".into());
            }
            // What it may meet without a fault, a slip over a sill, is a warning.
            let lines = String::from_utf8_lossy(&self.board.uart_from(log)).into_owned();
            let errors = lines.lines().filter(|line| line.starts_with('E'));
            findings.extend(errors.map(str::to_owned));
        }
        let unmodelled = self.board.unmodelled();
        if !unmodelled.is_empty() {
            findings.push(format!("a rule of the part is broken: {unmodelled:?}"));
        }
        // What only a reset ends: a held bus, the battery's cut-off.
        let cut_off = |faults: Faults| faults.intersects(Faults::BATTERY_CUTOFF);
        if met.iter().any(|kind| kind.3 == After::Reset)
            || !met.is_empty() && self.faults().is_ok_and(cut_off)
        {
            reset(&self.board);
            self.board.run_us(200_000);
        }
        let met: Vec<_> = met.iter().map(|kind| kind.0).collect();
        for finding in findings {
            println!("phase {number}, {phase:?} from {begin_s:.0} s, faults {met:?}: {finding}");
            self.findings += 1;
            print!("{}", String::from_utf8_lossy(&self.board.uart_from(log)));
        }
        goes_on
    }

    fn faults(&mut self) -> Result<Faults, Box<dyn Error>> {
        Ok(open(&mut self.io)?.wait_for_reply()?.faults)
    }

    /// A person clears the faults.
    fn recover(&mut self) -> Result<(), Box<dyn Error>> {
        let mut session = open(&mut self.io)?;
        let clear = CommandRequest {
            clear_faults: Faults::from_bits(u16::MAX),
            order: Order::Resume,
            ..CommandRequest::default()
        };
        for _ in 0..CLEARING_FRAMES {
            session.exchange(&clear)?;
        }
        let report = session.wait_for_reply()?;
        if report.state == State::Stopped || !report.faults.difference(HARMLESS).is_empty() {
            return Err(format!("not recovered: {report:?}").into());
        }
        Ok(())
    }

    fn explore(&mut self, mut disturbance: Option<&mut Disturbance>) -> Result<(), Box<dyn Error>> {
        let run = exploration::explore(&mut self.io, &self.board, |_| {
            if let Some(disturbance) = &mut disturbance {
                disturbance.look();
            }
        });
        let run = run?;
        let drive = run.drive?;
        if drive.outcome != Outcome::Complete || run.link.rejected > 0 {
            return Err(format!("{drive:?}, {:?}", run.link).into());
        }
        self.explored += 1;
        Ok(())
    }

    fn rest_us(&mut self) -> u64 {
        let [least, range] = REST_S;
        1_000_000 * (least + self.random.below(range)) as u64
    }

    /// Frames without motion.
    fn stand(&mut self, mut disturbance: Option<&mut Disturbance>) -> Result<(), Box<dyn Error>> {
        let ends_us = self.board.now_us() + self.rest_us();
        let mut session = open(&mut self.io)?;
        // A session clears the rejection of its own first frame.
        for _ in 0..CLEARING_FRAMES {
            session.exchange(&CommandRequest::default())?;
        }
        let mut begin = None;
        while self.board.now_us() < ends_us {
            let report = session.exchange(&CommandRequest::default());
            let report = match (report, &mut disturbance) {
                (_, Some(disturbance)) => {
                    disturbance.look();
                    continue;
                }
                (report, None) => report?,
            };
            let Some(report) = report else { continue };
            let pose = *begin.get_or_insert(report.pose);
            if report.pose != pose || !report.faults.difference(HARMLESS).is_empty() {
                return Err(format!("stood at {pose:?}: {report:?}").into());
            }
        }
        let rejected = session.statistics().rejected;
        if rejected > 0 {
            return Err(format!("{rejected} frames rejected").into());
        }
        Ok(())
    }
}

fn open(io: &mut BoardIo) -> Result<Session<'_>, Box<dyn Error>> {
    Ok(Session::open(io, RATE_HZ, READY_MS)?)
}
