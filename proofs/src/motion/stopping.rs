//! T15: the figures of the obstacle stop, each against its formula: speeds, energies and ways.

use fw_core::motion::obstacle_limit::{braking_energy, reaction_speed, stoppable, stopping_way};

use crate::property::Seen;

/// Places of the bits of a speed, from the highest on.
fn places() -> impl Iterator<Item = u32> {
    (0..14).rev()
}

/// `2·above + bit`, for the bits of `n` above a place and the bit there: times the bit what it adds to their
/// square.
const fn added(n: u32, place: u32) -> u32 {
    (n >> place >> 1 << 1 << place) * 2 + (1 << place)
}

/// What the bits of a speed add is its square, and their sum the speed: with a reaction,
/// `Σ (added + reaction)·bit` is `n² + reaction·n`.
pub fn bits_of_a_speed_add_up(n: u16) -> Seen {
    let n = u32::from(n) % (1 << 14);
    let (mut square, mut sum) = (0, 0);
    for place in places().filter(|place| n >> place & 1 != 0) {
        square += added(n, place) << place;
        sum += 1 << place;
    }
    assert!(square == n * n && sum == n);
    seen!(n == 0, n == (1 << 14) - 1)
}

/// The speed is the largest that stops: `n² + reaction·n`, as [`bits_of_a_speed_add_up`] has it, is within the
/// energy. A faster speed has its first other bit where n has none, and needs too much with this bit.
// Requirement: WIRE-obstacle-1
pub fn speed_is_the_largest_that_stops(reaction: u32, energy: u32) -> Seen {
    given!(reaction < 1 << 17);
    let n = stoppable(reaction, energy);
    let fastest = (1 << 14) - 1;
    assert!(n <= fastest);
    let mut rest = energy;
    for place in places() {
        let more = (added(n, place) + reaction) << place;
        if n >> place & 1 != 0 {
            assert!(more <= rest);
            rest -= more;
        } else {
            assert!(more > rest);
        }
    }
    seen!(n == 0, n == fastest, n > 0 && n < fastest)
}

/// Reaction, energy and way back are rounded so that the robot stops rather too early: each against its
/// formula, for every figure and room.
// Requirement: WIRE-obstacle-1, WIRE-obstacle-4
pub fn figures_err_on_the_safe_side(
    deceleration: u16,
    reaction_time: u16,
    speed: u16,
    room: u32,
) -> Seen {
    given!((50..=10_000).contains(&deceleration) && reaction_time <= 1_000);
    given!(speed <= 2_000 && room >> 31 == 0);
    let [a, t, v] = [deceleration, reaction_time, speed].map(u32::from);
    let reaction = reaction_speed(a, t);
    assert!(reaction < 1 << 17 && reaction * 128 >= a * t && reaction * 128 < a * t + 128);
    let energy = braking_energy(room, a * 125_000);
    let exact = u64::from(room) * u64::from(a * 125_000);
    assert!(u64::from(energy) <= exact >> 28);
    assert!(energy == u32::MAX || u64::from(energy) == exact >> 28);
    // Both parts of the way, and both a millimetre too long at most.
    let way = stopping_way(v, t, a);
    let (reaction_way, braking_way) = (v * t / 1000 + 1, v * v / (2 * a) + 1);
    assert!(reaction_way * 1000 > v * t && braking_way * 2 * a > v * v);
    assert!(way == reaction_way + braking_way);
    seen!(reaction * 128 > a * t, energy == u32::MAX, way > 2_000)
}

/// Every deceleration with every reaction time and with every speed, every reaction time with every speed:
/// no part depends on more than two of them. The room is only multiplied, shifted and cut.
#[cfg(test)]
fn figures() -> impl Iterator<Item = (u16, u16, u16, u32)> {
    (50..=10_000_u16).flat_map(|deceleration| {
        (0..=1_000_u16).flat_map(move |time| {
            [2 * time, 2 * time + 1].map(|speed| {
                let room = u32::from(deceleration).wrapping_mul(u32::from(time) << 20 | 0xFFFF);
                (
                    deceleration,
                    time,
                    (deceleration + speed) % 2_001,
                    room >> 1,
                )
            })
        })
    })
}

crate::properties! {
    theorem T15 bits_of_a_speed_add_up(n: u16) {
        cases ["stands", "the fastest"];
        exhaustive (0..=u16::MAX).map(|n| (n,));
        sampled 20_000;
    }
    theorem T15 speed_is_the_largest_that_stops(reaction: u32, energy: u32) {
        cases ["stands", "the fastest", "between"];
        needs [bits_of_a_speed_add_up];
        kani proof [unwind(16)];
        kani first_board [unwind(16)] = (313, any());
        sampled 2_000_000;
    }
    theorem T15 figures_err_on_the_safe_side(
        deceleration: u16, reaction_time: u16, speed: u16, room: u32
    ) {
        cases ["rounded up", "saturated", "a long way"];
        exhaustive figures();
        sampled 200_000;
    }
}
