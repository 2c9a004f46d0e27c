//! Scan servo of the front rangefinder: bearing, pulse widths, and when the sensor may be triggered.
//!
//! A hobby servo turns to the angle that the pulse width encodes, 50 pulses a second, without feedback.
//! Its position follows from the last pulses and the time since:
//!
//! | time after a trigger | event |
//! |---|---|
//! | 0 | the servo is settled, the sensor is triggered: bearing of this reading |
//! | 20 ms | every object within range has answered; the pulse of the next bearing begins |
//! | 22 ms | the pulse has ended; the servo turns 10° in 25 ms |
//! | 47 to 60 ms | it settles |
//! | 60 ms | next trigger |
//!
//! Pulses begin with the first fresh frame and end with the stop deadline or a blocking fault. Without
//! pulses the servo is free to be moved, so after a pause the sensor is not triggered until the servo
//! had the time for its whole travel.

use super::rangefinder::LISTEN_TICKS;
use crate::eeprom::Config;
use crate::types::RangefinderId;
use core::num::NonZeroU16;

/// Ticks from pulse to pulse: 50 Hz.
const PULSE_PERIOD: u8 = 2;
/// Pulse width at the centre of the travel, microseconds.
const CENTRE_WIDTH: u16 = 1500;
/// Deviation of the pulse width at either end of the travel, microseconds.
const HALF_SPAN: u16 = 500;
/// Half a turn, turn × 0x10000.
const HALF_TURN: u32 = 0x8000;
/// Steps of a whole turn: 10° at most.
const STEPS_PER_TURN: u32 = 36;
/// Ticks from the pulse of a new bearing until the servo is settled: 2 ms of pulse, 25 ms for 10° at
/// 60° in 0.15 s, 13 ms to settle.
pub const STEP_TICKS: u8 = 4;
/// Ticks until it is settled from anywhere: 450 ms for 180°, and to settle.
// Requirement: WIRE-servo-2
pub const FULL_TRAVEL_TICKS: u8 = 50;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Phase {
    /// Without pulses, position unknown.
    Off,
    /// Turning, for so many more ticks.
    Turning(u8),
    /// At its bearing.
    Settled,
    /// At its bearing, the sensor listens for so many more ticks.
    Listening(u8),
    /// Straight ahead permanently, without pulses.
    Parked,
}

/// The servo of the front rangefinder, if there is one.
// Requirement: DOC-2.2-3
#[derive(Clone, Debug)]
pub struct ServoScan {
    phase: Phase,
    /// Scans; else it parks straight ahead.
    scans: bool,
    /// Bearing at the centre of the travel, turn × 0x10000.
    centre: u16,
    /// Change of bearing from 1.0 to 2.0 ms, turn × 0x10000; negative if a longer pulse turns clockwise.
    travel: i32,
    /// Steps of the travel.
    steps: NonZeroU16,
    /// Steps from the 1.0 ms end.
    position: u16,
    /// Scans towards the 2.0 ms end.
    ascending: bool,
    /// Ticks to the next pulse.
    next_pulse: u8,
}

impl ServoScan {
    /// Without pulses at first. The servo scans, or parks straight ahead; without a servo the sensor
    /// always points there.
    // Requirement: WIRE-platform-6
    pub fn new(config: &Config, scans: bool) -> Self {
        let servo = config.servo();
        let travel = servo.map_or(HALF_TURN, |servo| servo.travel.0 >> 16);
        let steps = (travel * STEPS_PER_TURN).div_ceil(1 << 16);
        let travel = travel as i32;
        Self {
            phase: if servo.is_some() {
                Phase::Off
            } else {
                Phase::Parked
            },
            scans,
            centre: (config.bearing(RangefinderId::Front).0 >> 16) as u16,
            travel: if servo.is_some_and(|servo| servo.reversed) {
                -travel
            } else {
                travel
            },
            // 18 at most.
            steps: NonZeroU16::new(steps as u16).unwrap_or(NonZeroU16::MIN),
            position: 0,
            ascending: true,
            next_pulse: 0,
        }
    }

    /// Every 10 ms: the width of the pulse to send now, microseconds, if one is due. `live`: within the
    /// stop deadline and without a blocking fault.
    // Requirement: WIRE-servo-1, WIRE-servo-3
    pub fn tick(&mut self, live: bool) -> Option<u16> {
        if self.phase == Phase::Parked {
            return None;
        }
        if !live {
            self.phase = Phase::Off;
            return None;
        }
        let pulse_due = self.next_pulse == 0 || self.phase == Phase::Off;
        self.next_pulse = if pulse_due {
            PULSE_PERIOD - 1
        } else {
            self.next_pulse - 1
        };
        self.phase = match self.phase {
            Phase::Off => {
                self.position = 0;
                self.ascending = true;
                Phase::Turning(FULL_TRAVEL_TICKS)
            }
            Phase::Turning(left) if left > 1 => Phase::Turning(left - 1),
            Phase::Turning(_) if self.scans => Phase::Settled,
            Phase::Turning(_) => Phase::Parked,
            Phase::Listening(left) if left > 1 => Phase::Listening(left - 1),
            // Only with a pulse: without one the servo would start a tick late.
            Phase::Listening(_) if pulse_due => {
                self.step();
                Phase::Turning(STEP_TICKS)
            }
            phase @ (Phase::Listening(_) | Phase::Settled | Phase::Parked) => phase,
        };
        (pulse_due && self.phase != Phase::Parked).then(|| self.pulse_width())
    }

    /// The next bearing, reversing at the ends of the travel: consecutive readings differ in it.
    // Requirement: WIRE-bearing-4, WIRE-bearing-5
    fn step(&mut self) {
        if self.position >= self.steps.get() {
            self.ascending = false;
        } else if self.position == 0 {
            self.ascending = true;
        }
        self.position = if self.ascending {
            self.position + 1
        } else {
            self.position - 1
        };
    }

    /// The sensor's bearing, turn × 0x10000, while it is settled and may be triggered.
    // Requirement: WIRE-bearing-2
    pub fn settled_bearing(&self) -> Option<u16> {
        match self.phase {
            Phase::Parked => Some(self.centre),
            Phase::Settled => Some(self.bearing()),
            Phase::Off | Phase::Turning(_) | Phase::Listening(_) => None,
        }
    }

    /// Whether the bearing is unknown: earlier readings are void.
    pub const fn is_off(&self) -> bool {
        matches!(self.phase, Phase::Off)
    }

    /// The sensor was triggered: the servo rests until every object within range has answered.
    pub fn triggered(&mut self) {
        if self.phase == Phase::Settled {
            self.phase = Phase::Listening(LISTEN_TICKS);
        }
    }

    /// Width of the pulse at the present position, microseconds.
    fn pulse_width(&self) -> u16 {
        if !self.scans {
            return CENTRE_WIDTH;
        }
        CENTRE_WIDTH - HALF_SPAN
            + (2 * HALF_SPAN * self.position + self.steps.get() / 2) / self.steps
    }

    /// Bearing encoded by the rounded pulse, turn × 0x10000.
    // Requirement: WIRE-platform-5
    fn bearing(&self) -> u16 {
        let deviation = i32::from(self.pulse_width()) - i32::from(CENTRE_WIDTH);
        let angle = deviation * self.travel / (2 * i32::from(HALF_SPAN));
        self.centre.wrapping_add(angle as u16)
    }
}

#[cfg(test)]
mod tests;
