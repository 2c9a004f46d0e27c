//! A hobby servo: turns towards the angle of the last pulse, as fast as it can and no faster.

/// The figures of a servo.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ServoParams {
    /// Radians from a pulse of 1.0 ms to one of 2.0 ms; positive where a longer pulse turns
    /// counter-clockwise.
    pub travel_rad: f64,
    /// Largest speed, radians per second.
    pub slew_rad_s: f64,
    /// Time constant of the last bit of a turn, seconds.
    pub settle_s: f64,
    /// A pulse nearer to where it stands than this, microseconds, moves it no further.
    pub dead_band_us: f64,
    /// Seconds without a pulse until it gives up its force.
    pub patience_s: f64,
}

impl Default for ServoParams {
    /// ±90°, 60° in 0.15 s, as small servos have at 4.8 V; the rest is a choice within what they show.
    fn default() -> Self {
        Self {
            travel_rad: std::f64::consts::PI,
            slew_rad_s: 400f64.to_radians(),
            settle_s: 0.003,
            dead_band_us: 1.0,
            patience_s: 0.05,
        }
    }
}

/// Pulses outside of these, microseconds, are no pulses.
const PULSES_US: (f64, f64) = (800.0, 2200.0);

/// A servo.
#[derive(Clone, Copy, Debug)]
pub struct Servo {
    params: ServoParams,
    angle_rad: f64,
    target_rad: f64,
    /// Seconds since the last pulse.
    since_s: f64,
}

impl Servo {
    /// A servo in the middle of its travel that nobody has sent a pulse.
    #[must_use]
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
        let dead = self.params.dead_band_us / 1000.0 * self.params.travel_rad.abs();
        if self.since_s > self.params.patience_s || error.abs() < dead {
            return;
        }
        let eased = error * (1.0 - (-dt_s / self.params.settle_s).exp());
        let most = self.params.slew_rad_s * dt_s;
        self.angle_rad += eased.clamp(-most, most);
    }

    /// Where it stands, radians counter-clockwise from the middle of its travel.
    #[must_use]
    pub const fn angle_rad(&self) -> f64 {
        self.angle_rad
    }

    /// Somebody turns it by hand.
    pub const fn force(&mut self, angle_rad: f64) {
        self.angle_rad = angle_rad;
    }

    /// Its figures.
    #[must_use]
    pub const fn params(&self) -> &ServoParams {
        &self.params
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Sends pulses of `width_us` 50 times a second for `ms`.
    fn run(servo: &mut Servo, width_us: f64, ms: u32) {
        for k in 0..ms {
            if k % 20 == 0 {
                servo.pulse(width_us);
            }
            servo.step(0.001);
        }
    }

    #[test]
    fn it_takes_a_quarter_of_a_second_for_90_degrees_and_a_little_to_settle() {
        let mut servo = Servo::new(ServoParams::default());
        run(&mut servo, 2000.0, 200);
        let on_its_way = servo.angle_rad().to_degrees();
        assert!((75.0..85.0).contains(&on_its_way), "{on_its_way}");
        run(&mut servo, 2000.0, 50);
        assert!((servo.angle_rad().to_degrees() - 90.0).abs() < 0.5);
        run(&mut servo, 1000.0, 500);
        assert!((servo.angle_rad().to_degrees() + 90.0).abs() < 0.5);
    }

    #[test]
    fn ten_degrees_take_a_good_25_ms() {
        let mut servo = Servo::new(ServoParams::default());
        run(&mut servo, 1500.0 + 1000.0 / 18.0, 20);
        assert!(servo.angle_rad().to_degrees() < 8.1);
        run(&mut servo, 1500.0 + 1000.0 / 18.0, 18);
        assert!((servo.angle_rad().to_degrees() - 10.0).abs() < 0.3);
    }

    #[test]
    fn without_pulses_it_stands_and_a_wrong_pulse_is_none() {
        let mut servo = Servo::new(ServoParams::default());
        run(&mut servo, 2000.0, 50);
        for _ in 0..500 {
            servo.step(0.001);
        }
        let stands = servo.angle_rad();
        assert!(stands.to_degrees() < 45.0);
        run(&mut servo, 300.0, 500);
        run(&mut servo, 5000.0, 500);
        assert!((servo.angle_rad() - stands).abs() < 1e-12);
    }
}
