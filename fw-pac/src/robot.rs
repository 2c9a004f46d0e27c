//! The robot's priority: slots in, core, registers out.
//!
//! `PendSV` and the log's DMA interrupt share priority 2, so neither preempts the other; what runs
//! above them uses slots and never touches what is here, and thread level hands it over once, before
//! the interrupts are enabled. That is the whole locking there is.

use crate::gyro;
use crate::motors::Motors;
use crate::rangefinders::Echo;
use crate::uart::Uart;
use crate::{adc, fault_injection, leds, rangefinders, spi, time, watchdog};
use core::cell::UnsafeCell;
use core::mem::MaybeUninit;
use core::sync::atomic::{compiler_fence, Ordering};
use cortex_m::interrupt::free;
use cortex_m_rt::exception;
use fw_core::log::Log;
use fw_core::robot::{Robot, Sample};

/// What the robot's priority owns beside the log.
// Requirement: DOC-3.2-2
pub struct Body {
    /// Every decision.
    pub robot: Robot,
    /// The number of the reply it would write now, see [`spi`].
    pub reply: u32,
    /// Both bridges.
    pub motors: Motors,
    /// What the robot had the LEDs show last; nothing before its first tick.
    pub leds: u8,
    /// The log's transmitter.
    pub uart: Uart,
}

/// A value that one priority owns.
struct Owned<T>(UnsafeCell<T>);

// SAFETY: one priority at a time touches the inside: boot alone before the interrupts are enabled,
// priority 2 alone afterwards.
unsafe impl<T> Sync for Owned<T> {}

static LOG: Owned<Log> = Owned(UnsafeCell::new(Log::new()));
static BODY: Owned<MaybeUninit<Body>> = Owned(UnsafeCell::new(MaybeUninit::uninit()));

/// The log, for boot.
///
/// # Safety
/// Once, before the interrupts are enabled, and not to be used after [`install`].
pub unsafe fn boot_log() -> &'static mut Log {
    // SAFETY: the caller's promise.
    unsafe { &mut *LOG.0.get() }
}

/// Hands the body over to the robot's priority.
///
/// # Safety
/// Once, before priority 2's interrupts are enabled; they must not be enabled without it.
pub unsafe fn install(body: Body) {
    // SAFETY: the caller's promise.
    unsafe { (*BODY.0.get()).write(body) };
    compiler_fence(Ordering::SeqCst);
}

/// What happened.
enum Event {
    Echo(Echo),
    Frame(spi::Claim),
    Tick(Sample),
}

/// An echo, or else the older of a frame and a tick: the core's clock never runs backwards. Both are
/// looked at and one is claimed in one masked stretch, and whoever latches one stores it in another,
/// so none can slip in between with an earlier time.
#[inline]
fn next() -> Option<Event> {
    free(|token| {
        if let Some(echo) = rangefinders::take(token) {
            return Some(Event::Echo(echo));
        }
        let tick_first = match (spi::ended(token), time::latched(token)) {
            (Some(frame), Some(tick)) => tick.since(frame) > u32::MAX / 2,
            (frame, _) => frame.is_none(),
        };
        if tick_first {
            time::claim(token).map(Event::Tick)
        } else {
            spi::claim(token).map(Event::Frame)
        }
    })
}

// Requirement: DOC-2.1-6
#[exception]
fn PendSV() {
    // SAFETY: priority 2, like the only other user; `install` came before the interrupts.
    let (body, log) = unsafe { ((*BODY.0.get()).assume_init_mut(), &mut *LOG.0.get()) };
    while let Some(event) = next() {
        match event {
            Event::Echo(echo) => body.on_echo(&echo),
            Event::Frame(frame) => body.on_frame(frame, log),
            Event::Tick(sample) => body.on_tick(sample, log),
        }
    }
    // SAFETY: the log is static.
    unsafe { body.uart.service(log) };
}

/// The log's transfer has ended; at the robot's priority.
pub fn log_sent() {
    // SAFETY: priority 2, like the only other user; `install` came before the interrupts. The log
    // is static.
    unsafe {
        let body = (*BODY.0.get()).assume_init_mut();
        body.uart.service(&mut *LOG.0.get());
    }
}

impl Body {
    #[inline(never)]
    fn on_echo(&mut self, echo: &Echo) {
        self.robot.on_echo(echo.which, echo.rise, echo.fall);
    }

    /// A frame ended: parsed, then answered.
    #[inline]
    fn on_frame(&mut self, mut frame: spi::Claim, log: &mut Log) {
        self.exchange(&mut frame, log);
        let lost = frame.lost;
        frame.answer();
        if lost > 0 {
            self.robot.on_lost_frames(lost, log);
        }
    }

    /// What a frame says and what is answered to it, without a register. Its own symbol, for whoever
    /// counts its instructions.
    // Requirement: DOC-5-3
    #[inline(never)]
    #[export_name = "robot_frame"]
    fn exchange(&mut self, frame: &mut spi::Claim, log: &mut Log) {
        self.catch_up(frame.reply.due);
        let (clocked, at) = (frame.clocked(), frame.at());
        let (bytes, reply) = frame.both();
        self.robot.on_frame(bytes, clocked, at, log);
        self.robot.refresh_reply(reply);
    }

    /// The replies before the one that is due have gone out.
    #[inline]
    fn catch_up(&mut self, due: u32) {
        while self.reply != due {
            self.reply = self.reply.wrapping_add(1);
            self.robot.reply_gone();
        }
    }

    /// The reply that is due, from what is known now.
    // Requirement: WIRE-spi-6
    fn answer(&mut self) {
        // SAFETY: the robot's priority, without a claim.
        let mut vacancy = unsafe { spi::vacancy() };
        self.catch_up(vacancy.due);
        self.robot.refresh_reply(vacancy.buffer());
        spi::offer(self.reply, vacancy);
    }

    /// For a frame that ends while the robot is busy: the reply after the one that is due; or that
    /// one, where a frame has ended that the robot has not come to.
    fn stand_by(&mut self) {
        // SAFETY: the robot's priority, without a claim.
        let mut vacancy = unsafe { spi::vacancy() };
        self.catch_up(vacancy.due);
        let number = if vacancy.spent {
            self.robot.refresh_reply(vacancy.buffer());
            self.reply
        } else {
            self.robot.following_reply(vacancy.buffer());
            self.reply.wrapping_add(1)
        };
        spi::offer(number, vacancy);
    }

    /// The 100 Hz tick. Its own symbol, for whoever counts its instructions.
    #[inline(never)]
    #[export_name = "robot_tick"]
    fn on_tick(&mut self, sample: Sample, log: &mut Log) {
        self.stand_by();
        let words = adc::words();
        let taps = words.as_ref().map_or(&[][..], |words| &words[..]);
        // SAFETY: the robot's priority.
        unsafe {
            let order = self.robot.on_gyro(gyro::take(), log);
            gyro::begin(order);
        }
        let outputs = self.robot.on_tick(sample, taps, log);
        self.motors.set(outputs.left, outputs.right);
        if outputs.leds != self.leds {
            self.leds = outputs.leds;
            leds::show(outputs.leds);
        }
        if let Some(width) = outputs.servo {
            crate::servo::pulse(width);
        }
        if let Some(which) = outputs.trigger {
            rangefinders::trigger(which);
        }
        if let Some((sensor, reference)) = adc::temperature() {
            self.robot.on_temperature(sensor, reference, log);
        }
        self.answer();
        watchdog::ticked();
        fault_injection::tick();
        #[cfg(feature = "test-hand")]
        crate::hand::tick();
    }
}
