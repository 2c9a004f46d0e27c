//! Three US-015: a trigger pulse out, the echo's two edges timed by EXTI and TIM5.
//!
//! A sensor's edges count from its trigger to the end of its echo, which without an object comes after
//! the next sensor's trigger; any other edge is ignored as noise. An echo shorter than the interrupt's
//! latency shows no rising edge and is ignored too: 2 µs are 0.3 mm.

use crate::board::{ECHO_FRONT, ECHO_LEFT, ECHO_RIGHT, TRIGGER_FRONT, TRIGGER_LEFT, TRIGGER_RIGHT};
use crate::gpio::{Driver, Pin, Pull};
use crate::time;
use core::cell::Cell;
use cortex_m::interrupt::{CriticalSection, Mutex, free};
use cortex_m::peripheral::SCB;
use fw_core::types::{Micros, RangefinderId};

/// One echo, on the robot's clock.
#[derive(Clone, Copy)]
pub struct Echo {
    /// The sensor.
    pub which: RangefinderId,
    /// Rising edge: the burst has left.
    pub rise: Micros,
    /// Falling edge: it has come back.
    pub fall: Micros,
}

/// State of one sensor.
#[derive(Clone, Copy)]
enum Progress {
    /// Not triggered, or its echo has been taken.
    Idle,
    /// Triggered, no edge yet.
    Triggered,
    /// The echo's pin rose.
    Rising(Micros),
    /// And fell, at the second time; the robot has not taken it yet.
    Received(Micros, Micros),
}

/// In the order of [`RangefinderId`].
static PROGRESS: Mutex<[Cell<Progress>; 3]> = Mutex::new([
    Cell::new(Progress::Idle),
    Cell::new(Progress::Idle),
    Cell::new(Progress::Idle),
]);

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

/// Sends one sensor's pulse; its echo counts until it is over or the sensor is triggered again.
pub fn trigger(which: RangefinderId) {
    free(|token| PROGRESS.borrow(token)[which as usize].set(Progress::Triggered));
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

/// A received echo, once.
#[inline]
pub fn take(token: &CriticalSection) -> Option<Echo> {
    let received = |which| {
        let progress = &PROGRESS.borrow(token)[which as usize];
        let Progress::Received(rise, fall) = progress.get() else {
            return None;
        };
        progress.set(Progress::Idle);
        Some(Echo { which, rise, fall })
    };
    received(RangefinderId::Front)
        .or_else(|| received(RangefinderId::Right))
        .or_else(|| received(RangefinderId::Left))
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
    let high = echo.is_high();
    let progress = &PROGRESS.borrow(token)[which as usize];
    match progress.get() {
        Progress::Triggered if high => progress.set(Progress::Rising(at)),
        Progress::Rising(rise) if !high => {
            progress.set(Progress::Received(rise, at));
            SCB::set_pendsv();
        }
        _ => {}
    }
}
