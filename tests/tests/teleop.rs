//! `robot teleop` at a terminal of its own.

use crate::program::{Program, await_end};
use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};
use std::fs::File;
use std::io::{Read, Write};
use std::os::unix::ffi::OsStringExt;
use std::process::Stdio;
use std::time::Duration;

/// Runs `teleop` at a terminal that hangs up when it has shown so many bytes and these keys were typed; its exit code.
fn teleop(program: &Program, typed: &[u8], shown: u64) -> Option<i32> {
    // The program is not to hold the other end.
    let flags = OpenptFlags::RDWR | OpenptFlags::NOCTTY | OpenptFlags::CLOEXEC;
    let pty = openpt(flags).expect("a pty");
    grantpt(&pty).expect("granted");
    unlockpt(&pty).expect("unlocked");
    let name = ptsname(&pty, Vec::new()).expect("a name").into_bytes();
    let name = std::ffi::OsString::from_vec(name);
    let open = || File::options().read(true).write(true).open(&name);
    let terminal = || open().expect("a terminal");
    let mut command = program.command("teleop --yes");
    command.stdout(terminal()).stdin(terminal());
    let mut teleop = command.stderr(Stdio::null()).spawn().expect("started");
    drop(command);
    let mut keys = File::from(pty);
    let mut screen = keys.try_clone().expect("a copy").take(shown);
    let shown = std::thread::spawn(move || std::io::copy(&mut screen, &mut std::io::sink()));
    for key in typed.chunks(1) {
        std::thread::sleep(Duration::from_millis(100));
        keys.write_all(key).expect("typed");
    }
    drop(keys);
    await_end(&mut teleop);
    let _ = shown.join();
    teleop.wait().expect("ended").code()
}

// Requirement: SERVE-teleop-1
#[test]
fn teleop_drives_by_keys_of_a_terminal() {
    let alone = Program::configured();
    alone.expect_each("0 | mode guarded-normal | both ends");
    assert_eq!(teleop(&alone, b"q", u64::MAX), Some(0));
    // With an error or without, by itself.
    assert!(teleop(&alone, b"", 3_000).is_some());
    alone.expect_each("0 | eeprom diff robot.toml | no difference");
    let program = Program::blank();
    let _server = program.serve();
    let left = teleop(&program, b"wwwwwwwwwwwwwwwwwwwwq", u64::MAX);
    assert_eq!(left, Some(0));
    let status = program.expect(0, "--json status");
    let shown: serde_json::Value = serde_json::from_str(&status).expect("JSON");
    assert!(shown["pose"]["x_mm"].as_f64() > Some(50.0), "{status}");
}
