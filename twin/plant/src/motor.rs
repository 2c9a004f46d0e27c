//! A geared motor behind its half of the L298P, with the wheel on it.
//!
//! # The model
//! The bridge's duty sets a speed that the wheel follows through two first-order lags:
//! `target = curve(|duty|)`, `drive' = (target − drive)/lag`, `speed' = (drive − speed)/lag`.
//! The curve is zero below the dead zone and straight between the speeds at 50, 75 and 100 %: the
//! "gain · (|duty| − dead zone)" of the first board's notes, with a gain of its own for each part,
//! because the left motor's speed rises far more than in proportion above 75 %. The share of the dry
//! friction that the drive does not overcome (all of it at duty 0, none from the dead zone on)
//! decelerates the wheel at `friction_deg_s2` and brings it to a full stop.
//!
//! # Where the figures come from
//! Least-squares fit to steps of ±50, ±75 and ±100 % for 1.3 s to 4 s, followed by coasting to
//! rest, logged on the first board at 100 Hz: one set of parameters per motor for all six logs.
//! Worst residuals over the whole of a log: left 3.3 % in the final angle and 10.2° RMS, right 2.4 %
//! and 11.0° RMS. The rest is the board's own scatter (the same duty forward and backward
//! differs by 5 %). The dead zones are the board's notes'; nominal supply, breakaway, brake and
//! winding figures are assumptions.

/// Duty beyond the dead zone that starts a wheel at rest.
const BREAKAWAY: f64 = 0.02;
/// Lag of the shorted motor, s.
const BRAKE_LAG_S: f64 = 0.04;
/// Supply at which the speeds hold, V.
const NOMINAL_V: f64 = 7.4;
/// What the L298P's two transistors in series drop, V.
const BRIDGE_DROP_V: f64 = 2.0;
/// Resistance of winding and transistors, ohm.
const WINDING_OHM: f64 = 3.6;

/// What the bridge applies to one motor.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct MotorInput {
    /// Share of the supply that the bridge applies, −1..=1; positive = forward. With 0 and no brake
    /// the wheel coasts.
    pub duty: f64,
    /// Both bridge inputs alike: the share of the time in which the enable shorts the motor, 0..=1. Overrides
    /// `duty`.
    pub brake: f64,
}

impl MotorInput {
    /// The enable low: the wheel rolls freely.
    pub const COAST: Self = Self::run(0.0);
    /// The motor shorted.
    pub const BRAKE: Self = Self {
        duty: 0.0,
        brake: 1.0,
    };

    /// Driven with this duty, −1..=1.
    pub const fn run(duty: f64) -> Self {
        Self { duty, brake: 0.0 }
    }
}

/// One motor's figures. Speeds are the wheel's, in degrees per second.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MotorParams {
    /// Duty below which friction holds the turning wheel, 0..0.5, at nominal supply.
    pub dead_zone: f64,
    /// Steady speed at 50, 75 and 100 % duty and nominal supply, °/s.
    pub speeds_deg_s: [f64; 3],
    /// Each of the two lags, s.
    pub lag_s: f64,
    /// Deceleration of the undriven wheel by dry friction, °/s².
    pub friction_deg_s2: f64,
}

impl MotorParams {
    /// The first board's left motor.
    pub const fn first_board_left() -> Self {
        Self {
            dead_zone: 0.16,
            speeds_deg_s: [98.83, 150.55, 266.23],
            lag_s: 0.1849,
            friction_deg_s2: 367.2,
        }
    }

    /// The first board's right motor.
    pub const fn first_board_right() -> Self {
        Self {
            dead_zone: 0.23,
            speeds_deg_s: [129.14, 235.90, 331.06],
            lag_s: 0.1516,
            friction_deg_s2: 401.9,
        }
    }

    /// Steady speed for a duty ≥ 0 at nominal supply, °/s; the last part's slope continues above 1.
    fn curve(&self, duty: f64) -> f64 {
        let [half, three_quarters, full] = self.speeds_deg_s;
        if duty <= self.dead_zone {
            0.0
        } else if duty <= 0.5 {
            half * (duty - self.dead_zone) / (0.5 - self.dead_zone)
        } else if duty <= 0.75 {
            half + (three_quarters - half) * (duty - 0.5) * 4.0
        } else {
            three_quarters + (full - three_quarters) * (duty - 0.75) * 4.0
        }
    }
}

/// Share of the nominal motor voltage that a supply of `volts` leaves after the bridge's drop.
fn supply_share(volts: f64) -> f64 {
    ((volts - BRIDGE_DROP_V) / (NOMINAL_V - BRIDGE_DROP_V)).max(0.0)
}

/// One motor's state.
#[derive(Clone, Debug)]
pub struct Motor {
    params: MotorParams,
    drive: f64,
    speed: f64,
    current_a: f64,
}

impl Motor {
    /// A motor at rest.
    pub const fn new(params: MotorParams) -> Self {
        Self {
            params,
            drive: 0.0,
            speed: 0.0,
            current_a: 0.0,
        }
    }

    /// Advances by `dt` seconds (at most a few milliseconds) with the bridge fed from `volts`, and
    /// returns how far the wheel turned forward, in degrees.
    pub fn step(&mut self, dt: f64, input: MotorInput, volts: f64) -> f64 {
        let p = &self.params;
        let applied = if input.brake > 0.0 {
            0.0
        } else {
            input.duty.clamp(-1.0, 1.0) * supply_share(volts)
        };
        let pull = applied.abs();
        let held = self.speed == 0.0 && self.drive == 0.0 && pull < p.dead_zone + BREAKAWAY;
        if held {
            self.current_a = self.draw(input, applied);
            return 0.0;
        }
        let target = p.curve(pull).copysign(applied);
        let before = self.speed;
        if input.brake > 0.0 {
            self.drive = 0.0;
            self.speed -= self.speed * (dt * input.brake / BRAKE_LAG_S).min(1.0);
        } else {
            self.drive += (target - self.drive) * (dt / p.lag_s).min(1.0);
            self.speed += (self.drive - self.speed) * (dt / p.lag_s).min(1.0);
        }
        let unbalanced = (1.0 - pull / p.dead_zone).max(0.0);
        let lost = p.friction_deg_s2 * unbalanced * dt;
        if lost > 0.0 && self.speed.abs() <= lost {
            self.speed = 0.0;
            self.drive = 0.0;
        } else {
            self.speed -= lost.copysign(self.speed);
        }
        self.current_a = self.draw(input, applied);
        f64::midpoint(before, self.speed) * dt
    }

    /// Current out of the battery, averaged over the PWM's period, ampere. A motor that runs faster
    /// than it is driven returns none: the bridge's diodes dissipate it.
    fn draw(&self, input: MotorInput, applied: f64) -> f64 {
        if input.brake > 0.0 {
            return 0.0;
        }
        let full_v = NOMINAL_V - BRIDGE_DROP_V;
        // 95 % of the voltage is generated back at full speed, 5 % feeds friction.
        let back_v = 0.95 * full_v * self.speed / self.params.speeds_deg_s[2];
        let amperes = (applied * full_v - back_v) / WINDING_OHM;
        (amperes * input.duty.clamp(-1.0, 1.0)).max(0.0)
    }

    /// Speed of the wheel, °/s, positive forward.
    pub fn speed_deg_s(&self) -> f64 {
        self.speed
    }

    /// Current that the motor draws from the battery, ampere.
    pub fn current_a(&self) -> f64 {
        self.current_a
    }

    /// Stops the wheel at once.
    pub fn block(&mut self) {
        self.speed = 0.0;
        self.drive = 0.0;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const LEFT: MotorParams = MotorParams::first_board_left();
    const RIGHT: MotorParams = MotorParams::first_board_right();

    /// Degrees turned in `ms` milliseconds at nominal supply.
    fn run(motor: &mut Motor, input: MotorInput, ms: u32) -> f64 {
        (0..ms).map(|_| motor.step(0.001, input, NOMINAL_V)).sum()
    }

    #[test]
    fn measured_steps_end_within_five_percent() {
        // Duty, milliseconds it was applied and final wheel angle in degrees, as measured.
        let left = [
            (0.5, 3700, 335.0),
            (0.75, 2450, 350.0),
            (1.0, 2080, 515.0),
            (-0.5, 4000, -381.0),
            (-0.75, 2450, -329.0),
            (-1.0, 1270, -302.0),
        ];
        let right = [
            (0.5, 3700, 466.0),
            (0.75, 2450, 555.0),
            (1.0, 2080, 654.0),
            (-0.5, 4000, -484.0),
            (-0.75, 2450, -547.0),
            (-1.0, 1270, -392.0),
        ];
        for (params, steps) in [(LEFT, left), (RIGHT, right)] {
            for (duty, on_ms, measured) in steps {
                let mut motor = Motor::new(params);
                let driven = run(&mut motor, MotorInput::run(duty), on_ms);
                let angle = driven + run(&mut motor, MotorInput::COAST, 2000);
                assert!(motor.speed_deg_s().abs() < f64::EPSILON, "still turning");
                let ratio = angle / measured;
                assert!((ratio - 1.0).abs() < 0.05, "{duty}: {angle} for {measured}");
            }
        }
    }

    #[test]
    fn duty_below_breakaway_keeps_wheel_turning_but_never_starts_it() {
        let mut motor = Motor::new(LEFT);
        assert!(run(&mut motor, MotorInput::run(0.175), 1000) == 0.0);
        assert!(motor.current_a() > 0.0);
        run(&mut motor, MotorInput::run(0.2), 1000);
        assert!(motor.speed_deg_s() > 1.0);
        run(&mut motor, MotorInput::run(0.175), 3000);
        assert!(motor.speed_deg_s() > 1.0);
    }

    #[test]
    fn brake_stops_three_times_shorter_than_coasting() {
        let stopping_deg = |input| {
            let mut motor = Motor::new(RIGHT);
            run(&mut motor, MotorInput::run(1.0), 1500);
            run(&mut motor, input, 2000)
        };
        let braked_deg = stopping_deg(MotorInput::BRAKE);
        assert!(braked_deg * 3.0 < stopping_deg(MotorInput::COAST));
        let weakly = MotorInput {
            brake: 0.2,
            ..MotorInput::BRAKE
        };
        assert!(stopping_deg(weakly) > braked_deg * 2.0);
    }

    #[test]
    fn steady_speed_follows_voltage_behind_bridge_and_sign_of_duty() {
        let speed = |duty: f64, volts: f64| {
            let mut motor = Motor::new(RIGHT);
            run(&mut motor, MotorInput::run(-duty), 1000);
            for _ in 0..3000 {
                motor.step(0.001, MotorInput::run(duty), volts);
            }
            motor.speed_deg_s()
        };
        assert!((speed(1.0, 7.4) - 331.06).abs() < 0.1);
        assert!((speed(-1.0, 7.4) + 331.06).abs() < 0.1);
        assert!(speed(1.0, 8.4) > speed(1.0, 7.4) && speed(1.0, 6.0) < speed(1.0, 7.4));
        assert!(speed(1.0, 1.9).abs() < 1e-9);
    }
}
