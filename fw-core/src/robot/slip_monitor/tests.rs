//! The robot with and without its gyroscope, beside each other.

use super::super::tests::{Bench, clearing};
use super::*;
use crate::eeprom::fields;
use crate::log::tests::transmitted;
use crate::types::Millimetres;
use crate::wire::{Command, Mode, State};
use std::string::String;

extern crate std;

/// A robot whose wheels are turned by hand, and a part that answers.
struct Turned {
    bench: Bench,
    outcome: BusResult,
    logged: String,
    noise: u8,
    frozen: bool,
    /// What every request comes to, unless [`BusResult::Done`].
    failure: BusResult,
    registers: [u8; 128],
}

impl Turned {
    fn new(mode: Mode) -> Self {
        Self {
            bench: Bench::with(mode, &[(fields::GYRO, 1)]),
            outcome: BusResult::Done,
            logged: String::new(),
            noise: 0,
            frozen: false,
            failure: BusResult::Done,
            registers: [0; 128],
        }
    }

    /// At rest until the bias is known.
    fn rested(mode: Mode) -> Self {
        let mut robot = Self::new(mode);
        robot.ticks(200, 0, 0, 0);
        robot
    }

    /// With a gyroscope that has agreed with the wheels over 30°.
    fn trusted() -> Self {
        let mut robot = Self::rested(Mode::GuardedNormal);
        robot.ticks(50, SPIN, -10, 10);
        robot
    }

    /// A tick in which the robot turns at `rate` (least significant bits) and its wheels say `counts`
    /// forward each way. The order that came of it.
    fn tick(&mut self, rate: i16, left: i32, right: i16) -> BusRequest {
        let order = self.bench.robot.on_gyro(self.outcome, &mut self.bench.log);
        self.bench.roll(left, right);
        let _ = self.bench.tick();
        self.logged += &transmitted(&mut self.bench.log);
        self.noise = (self.noise + u8::from(!self.frozen) * 3) % 7;
        self.outcome = match order {
            BusRequest::Idle | BusRequest::DriveLines { .. } | BusRequest::ReleaseLines => {
                BusResult::Done
            }
            _ if self.failure != BusResult::Done => self.failure,
            BusRequest::Write { register, value } => {
                self.registers[usize::from(register)] = value;
                BusResult::Done
            }
            BusRequest::Read { register: 0x75, .. } => BusResult::Bytes([0x68, 0]),
            BusRequest::Read { register: 0x1A, .. } => {
                BusResult::Bytes([self.registers[0x1A], self.registers[0x1B]])
            }
            BusRequest::Read { .. } => {
                BusResult::Bytes((rate + 77 + i16::from(self.noise)).to_be_bytes())
            }
        };
        order
    }

    fn ticks(&mut self, ticks: u32, rate: i16, left: i32, right: i16) {
        for _ in 0..ticks {
            self.tick(rate, left, right);
        }
    }

    fn faults(&self) -> Faults {
        self.bench.robot.faults() & (Faults::SLIP | Faults::GYRO_LOST)
    }

    fn heading_deg(&self) -> f64 {
        degrees(self.bench.robot.pose().heading.0.cast_signed())
    }

    /// The gyroscope's angle in the next reply.
    fn angle(&mut self) -> Option<i32> {
        self.bench.frame(&Command::default()).gyro.angle()
    }
}

fn degrees(turn: i32) -> f64 {
    f64::from(turn) / 4_294_967_296.0 * 360.0
}

/// 40 counts a tick each way turn the first board by 2.4° a tick, which is too fast; 10 by 0.6°.
const SPIN: i16 = 3_931;

// Requirement: WIRE-fault-12
#[test]
fn slip_latches_fault_and_keeps_heading() {
    let mut robot = Turned::trusted();
    robot.ticks(10, 0, 0, 0);
    let before = robot.heading_deg();
    assert!((before - 30.0).abs() < 0.1, "{before}");
    assert_eq!(robot.faults(), Faults::NONE);
    // Straight on by the wheels, and the robot turns by 60°.
    robot.ticks(100, SPIN, 20, 20);
    robot.ticks(30, 0, 20, 20);
    let turned = robot.heading_deg() - before;
    assert!((turned - 60.0).abs() < 0.5, "{turned}");
    assert_eq!(robot.faults(), Faults::SLIP);
    assert_ne!(robot.bench.robot.state(), State::Faulted);
}

#[test]
fn pose_without_slip_is_the_encoders() {
    let mut with = Turned::new(Mode::GuardedNormal);
    let mut without = Bench::with(Mode::GuardedNormal, &[]);
    let ways = [
        (0, 0, 0),
        (SPIN, -10, 10),
        (0, 30, 30),
        (-SPIN / 2, 15, 5),
        (0, 0, 0),
    ];
    for tick in 0..2_000_usize {
        let (rate, left, right) = ways[tick / 200 % ways.len()];
        // Up to 5 % off.
        with.tick(rate + rate / 20, left, right);
        without.roll(left, right);
        let _ = without.tick();
        assert_eq!(with.bench.robot.pose(), without.robot.pose());
    }
    assert_eq!(with.bench.robot.faults(), without.robot.faults());
}

// Requirement: WIRE-fault-13
#[test]
fn absent_gyro_is_fault_until_it_agrees_again() {
    let mut robot = Turned::new(Mode::GuardedNormal);
    robot.failure = BusResult::Nack;
    robot.ticks(100, 0, 0, 0);
    assert_eq!(robot.faults(), Faults::GYRO_LOST);
    let clear = clearing(Faults::ALL_BITS, Command::default());
    robot.bench.frame(&clear);
    robot.tick(0, 0, 0);
    assert_eq!(robot.faults(), Faults::GYRO_LOST, "still");
    robot.failure = BusResult::Done;
    robot.ticks(1_500, 0, 0, 0);
    robot.ticks(50, SPIN, -10, 10);
    robot.bench.frame(&clear);
    robot.tick(0, 0, 0);
    assert_eq!(robot.faults(), Faults::NONE);
}

// Requirement: WIRE-fault-13
#[test]
fn contradicting_gyro_is_fault_but_not_slip_end() {
    let mut robot = Turned::rested(Mode::GuardedNormal);
    robot.ticks(100, SPIN, -10, 10);
    // Held for 2 s with turning wheels.
    robot.ticks(190, 0, -10, 10);
    assert_eq!(robot.faults(), Faults::SLIP);
    robot.ticks(30, 0, -10, 10);
    assert_eq!(robot.faults(), Faults::SLIP | Faults::GYRO_LOST);
    let mut upside_down = Turned::rested(Mode::GuardedNormal);
    // Three verifications of 10° by the wheels.
    upside_down.ticks(40, -SPIN, -10, 10);
    assert_eq!(upside_down.faults(), Faults::NONE);
    upside_down.ticks(20, -SPIN, -10, 10);
    assert_eq!(upside_down.faults(), Faults::GYRO_LOST);
}

#[test]
fn turn_either_way_makes_the_gyro_trusted() {
    for way in [1, -1] {
        let mut robot = Turned::rested(Mode::GuardedNormal);
        robot.ticks(50, SPIN * way, -10 * i32::from(way), 10 * way);
        let agrees = robot.logged.contains("gyro: agrees with the wheels\n");
        assert!(agrees, "{way}: {}", robot.logged);
    }
}

// Requirement: WIRE-fault-13
#[test]
fn frozen_gyro_takes_its_correction_back() {
    // Words repeated before one that changed are confirmed by it.
    for confirmed in [0, 10] {
        let mut robot = Turned::trusted();
        robot.frozen = true;
        robot.ticks(confirmed, SPIN, 0, 0);
        robot.frozen = false;
        robot.ticks(confirmed, SPIN, 0, 0);
        robot.frozen = true;
        robot.tick(SPIN, 0, 0);
        let before = robot.heading_deg();
        robot.ticks(14, SPIN, 0, 0);
        assert!(robot.heading_deg() - before > 5.0, "a slip so far");
        robot.ticks(15, SPIN, 0, 0);
        assert_eq!(robot.faults(), Faults::SLIP | Faults::GYRO_LOST);
        assert!((robot.heading_deg() - before).abs() < 0.1);
    }
}

#[test]
fn absent_gyro_keeps_its_correction() {
    let mut robot = Turned::trusted();
    robot.ticks(10, SPIN, 0, 0);
    robot.frozen = true;
    robot.ticks(5, SPIN, 0, 0);
    let before = robot.heading_deg();
    robot.failure = BusResult::Nack;
    robot.ticks(10, SPIN, 0, 0);
    assert_eq!(robot.faults(), Faults::SLIP | Faults::GYRO_LOST);
    assert!(robot.heading_deg() >= before);
}

/// The heading takes the whole window, the controllers one tick.
#[test]
fn slip_start_turns_the_controllers_by_one_tick() {
    let mut robot = Turned::trusted();
    let before = robot.heading_deg();
    let started = (0..20).any(|_| {
        robot.tick(SPIN, 0, 0);
        !robot.faults().is_empty()
    });
    assert!(started && robot.heading_deg() - before > 2.0);
    let turn = degrees(robot.bench.robot.delta.turn);
    assert!((turn - 0.6).abs() < 0.05, "{turn}");
}

// Requirement: WIRE-obstacle-2
#[test]
fn turn_by_hand_voids_the_echo() {
    let mut robot = Turned::trusted();
    let limit = |robot: &Turned| robot.bench.robot.obstacle.max_forward();
    let blind = limit(&robot);
    let near = Some(Millimetres::default());
    robot.bench.robot.obstacle.on_range(0, near);
    robot.tick(0, 0, 0);
    assert!(blind > 0 && limit(&robot) == 0);
    // 2.4° a tick.
    robot.ticks(10, 4 * SPIN, 0, 0);
    assert_eq!(limit(&robot), blind);
}

/// Its bias and its trust go with it, and a slip ends.
#[test]
fn gyro_lost_during_slip_restarts_without_bias() {
    let mut robot = Turned::trusted();
    robot.ticks(20, 0, -10, 10);
    robot.failure = BusResult::Nack;
    robot.ticks(10, 0, 0, 0);
    // Whatever the gyroscope corrected is in doubt with it.
    for (text, count) in [
        ("slip: heading by the gyro\n", 1),
        ("slip over", 0),
        (": gyro: no answer at 0x68, encoders alone\n", 1),
    ] {
        let logged = robot.logged.matches(text).count();
        assert_eq!(logged, count, "{}", robot.logged);
    }
    assert_eq!(robot.bench.robot.slip_monitor.angle(), None);
}

// Requirement: WIRE-platform-7
#[test]
fn gyro_not_configured_or_tuning_is_idle() {
    let mut tuning = Turned::new(Mode::GuardedTuneRotate);
    let mut plain = Turned::new(Mode::GuardedNormal);
    plain.bench = Bench::with(Mode::GuardedNormal, &[]);
    for _ in 0..500 {
        assert_eq!(tuning.tick(0, 0, 0), BusRequest::Idle);
        assert_eq!(plain.tick(0, 0, 0), BusRequest::Idle);
    }
    assert!(plain.bench.robot.faults().is_empty());
}

#[test]
fn gyro_event_is_one_line_of_its_level() {
    let bias = |rate| std::format!("I00000: gyro: bias {rate} deg/s\n");
    let ended = |turn| std::format!("I00000: slip over: heading corrected by {turn} deg\n");
    let alone = |cause| std::format!("W00000: gyro: {cause}, encoders alone\n");
    for (event, line) in [
        (Event::BiasUpdated(0), &*bias("0.00")),
        (Event::BiasUpdated(-16_768), &bias("-1.00")),
        (Event::Trusted, "I00000: gyro: agrees with the wheels\n"),
        (Event::SlipStarted, "W00000: slip: heading by the gyro\n"),
        (Event::SlipEnded(1 << 30), &ended("90.00")),
        (Event::SlipEnded(-(1 << 29)), &ended("-45.00")),
        (Event::SlipEnded(5 << 32), &ended("1800.00")),
        (Event::SlipTimedOut, &alone("slip timed out")),
        (Event::Mismatch, &alone("contradicts the wheels")),
    ] {
        let mut log = Log::new();
        log_event(event, &mut log);
        assert_eq!(transmitted(&mut log), line);
    }
}

// Requirement: WIRE-gyro-3
#[test]
fn reply_carries_the_gyros_angle() {
    let mut robot = Turned::new(Mode::GuardedVelocity);
    robot.tick(0, 0, 0);
    assert_eq!(robot.angle(), None);
    robot.ticks(200, 0, 0, 0);
    let before = robot.angle().expect("an angle after the rest");
    robot.ticks(50, SPIN, -10, 10);
    let turned = robot.angle().expect("an angle") - before;
    // 30°, 2⁻²⁴ turns.
    let expected = (1 << 24) / 12;
    assert!((turned - expected).abs() < expected / 20, "{turned}");
    for failure in [BusResult::Nack, BusResult::Timeout, BusResult::Done] {
        (robot.failure, robot.frozen) = (failure, failure == BusResult::Done);
        robot.ticks(if robot.frozen { 50 } else { 10 }, 0, 0, 0);
        assert_eq!(robot.angle(), None, "{failure:?}");
        (robot.failure, robot.frozen) = (BusResult::Done, false);
        robot.ticks(1_000, 0, 0, 0);
        let again = robot.angle().expect("an angle again");
        assert!(again.abs() < expected / 20, "{again}");
    }
}

// Requirement: WIRE-gyro-2
#[test]
fn angle_goes_on_through_missing_readings() {
    let mut robot = Turned::rested(Mode::GuardedVelocity);
    robot.ticks(5, SPIN, -10, 10);
    let mut turned = |failure| {
        let before = robot.angle().expect("an angle");
        for tick in 0..10 {
            robot.failure = if tick < 3 { failure } else { BusResult::Done };
            robot.tick(SPIN, -10, 10);
        }
        robot.angle().expect("an angle") - before
    };
    let (read, missed) = (turned(BusResult::Done), turned(BusResult::Nack));
    assert!((read - missed).abs() < read / 100, "{read} {missed}");
}

// Requirement: WIRE-platform-7
#[test]
fn gyro_is_read_in_every_mode_that_drives() {
    for mode in [
        Mode::Normal,
        Mode::GuardedNormal,
        Mode::GuardedSweep,
        Mode::GuardedVelocity,
    ] {
        let mut robot = Turned::new(mode);
        assert!((0..20).any(|_| robot.tick(0, 0, 0) != BusRequest::Idle));
    }
}

#[test]
fn correction_beyond_its_type_keeps_its_sign_in_the_log() {
    let mut log = Log::new();
    log_event(Event::SlipEnded(1 << 61), &mut log);
    let text = transmitted(&mut log);
    let is_positive = text.contains("corrected by ") && !text.contains('-');
    assert!(is_positive, "{text}");
}
