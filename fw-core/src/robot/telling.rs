//! What the robot says in its log, and how often.

use crate::log::{Level, Line, Log};
use crate::sensing::EchoStats;
use crate::types::{Duty, Faults, RangefinderId};
use crate::wire::{FrameError, PoseCode, State};

/// Ticks without a line about rejected frames after one: a broken wire must not fill the log.
const QUIET_TICKS: u16 = 100;
/// Milliseconds of a tick.
const TICK_MS: u16 = 10;

/// Triggers in a consecutive_misses without an answer before a line says so.
const SILENT: u8 = 3;

/// What has been told, and when the next telling is due.
///
/// A frame's answer must be there before the next frame: what a frame has to tell waits for the tick.
#[derive(Clone, Debug)]
pub(super) struct Telling {
    state: State,
    /// The target that no line has told of yet.
    target: Option<PoseCode>,
    /// The rejected frame that the next tick tells of.
    rejected: Option<FrameError>,
    /// Rejected frames that no line has told of yet.
    untold: u32,
    /// Ticks until a line about rejected frames may come again.
    quiet: u16,
    /// Ticks from one pose line to the next, 0 = none.
    period: u16,
    until_pose: u16,
    /// Which rangefinders do not answer, as told.
    silent: [bool; 3],
    /// Whether the temperature was known at the last telling, if there was one.
    warm: Option<bool>,
}

impl Telling {
    /// A pose line every `period` milliseconds, 0 = none.
    pub(super) const fn new(period: u16) -> Self {
        Self {
            state: State::Booting,
            target: None,
            rejected: None,
            untold: 0,
            quiet: 0,
            period: period.div_ceil(TICK_MS),
            until_pose: 0,
            silent: [false; 3],
            warm: None,
        }
    }

    /// For every change of a stats: a line when the rangefinder does not answer three triggers in a
    /// consecutive_misses, and when it answers again. One that answers without an object in range is no matter for a
    /// line.
    // Requirement: WIRE-log-9
    pub(super) fn rangefinder(&mut self, which: RangefinderId, stats: &EchoStats, log: &mut Log) {
        let Some(told) = self.silent.get_mut(which as usize) else {
            return;
        };
        // A consecutive_misses ends at 0: between two ticks no trigger ends twice.
        let silent = stats.consecutive_misses >= SILENT;
        if silent == *told {
            return;
        }
        *told = silent;
        rangefinder(which, stats, log);
    }

    /// The first temperature, and every change between knowing one and not.
    // Requirement: WIRE-log-10
    pub(super) fn temperature(&mut self, air: Option<fixed::types::I16F16>, log: &mut Log) {
        if self.warm.replace(air.is_some()) == Some(air.is_some()) {
            return;
        }
        let level = if air.is_some() {
            Level::Info
        } else {
            Level::Warn
        };
        log.line(level, |line| match air {
            Some(air) => {
                line.text("air at ")
                    .int(air.round().to_num())
                    .text(" deg C");
            }
            None => {
                line.text("no temperature: sound taken at 343 m/s");
            }
        });
    }

    /// Once a tick: a line for a change of state, for the rejected frames kept back so far, or for a
    /// new target; one at a time, a line is the longest thing that a tick does. Whether there was one.
    // Requirement: DOC-2.1-3
    pub(super) fn state(&mut self, state: State, faults: Faults, log: &mut Log) -> bool {
        self.quiet = self.quiet.saturating_sub(1);
        if state != self.state {
            self.state = state;
            let (level, text) = match state {
                State::Booting => (Level::Info, "booting"),
                State::Ready => (Level::Info, "ready"),
                State::Moving => (Level::Info, "moving"),
                State::Stopped if faults.intersects(Faults::LINK_LOST) => {
                    (Level::Warn, "stopped: no fresh frame in time")
                }
                State::Stopped => (Level::Warn, "stopped"),
                State::Faulted => (Level::Error, "faulted: motors off"),
            };
            log.line(level, |line| {
                line.text(text);
            });
        } else if let Some(error) = self.rejected.take() {
            self.quiet = QUIET_TICKS;
            log.line(Level::Warn, |line| {
                error.log(line.text("frame rejected: "));
            });
        } else if self.quiet == 0 && self.untold != 0 {
            let count = self.untold;
            log.line(Level::Warn, |line| {
                line.int(count.into()).text(" more frames rejected");
            });
            self.untold = 0;
            self.quiet = QUIET_TICKS;
        } else if let Some(target) = self.target.take() {
            log.line(Level::Info, |line| pose(line.text("target "), &target));
        } else {
            return false;
        }
        true
    }

    /// A rejected frame: told in the next tick, or counted while the last telling is less than a
    /// second ago.
    pub(super) fn rejected(&mut self, error: FrameError) {
        if self.quiet != 0 || self.rejected.is_some() {
            self.untold = self.untold.saturating_add(1);
        } else {
            self.rejected = Some(error);
        }
    }

    /// A new target: told in the next tick, the last of several.
    pub(super) fn target(&mut self, target: PoseCode) {
        self.target = Some(target);
    }

    /// Once a tick: whether a pose line is due.
    // Requirement: WIRE-platform-12
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

/// Lines of faults that were not latched before: errors for those that stop the motors.
pub(super) fn faults(new: Faults, log: &mut Log) {
    for (bit, text) in LINES.into_iter().enumerate() {
        let fault = Faults::from_bits(1 << bit);
        if new.intersects(fault) && !text.is_empty() {
            let level = if fault.intersects(Faults::BLOCKING) {
                Level::Error
            } else {
                Level::Warn
            };
            log.line(level, |line| {
                line.text(text);
            });
        }
    }
}

/// Each fault's log line by its bit, empty for none: the part of the table that the firmware needs.
const LINES: [&str; Faults::TABLE.len()] = {
    let mut lines = [""; Faults::TABLE.len()];
    let mut bit = 0;
    while bit < lines.len() {
        if let Some(line) = Faults::TABLE[bit].log_line {
            lines[bit] = line;
        }
        bit += 1;
    }
    lines
};

/// A rangefinder that fell silent or answers again, and how its triggers ended so far.
#[cold]
#[inline(never)]
fn rangefinder(which: RangefinderId, stats: &EchoStats, log: &mut Log) {
    log.line(Level::Warn, |line| {
        line.text(which.name())
            .text(if stats.consecutive_misses > 0 {
                " rangefinder silent"
            } else {
                " rangefinder answers"
            })
            .text(": hits ")
            .int(stats.hits.into())
            .text(", out of range ")
            .int(stats.out_of_range.into())
            .text(", missing ")
            .int(stats.missing.into());
    });
}

/// A sample of a tuning mode: duty in percent, measured degrees or millimetres in thousandths.
// Requirement: DOC-5.2.2-2, DOC-5.2.3-4, WIRE-log-7, WIRE-log-8
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

#[cfg(test)]
mod tests;
