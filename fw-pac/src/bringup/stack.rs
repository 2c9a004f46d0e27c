//! A stack overflow on purpose: below the RAM is nothing, so it must end in a `HardFault` and the safe state.

use crate::reset::Kept;
use crate::stack_overflow;

/// Tells the boot after the reset that the overflow was on purpose.
#[unsafe(link_section = ".uninit.bringup")]
pub static ON_PURPOSE: Kept = Kept::new();

/// Uses up the stack.
pub fn overflow() -> ! {
    ON_PURPOSE.mark();
    stack_overflow::descend(0);
    // Only reached where the stack did not overflow: the line of `HardFault` is missing then.
    cortex_m::peripheral::SCB::sys_reset()
}
