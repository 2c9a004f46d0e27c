//! Gates that run tests: beside the code, and with the firmware in the loop.

use std::io;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use std::sync::Mutex;
use std::thread::{self, available_parallelism};

use serde_json::{Value, json};
use xshell::{Cmd, cmd};

use super::firmware::check_stack_use;
use crate::budget::{self, Budget};
use crate::error::{Context, Error, Kind, Result, bail, ensure, fail};
use crate::process::{self, captures};
use crate::programs;
use crate::session::Session;
use crate::toolchain::{apt_install, in_rustlib};

/// In the names of the properties' tests that try every input: seconds each, so no quick check.
const EXHAUSTIVE: &str = "::exhaustive";

pub fn unit(session: &Session) -> Result<String> {
    let tests = session.cargo_on_host("test --release --no-fail-fast")?;
    run(tests.args(["--", "--skip", EXHAUSTIVE]))
}

pub fn exhaustive(session: &Session) -> Result<String> {
    let tests = session.cargo_on_host("test --release --no-fail-fast --lib")?;
    run(tests.args(["--", EXHAUSTIVE]))
}

const IN_THE_LOOP: &str = "test --release --test in_the_loop";

/// Each test in a process of its own, as many at a time as there are processors: the emulator compiles the
/// firmware as it runs, and each new page of code interrupts every processor that runs the same process. With a seed,
/// in other worlds and at other phases of the frames.
pub fn in_the_loop(session: &Session, seed: Option<u64>) -> Result<String> {
    let firmware = |name, features| Ok::<_, Error>(session.build("fw-pac", name, features)?.path);
    let inputs = [
        ("ROBOT_ELF", session.image()?.path.clone()),
        ("ROBOT_PROGRAM", programs::build_pilot(session)?),
        ("ROBOT_ELF_BRINGUP", firmware("bringup", "")?),
        ("ROBOT_ELF_PANIC", firmware("fw-pac", "test-panic")?),
        ("ROBOT_ELF_OVERFLOW", firmware("fw-pac", "test-overflow")?),
    ];
    let words = format!("{IN_THE_LOOP} --no-run --message-format json-render-diagnostics");
    let built = session.cargo_on_host(&words)?.read()?;
    let program = captures(&built, r#""executable":"([^"]*/in_the_loop-[^"]*)""#);
    let program = program.first().context("cargo names no in_the_loop")?;
    let folder = session.root.join("tests");
    let output = |words: &[&str]| {
        let mut test = Command::new(program);
        test.args(words).envs(inputs.clone()).current_dir(&folder);
        test.envs(seed.map(|seed| ("ROBOT_BOARD_SEED", seed.to_string())));
        test.output()
    };
    let list = output(&["--list", "--format", "terse"])?;
    let list = String::from_utf8_lossy(&list.stdout);
    apart(captures(&list, "(?m)^(.*): test$"), |name| {
        output(&["--exact", name])
    })
}

/// Runs each of these tests by `start`, as many at a time as there are processors.
fn apart(names: Vec<&str>, start: impl Fn(&str) -> io::Result<Output> + Sync) -> Result<String> {
    let (names, outcomes) = (Mutex::new(names.into_iter()), Mutex::new(Vec::new()));
    let next = || names.lock().ok()?.next();
    let work = || {
        while let Some(name) = next() {
            let (success, text) = match start(name) {
                Ok(end) => (end.status.success(), [end.stdout, end.stderr].concat()),
                Err(error) => (false, error.to_string().into_bytes()),
            };
            let text = String::from_utf8_lossy(&text);
            let verdict = captures(&text, r"(?m)^(test .* \.\.\. .*)$").concat();
            println!("{}", if success { &verdict } else { &*text });
            if let Ok(mut outcomes) = outcomes.lock() {
                outcomes.push((name, success, process::test_results(&text).0));
            }
        }
    };
    let processors = available_parallelism()?.get();
    thread::scope(|scope| (0..processors).for_each(|_| drop(scope.spawn(work))));
    let outcomes = outcomes.into_inner().unwrap_or_default();
    let failed = outcomes.iter().filter(|outcome| !outcome.1);
    let failed: Vec<_> = failed.map(|outcome| outcome.0).collect();
    let passed = outcomes.iter().map(|outcome| outcome.2).sum();
    judge(passed, &failed)
}

/// Runs a script of `tests/` on the Pi's program and the ELF, by Python with what `requirements.txt` beside
/// it names; what it prints.
pub fn by_python(session: &Session, script: &str) -> Result<String> {
    let (sh, folder) = (&session.sh, session.target.join(script).with_extension(""));
    let script = Path::new("tests").join(script);
    let (venv, python) = (folder.join("venv"), folder.join("venv/bin/python"));
    let packages = script.with_file_name("requirements.txt");
    let install = cmd!(sh, "{python} -m pip install --quiet -r {packages}");
    let created = python.is_file() || cmd!(sh, "python3 -m venv {venv}").run().is_ok();
    if !created || install.run().is_err() {
        let missing = "cannot be installed by python3 -m venv and pip";
        return fail(Kind::Skipped, format!("{} {missing}", packages.display()));
    }
    let (program, elf) = (programs::build_pilot(session)?, &session.image()?.path);
    Ok(cmd!(sh, "{python} {script} {program} {elf} {folder}").read()?)
}

/// Installs a package where its programs are not found; skipped without.
fn install(session: &Session, package: &str, found: impl Fn() -> bool) -> Result<()> {
    if found() || apt_install(session, package, 20).is_ok() && found() {
        return Ok(());
    }
    let why = format!("no {package}, and `apt-get install {package}` failed");
    fail(Kind::Skipped, why)
}

/// The page of `robot serve`, in a browser without a screen.
pub fn page(session: &Session) -> Result<String> {
    let browsers = ["chromium", "chromium-browser", "google-chrome"];
    let found = || session.has("chromedriver") && browsers.iter().any(|name| session.has(name));
    install(session, "chromium-driver", found)?;
    let tests = session.cargo_on_host(IN_THE_LOOP)?;
    let tests = tests.env("ROBOT_ELF", &session.image()?.path);
    run(tests.args(["--", "--ignored", "page::"]))
}

/// The core's arithmetic on another emulator of its processor, to the bit as on the host.
pub fn qemu(session: &Session) -> Result<String> {
    const QEMU: &str = "qemu-system-arm";
    if !session.has(QEMU) && apt_install(session, QEMU, 20).is_err() {
        // Another package is in its way: the program alone.
        let unpacked = unpack(session, QEMU);
        unpacked.or_else(|error| fail(Kind::Skipped, format!("no {QEMU}: {error:#}")))?;
    }
    let [host, core] = programs::second_opinion(session)?;
    ensure!(host == core, "the host came to\n{host}\nQEMU to\n{core}");
    Ok(format!("{} lines alike", core.lines().count()))
}

/// Puts the program of a package with its name below the target folder, and installs the libraries it needs.
fn unpack(session: &Session, package: &str) -> Result<()> {
    let (sh, tools) = (&session.sh, session.target.join("tools"));
    let folder = sh.create_dir(tools.join(package))?;
    let _in_folder = sh.push_dir(&folder);
    cmd!(sh, "timeout 60 apt-get -q download {package}").run()?;
    let mut files = sh.read_dir(&folder)?.into_iter();
    let file = files.rfind(|path| path.extension().is_some_and(|kind| kind == "deb"));
    let file = file.context("apt-get downloaded no package")?;
    let depends = cmd!(sh, "dpkg-deb -f {file} Depends").read()?;
    let libraries = captures(&depends, r"\b(lib[^\s,]+)").join(" ");
    apt_install(session, &libraries, 60)?;
    cmd!(sh, "dpkg-deb -x {file} .").run()?;
    sh.create_dir(tools.join("bin"))?;
    Ok(sh.copy_file(folder.join("usr/bin").join(package), tools.join("bin"))?)
}

/// The packages for the Pi: their programs, by QEMU.
pub fn packages(session: &Session) -> Result<String> {
    let (sh, config) = (&session.sh, "host-link/config/first-board.toml");
    install(session, "qemu-user-static", || {
        session.has("qemu-arm-static")
    })?;
    let packages = programs::packages(session)?;
    for (package, qemu) in &packages {
        let content = package.with_extension("content");
        cmd!(sh, "dpkg-deb -x {package} {content}").run()?;
        let robot = content.join("usr/bin/robot");
        for words in ["--version", "explore --help"] {
            cmd!(sh, "{qemu} {robot}").args(words.split(' ')).run()?;
        }
        cmd!(sh, "{qemu} {robot} eeprom check {config}").run()?;
        // Without a robot there is much to be done.
        let doctor = cmd!(sh, "{qemu} {robot} doctor --json").ignore_status();
        let findings: Value = serde_json::from_str(&doctor.read()?).context("doctor --json")?;
        ensure!(findings.is_object(), "doctor printed no object");
    }
    Ok(format!("{} packages", packages.len()))
}

/// The demo of this kind, `demo` or `tour`.
pub fn demo(session: &Session, kind: &str) -> Result<String> {
    let tour = (kind == "tour").then(|| "--tour".to_owned());
    let ran = programs::demo(session, tour.as_slice());
    let out = session.target.join(kind);
    for file in "map.png map.pgm map.yaml trajectory.png uart.log report.md".split(' ') {
        let left = ran.is_err() || out.join(file).is_file();
        ensure!(left, "the demo left no {file}");
    }
    let (bars, report) = check_report(session, kind, &out.join("report.json"), ran)?;
    check_stack_use(session, &report)?;
    let figure = |key| budget::figure(&report, key).unwrap_or(f64::NAN);
    let [mm, deg] = ["position_error_mm_max", "heading_error_deg_max"].map(figure);
    let [map, factor] = ["map_iou", "realtime_factor"].map(figure);
    let errors = format!("{bars} bars; position {mm:.1} mm, heading {deg:.2}°");
    Ok(format!("{errors}, map {map:.2}, {factor:.1} × real time"))
}

pub fn figures(session: &Session) -> Result<String> {
    let ran = programs::figures(session, &[]);
    let out = session.target.join("figures.json");
    let (bars, report) = check_report(session, "figures", &out, ran)?;
    let (used, worst) = check_stack_use(session, &report)?;
    let figure = |key| budget::figure(&report, key).unwrap_or(f64::NAN);
    let [tick, frame] = ["tick_instructions.max", "frame_instructions.max"].map(figure);
    let [rate, ready] = ["frames_per_s_sustained", "boot_to_ready_us"].map(figure);
    let ready = ready / 1000.0;
    Ok(format!(
        "{bars} bars; tick {tick:.0}, frame {frame:.0} instructions at most, {rate:.0} frames/s, \
         ready in {ready:.1} ms, stack {used:.0} of {worst}"
    ))
}

/// Generated rooms, explored.
pub fn rooms(session: &Session) -> Result<String> {
    let table = programs::explore_bench(session, &["--seeds", "1..10"])?;
    let rows: Vec<Value> = serde_json::from_str(&session.sh.read_file(table)?)?;
    let worst = worst(&rows);
    Budget::read(session)?.check("rooms", &worst)?;
    Ok(format!("of {} rooms {worst}", rows.len()))
}

/// How many rooms were completed, contacts in all of them, and the worst figures of those completed.
fn worst(rows: &[Value]) -> Value {
    let completed = rows.iter().filter(|row| row["completed"] == true);
    let of = |row, key| budget::figure(row, key).unwrap_or(f64::NAN);
    let all = |key| completed.clone().map(move |row| of(row, key));
    json!({
        "completed": completed.clone().count(),
        "collisions": rows.iter().map(|row| of(row, "collisions")).sum::<f64>(),
        "map_iou": all("map_iou").fold(1.0, f64::min),
        "position_error_mm_max": all("position_error_mm_max").fold(0.0, f64::max),
    })
}

/// Sources that do not count: other packages, and files of tests.
const IGNORED: &str = "/(plant|proofs|tests)/|/tests\\.rs$";

/// Runs the tests, prints what they run of each file and the lines that they do not; fails below the
/// floor of `ci/budget.toml`, which is returned.
pub fn coverage(session: &Session) -> Result<String> {
    let has_tools = || !in_rustlib(&session.sysroot, "bin/llvm-profdata").is_empty();
    let add = session.rustup("component add llvm-tools");
    process::require(has_tools, &add, "LLVM's part of the compiler")?;
    session.require_tool("llvm-cov@0.9.1")?;
    let budget = Budget::read(session)?;
    let floor = budget.value("coverage.at_least.regions_percent")?;
    // Programs of an earlier state of the code would count as never run.
    session.cargo("llvm-cov clean --workspace").run()?;
    let words = format!(
        "llvm-cov --locked --package fw-core --lib --tests --show-missing-lines \
         --fail-under-regions {floor} --ignore-filename-regex {IGNORED}"
    );
    session.cargo(&words).run()?;
    Ok(format!("at least {floor} % of the regions"))
}

/// The report of a run against its bars. A run that failed may still have left the figures that say
/// why; the run's own failure counts in any case.
fn check_report(
    session: &Session,
    name: &str,
    file: &Path,
    ran: Result<PathBuf>,
) -> Result<(usize, Value)> {
    if !file.is_file() {
        ran?;
        bail!("no {}", session.relative(file));
    }
    let report = session.sh.read_file(file)?;
    let report = serde_json::from_str(&report).with_context(|| file.display().to_string())?;
    let bars = Budget::read(session)?.check(name, &report)?;
    ran.map(|_| (bars, report))
}

/// Runs tests; returns their number. A run without a test has tested nothing.
fn run(tests: Cmd<'_>) -> Result<String> {
    let (success, text) = process::tee(tests)?;
    let (passed, failed) = process::test_results(&text);
    let named = success || !failed.is_empty();
    ensure!(named, "the tests did not end with 0");
    judge(passed, &failed)
}

fn judge(passed: u32, failed: &[&str]) -> Result<String> {
    ensure!(failed.is_empty(), "failed: {}", failed.join(", "));
    ensure!(passed > 0, "no test ran");
    Ok(format!("{passed} tests"))
}

#[test]
fn rooms_worst_figures_are_of_the_completed() {
    let row = |completed, collisions, iou, mm| json!({"completed": completed, "collisions": collisions, "map_iou": iou, "position_error_mm_max": mm});
    let rows = [
        row(true, 0, 0.9, 20.0),
        row(false, 1, 0.1, 900.0),
        row(true, 0, 0.8, 30.0),
    ];
    let expected =
        json!({"completed": 2, "collisions": 1.0, "map_iou": 0.8, "position_error_mm_max": 30.0});
    assert_eq!(worst(&rows), expected);
}
