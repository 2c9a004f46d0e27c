//! Obstacle stop: the range of speeds that keeps the robot clear of what the front rangefinder sees.
//!
//! Forward: `v·t_r + v²/(2a) ≤ max(0, d − overhang − stop_distance)`, `t_r` the reaction time, a the
//! deceleration, d the last echo within ±15° of straight ahead less the forward way since. The echo is
//! void after a newer one, three readings without one in a row, and 15° of turning; without an echo
//! the blind speed is the limit. Backward, where no sensor looks: the reverse speed, and where driven
//! by velocity only the reverse distance before the next way forward.

use crate::eeprom::ObstacleStop;
use crate::types::{Delta, Millimetres};

/// Resolution of the forward limit: 2⁸ µm/s.
const SPEED_SHIFT: u32 = 8;
/// Bits of the forward limit in that resolution: 4.19 m/s.
const SPEED_BITS: u32 = 14;
/// 15°: turn × 0x10000, and 2⁻³² turns.
const CONE: u16 = 0xAAA;
const MAX_TURN: u32 = (CONE as u32) << 16;
/// Readings without an echo that void the last one.
const MAX_MISSES: u8 = 3;
/// Millimetres, 2⁻¹⁶.
const MM: i32 = 1 << 16;
/// Way forward that allows the reverse distance again; less may be a wheel's backlash.
const FORWARD_RUN: i32 = 10 * MM;

/// The forward and backward limit of the speed.
#[derive(Clone, Debug)]
pub struct ObstacleLimit {
    /// Kept ahead of the sensor's face, 2⁻¹⁶ mm.
    clearance: i32,
    /// 2a, 2⁻²⁸ squared units of speed per 2⁻¹⁶ mm.
    deceleration: u32,
    /// `2·a·t_r`, units of speed.
    reaction: u32,
    /// µm/s.
    blind_speed: i32,
    reverse_speed: i32,
    /// Way back after which the robot brakes, 2⁻¹⁶ mm; none where it drives to a pose.
    reverse_way: Option<i32>,
    track: Track,
}

/// What is remembered of echoes and ways.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Track {
    /// The last echo less the forward way since, 2⁻¹⁶ mm.
    pub ahead: Option<i32>,
    /// The echo is newer than the limit.
    pub fresh: bool,
    /// Turned since that echo, 2⁻³² turns.
    pub turned: i32,
    /// Readings without an echo since.
    pub misses: u8,
    /// Way back since the last forward way of 10 mm, 2⁻¹⁶ mm, not negative.
    pub backward: i32,
    /// Forward way since the last one back, 2⁻¹⁶ mm, not negative.
    pub forward: i32,
    /// Largest speed forward, µm/s, not negative.
    pub max_forward: i32,
}

impl ObstacleLimit {
    /// Without an echo. `by_velocity`: the way back is limited too.
    pub fn new(figures: &ObstacleStop, by_velocity: bool) -> Self {
        let ObstacleStop {
            stop_distance_mm,
            overhang_mm,
            reaction_time,
            deceleration_mm_s2,
            blind_speed_mm_s,
            reverse_speed_mm_s,
            reverse_distance_mm,
        } = *figures;
        let millimetres = |length: u16| i32::from(length) * MM;
        let deceleration = u32::from(deceleration_mm_s2);
        let reverse = u32::from(reverse_speed_mm_s);
        let stopping = stopping_way(reverse, reaction_time.0.into(), deceleration);
        Self {
            clearance: millimetres(stop_distance_mm) + millimetres(overhang_mm),
            // (2·10³·a µm/s²) · (10³/2¹⁶ µm) / 2¹⁶ = a · 2·10⁶/2³², below 2³¹ in 2⁻²⁸.
            deceleration: deceleration * 125_000,
            reaction: reaction_speed(deceleration, reaction_time.0.into()),
            blind_speed: i32::from(blind_speed_mm_s) * 1000,
            reverse_speed: i32::from(reverse_speed_mm_s) * 1000,
            reverse_way: by_velocity
                .then(|| (i32::from(reverse_distance_mm) - stopping as i32).max(0) * MM),
            track: Track {
                max_forward: i32::from(blind_speed_mm_s) * 1000,
                ..Track::default()
            },
        }
    }

    /// What is remembered of echoes and ways.
    pub const fn track(&self) -> &Track {
        &self.track
    }

    /// As after the echoes and ways of `track`.
    #[must_use]
    pub const fn with_track(mut self, track: Track) -> Self {
        self.track = track;
        self
    }

    /// A measurement of the front sensor that has ended: its bearing at the trigger, turn × 0x10000
    /// counter-clockwise from straight ahead, and its distance, `None` if nothing answered. Counts from
    /// the next [`Self::step`] on.
    // Requirement: WIRE-obstacle-2
    pub fn on_range(&mut self, bearing: u16, distance: Option<Millimetres>) {
        if (bearing as i16).unsigned_abs() > CONE {
            return;
        }
        let track = &mut self.track;
        if let Some(distance) = distance {
            // Down to the next 2⁻¹⁶ mm.
            let bits = (distance.0.to_bits() >> 16).clamp(0, i32::MAX.into());
            track.ahead = Some(bits as i32);
            track.fresh = true;
            (track.turned, track.misses) = (0, 0);
        } else {
            track.misses = track.misses.saturating_add(1);
            if track.misses >= MAX_MISSES {
                track.ahead = None;
            }
        }
    }

    /// Every tick, with the robot's motion since the last one.
    // Requirement: WIRE-obstacle-1
    pub fn step(&mut self, delta: &Delta) {
        let track = &mut self.track;
        let travel = delta.travel.to_bits();
        if travel > 0 {
            track.forward = track.forward.saturating_add(travel);
            if track.forward >= FORWARD_RUN {
                track.backward = 0;
            }
        } else if travel < 0 {
            track.forward = 0;
            track.backward = track.backward.saturating_sub(travel);
        }
        track.turned = track.turned.saturating_add(delta.turn);
        if track.turned.unsigned_abs() > MAX_TURN {
            track.ahead = None;
        }
        let fresh = core::mem::take(&mut track.fresh);
        // Requirement: WIRE-obstacle-2
        track.max_forward = match &mut track.ahead {
            None => self.blind_speed,
            Some(_) if travel <= 0 && !fresh => track.max_forward,
            Some(ahead) => {
                *ahead = ahead.saturating_sub(travel.max(0));
                let room = ahead.saturating_sub(self.clearance).max(0) as u32;
                let energy = braking_energy(room, self.deceleration);
                (stoppable(self.reaction, energy) << SPEED_SHIFT) as i32
            }
        };
    }

    /// The speed nearest to `commanded` that is allowed, µm/s, forward positive.
    // Requirement: WIRE-obstacle-2
    pub fn limit(&self, commanded: i32) -> i32 {
        commanded.min(self.max_forward()).max(-self.max_reverse())
    }

    /// Whether a commanded speed is not allowed, µm/s.
    pub fn limited(&self, commanded: i32) -> bool {
        self.limit(commanded) != commanded
    }

    /// Largest speed forward, µm/s, not negative.
    pub const fn max_forward(&self) -> i32 {
        self.track.max_forward
    }

    /// Largest speed backward, µm/s, not negative.
    // Requirement: WIRE-obstacle-3, WIRE-obstacle-4
    pub fn max_reverse(&self) -> i32 {
        match self.reverse_way {
            Some(way) if self.track.backward >= way => 0,
            _ => self.reverse_speed,
        }
    }
}

/// `2·a·t_r` in units of speed, rounded up: below 2¹⁷ for `a` ≤ 10 000 mm/s² and `t_r` ≤ 1000 ms.
// Requirement: WIRE-obstacle-1
pub const fn reaction_speed(deceleration: u32, reaction_time: u32) -> u32 {
    // 2·(10³·a)·(10⁻³·t) / 2⁸.
    (deceleration * reaction_time).div_ceil(1 << (SPEED_SHIFT - 1))
}

/// `2·a·room` in squared units of speed, rounded down, saturating; `room` in 2⁻¹⁶ mm, `deceleration` in
/// mm/s² / 125 000, below 2³¹.
// Requirement: WIRE-obstacle-1
pub const fn braking_energy(room: u32, deceleration: u32) -> u32 {
    let energy = (room as u64 * deceleration as u64) >> 28;
    if energy > u32::MAX as u64 {
        u32::MAX
    } else {
        energy as u32
    }
}

/// Way from `speed`, at most 2000 mm/s, until the robot stands, mm, rounded up; reaction time in ms,
/// at most 1000, deceleration in mm/s².
// Requirement: WIRE-obstacle-4
pub const fn stopping_way(speed: u32, reaction_time: u32, deceleration: u32) -> u32 {
    let braking = 2 * deceleration;
    let braking = if braking == 0 { 1 } else { braking };
    speed * reaction_time / 1000 + 1 + speed * speed / braking + 1
}

/// The largest `n` below 2¹⁴ with `n² + reaction·n ≤ energy`, bit by bit without a division;
/// `reaction` below 2¹⁷.
pub const fn stoppable(reaction: u32, energy: u32) -> u32 {
    let (mut n, mut rest) = (0, energy);
    let mut bit = SPEED_BITS;
    while bit > 0 {
        bit -= 1;
        // What this bit adds to the left side.
        let more = (2 * n + (1 << bit) + reaction) << bit;
        if more <= rest {
            rest -= more;
            n |= 1 << bit;
        }
    }
    n
}

#[cfg(test)]
mod tests;
