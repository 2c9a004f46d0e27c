//! Gates on the proofs: how many there are, Kani, the fuzz targets.

use super::{passed, skipped, Context, Verdict};
use crate::code;
use crate::demand;
use crate::error::{failed, Of, Result};

/// What the proofs folder holds.
#[derive(Debug, Default, PartialEq, Eq)]
struct Counts {
    harnesses: usize,
    covers: usize,
    /// Harnesses that nothing shows to be satisfiable.
    uncovered: Vec<String>,
}

pub fn floors(context: &mut Context) -> Result<Verdict> {
    let mut files = Vec::new();
    let folder = context.place.root.join("proofs");
    super::hygiene::sources(&folder, &context.place.target, &mut files)?;
    let mut sum = Counts::default();
    for file in files {
        let counts = count(&code::bare(
            &std::fs::read_to_string(&file).of(file.display())?,
        ));
        sum.harnesses += counts.harnesses;
        sum.covers += counts.covers;
        sum.uncovered.extend(counts.uncovered);
    }
    let budget = context.budget()?;
    for (key, floor) in budget.section("proofs.at_least") {
        let number = match key {
            "harnesses" => sum.harnesses,
            "covers" => sum.covers,
            _ => return failed(format!("ci/budget.toml: proofs has no figure {key}")),
        };
        #[expect(clippy::cast_precision_loss, reason = "nobody writes 2^52 proofs")]
        let number = number as f64;
        if number < floor {
            return failed(format!(
                "{number} {key}, the floor of ci/budget.toml is {floor}"
            ));
        }
        if number > floor {
            println!("  {number} {key}: raise the floor of ci/budget.toml from {floor}");
        }
    }
    if !sum.uncovered.is_empty() {
        return failed(format!("no kani::cover! in {}", sum.uncovered.join(", ")));
    }
    passed(format!(
        "{} harnesses, {} covers",
        sum.harnesses, sum.covers
    ))
}

fn count(bare: &str) -> Counts {
    let mut counts = Counts {
        covers: bare.matches("kani::cover!").count(),
        ..Counts::default()
    };
    let attributes = ["#[kani::proof]", "#[kani::proof_for_contract"];
    for attribute in attributes {
        for (at, _) in bare.match_indices(attribute) {
            counts.harnesses += 1;
            let harness = &bare[at..];
            if !code::body(harness).contains("kani::cover!") {
                let name = harness
                    .split("fn ")
                    .nth(1)
                    .and_then(|rest| rest.split('(').next());
                counts
                    .uncovered
                    .push(name.unwrap_or("a harness").trim().to_owned());
            }
        }
    }
    counts
}

pub fn kani(context: &mut Context) -> Result<Verdict> {
    match demand::kani_version(&context.place) {
        None => skipped(demand::NO_KANI),
        Some(version) => passed(format!("{version}: {}", demand::prove(&context.place)?)),
    }
}

pub fn fuzz(context: &mut Context) -> Result<Verdict> {
    const SECONDS: u32 = 10;
    if let Some(reason) = demand::no_fuzz(&context.place) {
        return skipped(reason);
    }
    let targets = demand::fuzz_targets(&context.place)?;
    for target in &targets {
        demand::fuzz_one(&context.place, target, SECONDS)?;
    }
    passed(format!("{} targets, {SECONDS} s each", targets.len()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn harnesses_without_a_cover_are_named() {
        let text = "\
#[kani::proof] #[kani::unwind(3)] fn covered() { let a = kani::any(); kani::cover!(a > 0); }
#[kani::proof]\nfn bare() { assert!(true); }
#[kani::proof_for_contract(f)] fn contract() { kani::cover!(true); }";
        let counts = count(text);
        assert_eq!((counts.harnesses, counts.covers), (3, 2));
        assert_eq!(counts.uncovered, ["bare"]);
    }
}
