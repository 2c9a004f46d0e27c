//! An explicit-state search: every state a model can reach, every order of events, and the shortest
//! way to the first state that breaks an invariant.

use std::fmt::Debug;
use std::hash::{Hash, Hasher};

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
    state: M::State,
    by: Option<(usize, M::Event)>,
    depth: usize,
}

/// Every state that was reached, in the order of reaching, and where each stands.
struct Known<M: Model> {
    reached: Vec<Reached<M>>,
    /// Open addressing, at most half full: a place in `reached` plus one, below the state's hash, of
    /// which the upper half is kept; 0 is free.
    table: Vec<u64>,
}

impl<M: Model> Known<M> {
    fn new() -> Self {
        Self {
            reached: Vec::new(),
            table: vec![0; 1 << 16],
        }
    }

    /// Adds a state, unless it has been reached before: equal states are one, whatever their hashes.
    fn add(&mut self, state: M::State, by: Option<(usize, M::Event)>, depth: usize) {
        const PLACE: u64 = u32::MAX as u64;
        if self.table.len() < 2 * (self.reached.len() + 1) {
            self.grow();
        }
        let mut hasher = Mixing(0);
        state.hash(&mut hasher);
        let hash = hasher.finish();
        let mask = self.table.len() - 1;
        let mut slot = Self::slot(hash) & mask;
        while self.table[slot] != 0 {
            let entry = self.table[slot];
            let place = usize::try_from((entry & PLACE) - 1).unwrap_or(usize::MAX);
            if (entry ^ hash) & !PLACE == 0 && self.reached[place].state == state {
                return;
            }
            slot = (slot + 1) & mask;
        }
        self.reached.push(Reached { state, by, depth });
        let place = u32::try_from(self.reached.len()).expect("fewer than 2³² states");
        self.table[slot] = hash & !PLACE | u64::from(place);
    }

    /// Where to look for a hash of which the upper half is known.
    #[allow(clippy::cast_possible_truncation, reason = "32 bits are meant")]
    fn slot(hash: u64) -> usize {
        (hash >> 32) as u32 as usize
    }

    fn grow(&mut self) {
        let mask = self.table.len() * 4 - 1;
        let mut table = vec![0; mask + 1];
        for &entry in self.table.iter().filter(|&&entry| entry != 0) {
            let mut slot = Self::slot(entry) & mask;
            while table[slot] != 0 {
                slot = (slot + 1) & mask;
            }
            table[slot] = entry;
        }
        self.table = table;
    }
}

/// A quick hash, good enough for states: they are compared in full where it agrees.
struct Mixing(u64);

impl Hasher for Mixing {
    fn finish(&self) -> u64 {
        // The upper half counts.
        (self.0 ^ self.0 >> 32).wrapping_mul(0x9E37_79B9_7F4A_7C15)
    }

    fn write(&mut self, bytes: &[u8]) {
        for chunk in bytes.chunks(8) {
            let mut word = [0; 8];
            for (to, from) in word.iter_mut().zip(chunk) {
                *to = *from;
            }
            self.write_u64(u64::from_le_bytes(word));
        }
    }

    fn write_u8(&mut self, value: u8) {
        self.write_u64(value.into());
    }

    fn write_u32(&mut self, value: u32) {
        self.write_u64(value.into());
    }

    fn write_u64(&mut self, value: u64) {
        self.0 = (self.0.rotate_left(5) ^ value).wrapping_mul(0x517C_C1B7_2722_0A95);
    }

    fn write_usize(&mut self, value: usize) {
        self.write_u64(value as u64);
    }
}

/// Visits every reachable state of `model`, breadth first.
///
/// # Errors
/// The shortest counter-example.
///
/// # Panics
/// If there are more than `limit` states: a search that is cut short proves nothing.
pub fn search<M: Model>(model: &M, limit: usize) -> Result<Visited, Counterexample<M>> {
    let mut known = Known::<M>::new();
    for state in model.starts() {
        known.add(state, None, 0);
    }
    let (mut at, mut steps, mut deepest) = (0, 0, 0);
    while at < known.reached.len() {
        let (state, depth) = (known.reached[at].state.clone(), known.reached[at].depth);
        deepest = deepest.max(depth);
        for event in model.events(&state) {
            steps += 1;
            match model.step(&state, &event) {
                Ok(next) => {
                    known.add(next, Some((at, event)), depth + 1);
                    assert!(known.reached.len() <= limit, "more than {limit} states");
                }
                Err(broken) => {
                    let mut events = vec![(state, event)];
                    let mut back = at;
                    while let Some((before, event)) = &known.reached[back].by {
                        let state = known.reached[*before].state.clone();
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
        states: known.reached.len(),
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

    /// A counter whose every value has the same hash.
    #[derive(Clone, Debug, PartialEq, Eq)]
    struct Alike(u16);

    impl Hash for Alike {
        fn hash<H: Hasher>(&self, state: &mut H) {
            state.write_u8(1);
        }
    }

    struct Counter;

    impl Model for Counter {
        type State = Alike;
        type Event = u16;

        fn starts(&self) -> Vec<Alike> {
            vec![Alike(0), Alike(0)]
        }

        fn events(&self, _: &Alike) -> Vec<u16> {
            vec![1, 2, 500]
        }

        fn step(&self, state: &Alike, event: &u16) -> Result<Alike, String> {
            Ok(Alike((state.0 + event) % 1000))
        }
    }

    #[test]
    fn states_of_one_hash_are_still_apart() {
        let visited = search(&Counter, 1000).unwrap_or_else(|found| panic!("{found}"));
        assert_eq!((visited.states, visited.steps), (1000, 3000));
    }

    /// More states than the table begins with.
    struct Large;

    impl Model for Large {
        type State = u32;
        type Event = u32;

        fn starts(&self) -> Vec<u32> {
            vec![0]
        }

        fn events(&self, _: &u32) -> Vec<u32> {
            vec![1, 3, 1 << 17]
        }

        fn step(&self, state: &u32, event: &u32) -> Result<u32, String> {
            Ok((state + event) % (1 << 18))
        }
    }

    #[test]
    fn a_search_of_many_states_loses_none() {
        let visited = search(&Large, 1 << 18).unwrap_or_else(|found| panic!("{found}"));
        assert_eq!((visited.states, visited.steps), (1 << 18, 3 << 18));
    }

    #[test]
    #[should_panic(expected = "more than 24 states")]
    fn a_search_that_would_be_cut_short_fails() {
        let _ = search(&Pair(9), 24);
    }

    #[test]
    fn the_shortest_counterexample_is_found() {
        let found = search(&Pair(2), 100).expect_err("they meet");
        assert_eq!(found.events.len(), 4);
        assert_eq!(found.events[0].0, (0, 0));
    }
}
