//! The firmware of the STM32F411RE: registers, DMA and interrupts around `fw-core`, which decides.
//!
//! | module | peripheral |
//! |---|---|
//! | [`clock`] | RCC, PWR, flash: 100 MHz |
//! | [`gpio`], [`board`] | pins, and the board's names for them |
//! | [`dma`] | one stream |
//! | [`watchdog`] | IWDG |
//! | [`uart`] | USART1: the log |
//! | [`time`] | TIM5: microseconds, tick |
//! | [`i2c`], [`eeprom`] | I2C1: the configuration |
//! | `gyro` | I2C1 after boot: the MPU6050 |
//! | [`spi`] | SPI1: frames |
//! | [`encoders`], [`motors`] | TIM2, TIM3; TIM4 and the bridges |
//! | [`rangefinders`], [`adc`], [`leds`] | what it senses and shows |
//! | `servo` | TIM1: where the swept rangefinder looks |
//! | [`memory`] | what the compiler calls to copy and to fill |
//! | [`exti`] | edges, and everybody's priority |
//! | [`robot`] | events into the core, outputs to the registers |
//! | [`safe`], [`fault_injection`] | where everything that must not happen ends |
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
mod board;
mod clock;
mod dma;
mod eeprom;
mod encoders;
mod exti;
mod fault_injection;
mod gpio;
mod gyro;
#[cfg(feature = "test-hand")]
mod hand;
mod i2c;
mod leds;
mod memory;
mod motors;
mod rangefinders;
mod reset;
mod robot;
mod safe;
mod servo;
mod spi;
mod time;
mod uart;
mod watchdog;

use crate::gpio::Driver;
use crate::motors::Motors;
use crate::uart::Uart;
use clock::Source;
use fw_core::eeprom::ConfigError;
use fw_core::log::{Level, Log};
use fw_core::robot::Robot;
use fw_core::types::Faults;
use fw_core::wire::State;

#[cortex_m_rt::entry]
fn main() -> ! {
    // Boot runs alone; an interrupt enabled in the NVIC only wakes it from its dozes.
    cortex_m::interrupt::disable();
    clock::enable_peripherals();
    motors::force_off();
    servo::force_off();
    board::READY.low();
    board::READY.output(Driver::PushPull);
    watchdog::start();
    leds::start();
    leds::show(fw_core::robot::leds(State::Booting));
    let Some(source) = clock::start() else {
        safe::halt(b"\nE: no clock, motors off\n");
    };
    watchdog::feed();
    time::start();
    // SAFETY: boot runs alone, and `log` ends with it.
    let log = unsafe { robot::boot_log() };
    let mut uart = Uart::start();
    let restart = reset::cause();
    log.line(Level::Info, |line| {
        line.text("boot after ").text(restart.name());
    });
    let mut idle = |log: &mut Log| {
        watchdog::feed();
        // SAFETY: the log is static.
        unsafe { uart.service(log) };
    };

    // SAFETY: boot's one call.
    let image = match unsafe { eeprom::read(log, &mut idle) } {
        Ok(image) => image,
        Err(error) => {
            log.line(Level::Error, |line| {
                line.text("no configuration: ").text(error.reason());
            });
            stand_by(log, idle);
        }
    };
    let config = match fw_core::eeprom::decode(image) {
        Ok(config) => config,
        Err(error) => refuse(&error, log, idle),
    };
    if usize::from(config.cells) > board::TAPS {
        log.line(Level::Warn, |line| {
            line.text("more cells than this board has taps");
        });
    }

    encoders::start();
    let mut robot = Robot::new(&config, cortex_m::interrupt::free(time::sample));
    if source == Source::Internal {
        // Requirement: WIRE-fault-1
        robot.raise(Faults::CLOCK_FALLBACK, log);
    }
    if restart.is_fault() {
        // Requirement: WIRE-fault-11
        robot.raise(Faults::RESTARTED, log);
    }
    robot.calibrate(adc::calibration());
    adc::start();
    rangefinders::start();
    if config.platform.servo {
        servo::start();
    }
    let motors = Motors::start();
    leds::show(fw_core::robot::leds(robot.state()));
    // SAFETY: boot's one call; the interrupts are disabled.
    unsafe { spi::start(|reply| robot.next_reply(reply)) };
    log.line(Level::Info, |line| {
        line.text("configured, mode ").text(config.mode.name());
    });
    if config.platform.log_baud != uart::BOOT_BAUD {
        // What has been said so far was for readers at the boot's rate.
        time::wait(1_000_000, || {
            idle(log);
            log.pending().is_empty()
        });
        uart.set_rate(config.platform.log_baud);
    }
    // SAFETY: the interrupts are disabled, and boot's `log` is not used again.
    unsafe {
        robot::install(robot::Body {
            robot,
            reply: 0,
            motors,
            leds: 0,
            uart,
        });
    }
    // SAFETY: nobody else takes the core's peripherals.
    let mut core = unsafe { cortex_m::Peripherals::steal() };
    exti::start(&mut core.NVIC, &mut core.SCB);
    time::start_ticks();
    // SAFETY: every handler's state is in place.
    unsafe { cortex_m::interrupt::enable() };
    // Requirement: WIRE-ready-1
    board::READY.high();

    loop {
        watchdog::feed_if_ticked();
        cortex_m::asm::wfi();
    }
}

/// How long boot sleeps between two looks, microseconds: the watchdog waits 68 ms at least.
const DOZE: u32 = 5_000;

/// This configuration is not for this robot.
fn refuse(error: &ConfigError, log: &mut Log, idle: impl FnMut(&mut Log)) -> ! {
    log.line(Level::Error, |line| {
        line.text("configuration rejected: ");
        error.log(line);
    });
    stand_by(log, idle)
}

/// READY stays low and the motors off; the log goes out. Only a reset leaves, as the Pi does after
/// writing the EEPROM.
// Requirement: WIRE-eeprom-3
fn stand_by(log: &mut Log, mut idle: impl FnMut(&mut Log)) -> ! {
    leds::show(fw_core::robot::leds(State::Faulted));
    loop {
        idle(log);
        time::doze(DOZE);
    }
}
