//! `docs/requirements.md`: the rows, and whether they account for the whole original document.

use super::{Requirement, Requirements};
use crate::error::{failed, Result};

/// Its path.
pub const NAME: &str = "docs/requirements.md";

/// Every section of the original document that has a text of its own.
const DOCUMENT: [&str; 25] = [
    "1", "2.1", "2.2", "2.3", "3.1", "3.2", "3.3", "4", "4.1", "5", "5.1", "5.1.1", "5.1.2",
    "5.1.3", "5.1.4", "5.1.5", "5.1.6", "5.2", "5.2.1", "5.2.2", "5.2.3", "6", "6.0.1", "6.0.2",
    "6.0.3",
];

/// The requirements of the page: `| ID | what it says |`. A section of the document stands in the
/// middle of a `DOC-…` row's name, or in a row of what is no requirement: `| section | what | why |`.
///
/// # Errors
/// Where there is none, or one stands there twice.
pub fn read(page: &str, wrong: &mut Vec<String>) -> Result<Requirements> {
    let mut requirements = Requirements::new();
    let mut accounted = Vec::new();
    for line in page.lines() {
        let cells: Vec<&str> = line.split('|').map(str::trim).collect();
        match cells[..] {
            ["", id, text, ""] if is_name(id) => {
                accounted.extend(section(id));
                let requirement = Requirement {
                    text: text.to_owned(),
                    ..Requirement::default()
                };
                if requirements.insert(id.to_owned(), requirement).is_some() {
                    return failed(format!("{NAME}: {id} stands there twice"));
                }
            }
            ["", section, _, _, ""] if section.starts_with(|c: char| c.is_ascii_digit()) => {
                accounted.push(section);
            }
            _ => {}
        }
    }
    if requirements.is_empty() {
        return failed(format!("{NAME} has no requirement"));
    }
    for section in DOCUMENT {
        if !accounted.contains(&section) {
            wrong.push(format!(
                "{NAME}: nothing is said of the document's section {section}"
            ));
        }
    }
    accounted.retain(|section| !DOCUMENT.contains(section));
    accounted.dedup();
    for section in accounted {
        wrong.push(format!("{NAME}: the document has no section {section}"));
    }
    Ok(requirements)
}

fn is_name(id: &str) -> bool {
    id.starts_with("DOC-") || id.starts_with("WIRE-")
}

/// The section of the document that a requirement of it is taken from.
fn section(id: &str) -> Option<&str> {
    let (section, _) = id.strip_prefix("DOC-")?.rsplit_once('-')?;
    Some(section)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A page with a row for each section but these.
    fn without(left_out: &[&str]) -> String {
        DOCUMENT
            .iter()
            .filter(|section| !left_out.contains(section))
            .fold("# Requirements\n\n".to_owned(), |page, section| {
                page + &format!("| DOC-{section}-1 | It does. |\n")
            })
    }

    fn judged(page: &str) -> Vec<String> {
        let mut wrong = Vec::new();
        read(page, &mut wrong).unwrap();
        wrong
    }

    #[test]
    fn a_section_of_the_document_that_nobody_speaks_of_is_named() {
        assert!(judged(&without(&[])).is_empty());
        let page = without(&["4", "5.1.3"]);
        let missing =
            |section| format!("{NAME}: nothing is said of the document's section {section}");
        assert_eq!(judged(&page), ["4", "5.1.3"].map(missing));
        let told = page + "| 4 | the chapter | a title |\n| 5.1.3 | the union | a means |\n";
        assert!(judged(&told).is_empty());
    }

    #[test]
    fn a_section_that_the_document_does_not_have_is_named() {
        let page = without(&[]) + "| DOC-5.1.7-1 | It does. |\n| 9 | this | that |\n";
        let none = |section| format!("{NAME}: the document has no section {section}");
        assert_eq!(judged(&page), ["5.1.7", "9"].map(none));
    }

    #[test]
    fn a_page_without_requirements_or_with_one_twice_is_none() {
        assert!(read("# Requirements\n", &mut Vec::new()).is_err());
        assert!(read(&without(&[]).repeat(2), &mut Vec::new()).is_err());
    }
}
