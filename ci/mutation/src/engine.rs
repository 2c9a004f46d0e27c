//! Trying mutants: nearly all switched on one by one in one build, the others built one by one.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::process::Command;
use std::slice;
use std::sync::Mutex;
use std::thread;

use anyhow::{Context, Result, anyhow, bail, ensure};
use serde_json::Value;

use crate::citations::{Citations, Claim};
use crate::config::{Config, Judge, Stage};
use crate::mutant::Mutant;
use crate::operators::{CONSTANT, NAMES};
use crate::suite::{DoesNotCompile, Outcome, Suite};
use crate::switch::{Constants, FEATURES, SWITCH, marked, switch};
use crate::workspace::{Workspace, edit, module, near, sorted};

/// Fewer mutants than this are built one by one sooner than all at once.
const FEW: usize = 8;

/// A copy of the workspace with its built tests, stage by stage.
struct Copy {
    root: PathBuf,
    target: PathBuf,
    suites: BTreeMap<usize, Suite>,
}

/// Everything that it takes to try mutants.
pub struct Engine<'a> {
    config: &'a Config,
    workspace: &'a Workspace,
    stages: Vec<Stage>,
    all: &'a [Mutant],
    jobs: usize,
    quick: bool,
    /// The copy with every mutant behind a switch, and those that have one, by index.
    switched: Option<(Copy, BTreeSet<usize>)>,
    /// The copy for one mutant at a time.
    plain: Option<Copy>,
}

impl<'a> Engine<'a> {
    /// Prepares to try `count` of all mutants, `jobs` at a time; with `quick`, those with a switch.
    ///
    /// # Errors
    /// Where the workspace cannot be copied, or its tests fail without a mutant.
    pub fn new(
        config: &'a Config,
        workspace: &'a Workspace,
        all: &'a [Mutant],
        count: usize,
        (jobs, quick): (usize, bool),
    ) -> Result<Self> {
        let mut engine = Self {
            config,
            workspace,
            stages: config.stages(),
            all,
            jobs: jobs.max(1),
            quick,
            switched: None,
            plain: None,
        };
        if let Some(judge) = &config.judge {
            let outcome = engine.judged(judge, None)?;
            ensure!(
                outcome == Outcome::Survived,
                "without a mutant: {outcome:?}"
            );
        } else if quick || count >= FEW {
            let (copy, numbers) = engine.build_switched()?;
            println!("{} of {} mutants in one build", numbers.len(), all.len());
            engine.switched = Some((copy, numbers));
        }
        Ok(engine)
    }

    fn copy(&self, name: &str) -> Result<Copy> {
        let folder = self.workspace.target.join("mutants").join(name);
        let root = folder.join("workspace");
        self.workspace.copy(&root)?;
        Ok(Copy {
            root,
            target: folder.join("target"),
            suites: BTreeMap::new(),
        })
    }

    /// Rewrites a copy until it compiles, each time without the mutants that the compiler refused.
    fn build_switched(&self) -> Result<(Copy, BTreeSet<usize>)> {
        let mut refused = BTreeSet::new();
        loop {
            let mut copy = self.copy("switched")?;
            let numbers = self.rewrite(&copy.root, &refused)?;
            let Err(error) = copy.prepare(self.config, &self.stages, 0) else {
                return Ok((copy, numbers));
            };
            let DoesNotCompile(messages) = error.downcast()?;
            let before = refused.len();
            refused.extend(blamed(&messages, &copy.root));
            if refused.len() == before {
                let rendered = |error: Value| error["rendered"].as_str().map(str::to_owned);
                let error = errors(&messages).find_map(rendered).unwrap_or_default();
                bail!("the code with all mutants does not compile: {error}");
            }
        }
    }

    /// Puts a switch for every mutant but the refused ones into a copy; those that have one.
    fn rewrite(&self, root: &Path, refused: &BTreeSet<usize>) -> Result<BTreeSet<usize>> {
        let mut files = BTreeMap::<&str, Vec<(usize, &Mutant)>>::new();
        for (index, mutant) in self.all.iter().enumerate() {
            if !refused.contains(&index) {
                // Number 0 is no mutant.
                let of_file = files.entry(&mutant.file).or_default();
                of_file.push((index + 1, mutant));
            }
        }
        let mut switched = BTreeSet::new();
        let sources = root.join(self.workspace.library.parent().unwrap_or(Path::new("")));
        let mut modules = BTreeMap::<PathBuf, Constants>::new();
        for path in sorted(&sources)? {
            let file = path.strip_prefix(root).unwrap_or(&path);
            let mutants = files.remove(file.to_str().unwrap_or_default());
            let own = module(&path);
            let around = own.ancestors().skip(1).find_map(|outer| modules.get(outer));
            let mut constants = around.cloned().unwrap_or_default();
            edit(&path, |text| {
                let (text, numbers) = switch(text, &mutants.unwrap_or_default(), &mut constants)?;
                switched.extend(numbers.into_iter().map(|number| number - 1));
                Ok(text)
            })?;
            modules.insert(own, constants);
        }
        edit(&root.join(&self.workspace.library), |text| {
            Ok([FEATURES, text, SWITCH].concat())
        })?;
        Ok(switched)
    }

    /// Tries some of the mutants, by index. What is excused is not shown to the later stages.
    ///
    /// # Errors
    /// Where the tests fail without a mutant, or cannot be run.
    pub fn try_all(
        &mut self,
        mutants: &[usize],
        excused: impl Fn(&Mutant) -> bool,
    ) -> Result<BTreeMap<usize, Outcome>> {
        let mut outcomes = BTreeMap::new();
        let has_switch = |index: &&usize| {
            let switched = self.switched.as_ref();
            switched.is_some_and(|(_, numbers)| numbers.contains(index))
        };
        let (mut left, mut plain): (Vec<usize>, Vec<usize>) =
            mutants.iter().partition(|index| has_switch(index));
        // Of our own operators, what the compiler refused behind a switch it refuses without one.
        if self.switched.is_some() {
            plain.retain(|&index| {
                let genre = &self.all[index].genre;
                let refused = genre != CONSTANT && NAMES.iter().any(|(_, own)| own == genre);
                if refused {
                    outcomes.insert(index, Outcome::Unviable);
                }
                !refused
            });
        }
        for stage in 0..self.stages.len() {
            if let (Some((copy, _)), false) = (&mut self.switched, left.is_empty()) {
                copy.prepare(self.config, &self.stages, stage)?;
                let suite = &copy.suites[&stage];
                outcomes.extend(in_parallel(&left, self.jobs, |index| {
                    let file = &self.all[index].file;
                    let near = if stage == 0 { near(file) } else { Vec::new() };
                    match suite.run(index + 1, &near)? {
                        Outcome::Survived if stage == 0 => suite.run(index + 1, &[]),
                        outcome => Ok(outcome),
                    }
                })?);
            }
            left.retain(|index| {
                outcomes[index] == Outcome::Survived && !excused(&self.all[*index])
            });
        }
        // Built one by one, they are not quick.
        let plain = if self.quick { Vec::new() } else { plain };
        for index in plain {
            outcomes.insert(index, self.try_plain(index, &excused)?);
        }
        Ok(outcomes)
    }

    /// The chosen claims of which no mutant is noticed, `jobs` at a time, and how many there are.
    ///
    /// # Errors
    /// Where the tests fail without a mutant, or cannot be run.
    pub fn try_claims(
        &mut self,
        citations: &Citations,
        chosen: impl Fn(&Claim) -> bool,
    ) -> Result<(usize, Vec<Claim>)> {
        let Some((copy, numbers)) = &self.switched else {
            bail!("no mutant has a switch");
        };
        let mut claims = citations.claims(self.all, |index| numbers.contains(&index));
        claims.retain(chosen);
        let mut idle = Vec::new();
        let own = slice::from_ref(&self.config.package);
        for (elsewhere, packages) in [(false, own), (true, &self.config.also)] {
            let chosen = (0..claims.len()).filter(|index| claims[*index].elsewhere == elsewhere);
            let chosen: Vec<_> = chosen.collect();
            // Without a package cargo would build all of them.
            if chosen.is_empty() {
                continue;
            }
            let stage = Stage::of(packages, false, &[]);
            let suite = Suite::build(self.config, &stage, &copy.root, &copy.target)?;
            let outcomes = in_parallel(&chosen, self.jobs, |index| {
                let mut suite = suite.clone();
                let only = [claims[index].test.clone()];
                suite.calibrate(&only)?;
                for mutant in &claims[index].mutants {
                    let outcome = suite.run(mutant + 1, &only)?;
                    if outcome != Outcome::Survived {
                        return Ok(outcome);
                    }
                }
                println!("  {}", claims[index]);
                Ok(Outcome::Survived)
            })?;
            let survived = outcomes.into_iter();
            let survived = survived.filter(|(_, outcome)| *outcome == Outcome::Survived);
            idle.extend(survived.map(|(index, _)| claims[index].clone()));
        }
        Ok((claims.len(), idle))
    }

    /// What the judge's commands come to, with the mutant.
    fn judged(&self, judge: &Judge, mutant: Option<&Mutant>) -> Result<Outcome> {
        let copy = self.copy("judged")?;
        if let Some(mutant) = mutant {
            let file = copy.root.join(&mutant.file);
            edit(&file, |text| Ok(mutant.applied(text)))?;
        }
        let passes = |words: &str| {
            let mut parts = words.split(' ');
            let mut command = Command::new(parts.next().unwrap_or_default());
            command.args(parts).current_dir(&copy.root);
            let output = command.output().with_context(|| words.to_owned());
            output.map(|output| output.status.success())
        };
        Ok(match passes(&judge.build)? {
            false => Outcome::Unviable,
            true if passes(&judge.test)? => Outcome::Survived,
            true => Outcome::Caught,
        })
    }

    fn try_plain(&mut self, index: usize, excused: impl Fn(&Mutant) -> bool) -> Result<Outcome> {
        let mutant = &self.all[index];
        if let Some(judge) = &self.config.judge {
            return self.judged(judge, Some(mutant));
        }
        let mut copy = match self.plain.take() {
            Some(copy) => copy,
            None => self.copy("plain")?,
        };
        let file = copy.root.join(&mutant.file);
        let mut outcome = Outcome::Survived;
        for stage in 0..self.stages.len() {
            if stage > 0 && (outcome != Outcome::Survived || excused(mutant)) {
                break;
            }
            // Without the mutant first, for the time limit.
            copy.prepare(self.config, &self.stages, stage)?;
            let mut original = String::new();
            edit(&file, |text| {
                text.clone_into(&mut original);
                Ok(mutant.applied(text))
            })?;
            let built = Suite::build(self.config, &self.stages[stage], &copy.root, &copy.target);
            let ran = match built {
                Ok(mut suite) => {
                    suite.limit = copy.suites[&stage].limit;
                    suite.run(0, &[])
                }
                Err(error) if error.is::<DoesNotCompile>() => Ok(Outcome::Unviable),
                Err(error) => Err(error),
            };
            edit(&file, |_| Ok(original))?;
            outcome = ran?;
        }
        self.plain = Some(copy);
        Ok(outcome)
    }
}

impl Copy {
    /// Builds and calibrates a stage's tests, once.
    fn prepare(&mut self, config: &Config, stages: &[Stage], stage: usize) -> Result<()> {
        if self.suites.contains_key(&stage) {
            return Ok(());
        }
        let mut suite = Suite::build(config, &stages[stage], &self.root, &self.target)?;
        suite.calibrate(&[])?;
        self.suites.insert(stage, suite);
        Ok(())
    }
}

/// The errors among the compiler's messages.
fn errors(messages: &str) -> impl Iterator<Item = Value> {
    let messages = messages.lines().filter_map(|message| {
        let mut message: Value = serde_json::from_str(message).ok()?;
        Some(message.get_mut("message")?.take())
    });
    messages.filter(|message| message["level"] == "error")
}

/// The indices of the mutants on the lines that the compiler's errors are about.
fn blamed(messages: &str, root: &Path) -> BTreeSet<usize> {
    let mut indices = BTreeSet::new();
    for error in errors(messages) {
        for span in error["spans"].as_array().into_iter().flatten() {
            let mut span = span;
            // From inside a macro out to where it is called.
            while span.is_object() {
                let file = root.join(span["file_name"].as_str().unwrap_or_default());
                let text = std::fs::read_to_string(file).unwrap_or_default();
                let lines: Vec<&str> = text.lines().collect();
                let line = |key: &str| span[key].as_u64().and_then(|n| usize::try_from(n).ok());
                let from = line("line_start").unwrap_or(1).saturating_sub(1);
                let to = line("line_end").unwrap_or_default();
                // The number is on the line, or close by where a switch takes several.
                let around =
                    (0..4).map(|more| from.saturating_sub(more)..(to + more).min(lines.len()));
                let numbers = around
                    .map(|range| lines.get(range).unwrap_or_default().iter())
                    .map(|lines| lines.flat_map(|line| marked(line)).collect::<Vec<_>>());
                let nearest = numbers.into_iter().find(|numbers| !numbers.is_empty());
                indices.extend(nearest.into_iter().flatten().map(|number| number - 1));
                span = &span["expansion"]["span"];
            }
        }
    }
    indices
}

/// Runs `work` for each of these, `jobs` at a time.
fn in_parallel(
    indices: &[usize],
    jobs: usize,
    work: impl Fn(usize) -> Result<Outcome> + Sync,
) -> Result<BTreeMap<usize, Outcome>> {
    let queue = Mutex::new(indices.iter());
    let take = || queue.lock().ok()?.next().copied();
    thread::scope(|scope| {
        let worker = || -> Result<Vec<_>> {
            let taken = std::iter::from_fn(take);
            taken.map(|index| Ok((index, work(index)?))).collect()
        };
        let running: Vec<_> = (0..jobs).map(|_| scope.spawn(worker)).collect();
        let mut outcomes = BTreeMap::new();
        for thread in running {
            let found = thread.join().map_err(|_| anyhow!("a worker panicked"))?;
            outcomes.extend(found?);
        }
        Ok(outcomes)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn error_blames_the_mutants_of_its_line() {
        let folder = tempfile::tempdir().unwrap();
        let folder = folder.path();
        std::fs::write(folder.join("a.rs"), "a\nb 0_0_3 c 0_0_14\nd 0_0_15\n").unwrap();
        let messages = r#"{"reason": "compiler-message", "message": {"level": "error", "spans": [
            {"file_name": "core/macros.rs", "line_start": 7, "line_end": 7, "expansion":
             {"span": {"file_name": "a.rs", "line_start": 2, "line_end": 2, "expansion": null}}}]}}"#;
        let blamed = blamed(&messages.replace('\n', " "), folder);
        assert_eq!(blamed, BTreeSet::from([2, 13]));
    }
}
