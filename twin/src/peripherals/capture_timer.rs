//! TIM11 as the bring-up firmware uses it, RM0383 rev 3 chapter 14: captures of the crystal's clock as the
//! RTC's prescaler divides it. Counter and captures follow from the elapsed time when they are read.
//!
//! Any other use is reported.

use rigless::device::{Device, DeviceContext, RegisterFile};
use rigless::soc::stm32f427::generated::tim11::{Register, cr1, sr};
use rigless::time::{NANOS_PER_SECOND, VirtualNanos};

/// `CC1S` = TI1, without the filter and the prescaler, and both as masks.
const INPUT_1: u64 = 0b01;
const PRESCALER: u64 = 0b1100;
/// `TI1_RMP` = the RTC's clock of the crystal.
const CRYSTAL: u64 = 0b10;

/// The timer.
#[derive(Debug, Default)]
pub struct CaptureTimer {
    /// The crystal's clock behind the RTC's prescaler, hertz; 0 while it stands.
    pub input_hz: u64,
    hz: u64,
    /// Since when it counts.
    started: Option<VirtualNanos>,
    /// Captures so far.
    captures: u64,
}

impl CaptureTimer {
    /// The timer, its clock at `hz`.
    pub fn with_clock(hz: u64) -> Self {
        Self {
            hz,
            ..Self::default()
        }
    }

    /// Takes the captures up to `now` into the registers.
    fn settle(&mut self, registers: &mut RegisterFile, now: VirtualNanos) {
        let Some(started) = self.started.filter(|_| self.input_hz > 0) else {
            return;
        };
        let divider = 1_u64 << ((registers.get(Register::Ccmr1Input) & PRESCALER) >> 2);
        let elapsed = u128::from(now.0.saturating_sub(started.0));
        let captures = elapsed * u128::from(self.input_hz) / u128::from(NANOS_PER_SECOND * divider);
        let captures = u64::try_from(captures).unwrap_or(u64::MAX);
        if captures == self.captures {
            return;
        }
        let flags = registers.get(Register::Sr);
        let missed = captures > self.captures + 1 || sr::CC1IF.is_set(flags);
        let missed = if missed { sr::CC1OF.mask() } else { 0 };
        registers.set(Register::Sr, flags | sr::CC1IF.mask() | missed);
        self.captures = captures;
        let cycles =
            u128::from(captures * divider) * u128::from(self.hz) / u128::from(self.input_hz);
        let prescaler = u128::from(registers.get(Register::Psc) + 1);
        let top = u128::from(registers.get(Register::Arr) + 1);
        let count = cycles / prescaler % top;
        registers.set(Register::Ccr1, u64::try_from(count).unwrap_or_default());
    }
}

impl Device for CaptureTimer {
    type Register = Register;

    fn read(
        &mut self,
        register: Register,
        registers: &mut RegisterFile,
        context: &mut DeviceContext<'_>,
    ) -> Option<u64> {
        self.settle(registers, context.now());
        if register == Register::Ccr1 {
            let flags = registers.get(Register::Sr);
            registers.set(Register::Sr, flags & !sr::CC1IF.mask());
        }
        None
    }

    fn write(
        &mut self,
        register: Register,
        value: u64,
        registers: &mut RegisterFile,
        context: &mut DeviceContext<'_>,
    ) {
        self.settle(registers, context.now());
        if register == Register::Sr {
            registers.set(Register::Sr, registers.get(Register::Sr) & value);
        }
        let runs = cr1::CEN.is_set(registers.get(Register::Cr1));
        if runs != self.started.is_some() {
            self.started = runs.then(|| context.now());
            self.captures = 0;
        }
        let input = registers.get(Register::Ccmr1Input) & !PRESCALER;
        let known = registers.get(Register::Or) == CRYSTAL && input == INPUT_1;
        if runs && !(known && registers.get(Register::Dier) == 0) {
            context.tell("CR1", "only captures of the crystal's clock are modelled");
        }
    }

    fn on_clock(&mut self, hz: u64, _: &mut RegisterFile, _: &mut DeviceContext<'_>) {
        self.hz = hz;
    }

    fn reset(&mut self) {
        *self = Self::with_clock(self.hz);
    }
}
