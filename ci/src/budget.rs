//! The bars of `ci/budget.toml`, and the reports that are compared with them.

use serde_json::Value;

use crate::error::{Context, Result, bail, ensure};
use crate::workspace::Workspace;

/// Sections `NAME.at_most` and `NAME.at_least` of figures.
pub struct Budget(Value);

impl Budget {
    pub fn read(workspace: &Workspace) -> Result<Self> {
        Self::parse(&workspace.sh.read_file("ci/budget.toml")?)
    }

    fn parse(text: &str) -> Result<Self> {
        toml::from_str(text).map(Self).context("ci/budget.toml")
    }

    /// What stands at a dotted path.
    pub fn value(&self, path: &str) -> Result<&Value> {
        at(&self.0, path).with_context(|| format!("ci/budget.toml has no {path}"))
    }

    /// Compares `report` with every bar of `name`; returns how many there are. An error names every
    /// bar that is missed or has no figure in the report.
    pub fn check(&self, name: &str, report: &Value) -> Result<usize> {
        let (mut bars, mut missed) = (0, Vec::new());
        for (bound, section) in self.0[name].as_object().into_iter().flatten() {
            for (path, bar) in leaves(section, "") {
                bars += 1;
                let bar = bar.with_context(|| format!("ci/budget.toml: {path} is no number"))?;
                let figure = figure(report, &path);
                let (good, bound) = match bound.as_str() {
                    "at_most" => (figure.is_some_and(|figure| figure <= bar), "at most"),
                    "at_least" => (figure.is_some_and(|figure| figure >= bar), "at least"),
                    _ => bail!("ci/budget.toml: {name}.{bound} is neither at_most nor at_least"),
                };
                if !good {
                    let figure = figure.map_or("unknown".into(), |figure| figure.to_string());
                    missed.push(format!("{path} is {figure}, the bar is {bound} {bar}"));
                }
            }
        }
        ensure!(missed.is_empty(), missed.join("; "));
        ensure!(bars > 0, "ci/budget.toml has no bar for {name}");
        Ok(bars)
    }
}

fn at<'v>(value: &'v Value, path: &str) -> Option<&'v Value> {
    path.split('.').try_fold(value, |value, key| value.get(key))
}

/// The number at a dotted path of a report; of a list, its length; 1 and 0 for true and false.
pub fn figure(report: &Value, path: &str) -> Option<f64> {
    let value = at(report, path)?;
    #[expect(clippy::cast_precision_loss, reason = "lists are shorter than 2^52")]
    value
        .as_f64()
        .or_else(|| Some(value.as_array()?.len() as f64))
        .or_else(|| value.as_bool().map(|flag| f64::from(u8::from(flag))))
}

/// Every figure of a section and of the tables in it, by dotted path.
fn leaves(value: &Value, path: &str) -> Vec<(String, Option<f64>)> {
    let Some(table) = value.as_object() else {
        return vec![(path.to_owned(), value.as_f64())];
    };
    let below = |(key, value)| leaves(value, format!("{path}.{key}").trim_start_matches('.'));
    table.iter().flat_map(below).collect()
}

#[test]
fn bar_missed_or_unmeasured_is_named() {
    let budget = "# bars\n[demo.at_most]\nerror_mm = 30 # of 25 m\nregisters = 0\n\
                  [demo.at_least]\ntick.mean = 2_000\n";
    let budget = Budget::parse(budget).unwrap();
    let check = |name: &str, report: &str| {
        let checked = budget.check(name, &serde_json::from_str(report).unwrap());
        checked.map_err(|error| error.to_string())
    };
    let good = r#"{"error_mm": 3.5, "registers": [], "tick": {"mean": 2000}}"#;
    assert_eq!(check("demo", good), Ok(3));
    let bad = r#"{"error_mm": 30.5, "registers": ["TIM9"], "tick": 1}"#;
    let expected = "tick.mean is unknown, the bar is at least 2000; error_mm is 30.5, the bar is at \
                    most 30; registers is 1, the bar is at most 0";
    assert_eq!(check("demo", bad), Err(expected.into()));
    let none = "ci/budget.toml has no bar for figures";
    assert_eq!(check("figures", good), Err(none.into()));
    assert_eq!(budget.value("demo.at_least.tick.mean").unwrap(), 2000);
    assert!(budget.value("demo.at_least.tock").is_err());
    assert!(Budget::parse("[a]\nb = 1\nb = 2\n").is_err());
}
