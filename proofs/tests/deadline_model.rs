//! T8, every order of the clock, the ticks and the frames around the stop deadline: the core's own
//! supervisor, handed what the interrupts stamped in the order of the core's own [`next_event`].
//!
//! A frame's end and a tick are stamped when they happen and wait, one of each, until the robot comes to
//! them. What must follow is worked out at once, when they happen, from the
//! rules of `docs/interfaces.md` and a clock that does not wrap. The code's own does, within the run.
//!
//! `cargo test -p proofs --test deadline_model -- --nocapture` shows the way to each broken invariant.

use std::cell::Cell;
use std::fmt;

use fw_core::captured::{Echoes, Event as Next, Pending, next_event};
use fw_core::motion::StopDeadline;
use fw_core::robot::{AllowedMotion, Supervisor, SupervisorCommand, TickInput};
use fw_core::types::{Faults, Micros, Milliseconds};
use fw_core::wire::Order;
use proofs::search::{Model, assert_broken, assert_holds};

const DEADLINE_MS: u16 = 100;
const DEADLINE: u64 = 100_000;
/// Half a deadline passes from tick to tick, and 1 µs: a frame 2 µs after a tick is as old as the
/// deadline, to the microsecond, at the next tick but one.
const PERIOD: u64 = DEADLINE / 2 + 1;
/// When a frame may end, after a tick.
const MOMENTS: [u64; 4] = [1, 2, 3, PERIOD - 1];
/// The longest time between two ticks that the proofs take for granted, less what the deadline takes.
const SLEEP: u64 = (1 << 31) - 2 * DEADLINE;
/// The clock wraps within the run.
const START: u64 = (1 << 32) - 3 * PERIOD;
const TICKS: u8 = 7;
const FRAMES: u8 = 3;
/// A fault that blocks.
const FAULT: Faults = Faults::LEFT_STALLED;

/// What a fresh frame says.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
enum Word {
    /// Nothing: the link is alive.
    Alive,
    Stop,
    Resume,
    /// The faults are cleared.
    Cured,
}

impl Word {
    const ALL: [Self; 4] = [Self::Alive, Self::Stop, Self::Resume, Self::Cured];

    fn intent(self) -> SupervisorCommand {
        let mut intent = SupervisorCommand::default();
        match self {
            Self::Alive => {}
            Self::Stop => intent.order = Order::Stop,
            Self::Resume => intent.order = Order::Resume,
            Self::Cured => intent.clear_faults = Faults::ALL_BITS,
        }
        intent
    }
}

#[allow(clippy::struct_excessive_bools, reason = "each is a fact")]
#[derive(Clone, Copy, PartialEq, Eq, Hash)]
struct State {
    supervisor: Supervisor,
    /// Microseconds, without a wrap.
    clock: u64,
    /// The last tick, and how often it has slept.
    ticked: u64,
    slept: bool,
    /// Waiting for the robot: when it ended and what it says.
    frame: Option<(u64, Word)>,
    /// Waiting for the robot: when it was, what must come of it, and whether frames arrive.
    tick: Option<(u64, AllowedMotion, bool, bool)>,
    /// What must be: when a frame last ended, whether the robot is stopped or faulted, whether the loss of
    /// the link is latched.
    received: Option<u64>,
    stopped: bool,
    faulted: bool,
    lost: bool,
    /// What the motors were last permitted, and whether a frame was handled or a fault found since; for
    /// [`Robot::Blind`] alone.
    permit: AllowedMotion,
    met: bool,
    ticks: u8,
    frames: u8,
}

impl fmt::Debug for State {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "{} µs, {} after tick {}; waiting: frame {:?}, tick {:?}; received at {:?}, must be {}{}; {:?}",
            self.clock - START,
            self.clock - self.ticked,
            self.ticks,
            self.frame.map(|(at, word)| (at - START, word)),
            self.tick.map(|(at, permit, ..)| (at - START, permit)),
            self.received.map(|at| at - START),
            if self.stopped { "stopped" } else { "free" },
            if self.faulted { " and faulted" } else { "" },
            self.supervisor,
        )
    }
}

#[derive(Clone, Copy, Debug)]
enum Event {
    /// Time passes up to the next moment.
    Pass,
    /// Time passes up to the next tick.
    Tick,
    /// The tick comes only just in time.
    Sleep,
    /// A fresh frame ends.
    Frame(Word),
    /// The robot comes to what waits.
    Handle,
    /// A fault is found that blocks.
    Fault,
}

/// The robot's priority, as it is or broken on purpose.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Robot {
    Right,
    /// The deadline is looked at only in ticks that follow a frame or a fault.
    Blind,
    /// A frame's time is when the robot comes to it, not when it ended.
    StampedLate,
    /// Ticks are handled before frames, whichever is older.
    TickFirst,
    /// Frames are handled before ticks, whichever is older.
    FrameFirst,
    /// That the deadline has run out is not kept.
    Forgetful,
    /// Any frame ends a stop.
    Eager,
    /// The loss of the link is latched only while nothing else has stopped the robot.
    Unlatched,
}

/// The code's clock.
#[allow(clippy::cast_possible_truncation, reason = "it wraps")]
fn micros(time: u64) -> Micros {
    Micros(time as u32)
}

impl State {
    /// The time is up, by the rules.
    fn silent(&self, now: u64) -> bool {
        self.received
            .is_some_and(|received| now - received >= DEADLINE)
    }

    /// A tick, by the rules.
    fn tick_at(&mut self, now: u64) {
        self.clock = now;
        self.ticked = now;
        self.ticks += 1;
        self.lost |= self.silent(now);
        self.stopped |= self.silent(now) || self.faulted;
        let permit = if self.stopped {
            AllowedMotion::Brake
        } else if self.received.is_some() {
            AllowedMotion::Drive
        } else {
            AllowedMotion::Coast
        };
        let attended = self.received.is_some() && !self.silent(now);
        self.tick = Some((now, permit, attended, self.lost));
    }

    /// A fresh frame, by the rules.
    fn frame_at(&mut self, now: u64, word: Word) {
        self.frames += 1;
        self.stopped |= self.silent(now);
        self.lost |= self.silent(now);
        self.received = Some(now);
        match word {
            Word::Alive => {}
            Word::Stop => self.stopped = true,
            Word::Resume => self.stopped = false,
            Word::Cured => (self.faulted, self.lost) = (false, false),
        }
        self.frame = Some((now, word));
    }
}

/// What awaits the robot, as the firmware shows it to [`next_event`].
struct Waiting {
    robot: Robot,
    frame: Option<Micros>,
    tick: Cell<Option<TickInput>>,
}

impl Pending for Waiting {
    type Frame = Micros;

    fn frame_ended_at(&mut self) -> Option<Micros> {
        self.frame.filter(|_| self.robot != Robot::TickFirst)
    }

    fn captured<R>(&mut self, f: impl FnOnce(&Cell<Option<TickInput>>, &Echoes) -> R) -> R {
        if self.robot == Robot::FrameFirst && self.frame.is_some() {
            self.tick.take();
        }
        f(&self.tick, &Echoes::new())
    }

    fn claim(self) -> Option<Micros> {
        self.frame
    }
}

impl Robot {
    /// The robot comes to the older of what waits.
    fn handle(self, next: &mut State) -> Result<(), String> {
        let tick = next.tick.map(|(at, ..)| TickInput {
            now: micros(at),
            ..TickInput::default()
        });
        let event = next_event(Waiting {
            robot: self,
            frame: next.frame.map(|(at, _)| micros(at)),
            tick: Cell::new(tick),
        });
        let tick_first = matches!(event, Some(Next::Tick(_)));
        match (next.frame, next.tick) {
            (_, Some((at, expected, attended, lost))) if tick_first => {
                next.tick = None;
                let wanted = expected != AllowedMotion::Coast;
                let mut supervisor = next.supervisor;
                let halted = supervisor.halted();
                let permit = if next.met || self != Self::Blind {
                    supervisor.on_tick(micros(at), wanted, wanted)
                } else {
                    next.permit
                };
                if self == Self::Blind {
                    next.permit = permit;
                    next.met = false;
                }
                if self != Self::Forgetful && !(self == Self::Unlatched && halted) {
                    next.supervisor = supervisor;
                }
                if permit == expected {
                    // What the servo's force goes by.
                    let latched = next.supervisor.faults().intersects(Faults::LINK_LOST);
                    return if next.supervisor.link_alive(micros(at)) != attended {
                        Err("whether frames arrive is mistaken".into())
                    } else if latched != lost && self != Self::Forgetful {
                        Err("the loss of the link is not latched, or still".into())
                    } else {
                        Ok(())
                    };
                }
                Err(match expected {
                    AllowedMotion::Brake => "the motors run although they must stand".into(),
                    _ => format!("{permit:?} although nothing stops the robot"),
                })
            }
            (Some((at, word)), _) => {
                next.frame = None;
                next.met = self == Self::Blind;
                let late = self == Self::StampedLate;
                let mut intent = word.intent();
                intent.resumes = self == Self::Eager;
                next.supervisor
                    .on_fresh(micros(if late { next.clock } else { at }), intent);
                Ok(())
            }
            _ => Ok(()),
        }
    }
}

impl Model for Robot {
    type State = State;
    type Event = Event;

    fn starts(&self) -> Vec<State> {
        vec![State {
            supervisor: Supervisor::new(StopDeadline::new(Milliseconds(DEADLINE_MS))),
            clock: START,
            ticked: START,
            slept: false,
            frame: None,
            tick: None,
            received: None,
            stopped: false,
            faulted: false,
            lost: false,
            permit: AllowedMotion::Coast,
            met: false,
            ticks: 0,
            frames: 0,
        }]
    }

    fn events(&self, state: &State) -> Vec<Event> {
        let mut events = Vec::new();
        let since = state.clock - state.ticked;
        if since < PERIOD - 1 {
            events.push(Event::Pass);
        }
        // The robot handles a tick before the next one.
        if state.tick.is_none() && state.ticks < TICKS {
            events.push(Event::Tick);
            if !state.slept && state.frame.is_none() {
                events.push(Event::Sleep);
            }
        }
        if since > 0 && state.frame.is_none() && state.frames < FRAMES {
            events.extend(Word::ALL.map(Event::Frame));
        }
        if state.frame.is_some() || state.tick.is_some() {
            events.push(Event::Handle);
        } else if !state.faulted {
            events.push(Event::Fault);
        }
        events
    }

    fn step(&self, state: &State, event: &Event) -> Result<State, String> {
        let mut next = *state;
        match *event {
            Event::Pass => {
                let since = state.clock - state.ticked;
                let moment = MOMENTS.into_iter().find(|&moment| moment > since);
                next.clock = state.ticked + moment.unwrap_or(since);
            }
            Event::Tick => next.tick_at(state.ticked + PERIOD),
            Event::Sleep => {
                next.slept = true;
                next.tick_at(state.ticked + SLEEP);
            }
            Event::Frame(word) => next.frame_at(state.clock, word),
            Event::Handle => self.handle(&mut next)?,
            Event::Fault => {
                next.faulted = true;
                next.stopped = true;
                next.met = *self == Self::Blind;
                next.supervisor.raise(FAULT);
            }
        }
        Ok(next)
    }
}

// Requirement: WIRE-deadline-1, WIRE-deadline-2
#[test]
fn deadline_is_exact_in_every_order() {
    assert_holds(&Robot::Right, 10_000);
}

#[test]
fn broken_deadline_is_found() {
    assert_broken(&[
        (Robot::Blind, "must stand"),
        (Robot::StampedLate, "must stand"),
        (Robot::TickFirst, "is mistaken"),
        (Robot::FrameFirst, "is mistaken"),
        (Robot::Forgetful, "must stand"),
        (Robot::Eager, "must stand"),
        (Robot::Unlatched, "is not latched"),
    ]);
}
