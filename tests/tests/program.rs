//! The program `robot` on the virtual board, as its user runs it.

use std::fs;
use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

/// Environment variable with the path of the program, built with the feature `virtual`.
const PROGRAM: &str = "ROBOT_PROGRAM";

/// The program with a virtual EEPROM in a folder of the test's own.
struct Program(PathBuf);

impl Program {
    /// A blank one.
    fn blank(name: &str) -> Self {
        let folder = std::env::temp_dir().join(format!("robot-{name}-{}", std::process::id()));
        let _ = fs::remove_dir_all(&folder);
        fs::create_dir_all(&folder).expect("a folder");
        Self(folder)
    }

    /// With the sample configuration.
    fn configured(name: &str) -> Self {
        let program = Self::blank(name);
        program.expect(0, "eeprom init robot.toml");
        program.expect(0, "eeprom write robot.toml");
        program
    }

    fn command(&self, words: &str) -> Command {
        let manifest = Path::new(env!("CARGO_MANIFEST_DIR"));
        let file = |variable: &str, usual: &str| {
            let named = std::env::var_os(variable).map(PathBuf::from);
            named.unwrap_or_else(|| manifest.join("../target").join(usual))
        };
        let mut command = Command::new(file(PROGRAM, "release/robot"));
        let elf = file("ROBOT_ELF", "elf/fw-pac.elf");
        command.args(["--virtual", "--eeprom-image", "eeprom.bin", "--elf"]);
        command.arg(elf).args(words.split(' '));
        command.current_dir(&self.0).stdin(Stdio::null());
        command
    }

    /// Runs the program; its standard output and error together.
    #[track_caller]
    fn expect(&self, code: i32, words: &str) -> String {
        let done = self
            .command(words)
            .output()
            .expect("`cargo build --release -p pilot --features virtual` first");
        let text = String::from_utf8_lossy(&[done.stdout, done.stderr].concat()).into_owned();
        assert_eq!(done.status.code(), Some(code), "{words}: {text}");
        text
    }
}

impl Drop for Program {
    fn drop(&mut self) {
        let _ = fs::remove_dir_all(&self.0);
    }
}

// Requirement: WIRE-program-2
#[test]
fn monitor_closed_pipe_ends_without_an_error() {
    let program = Program::configured("pipe");
    let mut monitor = program
        .command("monitor")
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .expect("started");
    let mut lines = BufReader::new(monitor.stdout.take().expect("piped")).lines();
    assert!(lines.next().is_some_and(|line| line.is_ok()));
    drop(lines);
    let begun = Instant::now();
    while monitor.try_wait().expect("a child").is_none() {
        if begun.elapsed() > Duration::from_secs(30) {
            monitor.kill().expect("a child");
        }
        std::thread::sleep(Duration::from_millis(20));
    }
    let ended = monitor.wait_with_output().expect("ended");
    assert_eq!(ended.status.code(), Some(0));
    assert_eq!(String::from_utf8_lossy(&ended.stderr), "");
}

// Requirement: WIRE-program-1
#[test]
fn foreign_eeprom_image_is_refused_and_kept() {
    let program = Program::blank("foreign");
    fs::write(program.0.join("eeprom.bin"), "a letter").expect("written");
    let text = program.expect(11, "status");
    assert!(text.contains("no EEPROM image"), "{text}");
    let kept = fs::read(program.0.join("eeprom.bin")).expect("there");
    assert_eq!(kept, b"a letter");
}

// Requirement: WIRE-program-1, WIRE-program-3
#[test]
fn senseless_drives_are_refused_before_they_move() {
    let program = Program::configured("refused");
    fs::write(program.0.join("tour"), "300 0 0\n").expect("written");
    fs::create_dir(program.0.join("map.png")).expect("made");
    for (code, words, expected) in [
        (
            2,
            "--rate 1 goto 100 0 0",
            "--rate 1: frames would come 1000 ms",
        ),
        (11, "map tour", "map.png"),
        (2, "tune move --yes --levels 20,100", "--levels 20"),
        (2, "tune move", "not confirmed"),
        (13, "tune battery 1 5.1", "accepted are 5 %"),
    ] {
        let text = program.expect(code, words);
        assert!(text.contains(expected), "{words}: {text}");
    }
    assert!(program.expect(0, "--json doctor").contains("\"failed\":0"));
}
