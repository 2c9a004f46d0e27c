//! A firmware without a servo: the front rangefinder never turns, and nobody asks for its bearing.

use crate::eeprom::Platform;

/// The mount of the front rangefinder.
#[derive(Clone, Debug)]
pub struct ServoScan;

#[allow(
    clippy::unused_self,
    reason = "the servo's own functions, for a robot without one"
)]
impl ServoScan {
    /// The mount.
    #[must_use]
    pub const fn new(_platform: &Platform, _sweeps: bool) -> Self {
        Self
    }

    /// No pulse.
    pub const fn tick(&mut self, _live: bool) -> Option<u16> {
        None
    }

    /// It may always be triggered.
    #[must_use]
    pub const fn settled_bearing(&self) -> Option<u16> {
        Some(0)
    }

    /// Never.
    #[must_use]
    pub const fn is_off(&self) -> bool {
        false
    }

    /// Nothing to keep still.
    pub const fn triggered(&mut self) {}
}
