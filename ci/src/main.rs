//! The gates, the demo and the set-up, as one program: `cargo xtask …`.
#![forbid(unsafe_code)]

mod budget;
mod defects;
mod elf;
mod error;
mod evidence;
mod firmware;
mod flash;
mod fuzz;
mod gates;
mod kani;
mod process;
mod programs;
mod session;
mod stack;
mod toolchain;
mod trace;
mod workspace;

use std::path::Path;
use std::process::ExitCode;

use clap::{Args, Parser, Subcommand};

use error::{Failure, Result};
use flash::Board;
use gates::When;
use session::Session;
use toolchain::Provider;
use trace::Trace;

/// The gates, the demo and the set-up of the robot.
#[derive(Parser)]
#[command(name = "cargo xtask", bin_name = "cargo xtask", after_help = EXIT_CODES)]
struct Cli {
    /// Where the firmware's compiler comes from, instead of the first that works
    #[arg(long, global = true, env = "ROBOT_WAY")]
    provider: Option<Provider>,
    #[command(subcommand)]
    command: Command,
}

const EXIT_CODES: &str = "\
Exit codes: 0 done, 1 something failed, 2 wrong command line, 3 no toolchain for the firmware,
4 a program is missing, 5 the board did not answer or does not hold the firmware.";

#[derive(Subcommand)]
enum Command {
    /// Find or install a toolchain for the robot's processor
    Setup,
    /// Build the ELF that is flashed, print its path and sizes
    Firmware,
    /// The worst-case depth of its stack, with the calls that lead there
    Stack,
    /// The virtual robot explores the default room: target/demo/; with --tour it drives the room's tour:
    /// target/tour/
    Demo(Handed),
    /// The virtual robot explores generated rooms, e.g. --seeds 1..10: a table
    ExploreBench(Handed),
    /// Faults, alone and in pairs, on the driving virtual robot: --hours H --seed S
    Campaign(Handed),
    /// Measure the ELF on the emulated core: target/figures.json; with --profile, where the tick's
    /// instructions go
    Figures(Handed),
    /// The odometry beside others on the emulated core, as a table
    Bench,
    /// The Pi's program on the virtual board, e.g. `robot goto 500 0 90`
    Robot(Handed),
    /// The Debian packages of the Pi's program: target/packages/
    Deb,
    /// Flash, verify, reset, show the first log lines
    Flash(Board),
    /// Every gate a change must pass, with a table
    Test {
        /// Without the slow gates
        #[arg(long)]
        quick: bool,
        #[command(flatten)]
        choice: gates::Choice,
    },
    /// The gates that take longer than a change should wait for
    Night(gates::Choice),
    /// The theorems, by Kani
    Prove(kani::Choice),
    /// Fuzz one target or all
    Fuzz {
        target: Option<String>,
        #[arg(long, default_value_t = 60)]
        seconds: u32,
    },
    /// Every requirement with the code that meets it and what checks that
    Trace,
    /// Make the code wrong on purpose; some gate must notice
    Defects {
        #[arg(long, value_name = "NAME", value_delimiter = ',')]
        only: Vec<String>,
    },
    /// Change fw-core in every way; some test must notice: the options of `ci/mutation`
    Mutants(Handed),
    /// How much of fw-core the tests run, and what they do not
    Coverage,
}

/// What goes to another program, `--help` included.
#[derive(Args)]
#[command(disable_help_flag = true)]
struct Handed {
    #[arg(trailing_var_arg = true, allow_hyphen_values = true)]
    arguments: Vec<String>,
}

fn main() -> ExitCode {
    run(Cli::parse()).unwrap_or_else(|error| {
        eprintln!("cargo xtask: {error:#}");
        let failure = error.downcast_ref();
        ExitCode::from(failure.map_or(1, |Failure(kind, _)| *kind as u8))
    })
}

fn run(cli: Cli) -> Result<ExitCode> {
    let session = &Session::new(cli.provider)?;
    let see = |what, path: &Path| println!("{what}: see {}", session.relative(path));
    let mut good = true;
    match cli.command {
        Command::Setup => drop(session.toolchain()?),
        Command::Firmware => drop(session.image()?),
        Command::Stack => {
            stack::bound(session, &session.image()?.path)?;
        }
        Command::Demo(more) => see("demo", &programs::demo(session, &more.arguments)?),
        Command::ExploreBench(more) => drop(programs::explore_bench(session, &more.arguments)?),
        Command::Campaign(more) => programs::campaign(session, &more.arguments)?,
        Command::Figures(more) => see("figures", &programs::figures(session, &more.arguments)?),
        Command::Bench => programs::bench(session)?,
        Command::Robot(robot) => {
            let code = programs::pilot(session, &robot.arguments)?;
            return Ok(ExitCode::from(code));
        }
        Command::Deb => {
            for (package, _) in programs::packages(session)? {
                see("deb", &package);
            }
        }
        Command::Flash(board) => flash::flash(session, &board)?,
        Command::Test { quick, choice } => {
            good = gates::run(session, &choice, &[When::Quick, When::Change], quick);
        }
        Command::Night(choice) => good = gates::run(session, &choice, &[When::Night], false),
        Command::Prove(choice) => println!("{}", kani::prove(session, &choice)?),
        Command::Fuzz { target, seconds } => {
            println!("{}", fuzz::run(session, target.as_deref(), Some(seconds))?);
        }
        Command::Trace => Trace::read(session)?.print(),
        Command::Defects { only } => println!("noticed: {}", defects::run(session, &only)?),
        Command::Mutants(more) => drop(gates::mutants(session, &more.arguments)?),
        Command::Coverage => println!("{}", gates::coverage(session)?),
    }
    Ok(ExitCode::from(u8::from(!good)))
}

#[test]
fn command_lines_are_read_as_written() {
    let read = |line: &str| Cli::try_parse_from(["xtask"].into_iter().chain(line.split(' ')));
    let test = read("test --only fmt,docs --quick --only=kani").map(|cli| cli.command);
    let only = ["fmt", "docs", "kani"];
    assert!(matches!(test, Ok(Command::Test { choice, .. }) if choice.only == only));
    assert!(read("test --only kanu").is_err());
    let robot = read("robot --seed 3 goto -5 0 --help").map(|cli| cli.command);
    assert!(matches!(robot, Ok(Command::Robot(robot)) if robot.arguments.len() == 6));
    assert!(read("prove --shard 4/4").is_err());
}
