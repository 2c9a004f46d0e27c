use super::*;
use proptest::prelude::*;
use std::string::{String, ToString};
use std::vec::Vec;

fn written(write: impl FnOnce(&mut Line)) -> String {
    let mut line = Line::new();
    write(&mut line);
    line.as_str().to_string()
}

/// Everything that a log has to say, transmitted.
pub(crate) fn transmitted<const N: usize>(log: &mut Log<N>) -> String {
    let mut text = Vec::new();
    while !log.pending().is_empty() {
        text.extend_from_slice(log.pending());
        log.sent(log.pending().len());
        // What was dropped is said at the end, once.
        assert!(text.len() <= N + MAX_LINE, "it says more than it holds");
    }
    String::from_utf8(text).unwrap()
}

// Requirement: WIRE-log-1
#[test]
fn a_line_is_level_counter_text_and_newline() {
    let mut log: Log = Log::new();
    log.line(Level::Info, |line| {
        line.text("boot ").int(-7);
    });
    log.line(Level::Warn, |line| {
        line.text("low");
    });
    log.line(Level::Error, |_| ());
    assert_eq!(
        transmitted(&mut log),
        "I00000: boot -7\nW00001: low\nE00002: \n"
    );
    assert_eq!(log.dropped(), 0);
}

// Requirement: WIRE-log-5
#[test]
fn the_counter_wraps_after_99999() {
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
fn numbers_read_as_they_are_written_elsewhere() {
    for value in [
        0,
        1,
        -1,
        9,
        10,
        4_294_967_295,
        4_294_967_296,
        i64::MAX,
        i64::MIN,
    ] {
        assert_eq!(written(|line| _ = line.int(value)), value.to_string());
    }
    assert_eq!(
        written(|line| _ = line.count(usize::MAX)),
        usize::MAX.to_string()
    );
    assert_eq!(written(|line| _ = line.decimal(-1234, 3)), "-1.234");
    assert_eq!(written(|line| _ = line.decimal(-34, 3)), "-0.034");
    assert_eq!(written(|line| _ = line.decimal(5, 12)), "0.000000005");
    assert_eq!(
        written(|line| _ = line.decimal(123_456_789_012_345, 6)),
        "123456789.012345"
    );
    assert_eq!(
        written(|line| _ = line.hex(0x1A2B, 4).hex(0xF, 2).hex(0xDEAD_BEEF, 12)),
        "1A2B0FDEADBEEF"
    );
    assert_eq!(written(|line| _ = line.hex(0x1A2B, 2).hex(9, 0)), "2B");
}

#[test]
fn fixed_point_rounds_and_carries() {
    let text = |value, decimals| written(|line| _ = line.fixed(I32F32::from_num(value), decimals));
    assert_eq!(text(0.0, 3), "0.000");
    assert_eq!(text(-0.0001, 3), "0.000");
    assert_eq!(text(0.9996, 3), "1.000");
    assert_eq!(text(-1.5, 0), "-2");
    assert_eq!(text(106.72, 2), "106.72");
    assert_eq!(text(-0.25, 2), "-0.25");
    assert_eq!(
        written(|line| _ = line.fixed(I32F32::MIN, 1)),
        "-2147483648.0"
    );
    assert_eq!(
        written(|line| _ = line.fixed(I32F32::MAX, 9)),
        "2147483648.000000000"
    );
}

#[test]
fn what_is_not_printable_ascii_becomes_a_question_mark() {
    assert_eq!(written(|line| _ = line.text("a\n\t~\u{7f} é")), "a??~? ??");
}

// Requirement: WIRE-log-6
#[test]
fn a_text_too_long_ends_in_a_tilde_and_the_line_in_a_newline() {
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
    log.line(Level::Info, |line| {
        for _ in 0..MAX_LINE - 9 {
            line.text("x");
        }
    });
    let text = transmitted(&mut log);
    assert_eq!(text.len(), MAX_LINE);
    assert!(text.ends_with("xx\n"));
}

// Requirement: WIRE-log-2, WIRE-log-5
#[test]
fn dropped_lines_are_counted_and_said_as_soon_as_there_is_room() {
    let mut log = Log::<64>::new();
    for _ in 0..5 {
        log.line(Level::Info, |line| {
            line.text("0123456789");
        });
    }
    // 19 bytes each: three fit, two do not.
    assert_eq!(log.dropped(), 2);
    log.sent(5);
    // 12 bytes of room, the report needs 24.
    assert_eq!(log.pending().len(), 52);
    log.sent(19);
    let text = transmitted(&mut log);
    assert!(
        text.ends_with("I00002: 0123456789\nW00005: 2 lines dropped\n"),
        "{text}"
    );
    log.line(Level::Info, |_| ());
    assert_eq!(transmitted(&mut log), "I00006: \n");
    assert_eq!(log.dropped(), 2);
}

#[test]
fn a_line_that_just_fits_is_taken() {
    let mut log = Log::<18>::new();
    log.line(Level::Info, |_| ());
    log.line(Level::Info, |_| ());
    assert_eq!((log.pending().len(), log.dropped()), (18, 0));
}

#[test]
fn more_than_is_pending_cannot_be_sent() {
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
fn a_log_without_room_drops_everything() {
    let mut log = Log::<0>::new();
    log.line(Level::Error, |line| _ = line.text("nobody hears"));
    log.sent(9);
    assert_eq!((log.pending().len(), log.dropped()), (0, 1));
}

/// What happens to a log: a line of so many characters, or so many bytes transmitted.
#[derive(Clone, Debug)]
enum Event {
    Line(usize),
    Sent(usize),
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(5_000))]

    #[test]
    fn no_line_is_torn_and_every_missing_number_was_dropped(
        events in prop::collection::vec(
            prop_oneof![
                (0_usize..40).prop_map(Event::Line),
                (0_usize..60).prop_map(Event::Sent),
            ],
            0..200,
        ),
    ) {
        let mut log = Log::<97>::new();
        let mut text = String::new();
        for event in events {
            let owned = log.pending().to_vec();
            let place = log.pending().as_ptr();
            match event {
                Event::Line(len) => {
                    log.line(Level::Info, |line| _ = line.text(&"abcdefghij".repeat(4)[..len]));
                    // Whoever transmits has seen these bytes at this place.
                    prop_assert!(log.pending().starts_with(&owned));
                    prop_assert!(owned.is_empty() || log.pending().as_ptr() == place);
                }
                Event::Sent(count) => {
                    let count = count.min(owned.len());
                    text += core::str::from_utf8(&owned[..count]).unwrap();
                    log.sent(count);
                }
            }
            prop_assert!(log.len <= 97 && log.start < 97);
        }
        text += &transmitted(&mut log);
        let mut next = 0;
        let mut reported = 0;
        let mut missing = 0;
        for line in text.lines() {
            let (head, body) = line.split_once(": ").unwrap();
            let number: u32 = head[1..].parse().unwrap();
            prop_assert!(number >= next);
            missing += number - next;
            next = number + 1;
            if let Some(count) = body.strip_suffix(" lines dropped") {
                prop_assert_eq!(&head[..1], "W");
                reported += count.parse::<u32>().unwrap();
                // Said before anything later is.
                prop_assert_eq!(reported, missing);
            } else {
                prop_assert_eq!(&head[..1], "I");
                // Nothing overtakes the report of what was dropped before it.
                prop_assert_eq!(reported, missing);
                prop_assert!("abcdefghij".repeat(4).starts_with(body));
            }
        }
        prop_assert!(text.is_empty() || text.ends_with('\n'));
        prop_assert_eq!(reported, log.dropped());
        prop_assert_eq!(missing, log.dropped());
    }
}

#[test]
fn a_number_too_long_for_its_line_ends_in_a_tilde_too() {
    for (before, written) in [(3, "123"), (2, "1~"), (1, "~"), (0, "~")] {
        let mut line = Line::new();
        for _ in before..Line::ROOM {
            line.text("x");
        }
        line.decimal(123, 0);
        assert_eq!(line.as_bytes().len(), Line::ROOM, "{before}");
        assert!(
            line.as_str().ends_with(written),
            "{before}: {}",
            line.as_str()
        );
        assert_eq!(line.as_str().contains('~'), before != 3);
    }
}
