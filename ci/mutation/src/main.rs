//! `mutation --package P`: tries the mutants of a package; see the README.

use std::path::PathBuf;
use std::process::ExitCode;
use std::time::Duration;

use clap::Parser;
use mutation::{Choice, Config, Error, Excuses, run};

/// Changes a package in every way that cargo-mutants lists, to see that some test notices.
///
/// Exit codes: 0 all noticed or excused, 1 not all or failed, 2 usage, 4 no cargo-mutants.
#[derive(Parser)]
#[command(version)]
struct Arguments {
    /// The configuration.
    #[arg(long, value_name = "FILE", required_unless_present = "package")]
    config: Option<PathBuf>,
    /// The package, instead of a configuration.
    #[arg(long)]
    package: Option<String>,
    /// A folder in the workspace.
    #[arg(long, default_value = ".")]
    dir: PathBuf,
    /// The program cargo-mutants, which lists the mutants.
    #[arg(long, value_name = "PROGRAM", default_value = "cargo-mutants")]
    lister: PathBuf,
    /// Only mutants of files whose path contains one of these.
    #[arg(long, value_delimiter = ',')]
    file: Vec<String>,
    /// Only mutants whose description contains one of these.
    #[arg(long, value_delimiter = ',')]
    only: Vec<String>,
    /// Every N-th mutant from the K-th on, K from 0.
    #[arg(long, value_name = "K/N", value_parser = shard)]
    shard: Option<(usize, usize)>,
    /// Only mutants in lines changed since this commit.
    #[arg(long, value_name = "COMMIT")]
    since: Option<String>,
    /// Start no more after so many seconds.
    #[arg(long)]
    seconds: Option<u64>,
    /// How many at a time.
    #[arg(long, default_value_t = 1)]
    jobs: usize,
    /// Ask the quick tests beside the code alone.
    #[arg(long)]
    quick: bool,
    /// Also write the report to this file.
    #[arg(long, value_name = "FILE")]
    report: Option<PathBuf>,
}

fn shard(text: &str) -> Result<(usize, usize), &'static str> {
    let parts = text.split_once('/');
    let numbers = parts.and_then(|(k, n)| k.parse().ok().zip(n.parse().ok()));
    numbers
        .filter(|(k, n)| k < n)
        .ok_or("not K/N with K from 0 to N - 1")
}

fn main() -> ExitCode {
    match try_main(Arguments::parse()) {
        Ok(code) => code,
        Err(error) => {
            eprintln!("mutation: {error}");
            match error {
                Error::NoLister(_) => ExitCode::from(4),
                Error::Failed(_) => ExitCode::FAILURE,
            }
        }
    }
}

fn try_main(arguments: Arguments) -> Result<ExitCode, Error> {
    let config = match (&arguments.config, arguments.package) {
        (Some(file), _) => Config::read(file)?,
        (None, package) => {
            let config = Config {
                package: package.unwrap_or_default(),
                ..Config::default()
            };
            (config, Excuses::default())
        }
    };
    let choice = Choice {
        files: arguments.file,
        only: arguments.only,
        shard: arguments.shard,
        since: arguments.since,
        at_most: arguments.seconds.map(Duration::from_secs),
        jobs: arguments.jobs,
        quick: arguments.quick,
    };
    let report = run(&arguments.dir, &arguments.lister, &config, &choice)?;
    println!("\n{report}");
    if let Some(file) = arguments.report {
        let written = std::fs::write(&file, format!("{report}\n"));
        written.map_err(|error| format!("{}: {error}", file.display()))?;
    }
    let (tried, chosen) = (report.tried(), report.chosen);
    println!(
        "{tried} of {chosen} mutants, {} findings",
        report.findings.len()
    );
    Ok(if report.findings.is_empty() {
        ExitCode::SUCCESS
    } else {
        ExitCode::FAILURE
    })
}
