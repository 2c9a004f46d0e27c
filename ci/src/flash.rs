//! Putting the firmware on the board, real or virtual, and opening the debugger on it.

use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::Duration;

use crate::error::{Error, Of, Result};
use crate::lines::{is_log, Lines};
use crate::place::Place;
use crate::robot::cargo_with_board;
use crate::{gdb, shell};

/// What `probe-rs` calls the chip.
const CHIP: &str = "STM32F411RETx";
/// Log lines to show, and how long to wait for them.
const FIRST_LINES: usize = 8;
const PATIENCE: Duration = Duration::from_secs(10);

/// How the board is reached.
pub struct Wiring<'a> {
    /// The UART's device, where it is wired to this machine.
    pub serial: Option<&'a str>,
    /// The SWD adapter, as `OpenOCD` names it.
    pub interface: &'a str,
}

enum Flasher {
    ProbeRs,
    OpenOcd,
}

fn flasher() -> Result<Flasher> {
    if shell::installed("probe-rs") {
        Ok(Flasher::ProbeRs)
    } else if shell::installed("openocd") {
        Ok(Flasher::OpenOcd)
    } else {
        Err(Error::Missing(
            "neither probe-rs (`cargo install --locked probe-rs-tools`) nor OpenOCD (`apt-get \
             install openocd`) is installed; `--virtual` needs neither"
                .into(),
        ))
    }
}

fn on_board(result: Result<()>) -> Result<()> {
    result.map_err(|error| match error {
        Error::Failed(text) => {
            Error::Board(format!("{text}; is the probe plugged in and the board on?"))
        }
        other => other,
    })
}

/// Flashes, verifies, resets, shows the first log lines.
///
/// # Errors
/// [`Error::Missing`] without a flasher, [`Error::Board`] where the board did not take the firmware
/// or does not speak.
pub fn flash(elf: &Path, wiring: &Wiring) -> Result<()> {
    let flasher = flasher()?;
    // Listen before the reset, or the first lines are gone.
    let log = wiring.serial.map(Lines::of_serial).transpose()?;
    match flasher {
        Flasher::ProbeRs => {
            let mut download = Command::new("probe-rs");
            download
                .args(["download", "--chip", CHIP, "--verify"])
                .arg(elf);
            on_board(shell::run(&mut download))?;
            on_board(shell::run(
                Command::new("probe-rs").args(["reset", "--chip", CHIP]),
            ))?;
        }
        Flasher::OpenOcd => {
            let program = format!("program \"{}\" verify reset exit", elf.display());
            on_board(shell::run(openocd(wiring).args(["-c", &program])))?;
        }
    }
    println!("flash: written, verified, reset");
    let Some(log) = log else {
        println!("flash: `--serial /dev/ttyUSB0` (or where TX_STM is wired to) shows the log");
        return Ok(());
    };
    spoke(log.show(FIRST_LINES, PATIENCE, is_log))
}

fn spoke(lines: usize) -> Result<()> {
    if lines == 0 {
        let seconds = PATIENCE.as_secs();
        return Err(Error::Board(format!(
            "flashed, but no log line came within {seconds} s"
        )));
    }
    Ok(())
}

fn openocd(wiring: &Wiring) -> Command {
    let mut openocd = Command::new("openocd");
    openocd.args(["-f", &format!("interface/{}.cfg", wiring.interface)]);
    openocd.args(["-f", "target/stm32f4x.cfg"]);
    openocd
}

/// Opens GDB on the board.
///
/// # Errors
/// As [`flash`].
pub fn debug(elf: &Path, wiring: &Wiring) -> Result<()> {
    let gdb = gdb::find()?;
    let address = "127.0.0.1:3333";
    let mut server = match flasher()? {
        Flasher::ProbeRs => {
            let mut server = Command::new("probe-rs");
            server.args(["gdb", "--chip", CHIP, "--gdb-connection-string", address]);
            server
        }
        Flasher::OpenOcd => openocd(wiring),
    };
    println!("  $ {} &", shell::shown(&server));
    let server = server.stdin(Stdio::null()).stdout(Stdio::null()).spawn();
    let _server = Ended(server.of("the debug server")?);
    gdb::wait_for(address, PATIENCE)?;
    gdb::open(gdb, elf, address)
}

/// A child that does not outlive us.
struct Ended(Child);

impl Drop for Ended {
    fn drop(&mut self) {
        shell::end(&mut self.0);
    }
}

/// The virtual board, switched on with its core held for the debugger.
struct VirtualBoard {
    child: Ended,
    log: Lines,
    address: String,
}

impl VirtualBoard {
    /// Starts it with nothing in its flash: what runs then came through the debugger.
    fn start(place: &Place) -> Result<Self> {
        let words = [
            "build",
            "--release",
            "--package",
            "twin",
            "--bin",
            "virtual-board",
        ];
        shell::run(&mut cargo_with_board(place, &words)?)?;
        let mut board = Command::new(place.target.join("release/virtual-board"));
        board.args(["--gdb", "127.0.0.1:0"]);
        println!("  $ {} &", shell::shown(&board));
        let child = board.stdin(Stdio::null()).stdout(Stdio::piped()).spawn();
        let mut child = Ended(child.of("virtual-board")?);
        let pipe = child.0.stdout.take();
        let log = pipe
            .map(Lines::of)
            .ok_or_else(|| Error::Failed("virtual-board: no output".into()))?;
        let address = log.find("gdb: ", PATIENCE);
        let address = address.ok_or_else(|| {
            Error::Board("the virtual board did not say where its debug server listens".into())
        })?;
        Ok(Self {
            child,
            log,
            address,
        })
    }
}

/// [`flash`] on the virtual board, through its debug server.
///
/// # Errors
/// As [`flash`].
pub fn flash_virtual(place: &Place, elf: &Path) -> Result<()> {
    let gdb = gdb::find()?;
    let board = VirtualBoard::start(place)?;
    gdb::load(gdb, elf, &board.address)?;
    spoke(board.log.show(FIRST_LINES, PATIENCE, is_log))?;
    drop(board.child);
    Ok(())
}

/// [`debug`] on the virtual board.
///
/// # Errors
/// As [`flash`].
pub fn debug_virtual(place: &Place, elf: &Path) -> Result<()> {
    let gdb = gdb::find()?;
    let board = VirtualBoard::start(place)?;
    gdb::open(gdb, elf, &board.address)
}
