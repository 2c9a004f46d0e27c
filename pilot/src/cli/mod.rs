//! The command line: arguments in, one report and one exit code out.

mod args;
mod board_args;
mod calibrate;
mod connection;
mod drive;
mod eeprom;
mod explore;
mod map;
mod mode;
mod monitor;
mod output;
mod prompt;
mod remote;
mod serve;
mod status;
mod stop;
mod tune;

use args::{Arguments, Command};
use clap::{CommandFactory, FromArgMatches};
use connection::Context;
use host_link::error::{Error, Exit};
use host_link::reset;
use output::Output;
use std::process::ExitCode;

/// Runs the program.
pub fn main() -> ExitCode {
    // The options outside of a command are accepted after it, too.
    let command = Arguments::command().mut_args(|option| option.global(true));
    let matches = command.try_get_matches();
    let arguments = match matches.and_then(|matches| Arguments::from_arg_matches(&matches)) {
        Ok(arguments) => arguments,
        Err(problem) => {
            // Help and version are no errors; clap chooses the stream.
            let _ = problem.print();
            let exit = if problem.use_stderr() {
                Exit::Usage
            } else {
                Exit::Ok
            };
            if exit == Exit::Usage && std::env::args_os().any(|word| word == "--json") {
                let what = problem.kind().to_string();
                Output::new(true).json_error(&Error::Usage(what));
            }
            return ExitCode::from(exit.code());
        }
    };
    let output = Output::new(arguments.json);
    let exit = run(&arguments, output).unwrap_or_else(|error| {
        output.error(&error);
        error.exit()
    });
    ExitCode::from(exit.code())
}

fn run(arguments: &Arguments, output: Output) -> Result<Exit, Error> {
    let context = Context {
        board: &arguments.board,
        output,
    };
    if let Some(exit) = run_remote(&arguments.command, context)? {
        return Ok(exit);
    }
    match &arguments.command {
        Command::Eeprom { command } => return eeprom::run(command, context),
        Command::Status(status) => return status::run(status, context),
        Command::Reset => context.with_board(|connection| {
            let ready_ms = reset::restart(&mut connection.io, context.board.ready_timeout)?;
            output.result(&serde_json::json!({ "ready_ms": ready_ms }), || {
                format!("STM reset; ready after {ready_ms} ms")
            });
            Ok(())
        }),
        Command::Mode { mode } => mode::run(*mode, context),
        Command::Monitor(monitor) => monitor::run(monitor, context),
        Command::Serve(serve) => serve::run(serve, context),
        Command::Stop => stop::run(context),
        Command::Log => stop::log(context),
        Command::Goto(goto) => match &goto.map {
            Some(map) => explore::go_to(goto, map, context),
            None => drive::run(&[goto.target()], &goto.criteria, context),
        },
        Command::Tour(tour) => drive::run(
            &pilot::waypoints::load(&tour.file)?,
            &tour.criteria,
            context,
        ),
        Command::Tune { command } => tune::run(command, context),
        Command::Calibrate { command } => calibrate::run(command, context),
        Command::Map(map) => map::run(map, context),
        Command::Explore(explore) => explore::run(explore, context),
    }?;
    Ok(Exit::Ok)
}

/// Runs the command as a client, where a server of the robot runs and the command can be one.
fn run_remote(command: &Command, context: Context<'_>) -> Result<Option<Exit>, Error> {
    let name = match command {
        Command::Status(_) => "status",
        Command::Monitor(_) => "monitor",
        Command::Stop => "stop",
        Command::Log => "log",
        Command::Goto(goto) if goto.map.is_none() => "goto",
        Command::Explore(_) => "explore",
        _ => return Ok(None),
    };
    let Some(mut client) = remote::connect(name, context)? else {
        return Ok(None);
    };
    let client = &mut client;
    match command {
        Command::Status(_) => return status::of_server(client, context).map(Some),
        Command::Monitor(monitor) => remote::monitor(client, monitor, context),
        Command::Stop => remote::stop(client, context),
        Command::Log => remote::log(client, context),
        Command::Goto(goto) => remote::go_to(client, goto, context),
        Command::Explore(explore) => remote::explore(client, explore, context),
        _ => return Ok(None),
    }?;
    Ok(Some(Exit::Ok))
}
