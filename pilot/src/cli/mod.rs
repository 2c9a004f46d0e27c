//! The command line: arguments in, one report and one exit code out.

mod args;
mod board_args;
mod bringup;
mod calibrate;
mod connection;
mod doctor;
mod drive;
mod eeprom;
mod explore;
mod lock;
mod map;
mod measuring_args;
mod mode;
mod monitor;
mod number;
mod output;
mod prompt;
mod replay;
#[cfg(feature = "ros2")]
mod ros2;
#[cfg(any(test, feature = "terminal"))]
mod screen;
#[cfg(not(any(test, feature = "terminal")))]
mod screen {
    use super::Error;
    use pilot::{client::Client, teleop::DeadMan};

    pub fn run(_: &mut Client, _: Option<DeadMan>) -> Result<(), Error> {
        let what = "this `robot` was built without the feature `terminal`";
        Err(Error::Usage(what.into()))
    }
}
mod serve;
mod status;
mod stop;
mod tune;

use args::{Arguments, Command};
use clap::{ArgMatches, CommandFactory, FromArgMatches};
use clap_complete::{Shell, generate_to};
use connection::Context;
use host_link::error::{Error, Exit};
use host_link::reset;
use output::Output;
use std::io::IsTerminal;
use std::path::Path;
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
        option.allow_negative_numbers(takes_value)
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
                .and_then(|()| run(&arguments, &matches, Output::new(json)))
        }
        // Help and version are results.
        Err(problem) if !problem.use_stderr() => {
            let text = problem.render();
            let ansi = std::io::stdout().is_terminal();
            let plain = text.to_string();
            let text = if ansi { text.ansi().to_string() } else { plain };
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

fn run(arguments: &Arguments, matches: &ArgMatches, output: Output) -> Result<Exit, Error> {
    let context = Context {
        matches,
        board: &arguments.board,
        output,
    };
    match &arguments.command {
        Command::Eeprom { command } => return eeprom::run(command, context),
        Command::Status(status) => return status::run(status, context),
        Command::Doctor(doctor) => return doctor::run(doctor, context),
        Command::Bringup(bringup) => return bringup::run(bringup, context),
        Command::Reset => context.with_board(|connection| {
            let ready_ms = reset::restart(&mut connection.io, context.board.ready_timeout)?;
            output.result(&serde_json::json!({ "ready_ms": ready_ms }), || {
                format!("STM reset; ready after {ready_ms} ms")
            })
        }),
        Command::Mode { mode } => mode::run(*mode, context),
        Command::Monitor(monitor) => monitor::run(monitor, context),
        Command::Teleop(teleop) => monitor::teleop(teleop, context),
        Command::Serve(serve) => serve::run(serve, context),
        #[cfg(feature = "ros2")]
        Command::Ros2(arguments) => ros2::run(arguments, context),
        Command::Stop => stop::run(context),
        Command::Log => stop::log(context),
        Command::Goto(goto) => match &goto.map {
            Some(map) => explore::go_to(goto, map, context),
            // clap requires no map where ROT, which a map excludes, is given.
            None if goto.start.is_some() || goto.yes => {
                let why = "--start and --yes are for --map, which takes X Y without ROT";
                Err(Error::Usage(why.into()))
            }
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
        Command::Manual { folder } => write_manual(folder),
    }?;
    Ok(Exit::Ok)
}

/// Manual pages and completions of all commands and options.
fn write_manual(folder: &Path) -> Result<(), Error> {
    let mut grammar = grammar(true);
    let mut write = || {
        std::fs::create_dir_all(folder)?;
        clap_mangen::generate_to(grammar.clone(), folder)?;
        for shell in [Shell::Bash, Shell::Zsh, Shell::Fish] {
            generate_to(shell, &mut grammar, "robot", folder)?;
        }
        Ok(())
    };
    write().map_err(|error: std::io::Error| Error::unwritable(folder, &error))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn grammar_is_consistent_and_first_help_short() {
        grammar(true).debug_assert();
        let lines = |all| grammar(all).render_long_help().to_string().lines().count();
        let (short, long) = (lines(false), lines(true));
        assert!(short <= 50 && long > short + 40, "{short} and {long} lines");
    }
}
