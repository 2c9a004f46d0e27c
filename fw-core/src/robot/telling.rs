//! What the robot says in its log, and how often.

use crate::log::{Level, Line, Log};
use crate::units::Duty;
use crate::wire::{fault, FrameError, PoseCode, State};

/// Ticks without a line about rejected frames after one: a broken wire must not fill the log.
const QUIET_TICKS: u16 = 100;
/// Milliseconds of a tick.
const TICK_MS: u16 = 10;

/// What has been told, and when the next telling is due.
#[derive(Clone, Debug)]
pub(super) struct Telling {
    state: State,
    /// Rejected frames that no line has told of yet.
    untold: u32,
    /// Ticks until a line about rejected frames may come again.
    quiet: u16,
    /// Ticks from one pose line to the next, 0 = none.
    period: u16,
    until_pose: u16,
}

impl Telling {
    /// A pose line every `period` milliseconds, 0 = none.
    pub(super) const fn new(period: u16) -> Self {
        Self {
            state: State::Booting,
            untold: 0,
            quiet: 0,
            period: period.div_ceil(TICK_MS),
            until_pose: 0,
        }
    }

    /// Once a tick: a line for every change of state, and the rejected frames kept back so far.
    /// Whether there was one.
    pub(super) fn state(&mut self, state: State, faults: u16, log: &mut Log) -> bool {
        let changed = state != self.state;
        if changed {
            self.state = state;
            let (level, text) = match state {
                State::Booting => (Level::Info, "booting"),
                State::Ready => (Level::Info, "ready"),
                State::Moving => (Level::Info, "moving"),
                State::Stopped if faults & fault::LINK_LOST != 0 => {
                    (Level::Warn, "stopped: no fresh frame in time")
                }
                State::Stopped => (Level::Warn, "stopped"),
                State::Faulted => (Level::Error, "faulted: motors off"),
            };
            log.line(level, |line| {
                line.text(text);
            });
        }
        self.quiet = self.quiet.saturating_sub(1);
        if self.quiet == 0 && self.untold != 0 {
            let count = self.untold;
            log.line(Level::Warn, |line| {
                line.int(count.into()).text(" more frames rejected");
            });
            self.untold = 0;
            self.quiet = QUIET_TICKS;
            return true;
        }
        changed
    }

    /// A rejected frame: told at once, or counted while the last telling is less than a second ago.
    pub(super) fn rejected(&mut self, error: &FrameError, log: &mut Log) {
        if self.quiet != 0 {
            self.untold = self.untold.saturating_add(1);
            return;
        }
        self.quiet = QUIET_TICKS;
        log.line(Level::Warn, |line| {
            error.log(line.text("frame rejected: "));
        });
    }

    /// Once a tick: whether a pose line is due.
    pub(super) fn pose_is_due(&mut self) -> bool {
        if self.period == 0 {
            return false;
        }
        self.until_pose = if self.until_pose == 0 {
            self.period - 1
        } else {
            self.until_pose - 1
        };
        self.until_pose == 0
    }
}

/// Faults that were not latched before.
pub(super) fn faults(new: u16, log: &mut Log) {
    for (bit, level, text) in FAULTS {
        if new & bit != 0 {
            log.line(level, |line| {
                line.text(text);
            });
        }
    }
}

/// A sample of a tuning mode: duty in percent, measured degrees or millimetres in thousandths.
pub(super) fn tuning(duty: Duty, thousandths: i64, log: &mut Log) {
    log.line(Level::Info, |line| {
        line.text("T ")
            .decimal(duty.hundredths().into(), 2)
            .text(" ")
            .decimal(thousandths, 3);
    });
}

/// A pose line.
pub(super) fn pose_line(code: &PoseCode, log: &mut Log) {
    log.line(Level::Info, |line| pose(line.text("pose "), code));
}

/// `x y mm, rotation deg`.
pub(super) fn pose(line: &mut Line, code: &PoseCode) {
    line.decimal(code.x.into(), 3)
        .text(" ")
        .decimal(code.y.into(), 3)
        .text(" mm, ")
        .decimal((i64::from(code.rotation) * 36_000) >> 15, 2)
        .text(" deg");
}

/// Every fault as its line.
const FAULTS: [(u16, Level, &str); 9] = [
    (
        fault::CLOCK_FALLBACK,
        Level::Warn,
        "no crystal: running from the internal oscillator",
    ),
    (fault::BATTERY_LOW, Level::Warn, "battery low: charge it"),
    (
        fault::BATTERY_CUTOFF,
        Level::Error,
        "battery empty: motors off",
    ),
    (fault::LEFT_STALLED, Level::Error, "left wheel stalled"),
    (fault::RIGHT_STALLED, Level::Error, "right wheel stalled"),
    (fault::ENCODER_JUMP, Level::Error, "an encoder jumped"),
    (fault::LEFT_REVERSED, Level::Error, "left wheel reversed"),
    (fault::RIGHT_REVERSED, Level::Error, "right wheel reversed"),
    (fault::RESTARTED, Level::Warn, "restarted after a failure"),
];
