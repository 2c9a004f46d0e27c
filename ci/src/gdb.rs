//! GDB: finding one that speaks ARM, and having it load and compare an ELF.

use std::path::Path;
use std::process::Command;
use std::time::Duration;

use crate::arm;
use crate::error::{Error, Result};
use crate::shell;

/// Debuggers by name, the likeliest first.
const NAMES: [&str; 3] = ["gdb-multiarch", "arm-none-eabi-gdb", "gdb"];

/// A debugger for the robot's processor, installed where that is possible.
///
/// # Errors
/// [`Error::Missing`] says what to install.
pub fn find() -> Result<&'static str> {
    let found = || NAMES.into_iter().find(|name| speaks_arm(name));
    if let Some(name) = found() {
        return Ok(name);
    }
    let why = match arm::apt_install(&["gdb-multiarch"]) {
        Ok(()) => "it was installed and does not start".to_owned(),
        Err(error) => error.to_string(),
    };
    found().ok_or_else(|| {
        Error::Missing(format!(
            "no GDB for ARM here (install gdb-multiarch or arm-none-eabi-gdb; {why})"
        ))
    })
}

fn speaks_arm(name: &str) -> bool {
    let mut gdb = Command::new(name);
    gdb.args([
        "-nx",
        "-batch",
        "-ex",
        "set architecture arm",
        "-ex",
        "show architecture",
    ]);
    // An unknown architecture is no error to GDB's exit code, and its wording changes.
    shell::installed(name) && shell::ask(&mut gdb).is_some_and(|said| said.contains("\"arm\""))
}

/// Loads `elf` through the debug server at `address`, compares every section, resets the core and
/// lets it run.
///
/// # Errors
/// [`Error::Board`] where a section differs or GDB did not get through.
pub fn load(gdb: &str, elf: &Path, address: &str) -> Result<()> {
    let connect = format!("target extended-remote {address}");
    let words = [
        "set confirm off",
        "set pagination off",
        "set remotetimeout 60",
        &connect,
        "load",
        "compare-sections",
        "monitor reset",
        "echo running\\n",
        "detach",
    ];
    let mut command = Command::new(gdb);
    command.args(["-nx", "-batch"]);
    for word in words {
        command.args(["-ex", word]);
    }
    let (status, text) = shell::tee_any_end(command.arg(elf))?;
    judge(status.success(), &text)
}

/// GDB says what went wrong in words and goes on: only the words count.
fn judge(ended_well: bool, text: &str) -> Result<()> {
    let compared = text
        .lines()
        .filter(|line| line.starts_with("Section "))
        .count();
    let said = |word: &str| text.lines().find(|line| line.contains(word));
    let lost = [
        "Connection ",
        "Remote connection closed",
        "Remote communication error",
    ];
    let wrong = if let Some(line) = lost.into_iter().find_map(said) {
        Some(line.to_owned())
    } else if let Some(line) = said("MIS-MATCHED") {
        Some(line.to_owned())
    } else if !ended_well {
        Some("GDB ended with an error".into())
    } else if !text.contains("Transfer rate") {
        Some("GDB loaded nothing".into())
    } else if compared == 0 {
        Some("GDB compared no section".into())
    } else if !text.lines().any(|line| line == "running") {
        Some("GDB did not get as far as the reset".into())
    } else {
        None
    };
    match wrong {
        None => {
            println!("flash: {compared} sections compared, all alike");
            Ok(())
        }
        Some(why) => Err(Error::Board(format!("not flashed: {why}"))),
    }
}

/// Opens the debugger at the terminal on the server at `address`.
///
/// # Errors
/// Where GDB cannot be started.
pub fn open(gdb: &str, elf: &Path, address: &str) -> Result<()> {
    let connect = format!("target extended-remote {address}");
    let mut command = Command::new(gdb);
    command.args([
        "-q",
        "-ex",
        &connect,
        "-ex",
        "load",
        "-ex",
        "monitor reset halt",
    ]);
    command.args([
        "-ex",
        "maintenance flush register-cache",
        "-ex",
        "break main",
    ]);
    shell::run(command.arg(elf))
}

/// Waits until the debug server at `address` listens.
///
/// # Errors
/// [`Error::Board`] after `limit`.
pub fn wait_for(address: &str, limit: Duration) -> Result<()> {
    let start = std::time::Instant::now();
    while std::net::TcpStream::connect(address).is_err() {
        if start.elapsed() > limit {
            return Err(Error::Board(format!("no debug server at {address}")));
        }
        std::thread::sleep(Duration::from_millis(100));
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    const GOOD: &str = "\
Loading section .vector_table, size 0x198 lma 0x8000000
Transfer rate: 30 KB/sec, 5000 bytes/write.
Section .vector_table, range 0x8000000 -- 0x8000198: matched.
Section .text, range 0x8000198 -- 0x80021a0: matched.
running
";

    #[test]
    fn only_a_load_whose_sections_all_match_counts() {
        assert!(judge(true, GOOD).is_ok());
        assert!(judge(false, GOOD).is_err());
        assert!(judge(
            true,
            &GOOD.replace("80021a0: matched.", "80021a0: MIS-MATCHED!")
        )
        .is_err());
        assert!(judge(true, &GOOD.replace("Transfer rate", "")).is_err());
        assert!(judge(true, &GOOD.replace("running", "")).is_err());
        assert!(judge(true, &GOOD.replace("Section ", "")).is_err());
    }
}
