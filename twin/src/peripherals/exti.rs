//! The external interrupt controller, RM0383 rev 3 chapter 10.
//!
//! | Register or section | Behaviour | Test |
//! |---|---|---|
//! | `RTSR`, `FTSR` | The edges that set a line's pending bit | `each_edge_pends_only_where_it_is_selected` |
//! | `PR` | Set by a selected edge whatever the mask says (figure 29 puts the mask behind it), cleared by a written one | `a_pending_bit_clears_by_a_written_one_only` |
//! | `IMR` | The NVIC's line follows pending and mask, so unmasking a pending line interrupts | `unmasking_a_pending_line_interrupts` |
//! | `SWIER` | A written one pends an unmasked line; the bit falls with the pending bit | `software_pends_a_line` |
//! | NVIC | Lines 0 to 4 alone, 5 to 9 and 10 to 15 together: 6 to 10, 23 and 40 | `lines_share_their_vectors` |
//!
//! Not modelled: lines 16 to 22 (PVD, RTC, OTG, no such source here) and event mode (`EMR`), which
//! only wakes a `WFE`; `EMR` is stored.

use rigless::device::{Device, DeviceContext, Level, RegisterFile, RequestChange};
use rigless::soc::stm32f427::generated::exti::Register;

/// Lines with a pin behind them.
pub const LINES: usize = 16;

/// The NVIC lines as the instance lists them: 2 (tamper), 6 to 10, 23, 40.
const VECTORS: usize = 8;

/// The external interrupt controller.
#[derive(Debug, Default)]
pub struct Exti {
    lines: [Option<Level>; LINES],
    driven: [bool; VECTORS],
}

/// The position, in the instance's list of NVIC lines, of external line `line`.
const fn vector(line: usize) -> usize {
    match line {
        0..=4 => line + 1,
        5..=9 => 6,
        _ => 7,
    }
}

impl Exti {
    fn refresh(&mut self, registers: &RegisterFile, context: &mut DeviceContext<'_>) {
        let active = registers.get(Register::Pr) & registers.get(Register::Imr);
        let mut wanted = [false; VECTORS];
        for line in 0..LINES {
            wanted[vector(line)] |= active >> line & 1 != 0;
        }
        for (position, (driven, wanted)) in self.driven.iter_mut().zip(wanted).enumerate() {
            if *driven != wanted {
                *driven = wanted;
                context.interrupt(position, Level::from(wanted));
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
        self.refresh(registers, context);
    }

    fn on_request(
        &mut self,
        change: RequestChange,
        registers: &mut RegisterFile,
        context: &mut DeviceContext<'_>,
    ) {
        if change.instance != "SYSCFG" || change.request >= LINES {
            return;
        }
        let before = self.lines[change.request].replace(change.level);
        let selected = match (before, change.level) {
            (Some(Level::Low), Level::High) => registers.get(Register::Rtsr),
            (Some(Level::High), Level::Low) => registers.get(Register::Ftsr),
            _ => 0,
        };
        if selected >> change.request & 1 != 0 {
            registers.set(
                Register::Pr,
                registers.get(Register::Pr) | 1 << change.request,
            );
            self.refresh(registers, context);
        }
    }

    fn reset(&mut self) {
        *self = Self::default();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::soc::Stm32f411;
    use rigless::mcu::{Mcu, Operate};
    use rigless::soc::Width;
    use rigless::time::VirtualNanos;

    const EXTI: u64 = 0x4001_3C00;
    const IMR: u64 = EXTI;
    const RTSR: u64 = EXTI + 8;
    const FTSR: u64 = EXTI + 0xC;
    const SWIER: u64 = EXTI + 0x10;
    const PR: u64 = EXTI + 0x14;
    const NOW: VirtualNanos = VirtualNanos(0);

    fn write(part: &mut Stm32f411, address: u64, value: u64) {
        part.write(NOW, address, Width::W32, value).unwrap();
        crate::soc::fixture::settle(part);
    }

    fn read(part: &mut Stm32f411, address: u64) -> u64 {
        part.read(NOW, address, Width::W32).unwrap()
    }

    fn lines(part: &mut Stm32f411) -> Vec<(u16, Level)> {
        part.drain_interrupts()
            .into_iter()
            .map(|change| (change.interrupt, change.level))
            .collect()
    }

    /// A part whose port A is clocked, PA4 on line 4 (the reset routing), driven low.
    fn part() -> Stm32f411 {
        let mut part = Stm32f411::new().unwrap();
        write(&mut part, 0x4002_3830, 0x87);
        write(&mut part, 0x4002_3844, 1 << 14);
        drive(&mut part, 4, Level::Low);
        part
    }

    fn drive(part: &mut Stm32f411, pin: u8, level: Level) {
        part.drive_pin(NOW, crate::soc::pin('A', pin), Some(level));
        crate::soc::fixture::settle(part);
    }

    #[test]
    fn each_edge_pends_only_where_it_is_selected() {
        let mut part = part();
        drive(&mut part, 4, Level::High);
        assert_eq!(read(&mut part, PR), 0);
        write(&mut part, FTSR, 1 << 4);
        drive(&mut part, 4, Level::Low);
        assert_eq!(read(&mut part, PR), 1 << 4);
        write(&mut part, PR, 1 << 4);
        drive(&mut part, 4, Level::High);
        assert_eq!(read(&mut part, PR), 0);
        write(&mut part, RTSR, 1 << 4);
        drive(&mut part, 4, Level::Low);
        write(&mut part, PR, 1 << 4);
        drive(&mut part, 4, Level::High);
        assert_eq!(read(&mut part, PR), 1 << 4);
    }

    #[test]
    fn a_pending_bit_clears_by_a_written_one_only() {
        let mut part = part();
        write(&mut part, RTSR, 1 << 4);
        drive(&mut part, 4, Level::High);
        write(&mut part, PR, !(1 << 4) & 0x7F_FFFF);
        assert_eq!(read(&mut part, PR), 1 << 4);
        write(&mut part, PR, 1 << 4);
        assert_eq!(read(&mut part, PR), 0);
    }

    #[test]
    fn unmasking_a_pending_line_interrupts() {
        let mut part = part();
        write(&mut part, RTSR, 1 << 4);
        drive(&mut part, 4, Level::High);
        assert_eq!(lines(&mut part), []);
        write(&mut part, IMR, 1 << 4);
        assert_eq!(lines(&mut part), [(10, Level::High)]);
        write(&mut part, PR, 1 << 4);
        assert_eq!(lines(&mut part), [(10, Level::Low)]);
    }

    #[test]
    fn software_pends_a_line() {
        let mut part = part();
        write(&mut part, SWIER, 1);
        assert_eq!(read(&mut part, PR), 0, "masked");
        write(&mut part, IMR, 1);
        write(&mut part, SWIER, 1);
        assert_eq!(read(&mut part, PR), 1);
        write(&mut part, PR, 1);
        assert_eq!(read(&mut part, SWIER), 0);
    }

    #[test]
    fn lines_share_their_vectors() {
        let mut part = part();
        write(&mut part, IMR, 0xFFFF);
        for (line, number) in [
            (0, 6),
            (1, 7),
            (4, 10),
            (5, 23),
            (9, 23),
            (10, 40),
            (15, 40),
        ] {
            write(&mut part, SWIER, 1 << line);
            assert_eq!(lines(&mut part), [(number, Level::High)], "line {line}");
            write(&mut part, PR, 1 << line);
            lines(&mut part);
        }
        assert!(part.bus().slots().len() > 30);
    }
}
