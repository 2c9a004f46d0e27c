//! The log's samples on one time base. The STM writes one line a tick; gaps in the line numbers count
//! the lost lines.

use host_link::log::{LogLine, LogParser};

/// Seconds from one sample to the next.
pub const TICK_S: f64 = 0.01;

/// A longer gap means a malformed number or a restarted STM, not lost lines.
const LONGEST_GAP: u32 = 500;

/// Line numbers wrap here.
const NUMBERS: u32 = 100_000;

/// One sample.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sample {
    /// Ticks of 10 ms since the record's first sample.
    pub tick: u32,
    /// Duty, percent.
    pub percent: f64,
    /// Degrees or millimetres.
    pub value: f64,
}

impl Sample {
    /// Seconds since the record's first sample.
    pub fn seconds(&self) -> f64 {
        f64::from(self.tick) * TICK_S
    }
}

/// What was recorded.
#[derive(Clone, Debug, Default)]
pub struct SampleRecorder {
    lines: LogParser,
    last: Option<u32>,
    tick: u32,
    samples: Vec<Sample>,
    lost: u32,
}

impl SampleRecorder {
    /// Takes bytes of the log.
    pub fn feed(&mut self, bytes: &[u8]) {
        for (number, line) in self.lines.feed(bytes) {
            self.take(number, &line);
        }
    }

    fn take(&mut self, number: u32, line: &LogLine) {
        if let Some(last) = self.last.replace(number) {
            let gap = (number + NUMBERS - last - 1) % NUMBERS;
            if gap <= LONGEST_GAP {
                // What was lost is nearly always a sample: that is what the log consists of.
                self.tick = self.tick.saturating_add(gap);
                self.lost = self.lost.saturating_add(gap);
            }
        }
        if let LogLine::Sample { percent, value } = *line {
            if self.samples.is_empty() {
                (self.tick, self.lost) = (0, 0);
            } else {
                self.tick = self.tick.saturating_add(1);
            }
            self.samples.push(Sample {
                tick: self.tick,
                percent,
                value,
            });
        }
    }

    /// The samples so far.
    pub fn samples(&self) -> &[Sample] {
        &self.samples
    }

    /// Lines lost since the first sample.
    pub const fn lost(&self) -> u32 {
        self.lost
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tune::{Axis, export};

    #[test]
    fn lost_lines_keep_sample_times() {
        let mut recorder = SampleRecorder::default();
        recorder.feed(
            b"I99990: T 0.00 0.000\nI99997: T 0.00 0.000\nI99998: ready\nI99999: T 50.00 0.000\n\
              I000x0: T 50.00 1.000\nI00001: T 50.00 2.000\nI40000: T 50.00 3.000\nI00003: T 50.00 4.000\n",
        );
        let ticks = recorder.samples().iter().map(|sample| sample.tick);
        let ticks: Vec<u32> = ticks.collect();
        assert_eq!(ticks, [0, 7, 8, 10, 11, 12]);
        assert_eq!(recorder.lost(), 7);
        let csv = export::csv(Axis::Move, &recorder.samples()[2..3]);
        assert_eq!(csv, "seconds,percent,mm\n0.08,50.00,0.000\n");
    }
}
