//! The figures of a robot, and how a seed makes them deviate.

use crate::imperfections::stream;
use crate::{
    BatteryParams, Chassis, Imperfections, MotorParams, Mount, RangefinderParams, Rng, ServoParams,
    Sides,
};

/// The figures of a robot. The default is the first board in a world without imperfections.
#[derive(Clone, Debug, PartialEq)]
pub struct Params {
    /// The motors.
    pub motors: Sides<MotorParams>,
    /// The battery.
    pub battery: BatteryParams,
    /// Wheels, track, encoders, body.
    pub chassis: Chassis,
    /// Where the rangefinders sit: front, right, left.
    pub mounts: [Mount; 3],
    /// Their beam and errors, and the air.
    pub rangefinder: RangefinderParams,
    /// The servo that turns the front one, if it is sent any pulses.
    pub servo: ServoParams,
    /// How much warmer the microcontroller is than the air, K.
    pub chip_over_air_k: f64,
    /// What deviates from these figures, and how the floor and the surfaces disturb.
    pub imperfections: Imperfections,
}

impl Default for Params {
    fn default() -> Self {
        Self {
            motors: Sides::new(
                MotorParams::first_board_left(),
                MotorParams::first_board_right(),
            ),
            battery: BatteryParams::default(),
            chassis: Chassis::default(),
            mounts: Mount::first_board(),
            rangefinder: RangefinderParams::default(),
            servo: ServoParams::default(),
            // 50 mW through the package's 51 K/W.
            chip_over_air_k: 2.5,
            imperfections: Imperfections::none(),
        }
    }
}

impl Imperfections {
    /// The robot of this seed: `params` with the deviations that the seed draws.
    pub fn draw(&self, mut params: Params, seed: u64) -> Params {
        let mut rng = Rng::stream(seed, stream::DRAW);
        // Always the same draws: what is switched off changes nothing else.
        let mut within = |bound: Option<f64>| {
            let drawn = rng.within(1.0);
            bound.map_or(0.0, |bound| bound * drawn)
        };
        let geometry = self.geometry;
        let chassis = &mut params.chassis;
        let wheels = &mut chassis.wheel_diameter_mm;
        for diameter in [&mut wheels.left, &mut wheels.right] {
            *diameter *= 1.0 + within(geometry.map(|spread| spread.wheel));
        }
        chassis.track_mm *= 1.0 + within(geometry.map(|spread| spread.track));
        for motor in [&mut params.motors.left, &mut params.motors.right] {
            let faster = 1.0 + within(self.drive.map(|spread| spread.speed));
            motor.speeds_deg_s = motor.speeds_deg_s.map(|speed| speed * faster);
            motor.dead_zone *= 1.0 + within(self.drive.map(|spread| spread.dead_zone));
            motor.lag_s *= 1.0 + within(self.drive.map(|spread| spread.lag));
        }
        let (charge, ohm) = (within(Some(1.0)), within(Some(1.0)));
        if let Some(spread) = self.drive {
            let between =
                |[low, high]: [f64; 2], drawn: f64| low + (high - low) * (drawn + 1.0) / 2.0;
            let battery = &mut params.battery;
            // The cells stay as unequal as they are.
            let down = battery.charge[0] - between(spread.charge, charge);
            battery.charge = battery.charge.map(|charge| (charge - down).clamp(0.0, 1.0));
            battery.cell_ohm = between(spread.cell_ohm, ohm);
        }
        params
    }
}
