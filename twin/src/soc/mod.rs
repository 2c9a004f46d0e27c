//! The STM32F411RE: `rigless`'s models of the blocks it shares with the STM32F427, our own for what
//! `rigless` has none, on the bus of [`memory_map`].

mod io;
pub mod memory_map;
mod oscillators;
mod pins;
mod rules;

pub use pins::Role;

use rigless::cpu::armv7m::Dwt;
use rigless::device::{ErasedDevice, Level, RegisterFile, ResetCause};
use rigless::mcu::{Mcu, Operate};
use rigless::soc::stm32f427::generated as g;
use rigless::soc::stm32f427::peripherals::adc::{Adc, AdcCommon};
use rigless::soc::stm32f427::peripherals::dbg::Dbg;
use rigless::soc::stm32f427::peripherals::dma::Dma;
use rigless::soc::stm32f427::peripherals::flash::Flash;
use rigless::soc::stm32f427::peripherals::gpio::Gpio;
use rigless::soc::stm32f427::peripherals::iwdg::Iwdg;
use rigless::soc::stm32f427::peripherals::pwr::Pwr;
use rigless::soc::stm32f427::peripherals::rcc::{self, Rcc};
use rigless::soc::stm32f427::peripherals::rtc::Rtc;
use rigless::soc::stm32f427::peripherals::tim::{Advanced, Counter, General, Tim};
use rigless::soc::stm32f427::peripherals::usart::{Kind, Usart};
use rigless::soc::{Bus, Error};
use rigless::time::VirtualNanos;

use crate::peripherals::board_port::BoardPort;
use crate::peripherals::capture_timer::CaptureTimer;
use crate::peripherals::exti::{self, Exti};
use crate::peripherals::i2c_master::I2cPeripheral;
use crate::peripherals::pwm_timer::PwmTimer;
use crate::peripherals::spi_slave::SpiSlave;
use crate::peripherals::syscfg::Syscfg;
use crate::pin::PORTS;

/// The clock of every bus after reset, RM0383 section 6.2.2.
const RESET_HZ: u64 = rcc::HSI_HZ;

#[derive(Clone, Copy, Debug)]
enum Model {
    None,
    Rcc,
    Pwr,
    Gpio(usize),
    Usart(usize),
    I2c(usize),
    Flash,
    Adc,
    AdcCommon,
    Tim(usize),
    Tim1,
    Pwm,
    Capture,
    Dma(usize),
    Rtc,
    Dbg,
    Iwdg,
    Dwt,
    Spi,
    Exti,
    Syscfg,
    BoardPort,
}

/// The microcontroller.
#[derive(Debug)]
pub struct Stm32f411 {
    /// Reset and clock control.
    pub rcc: Rcc,
    /// Power control.
    pub pwr: Pwr,
    /// The ports, in the order of [`PORTS`].
    pub gpio: [Gpio; PORTS.len()],
    /// The serial ports, in the order of [`memory_map::SERIAL_PORTS`].
    pub usart: [Usart; memory_map::SERIAL_PORTS.len()],
    /// The I2C interfaces, in the order of [`memory_map::I2C`].
    pub i2c: [I2cPeripheral; memory_map::I2C.len()],
    /// The flash interface.
    pub flash: Flash,
    /// The converter.
    pub adc: Adc,
    /// Its common block.
    pub adc_common: AdcCommon,
    /// TIM2, TIM3 and TIM5.
    pub tim: [Tim<General>; memory_map::TIMERS.len()],
    /// TIM4.
    pub pwm: PwmTimer,
    /// TIM11.
    pub capture: CaptureTimer,
    /// TIM1.
    pub tim1: Tim<Advanced>,
    /// DMA1 and DMA2.
    pub dma: [Dma; 2],
    /// The backup domain.
    pub rtc: Rtc,
    /// The debug block.
    pub dbg: Dbg,
    /// The independent watchdog.
    pub iwdg: Iwdg,
    /// The cycle counter.
    pub dwt: Dwt,
    /// SPI1.
    pub spi: SpiSlave,
    /// The external interrupts.
    pub exti: Exti,
    /// Their multiplexer.
    pub syscfg: Syscfg,
    /// The connection to the board.
    pub board_port: BoardPort,
    rules: rules::Rules,
    /// Since when the crystal and the PLL have been on.
    on_since: [Option<VirtualNanos>; 2],
    bus: Bus,
    models: Box<[Model]>,
    slots: Slots,
}

#[derive(Clone, Copy, Debug)]
struct Slots {
    gpio: [usize; PORTS.len()],
    tim: [usize; memory_map::TIMERS.len()],
    tim1: usize,
    pwm: usize,
    i2c1: usize,
    usart1: usize,
    dma1: usize,
    spi: usize,
    rcc: usize,
    pwr: usize,
    flash: usize,
    exti: usize,
    board_port: usize,
}

impl Stm32f411 {
    /// The part out of reset, nothing on its pins.
    ///
    /// # Errors
    /// A description that contradicts itself.
    pub fn new() -> Result<Self, Error> {
        let bus = memory_map::bus()?;
        let mut models = vec![Model::None; bus.slots().len()].into_boxed_slice();
        let mut wire = |name: &'static str, field: Model| -> Result<usize, Error> {
            let slot = bus.slot(name)?;
            models[slot] = field;
            Ok(slot)
        };
        let mut slots = Slots {
            gpio: [0; PORTS.len()],
            tim: [0; memory_map::TIMERS.len()],
            tim1: wire("TIM1", Model::Tim1)?,
            pwm: wire("TIM4", Model::Pwm)?,
            i2c1: wire("I2C1", Model::I2c(0))?,
            usart1: wire("USART1", Model::Usart(0))?,
            dma1: wire("DMA1", Model::Dma(0))?,
            spi: wire("SPI1", Model::Spi)?,
            rcc: wire("RCC", Model::Rcc)?,
            pwr: wire("PWR", Model::Pwr)?,
            flash: wire("FLASH", Model::Flash)?,
            exti: wire("EXTI", Model::Exti)?,
            board_port: wire(crate::peripherals::board_port::NAME, Model::BoardPort)?,
        };
        for (nth, name) in PORTS.into_iter().enumerate() {
            slots.gpio[nth] = wire(name, Model::Gpio(nth))?;
        }
        for (nth, (name, _)) in memory_map::TIMERS.into_iter().enumerate() {
            slots.tim[nth] = wire(name, Model::Tim(nth))?;
        }
        for (name, field) in [
            ("USART2", Model::Usart(1)),
            ("USART6", Model::Usart(2)),
            ("I2C2", Model::I2c(1)),
            ("I2C3", Model::I2c(2)),
            ("ADC1", Model::Adc),
            ("C_ADC", Model::AdcCommon),
            ("DMA2", Model::Dma(1)),
            ("RTC", Model::Rtc),
            ("DBG", Model::Dbg),
            ("IWDG", Model::Iwdg),
            (rigless::cpu::armv7m::DWT, Model::Dwt),
            ("TIM11", Model::Capture),
            ("SYSCFG", Model::Syscfg),
        ] {
            wire(name, field)?;
        }
        let mut part = Self {
            rcc: Rcc::new(),
            pwr: Pwr::new(),
            gpio: std::array::from_fn(|_| Gpio::default()),
            usart: std::array::from_fn(|_| Usart::with_clock(Kind::Usart, RESET_HZ)),
            i2c: std::array::from_fn(|_| I2cPeripheral::with_clock(RESET_HZ)),
            flash: Flash::with_clock(RESET_HZ),
            // Section 11.13.16: ADCPRE resets to a division by two.
            adc: Adc::with_clock(RESET_HZ / 2),
            adc_common: AdcCommon::with_clock(RESET_HZ),
            tim: memory_map::TIMERS.map(|(_, counter)| Tim::with_clock(RESET_HZ, counter)),
            pwm: PwmTimer::with_clock(RESET_HZ),
            capture: CaptureTimer::with_clock(RESET_HZ),
            tim1: Tim::with_clock(RESET_HZ, Counter::Narrow).breaks_on("RCC", rcc::CLOCK_FAILURE),
            dma: [
                Dma::new(&memory_map::DMA1_REQUESTS, &[], false),
                Dma::new(&memory_map::DMA2_REQUESTS, &[], true),
            ],
            rtc: Rtc,
            dbg: Dbg,
            iwdg: Iwdg::new(),
            dwt: Dwt::with_clock(RESET_HZ),
            spi: SpiSlave::default(),
            exti: Exti::default(),
            syscfg: Syscfg::default(),
            board_port: BoardPort::default(),
            rules: rules::Rules::default(),
            on_since: [None; 2],
            bus,
            models,
            slots,
        };
        part.check()?;
        Ok(part)
    }

    /// The board's rail, in millivolts, for the supervisor, the flash and the converter.
    pub fn set_supply(&mut self, now: VirtualNanos, millivolts: u32) {
        let registers = self.bus.slot_mut(self.slots.pwr).registers_mut();
        self.pwr.set_supply(millivolts, registers);
        if let Some(millivolts) = std::num::NonZeroU32::new(millivolts) {
            self.flash.set_supply(millivolts);
        }
        self.adc.set_reference(millivolts);
        self.drive_supply_line(now);
    }

    /// Drives EXTI's line of the supply detector with its output.
    fn drive_supply_line(&mut self, now: VirtualNanos) {
        let status = self.block(self.slots.pwr).get(g::pwr::Register::Csr);
        let low = Level::from(g::pwr::csr::PVDO.is_set(status));
        let (registers, mut context) = self.bus.drive(now, self.slots.exti);
        self.exti.drive(exti::SUPPLY, low, registers, &mut context);
    }

    /// The option bytes, as `FLASH_OPTCR` shows them (RM0383, 3.8.6); a reset keeps them.
    pub fn set_option_bytes(&mut self, word: u64) {
        let flash = self.bus.slot_mut(self.slots.flash).registers_mut();
        flash.set(g::flash::Register::Optcr, word);
    }

    /// Sets bits of the clock controller that no access of the program has set.
    pub fn set_rcc_bits(&mut self, register: g::rcc::Register, bits: u64) {
        let registers = self.bus.slot_mut(self.slots.rcc).registers_mut();
        registers.set(register, registers.get(register) | bits);
    }

    /// Requests a stop at `at`.
    pub fn wake_at(&mut self, now: VirtualNanos, at: VirtualNanos) {
        self.bus.drive(now, self.slots.board_port).1.schedule(at);
    }

    /// The registers of the instance in this slot of the bus.
    fn block(&self, slot: usize) -> &RegisterFile {
        self.bus.slots()[slot].registers()
    }

    /// The crystal's clock behind the RTC's prescaler, RM0383 section 6.3.3; 0 while it stands.
    fn crystal_for_rtc_hz(&self) -> u64 {
        let registers = self.block(self.slots.rcc);
        let runs = g::rcc::cr::HSERDY.is_set(registers.get(g::rcc::Register::Cr));
        let divider = g::rcc::cfgr::RTCPRE.get(registers.get(g::rcc::Register::Cfgr));
        let crystal_hz = if runs { self.rcc.crystals().0 } else { 0 };
        crystal_hz.checked_div(divider).unwrap_or(0)
    }

    /// Sets whether the byte in transfer on I2C1 is the last of its DMA stream.
    fn update_next_is_last(&mut self) {
        let registers = self.block(self.slots.i2c1);
        if !I2cPeripheral::uses_last(registers) {
            self.i2c[0].next_is_last = false;
            return;
        }
        let waiting = u64::from(I2cPeripheral::has_byte(registers));
        let streams = self.block(self.slots.dma1);
        let last = I2C1_RECEIVERS.iter().any(|&(control, count)| {
            let control = streams.get(control);
            let enabled = g::dma2::s0cr::EN.is_set(control);
            let channel = g::dma2::s0cr::CHSEL.get(control);
            let left = streams.get(count) & 0xFFFF;
            enabled && channel == 1 && left.saturating_sub(waiting) == 1
        });
        self.i2c[0].next_is_last = last;
    }
}

/// The streams of DMA1 that can receive from I2C1: control and count.
const I2C1_RECEIVERS: [(g::dma2::Register, g::dma2::Register); 2] = [
    (g::dma2::Register::S0cr, g::dma2::Register::S0ndtr),
    (g::dma2::Register::S5cr, g::dma2::Register::S5ndtr),
];

impl Mcu for Stm32f411 {
    fn bus(&self) -> &Bus {
        &self.bus
    }

    fn bus_mut(&mut self) -> &mut Bus {
        &mut self.bus
    }

    /// A system reset, RM0383 section 6.1.1: a fresh part with the board's levels on its pins, the
    /// reset flags with `cause`'s beside the earlier ones, the backup domain unchanged.
    fn reset(&mut self, at: VirtualNanos, cause: ResetCause) {
        let mut fresh = Self::new().expect("a part that assembled once assembles again");
        let old = self.block(self.slots.rcc);
        let clocks = fresh.bus.slot_mut(fresh.slots.rcc).registers_mut();
        let flags = old.get(g::rcc::Register::Csr);
        fresh.rcc.restarted(cause, flags, clocks);
        clocks.set(g::rcc::Register::Bdcr, old.get(g::rcc::Register::Bdcr));
        let (hse, lse) = self.rcc.crystals();
        fresh.rcc.attach_crystals(hse, lse);
        fresh.set_supply(at, self.pwr.supply());
        let flash = self.block(self.slots.flash);
        fresh.set_option_bytes(flash.get(g::flash::Register::Optcr));
        for (fresh, old) in fresh.usart.iter_mut().zip(&mut self.usart) {
            fresh.inherit(old);
        }
        for (fresh, old) in fresh.i2c.iter_mut().zip(&mut self.i2c) {
            fresh.inner.inherit(&mut old.inner);
        }
        fresh.adc.inherit(&self.adc);
        fresh.spi.prefetch = self.spi.prefetch;
        let rtc = self.bus.slot_of("RTC").expect("an instance of the part");
        let backup = fresh.bus.slot_mut(rtc).registers_mut();
        for register in g::rtc::Register::ALL {
            backup.set(register, self.block(rtc).get(register));
        }
        let kept = fresh.bus.keep_added(&self.bus);
        kept.expect("a part rebuilt from its own description");
        *self = fresh;
    }

    /// Only the serial ports depend on the outside.
    fn poll(&mut self, now: VirtualNanos) {
        self.update_next_is_last();
        self.update_ready_flags(now);
        self.check_clocks(now);
        let (registers, mut context) = self.bus.drive(now, self.slots.usart1);
        rigless::device::Device::poll(&mut self.usart[0], registers, &mut context);
    }

    fn split(&mut self, slot: usize) -> (&mut Bus, Option<&mut dyn ErasedDevice>) {
        let field = self.models.get(slot).copied().unwrap_or(Model::None);
        let model: Option<&mut dyn ErasedDevice> = match field {
            Model::None => None,
            Model::Rcc => Some(&mut self.rcc),
            Model::Pwr => Some(&mut self.pwr),
            Model::Gpio(nth) => Some(&mut self.gpio[nth]),
            Model::Usart(nth) => Some(&mut self.usart[nth]),
            Model::I2c(nth) => Some(&mut self.i2c[nth]),
            Model::Flash => Some(&mut self.flash),
            Model::Adc => Some(&mut self.adc),
            Model::AdcCommon => Some(&mut self.adc_common),
            Model::Tim(nth) => Some(&mut self.tim[nth]),
            Model::Tim1 => Some(&mut self.tim1),
            Model::Pwm => Some(&mut self.pwm),
            Model::Capture => {
                self.capture.input_hz = self.crystal_for_rtc_hz();
                Some(&mut self.capture)
            }
            Model::Dma(nth) => Some(&mut self.dma[nth]),
            Model::Rtc => Some(&mut self.rtc),
            Model::Dbg => Some(&mut self.dbg),
            Model::Iwdg => Some(&mut self.iwdg),
            Model::Dwt => Some(&mut self.dwt),
            Model::Spi => Some(&mut self.spi),
            Model::Exti => Some(&mut self.exti),
            Model::Syscfg => Some(&mut self.syscfg),
            Model::BoardPort => Some(&mut self.board_port),
        };
        (&mut self.bus, model)
    }
}

#[cfg(test)]
mod tests;
