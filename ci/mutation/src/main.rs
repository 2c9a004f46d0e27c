//! `mutation --package P` tries the mutants of a package; see the README.

use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::{Context, Result};
use clap::Parser;
use mutation::{Choice, Config, Excuses, NoLister, run, run_citations};

/// Changes a package in every way that cargo-mutants lists, to see that some test notices
///
/// Exit codes: 0 all noticed or excused, 1 findings or a failure, 2 usage, 4 no cargo-mutants.
#[derive(Parser)]
#[command(version)]
struct Arguments {
    /// The configuration
    #[arg(long, value_name = "FILE", required_unless_present = "package")]
    config: Option<PathBuf>,
    /// The package, instead of a configuration
    #[arg(long)]
    package: Option<String>,
    /// A folder in the workspace
    #[arg(long, default_value = ".")]
    dir: PathBuf,
    /// The program that lists the mutants: cargo-mutants, or cargo
    #[arg(long, value_name = "PROGRAM", default_value = "cargo-mutants")]
    lister: PathBuf,
    /// Instead, whether each test that cites a requirement in a comment `// LABEL: NAME, ...` notices a change
    /// of the code that cites it
    #[arg(long, value_name = "LABEL")]
    citations: Option<String>,
    #[command(flatten)]
    choice: Choice,
    /// Also write the report to this file
    #[arg(long, value_name = "FILE")]
    report: Option<PathBuf>,
}

fn main() -> ExitCode {
    try_main(Arguments::parse()).unwrap_or_else(|error| {
        eprintln!("mutation: {error:#}");
        ExitCode::from(if error.is::<NoLister>() { 4 } else { 1 })
    })
}

fn try_main(arguments: Arguments) -> Result<ExitCode> {
    let own = Config {
        package: arguments.package.unwrap_or_default(),
        ..Config::default()
    };
    let config = match &arguments.config {
        Some(file) => Config::read(file)?,
        None => (own, Excuses::default()),
    };
    let (folder, lister) = (&arguments.dir, &arguments.lister);
    if let Some(label) = &arguments.citations {
        let (claims, idle) = run_citations(folder, lister, &config.0, label, &arguments.choice)?;
        for finding in &idle {
            println!("- {finding}");
        }
        println!("{claims} citations by tests, {} findings", idle.len());
        return Ok(ExitCode::from(u8::from(!idle.is_empty())));
    }
    let report = run(folder, lister, &config, &arguments.choice)?;
    println!("\n{report}");
    if let Some(file) = arguments.report {
        let written = std::fs::write(&file, format!("{report}\n"));
        written.with_context(|| file.display().to_string())?;
    }
    let (tried, chosen, findings) = (report.tried(), report.chosen, report.findings.len());
    println!("{tried} of {chosen} mutants, {findings} findings");
    Ok(ExitCode::from(u8::from(findings > 0)))
}
