//! An explicit-state search: every state a model can reach, every order of events, and the shortest
//! way to the first state that breaks an invariant.

use std::collections::HashSet;
use std::fmt::Debug;
use std::hash::Hash;
use std::rc::Rc;

/// A system whose every behaviour is to be visited.
pub trait Model {
    /// Everything the future depends on.
    type State: Clone + Eq + Hash + Debug;
    /// Something that may happen next.
    type Event: Clone + Debug;

    /// Where it may start.
    fn starts(&self) -> Vec<Self::State>;

    /// What may happen in `state`.
    fn events(&self, state: &Self::State) -> Vec<Self::Event>;

    /// What `event` makes of `state`, or the sentence that says which invariant it broke.
    ///
    /// # Errors
    /// The broken invariant.
    fn step(&self, state: &Self::State, event: &Self::Event) -> Result<Self::State, String>;
}

/// What a complete search visited.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Visited {
    /// Distinct states.
    pub states: usize,
    /// Events tried.
    pub steps: usize,
    /// Events on the longest of the shortest ways to a state.
    pub depth: usize,
}

/// The shortest run that breaks an invariant.
#[derive(Clone, Debug)]
pub struct Counterexample<M: Model> {
    /// Which invariant.
    pub broken: String,
    /// Each event and the state before it; the last event is the one that breaks it.
    pub events: Vec<(M::State, M::Event)>,
}

impl<M: Model> std::fmt::Display for Counterexample<M> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        writeln!(f, "{}", self.broken)?;
        for (state, event) in &self.events {
            writeln!(f, "  {state:?}\n    {event:?}")?;
        }
        Ok(())
    }
}

/// A state that was reached: the event that first led to it with the state that was before, and how
/// many events it took.
struct Reached<M: Model> {
    state: Rc<M::State>,
    by: Option<(usize, M::Event)>,
    depth: usize,
}

/// Visits every reachable state of `model`, breadth first.
///
/// # Errors
/// The shortest counter-example.
///
/// # Panics
/// If there are more than `limit` states: a search that is cut short proves nothing.
pub fn search<M: Model>(model: &M, limit: usize) -> Result<Visited, Counterexample<M>> {
    let mut known = HashSet::new();
    let mut reached: Vec<Reached<M>> = Vec::new();
    for state in model.starts().into_iter().map(Rc::new) {
        if known.insert(state.clone()) {
            reached.push(Reached {
                state,
                by: None,
                depth: 0,
            });
        }
    }
    let (mut at, mut steps, mut deepest) = (0, 0, 0);
    while at < reached.len() {
        let (state, depth) = (reached[at].state.clone(), reached[at].depth);
        deepest = deepest.max(depth);
        for event in model.events(&state) {
            steps += 1;
            match model.step(&state, &event) {
                Ok(next) => {
                    let state = Rc::new(next);
                    if known.insert(Rc::clone(&state)) {
                        reached.push(Reached {
                            state,
                            by: Some((at, event)),
                            depth: depth + 1,
                        });
                        assert!(reached.len() <= limit, "more than {limit} states");
                    }
                }
                Err(broken) => {
                    let mut events = vec![(state.as_ref().clone(), event)];
                    let mut back = at;
                    while let Some((before, event)) = &reached[back].by {
                        let state = reached[*before].state.as_ref().clone();
                        events.push((state, event.clone()));
                        back = *before;
                    }
                    events.reverse();
                    return Err(Counterexample { broken, events });
                }
            }
        }
        at += 1;
    }
    Ok(Visited {
        states: reached.len(),
        steps,
        depth: deepest,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two counters below a limit that must never meet at it.
    struct Pair(u8);

    impl Model for Pair {
        type State = (u8, u8);
        type Event = bool;

        fn starts(&self) -> Vec<Self::State> {
            vec![(0, 0)]
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
            if next == (self.0, self.0) {
                return Err("they met".into());
            }
            Ok(next)
        }
    }

    #[test]
    fn every_state_is_visited() {
        let visited = search(&Pair(9), 100).unwrap_or_else(|found| panic!("{found}"));
        assert_eq!((visited.states, visited.steps, visited.depth), (25, 50, 8));
    }

    #[test]
    fn the_shortest_counterexample_is_found() {
        let found = search(&Pair(2), 100).expect_err("they meet");
        assert_eq!(found.events.len(), 4);
        assert_eq!(found.events[0].0, (0, 0));
    }
}
