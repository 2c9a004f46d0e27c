//! T1: parsing is total, and takes exactly the frames of the byte tables.

use fw_core::wire::crc::crc16;
use fw_core::wire::strategy::Context;
use fw_core::wire::{FrameError, Mode, Reason, parse_command, parse_report};

use super::table::{
    Frame, command_is_right, command_says, is_fresh, report_is_right, report_says, table, word,
};
use crate::property::Seen;

/// In a mode without guard the STM takes a frame of the Pi exactly when the table allows it, and
/// understands by it what the table says.
// Requirement: DOC-5.1-2, DOC-5.1-3
pub fn command_follows_the_table(mode: Mode, context: Context, frame: Frame) -> Seen {
    let table = table(mode);
    given!(!table.guarded);
    let right = command_is_right(mode, &context, &frame);
    let parsed = parse_command(mode, &context, &frame[..table.len], 0);
    if let Ok(command) = &parsed {
        assert!(command_says(mode, &frame, command));
    }
    assert!(parsed.is_ok() == right);
    Seen::NOTHING
        .case(0, right)
        .case(1, frame[0] != context.key_from_pi)
        .case(2, frame[table.battery] >> 5 >= context.cells)
}

/// In a mode without guard the Pi takes a frame of the STM exactly when the table allows it, and
/// understands by it what the table says.
// Requirement: DOC-5.1-2, DOC-5.1-3
pub fn report_follows_the_table(mode: Mode, context: Context, frame: Frame) -> Seen {
    let table = table(mode);
    given!(!table.guarded);
    let right = report_is_right(mode, &context, &frame);
    let parsed = parse_report(mode, &context, &frame[..table.len], 0);
    if let Ok(report) = &parsed {
        assert!(report_says(mode, &frame, report));
    }
    assert!(parsed.is_ok() == right);
    Seen::NOTHING
        .case(0, right)
        .case(1, frame[0] != context.key_from_stm)
        .case(2, frame[table.battery] >> 5 >= context.cells)
}

/// What must hold of a guarded frame whatever end parses it: taken if and only if all is right and the
/// checksum too, and rejected by the checksum if and only if it alone is wrong.
fn guarded_verdict<T>(parsed: &Result<T, FrameError>, right: bool, frame: &Frame, mode: Mode) {
    let at = table(mode).len - 2;
    let (expected, found) = (crc16(&frame[..at]), word(frame, at));
    assert!(parsed.is_ok() == (right && found == expected));
    if let Err(error) = parsed {
        let by_checksum = error.reason == Reason::Crc { expected, found };
        assert!(by_checksum == right && (!right || usize::from(error.offset) == at));
    }
}

/// In a guarded mode the STM takes a frame of the Pi exactly when the table allows it and its checksum
/// is right, and understands by it what the table says.
pub fn guarded_command_follows_the_table(mode: Mode, context: Context, frame: Frame) -> Seen {
    let table = table(mode);
    given!(table.guarded);
    let right = command_is_right(mode, &context, &frame);
    let parsed = parse_command(mode, &context, &frame[..table.len], 0);
    guarded_verdict(&parsed, right, &frame, mode);
    if let Ok(command) = &parsed {
        assert!(command_says(mode, &frame, command));
    }
    Seen::NOTHING
        .case(0, right)
        .case(1, frame[0] != context.key_from_pi)
        .case(2, !is_fresh(context.last, frame[1]))
        .case(3, frame[5] > 2)
        .case(4, right && parsed.is_err())
}

/// In a guarded mode the Pi takes a frame of the STM exactly when the table allows it and its checksum
/// is right, and understands by it what the table says.
pub fn guarded_report_follows_the_table(mode: Mode, context: Context, frame: Frame) -> Seen {
    let table = table(mode);
    given!(table.guarded);
    let right = report_is_right(mode, &context, &frame);
    let parsed = parse_report(mode, &context, &frame[..table.len], 0);
    guarded_verdict(&parsed, right, &frame, mode);
    if let Ok(report) = &parsed {
        assert!(report_says(mode, &frame, report));
    }
    Seen::NOTHING
        .case(0, right)
        .case(1, frame[0] != context.key_from_stm)
        .case(2, !is_fresh(context.last, frame[1]))
        .case(3, frame[5] & 0x3F > 4)
        .case(4, right && frame[5] > 4)
        .case(5, right && parsed.is_err())
}

/// Room for a frame longer than any mode's.
pub const LONGER: usize = 33;

/// A frame that is not exactly as long as its mode's is rejected at both ends, whatever its checksum: short,
/// long within the buffer, or with bytes beyond it. It has `extra` bytes more than the mode's, modulo 256.
// Requirement: DOC-5.1.5-1
pub fn odd_length_is_rejected(
    mode: Mode,
    context: Context,
    frame: [u8; LONGER],
    extra: [u8; 3],
    beyond: u16,
) -> Seen {
    let (whole, beyond) = (table(mode).len, usize::from(beyond));
    let mut seen = Seen::NOTHING;
    // Of constant lengths CBMC knows where each field is.
    for len in extra.map(|extra| (whole + usize::from(extra)) % 256) {
        if len <= LONGER && (len != whole || beyond != 0) {
            assert!(parse_command(mode, &context, &frame[..len], beyond).is_err());
            assert!(parse_report(mode, &context, &frame[..len], beyond).is_err());
            seen = seen.and(seen!(len < whole, len > whole, len == whole));
        }
    }
    seen
}

/// Every mode with every length, the rest zeros, and a checksum that is right for this length.
#[cfg(test)]
fn lengths() -> impl Iterator<Item = (Mode, Context, [u8; LONGER], [u8; 3], u16)> {
    let context = Context {
        key_from_pi: 0,
        key_from_stm: 0,
        cells: 1,
        own: 0,
        last: None,
    };
    Mode::ALL.iter().flat_map(move |&mode| {
        (0..=u8::MAX).flat_map(move |extra| {
            let mut frame = [0; LONGER];
            let bytes = frame.get_mut(..(table(mode).len + usize::from(extra)) % 256);
            if let Some((body, sum)) = bytes.and_then(<[u8]>::split_last_chunk_mut) {
                *sum = crc16(body).to_be_bytes();
            }
            [0, 1, u16::MAX].map(move |beyond| (mode, context, frame, [extra; 3], beyond))
        })
    })
}

crate::properties! {
    theorem T1 command_follows_the_table(mode: Mode, context: Context, frame: Frame) {
        cases ["taken", "wrong key", "a cell that is not configured"];
        kani normal [unwind(12)] = (Mode::Normal, any(), any());
        kani tune_rotate [unwind(12)] = (Mode::TuneRotate, any(), any());
        kani tune_move [unwind(12)] = (Mode::TuneMove, any(), any());
        sampled 200_000;
    }
    theorem T1 report_follows_the_table(mode: Mode, context: Context, frame: Frame) {
        cases ["taken", "wrong key", "a cell that is not configured"];
        kani normal [unwind(12)] = (Mode::Normal, any(), any());
        kani tune_rotate [unwind(12)] = (Mode::TuneRotate, any(), any());
        kani tune_move [unwind(12)] = (Mode::TuneMove, any(), any());
        sampled 200_000;
    }
    theorem T1 guarded_command_follows_the_table(mode: Mode, context: Context, frame: Frame) {
        cases ["right but perhaps for its checksum", "wrong key", "stale", "no such order", "wrong checksum"];
        needs [checksum_is_the_catalogues];
        kani normal [unwind(12)] = (Mode::GuardedNormal, any(), any());
        kani tune_rotate [unwind(12)] = (Mode::GuardedTuneRotate, any(), any());
        kani tune_move [unwind(12)] = (Mode::GuardedTuneMove, any(), any());
        kani sweep [unwind(12)] = (Mode::GuardedSweep, any(), any());
        kani velocity [unwind(12)] = (Mode::GuardedVelocity, any(), any());
        sampled 200_000;
    }
    theorem T1 guarded_report_follows_the_table(mode: Mode, context: Context, frame: Frame) {
        cases ["right but perhaps for its checksum", "wrong key", "stale", "no such state",
            "limited or clipped", "wrong checksum"];
        needs [checksum_is_the_catalogues];
        kani normal [unwind(12)] = (Mode::GuardedNormal, any(), any());
        kani tune_rotate [unwind(12)] = (Mode::GuardedTuneRotate, any(), any());
        kani tune_move [unwind(12)] = (Mode::GuardedTuneMove, any(), any());
        kani sweep [unwind(12)] = (Mode::GuardedSweep, any(), any());
        kani velocity [unwind(12)] = (Mode::GuardedVelocity, any(), any());
        sampled 200_000;
    }
    property T1 odd_length_is_rejected(
        mode: Mode, context: Context, frame: [u8; LONGER], extra: [u8; 3], beyond: u16
    ) {
        cases ["short", "long in the buffer", "long beyond it"];
        kani normal [unwind(12), solver(minisat)] = (Mode::Normal, any(), any(), [255, 0, 1], any());
        kani tune_rotate [unwind(12), solver(minisat)] = (Mode::TuneRotate, any(), any(), [255, 0, 1], any());
        kani tune_move [unwind(12), solver(minisat)] = (Mode::TuneMove, any(), any(), [255, 0, 1], any());
        kani guarded_normal [unwind(12)] = (Mode::GuardedNormal, any(), any(), [255, 0, 1], any());
        kani guarded_tune_rotate [unwind(12)] = (Mode::GuardedTuneRotate, any(), any(), [255, 0, 1], any());
        kani guarded_tune_move [unwind(12)] = (Mode::GuardedTuneMove, any(), any(), [255, 0, 1], any());
        kani sweep [unwind(12)] = (Mode::GuardedSweep, any(), any(), [255, 0, 1], any());
        kani velocity [unwind(12)] = (Mode::GuardedVelocity, any(), any(), [255, 0, 1], any());
        stepped lengths();
        sampled 200_000;
    }
}
