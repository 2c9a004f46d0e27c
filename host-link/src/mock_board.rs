//! A board in memory behind [`BoardIo`], with a fault at any chosen call. The real board's behaviour is
//! tested on the virtual one.

use crate::board_io::{BoardIo, Interrupt, IoError, OutputLine};
use fw_core::binary64::Binary64;
use fw_core::eeprom::{Config, IMAGE_LEN, Image};
use fw_core::types::Faults;
use fw_core::wire::{Command, MAX_FRAME, Mode, PoseCode, Reason, Report, StmLink};
use std::cell::RefCell;
use std::rc::Rc;

/// A fault at a chosen call.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum IoFault {
    /// This call fails, the next works again.
    FailOnce(usize),
    /// From this call on nothing answers on I2C and SPI; the lines still work.
    BusesFail(usize),
    /// From this call on nothing works at all.
    AllFail(usize),
    /// The call panics.
    Panic(usize),
    /// Ctrl-C during this call.
    Interrupt(usize),
}

/// What the robot does with a command: changes what it reports.
pub type OnCommand = Box<dyn FnMut(&Command, &mut Report)>;

/// The board as seen through its lines and buses.
#[allow(clippy::struct_excessive_bools)] // so many lines
pub struct MockBoard {
    /// The fault to inject, if any.
    pub fault: Option<IoFault>,
    /// Calls so far, over all handles.
    pub calls: usize,
    /// Level of `WP_EEPROM`.
    pub protected: bool,
    /// Level of SELECT.
    pub selected: bool,
    /// Whether RESET is held low.
    pub in_reset: bool,
    /// Completed resets.
    pub resets: usize,
    /// The EEPROM's content.
    pub memory: Image,
    /// Every frame that was accepted, in order.
    pub commands: Vec<Command>,
    /// What the board reports in its next reply.
    pub report: Report,
    /// Called with every accepted command.
    pub on_command: Option<OnCommand>,
    /// Unread bytes of the UART log.
    pub log: Vec<u8>,
    /// Whether the log's wire is there.
    pub log_connected: bool,
    /// Replies are malformed from this frame on.
    pub garbled_from: usize,
    drive: DriveModel,
    link: Option<StmLink>,
    /// Number of the next reply.
    reply: u32,
    /// Time of the mock, µs.
    pub now_us: u64,
    low_since_us: u64,
    busy_until_us: u64,
    /// Until then a byte between EEPROM and STM may still be under way.
    taken_from_us: u64,
    pointer: usize,
    /// The machine's Ctrl-C flag.
    pub interrupt: Interrupt,
}

/// The error of every injected fault.
pub fn injected() -> IoError {
    IoError::new("injected")
}

/// A board that outlives its connections.
pub type Shared = Rc<RefCell<MockBoard>>;

/// A drive behind two lags: 2 per second and percent beyond 20 %, lags of 0.15 s.
#[derive(Default)]
struct DriveModel {
    percent: f64,
    lagged: [f64; 2],
    position: f64,
    ticks: u64,
    lines: u32,
}

impl DriveModel {
    /// The log's next line.
    fn line(&mut self, text: &str) -> String {
        self.lines += 1;
        format!("I{:05}: {text}\n", (self.lines - 1) % 100_000)
    }

    /// One tick of 10 ms, and its line of the log.
    fn tick(&mut self) -> String {
        let line = self.line(&format!("T {:.2} {:.3}", self.percent, self.position));
        let beyond = (self.percent.abs() - 20.0).max(0.0).copysign(self.percent);
        if self.percent == 0.0 {
            // It brakes.
            self.lagged = [0.0; 2];
        }
        for _ in 0..100 {
            self.lagged[0] += (2.0 * beyond - self.lagged[0]) * 1e-4 / 0.15;
            self.lagged[1] += (self.lagged[0] - self.lagged[1]) * 1e-4 / 0.15;
            self.position += self.lagged[1] * 1e-4;
        }
        line
    }
}

impl MockBoard {
    fn call(&mut self, bus: bool) -> Result<(), IoError> {
        let call = self.calls;
        self.calls += 1;
        match self.fault {
            Some(IoFault::FailOnce(at)) if call == at => Err(injected()),
            Some(IoFault::BusesFail(at)) if call >= at && bus => Err(injected()),
            Some(IoFault::AllFail(at)) if call >= at => Err(injected()),
            Some(IoFault::Panic(at)) if call == at => panic!("injected panic"),
            Some(IoFault::Interrupt(at)) if call == at => {
                self.interrupt.raise();
                Ok(())
            }
            _ => Ok(()),
        }
    }

    fn ready(&self) -> bool {
        !self.in_reset && !self.selected && Config::decode(&self.memory).is_ok()
    }

    fn set_reset(&mut self, high: bool) {
        assert!(!high || !self.selected, "released without the EEPROM");
        if high && self.in_reset {
            let ticks = self.drive.ticks;
            (self.link, self.reply) = (link(&self.memory), 1);
            self.drive = DriveModel::default();
            self.drive.ticks = ticks;
            self.resets += usize::from(self.now_us - self.low_since_us >= 100_000);
        } else if !high {
            self.low_since_us = self.now_us;
        }
        self.in_reset = !high;
    }

    fn set_select(&mut self, high: bool) {
        assert!(high || self.protected, "returned without protection");
        (self.selected, self.taken_from_us) = (high, self.now_us + 100);
    }

    /// A transfer with the EEPROM.
    fn i2c(&mut self, address: u8, write: &[u8], read: &mut [u8]) -> Result<(), IoError> {
        self.call(true)?;
        assert_eq!(address, 0x50);
        assert!(self.now_us >= self.taken_from_us, "a byte is cut");
        if !self.selected || self.now_us < self.busy_until_us {
            return Err(injected());
        }
        self.write(write)?;
        self.read(read);
        Ok(())
    }

    /// One I2C write to the EEPROM.
    fn write(&mut self, bytes: &[u8]) -> Result<(), IoError> {
        let [high, low, data @ ..] = bytes else {
            return Err(injected());
        };
        self.pointer = usize::from(u16::from_be_bytes([*high, *low]));
        if data.is_empty() {
            return Ok(());
        }
        let fits = self.pointer % 32 + data.len() <= 32;
        assert!(fits, "burst crosses a row");
        if !self.protected {
            self.memory.0[self.pointer..self.pointer + data.len()].copy_from_slice(data);
        }
        self.busy_until_us = self.now_us + 3_000;
        Ok(())
    }

    fn read(&mut self, out: &mut [u8]) {
        for byte in out {
            *byte = self.memory.0[self.pointer % IMAGE_LEN];
            self.pointer += 1;
        }
    }

    /// One frame; in every frame the robot covers half of its distance to the target, up to 100 mm
    /// along each axis and 45°.
    fn frame(&mut self, back: &mut [u8], out: &[u8]) {
        let Some(link) = &mut self.link else { return };
        self.report.cell.cell = (self.report.cell.cell + 1) % 2;
        let mut reply = [0; MAX_FRAME];
        let len = link.encode_reply(self.reply, &self.report, &mut reply);
        self.reply += 1;
        back.copy_from_slice(&reply[..len]);
        let command = match link.receive(out, 0, self.reply) {
            Ok(command) => command,
            // The first frames of a new session.
            Err(error) if matches!(error.reason, Reason::Stale { .. }) => {
                self.report.faults |= Faults::FRAME_REJECTED;
                return;
            }
            Err(error) => panic!("the Pi sends a wrong frame: {error}"),
        };
        self.report.faults = self.report.faults.difference(command.clear_faults);
        if command.apply {
            let step = |from: i32, to: i32| from + ((to - from) / 2).clamp(-100_000, 100_000);
            let (from, to) = (self.report.pose, command.expected);
            // Of 15 bits, the turn of 16.
            let turn = (to.rotation.wrapping_sub(from.rotation) << 1).cast_signed();
            let turn = (turn.clamp(-0x2000, 0x2000) >> 1).cast_unsigned();
            self.report.pose = PoseCode {
                x: step(from.x, to.x),
                y: step(from.y, to.y),
                rotation: from.rotation.wrapping_add(turn) & 0x7FFF,
            };
        }
        self.drive.percent = f64::from_bits(command.percent.0);
        self.report.measurement = Binary64(self.drive.position.to_bits());
        if command.tune.voltage != 0 && self.log_connected {
            let tap = command.tune.cell + 1;
            let tuned = format!("tuned tap {tap}: upper resistor 33120 ohm");
            self.log.extend(self.drive.line(&tuned).as_bytes());
        }
        if self.commands.len() >= self.garbled_from {
            back.fill(0xFF);
        }
        if let Some(robot) = &mut self.on_command {
            robot(&command, &mut self.report);
        }
        self.commands.push(command);
    }

    /// Advances time: motion and log of the drive in a tuning mode.
    fn pass(&mut self, us: u64) {
        self.now_us += us;
        let mode = Config::decode(&self.memory).map(|config| config.mode());
        let tunes = matches!(mode, Ok(Mode::TuneRotate | Mode::TuneMove));
        while self.drive.ticks * 10_000 < self.now_us {
            self.drive.ticks += 1;
            if tunes && !self.in_reset && !self.selected {
                let line = self.drive.tick();
                if self.log_connected {
                    self.log.extend(line.as_bytes());
                }
            }
        }
    }
}

fn link(memory: &Image) -> Option<StmLink> {
    let config = Config::decode(memory).ok()?;
    Some(StmLink::new(config.link_setup()))
}

/// A board whose EEPROM holds `memory`, and the I/O that reaches it.
pub fn mock_board(memory: &Image, fault: Option<IoFault>) -> (Shared, BoardIo) {
    let board = Rc::new(RefCell::new(MockBoard {
        fault,
        calls: 0,
        protected: true,
        selected: false,
        in_reset: false,
        resets: 0,
        memory: memory.clone(),
        commands: Vec::new(),
        report: Report::default(),
        on_command: None,
        log: Vec::new(),
        log_connected: true,
        garbled_from: usize::MAX,
        drive: DriveModel::default(),
        link: link(memory),
        reply: 1,
        now_us: 0,
        low_since_us: 0,
        busy_until_us: 0,
        taken_from_us: 0,
        pointer: 0,
        interrupt: Interrupt::new(),
    }));
    let io = reconnect(&board);
    (board, io)
}

/// A second connection to the same board.
pub fn reconnect(board: &Shared) -> BoardIo {
    let [spi, i2c, lines, delay, clock, log] = [(); 6].map(|()| board.clone());
    let line = |set: fn(&mut MockBoard, bool)| -> OutputLine {
        let board = board.clone();
        Box::new(move |high| {
            let mut board = board.borrow_mut();
            board.call(false).map(|()| set(&mut board, high))
        })
    };
    BoardIo {
        spi: Box::new(move |out, back, setup_ns| {
            let mut board = spi.borrow_mut();
            board.call(true)?;
            board.pass(u64::from(setup_ns / 1000));
            board.frame(back, out);
            Ok(())
        }),
        i2c: Box::new(move |address, write, read| i2c.borrow_mut().i2c(address, write, read)),
        reset: line(MockBoard::set_reset),
        select: line(MockBoard::set_select),
        protect: line(|board, high| board.protected = high),
        ready: Box::new(move || {
            let mut board = lines.borrow_mut();
            board.call(false).map(|()| board.ready())
        }),
        delay: Box::new(move |us| delay.borrow_mut().pass(us.into())),
        clock: Box::new(move || clock.borrow().now_us),
        real_time: true,
        log: Box::new(move |_| Ok(std::mem::take(&mut log.borrow_mut().log))),
        interrupt: board.borrow().interrupt.clone(),
    }
}
