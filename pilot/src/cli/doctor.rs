//! `doctor`: everything between the kernel and the wheels.

use super::args::Doctor;
use super::connection::{Connection, Context};
use super::prompt;
use host_link::error::{Error, Exit};
use pilot::doctor::{self, Findings, Outcome};
use serde_json::json;
use std::path::{Path, PathBuf};

/// Runs the command.
pub fn run(doctor: &Doctor, context: Context<'_>) -> Result<Exit, Error> {
    let mut findings = Findings::default();
    let board = context.board;
    if !board.virtual_board.chosen {
        let devices = [&board.spi, &board.i2c, &board.gpiochip, &board.uart];
        doctor::check_computer(
            devices.map(PathBuf::as_path),
            Path::new("/boot"),
            &mut findings,
        );
    }
    let devices_fail = !findings.failed().is_empty();
    let outcome =
        context.with_board(|connection| check(doctor, connection, context, &mut findings));
    match outcome {
        // Its cause is among the findings already.
        Err(Error::Device { .. }) if devices_fail => {}
        Err(error) => {
            if !findings.0.is_empty() {
                report(&findings, context)?;
            }
            return Err(error);
        }
        Ok(()) => {}
    }
    report(&findings, context)
}

/// Prints the findings; the exit code that they demand.
pub fn report(findings: &Findings, context: Context<'_>) -> Result<Exit, Error> {
    let failed = findings.failed().len();
    let exit = if failed > 0 { Exit::Findings } else { Exit::Ok };
    let done = json!({ "findings": findings, "failed": failed, "exit": exit.code() });
    context.output.result(&done, || summary(findings))?;
    Ok(exit)
}

fn check(
    doctor: &Doctor,
    Connection { io, journal, .. }: &mut Connection,
    context: Context<'_>,
    findings: &mut Findings,
) -> Result<(), Error> {
    let (rate, timeout) = (context.board.rate, context.board.ready_timeout);
    let image = doctor::check_board(io, rate, timeout, findings)?;
    if !doctor.wheels_up {
        return Ok(());
    }
    let Some(image) = image else {
        doctor::skip_wheels(findings);
        return Ok(());
    };
    let what = "Lift the wheels off the floor; they will turn ahead and back.";
    prompt::confirm_drive(doctor.yes, what, &io.interrupt, context.output)?;
    doctor::check_wheels(io, &image, rate, timeout, journal, findings)
}

fn summary(findings: &Findings) -> String {
    let lines = findings.0.iter().map(|finding| {
        let outcome = match finding.outcome {
            Outcome::Passed => "ok  ",
            Outcome::Failed => "FAIL",
            Outcome::Skipped => "skip",
        };
        let advice = finding.advice.map(|advice| format!("\n      -> {advice}"));
        let (check, found) = (finding.check, &finding.found);
        format!("{outcome}  {check}: {found}{}", advice.unwrap_or_default())
    });
    lines.collect::<Vec<_>>().join("\n")
}
