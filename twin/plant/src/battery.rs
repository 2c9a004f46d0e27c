//! The 2-cell lithium-polymer battery and the two dividers the ADC measures it through.

/// A resistive divider in front of an ADC pin.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Divider {
    /// Between tap and pin, ohm.
    pub upper_ohm: f64,
    /// Between pin and ground, ohm.
    pub lower_ohm: f64,
}

impl Divider {
    /// Voltage at the pin for a voltage at the tap.
    #[must_use]
    pub fn pin(&self, tap: f64) -> f64 {
        tap * self.lower_ohm / (self.upper_ohm + self.lower_ohm)
    }
}

/// What the battery is made of.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BatteryParams {
    /// Charge that a full cell gives, ampere hours.
    pub capacity_ah: f64,
    /// State of charge of each cell at the start, 0..=1, cell 1 (at ground) first.
    pub charge: [f64; 2],
    /// Inner resistance of one cell, ohm.
    pub cell_ohm: f64,
    /// What the Pi and the logic draw all the time, ampere.
    pub idle_a: f64,
    /// The dividers of `CELL_1` and `CELL_2`.
    pub dividers: [Divider; 2],
}

impl Default for BatteryParams {
    /// The first board's dividers; capacity, resistance (an aged 1500 mAh pack with its leads) and
    /// idle current (a Pi 3B+ through its regulator) are choices.
    fn default() -> Self {
        Self {
            capacity_ah: 1.5,
            charge: [0.85, 0.84],
            cell_ohm: 0.06,
            idle_a: 0.5,
            dividers: [
                Divider {
                    upper_ohm: 10_000.0,
                    lower_ohm: 33_000.0,
                },
                Divider {
                    upper_ohm: 33_000.0,
                    lower_ohm: 22_000.0,
                },
            ],
        }
    }
}

/// Open-circuit voltage of a cell at 0, 10, .. 100 % charge: the usual shape of the chemistry,
/// 3.0 V empty to 4.2 V full.
const OPEN_CIRCUIT: [f64; 11] = [
    3.00, 3.61, 3.69, 3.73, 3.77, 3.80, 3.84, 3.91, 3.98, 4.08, 4.20,
];

/// The battery's state.
#[derive(Clone, Debug)]
pub struct Battery {
    params: BatteryParams,
    charge: [f64; 2],
    current_a: f64,
}

impl Battery {
    /// A rested battery.
    #[must_use]
    pub fn new(params: BatteryParams) -> Self {
        Self {
            charge: params.charge,
            current_a: params.idle_a,
            params,
        }
    }

    /// Draws `motors_a` ampere on top of the idle current for `dt` seconds.
    pub fn step(&mut self, dt: f64, motors_a: f64) {
        self.current_a = self.params.idle_a + motors_a;
        let used = self.current_a * dt / (3600.0 * self.params.capacity_ah);
        for charge in &mut self.charge {
            *charge = (*charge - used).clamp(0.0, 1.0);
        }
    }

    /// Voltage of each cell under the present load, cell 1 first.
    #[must_use]
    pub fn cells(&self) -> [f64; 2] {
        self.charge
            .map(|charge| (open_circuit(charge) - self.current_a * self.params.cell_ohm).max(0.0))
    }

    /// Voltages against ground of `CELL_1` and `CELL_2`: tap n is the sum of the cells up to n.
    #[must_use]
    pub fn taps(&self) -> [f64; 2] {
        let [one, two] = self.cells();
        [one, one + two]
    }

    /// Voltage of the whole battery under the present load.
    #[must_use]
    pub fn voltage(&self) -> f64 {
        self.taps()[1]
    }

    /// Voltages at the ADC pins. At more than 8.25 V the second exceeds the ADC's 3.3 V; clipping
    /// is the ADC's.
    #[must_use]
    pub fn pins(&self) -> [f64; 2] {
        let taps = self.taps();
        [
            self.params.dividers[0].pin(taps[0]),
            self.params.dividers[1].pin(taps[1]),
        ]
    }

    /// Present current out of the battery, ampere.
    #[must_use]
    pub fn current_a(&self) -> f64 {
        self.current_a
    }

    /// State of charge of each cell, 0..=1.
    #[must_use]
    pub fn charge(&self) -> [f64; 2] {
        self.charge
    }
}

#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)] // 0..=10
fn open_circuit(charge: f64) -> f64 {
    let place = charge.clamp(0.0, 1.0) * 10.0;
    let below = (place as usize).min(9);
    let part = place - f64::from(u8::try_from(below).unwrap_or(9));
    OPEN_CIRCUIT[below] + part * (OPEN_CIRCUIT[below + 1] - OPEN_CIRCUIT[below])
}

#[cfg(test)]
mod tests {
    use super::*;

    fn with_charge(charge: f64) -> Battery {
        let params = BatteryParams {
            charge: [charge; 2],
            idle_a: 0.0,
            ..BatteryParams::default()
        };
        Battery::new(params)
    }

    #[test]
    fn open_circuit_spans_six_to_eight_point_four_volts() {
        assert!((with_charge(1.0).voltage() - 8.4).abs() < 1e-9);
        assert!((with_charge(0.0).voltage() - 6.0).abs() < 1e-9);
        let mut last = 0.0;
        for percent in 0..=100 {
            let volts = open_circuit(f64::from(percent) / 100.0);
            assert!(volts > last);
            last = volts;
        }
    }

    #[test]
    fn load_sags_and_rest_recovers() {
        let mut battery = with_charge(0.5);
        let rested = battery.voltage();
        battery.step(0.001, 2.0);
        assert!((rested - battery.voltage() - 2.0 * 2.0 * 0.06).abs() < 1e-3);
        battery.step(0.001, 0.0);
        assert!((rested - battery.voltage()).abs() < 1e-3);
    }

    #[test]
    fn the_charge_drawn_is_current_times_time() {
        let mut battery = with_charge(1.0);
        for _ in 0..3600 {
            battery.step(1.0, 0.75);
        }
        assert!((battery.charge()[0] - 0.5).abs() < 1e-9);
    }

    #[test]
    fn pins_see_the_taps_through_their_dividers() {
        let battery = with_charge(0.5);
        let [one, two] = battery.pins();
        assert!((one - 3.80 * 33.0 / 43.0).abs() < 1e-9);
        assert!((two - 7.60 * 22.0 / 55.0).abs() < 1e-9);
    }
}
