//! Gates on the proofs and on what the tests notice: Kani, fuzz targets, mutants, seeded defects.

use std::ffi::OsStr;

use serde_json::{Value, json};
use xshell::cmd;

use crate::budget::Budget;
use crate::defects;
use crate::error::{Context, Kind, Result, bail, fail};
use crate::kani;
use crate::process;
use crate::session::Session;

/// The theorems' table against its floors: a proof that went missing fails here.
pub fn floors(session: &Session) -> Result<String> {
    let counts = counts(&kani::declared(session, &[])?)?;
    Budget::read(session)?.check("proofs", &counts)?;
    let figures = counts.as_object().into_iter().flatten();
    let figures = figures.map(|(name, count)| format!("{count} {name}"));
    Ok(figures.collect::<Vec<_>>().join(", "))
}

/// The rows of each kind, and the sums of the columns.
fn counts(list: &str) -> Result<Value> {
    let head = "kind\tgroup\tarea\tproperty\tharnesses\tcovers\ttests\tneeds\n";
    let rows = list.strip_prefix(head);
    let rows = rows.context("the theorems' list has other columns")?;
    let rows: Vec<Vec<_>> = rows.lines().map(|row| row.split('\t').collect()).collect();
    let sum = |column: usize| {
        let numbers = rows.iter().map(|row| row[column].parse::<usize>());
        numbers.sum::<std::result::Result<usize, _>>()
    };
    let theorems = rows.iter().filter(|row| row[0] == "theorem").count();
    let tests = rows.iter().flat_map(|row| row[6].split(','));
    Ok(json!({
        "theorems": theorems,
        "sampled": rows.len() - theorems,
        "harnesses": sum(4)?,
        "covers": sum(5)?,
        "tests": tests.filter(|name| !name.is_empty()).count(),
    }))
}

/// Every seeded defect fits the code; the samples are tried.
pub fn defects(session: &Session) -> Result<String> {
    let all = defects::all(session)?;
    let noticed = defects::try_all(session, all.iter().filter(|defect| defect.sample))?;
    Ok(format!("{} fit the code; noticed: {noticed}", all.len()))
}

/// Tries the core's mutants with these arguments of `ci/mutation`; its last line, `9 of 9 mutants, 0 findings`.
pub fn mutants(session: &Session, arguments: &[impl AsRef<OsStr>]) -> Result<String> {
    mutation(session, "--config ci/mutation.toml", arguments)
}

/// `ci/mutation` for what `of` says.
fn mutation(session: &Session, of: &str, arguments: &[impl AsRef<OsStr>]) -> Result<String> {
    session.require_tool("mutants@27.1.0")?;
    let mutation = session.build_program("mutation")?;
    let run = cmd!(session.sh, "{mutation}").args(of.split(' '));
    let (success, text) = process::tee(run.args(["--lister", "cargo"]).args(arguments))?;
    let last = text.trim().lines().last().unwrap_or_default().to_owned();
    if success { Ok(last) } else { bail!(last) }
}

/// The mutants of the lines that changed in the core since the main branch, or on it since the commit
/// before, for a minute or so.
pub fn mutants_of_the_change(session: &Session) -> Result<String> {
    let sh = &session.sh;
    let commit = |name| process::output(cmd!(sh, "git rev-parse --verify --quiet {name}"));
    let main = commit("origin/main").filter(|main| Some(main) != commit("HEAD").as_ref());
    let Some(base) = main.or_else(|| commit("HEAD~1")) else {
        return fail(Kind::Skipped, "no commit to compare with");
    };
    let diff = cmd!(sh, "git diff --merge-base {base} --name-only --");
    let unchanged = format!("nothing in the core changed since {base}");
    // A file of tests has no mutant, and the tool takes a minute to build.
    let core = diff.args(["fw-core/src", ":(exclude)*tests*"]);
    if process::output(core).is_none_or(|files| files.is_empty()) {
        return fail(Kind::Skipped, unchanged);
    }
    let tried = mutants(session, &["--since", &base, "--seconds", "60"])?;
    // A change of comments or tests has no mutant.
    if tried.starts_with("0 of 0 ") {
        return fail(Kind::Skipped, unchanged);
    }
    Ok(tried)
}

/// All mutants of the core.
pub fn all_mutants(session: &Session) -> Result<String> {
    mutants(session, &["--jobs", "2", "--report", "target/mutants.md"])
}

/// Every unit test, or property, that cites a requirement notices a change of its crate's code that cites it.
pub fn citations(session: &Session) -> Result<String> {
    let arguments = ["--jobs", "2", "--citations", "Requirement"];
    let crates = [
        "--config ci/mutation.toml",
        "--config ci/mutation-host-link.toml",
        "--config ci/mutation-pilot.toml",
        "--package navigator",
        "--package mapper",
    ];
    let of_each = crates.map(|of| mutation(session, of, &arguments));
    Ok(of_each.into_iter().collect::<Result<Vec<_>>>()?.join("; "))
}

/// fw-pac's statements deleted: the virtual board judges.
pub fn firmware_mutants(session: &Session) -> Result<String> {
    let arguments = ["--only", "delete statement"];
    mutants_of_the_day(session, "--config ci/mutation-fw-pac.toml", arguments)
}

/// The mutants of host-link.
pub fn host_link_mutants(session: &Session) -> Result<String> {
    mutants_of_the_day(
        session,
        "--config ci/mutation-host-link.toml",
        ["--jobs", "2"],
    )
}

/// A twentieth of these mutants, another one each day.
fn mutants_of_the_day(session: &Session, of: &str, more: [&str; 2]) -> Result<String> {
    const PARTS: u64 = 20;
    let part = format!("{}/{PARTS}", process::days()? % PARTS);
    mutation(session, of, &[more[0], more[1], "--shard", &part])
}

#[test]
fn columns_of_the_theorems_are_summed_by_name() {
    let list = "kind\tgroup\tarea\tproperty\tharnesses\tcovers\ttests\tneeds\n\
                theorem\tT0\tunits\ta\t1\t3\texhaustive,sampled\t\n\
                property\tT1\twire\tb\t2\t4\t\ta\n";
    let expected = r#"{"covers":7,"harnesses":3,"sampled":1,"tests":2,"theorems":1}"#;
    assert_eq!(counts(list).unwrap().to_string(), expected);
    assert!(counts("").is_err());
}
