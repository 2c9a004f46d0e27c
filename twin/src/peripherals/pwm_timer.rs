//! TIM4 as a PWM generator, RM0383 rev 3 chapter 13.
//!
//! At 20 kHz `rigless`'s timer stops the emulation at 60,000 compare matches and updates a second. This one
//! schedules nothing: counter, flags and shadow registers follow from the elapsed cycles when they
//! are read.
//!
//! | Register or section | Behaviour |
//! |---|---|
//! | Time base, 13.3.1, 13.3.2 | Counts up; `PSC` and, with `ARPE`, `ARR` are loaded at the update. A counter above `ARR` runs to 0xFFFF |
//! | `CCRx`, 13.3.4 | Loaded at the update with `OCxPE`, else at once |
//! | PWM modes 1 and 2, forced levels, frozen, 13.3.7 to 13.3.9 | The share of the period at high level |
//! | `UG`, `UDIS`, `URS` | As 13.4.1 and 13.4.6 say |
//! | `SR` | `UIF` and `CCxIF` |
//!
//! Not modelled, and reported when the firmware enables it: interrupts and DMA requests, the slave modes,
//! a trigger output, counting down, one-pulse mode, captures, and the other output modes.

use rigless::device::{Device, DeviceContext, RegisterFile};
use rigless::soc::stm32f427::generated::tim3::Register::{self, Ccr1, Ccr2, Ccr3, Ccr4};
use rigless::soc::stm32f427::generated::tim3::{cr1, egr, sr};
use rigless::time::{NANOS_PER_SECOND, VirtualNanos};

const CHANNELS: usize = 4;
const MAX_COUNT: u64 = 0xFFFF;

/// The registers that an update loads.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Buffered {
    psc: u64,
    arr: u64,
    compare: [u64; CHANNELS],
}

/// The counter at an instant.
#[derive(Clone, Copy, Debug)]
struct State {
    /// The instant.
    at: VirtualNanos,
    /// Fractions of a clock cycle since the cycle in progress began, in cycles × nanoseconds a second.
    phase: u64,
    /// Cycles of the prescaler in progress.
    prescaled: u64,
    count: u64,
    /// The bits of `SR`.
    flags: u64,
    shadow: Buffered,
}

/// The timer.
#[derive(Debug)]
pub struct PwmTimer {
    hz: u64,
    running: bool,
    /// What the next update loads, unless `UDIS` is set.
    preload: Buffered,
    updates: bool,
    state: State,
}

/// `OCxM` of channel 0 to 3, and whether `OCxPE` is set.
fn output_control(registers: &RegisterFile, channel: usize) -> (u64, bool) {
    let [first, second] = [Register::Ccmr1Output, Register::Ccmr2Output].map(|r| registers.get(r));
    let pair = if channel < 2 { first } else { second };
    let own = pair >> (channel % 2 * 8);
    (own >> 4 & 7, own >> 3 & 1 != 0)
}

impl PwmTimer {
    /// The timer, its clock at `hz`.
    pub const fn with_clock(hz: u64) -> Self {
        let preload = Buffered {
            psc: 0,
            arr: MAX_COUNT,
            compare: [0; CHANNELS],
        };
        Self {
            hz,
            running: false,
            preload,
            updates: true,
            state: State {
                at: VirtualNanos(0),
                phase: 0,
                prescaled: 0,
                count: 0,
                flags: 0,
                shadow: preload,
            },
        }
    }

    /// The state at `now`.
    fn at(&self, now: VirtualNanos) -> State {
        let mut state = self.state;
        let elapsed = now.0.saturating_sub(state.at.0);
        state.at = now;
        if !self.running || self.hz == 0 {
            return state;
        }
        let second = u128::from(NANOS_PER_SECOND);
        let cycles = u128::from(elapsed) * u128::from(self.hz) + u128::from(state.phase);
        state.phase = low(cycles % second);
        let mut cycles = low(cycles / second) + state.prescaled;
        let top = state.top();
        let to_overflow = (top - state.count + 1) * (state.shadow.psc + 1);
        if state.shadow.arr != 0 && cycles >= to_overflow {
            cycles -= to_overflow;
            state.flag_matches(top, true);
            if self.updates {
                state.shadow = self.preload;
                state.flags |= sr::UIF.mask();
            }
            state.start_from(0);
            state.prescaled = 0;
            // From here on the periods are alike.
            let period = (state.shadow.arr + 1) * (state.shadow.psc + 1);
            if cycles >= period {
                cycles %= period;
                state.flag_matches(MAX_COUNT, true);
            }
        }
        if state.shadow.arr != 0 {
            let count = state.count + cycles / (state.shadow.psc + 1);
            state.prescaled = cycles % (state.shadow.psc + 1);
            state.flag_matches(count, false);
            state.count = count;
        }
        state
    }

    fn settle(&mut self, registers: &mut RegisterFile, now: VirtualNanos) {
        self.state = self.at(now);
        let flags = registers.get(Register::Sr) | std::mem::take(&mut self.state.flags);
        registers.set(Register::Sr, flags);
    }

    /// The share of the time that a channel (1 to 4) puts out a high level, 0..=1; none while its output is off.
    ///
    /// # Panics
    /// When there is no such channel.
    pub fn duty(&self, now: VirtualNanos, channel: u8, registers: &RegisterFile) -> Option<f64> {
        let nth = usize::from(channel) - 1;
        let enable = registers.get(Register::Ccer) >> (nth * 4);
        if enable & 1 == 0 {
            return None;
        }
        let state = self.at(now);
        let (compare, period) = (state.shadow.compare[nth], state.shadow.arr + 1);
        let below = if self.running {
            compare.min(period)
        } else {
            period * u64::from(state.count < compare)
        };
        let active = match output_control(registers, nth).0 {
            5 => period,
            6 => below,
            7 => period - below,
            _ => 0,
        };
        let active_low = enable >> 1 & 1 != 0;
        let high = if active_low { period - active } else { active };
        #[expect(clippy::cast_precision_loss, reason = "seventeen bits")]
        Some(high as f64 / period as f64)
    }

    fn report_unmodelled(registers: &RegisterFile, context: &mut DeviceContext<'_>) {
        let value = |register| registers.get(register);
        let modes = (0..CHANNELS).map(|nth| output_control(registers, nth).0);
        let on = |nth: usize| value(Register::Ccer) >> (4 * nth) & 1 != 0;
        let unbuffered = |nth| matches!(output_control(registers, nth), (6.., false));
        // CCxS of the two channels that a CCMR configures.
        let selections = (value(Register::Ccmr1Output) | value(Register::Ccmr2Output)) & 0x0303;
        let counts_otherwise = cr1::OPM.mask() | cr1::DIR.mask() | cr1::CMS.mask();
        let mut tell = |found, register, reason| {
            if found {
                context.tell(register, reason);
            }
        };
        let (interrupts, slave) = (value(Register::Dier), value(Register::Smcr) & 7);
        let reason = "its interrupts and DMA requests are not modelled";
        tell(interrupts != 0, "DIER", reason);
        tell(slave != 0, "SMCR", "its slave modes are not modelled");
        let trigger = value(Register::Cr2) != 0;
        tell(trigger, "CR2", "its trigger output is not modelled");
        let otherwise = value(Register::Cr1) & counts_otherwise != 0;
        tell(otherwise, "CR1", "it counts up and goes on");
        tell(selections != 0, "CCMR", "its captures are not modelled");
        let at_match = modes.into_iter().any(|mode| (1..=3).contains(&mode));
        let reason = "output modes that act at a match are not modelled";
        tell(at_match, "CCMR", reason);
        let at_once = (0..CHANNELS).any(|nth| on(nth) && unbuffered(nth));
        let reason = "PWM mode without preload, RM0383 13.4.7";
        tell(at_once, "CCER", reason);
    }

    /// Takes what the registers hold now.
    fn load(&mut self, registers: &RegisterFile) {
        let control = registers.get(Register::Cr1);
        let compare = [Ccr1, Ccr2, Ccr3, Ccr4];
        self.preload = Buffered {
            psc: registers.get(Register::Psc) & MAX_COUNT,
            arr: registers.get(Register::Arr) & MAX_COUNT,
            compare: compare.map(|register| registers.get(register) & MAX_COUNT),
        };
        self.running = cr1::CEN.is_set(control);
        self.updates = !cr1::UDIS.is_set(control);
        if !cr1::ARPE.is_set(control) {
            self.state.shadow.arr = self.preload.arr;
        }
        for nth in 0..CHANNELS {
            if !output_control(registers, nth).1 {
                self.state.shadow.compare[nth] = self.preload.compare[nth];
            }
        }
    }
}

/// A number of cycles: a run is shorter than 2^64 of them.
fn low(cycles: u128) -> u64 {
    u64::try_from(cycles).expect("a run is shorter than 2^64 cycles")
}

impl State {
    /// The count before the overflow, section 13.3.2.
    fn top(&self) -> u64 {
        if self.count <= self.shadow.arr {
            self.shadow.arr
        } else {
            MAX_COUNT
        }
    }

    /// Sets the flags of the channels matched on the way to `count`, and at the overflow those of values
    /// above `ARR` (section 13.4.5).
    fn flag_matches(&mut self, count: u64, overflows: bool) {
        for (nth, &compare) in self.shadow.compare.iter().enumerate() {
            let matched = (self.count + 1..=count).contains(&compare)
                || overflows && compare > self.shadow.arr;
            self.flags |= u64::from(matched) << (nth + 1);
        }
    }

    /// The counter goes on from `count`, which matches too.
    fn start_from(&mut self, count: u64) {
        self.count = count;
        for (nth, &compare) in self.shadow.compare.iter().enumerate() {
            self.flags |= u64::from(compare == count) << (nth + 1);
        }
    }
}

impl Device for PwmTimer {
    type Register = Register;

    fn read(
        &mut self,
        register: Register,
        registers: &mut RegisterFile,
        context: &mut DeviceContext<'_>,
    ) -> Option<u64> {
        self.settle(registers, context.now());
        (register == Register::Cnt).then_some(self.state.count)
    }

    fn peek(&self, register: Register, registers: &RegisterFile, now: VirtualNanos) -> Option<u64> {
        match register {
            Register::Cnt => Some(self.at(now).count),
            Register::Sr => Some(registers.get(register) | self.at(now).flags),
            _ => None,
        }
    }

    fn write(
        &mut self,
        register: Register,
        value: u64,
        registers: &mut RegisterFile,
        context: &mut DeviceContext<'_>,
    ) {
        self.settle(registers, context.now());
        match register {
            Register::Sr => registers.set(Register::Sr, registers.get(Register::Sr) & value),
            Register::Cnt => self.state.start_from(value & MAX_COUNT),
            _ => {
                let ran = self.running;
                self.load(registers);
                if self.running && !ran {
                    self.state.start_from(self.state.count);
                }
            }
        }
        if register == Register::Egr {
            registers.set(Register::Egr, 0);
            let mut flags = value & 0x1E;
            if egr::UG.is_set(value) {
                if self.updates {
                    self.state.shadow = self.preload;
                    let source = cr1::URS.is_set(registers.get(Register::Cr1));
                    flags |= u64::from(!source);
                }
                self.state.start_from(0);
                self.state.prescaled = 0;
            }
            registers.set(Register::Sr, registers.get(Register::Sr) | flags);
        }
        Self::report_unmodelled(registers, context);
    }

    fn on_clock(&mut self, hz: u64, registers: &mut RegisterFile, context: &mut DeviceContext<'_>) {
        self.settle(registers, context.now());
        self.hz = hz;
    }

    fn reset(&mut self) {
        *self = Self::with_clock(self.hz);
    }
}
