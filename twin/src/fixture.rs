//! A microcontroller driven register by register, with a little memory for its DMA.

use rigless::emulator::{Error, Memory};
use rigless::mcu::{Mcu, Operate};
use rigless::soc::Width;
use rigless::time::VirtualNanos;

pub(crate) const RAM: u64 = 0x2000_0000;

pub(crate) struct Fixture<M> {
    pub(crate) mcu: M,
    pub(crate) ram: [u8; 64],
    pub(crate) now: VirtualNanos,
}

struct Ram<'a>(&'a mut [u8; 64]);

impl Ram<'_> {
    fn byte(&mut self, address: u64, width: Width) -> Result<&mut u8, Error> {
        let index = usize::try_from(address.wrapping_sub(RAM)).ok();
        index
            .filter(|_| width == Width::W8)
            .and_then(|index| self.0.get_mut(index))
            .ok_or(Error::Memory { address, width })
    }
}

impl Memory for Ram<'_> {
    fn read(&mut self, address: u64, width: Width) -> Result<u64, Error> {
        self.byte(address, width).map(|byte| u64::from(*byte))
    }

    fn write(&mut self, address: u64, width: Width, value: u64) -> Result<(), Error> {
        *self.byte(address, width)? = value.to_le_bytes()[0];
        Ok(())
    }
}

impl<M: Mcu> Fixture<M> {
    pub(crate) fn new(mcu: M) -> Self {
        Self {
            mcu,
            ram: [0; 64],
            now: VirtualNanos(0),
        }
    }

    pub(crate) fn settle(&mut self) {
        self.mcu.settle(&mut Ram(&mut self.ram)).unwrap();
    }

    pub(crate) fn write(&mut self, address: u64, value: u64) {
        let written = self.mcu.write(self.now, address, Width::W32, value);
        written.unwrap();
        self.settle();
    }

    pub(crate) fn read(&mut self, address: u64) -> u64 {
        let value = self.mcu.read(self.now, address, Width::W32).unwrap();
        self.settle();
        value
    }

    /// Acts on the part from outside its bus.
    pub(crate) fn act<T>(&mut self, act: impl FnOnce(&mut M, VirtualNanos) -> T) -> T {
        let result = act(&mut self.mcu, self.now);
        self.settle();
        result
    }

    /// The interrupt lines that changed: number, and whether it is high.
    pub(crate) fn interrupts(&mut self) -> Vec<(u16, bool)> {
        let changes = self.mcu.drain_interrupts().into_iter();
        let high = |level| level == rigless::device::Level::High;
        changes.map(|c| (c.interrupt, high(c.level))).collect()
    }

    /// Lets virtual time pass as the emulator does: from event to event.
    pub(crate) fn run(&mut self, ns: u64) {
        let ends = VirtualNanos(self.now.0 + ns);
        while let Some(at) = self.mcu.next_event().filter(|&at| at <= ends) {
            self.now = at;
            self.mcu.advance_to(at);
            self.mcu.poll(at);
            self.settle();
        }
        self.now = ends;
    }
}
