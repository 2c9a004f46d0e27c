//! One DMA stream, in direct mode, bytes or half-words, memory incrementing (RM0383, 9).
//!
//! | stream | channel | carries | interrupt |
//! |---|---|---|---|
//! | DMA1 S0 | 1 | I2C1 RX: EEPROM → image; later the gyroscope's rate | polled at boot; complete, at the robot's priority |
//! | DMA2 S0 | 3 | SPI1 RX: frame from the Pi | none, the chip-select's rise ends it |
//! | DMA2 S3 | 3 | SPI1 TX: frame to the Pi | none |
//! | DMA2 S4 | 0 | ADC1: battery taps | none, read at the tick |
//! | DMA2 S7 | 4 | USART1 TX: log | complete, at the robot's priority |
//!
//! All of them are in RM0383's request map (9.3.3, tables 27 and 28).

use core::sync::atomic::{fence, Ordering};
use stm32f4::stm32f411 as pac;

/// A stream, fixed at compile time: controller 1 or 2, stream 0 ..= 7.
// Requirement: DOC-3.3-1, DOC-3.3-2, DOC-3.3-3
pub struct Stream<const CONTROLLER: u8, const STREAM: usize>;

/// What a stream's control register says beside its channel.
pub mod control {
    /// Stream on.
    pub const EN: u32 = 1 << 0;
    /// Interrupt on a transfer error.
    pub const TEIE: u32 = 1 << 2;
    /// Interrupt when complete.
    pub const TCIE: u32 = 1 << 4;
    /// Peripheral to memory.
    pub const READ: u32 = 0b00 << 6;
    /// Memory to peripheral.
    pub const WRITE: u32 = 0b01 << 6;
    /// The memory address advances.
    pub const MINC: u32 = 1 << 10;
    /// 16 bits at both ends.
    pub const HALF_WORDS: u32 = 0b01 << 11 | 0b01 << 13;
    /// Before the others.
    pub const VERY_HIGH: u32 = 0b11 << 16;
    /// After the others of importance.
    pub const MEDIUM: u32 = 0b01 << 16;
    /// The request line, 0 ..= 7.
    pub const fn channel(number: u32) -> u32 {
        number << 25
    }
}

impl<const CONTROLLER: u8, const STREAM: usize> Stream<CONTROLLER, STREAM> {
    /// The stream's five flags within its flag register: FEIF, DMEIF, TEIF, HTIF, TCIF.
    const SHIFT: u32 = match STREAM % 4 {
        0 => 0,
        1 => 6,
        2 => 16,
        _ => 22,
    };
    const ALL: u32 = 0b11_1101 << Self::SHIFT;
    const ERROR: u32 = 0b1000 << Self::SHIFT;
    const COMPLETE: u32 = 0b10_0000 << Self::SHIFT;

    #[inline]
    fn controller() -> &'static pac::dma1::RegisterBlock {
        let address = match CONTROLLER {
            1 => pac::DMA1::ptr(),
            _ => pac::DMA2::ptr(),
        };
        // SAFETY: the controller's registers are at this address for as long as the part is
        // powered. Each stream has one owner in this firmware, the flag-clear registers ignore the
        // bits written as 0, so owners of different streams never disturb each other.
        unsafe { &*address }
    }

    /// Starts `count` transfers between the data register at `peripheral` and `memory`.
    ///
    /// # Safety
    /// `memory` must stay valid for `count` items, and nobody may write it (for [`control::READ`]:
    /// touch it) until the stream has been stopped or has completed.
    #[inline]
    pub unsafe fn start(peripheral: u32, memory: u32, count: u16, settings: u32) {
        // SAFETY: the caller's promise.
        unsafe {
            Self::connect(peripheral);
            Self::restart(memory, count, settings);
        }
    }

    /// Names the peripheral's end, for every [`Self::restart`] from now on; with the stream stopped.
    ///
    /// # Safety
    /// `peripheral` must be the address of a data register.
    #[inline]
    pub unsafe fn connect(peripheral: u32) {
        let stream = Self::controller().st(STREAM);
        // SAFETY: the caller's promise.
        stream.par().write(|w| unsafe { w.bits(peripheral) });
    }

    /// [`Self::start`] at the peripheral connected last.
    ///
    /// # Safety
    /// As [`Self::start`]; the stream must have been connected.
    #[inline]
    pub unsafe fn restart(memory: u32, count: u16, settings: u32) {
        let controller = Self::controller();
        let stream = controller.st(STREAM);
        Self::clear();
        // SAFETY: `settings` is composed of `control`'s fields alone and the address is the
        // caller's promise.
        unsafe {
            stream.m0ar().write(|w| w.bits(memory));
            stream.ndtr().write(|w| w.bits(u32::from(count)));
            // Every store to the buffer is in memory before the stream may read it.
            fence(Ordering::SeqCst);
            stream
                .cr()
                .write(|w| w.bits(settings | control::MINC | control::EN));
        }
    }

    /// Stops the stream and waits until the access under way, if any, has ended: a handful of
    /// cycles (RM0383, 9.3.14). The buffer is the program's again afterwards.
    #[inline]
    pub fn stop() {
        let stream = Self::controller().st(STREAM);
        // SAFETY: the register as it is, less EN.
        stream
            .cr()
            .modify(|r, w| unsafe { w.bits(r.bits() & !control::EN) });
        for _ in 0..64 {
            if stream.cr().read().en().bit_is_clear() {
                break;
            }
        }
        fence(Ordering::SeqCst);
    }

    /// Items not yet moved at the peripheral's end.
    #[inline]
    pub fn remaining() -> u16 {
        Self::controller().st(STREAM).ndtr().read().ndt().bits()
    }

    /// Whether every item has been moved.
    #[inline]
    pub fn complete() -> bool {
        Self::flags() & Self::COMPLETE != 0
    }

    /// Whether the bus refused an access; the stream has stopped itself.
    #[inline]
    pub fn failed() -> bool {
        Self::flags() & Self::ERROR != 0
    }

    /// Clears the stream's flags; needed before every start.
    #[inline]
    pub fn clear() {
        let controller = Self::controller();
        // SAFETY: a 1 clears its flag, a 0 leaves it; `ALL` is this stream's flags alone.
        unsafe {
            if STREAM < 4 {
                controller.lifcr().write(|w| w.bits(Self::ALL));
            } else {
                controller.hifcr().write(|w| w.bits(Self::ALL));
            }
        }
    }

    #[inline]
    fn flags() -> u32 {
        let controller = Self::controller();
        if STREAM < 4 {
            controller.lisr().read().bits()
        } else {
            controller.hisr().read().bits()
        }
    }
}
