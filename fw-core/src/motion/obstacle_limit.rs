//! Obstacle stop: the range of speeds that keeps the robot clear of what the front rangefinder sees.
//!
//! Forward: `v·t_r + v²/(2a) ≤ max(0, d − overhang − stop_distance)`, `t_r` the reaction time, a the
//! deceleration, d the last echo within ±15° of straight ahead less the forward way since. The echo is
//! void after a newer one, three readings without one in a row, and 15° of turning; without an echo
//! the blind speed is the limit. Backward, where no sensor looks: the reverse speed, and where driven
//! by velocity only the reverse distance before the next way forward.

use crate::eeprom::{Config, ObstacleStop};
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
    /// The last echo less the forward way since, 2⁻¹⁶ mm.
    ahead: Option<i32>,
    /// The echo is newer than the limit.
    fresh: bool,
    /// Turned since that echo, 2⁻³² turns.
    turned: i32,
    misses: u8,
    /// Ways since the last change of direction, 2⁻¹⁶ mm.
    backward: i32,
    forward: i32,
    /// Largest speed forward, µm/s.
    max_forward: i32,
}

impl ObstacleLimit {
    /// Without an echo. `by_velocity`: the way back is limited too.
    pub fn new(config: &Config, by_velocity: bool) -> Self {
        let ObstacleStop {
            stop_distance_mm,
            overhang_mm,
            reaction_time,
            deceleration_mm_s2,
            blind_speed_mm_s,
            reverse_speed_mm_s,
            reverse_distance_mm,
        } = *config.obstacle_stop();
        let millimetres = |length: u16| i32::from(length) * MM;
        let deceleration = u32::from(deceleration_mm_s2);
        let reverse = u32::from(reverse_speed_mm_s);
        // Rolled at the reverse speed until the robot stands, mm.
        let stopping = reverse * u32::from(reaction_time.0) / 1000
            + 1
            + (reverse * reverse) / (2 * deceleration).max(1)
            + 1;
        Self {
            clearance: millimetres(stop_distance_mm) + millimetres(overhang_mm),
            // (2·10³·a µm/s²) · (10³/2¹⁶ µm) / 2¹⁶ = a · 2·10⁶/2³², below 2³¹ in 2⁻²⁸.
            deceleration: deceleration * 125_000,
            // 2·(10³·a)·(10⁻³·t) / 2⁸, rounded up.
            reaction: (deceleration * u32::from(reaction_time.0)).div_ceil(1 << (SPEED_SHIFT - 1)),
            blind_speed: i32::from(blind_speed_mm_s) * 1000,
            reverse_speed: i32::from(reverse_speed_mm_s) * 1000,
            reverse_way: by_velocity
                .then(|| (i32::from(reverse_distance_mm) - stopping as i32).max(0) * MM),
            ahead: None,
            fresh: false,
            turned: 0,
            misses: 0,
            backward: 0,
            forward: 0,
            max_forward: i32::from(blind_speed_mm_s) * 1000,
        }
    }

    /// A measurement of the front sensor that has ended: its bearing at the trigger, turn × 0x10000
    /// counter-clockwise from straight ahead, and its distance, `None` if nothing answered. Counts from
    /// the next [`Self::step`] on.
    // Requirement: WIRE-obstacle-2
    pub fn on_range(&mut self, bearing: u16, distance: Option<Millimetres>) {
        if (bearing as i16).unsigned_abs() > CONE {
            return;
        }
        if let Some(distance) = distance {
            // Down to the next 2⁻¹⁶ mm.
            let bits = (distance.0.to_bits() >> 16).clamp(0, i32::MAX.into());
            self.ahead = Some(bits as i32);
            self.fresh = true;
            (self.turned, self.misses) = (0, 0);
        } else {
            self.misses = self.misses.saturating_add(1);
            if self.misses >= MAX_MISSES {
                self.ahead = None;
            }
        }
    }

    /// Every tick, with the robot's motion since the last one.
    // Requirement: WIRE-obstacle-1
    pub fn step(&mut self, delta: &Delta) {
        let travel = delta.travel.to_bits();
        if travel > 0 {
            self.forward = self.forward.saturating_add(travel);
            if self.forward >= FORWARD_RUN {
                self.backward = 0;
            }
        } else if travel < 0 {
            self.forward = 0;
            self.backward = self.backward.saturating_sub(travel);
        }
        self.turned = self.turned.saturating_add(delta.turn);
        if self.turned.unsigned_abs() > MAX_TURN {
            self.ahead = None;
        }
        let fresh = core::mem::take(&mut self.fresh);
        self.max_forward = match &mut self.ahead {
            None => self.blind_speed,
            Some(_) if travel <= 0 && !fresh => self.max_forward,
            Some(ahead) => {
                *ahead = ahead.saturating_sub(travel.max(0));
                let room = ahead.saturating_sub(self.clearance).max(0) as u32;
                let energy = (u64::from(room) * u64::from(self.deceleration)) >> 28;
                let energy = u32::try_from(energy).unwrap_or(u32::MAX);
                (stoppable(self.reaction, energy) << SPEED_SHIFT) as i32
            }
        };
    }

    /// The speed nearest to `commanded` that is allowed, µm/s, forward positive.
    pub fn limit(&self, commanded: i32) -> i32 {
        commanded.min(self.max_forward).max(-self.max_reverse())
    }

    /// Whether a commanded speed is not allowed, µm/s.
    pub fn limited(&self, commanded: i32) -> bool {
        self.limit(commanded) != commanded
    }

    /// Largest speed forward, µm/s, not negative.
    pub const fn max_forward(&self) -> i32 {
        self.max_forward
    }

    /// Largest speed backward, µm/s, not negative.
    // Requirement: WIRE-obstacle-3, WIRE-obstacle-4
    pub fn max_reverse(&self) -> i32 {
        match self.reverse_way {
            Some(way) if self.backward >= way => 0,
            _ => self.reverse_speed,
        }
    }
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
            n += 1 << bit;
        }
    }
    n
}

#[cfg(test)]
mod tests;
