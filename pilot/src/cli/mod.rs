//! The command-line program: arguments in, one report and one exit code out.

mod args;
mod calibrate;
mod connection;
mod drive;
mod eeprom;
mod map;
mod mode;
mod monitor;
mod output;
mod prompt;
mod status;
mod tune;

use args::{Arguments, Command};
use clap::Parser;
use host_link::error::{Error, Exit};
use output::Output;
use std::process::ExitCode;

/// Runs the program.
pub fn main() -> ExitCode {
    let arguments = match Arguments::try_parse() {
        Ok(arguments) => arguments,
        Err(problem) => {
            // Help and version are no errors; clap knows where each belongs.
            let _ = problem.print();
            let exit = if problem.use_stderr() {
                Exit::Usage
            } else {
                Exit::Ok
            };
            if exit == Exit::Usage && std::env::args_os().any(|word| word == "--json") {
                let what = problem.kind().to_string();
                Output::new(true).failure(&Error::Usage(what));
            }
            return ExitCode::from(exit.code());
        }
    };
    let output = Output::new(arguments.json);
    match run(&arguments, output) {
        Ok(exit) => ExitCode::from(exit.code()),
        Err(error) => {
            output.error(&error);
            ExitCode::from(error.exit().code())
        }
    }
}

fn run(arguments: &Arguments, output: Output) -> Result<Exit, Error> {
    let robot = &arguments.robot;
    match &arguments.command {
        Command::Eeprom { command } => eeprom::run(command, robot, output),
        Command::Reset => connection::with_machine(robot, connection::Reset { robot, output }),
        Command::Mode { mode } => connection::with_machine(
            robot,
            mode::Change {
                mode: *mode,
                robot,
                output,
            },
        ),
        Command::Monitor(monitor) => connection::with_machine(
            robot,
            monitor::Watch {
                monitor,
                robot,
                output,
            },
        ),
        Command::Status(status) => connection::with_machine(
            robot,
            status::Look {
                status,
                robot,
                output,
            },
        ),
        Command::Goto(goto) => {
            let way = vec![goto.target()?];
            connection::with_machine(
                robot,
                drive::Drive {
                    way,
                    terms: &goto.terms,
                    robot,
                    output,
                },
            )
        }
        Command::Tour(tour) => {
            let way = pilot::waypoints::load(&tour.file)?;
            connection::with_machine(
                robot,
                drive::Drive {
                    way,
                    terms: &tour.terms,
                    robot,
                    output,
                },
            )
        }
        Command::Tune { command } => tune::run(command, robot, output),
        Command::Calibrate { command } => calibrate::run(command, robot, output),
        Command::Map(map) => map::run(map, robot, output),
    }
}
