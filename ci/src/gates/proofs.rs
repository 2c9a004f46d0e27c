//! Gates on the proofs: how many there are, Kani, the fuzz targets.

use super::{passed, skipped, Context, Verdict};
use crate::defects::{self, Bench};
use crate::error::{failed, Error, Result};
use crate::fuzz::{Effort, Fuzzer};
use crate::kani;
use crate::mutants::{self, Said};
use crate::shard::Shard;
use crate::shell;

/// The theorems' table against its floors: a proof that went missing fails here.
pub fn floors(context: &mut Context) -> Result<Verdict> {
    let list = [
        "run",
        "--quiet",
        "--package",
        "proofs",
        "--example",
        "theorems",
    ];
    let text = shell::ask(context.place.cargo().args(list));
    let Some(text) = text else {
        return failed("`cargo run -p proofs --example theorems` failed");
    };
    let counts = Counts::of(&text)?;
    let mut below = Vec::new();
    for (key, floor) in context.budget()?.section("proofs.at_least") {
        let Some(number) = counts.get(key) else {
            return failed(format!("ci/budget.toml: proofs has no figure {key}"));
        };
        let number = f64::from(number);
        if number < floor {
            below.push(format!(
                "{number} {key}, the floor of ci/budget.toml is {floor}"
            ));
        } else if number > floor {
            println!("  {number} {key}: the floor of ci/budget.toml can be raised from {floor}");
        }
    }
    if !below.is_empty() {
        return failed(below.join("; "));
    }
    let Counts {
        theorems,
        sampled,
        harnesses,
        covers,
        tests,
    } = counts;
    passed(format!(
        "{theorems} theorems, {sampled} sampled properties, {harnesses} harnesses, {covers} covers, {tests} tests"
    ))
}

/// What `proofs` declares.
#[derive(Debug, Default, PartialEq, Eq)]
struct Counts {
    theorems: u32,
    sampled: u32,
    harnesses: u32,
    covers: u32,
    tests: u32,
}

impl Counts {
    /// Sums the columns of the theorems' list, by the names in its first line.
    fn of(list: &str) -> Result<Self> {
        let mut rows = list
            .lines()
            .map(|line| line.split('\t').collect::<Vec<_>>());
        let head = rows.next().unwrap_or_default();
        let column = |name: &str| {
            let missing = || Error::Failed(format!("the theorems' list has no column {name}"));
            head.iter()
                .position(|&found| found == name)
                .ok_or_else(missing)
        };
        let (kind, harnesses) = (column("kind")?, column("harnesses")?);
        let (covers, tests) = (column("covers")?, column("tests")?);
        let mut counts = Self::default();
        for row in rows {
            let number = |at: usize| {
                row.get(at)
                    .and_then(|cell| cell.parse().ok())
                    .unwrap_or(0_u32)
            };
            let theorem = row.get(kind) == Some(&"theorem");
            counts.theorems += u32::from(theorem);
            counts.sampled += u32::from(!theorem);
            counts.harnesses += number(harnesses);
            counts.covers += number(covers);
            let named = row.get(tests).map_or(0, |cell| {
                cell.split(',').filter(|name| !name.is_empty()).count()
            });
            counts.tests += u32::try_from(named).unwrap_or(u32::MAX);
        }
        Ok(counts)
    }

    fn get(&self, key: &str) -> Option<u32> {
        match key {
            "theorems" => Some(self.theorems),
            "sampled" => Some(self.sampled),
            "harnesses" => Some(self.harnesses),
            "covers" => Some(self.covers),
            "tests" => Some(self.tests),
            _ => None,
        }
    }
}

pub fn kani(context: &mut Context) -> Result<Verdict> {
    match kani::version(&context.place) {
        None => skipped(kani::MISSING),
        Some(version) => {
            let figure = kani::prove(&context.place, Shard::ALL)?;
            passed(format!("{version}: {figure}"))
        }
    }
}

/// Every target on the same inputs each time, as far as the time goes; finding new ones is for the
/// night.
pub fn fuzz(context: &mut Context) -> Result<Verdict> {
    // The corpora hold what long runs learned; new ground is for `cargo xtask fuzz` and the night.
    const INPUTS: u32 = 500_000;
    const SECONDS: u32 = 30;
    let fuzzer = match Fuzzer::find(&context.place) {
        Err(Error::Missing(reason)) => return skipped(reason),
        found => found?,
    };
    fuzzer.build()?;
    let targets = fuzzer.targets()?;
    let done = fuzzer.run_all(&targets, Effort::Inputs(INPUTS, SECONDS));
    let mut broken = Vec::new();
    let (mut executions, mut edges, mut least) = (0, 0, u64::MAX);
    for (target, ran) in &done {
        match ran {
            Ok(figures) => {
                println!("  {target}: {figures}");
                executions += figures.executions;
                edges += figures.edges;
                least = least.min(figures.executions);
            }
            Err(error) => broken.push(error.to_string()),
        }
    }
    if broken.is_empty() {
        passed(format!(
            "{} targets, {executions} executions, {least} at least, {edges} edges reached",
            targets.len()
        ))
    } else {
        failed(broken.join("; "))
    }
}

/// Every seeded defect fits the code, and the table says nothing that is no longer so; the samples
/// are tried.
pub fn defects(context: &mut Context) -> Result<Verdict> {
    let all = defects::all(&context.place)?;
    let listed = defects::listed(&context.place, &all)?;
    let bench = Bench::set_up(&context.place, None)?;
    let mut caught = Vec::new();
    for defect in all.iter().filter(|defect| defect.sample) {
        println!("  {}: {}", defect.name, defect.what);
        bench.try_one(defect)?;
        caught.push(defect.name.as_str());
    }
    passed(format!(
        "{} fit the code, {listed} in the table; caught again: {}",
        all.len(),
        caught.join(", ")
    ))
}

/// The mutants of the lines that changed in the core; all of them are for the night.
pub fn mutants(context: &mut Context) -> Result<Verdict> {
    match mutants::of_the_change(&context.place)? {
        Said::Good(figure) => passed(figure),
        Said::Nothing(reason) => skipped(reason),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_theorems_columns_are_summed_by_name() {
        let list = "kind\tgroup\tarea\tproperty\tharnesses\tcovers\ttests\tneeds\n\
                    theorem\tT0\tunits\ta\t1\t3\texhaustive,sampled\t\n\
                    property\tT1\twire\tb\t2\t4\t\ta\n";
        let counts = Counts::of(list).unwrap();
        assert_eq!(
            counts,
            Counts {
                theorems: 1,
                sampled: 1,
                harnesses: 3,
                covers: 7,
                tests: 2
            }
        );
        assert!(Counts::of("").is_err());
    }
}
