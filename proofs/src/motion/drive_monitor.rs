//! T14: a wheel that does not do what it is told is noticed in time, and one that does never is.
//!
//! What a wheel must do is written out here once more, without the code's windows and lags:
//!
//! - It is *driven* by what its duty has beyond the dead zone. It *stands* while it turns by less than
//!   1/128 turn, it turns *back* where it turns by more than that against its duty.
//! - Told at least 25 % beyond its dead zone, one way, a wheel that stands or turns back is noticed
//!   within [`FROM_REST`] ticks of a start, within [`WHILE_DRIVING`] where the duty has not changed for
//!   some time, and within [`AFTER_ANYTHING`] whatever it was told before.
//! - Never without [`WINDOW`] ticks in a row in each of which it was told 20 % at least, one way; after
//!   a start, however it was driven before, never within [`EARLIEST`].

use fw_core::eeprom::Platform;
use fw_core::motion::DriveMonitor;

use crate::eeprom::accepted::AcceptedConfig;
use crate::input::{Input, Source};
use crate::property::Seen;
use fw_core::types::{Delta, Duty, Faults, MotorCommand, MotorCommands};

/// Ticks without which nothing is said of a wheel that stands: half a second.
pub const WINDOW: u8 = 50;
/// Ticks from a start to the fault, at least: full drive needs 13 to count.
pub const EARLIEST: u8 = 62;
/// Ticks from a start to the fault, at most.
pub const FROM_REST: u8 = 95;
/// Ticks to the fault where the wheel has been driven like that for a second, at most.
pub const WHILE_DRIVING: u8 = 99;
/// Ticks to the fault at most, even against full drive the other way.
pub const AFTER_ANYTHING: u8 = 127;
/// Duty beyond the dead zone from which on these times hold, hundredths of a percent.
pub const DRIVEN: i32 = 2500;
/// Duty beyond the dead zone below which nothing is ever said of a wheel that stands.
pub const IDLE: i32 = 2000;

/// The wheels' figures of a platform.
#[derive(Clone, Copy, Debug)]
pub struct Figures {
    /// Encoder counts of a turn.
    pub turn: u16,
    /// Hundredths of a percent.
    pub dead_zones: [u16; 2],
    /// A positive duty drives backwards.
    pub reversed: [bool; 2],
}

impl Input for Figures {
    fn draw(source: &mut impl Source) -> Self {
        Self {
            turn: Input::draw(source),
            dead_zones: [Input::draw(source), Input::draw(source)],
            reversed: [Input::draw(source), Input::draw(source)],
        }
    }
}

impl Figures {
    fn of(platform: &Platform) -> Self {
        Self {
            turn: platform.counts_per_turn,
            dead_zones: [platform.dead_zone_left, platform.dead_zone_right],
            reversed: [platform.motor_left_reversed, platform.motor_right_reversed],
        }
    }

    fn watch(self) -> DriveMonitor {
        DriveMonitor::new(&Platform {
            counts_per_turn: self.turn,
            dead_zone_left: self.dead_zones[0],
            dead_zone_right: self.dead_zones[1],
            motor_left_reversed: self.reversed[0],
            motor_right_reversed: self.reversed[1],
            ..Platform::FIRST_BOARD
        })
    }

    /// Counts of 1/128 turn: a wheel that turns by less stands.
    fn least(self) -> i32 {
        i32::from(self.turn / 128).max(2)
    }

    /// Counts of a tenth of a turn: more in a tick is a jump.
    fn most(self) -> i32 {
        i32::from(self.turn / 10).max(10)
    }

    /// What a wheel is driven by, forward positive: its duty beyond the dead zone.
    fn beyond(self, wheel: usize, drive: MotorCommand) -> i32 {
        let MotorCommand::Run(duty) = drive else {
            return 0;
        };
        let duty = i32::from(duty.hundredths());
        let beyond = (duty.abs() - i32::from(self.dead_zones[wheel])).max(0) * duty.signum();
        if self.reversed[wheel] {
            -beyond
        } else {
            beyond
        }
    }

    /// The duty that drives a wheel by `beyond`.
    fn duty(self, wheel: usize, beyond: i32) -> MotorCommand {
        let duty = (beyond.abs() + i32::from(self.dead_zones[wheel])) * beyond.signum();
        MotorCommand::Run(Duty::saturating(if self.reversed[wheel] {
            -duty
        } else {
            duty
        }))
    }
}

/// The faults of each wheel.
const STALLED: [Faults; 2] = [Faults::LEFT_STALLED, Faults::RIGHT_STALLED];
const REVERSED: [Faults; 2] = [Faults::LEFT_REVERSED, Faults::RIGHT_REVERSED];

/// Both wheels, of which one does something and the other rests.
fn one_of(wheel: usize, drive: MotorCommand, counts: i32) -> (MotorCommands, Delta) {
    let (mut told, mut delta) = (MotorCommands::BRAKE, Delta::default());
    if wheel == 0 {
        (told.left, delta.left) = (drive, counts);
    } else {
        (told.right, delta.right) = (drive, counts);
    }
    (told, delta)
}

/// An encoder that jumps is noticed in that tick, whatever was before, and nothing else is a jump: more
/// than a tenth of a turn. Nothing overflows for any duties, counts and figures.
// Requirement: WIRE-status-3
pub fn jump_is_noticed_at_once(
    figures: Figures,
    before: (MotorCommands, (i32, i32)),
    told: MotorCommands,
    counts: (i32, i32),
) -> Seen {
    let mut watch = figures.watch();
    let delta = |(left, right): (i32, i32)| Delta {
        left,
        right,
        ..Delta::default()
    };
    let (first, rolled) = before;
    let _ = watch.step(&first, &delta(rolled));
    let faults = watch.step(&told, &delta(counts));
    let most = figures.most().unsigned_abs();
    let jumps = counts.0.unsigned_abs() > most || counts.1.unsigned_abs() > most;
    assert!(faults.intersects(Faults::ENCODER_JUMP) == jumps);
    // Two ticks say nothing about a wheel that stands.
    assert!(faults.difference(Faults::ENCODER_JUMP).is_empty());
    Seen::NOTHING
        .case(0, jumps)
        .case(1, !jumps && counts.0 != 0)
        .case(2, counts.0 == i32::MIN)
}

/// What happens to both wheels for a while, 5 bytes each time: how long, and each wheel's duty and counts.
type Whiles = [u8; 60];

impl Figures {
    /// A duty, often one near what decides.
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

    /// Counts of a tick, often such that a window's sum is near what decides.
    fn some_counts(self, byte: u8, tick: u8) -> i32 {
        let sign = if byte & 1 == 0 { 1 } else { -1 };
        let least = self.least();
        let share = |sum: i32| {
            // `sum` in [`WINDOW`] ticks, as even as whole counts can be.
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

/// What must be so for a wheel to be accused: [`WINDOW`] ticks in a row of one way.
#[derive(Clone, Debug, Default)]
struct Witness {
    /// Which way it was told [`IDLE`] at least, without a break.
    way: i32,
    /// Counts this way since then, after each tick.
    sums: Vec<i64>,
}

impl Witness {
    /// A tick, and the sum of the window that ends with it if it was driven that long.
    fn step(&mut self, beyond: i32, counts: i32) -> Option<i64> {
        if beyond.abs() < IDLE || beyond.signum() != self.way {
            self.sums.clear();
            self.way = beyond.signum();
        }
        if beyond.abs() >= IDLE {
            let before = self.sums.last().copied().unwrap_or_default();
            self.sums.push(before + i64::from(counts * self.way));
        }
        let last = self.sums.last()?;
        let begin = self.sums.len().checked_sub(usize::from(WINDOW))?;
        let before = begin.checked_sub(1).map_or(0, |at| self.sums[at]);
        Some(last - before)
    }
}

/// Nothing is said of a wheel that does what it is told: a wheel is accused of standing only if it was
/// told 20 % beyond its dead zone, one way, in each of the last 50 ticks and turned by less than 1/128
/// turn in them; of turning back only if it turned by that much the other way. Whatever both wheels
/// are told and do, for as long as one likes.
// Requirement: WIRE-status-3
pub fn healthy_wheels_are_not_accused(config: AcceptedConfig, whiles: Whiles) -> Seen {
    let figures = Figures::of(&config.0.platform);
    let mut watch = figures.watch();
    let mut witnesses = [Witness::default(), Witness::default()];
    let least = i64::from(figures.least());
    let (mut seen, mut exonerated) = (Faults::NONE, false);
    for event in whiles.chunks_exact(5) {
        for tick in 0..event[0] {
            let told = [1, 3].map(|at| figures.some_duty(at / 2, event[at]));
            let counts = [2, 4].map(|at| figures.some_counts(event[at], tick));
            let faults = watch.step(
                &MotorCommands {
                    left: told[0],
                    right: told[1],
                },
                &Delta {
                    left: counts[0],
                    right: counts[1],
                    ..Delta::default()
                },
            );
            for wheel in 0..2 {
                let beyond = figures.beyond(wheel, told[wheel]);
                let sum = witnesses[wheel].step(beyond, counts[wheel]);
                if faults.intersects(STALLED[wheel]) {
                    assert!(sum.is_some_and(|sum| -least < sum && sum < least));
                }
                if faults.intersects(REVERSED[wheel]) {
                    assert!(sum.is_some_and(|sum| sum <= -least));
                }
                exonerated |= sum == Some(least);
            }
            let jumps = counts.iter().any(|counts| counts.abs() > figures.most());
            assert!(faults.intersects(Faults::ENCODER_JUMP) == jumps);
            seen |= faults;
        }
    }
    Seen::NOTHING
        .case(0, seen.intersects(Faults::LEFT_STALLED))
        .case(1, seen.intersects(Faults::RIGHT_REVERSED))
        .case(2, seen.intersects(Faults::ENCODER_JUMP))
        .case(3, exonerated)
}

/// What a wheel did before it broke.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Past {
    /// Anything, and then it was braked or let go for a tick: this is a start.
    Rest,
    /// It was driven as it is now for a second, and turned.
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

/// A wheel that stands, or whose encoder does, is noticed in time, and so is one that turns the wrong
/// way: within [`FROM_REST`], [`WHILE_DRIVING`] or [`AFTER_ANYTHING`] ticks, as its past was, and its
/// encoder may tremble. From a start never within [`EARLIEST`].
// Requirement: WIRE-status-3
pub fn broken_wheel_is_noticed_in_time(
    config: AcceptedConfig,
    past: (u8, [u8; 15]),
    beyond: u16,
    forward: bool,
    broken: (bool, [u8; 16]),
) -> Seen {
    let mut figures = Figures::of(&config.0.platform);
    let (kind, whiles) = past;
    let wheel = usize::from(kind & 1);
    // A wheel that can be driven that much.
    figures.dead_zones[wheel] = figures.dead_zones[wheel].min(7500);
    let room = 10_000 - i32::from(figures.dead_zones[wheel]);
    let way = if forward { 1 } else { -1 };
    let beyond = way * (DRIVEN + i32::from(beyond) % (room - DRIVEN + 1));
    let drive = figures.duty(wheel, beyond);
    assert!(figures.beyond(wheel, drive) == beyond);
    let past = match kind >> 1 & 3 {
        0 => Past::Rest,
        1 => Past::Driving,
        _ => Past::Anything,
    };
    let mut watch = figures.watch();
    let mut step = |drive: MotorCommand, counts: i32| {
        let (told, delta) = one_of(wheel, drive, counts);
        watch.step(&told, &delta)
    };
    if past == Past::Driving {
        // A healthy wheel, and the fault anywhere in the code's window.
        for _ in 0..100 + usize::from(whiles[0]) {
            assert!(step(drive, way * figures.least()).is_empty());
        }
    } else {
        for event in whiles.chunks_exact(3) {
            for tick in 0..event[0] {
                let drive = figures.some_duty(wheel, event[1]);
                let _ = step(drive, figures.some_counts(event[2], tick));
            }
        }
    }
    if past == Past::Rest {
        let _ = step(
            [MotorCommand::Brake, MotorCommand::Coast][usize::from(whiles[0] & 1)],
            0,
        );
    }
    let (back, tremble) = broken;
    let expected = if back {
        REVERSED[wheel]
    } else {
        STALLED[wheel]
    };
    let (least, mut stood) = (figures.least(), 0);
    let mut after = None;
    for tick in 0..past.within() {
        let counts = if back {
            -way * least
        } else {
            // Anywhere within less than 1/128 turn.
            let at = i32::from(tremble[usize::from(tick) % tremble.len()]) % least;
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
    Seen::NOTHING
        .case(0, past == Past::Rest && after >= Some(FROM_REST - 1))
        .case(1, past == Past::Driving && after == Some(WHILE_DRIVING))
        .case(
            2,
            past == Past::Anything && after >= Some(AFTER_ANYTHING - 3),
        )
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
    theorem T14 jump_is_noticed_at_once(
        figures: Figures, before: (MotorCommands, (i32, i32)), told: MotorCommands, counts: (i32, i32)
    ) {
        cases ["a jump", "no jump", "the longest"];
        kani proof [unwind(4)];
        sampled 300_000;
    }
    property T14 healthy_wheels_are_not_accused(config: AcceptedConfig, whiles: Whiles) {
        cases ["one stood", "one turned back", "one jumped", "one turned just enough"];
        needs [accepted_configuration_is_bounded];
        sampled 20_000;
    }
    property T14 broken_wheel_is_noticed_in_time(
        config: AcceptedConfig, past: (u8, [u8; 15]), beyond: u16, forward: bool, broken: (bool, [u8; 16])
    ) {
        cases [
            "as late as can be from a start", "as late as can be while driving",
            "as late as can be after anything", "it turned back", "it stood",
            "as early as can be from a start"
        ];
        needs [accepted_configuration_is_bounded];
        sampled 50_000;
    }
}
