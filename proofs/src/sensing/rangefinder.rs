//! T9: a distance comes from a valid echo and from nothing else.

use fixed::types::I16F16;
use fw_core::sensing::{Echo, Rangefinders};
use fw_core::wire::DistanceCode;

use crate::input::{Input, Source};
use crate::property::Seen;
use fw_core::types::{Micros, RangefinderId};

/// 2500 mm and 20 mm, 2⁻³² mm (document, 5.1.4; the sensor's data sheet).
const FARTHEST: i64 = 2500 << 32;
const NEAREST: i64 = 20 << 32;
/// Half the path of sound in a microsecond at 343 m/s, 2⁻³² mm.
const MM_PER_US: i64 = (343_i64 << 32) / 2000;

impl Input for RangefinderId {
    fn draw(source: &mut impl Source) -> Self {
        match source.bits8() % 3 {
            0 => Self::Front,
            1 => Self::Right,
            _ => Self::Left,
        }
    }
}

/// Bearing of the front sensor.
const AHEAD: Option<u16> = Some(0);

/// The front sensor, triggered at `trigger`.
fn triggered(trigger: Micros) -> Rangefinders {
    let mut all = Rangefinders::new(3);
    assert!(all.tick(trigger, AHEAD, false) == Some(RangefinderId::Front));
    all
}

/// An echo gives its distance, to 2⁻²² of it, exactly if both edges can belong to the trigger and an object
/// can have caused it, across the clock's wrap.
pub fn echo_is_its_distance(trigger: Micros, delay: u32, width: u32) -> Seen {
    let mut all = triggered(trigger);
    let rise = trigger.after(delay);
    all.echo(RangefinderId::Front, rise, rise.after(width));
    let reading = all.reading(RangefinderId::Front).echo;
    let plausible = delay <= 3_000 && width <= 1 << 20;
    let way = i64::from(width.min(1 << 20)) * MM_PER_US;
    match reading {
        Echo::Distance(distance) => {
            let bits = distance.0.to_bits();
            assert!(plausible && width >= 117);
            assert!((NEAREST..=FARTHEST).contains(&bits));
            assert!((bits - way).unsigned_abs() <= u64::from(width));
        }
        Echo::OutOfRange => assert!(plausible && way + i64::from(width) > FARTHEST),
        Echo::Missing => assert!(plausible && width < 117),
        Echo::NotMeasured => assert!(!plausible),
        Echo::TimedOut => panic!("no time has passed"),
    }
    let far = matches!(reading, Echo::OutOfRange);
    let at = matches!(reading, Echo::Distance(_));
    assert!(at == all.distance(RangefinderId::Front).is_some());
    Seen::NOTHING
        .case(0, at)
        .case(1, far)
        .case(2, !plausible && delay > u32::MAX / 2)
        .case(3, at && rise.0 < trigger.0)
}

/// The wire's code is 0xFFFF exactly without an object within range.
// Requirement: DOC-5.1.4-2
pub fn code_is_none_exactly_without_a_distance(trigger: Micros, delay: u32, width: u32) -> Seen {
    let mut all = triggered(trigger);
    let rise = trigger.after(delay);
    all.echo(RangefinderId::Front, rise, rise.after(width));
    let distance = all.distance(RangefinderId::Front);
    let none = DistanceCode::from_distance(distance) == DistanceCode::NONE;
    assert!(none == distance.is_none());
    seen!(none, !none, distance.is_some_and(|at| at.0 > 2499))
}

/// The distance is monotone in the width.
pub fn distance_is_monotone(width: u32) -> Seen {
    let distance = |width: u32| {
        let mut all = triggered(Micros(0));
        all.echo(RangefinderId::Front, Micros(500), Micros(500 + width));
        all.distance(RangefinderId::Front)
    };
    given!(width < 1 << 20);
    match (distance(width), distance(width + 1)) {
        (Some(near), Some(far)) => assert!(near < far),
        // Too short, then a distance; or out of range from here on.
        (None, Some(_)) => assert!(width + 1 == 117),
        (Some(near), None) => assert!(near.0 > 2499),
        (None, None) => {}
    }
    seen!(distance(width).is_some(), distance(width).is_none())
}

/// No edges change the reading of a sensor that was not triggered or has answered; without an echo it is
/// missing at its next trigger, never a distance.
// Requirement: WIRE-distance-1
pub fn missing_edge_is_no_distance(
    which: RangefinderId,
    trigger: Micros,
    rise: Micros,
    fall: Micros,
    answered: bool,
) -> Seen {
    let mut all = triggered(trigger);
    if answered {
        let rise = trigger.after(500);
        all.echo(RangefinderId::Front, rise, rise.after(5_000));
    }
    let before = all.reading(which);
    let pending = which == RangefinderId::Front && !answered;
    if !pending {
        all.echo(which, rise, fall);
        assert!(all.reading(which) == before);
    }
    let mut now = trigger;
    let mut front_again = false;
    for _ in 0..9 {
        if !front_again {
            now = now.after(10_000);
            front_again = all.tick(now, AHEAD, false) == Some(RangefinderId::Front);
        }
    }
    assert!(front_again);
    let front = all.reading(RangefinderId::Front).echo;
    assert!(answered || front == Echo::Missing);
    assert!(!answered || matches!(front, Echo::Distance(_)));
    Seen::NOTHING.case(0, pending).case(1, answered)
}

/// The sensors take turns: the next is triggered 20 ms after one that answered and 30 ms after one that did
/// not, each at least 60 ms after its last trigger, and exactly 60 ms if all answer. For any answers and
/// deferred triggers.
pub fn sensors_take_turns(count: u8, answers: u64, allowed: u64) -> Seen {
    let mut all = Rangefinders::new(count);
    let fitted = count.min(3);
    let mut last = [None::<u32>; 3];
    let mut before = None::<(u32, bool)>;
    let mut expected = 0;
    for tick in 0..36 {
        let now = Micros(tick * 10_000);
        let bearing = (allowed >> tick & 1 != 0).then_some(7);
        let Some(which) = all.tick(now, bearing, false) else {
            continue;
        };
        assert!(bearing.is_some());
        if let Some((since, answered)) = before {
            assert!(tick - since >= if answered { 2 } else { 3 });
        }
        let answered = answers >> tick & 1 != 0;
        before = Some((tick, answered));
        if answered {
            all.echo(which, now.after(500), now.after(10_500));
        }
        let which = which as usize;
        assert!(which == expected && which < usize::from(fitted));
        expected = (which + 1) % usize::from(fitted);
        if let Some(before) = last[which] {
            let apart = tick - before;
            assert!(apart >= 6);
            assert!(apart == 6 || answers != u64::MAX || allowed != u64::MAX);
        }
        last[which] = Some(tick);
    }
    for (which, last) in last.into_iter().enumerate() {
        assert!(last.is_none() || which < usize::from(fitted));
    }
    let always = allowed == u64::MAX;
    assert!(!always || last.iter().flatten().count() == usize::from(fitted));
    Seen::NOTHING
        .case(0, fitted == 0)
        .case(1, fitted == 3 && always && answers == u64::MAX)
        .case(2, fitted == 3 && answers == 0)
        .case(3, before.is_some() && !always)
}

/// A reading has the bearing of its own trigger, for any later bearings, unanswered triggers and delays. The
/// echo's width identifies the trigger.
// Requirement: WIRE-bearing-2
pub fn reading_keeps_its_triggers_bearing(bearings: [u16; 24], answers: u32, delays: u64) -> Seen {
    let mut all = Rangefinders::new(1);
    let mut triggered = Vec::new();
    let (mut pending, mut distances) = (None, 0);
    for (tick, bearing) in (0_u32..).zip(bearings) {
        let now = Micros(tick * 10_000);
        // Some bearings stand for a turning servo.
        let bearing = (bearing & 0xF != 0).then_some(bearing);
        if all.tick(now, bearing, false).is_some() {
            pending = (answers >> tick & 1 != 0).then_some((triggered.len(), now));
            triggered.push(bearing);
        }
        if let Some((trigger, at)) = pending {
            // In its own tick, or in one of the next.
            if (delays >> (2 * tick)) % 4 == 0 {
                let width = 1_000 + 100 * u32::try_from(trigger).unwrap_or(0);
                all.echo(RangefinderId::Front, at.after(500), at.after(500 + width));
                pending = None;
            }
        }
        let reading = all.reading(RangefinderId::Front);
        if let Echo::Distance(distance) = reading.echo {
            let trigger = (distance.0.to_bits() / MM_PER_US - 999) / 100;
            let trigger = usize::try_from(trigger).unwrap_or(usize::MAX);
            assert!(triggered.get(trigger) == Some(&Some(reading.bearing)));
            distances += 1;
        }
    }
    Seen::NOTHING
        .case(0, distances > 0)
        .case(1, distances > 0 && triggered.len() > 2)
        .case(2, distances == 0 && triggered.len() > 2)
}

/// No temperature causes an overflow or a distance beyond the range.
pub fn any_temperature_is_safe(celsius: i32, width: u32) -> Seen {
    let mut all = triggered(Micros(0));
    all.set_temperature(Some(I16F16::from_bits(celsius)));
    all.echo(RangefinderId::Front, Micros(0), Micros(width));
    let distance = all.distance(RangefinderId::Front);
    if let Some(distance) = distance {
        assert!(distance.0 > 0 && distance.0 <= 2500);
    }
    seen!(distance.is_some(), celsius < -(40 << 16))
}

crate::properties! {
    theorem T9 echo_is_its_distance(trigger: Micros, delay: u32, width: u32) {
        cases ["a distance", "out of range", "edges from before the trigger", "across the wrap"];
        kani proof [unwind(4)];
        stepped (0..=(1 << 20) + 2).map(|width| (Micros(u32::MAX - 300), 400, width))
            .chain([(Micros(7), u32::MAX, 500)]);
        sampled 500_000;
    }
    theorem T9 code_is_none_exactly_without_a_distance(trigger: Micros, delay: u32, width: u32) {
        cases ["nothing", "a distance", "almost 2500 mm"];
        kani proof [unwind(4)];
        stepped (0..=(1 << 20) + 2).map(|width| (Micros(0), 400, width));
    }
    theorem T9 distance_is_monotone(width: u32) {
        cases ["a distance", "none"];
        kani proof [unwind(4)];
        exhaustive (0..1 << 20).map(|width| (width,));
    }
    theorem T9 missing_edge_is_no_distance(
        which: RangefinderId, trigger: Micros, rise: Micros, fall: Micros, answered: bool
    ) {
        cases ["no echo", "it had answered"];
        kani proof [unwind(11), solver(minisat)];
        sampled 300_000;
    }
    property T9 sensors_take_turns(count: u8, answers: u64, allowed: u64) {
        cases ["none fitted", "three that answer", "three that do not", "a turning servo"];
        stepped (0..=u8::MAX).flat_map(|count| {
            (0..100_u64).flat_map(move |n| {
                let some = n.wrapping_mul(0x9E37_79B9_7F4A_7C15);
                let others = some.rotate_left(23);
                [(0, u64::MAX), (u64::MAX, u64::MAX), (some, u64::MAX), (u64::MAX, some), (some, others)]
                    .map(|(answers, allowed)| (count, answers, allowed))
            })
        });
    }
    property T9 reading_keeps_its_triggers_bearing(bearings: [u16; 24], answers: u32, delays: u64) {
        cases ["a distance", "after several triggers", "none was answered"];
        sampled 200_000;
    }
    theorem T5 any_temperature_is_safe(celsius: i32, width: u32) {
        cases ["a distance", "below the range"];
        kani proof [unwind(4)];
        sampled 300_000;
    }
}
