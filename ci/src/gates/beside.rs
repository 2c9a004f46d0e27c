//! Gates that keep one core busy, run by another process beside the gates that follow.

use std::fs::File;
use std::path::PathBuf;
use std::process::{Child, Command};

use super::{FAILED, PASSED, Row, SKIPPED};
use crate::error::Result;
use crate::session::Session;

/// They build in folders of their own, or wait until `unit` has built what they need.
const GATES: &str = "firmware,elf,reproducible,msrv,exhaustive,defects,page,kani,qemu,demo,tour,recording,\
                     ros2,figures";

/// Whether the other process runs this gate.
pub fn runs(name: &str) -> bool {
    GATES.split(',').any(|gate| gate == name)
}

pub struct Beside {
    process: Child,
    output: PathBuf,
}

impl Beside {
    /// Starts it with this command's own arguments.
    pub fn start(session: &Session) -> Result<Self> {
        let output = session.target.join("beside.txt");
        let file = File::create(&output)?;
        let mut command = Command::new(std::env::current_exe()?);
        command.args(std::env::args_os().skip(1));
        command.args(["--only", GATES]);
        command.stdout(file.try_clone()?).stderr(file);
        let process = command.spawn()?;
        println!("\n{} run beside what follows", GATES.replace(',', ", "));
        Ok(Self { process, output })
    }

    /// Waits for its end and prints what it printed, but for its table.
    fn finish(mut self) -> Result<String> {
        self.process.wait()?;
        let text = String::from_utf8_lossy(&std::fs::read(self.output)?).into_owned();
        let (printed, table) = text.rsplit_once("\ngate ").unwrap_or((&text, ""));
        println!("{printed}");
        Ok(table.to_owned())
    }
}

/// The rows of all [`GATES`], once it has ended.
pub fn rows(started: Result<Beside>) -> Vec<Row> {
    let none = "the process beside this one came to no result";
    let (table, why) = match started.and_then(Beside::finish) {
        Ok(table) => (table, none.into()),
        Err(error) => (String::new(), format!("{error:#}")),
    };
    let found = |gate| table.lines().filter_map(row).find(|row| row.0 == gate);
    let rows = GATES.split(',');
    let rows = rows.map(|gate| found(gate).unwrap_or_else(|| Row(gate, FAILED, why.clone())));
    rows.collect()
}

/// A line of the table as [`super::summarise`] prints it.
fn row(line: &str) -> Option<Row> {
    let (name, result) = (line.get(..13)?.trim_end(), line.get(14..22)?.trim_end());
    let name = GATES.split(',').find(|gate| *gate == name)?;
    let mut results = [PASSED, FAILED, SKIPPED].into_iter();
    let result = results.find(|known| *known == result)?;
    Some(Row(name, result, line.get(23..)?.to_owned()))
}

#[test]
fn row_of_the_table_is_read_and_nothing_else() {
    let line = "demo          passed      41.4  13 bars; map 0.94";
    let Row(name, result, figure) = row(line).unwrap();
    // As it was printed, with the seconds in their column.
    assert_eq!(format!("{name:<13} {result:<8} {figure}"), line);
    assert!(row("7 passed, 1 failed, 0 skipped").is_none());
    assert!(row("loop          passed      41.4  a gate of the other process").is_none());
}
