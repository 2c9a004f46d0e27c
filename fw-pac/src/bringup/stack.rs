//! A stack overflow on purpose: below the RAM is nothing, so it must end in a `HardFault` and the safe state.

use crate::stack_overflow;
use core::cell::UnsafeCell;
use core::mem::MaybeUninit;

/// Tells the boot after the reset that the overflow was on purpose.
const MARKER: u32 = 0x5AC4_0F10;

/// A word that a reset leaves as it is.
struct Kept(UnsafeCell<MaybeUninit<u32>>);

// SAFETY: accessed by volatile words, at boot and by the one step that never returns.
unsafe impl Sync for Kept {}

#[unsafe(link_section = ".uninit.bringup")]
static KEPT: Kept = Kept(UnsafeCell::new(MaybeUninit::uninit()));

/// Whether the reset came out of [`overflow`]; clears the marker.
pub fn take_marker() -> bool {
    let word: *mut u32 = KEPT.0.get().cast();
    // SAFETY: RAM, aligned; any pattern is a word.
    unsafe {
        let found = word.read_volatile() == MARKER;
        word.write_volatile(0);
        found
    }
}

/// Uses up the stack.
pub fn overflow() -> ! {
    let word: *mut u32 = KEPT.0.get().cast();
    // SAFETY: as above.
    unsafe { word.write_volatile(MARKER) };
    stack_overflow::descend(0);
    // Only reached where the stack did not overflow: the line of `HardFault` is missing then.
    cortex_m::peripheral::SCB::sys_reset()
}
