//! The log's queue: whatever is logged and however slowly it leaves, what leaves are whole lines,
//! numbered one after the other, and every dropped line is counted.
#![no_main]

use fw_core::log::{Level, Log, MAX_LINE};
use libfuzzer_sys::fuzz_target;
use robot_fuzz::Bytes;

const LEVELS: [Level; 3] = [Level::Info, Level::Warn, Level::Error];

fuzz_target!(|data: &[u8]| {
    let mut bytes = Bytes::new(data);
    let mut log: Log<256> = Log::new();
    let mut left = Vec::new();
    let mut logged = 0_u32;
    while bytes.more() {
        let choice = bytes.byte();
        if choice & 1 == 0 {
            let leaving = usize::from(choice >> 1);
            let pending = log.pending();
            left.extend_from_slice(&pending[..leaving.min(pending.len())]);
            log.sent(leaving);
            continue;
        }
        let text = String::from_utf8_lossy(bytes.some(usize::from(choice >> 4))).into_owned();
        let number = i64::from_le_bytes(bytes.array());
        log.line(LEVELS[usize::from(choice >> 1) % 3], |line| {
            line.text(&text).int(number).decimal(number, choice);
            line.hex(
                u32::try_from(number & 0xFFFF_FFFF).unwrap_or(0),
                choice >> 3,
            )
            .fixed(fixed(number), choice >> 4);
        });
        logged += 1;
    }
    while !log.pending().is_empty() {
        left.extend_from_slice(log.pending());
        log.sent(log.pending().len());
    }
    check(&left, logged, log.dropped());
});

fn fixed(number: i64) -> fixed_point::types::I32F32 {
    fixed_point::types::I32F32::from_bits(number)
}

fn check(left: &[u8], logged: u32, dropped: u32) {
    let text = std::str::from_utf8(left).expect("the log is ASCII");
    assert!(text.is_ascii());
    assert!(text.is_empty() || text.ends_with('\n'), "a torn last line");
    let mut reported = 0;
    let mut whole = 0;
    let mut before: Option<u32> = None;
    for line in text.lines() {
        assert!(line.len() < MAX_LINE);
        assert!(matches!(line.as_bytes()[0], b'I' | b'W' | b'E'), "{line}");
        assert_eq!(&line[6..8], ": ");
        let number: u32 = line[1..6].parse().expect("five digits");
        assert!(
            before.is_none_or(|before| number > before),
            "numbers go up: {line}"
        );
        before = Some(number);
        match line[8..]
            .strip_suffix(" lines dropped")
            .map(str::parse::<u32>)
        {
            Some(Ok(count)) if line.starts_with('W') => reported += count,
            _ => whole += 1,
        }
    }
    assert_eq!(whole + dropped, logged, "a line is gone uncounted");
    assert_eq!(reported, dropped, "a dropped line was not reported");
}
