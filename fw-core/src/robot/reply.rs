//! What the robot says of itself: what it senses is turned into the wire's codes when it changes, and
//! a reply, which must be there before the next frame, only copies them.

use super::{Measure, Robot};
use crate::binary64::Binary64;
use crate::types::{Pose, RangefinderId};
use crate::wire::{CellCode, DistanceCode, PoseCode, MAX_FRAME};

impl Robot {
    /// What a tick changed, in the wire's codes: a frame's reply only copies it.
    // Requirement: DOC-2.1-4
    pub(super) fn sense(&mut self, pose: &Pose) {
        self.said.pose = PoseCode::from_pose(pose);
        if self.measure != Measure::Pose {
            self.said.measurement = self.measurement();
        }
        for (volts, code) in self.battery.voltages().iter().zip(&mut self.voltages) {
            *code = CellCode::from_volts(0, *volts).voltage;
        }
    }

    /// A distance, and with the front one's the bearing that it was taken at.
    // Requirement: WIRE-bearing-3
    pub(super) fn sense_range(&mut self, which: RangefinderId) {
        if which == RangefinderId::Front {
            self.said.bearing = self.rangefinders.reading(which).bearing;
        }
        if let Some(range) = self.said.ranges.get_mut(which as usize) {
            *range = DistanceCode::from_distance(self.rangefinders.distance(which));
        }
    }

    /// The reply has gone out with a frame: the next one has a new sequence number and the next
    /// cell. Once per frame, before [`Self::refresh_reply`] writes that one.
    #[inline]
    pub fn reply_gone(&mut self) {
        (self.cell, _) = self.battery.walk();
        self.link.advance();
    }

    /// Writes the reply to the next frame, with a new sequence number and the next cell; returns
    /// its length. Once per received frame.
    pub fn next_reply(&mut self, out: &mut [u8; MAX_FRAME]) -> usize {
        self.reply_gone();
        self.refresh_reply(out)
    }

    /// Writes the same reply again with the newest data; returns its length. After a tick.
    #[inline]
    pub fn refresh_reply(&mut self, out: &mut [u8; MAX_FRAME]) -> usize {
        self.report(self.cell);
        self.link.resend(&self.said, out)
    }

    /// Writes the reply after that one, in advance, for a frame that ends while the robot is busy:
    /// what [`Self::next_reply`] would write if nothing happened until then. Returns its length.
    pub fn following_reply(&mut self, out: &mut [u8; MAX_FRAME]) -> usize {
        self.report(self.battery.upcoming());
        self.link.anticipate(&self.said, out)
    }

    /// What only the moment of a reply decides.
    // Requirement: DOC-5.2.1-2, DOC-5.2.2-4, DOC-5.2.3-3
    #[inline]
    pub(super) fn report(&mut self, cell: u8) {
        let voltage = self.voltages.get(usize::from(cell)).copied();
        self.said.cell = CellCode {
            cell,
            voltage: voltage.unwrap_or_default(),
        };
        self.said.faults = self.supervisor.faults();
        self.said.state = self.supervisor.state();
    }

    /// Rotation in degrees or displacement in millimetres since reset.
    // Requirement: WIRE-modes-3, WIRE-modes-4
    pub(super) fn measurement(&self) -> Binary64 {
        match self.measure {
            Measure::Pose => Binary64::default(),
            Measure::Rotation => Binary64::from_scaled(self.turned.saturating_mul(360), 32),
            Measure::Displacement => Binary64::from_scaled(self.travelled, 16),
        }
    }
}
