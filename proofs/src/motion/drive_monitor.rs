//! T14: a wheel that does not follow its command is detected in time, a healthy one never accused.
//!
//! The specification, independent of the code's windows and lags:
//!
//! - A wheel is *driven* by its duty beyond the dead zone. It *stands* while it turns by less than 1/128
//!   turn; it is *reversed* where it turns by more than that against its duty.
//! - Driven by at least 25 % in one direction, a wheel that stands or is reversed is detected within
//!   [`FROM_REST`] ticks of a start, within [`WHILE_DRIVING`] if the drive was constant before, and within
//!   [`AFTER_ANYTHING`] in any case.
//! - Never without [`WINDOW`] consecutive ticks driven by at least 20 % in one direction; after a start
//!   never within [`EARLIEST`].

use fw_core::eeprom::Config;
use fw_core::eeprom::fields::{
    COUNTS_PER_TURN, DEAD_ZONE_LEFT, DEAD_ZONE_RIGHT, MOTOR_LEFT_REVERSED, MOTOR_RIGHT_REVERSED,
};
use fw_core::motion::DriveMonitor;

use crate::eeprom::accepted::AcceptedConfig;
use crate::input::{Input, Source};
use crate::property::Seen;
use fw_core::types::{Delta, Duty, Faults, MotorCommand, MotorCommands};

/// Fewest ticks before a standing wheel is judged: half a second.
pub const WINDOW: u8 = 50;
/// Fewest ticks from a start to the fault: full drive passes the lags in 13.
pub const EARLIEST: u8 = 62;
/// Most ticks from a start to the fault.
pub const FROM_REST: u8 = 95;
/// Most ticks to the fault after a second of the same drive.
pub const WHILE_DRIVING: u8 = 99;
/// Most ticks to the fault, even after full drive in the other direction.
pub const AFTER_ANYTHING: u8 = 127;
/// Smallest drive for which these times hold, hundredths of a percent.
pub const DRIVEN: i32 = 2500;
/// Drive below which a standing wheel is never judged.
pub const IDLE: i32 = 2000;

/// The monitor's parameters of a platform.
#[derive(Clone, Copy, Debug)]
pub struct Parameters {
    /// Encoder counts of a turn.
    pub turn: u16,
    /// Hundredths of a percent.
    pub dead_zones: [u16; 2],
    /// A positive duty drives backward.
    pub reversed: [bool; 2],
}

impl Input for Parameters {
    fn draw(source: &mut impl Source) -> Self {
        Self {
            turn: u16::draw(source).clamp(100, 60_000),
            dead_zones: [u16::draw(source).min(9_999), u16::draw(source).min(9_999)],
            reversed: [Input::draw(source), Input::draw(source)],
        }
    }
}

impl Parameters {
    fn of(config: &Config) -> Self {
        let wheels = [config.left(), config.right()];
        Self {
            turn: config.counts_per_turn(),
            dead_zones: wheels.map(|wheel| wheel.dead_zone.hundredths().unsigned_abs()),
            reversed: wheels.map(|wheel| wheel.motor_reversed),
        }
    }

    fn monitor(self) -> DriveMonitor {
        let values = AcceptedConfig::FIRST_BOARD
            .with(COUNTS_PER_TURN, self.turn.into())
            .with(DEAD_ZONE_LEFT, self.dead_zones[0].into())
            .with(DEAD_ZONE_RIGHT, self.dead_zones[1].into())
            .with(MOTOR_LEFT_REVERSED, self.reversed[0].into())
            .with(MOTOR_RIGHT_REVERSED, self.reversed[1].into());
        DriveMonitor::new(&values.config().expect("accepted"))
    }

    /// Counts of 1/128 turn.
    fn least(self) -> i32 {
        i32::from(self.turn / 128).max(2)
    }

    /// Counts of a tenth of a turn.
    fn most(self) -> i32 {
        i32::from(self.turn / 10).max(10)
    }

    /// Duty of a wheel beyond the dead zone, forward positive.
    fn beyond(self, wheel: usize, drive: MotorCommand) -> i32 {
        let MotorCommand::Run(duty) = drive else {
            return 0;
        };
        let duty = i32::from(duty.hundredths());
        let beyond = (duty.abs() - i32::from(self.dead_zones[wheel])).max(0) * duty.signum();
        beyond * self.sign(wheel)
    }

    /// −1 where a positive duty drives backward.
    fn sign(self, wheel: usize) -> i32 {
        1 - 2 * i32::from(self.reversed[wheel])
    }

    /// The duty that drives a wheel by `beyond`.
    fn duty(self, wheel: usize, beyond: i32) -> MotorCommand {
        let duty = (beyond.abs() + i32::from(self.dead_zones[wheel])) * beyond.signum();
        MotorCommand::Run(Duty::saturating(duty * self.sign(wheel)))
    }
}

/// The faults of each wheel.
const STALLED: [Faults; 2] = [Faults::LEFT_STALLED, Faults::RIGHT_STALLED];
const REVERSED: [Faults; 2] = [Faults::LEFT_REVERSED, Faults::RIGHT_REVERSED];

/// Command and motion of one wheel; the other one rests.
fn one_of(wheel: usize, drive: MotorCommand, counts: i32) -> (MotorCommands, Delta) {
    let mut command = MotorCommands::BRAKE;
    if wheel == 0 {
        command.left = drive;
        return (command, Delta::rolled(counts, 0));
    }
    command.right = drive;
    (command, Delta::rolled(0, counts))
}

/// An encoder jump is reported in its tick, and nothing but more than a tenth of a turn is a jump. No
/// overflow for any commands, counts and parameters.
// Requirement: WIRE-status-3
pub fn jump_is_detected_at_once(
    parameters: Parameters,
    before: (MotorCommands, (i32, i32)),
    command: MotorCommands,
    counts: (i32, i32),
) -> Seen {
    let mut monitor = parameters.monitor();
    let _ = monitor.step(&before.0, &Delta::rolled(before.1.0, before.1.1));
    let faults = monitor.step(&command, &Delta::rolled(counts.0, counts.1));
    let most = parameters.most().unsigned_abs();
    let jumps = counts.0.unsigned_abs() > most || counts.1.unsigned_abs() > most;
    assert!(faults.intersects(Faults::ENCODER_JUMP) == jumps);
    // Two ticks are too few to judge a wheel.
    assert!(faults.difference(Faults::ENCODER_JUMP).is_empty());
    seen!(jumps, !jumps && counts.0 != 0, counts.0 == i32::MIN)
}

/// Phases of 5 bytes: duration, and each wheel's duty and counts.
type Phases = [u8; 60];

impl Parameters {
    /// A command, often near a threshold.
    fn some_duty(self, wheel: usize, byte: u8) -> MotorCommand {
        let sign = if byte & 1 == 0 { 1 } else { -1 };
        match byte >> 1 {
            0 => MotorCommand::Coast,
            1 => MotorCommand::Brake,
            2..=31 => self.duty(wheel, sign * (IDLE + i32::from(byte) - 32)),
            32..=63 => self.duty(wheel, sign * 10_000),
            _ => MotorCommand::Run(Duty::saturating((i32::from(byte) - 128) * 79)),
        }
    }

    /// Counts of a tick, often with a window's sum near a threshold.
    fn some_counts(self, byte: u8, tick: u8) -> i32 {
        let sign = if byte & 1 == 0 { 1 } else { -1 };
        let least = self.least();
        let share = |sum: i32| {
            // `sum` distributed evenly over [`WINDOW`] ticks.
            let (tick, window) = (i32::from(tick % WINDOW), i32::from(WINDOW));
            sum * (tick + 1) / window - sum * tick / window
        };
        match byte >> 1 {
            0..=7 => 0,
            8..=39 => share(sign * (least + i32::from(byte >> 1) - 24)),
            40..=47 => sign * if tick % 2 == 0 { least } else { -least },
            48..=79 => share(sign * 20 * least),
            80..=87 => sign * (self.most() + i32::from(byte >> 1) - 84),
            _ => share(sign * i32::from(byte)),
        }
    }
}

/// Precondition of a fault: [`WINDOW`] consecutive ticks in one direction.
#[derive(Clone, Debug, Default)]
struct Witness {
    /// Direction in which it is driven by [`IDLE`] at least, without interruption.
    direction: i32,
    /// Counts in this direction since then, after each tick.
    sums: Vec<i64>,
}

impl Witness {
    /// One tick: the sum of the window that ends with it, if it is complete.
    fn step(&mut self, beyond: i32, counts: i32) -> Option<i64> {
        if beyond.abs() < IDLE || beyond.signum() != self.direction {
            self.sums.clear();
            self.direction = beyond.signum();
        }
        if beyond.abs() >= IDLE {
            let before = self.sums.last().copied().unwrap_or_default();
            self.sums.push(before + i64::from(counts * self.direction));
        }
        let last = self.sums.last()?;
        let begin = self.sums.len().checked_sub(usize::from(WINDOW))?;
        let before = begin.checked_sub(1).map_or(0, |at| self.sums[at]);
        Some(last - before)
    }
}

/// A wheel is reported as stalled only if it was driven by at least 20 % in one direction in each of the
/// last 50 ticks and turned by less than 1/128 turn in them; as reversed only if it turned by that in
/// the other direction. For any commands and motions of both wheels.
// Requirement: WIRE-status-3
pub fn healthy_wheel_raises_no_fault(values: AcceptedConfig, phases: Phases) -> Seen {
    given!(let Some(config) = values.config());
    let parameters = Parameters::of(&config);
    let mut monitor = parameters.monitor();
    let mut witnesses = [Witness::default(), Witness::default()];
    let least = i64::from(parameters.least());
    let (mut seen, mut just_enough) = (Faults::NONE, false);
    for phase in phases.chunks_exact(5) {
        for tick in 0..phase[0] {
            let command = [1, 3].map(|at| parameters.some_duty(at / 2, phase[at]));
            let counts = [2, 4].map(|at| parameters.some_counts(phase[at], tick));
            let (mut motion, [left, right]) = (Delta::default(), command);
            [motion.left, motion.right] = counts;
            let faults = monitor.step(&MotorCommands { left, right }, &motion);
            for wheel in 0..2 {
                let beyond = parameters.beyond(wheel, command[wheel]);
                let sum = witnesses[wheel].step(beyond, counts[wheel]);
                let stands = sum.is_some_and(|sum| -least < sum && sum < least);
                assert!(stands || !faults.intersects(STALLED[wheel]));
                let turns_back = sum.is_some_and(|sum| sum <= -least);
                assert!(turns_back || !faults.intersects(REVERSED[wheel]));
                just_enough |= sum == Some(least);
            }
            let jumps = counts.iter().any(|counts| counts.abs() > parameters.most());
            assert!(faults.intersects(Faults::ENCODER_JUMP) == jumps);
            seen |= faults;
        }
    }
    Seen::NOTHING
        .case(0, seen.intersects(Faults::LEFT_STALLED))
        .case(1, seen.intersects(Faults::RIGHT_REVERSED))
        .case(2, seen.intersects(Faults::ENCODER_JUMP))
        .case(3, just_enough)
}

/// History of a wheel before its failure.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Past {
    /// Anything, then braked or coasting for a tick: a start.
    Rest,
    /// The same drive for a second, turning.
    Driving,
    /// Anything.
    Anything,
}

impl Past {
    fn within(self) -> u8 {
        match self {
            Self::Rest => FROM_REST,
            Self::Driving => WHILE_DRIVING,
            Self::Anything => AFTER_ANYTHING,
        }
    }
}

/// A blocked or reversed wheel or a dead encoder is reported within [`FROM_REST`], [`WHILE_DRIVING`] or
/// [`AFTER_ANYTHING`] ticks, depending on its history, even with jitter of the encoder; from a start
/// never within [`EARLIEST`].
// Requirement: WIRE-status-3
pub fn broken_wheel_is_detected_in_time(
    values: AcceptedConfig,
    past: (u8, [u8; 15]),
    beyond: u16,
    forward: bool,
    broken: (bool, [u8; 16]),
) -> Seen {
    given!(let Some(config) = values.config());
    let mut parameters = Parameters::of(&config);
    let (kind, phases) = past;
    let wheel = usize::from(kind & 1);
    // A dead zone that leaves enough duty.
    parameters.dead_zones[wheel] = parameters.dead_zones[wheel].min(7500);
    let room = 10_000 - i32::from(parameters.dead_zones[wheel]);
    let direction = if forward { 1 } else { -1 };
    let beyond = direction * (DRIVEN + i32::from(beyond) % (room - DRIVEN + 1));
    let drive = parameters.duty(wheel, beyond);
    assert!(parameters.beyond(wheel, drive) == beyond);
    let past = match kind >> 1 & 3 {
        0 => Past::Rest,
        1 => Past::Driving,
        _ => Past::Anything,
    };
    let mut monitor = parameters.monitor();
    let mut step = |drive: MotorCommand, counts: i32| {
        let (command, delta) = one_of(wheel, drive, counts);
        monitor.step(&command, &delta)
    };
    if past == Past::Driving {
        // A healthy wheel, with the failure anywhere in the code's window.
        for _ in 0..100 + usize::from(phases[0]) {
            assert!(step(drive, direction * parameters.least()).is_empty());
        }
    } else {
        for phase in phases.chunks_exact(3) {
            for tick in 0..phase[0] {
                let drive = parameters.some_duty(wheel, phase[1]);
                let _ = step(drive, parameters.some_counts(phase[2], tick));
            }
        }
    }
    if past == Past::Rest {
        let rest = [MotorCommand::Brake, MotorCommand::Coast];
        let _ = step(rest[usize::from(phases[0] & 1)], 0);
    }
    let (back, jitter) = broken;
    let expected = if back { REVERSED } else { STALLED }[wheel];
    let (least, mut stood) = (parameters.least(), 0);
    let mut after = None;
    for tick in 0..past.within() {
        let counts = if back {
            -direction * least
        } else {
            // Jitter of less than 1/128 turn.
            let at = i32::from(jitter[usize::from(tick) % jitter.len()]) % least;
            let counts = at - stood;
            stood = at;
            counts
        };
        if step(drive, counts).intersects(expected) {
            after = after.or(Some(tick + 1));
        }
    }
    assert!(after.is_some());
    if past == Past::Rest {
        assert!(after >= Some(EARLIEST));
    }
    let latest = after >= Some(AFTER_ANYTHING - 3);
    Seen::NOTHING
        .case(0, past == Past::Rest && after >= Some(FROM_REST - 1))
        .case(1, past == Past::Driving && after == Some(WHILE_DRIVING))
        .case(2, past == Past::Anything && latest)
        .case(3, back && past == Past::Driving)
        .case(4, !back && past == Past::Anything)
        .case(5, past == Past::Rest && after == Some(EARLIEST))
}

impl Input for MotorCommands {
    fn draw(source: &mut impl Source) -> Self {
        let drive = |source: &mut _| match u8::draw(source) % 4 {
            0 => MotorCommand::Coast,
            1 => MotorCommand::Brake,
            _ => MotorCommand::Run(Duty::saturating(i16::draw(source).into())),
        };
        Self {
            left: drive(source),
            right: drive(source),
        }
    }
}

crate::properties! {
    theorem T14 jump_is_detected_at_once(
        parameters: Parameters, before: (MotorCommands, (i32, i32)), command: MotorCommands, counts: (i32, i32)
    ) {
        cases ["a jump", "no jump", "the longest"];
        kani proof [unwind(80)];
        sampled 300_000;
    }
    property T14 healthy_wheel_raises_no_fault(values: AcceptedConfig, phases: Phases) {
        cases ["one stalled", "one reversed", "one jumped", "one turned just enough"];
        needs [accepted_configuration_is_bounded];
        sampled 20_000;
    }
    property T14 broken_wheel_is_detected_in_time(
        values: AcceptedConfig, past: (u8, [u8; 15]), beyond: u16, forward: bool, broken: (bool, [u8; 16])
    ) {
        cases [
            "the latest from a start", "the latest while driving", "the latest after anything",
            "reversed", "stalled", "the earliest from a start"
        ];
        needs [accepted_configuration_is_bounded];
        sampled 50_000;
    }
}
