//! T11, every interleaving of the hand-over between the SPI's DMA, the chip-select's interrupt and the
//! robot, as the head of `fw-pac/src/spi.rs` describes it.
//!
//! Registers cannot run here, so this is a model of that code and not the code. Its steps are the
//! code's masked stretches and, in between, every byte that the robot writes or reads; the wire and
//! the DMA may come before and after each, within masked stretches too. Two assumptions, both the
//! interfaces' own: a frame's end is handled before the next frame begins (20 µs against some 2), and
//! no masked stretch is longer than that.
//!
//! `cargo test -p proofs --test handover_model -- --nocapture` shows the way to each broken invariant.

use std::fmt;

use proofs::search::{search, Model};

/// Bytes of a frame: a key that all replies share, then two of the reply's own.
const LEN: usize = 3;
/// Frames and ticks at most: enough for every buffer to change its role and come back.
const FRAMES: u8 = 4;
const TICKS: u8 = 2;
/// Receive and transmit buffers.
const RECEIVE: usize = 3;
const TRANSMIT: usize = 4;

/// A reply in its buffer.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
struct Reply {
    buffer: usize,
    number: u8,
}

/// What a reply under construction is for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
enum Purpose {
    /// `Claim::answer`: the frame is read, and given back with the reply.
    Answer,
    /// `stand_by`, before a tick's work.
    StandBy,
    /// `answer`, after it.
    Tick,
}

/// Where the robot is in its work.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
enum Robot {
    Idle,
    /// About to choose a free buffer, and to learn which reply is due.
    Choosing(Purpose),
    /// Building a reply: so many bytes are there.
    Building {
        purpose: Purpose,
        reply: Reply,
        built: usize,
    },
    /// Masked: the chip-select was high, the stream is about to be stopped.
    Stopping(Purpose, Reply),
    /// Masked: the stream stands; so many bytes had left the armed buffer.
    Comparing(Purpose, Reply, usize),
    /// Reading the claimed frame in place: so many bytes, all of them of this frame so far. The
    /// reply has its buffer and number since the claim.
    Reading {
        read: usize,
        frame: u8,
        reply: Reply,
    },
}

/// Bytes on their way, at most a frame of them; in place, for there are millions of states.
#[derive(Clone, Copy, Default, PartialEq, Eq, Hash)]
struct Bytes {
    /// 0 from `len` on.
    bytes: [u8; LEN],
    len: u8,
}

impl Bytes {
    fn as_slice(&self) -> &[u8] {
        &self.bytes[..usize::from(self.len)]
    }

    fn push(&mut self, byte: u8) {
        self.bytes[usize::from(self.len)] = byte;
        self.len += 1;
    }

    /// Takes out the first.
    fn take(&mut self) -> u8 {
        let first = self.bytes[0];
        self.bytes.rotate_left(1);
        self.bytes[LEN - 1] = 0;
        self.len -= 1;
        first
    }
}

impl fmt::Debug for Bytes {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.as_slice().fmt(f)
    }
}

#[allow(clippy::struct_excessive_bools, reason = "each is a pin or a flag")]
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
struct State {
    robot: Robot,
    /// Every byte of the receive buffers is the number of the frame it came with.
    frames: [[u8; LEN]; RECEIVE],
    receiving: usize,
    received: usize,
    /// Buffer and length.
    ended: Option<(usize, usize)>,
    taken: Option<(usize, usize)>,
    lost: u8,
    /// Every byte of the transmit buffers but the key is the serial number of the building.
    replies: [[u8; LEN]; TRANSMIT],
    built: u8,
    armed: Reply,
    spent: bool,
    standby: Option<Reply>,
    /// Bytes the stream has taken out of the armed buffer; it stands while it is redirected.
    sent: usize,
    standing: bool,
    /// The bytes the transmitter has and the wire has not had.
    held: Bytes,
    /// What the Pi has read of the frame under way.
    wire: Bytes,
    /// The chip-select is low; its rise awaits its interrupt.
    low: bool,
    rise: bool,
    begun: u8,
    done: u8,
    claimed: u8,
    ticks: u8,
    /// The number of the reply that the last frame carried.
    carried: Option<u8>,
}

#[derive(Clone, Copy, Debug)]
enum Event {
    /// The chip-select falls.
    Fall,
    /// A byte crosses the wire, both ways.
    Clock,
    /// The stream hands the transmitter a byte.
    Feed,
    /// The chip-select rises.
    Rise,
    /// Its interrupt.
    FrameEnd,
    /// The robot claims the frame that ended.
    Claim,
    /// The robot begins a tick.
    Tick,
    /// The robot goes on.
    Go,
}

/// The hand-over, as it is or broken on purpose.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum HandOver {
    Right,
    /// The buffer is chosen without regard to the standby.
    ForgetStandby,
    /// The stream goes on in the new reply whatever it has sent of the old one.
    NoCompare,
    /// A reply is armed whatever its number.
    NoNumber,
    /// A frame that is replaced is not counted.
    NotCounted,
    /// The next receive buffer is chosen without regard to the one taken.
    ForgetTaken,
}

impl State {
    fn masked(&self) -> bool {
        matches!(self.robot, Robot::Stopping(..) | Robot::Comparing(..))
    }

    /// What is in a free buffer is overwritten before it is read: states that differ only there are
    /// one.
    fn forget(&mut self) {
        let building = match self.robot {
            Robot::Building { reply, .. }
            | Robot::Stopping(_, reply)
            | Robot::Comparing(_, reply, _) => Some(reply.buffer),
            _ => None,
        };
        let standby = self.standby.map(|reply| reply.buffer);
        for (buffer, reply) in self.replies.iter_mut().enumerate() {
            if buffer != self.armed.buffer && Some(buffer) != standby && Some(buffer) != building {
                *reply = [0; LEN];
            }
        }
        let (ended, taken) = (self.ended.map(|of| of.0), self.taken.map(|of| of.0));
        for (buffer, frame) in self.frames.iter_mut().enumerate() {
            if buffer != self.receiving && Some(buffer) != ended && Some(buffer) != taken {
                *frame = [0; LEN];
            }
        }
    }

    /// Goes on after a reply.
    fn after(&mut self, purpose: Purpose) {
        self.robot = match purpose {
            Purpose::StandBy => Robot::Choosing(Purpose::Tick),
            Purpose::Answer | Purpose::Tick => Robot::Idle,
        };
    }

    /// The number of the reply that is due.
    fn due(&self) -> u8 {
        self.armed.number + u8::from(self.spent)
    }

    /// Begins a reply in `reply`'s buffer.
    fn build(&mut self, purpose: Purpose, reply: Reply) {
        // More than there are buffers: no two at a time have the same.
        self.built = self.built % 6 + 1;
        self.robot = Robot::Building {
            purpose,
            reply,
            built: 0,
        };
    }
}

impl HandOver {
    fn frame_end(self, next: &mut State) -> Result<(), String> {
        next.rise = false;
        if next
            .wire
            .as_slice()
            .windows(2)
            .skip(1)
            .any(|pair| pair[0] != pair[1])
        {
            return Err(format!("the Pi read parts of two replies: {:?}", next.wire));
        }
        // Numbers on the wire go up by one, or stay where the robot has not kept up.
        let number = next.armed.number;
        if next
            .carried
            .is_some_and(|last| number != last && number != last + 1)
        {
            return Err(format!("reply {number} after {:?}", next.carried));
        }
        next.carried = Some(number);
        next.wire = Bytes::default();
        next.held = Bytes::default();
        match next.standby.take() {
            Some(standby) => {
                next.armed = standby;
                next.spent = false;
            }
            None => next.spent = true,
        }
        next.sent = 0;
        next.done += 1;
        if next.ended.is_some() && self != Self::NotCounted {
            next.lost += 1;
        }
        let buffer = next.receiving;
        next.ended = Some((buffer, next.received));
        next.receiving = match next.taken {
            Some((taken, _)) if self != Self::ForgetTaken => RECEIVE - buffer - taken,
            _ => (buffer + 1) % RECEIVE,
        };
        next.received = 0;
        Ok(())
    }

    /// `State::vacancy`: a buffer that is free, and the number of the reply that is due.
    fn vacancy(self, next: &State) -> Reply {
        let standby = next.standby.map_or(next.armed.buffer, |reply| reply.buffer);
        let beside = (next.armed.buffer + 1) % TRANSMIT;
        let buffer = if beside == standby && self != Self::ForgetStandby {
            (beside + 1) % TRANSMIT
        } else {
            beside
        };
        Reply {
            buffer,
            number: next.due(),
        }
    }

    /// `give`, up to where it stops the stream; masked.
    fn give(self, next: &mut State, purpose: Purpose, reply: Reply) {
        if purpose == Purpose::Answer {
            next.taken = None;
        }
        let due = reply.number == next.due();
        if (due || self == Self::NoNumber) && !next.low {
            next.robot = Robot::Stopping(purpose, reply);
            return;
        }
        let stands = if due {
            next.spent
        } else {
            !next.spent && reply.number == next.armed.number + 1
        };
        if stands {
            next.standby = Some(reply);
        }
        next.after(purpose);
    }

    fn go(self, next: &mut State) -> Result<(), String> {
        match next.robot {
            Robot::Idle => {}
            Robot::Choosing(purpose) => {
                let mut reply = self.vacancy(next);
                if purpose == Purpose::StandBy && !next.spent {
                    reply.number += 1;
                }
                next.build(purpose, reply);
            }
            Robot::Building {
                purpose,
                reply,
                built,
            } => {
                if built == LEN {
                    self.give(next, purpose, reply);
                    return Ok(());
                }
                let standby = next.standby.map(|reply| reply.buffer);
                if reply.buffer == next.armed.buffer || Some(reply.buffer) == standby {
                    return Err("a reply is written into a buffer that is not free".into());
                }
                next.replies[reply.buffer][built] = if built == 0 { 0 } else { next.built };
                next.robot = Robot::Building {
                    purpose,
                    reply,
                    built: built + 1,
                };
            }
            Robot::Stopping(purpose, reply) => {
                next.standing = true;
                next.robot = Robot::Comparing(purpose, reply, next.sent);
            }
            Robot::Comparing(purpose, reply, sent) => {
                let old = &next.replies[next.armed.buffer][..sent];
                if old == &next.replies[reply.buffer][..sent] || self == Self::NoCompare {
                    next.armed = reply;
                    next.spent = false;
                } else if next.spent {
                    next.standby = Some(reply);
                }
                next.standing = false;
                next.after(purpose);
            }
            Robot::Reading { read, frame, reply } => {
                let Some((buffer, len)) = next.taken else {
                    return Err("nothing is claimed".into());
                };
                if read == len {
                    next.build(Purpose::Answer, reply);
                    return Ok(());
                }
                let byte = next.frames[buffer][read];
                if read > 0 && byte != frame {
                    return Err("the robot read parts of two frames".into());
                }
                next.robot = Robot::Reading {
                    read: read + 1,
                    frame: byte,
                    reply,
                };
            }
        }
        Ok(())
    }
}

impl Model for HandOver {
    type State = State;
    type Event = Event;

    fn starts(&self) -> Vec<State> {
        vec![State {
            robot: Robot::Idle,
            frames: [[0; LEN]; RECEIVE],
            receiving: 0,
            received: 0,
            ended: None,
            taken: None,
            lost: 0,
            replies: [[0; LEN]; TRANSMIT],
            built: 0,
            armed: Reply {
                buffer: 0,
                number: 0,
            },
            spent: false,
            standby: None,
            sent: 0,
            standing: false,
            held: Bytes::default(),
            wire: Bytes::default(),
            low: false,
            rise: false,
            begun: 0,
            done: 0,
            claimed: 0,
            ticks: 0,
            carried: None,
        }]
    }

    fn events(&self, state: &State) -> Vec<Event> {
        let mut events = Vec::new();
        // The wire and the DMA go on whatever the processor does.
        if !state.low && !state.rise && state.begun < FRAMES {
            events.push(Event::Fall);
        }
        if state.low {
            events.push(Event::Rise);
            if state.received < LEN && state.held.len > 0 {
                events.push(Event::Clock);
            }
        }
        // The transmitter holds two bytes: the one under way and the next.
        if !state.standing && !state.rise && state.sent < LEN && state.held.len < 2 {
            events.push(Event::Feed);
        }
        if state.rise && !state.masked() {
            events.push(Event::FrameEnd);
        }
        if state.robot == Robot::Idle {
            if state.ended.is_some() {
                events.push(Event::Claim);
            }
            if state.ticks < TICKS {
                events.push(Event::Tick);
            }
        } else {
            events.push(Event::Go);
        }
        events
    }

    fn step(&self, state: &State, event: &Event) -> Result<State, String> {
        let mut next = *state;
        match event {
            Event::Fall => {
                next.low = true;
                next.begun += 1;
            }
            Event::Clock => {
                let sent = next.held.take();
                next.wire.push(sent);
                let owned =
                    |of: Option<(usize, usize)>| of.is_some_and(|of| of.0 == next.receiving);
                if owned(next.taken) || owned(next.ended) {
                    return Err("the DMA writes a frame that is the robot's".into());
                }
                let (buffer, at) = (next.receiving, next.received);
                next.frames[buffer][at] = next.begun;
                next.received += 1;
            }
            Event::Feed => {
                next.held.push(next.replies[next.armed.buffer][next.sent]);
                next.sent += 1;
            }
            Event::Rise => {
                next.low = false;
                next.rise = true;
            }
            Event::FrameEnd => self.frame_end(&mut next)?,
            Event::Claim => {
                next.taken = next.ended.take();
                next.claimed += 1;
                next.robot = Robot::Reading {
                    read: 0,
                    frame: 0,
                    reply: self.vacancy(&next),
                };
            }
            Event::Tick => {
                next.ticks += 1;
                next.robot = Robot::Choosing(Purpose::StandBy);
            }
            Event::Go => self.go(&mut next)?,
        }
        next.forget();
        let waiting = u8::from(next.ended.is_some());
        if next.claimed + next.lost + waiting != next.done {
            return Err("a frame was lost without being counted".into());
        }
        Ok(next)
    }
}

const LIMIT: usize = 10_000_000;

// Requirement: DOC-3.3-1
#[test]
fn no_interleaving_tears_a_frame_or_loses_one_unseen() {
    let visited = search(&HandOver::Right, LIMIT).unwrap_or_else(|found| panic!("{found}"));
    println!("{visited:?}");
    assert!(visited.states > 10_000);
}

#[test]
fn every_way_to_break_the_hand_over_is_found() {
    for (broken, expected) in [
        (HandOver::ForgetStandby, "not free"),
        (HandOver::NoCompare, "two replies"),
        (HandOver::NoNumber, "after"),
        (HandOver::NotCounted, "without being counted"),
        (HandOver::ForgetTaken, "is the robot's"),
    ] {
        let found = search(&broken, LIMIT).expect_err("broken");
        println!("{broken:?}: {found}");
        assert!(found.broken.contains(expected), "{broken:?}: {found}");
    }
}
