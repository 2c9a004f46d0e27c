//! T9: an echo is its distance, and nothing else ever is one.

use fixed::types::I16F16;
use fw_core::robot::Rangefinder;
use fw_core::sensing::{Echo, Rangefinders};
use fw_core::units::Micros;
use fw_core::wire::DistanceCode;

use crate::input::{Input, Source};
use crate::theorem::Seen;

/// 2500 mm and 20 mm, 2⁻³² mm (document, 5.1.4; the sensor's data sheet).
const FARTHEST: i64 = 2500 << 32;
const NEAREST: i64 = 20 << 32;
/// Half a millimetre's way of sound in a microsecond at 343 m/s, 2⁻³² mm: 0.1715 mm.
const PACE: i64 = (343_i64 << 32) / 2000;

impl Input for Rangefinder {
    fn draw(source: &mut impl Source) -> Self {
        match source.bits8() % 3 {
            0 => Self::Front,
            1 => Self::Right,
            _ => Self::Left,
        }
    }
}

/// The front sensor, triggered at `trigger` and nothing heard yet.
fn triggered(trigger: Micros) -> Rangefinders {
    let mut all = Rangefinders::new(3);
    assert!(all.tick(trigger) == Some(Rangefinder::Front));
    all
}

/// An echo of a triggered sensor is its distance, to 2⁻²² of it, exactly when both edges can belong to
/// the trigger and an object can have made it; else it is nothing valid. Wherever the clock wraps.
pub fn echo_is_its_distance(trigger: Micros, delay: u32, width: u32) -> Seen {
    let mut all = triggered(trigger);
    let rise = trigger.after(delay);
    all.echo(Rangefinder::Front, rise, rise.after(width));
    let reading = all.reading(Rangefinder::Front);
    let believable = delay <= 8_000 && width <= 1 << 20;
    let way = i64::from(width.min(1 << 20)) * PACE;
    match reading {
        Echo::At(distance) => {
            let bits = distance.0.to_bits();
            assert!(believable && width >= 117);
            assert!((NEAREST..=FARTHEST).contains(&bits));
            assert!((bits - way).unsigned_abs() <= u64::from(width));
        }
        Echo::OutOfRange => assert!(believable && way + i64::from(width) > FARTHEST),
        Echo::Missing => assert!(believable && width < 117),
        Echo::None => assert!(!believable),
    }
    let far = matches!(reading, Echo::OutOfRange);
    let at = matches!(reading, Echo::At(_));
    assert!(at == all.distance(Rangefinder::Front).is_some());
    Seen::NOTHING
        .case(0, at)
        .case(1, far)
        .case(2, !believable && delay > u32::MAX / 2)
        .case(3, at && rise.0 < trigger.0)
}

/// What is sent of an echo: 0xFFFF exactly when there is no object within range.
pub fn code_is_none_exactly_without_a_distance(trigger: Micros, delay: u32, width: u32) -> Seen {
    let mut all = triggered(trigger);
    let rise = trigger.after(delay);
    all.echo(Rangefinder::Front, rise, rise.after(width));
    let distance = all.distance(Rangefinder::Front);
    let none = DistanceCode::from_distance(distance) == DistanceCode::NONE;
    assert!(none == distance.is_none());
    Seen::NOTHING
        .case(0, none)
        .case(1, !none)
        .case(2, distance.is_some_and(|at| at.0 > 2499))
}

/// A longer echo never makes a shorter distance: every width and the next.
pub fn distance_is_monotone(width: u32) -> Seen {
    let distance = |width: u32| {
        let mut all = triggered(Micros(0));
        all.echo(Rangefinder::Front, Micros(500), Micros(500 + width));
        all.distance(Rangefinder::Front)
    };
    if width >= 1 << 20 {
        return Seen::NOTHING;
    }
    match (distance(width), distance(width + 1)) {
        (Some(near), Some(far)) => assert!(near < far),
        // Too short, then a distance; or out of range from here on.
        (None, Some(_)) => assert!(width + 1 == 117),
        (Some(near), None) => assert!(near.0 > 2499),
        (None, None) => {}
    }
    Seen::NOTHING
        .case(0, distance(width).is_some())
        .case(1, distance(width).is_none())
}

/// A sensor that nobody triggered, or that has answered already, cannot be made to say anything by any
/// edges; and one that does not answer is missing by its next trigger, never a distance.
pub fn missing_edge_is_no_distance(
    which: Rangefinder,
    trigger: Micros,
    rise: Micros,
    fall: Micros,
    answered: bool,
) -> Seen {
    let mut all = triggered(trigger);
    if answered {
        all.echo(
            Rangefinder::Front,
            trigger.after(500),
            trigger.after(500 + 5_000),
        );
    }
    let before = all.reading(which);
    let awaited = which == Rangefinder::Front && !answered;
    if !awaited {
        all.echo(which, rise, fall);
        assert!(all.reading(which) == before);
    }
    let mut now = trigger;
    let mut front_again = false;
    for _ in 0..6 {
        now = now.after(10_000);
        front_again |= all.tick(now) == Some(Rangefinder::Front);
    }
    assert!(front_again);
    let front = all.reading(Rangefinder::Front);
    assert!(answered || front == Echo::Missing);
    assert!(!answered || matches!(front, Echo::At(_)));
    Seen::NOTHING.case(0, awaited).case(1, answered)
}

/// The sensors take turns, and each waits 60 ms from one trigger to its next.
pub fn sensors_take_turns(count: u8) -> Seen {
    let mut all = Rangefinders::new(count);
    let fitted = count.min(3);
    let mut last = [None::<u32>; 3];
    let mut expected = 0;
    for tick in 0..36 {
        let Some(which) = all.tick(Micros(tick * 10_000)) else {
            continue;
        };
        let which = which as usize;
        assert!(which == expected && which < usize::from(fitted));
        expected = if which + 1 == usize::from(fitted) {
            0
        } else {
            which + 1
        };
        if let Some(before) = last[which] {
            assert!(tick - before == 6);
        }
        last[which] = Some(tick);
    }
    for (which, last) in last.into_iter().enumerate() {
        assert!(last.is_some() == (which < usize::from(fitted)));
    }
    Seen::NOTHING.case(0, fitted == 0).case(1, fitted == 3)
}

/// No temperature, whatever the sensor that measured it says, makes a distance beyond the range or an
/// overflow.
pub fn any_temperature_is_safe(celsius: i32, width: u32) -> Seen {
    let mut all = triggered(Micros(0));
    all.set_temperature(I16F16::from_bits(celsius));
    all.echo(Rangefinder::Front, Micros(0), Micros(width));
    let distance = all.distance(Rangefinder::Front);
    if let Some(distance) = distance {
        assert!(distance.0 > 0 && distance.0 <= 2500);
    }
    Seen::NOTHING
        .case(0, distance.is_some())
        .case(1, celsius < -(40 << 16))
}

crate::theorems! {
    T9 echo_is_its_distance(trigger: Micros, delay: u32, width: u32) {
        cases ["a distance", "out of range", "edges from before the trigger", "across the wrap"];
        kani proof [unwind(4)];
        exhaustive (0..=(1 << 20) + 2).map(|width| (Micros(u32::MAX - 300), 400, width))
            .chain([(Micros(7), u32::MAX, 500)]);
        sampled 500_000;
    }
    T9 code_is_none_exactly_without_a_distance(trigger: Micros, delay: u32, width: u32) {
        cases ["nothing", "a distance", "almost 2500 mm"];
        exhaustive (0..=(1 << 20) + 2).map(|width| (Micros(0), 400, width));
    }
    T9 distance_is_monotone(width: u32) {
        cases ["a distance", "none"];
        exhaustive (0..1 << 20).map(|width| (width,));
    }
    T9 missing_edge_is_no_distance(
        which: Rangefinder, trigger: Micros, rise: Micros, fall: Micros, answered: bool
    ) {
        cases ["nothing was heard", "it had answered"];
        kani proof [unwind(8)];
        sampled 300_000;
    }
    T9 sensors_take_turns(count: u8) {
        cases ["none fitted", "three fitted"];
        exhaustive (0..=u8::MAX).map(|count| (count,));
    }
    T5 any_temperature_is_safe(celsius: i32, width: u32) {
        cases ["a distance", "colder than anything"];
        sampled 300_000;
    }
}
