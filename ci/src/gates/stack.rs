//! The gate on the stack: computed from the ELFs, held against what is reserved and what runs used.

use super::{passed, Context, Verdict};
use crate::error::{failed, Of, Result};
use crate::firmware::Edition;
use crate::numbers::Report;
use crate::stack;

/// The key of a run's report under which it says how much of the stack it has used, bytes.
const USED: &str = "stack_used_bytes";

/// The worst case against what is reserved and against its budget.
pub fn stack(context: &mut Context) -> Result<Verdict> {
    let budget = context.budget()?;
    let mut told = Vec::new();
    for edition in Edition::ALL {
        let report = worst_case(context, edition)?;
        println!("  {}", edition.name());
        println!("{report}");
        let (worst, reserved) = (report.worst(), report.reserved);
        if worst > reserved {
            return failed(format!(
                "{}: the stack can come to {worst} bytes, reserved are {reserved}",
                edition.name()
            ));
        }
        for (key, bar) in budget.section("stack.at_most") {
            match key {
                "worst_bytes" if f64::from(worst) <= bar => {}
                "worst_bytes" => {
                    return failed(format!(
                        "{}: the stack can come to {worst} bytes, the budget is {bar}",
                        edition.name()
                    ))
                }
                _ => return failed(format!("ci/budget.toml: stack has no figure {key}")),
            }
        }
        told.push(format!(
            "{worst} of {reserved} bytes in {} routines",
            report.routines
        ));
    }
    passed(format!("at most {}", told[0]))
}

fn worst_case(context: &mut Context, edition: Edition) -> Result<stack_bound::Report> {
    let path = context.edition(edition)?.path.clone();
    let bytes = std::fs::read(&path).of(path.display())?;
    stack::worst_case(&bytes)
}

/// The stack that a run of the full firmware has used against the worst that is computed for it: a
/// computation below what happens is wrong. Both, in bytes.
pub fn holds(context: &mut Context, run: &Report) -> Result<(f64, u32)> {
    let worst = worst_case(context, Edition::Full)?.worst();
    match run.figure(USED) {
        Some(used) if used > 0.0 && used <= f64::from(worst) => Ok((used, worst)),
        Some(used) => failed(format!(
            "the run used {used} bytes of stack, computed are at most {worst}"
        )),
        None => failed(format!("{USED} is not in the report")),
    }
}
