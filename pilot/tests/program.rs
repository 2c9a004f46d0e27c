//! The program as its user sees it, where no robot is needed: exit codes, files, standard output.

use fw_core::eeprom::{Image, fields};
use host_link::pose::Pose;
use host_link::settings::Settings;
use mapper::Grid;
use pilot::mapping::{BODY_MM, RangeSample};
use pilot::recording::Recorder;
use std::ffi::OsStr;
use std::fs::{self, File};
use std::io::Write;
use std::os::unix::ffi::OsStrExt;
use std::path::Path;
use std::process::{Command, Stdio};
use std::thread::sleep;
use std::time::{Duration, Instant};

/// Records poses along x, millimetres.
fn record(path: &Path, begin_us: u64, along_mm: &[f64]) {
    let mut recorder = Recorder::create(path, &Settings::sample().unwrap(), BODY_MM, 0).unwrap();
    for (time_us, &x_mm) in (begin_us..).step_by(25_000).zip(along_mm) {
        let sample = RangeSample {
            time_us,
            pose: Pose::new(x_mm, 0.0, 0.0),
            ..RangeSample::default()
        };
        recorder.add(&sample).unwrap();
    }
    let finished = recorder.finish(1_000_000, &Grid::new(25.0), Pose::default());
    finished.unwrap();
}

fn robot() -> Command {
    let mut robot = Command::new(env!("CARGO_BIN_EXE_robot"));
    robot.stdin(Stdio::null());
    robot
}

/// Exit code, standard output and standard error; words are parted by blanks.
fn run(words: &str) -> (i32, String, String) {
    let done = robot().args(words.split(' ')).output().unwrap();
    let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
    (
        done.status.code().unwrap(),
        text(&done.stdout),
        text(&done.stderr),
    )
}

#[test]
fn bringup_listens_until_its_patience_after_the_last_line() {
    let folder = tempfile::tempdir().unwrap();
    let log = folder.path().join("serial");
    assert!(Command::new("mkfifo").arg(&log).status().unwrap().success());
    let mut bringup = robot();
    bringup.args(["bringup", "--patience", "2"]).arg(&log);
    let bringup = bringup.stderr(Stdio::piped()).spawn().unwrap();
    let mut port = File::create(&log).unwrap();
    for line in [
        "bringup 1 after power-on",
        "rest counts 0 0",
        "link",
        "the last",
    ] {
        writeln!(port, "I00000: {line}").unwrap();
        sleep(Duration::from_millis(900));
    }
    let text = bringup.wait_with_output().unwrap().stderr;
    assert!(String::from_utf8_lossy(&text).contains("the last"));
}

// Requirement: WIRE-program-3
#[test]
fn senseless_options_are_refused_by_name() {
    for (words, name) in [
        ("--virtual --air -300 status", "--air"),
        ("--seed 3 status", "--seed"),
        ("--virtual status --spi /dev/spidev0.0", "--spi"),
        ("--ready-timeout -1 status", "--ready-timeout"),
        ("goto 1 2 3 --timeout -1", "--timeout"),
        ("goto 1 2 3 --tolerance-mm nan", "--tolerance-mm"),
        (
            "goto 1 2 3 --tolerance-mm 0.001",
            "accepted is 0.2 to 1000000",
        ),
        (
            "goto 1 2 --start 0,0,0",
            "were not provided:\n  --map <FILE>\n\n",
        ),
        ("--rate x status", "accepted is 1 to 2000"),
        ("--virtual --seed x status", "accepted is 0 to"),
        ("tune move --hold -1", "--hold"),
        ("tune move --levels 0,100", "--levels"),
        ("calibrate umbmark --side 1", "--side"),
        ("--rate 0 status", "--rate"),
        ("--eeprom-image other.bin status", "--eeprom-image"),
        ("goto 1 2 --map map.yaml --timeout 3", "--timeout"),
        ("map tour --out maps/", "--out"),
        ("explore --out ..", "--out"),
    ] {
        let (code, _, stderr) = run(words);
        assert_eq!(code, 2, "{words}: {stderr}");
        assert!(stderr.contains(name), "{words}: {stderr}");
        assert!(stderr.starts_with("robot: "), "{words}: {stderr}");
    }
    let mut explore = robot();
    explore.args(["explore", "--out"]);
    let done = explore.arg(OsStr::from_bytes(b"\xFF")).output().unwrap();
    assert_eq!(done.status.code(), Some(2), "{done:?}");
}

// Requirement: WIRE-program-2
#[test]
fn failed_standard_output_is_exit_code_11_and_closed_pipe_0() {
    for words in ["eeprom init", "--help", "--json eeprom init"] {
        let full = File::options().write(true).open("/dev/full").unwrap();
        let status = robot().args(words.split(' ')).stdout(full).status();
        assert_eq!(status.unwrap().code(), Some(11), "{words}");
        let (reader, writer) = std::io::pipe().unwrap();
        drop(reader);
        let done = robot().args(words.split(' ')).stdout(writer).output();
        let done = done.unwrap();
        assert_eq!(
            (done.status.code(), done.stderr),
            (Some(0), vec![]),
            "{words}"
        );
    }
}

#[test]
fn endless_and_far_inputs_are_refused() {
    let here = tempfile::tempdir().unwrap();
    let here = here.path();
    let far = here.join("far.mcap");
    // By a server that had served for an hour.
    record(&far, 3_600_000_000, &[0.0, 2e6]);
    let map = here.join("map").display().to_string();
    let far = far.display().to_string();
    let image = here.join("nine.bin").display().to_string();
    let nine_cells = Image::FIRST_BOARD.with(fields::CELLS, 9);
    fs::write(&image, nine_cells.0).unwrap();
    for (words, expected) in [
        ("eeprom restore Cargo.toml".into(), "`robot eeprom write`"),
        (
            "eeprom check /dev/zero".into(),
            "/dev/zero: it has more than",
        ),
        ("eeprom check /dev/zero.toml".into(), "cannot read"),
        ("tour /dev/zero".into(), "/dev/zero: it has more than"),
        ("map /dev/zero".into(), "/dev/zero: it has more than"),
        ("map --from /dev/zero".into(), "/dev/zero"),
        (
            format!("map --from {far} --out {map}"),
            "2000 m from the start",
        ),
    ] {
        let (code, _, stderr) = run(&words);
        assert_eq!(code, 3, "{words}: {stderr}");
        assert!(stderr.contains(expected), "{words}: {stderr}");
    }
    assert!(!here.join("map.png").exists());
    for words in ["check", "dump --image"] {
        let (code, _, stderr) = run(&format!("eeprom {words} {image}"));
        assert_eq!(code, 5, "{stderr}");
        let expected = "nine.bin: EEPROM page 0x02";
        assert!(stderr.contains(expected), "{stderr}");
    }
    // Its two reports are 25 ms apart.
    let begun = Instant::now();
    // A SIGHUP that is ignored from the beginning on stays so.
    let script = r#"trap "" HUP; "$0" replay $1 --speed 0.05 & sleep 0.2; kill -HUP $!; wait $!"#;
    let mut shell = Command::new("sh");
    shell.args(["-c", script, env!("CARGO_BIN_EXE_robot"), &far]);
    assert!(shell.status().unwrap().success());
    assert!((500..60_000).contains(&begun.elapsed().as_millis()));
}

// Requirement: WIRE-program-1
#[test]
fn outputs_spare_foreign_files_and_links() {
    let here = tempfile::tempdir().unwrap();
    let here = here.path();
    let (letter, link) = (here.join("map.png"), here.join("link.toml"));
    fs::write(&letter, "a letter").unwrap();
    std::os::unix::fs::symlink(&letter, &link).unwrap();
    let one = here.join("one.mcap");
    record(&one, 0, &[0.0]);
    let out = here.join("map");
    for words in [
        format!("map --from {} --out {}", one.display(), out.display()),
        format!("eeprom init --force {}", link.display()),
        format!("eeprom init --force {}", here.display()),
    ] {
        let (code, _, stderr) = run(&words);
        assert_eq!(code, 11, "{words}: {stderr}");
    }
    assert_eq!(fs::read(&letter).unwrap(), b"a letter");
    assert!(link.is_symlink() && !here.join("map.pgm").exists());
    // A name that clears the terminal does not where it is shown, nor in an error.
    let (one, clears) = (one.display(), here.join("\x1b[2J").display().to_string());
    for (words, code) in [
        (format!("map --from {one} --out {clears}"), 0),
        (format!("tour {clears}"), 3),
    ] {
        let (ended, stdout, stderr) = run(&words);
        let shown = stdout + &stderr;
        assert_eq!(ended, code, "{shown}");
        assert!(
            shown.contains(r"\u{1b}[2J") && !shown.contains('\x1b'),
            "{shown}"
        );
    }
}

#[test]
fn faults_of_a_file_come_in_one_run_with_carets() {
    let here = tempfile::tempdir().unwrap();
    let here = here.path();
    let file = here.join("tour");
    fs::write(&file, "0 0 0\n1 2\n0 x 0\n").unwrap();
    let (code, _, stderr) = run(&format!("tour {}", file.display()));
    assert_eq!(code, 3, "{stderr}");
    for expected in [
        "line 2: a way-point is x, y and rotation",
        "this line has 2 of three",
        "    1 2\n    ^^^",
        "line 3: y = x",
        "    0 x 0\n      ^",
    ] {
        assert!(stderr.contains(expected), "{expected}: {stderr}");
    }
}

#[test]
fn manual_has_page_for_each_command_and_completions() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    assert_eq!(run(&format!("manual {}", folder.display())).0, 0);
    let text = |name: &str| fs::read_to_string(folder.join(name)).unwrap();
    assert!(text("robot.1").contains("Exit codes"));
    assert!(text("robot-eeprom-write.1").contains("Configuration file"));
    for name in ["robot.bash", "_robot", "robot.fish"] {
        assert!(text(name).contains("explore"));
    }
    let file = folder.join("robot.1");
    assert_eq!(run(&format!("manual {}", file.display())).0, 11);
}
