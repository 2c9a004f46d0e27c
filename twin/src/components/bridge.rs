//! One half of the L298P: what its three inputs do to a motor (datasheet, figure 6).

use plant::MotorInput;
use rigless::device::Level;

use crate::pinout::BridgePins;
use crate::soc::{Role, Stm32f411};

/// TIM4's place among TIM2 to TIM5.
const TIM4: usize = 2;
/// The alternate function that puts TIM4 on the enables.
const TIM4_FUNCTION: u8 = 2;

/// What the firmware applies to the motor right now.
#[must_use]
pub fn input(chip: &Stm32f411, pins: BridgePins) -> MotorInput {
    let high = |pin| chip.output(pin) == Some(Level::High);
    drive(enable(chip, pins), high(pins.in1), high(pins.in2))
}

/// The share of the time the enable is high, 0..=1.
fn enable(chip: &Stm32f411, pins: BridgePins) -> f64 {
    match chip.role(pins.enable) {
        Role::Function(TIM4_FUNCTION) => match chip.pulse(TIM4, pins.channel) {
            (Some(pulse), _) if pulse.period.0 > 0 => {
                #[expect(clippy::cast_precision_loss, reason = "a period is far below 2^53 ns")]
                let share = pulse.width.0 as f64 / pulse.period.0 as f64;
                share
            }
            (_, Some(Level::High)) => 1.0,
            _ => 0.0,
        },
        Role::Output if chip.output(pins.enable) == Some(Level::High) => 1.0,
        // A pin nobody drives is held low by the bridge's own input.
        _ => 0.0,
    }
}

/// Both inputs alike short the motor while it is enabled; otherwise the higher one gives the
/// direction.
fn drive(enabled: f64, in1: bool, in2: bool) -> MotorInput {
    if enabled <= 0.0 {
        return MotorInput::COAST;
    }
    match (in1, in2) {
        (false, true) => MotorInput::run(enabled),
        (true, false) => MotorInput::run(-enabled),
        _ => MotorInput::BRAKE,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_low_enable_lets_the_motor_coast_whatever_the_inputs_say() {
        for inputs in 0..4 {
            assert_eq!(
                drive(0.0, inputs & 1 != 0, inputs & 2 != 0),
                MotorInput::COAST
            );
        }
    }

    #[test]
    fn in2_high_is_forward_and_in1_high_is_backward() {
        assert_eq!(drive(0.5, false, true), MotorInput::run(0.5));
        assert_eq!(drive(0.5, true, false), MotorInput::run(-0.5));
        assert_eq!(drive(1.0, true, true), MotorInput::BRAKE);
        assert_eq!(drive(1.0, false, false), MotorInput::BRAKE);
    }
}
