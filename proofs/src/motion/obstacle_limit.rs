//! T15: the commanded forward speed never exceeds what stops before the stop distance.

#![allow(clippy::cast_sign_loss, reason = "a bearing's sign bit is half a turn")]

use fixed::types::{I16F16, I32F32};
use fw_core::eeprom::ObstacleStop;
use fw_core::motion::ObstacleLimit;
use fw_core::motion::obstacle_limit::{
    Track, braking_energy, reaction_speed, stoppable, stopping_way,
};
use fw_core::types::{Delta, Millimetres, Milliseconds};

use crate::eeprom::accepted::AcceptedConfig;
use crate::input::{Input, Source};
use crate::property::Seen;

/// Figures of the obstacle stop that a configuration may have.
#[derive(Clone, Copy, Debug)]
pub struct AcceptedStop(pub ObstacleStop);

impl Input for AcceptedStop {
    fn draw(source: &mut impl Source) -> Self {
        let mut up_to = |most: u16| {
            let mask = most.next_power_of_two() - 1;
            (u16::draw(source) & mask).min(most)
        };
        Self(ObstacleStop {
            stop_distance_mm: up_to(2_000),
            overhang_mm: up_to(1_000),
            reaction_time: Milliseconds(up_to(1_000)),
            deceleration_mm_s2: 50 + up_to(9_950),
            blind_speed_mm_s: up_to(2_000),
            reverse_speed_mm_s: up_to(2_000),
            reverse_distance_mm: up_to(10_000),
        })
    }
}

/// A reading of the front sensor, if one ended, then a tick.
#[derive(Clone, Copy, Debug, Default)]
pub struct Event {
    /// Bearing, turn × 0x10000, and distance, 2⁻¹⁶ mm.
    reading: Option<(i16, Option<u32>)>,
    /// 2⁻¹⁶ mm.
    travel: i32,
    /// 2⁻³² turns.
    turn: i32,
}

impl Input for Event {
    fn draw(source: &mut impl Source) -> Self {
        // Realistic values as often as any.
        let near = bool::draw(source);
        let small = |value: i32| if near { value >> 12 } else { value };
        let distance =
            Option::<u32>::draw(source).map(|value| if near { value >> 4 } else { value });
        let bearing = i16::draw(source) / if near { 8 } else { 1 };
        Self {
            reading: bool::draw(source).then_some((bearing, distance)),
            travel: small(Input::draw(source)),
            turn: small(Input::draw(source)) * if near { 64 } else { 1 },
        }
    }
}

impl Event {
    /// Gives the event to the core.
    pub fn apply(&self, obstacle: &mut ObstacleLimit) -> Delta {
        if let Some((bearing, distance)) = self.reading {
            let distance =
                distance.map(|bits| Millimetres(I32F32::from_bits(i64::from(bits) << 16)));
            obstacle.on_range(bearing as u16, distance);
        }
        let delta = Delta {
            travel: I16F16::from_bits(self.travel),
            turn: self.turn,
            ..Delta::default()
        };
        obstacle.step(&delta);
        delta
    }
}

/// The statement's own account of the events.
#[derive(Clone, Copy, Debug, Default)]
struct Account {
    /// Last echo, forward way and turn since.
    echo: Option<(i64, i64, i64)>,
    misses: u32,
    /// Ways since the last forward way of 10 mm, and since the last backward way.
    backward: i64,
    forward: i64,
}

impl Account {
    const FIFTEEN_DEGREES: i64 = 0xAAA;

    fn add(&mut self, event: &Event) {
        match event.reading {
            Some((bearing, _)) if i64::from(bearing).abs() > Self::FIFTEEN_DEGREES => {}
            Some((_, Some(distance))) => {
                let furthest = i64::from(i32::MAX);
                self.echo = Some((i64::from(distance).min(furthest), 0, 0));
                self.misses = 0;
            }
            Some((_, None)) => {
                self.misses += 1;
                self.echo = self.echo.filter(|_| self.misses < 3);
            }
            None => {}
        }
        let (travel, turn) = (i64::from(event.travel), i64::from(event.turn));
        self.echo = self
            .echo
            .map(|(at, way, turned)| (at, way + travel.max(0), turned + turn))
            .filter(|(_, _, turned)| turned.abs() <= Self::FIFTEEN_DEGREES << 16);
        if travel < 0 {
            self.forward = 0;
        }
        self.forward += travel.max(0);
        self.backward += (-travel).max(0);
        if travel > 0 && self.forward >= 10 << 16 {
            self.backward = 0;
        }
    }
}

/// What every event keeps: what [`obstacle_step_follows_the_rules`] takes for granted.
fn is_possible(track: &Track) -> bool {
    let Track {
        ahead,
        misses,
        backward,
        forward,
        max_forward,
        ..
    } = *track;
    backward.min(forward).min(max_forward) >= 0 && (ahead.is_none() || misses < 3)
}

/// Inductive step over every state: echoes, misses, turning and ways count as the rules say, and the
/// forward limit is the blind speed without an echo, unchanged while the distance is, and else that of
/// [`distance_allows_what_stops`]. No command passes the limits, nor is one changed within them.
// Requirement: WIRE-obstacle-1, WIRE-obstacle-2, WIRE-obstacle-3, WIRE-obstacle-4
pub fn obstacle_step_follows_the_rules(
    stop: AcceptedStop,
    by_velocity: bool,
    before: Track,
    event: Event,
    commanded: i32,
) -> Seen {
    let AcceptedStop(figures) = stop;
    let start = ObstacleLimit::new(&figures, by_velocity);
    assert!(is_possible(start.track()) && start.track().ahead.is_none());
    given!(is_possible(&before));
    let mut obstacle = start.with_track(before);
    event.apply(&mut obstacle);
    let after = *obstacle.track();
    assert!(is_possible(&after) && !after.fresh);
    let mut expected = before;
    match event.reading {
        Some((bearing, _)) if i64::from(bearing).abs() > Account::FIFTEEN_DEGREES => {}
        Some((_, Some(distance))) => {
            expected = Track {
                ahead: Some(i32::try_from(distance).unwrap_or(i32::MAX)),
                fresh: true,
                turned: 0,
                misses: 0,
                ..before
            };
        }
        Some((_, None)) => {
            expected.misses = before.misses.saturating_add(1);
            expected.ahead = before.ahead.filter(|_| expected.misses < 3);
        }
        None => {}
    }
    expected.turned = expected.turned.saturating_add(event.turn);
    if i64::from(expected.turned).abs() > Account::FIFTEEN_DEGREES << 16 {
        expected.ahead = None;
    }
    let forward_way = event.travel.max(0);
    expected.ahead = expected
        .ahead
        .map(|ahead| ahead.saturating_sub(forward_way));
    if event.travel < 0 {
        expected.forward = 0;
        expected.backward = before.backward.saturating_sub(event.travel);
    } else {
        expected.forward = before.forward.saturating_add(forward_way);
        if event.travel > 0 && expected.forward >= 10 << 16 {
            expected.backward = 0;
        }
    }
    expected.max_forward = match expected.ahead {
        None => i32::from(figures.blind_speed_mm_s) * 1000,
        Some(_) if forward_way == 0 && !expected.fresh => before.max_forward,
        Some(_) => after.max_forward,
    };
    expected.fresh = false;
    assert!(after == expected);
    let reverse = u32::from(figures.reverse_speed_mm_s);
    let used_up = by_velocity && obstacle.max_reverse() == 0;
    // At the latest after the whole way.
    let whole = i64::from(figures.reverse_distance_mm) << 16;
    assert!(used_up || !by_velocity || i64::from(after.backward) < whole);
    assert!(obstacle.max_forward() == after.max_forward);
    assert!(obstacle.max_reverse().unsigned_abs() == if used_up { 0 } else { reverse * 1000 });
    let allowed = obstacle.limit(commanded);
    assert!(-obstacle.max_reverse() <= allowed && allowed <= obstacle.max_forward());
    let bound = [-obstacle.max_reverse(), obstacle.max_forward()][usize::from(commanded > 0)];
    assert!(allowed == commanded || allowed == bound);
    assert!(commanded.signum() * allowed.signum() >= 0);
    assert!(allowed.unsigned_abs() <= commanded.unsigned_abs());
    assert!(obstacle.limited(commanded) == (allowed != commanded));
    Seen::NOTHING
        .case(0, after.ahead.is_some() && allowed < commanded)
        .case(1, before.ahead.is_some() && after.ahead.is_none())
        .case(2, used_up && commanded < 0)
        .case(3, after.ahead.is_some_and(|ahead| ahead < 0))
        .case(
            4,
            after.ahead.is_some() && after.max_forward > before.max_forward,
        )
}

/// A distance allows the largest speed that stops within it, by `speed_is_the_largest_that_stops` and
/// `figures_err_on_the_safe_side`; a way back allows what stops within the rest of it.
// Requirement: WIRE-obstacle-1, WIRE-obstacle-4
pub fn distance_allows_what_stops(stop: AcceptedStop, ahead: i32, backward: i32) -> Seen {
    let AcceptedStop(figures) = stop;
    given!(backward >= 0);
    let track = Track {
        ahead: Some(ahead),
        fresh: true,
        backward,
        ..Track::default()
    };
    let mut obstacle = ObstacleLimit::new(&figures, true).with_track(track);
    obstacle.step(&Delta::default());
    let deceleration = u32::from(figures.deceleration_mm_s2);
    let reaction_time = u32::from(figures.reaction_time.0);
    let clearance = (i32::from(figures.stop_distance_mm) + i32::from(figures.overhang_mm)) << 16;
    let room = ahead.saturating_sub(clearance).max(0).unsigned_abs();
    let energy = braking_energy(room, deceleration * 125_000);
    let units = stoppable(reaction_speed(deceleration, reaction_time), energy);
    assert!(obstacle.max_forward().unsigned_abs() == units << 8);
    let reverse = u32::from(figures.reverse_speed_mm_s);
    let way = stopping_way(reverse, reaction_time, deceleration);
    let way = i64::from(figures.reverse_distance_mm) - i64::from(way);
    let used_up = i64::from(backward) >= way << 16;
    assert!(obstacle.max_reverse().unsigned_abs() == if used_up { 0 } else { reverse * 1000 });
    Seen::NOTHING
        .case(0, units == 0)
        .case(1, units > 0)
        .case(2, used_up && reverse > 0)
        .case(3, !used_up && reverse > 0)
}

/// After any events: `v·t_r + v²/(2a)` ≤ max(0, d − overhang − stop distance) for the commanded forward
/// speed v, the blind speed without an echo; backward the reverse speed, and driven by velocity only
/// what stops within the reverse distance.
// Requirement: WIRE-obstacle-1, WIRE-obstacle-2, WIRE-obstacle-3, WIRE-obstacle-4
pub fn commanded_speed_stops_in_time(
    values: AcceptedConfig,
    by_velocity: bool,
    events: [(Event, ()); 8],
    count: u8,
    commanded: i32,
) -> Seen {
    given!(let (true, config) = values.checked());
    let figures = config.obstacle_stop();
    let mut obstacle = ObstacleLimit::new(figures, by_velocity);
    let mut account = Account::default();
    for (event, ()) in events.into_iter().take(usize::from(count % 9)) {
        event.apply(&mut obstacle);
        account.add(&event);
    }
    let allowed = obstacle.limit(commanded);
    assert!(allowed <= obstacle.max_forward() && allowed >= -obstacle.max_reverse());
    assert!(obstacle.limited(commanded) == (allowed != commanded));
    assert!(commanded.signum() * allowed.signum() >= 0);
    assert!(allowed.abs() <= commanded.saturating_abs());
    let reaction = u64::from(figures.reaction_time.0);
    let deceleration = u64::from(figures.deceleration_mm_s2);
    let fastest = u64::from(obstacle.max_forward().unsigned_abs());
    let mut seen = Seen::NOTHING;
    if let Some((at, way, _)) = account.echo {
        let clearance = u32::from(figures.stop_distance_mm) + u32::from(figures.overhang_mm);
        let room = (at - way - (i64::from(clearance) << 16))
            .max(0)
            .unsigned_abs();
        // Units of 256 µm/s; both sides times 2·a·10⁶·2¹⁶ mm⁻¹, over 2¹⁰.
        let n = fastest >> 8;
        assert!(fastest == n << 8);
        let needed = ((n * n) << 25) + ((n * reaction * deceleration) << 18);
        assert!(needed <= room * 15_625 * deceleration);
        seen = seen.case(0, room == 0).case(1, room > 0 && allowed > 0);
    } else {
        assert!(fastest == u64::from(figures.blind_speed_mm_s) * 1000);
        seen = seen.case(2, account.misses >= 3);
    }
    let reverse = u64::from(figures.reverse_speed_mm_s);
    let allowed_reverse = u64::from(obstacle.max_reverse().unsigned_abs());
    assert!(allowed_reverse == 0 || allowed_reverse == reverse * 1000);
    if by_velocity && obstacle.max_reverse() > 0 {
        let stopping = (reverse * reaction * 2 * deceleration + reverse * reverse * 1000) << 16;
        let left = (i64::from(figures.reverse_distance_mm) << 16) - account.backward;
        assert!(left > 0 && stopping <= left.unsigned_abs() * 2000 * deceleration);
    }
    seen.case(3, by_velocity && obstacle.max_reverse() == 0 && reverse > 0)
        .case(4, !by_velocity && allowed < 0)
}

crate::properties! {
    theorem T15 obstacle_step_follows_the_rules(
        stop: AcceptedStop, by_velocity: bool, before: Track, event: Event, commanded: i32
    ) {
        cases ["limited", "echo void", "way back used up", "beyond the obstacle", "further away"];
        needs [
            accepted_configuration_is_bounded, distance_allows_what_stops
        ];
        kani proof [unwind(16)];
        sampled 500_000;
    }
    property T15 distance_allows_what_stops(stop: AcceptedStop, ahead: i32, backward: i32) {
        cases ["at the obstacle", "before it", "no way back", "a way back"];
        needs [
            accepted_configuration_is_bounded, speed_is_the_largest_that_stops,
            figures_err_on_the_safe_side
        ];
        sampled 500_000;
    }
    property T15 commanded_speed_stops_in_time(
        values: AcceptedConfig, by_velocity: bool, events: [(Event, ()); 8], count: u8, commanded: i32
    ) {
        cases ["at the obstacle", "before the obstacle", "echo void", "way back used up", "backward"];
        needs [accepted_configuration_is_bounded, speed_is_the_largest_that_stops];
        sampled 200_000;
    }
}
