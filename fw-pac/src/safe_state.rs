//! The safe state: the end of a panic, a fault, a failed crystal, a missing tick and any unexpected interrupt.
//!
//! In this order: interrupts off, motors and servo off by plain GPIO (whatever the timers do), READY low,
//! the LEDs' fault pattern, one line on the UART, then a wait for the watchdog, which resets the part
//! within 188 ms. The wait leaves the line time to get out; without a working watchdog the part resets
//! itself after about a second. The motors stay off, and the next boot reports the cause.

use crate::board::READY;
use crate::gpio::Driver;
use crate::registers::Registers;
use crate::{clock, leds, motors, reset, servo, uart};
use core::panic::PanicInfo;
use cortex_m::peripheral::SCB;
use cortex_m_rt::exception;
use fw_core::robot;
use fw_core::wire::State;
use stm32f4::stm32f411::RCC;

/// Polls of the wait for the watchdog: about a second at 100 MHz.
const WATCHDOG_POLLS: u32 = 100_000_000;

/// Motors and servo off by plain GPIO, READY low: boot's first step and the safe state's.
#[inline]
pub fn outputs_off() {
    clock::enable_peripherals();
    motors::force_off();
    servo::force_off();
    READY.low();
    READY.output(Driver::PushPull);
}

/// Enters the safe state. `why`, ASCII, stands in the log's last line.
// Requirement: WIRE-safe-1
pub fn halt(why: &[u8]) -> ! {
    cortex_m::interrupt::disable();
    // A fault may come before boot does it.
    outputs_off();
    leds::show(robot::leds(State::Faulted));
    uart::write_blocking(b"\nE: ");
    uart::write_blocking(why);
    uart::write_blocking(b", motors off\n");
    cortex_m::asm::delay(WATCHDOG_POLLS);
    reset::SAFE_STATE.mark();
    SCB::sys_reset()
}

#[panic_handler]
fn panic(_: &PanicInfo) -> ! {
    halt(b"panic")
}

#[exception]
unsafe fn NonMaskableInt() -> ! {
    // Otherwise the NMI stays pending and is taken again after the reset.
    RCC::registers().cir().modify(|_, w| w.cssc().set_bit());
    uart::slow_down();
    halt(b"crystal failed")
}

// Requirement: WIRE-safe-1
#[exception]
fn SysTick() -> ! {
    halt(b"no tick")
}

#[exception]
unsafe fn DefaultHandler(_: i16) -> ! {
    halt(b"unexpected interrupt")
}

// After a stack overflow a push within HardFault is lockup, so the handler first resets the stack
// pointer: it never returns.
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
    halt(b"HardFault")
}
