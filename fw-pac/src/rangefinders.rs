//! Three US-015: a trigger pulse out, the echo's two edges timed by EXTI and TIM5.
//!
//! Only the sensor triggered last is listened to; an edge of another one is noise or a stray echo
//! and is ignored. An echo shorter than the interrupt's latency has no rising edge left to see and
//! is ignored too: 2 µs are 0.3 mm.

use crate::board::{ECHO_FRONT, ECHO_LEFT, ECHO_RIGHT, TRIGGER_FRONT, TRIGGER_LEFT, TRIGGER_RIGHT};
use crate::gpio::{Driver, Pin, Pull};
use crate::{exti, time};
use core::cell::Cell;
use cortex_m::interrupt::{free, Mutex};
use fw_core::robot::Rangefinder;
use fw_core::units::Micros;
use stm32f4::stm32f411::interrupt;

/// One echo, on the robot's clock.
#[derive(Clone, Copy)]
pub struct Echo {
    /// Whose.
    pub which: Rangefinder,
    /// The edge up: the burst has left.
    pub rise: Micros,
    /// The edge down: it came back.
    pub fall: Micros,
}

/// Where the sensor under way is.
#[derive(Clone, Copy)]
enum Progress {
    /// None triggered, or its echo is over.
    Idle,
    /// Triggered, no edge yet.
    Triggered(Rangefinder),
    /// The echo's pin went up.
    Rising(Rangefinder, Micros),
}

static PROGRESS: Mutex<Cell<Progress>> = Mutex::new(Cell::new(Progress::Idle));
/// The echo heard last, until the robot takes it. Sensors take turns, so there is never a second.
static HEARD: Mutex<Cell<Option<Echo>>> = Mutex::new(Cell::new(None));

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

/// Sends one sensor's pulse and listens to it from now on.
pub fn trigger(which: Rangefinder) {
    free(|token| PROGRESS.borrow(token).set(Progress::Triggered(which)));
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

/// The echo heard since the last call.
pub fn take() -> Option<Echo> {
    free(|token| HEARD.borrow(token).take())
}

const fn pins(which: Rangefinder) -> (Pin, Pin) {
    match which {
        Rangefinder::Front => (TRIGGER_FRONT, ECHO_FRONT),
        Rangefinder::Right => (TRIGGER_RIGHT, ECHO_RIGHT),
        Rangefinder::Left => (TRIGGER_LEFT, ECHO_LEFT),
    }
}

/// An edge of one sensor's echo, at `at`.
#[inline]
fn edge(which: Rangefinder, at: Micros) {
    let (_, echo) = pins(which);
    let high = echo.is_high();
    free(|token| {
        let progress = PROGRESS.borrow(token);
        match progress.get() {
            Progress::Triggered(expected) if expected == which && high => {
                progress.set(Progress::Rising(which, at));
            }
            Progress::Rising(expected, rise) if expected == which && !high => {
                progress.set(Progress::Idle);
                HEARD.borrow(token).set(Some(Echo {
                    which,
                    rise,
                    fall: at,
                }));
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
    edge(Rangefinder::Right, at);
}

#[interrupt]
fn EXTI9_5() {
    let at = time::now();
    exti::clear(9);
    edge(Rangefinder::Front, at);
}

#[interrupt]
fn EXTI15_10() {
    let at = time::now();
    exti::clear(12);
    edge(Rangefinder::Left, at);
}
