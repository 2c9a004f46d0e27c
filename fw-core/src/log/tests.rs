use super::*;
use std::string::{String, ToString};
use std::vec::Vec;

fn written(write: impl FnOnce(&mut Line)) -> String {
    let mut line = Line::new();
    write(&mut line);
    line.as_str().to_string()
}

/// Transmits the whole log.
pub(crate) fn transmitted<const N: usize>(log: &mut Log<N>) -> String {
    let mut text = Vec::new();
    while !log.pending().is_empty() {
        text.extend_from_slice(log.pending());
        log.sent(log.pending().len());
    }
    String::from_utf8(text).unwrap()
}

// Requirement: WIRE-log-1
#[test]
fn line_has_level_counter_text_newline() {
    let mut log: Log = Log::new();
    log.line(Level::Info, |line| _ = line.text("boot ").int(-7));
    log.line(Level::Warn, |line| _ = line.text("low"));
    log.line(Level::Error, |_| ());
    let lines = "I00000: boot -7\nW00001: low\nE00002: \n";
    assert_eq!(transmitted(&mut log), lines);
    assert_eq!(log.dropped(), 0);
}

// Requirement: WIRE-log-5
#[test]
fn counter_wraps_after_99999() {
    let mut log: Log = Log::new();
    let mut text = String::new();
    for _ in 0..=100_000 {
        log.line(Level::Info, |_| ());
        text = transmitted(&mut log);
        if log.number == 0 {
            assert_eq!(text, "I99999: \n");
        }
    }
    assert_eq!(text, "I00000: \n");
}

#[test]
fn numbers_are_formatted_as_specified() {
    type Write = fn(&mut Line);
    let cases: [(Write, &str); 20] = [
        (|line| _ = line.int(0), "0"),
        (|line| _ = line.int(-10), "-10"),
        (|line| _ = line.int(4_294_967_296), "4294967296"),
        (|line| _ = line.int(i64::MIN), "-9223372036854775808"),
        (|line| _ = line.count(4_294_967_295), "4294967295"),
        (|line| _ = line.decimal(-1234, 3), "-1.234"),
        (|line| _ = line.decimal(-34, 3), "-0.034"),
        (|line| _ = line.decimal(5, 12), "0.000000005"),
        (
            |line| _ = line.decimal(3_456_789_012_345, 6),
            "3456789.012345",
        ),
        (|line| _ = line.hex(0x1A2B, 4), "1A2B"),
        (|line| _ = line.hex(0xF, 2), "0F"),
        (|line| _ = line.hex(0xDEAD_BEEF, 12), "DEADBEEF"),
        (|line| _ = line.hex(0x1A2B, 2).hex(9, 0), "2B"),
        (|line| _ = line.fixed(I32F32::from_num(-0.0001), 3), "0.000"),
        (|line| _ = line.fixed(I32F32::from_num(0.9996), 3), "1.000"),
        (|line| _ = line.fixed(I32F32::from_num(-1.5), 0), "-2"),
        (|line| _ = line.fixed(I32F32::from_num(-0.25), 2), "-0.25"),
        (|line| _ = line.fixed(I32F32::MIN, 1), "-2147483648.0"),
        (
            |line| _ = line.fixed(I32F32::MAX, 9),
            "2147483648.000000000",
        ),
        (|line| _ = line.text("a\n\t~\u{7f} é"), "a??~? ??"),
    ];
    for (write, text) in cases {
        assert_eq!(written(write), text);
    }
}

// Requirement: WIRE-log-6
#[test]
fn text_too_long_ends_in_tilde() {
    let mut log: Log = Log::new();
    log.line(Level::Info, |line| {
        for _ in 0..100 {
            line.text("0123456789");
        }
    });
    let text = transmitted(&mut log);
    assert_eq!(text.len(), 160);
    assert!(text.ends_with("~\n"));
    // A text that just fits is left alone.
    log.line(Level::Info, |line| _ = line.text(&"x".repeat(MAX_LINE - 9)));
    let text = transmitted(&mut log);
    assert_eq!(text.len(), MAX_LINE);
    assert!(text.ends_with("xx\n"));
}

// Requirement: WIRE-log-2, WIRE-log-5
#[test]
fn dropped_lines_are_reported_when_room_returns() {
    let mut log = Log::<64>::new();
    for _ in 0..5 {
        log.line(Level::Info, |line| _ = line.text("0123456789"));
    }
    // 19 bytes each: three fit, two do not.
    assert_eq!(log.dropped(), 2);
    log.sent(5);
    // 12 bytes of room, the report needs 24: a line of 9 does not overtake it.
    log.line(Level::Info, |_| ());
    assert_eq!((log.pending().len(), log.dropped()), (52, 3));
    log.sent(19);
    let text = transmitted(&mut log);
    let end = "I00002: 0123456789\nW00006: 3 lines dropped\n";
    assert!(text.ends_with(end), "{text}");
    log.line(Level::Info, |_| ());
    assert_eq!(transmitted(&mut log), "I00007: \n");
    assert_eq!(log.dropped(), 3);
}

#[test]
fn sent_beyond_pending_counts_as_all() {
    let mut log = Log::<21>::new();
    log.line(Level::Info, |_| ());
    log.line(Level::Info, |_| ());
    log.sent(9);
    log.line(Level::Info, |_| ());
    // The third line goes on at the buffer's beginning: only its first half is pending.
    assert_eq!(log.pending(), b"I00001: \nI00");
    log.sent(usize::MAX);
    assert_eq!(transmitted(&mut log), "002: \n");
}

#[test]
fn number_beyond_line_end_ends_in_tilde() {
    for (before, written) in [(3, "123"), (2, "1~"), (1, "~"), (0, "~")] {
        let mut line = Line::new();
        line.text(&"x".repeat(Line::ROOM - before));
        line.decimal(123, 0);
        assert_eq!(line.as_bytes().len(), Line::ROOM, "{before}");
        assert!(line.as_str().ends_with(written), "{before}");
        assert_eq!(line.as_str().contains('~'), before != 3);
    }
}

// Requirement: WIRE-log-2
#[test]
fn dropped_lines_beyond_the_last_number_stay_there() {
    let mut log = Log::<24>::new();
    (log.unreported, log.dropped) = (u32::MAX, u32::MAX);
    log.line(Level::Info, |_| ());
    assert_eq!((log.unreported, log.dropped()), (u32::MAX, u32::MAX));
}
