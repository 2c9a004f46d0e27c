//! The servo that swings the front rangefinder: where it points, when it may measure, what it is told.
//!
//! A hobby servo turns to the angle that the width of a pulse names, 50 pulses a second, and says
//! nothing back. So what it does is known from what it was told and from how long ago that was:
//!
//! | time after a trigger | what happens |
//! |---|---|
//! | 0 | the servo stands, the sensor is triggered: this reading's bearing |
//! | 20 ms | everything within range has answered; the pulse of the next bearing begins |
//! | 22 ms | the pulse is over at the latest: the servo turns, 10° in 25 ms |
//! | 47 to 60 ms | it settles |
//! | 60 ms | the sensor is triggered anew, as soon as it allows |
//!
//! Nothing on the robot moves before somebody talks to it: pulses begin with the first fresh frame and
//! end with the last one's deadline, and with a fault that stops the robot. Without pulses the servo
//! has no force and stands; when they begin again it may stand anywhere, and nothing is measured
//! before it has had the time for its whole travel.

use super::rangefinder::LISTEN;
use crate::eeprom::Platform;
use core::num::NonZeroU16;

/// Ticks from pulse to pulse: 50 Hz.
const FRAME: u8 = 2;
/// Microseconds of the pulse in the middle of the travel.
const MIDDLE: u16 = 1500;
/// Microseconds of the pulse on each side of that: 1.0 to 2.0 ms.
const ASIDE: u16 = 500;
/// The travel that a configuration's 0 stands for: half a turn.
const HALF_TURN: u16 = 0x8000;
/// Steps of a whole turn: none is longer than 10°.
const STEPS_OF_A_TURN: u32 = 36;
/// Ticks from the pulse of a new bearing until the servo stands there: 2 ms of pulse, 25 ms for 10° at
/// 60° in 0.15 s, 13 ms to settle.
pub const STEP: u8 = 4;
/// Ticks until it stands wherever it was before: 450 ms for 180°, and to settle.
// Requirement: WIRE-servo-2
pub const ANYWHERE: u8 = 50;

/// What the servo is doing.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Phase {
    /// No pulses: nobody knows where it stands.
    Off,
    /// On its way, for so many ticks more.
    Turning(u8),
    /// It stands where it was told.
    Still,
    /// It stands, and the sensor listens for so many ticks more.
    Listening(u8),
    /// Straight ahead for good, without pulses.
    Parked,
}

/// The servo of the front rangefinder, if there is one.
// Requirement: DOC-2.2-3
#[derive(Clone, Debug)]
pub struct ServoScan {
    phase: Phase,
    /// Whether it sweeps; else it is parked straight ahead.
    sweeps: bool,
    /// Bearing in the middle of the travel, turn × 0x10000.
    front: u16,
    /// Bearings from 1.0 to 2.0 ms, turn × 0x10000; negative where a longer pulse turns clockwise.
    travel: i32,
    /// The travel in so many steps.
    steps: NonZeroU16,
    /// Steps from the 1.0 ms end.
    at: u16,
    /// Towards the 2.0 ms end.
    up: bool,
    /// Ticks to the next pulse.
    frame: u8,
}

impl ServoScan {
    /// A servo at rest. It sweeps or turns the sensor straight ahead; without one the sensor always
    /// points there.
    // Requirement: WIRE-platform-6
    #[must_use]
    pub fn new(platform: &Platform, sweeps: bool) -> Self {
        let travel = match platform.servo_travel {
            0 => HALF_TURN,
            travel => travel.min(HALF_TURN),
        };
        let steps = (u32::from(travel) * STEPS_OF_A_TURN).div_ceil(1 << 16);
        let travel = i32::from(travel);
        Self {
            phase: if platform.servo {
                Phase::Off
            } else {
                Phase::Parked
            },
            sweeps,
            front: platform.bearings[0],
            travel: if platform.servo_reversed {
                -travel
            } else {
                travel
            },
            // 18 at most.
            steps: NonZeroU16::new(steps as u16).unwrap_or(NonZeroU16::MIN),
            at: 0,
            up: true,
            frame: 0,
        }
    }

    /// Every 10 ms, `live` while somebody talks to a robot that nothing has stopped: the pulse to send
    /// now, microseconds, if it is time for one.
    // Requirement: WIRE-servo-1, WIRE-servo-3
    pub fn tick(&mut self, live: bool) -> Option<u16> {
        if self.phase == Phase::Parked {
            return None;
        }
        if !live {
            self.phase = Phase::Off;
            return None;
        }
        // A pulse ends long before the next tick, so a bearing changes between two of them.
        let pulse_due = self.frame == 0 || self.phase == Phase::Off;
        self.frame = if pulse_due { FRAME - 1 } else { self.frame - 1 };
        self.phase = match self.phase {
            Phase::Off => {
                self.at = 0;
                self.up = true;
                Phase::Turning(ANYWHERE)
            }
            Phase::Turning(left) if left > 1 => Phase::Turning(left - 1),
            Phase::Turning(_) if self.sweeps => Phase::Still,
            Phase::Turning(_) => Phase::Parked,
            Phase::Listening(left) if left > 1 => Phase::Listening(left - 1),
            // Only with a pulse, or the servo would learn of it a tick later than the plan says.
            Phase::Listening(_) if pulse_due => {
                self.step();
                Phase::Turning(STEP)
            }
            phase @ (Phase::Listening(_) | Phase::Still | Phase::Parked) => phase,
        };
        (pulse_due && self.phase != Phase::Parked).then(|| self.pulse())
    }

    /// The next bearing, back from the ends of the travel: no two readings in turn share one.
    // Requirement: WIRE-bearing-4, WIRE-bearing-5
    fn step(&mut self) {
        if self.at >= self.steps.get() {
            self.up = false;
        } else if self.at == 0 {
            self.up = true;
        }
        self.at = if self.up { self.at + 1 } else { self.at - 1 };
    }

    /// Where the sensor points, turn × 0x10000, if it stands there: the only time to trigger it.
    // Requirement: WIRE-bearing-2
    #[must_use]
    pub fn settled_bearing(&self) -> Option<u16> {
        match self.phase {
            Phase::Parked => Some(self.front),
            Phase::Still => Some(self.bearing()),
            Phase::Off | Phase::Turning(_) | Phase::Listening(_) => None,
        }
    }

    /// Whether nobody knows where it points: what it measured before means nothing any more.
    #[must_use]
    pub const fn is_off(&self) -> bool {
        matches!(self.phase, Phase::Off)
    }

    /// The sensor was triggered: it keeps still until everything within range has answered.
    pub fn triggered(&mut self) {
        if self.phase == Phase::Still {
            self.phase = Phase::Listening(LISTEN);
        }
    }

    /// Microseconds.
    fn pulse(&self) -> u16 {
        if !self.sweeps {
            return MIDDLE;
        }
        MIDDLE - ASIDE + (2 * ASIDE * self.at + self.steps.get() / 2) / self.steps
    }

    /// What the pulse as it is sent stands for, turn × 0x10000.
    // Requirement: WIRE-platform-5
    fn bearing(&self) -> u16 {
        let aside = i32::from(self.pulse()) - i32::from(MIDDLE);
        let angle = aside * self.travel / (2 * i32::from(ASIDE));
        self.front.wrapping_add(angle as u16)
    }
}

#[cfg(test)]
mod tests;
