//! SPI1 as a slave clocked by a master, RM0383 rev 3 chapter 20.
//!
//! | Register or section | Behaviour | Test |
//! |---|---|---|
//! | 20.3.5, slave transmit | The Tx buffer goes to the shift register at a word's first clock, which sets `TXE`: one word is always fetched ahead | `the_next_word_is_fetched_at_the_first_clock` |
//! | 20.3.5, slave receive | The last sampling edge moves the word to the Rx buffer and sets `RXNE` | `a_whole_word_arrives_and_leaves` |
//! | `OVR`, 20.3.10 | A word that finds `RXNE` set is lost; cleared by reading `DR`, then `SR` | `an_unread_word_is_kept_and_the_next_one_is_lost` |
//! | Underrun | No flag in SPI mode (`UDR` is the I2S's): the Tx buffer's last word goes out again | `an_empty_transmit_buffer_repeats_its_last_word` |
//! | Hardware NSS, 20.3.1 | Deselected, the clock is ignored and MISO released | `a_deselected_slave_hears_nothing` |
//! | Partial words | A chip select that rises inside a word leaves the bits in the shift register. The next frame is then out of step, until `SPE` is cleared or the clock controller resets the block | `bits_of_a_torn_word_stay_until_the_block_is_disabled` |
//! | `SPE` cleared, 20.3.8 | The word on the wire is dropped. Both buffers keep what they hold: only the clock controller's reset empties them | `disabling_keeps_the_buffers_and_a_reset_empties_them` |
//! | `TXDMAEN`, `RXDMAEN`, 20.3.9 | Requests follow `TXE` and `RXNE` | `requests_follow_the_flags` |
//! | `TXEIE`, `RXNEIE`, `ERRIE` | The one interrupt follows the flags | `requests_follow_the_flags` |
//! | `LSBFIRST`, `DFF` | Bit order and sixteen bits | `sixteen_bits_least_significant_first` |
//!
//! Not modelled, and told to the run's report where the firmware asks for it: master mode, CRC,
//! TI mode, I2S, the bidirectional line, and another clock mode than 0 (the board's master speaks
//! mode 0; a slave set to another one is out of step by half a bit, which has no value here).
//! `RXONLY` is stored.

use rigless::device::{Device, DeviceContext, Level, RegisterFile};
use rigless::soc::stm32f427::generated::spi1::{cr1, cr2, i2scfgr, sr, Register};

/// The request to receive, as the part's DMA wiring numbers it.
pub const RECEIVE_REQUEST: usize = 0;
/// The request to transmit.
pub const TRANSMIT_REQUEST: usize = 1;

const GLOBAL: usize = 0;

/// The serial interface as its master sees it.
#[derive(Debug, Default)]
#[expect(
    clippy::struct_excessive_bools,
    reason = "each is a flip-flop of the block"
)]
pub struct SpiSlave {
    /// The chip select's level at the pin, `None` while no pin is routed here.
    nss: Option<Level>,
    transmit: u16,
    transmit_full: bool,
    receive: u16,
    receive_full: bool,
    overrun: bool,
    /// `DR` was read since the overrun, so a read of `SR` clears it.
    overrun_read: bool,
    shift_out: u16,
    shift_in: u16,
    /// Bits of the word on the wire already sampled.
    bits: u32,
    requests: [Level; 2],
    interrupt: Level,
}

impl SpiSlave {
    fn word_bits(registers: &RegisterFile) -> u32 {
        if cr1::DFF.is_set(registers.get(Register::Cr1)) {
            16
        } else {
            8
        }
    }

    /// Whether a clock edge reaches the shift register.
    #[must_use]
    pub fn listens(&self, registers: &RegisterFile) -> bool {
        let control = registers.get(Register::Cr1);
        let selected = if cr1::SSM.is_set(control) {
            !cr1::SSI.is_set(control)
        } else {
            self.nss == Some(Level::Low)
        };
        selected && cr1::SPE.is_set(control) && !cr1::MSTR.is_set(control)
    }

    /// How many clocks from here to the next one at which a buffer moves: 1 before a word's first
    /// clock, then what is left of the word.
    #[must_use]
    pub fn clocks_to_act(&self, registers: &RegisterFile) -> u32 {
        if self.bits == 0 {
            1
        } else {
            Self::word_bits(registers) - self.bits
        }
    }

    /// The chip select's level at the pin; `None` when no pin carries it.
    pub fn select(
        &mut self,
        level: Option<Level>,
        registers: &mut RegisterFile,
        context: &mut DeviceContext<'_>,
    ) {
        self.nss = level;
        self.refresh(registers, context);
    }

    /// One clock of the master: the bit it sends in, the bit this slave sends out. `None` where
    /// the slave does not drive its line.
    pub fn clock(
        &mut self,
        bit: bool,
        registers: &mut RegisterFile,
        context: &mut DeviceContext<'_>,
    ) -> Option<bool> {
        if !self.listens(registers) {
            return None;
        }
        let width = Self::word_bits(registers);
        let lsb_first = cr1::LSBFIRST.is_set(registers.get(Register::Cr1));
        if self.bits == 0 {
            self.shift_out = self.transmit;
            self.shift_in = 0;
            self.transmit_full = false;
        }
        let position = if lsb_first {
            self.bits
        } else {
            width - 1 - self.bits
        };
        let out = self.shift_out >> position & 1 != 0;
        self.shift_in |= u16::from(bit) << position;
        self.bits += 1;
        if self.bits >= width {
            self.bits = 0;
            if self.receive_full {
                self.overrun = true;
                self.overrun_read = false;
            } else {
                self.receive = self.shift_in;
                self.receive_full = true;
            }
        }
        self.refresh(registers, context);
        Some(out)
    }

    fn status(&self) -> u64 {
        let mut status = 0;
        status = sr::RXNE.set(status, u64::from(self.receive_full));
        status = sr::TXE.set(status, u64::from(!self.transmit_full));
        status = sr::OVR.set(status, u64::from(self.overrun));
        sr::BSY.set(status, u64::from(self.bits != 0))
    }

    fn refresh(&mut self, registers: &mut RegisterFile, context: &mut DeviceContext<'_>) {
        registers.set(Register::Sr, self.status());
        registers.set(Register::Dr, u64::from(self.receive));
        let control = registers.get(Register::Cr2);
        let wanted = [
            Level::from(self.receive_full && cr2::RXDMAEN.is_set(control)),
            Level::from(!self.transmit_full && cr2::TXDMAEN.is_set(control)),
        ];
        for (request, (driven, wanted)) in self.requests.iter_mut().zip(wanted).enumerate() {
            if *driven != wanted {
                *driven = wanted;
                context.request(request, wanted);
            }
        }
        let interrupt = Level::from(
            self.receive_full && cr2::RXNEIE.is_set(control)
                || !self.transmit_full && cr2::TXEIE.is_set(control)
                || self.overrun && cr2::ERRIE.is_set(control),
        );
        if self.interrupt != interrupt {
            self.interrupt = interrupt;
            context.interrupt(GLOBAL, interrupt);
        }
    }

    /// What this model does not do, told once where the firmware asks for it.
    fn object(registers: &RegisterFile, context: &mut DeviceContext<'_>) {
        let control = registers.get(Register::Cr1);
        if !cr1::SPE.is_set(control) {
            return;
        }
        for (field, reason) in [
            (cr1::MSTR, "master mode is not modelled, RM0383 20.3.3"),
            (cr1::CPHA, "the board's master speaks mode 0, RM0383 20.3.1"),
            (cr1::CPOL, "the board's master speaks mode 0, RM0383 20.3.1"),
            (cr1::CRCEN, "CRC is not modelled, RM0383 20.3.6"),
            (
                cr1::BIDIMODE,
                "the bidirectional line is not modelled, RM0383 20.3.4",
            ),
        ] {
            if field.is_set(control) {
                context.tell("CR1", reason);
            }
        }
        if cr2::FRF.is_set(registers.get(Register::Cr2)) {
            context.tell("CR2", "TI mode is not modelled, RM0383 20.3.1");
        }
        if i2scfgr::I2SMOD.is_set(registers.get(Register::I2scfgr)) {
            context.tell("I2SCFGR", "I2S is not modelled, RM0383 20.4");
        }
    }
}

impl Device for SpiSlave {
    type Register = Register;

    fn read(
        &mut self,
        register: Register,
        registers: &mut RegisterFile,
        context: &mut DeviceContext<'_>,
    ) -> Option<u64> {
        match register {
            Register::Dr => {
                let word = self.receive;
                self.receive_full = false;
                self.overrun_read = self.overrun;
                self.refresh(registers, context);
                Some(u64::from(word))
            }
            Register::Sr => {
                let status = self.status();
                if self.overrun_read {
                    self.overrun = false;
                    self.overrun_read = false;
                    self.refresh(registers, context);
                }
                Some(status)
            }
            _ => None,
        }
    }

    fn write(
        &mut self,
        register: Register,
        value: u64,
        registers: &mut RegisterFile,
        context: &mut DeviceContext<'_>,
    ) {
        match register {
            Register::Dr => {
                self.transmit = u16::try_from(value & 0xFFFF).unwrap_or_default();
                self.transmit_full = true;
            }
            Register::Cr1 if !cr1::SPE.is_set(registers.get(Register::Cr1)) => {
                self.bits = 0;
            }
            _ => {}
        }
        Self::object(registers, context);
        self.refresh(registers, context);
    }

    fn reset(&mut self) {
        *self = Self {
            nss: self.nss,
            ..Self::default()
        };
    }

    fn reset_line(&mut self, registers: &mut RegisterFile, context: &mut DeviceContext<'_>) {
        context.lower_requests(&self.requests);
        self.reset();
        registers.set(Register::Sr, self.status());
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::soc::fixture::settle;
    use crate::soc::Stm32f411;
    use rigless::mcu::Operate;
    use rigless::soc::Width;
    use rigless::time::VirtualNanos;

    const NOW: VirtualNanos = VirtualNanos(0);
    const RCC: u64 = 0x4002_3800;
    const SPI1: u64 = 0x4001_3000;
    const CR1: u64 = SPI1;
    const CR2: u64 = SPI1 + 4;
    const SR: u64 = SPI1 + 8;
    const DR: u64 = SPI1 + 0xC;
    const SPE: u64 = 1 << 6;
    const RXNE: u64 = 1;
    const TXE: u64 = 2;
    const OVR: u64 = 1 << 6;
    const BSY: u64 = 1 << 7;

    /// A part whose SPI1 is an enabled, selected slave.
    fn part() -> Stm32f411 {
        let mut part = Stm32f411::new().unwrap();
        write(&mut part, RCC + 0x44, 1 << 12);
        write(&mut part, CR1, SPE);
        select(&mut part, true);
        part
    }

    fn write(part: &mut Stm32f411, address: u64, value: u64) {
        part.write(NOW, address, Width::W32, value).unwrap();
        settle(part);
    }

    fn read(part: &mut Stm32f411, address: u64) -> u64 {
        let value = part.read(NOW, address, Width::W32).unwrap();
        settle(part);
        value
    }

    fn select(part: &mut Stm32f411, selected: bool) {
        part.drive_spi(NOW, |spi, registers, context| {
            spi.select(Some(Level::from(!selected)), registers, context);
        });
        settle(part);
    }

    fn clock(part: &mut Stm32f411, word: u16, bits: u32) -> u16 {
        (0..bits).rev().fold(0, |seen, bit| {
            let out = part.drive_spi(NOW, |spi, registers, context| {
                spi.clock(word >> bit & 1 != 0, registers, context)
            });
            settle(part);
            seen << 1 | u16::from(out.unwrap_or(false))
        })
    }

    #[test]
    fn a_whole_word_arrives_and_leaves() {
        let mut part = part();
        write(&mut part, DR, 0xA5);
        assert_eq!(clock(&mut part, 0x3C, 8), 0xA5);
        assert_eq!(read(&mut part, SR), RXNE | TXE);
        assert_eq!(read(&mut part, DR), 0x3C);
        assert_eq!(read(&mut part, SR), TXE);
    }

    #[test]
    fn the_next_word_is_fetched_at_the_first_clock() {
        let mut part = part();
        write(&mut part, DR, 0x80);
        assert_eq!(read(&mut part, SR), 0);
        assert_eq!(clock(&mut part, 0, 1), 1);
        assert_eq!(read(&mut part, SR), TXE | BSY);
        write(&mut part, DR, 0xFF);
        assert_eq!(
            clock(&mut part, 0, 7),
            0,
            "the word on the wire is the first one"
        );
        read(&mut part, DR);
        assert_eq!(clock(&mut part, 0, 8), 0xFF);
    }

    #[test]
    fn an_unread_word_is_kept_and_the_next_one_is_lost() {
        let mut part = part();
        clock(&mut part, 1, 8);
        clock(&mut part, 2, 8);
        assert_eq!(read(&mut part, SR) & OVR, OVR);
        assert_eq!(read(&mut part, SR) & OVR, OVR, "SR alone does not clear it");
        assert_eq!(read(&mut part, DR), 1);
        assert_eq!(
            read(&mut part, SR) & OVR,
            OVR,
            "the read that clears it shows it"
        );
        assert_eq!(read(&mut part, SR) & OVR, 0);
    }

    #[test]
    fn an_empty_transmit_buffer_repeats_its_last_word() {
        let mut part = part();
        write(&mut part, DR, 0x42);
        assert_eq!(clock(&mut part, 0, 8), 0x42);
        assert_eq!(clock(&mut part, 0, 8), 0x42);
    }

    #[test]
    fn a_deselected_slave_hears_nothing() {
        let mut part = part();
        select(&mut part, false);
        write(&mut part, DR, 0xFF);
        assert_eq!(clock(&mut part, 0xFF, 8), 0);
        assert_eq!(read(&mut part, SR), 0);
    }

    #[test]
    fn bits_of_a_torn_word_stay_until_the_block_is_disabled() {
        let mut part = part();
        clock(&mut part, 0b101, 3);
        select(&mut part, false);
        select(&mut part, true);
        assert_eq!(read(&mut part, SR) & BSY, BSY);
        clock(&mut part, 0b0_0001, 5);
        assert_eq!(read(&mut part, DR), 0b1010_0001);
        clock(&mut part, 0b11, 2);
        write(&mut part, CR1, 0);
        write(&mut part, CR1, SPE);
        clock(&mut part, 0x5A, 8);
        assert_eq!(read(&mut part, DR), 0x5A);
    }

    #[test]
    fn disabling_keeps_the_buffers_and_a_reset_empties_them() {
        let mut part = part();
        clock(&mut part, 0x5A, 8);
        write(&mut part, DR, 0x77);
        write(&mut part, CR1, 0);
        assert_eq!(read(&mut part, SR), RXNE);
        write(&mut part, RCC + 0x24, 1 << 12);
        write(&mut part, RCC + 0x24, 0);
        assert_eq!(read(&mut part, SR), TXE);
        assert_eq!(read(&mut part, DR), 0);
    }

    #[test]
    fn requests_follow_the_flags() {
        let mut part = part();
        write(&mut part, CR2, 1 << 6);
        let lines = |part: &mut Stm32f411| -> Vec<(u16, Level)> {
            part.drain_interrupts()
                .into_iter()
                .map(|change| (change.interrupt, change.level))
                .collect()
        };
        assert_eq!(lines(&mut part), []);
        clock(&mut part, 0, 8);
        assert_eq!(lines(&mut part), [(35, Level::High)]);
        read(&mut part, DR);
        assert_eq!(lines(&mut part), [(35, Level::Low)]);
        part.drive_spi(NOW, |spi, _, _| assert_eq!(spi.requests, [Level::Low; 2]));
        write(&mut part, CR2, 3);
        clock(&mut part, 0, 8);
        part.drive_spi(NOW, |spi, _, _| assert_eq!(spi.requests, [Level::High; 2]));
        read(&mut part, DR);
        write(&mut part, DR, 0);
        part.drive_spi(NOW, |spi, _, _| assert_eq!(spi.requests, [Level::Low; 2]));
    }

    #[test]
    fn sixteen_bits_least_significant_first() {
        let mut part = part();
        write(&mut part, CR1, SPE | 1 << 11 | 1 << 7);
        write(&mut part, DR, 0x8001);
        assert_eq!(clock(&mut part, 0x0003, 16), 0x8001);
        assert_eq!(read(&mut part, DR), 0xC000);
    }
}
