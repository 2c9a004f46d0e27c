//! The multiplexer of the external interrupt lines in SYSCFG, RM0383 rev 3 section 7.2.
//!
//! `EXTICR1` to `EXTICR4` select the port whose pin `n` is line `n`; its level is this instance's
//! request `n` to the external interrupt controller. Changing the selection while the levels differ
//! is an edge on the line, as in the silicon. The memory remap and the compensation cell are stored
//! without effect.

use rigless::device::{Device, DeviceContext, Level, RegisterFile, RequestChange};
use rigless::soc::stm32f427::generated::syscfg::Register::{
    self, Exticr1, Exticr2, Exticr3, Exticr4,
};

use super::exti::LINES;
use crate::pin::PORTS;

/// The `EXTICR` code of each port of [`PORTS`], section 7.2.3: H is 7.
const CODES: [u64; PORTS.len()] = [0, 1, 2, 3, 4, 7];

/// The external interrupt multiplexer.
#[derive(Debug, Default)]
pub struct Syscfg {
    pins: [[Option<Level>; LINES]; PORTS.len()],
    driven: [Option<Level>; LINES],
}

impl Syscfg {
    fn refresh(&mut self, line: usize, registers: &RegisterFile, context: &mut DeviceContext<'_>) {
        let register = [Exticr1, Exticr2, Exticr3, Exticr4][line / 4];
        let code = registers.get(register) >> (line % 4 * 4) & 0xF;
        let port = CODES.iter().position(|&known| known == code);
        if let Some(level) = port.and_then(|port| self.pins[port][line])
            && self.driven[line].replace(level) != Some(level)
        {
            context.request(line, level);
        }
    }
}

impl Device for Syscfg {
    type Register = Register;

    fn write(
        &mut self,
        _register: Register,
        _value: u64,
        registers: &mut RegisterFile,
        context: &mut DeviceContext<'_>,
    ) {
        for line in 0..LINES {
            self.refresh(line, registers, context);
        }
    }

    fn on_request(
        &mut self,
        change: RequestChange,
        registers: &mut RegisterFile,
        context: &mut DeviceContext<'_>,
    ) {
        let port = PORTS.iter().position(|&name| name == change.instance);
        if let (Some(port), true) = (port, change.request < LINES) {
            self.pins[port][change.request] = Some(change.level);
            self.refresh(change.request, registers, context);
        }
    }

    /// The registers go back to port A everywhere; the pins keep their levels.
    fn reset_line(&mut self, registers: &mut RegisterFile, context: &mut DeviceContext<'_>) {
        for line in 0..LINES {
            self.refresh(line, registers, context);
        }
    }

    fn reset(&mut self) {
        *self = Self::default();
    }
}
