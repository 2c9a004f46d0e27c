//! Physical units.

use fixed::types::{I32F32, U16F16};

/// An instant on the robot's clock: microseconds, wrapping every 71.6 minutes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct Micros(pub u32);

impl Micros {
    /// Microseconds from `earlier` to `self`, right across a wrap for spans below 71.6 minutes.
    #[must_use]
    pub const fn since(self, earlier: Self) -> u32 {
        self.0.wrapping_sub(earlier.0)
    }

    /// The instant `span` microseconds later.
    #[must_use]
    pub const fn after(self, span: u32) -> Self {
        Self(self.0.wrapping_add(span))
    }
}

/// An angle: one turn is 2³², counter-clockwise positive, wrapping.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Turns(pub u32);

impl Turns {
    /// The shortest signed way from `other` to `self`, in 2⁻³² turns, −½ turn up to just below ½.
    #[must_use]
    #[allow(
        clippy::cast_possible_wrap,
        reason = "the sign bit is half a turn back"
    )]
    pub const fn from_nearest(self, other: Self) -> i32 {
        self.0.wrapping_sub(other.0) as i32
    }
}

/// A length in millimetres, resolution 2⁻³² mm, range ±2³¹ mm.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub struct Millimetres(pub I32F32);

/// A length in micrometres.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub struct Micrometres(pub u32);

/// A span of time in milliseconds.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub struct Milliseconds(pub u16);

/// A resistance in ohms.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub struct Ohms(pub u32);

/// A voltage, resolution 15 µV.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub struct Volts(pub U16F16);

/// A signed motor duty in hundredths of a percent, −10 000 ..= 10 000; positive drives forward.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub struct Duty(i16);

impl Duty {
    /// No drive.
    pub const ZERO: Self = Self(0);
    /// Full drive, hundredths of a percent.
    pub const FULL: i16 = 10_000;

    /// The nearest duty the bridge can be given.
    #[allow(clippy::cast_possible_truncation, reason = "within 10 000 by then")]
    pub const fn saturating(hundredths: i32) -> Self {
        if hundredths > Self::FULL as i32 {
            Self(Self::FULL)
        } else if hundredths < -(Self::FULL as i32) {
            Self(-Self::FULL)
        } else {
            Self(hundredths as i16)
        }
    }

    /// Hundredths of a percent, −10 000 ..= 10 000.
    #[must_use]
    pub const fn hundredths(self) -> i16 {
        self.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn duty_saturating_beyond_full_clamps() {
        for asked in -20_001..=20_001 {
            let duty = Duty::saturating(asked).hundredths();
            assert_eq!(i32::from(duty), asked.clamp(-10_000, 10_000));
        }
        assert_eq!(Duty::saturating(i32::MAX).hundredths(), 10_000);
        assert_eq!(Duty::saturating(i32::MIN).hundredths(), -10_000);
    }
}
