//! Ultrasonic rangefinders (US-015), triggered in turn, each at most every 60 ms, so that no sensor
//! receives another's echo or its own last one.
//!
//! | sensors | slot | period of each |
//! |---|---|---|
//! | 1 | 60 ms | 60 ms |
//! | 2 | 30 ms | 60 ms |
//! | 3 | 20 ms, 30 ms after a time-out | 60 to 90 ms |
//!
//! 60 ms is the part's limit. An object within the range of 2.5 m has answered 20 ms after the trigger at
//! any temperature. The part receives up to 4 m, and such an echo, after 26 ms at −40 °C, must not reach
//! the next sensor: after a time-out the next trigger waits until 30 ms.
//!
//! | echo line | reading | on the wire |
//! |---|---|---|
//! | rises, falls within the time of 2500 mm | [`Echo::Distance`] | its code |
//! | high for longer, 38 ms without an echo | [`Echo::TimedOut`], then [`Echo::OutOfRange`] | 0xFFFF |
//! | never rises, never falls, or falls at once | [`Echo::TimedOut`], then [`Echo::Missing`] | 0xFFFF |

use crate::types::{Micros, Millimetres, RangefinderId};
use fixed::types::I16F16;
use fixed::types::I32F32;

/// Largest distance (document, 5.1.4), 2⁻³² mm.
const MAX_DISTANCE: i64 = 2500 << 32;
/// Shortest echo of an object, microseconds: 20 mm, the sensor's blind distance.
const MIN_WIDTH: u32 = 117;
/// Longest time from the trigger to the echo's rise, microseconds; the sensor takes below 1 ms. With
/// the 16.3 ms of 2500 mm at −40 °C it is within the slot.
const MAX_RISE_DELAY: u32 = 3_000;
/// Ticks from one trigger of a sensor to its next.
const CYCLE_TICKS: u8 = 6;
/// Ticks until every object within range has answered a trigger: 20 ms.
pub const LISTEN_TICKS: u8 = 2;
/// Ticks until no echo of a trigger can arrive any more: 8 m of path, 26 ms at −40 °C.
const QUIET_TICKS: u8 = 3;
/// Speed of sound while no temperature is known, mm/s: at 19 °C.
const DEFAULT_SPEED: u64 = 343_000;

/// Result of a measurement.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Echo {
    /// Not measured yet.
    #[default]
    NotMeasured,
    /// An object at 20 ..= 2500 mm.
    Distance(Millimetres),
    /// No echo from within range; [`Self::OutOfRange`] or [`Self::Missing`] follows when the line falls,
    /// or at the next trigger.
    TimedOut,
    /// An echo longer than that of 2500 mm: no object within range.
    OutOfRange,
    /// No echo, or an impossible one: broken or not connected.
    Missing,
}

/// A measurement with the bearing of its trigger: kept together, so that no measurement is assigned to a
/// later bearing.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Reading {
    /// The result.
    pub echo: Echo,
    /// Bearing of the sensor at the trigger, turn × 0x10000, counter-clockwise from straight ahead.
    pub bearing: u16,
}

/// Results of a sensor's triggers since the start; every count saturates.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct EchoStats {
    /// Distances.
    pub hits: u32,
    /// Echoes from beyond the range.
    pub out_of_range: u32,
    /// Triggers without an echo.
    pub missing: u32,
    /// Triggers without an echo since the last echo.
    pub consecutive_misses: u8,
}

impl EchoStats {
    // Requirement: WIRE-log-9
    fn count(&mut self, echo: Echo) {
        let count = match echo {
            Echo::Distance(_) => &mut self.hits,
            Echo::OutOfRange => &mut self.out_of_range,
            Echo::Missing => &mut self.missing,
            // Not a final result.
            Echo::NotMeasured | Echo::TimedOut => return,
        };
        *count = count.saturating_add(1);
        self.consecutive_misses = match echo {
            Echo::Missing => self.consecutive_misses.saturating_add(1),
            _ => 0,
        };
    }
}

#[derive(Clone, Copy, Debug, Default)]
struct Sensor {
    /// Time and bearing of the trigger, until its echo arrives.
    pending: Option<(Micros, u16)>,
    reading: Reading,
    stats: EchoStats,
}

impl Sensor {
    /// Stores the result of a trigger at `bearing`.
    fn record(&mut self, echo: Echo, bearing: u16) {
        self.stats.count(echo);
        self.reading = Reading { echo, bearing };
    }
}

/// All rangefinders of the robot.
#[derive(Clone, Debug)]
pub struct Rangefinders {
    sensors: [Sensor; 3],
    count: u8,
    /// Ticks since the last trigger, at most 255.
    ticks: u8,
    /// Index of the sensor triggered last.
    current: u8,
    /// Distance per echo time, 2⁻³² mm/µs.
    mm_per_us: u64,
    /// Bit mask of the sensors with unread updates.
    updated: u8,
}

impl Rangefinders {
    /// The first `count`, 0 ..= 3, of front, right and left; sound at 343 m/s, as at 19 °C.
    // Requirement: WIRE-platform-4
    pub fn new(count: u8) -> Self {
        Self {
            sensors: [Sensor::default(); 3],
            count: count.min(3),
            ticks: u8::MAX,
            // The front sensor is next.
            current: u8::MAX,
            mm_per_us: mm_per_us(DEFAULT_SPEED),
            updated: 0,
        }
    }

    /// Speed of sound 331.3 + 0.606·T m/s at the temperature T, −40 to 85 °C; 343 m/s if unknown.
    pub fn set_temperature(&mut self, celsius: Option<I16F16>) {
        self.mm_per_us = mm_per_us(celsius.map_or(DEFAULT_SPEED, speed_of_sound));
    }

    /// Every 10 ms: the sensor to trigger now, pointing at `bearing` (turn × 0x10000); none while the
    /// bearing is unknown, unless the sensors at the `sides` need none. A sensor without an echo by its next
    /// trigger becomes [`Echo::Missing`].
    pub fn tick(
        &mut self,
        now: Micros,
        bearing: Option<u16>,
        sides: bool,
    ) -> Option<RangefinderId> {
        self.ticks = self.ticks.saturating_add(1);
        let slot = match self.count {
            0 => return None,
            count => CYCLE_TICKS / count,
        };
        let mut timed_out = false;
        if let Some(sensor) = self.sensors.get_mut(usize::from(self.current)) {
            if let Some((_, bearing)) = sensor.pending {
                timed_out = true;
                if self.ticks == LISTEN_TICKS {
                    sensor.record(Echo::TimedOut, bearing);
                    self.updated |= 1 << self.current;
                }
            }
        }
        let slot = if timed_out {
            slot.max(QUIET_TICKS)
        } else {
            slot
        };
        if self.ticks < slot {
            return None;
        }
        let which = self.current.wrapping_add(1);
        let which = if which < self.count { which } else { 0 };
        // Requirement: WIRE-bearing-2
        let bearing = bearing.or((sides && which != 0).then_some(0))?;
        let sensor = self.sensors.get_mut(usize::from(which))?;
        if let Some((_, bearing)) = sensor.pending {
            sensor.record(Echo::Missing, bearing);
            self.updated |= 1 << which;
        }
        sensor.pending = Some((now, bearing));
        self.ticks = 0;
        self.current = which;
        Some(match which {
            0 => RangefinderId::Front,
            1 => RangefinderId::Right,
            _ => RangefinderId::Left,
        })
    }

    /// Both edges of an echo. Edges that cannot belong to the sensor's last trigger are ignored: a missing
    /// edge never becomes a distance.
    // Requirement: WIRE-bearing-2, WIRE-distance-1
    pub fn echo(&mut self, which: RangefinderId, rise: Micros, fall: Micros) {
        let Some(sensor) = self.sensors.get_mut(which as usize) else {
            return;
        };
        let Some((trigger, bearing)) = sensor.pending else {
            return;
        };
        // Edges before the trigger wrap to far beyond these bounds.
        let delay = rise.since(trigger);
        let width = fall.since(rise);
        if delay > MAX_RISE_DELAY || width > 1 << 20 {
            return;
        }
        sensor.pending = None;
        let distance = (u64::from(width) * self.mm_per_us) as i64;
        let echo = if width < MIN_WIDTH {
            Echo::Missing
        } else if distance > MAX_DISTANCE {
            Echo::OutOfRange
        } else {
            Echo::Distance(Millimetres(I32F32::from_bits(distance)))
        };
        sensor.record(echo, bearing);
        self.updated |= 1 << which as u8;
    }

    /// The bearing is unknown: discards all readings and pending triggers.
    // Requirement: WIRE-servo-1
    pub fn invalidate(&mut self) {
        for sensor in &mut self.sensors {
            sensor.pending = None;
            sensor.reading = Reading::default();
        }
        self.updated = 0b111;
    }

    /// Takes one sensor whose reading or statistics were updated, the front one first; `None` once all
    /// updates are taken.
    pub fn take_updated(&mut self) -> Option<RangefinderId> {
        let which = RangefinderId::ALL.get(self.updated.trailing_zeros() as usize)?;
        self.updated &= self.updated - 1;
        Some(*which)
    }

    /// The last reading, at most one cycle old: without an echo it becomes [`Echo::TimedOut`] and then
    /// [`Echo::Missing`].
    pub fn reading(&self, which: RangefinderId) -> Reading {
        self.sensors
            .get(which as usize)
            .map_or_else(Reading::default, |sensor| sensor.reading)
    }

    /// The distance of the last reading, if it has one.
    pub fn distance(&self, which: RangefinderId) -> Option<Millimetres> {
        match self.reading(which).echo {
            Echo::Distance(distance) => Some(distance),
            Echo::NotMeasured | Echo::TimedOut | Echo::OutOfRange | Echo::Missing => None,
        }
    }

    /// Results of the sensor's triggers.
    pub fn stats(&self, which: RangefinderId) -> EchoStats {
        self.sensors
            .get(which as usize)
            .map_or_else(EchoStats::default, |sensor| sensor.stats)
    }
}

/// Speed of sound in air, mm/s; 307 to 383 m/s from −40 to 85 °C.
fn speed_of_sound(celsius: I16F16) -> u64 {
    let celsius = i64::from(celsius.to_bits()).clamp(-40 << 16, 85 << 16);
    (331_300 + ((celsius * 606) >> 16)).unsigned_abs()
}

/// Half the path of sound at `speed`, below 400 000 mm/s, in a microsecond, 2⁻³² mm.
const fn mm_per_us(speed: u64) -> u64 {
    // 2⁵³ / 2 000 000, for 2³² / 2 000 000 without a 64-bit division.
    (speed * 4_503_599_627) >> 21
}

#[cfg(test)]
mod tests;
