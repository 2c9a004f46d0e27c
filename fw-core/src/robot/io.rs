//! Inputs and outputs of the robot's events.

use crate::types::{Micros, MotorCommand, RangefinderId};
use crate::wire::State;

/// The raw readings of one 100 Hz tick, latched together.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct TickInput {
    /// TIM5 at the tick.
    pub now: Micros,
    /// TIM2's counter.
    pub left: u32,
    /// TIM3's counter.
    pub right: u16,
    /// The STM's supply is below the detector's threshold.
    pub supply_low: bool,
}

/// A frame that the SPI slave received.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ReceivedFrame<'a> {
    /// The bytes that the buffer had room for.
    pub bytes: &'a [u8],
    /// Bytes that crossed the wire after those, lost.
    pub overflow_len: usize,
    /// When the chip-select rose.
    pub at: Micros,
    /// Number of the next reply, see [`Robot::encode_reply`](super::Robot::encode_reply).
    pub reply: u32,
}

/// What a tick writes to the registers.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct TickOutput {
    /// The left motor.
    pub left: MotorCommand,
    /// The right motor.
    pub right: MotorCommand,
    /// The rangefinder to trigger now, if any.
    pub trigger: Option<RangefinderId>,
    /// The one pulse to send the servo now, microseconds high; a servo without pulses has no force.
    pub servo: Option<u16>,
    /// LEDs 1 to 4, bit 0 = LED 1 lit.
    pub leds: u8,
}

/// The LEDs of a state, bit 0 = LED 1 lit: one more for every step from booting to moving, the
/// outer or the inner pair when the robot needs attention.
///
/// | state | LED 1 2 3 4 |
/// |---|---|
/// | booting | ● ○ ○ ○ |
/// | ready | ● ● ○ ○ |
/// | moving | ● ● ● ○ |
/// | stopped | ● ○ ○ ● |
/// | faulted | ○ ● ● ○ |
// Requirement: WIRE-status-6
pub const fn leds(state: State) -> u8 {
    match state {
        State::Booting => 0b0001,
        State::Ready => 0b0011,
        State::Moving => 0b0111,
        State::Stopped => 0b1001,
        State::Faulted => 0b0110,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn leds_of_every_state_match_table() {
        // As the table draws them: LED 1 is the lowest bit.
        for (state, shown) in [
            (State::Booting, "*..."),
            (State::Ready, "**.."),
            (State::Moving, "***."),
            (State::Stopped, "*..*"),
            (State::Faulted, ".**."),
        ] {
            let lit = shown.bytes().rev();
            let lit = lit.fold(0, |bits, led| bits << 1 | u8::from(led == b'*'));
            assert_eq!(leds(state), lit, "{state:?}");
        }
    }
}
