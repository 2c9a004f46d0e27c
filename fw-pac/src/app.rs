//! Everything the robot's priority owns, and its event loop: slots in, core, registers out.
//!
//! `PendSV`, the log's DMA and the I2C interrupts share priority 2, so none preempts another; higher
//! priorities store into slots and never touch what is here.

use crate::gyro::Gyro;
use crate::motors::Motors;
use crate::priority::{FrameEnd, Owned, Slot};
use crate::rangefinders::{self, Echo};
use crate::spi::{Claim, SpiSlave};
use crate::uart::Uart;
use crate::{adc, fault_injection, leds, servo, tick, watchdog};
use cortex_m::interrupt::free;
use fw_core::eeprom::Config;
use fw_core::log::Log;
use fw_core::robot::{ReceivedFrame, Robot, TickInput};

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

/// An event for the robot.
enum Event<'a> {
    Echo(Echo),
    Frame(Claim<'a>),
    Tick(TickInput),
}

/// An echo, or else the older of a frame and a tick, so that the core's clock never runs backwards: no
/// frame ends meanwhile, and a tick that is latched after the comparison is younger than that frame.
#[inline]
fn next_event(spi: &mut SpiSlave) -> Option<Event<'_>> {
    // SAFETY: the robot's priority, and nothing here raises it again.
    unsafe {
        FrameEnd::raised(|frame_end| {
            let frame = spi.ended_at(frame_end);
            let captured = free(|token| {
                if let Some(echo) = rangefinders::take(token) {
                    return Some(Event::Echo(echo));
                }
                let tick = tick::latched_at(token)?;
                let first = frame.is_none_or(|frame| tick.since(frame) > u32::MAX / 2);
                first.then(|| tick::take(token).map(Event::Tick))?
            });
            captured.or_else(|| spi.claim(frame_end).map(Event::Frame))
        })
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
        while let Some(event) = next_event(&mut drivers.spi) {
            match event {
                Event::Echo(Echo { which, rise, fall }) => robot.on_echo(which, rise, fall),
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
