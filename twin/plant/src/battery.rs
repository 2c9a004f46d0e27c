//! The 2-cell lithium-polymer battery, and the two dividers in front of the ADC.

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
    pub fn pin(&self, tap: f64) -> f64 {
        tap * self.lower_ohm / (self.upper_ohm + self.lower_ohm)
    }
}

/// Parameters of the battery.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BatteryParams {
    /// Charge of a full cell, ampere hours.
    pub capacity_ah: f64,
    /// State of charge of each cell at the start, 0..=1, cell 1 (at ground) first.
    pub charge: [f64; 2],
    /// Internal resistance of one cell, ohm.
    pub cell_ohm: f64,
    /// Constant current of the Pi and the logic, ampere.
    pub idle_a: f64,
    /// The dividers of `CELL_1` and `CELL_2`.
    pub dividers: [Divider; 2],
}

impl Default for BatteryParams {
    /// The first board's dividers. Capacity, resistance (an aged 1500 mAh pack with its leads) and
    /// idle current (a Pi 3B+ through its regulator) are assumptions.
    fn default() -> Self {
        let divider = |upper_ohm, lower_ohm| Divider {
            upper_ohm,
            lower_ohm,
        };
        Self {
            capacity_ah: 1.5,
            charge: [0.85, 0.84],
            cell_ohm: 0.06,
            idle_a: 0.5,
            dividers: [divider(10_000.0, 33_000.0), divider(33_000.0, 22_000.0)],
        }
    }
}

/// Open-circuit voltage of a cell at 0, 10, .. 100 % charge: the usual shape of the chemistry.
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
    pub fn new(params: BatteryParams) -> Self {
        Self {
            charge: params.charge,
            current_a: params.idle_a,
            params,
        }
    }

    /// Draws `motors_a` ampere on top of the idle current for `dt_s` seconds.
    pub fn step(&mut self, dt_s: f64, motors_a: f64) {
        self.current_a = self.params.idle_a + motors_a;
        let used = self.current_a * dt_s / (3600.0 * self.params.capacity_ah);
        self.charge = self.charge.map(|charge| (charge - used).clamp(0.0, 1.0));
    }

    /// Voltages against ground of `CELL_1` and `CELL_2` under the present load: tap n is the sum of
    /// the cells up to n.
    pub fn taps(&self) -> [f64; 2] {
        let drop = self.current_a * self.params.cell_ohm;
        let [one, two] = self
            .charge
            .map(|charge| (open_circuit(charge) - drop).max(0.0));
        [one, one + two]
    }

    /// Voltages at the ADC pins. The second exceeds the ADC's 3.3 V above 8.25 V; clipping is the
    /// ADC's. `cells` in place of the cells' own.
    pub fn pins(&self, cells: Option<[f64; 2]>) -> [f64; 2] {
        let taps = cells.map_or_else(|| self.taps(), |[one, two]| [one, one + two]);
        std::array::from_fn(|cell| self.params.dividers[cell].pin(taps[cell]))
    }
}

#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)] // 0..=10
fn open_circuit(charge: f64) -> f64 {
    let place = charge.clamp(0.0, 1.0) * 10.0;
    let below = (place as usize).min(9);
    let share = place - f64::from(u8::try_from(below).unwrap_or(9));
    OPEN_CIRCUIT[below] + share * (OPEN_CIRCUIT[below + 1] - OPEN_CIRCUIT[below])
}

#[cfg(test)]
mod tests {
    use super::*;

    fn with_charge(charge: f64) -> Battery {
        Battery::new(BatteryParams {
            charge: [charge; 2],
            idle_a: 0.0,
            ..BatteryParams::default()
        })
    }

    #[test]
    fn open_circuit_voltage_rises_from_3_0_to_4_2() {
        assert!((with_charge(1.0).taps()[1] - 8.4).abs() < 1e-9);
        assert!((with_charge(0.0).taps()[1] - 6.0).abs() < 1e-9);
        let volts = (0..=100).map(|percent| open_circuit(f64::from(percent) / 100.0));
        assert!(volts.is_sorted_by(|a, b| a < b));
    }

    #[test]
    fn load_sags_voltage_and_uses_charge() {
        let mut battery = with_charge(1.0);
        let rested = battery.taps()[1];
        battery.step(0.001, 2.0);
        assert!((rested - battery.taps()[1] - 2.0 * 2.0 * 0.06).abs() < 1e-3);
        battery.step(0.001, 0.0);
        assert!((rested - battery.taps()[1]).abs() < 1e-3);
        battery.step(3600.0, 0.75);
        assert!((battery.charge[0] - 0.5).abs() < 1e-5);
    }

    #[test]
    fn pins_show_taps_behind_their_dividers() {
        let [one, two] = with_charge(0.5).pins(None);
        assert!((one - 3.80 * 33.0 / 43.0).abs() < 1e-9);
        assert!((two - 7.60 * 22.0 / 55.0).abs() < 1e-9);
    }
}
