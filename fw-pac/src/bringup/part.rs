//! Identity of the part, its flash and its option bytes.

use crate::registers::Registers;
use fw_core::log::{Level, Log};
use stm32f4::stm32f411::{DBGMCU, FLASH};

/// Kilobytes of flash, a half-word of the system memory (RM0383, 24.2).
const FLASH_SIZE: usize = 0x1FFF_7A22;

/// Reports device and revision codes, flash size, brown-out level (3 = off) and read protection
/// (0xAA = none).
pub fn report(log: &mut Log) {
    let id = DBGMCU::registers().idcode().read();
    let options = FLASH::registers().optcr().read();
    // SAFETY: an aligned half-word of the system memory, which is always readable.
    let flash_kb = unsafe { (FLASH_SIZE as *const u16).read_volatile() };
    log.line(Level::Info, |line| {
        line.text("part device 0x")
            .hex(id.dev_id().bits().into(), 3);
        line.text(" revision 0x").hex(id.rev_id().bits().into(), 4);
        line.text(" flash_kb ").int(flash_kb.into());
        line.text(" bor ").int(options.bor_lev().bits().into());
        line.text(" rdp 0x").hex(options.rdp().bits().into(), 2);
    });
}
