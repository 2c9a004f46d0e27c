//! T0: the units' own arithmetic.

use crate::property::Seen;
use fw_core::types::{Duty, Micros, Turns};

/// A span is measured right wherever the clock wraps.
pub fn span_survives_the_wrap(start: Micros, span: u32) -> Seen {
    let end = start.after(span);
    assert!(end.since(start) == span);
    assert!(start.since(start) == 0);
    seen!(end.0 < start.0, end.0 >= start.0)
}

/// The shortest way between two headings leads from one to the other and is never longer than half
/// a turn.
pub fn shortest_way_arrives(from: Turns, to: Turns) -> Seen {
    let way = to.from_nearest(from);
    assert!(from.0.wrapping_add_signed(way) == to.0);
    assert!(way.unsigned_abs() <= 1 << 31);
    seen!(way > 0, way < 0, to.0 < from.0 && way > 0)
}

/// A duty is within full drive, exact where it can be and monotone.
pub fn duty_is_the_nearest(one: i32, other: i32) -> Seen {
    let duty = Duty::saturating(one).hundredths();
    assert!((-Duty::FULL..=Duty::FULL).contains(&duty));
    let exact = i32::from(duty) == one;
    assert!(exact || one.unsigned_abs() > u32::from(Duty::FULL.unsigned_abs()));
    if one <= other {
        assert!(duty <= Duty::saturating(other).hundredths());
    }
    seen!(exact, one > 0 && !exact, one < 0 && !exact)
}

crate::properties! {
    theorem T0 span_survives_the_wrap(start: Micros, span: u32) {
        cases ["the clock wrapped", "it did not"];
        kani proof [unwind(4)];
        sampled 100_000;
    }
    theorem T0 shortest_way_arrives(from: Turns, to: Turns) {
        cases ["counter-clockwise", "clockwise", "across a full turn"];
        kani proof [unwind(4)];
        sampled 100_000;
    }
    theorem T0 duty_is_the_nearest(one: i32, other: i32) {
        cases ["exact", "too high", "too low"];
        kani proof [unwind(4)];
        stepped (-20_000..=20_000).map(|duty| (duty, duty + 1));
        sampled 100_000;
    }
}
