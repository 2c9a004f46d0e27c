//! The L298P: TIM4 chops the enables at 20 kHz, four pins set the directions.
//!
//! | drive | enable | inputs |
//! |---|---|---|
//! | coast | 0 | both low |
//! | brake | 100 % | both low: both ends of the motor to ground |
//! | forward | duty | IN2 high, IN1 low |
//! | backward | duty | IN1 high, IN2 low |
//!
//! Whenever a motor's inputs change, its enable goes low first and stays so for
//! [`DEAD_TIME_CYCLES`], longer than the bridge needs to turn off, so upper and lower transistors of
//! a leg never conduct together. The compare registers are preloaded, as PWM mode needs it (RM0383,
//! 13.4.7); the zero before a change of inputs takes effect at once, by an update event.

use crate::board::{LEFT_EN, LEFT_IN1, LEFT_IN2, RIGHT_EN, RIGHT_IN1, RIGHT_IN2};
use crate::clock::APB1_TIMER_HZ;
use crate::gpio::{Driver, Pin, Pull};
use crate::registers::Registers;
use fw_core::types::{Duty, MotorCommand};
use stm32f4::stm32f411::TIM4;

/// The enables' chopping frequency, hertz: inaudible, and within the L298's 40 kHz.
const PWM_HZ: u32 = 20_000;
/// Timer counts of one period.
const PERIOD: u32 = APB1_TIMER_HZ / PWM_HZ;
/// Hundredths of a percent for each timer count.
const STEP: u32 = Duty::FULL as u32 / PERIOD;
const _: () = assert!(
    STEP * PERIOD == Duty::FULL as u32,
    "full duty is exactly the period"
);
/// 2 µs: the L298's slowest turn-off is 1.5 µs (source current turn-off delay, datasheet table).
const DEAD_TIME_CYCLES: u32 = 200;

/// Levels of one motor's direction inputs.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Inputs {
    /// Both low.
    Low,
    /// IN2 high, IN1 low.
    Forward,
    /// IN1 high, IN2 low.
    Backward,
}

/// Both bridges, with the levels last applied to their inputs.
pub struct Motors {
    left: Inputs,
    right: Inputs,
}

impl Motors {
    /// Starts the PWM with both motors coasting.
    pub fn start() -> Self {
        let timer = TIM4::registers();
        timer.ccmr2_output().write(|w| {
            w.oc3m().pwm_mode1().oc3pe().set_bit();
            w.oc4m().pwm_mode1().oc4pe().set_bit()
        });
        timer.psc().write(|w| w.psc().set(0));
        timer.arr().write(|w| w.arr().set((PERIOD - 1) as u16));
        timer.ccr3().write(|w| w.ccr().set(0));
        timer.ccr4().write(|w| w.ccr().set(0));
        timer.ccer().write(|w| {
            w.cc3e().set_bit();
            w.cc4e().set_bit()
        });
        timer.cr1().write(|w| w.cen().set_bit());
        for pin in [RIGHT_EN, LEFT_EN] {
            pin.alternate(2, Driver::PushPull, Pull::Floating);
        }
        Self {
            left: Inputs::Low,
            right: Inputs::Low,
        }
    }

    /// Applies both commands.
    // Requirement: DOC-2.3-2
    pub fn set(&mut self, left: MotorCommand, right: MotorCommand) {
        let timer = TIM4::registers();
        let (left_inputs, left_duty) = decode(left);
        let (right_inputs, right_duty) = decode(right);
        let turn_left = left_inputs != self.left;
        let turn_right = right_inputs != self.right;
        if turn_left || turn_right {
            if turn_right {
                timer.ccr3().write(|w| w.ccr().set(0));
            }
            if turn_left {
                timer.ccr4().write(|w| w.ccr().set(0));
            }
            timer.egr().write(|w| w.ug().set_bit());
            cortex_m::asm::delay(DEAD_TIME_CYCLES);
            if turn_right {
                apply(right_inputs, RIGHT_IN1, RIGHT_IN2);
                self.right = right_inputs;
            }
            if turn_left {
                apply(left_inputs, LEFT_IN1, LEFT_IN2);
                self.left = left_inputs;
            }
        }
        timer.ccr3().write(|w| w.ccr().set(right_duty));
        timer.ccr4().write(|w| w.ccr().set(left_duty));
    }
}

/// Inputs and compare value: 0 never rises, `PERIOD` (one above the reload) never falls.
#[inline]
fn decode(drive: MotorCommand) -> (Inputs, u16) {
    match drive {
        MotorCommand::Coast => (Inputs::Low, 0),
        MotorCommand::Brake => (Inputs::Low, PERIOD as u16),
        MotorCommand::Run(duty) => {
            let hundredths = duty.hundredths();
            let inputs = match hundredths {
                1.. => Inputs::Forward,
                0 => Inputs::Low,
                ..0 => Inputs::Backward,
            };
            // A duty is within ±`Duty::FULL`.
            (inputs, hundredths.unsigned_abs() / STEP as u16)
        }
    }
}

/// Sets both pins; the one that falls goes first, so both are never high on the way.
fn apply(inputs: Inputs, in1: Pin, in2: Pin) {
    match inputs {
        Inputs::Low => {
            in1.low();
            in2.low();
        }
        Inputs::Forward => {
            in1.low();
            in2.high();
        }
        Inputs::Backward => {
            in2.low();
            in1.high();
        }
    }
}

/// Drives the enables and the inputs low, whatever the timer does: the first action of boot and of the
/// safe state. Needs only the ports' clocks.
pub fn force_off() {
    // A static, so that the safe state needs no stack for a copy.
    static PINS: [Pin; 6] = [RIGHT_EN, LEFT_EN, RIGHT_IN1, RIGHT_IN2, LEFT_IN1, LEFT_IN2];
    for pin in &PINS {
        pin.low();
        pin.output(Driver::PushPull);
    }
}
