//! Gates on the proofs and on what the tests notice: Kani, fuzz targets, mutants, seeded defects.

use serde_json::{Map, Value};

use super::check_bars;
use crate::error::{Context, Error, Failure, Result, bail};
use crate::fuzz::{self, Effort};
use crate::kani::{self, Shard};
use crate::session::Session;
use crate::{coverage, defects, mutants};

/// The theorems' table against its floors: a proof that went missing fails here.
pub fn floors(session: &Session) -> Result<String> {
    let list = session
        .cargo("run --quiet --package proofs --example theorems")
        .read()?;
    let counts = counts(&list)?;
    let figures = counts.iter().map(|(name, count)| format!("{count} {name}"));
    let figures = figures.collect::<Vec<_>>().join(", ");
    check_bars(session, "proofs", &Value::Object(counts))?;
    Ok(figures)
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

pub fn kani(session: &Session) -> Result<String> {
    let Some(version) = kani::version(session) else {
        bail!(Failure::Skipped(kani::MISSING.into()));
    };
    Ok(format!("{version}: {}", kani::prove(session, Shard::ALL)?))
}

/// Every target on the same inputs each time, as far as the time goes; the nightly workflow looks for
/// new ones.
pub fn fuzz(session: &Session) -> Result<String> {
    let targets = fuzz::build(session)?;
    fuzz::run(session, &targets, Effort::Inputs(500_000, 30))
}

pub fn coverage(session: &Session) -> Result<String> {
    coverage::run(session)
}

/// Every seeded defect fits the code; the samples are tried.
pub fn defects(session: &Session) -> Result<String> {
    let all = defects::all(session)?;
    let noticed = defects::try_all(session, all.iter().filter(|defect| defect.sample))?;
    Ok(format!("{} fit the code; noticed: {noticed}", all.len()))
}

pub fn all_defects(session: &Session) -> Result<String> {
    defects::run(session, &[])
}

pub fn mutants(session: &Session) -> Result<String> {
    mutants::of_the_change(session)
}

/// All mutants of the core.
pub fn all_mutants(session: &Session) -> Result<String> {
    let arguments = ["--jobs", "2", "--report", "target/mutants.md"];
    mutants::run(session, &arguments.map(str::to_owned))
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
