//! One half of the L298P: from its three inputs to the motor (datasheet, figure 6).

use plant::MotorInput;
use rigless::device::Level;
use rigless::time::VirtualNanos;

use crate::pinout::BridgePins;
use crate::soc::{Role, Stm32f411};

/// The alternate function that puts TIM4 on the enables.
const TIM4_FUNCTION: u8 = 2;

/// What the firmware applies to the motor at `now`.
pub fn input(chip: &Stm32f411, now: VirtualNanos, pins: BridgePins) -> MotorInput {
    let high = |pin| chip.output(pin) == Some(Level::High);
    drive(enable(chip, now, pins), high(pins.in1), high(pins.in2))
}

/// The share of the time the enable is high, 0..=1.
fn enable(chip: &Stm32f411, now: VirtualNanos, pins: BridgePins) -> f64 {
    match chip.role(pins.enable) {
        Role::Function(TIM4_FUNCTION) => chip.pwm_duty(now, pins.channel).unwrap_or(0.0),
        Role::Output if chip.output(pins.enable) == Some(Level::High) => 1.0,
        // The bridge pulls an undriven input low.
        _ => 0.0,
    }
}

/// Both inputs alike short the motor for as long as it is enabled; otherwise the higher one gives the
/// direction.
fn drive(enabled: f64, in1: bool, in2: bool) -> MotorInput {
    if enabled <= 0.0 {
        return MotorInput::COAST;
    }
    match (in1, in2) {
        (false, true) => MotorInput::run(enabled),
        (true, false) => MotorInput::run(-enabled),
        _ => MotorInput {
            duty: 0.0,
            brake: enabled,
        },
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn inputs_select_direction_brake_or_coast() {
        for (enabled, in1, in2, expected) in [
            (0.5, false, true, MotorInput::run(0.5)),
            (0.5, true, false, MotorInput::run(-0.5)),
            (1.0, true, true, MotorInput::BRAKE),
            (1.0, false, false, MotorInput::BRAKE),
            (0.0, false, true, MotorInput::COAST),
            (0.0, true, false, MotorInput::COAST),
            (0.0, true, true, MotorInput::COAST),
            (0.0, false, false, MotorInput::COAST),
        ] {
            assert_eq!(drive(enabled, in1, in2), expected, "{enabled} {in1} {in2}");
        }
    }
}
