//! The bars of `ci/budget.toml`, and the reports that are held against them.

use serde_json::Value;
use toml::Table;

use crate::error::{bail, ensure, Context, Result};
use crate::workspace::Workspace;

/// Sections `NAME.at_most` and `NAME.at_least` of figures.
pub struct Budget(Table);

impl Budget {
    pub fn read(workspace: &Workspace) -> Result<Self> {
        Self::parse(&workspace.read("ci/budget.toml")?)
    }

    pub fn parse(text: &str) -> Result<Self> {
        text.parse().map(Self).context("ci/budget.toml")
    }

    /// A section's value, by dotted path.
    pub fn value(&self, path: &str) -> Result<&toml::Value> {
        let mut keys = path.split('.');
        let first = keys.next().and_then(|key| self.0.get(key));
        let value = keys.try_fold(first, |value, key| value.map(|value| value.get(key)));
        value
            .flatten()
            .with_context(|| format!("ci/budget.toml has no {path}"))
    }

    /// One bar.
    pub fn figure(&self, path: &str) -> Result<f64> {
        let value = number(self.value(path)?);
        value.with_context(|| format!("ci/budget.toml: {path} is no number"))
    }

    /// Compares `report` with every bar of `name`; returns how many there are. An error names every
    /// bar that is missed or has no figure in the report.
    pub fn check(&self, name: &str, report: &Report) -> Result<usize> {
        let (mut bars, mut missed) = (0, Vec::new());
        let sections = self
            .0
            .get(name)
            .and_then(toml::Value::as_table)
            .into_iter()
            .flatten();
        for (bound, section) in sections {
            let at_most = match bound.as_str() {
                "at_most" => true,
                "at_least" => false,
                _ => bail!("ci/budget.toml: {name}.{bound} is neither at_most nor at_least"),
            };
            for (path, bar) in leaves(section) {
                let bar = bar.with_context(|| format!("ci/budget.toml: {path} is no number"))?;
                bars += 1;
                match report.figure(&path) {
                    None => missed.push(format!("{path} is not in the report")),
                    Some(figure)
                        if if at_most {
                            figure <= bar
                        } else {
                            figure >= bar
                        } => {}
                    Some(figure) => {
                        let bound = bound.replace('_', " ");
                        missed.push(format!("{path} is {figure}, the bar is {bound} {bar}"));
                    }
                }
            }
        }
        ensure!(missed.is_empty(), "{}", missed.join("; "));
        ensure!(bars > 0, "ci/budget.toml has no bar for {name}");
        Ok(bars)
    }
}

fn number(value: &toml::Value) -> Option<f64> {
    #[expect(clippy::cast_precision_loss, reason = "bars are far below 2^52")]
    value
        .as_float()
        .or_else(|| value.as_integer().map(|whole| whole as f64))
}

/// The figures of a table and of the tables in it, by dotted path.
fn leaves(value: &toml::Value) -> Vec<(String, Option<f64>)> {
    let Some(table) = value.as_table() else {
        return vec![(String::new(), number(value))];
    };
    let entries = table.iter().flat_map(|(key, value)| {
        let below = leaves(value).into_iter();
        below.map(move |(path, figure)| match path.as_str() {
            "" => (key.clone(), figure),
            path => (format!("{key}.{path}"), figure),
        })
    });
    entries.collect()
}

/// A report of one of our programs, or figures of this one.
pub struct Report(pub Value);

impl Report {
    pub fn parse(text: &str) -> Result<Self> {
        serde_json::from_str(text)
            .map(Self)
            .context("the report is no JSON")
    }

    /// The number at a dotted path; of a list, its length.
    pub fn figure(&self, path: &str) -> Option<f64> {
        let value = path
            .split('.')
            .try_fold(&self.0, |value, key| value.get(key))?;
        #[expect(clippy::cast_precision_loss, reason = "lists are shorter than 2^52")]
        value
            .as_f64()
            .or_else(|| value.as_array().map(|list| list.len() as f64))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bar_missed_or_unmeasured_is_named() {
        let budget = "# bars\n[demo.at_most]\nerror_mm = 30 # of 25 m\nregisters = 0\n\
                      [demo.at_least]\ntick.mean = 2_000\n";
        let budget = Budget::parse(budget).unwrap();
        let check = |name: &str, report: &str| budget.check(name, &Report::parse(report).unwrap());
        let good = r#"{"error_mm": 3.5, "registers": [], "tick": {"mean": 2000}}"#;
        assert_eq!(check("demo", good).unwrap(), 3);
        let bad = check(
            "demo",
            r#"{"error_mm": 30.5, "registers": ["TIM9"], "tick": 1}"#,
        );
        let expected = "tick.mean is not in the report; error_mm is 30.5, the bar is at most 30; \
                        registers is 1, the bar is at most 0";
        assert_eq!(bad.unwrap_err().to_string(), expected);
        let none = check("figures", good).unwrap_err().to_string();
        assert_eq!(none, "ci/budget.toml has no bar for figures");
        assert_eq!(
            budget
                .figure("demo.at_least.tick.mean")
                .unwrap()
                .to_string(),
            "2000"
        );
        assert!(budget.figure("demo.at_least.tock").is_err());
    }

    #[test]
    fn budget_with_a_bar_twice_is_rejected() {
        assert!(Budget::parse("[a]\nb = 1\nb = 2\n").is_err());
        assert!(Budget::parse("[a]\nb = many\n").is_err());
    }
}
