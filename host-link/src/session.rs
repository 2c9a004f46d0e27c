//! A session with the robot: paced frames, the cycle over the battery's cells, the latest of all
//! reports, and the detection of a lost link.

use crate::board_io::BoardIo;
use crate::error::Error;
use crate::link::Link;
use crate::log::LogParser;
pub use crate::mode_check::MODE_CHECK_FRAMES;
use crate::mode_check::{ModeCheck, StartFaults};
use crate::pose::Pose;
use crate::snapshot::Snapshot;
use crate::statistics::LinkStatistics;
use crate::{eeprom, reset};
use fw_core::binary64::Binary64;
use fw_core::eeprom::Config;
use fw_core::types::Faults;
use fw_core::wire::{CellCode, Command, Field, Order, Report, State};
pub use request::{CommandRequest, VelocityRequest};

/// Default frames per second (document, 5.2.2: 40 Hz).
// Requirement: DOC-5.2.2-5
pub const RATE_HZ: u32 = 40;

/// Without a valid frame for this long the link counts as failed, microseconds.
pub const SILENCE_TIMEOUT_US: u64 = 1_000_000;

/// A session over one [`BoardIo`].
pub struct Session<'m> {
    io: &'m mut BoardIo,
    config: Config,
    link: Link,
    period_us: u64,
    next_us: u64,
    last_good_us: u64,
    unanswered: u32,
    last_wrong: String,
    cell: u8,
    snapshot: Snapshot,
    mode_check: ModeCheck,
    start: StartFaults,
    lines: LogParser,
    log_error: Option<String>,
}

impl<'m> Session<'m> {
    /// Awaits `STM_READY`, reads the configuration the STM booted with from the EEPROM, and sets the
    /// link up by it.
    ///
    /// # Errors
    /// [`Error::NotReady`], those of [`eeprom::read`], [`Error::Rejected`], [`Error::Interrupted`].
    // Requirement: DOC-5.2-3
    pub fn open(io: &'m mut BoardIo, rate_hz: u32, ready_timeout_ms: u32) -> Result<Self, Error> {
        reset::await_ready(io, ready_timeout_ms)?;
        let image = eeprom::read(io)?;
        let config = crate::settings::decode(&image)?;
        Ok(Self::with_config(io, config, rate_hz))
    }

    /// A session by a configuration that is known already. `rate_hz` 0 counts as 1.
    pub fn with_config(io: &'m mut BoardIo, config: Config, rate_hz: u32) -> Self {
        let now = (io.clock)();
        Self {
            link: Link::new(&config),
            period_us: u64::from(1_000_000 / rate_hz.max(1)),
            next_us: now,
            last_good_us: now,
            unanswered: 0,
            last_wrong: String::new(),
            cell: 0,
            snapshot: Snapshot::new(&config),
            mode_check: ModeCheck::new(&config),
            start: StartFaults::default(),
            lines: LogParser::default(),
            log_error: None,
            io,
            config,
        }
    }

    /// The same by what the EEPROM holds now; by the present configuration where that cannot be read.
    #[must_use]
    pub fn reread(self) -> Self {
        let (io, config, period_us) = (self.io, self.config, self.period_us);
        let present = eeprom::read(io).and_then(|image| crate::settings::decode(&image));
        let rate_hz = u32::try_from(1_000_000 / period_us).unwrap_or(1);
        Self::with_config(io, present.unwrap_or(config), rate_hz)
    }

    /// The board's lines and buses.
    pub fn io(&mut self) -> &mut BoardIo {
        self.io
    }

    /// Transfers a frame that another process has built; the reply, and its report where valid, which is taken over.
    ///
    /// # Errors
    /// [`Error::Spi`].
    pub fn relay(&mut self, frame: &[u8]) -> Result<(Vec<u8>, Option<Report>), Error> {
        self.wait_until(0);
        let now_us = self.now_us();
        let mut reply = vec![0; frame.len()];
        let (spi, clock) = (&mut *self.io.spi, &mut *self.io.clock);
        let report = self.link.relay(spi, clock, frame, &mut reply)?;
        if let Some(report) = &report {
            self.take_over(now_us, report);
        }
        Ok((reply, report))
    }

    fn take_over(&mut self, now_us: u64, report: &Report) {
        self.snapshot.restarted |= std::mem::take(&mut self.link.restarted);
        self.snapshot.update(now_us, report, self.link.statistics());
    }

    /// The configuration both ends work by.
    pub fn config(&self) -> &Config {
        &self.config
    }

    /// The latest of everything the robot reported.
    pub fn snapshot(&self) -> &Snapshot {
        &self.snapshot
    }

    /// Whether the STM has restarted since the last call: its pose has returned to zero.
    pub fn take_restart(&mut self) -> bool {
        std::mem::take(&mut self.snapshot.restarted)
    }

    /// The link's counters.
    pub fn statistics(&self) -> LinkStatistics {
        self.link.statistics()
    }

    /// Now, microseconds on the board's clock.
    pub fn now_us(&mut self) -> u64 {
        (self.io.clock)()
    }

    /// Time to the next slot of the frame rate, microseconds; 0 once it has come.
    pub fn until_next_us(&mut self) -> u64 {
        self.next_us.saturating_sub(self.now_us())
    }

    /// Waits for the next slot of the frame rate and exchanges one frame. `None`: the reply was
    /// rejected and is counted; the latest good values stay.
    ///
    /// # Errors
    /// [`Error::Interrupted`], [`Error::Spi`], [`Error::Silent`] after [`SILENCE_TIMEOUT_US`] without a valid
    /// reply, [`Error::ModeMismatch`] when none of the first [`MODE_CHECK_FRAMES`] was valid or they show
    /// that the STM runs another mode.
    pub fn exchange(&mut self, request: &CommandRequest) -> Result<Option<Report>, Error> {
        self.io.interrupt.check()?;
        self.exchange_uninterruptible(request)
    }

    /// [`Self::exchange`] that Ctrl-C does not stop: for the frames that stop the robot.
    // Requirement: WIRE-rejected-4
    fn exchange_uninterruptible(
        &mut self,
        request: &CommandRequest,
    ) -> Result<Option<Report>, Error> {
        self.pace();
        let now_us = (self.io.clock)();
        let command = self.command(request);
        let (spi, clock) = (&mut *self.io.spi, &mut *self.io.clock);
        match self.link.exchange(spi, clock, &command)? {
            Ok(report) => {
                self.last_good_us = now_us;
                self.unanswered = 0;
                self.start
                    .update(self.link.statistics().frames, report.faults);
                self.take_over(now_us, &report);
                let checked = self.mode_check.update(&report);
                checked.map_err(|why| self.mode_mismatch(why))?;
                Ok(Some(report))
            }
            Err(wrong) => {
                self.unanswered = self.unanswered.saturating_add(1);
                self.last_wrong = wrong.to_string();
                if self.snapshot.link.accepted == 0 && self.unanswered >= MODE_CHECK_FRAMES {
                    return Err(self.mode_mismatch(format!("the last reply: {wrong}")));
                }
                if now_us.saturating_sub(self.last_good_us) >= SILENCE_TIMEOUT_US {
                    return Err(self.silent_error());
                }
                Ok(None)
            }
        }
    }

    fn mode_mismatch(&self, reason: String) -> Error {
        Error::ModeMismatch {
            mode: self.config.mode().name(),
            frames: self.statistics().frames,
            reason,
        }
    }

    /// # Errors
    /// [`Error::Silent`] after so many frames in a row without a valid reply.
    pub fn check_answered(&mut self, frames: u32) -> Result<(), Error> {
        if self.unanswered >= frames {
            return Err(self.silent_error());
        }
        Ok(())
    }

    fn silent_error(&mut self) -> Error {
        let silent_us = self.now_us().saturating_sub(self.last_good_us);
        Error::Silent {
            ms: silent_us / 1000,
            frames: self.unanswered,
            last: self.last_wrong.clone(),
        }
    }

    /// Reads the STM's log for [`Snapshot::stm`] and [`Snapshot::silent`], and returns the bytes read. A
    /// failure ends the reading and is kept in [`Self::log_error`].
    pub fn poll_log(&mut self) -> Vec<u8> {
        if self.log_error.is_some() {
            return Vec::new();
        }
        let bytes = self.read_log();
        self.log_error = bytes.as_ref().err().map(ToString::to_string);
        let bytes = bytes.unwrap_or_default();
        for (_, line) in self.lines.feed(&bytes) {
            self.snapshot.take_line(line);
        }
        bytes
    }

    /// The bytes of the STM's log that came since they were last read, by this or [`Self::poll_log`].
    ///
    /// # Errors
    /// [`Error::Device`].
    pub fn read_log(&mut self) -> Result<Vec<u8>, Error> {
        (self.io.log)(self.config.log_baud())
    }

    /// Why the STM's log cannot be read, if so.
    pub fn log_error(&self) -> Option<&str> {
        self.log_error.as_deref()
    }

    /// Waits for the next slot and the gap after the last frame. Missed slots are skipped, and are no silence.
    fn pace(&mut self) {
        let now = self.now_us();
        self.last_good_us += now.saturating_sub(self.next_us);
        self.wait_until(self.next_us);
        self.next_us = self.next_us.max(now) + self.period_us;
    }

    /// Waits for this time and the gap after the last frame.
    fn wait_until(&mut self, slot_us: u64) {
        let due_us = slot_us.max(self.link.due_us());
        if let Ok(wait @ 1..) = u32::try_from(due_us.saturating_sub(self.now_us())) {
            (self.io.delay)(wait);
        }
    }

    // Requirement: DOC-5.2.1-4, WIRE-battery-1
    fn command(&mut self, request: &CommandRequest) -> Command {
        let cell = self.cell;
        self.cell = (cell + 1) % self.config.cells().max(1);
        let (velocity, sweep) = request.velocity.unwrap_or_default().code();
        Command {
            velocity,
            sweep,
            expected: request.target.map(Pose::code).unwrap_or_default(),
            apply: request.target.is_some(),
            percent: Binary64(request.percent.to_bits()),
            tune: request.tune.unwrap_or(CellCode { cell, voltage: 0 }),
            clear_faults: request.clear_faults.union(self.start.own),
            order: request.order,
            ..Command::default()
        }
    }

    /// Exchanges frames without a command until a valid report arrives.
    ///
    /// # Errors
    /// Those of [`Self::exchange`].
    pub fn wait_for_reply(&mut self) -> Result<Report, Error> {
        loop {
            if let Some(report) = self.exchange(&CommandRequest::default())? {
                return Ok(report);
            }
        }
    }

    /// Exchanges frames without a command until both ends are known to run the same mode.
    ///
    /// # Errors
    /// Those of [`Self::exchange`].
    pub fn confirm_mode(&mut self) -> Result<(), Error> {
        while !self.mode_check.is_confirmed() {
            self.exchange(&CommandRequest::default())?;
        }
        Ok(())
    }

    /// Exchanges frames without a command and reads the log for so many microseconds. Returns what the robot
    /// reported, how many bytes its log had, and what ended the exchange early.
    ///
    /// # Errors
    /// [`Error::Interrupted`].
    pub fn observe(&mut self, us: u64) -> Result<(Snapshot, usize, Option<Error>), Error> {
        let ends_us = self.now_us() + us;
        let (mut logged, mut ended) = (self.poll_log().len(), None);
        while ended.is_none() && self.now_us() < ends_us {
            ended = self.exchange(&CommandRequest::default()).err();
            logged += self.poll_log().len();
        }
        if ended == Some(Error::Interrupted) {
            return Err(Error::Interrupted);
        }
        let mut seen = self.snapshot.clone();
        seen.link = self.statistics();
        Ok((seen, logged, ended))
    }

    /// Clears the fault of the silence before this session and resumes. In Normal mode, whose replies show
    /// neither state nor faults, the first frame with the apply bit does that.
    ///
    /// # Errors
    /// Those of [`Self::exchange`]; [`Error::Fault`] if the robot stays stopped or is faulted.
    pub fn resume(&mut self) -> Result<(), Error> {
        let mut report = self.wait_for_reply()?;
        for _ in 0..RESUME_FRAMES {
            if report.state != State::Stopped && !report.faults.intersects(Faults::LINK_LOST) {
                break;
            }
            let request = CommandRequest {
                order: Order::Resume,
                clear_faults: Faults::LINK_LOST,
                ..CommandRequest::default()
            };
            if let Some(next) = self.exchange(&request)? {
                report = next;
            }
        }
        self.ensure_drivable(report.state, report.faults)
    }

    /// In guarded modes: an error if the robot reports that it is stopped or faulted.
    ///
    /// # Errors
    /// [`Error::Fault`].
    pub fn ensure_drivable(&self, state: State, faults: Faults) -> Result<(), Error> {
        let stands = matches!(state, State::Stopped | State::Faulted);
        if stands && self.config.mode().has(Field::Status) {
            return Err(Error::Fault {
                state: state.name(),
                faults: crate::snapshot::fault_names(faults).join(", "),
            });
        }
        Ok(())
    }

    /// Stops the robot: in Normal mode its own pose becomes the target, in guarded modes it is ordered to
    /// brake; without further frames the stop deadline holds the motors. Ctrl-C does not end this early.
    pub fn stop(&mut self) {
        let mode = self.config.mode();
        for _ in 0..STOP_FRAMES {
            let mut request = CommandRequest::default();
            if mode.has(Field::Status) {
                request.order = Order::Stop;
            } else if mode.has(Field::Position) {
                request.target = self.snapshot.pose;
            }
            if let Err(Error::Spi(_)) = self.exchange_uninterruptible(&request) {
                // Nothing more can be sent: the stop deadline does it.
                return;
            }
        }
    }
}

/// Frames in which the robot must have resumed.
const RESUME_FRAMES: usize = 40;

/// Frames of the stop. At 40 Hz a quarter of a second, in which the robot comes to rest.
const STOP_FRAMES: usize = 10;

mod request;

#[cfg(test)]
mod tests;
