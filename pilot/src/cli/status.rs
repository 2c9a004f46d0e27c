//! `status`: some frames without a command, then everything known of robot and link.

use super::args::Status;
use super::connection::Context;
use super::monitor;
use fw_core::types::{Fault, Faults};
use host_link::board_io::BoardIo;
use host_link::error::{Error, Exit};
use host_link::snapshot::Snapshot;
use host_link::{eeprom, reset, settings};
use pilot::client::Client;
use pilot::hints;
use serde::Serialize;
use std::thread;
use std::time::{Duration, Instant};

/// Time between two looks at what a server knows.
const LOOK: Duration = Duration::from_millis(50);

#[derive(Default, Serialize)]
struct Summary {
    /// `STM_READY`.
    ready: bool,
    #[serde(flatten)]
    report: Option<Snapshot>,
    stop_deadline_ms: Option<u16>,
    hints: Vec<String>,
    /// What ended the exchange early.
    error: Option<String>,
    exit: u8,
}

/// Runs the command.
pub fn run(status: &Status, context: Context<'_>) -> Result<Exit, Error> {
    if let Some(mut client) = context.server()? {
        return of_server(&mut client, status, context);
    }
    context.with_own_board(|connection| {
        let io = &mut connection.io;
        let (seen, exit) = match reset::await_ready(io, context.board.ready_timeout) {
            Ok(_) => linked(io, status, context)?,
            Err(error @ Error::NotReady { .. }) => not_ready(io, &error)?,
            Err(error) => return Err(error),
        };
        context.output.result(&seen, || summary(&seen))?;
        Ok(exit)
    })
}

/// Shows what the server knows, once it knows the STM's end.
fn of_server(client: &mut Client, status: &Status, context: Context<'_>) -> Result<Exit, Error> {
    let mut frame = client.status()?;
    let ends = Instant::now() + Duration::from_millis(status.ms.into());
    while frame.robot.stm.is_none() && frame.error.is_none() && Instant::now() < ends {
        thread::sleep(LOOK);
        frame = client.status()?;
    }
    let unreachable = frame.error.is_some();
    let reached = of_faults(&frame.robot);
    let exit = if unreachable { Exit::Link } else { reached };
    let mut hints = frame.advice;
    let drives = |driver| format!("{driver} drives the robot");
    hints.extend(frame.driver.map(drives));
    let seen = Summary {
        ready: !unreachable,
        report: Some(frame.robot),
        stop_deadline_ms: Some(frame.stop_deadline_ms),
        hints,
        error: frame.error,
        exit: exit.code(),
    };
    context.output.result(&seen, || summary(&seen))?;
    Ok(exit)
}

fn linked(
    io: &mut BoardIo,
    status: &Status,
    context: Context<'_>,
) -> Result<(Summary, Exit), Error> {
    let mut session = context.open_session(io)?;
    let (report, _, ended) = session.observe(u64::from(status.ms) * 1000)?;
    let mut hints = hints::diagnose(&report, session.config());
    hints.extend(hints::no_log(&report, session.log_error()));
    let exit = ended.as_ref().map_or(of_faults(&report), Error::exit);
    let seen = Summary {
        ready: true,
        report: Some(report),
        stop_deadline_ms: Some(session.config().stop_deadline().0),
        hints,
        error: ended.map(|error| error.to_string()),
        exit: exit.code(),
    };
    Ok((seen, exit))
}

/// Whether what an answering robot reports keeps its motors off.
fn of_faults(report: &Snapshot) -> Exit {
    let blocks = |fault: &Fault| fault.blocking && report.faults.contains(&fault.name);
    let blocked = Faults::TABLE.iter().any(blocks);
    if blocked { Exit::Fault } else { Exit::Ok }
}

/// The STM does not start: checks its EEPROM for the reason.
fn not_ready(io: &mut BoardIo, error: &Error) -> Result<(Summary, Exit), Error> {
    let hint = match settings::decode(&eeprom::read(io)?) {
        Ok(config) => format!(
            "the EEPROM holds a good configuration of mode {}: the STM does not run, awaits 2.76 V, or could not read it",
            config.mode().name()
        ),
        Err(why) => why.to_string(),
    };
    let exit = error.exit();
    let seen = Summary {
        hints: vec![hint],
        error: Some(error.to_string()),
        exit: exit.code(),
        ..Summary::default()
    };
    Ok((seen, exit))
}

fn summary(seen: &Summary) -> String {
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
    lines.extend(seen.hints.iter().map(|hint| format!("hint: {hint}")));
    lines.extend(seen.error.iter().map(|error| format!("error: {error}")));
    lines.join("\n")
}

#[test]
fn fault_that_keeps_the_motors_off_has_its_exit_code() {
    for (name, exit) in [("slip", Exit::Ok), ("battery-cutoff", Exit::Fault)] {
        let mut report = Snapshot::default();
        report.faults = vec!["link-lost", name];
        assert_eq!(of_faults(&report).code(), exit.code());
    }
}
