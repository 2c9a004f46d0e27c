//! Parser of the STM's log, line by line: `I00012: T 50.00 123.456`. A UART loses and corrupts bytes, so
//! any bytes are accepted and only lines of exactly the known form count.

use crate::statistics::{RejectCounts, StmStatistics};
use fw_core::types::RangefinderId;
use fw_core::wire::Cause;

/// The longest line kept, bytes; the STM's are shorter.
pub const LONGEST: usize = 256;

/// What a line of the log says.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum LogLine {
    /// A sample of a tuning mode.
    Sample {
        /// Duty, percent.
        percent: f64,
        /// Degrees or millimetres.
        value: f64,
    },
    /// `tuned tap N: upper resistor R ohm`.
    Tuned {
        /// The tap, 1 to 8.
        tap: u8,
        /// The resistor proposed, ohm.
        ohm: u32,
    },
    /// The STM's end of the link, once a second while frames come:
    /// `L <frames> <accepted> <lost> <missed> <gap> <worst> <behind>[ <cause> <count>]…`.
    Link(StmStatistics),
    /// `<front|right|left> rangefinder <silent|answers>: …`.
    Rangefinder {
        /// Which.
        which: RangefinderId,
        /// It has missed three echoes in a row; otherwise it answers again.
        silent: bool,
    },
    /// Any other line of the log.
    Other,
}

/// Splits bytes into lines, as they come.
#[derive(Clone, Debug, Default)]
pub struct Lines(Vec<u8>);

impl Lines {
    /// Takes bytes in pieces of any size; returns the lines they complete without their ends, of a line longer
    /// than [`LONGEST`] that many and one more.
    pub fn feed(&mut self, bytes: &[u8]) -> Vec<Vec<u8>> {
        let mut lines = Vec::new();
        for &byte in bytes {
            if byte == b'\n' {
                lines.push(std::mem::take(&mut self.0));
            } else if self.0.len() <= LONGEST {
                self.0.push(byte);
            }
        }
        lines
    }
}

/// Reads the log's lines.
#[derive(Clone, Debug, Default)]
pub struct LogParser(Lines);

impl LogParser {
    /// Takes bytes as they come, in pieces of any size; returns the lines of the log's form that they complete,
    /// each with the number that every line of the log takes: 0 to 99999 and again.
    pub fn feed(&mut self, bytes: &[u8]) -> Vec<(u32, LogLine)> {
        let lines = self.0.feed(bytes);
        lines.iter().filter_map(|line| parse(line)).collect()
    }
}

/// One line without its end.
fn parse(line: &[u8]) -> Option<(u32, LogLine)> {
    if line.len() > LONGEST {
        return None;
    }
    let text = std::str::from_utf8(line).ok()?;
    let text = text.strip_suffix('\r').unwrap_or(text);
    let (head, body) = text.split_once(": ")?;
    let digits = head.strip_prefix(['I', 'W', 'E'])?;
    let digits = Some(digits).filter(|digits| digits.len() == 5)?;
    Some((whole(digits)?, content(body)?))
}

/// What follows the line's number.
fn content(body: &str) -> Option<LogLine> {
    if let Some(sample) = body.strip_prefix("T ") {
        let (percent, value) = sample.split_once(' ')?;
        let percent = decimal(percent, 2).filter(|percent| percent.abs() <= 100.0)?;
        let value = decimal(value, 3)?;
        return Some(LogLine::Sample { percent, value });
    }
    if let Some(tuned) = body.strip_prefix("tuned tap ") {
        let tuned = tuned.strip_suffix(" ohm")?;
        let (tap, ohm) = tuned.split_once(": upper resistor ")?;
        let (tap, ohm) = (u8::try_from(whole(tap)?).ok()?, whole(ohm)?);
        let known = (1..=8).contains(&tap);
        return known.then_some(LogLine::Tuned { tap, ohm });
    }
    if let Some((name, rest)) = body.split_once(" rangefinder ") {
        let named = |which: &RangefinderId| which.name() == name;
        let which = RangefinderId::ALL.into_iter().find(named)?;
        let silent = rest.starts_with("silent: ");
        let known = silent || rest.starts_with("answers: ");
        return known.then_some(LogLine::Rangefinder { which, silent });
    }
    match body.strip_prefix("L ") {
        Some(counters) => link(counters).map(LogLine::Link),
        None => Some(LogLine::Other),
    }
}

/// The numbers of a link line. A lost digit is detected: the frames are the sum of the other counts.
fn link(text: &str) -> Option<StmStatistics> {
    let mut words = text.split(' ');
    let mut next = || words.next();
    let [frames, accepted, lost] = [whole(next()?)?, whole(next()?)?, whole(next()?)?];
    let missed = known(next()?).ok()?;
    let [recent_gap_us, worst_gap_us] = [whole(next()?)?, whole(next()?)?];
    let behind = known(next()?).ok()?;
    let round_trip_frames = behind.map(u8::try_from).transpose().ok()?;
    let mut causes = RejectCounts::default();
    let mut left = Cause::ALL.into_iter();
    while let Some(name) = words.next() {
        let cause = left.find(|cause| cause.name() == name)?;
        causes.set(cause, whole(words.next()?).filter(|&count| count > 0)?);
    }
    let rejected = causes.total();
    let sum = accepted.saturating_add(rejected).saturating_add(lost);
    let good = frames == sum
        && recent_gap_us <= worst_gap_us
        && missed.is_some() == round_trip_frames.is_some();
    good.then_some(StmStatistics {
        frames,
        accepted,
        rejected,
        causes,
        lost,
        missed,
        recent_gap_us,
        worst_gap_us,
        round_trip_frames,
    })
}

/// A number, or `-` where the mode does not know it; neither is an error.
fn known(text: &str) -> Result<Option<u32>, ()> {
    match whole(text) {
        None if text != "-" => Err(()),
        number => Ok(number),
    }
}

/// Digits only.
fn whole(text: &str) -> Option<u32> {
    let digits = text.bytes().all(|byte| byte.is_ascii_digit());
    text.parse().ok().filter(|_| digits)
}

/// A decimal number with exactly so many places: a torn one has fewer, two run together have more.
fn decimal(text: &str, places: usize) -> Option<f64> {
    let digits = text.strip_prefix('-').unwrap_or(text);
    let (before, after) = digits.split_once('.')?;
    let plain = |part: &str| part.bytes().all(|byte| byte.is_ascii_digit());
    let good = (1..=12).contains(&before.len()) && after.len() == places;
    let good = good && plain(before) && plain(after);
    text.parse().ok().filter(|_| good)
}

#[cfg(test)]
mod tests {
    use super::*;

    const LOG: &[u8] = b"I00007: ready\nI00008: T -50.00 -0.034\r\nI00009: T 0.00 123456.789\n\
        I00010: tuned tap 2: upper resistor 33120 ohm\nW00011: battery low: charge it\n\
        I00012: L 45 40 1 2 25013 3600000 1 stale 1 crc 3\nI00013: L 40 40 0 - 25013 25013 -\n\
        E00014: configuration rejected\nW00015: right rangefinder silent: hits 3, out of range 1, missing 3\n\
        W00016: left rangefinder answers: hits 1, out of range 0, missing 3\n";

    /// What [`LOG`] says; and the statistics of its line 12.
    fn lines() -> (Vec<(u32, LogLine)>, StmStatistics) {
        let mut causes = RejectCounts::default();
        causes.set(Cause::Stale, 1);
        causes.set(Cause::Crc, 3);
        let disturbed = StmStatistics {
            frames: 45,
            accepted: 40,
            rejected: 4,
            causes,
            lost: 1,
            missed: Some(2),
            recent_gap_us: 25_013,
            worst_gap_us: 3_600_000,
            round_trip_frames: Some(1),
        };
        let good = StmStatistics {
            frames: 40,
            accepted: 40,
            recent_gap_us: 25_013,
            worst_gap_us: 25_013,
            ..StmStatistics::default()
        };
        let sample = |percent, value| LogLine::Sample { percent, value };
        let rangefinder = |which, silent| LogLine::Rangefinder { which, silent };
        let (tap, ohm) = (2, 33_120);
        let lines = vec![
            (7, LogLine::Other),
            (8, sample(-50.0, -0.034)),
            (9, sample(0.0, 123_456.789)),
            (10, LogLine::Tuned { tap, ohm }),
            (11, LogLine::Other),
            (12, LogLine::Link(disturbed)),
            (13, LogLine::Link(good)),
            (14, LogLine::Other),
            (15, rangefinder(RangefinderId::Right, true)),
            (16, rangefinder(RangefinderId::Left, false)),
        ];
        (lines, disturbed)
    }

    /// What is read of a line without each of its stretches of bytes.
    fn read_torn(line: &[u8]) -> impl Iterator<Item = (u32, LogLine)> + '_ {
        let stretches =
            (0..line.len() - 1).flat_map(|from| (from + 1..line.len()).map(move |to| (from, to)));
        stretches.flat_map(|(from, to)| {
            LogParser::default().feed(&[&line[..from], &line[to..]].concat())
        })
    }

    // Requirement: WIRE-log-3
    #[test]
    fn link_line_with_lost_bytes_never_miscounts() {
        let counts = |link: StmStatistics| (link.frames, link.accepted, link.lost, link.causes);
        let good = counts(lines().1);
        for (_, read) in read_torn(b"I00012: L 45 40 1 2 25013 3600000 1 stale 1 crc 3\n") {
            if let LogLine::Link(link) = read {
                assert_eq!(counts(link), good);
            }
        }
        for wrong in [
            "I00012: L 45 40 1 2 3600001 3600000 1 stale 1 crc 3",
            "I00012: L 45 40 1 - 25013 3600000 1 stale 1 crc 3",
            "I00012: L 45 40 1 x 25013 3600000 x stale 1 crc 3",
            "I00012: L 45 40 1 2 25013 3600000 256 stale 1 crc 3",
            "I00012: L 45 40 1 2 25013 3600000 1 crc 3 stale 1",
            "I00012: L 45 40 1 2 25013 3600000 1 stale 1 stale 1 crc 2",
            "I00012: L 41 40 1 2 25013 3600000 1 crc 0",
            "I00012: L 42 40 1 2 25013 3600000 1 noise 1",
            "I000012: L 45 40 1 2 25013 3600000 1 stale 1 crc 3",
            // Two lines in one.
            "I00001: T 50.00 1.2I00002: T 50.00 3.400",
            "I00001: T 50.00 1.200I00002: T 50.00 3.400",
        ] {
            let mut lines = LogParser::default();
            assert_eq!(lines.feed(format!("{wrong}\n").as_bytes()), [], "{wrong}");
        }
    }

    #[test]
    fn log_in_pieces_of_any_size_reads_same() {
        for size in 1..LOG.len() {
            let mut parser = LogParser::default();
            let read = LOG.chunks(size).flat_map(|part| parser.feed(part));
            assert!(read.eq(lines().0));
        }
    }

    #[test]
    fn lost_bytes_never_make_another_sample() {
        // A number may lose a digit unseen before its point; everything else must be noticed.
        let percents = [-5.0, 0.0, 50.0, 5.0, -0.0];
        let mut digits = percents.map(|percent| (percent, -0.034)).to_vec();
        digits.push((-50.0, 0.034));
        for (number, read) in read_torn(b"I00008: T -50.00 -0.034\n") {
            if let LogLine::Sample { percent, value } = read {
                assert!(
                    number == 8 && digits.contains(&(percent, value)),
                    "{read:?}"
                );
            }
        }
    }

    #[test]
    fn line_after_noise_is_read() {
        let (mut state, expected) = (1_u32, lines().0);
        let mut byte = || {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            // Half noise, half the alphabet of the log.
            let byte = state.to_be_bytes()[0];
            let letter = LOG[usize::from(byte) % LOG.len()];
            [byte, letter][usize::from(byte & 1)]
        };
        let mut parser = LogParser::default();
        for _ in 0..2000 {
            let noise: Vec<u8> = (0..300).map(|_| byte()).collect();
            parser.feed(&noise);
            parser.feed(b"\n");
            assert_eq!(parser.feed(LOG), expected);
        }
    }

    #[test]
    fn numbers_beyond_what_the_stm_writes_are_no_lines() {
        let is_read = |body: &str| content(body).is_some();
        for (tap, good) in [(0, false), (1, true), (8, true), (9, false)] {
            assert_eq!(
                is_read(&format!("tuned tap {tap}: upper resistor 1 ohm")),
                good
            );
        }
        assert!(is_read("T 0.00 -123456789012.345") && !is_read("T 0.00 1234567890123.345"));
        assert!(!is_read("tuned tap 1: upper resistor +1 ohm"));
        assert!(!is_read("rear rangefinder silent: hits 1") && !is_read("left rangefinder is"));
        assert!(is_read("T 100.00 0.000") && !is_read("T 100.01 0.000"));
    }

    #[test]
    fn endless_line_takes_no_memory() {
        let mut parser = LogParser::default();
        for _ in 0..1000 {
            parser.feed(&[b'I'; 1000]);
        }
        assert!(parser.0.0.len() <= LONGEST + 1);
        assert_eq!(parser.feed(b"\nI00001: x\n"), [(1, LogLine::Other)]);
        for (len, lines) in [(LONGEST, 1), (LONGEST + 1, 0)] {
            let line = format!("I00001: {:x<1$}\n", "", len - 8);
            assert_eq!(parser.feed(line.as_bytes()).len(), lines, "{len}");
        }
    }
}
