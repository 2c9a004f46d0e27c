//! T13: the log's queue never tears a line, never waits, and counts what it drops.

use fw_core::log::{Level, Log};

use crate::property::Seen;

/// Bytes of the queue in these properties: four short lines.
pub const QUEUE: usize = 40;

/// What the far end of the UART makes of the bytes: whole lines, their numbers, and what was reported
/// as dropped.
#[derive(Clone, Debug, Default)]
struct Reader {
    line: Vec<u8>,
    /// Whole lines of ours.
    lines: u32,
    /// Lines reported as dropped.
    reported: u32,
    /// The number that the next line must at least have.
    next: u32,
}

/// A decimal number, all of it digits.
fn decimal(digits: &[u8]) -> u32 {
    digits.iter().fold(0, |number, digit| {
        assert!(digit.is_ascii_digit());
        number * 10 + u32::from(digit - b'0')
    })
}

impl Reader {
    fn read(&mut self, bytes: &[u8]) {
        for &byte in bytes {
            if byte == b'\n' {
                self.whole_line();
                self.line.clear();
            } else {
                self.line.push(byte);
            }
        }
    }

    fn whole_line(&mut self) {
        let line = &self.line;
        assert!(line.len() >= 8 && line[6..8] == *b": ");
        let number = decimal(&line[1..6]);
        // Every line has a number, dropped ones too: a gap is what was lost.
        assert!(number >= self.next);
        self.next = number + 1;
        let text = &line[8..];
        if line[0] == b'W' {
            let count = text.strip_suffix(b" lines dropped");
            assert!(count.is_some());
            self.reported += decimal(count.unwrap_or_default());
        } else {
            assert!(line[0] == b'I');
            // A text is as many letters as its first letter says.
            let length = text.first().map_or(0, |first| first - b'a' + 1);
            assert!(
                text.len() == usize::from(length) && text.iter().all(|&letter| letter == text[0])
            );
            self.lines += 1;
        }
    }
}

/// What a script's byte means: a line of some letters, or some bytes leaving.
fn event(byte: u8) -> Result<usize, usize> {
    match byte % 6 {
        0 => Ok(0),
        1 => Ok(3),
        2 => Ok(24),
        3 => Err(1),
        4 => Err(9),
        _ => Err(usize::MAX),
    }
}

/// Any order of lines and transmissions: the far end reads whole lines only, in order, and their number
/// with those reported as dropped is that of all lines; what is pending never moves under the
/// transmitter.
// Requirement: WIRE-log-2
pub fn log_never_tears_a_line(script: [u8; 24]) -> Seen {
    let mut log = Log::<QUEUE>::new();
    let mut reader = Reader::default();
    let mut written = 0_u32;
    for byte in script {
        match event(byte) {
            Ok(length) => {
                let before = *log.pending().first_chunk::<1>().unwrap_or(&[0]);
                let pending = log.pending().len();
                let text = ["", "ccc", "xxxxxxxxxxxxxxxxxxxxxxxx"];
                let text = text.iter().find(|text| text.len() == length);
                log.line(Level::Info, |line| {
                    line.text(text.copied().unwrap_or_default());
                });
                written += 1;
                assert!(log.pending().len() >= pending);
                assert!(pending == 0 || log.pending()[0] == before[0]);
            }
            Err(bytes) => {
                let count = bytes.min(log.pending().len());
                reader.read(&log.pending()[..count]);
                log.sent(bytes);
            }
        }
        assert!(log.pending().len() <= QUEUE);
    }
    let dropped = log.dropped();
    // Twice the ring and the report of what was dropped: then all is out.
    for _ in 0..4 {
        let count = log.pending().len();
        reader.read(log.pending());
        log.sent(count);
    }
    assert!(log.pending().is_empty() && reader.line.is_empty());
    assert!(reader.lines + log.dropped() == written);
    assert!(reader.reported == log.dropped() && log.dropped() == dropped);
    seen!(dropped > 0, dropped == 0, reader.lines > 4)
}

/// Three lines into a queue for two, any number of bytes leaving in between: nothing overflows, what
/// is queued fits, and what does not fit is counted.
pub fn three_lines_fit_or_are_counted(sent: [u8; 2]) -> Seen {
    let mut log = Log::<24>::new();
    log.line(Level::Info, |_| {});
    log.sent(usize::from(sent[0]));
    log.line(Level::Warn, |_| {});
    log.sent(usize::from(sent[1]));
    log.line(Level::Error, |_| {});
    assert!(log.pending().len() <= 24 && log.dropped() <= 1);
    seen!(log.dropped() == 0, log.dropped() == 1)
}

/// What the lines of [`line_leaves_as_it_entered`] are filled with.
const LETTERS: &str = "xxxxxxxxxxxxxxx";

/// So many of them.
fn letters(count: usize) -> &'static str {
    LETTERS.get(..count).unwrap_or_default()
}

/// A line with `first` letters passes through a queue of 24 bytes, so that the next byte has another
/// place for every count. Then come a line of 11 bytes with the last two digits of a number, `digits`, and one
/// of 14 for which there is no room. What the far end reads.
fn through_the_ring(first: usize, digits: u8) -> [u8; 35] {
    let mut log = Log::<24>::new();
    log.line(Level::Info, |line| {
        line.text(letters(first));
    });
    assert!(log.pending().len() == 9 + first);
    log.sent(9 + first);
    assert!(log.pending().is_empty());
    log.line(Level::Error, |line| {
        line.hex(0x9876_5400 | u32::from(digits), 2);
    });
    assert!(log.dropped() == 0);
    log.line(Level::Info, |line| {
        line.text(letters(5));
    });
    assert!(log.dropped() == 1);
    let mut read = [0; 35];
    let mut at = 0;
    // To the buffer's end, from its beginning, and the same for the report of the line dropped.
    for _ in 0..4 {
        let count = log.pending().len();
        read[at..at + count].copy_from_slice(log.pending());
        at += count;
        log.sent(count);
    }
    assert!(at == 35 && log.pending().is_empty() && log.dropped() == 1);
    read
}

/// Wherever the ring wraps, what leaves is what was written, byte by byte; then the line for which there
/// was no room is counted.
// Requirement: WIRE-log-2
pub fn line_leaves_as_it_entered(first: u8, digits: u8) -> Seen {
    const WRITTEN: &[u8; 35] = b"E00001: --\nW00003: 1 lines dropped\n";
    let first = usize::from(first);
    given!(first <= LETTERS.len());
    let read = through_the_ring(first, digits);
    for (place, (&read, &written)) in read.iter().zip(WRITTEN).enumerate() {
        let digit = match place {
            8 => digits >> 4,
            9 => digits & 0xF,
            _ => {
                assert!(read == written);
                continue;
            }
        };
        assert!(Some(&read) == b"0123456789ABCDEF".get(usize::from(digit)));
    }
    Seen::NOTHING
        .case(0, read[8] == b'0' && read[9] == b'F')
        .case(1, read[8] == b'A' && read[9] == b'9')
}

/// Every script of `length` events.
#[cfg(test)]
fn scripts(length: u32) -> impl Iterator<Item = ([u8; 24],)> {
    (0..6_u32.pow(length)).map(move |mut number| {
        let mut script = [5; 24];
        for event in script.iter_mut().take(length as usize) {
            *event = (number % 6) as u8;
            number /= 6;
        }
        (script,)
    })
}

crate::properties! {
    property T13 log_never_tears_a_line(script: [u8; 24]) {
        cases ["lines were dropped", "none were", "many went through"];
        stepped scripts(7);
        sampled 100_000;
    }
    theorem T13 line_leaves_as_it_entered(first: u8, digits: u8) {
        cases ["0F", "A9"];
        kani wrapped_between_digits [unwind(37)] = (6, any());
        kani wrapped_behind_the_line [unwind(37)] = (4, any());
        exhaustive (0..16).flat_map(|first| (0..=255).map(move |digits| (first, digits)));
    }
    theorem T13 three_lines_fit_or_are_counted(sent: [u8; 2]) {
        cases ["all fit", "one was dropped"];
        exhaustive (0..=u16::MAX).map(|sent| (sent.to_le_bytes(),));
    }
}
