//! The gyroscope in the robot: its transfers, tick by tick, and its rate against the encoders'.

use super::Robot;
use crate::log::{Level, Log};
use crate::sensing::gyro::{self, Event, GyroFusion};
use crate::sensing::mpu6050::{BusRequest, BusResult, DeviceError, GyroReading, Mpu6050};
use crate::types::{Delta, Faults, HeadingCorrection};

/// Fuses the gyroscope into the heading while a wheel slips.
#[derive(Clone, Debug)]
pub(super) struct SlipMonitor {
    mpu: Mpu6050,
    gyro: GyroFusion,
    /// Unreliable, until it has agreed with the wheels again.
    lost: bool,
    /// Added to the last tick's turn, 2⁻³² turns.
    added: i32,
    /// Added to the heading since the data last changed, 2⁻³² turns: void if they are frozen.
    unconfirmed: i32,
}

impl SlipMonitor {
    /// No transfer yet.
    pub(super) const fn new() -> Self {
        Self {
            mpu: Mpu6050::new(),
            gyro: GyroFusion::new(),
            lost: false,
            added: 0,
            unconfirmed: 0,
        }
    }

    /// The gyroscope's own angle, 2⁻³² turns, see [`GyroFusion::angle`].
    pub(super) fn angle(&self) -> Option<i64> {
        self.gyro.angle()
    }

    /// Adds the last tick's slip to the turn that the controller sees.
    pub(super) const fn add_to(&self, delta: &mut Delta) {
        delta.turn = delta.turn.wrapping_add(self.added);
    }
}

impl Robot {
    /// Before every tick: takes the result of the last request to the MPU6050, returns the next one. The
    /// rate was read just after the last tick and with its filter's delay is that tick's mean rate.
    ///
    /// Without a gyroscope in the configuration, and in the tuning modes, which measure the wheels,
    /// every request is idle.
    // Requirement: DOC-2.3-3, WIRE-fault-12, WIRE-fault-13
    pub fn on_gyro(&mut self, result: BusResult, log: &mut Log) -> BusRequest {
        if !self.gyro_enabled {
            return BusRequest::Idle;
        }
        let monitor = &mut self.slip_monitor;
        let (request, reading) = monitor.mpu.step(result);
        let rate = match reading {
            GyroReading::Rate(raw) => Some(raw),
            GyroReading::None => None,
            GyroReading::Lost(error) => {
                monitor.gyro = GyroFusion::new();
                monitor.lost = true;
                if error == DeviceError::Frozen {
                    let heading = monitor.unconfirmed.wrapping_neg();
                    let correction = HeadingCorrection { heading, tick: 0 };
                    self.odometry.apply_slip(correction, &self.delta);
                }
                log.line(Level::Warn, |line| {
                    line.text("gyro: ")
                        .text(error.reason())
                        .text(", encoders alone");
                });
                None
            }
        };
        let turn = self.delta.turn.wrapping_sub(monitor.added);
        let (correction, event) = monitor.gyro.step(rate, &self.delta, turn);
        monitor.added = correction.tick;
        monitor.unconfirmed = if monitor.mpu.repeats() {
            monitor.unconfirmed.wrapping_add(correction.heading)
        } else {
            0
        };
        if correction != HeadingCorrection::default() {
            self.odometry.apply_slip(correction, &self.delta);
        }
        if let Some(event) = event {
            match event {
                Event::Trusted => monitor.lost = false,
                Event::SlipTimedOut | Event::Mismatch => monitor.lost = true,
                Event::SlipStarted => self.supervisor.raise(Faults::SLIP),
                Event::BiasUpdated(_) | Event::SlipEnded(_) => {}
            }
            log_event(event, log);
        }
        if monitor.lost {
            self.supervisor.raise(Faults::GYRO_LOST);
        }
        request
    }
}

#[cold]
fn log_event(event: Event, log: &mut Log) {
    let level = match event {
        Event::BiasUpdated(_) | Event::Trusted | Event::SlipEnded(_) => Level::Info,
        Event::SlipStarted | Event::SlipTimedOut | Event::Mismatch => Level::Warn,
    };
    log.line(level, |line| {
        match event {
            Event::BiasUpdated(bias) => line
                .text("gyro: bias ")
                .decimal(gyro::hundredths(bias).into(), 2)
                .text(" deg/s"),
            Event::Trusted => line.text("gyro: agrees with the wheels"),
            Event::SlipStarted => line.text("slip: heading by the gyro"),
            Event::SlipEnded(added) => line
                .text("slip over: heading corrected by ")
                .decimal((added >> 8).saturating_mul(36_000) >> 24, 2)
                .text(" deg"),
            Event::SlipTimedOut => line.text("gyro: slip timed out, encoders alone"),
            Event::Mismatch => line.text("gyro: contradicts the wheels, encoders alone"),
        };
    });
}

#[cfg(test)]
mod tests;
