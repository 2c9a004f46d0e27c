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
//! The scan covers the whole travel or, by command, a part of it around the centre. The sensors at the sides
//! are triggered while it turns.
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
    /// Turning from anywhere, for so many more ticks.
    Homing(u8),
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
    /// Half the width of the scan, turn × 0x10000, at most half the travel; commanded, and in use.
    commanded: u16,
    half_width: u16,
    /// Deviation of the pulse width at either end of the scan, microseconds.
    half_span: u16,
    /// Steps of the scan.
    steps: NonZeroU16,
    /// Steps from the end of the shorter pulse.
    position: u16,
    /// Scans towards the longer pulse.
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
        let half_width = (travel / 2) as u16;
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
            commanded: half_width,
            half_width,
            half_span: HALF_SPAN,
            steps: steps(travel as u32),
            position: 0,
            ascending: true,
            next_pulse: 0,
        }
    }

    /// Every 10 ms: the width of the pulse to send now, microseconds, if one is due. `live`: within the
    /// stop deadline and without a blocking fault.
    // Requirement: WIRE-servo-1, WIRE-servo-3
    pub fn tick(&mut self, live: bool) -> Option<u16> {
        if matches!(self.phase, Phase::Parked) {
            return None;
        }
        if !live {
            self.phase = Phase::Off;
            return None;
        }
        let pulse_due = self.next_pulse == 0 || matches!(self.phase, Phase::Off);
        self.next_pulse = if pulse_due {
            PULSE_PERIOD - 1
        } else {
            self.next_pulse - 1
        };
        self.phase = match self.phase {
            Phase::Off => {
                self.apply_width();
                // From here the next step ascends.
                self.position = 0;
                Phase::Homing(FULL_TRAVEL_TICKS)
            }
            Phase::Homing(left) if left > 1 => Phase::Homing(left - 1),
            Phase::Turning(left) if left > 1 => Phase::Turning(left - 1),
            Phase::Homing(_) | Phase::Turning(_) if self.scans => Phase::Settled,
            Phase::Homing(_) | Phase::Turning(_) => Phase::Parked,
            Phase::Listening(left) if left > 1 => Phase::Listening(left - 1),
            // Only with a pulse: without one the servo would start a tick late.
            Phase::Listening(_) if pulse_due => Phase::Turning(self.step()),
            phase @ (Phase::Listening(_) | Phase::Settled | Phase::Parked) => phase,
        };
        (pulse_due && !matches!(self.phase, Phase::Parked)).then(|| self.pulse_width())
    }

    /// Half the width of the scan around straight ahead, turn × 0x10000, cut to the travel: from the next step
    /// on. 0 looks straight ahead.
    // Requirement: WIRE-sweep-1
    pub fn set_width(&mut self, half_width: u16) {
        self.commanded = half_width.min((self.travel.unsigned_abs() / 2) as u16);
    }

    /// Takes the commanded width; the position nearest to the present one.
    fn apply_width(&mut self) {
        let before = self.pulse_width();
        self.half_width = self.commanded;
        let width = 2 * u32::from(self.half_width);
        let travel = self.travel.unsigned_abs().max(1);
        self.half_span = (u32::from(HALF_SPAN) * width / travel) as u16;
        self.steps = steps(width);
        let start = CENTRE_WIDTH - self.half_span;
        let way = u32::from(before.saturating_sub(start)) * u32::from(self.steps.get());
        let position = way / u32::from(2 * self.half_span).max(1);
        self.position = position.min(self.steps.get().into()) as u16;
    }

    /// The next bearing, reversing at the ends of the scan: consecutive readings differ in it. Ticks until the
    /// servo is settled there.
    // Requirement: WIRE-bearing-4, WIRE-bearing-5
    fn step(&mut self) -> u8 {
        let (before, changed) = (self.pulse_width(), self.commanded != self.half_width);
        if changed {
            self.apply_width();
        }
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
        if !changed {
            return STEP_TICKS;
        }
        // 25 ms for 10°.
        let way = u32::from(self.pulse_width().abs_diff(before)) * self.travel.unsigned_abs();
        STEP_TICKS + ((way / u32::from(2 * HALF_SPAN) * 90) >> 16) as u8
    }

    /// The sensor's bearing, turn × 0x10000, while it is settled and may be triggered.
    // Requirement: WIRE-bearing-2
    pub fn settled_bearing(&self) -> Option<u16> {
        match self.phase {
            Phase::Parked => Some(self.centre),
            Phase::Settled => Some(self.bearing()),
            Phase::Off | Phase::Homing(_) | Phase::Turning(_) | Phase::Listening(_) => None,
        }
    }

    /// Whether the bearing is unknown: earlier readings are void.
    pub const fn is_off(&self) -> bool {
        matches!(self.phase, Phase::Off)
    }

    /// Whether the sensors at the sides may be triggered while the front one's bearing is unknown.
    #[must_use]
    pub const fn is_scanning(&self) -> bool {
        self.scans
            && matches!(
                self.phase,
                Phase::Turning(_) | Phase::Settled | Phase::Listening(_)
            )
    }

    /// The sensor was triggered: the servo rests until every object within range has answered.
    pub fn triggered(&mut self) {
        if matches!(self.phase, Phase::Settled) {
            self.phase = Phase::Listening(LISTEN_TICKS);
        }
    }

    /// Width of the pulse at the present position, microseconds.
    fn pulse_width(&self) -> u16 {
        if !self.scans {
            return CENTRE_WIDTH;
        }
        CENTRE_WIDTH - self.half_span
            + (2 * self.half_span * self.position + self.steps.get() / 2) / self.steps
    }

    /// Bearing encoded by the rounded pulse, turn × 0x10000.
    // Requirement: WIRE-platform-5
    fn bearing(&self) -> u16 {
        let deviation = i32::from(self.pulse_width()) - i32::from(CENTRE_WIDTH);
        let angle = deviation * self.travel / (2 * i32::from(HALF_SPAN));
        self.centre.wrapping_add(angle as u16)
    }
}

/// Steps of at most 10° in a scan of this width, turn × 0x10000, at most half a turn: 1 to 18.
fn steps(width: u32) -> NonZeroU16 {
    NonZeroU16::new((width * STEPS_PER_TURN).div_ceil(1 << 16) as u16).unwrap_or(NonZeroU16::MIN)
}

#[cfg(test)]
mod tests;
