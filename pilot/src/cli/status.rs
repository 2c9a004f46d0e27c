//! `status`: some frames that ask for nothing, then everything that is known of robot and link.

use super::args::{Robot, Status};
use super::connection::Job;
use super::monitor;
use super::output::Output;
use host_link::board_io::{Machine, Wires};
use host_link::eeprom::{self, journal::Journal};
use host_link::error::{Error, Exit};
use host_link::reset;
use host_link::session::{Session, Wish};
use host_link::settings;
use host_link::snapshot::Snapshot;
use pilot::hints;
use serde::Serialize;

/// The command.
pub struct Look<'a> {
    pub status: &'a Status,
    pub robot: &'a Robot,
    pub output: Output,
}

#[derive(Serialize)]
struct Seen {
    /// `STM_READY`.
    ready: bool,
    #[serde(flatten)]
    report: Option<Snapshot>,
    stop_deadline_ms: Option<u16>,
    hints: Vec<String>,
    /// What ended the look early.
    error: Option<String>,
    exit: u8,
}

impl Job for Look<'_> {
    type Result = Exit;

    fn run<W: Wires>(self, machine: &mut Machine<W>, _: &Journal) -> Result<Exit, Error> {
        let (seen, exit) = match reset::await_ready(machine, self.robot.ready_timeout) {
            Ok(_) => self.linked(machine)?,
            Err(error @ Error::NotReady { .. }) => refused(machine, &error)?,
            Err(error) => return Err(error),
        };
        self.output.result(&seen, || told(&seen));
        Ok(exit)
    }
}

impl Look<'_> {
    fn linked<W: Wires>(&self, machine: &mut Machine<W>) -> Result<(Seen, Exit), Error> {
        let mut session = Session::open(machine, self.robot.rate, self.robot.ready_timeout)?;
        let ends_us = session.now_us() + u64::from(self.status.ms) * 1000;
        let mut outcome = Ok(());
        session.hear();
        while outcome.is_ok() && session.now_us() < ends_us {
            outcome = session.exchange(&Wish::default()).map(|_| ());
            session.hear();
        }
        if outcome == Err(Error::Interrupted) {
            return Err(Error::Interrupted);
        }
        let mut report = session.snapshot().clone();
        report.link = session.statistics();
        let mut hints = hints::of(&report, session.config());
        if report.stm.is_none() {
            hints.push(match session.deaf() {
                Some(why) => format!("the STM's end of the link is not known: {why}"),
                None => "the STM's end of the link is not known: its log said nothing of it (slide switch, --uart, \
                         or a firmware that does not)"
                    .into(),
            });
        }
        let exit = outcome.as_ref().err().map_or(Exit::Ok, Error::exit);
        let seen = Seen {
            ready: true,
            report: Some(report),
            stop_deadline_ms: Some(session.config().platform.stop_deadline),
            hints,
            error: outcome.err().map(|error| error.to_string()),
            exit: exit.code(),
        };
        Ok((seen, exit))
    }
}

/// The STM does not start: what its EEPROM says about that.
fn refused<W: Wires>(machine: &mut Machine<W>, error: &Error) -> Result<(Seen, Exit), Error> {
    let hint = match settings::decode(&eeprom::read(machine)?) {
        Ok(config) => format!(
            "the EEPROM holds a good configuration of mode {}: the STM does not run, or could not read it",
            config.mode.name()
        ),
        Err(why) => why.to_string(),
    };
    let exit = error.exit();
    let seen = Seen {
        ready: false,
        report: None,
        stop_deadline_ms: None,
        hints: vec![hint],
        error: Some(error.to_string()),
        exit: exit.code(),
    };
    Ok((seen, exit))
}

fn told(seen: &Seen) -> String {
    let mut lines = Vec::new();
    match &seen.report {
        None => lines.push("STM_READY is low".into()),
        Some(report) => {
            lines.push(format!(
                "mode {}, stop deadline {} ms",
                report.mode,
                seen.stop_deadline_ms.unwrap_or_default()
            ));
            lines.push(monitor::robot(report));
            lines.push(format!("Pi:  {}", monitor::pi(&report.link)));
            lines.push(match &report.stm {
                Some(stm) => format!("STM: {}", monitor::stm(stm)),
                None => "STM: not known".into(),
            });
        }
    }
    for hint in &seen.hints {
        lines.push(format!("hint: {hint}"));
    }
    if let Some(error) = &seen.error {
        lines.push(format!("error: {error}"));
    }
    lines.join("\n")
}
