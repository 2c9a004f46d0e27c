//! Owners of the SPI's DMA buffers, between the wire, the chip-select interrupt and the robot.
//!
//! Receiving: one buffer is the DMA's, at most one holds a frame that awaits the robot, at most one is
//! claimed (the robot reads it in place). A frame that ends while another awaits the robot replaces it
//! and is counted.
//!
//! Sending: one buffer is armed (the DMA may read it), at most one is the standby, the third is free for
//! the robot to build in. Replies are numbered. The rising edge of chip-select ends the frame that carried
//! the armed reply n; the standby, reply n + 1, is armed at once. The answer to that frame replaces it
//! only within [`SWAP_WINDOW_US`] of the rising edge, while the wire is idle by agreement. An answer that
//! comes later is dropped; the next frame then carries the standby, which does not yet acknowledge that
//! frame.
//!
//! A tick refreshes the armed reply in place where the fresh one begins with the same [`SAME_PREFIX`]
//! bytes: a frame that begins meanwhile has fetched no more than those. So no frame carries parts of two
//! replies, whatever the Pi's set-up time and the processor's latency.

use crate::types::Micros;

/// Receive buffers.
pub const RX_BUFFERS: u8 = 3;
/// Transmit buffers.
pub const TX_BUFFERS: u8 = 3;

/// Least time from a rising edge of chip-select to the next falling edge, µs (docs/interfaces.md).
pub const GAP_US: u32 = 20;
/// Microseconds after the rising edge within which the armed reply may be replaced. The rest of [`GAP_US`], less one for
/// the clock's resolution, takes every handler that captures a time (180 instructions, and 30 for their entries), the
/// longest masked stretch (40) and arming (100). While rangefinders take turns, 100 cycles of latency fit in as well.
pub const SWAP_WINDOW_US: u32 = 13;
const _: () = assert!((GAP_US - SWAP_WINDOW_US - 1) * 60 >= 180 + 30 + 40 + 100);

/// Bytes that the transmitter may have fetched when a refresh is complete that began with chip-select
/// high: two held ready by the SPI and one by the DMA (RM0383, 9.2), and one every 0.67 µs at 12 MHz in
/// the 1.8 µs that 45 instructions at 60 a microsecond and 100 cycles of latency take.
pub const SAME_PREFIX: usize = 6;

/// Whether two replies begin alike. As numbers: comparing arrays would link a routine of its own.
#[inline]
#[must_use]
pub const fn begin_alike(one: [u8; SAME_PREFIX], other: [u8; SAME_PREFIX]) -> bool {
    const fn number([b0, b1, b2, b3, b4, b5]: [u8; SAME_PREFIX]) -> u64 {
        u64::from_le_bytes([b0, b1, b2, b3, b4, b5, 0, 0])
    }
    number(one) == number(other)
}

/// A frame in its buffer.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct EndedFrame {
    /// Receive buffer, below [`RX_BUFFERS`].
    pub buffer: u8,
    /// Bytes clocked, at most a receive buffer's.
    pub clocked: u8,
    /// The rising edge of chip-select.
    pub at: Micros,
}

/// A reply in its buffer.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Reply {
    /// Transmit buffer, below [`TX_BUFFERS`].
    pub buffer: u8,
    /// Its number, see [`crate::robot::Robot::encode_reply`].
    pub number: u32,
}

/// The buffers that the DMA uses for the next frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct DmaBuffers {
    /// Receive buffer.
    pub receive: u8,
    /// Transmit buffer.
    pub transmit: u8,
}

/// A frame that the robot took.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct ClaimedFrame {
    /// The frame.
    pub frame: EndedFrame,
    /// Frames replaced unread since the last claim.
    pub lost: u32,
    /// Where to build the answer, and its number.
    pub answer: Reply,
}

/// The owner of each buffer.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Handover {
    receiving: u8,
    ended: Option<EndedFrame>,
    claimed: Option<EndedFrame>,
    lost: u32,
    armed: Reply,
    /// A frame has carried the armed reply.
    transmitted: bool,
    standby: Option<Reply>,
}

impl Handover {
    /// Reply `first` armed in transmit buffer 0, receive buffer 0 empty.
    pub const fn new(first: u32) -> Self {
        Self {
            receiving: 0,
            ended: None,
            claimed: None,
            lost: 0,
            armed: Reply {
                buffer: 0,
                number: first,
            },
            transmitted: false,
            standby: None,
        }
    }

    /// The DMA's buffers.
    pub const fn dma_buffers(&self) -> DmaBuffers {
        DmaBuffers {
            receive: self.receiving,
            transmit: self.armed.buffer,
        }
    }

    /// Ends a frame of `clocked` bytes at the rising edge of chip-select; returns the next frame's
    /// buffers.
    // Requirement: WIRE-spi-3
    #[inline]
    pub fn end_frame(&mut self, clocked: u8, at: Micros) -> DmaBuffers {
        match self.standby.take() {
            Some(standby) => {
                self.armed = standby;
                self.transmitted = false;
            }
            None => self.transmitted = true,
        }
        let buffer = self.receiving;
        let replaced = self.ended.replace(EndedFrame {
            buffer,
            clocked,
            at,
        });
        if replaced.is_some() {
            self.lost = self.lost.saturating_add(1);
        }
        let claimed = self.claimed.map_or(buffer, |frame| frame.buffer);
        self.receiving = other(buffer, claimed);
        self.dma_buffers()
    }

    /// When the frame that [`Self::claim`] would return ended.
    #[inline]
    pub fn ended_at(&self) -> Option<Micros> {
        self.ended.map(|frame| frame.at)
    }

    /// The frame that ended last, for the robot to read in place until [`Self::answer`].
    #[inline]
    pub fn claim(&mut self) -> Option<ClaimedFrame> {
        let frame = self.ended.take()?;
        self.claimed = Some(frame);
        Some(ClaimedFrame {
            frame,
            lost: core::mem::take(&mut self.lost),
            answer: Reply {
                buffer: self.free(),
                number: self.due(),
            },
        })
    }

    /// Returns the claimed frame's buffer and takes its answer. The buffers to arm where the answer
    /// replaces the armed reply: at `now` the wire is idle.
    // Requirement: WIRE-spi-6
    #[inline]
    pub fn answer(&mut self, answer: Reply, now: Micros) -> Option<DmaBuffers> {
        let claimed = self.claimed.take()?;
        if answer.number != self.due() {
            return None;
        }
        if self.ended.is_none() && now.since(claimed.at) <= SWAP_WINDOW_US {
            self.armed = answer;
            self.transmitted = false;
            self.standby = self
                .standby
                .filter(|standby| standby.number != answer.number);
            return Some(self.dma_buffers());
        }
        if self.transmitted {
            self.standby = Some(answer);
        }
        None
    }

    /// Where to rebuild the armed reply, and its number; none where a frame has carried it.
    #[inline]
    pub fn fresh_reply(&self) -> Option<Reply> {
        (!self.transmitted).then(|| Reply {
            buffer: self.free(),
            number: self.armed.number,
        })
    }

    /// The armed buffer, where `fresh` may be copied over its bytes: they are the same reply and begin
    /// alike. Chip-select must be high.
    #[inline]
    pub fn refresh(&self, fresh: Reply, begin_alike: bool) -> Option<u8> {
        let same = self.fresh_reply().map(|reply| reply.number) == Some(fresh.number);
        (same && begin_alike).then_some(self.armed.buffer)
    }

    /// Where to build the reply after the armed one, and its number.
    #[inline]
    pub fn next_reply(&self) -> Reply {
        Reply {
            buffer: self.free(),
            number: self.armed.number.wrapping_add(1),
        }
    }

    /// Takes the reply after the armed one as the standby; drops it where its turn is over.
    #[inline]
    pub fn stand_by(&mut self, reply: Reply) {
        if reply.number == self.armed.number.wrapping_add(1) {
            self.standby = Some(reply);
        }
    }

    /// The number of the reply that the next frame should carry.
    #[inline]
    fn due(&self) -> u32 {
        self.armed.number.wrapping_add(u32::from(self.transmitted))
    }

    /// A transmit buffer that is neither armed nor standby. It stays so while the robot builds in it: a
    /// rising edge may arm the standby, which frees another one.
    #[inline]
    fn free(&self) -> u8 {
        let standby = self.standby.map_or(self.armed.buffer, |reply| reply.buffer);
        other(self.armed.buffer, standby)
    }
}

/// Of buffers 0, 1 and 2 one that is neither `a` nor `b`.
const fn other(a: u8, b: u8) -> u8 {
    if a != 0 && b != 0 {
        0
    } else if a != 1 && b != 1 {
        1
    } else {
        2
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Reply `number` in transmit buffer `buffer`.
    const fn reply(buffer: u8, number: u32) -> Reply {
        Reply { buffer, number }
    }

    #[test]
    fn answer_within_the_window_replaces_the_standby() {
        let mut handover = Handover::new(1);
        assert_eq!(handover.fresh_reply(), Some(reply(1, 1)));
        assert_eq!(handover.next_reply(), reply(1, 2));
        handover.stand_by(reply(1, 2));
        let dma = handover.end_frame(26, Micros(100));
        assert_eq!((dma.receive, dma.transmit), (1, 1));
        let claimed = handover.claim().expect("a frame");
        assert_eq!((claimed.frame.buffer, claimed.frame.clocked), (0, 26));
        assert_eq!((claimed.lost, claimed.answer), (0, reply(0, 2)));
        let armed = handover.answer(claimed.answer, Micros(100 + SWAP_WINDOW_US));
        assert_eq!(armed.map(|dma| dma.transmit), Some(0));
        assert_eq!(handover.dma_buffers().transmit, 0);
        assert_eq!(handover.fresh_reply(), Some(reply(1, 2)));
        // The reply after it waits while this one is rebuilt.
        handover.stand_by(reply(1, 3));
        assert_eq!(handover.fresh_reply(), Some(reply(2, 2)));
        assert_eq!(handover.refresh(reply(2, 2), true), Some(0));
        assert_eq!(handover.refresh(reply(2, 2), false), None);
        assert_eq!(handover.refresh(reply(2, 3), true), None);
        assert_eq!(handover.end_frame(26, Micros(500)).transmit, 1);
    }

    #[test]
    fn answer_leaves_the_standby_after_it() {
        let mut handover = Handover::new(1);
        handover.stand_by(reply(1, 2));
        handover.end_frame(26, Micros(0));
        handover.stand_by(reply(2, 3));
        let answer = handover.claim().expect("a frame").answer;
        assert!(handover.answer(answer, Micros(9)).is_some());
        assert_eq!(handover.end_frame(26, Micros(300)).transmit, 2);
    }

    #[test]
    fn answer_behind_another_frame_waits_as_standby() {
        let mut handover = Handover::new(1);
        handover.end_frame(26, Micros(0));
        let answer = handover.claim().expect("a frame").answer;
        handover.end_frame(26, Micros(9));
        assert_eq!(handover.answer(answer, Micros(10)), None);
        assert_eq!(handover.end_frame(26, Micros(60)).transmit, answer.buffer);
    }

    #[test]
    fn late_answer_waits_for_the_frame_after_the_next() {
        let mut handover = Handover::new(1);
        // Without a standby the armed reply goes once more.
        assert_eq!(handover.end_frame(26, Micros(0)).transmit, 0);
        assert_eq!(handover.fresh_reply(), None);
        let claimed = handover.claim().expect("a frame");
        assert_eq!(claimed.answer, reply(1, 2));
        assert_eq!(
            handover.answer(claimed.answer, Micros(SWAP_WINDOW_US + 1)),
            None
        );
        assert_eq!(handover.dma_buffers().transmit, 0);
        let at = Micros(300);
        assert_eq!(handover.end_frame(26, at).transmit, 1);
        assert_eq!(handover.fresh_reply(), Some(reply(0, 2)));
        // Where the armed reply is already the one due, a late answer is dropped.
        let claimed = handover.claim().expect("a frame");
        assert_eq!(claimed.answer, reply(0, 2));
        assert_eq!(
            handover.answer(claimed.answer, at.after(SWAP_WINDOW_US + 1)),
            None
        );
        assert_eq!(handover.end_frame(26, Micros(600)).transmit, 1);
        assert_eq!(handover.fresh_reply(), None);
    }

    // Requirement: WIRE-spi-3
    #[test]
    fn frames_that_end_unread_are_replaced_and_counted_once() {
        let mut handover = Handover::new(1);
        for (at, receive) in [(0, 1), (30, 0), (60, 1)] {
            assert_eq!(handover.end_frame(26, Micros(at)).receive, receive);
            assert_eq!(handover.ended_at(), Some(Micros(at)));
        }
        let first = handover.claim().expect("a frame");
        assert_eq!((first.lost, first.frame.at), (2, Micros(60)));
        assert_eq!((handover.ended_at(), handover.claim()), (None, None));
        // A frame that ends while the robot reads: neither its buffer nor the read one is the DMA's.
        assert_eq!(handover.end_frame(26, Micros(90)).receive, 2);
        assert_eq!(
            handover.answer(first.answer, Micros(91)),
            None,
            "the wire went on"
        );
        assert_eq!(
            handover.answer(first.answer, Micros(91)),
            None,
            "no frame is claimed"
        );
        let next = handover.claim().expect("a frame");
        assert_eq!((next.lost, next.frame.buffer), (0, 1));
        // Its buffer is free again with the answer.
        let _ = handover.answer(next.answer, Micros(92));
        assert_eq!(handover.end_frame(26, Micros(120)).receive, 0);
    }

    #[test]
    fn answer_in_time_is_armed_instead_of_an_older_standby() {
        let mut handover = Handover::new(1);
        let _ = handover.end_frame(26, Micros(0));
        let claimed = handover.claim().expect("a frame");
        // A tick builds the same reply meanwhile.
        handover.stand_by(reply(2, 2));
        let armed = handover.answer(claimed.answer, Micros(5));
        assert_eq!(armed.map(|dma| dma.transmit), Some(1));
        assert_eq!(handover.fresh_reply().map(|fresh| fresh.number), Some(2));
        assert_eq!(handover.end_frame(26, Micros(30)).transmit, 1);
        let mut full = Handover {
            lost: u32::MAX,
            ..handover
        };
        let _ = full.end_frame(26, Micros(60));
        assert_eq!(full.claim().map(|claimed| claimed.lost), Some(u32::MAX));
    }

    #[test]
    fn reply_out_of_turn_is_dropped() {
        let mut handover = Handover::new(u32::MAX);
        for number in [u32::MAX, 1] {
            handover.stand_by(reply(1, number));
            assert_eq!(handover.end_frame(26, Micros(0)).transmit, 0);
        }
        handover.stand_by(reply(1, 0));
        assert_eq!(handover.end_frame(26, Micros(0)).transmit, 1);
        let claimed = handover.claim().expect("a frame");
        assert_eq!(claimed.answer.number, 0);
        assert_eq!(handover.answer(reply(2, 1), Micros(1)), None);
        assert_eq!(handover.dma_buffers().transmit, 1);
    }
}
