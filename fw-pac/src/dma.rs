//! One DMA stream, in direct mode, bytes or half-words, memory incrementing (RM0383, 9).
//!
//! | stream | channel | carries | interrupt |
//! |---|---|---|---|
//! | DMA1 S0 | 1 | I2C1 RX: EEPROM image; later the gyroscope's rate | polled at boot; complete, at the robot's priority |
//! | DMA2 S0 | 3 | SPI1 RX: frame from the Pi | none, ended by the rising edge of chip-select |
//! | DMA2 S3 | 3 | SPI1 TX: frame to the Pi | none |
//! | DMA2 S4 | 0 | ADC1: battery taps | none, read at the tick |
//! | DMA2 S7 | 4 | USART1 TX: log | complete, at the robot's priority |
//!
//! All of them are in RM0383's request map (9.3.3, tables 27 and 28). Each stream has one owner, and the
//! flag-clear registers ignore zeros, so owners of different streams do not disturb each other.

use crate::registers::Registers;
use core::cell::UnsafeCell;
use core::sync::atomic::{Ordering, fence};
use stm32f4::stm32f411::{DMA1, DMA2, dma2};

/// A stream, fixed at compile time: controller 1 or 2, stream 0 ..= 7.
// Requirement: DOC-3.3-1, DOC-3.3-2, DOC-3.3-3
pub struct Stream<const CONTROLLER: u8, const STREAM: usize>;

/// Bits of a stream's control register.
pub mod control {
    /// Stream on.
    pub const EN: u32 = 1 << 0;
    /// Interrupt on a transfer error.
    pub const TEIE: u32 = 1 << 2;
    /// Interrupt when complete.
    pub const TCIE: u32 = 1 << 4;
    /// Memory to peripheral; otherwise peripheral to memory.
    pub const SEND: u32 = 0b01 << 6;
    /// The memory address advances.
    pub const MINC: u32 = 1 << 10;
    /// 16 bits at both ends.
    pub const HALF_WORDS: u32 = 0b01 << 11 | 0b01 << 13;
    /// Highest priority among the streams of the controller.
    pub const VERY_HIGH: u32 = 0b11 << 16;
    /// Second lowest priority.
    pub const MEDIUM: u32 = 0b01 << 16;
    /// The request line, 0 ..= 7.
    pub const fn channel(number: u32) -> u32 {
        number << 25
    }
}

/// Static memory that a stream fills and the program copies.
#[repr(align(4))]
pub struct Buffer<const N: usize>(UnsafeCell<[u8; N]>);

// SAFETY: the program reads the bytes by volatile copies alone and never holds a reference to them.
unsafe impl<const N: usize> Sync for Buffer<N> {}

impl<const N: usize> Buffer<N> {
    /// Zeros.
    pub const fn new() -> Self {
        Self(UnsafeCell::new([0; N]))
    }

    /// The bytes; consistent once the stream that fills them has completed or been stopped.
    #[inline]
    pub fn get(&self) -> [u8; N] {
        // SAFETY: always initialised; every pattern is a value.
        unsafe { self.0.get().read_volatile() }
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
    fn controller() -> &'static dma2::RegisterBlock {
        match CONTROLLER {
            1 => DMA1::registers(),
            _ => DMA2::registers(),
        }
    }

    /// Sets the peripheral's data register by its address, for every transfer from now on; with the
    /// stream stopped.
    #[inline]
    pub fn connect(data_register: *mut impl Sized) {
        let stream = Self::controller().st(STREAM);
        // SAFETY: without EN the address has no effect; a transfer is `receive`'s responsibility.
        unsafe { stream.par().write(|w| w.pa().bits(data_register as u32)) };
    }

    /// Sends `bytes`, at most 65 535, which must stay unchanged until the stream has completed or been
    /// stopped: otherwise the peripheral gets the changed ones.
    #[inline]
    pub fn send(bytes: &[u8], settings: u32) {
        // SAFETY: the stream only reads memory.
        unsafe {
            Self::start(
                bytes.as_ptr() as u32,
                bytes.len() as u16,
                settings | control::SEND,
            );
        }
    }

    /// Fills `buffer` with `items` transfers of `settings`' width, at most as many as it holds.
    #[inline]
    pub fn fill<const N: usize>(buffer: &'static Buffer<N>, items: u16, settings: u32) {
        let width = 1 + u16::from(settings & control::HALF_WORDS != 0);
        // SAFETY: a static buffer made for this, and no more items than it has room for.
        unsafe { Self::receive(buffer.0.get(), items.min(N as u16 / width), settings) };
    }

    /// Starts `items` transfers into `memory`.
    ///
    /// # Safety
    /// `memory` must hold that many items, and the program must not touch them until the stream has
    /// completed or been stopped.
    #[inline]
    pub unsafe fn receive(memory: *mut impl Sized, items: u16, settings: u32) {
        // SAFETY: the caller's promise.
        unsafe { Self::start(memory as u32, items, settings) };
    }

    /// # Safety
    /// As [`Self::receive`], where `settings` has no [`control::SEND`].
    #[inline]
    unsafe fn start(memory: u32, items: u16, settings: u32) {
        let stream = Self::controller().st(STREAM);
        Self::clear();
        stream.ndtr().write(|w| w.ndt().set(items));
        // SAFETY: `settings` is composed of `control`'s fields alone and the address is the caller's
        // promise.
        unsafe {
            stream.m0ar().write(|w| w.m0a().bits(memory));
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
        stream.cr().modify(|_, w| w.en().clear_bit());
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

    /// Whether a transfer error has stopped the stream.
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
