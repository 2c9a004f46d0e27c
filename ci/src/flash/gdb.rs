//! GDB: finding one that knows ARM, and having it load and compare an ELF.

use std::path::Path;
use std::process::Command;

use crate::error::{Kind, Result, fail};
use crate::process::{self, pattern};
use crate::toolchain::apt_install;
use crate::workspace::Workspace;

/// Debuggers by name, the likeliest first.
const NAMES: [&str; 3] = ["gdb-multiarch", "arm-none-eabi-gdb", "gdb"];

/// A debugger for the robot's processor, installed where that is possible.
pub fn find(workspace: &Workspace) -> Result<&'static str> {
    let find = || NAMES.into_iter().find(|name| knows_arm(name));
    let installed = || apt_install(workspace, "gdb-multiarch", 600).is_ok();
    if let Some(name) = find().or_else(|| installed().then(find)?) {
        return Ok(name);
    }
    let missing = "no GDB for ARM here (install gdb-multiarch or arm-none-eabi-gdb)";
    fail(Kind::MissingProgram, missing)
}

/// A GDB that executes these commands, one a line.
fn gdb(name: &str, commands: &str) -> Command {
    let mut gdb = Command::new(name);
    gdb.args(["-nx", "-batch"]);
    gdb.args(commands.lines().flat_map(|command| ["-ex", command]));
    gdb
}

fn knows_arm(name: &str) -> bool {
    // An unknown architecture is no error to GDB's exit code, and its wording changes.
    let commands = "set architecture arm\nshow architecture";
    let answer = gdb(name, commands).output();
    answer.is_ok_and(|answer| String::from_utf8_lossy(&answer.stdout).contains("\"arm\""))
}

/// Loads `elf` through the debug server at `address`, compares every section, resets the core and
/// lets it run. [`Kind::Board`] where a section differs or GDB did not get through.
pub fn load(name: &str, elf: &Path, address: &str) -> Result<()> {
    let commands = format!(
        "set confirm off\nset remotetimeout 60\ntarget extended-remote {address}\nload\n\
         compare-sections\nmonitor reset\necho running\\n\ndetach"
    );
    let mut gdb = gdb(name, &commands);
    gdb.arg(elf);
    let (success, text) = process::tee(gdb)?;
    match judge(success, &text) {
        Err(reason) => return fail(Kind::Board, format!("not flashed: {reason}")),
        Ok(sections) => println!("flash: {sections} sections compared, all alike"),
    }
    Ok(())
}

/// How many sections were compared, or what went wrong: GDB only prints it and goes on.
fn judge(success: bool, text: &str) -> std::result::Result<usize, &str> {
    let bad = pattern("Connection |Remote (connection closed|communication error)|MIS-MATCHED");
    let bad = text.lines().find(|line| bad.is_match(line));
    let sections = text.lines().filter(|line| line.starts_with("Section "));
    match (bad, sections.count()) {
        (Some(line), _) => Err(line),
        _ if !success => Err("GDB ended with an error"),
        _ if !text.contains("Transfer rate") => Err("GDB loaded nothing"),
        (None, 0) => Err("GDB compared no section"),
        _ if !text.lines().any(|line| line == "running") => Err("GDB did not reach the reset"),
        (None, sections) => Ok(sections),
    }
}

#[test]
fn load_counts_only_if_every_section_matches() {
    let good = "\
Loading section .vector_table, size 0x198 lma 0x8000000
Transfer rate: 30 KB/sec, 5000 bytes/write.
Section .vector_table, range 0x8000000 -- 0x8000198: matched.
Section .text, range 0x8000198 -- 0x80021a0: matched.
running
";
    assert_eq!(judge(true, good), Ok(2));
    assert!(judge(false, good).is_err());
    for change in [
        "80021a0: matched>80021a0: MIS-MATCHED",
        "Transfer rate>",
        "running>",
        "Section >",
    ] {
        let (word, instead) = change.split_once('>').unwrap();
        assert!(judge(true, &good.replace(word, instead)).is_err(), "{word}");
    }
}
