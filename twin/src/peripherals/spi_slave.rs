//! SPI1 as a slave clocked by a master, RM0383 rev 3 chapter 20.
//!
//! | Register or section | Behaviour |
//! |---|---|
//! | 20.3.5, slave transmit | The Tx buffer goes to the shift register at a word's first clock, which sets `TXE`: one word is always fetched ahead |
//! | 20.3.5, slave receive | The last sampling edge moves the word to the Rx buffer and sets `RXNE` |
//! | `OVR`, 20.3.10 | A word that finds `RXNE` set is lost; cleared by reading `DR`, then `SR` |
//! | Underrun | No flag in SPI mode (`UDR` is the I2S's): the Tx buffer's last word is sent again |
//! | Hardware NSS, 20.3.1 | Deselected, the clock is ignored and MISO released |
//! | Partial words | A chip select that rises inside a word leaves the bits in the shift register. The next frame is then out of step, until `SPE` is cleared or the clock controller resets the block |
//! | `SPE` cleared, 20.3.8 | The word in transfer is dropped. Both buffers keep their words: only the clock controller's reset empties them |
//! | `TXDMAEN`, `RXDMAEN`, 20.3.9 | Requests follow `TXE` and `RXNE` |
//! | `TXEIE`, `RXNEIE`, `ERRIE` | The one interrupt follows the flags |
//! | `LSBFIRST`, `DFF` | Bit order and sixteen bits |
//!
//! Not modelled, and reported when the firmware enables it: master mode, CRC,
//! TI mode, I2S, the bidirectional line, and another clock mode than 0 (the board's master uses
//! mode 0; a slave set to another one is out of step by half a bit, which has no value here).
//! `RXONLY` is stored.

use rigless::device::{Device, DeviceContext, Level, RegisterFile};
use rigless::soc::stm32f427::generated::spi1::{Register, cr1, cr2, i2scfgr, sr};

/// The request to receive, as the part's DMA wiring numbers it.
pub const RECEIVE_REQUEST: usize = 0;
/// The request to transmit.
pub const TRANSMIT_REQUEST: usize = 1;

const GLOBAL: usize = 0;

/// The serial interface.
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
    /// Words that have left the memory before the first clock: one; two where the idle block moves the first
    /// to its shift register, which RM0383 20.3 leaves open; three with the one that the DMA holds ready
    /// behind them (RM0383 9.2).
    pub prefetch: u8,
    /// The word that the DMA holds ready.
    behind: Option<u16>,
    /// The shift register holds the next word.
    loaded: bool,
    shift_out: u16,
    shift_in: u16,
    /// Bits of the word on the wire already sampled.
    bits: u32,
    pub(crate) requests: [Level; 2],
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
    pub fn is_selected(&self, registers: &RegisterFile) -> bool {
        let control = registers.get(Register::Cr1);
        let selected = if cr1::SSM.is_set(control) {
            !cr1::SSI.is_set(control)
        } else {
            self.nss == Some(Level::Low)
        };
        selected && cr1::SPE.is_set(control) && !cr1::MSTR.is_set(control)
    }

    /// Clocks until the next one at which a buffer moves: 1 before a word's first
    /// clock, then the rest of the word.
    pub fn clocks_to_act(&self, registers: &RegisterFile) -> u32 {
        if self.bits == 0 {
            1
        } else {
            Self::word_bits(registers) - self.bits
        }
    }

    /// The chip select's level at the pin; `None` when no pin carries it.
    pub fn set_nss(
        &mut self,
        level: Option<Level>,
        registers: &mut RegisterFile,
        context: &mut DeviceContext<'_>,
    ) {
        self.nss = level;
        self.refresh(registers, context);
    }

    /// One clock of the master with this bit on MOSI. Returns the bit on MISO, `None` where the slave
    /// does not drive it.
    pub fn clock(
        &mut self,
        bit: bool,
        registers: &mut RegisterFile,
        context: &mut DeviceContext<'_>,
    ) -> Option<bool> {
        if !self.is_selected(registers) {
            return None;
        }
        let width = Self::word_bits(registers);
        let lsb_first = cr1::LSBFIRST.is_set(registers.get(Register::Cr1));
        if self.bits == 0 {
            if !std::mem::take(&mut self.loaded) {
                self.load();
            }
            self.shift_in = 0;
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

    /// The next word to the shift register.
    fn load(&mut self) {
        self.shift_out = self.transmit;
        let behind = self.behind.take();
        self.transmit_full = behind.is_some();
        self.transmit = behind.unwrap_or(self.transmit);
    }

    fn status(&self) -> u64 {
        let mut status = 0;
        status = sr::RXNE.set(status, u64::from(self.receive_full));
        status = sr::TXE.set(status, u64::from(!self.transmit_full));
        status = sr::OVR.set(status, u64::from(self.overrun));
        sr::BSY.set(status, u64::from(self.bits != 0))
    }

    fn refresh(&mut self, registers: &mut RegisterFile, context: &mut DeviceContext<'_>) {
        let waits = self.bits == 0 && !self.loaded && cr1::SPE.is_set(registers.get(Register::Cr1));
        if self.prefetch > 1 && waits && self.transmit_full {
            self.load();
            self.loaded = true;
        }
        registers.set(Register::Sr, self.status());
        registers.set(Register::Dr, u64::from(self.receive));
        let control = registers.get(Register::Cr2);
        let ready = self.transmit_full && (self.prefetch < 3 || self.behind.is_some());
        let levels = [
            Level::from(self.receive_full && cr2::RXDMAEN.is_set(control)),
            Level::from(!ready && cr2::TXDMAEN.is_set(control)),
        ];
        for (request, (driven, level)) in self.requests.iter_mut().zip(levels).enumerate() {
            if *driven != level {
                *driven = level;
                context.request(request, level);
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

    /// Reports the modes that are not modelled.
    fn report_unmodelled(registers: &RegisterFile, context: &mut DeviceContext<'_>) {
        let control = registers.get(Register::Cr1);
        if !cr1::SPE.is_set(control) {
            return;
        }
        for (field, reason) in [
            (cr1::MSTR, "master mode is not modelled, RM0383 20.3.3"),
            (cr1::CPHA, "the board's master uses mode 0, RM0383 20.3.1"),
            (cr1::CPOL, "the board's master uses mode 0, RM0383 20.3.1"),
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
                let word = u16::try_from(value & 0xFFFF).unwrap_or_default();
                if self.transmit_full && self.prefetch > 2 {
                    self.behind = Some(word);
                } else {
                    self.transmit = word;
                    self.transmit_full = true;
                }
            }
            Register::Cr1 if !cr1::SPE.is_set(registers.get(Register::Cr1)) => {
                self.bits = 0;
            }
            _ => {}
        }
        Self::report_unmodelled(registers, context);
        self.refresh(registers, context);
    }

    fn reset(&mut self) {
        *self = Self {
            nss: self.nss,
            prefetch: self.prefetch,
            ..Self::default()
        };
    }

    fn reset_line(&mut self, registers: &mut RegisterFile, context: &mut DeviceContext<'_>) {
        context.lower_requests(&self.requests);
        self.reset();
        registers.set(Register::Sr, self.status());
    }
}
