//! Edges on pins, and the priorities of everything.
//!
//! | priority | handler | does |
//! |---|---|---|
//! | −2, −1 | NMI, HardFault, and any interrupt nobody expects | [`crate::safe`], for good |
//! | 0 | EXTI4 | the frame's end: swaps the SPI's buffers |
//! | 1 | TIM5, EXTI0, EXTI9_5, EXTI15_10 | latch the tick, time the echoes |
//! | 2 | PendSV, DMA2_STREAM7, I2C1_EV, I2C1_ER, DMA1_STREAM0 | the robot: frames, echoes, ticks, log, gyroscope |
//! | thread | `main` | feeds the watchdog, sleeps |

use cortex_m::peripheral::scb::SystemHandler;
use cortex_m::peripheral::{NVIC, SCB};
use stm32f4::stm32f411::{self as pac, Interrupt};

/// The lines in use: chip-select rise, and both edges of the three echoes.
const FRAME: u32 = 1 << 4;
const ECHOES: u32 = 1 << 0 | 1 << 9 | 1 << 12;

fn registers() -> &'static pac::exti::RegisterBlock {
    // SAFETY: the registers are at this address for as long as the part is powered; after boot only
    // PR is written, where a 1 clears its line and a 0 leaves the others alone.
    unsafe { &*pac::EXTI::ptr() }
}

/// Routes the pins to their lines and enables every interrupt.
pub fn start(nvic: &mut NVIC, scb: &mut SCB) {
    // SAFETY: boot runs alone.
    let syscfg = unsafe { &*pac::SYSCFG::ptr() };
    // SAFETY: port codes A 0, B 1, C 2 (RM0383, 7.2.3).
    unsafe {
        // EXTI0: PB0, the right echo.
        syscfg.exticr1().modify(|_, w| w.exti0().bits(1));
        // EXTI4: PA4, the chip-select.
        syscfg.exticr2().modify(|_, w| w.exti4().bits(0));
        // EXTI9: PC9, the front echo.
        syscfg.exticr3().modify(|_, w| w.exti9().bits(2));
        // EXTI12: PC12, the left echo.
        syscfg.exticr4().modify(|_, w| w.exti12().bits(2));
    }
    let exti = registers();
    // SAFETY: the lines named above, all of them GPIO lines.
    unsafe {
        exti.rtsr().write(|w| w.bits(FRAME | ECHOES));
        exti.ftsr().write(|w| w.bits(ECHOES));
        exti.pr().write(|w| w.bits(FRAME | ECHOES));
        exti.imr().write(|w| w.bits(FRAME | ECHOES));
    }
    // SAFETY: nothing relies on priorities for exclusion before this point, and every handler's
    // state is in place when `main` calls it.
    unsafe {
        // One by one and not in a loop: `cargo xtask stack` reads the levels from these stores.
        nvic.set_priority(Interrupt::EXTI4, 0 << 4);
        nvic.set_priority(Interrupt::TIM5, 1 << 4);
        nvic.set_priority(Interrupt::EXTI0, 1 << 4);
        nvic.set_priority(Interrupt::EXTI9_5, 1 << 4);
        nvic.set_priority(Interrupt::EXTI15_10, 1 << 4);
        nvic.set_priority(Interrupt::DMA2_STREAM7, 2 << 4);
        scb.set_priority(SystemHandler::PendSV, 2 << 4);
        for handler in [
            Interrupt::EXTI4,
            Interrupt::TIM5,
            Interrupt::EXTI0,
            Interrupt::EXTI9_5,
            Interrupt::EXTI15_10,
            Interrupt::DMA2_STREAM7,
        ] {
            NVIC::unmask(handler);
        }
        for handler in [
            Interrupt::I2C1_EV,
            Interrupt::I2C1_ER,
            Interrupt::DMA1_STREAM0,
        ] {
            nvic.set_priority(handler, 2 << 4);
            // What boot's read left pending.
            NVIC::unpend(handler);
            NVIC::unmask(handler);
        }
    }
}

/// Clears a line's pending edge.
#[inline]
pub fn clear(line: u8) {
    // SAFETY: a 1 clears its line alone.
    registers().pr().write(|w| unsafe { w.bits(1 << line) });
}

/// Has the robot look at its slots as soon as nothing above it runs.
#[inline]
pub fn wake_robot() {
    SCB::set_pendsv();
}
