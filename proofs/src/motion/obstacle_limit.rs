//! T15: the commanded forward speed never exceeds what stops before the stop distance.

#![allow(clippy::cast_sign_loss, reason = "a bearing's sign bit is half a turn")]

use fixed::types::{I16F16, I32F32};
use fw_core::motion::obstacle_limit::stoppable;
use fw_core::motion::ObstacleLimit;
use fw_core::types::{Delta, Millimetres};

use crate::eeprom::accepted::AcceptedConfig;
use crate::input::{Input, Source};
use crate::property::Seen;

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

/// The speed is the largest that stops: n² + reaction·n ≤ energy, and n + 1 exceeds it.
pub fn speed_is_the_largest_that_stops(reaction: u32, energy: u32) -> Seen {
    if reaction >= 1 << 17 {
        return Seen::NOTHING;
    }
    let (n, energy) = (u64::from(stoppable(reaction, energy)), u64::from(energy));
    let needed = |n: u64| n * (n + u64::from(reaction));
    let fastest = (1 << 14) - 1;
    assert!(n <= fastest && needed(n) <= energy);
    assert!(n == fastest || needed(n + 1) > energy);
    Seen::NOTHING
        .case(0, n == 0 && energy > 0)
        .case(1, n == fastest)
        .case(2, n > 0 && n < fastest)
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
    let Some(config) = values.config() else {
        return Seen::NOTHING;
    };
    let figures = config.obstacle_stop();
    let mut obstacle = ObstacleLimit::new(&config, by_velocity);
    let mut account = Account::default();
    for (event, ()) in events.into_iter().take(usize::from(count % 9)) {
        event.apply(&mut obstacle);
        account.add(&event);
    }
    let allowed = obstacle.limit(commanded);
    assert!(allowed <= obstacle.max_forward() && allowed >= -obstacle.max_reverse());
    assert!(obstacle.limited(commanded) == (allowed != commanded));
    assert!(
        commanded.signum() * allowed.signum() >= 0 && allowed.abs() <= commanded.saturating_abs()
    );
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
    assert!(
        obstacle.max_reverse() == 0
            || u64::from(obstacle.max_reverse().unsigned_abs()) == reverse * 1000
    );
    if by_velocity && obstacle.max_reverse() > 0 {
        let stopping = (reverse * reaction * 2 * deceleration + reverse * reverse * 1000) << 16;
        let left = (i64::from(figures.reverse_distance_mm) << 16) - account.backward;
        assert!(left > 0 && stopping <= left.unsigned_abs() * 2000 * deceleration);
    }
    seen.case(3, by_velocity && obstacle.max_reverse() == 0 && reverse > 0)
        .case(4, !by_velocity && allowed < 0)
}

crate::properties! {
    property T15 speed_is_the_largest_that_stops(reaction: u32, energy: u32) {
        cases ["stands", "the fastest", "between"];
        kani immediate [unwind(16)] = (0, any());
        kani first_board [unwind(16)] = (313, any());
        sampled 2_000_000;
    }
    property T15 commanded_speed_stops_in_time(
        values: AcceptedConfig, by_velocity: bool, events: [(Event, ()); 8], count: u8, commanded: i32
    ) {
        cases ["at the obstacle", "before the obstacle", "echo void", "way back used up", "backward"];
        needs [accepted_configuration_is_bounded, speed_is_the_largest_that_stops];
        kani first_board [unwind(80)] = (AcceptedConfig::FIRST_BOARD, any(), any(), 2, any());
        sampled 200_000;
    }
}
