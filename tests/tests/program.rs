//! The program `robot` on the virtual board, as its user runs it.

use plant::Rng;
use std::fs;
use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};
use tempfile::TempDir;

/// The EEPROM's content before an incomplete write.
const JOURNAL: &str = "eeprom.bin.eeprom.before";

/// The program with a virtual EEPROM in a folder of the test's own.
pub struct Program(TempDir);

impl Program {
    /// A blank one, with the sample configuration in robot.toml, and with a servo in second.toml.
    pub fn blank() -> Self {
        let program = Self(tempfile::tempdir().expect("a folder"));
        program.expect(0, "eeprom init robot.toml");
        let first = fs::read_to_string(program.file("robot.toml")).expect("there");
        let second = first.replace("servo = false", "servo = true");
        fs::write(program.file("second.toml"), second).expect("written");
        program
    }

    /// With the sample configuration.
    pub fn configured() -> Self {
        let program = Self::blank();
        program.expect_each("0 | eeprom write robot.toml | 0x0000 to 0x000C differ");
        program
    }

    fn file(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    pub fn command(&self, words: &str) -> Command {
        let manifest = Path::new(env!("CARGO_MANIFEST_DIR"));
        let file = |variable: &str, usual: &str| {
            let named = std::env::var_os(variable).map(PathBuf::from);
            named.unwrap_or_else(|| manifest.join("../target").join(usual))
        };
        let mut command = Command::new(file("ROBOT_PROGRAM", "release/robot"));
        command.env("ROBOT_ELF", file("ROBOT_ELF", "elf/fw-pac.elf"));
        command.args(["--virtual", "--eeprom-image", "eeprom.bin"]);
        command.args(words.split(' '));
        command.current_dir(self.0.path()).stdin(Stdio::null());
        command
    }

    /// Starts a server that keeps up with any computer, and waits until it serves.
    pub fn serve(&self) -> Server {
        let mut serve = self.command("serve --speed max");
        let mut server = serve.stderr(Stdio::piped()).spawn().expect("started");
        let mut lines = BufReader::new(server.stderr.take().expect("piped")).lines();
        let server = Server(server);
        assert!(lines.any(|line| line.expect("text").contains("serving on")));
        std::thread::spawn(move || lines.for_each(drop));
        server
    }

    /// Runs the program; its standard output and error together.
    #[track_caller]
    pub fn expect(&self, code: i32, words: &str) -> String {
        let done = self.command(words).output();
        let done = done.expect("`cargo build --release -p pilot --features virtual` first");
        let text = String::from_utf8_lossy(&[done.stdout, done.stderr].concat()).into_owned();
        assert_eq!(done.status.code(), Some(code), "{words}: {text}");
        text
    }

    /// Runs the program in each of these ways: a line has the exit code, the words and a text that it prints.
    #[track_caller]
    pub fn expect_each(&self, runs: &str) {
        let lines = runs.trim().lines().map(str::trim);
        for run in lines.filter(|line| !line.starts_with("//")) {
            let parts: Vec<&str> = run.splitn(3, " | ").collect();
            let [code, words, expected] = parts[..] else {
                panic!("not a run: {run}");
            };
            let text = self.expect(code.parse().expect("an exit code"), words);
            assert!(text.contains(expected), "{words}: {text}");
        }
    }
}

/// Ends with it.
pub struct Server(Child);

impl Drop for Server {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// Kills a program that has not ended after half a minute.
pub fn await_end(child: &mut Child) {
    let begun = Instant::now();
    while child.try_wait().expect("a child").is_none() {
        if begun.elapsed() > Duration::from_secs(30) {
            child.kill().expect("a child");
        }
        std::thread::sleep(Duration::from_millis(20));
    }
}

// Requirement: WIRE-program-2
#[test]
fn closed_pipe_ends_monitor_and_log_without_an_error() {
    let program = Program::configured();
    // No line follows the last of an idle robot.
    for (words, last) in [("monitor", ""), ("log", ": ready")] {
        let mut command = program.command(words);
        command.stdout(Stdio::piped()).stderr(Stdio::piped());
        let mut command = command.spawn().expect("started");
        let mut lines = BufReader::new(command.stdout.take().expect("piped")).lines();
        assert!(lines.any(|line| line.is_ok_and(|line| line.ends_with(last))));
        drop(lines);
        await_end(&mut command);
        let ended = command.wait_with_output().expect("ended");
        assert_eq!(ended.status.code(), Some(0), "{words}");
        assert_eq!(String::from_utf8_lossy(&ended.stderr), "", "{words}");
    }
}

// Requirement: WIRE-program-1
#[test]
fn foreign_eeprom_image_is_refused_and_kept() {
    let program = Program::blank();
    fs::write(program.file("eeprom.bin"), "a letter").expect("written");
    program.expect_each("11 | status | no EEPROM image");
    assert!(fs::read(program.file("eeprom.bin")).is_ok_and(|kept| kept == b"a letter"));
}

// Requirement: WIRE-program-1, WIRE-program-3
#[test]
fn senseless_drives_are_refused_before_they_move() {
    let program = Program::configured();
    fs::write(program.file("tour"), "300 0 0\n").expect("written");
    fs::create_dir(program.file("map.png")).expect("made");
    fs::write(program.file("was.pgm"), "P5\n").expect("written");
    fs::create_dir(program.file("eeprom.bin.explored.json")).expect("made");
    program.expect_each(
        r#"
        2 | --rate 7 monitor | would come 142 ms apart
        2 | bringup robot.toml --link | --link
        2 | map --from drive.mcap --timeout 2 | --timeout
        2 | map --served | none runs
        2 | goto 100 0 0 --start 1,1,1 | --start
        11 | map tour | map.png
        11 | explore --out plan | explored.json
        2 | map tour --out plan --record plan.pgm | plan.pgm would be written twice
        2 | serve --listen 127.0.0.1 | --listen
        2 | tune move --yes --levels 20,100 | --levels 20
        2 | tune move | ahead and back 6 times, up to 300 mm
        2 | tune move | not confirmed
        13 | tune battery 1 5.1 | accepted are 5 %
        0 | --json doctor | "failed":0
        0 | mode 0x12 | both ends
        5 | map tour --out was | position to drive to
        "#,
    );
    assert!(fs::read(program.file("was.pgm")).is_ok_and(|map| map == b"P5\n"));
}

// Requirement: WIRE-program-1
#[test]
fn configuration_is_compared_saved_and_brought_back() {
    let program = Program::configured();
    program.expect_each(
        "
        0 | eeprom diff robot.toml | no difference
        2 | eeprom init robot.toml | --force
        1 | eeprom diff second.toml | platform.servo: false -> true
        0 | eeprom backup saved.bin | 1024 bytes saved
        2 | eeprom backup saved.bin | --force
        0 | eeprom write --dry-run second.toml | platform.servo: false -> true
        1 | eeprom diff second.toml | platform.servo: false -> true
        0 | eeprom write second.toml | 5 bytes written
        0 | eeprom diff second.toml | no difference
        0 | eeprom restore saved.bin | 5 bytes written
        0 | eeprom diff robot.toml | no difference
        0 | eeprom migrate | 0 bytes written
        0 | eeprom dump --hex | 0000  15 26 37 48
        // 0.055 V more than the STM reads.
        0 | tune battery 1 3.95 --yes | 10587 ohm written
        1 | eeprom diff robot.toml | battery.tap_1.upper_ohm: 10587 -> 10000
        0 | tune rollback | as it was before
        0 | eeprom diff robot.toml | no difference
        // The first board's are faster.
        13 | tune move --yes --levels 60,90 | be worse than the
        0 | eeprom diff robot.toml | no difference
        0 | tune rotate --yes --levels 60,90 | gains written
        1 | eeprom diff robot.toml | pid.rotation.p:
        0 | tune rollback | as it was before
        14 | bringup robot.toml | the firmware is not heard
        2 | calibrate rollback | no tuning or calibration
        0 | reset | STM reset; ready after
        0 | status | stop deadline 250 ms
        ",
    );
    assert_eq!(program.expect(0, "stop"), "stopped\n");
    assert!(program.file("tune-move.csv").exists());
}

/// A room of 2 m2.
const SMALL_ROOM: &str = "wall -700 -700 700 -700 700 700 -700 700 -700 -700\nstart 0 0 0\n";

// Requirement: WIRE-program-4
#[test]
fn robot_is_checked_calibrated_and_explores_a_room() {
    let program = Program::configured();
    fs::write(program.file("small.room"), SMALL_ROOM).expect("written");
    program.expect_each(r#"0 | --json doctor --wheels-up --yes | "failed":0"#);
    let words = "--json --true-diameter-left 81 --true-diameter-right 81 calibrate distance --length 500 --yes \
                 --measure-with truth";
    let done = program.expect(0, words);
    let done = done.lines().find(|line| line.starts_with('{'));
    let done: serde_json::Value = serde_json::from_str(done.expect("JSON")).expect("JSON");
    let off_mm = |key: &str| done[key].as_f64().expect("a number").abs();
    assert!(
        off_mm("error_mm") > 5.0 && off_mm("verified_mm") < 2.0,
        "{done}"
    );
    program.expect_each(
        "
        1 | eeprom diff robot.toml | -> 80.0
        0 | calibrate rollback | as it was before
        0 | eeprom diff robot.toml | no difference
        0 | calibrate distance --length 500 --dry-run --yes --measure-with truth | not written
        0 | calibrate umbmark --side 300 --runs 1 --dry-run --yes --measure-with truth | right wheel against left -0.1
        8 | goto 3000 0 0 --timeout 20 | an obstacle ahead holds
        0 | --room small.room explore --yes --record way.mcap | min: map of 2
        0 | calibrate from-explore --dry-run | not written
        8 | --room small.room explore --timeout 20 --out part | the time ran out
        0 | --room small.room goto --map map.yaml 200 100 --start 0,0,0 | arrived at x
        2 | goto --map map.yaml 9000 0 | no free floor at x 9000 mm
        0 | replay way.mcap | mm
        0 | calibrate distance --measured 506,-3 --length 500 --yes | 506.0 mm ahead, -3.0 mm
        3 | calibrate from-explore --dry-run | explore again
        ",
    );
}

// Requirement: SERVE-borrow-1
#[test]
fn commands_borrow_the_robot_of_a_server() {
    let program = Program::blank();
    fs::write(program.file("tour"), "150 0 0\n0 0 0\n").expect("written");
    let _server = program.serve();
    program.expect_each(
        r#"
        0 | eeprom diff robot.toml | no difference
        0 | eeprom write second.toml | 5 bytes written
        0 | --json doctor | "failed":0
        0 | tour tour | 2 of 2: arrived
        0 | map tour --record drive.mcap | reports over 0.3
        0 | map --from drive.mcap --out again | by odometry alone in again-raw.png
        0 | map --served --out live | map of the server in live.png
        0 | goto --map live.yaml 100 0 --start 0,0,0 | arrived at
        0 | tune rotate --yes --dry-run | not written
        0 | eeprom check | Guarded Velocity
        0 | mode guarded-sweep | both ends
        0 | goto 100 0 0 | arrived at
        0 | --json monitor --count 3 | Guarded Sweep
        0 | stop | stopped
        2 | status --seed 3 | --seed is for a new
        2 | calibrate distance --yes --measure-with truth | end the server
        "#,
    );
    assert!(program.expect(0, "replay drive.mcap").lines().count() > 40);
    // A measurement that is killed does not leave its mode.
    let mut tune = program.command("tune rotate --yes");
    tune.stdout(Stdio::null()).stderr(Stdio::null());
    let mut tune = tune.spawn().expect("started");
    let journal = program.file(JOURNAL);
    while !journal.exists() {
        assert_eq!(tune.try_wait().expect("a child"), None);
        std::thread::sleep(Duration::from_millis(10));
    }
    std::thread::sleep(Duration::from_millis(300));
    tune.kill().and_then(|()| tune.wait()).expect("a child");
    // Then a robot that cannot be reached.
    fs::write(program.file("blank.bin"), [0xFF; 1024]).expect("written");
    program.expect_each(
        "
        0 | eeprom check | Guarded Sweep
        6 | eeprom restore blank.bin | READY
        7 | stop | cannot be reached
        7 | monitor --count 1 | READY
        ",
    );
    assert!(!journal.exists());
}

/// Environment variable with the number of kills; 200 for a release.
const KILLS: &str = "ROBOT_KILLS";

/// Commands that are killed.
const KILLED: [&str; 5] = [
    "eeprom write second.toml",
    "tune rotate --yes",
    "map tour --record drive.mcap",
    "explore --yes --record drive.mcap",
    "serve --speed max",
];

// Requirement: WIRE-program-1, WIRE-program-5, SERVE-borrow-1
#[test]
fn killed_commands_leave_nothing_half_written() {
    let kills = std::env::var(KILLS).map_or(8, |kills| kills.parse().expect("a number"));
    let program = Program::configured();
    fs::write(program.file("tour"), "60 0 0\n0 0 0\n").expect("written");
    let old = program.expect(0, "eeprom dump");
    let write = |words: &str| {
        let begun = Instant::now();
        program.expect(0, words);
        begun.elapsed()
    };
    let mut usual = write("eeprom write second.toml");
    let new = program.expect(0, "eeprom dump");
    assert_ne!(old, new);
    let (mut alive, mut undone, mut random) = (0, 0, Rng::new(1));
    for kill in 0..kills {
        let words = KILLED[kill % KILLED.len()];
        if words == KILLED[0] {
            // A busy computer may have made a write slow, which made every kill late.
            usual = usual.min(write("eeprom write robot.toml"));
        }
        // A moment within the usual time of a write and half as much again.
        let after = usual.mul_f64(1.5 * random.unit());
        let mut command = program.command(words);
        command.stdout(Stdio::null()).stderr(Stdio::null());
        let mut child = command.spawn().expect("started");
        std::thread::sleep(after);
        alive += usize::from(child.try_wait().expect("a child").is_none());
        child.kill().expect("a child");
        child.wait().expect("ended");
        let when = format!("{words} after {after:?}");
        let text = program.expect(0, "eeprom dump");
        assert!(text.contains(&old) || text.contains(&new), "{when}: {text}");
        assert!(!program.file(JOURNAL).exists(), "{when}");
        undone += usize::from(text.contains("is undone"));
        if program.file("drive.mcap").exists() {
            let done = program.command("replay drive.mcap").output();
            let done = done.expect("started");
            let text = String::from_utf8_lossy(&done.stderr);
            let empty = text.contains("it has no report");
            assert!(done.status.success() || empty, "{when}: {text}");
        }
        for (name, begin, end) in [
            ("map.png", &b"\x89PNG"[..], &b"IEND\xAE\x42\x60\x82"[..]),
            ("map.pgm", b"P5\n", b""),
            ("map.yaml", b"image: ", b"\n"),
        ] {
            let Ok(bytes) = fs::read(program.file(name)) else {
                continue;
            };
            assert!(bytes.starts_with(begin) && bytes.ends_with(end), "{name}");
        }
    }
    println!("{kills} kills: {alive} while the command ran, {undone} writes undone");
    assert!(2 * alive > kills, "{alive} of {kills} hit");
}
