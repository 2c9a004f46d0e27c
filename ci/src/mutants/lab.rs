//! Where mutants are tried: switched on one by one in one program first, then those that are left by
//! cargo-mutants.

use std::ops::Range;
use std::sync::Mutex;
use std::thread;

use super::listed::Mutant;
use super::runner::{Bench, Outcome, Outcomes, Runner, ALL, CORE};
use super::switched::Switched;
use crate::compat::Place;
use crate::error::Result;

/// Fewer mutants than these are built one by one in less time than all at once.
const FEW: usize = 8;

/// The program with all mutants, and the copies of the workspace for one at a time.
pub struct Lab<'r> {
    runner: &'r Runner<'r>,
    switched: Option<Switched>,
    benches: Vec<Bench<'r>>,
    jobs: usize,
}

impl<'r> Lab<'r> {
    /// Prepares to try so `many` of `all` mutants, `jobs` at a time; `list` is what cargo-mutants said of
    /// them all.
    pub fn set_up(
        place: &Place,
        runner: &'r Runner<'r>,
        jobs: usize,
        (all, list): &(Vec<Mutant>, String),
        many: usize,
    ) -> Self {
        let mut switched = None;
        if many >= FEW {
            match Switched::set_up(place, list, all) {
                Ok(program) => {
                    println!(
                        "  {} of {} mutants in one program",
                        program.len(),
                        all.len()
                    );
                    switched = Some(program);
                }
                // Slower, and as good.
                Err(error) => println!("  one by one, for {error}"),
            }
        }
        Self {
            runner,
            switched,
            benches: Vec::new(),
            jobs,
        }
    }

    /// Tries mutants. What the tests next to the code let pass is shown to all others, unless it is excused.
    ///
    /// # Errors
    /// Where the tests fail without any mutant, or cargo-mutants does.
    pub fn try_all(
        &mut self,
        mutants: &[Mutant],
        excused: impl Fn(&Mutant) -> bool,
    ) -> Result<Outcomes> {
        let chosen = |wanted: &dyn Fn(&Mutant) -> bool| -> Vec<Mutant> {
            let wanted = mutants.iter().filter(|mutant| wanted(mutant));
            wanted.cloned().collect()
        };
        let mut outcomes = self.switch(mutants)?;
        let fresh = chosen(&|mutant| !outcomes.contains_key(&mutant.name));
        outcomes.extend(self.build(&fresh, 0..CORE)?);
        let survived = chosen(&|mutant| {
            outcomes.get(&mutant.name) == Some(&Outcome::Survived) && !excused(mutant)
        });
        outcomes.extend(self.build(&survived, CORE..ALL)?);
        Ok(outcomes)
    }

    fn switch(&self, mutants: &[Mutant]) -> Result<Outcomes> {
        let Some(switched) = &self.switched else {
            return Ok(Outcomes::new());
        };
        let next = Mutex::new(mutants.iter());
        let one_after_another = || {
            let mut outcomes = Outcomes::new();
            while let Some(mutant) = next.lock().ok().and_then(|mut next| next.next()) {
                let outcome = switched.try_one(mutant)?;
                outcomes.extend(outcome.map(|outcome| (mutant.name.clone(), outcome)));
            }
            Ok(outcomes)
        };
        in_parallel((0..self.jobs).map(|_| one_after_another))
    }

    /// By cargo-mutants, in some of its stages.
    fn build(&mut self, mutants: &[Mutant], stages: Range<usize>) -> Result<Outcomes> {
        if mutants.is_empty() {
            return Ok(Outcomes::new());
        }
        if self.benches.is_empty() {
            self.benches = self.runner.benches(self.jobs)?;
        }
        let jobs = self.jobs;
        in_parallel(self.benches.iter_mut().enumerate().map(|(number, bench)| {
            let share: Vec<Mutant> = mutants.iter().skip(number).step_by(jobs).cloned().collect();
            let stages = stages.clone();
            move || bench.try_all(&share, stages)
        }))
    }
}

fn in_parallel<F: FnOnce() -> Result<Outcomes> + Send>(
    work: impl Iterator<Item = F>,
) -> Result<Outcomes> {
    thread::scope(|scope| {
        let running: Vec<_> = work.map(|work| scope.spawn(work)).collect();
        let mut outcomes = Outcomes::new();
        for thread in running {
            match thread.join() {
                Ok(found) => outcomes.extend(found?),
                Err(panic) => std::panic::resume_unwind(panic),
            }
        }
        Ok(outcomes)
    })
}
