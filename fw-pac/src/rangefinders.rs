//! Three US-015: a trigger pulse out, the echo's two edges timed by EXTI and TIM5.

use crate::board::{ECHO_FRONT, ECHO_LEFT, ECHO_RIGHT, TRIGGER_FRONT, TRIGGER_LEFT, TRIGGER_RIGHT};
use crate::gpio::{Driver, Pin, Pull};
use crate::time;
use cortex_m::interrupt::{CriticalSection, Mutex, free};
use cortex_m::peripheral::SCB;
use fw_core::captured::Echoes;
use fw_core::types::{Micros, RangefinderId};

/// Echoes that await the robot.
pub static ECHOES: Mutex<Echoes> = Mutex::new(Echoes::new());

/// Triggers low. Echoes come with 5 V, which no pin with a pull bears (DS10314, table 14): the board pulls
/// them down where no sensor is plugged in.
pub fn start() {
    for pin in [TRIGGER_FRONT, TRIGGER_RIGHT, TRIGGER_LEFT] {
        pin.low();
        pin.output(Driver::PushPull);
    }
    for pin in [ECHO_FRONT, ECHO_RIGHT, ECHO_LEFT] {
        pin.input(Pull::Floating);
    }
}

/// Sends one sensor's pulse.
pub fn trigger(which: RangefinderId) {
    free(|token| ECHOES.borrow(token).trigger(which));
    let (trigger, _) = pins(which);
    time::pulse(|| trigger.high());
}

/// Ends every trigger pulse.
#[inline]
pub fn end_trigger() {
    TRIGGER_FRONT.low();
    TRIGGER_RIGHT.low();
    TRIGGER_LEFT.low();
}

/// A sensor's trigger and echo.
// Requirement: DOC-2.2-1
pub const fn pins(which: RangefinderId) -> (Pin, Pin) {
    match which {
        RangefinderId::Front => (TRIGGER_FRONT, ECHO_FRONT),
        RangefinderId::Right => (TRIGGER_RIGHT, ECHO_RIGHT),
        RangefinderId::Left => (TRIGGER_LEFT, ECHO_LEFT),
    }
}

/// An edge of one sensor's echo, at `at`.
#[inline]
pub fn on_edge(which: RangefinderId, at: Micros, token: &CriticalSection) {
    let (_, echo) = pins(which);
    if ECHOES.borrow(token).on_edge(which, at, echo.is_high()) {
        SCB::set_pendsv();
    }
}
