//! The receiver on the log's wire: 8N1.

use rigless::chip::Timeline;
use rigless::chip::uart::Peer;
use rigless::snapshot::Store;
use rigless::time::VirtualNanos;

/// A byte of the log.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct LogByte {
    /// When its stop bit ended, nanoseconds of virtual time.
    pub at: u64,
    /// The byte as it arrived.
    pub byte: u8,
}

/// The receiver.
#[derive(Debug, Default)]
pub struct UartReceiver {
    words: Vec<LogByte>,
}

impl UartReceiver {
    /// What arrived since the last call.
    pub fn take(&mut self) -> Vec<LogByte> {
        std::mem::take(&mut self.words)
    }
}

impl Store for UartReceiver {}

impl Peer for UartReceiver {
    fn receive(&mut self, word: u16, context: &mut Timeline<'_, '_>) {
        self.words.push(LogByte {
            at: context.now().0,
            byte: word.to_le_bytes()[0],
        });
    }

    fn transmit(&mut self, _now: VirtualNanos) -> Option<u16> {
        None
    }
}

/// Whether a receiver at `own` baud reads a sender at `baud`: within 3 %, half a bit in ten with what its clock is off.
pub fn is_readable(baud: u64, own: u64) -> bool {
    baud.abs_diff(own) * 100 <= own * 3
}
