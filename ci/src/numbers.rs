//! The two notations of figures that the gates compare: our budget (TOML) and the programs' reports
//! (JSON).

use std::collections::HashMap;

use tinyjson::JsonValue;

use crate::error::{failed, Error, Result};

/// `[section]` and `key = number` lines of a TOML file; keys may be dotted.
#[derive(Debug, Default)]
pub struct Budget {
    figures: Vec<(String, String, f64)>,
}

impl Budget {
    /// # Errors
    /// Names the line that is neither a section, a figure nor a comment, or says again what one above it
    /// does: of two bars it is not clear which holds.
    pub fn parse(text: &str) -> Result<Self> {
        let mut budget = Self::default();
        let mut section = String::new();
        for (number, line) in text.lines().enumerate() {
            let line = line.split('#').next().unwrap_or("").trim();
            if let Some(name) = line
                .strip_prefix('[')
                .and_then(|line| line.strip_suffix(']'))
            {
                name.trim().clone_into(&mut section);
            } else if let Some((key, value)) = line.split_once('=') {
                let value = value.trim().replace('_', "").parse();
                let value = value.map_err(|_| bad_line(number, line))?;
                let key = key.trim();
                if budget.section(&section).any(|(known, _)| known == key) {
                    let number = number + 1;
                    return failed(format!(
                        "ci/budget.toml:{number}: {key} for the second time"
                    ));
                }
                budget
                    .figures
                    .push((section.clone(), key.to_owned(), value));
            } else if !line.is_empty() {
                return Err(bad_line(number, line));
            }
        }
        Ok(budget)
    }

    /// The keys and figures of one section.
    pub fn section<'a>(&'a self, name: &'a str) -> impl Iterator<Item = (&'a str, f64)> + 'a {
        let of_section = self
            .figures
            .iter()
            .filter(move |(section, _, _)| section == name);
        of_section.map(|(_, key, figure)| (key.as_str(), *figure))
    }

    /// Holds `report` against the sections `NAME.at_most` and `NAME.at_least`: how many bars there
    /// are.
    ///
    /// # Errors
    /// Every bar that is missed or has no figure in the report.
    pub fn hold(&self, name: &str, report: &Report) -> Result<usize> {
        let mut missed = Vec::new();
        let mut bars = 0;
        for (bound, at_most) in [("at_most", true), ("at_least", false)] {
            for (key, bar) in self.section(&format!("{name}.{bound}")) {
                bars += 1;
                match report.figure(key) {
                    None => missed.push(format!("{key} is not in the report")),
                    Some(figure) if (at_most && figure <= bar) || (!at_most && figure >= bar) => {}
                    Some(figure) => missed.push(format!(
                        "{key} is {figure}, the bar is {} {bar}",
                        if at_most { "at most" } else { "at least" },
                    )),
                }
            }
        }
        match (missed.is_empty(), bars) {
            (true, 0) => failed(format!("ci/budget.toml has no bar for {name}")),
            (true, bars) => Ok(bars),
            (false, _) => failed(missed.join("; ")),
        }
    }
}

fn bad_line(number: usize, line: &str) -> Error {
    Error::Failed(format!(
        "ci/budget.toml:{}: not `key = number`: {line}",
        number + 1
    ))
}

/// A report of one of our programs.
pub struct Report(JsonValue);

impl Report {
    /// # Errors
    /// Where the text is no JSON.
    pub fn parse(text: &str) -> Result<Self> {
        let value = text.parse::<JsonValue>();
        value
            .map(Self)
            .map_err(|error| Error::Failed(format!("the report is no JSON: {error}")))
    }

    /// The number at a dotted path; of a list, how long it is.
    pub fn figure(&self, path: &str) -> Option<f64> {
        let mut value = &self.0;
        for key in path.split('.') {
            value = value.get::<HashMap<String, JsonValue>>()?.get(key)?;
        }
        match value {
            JsonValue::Number(number) => Some(*number),
            #[expect(clippy::cast_precision_loss, reason = "nobody lists 2^52 registers")]
            JsonValue::Array(list) => Some(list.len() as f64),
            _ => None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const BUDGET: &str = "# bars\n[demo.at_most]\nerror_mm = 30 # of 25 m\nregisters = 0\n\
                          [demo.at_least]\ntick.mean = 2_000\n";

    #[test]
    fn a_bar_that_is_missed_or_unmeasured_is_named() {
        let budget = Budget::parse(BUDGET).unwrap();
        let report = |text: &str| Report::parse(text).unwrap();
        let good = report(r#"{"error_mm": 3.5, "registers": [], "tick": {"mean": 2000}}"#);
        assert_eq!(budget.hold("demo", &good).unwrap(), 3);
        let bad = report(r#"{"error_mm": 30.5, "registers": ["TIM9"], "tick": 1}"#);
        let why = budget.hold("demo", &bad).unwrap_err().to_string();
        assert!(
            why.contains("error_mm is 30.5, the bar is at most 30"),
            "{why}"
        );
        assert!(why.contains("registers is 1"), "{why}");
        assert!(why.contains("tick.mean is not in the report"), "{why}");
        assert!(
            budget.hold("figures", &good).is_err(),
            "no bars are not good bars"
        );
    }

    #[test]
    fn a_line_that_is_no_figure_is_named() {
        let why = Budget::parse("[a]\nb = many\n").unwrap_err().to_string();
        assert!(why.contains(":2:"), "{why}");
        let twice = "[a]\nb = 1\n[c]\nb = 1\nb = 2\n";
        let why = Budget::parse(twice).unwrap_err().to_string();
        assert!(why.contains(":5: b for the second time"), "{why}");
    }
}
