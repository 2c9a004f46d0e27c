//! The robot's log lines, and how often each may come.

use super::supervisor::Halt;
use crate::log::{Level, Line, Log};
use crate::sensing::EchoStats;
use crate::types::{Duty, Faults, Milliseconds, RangefinderId};
use crate::wire::{FrameError, PoseCode, State};

/// Ticks without a line about rejected frames after one: a broken wire must not fill the log.
const QUIET_TICKS: u16 = 100;
/// Ticks without a limit after which the way is logged as free.
const FREE_TICKS: u8 = 100;
/// Milliseconds of a tick.
const TICK_MS: u16 = 10;
/// Consecutive misses after which a rangefinder counts as silent.
const SILENT_MISSES: u8 = 3;

/// State of the log lines. Frame-triggered lines are deferred to the next tick: a reply must be ready
/// before the next frame.
#[derive(Clone, Debug)]
pub(super) struct EventLog {
    state: State,
    /// Target not logged yet.
    target: Option<PoseCode>,
    /// Rejected frame to log in the next tick.
    rejected: Option<FrameError>,
    /// Rejected frames without a line of their own since the last line about them.
    suppressed: u32,
    /// Ticks until the next line about rejected frames.
    quiet_ticks: u16,
    /// Ticks until the way is logged as free; 0 once it is.
    until_free: u8,
    /// Ticks from one pose line to the next, 0 = none.
    pose_period: u16,
    until_pose: u16,
    /// Rangefinders logged as silent.
    silent: [bool; 3],
    /// Whether the temperature was known at its last line.
    temperature_known: Option<bool>,
}

impl EventLog {
    /// A pose line every `period`, 0 = none.
    pub(super) const fn new(period: Milliseconds) -> Self {
        Self {
            state: State::Booting,
            target: None,
            rejected: None,
            suppressed: 0,
            quiet_ticks: 0,
            until_free: 0,
            pose_period: period.0.div_ceil(TICK_MS),
            until_pose: 0,
            silent: [false; 3],
            temperature_known: None,
        }
    }

    /// Logs a rangefinder that misses three echoes in a row, and its first answer afterwards. An answer
    /// out of range is not logged.
    // Requirement: WIRE-log-9
    pub(super) fn rangefinder(&mut self, id: RangefinderId, stats: &EchoStats, log: &mut Log) {
        let Some(logged) = self.silent.get_mut(id as usize) else {
            return;
        };
        // An answer resets the misses: between two ticks no trigger ends twice.
        let silent = stats.consecutive_misses >= SILENT_MISSES;
        if silent != *logged {
            *logged = silent;
            log_rangefinder(id, stats, log);
        }
    }

    /// The first temperature, and every change between a known and an unknown one.
    // Requirement: WIRE-log-10
    pub(super) fn temperature(&mut self, air: Option<fixed::types::I16F16>, log: &mut Log) {
        if self.temperature_known.replace(air.is_some()) == Some(air.is_some()) {
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
                line.text("no temperature: sound at 343 m/s");
            }
        });
    }

    /// Once a tick: logs a change of state, the begin and the end of the obstacle stop, a rejected frame,
    /// suppressed ones, or a new target; at most one line, since a line is the longest thing that a tick
    /// does. Returns whether there was one.
    // Requirement: DOC-2.1-3
    pub(super) fn tick(&mut self, state: State, halt: Halt, obstacle: bool, log: &mut Log) -> bool {
        self.quiet_ticks = self.quiet_ticks.saturating_sub(1);
        self.until_free = match self.until_free {
            0 => 0,
            _ if obstacle => FREE_TICKS,
            ticks => (ticks - 1).max(1),
        };
        if state != self.state {
            self.state = state;
            let (level, text) = match state {
                State::Booting => (Level::Info, "booting"),
                State::Ready => (Level::Info, "ready"),
                State::Moving => (Level::Info, "moving"),
                State::Stopped if halt == Halt::Silence => {
                    (Level::Warn, "stopped: no fresh frame in time")
                }
                State::Stopped => (Level::Warn, "stopped"),
                State::Faulted => (Level::Error, "faulted: motors off"),
            };
            log.text(level, text);
        } else if obstacle && self.until_free == 0 {
            // Requirement: WIRE-obstacle-6
            self.until_free = FREE_TICKS;
            log.text(Level::Info, "obstacle: speed limited");
        } else if !obstacle && self.until_free == 1 {
            self.until_free = 0;
            log.text(Level::Info, "obstacle: way free");
        } else if let Some(error) = self.rejected.take() {
            self.quiet_ticks = QUIET_TICKS;
            log.line(Level::Warn, |line| {
                error.log(line.text("frame rejected: "));
            });
        } else if self.quiet_ticks == 0 && self.suppressed != 0 {
            let count = self.suppressed;
            log.line(Level::Warn, |line| {
                line.int(count.into()).text(" more frames rejected");
            });
            self.suppressed = 0;
            self.quiet_ticks = QUIET_TICKS;
        } else if let Some(target) = self.target.take() {
            log.line(Level::Info, |line| pose(line.text("target "), &target));
        } else {
            return false;
        }
        true
    }

    /// A rejected frame: logged in the next tick, or counted within a second of the last line.
    pub(super) fn frame_rejected(&mut self, error: FrameError) {
        if self.quiet_ticks != 0 || self.rejected.is_some() {
            self.suppressed = self.suppressed.saturating_add(1);
        } else {
            self.rejected = Some(error);
        }
    }

    /// A new target: logged in the next tick, the last of several.
    pub(super) fn target_set(&mut self, target: PoseCode) {
        self.target = Some(target);
    }

    /// Once a tick: whether a pose line is due.
    // Requirement: WIRE-platform-12
    pub(super) fn pose_due(&mut self) -> bool {
        if self.pose_period == 0 {
            return false;
        }
        self.until_pose = if self.until_pose == 0 {
            self.pose_period - 1
        } else {
            self.until_pose - 1
        };
        self.until_pose == 0
    }
}

/// Logs faults that were not latched before: those that stop the motors are errors.
pub(super) fn log_faults(new: Faults, log: &mut Log) {
    for (bit, text) in FAULT_LINES.into_iter().enumerate() {
        let fault = Faults::from_bits(1 << bit);
        if new.intersects(fault) && !text.is_empty() {
            let level = if fault.intersects(Faults::BLOCKING) {
                Level::Error
            } else {
                Level::Warn
            };
            log.text(level, text);
        }
    }
}

/// Each fault's log line by its bit, empty for none: the part of the table that the firmware needs.
#[allow(clippy::indexing_slicing, reason = "the compiler evaluates it")]
const FAULT_LINES: [&str; Faults::TABLE.len()] = {
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

#[cold]
#[inline(never)]
fn log_rangefinder(id: RangefinderId, stats: &EchoStats, log: &mut Log) {
    log.line(Level::Warn, |line| {
        line.text(id.name())
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
pub(super) fn log_tuning(duty: Duty, thousandths: i64, log: &mut Log) {
    log.line(Level::Info, |line| {
        line.text("T ")
            .decimal(duty.hundredths().into(), 2)
            .text(" ")
            .decimal(thousandths, 3);
    });
}

/// A pose line.
pub(super) fn log_pose(code: &PoseCode, log: &mut Log) {
    log.line(Level::Info, |line| pose(line.text("pose "), code));
}

/// `x y mm, rotation deg`.
fn pose(line: &mut Line, code: &PoseCode) {
    line.decimal(code.x.into(), 3)
        .text(" ")
        .decimal(code.y.into(), 3)
        .text(" mm, ")
        .decimal((i64::from(code.rotation) * 36_000) >> 15, 2)
        .text(" deg");
}

#[cfg(test)]
mod tests;
