//! Everything the robot's priority owns, and its event loop: slots in, core, registers out.
//!
//! `PendSV`, the log's DMA and the I2C interrupts share priority 2, so none preempts another; higher
//! priorities store into slots and never touch what is here.

use crate::gyro::Gyro;
use crate::motors::Motors;
use crate::priority::{FrameEnd, Owned, Slot};
use crate::rangefinders::{self, ECHOES};
use crate::spi::{Claim, SpiSlave};
use crate::tick::LATCHED;
use crate::uart::Uart;
use crate::{adc, fault_injection, leds, servo, watchdog};
use core::cell::Cell;
use cortex_m::interrupt::free;
use fw_core::captured::{Echoes, Event, Pending, next_event};
use fw_core::eeprom::Config;
use fw_core::log::Log;
use fw_core::robot::{ReceivedFrame, Robot, TickInput};
use fw_core::types::Micros;

/// What the robot's priority owns.
pub static APP: Owned<2, App> = Owned::new(App {
    log: Log::new(),
    config: Slot::EMPTY,
    robot: Slot::EMPTY,
    drivers: Slot::EMPTY,
});

/// See [`APP`].
pub struct App {
    /// The log, in use from the first moment of boot.
    pub log: Log,
    /// The configuration, for boot.
    pub config: Slot<Config>,
    /// Every decision; constructed in place by boot once there is a configuration.
    pub robot: Slot<Robot>,
    /// The robot's drivers, from the same moment on.
    pub drivers: Slot<Drivers>,
}

/// What turns the robot's outputs into registers.
// Requirement: DOC-3.2-2
pub struct Drivers {
    /// The link to the Pi.
    pub spi: SpiSlave,
    /// Both bridges.
    pub motors: Motors,
    /// The gyroscope's bus.
    pub gyro: Gyro,
    /// The log's transmitter.
    pub uart: Uart,
    /// The LEDs' pattern shown last.
    pub leds: u8,
}

/// What awaits the robot while no frame can end.
struct Waiting<'a, 't> {
    spi: &'a mut SpiSlave,
    frame_end: &'t mut FrameEnd,
}

impl<'a> Pending for Waiting<'a, '_> {
    type Frame = Claim<'a>;

    #[inline]
    fn frame_ended_at(&mut self) -> Option<Micros> {
        self.spi.ended_at(self.frame_end)
    }

    #[inline]
    fn captured<R>(&mut self, f: impl FnOnce(&Cell<Option<TickInput>>, &Echoes) -> R) -> R {
        free(|token| f(LATCHED.borrow(token), ECHOES.borrow(token)))
    }

    #[inline]
    fn claim(self) -> Option<Claim<'a>> {
        self.spi.claim(self.frame_end)
    }
}

impl App {
    /// Handles every pending event, then the log.
    #[inline]
    pub fn process_events(&mut self) {
        let (Some(robot), Some(drivers)) = (self.robot.get(), self.drivers.get()) else {
            return;
        };
        let log = &mut self.log;
        loop {
            let spi = &mut drivers.spi;
            // SAFETY: the robot's priority, and nothing here raises it again.
            let event =
                unsafe { FrameEnd::raised(|frame_end| next_event(Waiting { spi, frame_end })) };
            let Some(event) = event else { break };
            match event {
                Event::Echo(echo) => robot.on_echo(echo.which, echo.rise, echo.fall),
                Event::Frame(frame) => {
                    let lost = frame.lost();
                    exchange(robot, frame, log);
                    drivers.refresh_standby(robot);
                    if lost > 0 {
                        robot.on_lost_frames(lost, log);
                    }
                }
                Event::Tick(sample) => drivers.on_tick(robot, sample, log),
            }
        }
        drivers.uart.service(log);
    }

    /// The log's transfer has ended.
    pub fn service_log(&mut self) {
        if let Some(drivers) = self.drivers.get() {
            drivers.uart.service(&mut self.log);
        }
    }

    /// Passes an interrupt of the gyroscope's bus on.
    pub fn on_gyro(&mut self, handle: fn(&mut Gyro)) {
        if let Some(drivers) = self.drivers.get() {
            handle(&mut drivers.gyro);
        }
    }
}

/// A frame's reply and effect. Its own symbol, so that its instructions can be counted.
// Requirement: DOC-5-3
#[inline(never)]
#[unsafe(export_name = "robot_frame")]
fn exchange(robot: &mut Robot, mut frame: Claim, log: &mut Log) {
    let (number, at) = (frame.number(), frame.at());
    let (bytes, reply) = frame.buffers();
    let command = robot.receive(&ReceivedFrame {
        bytes,
        overflow_len: 0,
        at,
        reply: number,
    });
    robot.encode_reply(number, reply);
    // Before the effect: the window for it is short.
    frame.answer();
    if let Ok(command) = command {
        robot.execute(&command, at, log);
    }
}

impl Drivers {
    /// Rebuilds the armed reply from the data of a tick.
    // Requirement: WIRE-spi-6
    fn refresh_reply(&mut self, robot: &mut Robot) {
        if let Some(mut fresh) = self.spi.fresh_reply() {
            let (number, begin) = (fresh.number(), fresh.begin());
            robot.refresh_reply(number, begin, fresh.bytes());
            fresh.submit();
        }
    }

    /// Builds the standby: the next frame's reply where the answer comes too late.
    fn refresh_standby(&mut self, robot: &mut Robot) {
        let mut standby = self.spi.free_tx_buffer();
        robot.encode_reply(standby.number(), standby.bytes());
        standby.submit();
    }

    /// The 100 Hz tick. Its own symbol, so that its instructions can be counted.
    #[inline(never)]
    #[unsafe(export_name = "robot_tick")]
    fn on_tick(&mut self, robot: &mut Robot, input: TickInput, log: &mut Log) {
        let request = robot.on_gyro(self.gyro.take(), log);
        self.gyro.begin(request);
        let words = adc::words();
        let taps = words.as_ref().map_or(&[][..], |words| &words[..]);
        let outputs = robot.on_tick(input, taps, log);
        self.motors.set(outputs.left, outputs.right);
        if outputs.leds != self.leds {
            self.leds = outputs.leds;
            leds::show(outputs.leds);
        }
        if let Some(width) = outputs.servo {
            servo::pulse(width);
        }
        if let Some(which) = outputs.trigger {
            rangefinders::trigger(which);
        }
        if let Some((sensor, reference)) = adc::temperature() {
            robot.on_temperature(sensor, reference, log);
        }
        self.refresh_reply(robot);
        self.refresh_standby(robot);
        watchdog::ticked();
        fault_injection::tick();
    }
}
