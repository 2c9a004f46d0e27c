//! The trace of requirements: each stands as a row of `docs/requirements.md`, has its text in the original
//! document or in a section of `docs/interfaces.md`, and is cited above the code that meets it and above
//! the test or property that checks it.

mod interfaces;
mod page;
mod source;

use std::collections::BTreeMap;

use crate::error::{failed, Of, Result};
use crate::gates::sources;
use crate::place::Place;

/// A requirement, and where it is cited, as `file:line`.
#[derive(Debug, Default, PartialEq, Eq)]
pub struct Requirement {
    /// What it says.
    pub text: String,
    /// The sections of `docs/interfaces.md` that it is taken from.
    pub sections: Vec<String>,
    /// Above code that meets it.
    pub code: Vec<String>,
    /// Above what checks that code.
    pub checks: Vec<String>,
}

/// The requirements by their names.
pub type Requirements = BTreeMap<String, Requirement>;

/// Reads both pages and every citation.
///
/// # Errors
/// Names all requirements that nobody meets or checks or that are nobody's text, all sections of either
/// document that are not accounted for, and all citations of what is none.
pub fn trace(place: &Place) -> Result<Requirements> {
    let mut wrong = Vec::new();
    let mut requirements = page::read(&place.read(page::NAME)?, &mut wrong)?;
    interfaces::read(
        &place.read(interfaces::NAME)?,
        &mut requirements,
        &mut wrong,
    );
    let mut files = Vec::new();
    sources(&place.root, &place.target, &mut files)?;
    for file in files {
        let name = place.short(&file).to_string();
        let source = std::fs::read_to_string(&file).of(&name)?;
        source::read(&name, &source, &mut requirements, &mut wrong);
    }
    for (id, requirement) in &requirements {
        if requirement.code.is_empty() {
            wrong.push(format!("{id}: no code cites it"));
        }
        if requirement.checks.is_empty() {
            wrong.push(format!("{id}: no test or property cites it"));
        }
    }
    for line in &wrong {
        println!("  {line}");
    }
    match wrong.first() {
        None => Ok(requirements),
        Some(first) => failed(format!("{} finding(s), the first: {first}", wrong.len())),
    }
}

/// Prints each requirement with its citations.
pub fn print(requirements: &Requirements) {
    for (id, requirement) in requirements {
        println!("{id}: {}", requirement.text);
        if !requirement.sections.is_empty() {
            println!("    text in     {}", requirement.sections.join(", "));
        }
        println!("    met in      {}", requirement.code.join(", "));
        println!("    checked in  {}", requirement.checks.join(", "));
    }
}
