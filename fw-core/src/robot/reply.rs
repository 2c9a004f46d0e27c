//! The reply: sensor values are converted to the wire's codes when they change; a reply, which must be
//! ready before the next frame, only copies them.

use super::{MeasuredQuantity, Robot};
use crate::binary64::Binary64;
use crate::types::{Pose, RangefinderId};
use crate::wire::handover::SAME_PREFIX;
use crate::wire::{CellCode, DistanceCode, GyroCode, MAX_FRAME, PoseCode};

impl Robot {
    /// Pose, measurement and voltages of a tick, in the wire's codes.
    // Requirement: DOC-2.1-4, WIRE-spi-6
    pub(super) fn update_report(&mut self, pose: &Pose) {
        self.report.pose = PoseCode::from_pose(pose);
        // Requirement: WIRE-gyro-3
        self.report.gyro = self
            .slip_monitor
            .angle()
            .map_or(GyroCode::NONE, GyroCode::from_angle);
        if self.quantity != MeasuredQuantity::Pose {
            self.report.measurement = self.measurement();
        }
        for (volts, code) in self.battery.voltages().iter().zip(&mut self.voltages) {
            *code = CellCode::from_volts(0, *volts).voltage;
        }
    }

    /// A distance, and the bearing of the front one.
    // Requirement: WIRE-bearing-3
    pub(super) fn update_range(&mut self, which: RangefinderId) {
        if which == RangefinderId::Front {
            self.report.bearing = self.rangefinders.reading(which).bearing;
        }
        if let Some(range) = self.report.ranges.get_mut(which as usize) {
            *range = DistanceCode::from_distance(self.rangefinders.distance(which));
        }
    }

    /// Writes reply `number`, counted from 1 after a reset, with the newest data; returns its length.
    /// The number decides the sequence number and the cell, so a reply may be written again, or in
    /// advance, in any order.
    // Requirement: DOC-5.2.1-2, DOC-5.2.2-4, DOC-5.2.3-3, WIRE-battery-1
    #[inline]
    pub fn encode_reply(&mut self, number: u32, out: &mut [u8; MAX_FRAME]) -> usize {
        // In place: a copy of the report costs a dozen instructions.
        self.report.cell = self.cell_of_reply(number);
        self.report.faults = self.supervisor.faults();
        self.report.state = self.supervisor.state();
        self.link.encode_reply(number, &self.report, out)
    }

    /// Writes reply `number` again, in guarded modes with the key, sequence and status that it begins with on
    /// its way.
    // Requirement: WIRE-spi-6
    #[inline]
    pub fn refresh_reply(
        &mut self,
        number: u32,
        begin: [u8; SAME_PREFIX],
        out: &mut [u8; MAX_FRAME],
    ) {
        let len = self.encode_reply(number, out);
        self.link.keep_begin(begin, out, len);
    }

    /// One cell a reply, in turn. After 2³² replies one cell may be repeated or left out.
    fn cell_of_reply(&self, number: u32) -> CellCode {
        let cells = u32::from(self.battery.cells());
        let cell = number.wrapping_sub(1).checked_rem(cells).unwrap_or(0) & 7;
        let voltage = self.voltages.get(cell as usize).copied();
        CellCode {
            cell: cell as u8,
            voltage: voltage.unwrap_or_default(),
        }
    }

    /// Adds the last tick's motion to what is measured.
    // Only the tuning modes measure; inline it costs the other modes' tick.
    #[cold]
    pub(super) fn measure(&mut self) {
        let moved = match self.quantity {
            MeasuredQuantity::Displacement => self.delta.travel.to_bits(),
            MeasuredQuantity::Rotation | MeasuredQuantity::Pose => self.delta.turn,
        };
        self.measured = self.measured.wrapping_add(moved.into());
    }

    /// Rotation in degrees or displacement in millimetres since reset.
    // Requirement: WIRE-modes-3, WIRE-modes-4
    pub(super) fn measurement(&self) -> Binary64 {
        match self.quantity {
            MeasuredQuantity::Pose => Binary64::default(),
            MeasuredQuantity::Rotation => {
                Binary64::from_scaled(self.measured.saturating_mul(360), 32)
            }
            MeasuredQuantity::Displacement => Binary64::from_scaled(self.measured, 16),
        }
    }
}
