//! A part on the bench: driven register by register, with a little memory for its DMA.

use rigless::emulator::{Error, Memory};
use rigless::mcu::{Mcu, Operate};
use rigless::soc::Width;
use rigless::time::VirtualNanos;

use super::Stm32f411;

/// The bench.
pub(crate) struct Bench {
    pub(crate) part: Stm32f411,
    pub(crate) ram: [u8; 64],
    now: VirtualNanos,
}

struct Ram<'a>(&'a mut [u8; 64]);

impl Memory for Ram<'_> {
    fn read(&mut self, address: u64, width: Width) -> Result<u64, Error> {
        let byte = usize::try_from(address - Bench::RAM).ok();
        byte.and_then(|byte| self.0.get(byte))
            .filter(|_| width == Width::W8)
            .map(|&byte| u64::from(byte))
            .ok_or(Error::Memory { address, width })
    }

    fn write(&mut self, address: u64, width: Width, value: u64) -> Result<(), Error> {
        let byte = usize::try_from(address - Bench::RAM).ok();
        let byte = byte.and_then(|byte| self.0.get_mut(byte));
        let byte = byte.filter(|_| width == Width::W8);
        *byte.ok_or(Error::Memory { address, width })? = value.to_le_bytes()[0];
        Ok(())
    }
}

impl Bench {
    /// Where its memory is.
    pub(crate) const RAM: u64 = 0x2000_0000;

    pub(crate) fn new() -> Self {
        Self {
            part: Stm32f411::new().unwrap(),
            ram: [0; 64],
            now: VirtualNanos(0),
        }
    }

    fn settle(&mut self) {
        self.part.settle(&mut Ram(&mut self.ram)).unwrap();
    }

    pub(crate) fn write(&mut self, address: u64, value: u64) {
        self.part
            .write(self.now, address, Width::W32, value)
            .unwrap();
        self.settle();
    }

    pub(crate) fn read(&mut self, address: u64) -> u64 {
        let value = self.part.read(self.now, address, Width::W32).unwrap();
        self.settle();
        value
    }

    pub(crate) fn hold_i2c1_low(&mut self, held: bool) {
        self.part.hold_i2c1_low(self.now, held);
        self.settle();
    }

    /// Lets virtual time pass as the emulator does: from event to event.
    pub(crate) fn run(&mut self, ns: u64) {
        let ends = VirtualNanos(self.now.0 + ns);
        while let Some(at) = self.part.next_event().filter(|&at| at <= ends) {
            self.now = at;
            self.part.advance_to(at);
            self.part.poll(at);
            self.settle();
        }
        self.now = ends;
    }
}

/// Lets the part reach its next steady state.
pub(crate) fn settle(part: &mut Stm32f411) {
    part.settle(&mut Ram(&mut [0; 64])).unwrap();
}
