//! Fault injection. Broken transfers are sequences of [`SpiStep`](crate::SpiStep)s, faults of the
//! buses are in [`I2cBus`](crate::components::i2c_bus::I2cBus).

use plant::Faults;
use rigless::mcu::Operate;
use rigless::soc::Width;

use crate::board::Board;
use crate::components::mpu6050::Mpu6050;

/// TIM5's first control register, RM0383 table 1 and section 13.4.1.
const TIM5_CR1: u64 = 0x4000_0C00;

impl Board {
    /// Changes what is broken in the physical world: a dead encoder, a missing or stuck echo, slip,
    /// a jammed wheel, an external rotation.
    pub fn set_faults(&self, change: impl FnOnce(&mut Faults) + Send + 'static) {
        self.world(|world| change(&mut world.faults));
    }

    /// Changes the MPU6050, if one is fitted: its fault, its errors, its supply.
    pub fn set_mpu(&self, change: impl FnOnce(&mut Mpu6050) + Send + 'static) {
        self.i2c_bus(|bus, _| bus.mpu.as_mut().map(change));
    }

    /// The crystal stops. Only a firmware with the clock security system on survives it, RM0383
    /// section 6.2.7.
    pub fn stop_crystal(&self) {
        self.stopped(|stopped| {
            let at = stopped.at();
            stopped.mcu().chip.fail_crystal(at);
        });
    }

    /// TIM5, the timer of the firmware's ticks, stops.
    ///
    /// # Panics
    /// While TIM5 has no clock, before the firmware has started it.
    pub fn stop_ticks(&self) {
        self.stopped(|stopped| {
            let at = stopped.at();
            let written = stopped.mcu().chip.write(at, TIM5_CR1, Width::W32, 0);
            written.expect("TIM5 has its clock");
        });
    }
}
