//! The STM's I2C bus: the MPU6050 on it, and the EEPROM behind its switch, which `SELECT` gives to the
//! Pi (high) or to the STM (low). The side without it hears no acknowledge of the EEPROM's.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use rigless::chip::i2c::Peer;
use rigless::chip::Timeline;
use rigless::snapshot::Store;

use super::eeprom::Eeprom;
use super::mpu6050::Mpu6050;

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
    /// The MPU6050, unless none is fitted: on the STM's side whatever the switch says.
    pub mpu: Option<Mpu6050>,
    owner: Side,
    /// Clock pulses until a part that lost its place lets `SDA` go.
    stuck: Option<u32>,
    /// The same of the MPU6050.
    mpu_stuck: Option<u32>,
    /// Whether the STM's transaction is with the MPU6050.
    with_mpu: bool,
}

/// Clock pulses that free a part in any state: eight bits and the acknowledge (NXP UM10204, 3.1.16).
pub const CLEARING_PULSES: u32 = 9;

impl I2cBus {
    /// The bus with this EEPROM, in the STM's hand as the pull-down leaves it.
    #[must_use]
    pub fn new(eeprom: Option<Eeprom>) -> Self {
        Self {
            eeprom,
            mpu: None,
            owner: Side::Stm,
            stuck: None,
            mpu_stuck: None,
            with_mpu: false,
        }
    }

    /// The same with an MPU6050.
    #[must_use]
    pub fn with_mpu(self, mpu: Option<Mpu6050>) -> Self {
        Self { mpu, ..self }
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

    /// The MPU6050 holds `SDA` low until it has heard this many clock pulses.
    pub fn stick_mpu(&mut self, pulses: u32) {
        self.mpu_stuck = Some(pulses);
    }

    /// It lets go by itself.
    pub fn release_mpu(&mut self) {
        self.mpu_stuck = None;
    }

    /// Whether `SDA` is held low on `side`'s wires.
    #[must_use]
    pub fn is_stuck(&self, side: Side) -> bool {
        let by_mpu = self.mpu_stuck.is_some() && side == Side::Stm;
        by_mpu || self.stuck.is_some() && self.owner == side
    }

    /// `side` raised the clock line by hand.
    pub fn pulse(&mut self, side: Side) {
        let less = |stuck: Option<u32>| {
            stuck
                .and_then(|left| left.checked_sub(1))
                .filter(|&left| left > 0)
        };
        if self.owner == side {
            self.stuck = less(self.stuck);
        }
        if side == Side::Stm {
            self.mpu_stuck = less(self.mpu_stuck);
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
        if let Some(mpu) = self.mpu.as_mut().filter(|mpu| mpu.is_reading()) {
            mpu.stop();
            self.mpu_stuck = Some(CLEARING_PULSES);
        }
        self.with_mpu = false;
    }

    fn mpu(&mut self, side: Side) -> Option<&mut Mpu6050> {
        if side == Side::Stm && self.with_mpu && !self.is_stuck(side) {
            self.mpu.as_mut()
        } else {
            None
        }
    }

    fn reachable(&mut self, side: Side) -> Option<&mut Eeprom> {
        if self.owner == side && !self.is_stuck(side) {
            self.eeprom.as_mut()
        } else {
            None
        }
    }

    /// A start; the answer is the acknowledge.
    pub fn start(&mut self, side: Side, now: u64, address: u8, read: bool) -> bool {
        let eeprom = self
            .reachable(side)
            .is_some_and(|eeprom| eeprom.start(now, address, read));
        if side == Side::Stm {
            self.with_mpu = true;
            self.with_mpu = self.mpu(side).is_some_and(|mpu| mpu.start(address, read));
        }
        eeprom || side == Side::Stm && self.with_mpu
    }

    /// A byte out; the answer is the acknowledge.
    pub fn write(&mut self, side: Side, byte: u8) -> bool {
        if let Some(mpu) = self.mpu(side) {
            return mpu.write(byte);
        }
        self.reachable(side)
            .is_some_and(|eeprom| eeprom.write(byte))
    }

    /// A byte in; a line nobody drives reads all ones.
    pub fn read(&mut self, side: Side) -> u8 {
        if let Some(mpu) = self.mpu(side) {
            return mpu.read();
        }
        self.reachable(side).map_or(0xFF, Eeprom::read)
    }

    /// A stop.
    pub fn stop(&mut self, side: Side, now: u64) {
        if let Some(mpu) = self.mpu(side) {
            mpu.stop();
            self.with_mpu = false;
        }
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
    use crate::components::eeprom::ADDRESS;

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

    fn both() -> I2cBus {
        let mpu = Mpu6050::new(crate::components::mpu6050::Mpu6050Params::default(), 1);
        I2cBus::new(Some(Eeprom::holding(&[7]))).with_mpu(Some(mpu))
    }

    #[test]
    fn the_motion_sensor_is_the_stms_whoever_has_the_eeprom() {
        let mut bus = both();
        for side in [Side::Stm, Side::Pi] {
            bus.give_to(side);
            assert!(bus.start(Side::Stm, 0, 0x68, false));
            assert!(bus.write(Side::Stm, 0x75));
            assert!(bus.start(Side::Stm, 0, 0x68, true));
            assert_eq!(bus.read(Side::Stm), 0x68);
            bus.stop(Side::Stm, 0);
            assert!(!bus.start(Side::Pi, 0, 0x68, false));
        }
        bus.give_to(Side::Stm);
        assert!(bus.start(Side::Stm, 0, ADDRESS, true));
        assert_eq!(bus.read(Side::Stm), 7);
    }

    #[test]
    fn a_motion_sensor_that_holds_the_line_holds_the_stms_alone() {
        let mut bus = both();
        bus.give_to(Side::Pi);
        bus.stick_mpu(2);
        assert!(bus.is_stuck(Side::Stm) && !bus.is_stuck(Side::Pi));
        assert!(!bus.start(Side::Stm, 0, 0x68, false));
        assert!(bus.start(Side::Pi, 0, ADDRESS, false));
        bus.pulse(Side::Stm);
        bus.pulse(Side::Stm);
        assert!(bus.start(Side::Stm, 0, 0x68, true));
        bus.stm_reset();
        assert!(bus.is_stuck(Side::Stm), "it was being read");
    }

    #[test]
    fn a_reset_in_the_middle_of_a_read_leaves_the_line_held() {
        let mut bus = I2cBus::new(Some(Eeprom::holding(&[])));
        bus.start(Side::Stm, 0, ADDRESS, true);
        bus.stm_reset();
        assert!(bus.is_stuck(Side::Stm));
    }
}
