//! What each end counts of the frames it receives.

use fw_core::wire::{Cause, LinkCounters};
use serde::{Deserialize, Deserializer, Serialize, Serializer};
use std::collections::HashMap;

/// Rejected frames by cause. As JSON an object of those that occurred.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct RejectCounts([u32; Cause::ALL.len()]);

impl RejectCounts {
    /// Rejected for `cause`.
    pub fn get(&self, cause: Cause) -> u32 {
        self.0.get(cause as usize).copied().unwrap_or_default()
    }

    /// Notes how many were rejected for `cause`.
    pub fn set(&mut self, cause: Cause, count: u32) {
        if let Some(slot) = self.0.get_mut(cause as usize) {
            *slot = count;
        }
    }

    /// Those that occurred, in the order of [`Cause::ALL`].
    pub fn nonzero(&self) -> impl Iterator<Item = (Cause, u32)> + '_ {
        let counts = Cause::ALL.into_iter().zip(self.0);
        counts.filter(|&(_, count)| count > 0)
    }

    /// Rejected for any cause.
    pub fn total(&self) -> u32 {
        self.0.iter().copied().fold(0, u32::saturating_add)
    }
}

impl From<&LinkCounters> for RejectCounts {
    fn from(counters: &LinkCounters) -> Self {
        Self(Cause::ALL.map(|cause| counters.rejected(cause)))
    }
}

impl Serialize for RejectCounts {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_map(self.nonzero().map(|(cause, count)| (cause.name(), count)))
    }
}

impl<'de> Deserialize<'de> for RejectCounts {
    fn deserialize<D: Deserializer<'de>>(value: D) -> Result<Self, D::Error> {
        let by_name = HashMap::<String, u32>::deserialize(value)?;
        let count = |cause: Cause| by_name.get(cause.name()).copied().unwrap_or_default();
        Ok(Self(Cause::ALL.map(count)))
    }
}

/// The Pi's end: replies of the STM since the session began.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct LinkStatistics {
    /// Frames exchanged.
    pub frames: u64,
    /// Replies that passed the whole chain.
    pub accepted: u32,
    /// Replies rejected.
    pub rejected: u32,
    /// Replies rejected, by cause.
    pub causes: RejectCounts,
    /// The longest time between two accepted replies, microseconds.
    pub worst_gap_us: u64,
    /// The longest of the last second.
    pub recent_gap_us: u64,
    /// The longest transfer of one frame, from the system call to its return, microseconds.
    pub worst_transfer_us: u64,
    /// Numbered replies of the STM that never arrived complete. Guarded modes only: the document's
    /// frames have no number.
    pub missed: Option<u32>,
    /// Frames sent that the STM had not confirmed in its latest reply; 1 is the least. Guarded modes
    /// only: the document's frames do not identify the frame that a reply answers.
    pub round_trip_frames: Option<u8>,
    /// From the begin of the transfer of a frame to the end of the one whose reply confirms it,
    /// microseconds: the latest. Guarded modes only.
    pub round_trip_us: Option<u64>,
    /// The longest of them.
    pub worst_round_trip_us: Option<u64>,
}

/// The STM's end, from its log: frames of the Pi since the STM's reset.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct StmStatistics {
    /// Frames that arrived.
    pub frames: u32,
    /// Frames that passed the whole chain.
    pub accepted: u32,
    /// Frames rejected.
    pub rejected: u32,
    /// Frames rejected, by cause.
    pub causes: RejectCounts,
    /// Frames that came too fast and were dropped unread.
    pub lost: u32,
    /// Frames the Pi numbered that were never accepted. Guarded modes only.
    pub missed: Option<u32>,
    /// The longest time between two accepted frames since the line of the log before, microseconds.
    pub recent_gap_us: u32,
    /// The longest since the reset; 4294967295 for half an hour and more.
    pub worst_gap_us: u32,
    /// Replies that the Pi's latest frame had not confirmed; 2 is the least, for the one to come is
    /// numbered already. Guarded modes only.
    pub round_trip_frames: Option<u8>,
}

#[test]
fn reject_counts_serialize_nonzero_causes() {
    let mut causes = RejectCounts::default();
    causes.set(Cause::Crc, 3);
    causes.set(Cause::Short, u32::MAX);
    let json = serde_json::to_string(&causes).unwrap();
    assert_eq!(json, r#"{"short":4294967295,"crc":3}"#);
    assert_eq!(serde_json::from_str::<RejectCounts>(&json).unwrap(), causes);
    assert_eq!(causes.total(), u32::MAX);
    let every = RejectCounts(Cause::ALL.map(|cause| cause as u32 + 1));
    let json = serde_json::to_string(&every).unwrap();
    assert_eq!(serde_json::from_str::<RejectCounts>(&json).unwrap(), every);
}

#[test]
fn link_counter_of_first_cause_is_taken_over() {
    use fw_core::eeprom::{Config, Image};
    let config = Config::decode(&Image::FIRST_BOARD).unwrap();
    let mut end = fw_core::wire::PiLink::new(config.link_setup());
    assert!(end.receive(&[]).is_err());
    let counts: Vec<_> = RejectCounts::from(end.counters()).nonzero().collect();
    assert_eq!(counts, [(Cause::Short, 1)]);
}
