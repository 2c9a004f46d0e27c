//! The gyroscope's part in the robot: its conversation goes on, tick by tick, and what it says of the
//! last tick's turn is set against the encoders'.

use super::Robot;
use crate::log::{Level, Log};
use crate::sensing::gyro::{self, Event, GyroFusion};
use crate::sensing::mpu6050::{BusRequest, BusResult, GyroReading, Mpu6050};
use crate::types::{Delta, Faults, HeadingCorrection};

/// Who watches over the heading.
#[derive(Clone, Debug)]
pub(super) struct Guard {
    mpu: Mpu6050,
    gyro: GyroFusion,
    /// Not to be relied on since it was last said; until it has agreed with the wheels again.
    lost: bool,
    /// What the gyroscope added to the last tick's turn, 2⁻³² turns.
    added: i32,
}

impl Guard {
    /// Nothing asked yet.
    pub(super) const fn new() -> Self {
        Self {
            mpu: Mpu6050::new(),
            gyro: GyroFusion::new(),
            lost: false,
            added: 0,
        }
    }

    /// While a wheel slips the controller's turn is the robot's, as of the tick before.
    pub(super) const fn add_to(&self, delta: &mut Delta) {
        delta.turn = delta.turn.wrapping_add(self.added);
    }
}

impl Robot {
    /// Before every tick: what became of the last order to the MPU6050, and the next one. Its rate was
    /// read just after the last tick and with its filter's delay is that tick's mean rate.
    ///
    /// Without a gyroscope in the configuration, and in the tuning modes, which measure the wheels,
    /// there is never an order.
    // Requirement: DOC-2.3-3, WIRE-fault-12, WIRE-fault-13
    pub fn on_gyro(&mut self, outcome: BusResult, log: &mut Log) -> BusRequest {
        if !self.guarded {
            return BusRequest::Idle;
        }
        let guard = &mut self.guard;
        let (order, news) = guard.mpu.step(outcome);
        let mut events = [None; 2];
        let reading = match news {
            GyroReading::Rate(raw) => Some(raw),
            GyroReading::None => None,
            GyroReading::Lost(trouble) => {
                events[0] = guard.gyro.reset();
                guard.lost = true;
                log.line(Level::Warn, |line| {
                    line.text("gyro: ")
                        .text(trouble.reason())
                        .text(", encoders alone");
                });
                None
            }
        };
        let turn = self.delta.turn.wrapping_sub(guard.added);
        let correction;
        (correction, events[1]) = guard.gyro.step(reading, &self.delta, turn);
        guard.added = correction.tick;
        if correction != HeadingCorrection::default() {
            self.odometry.apply_slip(correction, &self.delta);
        }
        for event in events.into_iter().flatten() {
            match event {
                Event::Trusted => guard.lost = false,
                Event::SlipTimedOut | Event::Mismatch => guard.lost = true,
                Event::SlipStarted => self.supervisor.raise(Faults::SLIP),
                Event::BiasUpdated(_) | Event::SlipEnded(_) => {}
            }
            tell(event, log);
        }
        if guard.lost {
            self.supervisor.raise(Faults::GYRO_LOST);
        }
        order
    }
}

#[cold]
fn tell(event: Event, log: &mut Log) {
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
            Event::SlipStarted => line.text("slip: the heading follows the gyro"),
            Event::SlipEnded(added) => line
                .text("slip over: heading corrected by ")
                .decimal((added >> 8).saturating_mul(36_000) >> 24, 2)
                .text(" deg"),
            Event::SlipTimedOut => line.text("gyro: slip too long to be true, encoders alone"),
            Event::Mismatch => line.text("gyro: contradicts the wheels, encoders alone"),
        };
    });
}

#[cfg(test)]
mod tests;
