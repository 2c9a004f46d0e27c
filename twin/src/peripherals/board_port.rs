//! The part's connection to the board: an instance without an address that records every change of
//! the firmware's outputs, and at which the board schedules its own events.
//!
//! It schedules an event at the instant of every change, so that the board handles it at that
//! instant.

use rigless::device::{Device, DeviceContext, Level, RegisterFile, RequestChange};
use rigless::soc::{Layout, Peripheral, RegisterSpec};

use crate::pin::{PORTS, Pin};

/// The instance's name.
pub const NAME: &str = "BOARD";

/// The instance: no bytes, so no access reaches it.
pub const INSTANCE: Peripheral = Peripheral {
    name: NAME,
    base: 0x4FFF_FC00,
    size: 0,
    interrupts: &[],
    registers: NoRegister::REGISTERS,
};

/// The layout without a register.
#[derive(Clone, Copy, Debug)]
pub enum NoRegister {}

impl Layout for NoRegister {
    const REGISTERS: &'static [RegisterSpec] = &[];

    fn from_index(_index: usize) -> Option<Self> {
        None
    }

    fn index(self) -> usize {
        match self {}
    }
}

/// A pin that changed its level on the wire.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PinChange {
    /// Nanoseconds of virtual time.
    pub at: u64,
    /// Which.
    pub pin: Pin,
    /// Whether it is high now.
    pub high: bool,
}

/// The connection to the board.
#[derive(Debug, Default)]
pub struct BoardPort {
    /// The pins whose changes are recorded, one bit mask per port of [`PORTS`].
    watched: [u16; PORTS.len()],
    changes: Vec<PinChange>,
}

impl BoardPort {
    /// Records the changes of `pin` from now on.
    pub fn watch(&mut self, pin: Pin) {
        self.watched[pin.port] |= 1 << pin.number;
    }

    /// What changed since the last call, oldest first.
    pub fn take_changes(&mut self) -> Vec<PinChange> {
        std::mem::take(&mut self.changes)
    }
}

impl Device for BoardPort {
    type Register = NoRegister;

    fn on_request(
        &mut self,
        change: RequestChange,
        _registers: &mut RegisterFile,
        context: &mut DeviceContext<'_>,
    ) {
        let Some(port) = PORTS.iter().position(|&name| name == change.instance) else {
            return;
        };
        let Ok(number) = u8::try_from(change.request) else {
            return;
        };
        if self.watched[port] >> number & 1 != 0 {
            self.changes.push(PinChange {
                at: context.now().0,
                pin: Pin { port, number },
                high: change.level == Level::High,
            });
            context.schedule(context.now());
        }
    }
}
