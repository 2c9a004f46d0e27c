//! A conversation with the robot: paced frames, the walk over the battery's cells, the latest of
//! everything, and noticing silence.

use crate::board_io::{Clock, Machine, Wires};
use crate::error::Error;
use crate::link::Link;
use crate::log::{Line, Lines};
use crate::mode_check::Acquaintance;
use crate::pose::Place;
use crate::snapshot::Snapshot;
use crate::statistics::Statistics;
use crate::{eeprom, reset};
use embedded_hal::delay::DelayNs;
use fw_core::binary64::Binary64;
use fw_core::eeprom::Config;
use fw_core::types::Faults;
use fw_core::wire::position::Position;
use fw_core::wire::status::Status;
use fw_core::wire::strategy::Duties;
use fw_core::wire::{chain, CellCode, Command, Mode, Order, Report, State};

/// Frames per second unless told otherwise (document, 5.2.2: 40 Hz).
// Requirement: DOC-5.2.2-5
pub const RATE_HZ: u32 = 40;

/// Without a valid frame for this long the link counts as failed, microseconds.
pub const SILENCE_US: u64 = 1_000_000;

/// When not one of the first frames is understood, the two ends do not speak the same chain with the
/// same keys: no need to wait for [`SILENCE_US`].
pub const STRANGER_FRAMES: u32 = 10;

/// What one frame is to say; [`Session`] adds the battery's walk and the sequence.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Wish {
    /// Where to drive, if anywhere.
    pub go: Option<Place>,
    /// Guarded modes.
    pub order: Order,
    /// Guarded modes: latched faults to clear.
    pub clear_faults: Faults,
    /// Tuning modes: duty, percent, −100 to 100.
    pub percent: f64,
    /// A cell and the reference voltage it is tuned to; then it takes the place of the walk.
    pub tune: Option<CellCode>,
}

/// A conversation over one [`Machine`].
pub struct Session<'m, W: Wires> {
    machine: &'m mut Machine<W>,
    config: Config,
    link: Link,
    period_us: u64,
    next_us: u64,
    last_good_us: u64,
    unanswered: u32,
    last_wrong: Option<String>,
    cell: u8,
    snapshot: Snapshot,
    acquaintance: Acquaintance,
    lines: Lines,
    deaf: Option<String>,
}

/// Whether the mode carries an expected and an actual pose.
#[must_use]
pub fn has_position(mode: Mode) -> bool {
    chain(mode)
        .iter()
        .any(|strategy| strategy.name == Position::NAME)
}

/// Whether the mode carries the robot's state, its faults, and orders.
#[must_use]
pub fn has_status(mode: Mode) -> bool {
    chain(mode)
        .iter()
        .any(|strategy| strategy.name == Status::NAME)
}

impl<'m, W: Wires> Session<'m, W> {
    /// Awaits `STM_READY`, reads the configuration the STM booted with from the EEPROM, and sets the
    /// link up by it.
    ///
    /// # Errors
    /// [`Error::NotReady`], those of [`eeprom::read`], [`Error::Rejected`], [`Error::Interrupted`].
    // Requirement: DOC-5.2-3
    pub fn open(
        machine: &'m mut Machine<W>,
        rate_hz: u32,
        ready_timeout_ms: u32,
    ) -> Result<Self, Error> {
        reset::await_ready(machine, ready_timeout_ms)?;
        let image = eeprom::read(machine)?;
        let config = crate::settings::decode(&image)?;
        Ok(Self::with_config(machine, config, rate_hz))
    }

    /// A session by a configuration that is known already. `rate_hz` 0 counts as 1.
    #[must_use]
    pub fn with_config(machine: &'m mut Machine<W>, config: Config, rate_hz: u32) -> Self {
        let now = machine.clock.micros();
        Self {
            link: Link::new(&config),
            period_us: u64::from(1_000_000 / rate_hz.max(1)),
            next_us: now,
            last_good_us: now,
            unanswered: 0,
            last_wrong: None,
            cell: 0,
            snapshot: Snapshot::new(&config),
            acquaintance: Acquaintance::new(&config),
            lines: Lines::default(),
            deaf: None,
            machine,
            config,
        }
    }

    /// The configuration both ends work by.
    #[must_use]
    pub fn config(&self) -> &Config {
        &self.config
    }

    /// The latest of everything the robot reported.
    #[must_use]
    pub fn snapshot(&self) -> &Snapshot {
        &self.snapshot
    }

    /// The link's counters.
    #[must_use]
    pub fn statistics(&self) -> Statistics {
        self.link.statistics()
    }

    /// Now, microseconds on the machine's clock.
    pub fn now_us(&mut self) -> u64 {
        self.machine.clock.micros()
    }

    /// Waits for the next slot of the frame rate and exchanges one frame. `None`: the reply was
    /// rejected and is counted; the latest good values stay.
    ///
    /// # Errors
    /// [`Error::Interrupted`], [`Error::Spi`], [`Error::Silent`] after [`SILENCE_US`] without a valid
    /// reply, [`Error::Stranger`] when none of the first [`STRANGER_FRAMES`] was valid or they show
    /// that the STM runs another mode.
    pub fn exchange(&mut self, wish: &Wish) -> Result<Option<Report>, Error> {
        self.machine.interrupt.check()?;
        self.exchange_regardless(wish)
    }

    /// [`Self::exchange`] that Ctrl-C does not stop: for the frames that stop the robot.
    // Requirement: WIRE-rejected-4
    fn exchange_regardless(&mut self, wish: &Wish) -> Result<Option<Report>, Error> {
        self.pace();
        let now_us = self.machine.clock.micros();
        let command = self.command(wish);
        match self
            .link
            .exchange(&mut self.machine.spi, &mut self.machine.clock, &command)?
        {
            Ok(report) => {
                self.last_good_us = now_us;
                self.unanswered = 0;
                self.snapshot.take(now_us, &report, self.link.statistics());
                if let Err(why) = self.acquaintance.take(&report) {
                    return Err(self.stranger(why));
                }
                Ok(Some(report))
            }
            Err(wrong) => {
                self.unanswered = self.unanswered.saturating_add(1);
                self.last_wrong = Some(wrong.to_string());
                let silent_us = now_us.saturating_sub(self.last_good_us);
                if self.snapshot.link.accepted == 0 && self.unanswered >= STRANGER_FRAMES {
                    let last = self.last_wrong.clone().unwrap_or_default();
                    return Err(self.stranger(format!("the last reply: {last}")));
                }
                if silent_us >= SILENCE_US {
                    return Err(self.silence());
                }
                Ok(None)
            }
        }
    }

    fn stranger(&self, why: String) -> Error {
        Error::Stranger {
            mode: self.config.mode.name(),
            frames: self.statistics().frames,
            why,
        }
    }

    /// The error of a link on which nothing valid arrives.
    pub fn silence(&mut self) -> Error {
        let silent_us = self.now_us().saturating_sub(self.last_good_us);
        Error::Silent {
            ms: silent_us / 1000,
            frames: self.unanswered,
            last: self.last_wrong.clone().unwrap_or_default(),
        }
    }

    /// What the STM's log said since it was last asked for.
    ///
    /// # Errors
    /// [`Error::Device`].
    pub fn log(&mut self) -> Result<Vec<u8>, Error> {
        self.machine.uart.fresh()
    }

    /// Listens to the STM's log for its end of the link: [`Snapshot::stm`]. Where the log cannot be
    /// read, nothing is heard: [`Self::deaf`] says why.
    pub fn hear(&mut self) {
        if self.deaf.is_some() {
            return;
        }
        match self.machine.uart.fresh() {
            Ok(bytes) => {
                for line in self.lines.feed(&bytes) {
                    if let Line::Link { link, .. } = line {
                        self.snapshot.stm = Some(link);
                    }
                }
            }
            Err(why) => self.deaf = Some(why.to_string()),
        }
    }

    /// Why the STM's log cannot be heard, if so.
    #[must_use]
    pub fn deaf(&self) -> Option<&str> {
        self.deaf.as_deref()
    }

    /// Waits for the next slot. Slots that were missed are not made up for.
    fn pace(&mut self) {
        let now = self.machine.clock.micros();
        if let Ok(wait) = u32::try_from(self.next_us.saturating_sub(now)) {
            if wait > 0 {
                self.machine.delay.delay_us(wait);
            }
        }
        self.next_us = self.next_us.max(now) + self.period_us;
    }

    // Requirement: DOC-5.2.1-4, WIRE-battery-1
    fn command(&mut self, wish: &Wish) -> Command {
        let cell = self.cell;
        self.cell = (cell + 1) % self.config.cells.max(1);
        Command {
            expected: wish.go.map(Place::code).unwrap_or_default(),
            apply: wish.go.is_some(),
            percent: Binary64(wish.percent.to_bits()),
            tune: wish.tune.unwrap_or(CellCode { cell, voltage: 0 }),
            clear_faults: wish.clear_faults,
            order: wish.order,
            ..Command::default()
        }
    }

    /// Exchanges frames that ask for nothing until one valid report is there.
    ///
    /// # Errors
    /// Those of [`Self::exchange`].
    pub fn greet(&mut self) -> Result<Report, Error> {
        loop {
            if let Some(report) = self.exchange(&Wish::default())? {
                return Ok(report);
            }
        }
    }

    /// Exchanges frames that ask for nothing until both ends are known to speak the same mode.
    ///
    /// # Errors
    /// Those of [`Self::exchange`].
    pub fn acquaint(&mut self) -> Result<(), Error> {
        while !self.acquaintance.made() {
            self.exchange(&Wish::default())?;
        }
        Ok(())
    }

    /// In guarded modes: clears the fault of the silence before this session and resumes. In Normal
    /// mode the first frame with the apply bit does that.
    ///
    /// # Errors
    /// Those of [`Self::exchange`]; [`Error::Fault`] if the robot stays stopped or is faulted.
    pub fn resume(&mut self) -> Result<(), Error> {
        let report = self.greet()?;
        if !has_status(self.config.mode) {
            return Ok(());
        }
        let mut state = report.state;
        let mut faults = report.faults;
        for _ in 0..RESUME_FRAMES {
            if state != State::Stopped && !faults.intersects(Faults::LINK_LOST) {
                break;
            }
            let wish = Wish {
                order: Order::Resume,
                clear_faults: Faults::LINK_LOST,
                ..Wish::default()
            };
            if let Some(report) = self.exchange(&wish)? {
                (state, faults) = (report.state, report.faults);
            }
        }
        self.refuse(state, faults)
    }

    /// In guarded modes: an error if the robot says that it will not drive.
    ///
    /// # Errors
    /// [`Error::Fault`].
    pub fn refuse(&self, state: State, faults: Faults) -> Result<(), Error> {
        if has_status(self.config.mode) && matches!(state, State::Stopped | State::Faulted) {
            return Err(Error::Fault {
                state: crate::snapshot::state_name(state),
                faults: crate::snapshot::fault_names(faults).join(", "),
            });
        }
        Ok(())
    }

    /// Stops the robot, whatever runs: in Normal mode it is told to be where it is, in guarded modes
    /// to brake; then this end falls silent and the stop deadline holds the motors.
    /// Ctrl-C does not cut this short.
    pub fn halt(&mut self) {
        for _ in 0..HALT_FRAMES {
            let wish = if has_status(self.config.mode) {
                Wish {
                    order: Order::Stop,
                    ..Wish::default()
                }
            } else {
                let here = has_position(self.config.mode)
                    .then_some(self.snapshot.pose)
                    .flatten();
                Wish {
                    go: here,
                    ..Wish::default()
                }
            };
            if let Err(Error::Spi(_)) = self.exchange_regardless(&wish) {
                // Nothing more can be sent: the stop deadline does it.
                return;
            }
        }
    }
}

/// Frames in which the robot must have resumed.
const RESUME_FRAMES: usize = 40;

/// Frames of the stop. At 40 Hz a quarter of a second, in which the robot comes to rest.
const HALT_FRAMES: usize = 10;

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mock_board::machine;
    use crate::settings::Settings;
    use fw_core::eeprom::{first_board, Divider, Image};

    /// The first board's EEPROM with so many cells.
    fn image(cells: u8) -> Image {
        let mut config = first_board();
        config.cells = cells;
        config.dividers = [Divider {
            upper: 1000,
            lower: 1000,
        }; 8];
        Settings {
            config,
            platform_page: true,
        }
        .image()
    }

    // Requirement: DOC-5.2.1-4, WIRE-battery-1
    #[test]
    fn frames_walk_all_cells_unless_one_is_tuned() {
        let (board, mut machine) = machine(&image(2), None);
        let mut session = Session::open(&mut machine, RATE_HZ, 100).unwrap();
        let tune = CellCode {
            cell: 1,
            voltage: 740,
        };
        for wish in [None, None, Some(tune), Some(tune), None, None, None] {
            let wish = Wish {
                tune: wish,
                ..Wish::default()
            };
            session.exchange(&wish).unwrap();
        }
        let told: Vec<_> = board.borrow().commands.iter().map(|c| c.tune).collect();
        let walked = |cell| CellCode { cell, voltage: 0 };
        assert_eq!(told[..4], [walked(0), walked(1), tune, tune]);
        assert_eq!(told[4..], [walked(0), walked(1), walked(0)]);
    }

    // Requirement: WIRE-rejected-1, WIRE-rejected-4
    #[test]
    fn a_rejected_reply_is_counted_by_its_cause_and_the_last_good_values_stay() {
        let (board, mut machine) = machine(&image(2), None);
        board.borrow_mut().report.pose.x = 1_234_000;
        let mut session = Session::open(&mut machine, RATE_HZ, 100).unwrap();
        assert!(session.exchange(&Wish::default()).unwrap().is_some());
        assert!(session.exchange(&Wish::default()).unwrap().is_some());
        let before = (session.snapshot().pose, session.snapshot().cells_v.clone());
        assert_eq!(before.0.map(|pose| pose.x_mm), Some(1234.0));
        {
            let mut board = board.borrow_mut();
            board.report.pose.x = 0;
            board.deaf_from = 0;
        }
        for rejected in 1..=5 {
            assert_eq!(session.exchange(&Wish::default()), Ok(None));
            let statistics = session.statistics();
            assert_eq!((statistics.accepted, statistics.rejected), (2, rejected));
            assert_eq!(statistics.causes.get(fw_core::wire::Cause::Key), rejected);
            let now = (session.snapshot().pose, session.snapshot().cells_v.clone());
            assert_eq!(now, before);
        }
    }
}
