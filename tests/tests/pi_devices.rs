//! The program as a Pi runs it: spidev, i2c-dev, GPIO character device and serial port, with the release ELF
//! behind them in real time.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::thread::sleep;
use std::time::Duration;
use tempfile::TempDir;

use robot_tests::pi_devices::PiDevices;
use robot_tests::test_board::Rig;
use twin::Options;
use twin::plant::Sides;

/// RESET released, the EEPROM with the STM and protected.
const IDLE: [bool; 3] = [true, false, true];
/// The stop deadline and a tick, with a frame that was under way, microseconds of the board.
const STOPPED_US: u64 = 2_050_000;

/// A blank robot with device files in a folder of the test's own.
struct Pi {
    folder: TempDir,
    devices: PiDevices,
    program: PathBuf,
    _rig: Rig,
}

impl Pi {
    fn new(keeps_levels: bool) -> Self {
        let folder = tempfile::tempdir().expect("a folder");
        let rig = Rig::new(Options::with_eeprom(Vec::new()));
        let devices = PiDevices::new(folder.path(), &rig.board, keeps_levels).expect("devices");
        let usual = Path::new(env!("CARGO_MANIFEST_DIR")).join("../target/release/robot");
        Self {
            folder,
            devices,
            program: std::env::var_os("ROBOT_PROGRAM").map_or(usual, PathBuf::from),
            _rig: rig,
        }
    }

    /// A busy computer's frames come late: it has the longest deadline.
    fn configure(&self) {
        self.expect(0, "eeprom init robot.toml");
        self.edit("deadline_ms = 250", "deadline_ms = 2000", "robot.toml");
        self.expect(0, "eeprom write robot.toml");
    }

    /// Writes `file`: robot.toml with a value replaced.
    fn edit(&self, from: &str, to: &str, file: &str) {
        let text = fs::read_to_string(self.folder.path().join("robot.toml")).expect("there");
        let edited = text.replace(from, to);
        assert_ne!(edited, text);
        fs::write(self.folder.path().join(file), edited).expect("written");
    }

    fn command(&self, words: &str) -> Command {
        let mut command = self.devices.command(&self.program);
        command.args(words.split(' ')).current_dir(&self.folder);
        command.stdin(Stdio::null());
        command
    }

    fn start(&self, words: &str) -> Child {
        let mut command = self.command(words);
        command.stdout(Stdio::null()).stderr(Stdio::null());
        command.spawn().expect("started")
    }

    #[track_caller]
    fn expect(&self, code: i32, words: &str) -> String {
        let done = self.command(words).output().expect("started");
        let text = String::from_utf8_lossy(&[done.stdout, done.stderr].concat()).into_owned();
        assert_eq!(done.status.code(), Some(code), "{words}: {text}");
        text
    }
}

// Requirement: DOC-2.1-5, WIRE-spi-4
#[test]
fn commands_configure_and_drive_through_device_files() {
    for keeps_levels in [false, true] {
        let pi = Pi::new(keeps_levels);
        if keeps_levels {
            // A Pi 5 with an older kernel.
            let chip = |number: u8| pi.folder.path().join(format!("gpiochip{number}"));
            fs::write(chip(4), "pinctrl-rp1").expect("written");
            fs::write(chip(0), "gpio-brcmstb@107d508500").expect("written");
        }
        pi.configure();
        assert_eq!(pi.devices.levels(), IDLE);
        // The configuration, then the EEPROM's content before the write, each with its folder; the journal's
        // new name after the write.
        let folder = pi.folder.path().file_name().and_then(|name| name.to_str());
        let folder = folder.expect("a name");
        let before = ".robot-spidev0.0-eeprom.before.robot-new";
        let synced = [".robot.toml.robot-new", folder, before, folder, folder];
        assert_eq!(pi.devices.synced(), synced);
        let start = pi.devices.board.truth().pose;
        for (words, expected) in [
            ("eeprom check", "Guarded Velocity"),
            ("goto 120 0 0", "arrived at"),
            ("--json status", "Guarded Velocity"),
            ("monitor --count 3", "mm"),
            ("--json doctor", "\"failed\":0"),
            ("stop", "stopped"),
        ] {
            let text = pi.expect(0, words);
            assert!(text.contains(expected), "{words}: {text}");
            assert_eq!(pi.devices.levels(), IDLE, "{words}");
        }
        // Not the path: with late frames it overshoots and returns.
        let moved_mm = pi.devices.board.truth().pose.distance_mm(&start);
        assert!((moved_mm - 120.0).abs() < 10.0, "{moved_mm}");
        assert_eq!(pi.devices.spi_settings(), (Some(0), Some(8), 8_000_000));
    }
}

#[test]
fn killed_program_leaves_a_robot_that_stops_and_is_repaired() {
    let pi = Pi::new(true);
    pi.configure();
    pi.edit("servo = false", "servo = true", "second.toml");
    let mut outcomes = Vec::new();
    for after_ms in [20, 60, 150, 400] {
        let mut write = pi.start("eeprom write second.toml");
        sleep(Duration::from_millis(after_ms));
        write.kill().expect("a child");
        write.wait().expect("ended");
        let text = pi.expect(0, "eeprom dump");
        assert_eq!(pi.devices.levels(), IDLE, "after {after_ms} ms");
        outcomes.push(text.contains("is undone"));
        pi.expect(0, "eeprom write robot.toml");
    }
    println!("undone: {outcomes:?}");
    let mut goto = pi.start("goto 400 0 0");
    let moves = || pi.devices.board.truth().duty != Sides::default();
    let begins = || {
        sleep(Duration::from_millis(10));
        moves()
    };
    assert!((0..3_000).any(|_| begins()), "nothing moves");
    goto.kill().expect("a child");
    goto.wait().expect("ended");
    let killed_us = pi.devices.board.now_us();
    while pi.devices.board.now_us() < killed_us + STOPPED_US {
        sleep(Duration::from_millis(10));
    }
    assert!(!moves(), "the motors do not stop");
    let text = pi.expect(9, "goto 0 0 0");
    let reports = |text: &str, what: &str| assert!(text.contains(what), "{text}");
    reports(&text, "was killed");
    reports(&text, "link-lost");
    pi.expect(0, "reset");
    let text = pi.expect(0, "goto 60 0 0");
    reports(&text, "arrived at");
    assert!(!text.contains("was killed"), "{text}");
    // After late frames it may still return from beyond its target.
    assert!((0..500).any(|_| !begins()), "the motors do not rest");
    // A request to end, as a service's or that of `stop`, is no kill.
    for x_mm in [400, -400] {
        let mut goto = pi.start(&format!("goto {x_mm} 0 0"));
        assert!((0..3_000).any(|_| begins()), "nothing moves");
        if x_mm > 0 {
            let ended = Command::new("kill").arg(goto.id().to_string()).status();
            assert!(ended.is_ok_and(|status| status.success()));
        } else {
            reports(&pi.expect(12, "status"), "`robot stop` ends process");
            reports(&pi.expect(0, "stop"), "stopped");
        }
        assert_eq!(goto.wait().expect("ended").code(), Some(130));
        assert!(!moves(), "the motors do not stop");
    }
}

#[test]
fn missing_and_wrong_devices_are_named_with_advice() {
    let pi = Pi::new(false);
    for (name, advice) in [
        ("gpiochip0", "--gpiochip names"),
        ("spidev0.0", "enable SPI"),
        ("i2c-1", "enable I2C"),
    ] {
        let (file, away) = (pi.folder.path().join(name), pi.folder.path().join("away"));
        fs::rename(&file, &away).expect("renamed");
        let text = pi.expect(10, "status");
        assert!(text.contains(name) && text.contains(advice), "{text}");
        let text = pi.expect(14, "--json doctor");
        let failed = r#""failed":1"#;
        assert!(text.contains(name) && text.contains(failed), "{text}");
        fs::rename(&away, &file).expect("renamed");
    }
}
