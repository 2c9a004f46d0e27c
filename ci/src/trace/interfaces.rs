//! `docs/interfaces.md`: each section says which requirements it is the text of, or that it is background.

use super::Requirements;

/// Its path.
pub const NAME: &str = "docs/interfaces.md";

/// What begins the paragraph of a section's requirements; they follow, parted by commas, several in turn
/// as the first of them and the last one's number: `DOC-1-1 to 3`.
const MARK: &str = "Requirements: ";
/// What begins a paragraph that says why a section demands nothing.
const BACKGROUND: &str = "Background: ";

/// From one heading to the next.
#[derive(Default)]
struct Section {
    name: String,
    line: usize,
    has_text: bool,
    accounted: bool,
}

impl Section {
    fn end(&self, wrong: &mut Vec<String>) {
        if self.has_text && !self.accounted {
            wrong.push(format!(
                "{NAME}:{}: \"{}\" names no requirement and is not marked as background",
                self.line, self.name
            ));
        }
    }
}

/// Notes the sections' requirements. Every `WIRE-…` must be some section's.
pub fn read(page: &str, requirements: &mut Requirements, wrong: &mut Vec<String>) {
    let mut section = Section::default();
    let mut cites = false;
    for (line, number) in page.lines().zip(1..) {
        if let Some(name) = line.strip_prefix('#') {
            section.end(wrong);
            section = Section {
                name: name.trim_start_matches(['#', ' ']).to_owned(),
                line: number,
                ..Section::default()
            };
            continue;
        }
        let ids = line.strip_prefix(MARK);
        cites = ids.is_some() || cites && !line.is_empty();
        section.accounted |= cites || line.starts_with(BACKGROUND);
        section.has_text |= !line.is_empty();
        if !cites {
            continue;
        }
        let ids = ids.unwrap_or(line).trim_end_matches([',', '.']);
        for id in ids.split(',').flat_map(|item| in_turn(item.trim())) {
            match requirements.get_mut(&id) {
                Some(requirement) => requirement.sections.push(section.name.clone()),
                None => wrong.push(format!("{NAME}:{number}: {id} is no requirement")),
            }
        }
    }
    section.end(wrong);
    for (id, requirement) in requirements {
        if id.starts_with("WIRE-") && requirement.sections.is_empty() {
            wrong.push(format!("{id}: no section of {NAME} is its text"));
        }
    }
}

/// The requirements that an item of a list stands for.
fn in_turn(item: &str) -> Vec<String> {
    let several = || {
        let (first, last) = item.split_once(" to ")?;
        let (group, from) = first.rsplit_once('-')?;
        let (from, to): (u32, u32) = (from.parse().ok()?, last.parse().ok()?);
        Some((from..=to).map(|n| format!("{group}-{n}")).collect())
    };
    several().unwrap_or_else(|| vec![item.to_owned()])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::trace::Requirement;

    fn judged(page: &str) -> (Requirements, Vec<String>) {
        let ids = ["DOC-1-1", "WIRE-a-1", "WIRE-a-2"];
        let mut requirements: Requirements = ids
            .into_iter()
            .map(|id| (id.to_owned(), Requirement::default()))
            .collect();
        let mut wrong = Vec::new();
        read(page, &mut requirements, &mut wrong);
        (requirements, wrong)
    }

    #[test]
    fn requirements_belong_to_the_section_that_names_them() {
        let (found, wrong) = judged(
            "# Title\n\nBackground: words.\n\n## A\n\n### B\n\nIt does.\n\n\
             Requirements: WIRE-a-1, DOC-1-1,\nWIRE-a-2.\n\nMore, and no list.\n\n\
             ## C\n\nRequirements: WIRE-a-1 to 2\n",
        );
        assert!(wrong.is_empty(), "{wrong:?}");
        assert_eq!(found["DOC-1-1"].sections, ["B"]);
        assert_eq!(found["WIRE-a-1"].sections, ["B", "C"]);
        assert_eq!(found["WIRE-a-2"].sections, ["B", "C"]);
    }

    #[test]
    fn a_requirement_without_a_text_and_a_text_without_one_are_named() {
        let (_, wrong) = judged(
            "# Title\n\nWords.\n\n## A\n\nRequirements: WIRE-a-1, WIRE-a-3 to 3, none\n\n## B\n\n| a | table |\n",
        );
        let expected = [
            format!("{NAME}:1: \"Title\" names no requirement and is not marked as background"),
            format!("{NAME}:7: WIRE-a-3 is no requirement"),
            format!("{NAME}:7: none is no requirement"),
            format!("{NAME}:9: \"B\" names no requirement and is not marked as background"),
            format!("WIRE-a-2: no section of {NAME} is its text"),
        ];
        assert_eq!(wrong, expected);
    }
}
