//! Faults of the robot's parts.

use crate::Sides;

/// What is broken right now. All false, zero and `None` by default.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Faults {
    /// The encoder gives no edges.
    pub dead_encoder: Sides<bool>,
    /// The encoder's second channel gives no edges: the count goes to and fro.
    pub dead_channel: Sides<bool>,
    /// Every edge of the encoder bounces.
    pub noisy_encoder: Sides<bool>,
    /// Share of the wheel's travel that does not move the robot, 0..=1 (1 = spinning in place).
    pub slip: Sides<f64>,
    /// External rotation of the robot with sliding wheels, °/s, counter-clockwise.
    pub twist_deg_s: f64,
    /// The wheel cannot turn; its motor stalls.
    pub jammed: Sides<bool>,
    /// Each motor is plugged in at the other's bridge.
    pub crossed_motors: bool,
    /// The rangefinder receives no echo: its line stays high as long as without an object.
    pub missing_echo: [bool; 3],
    /// The rangefinder is unplugged: its line never rises.
    pub unplugged: [bool; 3],
    /// The front and the right rangefinder's echo lines are swapped.
    pub crossed_echoes: bool,
    /// The rangefinder always reports this distance, mm.
    pub stuck_mm: [Option<f64>; 3],
    /// The cells' voltages, whatever their charge: sagging under a load, or 0 V at an open tap.
    pub cells_v: Option<[f64; 2]>,
}
