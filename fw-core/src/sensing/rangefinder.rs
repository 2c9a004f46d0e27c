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

#[cfg(test)]
mod tests {
    extern crate std;

    use super::*;
    use std::vec::Vec;
    use Rangefinder::{Front, Left, Right};

    const TICK: u32 = 10_000;

    fn triggers(count: u8, ticks: u32) -> Vec<(u32, Rangefinder)> {
        let mut rangefinders = Rangefinders::new(count);
        (0..ticks)
            .filter_map(|k| Some((k, rangefinders.tick(Micros(k * TICK))?)))
            .collect()
    }

    /// One that has just been triggered at `at`.
    fn triggered(at: Micros) -> Rangefinders {
        let mut rangefinders = Rangefinders::new(1);
        assert_eq!(rangefinders.tick(at), Some(Front));
        rangefinders
    }

    fn measured(width: u32) -> Echo {
        let mut rangefinders = triggered(Micros(0));
        rangefinders.echo(Front, Micros(500), Micros(500).after(width));
        rangefinders.reading(Front)
    }

    #[test]
    fn they_are_triggered_one_at_a_time_and_each_every_60_ms() {
        for count in 1..=3u8 {
            let all = triggers(count, 600);
            for which in [Front, Right, Left].into_iter().take(usize::from(count)) {
                let own: Vec<u32> = all.iter().filter(|t| t.1 == which).map(|t| t.0).collect();
                assert!(own.len() == 100, "{count} {which:?} {}", own.len());
                assert!(own.windows(2).all(|w| w[1] - w[0] == 6));
            }
            let apart = u32::from(6 / count);
            assert!(all.windows(2).all(|w| w[1].0 - w[0].0 == apart));
        }
        assert!(triggers(0, 600).is_empty());
    }

    #[test]
    fn every_width_is_a_distance_within_a_thousandth_of_a_millimetre_or_says_why_not() {
        let mut last = I32F32::ZERO;
        for width in 0..70_000u32 {
            let truth = f64::from(width) * 0.1715;
            match measured(width) {
                Echo::At(Millimetres(d)) => {
                    assert!(width >= SHORTEST && truth <= 2500.0, "{width}");
                    assert!((d.to_num::<f64>() - truth).abs() < 1e-3, "{width} {d}");
                    assert!(d > last, "monotone");
                    last = d;
                }
                Echo::OutOfRange => assert!(truth > 2499.999, "{width}"),
                Echo::Missing => assert!(width < SHORTEST, "{width}"),
                Echo::None => panic!("{width}"),
            }
        }
    }

    #[test]
    fn warm_air_carries_sound_faster() {
        let mut rangefinders = triggered(Micros(0));
        rangefinders.set_temperature(I16F16::from_num(30));
        rangefinders.echo(Front, Micros(500), Micros(10_500));
        let distance = rangefinders.distance(Front).unwrap().0.to_num::<f64>();
        assert!((distance - 1747.4).abs() < 0.01, "{distance}");
    }

    #[test]
    fn a_sensor_that_does_not_answer_is_missing_after_a_cycle_and_comes_back() {
        let mut rangefinders = Rangefinders::new(3);
        assert_eq!(rangefinders.reading(Right), Echo::None);
        for k in 0..60u32 {
            let now = Micros(k * TICK);
            let answers = k >= 30;
            if let Some(which) = rangefinders.tick(now) {
                if which != Right || answers {
                    rangefinders.echo(which, now.after(600), now.after(6_600));
                }
            }
            if (9..30).contains(&k) {
                assert_eq!(rangefinders.reading(Right), Echo::Missing);
                assert_eq!(rangefinders.distance(Right), None);
            }
            if k > 36 {
                assert!(rangefinders.distance(Right).is_some());
            }
        }
    }

    #[test]
    fn an_edge_of_another_trigger_never_becomes_a_distance() {
        let at = Micros(u32::MAX - 2_000);
        for (rise, fall) in [
            // Both before the trigger; the rise before it; the fall before the rise; far too late.
            (at.0.wrapping_sub(9_000), at.0.wrapping_sub(3_000)),
            (at.0.wrapping_sub(1), at.0.wrapping_add(5_000)),
            (at.0.wrapping_add(700), at.0.wrapping_add(699)),
            (at.0.wrapping_add(8_001), at.0.wrapping_add(10_000)),
        ] {
            let mut rangefinders = triggered(at);
            rangefinders.echo(Front, Micros(rise), Micros(fall));
            assert_eq!(rangefinders.reading(Front), Echo::None, "{rise} {fall}");
            // The right one still counts, across the clock's wrap.
            rangefinders.echo(Front, at.after(500), at.after(6_500));
            assert!(rangefinders.distance(Front).is_some());
        }
    }

    #[test]
    fn one_trigger_gives_one_reading_and_none_gives_none() {
        let mut rangefinders = triggered(Micros(0));
        rangefinders.echo(Front, Micros(500), Micros(1_500));
        let first = rangefinders.reading(Front);
        rangefinders.echo(Front, Micros(2_000), Micros(4_000));
        assert_eq!(rangefinders.reading(Front), first);
        rangefinders.echo(Left, Micros(500), Micros(1_500));
        assert_eq!(rangefinders.reading(Left), Echo::None);
    }
}
