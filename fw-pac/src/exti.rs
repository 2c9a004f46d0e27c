//! EXTI: the edges that raise interrupts.

use crate::registers::Registers;
use stm32f4::stm32f411::{EXTI, SYSCFG};

/// Chip-select: PA4.
pub const FRAME: u8 = 4;
/// Echoes, both edges: PB0, PC9, PC12.
pub const ECHO_RIGHT: u8 = 0;
/// See [`ECHO_RIGHT`].
pub const ECHO_FRONT: u8 = 9;
/// See [`ECHO_RIGHT`].
pub const ECHO_LEFT: u8 = 12;

/// The supply detector's output, high while the supply is low (RM0383, 5.2.3): latched, without an interrupt.
const SUPPLY: u8 = 16;

/// Routes the pins to their lines and unmasks them.
pub fn start() {
    let syscfg = SYSCFG::registers();
    // SAFETY: port codes A 0, B 1, C 2 (RM0383, 7.2.3).
    unsafe {
        syscfg.exticr1().modify(|_, w| w.exti0().bits(1));
        syscfg.exticr2().modify(|_, w| w.exti4().bits(0));
        syscfg.exticr3().modify(|_, w| w.exti9().bits(2));
        syscfg.exticr4().modify(|_, w| w.exti12().bits(2));
    }
    let exti = EXTI::registers();
    exti.rtsr().write(|w| {
        w.tr(FRAME).set_bit();
        w.tr(ECHO_RIGHT).set_bit();
        w.tr(ECHO_FRONT).set_bit();
        w.tr(ECHO_LEFT).set_bit();
        w.tr(SUPPLY).set_bit()
    });
    exti.ftsr().write(|w| {
        w.tr(ECHO_RIGHT).set_bit();
        w.tr(ECHO_FRONT).set_bit();
        w.tr(ECHO_LEFT).set_bit()
    });
    exti.pr().write(|w| {
        w.pr(FRAME).clear();
        w.pr(ECHO_RIGHT).clear();
        w.pr(ECHO_FRONT).clear();
        w.pr(ECHO_LEFT).clear();
        w.pr(SUPPLY).clear()
    });
    exti.imr().write(|w| {
        w.mr(FRAME).set_bit();
        w.mr(ECHO_RIGHT).set_bit();
        w.mr(ECHO_FRONT).set_bit();
        w.mr(ECHO_LEFT).set_bit();
        w.mr(SUPPLY).set_bit()
    });
}

/// Clears a line's pending edge.
#[inline]
pub fn clear(line: u8) {
    EXTI::registers().pr().write(|w| w.pr(line).clear());
}

/// Whether the supply has fallen below its threshold since the last call. Only what was seen is cleared.
#[inline]
pub fn take_supply_dip() -> bool {
    let pending = EXTI::registers().pr();
    let seen = pending.read().bits() & 1 << SUPPLY;
    // SAFETY: a 1 clears its line, a 0 leaves it.
    pending.write(|w| unsafe { w.bits(seen) });
    seen != 0
}
