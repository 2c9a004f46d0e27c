//! Rangefinders, their servo, and the air that sound travels in.

use super::Robot;
use crate::log::Log;
use crate::sensing::{Calibration, Echo, EchoStats, Reading, Thermometer};
use crate::types::{Micros, RangefinderId};
use crate::wire::State;

impl Robot {
    /// The servo's pulse and the rangefinder to trigger. Without frames, or where a fault has
    /// stopped it: the servo rests.
    // Requirement: WIRE-servo-1
    pub(super) fn update_ranging(&mut self, now: Micros) -> (Option<u16>, Option<RangefinderId>) {
        let live = self.supervisor.link_alive(now) && self.supervisor.state() != State::Faulted;
        let servo = self.servo_scan.tick(live);
        if self.servo_scan.is_off() {
            self.rangefinders.invalidate();
        }
        let trigger = self.rangefinders.tick(
            now,
            self.servo_scan.settled_bearing(),
            self.servo_scan.is_scanning(),
        );
        if trigger == Some(RangefinderId::Front) {
            self.servo_scan.triggered();
        }
        (servo, trigger)
    }

    /// A measurement of the front rangefinder that has ended.
    pub(super) fn update_obstacle(&mut self) {
        let Reading { echo, bearing } = self.rangefinders.reading(RangefinderId::Front);
        match echo {
            Echo::Distance(distance) => self.obstacle.on_range(bearing, Some(distance)),
            // Void readings, while the servo rests, are as good as none.
            Echo::OutOfRange | Echo::Missing | Echo::NotMeasured => {
                self.obstacle.on_range(bearing, None);
            }
            Echo::TimedOut => {}
        }
    }

    /// An echo of the rangefinder triggered last: both edges on the robot's clock.
    pub fn on_echo(&mut self, which: RangefinderId, rise: Micros, fall: Micros) {
        self.rangefinders.echo(which, rise, fall);
        self.update_range(which);
    }

    /// The factory's words for the temperature sensor; without them sound is taken at 343 m/s.
    pub fn calibrate(&mut self, calibration: Calibration) {
        self.thermometer = Thermometer::new(calibration);
    }

    /// The words of the chip's temperature sensor and of its voltage reference, once a second or so:
    /// how fast sound travels from now on.
    pub fn on_temperature(&mut self, sensor: u16, reference: u16, log: &mut Log) {
        let air = self.thermometer.read(sensor, reference);
        self.rangefinders.set_temperature(air);
        self.event_log.temperature(air, log);
    }

    /// How a rangefinder's triggers ended so far.
    pub fn stats(&self, which: RangefinderId) -> EchoStats {
        self.rangefinders.stats(which)
    }
}
