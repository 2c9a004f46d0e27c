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
//! - Where the limit exceeds the dead zone by less than 25 %, that headroom stands for the 25 % and four fifths of
//!   it for the 20 %; the window, and with it these times, are longer in inverse proportion.

mod parameters;

pub use parameters::Parameters;

use crate::eeprom::accepted::AcceptedConfig;
use crate::input::{Input, Source};
use crate::property::Seen;
use fw_core::types::{Delta, Duty, Faults, MotorCommand, MotorCommands};

/// Fewest ticks before a standing wheel is judged: half a second.
pub const WINDOW: u32 = 50;
/// Fewest ticks from a start to the fault: full drive passes the lags in 13.
pub const EARLIEST: u32 = 62;
/// Most ticks from a start to the fault.
pub const FROM_REST: u32 = 95;
/// Most ticks to the fault after a second of the same drive.
pub const WHILE_DRIVING: u32 = 99;
/// Most ticks to the fault, even after full drive in the other direction.
pub const AFTER_ANYTHING: u32 = 127;
/// Smallest drive for which these times hold, hundredths of a percent.
pub const DRIVEN: i32 = 2500;
/// Drive below which a standing wheel is never judged.
pub const IDLE: i32 = 2000;

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

/// Precondition of a fault: a window's consecutive ticks in one direction.
#[derive(Clone, Debug, Default)]
struct Witness {
    /// Direction in which it is driven enough to be judged, without interruption.
    direction: i32,
    /// Counts in this direction since then, after each tick.
    sums: Vec<i64>,
}

impl Witness {
    /// One tick: the sum of the window that ends with it, if it is complete.
    fn step(&mut self, driven: bool, beyond: i32, counts: i32, window: u32) -> Option<i64> {
        if !driven || beyond.signum() != self.direction {
            self.sums.clear();
            self.direction = beyond.signum();
        }
        if driven {
            let before = self.sums.last().copied().unwrap_or_default();
            self.sums.push(before + i64::from(counts * self.direction));
        }
        let last = self.sums.last()?;
        let begin = self.sums.len().checked_sub(window as usize)?;
        let before = begin.checked_sub(1).map_or(0, |at| self.sums[at]);
        Some(last - before)
    }
}

/// A wheel is reported as stalled only if it was driven by at least 20 %, or four fifths of a narrower headroom, in
/// one direction in each tick of a window and turned by less than 1/128 turn in them; as reversed only if it turned
/// by that in the other direction. For any commands within the limits and motions of both wheels.
// Requirement: WIRE-status-3
pub fn healthy_wheel_raises_no_fault(values: AcceptedConfig, phases: Phases) -> Seen {
    given!(let Some(config) = values.config());
    let parameters = Parameters::of(&config);
    let mut monitor = parameters.monitor();
    let mut witnesses = [Witness::default(), Witness::default()];
    let least = i64::from(parameters.least());
    let (mut seen, mut just_enough, mut narrow) = (Faults::NONE, false, false);
    for phase in phases.chunks_exact(5) {
        for tick in 0..phase[0] {
            let command = [1, 3].map(|at| parameters.some_duty(at / 2, phase[at]));
            let counts = [2, 4].map(|at| parameters.some_counts(phase[at], tick));
            let (mut motion, [left, right]) = (Delta::default(), command);
            [motion.left, motion.right] = counts;
            let faults = monitor.step(&MotorCommands { left, right }, &motion);
            for wheel in 0..2 {
                let beyond = parameters.beyond(wheel, command[wheel]);
                let driven = beyond.abs() << 8 >= parameters.judged(wheel);
                let window = parameters.window(wheel);
                let sum = witnesses[wheel].step(driven, beyond, counts[wheel], window);
                let stands = sum.is_some_and(|sum| -least < sum && sum < least);
                assert!(stands || !faults.intersects(STALLED[wheel]));
                let turns_back = sum.is_some_and(|sum| sum <= -least);
                assert!(turns_back || !faults.intersects(REVERSED[wheel]));
                just_enough |= sum == Some(least);
                narrow |= window > WINDOW && faults.intersects(STALLED[wheel]);
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
        .case(4, narrow)
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
    /// The latest tick of the fault, where the window is so much longer than [`WINDOW`].
    fn within(self, more: u32) -> u32 {
        match self {
            Self::Rest => FROM_REST + more,
            Self::Driving => WHILE_DRIVING + 2 * more,
            Self::Anything => AFTER_ANYTHING + 2 * more,
        }
    }
}

/// A blocked or reversed wheel or a dead encoder is reported within [`FROM_REST`], [`WHILE_DRIVING`] or
/// [`AFTER_ANYTHING`] ticks, depending on its history, even with jitter of the encoder; from a start
/// never within [`EARLIEST`]. Later by the window's growth, or by twice that, where the headroom is narrow.
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
    // The full limit, or one that leaves 2.5 to 25 %.
    let narrow = kind & 8 != 0;
    parameters.dead_zones[wheel] = parameters.dead_zones[wheel].min(7500);
    parameters.limits[wheel] = if narrow {
        parameters.dead_zones[wheel] + 250 + beyond % 2250
    } else {
        10_000
    };
    let (least, most) = (parameters.driven(wheel), parameters.headroom(wheel));
    let direction = if forward { 1 } else { -1 };
    let beyond = direction * (least + i32::from(beyond) % (most - least + 1));
    let more = parameters.more(wheel);
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
        for _ in 0..100 + 2 * more + u32::from(phases[0]) {
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
    for tick in 0..past.within(more) {
        let counts = if back {
            -direction * least
        } else {
            // Jitter of less than 1/128 turn.
            let at = i32::from(jitter[tick as usize % jitter.len()]) % least;
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
        assert!(after >= Some(EARLIEST + more));
    }
    let latest = after >= Some(AFTER_ANYTHING - 3);
    Seen::NOTHING
        .case(
            0,
            !narrow && past == Past::Rest && after >= Some(FROM_REST - 1),
        )
        .case(
            1,
            !narrow && past == Past::Driving && after == Some(WHILE_DRIVING),
        )
        .case(2, !narrow && past == Past::Anything && latest)
        .case(3, back && past == Past::Driving)
        .case(4, !back && past == Past::Anything)
        .case(5, past == Past::Rest && after == Some(EARLIEST))
        .case(
            6,
            narrow && past == Past::Rest && after >= Some(FROM_REST + more - 1),
        )
        .case(
            7,
            narrow && past == Past::Driving && after == Some(past.within(more)),
        )
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
        cases [
            "one stalled", "one reversed", "one jumped", "one turned just enough", "one stalled of little headroom"
        ];
        needs [accepted_configuration_is_bounded];
        sampled 20_000;
    }
    property T14 broken_wheel_is_detected_in_time(
        values: AcceptedConfig, past: (u8, [u8; 15]), beyond: u16, forward: bool, broken: (bool, [u8; 16])
    ) {
        cases [
            "the latest from a start", "the latest while driving", "the latest after anything",
            "reversed", "stalled", "the earliest from a start",
            "the latest from a start of little headroom", "the latest while driving with little headroom"
        ];
        needs [accepted_configuration_is_bounded];
        sampled 50_000;
    }
}
