//! A hobby servo: turns towards the angle of the last pulse with limited speed.

/// The figures of a servo.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ServoParams {
    /// Radians from a pulse of 1.0 ms to one of 2.0 ms; positive where a longer pulse turns
    /// counter-clockwise.
    pub travel_rad: f64,
    /// Largest speed, radians per second.
    pub slew_rad_s: f64,
}

impl Default for ServoParams {
    /// ±90°, 60° in 0.15 s, as small servos at 4.8 V.
    fn default() -> Self {
        Self {
            travel_rad: std::f64::consts::PI,
            slew_rad_s: 400f64.to_radians(),
        }
    }
}

/// Time constant of settling at the target, seconds. This and the next two are typical of such parts.
const SETTLE_S: f64 = 0.003;
/// Dead band around the target, microseconds of pulse width.
const DEAD_BAND_US: f64 = 1.0;
/// Seconds without a pulse until the motor is released.
const TIMEOUT_S: f64 = 0.05;
/// Pulse widths outside of these, microseconds, are ignored.
const PULSES_US: (f64, f64) = (800.0, 2200.0);

/// A servo.
#[derive(Clone, Copy, Debug)]
pub struct Servo {
    params: ServoParams,
    /// Angle, radians counter-clockwise from the middle of its travel; a change turns it from outside.
    pub angle_rad: f64,
    target_rad: f64,
    /// Seconds since the last pulse.
    since_s: f64,
}

impl Servo {
    /// A released servo in the middle of its travel.
    pub const fn new(params: ServoParams) -> Self {
        Self {
            params,
            angle_rad: 0.0,
            target_rad: 0.0,
            since_s: f64::INFINITY,
        }
    }

    /// A pulse of this width has just ended.
    pub fn pulse(&mut self, width_us: f64) {
        if width_us >= PULSES_US.0 && width_us <= PULSES_US.1 {
            self.target_rad = (width_us - 1500.0) / 1000.0 * self.params.travel_rad;
            self.since_s = 0.0;
        }
    }

    /// Lets `dt_s` seconds pass.
    pub fn step(&mut self, dt_s: f64) {
        self.since_s += dt_s;
        let error = self.target_rad - self.angle_rad;
        let dead = DEAD_BAND_US / 1000.0 * self.params.travel_rad.abs();
        if self.since_s > TIMEOUT_S || error.abs() < dead {
            return;
        }
        let eased = error * (1.0 - libm::exp(-dt_s / SETTLE_S));
        let most = self.params.slew_rad_s * dt_s;
        self.angle_rad += eased.clamp(-most, most);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Sends pulses of `width_us` 50 times a second for `ms`; the angle then, degrees.
    fn run(servo: &mut Servo, width_us: f64, ms: u32) -> f64 {
        for k in 0..ms {
            if k % 20 == 0 {
                servo.pulse(width_us);
            }
            servo.step(0.001);
        }
        servo.angle_rad.to_degrees()
    }

    #[test]
    fn turn_takes_slew_time_and_settling() {
        let mut servo = Servo::new(ServoParams::default());
        let turning = run(&mut servo, 2000.0, 200);
        assert!((75.0..85.0).contains(&turning), "{turning}");
        assert!((run(&mut servo, 2000.0, 50) - 90.0).abs() < 0.5);
        assert!((run(&mut servo, 1000.0, 500) + 90.0).abs() < 0.5);
        let ten_degrees = 1500.0 + 1000.0 / 18.0;
        let mut servo = Servo::new(ServoParams::default());
        assert!(run(&mut servo, ten_degrees, 20) < 8.1);
        assert!((run(&mut servo, ten_degrees, 18) - 10.0).abs() < 0.3);
    }

    #[test]
    fn missing_or_invalid_pulses_leave_angle_unchanged() {
        let mut servo = Servo::new(ServoParams::default());
        run(&mut servo, 2000.0, 50);
        for _ in 0..500 {
            servo.step(0.001);
        }
        let stopped_at = servo.angle_rad.to_degrees();
        assert!(stopped_at < 45.0);
        for invalid_us in [300.0, 5000.0] {
            assert!((run(&mut servo, invalid_us, 500) - stopped_at).abs() < 1e-9);
        }
    }
}
