//! Ultrasonic rangefinders (US-015): one at a time, at least 60 ms from one trigger of a sensor to
//! its next, so that no sensor hears another's echo or its own last one.
//!
//! | sensors | a slot | each measures every |
//! |---|---|---|
//! | 1 | 60 ms | 60 ms |
//! | 2 | 30 ms | 60 ms |
//! | 3 | 20 ms, 30 ms where nothing answered | 60 to 90 ms |
//!
//! 60 ms is the part's own limit. What is within range, 2.5 m, has answered 20 ms after the trigger at
//! any temperature; a sensor hears up to 4 m, and an echo from there, 26 ms late at −40 °C, must not
//! meet the next sensor listening. So where nothing answered in 20 ms the next one waits until 30.
//!
//! What a sensor says of the line of its echo, and what it means:
//!
//! | the line | reading | on the wire |
//! |---|---|---|
//! | rises, falls within the time of 2500 mm | [`Echo::Distance`] | its code |
//! | up for longer than that, 38 ms where nothing echoes | [`Echo::TimedOut`], then [`Echo::OutOfRange`] | 0xFFFF |
//! | never rises, never falls, or falls at once | [`Echo::TimedOut`], then [`Echo::Missing`] | 0xFFFF |

use crate::types::{Micros, Millimetres, RangefinderId};
use fixed::types::I16F16;
use fixed::types::I32F32;

/// Largest distance (document, 5.1.4), 2⁻³² mm.
const FARTHEST: i64 = 2500 << 32;
/// Shortest echo that an object makes, microseconds: 20 mm, the sensor's blind distance.
const SHORTEST: u32 = 117;
/// Longest time from the trigger to the echo's rise, microseconds; the sensor takes below 1 ms. With
/// the 16.3 ms of 2500 mm at −40 °C it is within the slot.
const LATEST_RISE: u32 = 3_000;
/// Ticks from one trigger of a sensor to its next.
const CYCLE: u8 = 6;
/// Ticks until everything within range has answered a trigger: 20 ms.
pub const LISTEN: u8 = 2;
/// Ticks until no echo of a trigger can be heard any more: 8 m of way, 26 ms at −40 °C.
const QUIET: u8 = 3;
/// Speed of sound until a temperature is known, mm/s: as at 19 °C.
const ASSUMED: u64 = 343_000;

/// What a rangefinder says.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Echo {
    /// Not measured yet.
    #[default]
    NotMeasured,
    /// An object, 20 ..= 2500 mm away.
    Distance(Millimetres),
    /// Nothing within range has answered the last trigger; whether for want of an object or of a
    /// sensor shows when its line falls, or does not until the next trigger.
    TimedOut,
    /// An echo longer than 2500 mm's: nothing within range.
    OutOfRange,
    /// The last trigger got no answer, or an impossible one: broken or not connected.
    Missing,
}

/// A reading and where the sensor pointed when it was triggered: never apart, so that no reading can
/// come to a later bearing.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Reading {
    /// What it says.
    pub echo: Echo,
    /// Turn × 0x10000, counter-clockwise from straight ahead.
    pub bearing: u16,
}

/// How a sensor's triggers ended since the start; each count stays at its largest.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct EchoStats {
    /// With a distance.
    pub hits: u32,
    /// With nothing within range.
    pub out_of_range: u32,
    /// Without an answer.
    pub missing: u32,
    /// Without an answer in a consecutive_misses, the last one among them; at most 255.
    pub consecutive_misses: u8,
}

impl EchoStats {
    fn count(&mut self, echo: Echo) {
        let count = match echo {
            Echo::Distance(_) => &mut self.hits,
            Echo::OutOfRange => &mut self.out_of_range,
            Echo::Missing => &mut self.missing,
            // No end yet.
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
    /// When it was triggered and where it pointed, until its echo arrives.
    awaited: Option<(Micros, u16)>,
    reading: Reading,
    stats: EchoStats,
}

impl Sensor {
    /// What became of a trigger at `bearing`.
    fn settle(&mut self, echo: Echo, bearing: u16) {
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
    since: u8,
    /// The one triggered last.
    current: u8,
    /// Millimetres of distance per microsecond of echo, 32 fractional bits.
    pace: u64,
    /// Whom [`Self::take_updated`] has still to name, bit n the n-th.
    news: u8,
}

impl Rangefinders {
    /// The first `count`, 0 ..= 3, of front, right and left; sound at 343 m/s, as at 19 °C.
    // Requirement: WIRE-platform-4
    #[must_use]
    pub const fn new(count: u8) -> Self {
        const NEVER: Sensor = Sensor {
            awaited: None,
            reading: Reading {
                echo: Echo::NotMeasured,
                bearing: 0,
            },
            stats: EchoStats {
                hits: 0,
                out_of_range: 0,
                missing: 0,
                consecutive_misses: 0,
            },
        };
        Self {
            sensors: [NEVER; 3],
            count: if count > 3 { 3 } else { count },
            since: u8::MAX,
            // The one before the front one's first turn.
            current: u8::MAX,
            pace: pace(ASSUMED),
            news: 0,
        }
    }

    /// Sound travels at 331.3 + 0.606·T m/s; `celsius` counts from −40 to 85. Without one it is assumed
    /// to travel at 343 m/s.
    pub fn set_temperature(&mut self, celsius: Option<I16F16>) {
        self.pace = pace(celsius.map_or(ASSUMED, speed));
    }

    /// Every 10 ms: which one to trigger now, the front one pointing to `aim` (turn × 0x10000), and
    /// none while that is not known. A sensor that has not answered its last trigger by the next is
    /// [`Echo::Missing`].
    pub fn tick(&mut self, now: Micros, aim: Option<u16>) -> Option<RangefinderId> {
        self.since = self.since.saturating_add(1);
        let slot = match self.count {
            0 => return None,
            count => CYCLE / count,
        };
        let mut silent = false;
        if let Some(sensor) = self.sensors.get_mut(usize::from(self.current)) {
            if let Some((_, bearing)) = sensor.awaited {
                silent = true;
                if self.since == LISTEN {
                    sensor.settle(Echo::TimedOut, bearing);
                    self.news |= 1 << self.current;
                }
            }
        }
        if self.since < if silent { slot.max(QUIET) } else { slot } {
            return None;
        }
        let aim = aim?;
        let which = self.current.wrapping_add(1);
        let which = if which < self.count { which } else { 0 };
        let sensor = self.sensors.get_mut(usize::from(which))?;
        if let Some((_, bearing)) = sensor.awaited {
            sensor.settle(Echo::Missing, bearing);
            self.news |= 1 << which;
        }
        sensor.awaited = Some((now, aim));
        self.since = 0;
        self.current = which;
        Some(match which {
            0 => RangefinderId::Front,
            1 => RangefinderId::Right,
            _ => RangefinderId::Left,
        })
    }

    /// An echo's two edges. One that no trigger asked for, or whose edges cannot belong to the last
    /// trigger, is ignored: a missing edge never becomes a distance.
    // Requirement: WIRE-distance-1
    pub fn echo(&mut self, which: RangefinderId, rise: Micros, fall: Micros) {
        let Some(sensor) = self.sensors.get_mut(which as usize) else {
            return;
        };
        let Some((trigger, bearing)) = sensor.awaited else {
            return;
        };
        // Edges before the trigger wrap to far beyond these bounds.
        let delay = rise.since(trigger);
        let width = fall.since(rise);
        if delay > LATEST_RISE || width > 1 << 20 {
            return;
        }
        sensor.awaited = None;
        let distance = (u64::from(width) * self.pace) as i64;
        let echo = if width < SHORTEST {
            Echo::Missing
        } else if distance > FARTHEST {
            Echo::OutOfRange
        } else {
            Echo::Distance(Millimetres(I32F32::from_bits(distance)))
        };
        sensor.settle(echo, bearing);
        self.news |= 1 << which as u8;
    }

    /// Nobody knows where they point: what they said and what is still on its way means nothing.
    pub fn invalidate(&mut self) {
        for sensor in &mut self.sensors {
            sensor.awaited = None;
            sensor.reading.echo = Echo::NotMeasured;
        }
        self.news = 0b111;
    }

    /// One whose reading or stats may not be what it was when it was named here last, the front one
    /// before the others; nothing once all have been named.
    pub fn take_updated(&mut self) -> Option<RangefinderId> {
        let which = RangefinderId::ALL.get(self.news.trailing_zeros() as usize)?;
        self.news &= self.news - 1;
        Some(*which)
    }

    /// The last reading with its bearing, which is the front one's own and the robot's else. It is at
    /// most one cycle old: what is not renewed becomes [`Echo::TimedOut`] and then [`Echo::Missing`].
    #[must_use]
    pub fn reading(&self, which: RangefinderId) -> Reading {
        self.sensors
            .get(which as usize)
            .map_or_else(Reading::default, |sensor| sensor.reading)
    }

    /// The distance, where there is one.
    #[must_use]
    pub fn distance(&self, which: RangefinderId) -> Option<Millimetres> {
        match self.reading(which).echo {
            Echo::Distance(distance) => Some(distance),
            Echo::NotMeasured | Echo::TimedOut | Echo::OutOfRange | Echo::Missing => None,
        }
    }

    /// How its triggers ended so far.
    #[must_use]
    pub fn stats(&self, which: RangefinderId) -> EchoStats {
        self.sensors
            .get(which as usize)
            .map_or_else(EchoStats::default, |sensor| sensor.stats)
    }
}

/// Speed of sound in air, mm/s; 307 to 383 m/s from −40 to 85 °C.
fn speed(celsius: I16F16) -> u64 {
    let celsius = i64::from(celsius.to_bits()).clamp(-40 << 16, 85 << 16);
    (331_300 + ((celsius * 606) >> 16)).unsigned_abs()
}

/// Half the way that sound of `speed` mm/s, below 400 m/s, goes in a microsecond, mm, 32 fractional
/// bits.
const fn pace(speed: u64) -> u64 {
    // 2⁵³ / 2 000 000, for 2³² / 2 000 000 without a 64-bit division.
    (speed * 4_503_599_627) >> 21
}

#[cfg(test)]
mod tests;
