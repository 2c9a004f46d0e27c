//! T5 and T6: heading and position from the encoders.

use fw_core::eeprom::Wheel;
use fw_core::eeprom::fields::{ENCODER_LEFT_REVERSED, ENCODER_RIGHT_REVERSED};
use fw_core::motion::Odometry;
use fw_core::motion::odometry::{MAX_POSITION, Position};

use crate::eeprom::accepted::AcceptedConfig;
use crate::property::Seen;
use fw_core::types::{Micrometres, Turns};

/// Increments of both counters, sample by sample.
pub type Path = [u8; 48];

/// The increments of a path, times 2^`scale`.
fn samples(path: &Path, scale: u8) -> impl Iterator<Item = (i32, i32)> + '_ {
    path.chunks_exact(2).map(move |pair| {
        let increment = |byte: u8| (i32::from(byte) - 128) << (scale % 8);
        (increment(pair[0]), increment(pair[1]))
    })
}

/// The heading depends on the counters alone, not on the path: tick by tick, with wraps, or in one tick,
/// it is equal to the last bit, and it is that of (4.4) in whole numbers, rounded.
// Requirement: DOC-4.1-5
pub fn heading_never_drifts(
    values: AcceptedConfig,
    left: u32,
    right: u16,
    path: Path,
    scale: u8,
) -> Seen {
    given!(let Some(config) = values.config());
    let mut slow = Odometry::new(&config, left, right);
    let mut quick = Odometry::new(&config, left, right);
    let (mut l, mut r) = (left, right);
    let (mut net_left, mut net_right) = (0_i32, 0_i32);
    for (grown_left, grown_right) in samples(&path, scale) {
        l = l.wrapping_add_signed(grown_left);
        r = r.wrapping_add_signed(grown_right as i16);
        net_left += grown_left;
        net_right += grown_right;
        let _ = slow.step(l, r);
    }
    // The range of a 16-bit counter in one step.
    given!(net_right.abs() <= 32_767);
    let _ = quick.step(l, r);
    let heading = slow.pose().heading;
    assert!(heading == quick.pose().heading);
    let arc = |net: i32, wheel: &Wheel| {
        let forward = if wheel.encoder_reversed { -net } else { net };
        i128::from(forward) * i128::from(wheel.diameter.0)
    };
    let arcs = arc(net_right, config.right()) - arc(net_left, config.left());
    let per_turn = 2 * i128::from(config.counts_per_turn()) * i128::from(config.track().0);
    let turns = (2 * (arcs << 32) + per_turn).div_euclid(2 * per_turn);
    // A tie between two codes may go either way: a count's turn is rounded at 2⁻⁶⁴.
    let above = (i128::from(heading.0) - turns + 1).rem_euclid(1 << 32);
    assert!((0..=2).contains(&above));
    Seen::NOTHING
        .case(0, net_left != 0 && net_right != 0)
        .case(1, l < left && net_left > 0)
        .case(2, r < right && net_right > 0)
}

/// A tick and its reverse restore the heading to the last bit, for any counters and wraps: a tick's turn
/// depends on its counts alone and is odd in them, and turns add modulo a turn. So any path that is
/// rolled back restores it, and counters that stand add nothing.
// Requirement: DOC-4.1-5
pub fn tick_back_undoes_a_tick(values: AcceptedConfig, from: (u32, u16), to: (u32, u16)) -> Seen {
    given!(let Some(config) = values.config());
    let mut odometry = Odometry::new(&config, from.0, from.1);
    let there = odometry.step(to.0, to.1);
    let away = odometry.pose().heading;
    let _ = odometry.step(from.0, from.1);
    // Half of the counters' range has no opposite.
    given!(there.left != i32::MIN && there.right.abs() != 1 << 15);
    assert!(odometry.pose().heading == Turns(0));
    Seen::NOTHING
        .case(0, away != Turns(0))
        .case(1, to.0 < from.0 && there.left < 0)
        .case(2, to.1 < from.1 && there.right > 0)
}

/// One tick of any counts against the document's exact arc in binary64 (4.3 to 4.7): within 10⁻⁶ mm, the
/// heading within 2⁻³² turns.
// Requirement: DOC-4.1-3
pub fn step_is_the_exact_arc(values: AcceptedConfig, heading: u16, left: i16, right: i16) -> Seen {
    use core::f64::consts::{PI, TAU};
    let values = values
        .with(ENCODER_LEFT_REVERSED, 0)
        .with(ENCODER_RIGHT_REVERSED, 0);
    given!(let Some(config) = values.config());
    let mut odometry = Odometry::new(&config, 0, 0);
    // To any heading: the right wheel rolls, the left one stands.
    let _ = odometry.step(0, heading);
    let before = odometry.pose();
    let delta = odometry.step(
        0_u32.wrapping_add_signed(left.into()),
        heading.wrapping_add_signed(right),
    );
    let after = odometry.pose();
    let counts = f64::from(config.counts_per_turn());
    let way = |Micrometres(micrometres): Micrometres, count: i16| {
        f64::from(micrometres) / 1000.0 * PI * f64::from(count) / counts
    };
    let s_right = way(config.right().diameter, right);
    let s_left = way(config.left().diameter, left);
    let psi = (s_right - s_left) / (f64::from(config.track().0) / 1000.0);
    // A sixteenth of a turn in a tick is six turns a second.
    if psi.abs() > TAU / 16.0 {
        return Seen::NOTHING.case(0, true);
    }
    assert!((f64::from(delta.turn) / 4_294_967_296.0 * TAU - psi).abs() < 4e-9);
    let mean = s_right / 2.0 + s_left / 2.0;
    let chord = if psi == 0.0 {
        mean
    } else {
        mean * (psi / 2.0).sin() / (psi / 2.0)
    };
    let beta = f64::from(before.heading.0) / 4_294_967_296.0 * TAU;
    let (sine, cosine) = (beta + psi / 2.0).sin_cos();
    let dx = (after.x.0 - before.x.0).to_num::<f64>();
    let dy = (after.y.0 - before.y.0).to_num::<f64>();
    // The pose's heading is rounded to 2⁻³² turns; sine and cosine have their own error.
    let bound = 1e-6 + mean.abs() * 2e-9;
    assert!((dx - chord * cosine).abs() <= bound && (dy - chord * sine).abs() <= bound);
    Seen::NOTHING
        .case(1, psi == 0.0 && mean != 0.0)
        .case(2, psi.abs() > 0.3)
}

/// Every accepted platform has its factors without overflow, and starts at the origin.
pub fn any_platform_starts_at_the_origin(values: AcceptedConfig, left: u32, right: u16) -> Seen {
    given!(let (true, config) = values.checked());
    let pose = Odometry::new(&config, left, right).pose();
    assert!(pose.x.0 == 0 && pose.y.0 == 0 && pose.heading == Turns(0));
    seen!(config.left().diameter.0 >= 80_000)
}

fn in_range(position: Position) -> bool {
    let range = !MAX_POSITION..=MAX_POSITION;
    range.contains(&position.x) && range.contains(&position.y)
}

/// No arc overflows anything, from any position, with any length, direction and bend, and its end is in the
/// range again: so it is in every tick of every platform, as what comes before it in a tick wraps on purpose.
pub fn any_arc_is_safe(from: (i64, i64), path: i64, middle: i64, turn: i32) -> Seen {
    let (x, y) = from;
    let mut position = Position { x, y };
    given!(in_range(position));
    position.advance(path, middle, turn);
    assert!(in_range(position));
    seen!(
        position.x == MAX_POSITION,
        position.y < y - MAX_POSITION / 4
    )
}

/// No path that a slipping wheel did not roll overflows the position, in any direction, or takes it out of its
/// range: half of 32 768 counts of either wheel, each at most 2⁴⁶ · 2⁻⁴² mm, is the longest.
pub fn any_loss_is_safe(from: (i64, i64), lost: i64, heading: Turns) -> Seen {
    let (x, y) = from;
    let mut position = Position { x, y };
    given!(in_range(position) && (-1 << 60..=1 << 60).contains(&lost));
    position.take_back(lost, heading);
    assert!(in_range(position));
    seen!(position.x == MAX_POSITION, position.y > y)
}

/// No counters overflow anything on an accepted platform.
pub fn any_counters_are_safe(values: AcceptedConfig, counters: [(u32, u16); 8], ticks: u8) -> Seen {
    given!(let (true, config) = values.checked());
    let mut odometry = Odometry::new(&config, 0, 0);
    for (left, right) in counters.into_iter().take(usize::from(ticks % 9)) {
        let delta = odometry.step(left, right);
        assert!(delta.right.abs() <= 32_768);
    }
    let pose = odometry.pose();
    seen!(pose.x.0 > 10_000, pose.x.0 < -10_000)
}

crate::properties! {
    theorem T5 any_platform_starts_at_the_origin(values: AcceptedConfig, left: u32, right: u16) {
        cases ["a wheel of 80 mm or more"];
        needs [accepted_configuration_is_bounded];
        kani any_encoder [unwind(80)] = (AcceptedConfig::of_any(|field| field.address == 0x0302), any(), any());
        kani any_diameters [unwind(80)] = (AcceptedConfig::of_any(|field| matches!(field.address, 0x0304 | 0x0308)), any(), any());
        kani any_track [unwind(80)] = (AcceptedConfig::of_any(|field| field.address == 0x030C), any(), any());
        sampled 10_000;
    }
    theorem T5 any_arc_is_safe(from: (i64, i64), path: i64, middle: i64, turn: i32) {
        cases ["held at the end of the range", "a long way back"];
        kani proof [unwind(4)];
        sampled 1_000_000;
    }
    theorem T5 any_loss_is_safe(from: (i64, i64), lost: i64, heading: Turns) {
        cases ["held at the end of the range", "to the left"];
        kani proof [unwind(4)];
        sampled 1_000_000;
    }
    property T6 heading_never_drifts(values: AcceptedConfig, left: u32, right: u16, path: Path, scale: u8) {
        cases ["both wheels turned", "the left counter wrapped", "the right counter wrapped"];
        needs [accepted_configuration_is_bounded];
        sampled 30_000;
    }
    property T6 tick_back_undoes_a_tick(values: AcceptedConfig, from: (u32, u16), to: (u32, u16)) {
        cases ["it had turned", "the left counter wrapped", "the right one fell"];
        needs [accepted_configuration_is_bounded];
        sampled 100_000;
    }
    property T6 step_is_the_exact_arc(values: AcceptedConfig, heading: u16, left: i16, right: i16) {
        cases ["turns faster than anything does", "straight on", "a sharp turn"];
        needs [accepted_configuration_is_bounded];
        sampled 100_000;
    }
    property T5 any_counters_are_safe(values: AcceptedConfig, counters: [(u32, u16); 8], ticks: u8) {
        cases ["far ahead", "far behind"];
        needs [accepted_configuration_is_bounded];
        kani on_first_board [unwind(80), solver(minisat)] = (AcceptedConfig::FIRST_BOARD, any(), 1);
        sampled 100_000;
    }
}
