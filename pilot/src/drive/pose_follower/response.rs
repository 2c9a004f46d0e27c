//! The core's response to a velocity: a ramp with the configured acceleration, then two lags.

use fw_core::eeprom::{Config, Wheel};
use std::f64::consts::PI;

/// Share of the slower wheel's full speed that is driven at: the rest is for steering.
const HEADROOM: f64 = 0.9;
/// Step of the prediction, s, and the part of a lag that passes in it: the core's is 1/8 in 10 ms.
const STEP_S: f64 = 0.005;
const LAG_SHARE: f64 = 0.0646;
/// Speed of a wheel below which the core brakes it if it is to stand, mm/s.
pub const BRAKED_MM_S: f64 = 10.0;

/// A pair of forward and yaw: mm and degrees, or mm/s and degrees/s.
pub type Axes = [f64; 2];

/// Figures of the robot that the response depends on.
#[derive(Clone, Copy, Debug)]
pub struct Limits {
    /// Largest speeds commanded, and back, mm/s.
    pub speed: Axes,
    pub reverse_mm_s: f64,
    /// mm/s² and degrees/s².
    pub acceleration: Axes,
    /// Of a wheel, mm/s.
    full_speed_mm_s: f64,
    /// Speed of a wheel per yaw rate, mm per degree.
    pub wheel_per_deg: f64,
}

impl Limits {
    pub fn new(config: &Config) -> Self {
        let limits = config.velocity_limits();
        let degrees = |turns: u32| f64::from(turns) / 4_294_967_296.0 * 360.0;
        let full_speed = |wheel: &Wheel| {
            let [dead_zone, limit] =
                [wheel.dead_zone, wheel.limit].map(|duty| f64::from(duty.hundredths()));
            f64::from(wheel.full_speed_mm_s) * (limit - dead_zone) / (10_000.0 - dead_zone)
        };
        let full_speed_mm_s = full_speed(config.left()).min(full_speed(config.right()));
        let wheel_per_deg = f64::from(config.track().0) / 1000.0 * PI / 360.0;
        let fastest = HEADROOM * full_speed_mm_s;
        Self {
            speed: [
                fastest.min(limits.speed_mm_s.into()),
                // Steering comes on top of it.
                (0.5 * fastest / wheel_per_deg).min(degrees(limits.yaw_rate)),
            ],
            reverse_mm_s: config.obstacle_stop().reverse_speed_mm_s.into(),
            acceleration: [
                limits.acceleration_mm_s2.into(),
                degrees(limits.yaw_acceleration),
            ],
            full_speed_mm_s,
            wheel_per_deg,
        }
    }
}

/// How the core follows a velocity.
#[derive(Clone, Copy, Debug, Default)]
pub struct Response {
    /// The commanded speeds within the acceleration, and behind one and two lags.
    pub ramp: Axes,
    first: Axes,
    pub second: Axes,
    /// Time beyond the last step, s.
    beyond_s: f64,
}

impl Response {
    /// Lets a step pass; the way and the turn.
    pub fn step(&mut self, command: Axes, limits: &Limits) -> Axes {
        let commanded = command.into_iter().zip(limits.acceleration);
        for (ramp, (command, acceleration)) in self.ramp.iter_mut().zip(commanded) {
            let most = acceleration * STEP_S;
            *ramp += (command - *ramp).clamp(-most, most);
        }
        // The core's feed-forward: a wheel that would need more than full duty slows the way, or the turn.
        let drive = |axis: usize| 4.0 * (self.ramp[axis] - self.first[axis]) + self.second[axis];
        let (forward, yaw) = (drive(0), drive(1) * limits.wheel_per_deg);
        let excess = forward.abs() + yaw.abs() - limits.full_speed_mm_s;
        if excess > 0.0 {
            let (axis, less) = if forward * self.ramp[0] > 0.0 {
                (0, excess / 4.0)
            } else {
                (1, excess / 4.0 / limits.wheel_per_deg)
            };
            let ramp = &mut self.ramp[axis];
            *ramp -= ramp.signum() * less.min(ramp.abs());
        }
        for axis in 0..2 {
            self.first[axis] += (self.ramp[axis] - self.first[axis]) * LAG_SHARE;
            self.second[axis] += (self.first[axis] - self.second[axis]) * LAG_SHARE;
        }
        let wheel = self.second[0].abs() + self.second[1].abs() * limits.wheel_per_deg;
        if is_zero(command) && is_zero(self.ramp) && wheel < BRAKED_MM_S {
            *self = Self::default();
        }
        self.second.map(|speed| speed * STEP_S)
    }

    /// Whether it has come to rest.
    pub fn stands(&self) -> bool {
        is_zero(self.ramp) && is_zero(self.second)
    }

    /// The way and the turn within so many seconds.
    pub fn run(&mut self, command: Axes, seconds: f64, limits: &Limits) -> Axes {
        let (mut moved, mut left_s) = ([0.0; 2], self.beyond_s + seconds);
        while left_s > STEP_S / 2.0 {
            let step = self.step(command, limits);
            moved = [moved[0] + step[0], moved[1] + step[1]];
            left_s -= STEP_S;
        }
        self.beyond_s = left_s;
        moved
    }

    /// The way and the turn until it rests, after a command that lasts so many seconds.
    pub fn rest(mut self, command: Axes, seconds: f64, limits: &Limits) -> Axes {
        let mut moved = self.run(command, seconds, limits);
        while !self.stands() {
            let step = self.step([0.0; 2], limits);
            moved = [moved[0] + step[0], moved[1] + step[1]];
        }
        moved
    }
}

/// Whether nothing moves.
pub fn is_zero(axes: Axes) -> bool {
    axes.iter().all(|value| value.abs() < 1e-9)
}
