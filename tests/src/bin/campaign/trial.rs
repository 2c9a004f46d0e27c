//! One fault or a pair on one driving robot, from power-on to its recovery.

use std::error::Error;

use fw_core::eeprom::{Config, Image, fields};
use fw_core::types::Faults;
use fw_core::wire::{Command, MAX_FRAME, Mode, Order, PiLink, Report, State};
use plant::{Pose2, Rng, Sides};
use robot_tests::linked_robot::velocity;
use robot_tests::test_board::near_walls;
use robot_tests::wires::{first_bits, selected};
use twin::components::eeprom::Eeprom;
use twin::components::i2c_bus::I2cBus;
use twin::components::spi_master::pack;
use twin::{Board, Options};

use crate::faults::{
    After, Cause, Frames, HALTED, HIDDEN, Kind, RESTARTING, Sign, lies_after_reset, reset,
};
use crate::replies::Replies;

/// The first board's stop deadline, a tick, and the millisecond between two looks, microseconds.
const STOP_US: u64 = 250_000 + 10_000 + 1_000;
/// What `SysTick` adds where no tick looks at the deadline.
const NO_TICK_US: u64 = 30_000;
/// The watchdog's latest reset of a halted core, which may be halted when the deadline ends.
const HALTED_US: u64 = 188_000;
/// A fault between two ticks is reported at once; the next tick stops the motors. And the look.
const REPORTED_US: u64 = 10_000 + 1_000;
/// Two frames at 40 Hz, milliseconds.
const PERIOD_MS: u32 = 25;
/// A wheel driven for this long during a fault shows it: the drive monitor takes up to 1.27 s.
const DRIVEN_MS: u32 = 1_300;
/// A slip that lasts longer is the gyroscope's fault.
const SLIP_MS: u32 = 2_000;
/// The drive monitor judges a wheel from this duty beyond its dead zone.
const DRIVEN_DUTY: f64 = 0.25;
/// From a fault's earliest begin to its end, milliseconds, and the time within which it begins.
const FAULT_MS: u32 = 2_400;
const BEGIN_MS: usize = 600;
/// A gyroscope that freezes in a turn leads the heading astray until that is noticed, and the position by some
/// millimetres.
const POSE_MM: f64 = 10.0;
/// From an EEPROM's fault to the end of a boot that may have read it before, µs.
const BOOT_US: u64 = 10_000;
/// A wheel below this speed stands, °/s: 14 mm/s.
const STILL_DEG_S: f64 = 20.0;
/// The controller's two lags of 80 ms and its ramp may overshoot a stop for so long, milliseconds.
const OVERSHOOT_MS: u32 = 300;

/// How a wheel has been driven.
#[derive(Clone, Copy, Default)]
struct Drive {
    /// The sign of its duty.
    direction: f64,
    /// For how long at least as hard as the drive monitor asks for, in this direction, and the longest.
    ms: u32,
    longest_ms: u32,
}

impl Drive {
    /// One look, a millisecond after the last.
    fn look(&mut self, duty: f64, judged: f64) {
        let on = duty * self.direction >= judged;
        self.ms = (self.ms + 1) * u32::from(on);
        self.direction = duty.signum();
        self.longest_ms = self.longest_ms.max(self.ms);
    }
}

/// What a trial has shown.
#[derive(Default)]
pub struct Seen {
    /// End of the last whole frame, µs.
    last_whole: Option<u64>,
    /// Since when reports say that the robot is stopped, µs.
    stopped_since: Option<u64>,
    report: Report,
    /// Every fault reported.
    faults: Faults,
    /// Since the latest fault began.
    drive: Sides<Drive>,
    backward_ms: u32,
    /// The longest from a last whole frame to the motors' end, µs.
    pub worst_stop_us: u64,
    pub findings: Vec<(&'static str, String)>,
}

/// One robot, from power-on to its recovery.
pub struct Trial {
    pub board: Board,
    pi: PiLink,
    random: Rng,
    /// What happens to them, each with the others.
    frames: Vec<Frames>,
    /// What happens each millisecond.
    each: Vec<fn(&Board, bool)>,
    replies: Replies,
    /// What was written to the EEPROM.
    image: Image,
    /// When its fault began, µs, and whether READY was high at the last look.
    began_us: u64,
    was_ready: bool,
    command: Command,
    /// The least duty at which the drive monitor judges a wheel.
    judged: Sides<f64>,
    /// How long the faults may turn a wheel against its command, milliseconds.
    may_turn_ms: u32,
    /// The latest end of the motors after the last whole frame, µs.
    stop_us: u64,
    /// Milliseconds to the next frame.
    until_frame: u32,
    pub seen: Seen,
}

impl Trial {
    pub fn new(elf: &[u8], seed: u64) -> Result<Self, Box<dyn Error>> {
        let image = Image::FIRST_BOARD.with(fields::MODE, Mode::GuardedVelocity.code().into());
        let image = image.with(fields::GYRO, 1);
        #[expect(clippy::cast_possible_truncation, reason = "the field has 16 bits")]
        let dead_zone = |field| f64::from(image.get(field) as u16) / 10_000.0;
        let judged = Sides::new(&fields::DEAD_ZONE_LEFT, &fields::DEAD_ZONE_RIGHT);
        let judged = judged.map(|field| dead_zone(field) + DRIVEN_DUTY);
        let config = Config::decode(&image).map_err(|error| format!("{error:?}"))?;
        let options = Options::with_eeprom(image.0.to_vec()).in_room(near_walls());
        let mut options = options.at(Pose2::default());
        options.seed = seed;
        let board = Board::new(elf, options)?;
        Ok(Self {
            replies: Replies::new(&board, config.clone()),
            board,
            each: Vec::new(),
            image,
            began_us: 0,
            was_ready: false,
            pi: PiLink::new(config.link_setup()),
            random: Rng::new(seed),
            frames: Vec::new(),
            command: Command::default(),
            judged,
            may_turn_ms: 0,
            stop_us: STOP_US,
            until_frame: 0,
            seen: Seen::default(),
        })
    }

    /// As far ahead as both wheels roll forward, in mm/s and degrees/s.
    fn ask(&mut self, forward: f64, yaw: f64) {
        self.command.velocity = velocity(forward, yaw);
    }

    /// Begins a fault, or ends it.
    fn set(&mut self, cause: Cause, on: bool) {
        match cause {
            Cause::Frames(frames) if on => self.frames.push(frames),
            Cause::Frames(_) => self.frames.clear(),
            Cause::Each(act) if on => self.each.push(act),
            of_board => {
                // All end together.
                self.each.retain(|_| on);
                of_board.set(&self.board, on);
            }
        }
    }

    /// Notes the first finding of a kind: what lasts is found in every millisecond.
    fn find(&mut self, kind: &'static str, what: impl std::fmt::Debug) {
        let mut known = self.seen.findings.iter();
        if !known.any(|(other, _)| *other == kind) {
            let at = self.board.now_us() / 1_000;
            let text = format!("{kind}: {what:?} at {at} ms");
            self.seen.findings.push((kind, text));
        }
    }

    /// One frame, as the fault leaves it.
    fn exchange(&mut self) {
        let disturbed = |how| self.frames.contains(&how);
        if disturbed(Frames::Silent) {
            return;
        }
        let mut frame = [0; MAX_FRAME];
        let len = self.pi.send(&self.command, &mut frame);
        let mut bytes = frame[..len].to_vec();
        if disturbed(Frames::Corrupt) {
            bytes[self.random.below(len)] ^= 1 << self.random.below(8);
        }
        if disturbed(Frames::Short) {
            bytes.truncate(1 + self.random.below(len - 1));
        }
        if disturbed(Frames::Long) {
            bytes.push(0);
        }
        let torn = disturbed(Frames::Torn);
        let count = if torn {
            1 + self.random.below(8 * len - 1)
        } else {
            8 * bytes.len()
        };
        let steps = selected(250, first_bits(&bytes, 8_000_000, count));
        let miso = pack(&self.board.spi_steps(steps.to_vec()));
        let now = self.board.now_us();
        if !torn && bytes == frame[..len] {
            self.seen.last_whole = Some(now);
        }
        let reply = miso.get(..len).map(|reply| self.pi.receive(reply));
        let Some(Ok(report)) = reply else { return };
        for (kind, lie) in self.replies.lies(&self.board, &report) {
            self.find(kind, lie);
        }
        self.seen.faults |= report.faults;
        let stopped = matches!(report.state, State::Stopped | State::Faulted);
        let resumed = self.command.order == Order::Resume;
        self.seen.stopped_since =
            (stopped && !resumed).then(|| self.seen.stopped_since.unwrap_or(now));
        self.seen.report = report;
    }

    /// Lets time pass, frames included, and looks every millisecond.
    fn run_ms(&mut self, ms: u32) {
        for _ in 0..ms {
            if self.until_frame == 0 {
                self.exchange();
                let flood = self.frames.contains(&Frames::Flood);
                self.until_frame = if flood { 1 } else { PERIOD_MS };
            }
            self.until_frame -= 1;
            for act in self.each.clone() {
                self.board.run_us(self.random.below(500) as u64);
                act(&self.board, true);
            }
            self.board.run_us(1_000 - self.board.now_us() % 1_000);
            self.look();
        }
    }

    fn look(&mut self) {
        let (truth, now) = (self.board.truth(), self.board.now_us());
        let (ready, pins) = self.board.stopped(|stopped| {
            let mcu = stopped.mcu();
            (mcu.is_ready(), mcu.board.world.cell_pins())
        });
        self.replies.look(pins);
        if ready && !self.was_ready && now > self.began_us + BOOT_US {
            let written = self.image.0;
            let differs = move |eeprom: &Eeprom| {
                eeprom.bytes()[..written.len()] != written || eeprom.weak.is_some_and(|weak| weak.1)
            };
            let differs = move |bus: &mut I2cBus, _| bus.eeprom.as_ref().is_some_and(differs);
            if self.board.i2c_bus(differs) {
                self.find("a configuration accepted that was not written", ());
            }
        }
        self.was_ready = ready;
        if truth.duty != Sides::default() {
            let silent = self.seen.last_whole.map(|at| now - at);
            if silent.is_none_or(|silent| silent > self.stop_us) {
                self.find("motors on after the last whole frame, µs", silent);
            } else {
                self.seen.worst_stop_us = self.seen.worst_stop_us.max(silent.unwrap_or(0));
            }
            let stopped = self.seen.stopped_since.map(|since| now - since);
            if stopped.is_some_and(|stopped| stopped > REPORTED_US) {
                self.find("motors on after the report of a stop, µs", stopped);
            }
        }
        let wheels = self.seen.drive.as_mut().zip(truth.duty.zip(self.judged));
        wheels.map(|(drive, (duty, judged))| drive.look(duty, judged));
        let wheels = truth.wheel_deg_s;
        let backward = wheels.left + wheels.right < -2.0 * STILL_DEG_S;
        self.seen.backward_ms = (self.seen.backward_ms + 1) * u32::from(backward);
        if self.seen.backward_ms > OVERSHOOT_MS + self.may_turn_ms {
            self.find("backward, °/s", wheels);
        }
    }

    /// From power-on through these faults to the end.
    pub fn run(&mut self, kinds: &[&Kind]) {
        if !self.board.run_until(200_000, 1_000, Board::is_ready) {
            self.find("not READY", ());
        }
        // The gyroscope's bias, then its verification in a turn.
        self.run_ms(1_200);
        self.ask(60.0, 20.0);
        self.run_ms(1_500);
        let [forward, yaw] = [75.0, 0.0].map(|middle| middle + self.random.within(15.0));
        self.ask(forward, yaw);
        self.run_ms(500);
        let may_turn = |kind: &&Kind| match (kind.1, kind.2) {
            // Until it is noticed a failed wheel or a lying gyroscope may turn the robot as it likes; against a
            // push it turns with all its power, and a stop meanwhile overshoots for longer.
            _ if lies_after_reset(kind) => SLIP_MS,
            (_, Sign::Driven(_)) => DRIVEN_MS,
            _ if kind.0 == "robot turned" => OVERSHOOT_MS,
            _ => 0,
        };
        self.may_turn_ms = kinds.iter().map(may_turn).max().unwrap_or(0);
        let later = |kind: &&Kind| match kind.0 {
            "no ticks" => NO_TICK_US,
            HALTED => HALTED_US,
            _ => 0,
        };
        self.stop_us += kinds.iter().map(later).max().unwrap_or(0);
        let named = |name| kinds.iter().any(|kind| kind.0 == name);
        self.replies.cells_unread = named("no conversions") || named("supply low");
        self.replies.lines_crossed = named("echo lines crossed");
        self.replies.clock_stops = named("no ticks");
        let mut begin = || u32::try_from(self.random.below(BEGIN_MS)).unwrap_or(0);
        let mut begins: Vec<_> = kinds.iter().map(|kind| (begin(), *kind)).collect();
        begins.sort_by_key(|(at, _)| *at);
        let mut passed = 0;
        for (at, kind) in begins {
            self.run_ms(at - passed);
            passed = at;
            self.board.run_us(self.random.below(1_000) as u64);
            self.set(kind.1, true);
            if kind.0 == "reset by pin" {
                // The Pi's own: a stop that was reported ends with it.
                self.seen.stopped_since = None;
            }
            if kind.0.starts_with("EEPROM") {
                self.began_us = self.board.now_us();
            }
            self.seen.drive = Sides::default();
        }
        self.run_ms(FAULT_MS - passed);
        let driven = self.seen.drive.map(|drive| drive.longest_ms >= DRIVEN_MS);
        for kind in kinds {
            self.set(kind.1, false);
        }
        self.recover();
        self.judge(kinds, driven);
    }

    /// Clears, resumes and drives.
    fn recover(&mut self) {
        self.ask(0.0, 0.0);
        self.run_ms(700);
        let wheels = self.board.truth().wheel_deg_s;
        if wheels.left.abs().max(wheels.right.abs()) > STILL_DEG_S {
            self.find("turning after zero was commanded, °/s", wheels);
        }
        // As the Pi does: a board that could not read its EEPROM stays unready until a reset.
        if self.seen.faults.intersects(Faults::BATTERY_CUTOFF) || !self.board.is_ready() {
            reset(&self.board);
            self.run_ms(200);
        }
        self.command.clear_faults = Faults::from_bits(u16::MAX);
        self.command.order = Order::Resume;
        self.run_ms(100);
        (self.command.clear_faults, self.command.order) = (Faults::NONE, Order::None);
        self.ask(70.0, 0.0);
        let before = self.board.truth().path_mm;
        self.run_ms(2_000);
        let way = self.board.truth().path_mm - before;
        if way < 60.0 {
            self.find("no recovery, mm", (way, self.seen.report));
        }
    }

    /// What was reported, and where the robot takes itself to be.
    fn judge(&mut self, kinds: &[&Kind], driven: Sides<bool>) {
        let log = String::from_utf8_lossy(&self.board.uart()).into_owned();
        let restarted = !self.board.resets().is_empty();
        for kind in kinds {
            let reported = match kind.2 {
                Sign::None => true,
                Sign::Latched(faults) => self.seen.faults.intersects(faults),
                Sign::Driven(faults) => {
                    let left = faults.intersects(Faults::LEFT_STALLED);
                    let driven = if left { driven.left } else { driven.right };
                    !driven || self.seen.faults.intersects(faults)
                }
                Sign::Log(line) => log.contains(line),
            };
            let other = |other: &&&Kind| other.0 != kind.0 && RESTARTING.contains(&other.0);
            let excused = kind.3 == After::Reset && kinds.iter().filter(other).count() > 0;
            let halted = kinds.iter().filter(other).any(|other| other.0 == HALTED);
            let hidden = restarted && lies_after_reset(kind)
                || kinds
                    .iter()
                    .any(|other| HIDDEN.contains(&(kind.0, other.0)));
            if !(reported || excused || hidden || halted) {
                self.find("unreported", kind.0);
            }
        }
        let pose = self.board.truth().pose;
        let [x, y] =
            [self.seen.report.pose.x, self.seen.report.pose.y].map(|um| f64::from(um) / 1000.0);
        let error = (pose.x_mm - x).hypot(pose.y_mm - y);
        if !restarted && error > POSE_MM && !kinds.iter().any(|kind| kind.3 == After::Pose) {
            self.find("the pose is wrong by mm", error);
        }
        let unmodelled = self.board.unmodelled();
        if !unmodelled.is_empty() {
            self.find("a rule of the part is broken", unmodelled);
        }
    }
}
