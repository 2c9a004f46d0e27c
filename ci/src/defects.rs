//! Seeded defects: code made wrong on purpose where no mutant can stand (registers, the ELF, the
//! stack, the Pi), to see that some gate notices. They are in `ci/defects.toml`.

use std::collections::BTreeMap;
use std::path::Path;

use regex_lite::escape;
use serde::Deserialize;
use xshell::Cmd;

use crate::elf::{Elf, banned};
use crate::error::{Context, Kind, Result, bail, ensure, fail};
use crate::process::{self, pattern};
use crate::session::Session;
use crate::stack;

const FILE: &str = "ci/defects.toml";

#[derive(Deserialize)]
#[serde(deny_unknown_fields, rename_all = "kebab-case")]
pub struct Defect {
    name: String,
    /// What is wrong with it, one sentence.
    description: String,
    /// The file, from the workspace's root.
    file: String,
    /// Code that the file has once, white space aside.
    from: String,
    /// What is there instead.
    to: String,
    /// Who must notice: `elf`, `stack`, `loop FILE FILTER`, or a package and a filter of its tests.
    noticed_by: String,
    /// Requirements that it violates: the test of `noticed-by` cites them.
    #[serde(default)]
    requirements: Vec<String>,
    /// Whether every `cargo xtask test` tries it.
    #[serde(default)]
    pub sample: bool,
}

/// Every defect; each must fit its file.
pub fn all(session: &Session) -> Result<Vec<Defect>> {
    let defects = parse(&session.sh.read_file(FILE)?).context(FILE)?;
    for defect in &defects {
        let source = session.sh.read_file(&defect.file)?;
        let changes = defect.applied(&source)? != source;
        ensure!(changes, "{} changes nothing", defect.name);
        defect.check_citations(session)?;
    }
    Ok(defects)
}

fn parse(text: &str) -> Result<Vec<Defect>> {
    let mut file: BTreeMap<String, Vec<Defect>> = toml::from_str(text)?;
    file.remove("defect").context("no defect")
}

impl Defect {
    /// The test that must notice it cites the requirements.
    fn check_citations(&self, session: &Session) -> Result<()> {
        let [Some(file), Some(test)] = [1, 2].map(|nth| self.noticed_by.split(' ').nth(nth)) else {
            return Ok(());
        };
        for id in &self.requirements {
            let source = session.sh.read_file(format!("tests/tests/{file}.rs"))?;
            let word = escape(id);
            let cited = format!(r"// Requirement: .*\b{word}\b.*\n(//.*\n)*#\[test\]\nfn {test}\b");
            let found = pattern(&cited).is_match(&source);
            ensure!(found, "{}: {test} does not cite {id}", self.name);
        }
        Ok(())
    }

    /// The file's text with the defect in it.
    fn applied(&self, source: &str) -> Result<String> {
        let letters = self.from.chars().filter(|letter| !letter.is_whitespace());
        let letters: Vec<_> = letters.map(|letter| escape(&letter.to_string())).collect();
        let from = pattern(&letters.join(r"\s*"));
        let places: Vec<_> = from.find_iter(source).map(|place| place.range()).collect();
        let [place] = &places[..] else {
            let (count, Self { name, file, .. }) = (places.len(), self);
            bail!("{name}: its code is {count} times in {file}");
        };
        Ok([&source[..place.start], &self.to, &source[place.end..]].concat())
    }

    /// Puts the defect into a copy of the workspace, asks who must notice, and takes it out again; what
    /// noticed it.
    fn try_in(&self, session: &Session, copy: &Path) -> Result<String> {
        let (sh, file) = (&session.sh, copy.join(&self.file));
        let good = sh.read_file(&file)?;
        sh.write_file(&file, self.applied(&good)?)?;
        let noticed = self.noticed(session, copy);
        sh.write_file(&file, good)?;
        let noticed = noticed.context(self.name.clone())?;
        noticed.with_context(|| format!("{} is not noticed: {}", self.name, self.description))
    }

    fn noticed(&self, session: &Session, copy: &Path) -> Result<Option<String>> {
        let by = &self.noticed_by;
        match by.split_once(' ').unwrap_or((by, "")) {
            ("elf", _) => {
                let elf = session.build_copy(copy, "fw-pac")?;
                let bytes = session.sh.read_binary_file(elf)?;
                let found = banned(&Elf::parse(&bytes)?.symbols());
                Ok(found.into_iter().next())
            }
            ("stack", _) => {
                let bound = stack::bound(session, &session.build_copy(copy, "fw-pac")?);
                Ok(bound.err().map(|error| error.to_string()))
            }
            ("loop", rest) => {
                let (file, test) = rest.split_once(' ').unwrap_or((rest, ""));
                let (variable, firmware) = match file {
                    "bringup" => ("ROBOT_ELF_BRINGUP", "bringup"),
                    _ => ("ROBOT_ELF", "fw-pac"),
                };
                let elf = session.build_copy(copy, firmware)?;
                // The Pi's code is in the tests; the firmware's is not to be, for they calculate what it must do.
                let (folder, target) = if self.file.starts_with("fw-") {
                    (&*session.root, session.target.clone())
                } else {
                    (copy, copy.join("target"))
                };
                let _in_folder = session.sh.push_dir(folder);
                let tests = session.cargo_on_host("test --release --test in_the_loop")?;
                let tests = tests.arg(format!("{file}::{test}")).env(variable, elf);
                failures(tests.env("CARGO_TARGET_DIR", target))
            }
            (package, rest) => {
                let tests = "test --locked --no-fail-fast --config profile.dev.opt-level=0";
                let tests = format!("{tests} --package {package} --lib {rest}");
                let _in_copy = session.sh.push_dir(copy);
                let tests = session.cargo_with_board(&tests)?;
                failures(tests.env("CARGO_TARGET_DIR", copy.join("target")))
            }
        }
    }
}

/// The first test that failed, or `None` where all passed.
fn failures(tests: Cmd<'_>) -> Result<Option<String>> {
    let (success, text) = process::tee(tests)?;
    let ran = pattern(r"(?m)^running [1-9]\d* tests?$").is_match(&text);
    ensure!(ran, "no test ran: does the defect compile?");
    let (_, failed) = process::test_results(&text);
    let aborted = (!success).then_some("an aborted test");
    Ok(failed.first().copied().or(aborted).map(str::to_owned))
}

/// Tries the defects of these names, or all.
pub fn run(session: &Session, only: &[String]) -> Result<String> {
    let defects = all(session)?;
    let known = |name: &String| defects.iter().any(|defect| defect.name == *name);
    if let Some(unknown) = only.iter().find(|name| !known(name)) {
        return fail(Kind::Usage, format!("no defect is called {unknown}"));
    }
    let chosen = |defect: &&Defect| only.is_empty() || only.contains(&defect.name);
    try_all(session, defects.iter().filter(chosen))
}

/// Tries defects; an error names those that are not noticed.
pub fn try_all<'a>(session: &Session, defects: impl Iterator<Item = &'a Defect>) -> Result<String> {
    let copy = session.target.join("defects/workspace");
    session.copy_to(&copy)?;
    let (mut noticed, mut missed) = (Vec::new(), Vec::new());
    for defect in defects {
        println!("\n== {}: {}", defect.name, defect.description);
        match defect.try_in(session, &copy) {
            Ok(by) => {
                println!("{}: noticed by {}: {by}", defect.name, defect.noticed_by);
                noticed.push(defect.name.as_str());
            }
            Err(error) => missed.push(format!("{error:#}")),
        }
    }
    ensure!(missed.is_empty(), missed.join("; "));
    Ok(noticed.join(", "))
}

#[test]
fn defect_is_found_however_its_code_is_formatted() {
    let defect = "[[defect]]\nname = \"a\"\ndescription = \"b\"\nfile = \"c\"\n\
                  from = \"f(a, b);\"\nto = \"f(b, a);\"\nnoticed-by = \"elf\"\n";
    let defect = &parse(defect).unwrap()[0];
    let source = "g();\n    f(\n        a,\n        b);\n";
    assert_eq!(defect.applied(source).unwrap(), "g();\n    f(b, a);\n");
    assert!(defect.applied("f(a);").is_err());
    assert!(defect.applied(&source.repeat(2)).is_err());
}
