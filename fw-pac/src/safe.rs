//! The safe state: where a panic, a fault, a dying crystal and every unexpected interrupt end.
//!
//! In this order: interrupts off, motors and servo off by plain GPIO (which works whatever became of
//! the timers), READY low, the LEDs' fault pattern, one line on the UART, then nothing more: the
//! watchdog, no longer fed, resets the part within 188 ms. Waiting for it rather than resetting at
//! once leaves the line time to get out and proves at every such end that the watchdog lives; should
//! it not, the part resets itself after about a second. Either reset leaves the motors off, and the
//! boot after it reports why it happened.

use crate::board::READY;
use crate::gpio::Driver;
use crate::{clock, leds, motors, uart};
use core::panic::PanicInfo;
use cortex_m::peripheral::SCB;
use cortex_m_rt::exception;
use fw_core::robot;
use fw_core::wire::State;
use stm32f4::stm32f411 as pac;

/// Polls of the wait for the watchdog: about a second at 100 MHz.
const PATIENCE: u32 = 100_000_000;

/// Ends here. `why` is one line of ASCII with its line feed.
// Requirement: WIRE-safe-1
pub fn halt(why: &[u8]) -> ! {
    cortex_m::interrupt::disable();
    // Boot may not have come to it yet.
    clock::enable_peripherals();
    motors::force_off();
    crate::servo::force_off();
    READY.low();
    READY.output(Driver::PushPull);
    leds::show(robot::leds(State::Faulted));
    uart::last_words(why);
    cortex_m::asm::delay(PATIENCE);
    SCB::sys_reset()
}

#[panic_handler]
fn panic(_: &PanicInfo) -> ! {
    halt(b"\nE: panic, motors off\n")
}

#[exception]
unsafe fn NonMaskableInt() -> ! {
    // SAFETY: the NMI is entered once and never left; clearing the flag keeps the pending NMI from
    // being taken again by the next reset's handler.
    unsafe { &*pac::RCC::ptr() }
        .cir()
        .modify(|_, w| w.cssc().set_bit());
    halt(b"\nE: crystal died, motors off\n")
}

#[exception]
unsafe fn DefaultHandler(_: i16) -> ! {
    halt(b"\nE: unexpected interrupt, motors off\n")
}

// A stack overflow leaves nothing to push on, and a push within HardFault is lockup. So the handler
// begins by giving itself the whole stack: nobody will return to what is on it.
core::arch::global_asm!(
    ".section .HardFault.user, \"ax\", %progbits",
    ".global HardFault",
    ".type HardFault, %function",
    ".thumb_func",
    "HardFault:",
    "ldr r0, =_stack_start",
    "msr msp, r0",
    "bl {handler}",
    ".ltorg",
    ".size HardFault, . - HardFault",
    handler = sym hard_fault,
);

extern "C" fn hard_fault() -> ! {
    halt(b"\nE: HardFault, motors off\n")
}
