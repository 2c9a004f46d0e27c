//! Seeded defects: code made wrong on purpose where no mutant can stand (registers, the ELF, the
//! stack, the Pi), to see that some gate notices. They are in `ci/defects.toml`.

use std::path::PathBuf;
use std::process::Command;

use toml::{Table, Value};

use crate::elf::{Elf, BANNED};
use crate::error::{bail, ensure, Context, Failure, Result};
use crate::session::Session;
use crate::workspace::Workspace;
use crate::{firmware, process, stack};

/// Where the defects are.
const FILE: &str = "ci/defects.toml";

/// One defect.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Defect {
    pub name: String,
    /// What is wrong with it, one sentence.
    pub description: String,
    /// The file, from the workspace's root.
    file: String,
    /// Code that the file has once, white space aside.
    from: String,
    /// What is there instead.
    to: String,
    /// Who must notice: `elf`, `stack`, `loop FILE FILTER`, or a package and a filter of its tests.
    noticed_by: String,
    /// Whether every `cargo xtask test` tries it.
    pub sample: bool,
}

/// Every defect; each must fit its file.
pub fn all(workspace: &Workspace) -> Result<Vec<Defect>> {
    let defects = parse(&workspace.read(FILE)?).context(FILE)?;
    for defect in &defects {
        let text = workspace.read(&defect.file)?;
        ensure!(
            defect.applied(&text)? != text,
            "{} changes nothing",
            defect.name
        );
    }
    Ok(defects)
}

fn parse(text: &str) -> Result<Vec<Defect>> {
    let table: Table = toml::from_str(text)?;
    let defects = table.get("defect").and_then(Value::as_array);
    let defects = defects.context("no defect")?.iter().map(|defect| {
        let text = |key: &str| {
            let value = defect.get(key).and_then(Value::as_str);
            let value = value.filter(|value| !value.trim().is_empty());
            value
                .map(str::to_owned)
                .with_context(|| format!("{key} is missing in {defect:?}"))
        };
        Ok(Defect {
            name: text("name")?,
            description: text("description")?,
            file: text("file")?,
            from: text("from")?,
            to: text("to")?,
            noticed_by: text("noticed-by")?,
            sample: defect
                .get("sample")
                .and_then(Value::as_bool)
                .unwrap_or(false),
        })
    });
    defects.collect()
}

impl Defect {
    /// The file's text with the defect in it.
    fn applied(&self, text: &str) -> Result<String> {
        let code: Vec<(usize, char)> = text
            .char_indices()
            .filter(|(_, letter)| !letter.is_whitespace())
            .collect();
        let from: Vec<char> = self
            .from
            .chars()
            .filter(|letter| !letter.is_whitespace())
            .collect();
        let fits = |window: &&[(usize, char)]| window.iter().map(|(_, letter)| letter).eq(&from);
        let places: Vec<_> = code.windows(from.len()).filter(fits).collect();
        let [place] = places[..] else {
            bail!(
                "{}: its code is {} times in {}",
                self.name,
                places.len(),
                self.file
            );
        };
        let (start, (last, letter)) = (place[0].0, place[from.len() - 1]);
        Ok([&text[..start], &self.to, &text[last + letter.len_utf8()..]].concat())
    }
}

/// A copy of the workspace to change, with a target folder of its own.
struct Copy<'a> {
    session: &'a Session,
    root: PathBuf,
    target: PathBuf,
}

impl<'a> Copy<'a> {
    /// Brings the copy up to date; equal files keep their time, so that cargo builds only what
    /// changed.
    fn new(session: &'a Session) -> Result<Self> {
        let workspace = &session.workspace;
        let folder = workspace.target.join("defects");
        let (root, target) = (folder.join("workspace"), folder.join("target"));
        // What is gone from the workspace must not be built.
        for copy in workspace.files(&root).unwrap_or_default() {
            if !workspace.root.join(copy.strip_prefix(&root)?).is_file() {
                std::fs::remove_file(copy)?;
            }
        }
        for file in workspace.files("")? {
            let copy = root.join(file.strip_prefix(&workspace.root)?);
            if std::fs::read(&file)? != std::fs::read(&copy).unwrap_or_default() {
                firmware::copy(&file, &copy)?;
            }
        }
        Ok(Self {
            session,
            root,
            target,
        })
    }

    /// Puts a defect in, asks who must notice, and takes it out again; what noticed it.
    fn try_one(&self, defect: &Defect) -> Result<String> {
        let file = self.root.join(&defect.file);
        let good = std::fs::read_to_string(&file)?;
        std::fs::write(&file, defect.applied(&good)?)?;
        let noticed = self.noticed(defect);
        std::fs::write(&file, good)?;
        noticed?.with_context(|| format!("{} is not noticed: {}", defect.name, defect.description))
    }

    fn noticed(&self, defect: &Defect) -> Result<Option<String>> {
        let mut words = defect.noticed_by.split(' ');
        let (gate, rest) = (words.next().unwrap_or_default(), words.collect::<Vec<_>>());
        let workspace = &self.session.workspace;
        match gate {
            "elf" => {
                let bytes = std::fs::read(self.elf()?)?;
                let symbols = Elf::parse(&bytes)?.symbols();
                let mut kinds = BANNED.iter();
                let found = kinds.find(|kind| !kind.among(&symbols).is_empty());
                Ok(found.map(|kind| kind.name.to_owned()))
            }
            "stack" => {
                let bound = stack::bound(workspace, &self.elf()?);
                Ok(bound.err().map(|error| error.to_string()))
            }
            "loop" => {
                let tests = "test --release --package robot-tests --test";
                let mut tests = workspace.cargo_with_board(tests)?;
                tests.args(rest).env("ROBOT_ELF", self.elf()?);
                failures(tests)
            }
            package => {
                let tests = "test --locked --no-fail-fast --config profile.dev.opt-level=0";
                let mut tests = workspace.cargo_with_board(tests)?;
                tests
                    .current_dir(&self.root)
                    .arg("--target-dir")
                    .arg(&self.target);
                tests.args(["--package", package, "--lib"]).args(rest);
                failures(tests)
            }
        }
    }

    fn elf(&self) -> Result<PathBuf> {
        let toolchain = self.session.toolchain()?;
        firmware::build_in(
            &self.session.workspace,
            toolchain,
            &self.root,
            &self.target,
            "",
        )
    }
}

/// The first test that failed, or `None` where all passed.
fn failures(tests: Command) -> Result<Option<String>> {
    let shown = process::display(&tests);
    let (status, text) = process::tee(tests, |_| true)?;
    let results = text
        .lines()
        .filter(|line| line.starts_with("test result: "));
    let ran = results
        .filter(|line| !line.contains(" 0 passed; 0 failed"))
        .count()
        > 0;
    ensure!(ran, "`{shown}` ran no test: does the defect compile?");
    let mut lines = text.lines().filter_map(|line| line.strip_prefix("test "));
    let failed = lines.find_map(|line| line.strip_suffix(" ... FAILED"));
    let aborted = (!status.success()).then_some("an aborted test");
    Ok(failed.or(aborted).map(str::to_owned))
}

/// Tries the defects of these names, or all.
pub fn run(session: &Session, only: &[String]) -> Result<String> {
    let defects = all(&session.workspace)?;
    let known = |name: &String| defects.iter().any(|defect| defect.name == *name);
    if let Some(unknown) = only.iter().find(|name| !known(name)) {
        bail!(Failure::Usage(format!("no defect is called {unknown}")));
    }
    let chosen = defects
        .iter()
        .filter(|defect| only.is_empty() || only.contains(&defect.name));
    try_all(session, chosen)
}

/// Tries defects; an error names those that are not noticed.
pub fn try_all<'a>(session: &Session, defects: impl Iterator<Item = &'a Defect>) -> Result<String> {
    let copy = Copy::new(session)?;
    let (mut noticed, mut missed) = (Vec::new(), Vec::new());
    for defect in defects {
        println!("\n== {}: {}", defect.name, defect.description);
        match copy.try_one(defect) {
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

#[cfg(test)]
mod tests {
    use super::*;

    const LIST: &str = "[[defect]]\nname = \"a\"\ndescription = \"b\"\nfile = \"c\"\n\
                        from = \"f(a, b);\"\nto = \"f(b, a);\"\nnoticed-by = \"elf\"\n";

    #[test]
    fn defect_is_found_however_its_code_is_formatted() {
        let defect = &parse(LIST).unwrap()[0];
        let text = "g();\n    f(\n        a,\n        b);\n";
        assert_eq!(defect.applied(text).unwrap(), "g();\n    f(b, a);\n");
        assert!(defect.applied("f(a);").is_err());
        assert!(defect.applied(&text.repeat(2)).is_err());
    }

    #[test]
    fn incomplete_defect_is_refused() {
        assert!(parse(&LIST.replace("elf", "")).is_err());
        assert!(parse("").is_err());
    }
}
