//! Nearly all mutants in one program, built once: `ci/switched` rewrites a copy of the core so that the
//! variable `MUTANT` switches one on. What cannot be switched, and what survives, is left to cargo-mutants.

use std::collections::BTreeSet;
use std::os::unix::process::ExitStatusExt;
use std::path::PathBuf;
use std::process::Stdio;
use std::time::{Duration, Instant};

use super::listed::Mutant;
use super::runner::{near, quick, Outcome, SETTINGS};
use crate::compat::Place;
use crate::compat::{failed, Of};
use crate::error::Result;
use crate::json;
use crate::mirror::mirror;
use crate::shell;

/// The program with the mutants.
pub struct Switched {
    program: PathBuf,
    /// Where its tests expect to be started.
    folder: PathBuf,
    /// The names of the mutants in it, with their numbers.
    numbers: Vec<(String, usize)>,
    /// How long the tests of one may take.
    limit: Duration,
}

impl Switched {
    /// Rewrites a copy of the core for the mutants of a list as cargo-mutants gave it, and builds its tests.
    ///
    /// # Errors
    /// Where it does not build, or a test fails with no mutant on.
    pub fn set_up(place: &Place, list: &str, mutants: &[Mutant]) -> Result<Self> {
        let folder = place.target.join("mutants/switched");
        let root = folder.join("workspace");
        mirror(&place.root, &place.target, &root)?;
        let file = folder.join("list.json");
        std::fs::write(&file, list).of(file.display())?;
        let mut skipped = BTreeSet::new();
        loop {
            let mut rewrite = place.cargo("");
            rewrite.args(["run", "--quiet", "--locked", "--package", "switched", "--"]);
            rewrite.arg(&file).arg(&root).arg("fw-core");
            rewrite.args(skipped.iter().map(usize::to_string));
            let Some(put_in) = shell::ask(&mut rewrite) else {
                return failed(format!("`{}` failed", shell::shown(&rewrite)));
            };
            let numbers = put_in.lines().filter_map(|line| line.parse().ok());
            let numbers = numbers
                .filter_map(|number: usize| Some((mutants.get(number - 1)?.name.clone(), number)));
            let mut build = place.cargo("");
            build.current_dir(&root).args([
                "test",
                "--package",
                "fw-core",
                "--lib",
                "--no-run",
                "--message-format=json",
            ]);
            build
                .args(SETTINGS)
                .arg("--target-dir")
                .arg(folder.join("target"));
            // Only there for what `switch.in.rs` asks of the compiler.
            build
                .env("RUSTC_BOOTSTRAP", "fw_core")
                .stderr(Stdio::null());
            let answer = build.output().of("cargo test")?;
            let said = String::from_utf8_lossy(&answer.stdout);
            if let (true, Some(program)) = (answer.status.success(), executable(&said)) {
                let mut switched = Self {
                    program,
                    folder: root.join("fw-core"),
                    numbers: numbers.collect(),
                    limit: Duration::from_mins(10),
                };
                let start = Instant::now();
                if switched.ended(0, &quick())? != Outcome::Survived {
                    return failed("the tests fail with no mutant on");
                }
                switched.limit = start.elapsed() * 5 + Duration::from_secs(10);
                return Ok(switched);
            }
            // Each round without those that the compiler refused, from the unspoilt sources.
            let refused = refused(&said, &root);
            let before = skipped.len();
            skipped.extend(refused);
            if skipped.len() == before {
                return failed("the core with all mutants does not build");
            }
            mirror(&place.root, &place.target, &root)?;
        }
    }

    /// How many mutants are in it.
    pub fn len(&self) -> usize {
        self.numbers.len()
    }

    /// How this mutant ends; nothing where it is not among those that can be switched.
    ///
    /// # Errors
    /// Where the program cannot be started.
    pub fn try_one(&self, mutant: &Mutant) -> Result<Option<Outcome>> {
        let number = self.numbers.iter().find(|(name, _)| *name == mutant.name);
        let Some((_, number)) = number else {
            return Ok(None);
        };
        let mut words = quick();
        words.extend(near(&mutant.file));
        match self.ended(*number, &words)? {
            Outcome::Survived => self.ended(*number, &quick()).map(Some),
            noticed => Ok(Some(noticed)),
        }
    }

    fn ended(&self, number: usize, words: &[String]) -> Result<Outcome> {
        // A loop without an end may gather as well as wait.
        let mut tests = shell::within_memory(&self.program, 2 << 30);
        tests
            .current_dir(&self.folder)
            .env("MUTANT", number.to_string());
        // The first test that fails is enough; the word for that is not stable yet.
        tests.env("RUSTC_BOOTSTRAP", "1");
        tests.args(["-Zunstable-options", "--fail-fast", "--test-threads=1"]);
        tests
            .args(words)
            .stdout(Stdio::null())
            .stderr(Stdio::null());
        let mut child = tests.spawn().of(self.program.display())?;
        match shell::wait(&mut child, self.limit) {
            None => {
                shell::end(&mut child);
                Ok(Outcome::Endless)
            }
            Some(status) if status.success() => Ok(Outcome::Survived),
            // Ended from outside it has said nothing.
            Some(status) if status.signal() == Some(9) => failed("the tests were killed"),
            Some(_) => Ok(Outcome::Caught),
        }
    }
}

/// The program that cargo built.
fn executable(said: &str) -> Option<PathBuf> {
    let messages = said.lines().filter_map(|line| json::parse(line, "").ok());
    let programs: Vec<PathBuf> = messages
        .filter_map(|message| json::text(&message, "executable").map(PathBuf::from))
        .collect();
    programs.into_iter().next_back()
}

/// The numbers of the mutants on the lines that the compiler found fault with.
fn refused(said: &str, root: &std::path::Path) -> BTreeSet<usize> {
    let mut numbers = BTreeSet::new();
    let messages = said.lines().filter_map(|line| json::parse(line, "").ok());
    for message in messages {
        let Some(message) = json::at(&message, "message") else {
            continue;
        };
        if json::text(message, "level") != Some("error") {
            continue;
        }
        for span in json::list(message, "spans") {
            let mut span = Some(span);
            // Out of the macros, to where they are called.
            while let Some(here) = span {
                let file = json::text(here, "file_name").unwrap_or_default();
                let text = std::fs::read_to_string(root.join(file)).unwrap_or_default();
                let line = |key| json::at(here, key).map_or(0, json::count);
                let (from, to) = (line("line_start"), line("line_end"));
                let lines = text.lines().take(to).skip(from.saturating_sub(1));
                numbers.extend(lines.flat_map(marked));
                let expansion = json::at(here, "expansion");
                span = expansion.and_then(|expansion| json::at(expansion, "span"));
            }
        }
    }
    numbers
}

/// The numbers in a line's marks, `/*~12*/`.
fn marked(line: &str) -> impl Iterator<Item = usize> + '_ {
    let marks = line.split("/*~").skip(1);
    marks.filter_map(|mark| mark.split_once("*/")?.0.parse().ok())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_error_is_laid_to_the_mutants_of_its_line() {
        let folder = std::env::temp_dir().join(format!("switched-{}", std::process::id()));
        std::fs::create_dir_all(&folder).unwrap();
        std::fs::write(folder.join("a.rs"), "a\nb /*~3*/ c /*~14*/\nd /*~15*/\n").unwrap();
        let said = r#"{"reason": "compiler-message", "message": {"level": "error", "spans": [
            {"file_name": "core/macros.rs", "line_start": 7, "line_end": 7, "expansion":
             {"span": {"file_name": "a.rs", "line_start": 2, "line_end": 2, "expansion": null}}}]}}"#;
        let said = said.replace('\n', " ") + "\n{\"executable\": \"t/fw_core-1\"}\n";
        assert_eq!(refused(&said, &folder), BTreeSet::from([3, 14]));
        assert_eq!(executable(&said), Some("t/fw_core-1".into()));
        std::fs::remove_dir_all(&folder).unwrap();
    }
}
