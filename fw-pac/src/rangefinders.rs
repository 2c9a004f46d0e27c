//! Three US-015: a trigger pulse out, the echo's two edges timed by EXTI and TIM5.
//!
//! A sensor is listened to from its trigger to the end of its echo, which for want of an object comes
//! after the next sensor's trigger; any other edge is noise and is ignored. An echo shorter than the
//! interrupt's latency has no rising edge left to see and is ignored too: 2 µs are 0.3 mm.

use crate::board::{ECHO_FRONT, ECHO_LEFT, ECHO_RIGHT, TRIGGER_FRONT, TRIGGER_LEFT, TRIGGER_RIGHT};
use crate::gpio::{Driver, Pin, Pull};
use crate::{exti, time};
use core::cell::Cell;
use cortex_m::interrupt::{free, CriticalSection, Mutex};
use fw_core::types::{Micros, RangefinderId};
use stm32f4::stm32f411::interrupt;

/// One echo, on the robot's clock.
#[derive(Clone, Copy)]
pub struct Echo {
    /// Whose.
    pub which: RangefinderId,
    /// The edge up: the burst has left.
    pub rise: Micros,
    /// The edge down: it came back.
    pub fall: Micros,
}

/// Where a sensor is.
#[derive(Clone, Copy)]
enum Progress {
    /// Not triggered, or its echo has been taken.
    Idle,
    /// Triggered, no edge yet.
    Triggered,
    /// The echo's pin went up.
    Rising(Micros),
    /// And down, at the second; the robot has not taken it yet.
    Heard(Micros, Micros),
}

/// In the order of [`RangefinderId`].
static PROGRESS: Mutex<[Cell<Progress>; 3]> = Mutex::new([
    Cell::new(Progress::Idle),
    Cell::new(Progress::Idle),
    Cell::new(Progress::Idle),
]);

/// Triggers low, echoes held low where no sensor is plugged in.
pub fn start() {
    for pin in [TRIGGER_FRONT, TRIGGER_RIGHT, TRIGGER_LEFT] {
        pin.low();
        pin.output(Driver::PushPull);
    }
    for pin in [ECHO_FRONT, ECHO_RIGHT, ECHO_LEFT] {
        pin.input(Pull::Down);
    }
}

/// Sends one sensor's pulse and listens to it until its echo is over or it is triggered anew.
pub fn trigger(which: RangefinderId) {
    free(|token| PROGRESS.borrow(token)[which as usize].set(Progress::Triggered));
    let (trigger, _) = pins(which);
    time::pulse(|| trigger.high());
}

/// Ends whichever pulse is out.
#[inline]
pub fn end_trigger() {
    TRIGGER_FRONT.low();
    TRIGGER_RIGHT.low();
    TRIGGER_LEFT.low();
}

/// An echo heard and not yet taken.
#[inline]
pub fn take(token: &CriticalSection) -> Option<Echo> {
    let heard = |which| {
        let progress = &PROGRESS.borrow(token)[which as usize];
        let Progress::Heard(rise, fall) = progress.get() else {
            return None;
        };
        progress.set(Progress::Idle);
        Some(Echo { which, rise, fall })
    };
    heard(RangefinderId::Front)
        .or_else(|| heard(RangefinderId::Right))
        .or_else(|| heard(RangefinderId::Left))
}

// Requirement: DOC-2.2-1
const fn pins(which: RangefinderId) -> (Pin, Pin) {
    match which {
        RangefinderId::Front => (TRIGGER_FRONT, ECHO_FRONT),
        RangefinderId::Right => (TRIGGER_RIGHT, ECHO_RIGHT),
        RangefinderId::Left => (TRIGGER_LEFT, ECHO_LEFT),
    }
}

/// An edge of one sensor's echo, at `at`.
#[inline]
fn edge(which: RangefinderId, at: Micros) {
    let (_, echo) = pins(which);
    let high = echo.is_high();
    free(|token| {
        let progress = &PROGRESS.borrow(token)[which as usize];
        match progress.get() {
            Progress::Triggered if high => progress.set(Progress::Rising(at)),
            Progress::Rising(rise) if !high => {
                progress.set(Progress::Heard(rise, at));
                exti::wake_robot();
            }
            _ => {}
        }
    });
}

#[interrupt]
fn EXTI0() {
    let at = time::now();
    exti::clear(0);
    edge(RangefinderId::Right, at);
}

#[interrupt]
fn EXTI9_5() {
    let at = time::now();
    exti::clear(9);
    edge(RangefinderId::Front, at);
}

#[interrupt]
fn EXTI15_10() {
    let at = time::now();
    exti::clear(12);
    edge(RangefinderId::Left, at);
}
