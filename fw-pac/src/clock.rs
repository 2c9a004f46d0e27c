//! The clock tree: 100 MHz from the 8 MHz crystal, or from the internal 16 MHz oscillator where the
//! crystal does not start.
//!
//! Both ways end at the same SYSCLK, so every timer and baud rate below is right on either; the
//! internal oscillator is merely less exact (±1 % at room temperature, DS10314 table 39), and the
//! robot says so with [`fw_core::types::Faults::CLOCK_FALLBACK`].
//!
//! A crystal that dies later is caught by the clock security system: the hardware falls back to the
//! bare HSI at 16 MHz, with which neither the PWM nor the µs clock nor the baud rate would be right,
//! and raises the NMI. The NMI ends in the safe state of [`crate::safe_state`] and the reset that follows;
//! the next boot finds the crystal dead, takes the fallback, reports it, and the robot stands until
//! it is sent off again. Going on driving through the change was decided against: for its duration
//! the length of a microsecond would be unknown.

use crate::registers::Registers;
use stm32f4::stm32f411::{FLASH, PWR, RCC, flash, pwr, rcc};

/// SYSCLK, AHB and APB2, hertz.
pub const APB2_HZ: u32 = 100_000_000;
/// The clock of TIM2 to TIM5: twice APB1's 50 MHz, hertz.
pub const APB1_TIMER_HZ: u32 = 100_000_000;
/// APB1, megahertz.
pub const APB1_MHZ: u8 = 50;

/// What the PLL is fed from.
#[derive(Clone, Copy, PartialEq, Eq)]
pub enum Source {
    /// HSE, 8 MHz.
    Crystal,
    /// HSI, 16 MHz.
    Internal,
}

/// Polls until the crystal must have started: at least 20 ms at 16 MHz and five cycles a poll; it
/// typically needs 2 ms (DS10314, table 37).
const CRYSTAL_POLLS: u32 = 64_000;
/// Polls until the PLL must have locked: at least 0.3 ms at 16 MHz, as DS10314 table 41 allows it.
const POLLS: u32 = 2_000;

/// Brings SYSCLK to 100 MHz, from the crystal if `crystal_fits`; `None` if not even the internal oscillator's
/// PLL locks.
///
/// Called once, at boot, on the HSI that the reset selects; waits for the supply and calls `feed` meanwhile.
// Requirement: DOC-2.3-1
pub fn start(crystal_fits: bool, feed: impl Fn() + Copy) -> Option<Source> {
    let (rcc, pwr, flash) = (RCC::registers(), PWR::registers(), FLASH::registers());
    rcc.apb1enr().modify(|_, w| w.pwren().set_bit());
    // Read back: a peripheral answers two bus cycles after its clock is enabled (ES0287, 2.2.7).
    let _ = rcc.apb1enr().read();
    // 100 MHz needs scale 1 (RM0383, 5.4.1); a backup domain that may be written, see below.
    // The detector's fifth level: 2.66 V falling, 2.76 V rising (DS10314, embedded reset and power control).
    pwr.cr().modify(|_, w| {
        w.vos().scale1();
        w.dbp().set_bit();
        w.pls().set(4);
        w.pvde().set_bit()
    });
    // PC14 and PC15 are the LSE's where an earlier firmware started it: a reset does not stop it (RM0383, 6.3.20).
    rcc.bdcr().modify(|_, w| w.lseon().clear_bit());

    rcc.cr().modify(|_, w| w.hseon().set_bit());
    let crystal = poll(CRYSTAL_POLLS, || rcc.cr().read().hserdy().bit_is_set());
    if crystal_fits && crystal && lock(rcc, Source::Crystal) {
        switch(rcc, pwr, flash, feed)?;
        rcc.cr().modify(|_, w| w.csson().set_bit());
        return Some(Source::Crystal);
    }
    rcc.cr()
        .modify(|_, w| w.hseon().clear_bit().pllon().clear_bit());
    // The PLL takes no new factors before it has stopped.
    poll(POLLS, || rcc.cr().read().pllrdy().bit_is_clear());
    if lock(rcc, Source::Internal) {
        switch(rcc, pwr, flash, feed)?;
        return Some(Source::Internal);
    }
    None
}

/// 2 MHz into the PLL × 100 / 2; the 48 MHz output (÷ 5) is unused.
fn lock(rcc: &rcc::RegisterBlock, source: Source) -> bool {
    let (divider, from_crystal) = match source {
        Source::Crystal => (4, true),
        Source::Internal => (8, false),
    };
    // SAFETY: M 4 or 8, N 100, Q 5: each within its range (RM0383, 6.3.2).
    rcc.pllcfgr().write(|w| unsafe {
        w.pllm().bits(divider);
        w.plln().bits(100);
        w.pllq().bits(5);
        w.pllp().div2();
        w.pllsrc().bit(from_crystal)
    });
    rcc.cr().modify(|_, w| w.pllon().set_bit());
    poll(POLLS, || rcc.cr().read().pllrdy().bit_is_set())
}

/// Scale 1, which the regulator takes once the PLL runs; four wait states, for 100 MHz down to 2.4 V
/// (RM0383, table 5): motors that stall on an empty battery pull the supply below the 2.7 V of three.
/// Then the bus dividers and the switch.
fn switch(
    rcc: &rcc::RegisterBlock,
    pwr: &pwr::RegisterBlock,
    flash: &flash::RegisterBlock,
    feed: impl Fn() + Copy,
) -> Option<()> {
    if !poll(POLLS, || pwr.csr().read().vosrdy().bit_is_set()) {
        return None;
    }
    // A supply that still rises would read the flash wrong at 100 MHz; at the HSI's 16 MHz it does not.
    while supply_is_low() {
        feed();
    }
    flash.acr().write(|w| {
        w.latency().ws4();
        w.prften().set_bit();
        w.icen().set_bit();
        w.dcen().set_bit()
    });
    if !poll(POLLS, || flash.acr().read().latency().is_ws4()) {
        return None;
    }
    rcc.cfgr().modify(|_, w| {
        w.hpre().div1();
        w.ppre1().div2();
        w.ppre2().div1()
    });
    rcc.cfgr().modify(|_, w| w.sw().pll());
    poll(POLLS, || rcc.cfgr().read().sws().is_pll()).then_some(())
}

/// Whether `ready` came true within `polls` looks.
fn poll(polls: u32, ready: impl Fn() -> bool) -> bool {
    (0..polls).any(|_| ready())
}

/// Whether the supply is below what [`start`] sets: motors that stall on an empty battery pull it down. At
/// 2.4 V the flash is still read right, which leaves time for a tick to turn the motors off.
pub fn supply_is_low() -> bool {
    PWR::registers().csr().read().pvdo().bit_is_set()
}

/// Feeds the clock to every peripheral the firmware uses.
pub fn enable_peripherals() {
    let rcc = RCC::registers();
    rcc.ahb1enr().modify(|_, w| {
        w.gpioaen().set_bit();
        w.gpioben().set_bit();
        w.gpiocen().set_bit();
        w.dma1en().set_bit();
        w.dma2en().set_bit()
    });
    rcc.apb1enr().modify(|_, w| {
        w.tim2en().set_bit();
        w.tim3en().set_bit();
        w.tim4en().set_bit();
        w.tim5en().set_bit();
        w.i2c1en().set_bit()
    });
    rcc.apb2enr().modify(|_, w| {
        w.usart1en().set_bit();
        w.adc1en().set_bit();
        w.spi1en().set_bit();
        w.syscfgen().set_bit()
    });
    rcc.apb2enr().modify(|_, w| w.tim1en().set_bit());
    // The servo's pulse goes on in WFI: of all clocks used here, a reset leaves TIM1's alone off in Sleep (RM0383,
    // 6.3.13 to 6.3.15).
    rcc.apb2lpenr().modify(|_, w| w.tim1lpen().set_bit());
    // Read back: a peripheral answers two bus cycles after its clock is enabled (ES0287, 2.2.7).
    let _ = rcc.apb2enr().read();
}
