//! A wheel's quadrature encoder: the instants of its edges.

use std::collections::VecDeque;

use rigless::device::Level;

/// An edge: when, and the position it leads to, in counts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Edge {
    /// Nanoseconds of virtual time.
    pub at: u64,
    /// The position after it.
    pub count: i64,
}

/// The edges still to come.
#[derive(Clone, Debug, Default)]
pub struct Encoder {
    edges: VecDeque<Edge>,
}

impl Encoder {
    /// Plans the edges of a wheel whose position moves evenly from `from` to `to` counts during
    /// the `span` nanoseconds after `start`. An edge lies at every whole count.
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_precision_loss,
        clippy::cast_sign_loss,
        reason = "positions are far below 2^53 counts and instants lie within the span"
    )]
    pub fn plan(&mut self, start: u64, span: u64, from: f64, to: f64) {
        let (first, last) = (from.floor() as i64, to.floor() as i64);
        let falls = last < first;
        for nth in 0..(last - first).abs() {
            let whole = if falls { first - nth } else { first + 1 + nth };
            let share = ((whole as f64 - from) / (to - from)).clamp(0.0, 1.0);
            let at = start + (share * span as f64) as u64;
            let count = whole - i64::from(falls);
            self.edges.push_back(Edge { at, count });
        }
    }

    /// When the next edge is due.
    pub fn next_event(&self) -> Option<u64> {
        self.edges.front().map(|edge| edge.at)
    }

    /// Takes the next edge due by `now`.
    pub fn take(&mut self, now: u64) -> Option<Edge> {
        self.edges.pop_front_if(|edge| edge.at <= now)
    }

    /// The levels of channels 1 and 2 at a position: channel 1 leads while the count rises.
    pub fn levels(count: i64) -> [Level; 2] {
        let phase = count.rem_euclid(4);
        [
            Level::from(phase == 1 || phase == 2),
            Level::from(phase == 2 || phase == 3),
        ]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn edges_lie_at_whole_counts_in_both_directions() {
        let mut encoder = Encoder::default();
        encoder.plan(1000, 100, 0.5, 2.5);
        assert_eq!(encoder.take(1024), None);
        assert_eq!(encoder.take(1025), Some(Edge { at: 1025, count: 1 }));
        assert_eq!(encoder.take(1075), Some(Edge { at: 1075, count: 2 }));
        encoder.plan(2000, 100, 2.5, 0.5);
        assert_eq!(encoder.take(9999), Some(Edge { at: 2025, count: 1 }));
        assert_eq!(encoder.take(9999), Some(Edge { at: 2075, count: 0 }));
        assert_eq!(encoder.next_event(), None);
    }

    #[test]
    fn one_channel_changes_at_a_time_and_channel_1_leads() {
        for count in -8..8 {
            let (before, after) = (Encoder::levels(count), Encoder::levels(count + 1));
            let changed = (0..2).filter(|&channel| before[channel] != after[channel]);
            assert_eq!(changed.count(), 1);
        }
        assert_eq!(Encoder::levels(0), [Level::Low, Level::Low]);
        assert_eq!(Encoder::levels(1), [Level::High, Level::Low]);
    }
}
