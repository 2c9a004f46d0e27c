//! T5, T8, T14 and T17 of the whole robot: any configuration that was accepted, any order of events.

mod rig;
pub mod target;

use fw_core::binary64::Binary64;
use fw_core::eeprom::fields::{BATTERY_CUTOFF, MODE};
use fw_core::log::Log;
use fw_core::robot::{ReceivedFrame, Robot, TickInput};
use fw_core::wire::{Command, MAX_FRAME, Mode, PiLink, State, frame_len};

use crate::eeprom::accepted::AcceptedConfig;
use crate::motion::drive_monitor;
use crate::property::Seen;
use fw_core::types::{Faults, Micros, MotorCommand, Pose};
pub use rig::Script;
use rig::{Events, Rig};

/// Any accepted configuration, any order of ticks, frames, echoes, temperatures, faults and pauses, a
/// gyroscope that answers or does not: nothing panics or overflows; the motors brake from the deadline on
/// and as long as a fault blocks them, never exceed their limits and never turn before a frame was taken;
/// the pose is the encoders' own until a slip is reported; a distance is one that sound can have gone;
/// every reply is one the Pi takes.
// Requirement: DOC-3.2-1, DOC-4.1-2, WIRE-deadline-1, WIRE-deadline-3, WIRE-servo-1, WIRE-eeprom-6
pub fn robot_obeys_whatever_happens(values: AcceptedConfig, start: Micros, script: Script) -> Seen {
    let mut events = Events::new(&script);
    given!(let Some(config) = values.config());
    let mut rig = Rig::new(config, start, &mut events);
    while events.more() {
        match events.byte() % 20 {
            0..=5 => rig.tick(&mut events),
            6..=10 => rig.command(&mut events),
            11 => rig.noise(&mut events),
            12 => rig.frame(frame_len(rig.setup.mode)),
            13 => rig.echo(&mut events),
            14 => rig.fault(&mut events),
            15 => rig.pause(&mut events),
            16 => rig.temperature(&mut events),
            17 => rig.upset(&mut events),
            _ => rig.stretch(&mut events),
        }
        rig.transmit();
    }
    rig.seen
}

/// The robot stands where it was switched on, whatever the counters read then: the first tick moves its
/// pose by nothing and finds no fault in its wheels. The next moves it.
// Requirement: DOC-4.1-1
pub fn first_sample_moves_nothing(
    values: AcceptedConfig,
    now: Micros,
    left: u32,
    right: u16,
    rolled: u8,
) -> Seen {
    given!(let Some(config) = values.config());
    let mut log = Log::<1024>::new();
    let at_rest = TickInput::default();
    let first = TickInput {
        now,
        left,
        right,
        ..at_rest
    };
    let mut robot = Robot::new(&config, first);
    let outputs = robot.on_tick(first, &[], &mut log);
    assert!(robot.pose() == Pose::default());
    assert!(!robot.faults().intersects(WHEELS));
    assert!(outputs.left == MotorCommand::Coast && outputs.right == MotorCommand::Coast);
    let next = TickInput {
        now: now.after(10_000),
        left: left.wrapping_add(rolled.into()),
        ..first
    };
    let _ = robot.on_tick(next, &[], &mut log);
    assert!((robot.pose() == Pose::default()) == (rolled == 0));
    Seen::NOTHING
        .case(0, left != 0 && right != 0)
        .case(1, rolled != 0 && next.left < left)
        .case(2, rolled == 0)
}

/// A command of the Pi in a frame that ends now.
fn send(pi: &mut PiLink, command: &Command, robot: &mut Robot, now: Micros, log: &mut Log) {
    let mut frame = [0; MAX_FRAME];
    let len = pi.send(command, &mut frame);
    let received = ReceivedFrame {
        bytes: &frame[..len],
        overflow_len: 0,
        at: now,
        reply: 1,
    };
    if let Ok(command) = robot.receive(&received) {
        robot.execute(&command, now, log);
    }
}

/// Most ticks by which the window of a wheel of little headroom grows here.
const MORE: u32 = 50;

/// What is found at the wheels.
const WHEELS: Faults = Faults::LEFT_STALLED
    .union(Faults::RIGHT_STALLED)
    .union(Faults::LEFT_REVERSED)
    .union(Faults::RIGHT_REVERSED)
    .union(Faults::ENCODER_JUMP);

/// A robot whose wheels do not turn is stopped in time: commanded to turn from a start, by any percentage,
/// it brakes and is faulted after [`EARLIEST`](drive_monitor::EARLIEST) ticks at the earliest, and after
/// [`FROM_REST`](drive_monitor::FROM_REST) at the latest where a wheel gets 25 % beyond its dead zone, or its limit
/// and the longer window that it leaves. What is latched stays, whatever the Pi says but clearing it.
// Requirement: WIRE-status-1, WIRE-status-3
pub fn blocked_wheels_stop_the_robot(values: AcceptedConfig, now: Micros, percent: i8) -> Seen {
    let values = values
        .with(MODE, Mode::TuneRotate.code().into())
        // Nothing else is to stop it.
        .with(BATTERY_CUTOFF, 0);
    given!(let Some(config) = values.config());
    let percent = i32::from(percent).clamp(-100, 100);
    let driven = [config.left(), config.right()].map(|wheel| {
        let duty = (percent.abs() * 100).min(wheel.limit.hundredths().into());
        duty - i32::from(wheel.dead_zone.hundredths())
    });
    let mut sample = TickInput {
        now,
        ..TickInput::default()
    };
    let mut robot = Robot::new(&config, sample);
    let mut pi = PiLink::new(config.link_setup());
    let mut log = Log::<1024>::new();
    let mut after = None;
    for tick in 0..=drive_monitor::FROM_REST + MORE {
        let command = Command {
            percent: Binary64::from_scaled(percent.into(), 0),
            ..Command::default()
        };
        send(&mut pi, &command, &mut robot, sample.now, &mut log);
        let outputs = robot.on_tick(sample, &[], &mut log);
        sample.now = sample.now.after(10_000);
        let accused = robot.faults().intersects(WHEELS);
        if accused {
            assert!(robot.state() == State::Faulted);
            assert!(outputs.left == MotorCommand::Brake && outputs.right == MotorCommand::Brake);
            // The first tick only set them: so many have been judged.
            after = after.or(Some(tick));
        }
        assert!(accused == after.is_some());
    }
    let parameters = drive_monitor::Parameters::of(&config);
    for (wheel, beyond) in driven.into_iter().enumerate() {
        let more = parameters.more(wheel);
        if beyond >= parameters.driven(wheel) && more <= MORE {
            assert!(after.is_some_and(|after| after <= drive_monitor::FROM_REST + more));
        }
    }
    if (0..2).all(|wheel| driven[wheel] << 8 < parameters.judged(wheel)) {
        assert!(after.is_none());
    }
    assert!(after.is_none_or(|after| after >= drive_monitor::EARLIEST));
    Seen::NOTHING
        .case(
            0,
            after.is_some_and(|after| after >= drive_monitor::FROM_REST - 1),
        )
        .case(1, after.is_some_and(|after| after < 65))
        .case(2, after.is_none() && percent != 0)
        .case(3, after > Some(drive_monitor::FROM_REST))
}

crate::properties! {
    property T6 first_sample_moves_nothing(
        values: AcceptedConfig, now: Micros, left: u32, right: u16, rolled: u8
    ) {
        cases ["counters that stand anywhere", "the left counter wrapped", "nothing rolled"];
        needs [accepted_configuration_is_bounded];
        sampled 50_000;
    }
    property T14 blocked_wheels_stop_the_robot(values: AcceptedConfig, now: Micros, percent: i8) {
        cases ["as late as can be", "at full drive", "too little to tell", "little headroom"];
        needs [accepted_configuration_is_bounded, broken_wheel_is_detected_in_time];
        sampled 20_000;
    }
    property T8 robot_obeys_whatever_happens(values: AcceptedConfig, start: Micros, script: Script) {
        cases ["it drove", "it drove and silence stopped it", "a fault stopped it", "it rejected a frame",
            "its heading followed the gyroscope", "a distance through air of another temperature"];
        needs [accepted_configuration_is_bounded];
        sampled 100_000;
    }
}
