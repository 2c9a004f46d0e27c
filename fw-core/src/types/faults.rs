//! Latched faults: one type, one table, used by firmware, Pi and documents.

use core::ops::{BitAnd, BitOr, BitOrAssign};

/// A set of faults, one bit each, as the status strategy carries it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct Faults(u16);

/// One row of [`Faults::TABLE`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Fault {
    /// The set of this fault alone.
    pub faults: Faults,
    /// Lower-case words joined by `-`, as on the Pi's screen and in JSON.
    pub name: &'static str,
    /// Meaning, as in docs/interfaces.md.
    pub text: &'static str,
    /// Keeps the motors off until it is cleared: by the Pi in guarded modes, else by a reset.
    pub blocking: bool,
    /// Path of the code that raises it.
    pub raised_in: &'static str,
    /// Log line when it is latched; none where its cause writes a line of its own.
    pub log_line: Option<&'static str>,
}

macro_rules! faults {
    ($($constant:ident = $bit:literal, $name:literal, $blocking:literal, $raised_in:literal,
       $text:literal, $log_line:expr;)*) => {
        impl Faults {
            $(
                #[doc = $text]
                pub const $constant: Self = Self(1 << $bit);
            )*

            /// Every fault, by bit.
            pub const TABLE: &'static [Fault] = &[$(Fault {
                faults: Self::$constant,
                name: $name,
                text: $text,
                blocking: $blocking,
                raised_in: $raised_in,
                log_line: $log_line,
            }),*];

            /// Faults that keep the motors off.
            pub const BLOCKING: Self = Self($(($blocking as u16) << $bit)|*);
        }
    };
}

faults! {
    LINK_LOST = 0, "link-lost", false, "fw-core/src/robot/supervisor.rs",
        "no fresh valid frame within the stop deadline", None;
    CLOCK_FALLBACK = 1, "clock-fallback", false, "fw-pac/src/main.rs",
        "the crystal did not start; the clock runs from the internal oscillator",
        Some("no crystal: internal oscillator");
    FRAME_REJECTED = 2, "frame-rejected", false, "fw-core/src/robot/mod.rs",
        "a frame was rejected or lost", None;
    BATTERY_LOW = 3, "battery-low", false, "fw-core/src/robot/mod.rs",
        "a cell is below the warning voltage", Some("battery low: charge it");
    BATTERY_CUTOFF = 4, "battery-cutoff", true, "fw-core/src/robot/mod.rs",
        "a cell is below the cut-off voltage, or none was measured for half a second", Some("battery empty or unread: motors off");
    LEFT_STALLED = 5, "left-stalled", true, "fw-core/src/motion/drive_monitor.rs",
        "the left wheel does not follow its duty", Some("left wheel stalled");
    RIGHT_STALLED = 6, "right-stalled", true, "fw-core/src/motion/drive_monitor.rs",
        "the right wheel does not follow its duty", Some("right wheel stalled");
    ENCODER_JUMP = 7, "encoder-jump", true, "fw-core/src/motion/drive_monitor.rs",
        "an encoder jumped further than a wheel can turn in a tick", Some("an encoder jumped");
    LEFT_REVERSED = 8, "left-reversed", true, "fw-core/src/motion/drive_monitor.rs",
        "the left wheel turned against its duty", Some("left wheel reversed");
    RIGHT_REVERSED = 9, "right-reversed", true, "fw-core/src/motion/drive_monitor.rs",
        "the right wheel turned against its duty", Some("right wheel reversed");
    LOG_DROPPED = 10, "log-dropped", false, "fw-core/src/robot/mod.rs",
        "the log dropped lines", None;
    RESTARTED = 11, "restarted", false, "fw-pac/src/main.rs",
        "the watchdog, a panic, a fault or a brown-out restarted the firmware",
        Some("restarted after a failure");
    SLIP = 12, "slip", false, "fw-core/src/robot/slip_monitor.rs",
        "a wheel slipped or the robot was turned by force: the heading followed the gyroscope", None;
    GYRO_LOST = 13, "gyro-lost", false, "fw-core/src/robot/slip_monitor.rs",
        "the configuration has a gyroscope and it is missing or unreliable: encoders alone", None;
    SUPPLY_LOW = 14, "supply-low", true, "fw-core/src/robot/mod.rs",
        "the supply of the STM fell below 2.7 V", Some("supply low: motors off");
    NOT_ARRIVED = 15, "not-arrived", true, "fw-core/src/robot/control.rs",
        "the robot did not reach its target in time", Some("not arrived in time");
}

impl Faults {
    /// No fault.
    pub const NONE: Self = Self(0);

    /// All 16 bits: clears whatever is latched.
    pub const ALL_BITS: Self = Self(u16::MAX);

    /// The set with these bits; bits without a fault are kept.
    pub const fn from_bits(bits: u16) -> Self {
        Self(bits)
    }

    /// One bit per fault.
    #[must_use]
    pub const fn bits(self) -> u16 {
        self.0
    }

    /// Whether no fault is in the set.
    #[must_use]
    pub const fn is_empty(self) -> bool {
        self.0 == 0
    }

    /// Whether some fault is in both sets.
    #[must_use]
    pub const fn intersects(self, other: Self) -> bool {
        self.0 & other.0 != 0
    }

    /// The faults of either set.
    #[must_use]
    pub const fn union(self, other: Self) -> Self {
        Self(self.0 | other.0)
    }

    /// The faults of this set that are not in `other`.
    #[must_use]
    pub const fn difference(self, other: Self) -> Self {
        Self(self.0 & !other.0)
    }

    /// The table's rows of the faults in the set.
    pub fn iter(self) -> impl Iterator<Item = &'static Fault> {
        Self::TABLE
            .iter()
            .filter(move |fault| self.intersects(fault.faults))
    }
}

impl BitOr for Faults {
    type Output = Self;

    fn bitor(self, other: Self) -> Self {
        self.union(other)
    }
}

impl BitOrAssign for Faults {
    fn bitor_assign(&mut self, other: Self) {
        *self = self.union(other);
    }
}

impl BitAnd for Faults {
    type Output = Self;

    fn bitand(self, other: Self) -> Self {
        Self(self.0 & other.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fault_table_bits_ascend_without_gap() {
        for (bit, fault) in Faults::TABLE.iter().enumerate() {
            assert_eq!(fault.faults.bits(), 1 << bit, "{}", fault.name);
            assert_eq!(fault.blocking, Faults::BLOCKING.intersects(fault.faults));
        }
        assert_eq!(Faults::BLOCKING.bits(), 0b1100_0011_1111_0000);
    }
}
