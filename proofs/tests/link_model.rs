//! T8, every order of events: the core's own link and supervisor under a Pi that sends or not, and a
//! wire that delivers, loses, repeats, overtakes and corrupts.
//!
//! The state is the code's own: what the search visits is what runs on the robot.
//!
//! `cargo test -p proofs --test link_model -- --nocapture` shows the way to each broken invariant.

use std::collections::hash_map::DefaultHasher;
use std::fmt;
use std::hash::{Hash, Hasher};

use fw_core::motion::StopDeadline;
use fw_core::robot::{AllowedMotion, Supervisor, SupervisorCommand};
use fw_core::types::{Micros, Milliseconds};
use fw_core::wire::{Command, MAX_FRAME, Mode, Order, PiLink, Report, Setup, StmLink};
use proofs::search::{Model, assert_broken, assert_holds};

const SETUP: Setup = Setup::first_board(Mode::GuardedTuneRotate);
const LEN: usize = 18;
/// Frames the Pi sends at most.
const FRAMES: usize = 5;
/// Half the deadline passes with a tick; ticks at most.
const DEADLINE_MS: u16 = 100;
const TICK_US: u32 = 50_000;
const TICKS: u8 = 6;
/// The clock wraps within the run.
const START: Micros = Micros(u32::MAX - 2 * TICK_US);

/// What the future depends on: all but the counters of what happened.
type Essence = (
    Vec<u8>,
    Supervisor,
    usize,
    u8,
    (Option<usize>, Option<(usize, usize)>),
    (Option<Micros>, Option<AllowedMotion>),
);

#[derive(Clone)]
struct State {
    pi: PiLink,
    stm: StmLink,
    supervisor: Supervisor,
    /// Every frame the Pi ever sent: the wire may hand any of them on, at any time.
    sent: Vec<[u8; MAX_FRAME]>,
    ticks: u8,
    /// What should be known: the newest frame that arrived whole, and when.
    newest: Option<usize>,
    received: Option<Micros>,
    /// The last of the old frames handed on one after the other, in the order they were sent, and
    /// how many they are.
    row: Option<(usize, usize)>,
    /// What the last tick permitted, unless a frame was taken since; for [`Link::Blind`] alone.
    permit: Option<AllowedMotion>,
}

impl State {
    fn now(&self) -> Micros {
        START.after(u32::from(self.ticks) * TICK_US)
    }

    fn essence(&self) -> Essence {
        let mut reply = [0; MAX_FRAME];
        let len = self.stm.encode_reply(1, &Report::default(), &mut reply);
        (
            reply[..len].to_vec(),
            self.supervisor,
            self.sent.len(),
            self.ticks,
            (self.newest, self.row),
            (self.received, self.permit),
        )
    }
}

impl PartialEq for State {
    fn eq(&self, other: &Self) -> bool {
        self.essence() == other.essence() && self.sent == other.sent
    }
}

impl Eq for State {}

impl Hash for State {
    fn hash<H: Hasher>(&self, state: &mut H) {
        let mut inner = DefaultHasher::new();
        format!("{:?}", self.essence()).hash(&mut inner);
        state.write_u64(inner.finish());
        self.sent.hash(state);
    }
}

impl fmt::Debug for State {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "tick {}, {} sent, newest received {:?} at {:?}, {:?}",
            self.ticks,
            self.sent.len(),
            self.newest,
            self.received,
            self.supervisor
        )
    }
}

#[derive(Clone, Copy, Debug)]
enum Event {
    /// The Pi sends; the frame is on the wire from now on.
    Send(Order),
    /// The wire hands on a frame, any that was ever sent.
    Deliver(usize),
    /// The same with a wrong bit.
    Corrupt(usize),
    /// Half a deadline passes, and the tick comes.
    Tick,
}

/// The link and who looks at it, as they are or broken on purpose.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Link {
    Right,
    /// A frame that is not fresh feeds the deadline all the same.
    Trusting,
    /// The deadline is looked at only in ticks that follow a frame.
    Blind,
    /// Which frame was the last is not kept.
    Forgetful,
}

impl Model for Link {
    type State = State;
    type Event = Event;

    fn starts(&self) -> Vec<State> {
        // The Pi's numbers wrap within the run.
        let mut pi = PiLink::new(SETUP);
        for _ in 0..254 {
            let _ = pi.send(&Command::default(), &mut [0; MAX_FRAME]);
        }
        vec![State {
            pi,
            stm: StmLink::new(SETUP),
            supervisor: Supervisor::new(StopDeadline::new(Milliseconds(DEADLINE_MS))),
            sent: Vec::new(),
            ticks: 0,
            newest: None,
            received: None,
            row: None,
            permit: None,
        }]
    }

    fn events(&self, state: &State) -> Vec<Event> {
        let mut events = Vec::new();
        if state.sent.len() < FRAMES {
            events.push(Event::Send(Order::Resume));
            events.push(Event::Send(Order::None));
        }
        for frame in 0..state.sent.len() {
            events.push(Event::Deliver(frame));
            events.push(Event::Corrupt(frame));
        }
        if state.ticks < TICKS {
            events.push(Event::Tick);
        }
        events
    }

    fn step(&self, state: &State, event: &Event) -> Result<State, String> {
        let mut next = state.clone();
        match *event {
            Event::Send(order) => {
                let command = Command {
                    order,
                    ..Command::default()
                };
                let mut frame = [0; MAX_FRAME];
                assert_eq!(next.pi.send(&command, &mut frame), LEN);
                next.sent.push(frame);
            }
            Event::Corrupt(which) => {
                let mut frame = next.sent[which];
                frame[5 + which] ^= 0x10;
                if next.stm.receive(&frame[..LEN], 0, 1).is_ok() {
                    return Err("a corrupted frame was taken".into());
                }
            }
            Event::Deliver(which) => {
                next.row = match (next.newest, next.row) {
                    (None, _) => None,
                    (Some(newest), _) if which >= newest => None,
                    (_, Some((last, row))) if which == last + 1 => Some((which, row + 1)),
                    _ => Some((which, 1)),
                };
                // Four old frames in a row that count upwards are another beginning, not repeats.
                let restarted = next.row.is_some_and(|(_, row)| row == 4);
                let fresh = restarted || next.newest.is_none_or(|newest| which > newest);
                if *self == Self::Forgetful {
                    next.stm = StmLink::new(SETUP);
                }
                let received = next.stm.receive(&next.sent[which][..LEN], 0, 1);
                if received.is_ok() != fresh {
                    return Err(
                        "a frame was taken that is not fresh, or a fresh one was not".into(),
                    );
                }
                let now = next.now();
                if fresh {
                    next.row = None;
                    next.newest = Some(which);
                    next.received = Some(now);
                }
                let intent = |command: Command| SupervisorCommand {
                    resumes: false,
                    order: command.order,
                    clear_faults: command.clear_faults,
                };
                if let Ok(command) = received {
                    next.supervisor.on_fresh(now, intent(command));
                    next.permit = None;
                } else if *self == Self::Trusting {
                    next.supervisor.on_fresh(now, SupervisorCommand::default());
                }
            }
            Event::Tick => {
                next.ticks += 1;
                let now = next.now();
                let permit = match next.permit {
                    Some(before) => before,
                    None => next.supervisor.on_tick(now, true, true),
                };
                if *self == Self::Blind {
                    next.permit = Some(permit);
                }
                let allowed = u32::from(DEADLINE_MS) * 1000;
                let silent = next
                    .received
                    .is_some_and(|received| now.since(received) >= allowed);
                if silent && permit != AllowedMotion::Brake {
                    return Err("the motors run although the link has been silent".into());
                }
            }
        }
        Ok(next)
    }
}

// Requirement: WIRE-deadline-1
#[test]
fn link_silence_brakes_in_every_order() {
    assert_holds(&Link::Right, 1_000);
}

#[test]
fn broken_link_is_found() {
    assert_broken(&[
        (Link::Trusting, "silent"),
        (Link::Blind, "silent"),
        (Link::Forgetful, "not fresh"),
    ]);
}
