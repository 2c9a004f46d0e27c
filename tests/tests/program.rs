//! The program `robot` on the virtual board, as its user runs it.

use std::fs;
use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

/// Environment variable with the path of the program, built with the feature `virtual`.
const PROGRAM: &str = "ROBOT_PROGRAM";

/// A virtual robot in a folder of the test's own.
struct Robot(PathBuf);

impl Robot {
    /// A blank one.
    fn blank(name: &str) -> Self {
        let folder = std::env::temp_dir().join(format!("robot-{name}-{}", std::process::id()));
        let _ = fs::remove_dir_all(&folder);
        fs::create_dir_all(&folder).expect("a folder");
        Self(folder)
    }

    /// With the sample configuration.
    fn configured(name: &str) -> Self {
        let robot = Self::blank(name);
        robot.expect(0, "eeprom init robot.toml");
        robot.expect(0, "eeprom write robot.toml");
        robot
    }

    fn command(&self, words: &str) -> Command {
        let manifest = Path::new(env!("CARGO_MANIFEST_DIR"));
        let file = |variable: &str, usual: &str| {
            let named = std::env::var_os(variable).map(PathBuf::from);
            named.unwrap_or_else(|| manifest.join("../target").join(usual))
        };
        let mut command = Command::new(file(PROGRAM, "release/robot"));
        command
            .arg("--virtual")
            .arg("--elf")
            .arg(file("ROBOT_ELF", "elf/fw-pac.elf"));
        command
            .args(["--eeprom-image", "eeprom.bin"])
            .args(words.split(' '));
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

impl Drop for Robot {
    fn drop(&mut self) {
        let _ = fs::remove_dir_all(&self.0);
    }
}

// Requirement: WIRE-program-2
#[test]
fn monitor_ends_when_its_reader_ends() {
    let robot = Robot::configured("pipe");
    let mut monitor = robot
        .command("monitor")
        .stdout(Stdio::piped())
        .spawn()
        .expect("started");
    let mut lines = BufReader::new(monitor.stdout.take().expect("piped")).lines();
    assert!(lines.next().is_some_and(|line| line.is_ok()));
    drop(lines);
    let begun = Instant::now();
    while monitor.try_wait().expect("a child").is_none() {
        assert!(begun.elapsed() < Duration::from_secs(60), "it goes on");
        std::thread::sleep(Duration::from_millis(20));
    }
    assert_eq!(monitor.wait().expect("ended").code(), Some(0));
    // Nothing was left half done: no repair is reported.
    assert!(!robot.expect(0, "status").contains("killed"));
}

// Requirement: WIRE-program-1
#[test]
fn foreign_file_is_no_virtual_eeprom() {
    let robot = Robot::blank("foreign");
    fs::write(robot.0.join("eeprom.bin"), "a letter").expect("written");
    let text = robot.expect(11, "status");
    assert!(text.contains("no EEPROM image"), "{text}");
    assert_eq!(
        fs::read(robot.0.join("eeprom.bin")).expect("there"),
        b"a letter"
    );
}

// Requirement: WIRE-program-1, WIRE-program-3
#[test]
fn nothing_moves_without_a_file_a_rate_or_consent() {
    let robot = Robot::configured("refused");
    fs::write(robot.0.join("tour"), "300 0 0\n").expect("written");
    fs::create_dir(robot.0.join("map.png")).expect("made");
    for (code, words, expected) in [
        (
            2,
            "--rate 1 goto 100 0 0",
            "--rate 1: frames would come 1000 ms apart",
        ),
        (11, "map tour", "map.png"),
        (2, "tune move --yes --levels 20,100", "--levels 20"),
        (2, "tune move", "not confirmed"),
        (13, "tune battery 1 5.1", "accepted are 5 %"),
    ] {
        let text = robot.expect(code, words);
        assert!(text.contains(expected), "{words}: {text}");
    }
    assert!(robot.expect(0, "--json doctor").contains("\"failed\":0"));
}
