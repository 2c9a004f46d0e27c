//! T11, every order of captures, frames and the robot around `fw_core::captured` and `fw_core::wire::handover`, the
//! code that `fw-pac/src/app.rs` runs.
//!
//! Captures come between any two of the robot's steps and twice within a look for the next event; a frame ends
//! between two looks. What must follow is worked out from the edges, ticks and frames themselves and a clock that
//! does not wrap. The code's own does, within the run.
//!
//! `cargo test -p proofs --test events_model -- --nocapture` shows the way to each broken invariant.

use std::cell::Cell;
use std::hash::{Hash, Hasher};

use fw_core::captured::{CapturedEcho, Echoes, Event, Pending, next_event};
use fw_core::robot::TickInput;
use fw_core::types::{Micros, RangefinderId};
use fw_core::wire::handover::{ClaimedFrame, Handover};
use proofs::search::{Model, assert_broken, assert_holds};

const SENSORS: [RangefinderId; 2] = [RangefinderId::Front, RangefinderId::Left];
/// The clock wraps within the run.
const START: u64 = (1 << 32) - 2;
/// Microseconds of a run, and how often each may happen.
const LENGTH: u64 = 3;
const TICKS: u8 = 2;
const FRAMES: u8 = 2;
const EDGES: u8 = 3;
const TRIGGERS: u8 = 2;

/// What happens at the interrupts' side.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Interrupt {
    Tick,
    FrameEnds,
    /// The line of one of [`SENSORS`] changes.
    Edge(usize),
}

#[derive(Clone, Copy, Debug)]
enum Step {
    /// A microsecond passes.
    Pass,
    Interrupt(Interrupt),
    /// `PendSV` begins.
    Enter,
    /// The robot takes the next event; something may be captured before it looks at the captures, or after.
    Take([Option<Interrupt>; 2]),
    /// The robot triggers a sensor.
    Trigger(usize),
    /// [`Handlers::Unmasked`]: a frame ends, then a tick is latched, between the looks at the two.
    TakeAcross,
}

/// The handlers, right or broken on purpose.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Handlers {
    Right,
    /// One of the interrupts does not wake the robot.
    Unwoken(Interrupt),
    /// The robot leaves after an event.
    Once,
    /// Frames end while the robot looks for the next event.
    Unmasked,
    /// Nothing is broken; what is rare counts as broken, and must be come across.
    Wanted,
}

#[derive(Clone, Debug, PartialEq, Eq)]
struct State {
    tick: Cell<Option<TickInput>>,
    echoes: Echoes,
    handover: Handover,
    clock: u64,
    high: [bool; 2],
    /// `PendSV` is pending, and running.
    pending: bool,
    running: bool,
    /// What must be: a latched tick, a frame that awaits the robot and how many it replaced, the edges of each
    /// sensor since it was triggered, unless its echo is over and taken.
    latched: Option<u64>,
    ended: Option<u64>,
    lost: u32,
    edges: [Option<Vec<(u64, bool)>>; 2],
    /// The time of the last tick or frame that the robot took.
    taken: u64,
    /// How often each has happened: ticks, frames, edges, triggers.
    counts: [u8; 4],
}

impl Hash for State {
    fn hash<H: Hasher>(&self, state: &mut H) {
        (self.clock, self.pending, self.running, self.counts).hash(state);
        (self.handover, &self.edges, self.latched, self.ended).hash(state);
    }
}

/// The code's clock.
#[allow(clippy::cast_possible_truncation, reason = "it wraps")]
fn micros(time: u64) -> Micros {
    Micros(time as u32)
}

impl State {
    /// Whether so few of a kind have happened.
    fn fewer(&self, kind: usize, most: u8) -> bool {
        self.counts[kind] < most
    }

    fn may(&self, interrupt: Interrupt) -> bool {
        match interrupt {
            Interrupt::Tick => self.fewer(0, TICKS),
            Interrupt::FrameEnds => self.fewer(1, FRAMES),
            Interrupt::Edge(_) => self.fewer(2, EDGES),
        }
    }

    /// The echo of a sensor that is over: the first edge up since its trigger and the first down after that.
    fn echo(&self, sensor: usize) -> Option<CapturedEcho> {
        let mut edges = self.edges[sensor].iter().flatten();
        let (rise, _) = edges.find(|edge| edge.1)?;
        let (fall, _) = edges.find(|edge| !edge.1)?;
        Some(CapturedEcho {
            which: SENSORS[sensor],
            rise: micros(*rise),
            fall: micros(*fall),
        })
    }
}

impl Handlers {
    /// An interrupt's handler, and what must follow.
    fn handle(self, state: &mut State, interrupt: Interrupt) {
        let wakes = match interrupt {
            Interrupt::Tick => {
                state.counts[0] += 1;
                state.latched = Some(state.clock);
                state.tick.set(Some(TickInput {
                    now: micros(state.clock),
                    ..TickInput::default()
                }));
                true
            }
            Interrupt::FrameEnds => {
                state.counts[1] += 1;
                state.lost += u32::from(state.ended.replace(state.clock).is_some());
                state.handover.end_frame(0, micros(state.clock));
                true
            }
            Interrupt::Edge(sensor) => {
                state.counts[2] += 1;
                let high = !state.high[sensor];
                state.high[sensor] = high;
                if let Some(edges) = &mut state.edges[sensor] {
                    edges.push((state.clock, high));
                }
                let at = micros(state.clock);
                state.echoes.on_edge(SENSORS[sensor], at, high)
            }
        };
        state.pending |= wakes && self != Self::Unwoken(interrupt);
    }
}

/// The firmware's side of [`next_event`].
struct Waiting<'a> {
    handlers: Handlers,
    state: &'a mut State,
    /// What comes before a look at the captures and before the claim.
    between: [Vec<Interrupt>; 2],
}

impl Waiting<'_> {
    fn come(&mut self, point: usize) {
        for (later, interrupt) in (0..).zip(std::mem::take(&mut self.between[point])) {
            self.state.clock += later;
            self.handlers.handle(self.state, interrupt);
        }
    }
}

impl Pending for Waiting<'_> {
    type Frame = ClaimedFrame;

    fn frame_ended_at(&mut self) -> Option<Micros> {
        self.state.handover.ended_at()
    }

    fn captured<R>(&mut self, f: impl FnOnce(&Cell<Option<TickInput>>, &Echoes) -> R) -> R {
        self.come(0);
        f(&self.state.tick, &self.state.echoes)
    }

    fn claim(mut self) -> Option<ClaimedFrame> {
        self.come(1);
        self.state.handover.claim()
    }
}

impl Handlers {
    /// The robot takes an event: it must be one that has happened, and none that is older may wait.
    fn take(self, next: &mut State, between: [Vec<Interrupt>; 2]) -> Result<(), String> {
        let event = next_event(Waiting {
            handlers: self,
            state: next,
            between,
        });
        next.running = self != Self::Once && event.is_some();
        let at = match event {
            None => return Ok(()),
            Some(Event::Echo(echo)) => {
                let sensor = usize::from(echo.which != SENSORS[0]);
                if next.echo(sensor) != Some(echo) {
                    return Err(format!("{echo:?} did not happen"));
                }
                next.edges[sensor] = None;
                return Ok(());
            }
            Some(Event::Tick(tick)) => {
                let at = next.latched.take().ok_or("a tick is taken twice")?;
                if tick.now != micros(at) {
                    return Err("a tick that was replaced".into());
                }
                at
            }
            Some(Event::Frame(claimed)) => {
                let at = next.ended.take().ok_or("a frame is taken twice")?;
                let lost = std::mem::take(&mut next.lost);
                if (claimed.frame.at, claimed.lost) != (micros(at), lost) {
                    return Err("a frame that was replaced, or is not counted".into());
                }
                let _ = next.handover.answer(claimed.answer, micros(next.clock));
                at
            }
        };
        if at < next.taken {
            return Err("the robot's clock runs backwards".into());
        }
        next.taken = at;
        Ok(())
    }
}

impl Model for Handlers {
    type State = State;
    type Event = Step;

    fn starts(&self) -> Vec<State> {
        vec![State {
            tick: Cell::new(None),
            echoes: Echoes::new(),
            handover: Handover::new(1),
            clock: START,
            high: [false; 2],
            pending: false,
            running: false,
            latched: None,
            ended: None,
            lost: 0,
            edges: [None, None],
            taken: START,
            counts: [0; 4],
        }]
    }

    fn events(&self, state: &State) -> Vec<Step> {
        let mut events = Vec::new();
        if state.clock < START + LENGTH {
            events.push(Step::Pass);
        }
        let captures = [Interrupt::Tick, Interrupt::Edge(0), Interrupt::Edge(1)];
        let captures = captures.into_iter().filter(|&one| state.may(one));
        events.extend(captures.clone().map(Step::Interrupt));
        if state.may(Interrupt::FrameEnds) {
            events.push(Step::Interrupt(Interrupt::FrameEnds));
        }
        if !state.running {
            events.extend(state.pending.then_some(Step::Enter));
            return events;
        }
        events.push(Step::Take([None; 2]));
        for capture in captures {
            events.push(Step::Take([Some(capture), None]));
            events.push(Step::Take([None, Some(capture)]));
        }
        if state.fewer(3, TRIGGERS) {
            events.extend([0, 1].map(Step::Trigger));
        }
        let both = state.may(Interrupt::Tick) && state.may(Interrupt::FrameEnds);
        if *self == Self::Unmasked && both {
            events.push(Step::TakeAcross);
        }
        events
    }

    fn step(&self, state: &State, event: &Step) -> Result<State, String> {
        let mut next = state.clone();
        match *event {
            Step::Pass => next.clock += 1,
            Step::Interrupt(interrupt) => self.handle(&mut next, interrupt),
            Step::Enter => (next.pending, next.running) = (false, true),
            Step::Take(between) => {
                self.take(&mut next, between.map(|one| one.into_iter().collect()))?;
            }
            Step::TakeAcross => {
                let across = vec![Interrupt::FrameEnds, Interrupt::Tick];
                self.take(&mut next, [across, Vec::new()])?;
            }
            Step::Trigger(sensor) => {
                next.counts[3] += 1;
                next.echoes.trigger(SENSORS[sensor]);
                next.edges[sensor] = Some(Vec::new());
            }
        }
        let waits = next.latched.is_some() || next.ended.is_some();
        let asleep = !next.running && !next.pending;
        if asleep && (waits || next.echo(0).is_some() || next.echo(1).is_some()) {
            return Err("something waits and nothing will wake the robot".into());
        }
        let before = next.ended > next.latched && next.latched.is_some();
        if *self == Self::Wanted && before && next.lost > 0 && next.echo(1).is_some() {
            return Err("an echo, and a tick before a frame that replaced one".into());
        }
        Ok(next)
    }
}

// Requirement: WIRE-spi-3
#[test]
fn events_arrive_once_and_in_order() {
    assert_holds(&Handlers::Right, 10_000);
}

#[test]
fn events_search_meets_rare_states() {
    assert_broken(&[(Handlers::Wanted, "an echo, and a tick")]);
}

#[test]
fn broken_handlers_are_found() {
    assert_broken(&[
        (Handlers::Unwoken(Interrupt::Tick), "nothing will wake"),
        (Handlers::Unwoken(Interrupt::FrameEnds), "nothing will wake"),
        (Handlers::Unwoken(Interrupt::Edge(0)), "nothing will wake"),
        (Handlers::Once, "nothing will wake"),
        (Handlers::Unmasked, "runs backwards"),
    ]);
}
