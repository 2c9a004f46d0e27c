//! The firmware of the STM32F411RE: registers, DMA and interrupts around `fw-core`, which decides.
#![no_std]
#![no_main]
#![allow(
    clippy::cast_possible_truncation,
    reason = "what is cast is a constant, clamped, or an address of a 32-bit machine"
)]

#[cfg(not(target_os = "none"))]
compile_error!(
    "fw-pac is firmware: build it with `cargo build -p fw-pac --profile firmware \
     --target thumbv7em-none-eabihf`, or let `cargo xtask` do it"
);

mod adc;
mod app;
mod board;
mod clock;
mod dma;
mod eeprom;
mod encoders;
mod exti;
mod fault_injection;
mod gpio;
mod gyro;
mod i2c;
mod interrupts;
mod leds;
mod memory;
mod motors;
mod priority;
mod rangefinders;
mod registers;
mod reset;
mod safe_state;
mod servo;
mod spi;
#[cfg(feature = "test-overflow")]
mod stack_overflow;
mod tick;
mod time;
mod uart;
mod watchdog;

use crate::app::{APP, App, Drivers};
use crate::gyro::Gyro;
use crate::motors::Motors;
use crate::priority::RobotLevel;
use crate::spi::SpiSlave;
use crate::uart::Uart;
use clock::Source;
use fw_core::eeprom::{Config, Image};
use fw_core::log::{Level, Log};
use fw_core::robot::Robot;
use fw_core::types::Faults;
use fw_core::wire::State;
use stm32f4::stm32f411::SPI1;

#[cortex_m_rt::entry]
fn main() -> ! {
    // Boot runs alone; an interrupt enabled in the NVIC only wakes it from its naps.
    cortex_m::interrupt::disable();
    // SAFETY: boot's one token; `interrupts::enable` takes it.
    let mut token = unsafe { RobotLevel::new() };
    boot(APP.borrow(&mut token));
    interrupts::enable(token);
    // Requirement: WIRE-ready-1
    board::READY.high();
    loop {
        watchdog::feed_if_ticked();
        cortex_m::asm::wfi();
    }
}

/// From reset to a configured robot; without a clock or a configuration it never returns. Every interrupt
/// is masked, as `cargo xtask stack` takes it to be. One stage after the other, so that their stacks do
/// not add up.
#[inline(never)]
#[unsafe(export_name = "boot")]
fn boot(app: &mut App) {
    let (start, mut uart) = start_hardware(&mut app.log);
    read_configuration(app, &mut uart);
    build_robot(app);
    start_robot(app, &start, uart);
}

/// What boot found before it had a configuration.
struct Start {
    clock: Source,
    cause: reset::Cause,
}

/// Clock, log and watchdog; the motors off.
#[inline(never)]
fn start_hardware(log: &mut Log) -> (Start, Uart) {
    safe_state::outputs_off();
    watchdog::start();
    leds::start(fw_core::robot::leds(State::Booting));
    let Some(clock) = clock::start(true, watchdog::feed) else {
        safe_state::halt(b"no clock");
    };
    watchdog::feed();
    time::start();
    let uart = Uart::start();
    let cause = reset::cause();
    log.line(Level::Info, |line| {
        line.text(concat!(
            "firmware ",
            env!("CARGO_PKG_VERSION"),
            ", boot after "
        ))
        .text(cause.name());
    });
    (Start { clock, cause }, uart)
}

/// Reads the EEPROM and decodes it, or reports why not and stands by.
#[inline(never)]
fn read_configuration(app: &mut App, uart: &mut Uart) {
    let log = &mut app.log;
    // SAFETY: an image is an array of bytes, and the robot comes later.
    let image: &mut Image = unsafe { app.robot.scratch() };
    if let Err(error) = eeprom::read(image, log, |log| idle(uart, log)) {
        log.line(Level::Error, |line| {
            line.text("no configuration: ").text(error.reason());
        });
        stand_by(log, uart);
    }
    match Config::decode(image) {
        Ok(config) => {
            if usize::from(config.cells()) > board::TAPS {
                log.text(Level::Warn, "more cells than this board has taps");
            }
            app.config.insert(config);
        }
        Err(error) => {
            log.line(Level::Error, |line| {
                line.text("configuration rejected: ");
                error.log(line);
            });
            stand_by(log, uart)
        }
    }
}

/// Builds the robot from the configuration.
#[inline(never)]
fn build_robot(app: &mut App) {
    if let Some(config) = app.config.get() {
        encoders::start();
        let first = cortex_m::interrupt::free(tick::sample);
        app.robot.insert(Robot::new(config, first));
    }
}

/// Starts the drivers and reports what boot found.
#[inline(never)]
fn start_robot(app: &mut App, start: &Start, uart: Uart) {
    let log = &mut app.log;
    let (Some(config), Some(robot)) = (app.config.get(), app.robot.get()) else {
        return;
    };
    adc::start();
    rangefinders::start();
    if config.servo().is_some() {
        servo::start();
    }
    let Drivers { spi, uart, .. } = app.drivers.insert(Drivers {
        // SAFETY: boot's one call.
        spi: SpiSlave::new(unsafe { SPI1::steal() }),
        motors: Motors::start(),
        gyro: Gyro::IDLE,
        uart,
        leds: 0,
    });
    if start.clock == Source::Internal {
        // Requirement: WIRE-fault-1
        robot.raise(Faults::CLOCK_FALLBACK, log);
    }
    if start.cause.is_fault() {
        // Requirement: WIRE-fault-11
        robot.raise(Faults::RESTARTED, log);
    }
    robot.calibrate(adc::calibration());
    leds::show(fw_core::robot::leds(robot.state()));
    log.line(Level::Info, |line| {
        line.text("configured, mode ").text(config.mode().name());
    });
    if config.log_baud() != uart::BOOT_BAUD {
        // The lines so far are for readers at the boot's rate.
        time::wait(1_000_000, || {
            idle(uart, log);
            log.pending().is_empty()
        });
        uart.set_rate(config.log_baud());
    }
    // Last: an edge that ends a frame while interrupts are still off is not taken.
    spi.start(|number, reply| robot.encode_reply(number, reply));
}

/// Keeps the watchdog fed and the log flowing while boot waits.
fn idle(uart: &mut Uart, log: &mut Log) {
    watchdog::feed();
    uart.service(log);
}

/// Between two turns of [`stand_by`], microseconds: the watchdog waits 68 ms at least.
const NAP: u32 = 5_000;

/// READY stays low and the motors off; the log goes out. Only a reset leaves, as the Pi does after
/// writing the EEPROM.
// Requirement: WIRE-eeprom-3
fn stand_by(log: &mut Log, uart: &mut Uart) -> ! {
    leds::show(fw_core::robot::leds(State::Faulted));
    loop {
        idle(uart, log);
        time::sleep(NAP);
    }
}
