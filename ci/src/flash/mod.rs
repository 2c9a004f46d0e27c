//! Writing the firmware to the board, real or virtual, and opening the debugger on it.

mod gdb;
mod log_lines;

use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::Duration;

use clap::Args;

use crate::error::{bail, ensure, Context, Error, Failure, Result};
use crate::process;
use crate::workspace::Workspace;
use log_lines::Lines;

/// What `probe-rs` calls the chip.
const CHIP: &str = "STM32F411RETx";
/// Log lines to print, and how long to wait for the first.
const LOG_LINES: usize = 8;
const LOG_TIMEOUT: Duration = Duration::from_secs(10);

/// How the board is reached.
#[derive(Args)]
pub struct Board {
    /// The virtual board instead of the real one
    #[arg(long = "virtual")]
    pub is_virtual: bool,
    /// The UART's device, where it is wired to this machine
    #[arg(long, value_name = "DEVICE")]
    pub serial: Option<String>,
    /// The SWD adapter, as `OpenOCD` names it
    #[arg(long, value_name = "NAME", default_value = "stlink")]
    pub interface: String,
}

enum Flasher {
    ProbeRs,
    OpenOcd,
}

fn flasher() -> Result<Flasher> {
    if process::installed("probe-rs") {
        Ok(Flasher::ProbeRs)
    } else if process::installed("openocd") {
        Ok(Flasher::OpenOcd)
    } else {
        bail!(Failure::MissingProgram(
            "neither probe-rs (`cargo install --locked probe-rs-tools`) nor OpenOCD (`apt-get \
             install openocd`) is installed; `--virtual` needs neither"
                .into()
        ))
    }
}

/// Writes, verifies, resets, prints the first log lines.
pub fn flash(workspace: &Workspace, elf: &Path, board: &Board) -> Result<()> {
    if board.is_virtual {
        return flash_virtual(workspace, elf);
    }
    let flasher = flasher()?;
    // Listen before the reset, or the first lines are gone.
    let log = board
        .serial
        .as_deref()
        .map(Lines::read_serial)
        .transpose()?;
    let on_board = |error: Error| match error.downcast::<Failure>() {
        Ok(failure) => failure,
        Err(error) => Failure::Board(format!(
            "{error}; is the probe plugged in and the board on?"
        )),
    };
    match flasher {
        Flasher::ProbeRs => {
            let mut download = Command::new("probe-rs");
            download
                .args(["download", "--chip", CHIP, "--verify"])
                .arg(elf);
            process::run(download).map_err(on_board)?;
            let mut reset = Command::new("probe-rs");
            reset.args(["reset", "--chip", CHIP]);
            process::run(reset).map_err(on_board)?;
        }
        Flasher::OpenOcd => {
            let mut openocd = openocd(&board.interface);
            openocd.arg("-c");
            openocd.arg(format!("program \"{}\" verify reset exit", elf.display()));
            process::run(openocd).map_err(on_board)?;
        }
    }
    println!("flash: written, verified, reset");
    if let Some(log) = log {
        return print_log(&log);
    }
    println!("flash: `--serial /dev/ttyUSB0` (or where TX_STM is wired to) prints the log");
    Ok(())
}

fn print_log(log: &Lines) -> Result<()> {
    let seconds = LOG_TIMEOUT.as_secs();
    let silent = || Failure::Board(format!("flashed, but no log line came within {seconds} s"));
    ensure!(log.print(LOG_LINES, LOG_TIMEOUT) > 0, silent());
    Ok(())
}

fn openocd(interface: &str) -> Command {
    let mut openocd = Command::new("openocd");
    openocd.args(["-f", &format!("interface/{interface}.cfg")]);
    openocd.args(["-f", "target/stm32f4x.cfg"]);
    openocd
}

/// Opens GDB on the board.
pub fn debug(workspace: &Workspace, elf: &Path, board: &Board) -> Result<()> {
    let gdb = gdb::find(workspace)?;
    if board.is_virtual {
        let board = VirtualBoard::start(workspace)?;
        return gdb::open(gdb, elf, &board.address);
    }
    let address = "127.0.0.1:3333";
    let server = match flasher()? {
        Flasher::ProbeRs => {
            let mut server = Command::new("probe-rs");
            server.args(["gdb", "--chip", CHIP, "--gdb-connection-string", address]);
            server
        }
        Flasher::OpenOcd => openocd(&board.interface),
    };
    let _server = Server::start(server, Stdio::null())?;
    gdb::wait_for(address, LOG_TIMEOUT)?;
    gdb::open(gdb, elf, address)
}

/// A program in the background that does not outlive this one.
struct Server(Child);

impl Server {
    fn start(mut command: Command, output: Stdio) -> Result<Self> {
        let shown = process::display(&command);
        println!("  $ {shown} &");
        let child = command.stdin(Stdio::null()).stdout(output).spawn();
        Ok(Self(child.context(shown)?))
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        let _ = self.0.kill().and_then(|()| self.0.wait());
    }
}

/// The virtual board, switched on with its core held for the debugger.
struct VirtualBoard {
    /// Ends the program when it is dropped.
    #[expect(dead_code, reason = "held")]
    server: Server,
    log: Lines,
    address: String,
}

impl VirtualBoard {
    /// Starts it with nothing in its flash: what runs then came through the debugger.
    fn start(workspace: &Workspace) -> Result<Self> {
        let build = "build --release --package twin --bin virtual-board";
        process::run(workspace.cargo_with_board(build)?)?;
        let mut board = Command::new(workspace.target.join("release/virtual-board"));
        board.args(["--gdb", "127.0.0.1:0"]);
        let mut server = Server::start(board, Stdio::piped())?;
        let log = Lines::read(server.0.stdout.take().context("virtual-board: no output")?);
        let address = log.find("gdb: ", LOG_TIMEOUT);
        let address = address.context(Failure::Board(
            "the virtual board did not print the address of its debug server".into(),
        ))?;
        Ok(Self {
            server,
            log,
            address,
        })
    }
}

/// [`flash`] on the virtual board, through its debug server.
fn flash_virtual(workspace: &Workspace, elf: &Path) -> Result<()> {
    let gdb = gdb::find(workspace)?;
    let board = VirtualBoard::start(workspace)?;
    gdb::load(gdb, elf, &board.address)?;
    print_log(&board.log)
}
