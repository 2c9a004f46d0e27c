//! The robot: one value, one method per event. Interrupts read registers, hand one event in here
//! and write what comes back; all of it runs at one interrupt priority.

use crate::units::Duty;

/// What a motor's bridge is told.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Drive {
    /// Enable low: the wheel turns freely. What a reset leaves and what every failure ends in.
    #[default]
    Coast,
    /// Both inputs alike, enable high: the motor is shorted and stops by itself.
    Brake,
    /// Duty and direction.
    Run(Duty),
}

/// The raw readings of one 100 Hz tick, latched together.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Sample {
    /// TIM5 at the tick.
    pub now: crate::units::Micros,
    /// TIM2's counter.
    pub left: u32,
    /// TIM3's counter.
    pub right: u16,
}

/// A rangefinder, in the order of the frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Rangefinder {
    /// Trig3, Echo3.
    Front = 0,
    /// Trig2, Echo2.
    Right = 1,
    /// Trig1, Echo1.
    Left = 2,
}

/// What a tick tells the registers.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Outputs {
    /// The left motor.
    pub left: Drive,
    /// The right motor.
    pub right: Drive,
    /// The rangefinder to trigger now, if it is one's turn.
    pub trigger: Option<Rangefinder>,
    /// LEDs 1 to 4, bit 0 = LED 1 lit.
    pub leds: u8,
}
