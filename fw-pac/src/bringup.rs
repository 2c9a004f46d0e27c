//! The bring-up firmware: tries the parts of a bare board one after the other with the firmware's own
//! drivers and reports what it sees on the log's UART, a line a step. `robot bringup` judges the lines.
//!
//! No motor runs before both wheels have been turned by hand: that is the consent to the motors' step.
#![no_std]
#![no_main]
#![allow(
    clippy::cast_possible_truncation,
    clippy::cast_possible_wrap,
    reason = "what is cast is a constant, clamped, a counter's difference, or an address of a 32-bit machine"
)]
#![allow(
    dead_code,
    reason = "the drivers are the firmware's, which uses the rest of them"
)]

mod adc;
#[path = "bringup/app.rs"]
mod app;
mod board;
mod clock;
#[path = "bringup/crystal.rs"]
mod crystal;
mod dma;
mod encoders;
mod exti;
mod gpio;
mod gyro;
mod i2c;
mod interrupts;
mod leds;
mod memory;
mod motors;
#[path = "bringup/part.rs"]
mod part;
mod priority;
mod rangefinders;
mod registers;
mod reset;
mod safe_state;
#[path = "bringup/sequence.rs"]
mod sequence;
mod servo;
mod spi;
#[path = "bringup/stack.rs"]
mod stack;
mod stack_overflow;
mod tick;
mod time;
mod uart;
mod watchdog;

use crate::app::{APP, App};
use crate::board::{SCL, SDA, SELECT};
use crate::gpio::Pull;
use crate::gyro::Gyro;
use crate::motors::Motors;
use crate::priority::RobotLevel;
use crate::sequence::Drivers;
use crate::spi::SpiSlave;
use crate::uart::Uart;
use fw_core::eeprom::KEY;
use fw_core::log::{Level, Log};
use fw_core::robot::leds as pattern;
use fw_core::wire::{State, test_frame};
use stm32f4::stm32f411::SPI1;

/// The EEPROM's address.
const EEPROM: u8 = 0x50;

#[cortex_m_rt::entry]
fn main() -> ! {
    cortex_m::interrupt::disable();
    // SAFETY: boot's one token; `interrupts::enable` takes it.
    let mut token = unsafe { RobotLevel::new() };
    boot(APP.borrow(&mut token));
    interrupts::enable(token);
    loop {
        watchdog::feed_if_ticked();
        cortex_m::asm::wfi();
    }
}

/// What needs no interrupt: clock, part, supply, buses.
#[inline(never)]
fn boot(app: &mut App) {
    safe_state::outputs_off();
    watchdog::start();
    leds::start(pattern(State::Booting));
    let crystal_khz = crystal::measure();
    watchdog::feed();
    let Some(source) = clock::start(crystal::FITS.contains(&crystal_khz), watchdog::feed) else {
        safe_state::halt(b"no clock");
    };
    watchdog::feed();
    time::start();
    let mut uart = Uart::start();
    let log = &mut app.log;
    let after_overflow = stack::ON_PURPOSE.take();
    let cause = reset::cause();
    log.line(Level::Info, |line| {
        line.text("bringup 1 after ").text(cause.name());
    });
    log.line(Level::Info, |line| {
        line.text("crystal khz ").int(crystal_khz.into());
        line.text(match source {
            clock::Source::Crystal => " in use 1",
            clock::Source::Internal => " in use 0",
        });
    });
    part::report(log);
    drain(&mut uart, log);
    scan_bus(&mut uart, log);
    encoders::start();
    adc::start();
    rangefinders::start();
    let Drivers { spi, .. } = app.drivers.insert(Drivers {
        // SAFETY: boot's one call.
        spi: SpiSlave::new(unsafe { SPI1::steal() }),
        motors: Motors::start(),
        gyro: Gyro::IDLE,
        uart,
    });
    spi.start(test_frame::encode);
    if after_overflow {
        app.sequence.resume_after_overflow();
    }
}

/// The lines' idle levels, and who answers. With SELECT high the Pi has the EEPROM's half of the bus.
fn scan_bus(uart: &mut Uart, log: &mut Log) {
    SELECT.input(Pull::PullDown);
    SCL.input(Pull::Floating);
    SDA.input(Pull::Floating);
    time::wait(100, || false);
    log.line(Level::Info, |line| {
        line.text("i2c scl ").int(SCL.is_high().into());
        line.text(" sda ").int(SDA.is_high().into());
        line.text(" select ").int(SELECT.is_high().into());
    });
    log.line(Level::Info, |line| {
        line.text("i2c found");
        // 0x00 to 0x07 and 0x78 to 0x7F are reserved by the bus's specification.
        for device in 0x08..0x78_u8 {
            watchdog::feed();
            i2c::start();
            if i2c::address(device << 1).is_ok() {
                line.text(" 0x").hex(device.into(), 2);
            }
            i2c::end();
        }
    });
    drain(uart, log);
    let mut key = [0; 10];
    i2c::start();
    let read = i2c::read(EEPROM, 0, &mut key, watchdog::feed);
    log.line(Level::Info, |line| {
        line.text("eeprom ");
        match read {
            Ok(()) => {
                line.text("key ").int((key == KEY).into());
                line.text(" blank ").int((key == [0xFF; 10]).into());
            }
            Err(error) => {
                line.text("error ").text(error.reason());
            }
        }
    });
}

/// Lets the log out, a second at most.
fn drain(uart: &mut Uart, log: &mut Log) {
    time::wait(1_000_000, || {
        watchdog::feed();
        uart.service(log);
        log.pending().is_empty()
    });
}
