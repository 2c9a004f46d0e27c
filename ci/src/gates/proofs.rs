//! Gates on the proofs and on what the tests notice: Kani, fuzz targets, mutants, seeded defects.

use std::time::UNIX_EPOCH;

use serde_json::{Map, Value};
use xshell::cmd;

use super::check_bars;
use crate::defects;
use crate::error::{Context, Error, Kind, Result, bail, fail};
use crate::kani;
use crate::process;
use crate::session::Session;

/// The theorems' table against its floors: a proof that went missing fails here.
pub fn floors(session: &Session) -> Result<String> {
    let counts = counts(&kani::declared(session, &[])?)?;
    let figures = counts.iter().map(|(name, count)| format!("{count} {name}"));
    let figures = figures.collect::<Vec<_>>().join(", ");
    check_bars(session, "proofs", &Value::Object(counts))?;
    Ok(figures)
}

/// The rows of each kind, and the sums of the columns, by the names in the list's first line.
fn counts(list: &str) -> Result<Map<String, Value>> {
    let rows = list.lines().map(|line| line.split('\t'));
    let rows: Vec<Vec<_>> = rows.map(Iterator::collect).collect();
    let (head, rows) = rows.split_first().context("the list is empty")?;
    let column = |name: &str| {
        let at = head.iter().position(|found| *found == name);
        let at = at.with_context(|| format!("the theorems' list has no column {name}"))?;
        Ok::<_, Error>(rows.iter().filter_map(move |row| row.get(at).copied()))
    };
    let mut counts = Map::new();
    let theorems = column("kind")?.filter(|kind| *kind == "theorem").count();
    counts.insert("theorems".into(), theorems.into());
    counts.insert("sampled".into(), (rows.len() - theorems).into());
    for name in ["harnesses", "covers", "tests"] {
        // A count, or names parted by commas.
        let names = |cell: &str| cell.split(',').filter(|name| !name.is_empty()).count();
        let cells = column(name)?;
        let cells = cells.map(|cell| cell.parse().unwrap_or_else(|_| names(cell)));
        counts.insert(name.into(), cells.sum::<usize>().into());
    }
    Ok(counts)
}

/// Every seeded defect fits the code; the samples are tried.
pub fn defects(session: &Session) -> Result<String> {
    let all = defects::all(session)?;
    let noticed = defects::try_all(session, all.iter().filter(|defect| defect.sample))?;
    Ok(format!("{} fit the code; noticed: {noticed}", all.len()))
}

/// Tries the core's mutants with these arguments of `ci/mutation`; its last line, `9 of 9 mutants, 0 findings`.
pub fn mutants(session: &Session, arguments: &[String]) -> Result<String> {
    mutation(session, "--config ci/mutation.toml", arguments)
}

/// `ci/mutation` for what `of` says.
fn mutation(session: &Session, of: &str, arguments: &[String]) -> Result<String> {
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
    let arguments = ["--since", &base, "--seconds", "60"];
    let tried = mutants(session, &arguments.map(str::to_owned))?;
    // A change of comments or tests has no mutant.
    if tried.starts_with("0 of 0 ") {
        return fail(Kind::Skipped, unchanged);
    }
    Ok(tried)
}

/// All mutants of the core.
pub fn all_mutants(session: &Session) -> Result<String> {
    let arguments = ["--jobs", "2", "--report", "target/mutants.md"];
    mutants(session, &arguments.map(str::to_owned))
}

/// Every unit test, or property, that cites a requirement notices a change of its crate's code that cites it.
pub fn citations(session: &Session) -> Result<String> {
    let arguments = ["--jobs", "2", "--citations", "Requirement"].map(str::to_owned);
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

/// A part of fw-pac's statements deleted, another one each day: the virtual board judges.
pub fn firmware_mutants(session: &Session) -> Result<String> {
    const PARTS: u64 = 20;
    let days = UNIX_EPOCH.elapsed()?.as_secs() / 86_400;
    let part = format!("{}/{PARTS}", days % PARTS);
    let arguments = ["--only", "delete statement", "--shard", &part].map(str::to_owned);
    mutation(session, "--config ci/mutation-fw-pac.toml", &arguments)
}

#[test]
fn columns_of_the_theorems_are_summed_by_name() {
    let list = "kind\tgroup\tarea\tproperty\tharnesses\tcovers\ttests\tneeds\n\
                theorem\tT0\tunits\ta\t1\t3\texhaustive,sampled\t\n\
                property\tT1\twire\tb\t2\t4\t\ta\n";
    let expected = r#"{"covers":7,"harnesses":3,"sampled":1,"tests":2,"theorems":1}"#;
    assert_eq!(Value::Object(counts(list).unwrap()).to_string(), expected);
    assert!(counts("").is_err());
}
