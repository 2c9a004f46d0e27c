//! The external interrupt controller, RM0383 rev 3 chapter 10.
//!
//! | Register or section | Behaviour |
//! |---|---|
//! | `RTSR`, `FTSR` | The edges that set a line's pending bit |
//! | `PR` | Set by a selected edge of an unmasked line, as `SWIER` does (10.3.5); cleared by a written one |
//! | `IMR` | The NVIC's line follows pending and mask |
//! | Latency | The NVIC's line falls [`CLEAR_NS`] after its pending bits: a handler that clears them last is entered again |
//! | `SWIER` | A written one pends an unmasked line; the bit falls with the pending bit |
//! | NVIC | Lines 0 to 4 alone, 5 to 9 and 10 to 15 together: 6 to 10, 23 and 40; [`SUPPLY`]: 1 |
//!
//! Not modelled: lines 17 to 22 (RTC, OTG, no such source here) and event mode (`EMR`), which
//! only wakes a `WFE`; `EMR` is stored.

use rigless::device::{Device, DeviceContext, Level, RegisterFile, RequestChange};
use rigless::soc::stm32f427::generated::exti::Register;
use rigless::time::{EventId, VirtualNanos};

/// Lines with a pin behind them.
pub const LINES: usize = 16;

/// The line of the supply detector's output, which rises when the supply falls (5.2.3, 10.2.5).
pub const SUPPLY: usize = LINES;

/// A store's way over APB2 and back, beside the ten cycles of an exception's return, which the emulated core spends
/// before the handler, nanoseconds.
pub const CLEAR_NS: u64 = 120;

/// The NVIC lines as the instance lists them: 2 (tamper), 6 to 10, 23, 40, 1.
const VECTORS: usize = 9;

/// The external interrupt controller.
#[derive(Debug, Default)]
pub struct Exti {
    lines: [Option<Level>; LINES + 1],
    driven: [bool; VECTORS],
}

/// The position, in the instance's list of NVIC lines, of external line `line`.
const fn vector(line: usize) -> usize {
    match line {
        0..=4 => line + 1,
        5..=9 => 6,
        SUPPLY => 8,
        _ => 7,
    }
}

impl Exti {
    /// The level of a line: a selected edge pends it unless it is masked.
    pub fn drive(
        &mut self,
        line: usize,
        level: Level,
        registers: &mut RegisterFile,
        context: &mut DeviceContext<'_>,
    ) {
        let before = self.lines[line].replace(level);
        let selected = match (before, level) {
            (Some(Level::Low), Level::High) => registers.get(Register::Rtsr),
            (Some(Level::High), Level::Low) => registers.get(Register::Ftsr),
            _ => 0,
        };
        let pended = selected & registers.get(Register::Imr) & 1 << line;
        registers.set(Register::Pr, registers.get(Register::Pr) | pended);
        self.refresh(false, registers, context);
    }

    /// Raises the NVIC's lines at once; lowers them where `late`, else in [`CLEAR_NS`].
    fn refresh(&mut self, late: bool, registers: &RegisterFile, context: &mut DeviceContext<'_>) {
        let active = registers.get(Register::Pr) & registers.get(Register::Imr);
        let mut levels = [false; VECTORS];
        for line in 0..=SUPPLY {
            levels[vector(line)] |= active >> line & 1 != 0;
        }
        for (position, (driven, level)) in self.driven.iter_mut().zip(levels).enumerate() {
            if *driven != level && (level || late) {
                *driven = level;
                context.interrupt(position, Level::from(level));
            } else if *driven != level {
                context.schedule(VirtualNanos(context.now().0 + CLEAR_NS));
            }
        }
    }
}

impl Device for Exti {
    type Register = Register;

    fn write(
        &mut self,
        register: Register,
        value: u64,
        registers: &mut RegisterFile,
        context: &mut DeviceContext<'_>,
    ) {
        match register {
            Register::Swier => {
                let pended = value & registers.get(Register::Imr);
                registers.set(Register::Pr, registers.get(Register::Pr) | pended);
            }
            Register::Pr => {
                let swier = registers.get(Register::Swier);
                registers.set(Register::Swier, swier & !value);
            }
            _ => {}
        }
        self.refresh(false, registers, context);
    }

    fn on_event(
        &mut self,
        _event: EventId,
        registers: &mut RegisterFile,
        context: &mut DeviceContext<'_>,
    ) {
        self.refresh(true, registers, context);
    }

    fn on_request(
        &mut self,
        change: RequestChange,
        registers: &mut RegisterFile,
        context: &mut DeviceContext<'_>,
    ) {
        if change.instance == "SYSCFG" && change.request < LINES {
            self.drive(change.request, change.level, registers, context);
        }
    }

    fn reset(&mut self) {
        *self = Self::default();
    }
}
