//! USART1 sends the log, 8N1, by DMA2 stream 7.

use crate::board::{RX, TX};
use crate::clock::APB2_HZ;
use crate::dma::{Stream, control};
use crate::gpio::{Driver, Pull};
use crate::registers::Registers;
use crate::time;
use fw_core::log::Log;
use fw_core::transmitter::{self, Transmitter};
use stm32f4::stm32f411::USART1;

type Dma = Stream<2, 7>;

/// The log's rate until the configuration is known, baud.
pub const BOOT_BAUD: u32 = 115_200;

/// The log's transmitter.
pub struct Uart(Transmitter);

/// The DMA's stream as the transmitter uses it.
struct LogStream;

impl transmitter::Stream for LogStream {
    #[inline]
    fn failed(&mut self) -> bool {
        Dma::failed()
    }

    #[inline]
    fn complete(&mut self) -> bool {
        Dma::complete()
    }

    #[inline]
    fn stop(&mut self) {
        Dma::stop();
    }

    #[inline]
    fn clear(&mut self) {
        Dma::clear();
    }

    #[inline]
    fn send(&mut self, bytes: &[u8]) {
        // TC must show the end of this transfer, not of the one before (RM0383, 19.3.13).
        USART1::registers().sr().write(|w| w.tc().clear_bit());
        Dma::send(bytes, control::channel(4) | control::TCIE | control::TEIE);
    }
}

impl Uart {
    /// Starts the transmitter at [`BOOT_BAUD`].
    // Requirement: WIRE-log-4
    pub fn start() -> Self {
        TX.alternate(7, Driver::PushPull, Pull::PullUp);
        RX.alternate(7, Driver::PushPull, Pull::PullUp);
        set_baud(BOOT_BAUD);
        let usart = USART1::registers();
        Dma::connect(usart.dr().as_ptr());
        usart.cr3().write(|w| w.dmat().set_bit());
        usart.cr1().write(|w| {
            w.ue().set_bit();
            w.te().set_bit()
        });
        Self(Transmitter::IDLE)
    }

    /// Never waits; polled at boot, called by the stream's interrupt and after each event later.
    pub fn service(&mut self, log: &mut Log) {
        self.0.service(log, &mut LogStream);
    }

    /// Changes the rate once the last byte has left, or after 10 ms: a character of 1200 baud.
    // Requirement: WIRE-log-4
    pub fn set_rate(&mut self, baud: u32) {
        if self.0.is_idle() {
            let usart = USART1::registers();
            time::wait(10_000, || usart.sr().read().tc().bit_is_set());
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
    // 12 bits of mantissa and 4 of fraction, at least 1.0 (RM0383, 19.3.4).
    USART1::registers().brr().write(|w| {
        w.div_mantissa().set((divider >> 4) as u16);
        w.div_fraction().set((divider & 15) as u8)
    });
}

/// Keeps the rate where the clock has fallen from 100 MHz to the internal oscillator's 16 MHz.
pub fn slow_down() {
    let brr = USART1::registers().brr();
    // SAFETY: a smaller divider of the same layout.
    brr.modify(|r, w| unsafe { w.bits((r.bits() * 4 + 12) / 25) });
}

/// Sends `text` without DMA or interrupts, for the safe state. Bounded: gives up where the
/// transmitter does not take a byte, as before boot has started it.
pub fn write_blocking(text: &[u8]) {
    Dma::stop();
    let usart = USART1::registers();
    for byte in text {
        // A character of 9600 baud takes 1.05 ms = 105 000 cycles, a poll at least 5.
        for _ in 0..21_000 {
            if usart.sr().read().txe().bit_is_set() {
                break;
            }
        }
        usart.dr().write(|w| w.dr().set(u16::from(*byte)));
    }
}
