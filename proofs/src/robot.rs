//! T5, T8 and T14 of the whole robot: any configuration that was accepted, any order of events.

use fw_core::double::Double;
use fw_core::log::Log;
use fw_core::robot::{leds, Drive, Outputs, Rangefinder, Robot, Sample, BLOCKING};
use fw_core::units::{Micros, Pose};
use fw_core::wire::{
    fault, frame_len, CellCode, Command, Mode, Order, PiLink, PoseCode, Setup, State, MAX_FRAME,
};

use crate::eeprom::accepted::AcceptedConfig;
use crate::motion::plausibility;
use crate::theorem::Seen;

/// What happens, as bytes: each event is one, and takes its figures from those after it.
pub type Script = [u8; 192];

/// The script as it is read.
struct Events<'a>(core::slice::Iter<'a, u8>);

impl Events<'_> {
    fn byte(&mut self) -> u8 {
        self.0.next().copied().unwrap_or_default()
    }

    /// A number of either sign, small more often than large.
    fn number(&mut self) -> i32 {
        let (size, value) = (self.byte(), self.byte());
        (i32::from(value) - 128) << (size % 20)
    }
}

/// The robot, its other end, and what must be true of it.
struct Rig {
    config: AcceptedConfig,
    setup: Setup,
    robot: Robot,
    pi: PiLink,
    log: Log,
    now: Micros,
    sample: Sample,
    last: [u8; MAX_FRAME],
    /// When the robot last took a frame, if it ever did.
    fresh: Option<Micros>,
    driven: bool,
    stopped: bool,
    rejected: bool,
}

impl Rig {
    fn new(config: AcceptedConfig, now: Micros) -> Self {
        let setup = Setup::from(&config.0);
        let sample = Sample {
            now,
            ..Sample::default()
        };
        Self {
            setup,
            robot: Robot::new(&config.0, sample),
            pi: PiLink::new(setup),
            log: Log::new(),
            now,
            sample,
            last: [0; MAX_FRAME],
            fresh: None,
            driven: false,
            stopped: false,
            rejected: false,
            config,
        }
    }

    fn frame(&mut self, clocked: usize) {
        let before = *self.robot.counters();
        let frame = self.last;
        self.robot
            .on_frame(&frame, clocked, self.now, &mut self.log);
        let after = self.robot.counters();
        if after.accepted == before.accepted {
            assert!(after.rejected_total() == before.rejected_total() + 1);
            self.rejected = true;
        } else {
            self.fresh = Some(self.now);
        }
        let mut reply = [0; MAX_FRAME];
        let len = self.robot.next_reply(&mut reply);
        self.reply_is_right(&reply, len);
    }

    fn reply_is_right(&self, reply: &[u8; MAX_FRAME], len: usize) {
        assert!(len == frame_len(self.setup.mode));
        assert!(PiLink::new(self.setup).receive(&reply[..len]).is_ok());
    }

    fn command(&mut self, events: &mut Events<'_>) {
        let kind = events.byte();
        let percent = [0.0_f64, 50.0, -100.0, 12.5][usize::from(kind & 3)];
        let command = Command {
            expected: PoseCode {
                x: events.number(),
                y: events.number(),
                rotation: u16::from(events.byte()) << 7,
            },
            apply: kind & 4 != 0,
            percent: Double(percent.to_bits()),
            tune: CellCode {
                cell: kind % self.setup.cells,
                voltage: if kind & 8 == 0 { 0 } else { 800 },
            },
            order: match kind >> 4 & 7 {
                0 => Order::Stop,
                1..=3 => Order::Resume,
                _ => Order::None,
            },
            clear_faults: if kind & 0x80 == 0 { 0 } else { u16::MAX },
            ..Command::default()
        };
        let len = self.pi.send(&command, &mut self.last);
        self.frame(len);
    }

    fn tick(&mut self, events: &mut Events<'_>) {
        self.sample.left = self.sample.left.wrapping_add_signed(events.number());
        #[allow(clippy::cast_possible_truncation, reason = "a 16-bit counter wraps")]
        {
            self.sample.right = self
                .sample
                .right
                .wrapping_add_signed(events.number() as i16);
        }
        self.now = self.now.after(10_000);
        self.sample.now = self.now;
        let word = u16::from(events.byte()) << 4;
        let outputs = self
            .robot
            .on_tick(self.sample, &[word / 2, word], &mut self.log);
        self.outputs_are_right(&outputs);
        let mut reply = [0; MAX_FRAME];
        let len = self.robot.refresh_reply(&mut reply);
        self.reply_is_right(&reply, len);
        let len = self.robot.following_reply(&mut reply);
        self.reply_is_right(&reply, len);
    }

    fn outputs_are_right(&mut self, outputs: &Outputs) {
        let platform = &self.config.0.platform;
        let braked = outputs.left == Drive::Brake && outputs.right == Drive::Brake;
        let state = self.robot.state();
        assert!(outputs.leds == leds(state) && state != State::Booting);
        for (drive, limit) in [
            (outputs.left, platform.limit_left),
            (outputs.right, platform.limit_right),
        ] {
            if let Drive::Run(duty) = drive {
                assert!(duty.hundredths().unsigned_abs() <= limit);
                assert!(self.fresh.is_some());
                self.driven = true;
            }
        }
        // Silence, from the last frame that was taken.
        let allowed = u32::from(platform.stop_deadline) * 1000;
        if self
            .fresh
            .is_some_and(|fresh| self.now.since(fresh) >= allowed)
        {
            assert!(braked && matches!(state, State::Stopped | State::Faulted));
            self.stopped |= self.driven;
        }
        if self.robot.faults() & BLOCKING != 0 {
            assert!(braked && state == State::Faulted);
        }
        assert!(state != State::Stopped || braked);
        if let Some(width) = outputs.servo {
            assert!((1000..=2000).contains(&width) && platform.servo);
            assert!(state != State::Faulted);
            // Like the motors: not before a frame was taken, not after the silence.
            assert!(self
                .fresh
                .is_some_and(|fresh| self.now.since(fresh) < allowed));
        }
    }
}

/// Any accepted configuration, any order of ticks, frames, echoes, faults and pauses: nothing panics or
/// overflows; the motors brake from the deadline on and as long as a fault blocks them, never exceed
/// their limits and never turn before a frame was taken; every reply is one the Pi takes.
// Requirement: DOC-3.2-1, DOC-4.1-2, WIRE-deadline-1, WIRE-deadline-3, WIRE-servo-1, WIRE-eeprom-6
pub fn robot_obeys_whatever_happens(config: AcceptedConfig, start: Micros, script: Script) -> Seen {
    let mut rig = Rig::new(config, start);
    let mut events = Events(script.iter());
    while !events.0.as_slice().is_empty() {
        match events.byte() % 16 {
            0..=5 => rig.tick(&mut events),
            6..=10 => rig.command(&mut events),
            11 => {
                // Anything at all, of any length.
                for byte in &mut rig.last {
                    *byte = byte.wrapping_mul(31) ^ events.0.len().to_le_bytes()[0];
                }
                let clocked = usize::from(events.byte());
                rig.frame(clocked);
            }
            12 => rig.frame(frame_len(rig.setup.mode)),
            13 => {
                let which = Rangefinder::ALL[usize::from(events.byte() % 3)];
                let rise = rig.now.after(u32::from(events.byte()) * 64);
                let fall = rise.after(u32::from(events.byte()) * 128);
                rig.robot.on_echo(which, rise, fall);
            }
            14 => {
                let fault = 1 << (events.byte() & 0xF);
                rig.robot.raise(fault, &mut rig.log);
                rig.robot
                    .on_lost_frames(u32::from(events.byte()), &mut rig.log);
            }
            _ => rig.now = rig.now.after(u32::from(events.byte()) << 14),
        }
        let pending = rig.log.pending().len();
        rig.log.sent(pending / 2);
    }
    Seen::NOTHING
        .case(0, rig.driven)
        .case(1, rig.stopped)
        .case(2, rig.robot.faults() & BLOCKING != 0)
        .case(3, rig.rejected && rig.fresh.is_some())
}

/// The robot stands where it was switched on, whatever the counters read then: the first tick moves its
/// pose by nothing and finds no fault in its wheels. The next moves it.
// Requirement: DOC-4.1-1
pub fn first_sample_moves_nothing(
    config: AcceptedConfig,
    now: Micros,
    left: u32,
    right: u16,
    rolled: u8,
) -> Seen {
    let mut log = Log::<1024>::new();
    let first = Sample { now, left, right };
    let mut robot = Robot::new(&config.0, first);
    let outputs = robot.on_tick(first, &[], &mut log);
    assert!(robot.pose() == Pose::default());
    assert!(robot.faults() & WHEELS == 0);
    assert!(outputs.left == Drive::Coast && outputs.right == Drive::Coast);
    let next = Sample {
        now: now.after(10_000),
        left: left.wrapping_add(rolled.into()),
        right,
    };
    let _ = robot.on_tick(next, &[], &mut log);
    assert!((robot.pose() == Pose::default()) == (rolled == 0));
    Seen::NOTHING
        .case(0, left != 0 && right != 0)
        .case(1, rolled != 0 && next.left < left)
        .case(2, rolled == 0)
}

/// What is found at the wheels.
const WHEELS: u16 = fault::LEFT_STALLED
    | fault::RIGHT_STALLED
    | fault::LEFT_REVERSED
    | fault::RIGHT_REVERSED
    | fault::ENCODER_JUMP;

/// A robot whose wheels do not turn is stopped in time: told to turn from a start, by any percentage,
/// it brakes and is faulted after [`EARLIEST`](plausibility::EARLIEST) ticks at the earliest, and after
/// [`FROM_REST`](plausibility::FROM_REST) at the latest where a wheel gets 25 % beyond its dead zone. What is latched stays, whatever the Pi says but clearing it.
// Requirement: WIRE-status-1, WIRE-status-3
pub fn blocked_wheels_stop_the_robot(config: AcceptedConfig, now: Micros, percent: i8) -> Seen {
    let AcceptedConfig(mut config) = config;
    config.mode = Mode::TuneRotate;
    // Nothing else is to stop it.
    config.platform.battery_cutoff = 0;
    let platform = config.platform;
    let percent = i32::from(percent).clamp(-100, 100);
    let beyond =
        |limit: u16, dead_zone: u16| (percent.abs() * 100).min(limit.into()) - i32::from(dead_zone);
    let driven = [
        beyond(platform.limit_left, platform.dead_zone_left),
        beyond(platform.limit_right, platform.dead_zone_right),
    ];
    let mut sample = Sample {
        now,
        ..Sample::default()
    };
    let mut robot = Robot::new(&config, sample);
    let mut pi = PiLink::new(Setup::from(&config));
    let mut log = Log::<1024>::new();
    let mut after = None;
    for tick in 0..=plausibility::FROM_REST + 20 {
        let command = Command {
            percent: Double::from_scaled(percent.into(), 0),
            ..Command::default()
        };
        let mut frame = [0; MAX_FRAME];
        let len = pi.send(&command, &mut frame);
        robot.on_frame(&frame, len, sample.now, &mut log);
        let outputs = robot.on_tick(sample, &[], &mut log);
        sample.now = sample.now.after(10_000);
        let accused = robot.faults() & WHEELS != 0;
        if accused {
            assert!(robot.state() == State::Faulted);
            assert!(outputs.left == Drive::Brake && outputs.right == Drive::Brake);
            // The first tick only told them: so many have been judged.
            after = after.or(Some(tick));
        }
        assert!(accused == after.is_some());
    }
    if driven.iter().any(|&beyond| beyond >= plausibility::DRIVEN) {
        assert!(after.is_some_and(|after| after <= plausibility::FROM_REST));
    }
    if driven.iter().all(|&beyond| beyond < plausibility::IDLE) {
        assert!(after.is_none());
    }
    assert!(after.is_none_or(|after| after >= plausibility::EARLIEST));
    Seen::NOTHING
        .case(
            0,
            after.is_some_and(|after| after >= plausibility::FROM_REST - 1),
        )
        .case(1, after.is_some_and(|after| after < 65))
        .case(2, after.is_none() && percent != 0)
}

crate::theorems! {
    T6 first_sample_moves_nothing(
        config: AcceptedConfig, now: Micros, left: u32, right: u16, rolled: u8
    ) {
        cases ["counters that stand anywhere", "the left counter wrapped", "nothing rolled"];
        needs [accepted_configuration_is_bounded];
        sampled 50_000;
    }
    T14 blocked_wheels_stop_the_robot(config: AcceptedConfig, now: Micros, percent: i8) {
        cases ["as late as can be", "at full drive", "too little to tell"];
        needs [accepted_configuration_is_bounded, broken_wheel_is_noticed_in_time];
        sampled 20_000;
    }
    T8 robot_obeys_whatever_happens(config: AcceptedConfig, start: Micros, script: Script) {
        cases ["it drove", "it drove and silence stopped it", "a fault stopped it", "it rejected a frame"];
        needs [accepted_configuration_is_bounded];
        sampled 100_000;
    }
}
