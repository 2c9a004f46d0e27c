//! What is tested with what.

use std::path::Path;

use anyhow::{Context, Error, Result, bail};
use serde::Deserialize;

use crate::excuses::Excuses;
use crate::operators;

/// A configuration, see the README.
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(deny_unknown_fields, rename_all = "kebab-case")]
pub struct Config {
    /// The package whose code is changed.
    pub package: String,
    /// The file of the excuses, from the configuration's folder.
    pub excuses: Option<String>,
    /// Parts of the paths of files that are not changed: what only tests use, or this machine does not build.
    #[serde(default)]
    pub without: Vec<String>,
    /// Parts of the names of tests that take long: left out of the first stage.
    #[serde(default)]
    pub slow: Vec<String>,
    /// Packages whose tests are asked last.
    #[serde(default)]
    pub also: Vec<String>,
    /// Operators beside those of cargo-mutants, see `operators::NAMES`.
    #[serde(default)]
    pub operators: Vec<String>,
    /// Arguments of every `cargo test`.
    #[serde(default)]
    pub cargo_args: Vec<String>,
    /// For a package without tests of its own.
    pub judge: Option<Judge>,
}

/// Commands, words parted by spaces, that run in the copy of the workspace with a mutant in it.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Judge {
    /// Fails where the mutant does not compile.
    pub build: String,
    /// Fails where the mutant is noticed.
    pub test: String,
}

/// Tests that see a mutant together; what they let pass goes to the next stage.
#[derive(Debug, PartialEq, Eq)]
pub struct Stage {
    /// Packages whose tests these are.
    pub packages: Vec<String>,
    /// Whether with those in `tests/`.
    pub all: bool,
    /// Parts of the names of tests that are left out.
    pub skip: Vec<String>,
}

impl Stage {
    /// The tests of these packages but those with these parts in their names; `all` with those in `tests/`.
    pub fn of(packages: &[String], all: bool, skip: &[String]) -> Self {
        Self {
            packages: packages.to_vec(),
            all,
            skip: skip.to_vec(),
        }
    }
}

impl Config {
    /// Reads a configuration and its excuses.
    ///
    /// # Errors
    /// Names the file, and what is wrong in it.
    pub fn read(path: &Path) -> Result<(Self, Excuses)> {
        fn parse<T>(path: &Path, parse: impl Fn(&str) -> Result<T>) -> Result<T> {
            let parsed = std::fs::read_to_string(path).map_err(Error::from);
            let parsed = parsed.and_then(|text| parse(&text));
            parsed.with_context(|| path.display().to_string())
        }
        let config: Self = parse(path, |text| Ok(toml::from_str(text)?))?;
        let known = |name: &str| operators::NAMES.iter().any(|(known, _)| *known == name);
        if let Some(unknown) = config.operators.iter().find(|name| !known(name)) {
            bail!("{}: no operator {unknown}", path.display());
        }
        let Some(file) = &config.excuses else {
            return Ok((config, Excuses::default()));
        };
        let file = path.parent().unwrap_or(Path::new("")).join(file);
        Ok((config, parse(&file, Excuses::parse)?))
    }

    /// The stages: the quick tests beside the code, all tests of the package, other packages'.
    pub fn stages(&self) -> Vec<Stage> {
        let own = [self.package.clone()];
        let mut stages = vec![
            Stage::of(&own, false, &self.slow),
            Stage::of(&own, true, &[]),
        ];
        if !self.also.is_empty() {
            stages.push(Stage::of(&self.also, true, &[]));
        }
        stages
    }
}
