//! Writing the firmware to the board, real or virtual.

mod gdb;
mod log_lines;
mod option_bytes;

use std::process::{Child, Command, Stdio};
use std::time::Duration;

use clap::Args;
use xshell::cmd;

use crate::error::{Context, Kind, Result, fail};
use crate::process;
use crate::session::Session;
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
    /// The bring-up firmware, which tries the parts of a bare board for `robot bringup`
    #[arg(long)]
    pub bringup: bool,
    /// The SWD adapter, as `OpenOCD` names it
    #[arg(long, value_name = "NAME", default_value = "stlink")]
    pub interface: String,
}

/// Writes, verifies, resets, prints the first log lines.
pub fn flash(session: &Session, board: &Board) -> Result<()> {
    let program = if board.bringup { "bringup" } else { "fw-pac" };
    let (sh, elf) = (&session.sh, &session.build("fw-pac", program, "")?.path);
    if board.is_virtual {
        let gdb = gdb::find(session)?;
        let (_board, log, address) = start_virtual_board(session)?;
        gdb::load(gdb, elf, &address)?;
        return print_log(&log);
    }
    let [probe_rs, openocd] = ["probe-rs", "openocd"].map(|name| session.has(name));
    if !probe_rs && !openocd {
        let missing = "neither probe-rs (`cargo install --locked probe-rs-tools`) nor OpenOCD (`apt-get \
                       install openocd`) is installed; `--virtual` needs neither";
        return fail(Kind::MissingProgram, missing);
    }
    // Listen before the reset, or the first lines are gone.
    let read = |device| Lines::read_serial(session, device);
    let log = board.serial.as_deref().map(read).transpose()?;
    let interface = format!("interface/{}.cfg", board.interface);
    let openocd = |commands: String| {
        let openocd = cmd!(sh, "openocd -f {interface} -f target/stm32f4x.cfg");
        openocd.args(["-c", &commands])
    };
    let register = option_bytes::OPTCR;
    let options = if probe_rs {
        cmd!(sh, "probe-rs read --chip {CHIP} b32 {register} 1")
    } else {
        openocd(format!("init; mdw {register}; exit"))
    };
    // A probe that does not answer fails at the next step, too.
    let (_, options) = process::tee(options)?;
    let written = if probe_rs {
        let written = cmd!(sh, "probe-rs download --chip {CHIP} --verify {elf}").run();
        written.and_then(|()| cmd!(sh, "probe-rs reset --chip {CHIP}").run())
    } else {
        let elf = elf.display();
        openocd(format!("program \"{elf}\" verify reset exit")).run()
    };
    if let Err(error) = written {
        let hint = "is the probe plugged in and the board on?";
        return fail(Kind::Board, format!("{error}; {hint}"));
    }
    println!("flash: written, verified, reset");
    if let Some(advice) = option_bytes::advice(&options, &board.interface) {
        println!("flash: warning: {advice}");
    }
    if let Some(log) = log {
        return print_log(&log);
    }
    println!("flash: `--serial /dev/ttyUSB0` (or where TX_STM is wired to) prints the log");
    Ok(())
}

fn print_log(log: &Lines) -> Result<()> {
    if log.print(LOG_LINES, LOG_TIMEOUT) == 0 {
        let seconds = LOG_TIMEOUT.as_secs();
        let silent = format!("flashed, but no log line came within {seconds} s");
        return fail(Kind::Board, silent);
    }
    Ok(())
}

/// A program in the background that does not outlive this one.
struct Server(Child);

impl Drop for Server {
    fn drop(&mut self) {
        let _ = self.0.kill().and_then(|()| self.0.wait());
    }
}

/// Starts the virtual board with nothing in its flash (what runs then came through the debugger) and its
/// core held; its program, its log and its debug server's address.
fn start_virtual_board(session: &Session) -> Result<(Server, Lines, String)> {
    let mut board = Command::new(session.build_program("virtual-board")?);
    board.args(["--gdb", "127.0.0.1:0"]).stdin(Stdio::null());
    let mut server = Server(board.stdout(Stdio::piped()).spawn()?);
    let log = Lines::read(server.0.stdout.take().context("virtual-board: no output")?);
    match log.find("gdb: ", LOG_TIMEOUT) {
        Some(address) => Ok((server, log, address)),
        None => fail(Kind::Board, "the virtual board printed no address"),
    }
}
