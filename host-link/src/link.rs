//! One frame per chip-select: what goes out, what comes back, and the statistics of both.

use crate::error::Error;
use embedded_hal::spi::SpiDevice;
use fw_core::eeprom::Config;
use fw_core::wire::{Cause, Command, FrameError, Mode, PiLink, Report, Setup, MAX_FRAME};
use serde::Serialize;
use std::collections::BTreeMap;

/// How many frames went, how many were good, and what was wrong with the others.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Statistics {
    /// Frames exchanged.
    pub frames: u64,
    /// Replies that passed the whole chain.
    pub accepted: u32,
    /// Replies rejected.
    pub rejected: u32,
    /// Replies rejected, by cause; causes that never occurred are left out.
    pub causes: BTreeMap<&'static str, u32>,
    /// The longest time between two accepted replies, microseconds.
    pub worst_gap_us: u64,
    /// Replies the STM numbered that never arrived whole. Guarded modes only.
    pub missed: u32,
    /// Round trip: frames sent that the STM had not confirmed in its latest reply; 1 is the least.
    /// Guarded modes only.
    pub round_trip_frames: Option<u8>,
}

/// The Pi's end of the link.
pub struct Link {
    end: PiLink,
    mode: Mode,
    frames: u64,
    last_good_us: Option<u64>,
    worst_gap_us: u64,
}

impl Link {
    /// The end that the configuration asks for: its mode's chain, its keys, its cells.
    #[must_use]
    pub fn new(config: &Config) -> Self {
        Self {
            end: PiLink::new(Setup::from(config)),
            mode: config.mode,
            frames: 0,
            last_good_us: None,
            worst_gap_us: 0,
        }
    }

    /// Sends `command` and returns the STM's frame of the same transfer: `Err` inside says what was
    /// wrong with it. `now_us` dates it for the statistics.
    ///
    /// # Errors
    /// [`Error::Spi`]: the bus itself failed; nothing is known about the frame.
    pub fn exchange<S: SpiDevice>(
        &mut self,
        spi: &mut S,
        now_us: u64,
        command: &Command,
    ) -> Result<Result<Report, FrameError>, Error> {
        let mut out = [0; MAX_FRAME];
        let mut back = [0; MAX_FRAME];
        let len = self.end.send(command, &mut out);
        let (Some(out), Some(back)) = (out.get(..len), back.get_mut(..len)) else {
            return Err(Error::Spi(format!(
                "a chain of {len} bytes exceeds the longest frame"
            )));
        };
        spi.transfer(back, out)
            .map_err(|cause| Error::Spi(format!("{cause:?}")))?;
        self.frames += 1;
        let reply = self.end.receive(back);
        if reply.is_ok() {
            if let Some(last) = self.last_good_us.replace(now_us) {
                self.worst_gap_us = self.worst_gap_us.max(now_us.saturating_sub(last));
            }
        }
        Ok(reply)
    }

    /// The counters so far.
    #[must_use]
    pub fn statistics(&self) -> Statistics {
        let counters = self.end.counters();
        Statistics {
            frames: self.frames,
            accepted: counters.accepted,
            rejected: counters.rejected_total(),
            causes: Cause::ALL
                .into_iter()
                .map(|cause| (cause.name(), counters.rejected(cause)))
                .filter(|&(_, count)| count > 0)
                .collect(),
            worst_gap_us: self.worst_gap_us,
            missed: counters.missed,
            round_trip_frames: self.mode.tells_fresh().then_some(counters.unacknowledged),
        }
    }
}
