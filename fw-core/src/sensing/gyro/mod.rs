//! Does the robot turn as its wheels say? The gyroscope watches; the encoders tell the heading.
//!
//! The encoders' heading is exact as long as the wheels grip, and a gyroscope's is not: its scale is
//! 3 % off, its zero drifts. So the heading takes nothing from the gyroscope until the two come
//! apart further than all of that can explain. Then a wheel slips, or somebody turns the robot, and
//! from there on, the way they had come apart in the window included, the heading turns as the
//! gyroscope does until both agree again. What was added stays added; the heading is the encoders'
//! plus one offset, as exact as before. Without a slip the offset is 0 and the heading is the
//! encoders' to the last bit.
//!
//! | what | figure | why |
//! |---|---|---|
//! | slip begins | 1° + ⅛ of what the wheels turned, apart within 0.32 s | ⅛: scale 3 % and 2 % over temperature (PS-MPU-6000A, 6.1), a track 3 % off, and a quarter of a tick between the two. 1°: a bias that drifted by 1 °/s is 0.3°, a bump or a count's play the rest |
//! | slip ends | ten ticks in a row within 0.1° + ⅛ of the tick's turn | a tenth of a second longer than the slip |
//! | not seen | a slip that turns the robot by less than 3 °/s + ⅛ of what the wheels say | it may be bias or scale |
//! | given up | two seconds of slip on turning wheels | a robot that is held must not turn its wheels for ever because a sensor says that it stands |
//! | believed | once it agreed with the encoders over a turn of 10° | one that is mounted upside down, on its side, or set up wrongly never touches the heading |
//!
//! A robot that is only turned by a hand, wheels standing, is followed for as long as it takes.

mod bias;
mod window;

use super::mpu6050::LSB_PER_DEGREE_TENTHS;
use crate::types::{Delta, HeadingCorrection};
use bias::Bias;
pub use bias::MOST as BIAS_MOST;
use window::Window;

/// 1°, 2⁻³² turns.
const DEGREE: i64 = 11_930_465;
/// What may come apart in the window beside the share, 2⁻³² turns.
const SLACK: i64 = DEGREE;
/// The same in a tick.
const TICK_SLACK: i64 = DEGREE / 10;
/// Share of the turn that they may differ by, 2⁻ⁿ.
const SHARE: u32 = 3;
/// Ticks in a row that agree and end a slip.
const QUIET: u8 = 10;
/// Ticks of slip on turning wheels until it is not believed.
const LONGEST: u16 = 200;
/// A turn over which it must have agreed.
const PROOF: i64 = 10 * DEGREE;
/// Ticks within which it must be turned: a bias that drifted by 0.5 °/s is 1.5° by then.
const STRETCH: u16 = 300;
/// Proofs in a row that fail before it is said.
const MAX_MISMATCHES: u8 = 3;
/// Readings beyond this are at the end of the range: the robot turns faster than 499 °/s.
const SATURATED: i16 = 32_700;
/// Ticks without a reading over which the rate is taken as it was.
const STALE: u8 = 5;
/// Turn of a tick, 2⁻³² turns, of one least significant bit: 2³² ÷ (65.5 · 36 000), 2⁻¹⁴.
const TURN: i64 = ((10_i64 << 46) / LSB_PER_DEGREE_TENTHS as i64 + 18_000) / 36_000;

/// What happened, for the log and the faults.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Event {
    /// The bias is known for the first time since it was found, 2⁻⁸ least significant bits.
    BiasUpdated(i32),
    /// It agreed with the encoders: from now on it guards the heading.
    Trusted,
    /// A wheel slips.
    SlipStarted,
    /// It grips again; what was added to the heading, 2⁻³² turns.
    SlipEnded(i64),
    /// It slipped too long to be true.
    SlipTimedOut,
    /// It turns otherwise than the wheels, time and again.
    Mismatch,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Trust {
    /// What both turned in the stretch under way, 2⁻³² turns, how many ticks it is long, and how many
    /// stretches in a row did not agree.
    Unverified {
        wheels: i64,
        gyro: i64,
        ticks: u16,
        mismatches: u8,
    },
    Trusted,
    Slipping {
        quiet: u8,
        ticks: u16,
        added: i64,
    },
}

/// A new stretch.
const fn unverified(mismatches: u8) -> Trust {
    Trust::Unverified {
        wheels: 0,
        gyro: 0,
        ticks: 0,
        mismatches,
    }
}

/// The watcher.
#[derive(Clone, Copy, Debug)]
pub struct GyroFusion {
    bias: Bias,
    window: Window,
    trust: Trust,
    /// The last reading, and its age in ticks.
    raw: i16,
    age: u8,
}

impl Default for GyroFusion {
    fn default() -> Self {
        Self::new()
    }
}

impl GyroFusion {
    /// Nothing seen yet.
    #[must_use]
    pub const fn new() -> Self {
        Self {
            bias: Bias::new(),
            window: Window::new(),
            trust: unverified(0),
            raw: 0,
            age: STALE,
        }
    }

    /// Whether the heading follows the gyroscope now.
    #[must_use]
    pub const fn is_slipping(&self) -> bool {
        matches!(self.trust, Trust::Slipping { .. })
    }

    /// The bias, 2⁻⁸ least significant bits, within ±[`BIAS_MOST`] of them; `None` before a rest.
    #[must_use]
    pub const fn bias(&self) -> Option<i32> {
        self.bias.get()
    }

    /// It may be another one when it answers again, or have lost its zero.
    pub fn lost(&mut self) -> Option<Event> {
        let event = self.release();
        *self = Self::new();
        event
    }

    /// A tick: the reading taken just after its counters, `None` if there is none, and what the
    /// encoders say happened in it, `turn` of which in 2⁻³² turns.
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
            // How fast it turned nobody knows: what came apart so far is not to be blamed on a wheel.
            Some(_) => self.age = STALE,
            None => self.age = self.age.saturating_add(1).min(STALE),
        }
        if self.age >= STALE {
            self.bias.disturb();
            self.window = Window::new();
            return (nothing, self.release());
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
        let apart = gyro.wrapping_sub(turn);
        self.window.push(apart, turn);
        match self.trust {
            Trust::Unverified { .. } => (nothing, self.prove(gyro, turn)),
            Trust::Trusted => self.watch(apart),
            Trust::Slipping { .. } => self.follow(apart, turn, moved),
        }
    }

    /// Not believed yet.
    fn prove(&mut self, gyro: i32, turn: i32) -> Option<Event> {
        let Trust::Unverified {
            wheels,
            gyro: before,
            ticks,
            mismatches,
        } = self.trust
        else {
            return None;
        };
        if self.bias.at_rest() || ticks >= STRETCH {
            self.trust = unverified(mismatches);
            return None;
        }
        // Each gains at most half a turn a tick.
        let (wheels, gyro) = (wheels + i64::from(turn), before + i64::from(gyro));
        if wheels.abs() < PROOF {
            self.trust = Trust::Unverified {
                wheels,
                gyro,
                ticks: ticks + 1,
                mismatches,
            };
            return None;
        }
        if (gyro - wheels).abs() <= SLACK + (wheels.abs() >> SHARE) {
            self.window = Window::new();
            self.trust = Trust::Trusted;
            return Some(Event::Trusted);
        }
        let mismatches = mismatches.saturating_add(1);
        self.trust = unverified(mismatches);
        (mismatches == MAX_MISMATCHES).then_some(Event::Mismatch)
    }

    /// Both agreed so far.
    fn watch(&mut self, apart: i32) -> (HeadingCorrection, Option<Event>) {
        let limit = SLACK + (self.window.turned() >> SHARE) as i64;
        let all = self.window.apart();
        if all.abs() <= limit {
            return (HeadingCorrection::default(), None);
        }
        self.trust = Trust::Slipping {
            quiet: 0,
            ticks: 0,
            added: all,
        };
        // Modulo a turn, as a heading is.
        let correction = HeadingCorrection {
            heading: all as i32,
            tick: apart,
        };
        (correction, Some(Event::SlipStarted))
    }

    /// The wheels do not tell how the robot turns.
    fn follow(&mut self, apart: i32, turn: i32, moved: bool) -> (HeadingCorrection, Option<Event>) {
        let Trust::Slipping {
            quiet,
            ticks,
            added,
        } = self.trust
        else {
            return (HeadingCorrection::default(), None);
        };
        let agrees = i64::from(apart).abs() <= TICK_SLACK + (i64::from(turn).abs() >> SHARE);
        let quiet = if agrees { quiet + 1 } else { 0 };
        let ticks = ticks.saturating_add(moved.into());
        let added = added.saturating_add(apart.into());
        self.trust = Trust::Slipping {
            quiet,
            ticks,
            added,
        };
        let correction = HeadingCorrection {
            heading: apart,
            tick: apart,
        };
        if quiet >= QUIET {
            return (correction, self.release());
        }
        if ticks >= LONGEST {
            self.window = Window::new();
            self.trust = unverified(0);
            return (correction, Some(Event::SlipTimedOut));
        }
        (correction, None)
    }

    /// Ends a slip, if there is one. What the window holds has been added already.
    fn release(&mut self) -> Option<Event> {
        let Trust::Slipping { added, .. } = self.trust else {
            return None;
        };
        self.window = Window::new();
        self.trust = Trust::Trusted;
        Some(Event::SlipEnded(added))
    }
}

/// A reading as the turn of a tick, 2⁻³² turns: at most 6.3° either way.
const fn turn_of(raw: i16, bias: i32) -> i32 {
    // Below 2²⁴ times below 2²⁵, and 22 fractional bits.
    (((((raw as i32) << 8) - bias) as i64 * TURN + (1 << 21)) >> 22) as i32
}

/// Hundredths of a degree per second of a bias.
#[must_use]
pub const fn hundredths(bias: i32) -> i64 {
    // 655 · 256 / 1000 = 4192 / 25: a 32-bit division, which the core has.
    (bias.saturating_mul(25) / (LSB_PER_DEGREE_TENTHS as i32 * 32 / 5)) as i64
}

#[cfg(test)]
mod tests;
