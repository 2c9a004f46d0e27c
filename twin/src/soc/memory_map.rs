//! The STM32F411RE as a bus: its memories, its instances, which clock-controller bit gates and
//! resets each, and which DMA stream serves which request. From RM0383 rev 3 (tables 1, 27, 28, 38;
//! chapter 6) and the STM32F411xC/xE datasheet; the register layouts and the corrections of the
//! vendor's file are `rigless`'s for the STM32F427, whose blocks are the same.

use std::num::{NonZeroU32, NonZeroU64};

use rigless::soc::stm32f427::generated as g;
use rigless::soc::stm32f427::peripherals::{adc, dma::Wire, flash, i2c, tim, usart};
use rigless::soc::{
    Builder, Bus, Cpu, Endian, EraseBlocks, Error, Gate, Peripheral, Region, WriteModify,
};

use crate::peripherals::{board_port, spi_slave};
use crate::pin::PORTS;

/// The general-purpose timers `rigless` models, in the order of [`super::Stm32f411::tim`].
pub const TIMERS: [(&str, tim::Counter); 3] = [
    ("TIM2", tim::Counter::Wide),
    ("TIM3", tim::Counter::Narrow),
    ("TIM5", tim::Counter::Wide),
];

/// The serial ports, in the order of [`super::Stm32f411::usart`].
pub const SERIAL_PORTS: [&str; 3] = ["USART1", "USART2", "USART6"];

/// The I2C interfaces, in the order of [`super::Stm32f411::i2c`].
pub const I2C: [&str; 3] = ["I2C1", "I2C2", "I2C3"];

/// RM0383 table 5: one bank of four sectors of 16 KiB, one of 64 and three of 128.
static SECTORS: [EraseBlocks; 3] = [
    sectors(16 << 10, 4),
    sectors(64 << 10, 1),
    sectors(128 << 10, 3),
];

const fn sectors(bytes: u64, count: u32) -> EraseBlocks {
    match (NonZeroU64::new(bytes), NonZeroU32::new(count)) {
        (Some(size), Some(count)) => EraseBlocks { size, count },
        _ => panic!("a sector has bytes"),
    }
}

/// 512 KiB of flash, 128 KiB of RAM and the system memory with the unique identifier, RM0383
/// section 2.3.
static MEMORY: [Region; 3] = [
    Region::flash("flash", 0x0800_0000, 512 << 10)
        .erased_in(&SECTORS)
        .erased_to(0xFF),
    Region::system("system", 0x1FFF_0000, 32 << 10),
    Region::ram("sram", 0x2000_0000, 128 << 10),
];

/// RM0383 table 37: 86 lines, the last SPI5's.
const INTERRUPT_LINES: u16 = 86;

/// Everything RM0383 table 1 puts on the buses of the part. An instance without a model here still
/// answers from its register file, and `rigless` reports every access to it.
fn instances() -> Vec<Peripheral> {
    let gpio = |peripheral: Peripheral| Peripheral {
        registers: &g::gpioa::REGISTERS,
        ..peripheral
    };
    let timer = |peripheral: Peripheral, counter: tim::Counter| Peripheral {
        registers: counter.layout(),
        ..peripheral
    };
    vec![
        timer(g::TIM2, tim::Counter::Wide),
        timer(g::TIM3, tim::Counter::Narrow),
        timer(g::TIM4, tim::Counter::Narrow),
        timer(g::TIM5, tim::Counter::Wide),
        g::RTC,
        g::WWDG,
        g::IWDG,
        g::SPI2,
        g::SPI3,
        g::USART2,
        g::I2C1,
        g::I2C2,
        g::I2C3,
        Peripheral {
            interrupts: &[],
            ..g::PWR
        },
        g::TIM1,
        g::USART1,
        g::USART6,
        Peripheral {
            interrupts: &[18],
            size: 0x300,
            ..g::ADC1
        },
        g::C_ADC,
        g::SDIO,
        g::SPI1,
        g::SPI4,
        g::SYSCFG,
        // With the supply detector's, number 1.
        Peripheral {
            interrupts: &[2, 6, 7, 8, 9, 10, 23, 40, 1],
            ..g::EXTI
        },
        g::TIM9,
        g::TIM10,
        g::TIM11,
        g::SPI5,
        gpio(g::GPIOA),
        gpio(g::GPIOB),
        gpio(g::GPIOC),
        gpio(g::GPIOD),
        gpio(g::GPIOE),
        gpio(g::GPIOH),
        g::CRC,
        g::RCC,
        g::FLASH,
        g::DMA1,
        g::DMA2,
        g::OTG_FS_GLOBAL,
        g::OTG_FS_HOST,
        g::OTG_FS_DEVICE,
        g::OTG_FS_PWRCLK,
        g::DBG,
        rigless::cpu::armv7m::PERIPHERAL,
        board_port::INSTANCE,
    ]
}

/// Clock enable and reset of every instance: enable register and field, reset register and field,
/// RM0383 sections 6.3.5 to 6.3.12 in the spelling of the vendor's file.
pub const CLOCKED: [(&str, &str, &str, &str, &str); 34] = [
    ("GPIOA", "AHB1ENR", "GPIOAEN", "AHB1RSTR", "GPIOARST"),
    ("GPIOB", "AHB1ENR", "GPIOBEN", "AHB1RSTR", "GPIOBRST"),
    ("GPIOC", "AHB1ENR", "GPIOCEN", "AHB1RSTR", "GPIOCRST"),
    ("GPIOD", "AHB1ENR", "GPIODEN", "AHB1RSTR", "GPIODRST"),
    ("GPIOE", "AHB1ENR", "GPIOEEN", "AHB1RSTR", "GPIOERST"),
    ("GPIOH", "AHB1ENR", "GPIOHEN", "AHB1RSTR", "GPIOHRST"),
    ("CRC", "AHB1ENR", "CRCEN", "AHB1RSTR", "CRCRST"),
    ("DMA1", "AHB1ENR", "DMA1EN", "AHB1RSTR", "DMA1RST"),
    ("DMA2", "AHB1ENR", "DMA2EN", "AHB1RSTR", "DMA2RST"),
    ("TIM2", "APB1ENR", "TIM2EN", "APB1RSTR", "TIM2RST"),
    ("TIM3", "APB1ENR", "TIM3EN", "APB1RSTR", "TIM3RST"),
    ("TIM4", "APB1ENR", "TIM4EN", "APB1RSTR", "TIM4RST"),
    ("TIM5", "APB1ENR", "TIM5EN", "APB1RSTR", "TIM5RST"),
    ("WWDG", "APB1ENR", "WWDGEN", "APB1RSTR", "WWDGRST"),
    ("SPI2", "APB1ENR", "SPI2EN", "APB1RSTR", "SPI2RST"),
    ("SPI3", "APB1ENR", "SPI3EN", "APB1RSTR", "SPI3RST"),
    ("USART2", "APB1ENR", "USART2EN", "APB1RSTR", "UART2RST"),
    ("I2C1", "APB1ENR", "I2C1EN", "APB1RSTR", "I2C1RST"),
    ("I2C2", "APB1ENR", "I2C2EN", "APB1RSTR", "I2C2RST"),
    ("I2C3", "APB1ENR", "I2C3EN", "APB1RSTR", "I2C3RST"),
    ("PWR", "APB1ENR", "PWREN", "APB1RSTR", "PWRRST"),
    ("TIM1", "APB2ENR", "TIM1EN", "APB2RSTR", "TIM1RST"),
    ("USART1", "APB2ENR", "USART1EN", "APB2RSTR", "USART1RST"),
    ("USART6", "APB2ENR", "USART6EN", "APB2RSTR", "USART6RST"),
    ("ADC1", "APB2ENR", "ADC1EN", "APB2RSTR", "ADCRST"),
    ("C_ADC", "APB2ENR", "ADC1EN", "APB2RSTR", "ADCRST"),
    ("SDIO", "APB2ENR", "SDIOEN", "APB2RSTR", "SDIORST"),
    ("SPI1", "APB2ENR", "SPI1EN", "APB2RSTR", "SPI1RST"),
    ("SPI4", "APB2ENR", "SPI4EN", "APB2RSTR", "SPI4RST"),
    ("SYSCFG", "APB2ENR", "SYSCFGEN", "APB2RSTR", "SYSCFGRST"),
    ("TIM9", "APB2ENR", "TIM9EN", "APB2RSTR", "TIM9RST"),
    ("TIM10", "APB2ENR", "TIM10EN", "APB2RSTR", "TIM10RST"),
    ("TIM11", "APB2ENR", "TIM11EN", "APB2RSTR", "TIM11RST"),
    ("SPI5", "APB2ENR", "SPI5EN", "APB2RSTR", "SPI5RST"),
];

/// RM0383 table 27, the requests our models drive.
pub static DMA1_REQUESTS: [Wire; 7] = [
    wire("I2C1", i2c::RECEIVE_REQUEST, 1, &[0, 5]),
    wire("I2C1", i2c::TRANSMIT_REQUEST, 0, &[1]),
    wire("I2C1", i2c::TRANSMIT_REQUEST, 1, &[6, 7]),
    wire("I2C2", i2c::RECEIVE_REQUEST, 7, &[2, 3]),
    wire("I2C2", i2c::TRANSMIT_REQUEST, 7, &[7]),
    wire("USART2", usart::RECEIVE_REQUEST, 4, &[5]),
    wire("USART2", usart::TRANSMIT_REQUEST, 4, &[6]),
];

/// RM0383 table 28, the requests our models drive.
pub static DMA2_REQUESTS: [Wire; 7] = [
    wire("ADC1", adc::DMA_REQUEST, 0, &[0, 4]),
    wire("SPI1", spi_slave::RECEIVE_REQUEST, 3, &[0, 2]),
    wire("SPI1", spi_slave::TRANSMIT_REQUEST, 3, &[3, 5]),
    wire("SPI1", spi_slave::TRANSMIT_REQUEST, 2, &[2]),
    wire("USART1", usart::RECEIVE_REQUEST, 4, &[2, 5]),
    wire("USART1", usart::TRANSMIT_REQUEST, 4, &[7]),
    wire("USART6", usart::TRANSMIT_REQUEST, 5, &[6, 7]),
];

const fn wire(
    instance: &'static str,
    request: usize,
    channel: usize,
    streams: &'static [usize],
) -> Wire {
    Wire {
        instance,
        request,
        channel,
        streams,
    }
}

/// The part's bus.
///
/// # Errors
/// A description that contradicts itself, which a test of this crate would have shown.
pub fn bus() -> Result<Bus, Error> {
    let reference = rigless::soc::stm32f427::builder().build()?;
    let mut builder = Bus::builder(
        Cpu::new("CM4", true, INTERRUPT_LINES, Endian::Little),
        &MEMORY,
        instances(),
    )
    // RM0383 section 23.6.1: device 0x431; revision A is 0x1000.
    .reset("DBG", "DBGMCU_IDCODE", 0x1000_6431);
    builder = corrections(builder);
    for (instance, enable, field, reset, bit) in CLOCKED {
        builder = builder
            .gate(instance, Gate::by("RCC", enable, field))
            .reset_by(instance, Gate::by("RCC", reset, bit));
    }
    // Section 5.4.1 bit 8, DBP, guards the backup domain against parasitic writes.
    builder = builder
        .gate_writes("RCC", &["BDCR"], Gate::by("PWR", "CR", "DBP"))
        .gate_writes("RTC", &[], Gate::by("PWR", "CR", "DBP"));
    let board = board_port::NAME;
    for instance in [
        "RTC", "SYSCFG", "EXTI", board, "TIM1", "RCC", "C_ADC", "ADC1", "DMA1", "DMA2",
    ] {
        builder = builder.reads_requests(instance);
    }
    // The clock of each instance, as the part numbers it that the clock tree's model was written for.
    for instance in SERIAL_PORTS
        .into_iter()
        .chain(I2C)
        .chain(TIMERS.map(|(name, _)| name))
        .chain(["TIM1", "TIM4", "FLASH", "DWT", "IWDG", "C_ADC", "ADC1"])
    {
        let clock = reference.clock_of(instance);
        builder = builder.clocked_by(instance, clock.ok_or(Error::UnknownInstance { instance })?);
    }
    builder.build()
}

/// The corrections of the vendor's file that `rigless` makes for the same blocks of the STM32F427,
/// each with the section its source gives.
fn corrections(mut builder: Builder) -> Builder {
    for port in SERIAL_PORTS {
        // RM0383 section 19.6.1.
        builder = builder.reset(port, "SR", 0xC0);
    }
    for spi in ["SPI1", "SPI2", "SPI3", "SPI4", "SPI5"] {
        // Section 20.5.9.
        builder = builder.reset(spi, "I2SPR", 2);
    }
    for timer in [
        "TIM1", "TIM2", "TIM3", "TIM4", "TIM5", "TIM9", "TIM10", "TIM11",
    ] {
        // Sections 12.4.5, 13.4.5, 14.4.5: the flags are rc_w0.
        builder = builder.write_modify(timer, "SR", WriteModify::ZeroToClear);
    }
    for (timer, counter) in TIMERS {
        // Section 13.4.12: ARR resets to all ones.
        builder = builder.reset(timer, "ARR", counter.mask());
    }
    for timer in ["TIM1", "TIM4"] {
        builder = builder.reset(timer, "ARR", 0xFFFF);
    }
    for interface in I2C {
        // Section 18.6.6: the error flags are rc_w0.
        builder = builder.write_modify(interface, "SR1", WriteModify::ZeroToClear);
    }
    for port in PORTS {
        // Sections 8.4.1, 8.4.3 and 8.4.4: the debug pins of ports A and B are enabled.
        let [mode, speed, pull] = match port {
            "GPIOA" => [0xA800_0000, 0x0C00_0000, 0x6400_0000],
            "GPIOB" => [0x0000_0280, 0x0000_00C0, 0x0000_0100],
            _ => [0, 0, 0],
        };
        builder = builder
            .reset(port, "MODER", mode)
            .reset(port, "OSPEEDR", speed)
            .reset(port, "PUPDR", pull);
    }
    builder
        .field("FLASH", "ACR", "LATENCY", flash::LATENCY)
        .field("FLASH", "CR", "LOCK", flash::LOCK)
        .field("FLASH", "CR", "STRT", flash::STRT)
        .field("FLASH", "OPTCR", "OPTLOCK", flash::OPTLOCK)
        .field("FLASH", "OPTCR", "OPTSTRT", flash::OPTSTRT)
        .declare("FLASH", "SR", &flash::RDERR)
        .write_modify("FLASH", "SR", WriteModify::OneToClear)
        // Section 10.3.6: PR is rc_w1.
        .write_modify("EXTI", "PR", WriteModify::OneToClear)
        .reset("RCC", "PLLI2SCFGR", 0x2400_3000)
        .reset("RCC", "APB2LPENR", 0x0007_7930)
}
