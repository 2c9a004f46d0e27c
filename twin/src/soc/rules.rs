//! What the manuals forbid and the models let pass: orders of accesses, and values that only several
//! blocks together make wrong. Each is reported as the models report, by [`crate::Board::unmodelled`].

use rigless::device::RegisterFile;
use rigless::emulator::{Access, AccessKind};
use rigless::soc::Layout;
use rigless::soc::stm32f427::generated as g;
use rigless::soc::stm32f427::generated::i2c3::Register::{Ccr, Cr1, Cr2, Trise};
use rigless::soc::stm32f427::generated::rcc::Register::{
    Ahb1rstr, Apb1rstr, Apb2lpenr, Apb2rstr, Cr,
};
use rigless::time::VirtualNanos;

use super::{Role, Stm32f411, memory_map};
use crate::pin::pin;
use crate::pinout;

const DMA1: u64 = 0x4002_6000;
const PWR_CR: u64 = 0x4000_7000;
const I2C1_CR1: u64 = 0x4000_5400;
const TIM1_CR1: u64 = 0x4001_0000;
const GPIOB_MODER: u64 = 0x4002_0400;
const ADC1_CR2: u64 = 0x4001_2008;
/// Port A's register of pulls, and the bits that tell the ports apart.
const PUPDR: u64 = 0x4002_000C;
const PORT_MASK: u64 = 0x1C00;
/// `RCC_AHB1RSTR` to `RCC_APB2RSTR`.
const RESETS: std::ops::RangeInclusive<u64> = 0x4002_3810..=0x4002_3824;

/// The alternate function that connects I2C1 to its pins.
const I2C_FUNCTION: Role = Role::Function(4);
/// Resistance of the sources at the converter's pins, ohms: the weaker of the two battery taps, docs/board.md.
const SOURCE_OHMS: f64 = 13_000.0;
/// Sampling cycles of each code of `SMPx`, RM0383 section 11.12.4.
const SAMPLING: [u32; 8] = [3, 15, 28, 56, 84, 112, 144, 480];
/// Clock limits at VOS scale 3, 2 and 1, megahertz, RM0383 section 5.4.1.
const SCALES: [u64; 4] = [64, 64, 84, 100];
/// HCLK that each number of wait states allows above 2.7 V, megahertz, RM0383 table 5.
const WAIT_STATES: [u64; 4] = [30, 64, 90, 100];

/// After a store that sets a stream's `EN`: ten cycles, nanoseconds. Drivers of F4 parts report streams that
/// hang where their control register is loaded at once; no manual does.
const ENABLING_NS: u64 = 100;

/// What the rules remember.
#[derive(Debug, Default)]
pub struct Rules {
    /// Streams that were switched off while items were left and not seen off since, DMA1's in the low byte.
    stopping: u16,
    /// Streams that the program has switched on.
    enabled: u16,
    /// The stream whose control register was stored last, if that set `EN`, and when.
    just_enabled: Option<(u16, VirtualNanos)>,
    /// I2C1 was reset by `SWRST` since its pins were connected.
    i2c_reset: bool,
    /// A block is held in reset.
    resets: bool,
    /// `VOS` as it was last written.
    vos: Option<u64>,
    /// HCLK, and what must suit it, when it was last looked at.
    clocks: [u64; 4],
}

impl Stm32f411 {
    /// Applies the rules to an access that the core has made; `value` is what was read or written.
    pub(crate) fn check_access(&mut self, access: &Access, value: u64) {
        if access.program_counter.is_none() {
            return;
        }
        let (now, write) = (access.virtual_time, access.kind == AccessKind::Write);
        if self.rules.resets {
            let slot = self.bus.slot_at(access.address);
            if let Some(slot) = slot.filter(|&slot| self.is_held_in_reset(slot)) {
                let reason = "accessed while RCC holds the block in reset, RM0383 6.3.5";
                self.tell(now, slot, "any", reason);
            }
        }
        match access.address {
            DMA1..0x4002_6800 => self.check_stream(now, access.address - DMA1, value, write),
            I2C1_CR1 if write => self.check_i2c(now, value),
            TIM1_CR1 if write && value & !self.block(self.slots.rcc).get(Apb2lpenr) & 1 != 0 => {
                let reason = "counts without a clock in Sleep, RM0383 6.3.15";
                self.tell(now, self.slots.tim1, "CR1", reason);
            }
            GPIOB_MODER if write && !self.i2c_connected() => {
                self.rules.i2c_reset = false;
                self.check_open_drain(now);
                if self.block(self.slots.i2c1).get(Cr1) & 1 != 0 {
                    let reason = "enabled without its pins: BUSY may be locked, RM0383 18.6.1";
                    self.tell(now, self.slots.i2c1, "CR1", reason);
                }
            }
            address if write && address & !PORT_MASK == PUPDR => self.check_pulls(now),
            ADC1_CR2 if write && value & (1 << 30 | 1 << 22) != 0 => {
                self.check_sampling(now, value & 1 << 22 != 0);
            }
            address if write && RESETS.contains(&address) => {
                let rcc = self.block(self.slots.rcc);
                let resets = [Ahb1rstr, Apb1rstr, Apb2rstr].map(|r| rcc.get(r));
                self.rules.resets = resets != [0; 3];
            }
            PWR_CR if write => {
                self.drive_supply_line(now);
                let vos = value >> 14 & 3;
                // Out of reset scale 2.
                let before = self.rules.vos.replace(vos).unwrap_or(0b10);
                if before != vos && self.block(self.slots.rcc).get(Cr) >> 24 & 1 != 0 {
                    let reason = "VOS is changed while the PLL is on, RM0383 5.4.1";
                    self.tell(now, self.slots.pwr, "CR", reason);
                }
            }
            _ => {}
        }
    }

    fn tell(
        &mut self,
        now: VirtualNanos,
        slot: usize,
        register: &'static str,
        reason: &'static str,
    ) {
        self.bus.drive(now, slot).1.tell(register, reason);
    }

    fn registers(&self, instance: &str) -> &RegisterFile {
        let registers = self.bus.registers(instance);
        registers.expect("an instance of the part")
    }

    fn is_held_in_reset(&self, slot: usize) -> bool {
        let name = self.bus.slots()[slot].peripheral().name;
        let mut clocked = memory_map::CLOCKED.into_iter();
        let Some((.., register, field)) = clocked.find(|row| row.0 == name) else {
            return false;
        };
        let mut rows = g::rcc::Register::ALL.into_iter();
        let row = rows.find(|row| row.spec().name == register);
        row.is_some_and(|row| {
            let mut fields = row.spec().fields.iter();
            let value = self.block(self.slots.rcc).get(row);
            fields.any(|known| known.name == field && known.is_set(value))
        })
    }

    /// RM0383 section 9.3.17: a stream's registers are written only once `EN` has been read as 0.
    fn check_stream(&mut self, now: VirtualNanos, offset: u64, value: u64, write: bool) {
        let (controller, register) = (offset >> 10, offset & 0x3FF);
        if !(0x10..0xD0).contains(&register) {
            return;
        }
        let (nth, register) = ((register - 0x10) / 0x18, (register - 0x10) % 0x18);
        let stream = 1 << (controller * 8 + nth);
        let enables = register == 0 && value & 1 != 0;
        let name = if controller == 0 { "DMA1" } else { "DMA2" };
        // Looked at as the items are set, since a pending request may move the first ones with EN.
        if write && register == 4 && self.has_flags(name, nth) {
            let reason = "set up with flags of its last transfer, RM0383 9.3.17";
            self.tell_stream(now, name, reason);
        }
        let rules = &mut self.rules;
        if write && register == 0 {
            rules.just_enabled = enables.then_some((stream, now));
        } else if register == 0
            && let Some((_, at)) = rules.just_enabled.filter(|&(just, _)| just == stream)
            && now.0 - at.0 < ENABLING_NS
        {
            self.tell_stream(
                now,
                name,
                "loaded right after EN was set: some streams hang",
            );
        }
        let rules = &mut self.rules;
        if write && rules.stopping & stream != 0 && (register != 0 || enables) {
            self.tell_stream(now, name, "set up before EN was read as 0, RM0383 9.3.17");
        } else if write && enables {
            rules.enabled |= stream;
        } else if write && register == 0 && rules.enabled & stream != 0 {
            rules.enabled &= !stream;
            let mut rows = g::dma2::Register::ALL.into_iter();
            let row = rows.find(|row| u64::from(row.spec().offset) == 0x14 + nth * 0x18);
            // A stream at its end is off already.
            if row.is_some_and(|row| self.registers(name).get(row) & 0xFFFF != 0) {
                self.rules.stopping |= stream;
            }
        } else if !write && register == 0 && !enables {
            rules.stopping &= !stream;
        }
    }

    /// Whether a flag of a controller's stream is set, RM0383 section 9.5.1.
    fn has_flags(&self, controller: &str, nth: u64) -> bool {
        let (low, high) = (g::dma2::Register::Lisr, g::dma2::Register::Hisr);
        let register = if nth < 4 { low } else { high };
        let place = [0, 6, 16, 22][(nth % 4) as usize];
        self.registers(controller).get(register) >> place & 0x3D != 0
    }

    fn tell_stream(&mut self, now: VirtualNanos, controller: &str, reason: &'static str) {
        let slot = self.bus.slot_of(controller).expect("a controller");
        self.tell(now, slot, "SxCR", reason);
    }

    /// DS10314 table 14: 5 V only where no pull is on; the board's echoes come with 5 V.
    fn check_pulls(&mut self, now: VirtualNanos) {
        for echo in pinout::RANGEFINDERS.map(|pins| pins.echo) {
            if self.pull(echo) != 0 {
                let reason = "5 V on a pin with a pull, DS10314 table 14";
                self.tell(now, self.slots.gpio[echo.port], "PUPDR", reason);
            }
        }
    }

    fn i2c_connected(&self) -> bool {
        [pinout::SCL, pinout::SDA].map(|pin| self.role(pin)) == [I2C_FUNCTION; 2]
    }

    /// Two ends drive the bus low: neither may drive it high.
    fn check_open_drain(&mut self, now: VirtualNanos) {
        for line in [pinout::SCL, pinout::SDA] {
            if matches!(self.role(line), Role::Output | I2C_FUNCTION) && !self.is_open_drain(line) {
                let reason = "a line of the I2C bus is not open drain, RM0383 8.3.10";
                self.tell(now, self.slots.gpio[line.port], "OTYPER", reason);
            }
        }
    }

    /// A write of I2C1's `CR1`.
    fn check_i2c(&mut self, now: VirtualNanos, value: u64) {
        if value & 1 << 15 != 0 {
            self.rules.i2c_reset = self.i2c_connected();
        }
        if value & 1 == 0 {
            return;
        }
        self.check_open_drain(now);
        let slot = self.slots.i2c1;
        if !self.rules.i2c_reset {
            self.tell(now, slot, "CR1", "enabled without SWRST after its pins were connected: BUSY may be locked, RM0383 18.6.1");
        }
        let registers = self.block(slot);
        let pclk = self.rcc.pclk1(self.block(self.slots.rcc));
        let [frequency, control, rise] = [Cr2, Ccr, Trise].map(|r| registers.get(r));
        let fast = control >> 15 & 1 != 0;
        let (low, high) = match control >> 14 & 3 {
            0b10 => (2, 1),
            0b11 => (16, 9),
            _ => (1, 1),
        };
        // The I2C specification's shortest low and high time and longest rise, nanoseconds.
        let (low_ns, high_ns, rise_ns) = if fast {
            (1_300, 600, 300)
        } else {
            (4_700, 4_000, 1_000)
        };
        let ns = |cycles: u64| cycles * (control & 0xFFF) * 1_000_000_000 / pclk.max(1);
        if (frequency & 0x3F) * 1_000_000 != pclk {
            self.tell(now, slot, "CR2", "FREQ is not APB1's clock, RM0383 18.6.2");
        }
        if ns(low) < low_ns || ns(high) < high_ns {
            let reason = "SCL is faster than the I2C specification allows, RM0383 18.6.8";
            self.tell(now, slot, "CCR", reason);
        }
        if (rise & 0x3F) != rise_ns * pclk / 1_000_000_000 + 1 {
            let reason = "not the longest rise in APB1 cycles plus one, RM0383 18.6.9";
            self.tell(now, slot, "TRISE", reason);
        }
    }

    /// The channels of a conversion that starts: analog pins, sampled for long enough.
    fn check_sampling(&mut self, now: VirtualNanos, injected: bool) {
        use g::adc1::Register::{Cr1, Jsqr, Smpr1, Smpr2, Sqr1, Sqr2, Sqr3};
        let adc = self.registers("ADC1");
        let divider = 2 * ((self.registers("C_ADC").get(g::c_adc::Register::Ccr) >> 16 & 3) + 1);
        let hz = self.rcc.pclk2(self.block(self.slots.rcc)) / divider;
        let field = |register, place: u64| adc.get(register) >> (5 * place) & 0x1F;
        let regular = (0..=adc.get(Sqr1) >> 20 & 0xF).map(|nth| match nth {
            0..=5 => field(Sqr3, nth),
            6..=11 => field(Sqr2, nth - 6),
            _ => field(Sqr1, nth - 12),
        });
        // The injected group follows by itself with JAUTO.
        let injected = injected || adc.get(Cr1) >> 10 & 1 != 0;
        let places = (3 - (adc.get(Jsqr) >> 20 & 3)..4).filter(|_| injected);
        let injected = places.map(|place| field(Jsqr, place));
        let mut reasons = Vec::new();
        if hz > 36_000_000 {
            reasons.push("the converter's clock is above 36 MHz, DS10314 table 66");
        }
        for channel in regular.chain(injected) {
            let (register, place) = if channel < 10 {
                (Smpr2, channel)
            } else {
                (Smpr1, channel - 10)
            };
            let code = usize::try_from(adc.get(register) >> (3 * place) & 7).expect("three bits");
            #[expect(clippy::cast_precision_loss, reason = "megahertz")]
            let hz = hz as f64;
            let cycles = f64::from(SAMPLING[code]);
            // DS10314 equation 1: twelve bits to a quarter of the last one, 4 pF behind 6 kΩ.
            let ohms = (cycles - 0.5) / (hz * 4e-12 * 14.0 * std::f64::consts::LN_2) - 6_000.0;
            let enough = if channel < 16 {
                ohms >= SOURCE_OHMS
            } else {
                cycles / hz >= 10e-6
            };
            if !enough {
                reasons.push(
                    "sampled too briefly for its source, DS10314 equation 1 and tables 70, 73",
                );
            }
            let number = u8::try_from(channel).expect("five bits");
            let pin = match number {
                0..=7 => Some(pin('A', number)),
                8..=9 => Some(pin('B', number - 8)),
                10..=15 => Some(pin('C', number - 10)),
                _ => None,
            };
            if pin.is_some_and(|pin| self.role(pin) != Role::Analog) {
                reasons.push("converts a pin that is not analog, RM0383 11.3.3");
            }
        }
        let slot = self.bus.slot_of("ADC1").expect("an instance of the part");
        for reason in reasons {
            self.tell(now, slot, "CR2", reason);
        }
    }

    /// A rising clock edge of the master at SPI1, at this rate, so many nanoseconds after the chip select fell.
    pub(crate) fn check_spi(&mut self, now: VirtualNanos, hz: u64, selected_ns: u64) {
        let pclk = self.rcc.pclk2(self.block(self.slots.rcc));
        let fastest = if self.pwr.supply() < 2_700 {
            20_000_000
        } else {
            38_000_000
        };
        // At most every other clock is a wave's edge of the same direction.
        let pad = 2 * self.fastest(pinout::MISO);
        let mut tell = |reason| self.tell(now, self.slots.spi, "DR", reason);
        if hz > fastest.min(pclk / 2) {
            tell("SCK is faster than the slave takes, RM0383 20.2.1, DS10314 6.3.19");
        }
        if hz > pad {
            tell("MISO's pad is too slow for SCK, DS10314 6.3.16");
        }
        if 2 * selected_ns * pclk < 3_000_000_000 {
            tell("SCK rises within 1.5 APB2 cycles of NSS, DS10314 6.3.19");
        }
    }

    /// The limits of the buses, the voltage scale and the flash, whenever one of them has changed.
    pub(super) fn check_clocks(&mut self, now: VirtualNanos) {
        let rcc = self.block(self.slots.rcc);
        let (hclk, pclk1, pclk2) = (self.rcc.hclk(rcc), self.rcc.pclk1(rcc), self.rcc.pclk2(rcc));
        let scale = self.block(self.slots.pwr).get(g::pwr::Register::Cr) >> 14 & 3;
        let latency = self.block(self.slots.flash).get(g::flash::Register::Acr) & 7;
        let clocks = [hclk, pclk1, scale, latency];
        if std::mem::replace(&mut self.rules.clocks, clocks) == clocks {
            return;
        }
        let allowed =
            |of: &[u64; 4], code: u64| of[usize::try_from(code).unwrap_or(3).min(3)] * 1_000_000;
        let mut tell = |reason| self.tell(now, self.slots.rcc, "CFGR", reason);
        if pclk1 > 50_000_000 {
            tell("APB1 is faster than 50 MHz, RM0383 6.3.3");
        }
        if pclk2 > 100_000_000 {
            tell("APB2 is faster than 100 MHz, RM0383 6.3.3");
        }
        if hclk > allowed(&SCALES, scale) {
            tell("HCLK is too fast for the regulator's scale, RM0383 5.4.1");
        }
        if hclk > allowed(&WAIT_STATES, latency) {
            tell("HCLK is too fast for the flash's wait states, RM0383 table 5");
        }
    }
}
