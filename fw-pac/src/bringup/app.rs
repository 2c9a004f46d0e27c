//! What the robot's priority owns during bring-up: the drivers, the log and the sequence of steps.

use crate::gyro::Gyro;
use crate::priority::{FrameEnd, Owned, Slot};
use crate::rangefinders::ECHOES;
use crate::sequence::{Drivers, Sequence};
use crate::tick::LATCHED;
use crate::watchdog;
use cortex_m::interrupt::free;
use fw_core::log::Log;
use fw_core::wire::test_frame;

/// What the robot's priority owns.
pub static APP: Owned<2, App> = Owned::new(App {
    log: Log::new(),
    sequence: Sequence::FIRST,
    drivers: Slot::EMPTY,
});

/// See [`APP`].
pub struct App {
    /// The log.
    pub log: Log,
    /// The steps.
    pub sequence: Sequence,
    /// The drivers, once boot has started them.
    pub drivers: Slot<Drivers>,
}

impl App {
    /// Handles every pending event, then the log.
    pub fn process_events(&mut self) {
        let Some(drivers) = self.drivers.get() else {
            return;
        };
        while let Some(echo) = free(|token| ECHOES.borrow(token).take()) {
            self.sequence.on_echo(&echo);
        }
        // SAFETY: the robot's priority, and nothing here raises it again.
        while let Some(mut frame) = unsafe { FrameEnd::raised(|token| drivers.spi.claim(token)) } {
            let (number, lost) = (frame.number(), frame.lost());
            let (bytes, reply) = frame.buffers();
            self.sequence.on_frame(bytes, lost);
            test_frame::encode(number, reply);
            frame.answer();
            let mut standby = drivers.spi.free_tx_buffer();
            test_frame::encode(standby.number(), standby.bytes());
            standby.submit();
        }
        if free(|token| LATCHED.borrow(token).take()).is_some() {
            self.sequence.on_tick(drivers, &mut self.log);
            watchdog::ticked();
        }
        drivers.uart.service(&mut self.log);
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
