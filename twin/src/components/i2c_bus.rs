//! The STM's I2C bus with the MPU6050, and the EEPROM behind its switch, which `SELECT` connects to the
//! Pi (high) or to the STM (low). The other controller receives no acknowledge from the EEPROM.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use rigless::chip::Timeline;
use rigless::chip::i2c::Peer;
use rigless::snapshot::Store;

use super::eeprom::Eeprom;
use super::mpu6050::Mpu6050;

/// A controller of the bus.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum I2cController {
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
    /// The MPU6050, unless none is fitted: on the STM's side of the switch.
    pub mpu: Option<Mpu6050>,
    /// What the switch connects the EEPROM to.
    controller: I2cController,
    /// Clock pulses until a device on the EEPROM's side releases `SDA`; 0 while none holds it.
    pub sda_held: u32,
    /// The same of the MPU6050.
    pub sda_held_by_mpu: u32,
    /// Whether the STM's transaction is with the MPU6050.
    mpu_addressed: bool,
}

/// Clock pulses that free a device in any state: eight bits and the acknowledge (NXP UM10204,
/// 3.1.16).
pub const CLEARING_PULSES: u32 = 9;

impl I2cBus {
    /// The bus with these devices, connected to the STM as the pull-down leaves it.
    pub fn new(eeprom: Option<Eeprom>, mpu: Option<Mpu6050>) -> Self {
        Self {
            eeprom,
            mpu,
            controller: I2cController::Stm,
            sda_held: 0,
            sda_held_by_mpu: 0,
            mpu_addressed: false,
        }
    }

    /// What the switch connects the EEPROM to.
    pub fn controller(&self) -> I2cController {
        self.controller
    }

    /// Switches the EEPROM. A transaction under way is cut off.
    pub fn switch_to(&mut self, controller: I2cController) {
        if self.controller != controller {
            self.controller = controller;
            if let Some(eeprom) = &mut self.eeprom {
                eeprom.abort();
            }
        }
    }

    /// Whether `SDA` is held low on the wires of `side`.
    pub fn is_sda_held(&self, side: I2cController) -> bool {
        let by_mpu = self.sda_held_by_mpu > 0 && side == I2cController::Stm;
        by_mpu || self.sda_held > 0 && self.controller == side
    }

    /// A clock pulse by the STM.
    pub fn clock_pulse(&mut self) {
        if self.controller == I2cController::Stm {
            self.sda_held = self.sda_held.saturating_sub(1);
        }
        self.sda_held_by_mpu = self.sda_held_by_mpu.saturating_sub(1);
    }

    /// The STM was reset: in the middle of a read the device is left driving `SDA`.
    pub fn stm_reset(&mut self) {
        if self.controller == I2cController::Stm
            && let Some(eeprom) = &mut self.eeprom
        {
            if eeprom.is_reading() {
                self.sda_held = CLEARING_PULSES;
            }
            eeprom.abort();
        }
        if let Some(mpu) = self.mpu.as_mut().filter(|mpu| mpu.is_reading()) {
            mpu.stop();
            self.sda_held_by_mpu = CLEARING_PULSES;
        }
        self.mpu_addressed = false;
    }

    fn mpu(&mut self, side: I2cController) -> Option<&mut Mpu6050> {
        let answers = side == I2cController::Stm && self.mpu_addressed && !self.is_sda_held(side);
        self.mpu.as_mut().filter(|_| answers)
    }

    fn reachable(&mut self, side: I2cController) -> Option<&mut Eeprom> {
        let answers = self.controller == side && !self.is_sda_held(side);
        self.eeprom.as_mut().filter(|_| answers)
    }

    /// A start. Returns the acknowledge.
    pub fn start(&mut self, side: I2cController, now: u64, address: u8, read: bool) -> bool {
        let eeprom = self.reachable(side);
        let eeprom = eeprom.is_some_and(|eeprom| eeprom.start(now, address, read));
        if side == I2cController::Stm {
            self.mpu_addressed = true;
            self.mpu_addressed = self.mpu(side).is_some_and(|mpu| mpu.start(address, read));
        }
        eeprom || side == I2cController::Stm && self.mpu_addressed
    }

    /// A byte out. Returns the acknowledge.
    pub fn write(&mut self, side: I2cController, byte: u8) -> bool {
        if let Some(mpu) = self.mpu(side) {
            return mpu.write(byte);
        }
        self.reachable(side)
            .is_some_and(|eeprom| eeprom.write(byte))
    }

    /// A byte in; an undriven line reads all ones.
    pub fn read(&mut self, side: I2cController) -> u8 {
        if let Some(mpu) = self.mpu(side) {
            return mpu.read();
        }
        self.reachable(side).map_or(0xFF, Eeprom::read)
    }

    /// A stop.
    pub fn stop(&mut self, side: I2cController, now: u64) {
        if let Some(mpu) = self.mpu(side) {
            mpu.stop();
            self.mpu_addressed = false;
        }
        if let Some(eeprom) = self.reachable(side) {
            eeprom.stop(now);
        }
    }
}

/// The bus, shared by the STM's controller, to which it is a chip, and the board.
#[derive(Clone, Debug)]
pub struct SharedBus(Arc<Mutex<I2cBus>>);

impl SharedBus {
    /// Shares `bus`.
    pub fn new(bus: I2cBus) -> Self {
        Self(Arc::new(Mutex::new(bus)))
    }

    /// The bus.
    pub fn lock(&self) -> MutexGuard<'_, I2cBus> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Store for SharedBus {}

impl Peer for SharedBus {
    fn start(&mut self, address: u8, read: bool, context: &mut Timeline<'_, '_>) -> bool {
        let now = context.now().0;
        self.lock().start(I2cController::Stm, now, address, read)
    }

    fn write(&mut self, byte: u8, _context: &mut Timeline<'_, '_>) -> bool {
        self.lock().write(I2cController::Stm, byte)
    }

    fn read(&mut self, _last: bool, _context: &mut Timeline<'_, '_>) -> u8 {
        self.lock().read(I2cController::Stm)
    }

    fn stop(&mut self, context: &mut Timeline<'_, '_>) {
        self.lock().stop(I2cController::Stm, context.now().0);
    }
}

#[cfg(test)]
mod tests {
    use super::I2cController::{Pi, Stm};
    use super::*;
    use crate::components::eeprom::ADDRESS;
    use crate::components::mpu6050::ADDRESS as MPU_ADDRESS;
    use plant::GyroParams;

    fn bus() -> I2cBus {
        let mpu = Mpu6050::new(GyroParams::default(), 1);
        I2cBus::new(Some(Eeprom::new(&[7])), Some(mpu))
    }

    #[test]
    fn eeprom_acknowledges_connected_controller_alone() {
        let mut bus = bus();
        for (connected, other) in [(Stm, Pi), (Pi, Stm)] {
            bus.switch_to(connected);
            assert!(bus.start(connected, 0, ADDRESS, false));
            assert!(!bus.start(other, 0, ADDRESS, false));
        }
    }

    #[test]
    fn nine_clock_pulses_free_held_bus() {
        let mut bus = bus();
        bus.sda_held = CLEARING_PULSES;
        for _ in 0..CLEARING_PULSES {
            assert!(bus.is_sda_held(Stm));
            assert!(!bus.start(Stm, 0, ADDRESS, false));
            bus.clock_pulse();
        }
        assert!(!bus.is_sda_held(Stm));
        assert!(bus.start(Stm, 0, ADDRESS, false));
    }

    #[test]
    fn mpu_answers_stm_whatever_the_switch() {
        let mut bus = bus();
        for side in [Stm, Pi] {
            bus.switch_to(side);
            assert!(bus.start(Stm, 0, MPU_ADDRESS, false));
            assert!(bus.write(Stm, 0x75));
            assert!(bus.start(Stm, 0, MPU_ADDRESS, true));
            assert_eq!(bus.read(Stm), 0x68);
            bus.stop(Stm, 0);
            assert!(!bus.start(Pi, 0, MPU_ADDRESS, false));
        }
        bus.switch_to(Stm);
        assert!(bus.start(Stm, 0, ADDRESS, true));
        assert_eq!(bus.read(Stm), 7);
    }

    #[test]
    fn sda_held_by_mpu_blocks_stm_alone() {
        let mut bus = bus();
        bus.switch_to(Pi);
        bus.sda_held_by_mpu = 2;
        assert!(bus.is_sda_held(Stm) && !bus.is_sda_held(Pi));
        assert!(!bus.start(Stm, 0, MPU_ADDRESS, false));
        assert!(bus.start(Pi, 0, ADDRESS, false));
        bus.clock_pulse();
        bus.clock_pulse();
        assert!(bus.start(Stm, 0, MPU_ADDRESS, true));
    }

    #[test]
    fn reset_during_read_leaves_sda_held() {
        for address in [ADDRESS, MPU_ADDRESS] {
            let mut bus = bus();
            bus.start(Stm, 0, address, true);
            bus.stm_reset();
            assert!(bus.is_sda_held(Stm), "{address:#x}");
        }
    }
}
