//! The exchange of one frame per chip-select, and the statistics of this end.

use crate::board_io::Spi;
use crate::error::Error;
use crate::statistics::{LinkStatistics, RejectCounts};
use fw_core::eeprom::Config;
use fw_core::wire::handover::GAP_US;
use fw_core::wire::{Command, Field, FrameError, MAX_FRAME, Mode, PiLink, Report};
use std::collections::HashMap;

/// From the fall of chip-select to the first clock, nanoseconds: the STM needs 60 (docs/interfaces.md), and
/// spidev's delays are whole microseconds.
pub const SETUP_NS: u32 = 1_000;

/// The Pi's end of the link.
pub struct Link {
    end: PiLink,
    mode: Mode,
    /// What this end counts beside [`PiLink::counters`].
    counted: LinkStatistics,
    last_good_us: Option<u64>,
    /// When the longest gap of the last second ended.
    recent_gap_end_us: u64,
    /// Earliest begin of the next frame.
    due_us: u64,
    round_trip: RoundTrip,
    /// The number of the last accepted reply, and how many frames had been sent by then.
    last_reply: Option<(u8, u64)>,
    /// A reply's number showed a restart of the STM.
    pub(crate) restarted: bool,
}

/// Time after which a gap is not recent any more, microseconds.
const RECENT_US: u64 = 1_000_000;
/// So many chip-selects by interference make the STM number a reply without a frame of this end.
const FALSE_SELECTS: u64 = 8;

impl Link {
    /// The end for a configuration: its mode's chain, its keys, its cells.
    pub fn new(config: &Config) -> Self {
        Self {
            end: PiLink::new(config.link_setup()),
            mode: config.mode(),
            counted: LinkStatistics::default(),
            last_good_us: None,
            recent_gap_end_us: 0,
            due_us: 0,
            round_trip: RoundTrip::default(),
            last_reply: None,
            restarted: false,
        }
    }

    /// Before this time, µs of [`Self::exchange`]'s clock, no frame may begin.
    // Requirement: WIRE-spi-7
    #[must_use]
    pub const fn due_us(&self) -> u64 {
        self.due_us
    }

    /// Sends `command`, not before [`Self::due_us`], and returns the STM's frame of the same transfer; the
    /// inner `Err` is the reason of its rejection.
    ///
    /// # Errors
    /// [`Error::Spi`]: the bus itself failed; nothing is known about the frame.
    // Requirement: DOC-5-3
    pub fn exchange(
        &mut self,
        spi: &mut Spi,
        clock: &mut dyn FnMut() -> u64,
        command: &Command,
    ) -> Result<Result<Report, FrameError>, Error> {
        let mut out = [0; MAX_FRAME];
        let mut back = [0; MAX_FRAME];
        let len = self.end.send(command, &mut out);
        let (Some(out), Some(back)) = (out.get(..len), back.get_mut(..len)) else {
            let long = format!("a chain of {len} bytes exceeds the longest frame");
            return Err(Error::Spi(long));
        };
        let begun_us = clock();
        self.round_trip.sent(begun_us);
        let ended_us = self.transfer(spi, clock, out, back)?;
        let counted = &mut self.counted;
        let transfer_us = ended_us.saturating_sub(begun_us);
        counted.worst_transfer_us = counted.worst_transfer_us.max(transfer_us);
        let reply = self.end.receive(back);
        if let Ok(report) = &reply {
            if self.last_good_us.is_none() && self.mode.has(Field::Sequence) {
                self.follow_numbers(report.sequence.seen);
            }
            let counted = &mut self.counted;
            if let Some(last) = self.last_good_us.replace(begun_us) {
                let gap_us = begun_us.saturating_sub(last);
                counted.worst_gap_us = counted.worst_gap_us.max(gap_us);
                let is_old = begun_us - self.recent_gap_end_us > RECENT_US;
                if gap_us >= counted.recent_gap_us || is_old {
                    (counted.recent_gap_us, self.recent_gap_end_us) = (gap_us, begun_us);
                }
            }
            if self.mode.has(Field::Sequence) {
                self.round_trip.seen(report.sequence.seen, ended_us);
            }
            self.check_number(report.sequence.own);
        }
        Ok(reply)
    }

    /// The first reply shows the number that the STM has last accepted, of an earlier session. Where the numbers
    /// of this one are stale to it, they go on from there.
    fn follow_numbers(&mut self, seen: u8) {
        let ahead = self.round_trip.number.wrapping_sub(seen);
        while !(1..=0x7F).contains(&ahead) && self.round_trip.number != seen {
            self.round_trip.number = self.round_trip.number.wrapping_add(1);
            let _ = self.end.send(&Command::default(), &mut [0; MAX_FRAME]);
        }
    }

    /// The STM numbers its replies from 1 after a reset, one a frame: a number ahead of the last one by more
    /// than the frames sent since then, or behind it, is that of an STM that has restarted.
    fn check_number(&mut self, number: u8) {
        let before = self.last_reply.replace((number, self.counted.frames));
        let is_ahead = before.is_some_and(|(last, frames)| {
            let ahead = u64::from(number.wrapping_sub(last));
            ahead > self.counted.frames - frames + FALSE_SELECTS
        });
        self.restarted |= is_ahead && self.mode.has(Field::Sequence);
    }

    /// Transfers a frame that another process has built, not before [`Self::due_us`]; the report, if the reply
    /// is a valid one.
    ///
    /// # Errors
    /// [`Error::Spi`].
    pub fn relay(
        &mut self,
        spi: &mut Spi,
        clock: &mut dyn FnMut() -> u64,
        frame: &[u8],
        reply: &mut [u8],
    ) -> Result<Option<Report>, Error> {
        self.transfer(spi, clock, frame, reply)?;
        let report = self.end.receive(reply).ok();
        if let Some(report) = &report {
            self.check_number(report.sequence.own);
        }
        Ok(report)
    }

    /// One frame, counted; the time of its end, which the next one's begin depends on.
    fn transfer(
        &mut self,
        spi: &mut Spi,
        clock: &mut dyn FnMut() -> u64,
        out: &[u8],
        back: &mut [u8],
    ) -> Result<u64, Error> {
        transfer(spi, out, back, SETUP_NS)?;
        let ended_us = clock();
        // One more, since the clock counts whole microseconds.
        self.due_us = ended_us + u64::from(GAP_US) + 1;
        self.counted.frames += 1;
        Ok(ended_us)
    }

    /// The counters so far.
    pub fn statistics(&self) -> LinkStatistics {
        let counters = self.end.counters();
        let numbered = self.mode.has(Field::Sequence);
        LinkStatistics {
            accepted: counters.accepted,
            rejected: counters.rejected_total(),
            causes: RejectCounts::from(counters),
            missed: numbered.then_some(counters.missed),
            round_trip_frames: numbered.then_some(counters.unacknowledged),
            round_trip_us: self.round_trip.latest_us,
            worst_round_trip_us: self.round_trip.worst_us,
            ..self.counted
        }
    }
}

/// One chip-select, `setup_ns` before the first clock, usually [`SETUP_NS`].
///
/// # Errors
/// [`Error::Spi`].
pub fn transfer(spi: &mut Spi, out: &[u8], back: &mut [u8], setup_ns: u32) -> Result<(), Error> {
    spi(out, back, setup_ns).map_err(|cause| Error::Spi(cause.to_string()))
}

/// How long the STM takes to confirm a frame: each is timed by its number, the first time that a
/// reply says it was the last one accepted.
#[derive(Default)]
struct RoundTrip {
    /// Numbers given out, as [`PiLink`] does: 1 for the first frame.
    number: u8,
    sent_us: HashMap<u8, u64>,
    last_seen: Option<u8>,
    latest_us: Option<u64>,
    worst_us: Option<u64>,
}

impl RoundTrip {
    fn sent(&mut self, at_us: u64) {
        self.number = self.number.wrapping_add(1);
        self.sent_us.insert(self.number, at_us);
    }

    fn seen(&mut self, number: u8, now_us: u64) {
        let before = self.last_seen.replace(number);
        // What the first reply has seen may be of an earlier session.
        if before.is_none_or(|before| before == number) {
            return;
        }
        if let Some(sent_us) = self.sent_us.get(&number) {
            self.latest_us = Some(now_us.saturating_sub(*sent_us));
            self.worst_us = self.worst_us.max(self.latest_us);
        }
    }
}

#[test]
fn round_trip_ends_at_first_confirming_reply() {
    let mut trip = RoundTrip::default();
    let mut at = 0;
    let mut frame = |seen: u64, latest_us| {
        at += 25_000;
        trip.sent(at);
        trip.seen(u8::try_from(seen & 0xFF).unwrap(), at + 60);
        assert_eq!(trip.latest_us, latest_us, "{seen}");
        assert!(trip.worst_us >= trip.latest_us);
    };
    // 77 is of another session, and not of this one's 77th frame.
    frame(77, None);
    frame(77, None);
    frame(2, Some(25_060));
    // Confirmed again and again: nothing new was accepted.
    frame(2, Some(25_060));
    frame(3, Some(50_060));
    for number in 5..=1000 {
        frame(number, Some(25_060));
    }
    assert_eq!(trip.worst_us, Some(50_060));
    // So is a first reply's 1: frame 1 is under way with it.
    let mut trip = RoundTrip::default();
    trip.sent(0);
    trip.seen(1, 60);
    assert_eq!(trip.worst_us, None);
}

#[test]
fn restart_shows_by_a_reply_number_beyond_the_frames_sent() {
    for (before, sent, after, is_restart) in [
        (0, 1, 1, false),
        (250, 12, 6, false),
        (5, 1, 14, false),
        (5, 1, 15, true),
        (100, 3, 1, true),
        (200, 4, 1, true),
        (2, 1, 1, true),
    ] {
        let mode = Mode::GuardedVelocity.code().into();
        let image = fw_core::eeprom::Image::FIRST_BOARD.with(fw_core::eeprom::fields::MODE, mode);
        let mut link = Link::new(&Config::decode(&image).unwrap());
        link.counted.frames = 50;
        link.check_number(before);
        assert!(!link.restarted);
        link.counted.frames += sent;
        link.check_number(after);
        assert_eq!(link.restarted, is_restart, "{before} {sent} {after}");
    }
}

#[test]
fn worst_transfer_stays_and_longest_gap_for_a_second() {
    let image = fw_core::eeprom::Image::FIRST_BOARD;
    let (_, mut io) = crate::mock_board::mock_board(&image, None);
    let mut link = Link::new(&Config::decode(&image).unwrap());
    let begins_us = [
        0, 300_000, 550_000, 800_000, 1_050_000, 1_300_000, 1_301_000,
    ];
    for (nth, begun_us) in begins_us.into_iter().enumerate() {
        let (transfer_us, worst_us) = [(60, 60), (200, 200), (70, 200)][nth.min(2)];
        let mut times = [begun_us, begun_us + transfer_us].into_iter();
        let mut clock = || times.next().unwrap();
        let reply = link.exchange(&mut *io.spi, &mut clock, &Command::default());
        assert!(reply.unwrap().is_ok());
        let gap_us = [0, 300_000, 300_000, 300_000, 300_000, 300_000, 1_000][nth];
        let counted = link.statistics();
        assert_eq!(
            (counted.worst_transfer_us, counted.recent_gap_us),
            (worst_us, gap_us)
        );
    }
}
