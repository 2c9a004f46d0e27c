//! USART1 sends the log, 8N1, by DMA2 stream 7.

use crate::board::{RX, TX};
use crate::clock::APB2_HZ;
use crate::dma::{control, Stream};
use crate::gpio::{Driver, Pull};
use crate::{robot, time};
use fw_core::log::Log;
use stm32f4::stm32f411 as pac;
use stm32f4::stm32f411::interrupt;

type Dma = Stream<2, 7>;

/// What the log is read at until the configuration is known, baud.
pub const BOOT_BAUD: u32 = 115_200;

fn registers() -> &'static pac::usart1::RegisterBlock {
    // SAFETY: the registers are at this address for as long as the part is powered; `Uart` is their
    // one user until the safe state sends its last words by polling.
    unsafe { &*pac::USART1::ptr() }
}

/// The transmitter, and how much of the log it has in hand.
pub struct Uart {
    sending: usize,
}

impl Uart {
    /// Starts the transmitter at [`BOOT_BAUD`].
    // Requirement: WIRE-log-4
    pub fn start() -> Self {
        TX.alternate(7, Driver::PushPull, Pull::Up);
        RX.alternate(7, Driver::PushPull, Pull::Up);
        set_baud(BOOT_BAUD);
        let usart = registers();
        usart.cr3().write(|w| w.dmat().set_bit());
        usart.cr1().write(|w| {
            w.ue().set_bit();
            w.te().set_bit()
        });
        Self { sending: 0 }
    }

    /// Retires what has been sent and sends on. Never waits; works polled or from the interrupt.
    ///
    /// # Safety
    /// `log` must be the same one in the same place for good: the DMA reads it.
    pub unsafe fn service(&mut self, log: &mut Log) {
        if self.sending > 0 {
            if Dma::failed() {
                // The stream stopped at a word the bus refused: give the rest up, not the log.
                Dma::stop();
            } else if !Dma::complete() {
                return;
            }
            log.sent(self.sending);
            self.sending = 0;
            Dma::clear();
        }
        let pending = log.pending();
        let count = pending.len().min(usize::from(u16::MAX));
        if count > 0 {
            // TC must tell of this transfer's end, not of the one before (RM0383, 19.3.13); a 1
            // leaves the other flags alone.
            // SAFETY: a 1 never sets a flag.
            registers()
                .sr()
                .write(|w| unsafe { w.bits(u16::MAX) }.tc().clear_bit());
            // SAFETY: the bytes lie in the log, which stays where it is (the caller's promise) and
            // keeps pending bytes unchanged until `sent` retires them.
            unsafe {
                Dma::start(
                    registers().dr().as_ptr() as u32,
                    pending.as_ptr() as u32,
                    count as u16,
                    control::channel(4) | control::WRITE | control::TCIE | control::TEIE,
                );
            }
            self.sending = count;
        }
    }

    /// Changes the rate once the last byte has left, or after 10 ms: a character of 1200 baud.
    // Requirement: WIRE-log-4
    pub fn set_rate(&mut self, baud: u32) {
        if self.sending == 0 {
            time::wait(10_000, || registers().sr().read().tc().bit_is_set());
        }
        set_baud(baud);
    }
}

/// The nearest rate; the configuration has checked its range.
fn set_baud(baud: u32) {
    let divider = (APB2_HZ + baud / 2)
        .checked_div(baud)
        .unwrap_or(APB2_HZ / BOOT_BAUD)
        .clamp(16, 0xFFFF);
    // SAFETY: 12 bits of mantissa and 4 of fraction, at least 1.0 (RM0383, 19.3.4).
    registers()
        .brr()
        .write(|w| unsafe { w.bits(divider as u16) });
}

/// Sends `text` without DMA or interrupts, for the safe state. Bounded: gives up where the
/// transmitter does not take a byte, as when boot has not come to starting it.
pub fn last_words(text: &[u8]) {
    Dma::stop();
    let usart = registers();
    for byte in text {
        // A character of 115200 baud takes 87 µs = 8700 cycles, a poll at least 5.
        for _ in 0..4_000 {
            if usart.sr().read().txe().bit_is_set() {
                break;
            }
        }
        usart.dr().write(|w| w.dr().set(u16::from(*byte)));
    }
}

#[interrupt]
fn DMA2_STREAM7() {
    robot::log_sent();
}
