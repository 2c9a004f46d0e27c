//! The STM's end of the link in its log: one line a second while frames come.
//!
//! `L <frames> <accepted> <lost> <missed> <gap> <worst> <behind>[ <cause> <count>]…`: counted since
//! the reset, gaps in microseconds. Frames are the sum of accepted, lost and every count, so that a
//! reader notices a corrupted digit.

use crate::log::{Level, Line, Log};
use crate::types::Micros;
use crate::wire::{Cause, LinkCounters};

/// Ticks from one line to the next.
const PERIOD: u8 = 100;

/// The longest time between two accepted frames, microseconds; `u32::MAX` for 35 minutes and more.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
struct FrameGap {
    last: Option<Micros>,
    /// Since the last line.
    recent: u32,
    /// Before that.
    worst: u32,
}

impl FrameGap {
    fn on_frame(&mut self, at: Micros) {
        if let Some(last) = self.last.replace(at) {
            let gap = at.since(last);
            if gap > self.recent {
                self.recent = gap;
            }
        }
    }

    /// Once a line: before the clock's wrap makes a long silence look short.
    fn saturate(&mut self, now: Micros) {
        // Upper bound: a frame from just after `now` would wrap to more.
        let long = 1 << 31..3 << 30;
        if self
            .last
            .is_some_and(|last| long.contains(&now.since(last)))
        {
            self.last = None;
            self.recent = u32::MAX;
        }
    }
}

/// Gaps between frames, and when the next line is due.
#[derive(Clone, Debug, Default)]
pub(super) struct LinkStats {
    gap: FrameGap,
    /// Ticks until the next line may come.
    until_line: u8,
    /// Frames in the last line.
    logged_frames: u32,
}

impl LinkStats {
    /// A frame was accepted.
    pub(super) fn on_frame(&mut self, at: Micros) {
        self.gap.on_frame(at);
    }

    /// Once a tick: logs a line where one is due, frames have come since the last, and the tick has no
    /// other line (`busy`). `numbered`: the mode's frames carry sequence numbers, so missed frames and
    /// the round trip are known.
    // Requirement: WIRE-log-3
    pub(super) fn tick(
        &mut self,
        now: Micros,
        busy: bool,
        numbered: bool,
        counters: &LinkCounters,
        log: &mut Log,
    ) {
        self.until_line = self.until_line.saturating_sub(1);
        if self.until_line == 0 && !busy {
            self.log_line(now, numbered, counters, log);
        }
    }

    #[inline(never)]
    fn log_line(&mut self, now: Micros, numbered: bool, counters: &LinkCounters, log: &mut Log) {
        self.until_line = PERIOD;
        self.gap.saturate(now);
        let frames = counters.frames();
        if frames == self.logged_frames {
            return;
        }
        self.logged_frames = frames;
        let recent = core::mem::take(&mut self.gap.recent);
        self.gap.worst = self.gap.worst.max(recent);
        log.line(Level::Info, |line| {
            line.text("L");
            for number in [frames, counters.accepted, counters.overrun] {
                column(line, number);
            }
            column_if(line, numbered, counters.missed);
            column(line, recent);
            column(line, self.gap.worst);
            column_if(line, numbered, counters.unacknowledged.into());
            for cause in Cause::ALL {
                let rejected = counters.rejected(cause);
                if rejected != 0 {
                    column(line.text(" ").text(cause.name()), rejected);
                }
            }
        });
    }
}

fn column(line: &mut Line, number: u32) {
    line.text(" ").count(number as usize);
}

fn column_if(line: &mut Line, known: bool, number: u32) {
    if known {
        column(line, number);
    } else {
        line.text(" -");
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::string::String;

    fn transmitted(log: &mut Log) -> String {
        let text = String::from_utf8(log.pending().to_vec()).unwrap();
        log.sent(text.len());
        text
    }

    fn counted(accepted: u32) -> LinkCounters {
        let mut counters = LinkCounters::default();
        counters.accepted = accepted;
        counters.missed = 2;
        counters.overrun = 1;
        counters.unacknowledged = 1;
        counters
    }

    // Requirement: WIRE-log-3
    #[test]
    fn rejected_frames_alone_are_a_line() {
        let (mut line, mut log) = (LinkStats::default(), Log::new());
        let mut counters = LinkCounters::default();
        counters.reject(Cause::Key);
        line.tick(Micros(0), false, true, &counters, &mut log);
        assert_eq!(transmitted(&mut log), "I00000: L 1 0 0 0 0 0 0 key 1\n");
    }

    // Requirement: WIRE-log-3
    #[test]
    fn link_line_once_a_second_while_frames_come() {
        let (mut line, mut log) = (LinkStats::default(), Log::new());
        let mut frames = 0;
        for tick in 0..600_u32 {
            let now = Micros(tick * 10_000).after(u32::MAX - 2_000_000);
            if tick < 150 || tick == 450 {
                line.on_frame(now);
                frames += 1;
            }
            line.tick(now, false, true, &counted(frames), &mut log);
        }
        assert_eq!(
            transmitted(&mut log),
            "I00000: L 2 1 1 2 0 0 1\nI00001: L 102 101 1 2 10000 10000 1\n\
             I00002: L 151 150 1 2 10000 10000 1\nI00003: L 152 151 1 2 3010000 3010000 1\n"
        );
    }

    // Requirement: WIRE-log-3
    #[test]
    fn link_line_waits_for_idle_tick() {
        let (mut line, mut log) = (LinkStats::default(), Log::new());
        line.tick(Micros(0), true, false, &counted(5), &mut log);
        assert_eq!(transmitted(&mut log), "");
        line.tick(Micros(10_000), false, false, &counted(5), &mut log);
        assert_eq!(transmitted(&mut log), "I00000: L 6 5 1 - 0 0 -\n");
    }

    #[test]
    fn gap_longer_than_clock_saturates() {
        let (mut line, mut log) = (LinkStats::default(), Log::new());
        line.on_frame(Micros(7));
        line.tick(Micros(7), false, true, &counted(1), &mut log);
        let hours = 3 * 3600_u64;
        for second in 0..hours {
            let now = Micros(u32::try_from((second * 1_000_000) & 0xFFFF_FFFF).unwrap());
            line.log_line(now, true, &counted(1), &mut log);
        }
        // A rejected frame ends the silence in the log, but no gap.
        let mut counters = counted(1);
        counters.reject(Cause::Stale);
        line.log_line(Micros(10_000), true, &counters, &mut log);
        assert!(transmitted(&mut log).contains("L 3 1 1 2 4294967295 4294967295 1 stale 1\n"));
        line.on_frame(Micros(20_000));
        line.log_line(Micros(30_000), true, &counted(3), &mut log);
        assert!(transmitted(&mut log).ends_with("L 4 3 1 2 0 4294967295 1\n"));
        // Rejected frames all the while do not hide the silence.
        let (mut line, mut log) = (LinkStats::default(), Log::new());
        line.on_frame(Micros(7));
        for second in 0..4_300_u32 {
            let _ = transmitted(&mut log);
            counters.reject(Cause::Stale);
            let now = Micros(second.wrapping_mul(1_000_000));
            line.log_line(now, true, &counters, &mut log);
        }
        line.on_frame(Micros(20_000));
        line.log_line(Micros(30_000), true, &counted(3), &mut log);
        assert!(transmitted(&mut log).ends_with("L 4 3 1 2 0 4294967295 1\n"));
    }

    #[test]
    fn gap_of_half_an_hour_is_measured() {
        let (mut line, mut log) = (LinkStats::default(), Log::new());
        line.on_frame(Micros(0));
        for second in 0..1_800 {
            line.log_line(Micros(second * 1_000_000), true, &counted(1), &mut log);
        }
        line.on_frame(Micros(1_800_000_000));
        line.log_line(Micros(1_800_000_000), true, &counted(2), &mut log);
        assert!(transmitted(&mut log).ends_with("L 3 2 1 2 1800000000 1800000000 1\n"));
    }

    #[test]
    fn largest_numbers_fit_one_line() {
        let mut counters = counted(u32::MAX);
        counters.overrun = u32::MAX;
        counters.missed = u32::MAX;
        counters.unacknowledged = u8::MAX;
        for cause in Cause::ALL {
            counters.reject(cause);
        }
        let (mut line, mut log) = (LinkStats::default(), Log::new());
        line.gap.recent = u32::MAX;
        line.tick(Micros(0), false, true, &counters, &mut log);
        let text = transmitted(&mut log);
        assert!(text.ends_with(" status 1 crc 1 velocity 1\n"), "{text}");
    }
}
