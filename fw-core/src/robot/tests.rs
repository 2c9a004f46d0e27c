//! The robot from outside: frames in, duties and replies out.

use super::*;
use crate::eeprom::{first_board, Platform};
use crate::types::{MotorCommand, RangefinderId};
use crate::wire::{DistanceCode, PiLink, MAX_FRAME};

mod driving;
mod events;
mod renewal;
mod sweeping;
mod tuning;

const TICK_US: u32 = 10_000;

pub(super) struct Bench {
    pub(super) robot: Robot,
    pi: PiLink,
    pub(super) log: Log,
    pub(super) sample: Sample,
}

impl Bench {
    fn new(mode: Mode) -> Self {
        Self::with(mode, |_| {})
    }

    pub(super) fn with(mode: Mode, change: impl FnOnce(&mut Platform)) -> Self {
        let mut config = first_board();
        config.mode = mode;
        change(&mut config.platform);
        let sample = Sample {
            now: Micros(u32::MAX - 5 * TICK_US),
            left: 7,
            right: 65_530,
        };
        Self {
            robot: Robot::new(&config, sample),
            pi: PiLink::new(Setup::from(&config)),
            log: Log::new(),
            sample,
        }
    }

    pub(super) fn tick(&mut self) -> Outputs {
        self.sample.now = self.sample.now.after(TICK_US);
        self.robot
            .on_tick(self.sample, &[3428, 3574], &mut self.log)
    }

    pub(super) fn frame(&mut self, command: &Command) -> Report {
        let mut reply = [0; MAX_FRAME];
        let len = self.robot.next_reply(&mut reply);
        let mut frame = [0; MAX_FRAME];
        let sent = self.pi.send(command, &mut frame);
        self.robot
            .on_frame(&frame[..sent], sent, self.sample.now, &mut self.log);
        self.pi.receive(&reply[..len]).expect("a valid reply")
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

fn runs(outputs: &Outputs) -> bool {
    matches!(
        (outputs.left, outputs.right),
        (MotorCommand::Run(_), MotorCommand::Run(_))
    )
}

// Requirement: WIRE-deadline-3
#[test]
fn without_a_frame_nothing_moves() {
    let mut bench = Bench::new(Mode::Normal);
    for _ in 0..1000 {
        let outputs = bench.tick();
        assert_eq!(
            (outputs.left, outputs.right),
            (MotorCommand::Coast, MotorCommand::Coast)
        );
    }
    assert_eq!(bench.robot.state(), State::Ready);
}

// Requirement: DOC-5.1.1-4
#[test]
fn a_target_without_the_apply_bit_is_not_driven_to() {
    let mut bench = Bench::new(Mode::Normal);
    for _ in 0..10 {
        bench.frame(&Command {
            apply: false,
            ..go(1000)
        });
        assert_eq!(bench.tick().left, MotorCommand::Coast);
    }
}

#[test]
fn an_applied_target_drives_and_silence_brakes_within_the_deadline() {
    let mut bench = Bench::new(Mode::Normal);
    bench.frame(&go(1000));
    let mut ticks = 0;
    let last = loop {
        let outputs = bench.tick();
        ticks += 1;
        if !runs(&outputs) {
            break outputs;
        }
        assert_eq!(bench.robot.state(), State::Moving);
        assert!(ticks <= 25, "still driving after the deadline");
    };
    assert_eq!(ticks, 25, "250 ms");
    assert_eq!(
        (last.left, last.right),
        (MotorCommand::Brake, MotorCommand::Brake)
    );
    assert_eq!(bench.robot.state(), State::Stopped);
    assert!(bench.log().contains("stopped: no fresh frame"));
    bench.frame(&go(1000));
    assert!(
        runs(&bench.tick()),
        "apply resumes, even to the same target"
    );
}

// Requirement: WIRE-fault-2, WIRE-rejected-4
#[test]
fn a_rejected_frame_changes_nothing_but_the_counters_and_does_not_feed_the_deadline() {
    let mut bench = Bench::new(Mode::Normal);
    bench.frame(&go(1000));
    let mut frame = [0; MAX_FRAME];
    let len = bench.pi.send(&go(-1000), &mut frame);
    for ticks in 1.. {
        for (bytes, clocked) in [(len - 1, len - 1), (len, len + 1)] {
            bench
                .robot
                .on_frame(&frame[..bytes], clocked, bench.sample.now, &mut bench.log);
        }
        frame[0] ^= 0xFF;
        bench
            .robot
            .on_frame(&frame[..len], len, bench.sample.now, &mut bench.log);
        frame[0] ^= 0xFF;
        if !runs(&bench.tick()) {
            assert_eq!(ticks, 25);
            break;
        }
    }
    assert_eq!(bench.robot.counters().accepted, 1);
    assert_eq!(bench.robot.counters().rejected_total(), 75);
    assert!(bench.robot.faults().intersects(Faults::FRAME_REJECTED));
    assert!(bench.log().contains("frame rejected: "));
}

#[test]
fn replies_carry_the_pose_and_walk_the_cells() {
    let mut bench = Bench::new(Mode::Normal);
    // Both wheels roll forward by 1000 counts: the first board's encoders count down.
    bench.sample.left = bench.sample.left.wrapping_sub(1000);
    bench.sample.right = bench.sample.right.wrapping_sub(1000);
    bench.tick();
    let first = bench.frame(&Command::default());
    // 1000 counts of 80 mm · π / 3840.
    assert_eq!(
        (first.pose.x, first.pose.y, first.pose.rotation),
        (65_450, 0, 0)
    );
    let second = bench.frame(&Command::default());
    assert_eq!(bench.frame(&Command::default()).cell.cell, 0);
    // 3428 / 4095 · 3.3 V · 43/33 = 3.5996 V; 3574 / 4095 · 3.3 V · 55/22 = 7.2004 V; steps of 5 mV.
    assert_eq!(
        [first.cell, second.cell].map(|c| (c.cell, c.voltage)),
        [(0, 720), (1, 720)]
    );
    assert_eq!(first.ranges, [DistanceCode::NONE; 3]);
}

#[test]
fn the_following_reply_is_the_next_one_in_advance() {
    for mode in Mode::ALL {
        let mut bench = Bench::new(*mode);
        let (mut ahead, mut next) = ([0; MAX_FRAME], [0; MAX_FRAME]);
        for _ in 0..3 {
            let len = bench.robot.following_reply(&mut ahead);
            assert_eq!(bench.robot.next_reply(&mut next), len);
            assert_eq!(ahead, next);
        }
    }
}

// Requirement: WIRE-spi-6, WIRE-sequence-5
#[test]
fn a_refreshed_reply_keeps_its_number_and_its_cell() {
    let mut bench = Bench::new(Mode::GuardedNormal);
    let (mut first, mut second) = ([0; MAX_FRAME], [0; MAX_FRAME]);
    bench.robot.next_reply(&mut first);
    bench.sample.left = bench.sample.left.wrapping_sub(1000);
    bench.tick();
    bench.robot.refresh_reply(&mut second);
    let mut pi = PiLink::new(Setup {
        mode: Mode::GuardedNormal,
        ..Setup::from(&first_board())
    });
    let old = pi.receive(&first).expect("a valid reply");
    assert!(
        pi.receive(&second).is_err(),
        "the same number again is stale"
    );
    let mut pi = PiLink::new(Setup {
        mode: Mode::GuardedNormal,
        ..Setup::from(&first_board())
    });
    let new = pi.receive(&second).expect("a valid reply");
    assert_eq!(old.cell.cell, new.cell.cell);
    assert_ne!(old.pose, new.pose);
}

// Requirement: WIRE-status-2, WIRE-deadline-5
#[test]
fn guarded_stop_and_resume_are_orders() {
    let mut bench = Bench::new(Mode::GuardedNormal);
    bench.frame(&go(1000));
    assert!(runs(&bench.tick()));
    bench.frame(&Command {
        order: crate::wire::Order::Stop,
        ..go(1000)
    });
    assert_eq!(bench.tick().left, MotorCommand::Brake);
    bench.frame(&go(1000));
    assert_eq!(
        bench.tick().left,
        MotorCommand::Brake,
        "apply does not resume a guarded robot"
    );
    bench.frame(&Command {
        order: crate::wire::Order::Resume,
        ..go(1000)
    });
    assert!(runs(&bench.tick()));
}

// Requirement: DOC-5.2.2-2, WIRE-deadline-5, WIRE-log-7
#[test]
fn tuning_sets_the_constant_duty_logs_every_sample_and_needs_zero_after_a_stop() {
    let mut bench = Bench::new(Mode::TuneRotate);
    let fifty = Command {
        percent: Binary64(50.0_f64.to_bits()),
        ..Command::default()
    };
    bench.frame(&fifty);
    assert_eq!(
        bench.tick().right,
        MotorCommand::Run(Duty::saturating(5000))
    );
    assert_eq!(
        bench.tick().left,
        MotorCommand::Run(Duty::saturating(-5000))
    );
    assert_eq!(bench.log().matches(": T 50.00 0.000\n").count(), 2);
    for _ in 0..30 {
        bench.tick();
    }
    assert_eq!(bench.robot.state(), State::Stopped);
    bench.frame(&fifty);
    assert_eq!(
        bench.tick().left,
        MotorCommand::Brake,
        "50 % does not end a stop"
    );
    bench.frame(&Command::default());
    bench.frame(&fifty);
    assert!(runs(&bench.tick()));
}

#[test]
fn an_empty_battery_stops_the_robot_for_good() {
    let mut bench = Bench::new(Mode::Normal);
    let mut last = MotorCommand::Coast;
    for _ in 0..100 {
        bench.frame(&go(1000));
        bench.sample.now = bench.sample.now.after(TICK_US);
        last = bench
            .robot
            .on_tick(bench.sample, &[100, 100], &mut bench.log)
            .left;
    }
    assert_eq!(
        (last, bench.robot.state()),
        (MotorCommand::Brake, State::Faulted)
    );
    assert!(bench.log().contains("battery empty"));
}

#[test]
fn wheels_that_do_not_turn_stop_the_robot_within_a_second_and_name_the_fault() {
    let mut bench = Bench::new(Mode::Normal);
    let mut ticks = 0;
    while bench.robot.state() != State::Faulted {
        assert!(ticks < 100, "it pushes on");
        if ticks % 3 == 0 {
            bench.frame(&go(1000));
        }
        bench.tick();
        ticks += 1;
    }
    let outputs = bench.tick();
    assert_eq!(
        (outputs.left, outputs.right),
        (MotorCommand::Brake, MotorCommand::Brake)
    );
    let stalled = Faults::LEFT_STALLED | Faults::RIGHT_STALLED;
    assert_eq!(bench.robot.supervisor.faults() & stalled, stalled);
}
