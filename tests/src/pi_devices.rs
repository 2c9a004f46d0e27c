//! The Pi's device files with the virtual board behind them, for the program as a Pi runs it: its system calls
//! come from `devices/ioctl.c`.

use std::collections::BTreeSet;
use std::fs::{self, File, OpenOptions};
use std::io::{self, Read, Write};
use std::os::unix::net::{UnixListener, UnixStream};
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread;
use std::time::{Duration, Instant};

use embedded_hal::digital::{InputPin, OutputPin, PinState};
use embedded_hal::i2c::{I2c, Operation as I2cOperation};
use embedded_hal::spi::{Operation, SpiDevice};
use host_link::linux::{PROTECT, READY, RESET, SELECT};
use twin::Board;
use twin::hal::{I2cError, Line, SpiTiming};

/// Errors of `errno.h`, by their numbers on every Linux.
const EIO: u32 = 5;
const EBUSY: u32 = 16;
const EINVAL: u32 = 22;
const ETIMEDOUT: u32 = 110;
const EREMOTEIO: u32 = 121;

/// Flags of `linux/gpio.h` and `linux/i2c.h`.
const LINE_INPUT: u32 = 1;
const LINE_OUTPUT: u32 = 2;
const READ: u32 = 1;

/// How often time passes and the log goes to its file where the program asks for nothing.
const STEP: Duration = Duration::from_millis(5);

/// What the devices remember.
struct State {
    board: Board,
    /// When the board had its power.
    begun: Instant,
    spi_mode: Option<u32>,
    spi_bits: Option<u32>,
    spi_hz: u64,
    /// Lines that a program holds.
    held: BTreeSet<u32>,
    /// A line that is let go keeps its level, as newer kernels do; else the board pulls it.
    keeps_levels: bool,
    log: File,
    logged: usize,
    /// Names of the files and folders that the program has synced.
    synced: Vec<String>,
}

/// Device files in a folder, and the board behind them.
pub struct PiDevices {
    folder: PathBuf,
    /// The board.
    pub board: Board,
    state: Arc<Mutex<State>>,
}

impl PiDevices {
    /// Connects a board with device files in a folder; it runs in real time from now on.
    ///
    /// # Errors
    /// Where a file cannot be made, or `cc` cannot build what is loaded before the program.
    pub fn new(folder: &Path, board: &Board, keeps_levels: bool) -> io::Result<Self> {
        let source = Path::new(env!("CARGO_MANIFEST_DIR")).join("devices/ioctl.c");
        let mut compile = Command::new("cc");
        compile.args(["-shared", "-fPIC", "-O1", "-pthread", "-o"]);
        let built = compile.arg(folder.join("ioctl.so")).arg(source).status()?;
        if !built.success() {
            return Err(io::Error::other("cc cannot build tests/devices/ioctl.c"));
        }
        for (name, content) in [
            ("spidev0.0", ""),
            ("i2c-1", ""),
            ("gpiochip0", "pinctrl-bcm2711"),
        ] {
            fs::write(folder.join(name), content)?;
        }
        let mut log = OpenOptions::new();
        log.create(true).append(true);
        let state = State {
            board: board.clone(),
            begun: Instant::now(),
            spi_mode: None,
            spi_bits: None,
            spi_hz: 0,
            held: BTreeSet::new(),
            keeps_levels,
            log: log.open(folder.join("serial0"))?,
            logged: 0,
            synced: Vec::new(),
        };
        let state = Arc::new(Mutex::new(state));
        let listener = UnixListener::bind(folder.join("socket"))?;
        let devices = Self {
            folder: folder.to_path_buf(),
            board: board.clone(),
            state: Arc::clone(&state),
        };
        let clock = Arc::downgrade(&state);
        thread::spawn(move || {
            while let Some(state) = clock.upgrade() {
                lock(&state).catch_up();
                drop(state);
                thread::sleep(STEP);
            }
        });
        let state = Arc::downgrade(&state);
        thread::spawn(move || {
            // One program at a time: the kernel has let a dead one's lines go before the next one asks.
            while let (Ok((program, _)), Some(state)) = (listener.accept(), state.upgrade()) {
                let _ = serve(program, &state);
                lock(&state).release_all();
            }
        });
        Ok(devices)
    }

    /// The program on these devices.
    pub fn command(&self, program: &Path) -> Command {
        let mut command = Command::new(program);
        command.env("LD_PRELOAD", self.folder.join("ioctl.so"));
        command.env("ROBOT_DEVICES", self.folder.join("socket"));
        for (option, name) in [
            ("--spi", "spidev0.0"),
            ("--i2c", "i2c-1"),
            ("--gpiochip", "gpiochip0"),
            ("--uart", "serial0"),
            ("--state-dir", ""),
        ] {
            command.arg(option).arg(self.folder.join(name));
        }
        command
    }

    /// Mode, bits and clock that the program set for SPI.
    pub fn spi_settings(&self) -> (Option<u32>, Option<u32>, u64) {
        let state = lock(&self.state);
        (state.spi_mode, state.spi_bits, state.spi_hz)
    }

    /// Names of the files and folders synced so far, in order.
    pub fn synced(&self) -> Vec<String> {
        lock(&self.state).synced.clone()
    }

    /// Levels of RESET, SELECT and `WP_EEPROM`.
    pub fn levels(&self) -> [bool; 3] {
        [Line::Reset, Line::Select, Line::WriteProtect]
            .map(|line| self.board.pin(line).is_high() == Ok(true))
    }
}

fn lock(state: &Mutex<State>) -> MutexGuard<'_, State> {
    state.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Answers one program until it ends.
fn serve(mut program: UnixStream, state: &Mutex<State>) -> io::Result<()> {
    loop {
        let [kind, number, length] = numbers(&mut program)?;
        let mut bytes = vec![0; length as usize];
        program.read_exact(&mut bytes)?;
        let answer = lock(state).answer(kind, number, &bytes);
        // The kernel answers when the wire is done: a sleep after it is one of the board, too.
        let [board, computer] = lock(state).times();
        thread::sleep(board.saturating_sub(computer));
        let (cause, bytes) = answer.map_or_else(|cause| (cause, Vec::new()), |bytes| (0, bytes));
        let length = u32::try_from(bytes.len()).unwrap_or(u32::MAX);
        let head = [cause, length].map(u32::to_ne_bytes).concat();
        program.write_all(&[head, bytes].concat())?;
    }
}

fn numbers<const N: usize>(from: &mut impl Read) -> io::Result<[u32; N]> {
    let mut numbers = [0; N];
    for number in &mut numbers {
        let mut bytes = [0; 4];
        from.read_exact(&mut bytes)?;
        *number = u32::from_ne_bytes(bytes);
    }
    Ok(numbers)
}

impl State {
    /// The board's time and the computer's, since the board had its power.
    fn times(&self) -> [Duration; 2] {
        let board = Duration::from_micros(self.board.now_us());
        [board, self.begun.elapsed()]
    }

    /// Lets the board's time come up with the computer's, and writes the log.
    fn catch_up(&mut self) {
        let [board, computer] = self.times();
        let due = computer.saturating_sub(board).as_micros();
        self.board.run_us(u64::try_from(due).unwrap_or(u64::MAX));
        let fresh = self.board.uart_from(self.logged);
        self.logged += fresh.len();
        self.log
            .write_all(&fresh)
            .expect("a log that can be written");
    }

    /// What the kernel answers, or its error.
    fn answer(&mut self, kind: u32, number: u32, bytes: &[u8]) -> Result<Vec<u8>, u32> {
        self.catch_up();
        let kind = u8::try_from(kind).unwrap_or_default();
        match kind {
            b'M' => self.spi_mode = Some(number),
            b'B' => self.spi_bits = Some(number),
            b'H' => self.spi_hz = number.into(),
            b'S' => return self.spi(number, bytes),
            b'I' => return self.i2c(number, bytes),
            b'G' => {
                let level = self.board.pin(line(number)?).is_high().map_err(|_| EIO)?;
                return Ok(vec![level.into()]);
            }
            b'P' => self.drive(number, bytes[0] != 0)?,
            b'L' => self.request(number, bytes)?,
            b'R' => self.release(number),
            b'F' => {
                let path = String::from_utf8_lossy(bytes);
                let name = path.rsplit('/').next().unwrap_or_default();
                self.synced.push(name.to_owned());
            }
            _ => return Err(EINVAL),
        }
        Ok(Vec::new())
    }

    fn request(&mut self, number: u32, mut bytes: &[u8]) -> Result<(), u32> {
        let [flags, level] = numbers(&mut bytes).map_err(|_| EINVAL)?;
        line(number)?;
        if !self.held.insert(number) {
            return Err(EBUSY);
        }
        match flags {
            LINE_INPUT => self.pull(number),
            LINE_OUTPUT => {
                let idle = u32::from(number != SELECT);
                assert!(
                    number == RESET || level == idle,
                    "line {number} is opened at {level}"
                );
                self.drive(number, level != 0)?;
            }
            _ => return Err(EINVAL),
        }
        Ok(())
    }

    /// Drives an output. RESET's line goes to the STM's own open drain: driven high, both may burn.
    fn drive(&self, number: u32, high: bool) -> Result<(), u32> {
        assert!(!(number == RESET && high), "RESET is driven high");
        let mut pin = self.board.pin(line(number)?);
        pin.set_state(PinState::from(high)).map_err(|_| EIO)
    }

    /// Leaves an input to the board's resistor.
    fn pull(&self, number: u32) {
        if let (Ok(line), true) = (line(number), number != READY) {
            let level = PinState::from(number != SELECT);
            self.board.pin(line).set_state(level).expect("an output");
        }
    }

    fn release(&mut self, number: u32) {
        if self.held.remove(&number) && !self.keeps_levels {
            self.pull(number);
        }
    }

    fn release_all(&mut self) {
        for number in self.held.clone() {
            self.release(number);
        }
    }

    fn spi(&mut self, count: u32, mut bytes: &[u8]) -> Result<Vec<u8>, u32> {
        let mut steps = Vec::new();
        for _ in 0..count {
            let [length, delay_us, changes] = numbers(&mut bytes).map_err(|_| EINVAL)?;
            assert_eq!(changes, 0, "the chip select stays");
            let data = bytes.split_off(..length as usize).ok_or(EINVAL)?;
            steps.push((data.to_vec(), delay_us * 1000));
        }
        let mut operations = Vec::new();
        for (data, delay_ns) in &mut steps {
            operations.push(Operation::TransferInPlace(data));
            operations.push(Operation::DelayNs(*delay_ns));
        }
        let timing = SpiTiming {
            hz: self.spi_hz,
            setup_ns: 0,
            ..SpiTiming::default()
        };
        let mut spi = self.board.spi_with(timing);
        spi.transaction(&mut operations).map_err(|_| EIO)?;
        Ok(steps.into_iter().flat_map(|(data, _)| data).collect())
    }

    fn i2c(&mut self, count: u32, mut bytes: &[u8]) -> Result<Vec<u8>, u32> {
        let (mut messages, mut address) = (Vec::new(), 0);
        for _ in 0..count {
            let [to, flags, length] = numbers(&mut bytes).map_err(|_| EINVAL)?;
            let data = bytes.split_off(..length as usize).ok_or(EINVAL)?;
            address = u8::try_from(to).map_err(|_| EINVAL)?;
            messages.push((flags & READ != 0, data.to_vec()));
        }
        let mut operations: Vec<_> = messages.iter_mut().map(operation).collect();
        let outcome = self.board.i2c().transaction(address, &mut operations);
        outcome.map_err(|cause| match cause {
            I2cError::NoAddress | I2cError::NoData => EREMOTEIO,
            I2cError::Held => ETIMEDOUT,
            I2cError::Ended(_) => EIO,
        })?;
        Ok(messages.into_iter().flat_map(|(_, data)| data).collect())
    }
}

fn operation((read, data): &mut (bool, Vec<u8>)) -> I2cOperation<'_> {
    if *read {
        I2cOperation::Read(data)
    } else {
        I2cOperation::Write(data)
    }
}

/// The board's line of a BCM number.
fn line(number: u32) -> Result<Line, u32> {
    match number {
        RESET => Ok(Line::Reset),
        SELECT => Ok(Line::Select),
        PROTECT => Ok(Line::WriteProtect),
        READY => Ok(Line::Ready),
        _ => Err(EINVAL),
    }
}
