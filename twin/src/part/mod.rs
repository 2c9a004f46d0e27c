//! The STM32F411RE: `rigless`'s models of the blocks it shares with the STM32F427, our own for what
//! `rigless` has none, on the bus of [`map`].

pub mod map;

use rigless::cpu::armv7m::Dwt;
use rigless::device::{DeviceContext, ErasedDevice, Level, RegisterFile, ResetCause};
use rigless::edge::Pulse;
use rigless::mcu::{Mcu, Operate};
use rigless::soc::stm32f427::generated as g;
use rigless::soc::stm32f427::peripherals::adc::{Adc, AdcCommon};
use rigless::soc::stm32f427::peripherals::dbg::Dbg;
use rigless::soc::stm32f427::peripherals::dma::Dma;
use rigless::soc::stm32f427::peripherals::flash::Flash;
use rigless::soc::stm32f427::peripherals::gpio::{self, Gpio};
use rigless::soc::stm32f427::peripherals::iwdg::Iwdg;
use rigless::soc::stm32f427::peripherals::pwr::Pwr;
use rigless::soc::stm32f427::peripherals::rcc::{self, Rcc};
use rigless::soc::stm32f427::peripherals::rtc::Rtc;
use rigless::soc::stm32f427::peripherals::tim::{Advanced, Channel, Counter, General, Tim};
use rigless::soc::stm32f427::peripherals::usart::{Kind, Usart};
use rigless::soc::{Bus, Error};
use rigless::time::VirtualNanos;

use crate::devices::exti::Exti;
use crate::devices::i2c_master::I2cMaster;
use crate::devices::outside::{Outside, PinChange};
use crate::devices::spi_slave::SpiSlave;
use crate::devices::syscfg::Syscfg;
use map::PORTS;

/// A pin of the part.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Pin {
    /// Its port's place in [`map::PORTS`].
    pub port: usize,
    /// 0 to 15.
    pub number: u8,
}

/// The pin `P<port><number>`.
///
/// # Panics
/// When the part has no such port or pin; the names are constants of this crate.
#[must_use]
pub const fn pin(port: char, number: u8) -> Pin {
    let port = match port {
        'A' => 0,
        'B' => 1,
        'C' => 2,
        'D' => 3,
        'E' => 4,
        'H' => 5,
        _ => panic!("ports A to E and H"),
    };
    assert!(number < 16, "a port has sixteen pins");
    Pin { port, number }
}

impl Pin {
    fn gpio(self) -> gpio::Pin {
        gpio::Pin::new(self.number).expect("checked when the pin was named")
    }
}

/// What a pin is configured to be, RM0383 section 8.4.1.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Role {
    /// A digital input.
    Input,
    /// A digital output.
    Output,
    /// The alternate function with this number.
    Function(u8),
    /// Analog.
    Analog,
}

/// What runs on every bus until a firmware touches the clock tree, RM0383 section 6.2.2.
const RESET_HZ: u64 = rcc::HSI_HZ;

#[derive(Clone, Copy, Debug)]
enum Field {
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
    Dma(usize),
    Rtc,
    Dbg,
    Iwdg,
    Dwt,
    Spi,
    Exti,
    Syscfg,
    Outside,
}

/// The microcontroller.
#[derive(Debug)]
pub struct Stm32f411 {
    /// Reset and clock control.
    pub rcc: Rcc,
    /// Power control.
    pub pwr: Pwr,
    /// The ports, in the order of [`map::PORTS`].
    pub gpio: [Gpio; PORTS.len()],
    /// The serial ports, in the order of [`map::SERIAL_PORTS`].
    pub usart: [Usart; map::SERIAL_PORTS.len()],
    /// The I2C interfaces, in the order of [`map::I2C`].
    pub i2c: [I2cMaster; map::I2C.len()],
    /// The flash interface.
    pub flash: Flash,
    /// The converter.
    pub adc: Adc,
    /// Its common block.
    pub adc_common: AdcCommon,
    /// TIM2 to TIM5.
    pub tim: [Tim<General>; map::TIMERS.len()],
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
    /// The door to the board.
    pub outside: Outside,
    bus: Bus,
    wiring: Box<[Field]>,
    slots: Slots,
}

#[derive(Clone, Copy, Debug)]
struct Slots {
    gpio: [usize; PORTS.len()],
    tim: [usize; map::TIMERS.len()],
    i2c1: usize,
    usart1: usize,
    dma1: usize,
    spi: usize,
    rcc: usize,
    pwr: usize,
    outside: usize,
}

impl Stm32f411 {
    /// The part out of reset, nothing on its pins.
    ///
    /// # Errors
    /// A description that contradicts itself.
    pub fn new() -> Result<Self, Error> {
        let bus = map::bus()?;
        let mut wiring = vec![Field::None; bus.slots().len()].into_boxed_slice();
        let mut wire = |name: &'static str, field: Field| -> Result<usize, Error> {
            let slot = bus.slot(name)?;
            wiring[slot] = field;
            Ok(slot)
        };
        let mut slots = Slots {
            gpio: [0; PORTS.len()],
            tim: [0; map::TIMERS.len()],
            i2c1: 0,
            usart1: wire("USART1", Field::Usart(0))?,
            dma1: wire("DMA1", Field::Dma(0))?,
            spi: wire("SPI1", Field::Spi)?,
            rcc: wire("RCC", Field::Rcc)?,
            pwr: wire("PWR", Field::Pwr)?,
            outside: wire(crate::devices::outside::NAME, Field::Outside)?,
        };
        for (nth, name) in PORTS.into_iter().enumerate() {
            slots.gpio[nth] = wire(name, Field::Gpio(nth))?;
        }
        for (nth, (name, _)) in map::TIMERS.into_iter().enumerate() {
            slots.tim[nth] = wire(name, Field::Tim(nth))?;
        }
        for (nth, name) in map::I2C.into_iter().enumerate() {
            let slot = wire(name, Field::I2c(nth))?;
            if nth == 0 {
                slots.i2c1 = slot;
            }
        }
        wire("USART2", Field::Usart(1))?;
        wire("USART6", Field::Usart(2))?;
        for (name, field) in [
            ("FLASH", Field::Flash),
            ("ADC1", Field::Adc),
            ("C_ADC", Field::AdcCommon),
            ("TIM1", Field::Tim1),
            ("DMA2", Field::Dma(1)),
            ("RTC", Field::Rtc),
            ("DBG", Field::Dbg),
            ("IWDG", Field::Iwdg),
            (rigless::cpu::armv7m::DWT, Field::Dwt),
            ("EXTI", Field::Exti),
            ("SYSCFG", Field::Syscfg),
        ] {
            wire(name, field)?;
        }
        let mut part = Self {
            rcc: Rcc::new(),
            pwr: Pwr::new(),
            gpio: std::array::from_fn(|_| Gpio::default()),
            usart: std::array::from_fn(|_| Usart::with_clock(Kind::Usart, RESET_HZ)),
            i2c: std::array::from_fn(|_| I2cMaster::with_clock(RESET_HZ)),
            flash: Flash::with_clock(RESET_HZ),
            // Section 11.13.16: ADCPRE resets to a division by two.
            adc: Adc::with_clock(RESET_HZ / 2),
            adc_common: AdcCommon::with_clock(RESET_HZ),
            tim: map::TIMERS.map(|(_, counter)| Tim::with_clock(RESET_HZ, counter)),
            tim1: Tim::with_clock(RESET_HZ, Counter::Narrow).breaks_on("RCC", rcc::CLOCK_FAILURE),
            dma: [
                Dma::new(&map::DMA1_REQUESTS, &[], false),
                Dma::new(&map::DMA2_REQUESTS, &[], true),
            ],
            rtc: Rtc,
            dbg: Dbg,
            iwdg: Iwdg::new(),
            dwt: Dwt::with_clock(RESET_HZ),
            spi: SpiSlave::default(),
            exti: Exti::default(),
            syscfg: Syscfg::default(),
            outside: Outside::default(),
            bus,
            wiring,
            slots,
        };
        part.check()?;
        Ok(part)
    }

    /// The board's rail, in millivolts, for the supervisor, the flash and the converter.
    pub fn set_supply(&mut self, millivolts: u32) {
        let registers = self.bus.slot_mut(self.slots.pwr).registers_mut();
        self.pwr.set_supply(millivolts, registers);
        if let Some(millivolts) = std::num::NonZeroU32::new(millivolts) {
            self.flash.set_supply(millivolts);
        }
        self.adc.set_reference(millivolts);
    }

    /// The instant the run is to come back to the board at.
    pub fn wake_at(&mut self, now: VirtualNanos, at: VirtualNanos) {
        self.bus.drive(now, self.slots.outside).1.schedule(at);
    }

    /// The followed pins that changed since the last call.
    pub fn take_pin_changes(&mut self) -> Vec<PinChange> {
        self.outside.take_changes()
    }

    /// Puts `level` on a pin from outside, or lets it float.
    pub fn drive_pin(&mut self, now: VirtualNanos, pin: Pin, level: Option<Level>) {
        let (registers, mut context) = self.bus.drive(now, self.slots.gpio[pin.port]);
        self.gpio[pin.port].drive(pin.gpio(), level, registers, &mut context);
    }

    /// The level on the wire of a pin.
    #[must_use]
    pub fn pin_level(&self, pin: Pin) -> Level {
        self.gpio[pin.port].level(pin.gpio(), self.port(pin))
    }

    /// What the pin is configured to be.
    #[must_use]
    pub fn role(&self, pin: Pin) -> Role {
        let registers = self.port(pin);
        match registers.get(g::gpioa::Register::Moder) >> (pin.number * 2) & 3 {
            0 => Role::Input,
            1 => Role::Output,
            2 => Role::Function(Gpio::function(pin.gpio(), registers).unwrap_or_default()),
            _ => Role::Analog,
        }
    }

    /// The level the firmware drives on a pin, `None` where it drives none.
    #[must_use]
    pub fn output(&self, pin: Pin) -> Option<Level> {
        let registers = self.port(pin);
        let bit = |register| registers.get(register) >> pin.number & 1 != 0;
        match self.role(pin) {
            Role::Output => {
                let high = bit(g::gpioa::Register::Odr);
                let open_drain = bit(g::gpioa::Register::Otyper);
                (!(high && open_drain)).then_some(Level::from(high))
            }
            _ => None,
        }
    }

    fn port(&self, pin: Pin) -> &RegisterFile {
        self.bus.slots()[self.slots.gpio[pin.port]].registers()
    }

    /// Puts `level` on the input of a channel (1 to 4) of TIM2 to TIM5 (0 to 3).
    ///
    /// # Panics
    /// When there is no such channel or timer.
    pub fn drive_timer(&mut self, now: VirtualNanos, nth: usize, channel: u8, level: Level) {
        let channel = Channel::new(channel).expect("a timer has four channels");
        let (registers, mut context) = self.bus.drive(now, self.slots.tim[nth]);
        self.tim[nth].drive_input(channel, level, registers, &mut context);
    }

    /// The pulse a channel (1 to 4) of TIM2 to TIM5 (0 to 3) puts out, and its level for an output
    /// that repeats none.
    ///
    /// # Panics
    /// When there is no such channel or timer.
    #[must_use]
    pub fn pulse(&self, nth: usize, channel: u8) -> (Option<Pulse>, Option<Level>) {
        let channel = Channel::new(channel).expect("a timer has four channels");
        let registers = self.bus.slots()[self.slots.tim[nth]].registers();
        (
            self.tim[nth].pulse(channel, registers),
            self.tim[nth].output(channel, registers),
        )
    }

    /// Hands the SPI slave an input the bus does not carry.
    pub fn drive_spi<T>(
        &mut self,
        now: VirtualNanos,
        input: impl FnOnce(&mut SpiSlave, &mut RegisterFile, &mut DeviceContext<'_>) -> T,
    ) -> T {
        let (registers, mut context) = self.bus.drive(now, self.slots.spi);
        input(&mut self.spi, registers, &mut context)
    }

    /// The SPI slave's registers.
    #[must_use]
    pub fn spi_registers(&self) -> &RegisterFile {
        self.bus.slots()[self.slots.spi].registers()
    }

    /// Somebody on I2C1's wires holds one low, or lets go.
    pub fn hold_i2c1_low(&mut self, now: VirtualNanos, held: bool) {
        let (registers, mut context) = self.bus.drive(now, self.slots.i2c1);
        self.i2c[0].hold_low(held, registers, &mut context);
    }

    /// The crystal stops while it runs.
    pub fn fail_crystal(&mut self, now: VirtualNanos) {
        let (registers, mut context) = self.bus.drive(now, self.slots.rcc);
        self.rcc.fail_hse(registers, &mut context);
    }

    /// The bit rate USART1 is set to, RM0383 section 19.3.4, or zero while it is off.
    #[must_use]
    pub fn usart1_baud(&self) -> u64 {
        let registers = self.bus.slots()[self.slots.usart1].registers();
        let clocks = self.bus.slots()[self.slots.rcc].registers();
        let divider = registers.get(g::usart6::Register::Brr) & 0xFFFF;
        let over8 = registers.get(g::usart6::Register::Cr1) >> 15 & 1 != 0;
        let sixteenths = if over8 {
            (divider >> 3) * 16 / 2 + (divider & 7)
        } else {
            divider
        };
        self.rcc.pclk2(clocks).checked_div(sixteenths).unwrap_or(0)
    }

    /// `rigless` lets an oscillator without a crystal become ready at no frequency. The silicon's
    /// never does (RM0383 section 6.2.1: the flag says whether it is stable).
    fn keep_a_missing_crystal_still(&mut self) {
        if self.rcc.crystals().0 == 0 {
            let registers = self.bus.slot_mut(self.slots.rcc).registers_mut();
            let control = registers.get(g::rcc::Register::Cr);
            if g::rcc::cr::HSERDY.is_set(control) {
                registers.set(g::rcc::Register::Cr, g::rcc::cr::HSERDY.set(control, 0));
            }
        }
    }

    /// Tells I2C1 whether the byte on its wires is the last one its DMA stream takes.
    fn watch_the_last_byte(&mut self) {
        let registers = self.bus.slots()[self.slots.i2c1].registers();
        if !I2cMaster::receives_to_the_last(registers) {
            self.i2c[0].next_is_last(false);
            return;
        }
        let waiting = u64::from(I2cMaster::has_byte(registers));
        let streams = self.bus.slots()[self.slots.dma1].registers();
        let last = I2C1_RECEIVERS.iter().any(|&(control, count)| {
            let control = streams.get(control);
            let enabled = g::dma2::s0cr::EN.is_set(control);
            let channel = g::dma2::s0cr::CHSEL.get(control);
            let left = streams.get(count) & 0xFFFF;
            enabled && channel == 1 && left.saturating_sub(waiting) == 1
        });
        self.i2c[0].next_is_last(last);
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

    /// A system reset, RM0383 section 6.1.1: a fresh part with what the board put on its pins, the
    /// reset flags carrying `cause`'s beside the ones before, the backup domain as it was.
    fn reset(&mut self, _at: VirtualNanos, cause: ResetCause) {
        let mut fresh = Self::new().expect("a part that assembled once assembles again");
        let flags = self.bus.slots()[self.slots.rcc]
            .registers()
            .get(g::rcc::Register::Csr);
        fresh.rcc.restarted(
            cause,
            flags,
            fresh.bus.slot_mut(fresh.slots.rcc).registers_mut(),
        );
        let (hse, lse) = self.rcc.crystals();
        fresh.rcc.attach_crystals(hse, lse);
        fresh.set_supply(self.pwr.supply());
        for (fresh, old) in fresh.usart.iter_mut().zip(&mut self.usart) {
            fresh.inherit(old);
        }
        for (fresh, old) in fresh.i2c.iter_mut().zip(&mut self.i2c) {
            fresh.inner.inherit(&mut old.inner);
        }
        fresh.adc.inherit(&self.adc);
        fresh.outside.inherit(&self.outside);
        for (name, registers) in [("RTC", None), ("RCC", Some(g::rcc::Register::Bdcr))] {
            let slot = self.bus.slot_of(name).expect("an instance of the part");
            let old = self.bus.slots()[slot].registers();
            let new = fresh.bus.slot_mut(slot).registers_mut();
            match registers {
                Some(register) => new.set(register, old.get(register)),
                None => {
                    for register in g::rtc::Register::ALL {
                        new.set(register, old.get(register));
                    }
                }
            }
        }
        fresh
            .bus
            .keep_added(&self.bus)
            .expect("a part rebuilt from its own description");
        *self = fresh;
    }

    /// Only the serial ports look outside.
    fn poll(&mut self, now: VirtualNanos) {
        self.watch_the_last_byte();
        self.keep_a_missing_crystal_still();
        let (registers, mut context) = self.bus.drive(now, self.slots.usart1);
        rigless::device::Device::poll(&mut self.usart[0], registers, &mut context);
    }

    fn split(&mut self, slot: usize) -> (&mut Bus, Option<&mut dyn ErasedDevice>) {
        let field = self.wiring.get(slot).copied().unwrap_or(Field::None);
        let model: Option<&mut dyn ErasedDevice> = match field {
            Field::None => None,
            Field::Rcc => Some(&mut self.rcc),
            Field::Pwr => Some(&mut self.pwr),
            Field::Gpio(nth) => Some(&mut self.gpio[nth]),
            Field::Usart(nth) => Some(&mut self.usart[nth]),
            Field::I2c(nth) => Some(&mut self.i2c[nth]),
            Field::Flash => Some(&mut self.flash),
            Field::Adc => Some(&mut self.adc),
            Field::AdcCommon => Some(&mut self.adc_common),
            Field::Tim(nth) => Some(&mut self.tim[nth]),
            Field::Tim1 => Some(&mut self.tim1),
            Field::Dma(nth) => Some(&mut self.dma[nth]),
            Field::Rtc => Some(&mut self.rtc),
            Field::Dbg => Some(&mut self.dbg),
            Field::Iwdg => Some(&mut self.iwdg),
            Field::Dwt => Some(&mut self.dwt),
            Field::Spi => Some(&mut self.spi),
            Field::Exti => Some(&mut self.exti),
            Field::Syscfg => Some(&mut self.syscfg),
            Field::Outside => Some(&mut self.outside),
        };
        (&mut self.bus, model)
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use rigless::emulator::{Error, Memory};
    use rigless::soc::Width;

    /// A part on the bench: driven register by register, with a little memory for its DMA.
    pub(crate) struct Bench {
        pub(crate) part: Stm32f411,
        pub(crate) ram: [u8; 64],
        now: VirtualNanos,
    }

    struct Ram<'a>(&'a mut [u8; 64]);

    impl Memory for Ram<'_> {
        fn read(&mut self, address: u64, width: Width) -> Result<u64, Error> {
            let byte = usize::try_from(address - Bench::RAM).ok();
            byte.and_then(|byte| self.0.get(byte))
                .filter(|_| width == Width::W8)
                .map(|&byte| u64::from(byte))
                .ok_or(Error::Memory { address, width })
        }

        fn write(&mut self, address: u64, width: Width, value: u64) -> Result<(), Error> {
            let byte = usize::try_from(address - Bench::RAM).ok();
            let byte = byte.and_then(|byte| self.0.get_mut(byte));
            let byte = byte.filter(|_| width == Width::W8);
            *byte.ok_or(Error::Memory { address, width })? = value.to_le_bytes()[0];
            Ok(())
        }
    }

    impl Bench {
        /// Where its memory is.
        pub(crate) const RAM: u64 = 0x2000_0000;

        pub(crate) fn new() -> Self {
            Self {
                part: Stm32f411::new().unwrap(),
                ram: [0; 64],
                now: VirtualNanos(0),
            }
        }

        fn settle(&mut self) {
            self.part.settle(&mut Ram(&mut self.ram)).unwrap();
        }

        pub(crate) fn write(&mut self, address: u64, value: u64) {
            self.part
                .write(self.now, address, Width::W32, value)
                .unwrap();
            self.settle();
        }

        pub(crate) fn read(&mut self, address: u64) -> u64 {
            let value = self.part.read(self.now, address, Width::W32).unwrap();
            self.settle();
            value
        }

        pub(crate) fn hold_i2c1_low(&mut self, held: bool) {
            self.part.hold_i2c1_low(self.now, held);
            self.settle();
        }

        /// Lets virtual time pass as the emulator does: from event to event.
        pub(crate) fn run(&mut self, ns: u64) {
            let ends = VirtualNanos(self.now.0 + ns);
            while let Some(at) = self.part.next_event().filter(|&at| at <= ends) {
                self.now = at;
                self.part.advance_to(at);
                self.part.poll(at);
                self.settle();
            }
            self.now = ends;
        }
    }

    /// Lets the part reach its next steady state.
    pub(crate) fn settle(part: &mut Stm32f411) {
        part.settle(&mut Ram(&mut [0; 64])).unwrap();
    }

    #[test]
    fn the_part_has_the_memories_of_its_name() {
        let part = Stm32f411::new().unwrap();
        let size = |name| {
            part.bus()
                .memory()
                .iter()
                .find(|region| region.name == name)
                .map(|region| region.size)
        };
        assert_eq!(size("flash"), Some(512 << 10));
        assert_eq!(size("sram"), Some(128 << 10));
    }

    #[test]
    fn a_peripheral_without_its_clock_refuses() {
        let mut part = Stm32f411::new().unwrap();
        let dr = 0x4001_300C;
        assert!(part.read(VirtualNanos(0), dr, Width::W32).is_err());
        part.write(VirtualNanos(0), 0x4002_3844, Width::W32, 1 << 12)
            .unwrap();
        assert!(part.read(VirtualNanos(0), dr, Width::W32).is_ok());
    }
}
