//! The robot from outside: frames in, duties and replies out.

use super::*;
use crate::binary64::Binary64;
use crate::eeprom::{Field, config_with, fields, first_board};
use crate::types::{MotorCommand, RangefinderId};
use crate::wire::{DistanceCode, MAX_FRAME, PiLink};

mod driving;
mod events;
mod platform;
mod renewal;
mod sweeping;
mod tuning;
mod velocity;

const TICK_US: u32 = 10_000;

pub(super) struct Bench {
    pub(super) robot: Robot,
    pi: PiLink,
    /// Number of the last reply.
    reply: u32,
    pub(super) log: Log,
    pub(super) sample: TickInput,
    /// The ADC words of the two taps; some 3.6 V a cell.
    words: [u16; 2],
}

impl Bench {
    fn new(mode: Mode) -> Self {
        Self::with(mode, &[])
    }

    pub(super) fn with(mode: Mode, changes: &[(&Field, u64)]) -> Self {
        let basis = [
            (fields::MODE, mode.code().into()),
            (fields::SERVO, (mode == Mode::GuardedSweep).into()),
        ];
        let config = config_with(&[&basis, changes].concat());
        let sample = TickInput {
            now: Micros(u32::MAX - 5 * TICK_US),
            left: 7,
            right: 65_530,
            supply_low: false,
        };
        Self {
            robot: Robot::new(&config, sample),
            pi: PiLink::new(config.link_setup()),
            reply: 0,
            log: Log::new(),
            sample,
            words: [3428, 3574],
        }
    }

    pub(super) fn tick(&mut self) -> TickOutput {
        self.sample.now = self.sample.now.after(TICK_US);
        self.robot.on_tick(self.sample, &self.words, &mut self.log)
    }

    fn ticks(&mut self, ticks: u32) {
        for _ in 0..ticks {
            self.tick();
        }
    }

    /// A frame, then a tick.
    fn drive(&mut self, command: &Command) -> TickOutput {
        self.frame(command);
        self.tick()
    }

    /// Rolls the wheels forward by so many counts: the first board's encoders count down then.
    pub(super) fn roll(&mut self, left: i32, right: i16) {
        self.sample.left = self.sample.left.wrapping_add_signed(-left);
        self.sample.right = self.sample.right.wrapping_add_signed(-right);
    }

    /// The echo of the sensor that was triggered in the last tick.
    fn echo(&mut self, which: RangefinderId, width_us: u32) {
        let rise = self.sample.now.after(500);
        self.robot.on_echo(which, rise, rise.after(width_us));
    }

    fn raise(&mut self, faults: Faults) {
        self.robot.raise(faults, &mut self.log);
    }

    pub(super) fn frame(&mut self, command: &Command) -> Report {
        let mut reply = [0; MAX_FRAME];
        self.reply += 1;
        let len = self.robot.encode_reply(self.reply, &mut reply);
        let mut frame = [0; MAX_FRAME];
        let sent = self.pi.send(command, &mut frame);
        self.receive(&frame[..sent], 0);
        self.pi.receive(&reply[..len]).expect("a valid reply")
    }

    fn receive(&mut self, bytes: &[u8], overflow_len: usize) {
        let frame = ReceivedFrame {
            bytes,
            overflow_len,
            at: self.sample.now,
            reply: self.reply + 1,
        };
        if let Ok(command) = self.robot.receive(&frame) {
            self.robot.execute(&command, frame.at, &mut self.log);
        }
    }

    pub(super) fn log(&self) -> &str {
        core::str::from_utf8(self.log.pending()).expect("ASCII")
    }
}

fn go(x_mm: i32) -> Command {
    Command {
        expected: PoseCode {
            x: x_mm * 1000,
            ..PoseCode::default()
        },
        apply: true,
        ..Command::default()
    }
}

/// A percentage to set on the engines, in a tuning mode.
fn tune(percent: f64) -> Command {
    let percent = Binary64(percent.to_bits());
    Command {
        percent,
        ..Command::default()
    }
}

fn with_order(order: Order, command: Command) -> Command {
    Command { order, ..command }
}

pub(super) fn clearing(clear_faults: Faults, command: Command) -> Command {
    Command {
        clear_faults,
        ..command
    }
}

fn run(hundredths: i32) -> MotorCommand {
    MotorCommand::Run(Duty::saturating(hundredths))
}

const COAST: [MotorCommand; 2] = [MotorCommand::Coast; 2];
const BRAKE: [MotorCommand; 2] = [MotorCommand::Brake; 2];

/// The commands of both motors, left first.
fn motors(outputs: TickOutput) -> [MotorCommand; 2] {
    [outputs.left, outputs.right]
}

/// A motor's duty in hundredths of a percent; 0 for one that is not driven.
fn duty(command: MotorCommand) -> i16 {
    match command {
        MotorCommand::Run(duty) => duty.hundredths(),
        MotorCommand::Brake | MotorCommand::Coast => 0,
    }
}

fn runs(outputs: TickOutput) -> bool {
    let is_run = |command| matches!(command, MotorCommand::Run(_));
    motors(outputs).into_iter().all(is_run)
}

#[test]
fn robot_without_frame_coasts() {
    let mut bench = Bench::new(Mode::Normal);
    for _ in 0..1000 {
        assert_eq!(motors(bench.tick()), COAST);
    }
    assert_eq!(bench.robot.state(), State::Ready);
}

// Requirement: DOC-5.1.1-4
#[test]
fn target_without_apply_is_not_driven() {
    let mut bench = Bench::new(Mode::Normal);
    let apply = false;
    for _ in 0..10 {
        let outputs = bench.drive(&Command { apply, ..go(1000) });
        assert_eq!(outputs.left, MotorCommand::Coast);
    }
}

// Requirement: DOC-2.1-2
#[test]
fn applied_target_drives_until_silence_brakes() {
    let mut bench = Bench::new(Mode::Normal);
    bench.frame(&go(1000));
    let mut ticks = 0;
    let last = loop {
        let outputs = bench.tick();
        ticks += 1;
        if !runs(outputs) {
            break outputs;
        }
        assert_eq!(bench.robot.state(), State::Moving);
        assert!(ticks <= 25, "still driving after the deadline");
    };
    assert_eq!(ticks, 25, "250 ms");
    assert_eq!(motors(last), BRAKE);
    assert_eq!(bench.robot.state(), State::Stopped);
    // No reply has carried that state yet.
    assert_eq!(last.leds, leds(State::Stopped));
    let log = bench.log();
    assert!(log.contains("stopped: no fresh frame"));
    assert!(log.contains(": target 1000.000 0.000 mm, 0.00 deg\n"));
    let outputs = bench.drive(&go(1000));
    assert!(runs(outputs), "resumes, even to the same target");
}

// Requirement: WIRE-fault-2, WIRE-rejected-4
#[test]
fn rejected_frame_does_not_feed_stop_deadline() {
    let mut bench = Bench::new(Mode::Normal);
    bench.frame(&go(1000));
    let mut frame = [0; MAX_FRAME];
    let len = bench.pi.send(&go(-1000), &mut frame);
    for ticks in 1.. {
        for (bytes, overflow_len) in [(len - 1, 0), (len, 1)] {
            bench.receive(&frame[..bytes], overflow_len);
        }
        frame[0] ^= 0xFF;
        bench.receive(&frame[..len], 0);
        frame[0] ^= 0xFF;
        if !runs(bench.tick()) {
            assert_eq!(ticks, 25);
            break;
        }
    }
    assert_eq!(bench.robot.counters().accepted, 1);
    assert_eq!(bench.robot.counters().rejected_total(), 75);
    assert!(bench.robot.faults().intersects(Faults::FRAME_REJECTED));
    assert!(bench.log().contains("frame rejected: "));
}

// Requirement: DOC-5.2.1-2, DOC-5.2.2-4, DOC-5.2.3-3, DOC-2.3-5
#[test]
fn replies_carry_pose_and_cells_in_turn() {
    for mode in [Mode::Normal, Mode::TuneRotate, Mode::TuneMove] {
        let mut bench = Bench::new(mode);
        bench.roll(1000, 1000);
        bench.tick();
        let first = bench.frame(&Command::default());
        if mode == Mode::Normal {
            // 1000 counts of 80 mm · π / 3840.
            let PoseCode { x, y, rotation } = first.pose;
            assert_eq!((x, y, rotation), (65_450, 0, 0));
            assert_eq!(first.ranges, [DistanceCode::NONE; 3]);
        }
        let second = bench.frame(&Command::default());
        assert_eq!(bench.frame(&Command::default()).cell.cell, 0);
        // 3428 / 4095 · 3.3 V · 43/33 = 3.5996 V; 3574 / 4095 · 3.3 V · 55/22 = 7.2004 V; steps of 5 mV.
        let cells = [first.cell, second.cell].map(|c| (c.cell, c.voltage));
        assert_eq!(cells, [(0, 720), (1, 720)]);
    }
}

// Requirement: WIRE-spi-6, WIRE-sequence-5, WIRE-battery-1, WIRE-ready-2
#[test]
fn reply_depends_on_its_number_and_newest_data_only() {
    let mut bench = Bench::new(Mode::GuardedNormal);
    let encoded = |robot: &mut Robot, number| {
        let mut out = [0; MAX_FRAME];
        robot.encode_reply(number, &mut out);
        out
    };
    let first = encoded(&mut bench.robot, 1);
    for number in [2, 1, 5, 258, u32::MAX, 0, 1] {
        let reply = encoded(&mut bench.robot, number);
        assert_eq!(u32::from(reply[1]), number & 0xFF);
        assert_eq!(u32::from(reply[16] >> 5), number.wrapping_sub(1) % 2);
    }
    assert_eq!(encoded(&mut bench.robot, 1), first);
    bench.roll(100, 0);
    bench.tick();
    let fresher = encoded(&mut bench.robot, 1);
    assert_eq!((fresher[1], fresher[16] >> 5), (1, 0));
    assert_ne!(fresher[6..16], first[6..16]);
}

// Requirement: WIRE-spi-6
#[test]
fn refreshed_reply_keeps_what_the_transmitter_may_have_fetched() {
    let guarded = |mode: &&Mode| mode.has(crate::wire::Field::Status);
    for &mode in Mode::ALL.iter().filter(guarded) {
        let mut bench = Bench::new(mode);
        let (mut first, mut fresher, mut refreshed) = ([0; 32], [0; 32], [0; 32]);
        let len = bench.robot.encode_reply(1, &mut first);
        bench.raise(Faults::SUPPLY_LOW);
        bench.tick();
        bench.robot.encode_reply(1, &mut fresher);
        assert_ne!(fresher[..6], first[..6]);
        let begin = *first.first_chunk().unwrap();
        bench.robot.refresh_reply(1, begin, &mut refreshed);
        assert!(refreshed.starts_with(&begin));
        let report = bench.pi.receive(&refreshed[..len]).expect("a valid reply");
        assert!(report.faults.is_empty());
    }
}

// Requirement: WIRE-status-2, WIRE-deadline-5
#[test]
fn guarded_stop_needs_resume_order() {
    let mut bench = Bench::new(Mode::GuardedNormal);
    let (stop, resume) = (Order::Stop, Order::Resume);
    assert!(runs(bench.drive(&go(1000))));
    assert_eq!(motors(bench.drive(&with_order(stop, go(1000)))), BRAKE);
    let outputs = bench.drive(&go(1000));
    assert_eq!(motors(outputs), BRAKE, "apply does not resume it");
    assert!(runs(bench.drive(&with_order(resume, go(1000)))));
    // A target that comes with the stop is the one to resume.
    let mut bench = Bench::new(Mode::GuardedNormal);
    assert_eq!(motors(bench.drive(&with_order(stop, go(1000)))), BRAKE);
    assert!(runs(bench.drive(&with_order(resume, Command::default()))));
}

// Requirement: DOC-5.2.2-2, WIRE-deadline-5, WIRE-log-7
#[test]
fn tuning_stop_needs_zero_percent() {
    let mut bench = Bench::new(Mode::TuneRotate);
    for _ in 0..2 {
        let outputs = bench.drive(&tune(50.0));
        assert_eq!(motors(outputs), [run(-5000), run(5000)]);
    }
    assert_eq!(bench.log().matches(": T 50.00 0.000\n").count(), 2);
    // What rounds to a duty of zero is zero.
    for zero in [0.0, -0.0, 0.004] {
        bench.ticks(30);
        assert_eq!(bench.robot.state(), State::Stopped);
        let outputs = bench.drive(&tune(50.0));
        assert_eq!(motors(outputs), BRAKE, "50 % does not end a stop");
        bench.frame(&tune(zero));
        assert!(runs(bench.drive(&tune(50.0))));
    }
}

#[test]
fn empty_battery_stops_robot() {
    let mut bench = Bench::new(Mode::Normal);
    bench.words = [100, 100];
    let mut last = COAST;
    for _ in 0..100 {
        last = motors(bench.drive(&go(1000)));
    }
    assert_eq!((last, bench.robot.state()), (BRAKE, State::Faulted));
    assert!(bench.log().contains("battery empty"));
}

#[test]
fn blocked_wheels_fault_within_a_second() {
    let mut bench = Bench::new(Mode::Normal);
    let faulted = (0..100).any(|tick| {
        if tick % 3 == 0 {
            bench.frame(&go(1000));
        }
        bench.tick();
        bench.robot.state() == State::Faulted
    });
    assert!(faulted, "it pushes on");
    assert_eq!(motors(bench.tick()), BRAKE);
    let stalled = Faults::LEFT_STALLED | Faults::RIGHT_STALLED;
    assert_eq!(bench.robot.supervisor.faults() & stalled, stalled);
}
