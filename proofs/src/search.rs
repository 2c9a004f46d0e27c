//! Breadth-first explicit-state search: every reachable state of a model under every order of
//! events, and the shortest run to the first state that breaks an invariant.
//!
//! States are compared in full, never by their hash alone, so a search that ends is complete.

use std::collections::HashSet;
use std::fmt::{self, Debug, Display};
use std::hash::Hash;
use std::rc::Rc;

/// A system whose every behaviour is visited.
pub trait Model {
    /// Everything the future depends on.
    type State: Clone + Eq + Hash + Debug;
    /// Something that may happen next.
    type Event: Clone + Debug;

    /// The initial states.
    fn starts(&self) -> Vec<Self::State>;

    /// The events that are possible in `state`.
    fn events(&self, state: &Self::State) -> Vec<Self::Event>;

    /// The state after `event`.
    ///
    /// # Errors
    /// A sentence that names the broken invariant.
    fn step(&self, state: &Self::State, event: &Self::Event) -> Result<Self::State, String>;
}

/// The size of a complete search.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Visited {
    /// Distinct states.
    pub states: usize,
    /// Events tried.
    pub steps: usize,
    /// Largest distance of a state from the initial ones, in events.
    pub depth: usize,
}

/// The shortest run that breaks an invariant.
#[derive(Clone, Debug)]
pub struct Counterexample<M: Model> {
    /// The broken invariant.
    pub broken: String,
    /// Each event with the state before it; the last event breaks the invariant.
    pub events: Vec<(M::State, M::Event)>,
}

impl<M: Model> Display for Counterexample<M> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "{}", self.broken)?;
        for (state, event) in &self.events {
            writeln!(f, "  {state:?}\n    {event:?}")?;
        }
        Ok(())
    }
}

/// A reached state, the event and the index of the state that first led to it, and its depth.
struct Reached<M: Model> {
    state: Rc<M::State>,
    by: Option<(usize, M::Event)>,
    depth: usize,
}

/// Visits every reachable state of `model`.
///
/// # Errors
/// The shortest counter-example.
///
/// # Panics
/// If there are more than `limit` states: a search that is cut short proves nothing.
pub fn search<M: Model>(model: &M, limit: usize) -> Result<Visited, Counterexample<M>> {
    let mut known = HashSet::new();
    let mut reached = Vec::<Reached<M>>::new();
    let mut add = |reached: &mut Vec<Reached<M>>, state: M::State, by, depth| {
        let state = Rc::new(state);
        if known.insert(Rc::clone(&state)) {
            reached.push(Reached { state, by, depth });
            assert!(reached.len() <= limit, "more than {limit} states");
        }
    };
    for state in model.starts() {
        add(&mut reached, state, None, 0);
    }
    let (mut at, mut steps) = (0, 0);
    while let Some(Reached { state, depth, .. }) = reached.get(at) {
        let (state, depth) = (Rc::clone(state), *depth);
        for event in model.events(&state) {
            steps += 1;
            match model.step(&state, &event) {
                Ok(next) => add(&mut reached, next, Some((at, event)), depth + 1),
                Err(broken) => {
                    let events = run_to(&reached, at, event);
                    return Err(Counterexample { broken, events });
                }
            }
        }
        at += 1;
    }
    Ok(Visited {
        states: reached.len(),
        steps,
        depth: reached.last().map_or(0, |last| last.depth),
    })
}

/// States of the largest search.
const LIMIT: usize = 10_000_000;

/// Searches `model` completely and prints how much was visited.
///
/// # Panics
/// With the counter-example, if there is one; if fewer than `least` states are reached.
pub fn assert_holds<M: Model>(model: &M, least: usize) {
    let visited = search(model, LIMIT).unwrap_or_else(|found| panic!("{found}"));
    println!("{visited:?}");
    assert!(visited.states >= least && visited.depth > 8);
}

/// Searches models that are broken on purpose, each beside a part of the sentence that names its broken
/// invariant, and prints the counter-examples.
///
/// # Panics
/// If a search finds none, or another one.
pub fn assert_broken<M: Model + Debug>(cases: &[(M, &str)]) {
    for (broken, expected) in cases {
        let found = search(broken, LIMIT).err();
        let found = found.unwrap_or_else(|| panic!("{broken:?} is not found"));
        println!("{broken:?}: {found}");
        assert!(found.broken.contains(expected), "{broken:?}: {found}");
    }
}

/// The run to state number `at` and the event after it.
fn run_to<M: Model>(
    reached: &[Reached<M>],
    at: usize,
    last: M::Event,
) -> Vec<(M::State, M::Event)> {
    let mut events = vec![((*reached[at].state).clone(), last)];
    let mut back = at;
    while let Some((before, event)) = &reached[back].by {
        events.push(((*reached[*before].state).clone(), event.clone()));
        back = *before;
    }
    events.reverse();
    events
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two counters modulo 5 that must not both have the forbidden value.
    struct Pair {
        forbidden: u8,
    }

    impl Model for Pair {
        type State = (u8, u8);
        type Event = bool;

        fn starts(&self) -> Vec<Self::State> {
            vec![(0, 0), (0, 0)]
        }

        fn events(&self, _: &Self::State) -> Vec<bool> {
            vec![false, true]
        }

        fn step(&self, &(a, b): &Self::State, &event: &bool) -> Result<Self::State, String> {
            let next = if event {
                (a, (b + 1) % 5)
            } else {
                ((a + 1) % 5, b)
            };
            if next == (self.forbidden, self.forbidden) {
                return Err("forbidden".into());
            }
            Ok(next)
        }
    }

    #[test]
    fn search_without_violation_visits_every_state_once() {
        let visited = search(&Pair { forbidden: 9 }, 25).unwrap_or_else(|found| panic!("{found}"));
        assert_eq!((visited.states, visited.steps, visited.depth), (25, 50, 8));
    }

    #[test]
    #[should_panic(expected = "more than 24 states")]
    fn search_beyond_its_limit_panics() {
        let _ = search(&Pair { forbidden: 9 }, 24);
    }

    #[test]
    fn search_with_violation_finds_the_shortest_run() {
        let found = search(&Pair { forbidden: 2 }, 100).expect_err("it is reachable");
        assert_eq!(found.events.len(), 4);
        assert_eq!(found.events[0].0, (0, 0));
    }
}
