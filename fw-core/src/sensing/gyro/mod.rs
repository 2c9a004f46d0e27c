//! Fuses the gyroscope into the heading while a wheel slips.
//!
//! The encoders' heading is exact while the wheels grip; the gyroscope's is not: its scale is 3 % off and
//! its zero drifts. So the heading is the encoders' until both differ by more than these errors explain.
//! Then a wheel slips or the robot is turned by force, and from there on, including the difference in
//! the window, the heading follows the gyroscope until both agree again. The sum of the corrections
//! remains as an offset; without a slip it is 0 and the heading is the encoders' to the last bit.
//!
//! | condition | threshold | reason |
//! |---|---|---|
//! | slip starts | difference beyond 1° + ⅛ of the wheels' turn within 0.32 s | ⅛: scale 3 %, 2 % over temperature (PS-MPU-6000A, 6.1), track 3 % and a quarter of a tick between both. 1°: a bias drift of 1 °/s is 0.3°, the rest for bumps and backlash |
//! | slip ends | ten consecutive ticks within 0.1° + ⅛ of the tick's turn | |
//! | not detected | a slip below 3 °/s + ⅛ of the wheels' turn | may be bias or scale |
//! | timed out | two seconds of slip with turning wheels | a robot that is held must not turn its wheels for ever because of a sensor |
//! | trusted | after agreeing with the encoders over a turn of 10° | a gyroscope mounted upside down or set up wrongly never affects the heading |
//!
//! A robot turned by hand with its wheels standing is followed without a time limit.

mod bias;
mod window;

use super::mpu6050::LSB_PER_DEGREE_TENTHS;
use crate::types::{Delta, HeadingCorrection};
use bias::Bias;
pub use bias::MAX_BIAS;
use window::Window;

/// 1°, 2⁻³² turns.
const DEGREE: i64 = 11_930_465;
/// Difference allowed in the window beside the share, 2⁻³² turns.
const WINDOW_SLACK: i64 = DEGREE;
/// The same in a tick.
const TICK_SLACK: i64 = DEGREE / 10;
/// Difference allowed as a share of the turn, 2⁻ⁿ.
const SHARE_SHIFT: u32 = 3;
/// Consecutive ticks of agreement that end a slip.
const AGREEING_TICKS: u8 = 10;
/// Ticks of slip with turning wheels before the time-out.
const MAX_SLIP_TICKS: u16 = 200;
/// Turn over which both must agree before the gyroscope is trusted, 2⁻²⁸ turns.
const VERIFICATION_TURN: i32 = ((10 * DEGREE) >> 4) as i32;
/// Ticks within which this turn must happen: a bias drift of 0.5 °/s is 1.5° by then.
const MAX_VERIFICATION_TICKS: u16 = 300;
/// Consecutive failed verifications before [`Event::Mismatch`].
const MAX_MISMATCHES: u8 = 3;
/// Readings from here on are at the end of the range: 499 °/s.
const SATURATED: i16 = 32_700;
/// Ticks without a reading until the last rate expires.
const STALE_TICKS: u8 = 5;
/// Turn in a tick per LSB, 2⁻³² turns: 2³² ÷ (65.5 · 36 000), 2⁻¹⁴.
const TURN_PER_LSB: i64 = ((10_i64 << 46) / LSB_PER_DEGREE_TENTHS as i64 + 18_000) / 36_000;

/// Changes of state, for the log and the faults.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Event {
    /// First bias since the start or a loss, 2⁻⁸ LSB.
    BiasUpdated(i32),
    /// The gyroscope agreed with the encoders: slip detection is active.
    Trusted,
    /// The heading follows the gyroscope.
    SlipStarted,
    /// The heading follows the encoders again; sum of the corrections, 2⁻³² turns.
    SlipEnded(i64),
    /// The slip lasted implausibly long: the gyroscope is unverified again.
    SlipTimedOut,
    /// The gyroscope repeatedly contradicts the encoders.
    Mismatch,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Trust {
    /// Turns of both during the present verification, 2⁻²⁸ turns, its ticks, and the consecutive
    /// verifications that failed before.
    Unverified {
        wheels: i32,
        gyro: i32,
        ticks: u16,
        mismatches: u8,
    },
    Trusted,
    Slipping {
        agreeing_ticks: u8,
        /// With turning wheels.
        ticks: u16,
        /// Sum of the corrections, 2⁻³² turns.
        corrected: i64,
    },
}

/// Starts a verification.
const fn unverified(mismatches: u8) -> Trust {
    Trust::Unverified {
        wheels: 0,
        gyro: 0,
        ticks: 0,
        mismatches,
    }
}

/// Slip detection and heading correction.
#[derive(Clone, Copy, Debug)]
pub struct GyroFusion {
    bias: Bias,
    window: Window,
    trust: Trust,
    /// The last reading, and its age in ticks.
    raw: i16,
    age: u8,
    /// Turned since the first bias, 2⁻³² turns.
    angle: i64,
}

impl Default for GyroFusion {
    fn default() -> Self {
        Self::new()
    }
}

impl GyroFusion {
    /// Without a bias.
    pub const fn new() -> Self {
        Self {
            bias: Bias::new(),
            window: Window::new(),
            trust: unverified(0),
            raw: 0,
            age: STALE_TICKS,
            angle: 0,
        }
    }

    /// Whether the heading follows the gyroscope now.
    pub const fn is_slipping(&self) -> bool {
        matches!(self.trust, Trust::Slipping { .. })
    }

    /// 2⁻⁸ LSB, within ±[`MAX_BIAS`]; `None` before the first rest.
    pub const fn bias(&self) -> Option<i32> {
        self.bias.get()
    }

    /// The gyroscope's own angle since the first bias, 2⁻³² turns, wrapping, the last known bias taken off each
    /// tick; `None` before the first bias.
    // Requirement: WIRE-gyro-2, WIRE-gyro-3
    #[must_use]
    pub fn angle(&self) -> Option<i64> {
        self.bias().map(|_| self.angle)
    }

    /// One tick: the reading taken just after its counters, LSB, if there is one; the encoders' `delta`, and
    /// their `turn`, 2⁻³² turns.
    pub fn step(
        &mut self,
        reading: Option<i16>,
        delta: &Delta,
        turn: i32,
    ) -> (HeadingCorrection, Option<Event>) {
        let nothing = HeadingCorrection::default();
        match reading {
            Some(raw) if raw.saturating_abs() < SATURATED => {
                self.raw = raw;
                self.age = 0;
            }
            // Rate unknown: the difference so far is not attributed to a wheel.
            Some(_) => self.age = STALE_TICKS,
            None => self.age = self.age.saturating_add(1).min(STALE_TICKS),
        }
        if self.age >= STALE_TICKS {
            self.bias.disturb();
            self.window = Window::new();
            return (nothing, self.end_slip());
        }
        let moved = delta.left != 0 || delta.right != 0;
        if moved || self.age != 0 || self.is_slipping() {
            self.bias.disturb();
        } else if self.bias.rest(self.raw) {
            return (nothing, self.bias.get().map(Event::BiasUpdated));
        }
        let Some(bias) = self.bias.get() else {
            return (nothing, None);
        };
        let gyro = turn_of(self.raw, bias);
        self.angle = self.angle.wrapping_add(gyro.into());
        let difference = gyro.wrapping_sub(turn);
        self.window.push(difference, turn);
        match self.trust {
            Trust::Unverified { .. } => (nothing, self.verify(gyro, turn)),
            Trust::Trusted => self.detect(difference),
            Trust::Slipping { .. } => self.correct(difference, turn, moved),
        }
    }

    /// While unverified.
    fn verify(&mut self, gyro: i32, turn: i32) -> Option<Event> {
        let Trust::Unverified {
            wheels,
            gyro: gyro_before,
            ticks,
            mismatches,
        } = self.trust
        else {
            return None;
        };
        if self.bias.at_rest() || ticks >= MAX_VERIFICATION_TICKS {
            self.trust = unverified(mismatches);
            return None;
        }
        // The wheels gain at most half a turn in the last tick, the gyroscope 5.3 turns in all.
        let (wheels, gyro) = (wheels + (turn >> 4), gyro_before + (gyro >> 4));
        if wheels.abs() < VERIFICATION_TURN {
            self.trust = Trust::Unverified {
                wheels,
                gyro,
                ticks: ticks + 1,
                mismatches,
            };
            return None;
        }
        if (gyro - wheels).abs() <= (WINDOW_SLACK >> 4) as i32 + (wheels.abs() >> SHARE_SHIFT) {
            self.window = Window::new();
            self.trust = Trust::Trusted;
            return Some(Event::Trusted);
        }
        let mismatches = mismatches.saturating_add(1);
        self.trust = unverified(mismatches);
        (mismatches == MAX_MISMATCHES).then_some(Event::Mismatch)
    }

    /// While the wheels grip.
    fn detect(&mut self, difference: i32) -> (HeadingCorrection, Option<Event>) {
        let limit = WINDOW_SLACK + (self.window.turned() >> SHARE_SHIFT) as i64;
        let total = self.window.difference();
        if total.abs() <= limit {
            return (HeadingCorrection::default(), None);
        }
        self.trust = Trust::Slipping {
            agreeing_ticks: 0,
            ticks: 0,
            corrected: total,
        };
        // Modulo a turn, as a heading is.
        let correction = HeadingCorrection {
            heading: total as i32,
            tick: difference,
        };
        (correction, Some(Event::SlipStarted))
    }

    /// While a wheel slips.
    fn correct(
        &mut self,
        difference: i32,
        turn: i32,
        moved: bool,
    ) -> (HeadingCorrection, Option<Event>) {
        let Trust::Slipping {
            agreeing_ticks,
            ticks,
            corrected,
        } = self.trust
        else {
            return (HeadingCorrection::default(), None);
        };
        let agrees =
            i64::from(difference).abs() <= TICK_SLACK + (i64::from(turn).abs() >> SHARE_SHIFT);
        let agreeing_ticks = if agrees { agreeing_ticks + 1 } else { 0 };
        let ticks = ticks.saturating_add(moved.into());
        let corrected = corrected.saturating_add(difference.into());
        self.trust = Trust::Slipping {
            agreeing_ticks,
            ticks,
            corrected,
        };
        let correction = HeadingCorrection {
            heading: difference,
            tick: difference,
        };
        if agreeing_ticks >= AGREEING_TICKS {
            return (correction, self.end_slip());
        }
        if ticks >= MAX_SLIP_TICKS {
            self.trust = unverified(0);
            return (correction, Some(Event::SlipTimedOut));
        }
        (correction, None)
    }

    /// Ends a slip, if there is one. The window's difference is part of the corrections already.
    fn end_slip(&mut self) -> Option<Event> {
        let Trust::Slipping { corrected, .. } = self.trust else {
            return None;
        };
        self.window = Window::new();
        self.trust = Trust::Trusted;
        Some(Event::SlipEnded(corrected))
    }
}

/// Turn in a tick, 2⁻³² turns, within ±6.3°.
const fn turn_of(raw: i16, bias: i32) -> i32 {
    // Below 2²⁴ times below 2²⁵, and 22 fractional bits.
    (((((raw as i32) << 8) - bias) as i64 * TURN_PER_LSB + (1 << 21)) >> 22) as i32
}

/// A bias of 2⁻⁸ LSB, within ±[`MAX_BIAS`], in hundredths of a degree per second.
pub const fn hundredths(bias: i32) -> i32 {
    bias * 1000 / (LSB_PER_DEGREE_TENTHS as i32 * 256)
}

#[cfg(test)]
mod tests;
