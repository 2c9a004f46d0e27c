//! Fault injection. Broken transfers are sequences of [`SpiStep`](crate::SpiStep)s, faults of the
//! buses are in [`I2cBus`](crate::components::i2c_bus::I2cBus).

use plant::Faults;
use rigless::mcu::Operate;
use rigless::soc::Width;
use rigless::soc::stm32f427::generated::rcc::{Register, bdcr, csr};
use rigless::time::VirtualNanos;

use crate::board::Board;
use crate::components::mpu6050::Mpu6050;
use crate::soc::Stm32f411;
use crate::virtual_board::{FACTORY_OPTIONS, RAIL_MV};

/// TIM5's first control register, RM0383 table 1 and section 13.4.1.
const TIM5_CR1: u64 = 0x4000_0C00;
const TIM5_DIER: u64 = TIM5_CR1 + 0xC;
/// USART1's third control register, RM0383 section 19.6.6, and whether the DMA feeds it.
const USART1_CR3: u64 = 0x4001_1014;
const DMAT: u64 = 1 << 7;
/// The clocks of APB2's peripherals, RM0383 section 6.3.12, and the converter's among them.
const RCC_APB2ENR: u64 = 0x4002_3844;
const ADC1EN: u64 = 1 << 8;

impl Board {
    /// Changes what is broken in the physical world: a dead encoder, a missing or stuck echo, slip,
    /// a jammed wheel, an external rotation.
    pub fn set_faults(&self, change: impl FnOnce(&mut Faults) + Send + 'static) {
        self.world(|world| change(&mut world.faults));
    }

    /// Changes the MPU6050, if one is fitted.
    pub fn set_mpu(&self, change: impl FnOnce(&mut Mpu6050) + Send + 'static) {
        self.i2c_bus(|bus, _| bus.mpu.as_mut().map(change));
    }

    /// The crystal stops for good, RM0383 section 6.2.7. The emulated core has no line to its NMI: I2C1's error
    /// interrupt stands for it, in an ELF in which both have one vector and without a gyroscope.
    pub fn stop_crystal(&self) {
        self.act_on_chip(Stm32f411::fail_crystal);
    }

    /// A device on I2C1's bus stretches the clock for as long as this is set.
    pub fn stretch_i2c(&self, stretched: bool) {
        self.act_on_chip(move |chip, at| chip.stretch_i2c1(at, stretched));
    }

    /// I2C1 sees a bus error that is none, ES0287 section 2.10.
    pub fn raise_bus_error(&self) {
        self.act_on_chip(Stm32f411::raise_i2c1_bus_error);
    }

    /// I2C1 loses the arbitration, as by a disturbance of SDA, RM0383 section 18.3.4; whether it was master.
    pub fn lose_arbitration(&self) -> bool {
        self.act_on_chip(Stm32f411::lose_i2c1_arbitration)
    }

    /// The 3.3 V rail, in millivolts, from now on.
    pub fn set_supply(&self, millivolts: u32) {
        self.act_on_chip(move |chip, at| chip.set_supply(at, millivolts));
    }

    /// The 3.3 V rail falls to so many millivolts for so many microseconds, which pass.
    pub fn dip_supply(&self, millivolts: u32, us: u64) {
        self.set_supply(millivolts);
        self.run_us(us);
        self.set_supply(RAIL_MV);
    }

    /// The option bytes are the factory's: no brown-out reset.
    pub fn reset_option_bytes(&self) {
        self.act_on_chip(|chip, _| chip.set_option_bytes(FACTORY_OPTIONS));
    }

    /// An earlier firmware has left the low-speed oscillator on: no reset stops it.
    pub fn start_lse(&self) {
        self.act_on_chip(|chip, _| chip.set_rcc_bits(Register::Bdcr, bdcr::LSEON.mask()));
    }

    /// The reset that follows is a brown-out's: the supply falls below its level, not to power-on's (RM0383,
    /// 6.3.21).
    pub fn brown_out(&self) {
        self.act_on_chip(|chip, _| chip.set_rcc_bits(Register::Csr, csr::BORRSTF.mask()));
    }

    /// The converter stops: no conversion ends any more.
    pub fn stop_converter(&self) {
        self.change(RCC_APB2ENR, |clocks| clocks & !ADC1EN);
    }

    /// The converter is started no more: TIM5's third compare interrupts no longer, where TIM5 has a clock.
    pub fn stop_conversions(&self) {
        self.change(TIM5_DIER, |enables| enables & !(1 << 3));
    }

    /// TIM5, the timer of the firmware's ticks, stops, where it has a clock.
    pub fn stop_ticks(&self) {
        self.change(TIM5_CR1, |_| 0);
    }

    /// A debugger halts the core, or lets it go on. The peripherals go on meanwhile; who freezes the watchdog
    /// and the timers is not modelled: the firmware does not.
    pub fn halt_core(&self, halted: bool) {
        self.stopped(move |stopped| stopped.hold_core(halted));
    }

    /// The log's bytes leave no more, or do again, where USART1 has a clock.
    pub fn block_log(&self, blocked: bool) {
        let requests = if blocked { 0 } else { DMAT };
        self.change(USART1_CR3, move |word| word & !DMAT | requests);
    }

    /// Changes a word of a peripheral; without a clock it does nothing that could be changed.
    fn change(&self, address: u64, change: impl FnOnce(u64) -> u64 + Send + 'static) {
        self.act_on_chip(move |chip, at| {
            if let Ok(word) = chip.read(at, address, Width::W32) {
                let written = chip.write(at, address, Width::W32, change(word));
                written.expect("it has its clock");
            }
        });
    }

    fn act_on_chip<T: Send + 'static>(
        &self,
        act: impl FnOnce(&mut Stm32f411, VirtualNanos) -> T + Send + 'static,
    ) -> T {
        self.stopped(|stopped| {
            let at = stopped.at();
            act(&mut stopped.mcu().chip, at)
        })
    }
}
