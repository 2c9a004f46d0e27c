//! What can go wrong with the robot's parts.

use crate::Sides;

/// What is broken or going wrong right now. All false, zero and `None` by default.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Faults {
    /// The encoder gives no edges.
    pub dead_encoder: Sides<bool>,
    /// Part of the wheel's travel that does not move the robot, 0..=1 (1 = spinning on the spot).
    pub slip: Sides<f64>,
    /// A hand turns the robot on the spot at this rate, °/s, counter-clockwise; its wheels slide.
    pub twist_deg_s: f64,
    /// The wheel cannot turn; its motor stalls.
    pub jammed: Sides<bool>,
    /// The rangefinder hears nothing: its line stays up as long as it does without an object.
    pub missing_echo: [bool; 3],
    /// The rangefinder's plug is out: its line never rises.
    pub unplugged: [bool; 3],
    /// The rangefinder always answers with this distance, mm.
    pub stuck_mm: [Option<f64>; 3],
}
