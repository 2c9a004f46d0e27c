//! Gates on the proofs and on what the tests notice: Kani, fuzz targets, mutants, seeded defects.

use serde_json::{Map, Value};

use super::check_bars;
use super::Outcome::{self, Passed, Skipped};
use crate::defects::{self, Bench};
use crate::error::{Context, Error, Result};
use crate::fuzz::{Effort, Fuzzer};
use crate::mutants::{self, Said};
use crate::session::Session;
use crate::shard::Shard;
use crate::{coverage, kani, process};

/// The theorems' table against its floors: a proof that went missing fails here.
pub fn floors(session: &Session) -> Result<Outcome> {
    let words = "run --quiet --package proofs --example theorems";
    let list = process::output(session.workspace.cargo(words));
    let counts = counts(&list.with_context(|| format!("`cargo {words}` failed"))?)?;
    let figures = counts.iter().map(|(name, count)| format!("{count} {name}"));
    let figures = figures.collect::<Vec<_>>().join(", ");
    check_bars(session, "proofs", Value::Object(counts))?;
    Ok(Passed(figures))
}

/// The rows of each kind, and the sums of the columns, by the names in the list's first line.
fn counts(list: &str) -> Result<Map<String, Value>> {
    let mut rows = list
        .lines()
        .map(|line| line.split('\t').collect::<Vec<_>>());
    let head = rows.next().unwrap_or_default();
    let rows: Vec<_> = rows.collect();
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
        let sum: usize = column(name)?
            .map(|cell| cell.parse().unwrap_or_else(|_| names(cell)))
            .sum();
        counts.insert(name.into(), sum.into());
    }
    Ok(counts)
}

pub fn kani(session: &Session) -> Result<Outcome> {
    let Some(version) = kani::version(&session.workspace) else {
        return Ok(Skipped(kani::MISSING.into()));
    };
    let figure = kani::prove(&session.workspace, Shard::ALL)?;
    Ok(Passed(format!("{version}: {figure}")))
}

/// Every target on the same inputs each time, as far as the time goes; the nightly workflow looks for
/// new ones.
pub fn fuzz(session: &Session) -> Result<Outcome> {
    let fuzzer = Fuzzer::find(&session.workspace)?;
    fuzzer.build()?;
    Ok(Passed(fuzzer.run_all(
        &fuzzer.targets()?,
        Effort::Inputs(500_000, 30),
    )?))
}

pub fn coverage(session: &Session) -> Result<Outcome> {
    Ok(Passed(coverage::run(&session.workspace)?))
}

/// Every seeded defect fits the code, and the table says nothing that is no longer so; the samples
/// are tried.
pub fn defects(session: &Session) -> Result<Outcome> {
    let workspace = &session.workspace;
    let all = defects::all(workspace)?;
    let listed = defects::listed(workspace, &all)?;
    let bench = Bench::set_up(workspace, None)?;
    let mut caught = Vec::new();
    for defect in all.iter().filter(|defect| defect.sample) {
        println!("  {}: {}", defect.name, defect.what);
        bench.try_one(defect)?;
        caught.push(defect.name.as_str());
    }
    let (all, caught) = (all.len(), caught.join(", "));
    Ok(Passed(format!(
        "{all} fit the code, {listed} in the table; caught again: {caught}"
    )))
}

pub fn all_defects(session: &Session) -> Result<Outcome> {
    defects::run(&session.workspace, session.toolchain().ok(), &[])?;
    Ok(Passed(String::new()))
}

/// The mutants of the lines that changed in the core.
pub fn mutants(session: &Session) -> Result<Outcome> {
    Ok(match mutants::of_the_change(&session.workspace)? {
        Said::Good(figure) => Passed(figure),
        Said::Nothing(reason) => Skipped(reason),
    })
}

/// All mutants of the core.
pub fn all_mutants(session: &Session) -> Result<Outcome> {
    mutants::run(&session.workspace, &mutants::Choice::default())?;
    Ok(Passed(String::new()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn columns_of_the_theorems_are_summed_by_name() {
        let list = "kind\tgroup\tarea\tproperty\tharnesses\tcovers\ttests\tneeds\n\
                    theorem\tT0\tunits\ta\t1\t3\texhaustive,sampled\t\n\
                    property\tT1\twire\tb\t2\t4\t\ta\n";
        let expected = serde_json::json!({
            "theorems": 1, "sampled": 1, "harnesses": 3, "covers": 7, "tests": 2
        });
        assert_eq!(Value::Object(counts(list).unwrap()), expected);
        assert!(counts("").is_err());
    }
}
