//! The log's transmitter: hands the queue to a stream of the DMA, piece by piece, and never waits.

use crate::log::Log;

/// A stream that sends bytes of memory by itself.
pub trait Stream {
    /// Whether an error has stopped the transfer.
    fn failed(&mut self) -> bool;
    /// Whether every byte has been moved.
    fn complete(&mut self) -> bool;
    /// Stops the transfer; the memory is the program's again.
    fn stop(&mut self);
    /// Clears what [`Self::failed`] and [`Self::complete`] read.
    fn clear(&mut self);
    /// Starts to send `bytes`, which stay unchanged until the stream is complete or stopped. Both ends of the
    /// transfer must call [`Transmitter::service`].
    fn send(&mut self, bytes: &[u8]);
}

/// How far the log has been handed over.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub struct Transmitter {
    /// Bytes of the log that the stream is sending.
    sending: usize,
}

impl Transmitter {
    /// Nothing is being sent.
    pub const IDLE: Self = Self { sending: 0 };

    /// Whether nothing is being sent.
    pub const fn is_idle(&self) -> bool {
        self.sending == 0
    }

    /// Retires what has been sent and starts the next transfer; what a failed transfer has not sent is lost.
    /// For the end of a transfer, and after every event that may have logged; the log keeps pending bytes
    /// unchanged.
    // Requirement: WIRE-log-2
    #[inline]
    pub fn service<const N: usize>(&mut self, log: &mut Log<N>, stream: &mut impl Stream) {
        if self.sending > 0 {
            if stream.failed() {
                stream.stop();
            } else if !stream.complete() {
                return;
            }
            log.sent(self.sending);
            self.sending = 0;
            stream.clear();
        }
        let pending = log.pending();
        if !pending.is_empty() {
            stream.send(pending);
            self.sending = pending.len();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::log::Level;
    use std::string::{String, ToString};
    use std::vec::Vec;

    /// Says what it is asked to do.
    #[derive(Default)]
    struct Recorded {
        failed: bool,
        complete: bool,
        calls: Vec<String>,
    }

    impl Stream for Recorded {
        fn failed(&mut self) -> bool {
            self.failed
        }

        fn complete(&mut self) -> bool {
            self.complete
        }

        fn stop(&mut self) {
            self.calls.push("stop".to_string());
        }

        fn clear(&mut self) {
            self.calls.push("clear".to_string());
        }

        fn send(&mut self, bytes: &[u8]) {
            self.calls.push(String::from_utf8_lossy(bytes).into_owned());
        }
    }

    #[test]
    fn transmitter_sends_the_next_lines_when_the_last_have_left() {
        let (mut log, mut stream) = (Log::<64>::new(), Recorded::default());
        let mut transmitter = Transmitter::IDLE;
        let mut service = |log: &mut Log<64>, failed, complete| {
            (stream.failed, stream.complete) = (failed, complete);
            transmitter.service(log, &mut stream);
            (core::mem::take(&mut stream.calls), transmitter.is_idle())
        };
        let strings = |texts: &[&str]| texts.iter().map(ToString::to_string).collect::<Vec<_>>();
        // Without a transfer the flags say nothing.
        assert_eq!(service(&mut log, true, true), (Vec::new(), true));
        log.text(Level::Info, "one");
        assert_eq!(
            service(&mut log, false, true),
            (strings(&["I00000: one\n"]), false)
        );
        log.text(Level::Info, "two");
        assert_eq!(service(&mut log, false, false), (Vec::new(), false));
        let next = strings(&["clear", "I00001: two\n"]);
        assert_eq!(service(&mut log, false, true), (next, false));
        log.text(Level::Info, "three");
        let next = strings(&["stop", "clear", "I00002: three\n"]);
        assert_eq!(service(&mut log, true, true), (next, false));
        assert_eq!(
            service(&mut log, true, false),
            (strings(&["stop", "clear"]), true)
        );
        assert_eq!(service(&mut log, false, true), (Vec::new(), true));
    }
}
