//! The EEPROM's bus behind its switch: `SELECT` gives it to the Pi (high) or to the STM (low). The
//! side without it hears no acknowledge.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use rigless::chip::i2c::Peer;
use rigless::chip::Timeline;
use rigless::snapshot::Store;

use super::eeprom::Eeprom;

/// Who addresses the bus.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Side {
    /// The STM's I2C1.
    Stm,
    /// The Pi's /dev/i2c-1.
    Pi,
}

/// The bus.
#[derive(Debug)]
pub struct I2cBus {
    /// The EEPROM, unless none is fitted.
    pub eeprom: Option<Eeprom>,
    owner: Side,
    /// Clock pulses until a part that lost its place lets `SDA` go.
    stuck: Option<u32>,
}

/// Clock pulses that free a part in any state: eight bits and the acknowledge (NXP UM10204, 3.1.16).
pub const CLEARING_PULSES: u32 = 9;

impl I2cBus {
    /// The bus with this EEPROM, in the STM's hand as the pull-down leaves it.
    #[must_use]
    pub fn new(eeprom: Option<Eeprom>) -> Self {
        Self {
            eeprom,
            owner: Side::Stm,
            stuck: None,
        }
    }

    /// Whose the bus is.
    #[must_use]
    pub fn owner(&self) -> Side {
        self.owner
    }

    /// Throws the switch. A transaction under way is cut off.
    pub fn give_to(&mut self, side: Side) {
        if self.owner != side {
            self.owner = side;
            if let Some(eeprom) = &mut self.eeprom {
                eeprom.abandon();
            }
        }
    }

    /// A part holds `SDA` low until it has heard this many clock pulses.
    pub fn stick(&mut self, pulses: u32) {
        self.stuck = Some(pulses);
    }

    /// Whether `SDA` is held low on `side`'s wires.
    #[must_use]
    pub fn is_stuck(&self, side: Side) -> bool {
        self.stuck.is_some() && self.owner == side
    }

    /// `side` raised the clock line by hand.
    pub fn pulse(&mut self, side: Side) {
        if self.owner == side {
            self.stuck = self
                .stuck
                .and_then(|left| left.checked_sub(1))
                .filter(|&left| left > 0);
        }
    }

    /// The STM was reset: in the middle of a read the EEPROM is left driving `SDA`.
    pub fn stm_reset(&mut self) {
        if self.owner == Side::Stm {
            if let Some(eeprom) = &mut self.eeprom {
                if eeprom.is_reading() {
                    self.stuck = Some(CLEARING_PULSES);
                }
                eeprom.abandon();
            }
        }
    }

    fn reachable(&mut self, side: Side) -> Option<&mut Eeprom> {
        if self.owner == side && self.stuck.is_none() {
            self.eeprom.as_mut()
        } else {
            None
        }
    }

    /// A start; the answer is the acknowledge.
    pub fn start(&mut self, side: Side, now: u64, address: u8, read: bool) -> bool {
        self.reachable(side)
            .is_some_and(|eeprom| eeprom.start(now, address, read))
    }

    /// A byte out; the answer is the acknowledge.
    pub fn write(&mut self, side: Side, byte: u8) -> bool {
        self.reachable(side)
            .is_some_and(|eeprom| eeprom.write(byte))
    }

    /// A byte in; a line nobody drives reads all ones.
    pub fn read(&mut self, side: Side) -> u8 {
        self.reachable(side).map_or(0xFF, Eeprom::read)
    }

    /// A stop.
    pub fn stop(&mut self, side: Side, now: u64) {
        if let Some(eeprom) = self.reachable(side) {
            eeprom.stop(now);
        }
    }
}

/// The bus, held by the STM's controller and by the board.
#[derive(Clone, Debug)]
pub struct SharedBus(Arc<Mutex<I2cBus>>);

impl SharedBus {
    /// Shares `bus`.
    #[must_use]
    pub fn new(bus: I2cBus) -> Self {
        Self(Arc::new(Mutex::new(bus)))
    }

    /// The bus.
    pub fn lock(&self) -> MutexGuard<'_, I2cBus> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// The switch as the STM's controller sees it: a chip that may or may not answer.
#[derive(Debug)]
pub struct StmPort(pub SharedBus);

impl Store for StmPort {}

impl Peer for StmPort {
    fn start(&mut self, address: u8, read: bool, context: &mut Timeline<'_, '_>) -> bool {
        self.0
            .lock()
            .start(Side::Stm, context.now().0, address, read)
    }

    fn write(&mut self, byte: u8, _context: &mut Timeline<'_, '_>) -> bool {
        self.0.lock().write(Side::Stm, byte)
    }

    fn read(&mut self, _last: bool, _context: &mut Timeline<'_, '_>) -> u8 {
        self.0.lock().read(Side::Stm)
    }

    fn stop(&mut self, context: &mut Timeline<'_, '_>) {
        self.0.lock().stop(Side::Stm, context.now().0);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::parts::eeprom::ADDRESS;

    #[test]
    fn only_the_side_with_the_switch_is_acknowledged() {
        let mut bus = I2cBus::new(Some(Eeprom::holding(&[])));
        assert!(bus.start(Side::Stm, 0, ADDRESS, false));
        assert!(!bus.start(Side::Pi, 0, ADDRESS, false));
        bus.give_to(Side::Pi);
        assert!(bus.start(Side::Pi, 0, ADDRESS, false));
        assert!(!bus.start(Side::Stm, 0, ADDRESS, false));
    }

    #[test]
    fn nine_clock_pulses_free_a_stuck_bus() {
        let mut bus = I2cBus::new(Some(Eeprom::holding(&[])));
        bus.stick(CLEARING_PULSES);
        for _ in 0..CLEARING_PULSES {
            assert!(bus.is_stuck(Side::Stm));
            assert!(!bus.start(Side::Stm, 0, ADDRESS, false));
            bus.pulse(Side::Stm);
        }
        assert!(!bus.is_stuck(Side::Stm));
        assert!(bus.start(Side::Stm, 0, ADDRESS, false));
    }

    #[test]
    fn a_reset_in_the_middle_of_a_read_leaves_the_line_held() {
        let mut bus = I2cBus::new(Some(Eeprom::holding(&[])));
        bus.start(Side::Stm, 0, ADDRESS, true);
        bus.stm_reset();
        assert!(bus.is_stuck(Side::Stm));
    }
}
