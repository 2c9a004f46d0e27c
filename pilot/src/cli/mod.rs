//! The command line: arguments in, one report and one exit code out.

mod args;
mod board_args;
mod calibrate;
mod connection;
mod doctor;
mod drive;
mod eeprom;
mod explore;
mod map;
mod mode;
mod monitor;
mod output;
mod prompt;
mod remote;
mod replay;
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
use std::io::IsTerminal;
use std::process::ExitCode;

/// Shows the options of every command's help.
const HELP_ALL: &str = "--help-all";

/// The command line's grammar. The options that choose a robot are accepted after the command, too; help
/// shows them on request.
fn grammar(all: bool) -> clap::Command {
    let grammar = Arguments::command().mut_args(|option| {
        let hidden = !all && !SHOWN.contains(&option.get_id().as_str());
        option.global(true).hide(hidden)
    });
    let grammar = name_in_errors(grammar);
    if all {
        return grammar.after_help(args::exit_codes());
    }
    grammar
}

/// Takes `-1` after an option for its value, so that its range and its name are stated.
fn name_in_errors(command: clap::Command) -> clap::Command {
    command.mut_subcommands(name_in_errors).mut_args(|option| {
        let takes_value = option.get_action().takes_values();
        if takes_value {
            option.allow_negative_numbers(true)
        } else {
            option
        }
    })
}

/// Global options in the short help.
const SHOWN: [&str; 2] = ["json", "chosen"];

/// Runs the program.
pub fn main() -> ExitCode {
    let all = std::env::args_os().any(|word| word == HELP_ALL);
    let words = std::env::args_os().map(|word| {
        let is_all = word == HELP_ALL;
        if is_all { "--help".into() } else { word }
    });
    let json = std::env::args_os().any(|word| word == "--json");
    let parsed = grammar(all)
        .try_get_matches_from(words)
        .and_then(|matches| Arguments::from_arg_matches(&matches).map(|all| (all, matches)));
    let outcome = match parsed {
        Ok((arguments, matches)) => {
            board_args::check(&matches, arguments.board.virtual_board.chosen)
                .and_then(|()| run(&arguments, Output::new(json)))
        }
        // Help and version are results.
        Err(problem) if !problem.use_stderr() => {
            let text = problem.render();
            let ansi = std::io::stdout().is_terminal();
            let text = if ansi {
                text.ansi().to_string()
            } else {
                text.to_string()
            };
            Output::line(text.trim_end()).map(|()| Exit::Ok)
        }
        Err(problem) => {
            let text = problem.render().to_string();
            let text = text.strip_prefix("error: ").unwrap_or(&text);
            Err(Error::Usage(text.trim_end().into()))
        }
    };
    let exit = outcome.unwrap_or_else(|error| {
        if error != Error::PipeClosed {
            Output::new(json).error(&error);
        }
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
        Command::Doctor(doctor) => return doctor::run(doctor, context),
        Command::Reset => context.with_board(|connection| {
            let ready_ms = reset::restart(&mut connection.io, context.board.ready_timeout)?;
            output.result(&serde_json::json!({ "ready_ms": ready_ms }), || {
                format!("STM reset; ready after {ready_ms} ms")
            })
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
        Command::Replay(replay) => replay::run(replay, output),
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn grammar_is_consistent_and_first_help_short() {
        grammar(true).debug_assert();
        let lines = |all| grammar(all).render_long_help().to_string().lines().count();
        let (short, long) = (lines(false), lines(true));
        assert!(short <= 48 && long > short + 40, "{short} and {long} lines");
    }
}
