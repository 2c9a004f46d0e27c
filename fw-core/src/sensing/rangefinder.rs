//! Ultrasonic rangefinders (US-015): one at a time, at least 60 ms from one trigger of a sensor to
//! its next, so that no sensor hears another's echo or its own last one.
//!
//! | sensors | a slot | each measures every |
//! |---|---|---|
//! | 1 | 60 ms | 60 ms |
//! | 2 | 30 ms | 60 ms |
//! | 3 | 20 ms | 60 ms |
//!
//! An echo from 2.5 m is over 16 ms after its trigger: it ends within the slot.

use fixed::types::{I16F16, I32F32};

use crate::robot::Rangefinder;
use crate::units::{Micros, Millimetres};

/// Largest distance (document, 5.1.4), 2⁻³² mm.
const FARTHEST: i64 = 2500 << 32;
/// Shortest echo that an object makes, microseconds: 20 mm, the sensor's blind distance.
const SHORTEST: u32 = 117;
/// Longest time from the trigger to the echo's rise, microseconds; the sensor takes below 1 ms.
const LATEST_RISE: u32 = 8_000;
/// Ticks from one trigger of a sensor to its next.
const CYCLE: u8 = 6;

/// What a rangefinder says.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Echo {
    /// Not measured yet.
    #[default]
    None,
    /// An object, 20 ..= 2500 mm away.
    At(Millimetres),
    /// An echo longer than 2500 mm's: nothing within range.
    OutOfRange,
    /// The last trigger got no answer, or an impossible one: broken or not connected.
    Missing,
}

#[derive(Clone, Copy, Debug, Default)]
struct Sensor {
    /// When it was triggered, until its echo arrives.
    awaited: Option<Micros>,
    echo: Echo,
}

/// All rangefinders of the robot.
#[derive(Clone, Debug)]
pub struct Rangefinders {
    sensors: [Sensor; 3],
    count: u8,
    /// Ticks to the next trigger.
    wait: u8,
    next: u8,
    /// Millimetres of distance per microsecond of echo, 32 fractional bits.
    pace: u64,
}

impl Rangefinders {
    /// The first `count`, 0 ..= 3, of front, right and left; sound at 343 m/s, as at 19 °C.
    #[must_use]
    pub const fn new(count: u8) -> Self {
        const NEVER: Sensor = Sensor {
            awaited: None,
            echo: Echo::None,
        };
        Self {
            sensors: [NEVER; 3],
            count: if count > 3 { 3 } else { count },
            wait: 0,
            next: 0,
            pace: pace(343_000),
        }
    }

    /// Sound travels at 331.3 + 0.606·T m/s; `celsius` counts from −40 to 85.
    pub fn set_temperature(&mut self, celsius: I16F16) {
        let celsius = i64::from(celsius.to_bits()).clamp(-40 << 16, 85 << 16);
        let speed = 331_300 + ((celsius * 606) >> 16);
        self.pace = pace(speed.unsigned_abs());
    }

    /// Every 10 ms: which one to trigger now. A sensor that has not answered its last trigger by
    /// the next is [`Echo::Missing`].
    pub fn tick(&mut self, now: Micros) -> Option<Rangefinder> {
        if self.wait > 1 {
            self.wait -= 1;
            return None;
        }
        self.wait = match self.count {
            0 => return None,
            count => CYCLE / count,
        };
        let which = self.next;
        self.next = if which + 1 < self.count { which + 1 } else { 0 };
        let sensor = self.sensors.get_mut(usize::from(which))?;
        if sensor.awaited.is_some() {
            sensor.echo = Echo::Missing;
        }
        sensor.awaited = Some(now);
        Some(match which {
            0 => Rangefinder::Front,
            1 => Rangefinder::Right,
            _ => Rangefinder::Left,
        })
    }

    /// An echo's two edges. One that no trigger asked for, or whose edges cannot belong to the last
    /// trigger, is ignored: a missing edge never becomes a distance.
    pub fn echo(&mut self, which: Rangefinder, rise: Micros, fall: Micros) {
        let pace = self.pace;
        let Some(sensor) = self.sensors.get_mut(which as usize) else {
            return;
        };
        let Some(trigger) = sensor.awaited else {
            return;
        };
        // Edges before the trigger wrap to far beyond these bounds.
        let delay = rise.since(trigger);
        let width = fall.since(rise);
        if delay > LATEST_RISE || width > 1 << 20 {
            return;
        }
        sensor.awaited = None;
        if width < SHORTEST {
            sensor.echo = Echo::Missing;
            return;
        }
        let distance = (u64::from(width) * pace) as i64;
        sensor.echo = if distance > FARTHEST {
            Echo::OutOfRange
        } else {
            Echo::At(Millimetres(I32F32::from_bits(distance)))
        };
    }

    /// The last reading. It is at most one cycle old: what is not renewed becomes
    /// [`Echo::Missing`].
    #[must_use]
    pub fn reading(&self, which: Rangefinder) -> Echo {
        self.sensors
            .get(which as usize)
            .map_or(Echo::None, |sensor| sensor.echo)
    }

    /// The distance, where there is one.
    #[must_use]
    pub fn distance(&self, which: Rangefinder) -> Option<Millimetres> {
        match self.reading(which) {
            Echo::At(distance) => Some(distance),
            Echo::None | Echo::OutOfRange | Echo::Missing => None,
        }
    }
}

/// Half the way that sound of `speed` mm/s goes in a microsecond, mm, 32 fractional bits.
const fn pace(speed: u64) -> u64 {
    (speed << 32) / 2_000_000
}
