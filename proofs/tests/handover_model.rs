//! T11: every interleaving of the wire, the SPI's DMA, the chip-select interrupt and the robot around
//! `fw_core::wire::handover`, the code that the firmware runs.
//!
//! The model's steps are the firmware's masked sections and, between them, every byte that the robot reads
//! or writes. Assumptions: a rising edge is handled before the next falling edge; an answer that is
//! accepted within `SWAP_WINDOW_US` is armed before the gap ends (docs/interfaces.md: 20 µs); the
//! transmitter fetches no byte beyond `SAME_PREFIX` between the check and the stores of a refresh.

use fw_core::types::Micros;
use fw_core::wire::handover::{GAP_US, Handover, RX_BUFFERS, Reply, SWAP_WINDOW_US, TX_BUFFERS};
use proofs::search::{Model, assert_broken, assert_holds};

/// Bytes of a frame: a key that all replies share, one that some share, then two of the reply's own.
const LEN: usize = 4;
/// Bytes that the transmitter has fetched at most when a refresh is stored, in place of `SAME_PREFIX`: two
/// held ready, none in the time that the refresh takes.
const FETCHED: u8 = 2;
/// Frames and ticks at most: enough for every buffer to change its role and come back.
const FRAMES: u8 = 3;
const TICKS: u8 = 1;

/// Use of a reply under construction.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
enum Purpose {
    Answer,
    /// The armed reply again.
    Refresh,
    Standby,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
enum Robot {
    Idle,
    /// Reading the claimed frame of `len` bytes: `read` of them, all equal to `frame`.
    Reading {
        buffer: u8,
        len: u8,
        read: u8,
        frame: u8,
        answer: Reply,
    },
    /// Building a reply; so many bytes of it are built.
    Building(Reply, Purpose, u8),
    /// Masked: a refresh was found possible and is about to be stored, from one buffer into the other.
    Refreshing(u8, u8),
}

#[allow(clippy::struct_excessive_bools, reason = "each is a pin or a flag")]
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
struct State {
    handover: Handover,
    robot: Robot,
    /// Every byte of a receive buffer is the number of the frame it came with.
    rx: [[u8; LEN]; RX_BUFFERS as usize],
    received: u8,
    /// The buffer of the frame that ended last.
    waiting: u8,
    /// Every byte of a transmit buffer but the key is the serial number of its building.
    tx: [[u8; LEN]; TX_BUFFERS as usize],
    serial: u8,
    /// The DMA's buffers as the firmware armed them.
    receive: u8,
    transmit: u8,
    /// Bytes that the DMA took of the armed reply; the last ones are still in the transmitter.
    fed: u8,
    held: [u8; 2],
    holds: u8,
    /// Bytes that the Pi has read of the frame under way.
    wire: [u8; LEN],
    sent: u8,
    low: bool,
    /// The rising edge awaits its interrupt.
    risen: bool,
    /// Less than [`SWAP_WINDOW_US`] since the rising edge: the wire is idle by agreement.
    gap: bool,
    begun: u8,
    ended: u8,
    claimed: u8,
    lost: u8,
    ticks: u8,
    /// The number of the reply that the last frame carried.
    carried: Option<u32>,
    /// The number of the reply under way.
    under_way: u32,
    /// The robot has had nothing to do since the last frame ended.
    rested: bool,
    /// The last frame ended before the robot was done with the one before.
    hurried: bool,
}

/// The second byte of the reply with a serial number: every other one has the same.
const fn shared(serial: u8) -> u8 {
    10 + serial % 2
}

#[derive(Clone, Copy, Debug)]
enum Event {
    Fall,
    /// A byte crosses the wire, both ways.
    Clock,
    /// The DMA hands the transmitter a byte.
    Feed,
    Rise,
    /// The chip-select interrupt.
    EndFrame,
    /// The gap is over: the wire may be busy again.
    GapEnds,
    Claim,
    Tick,
    /// The robot goes on.
    Go,
}

/// The firmware's calls, right or broken on purpose.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Caller {
    Right,
    /// Builds in the buffer after the free one.
    WrongBuffer,
    /// Takes any time for one within the gap.
    AnyTimeIsGap,
    /// Builds no standby after an answer.
    NoStandby,
    /// Ignores the count of lost frames.
    LostIgnored,
    /// Arms the answer without resetting the transmitter.
    NoReset,
    /// Refreshes a reply that begins otherwise.
    AnyPrefix,
}

impl State {
    /// Makes states that differ only in bytes that are never read again equal.
    fn normalise(&mut self) {
        let next = self.handover.next_reply();
        let building = match self.robot {
            Robot::Building(reply, ..) => Some(reply.buffer),
            Robot::Refreshing(fresh, _) => Some(fresh),
            _ => None,
        };
        if building != Some(next.buffer) {
            self.tx[usize::from(next.buffer)] = [0; LEN];
        }
        for (buffer, frame) in (0..).zip(&mut self.rx) {
            let waits = self.handover.ended_at().is_some() && buffer == self.waiting;
            let read = matches!(self.robot, Robot::Reading { buffer: of, .. } if of == buffer);
            if !waits && !read && buffer != self.receive {
                *frame = [0; LEN];
            }
        }
    }

    fn build(&mut self, caller: Caller, purpose: Purpose, mut reply: Reply) {
        if caller == Caller::WrongBuffer && purpose == Purpose::Standby {
            reply.buffer = (reply.buffer + 1) % TX_BUFFERS;
        }
        // More values than there are buffers: no two at a time have the same.
        self.serial = self.serial % 6 + 1;
        self.robot = Robot::Building(reply, purpose, 0);
    }

    fn arm(&mut self, caller: Caller, receive: u8, transmit: u8, number: u32, answer: bool) {
        self.receive = receive;
        self.transmit = transmit;
        self.under_way = number;
        self.received = 0;
        self.fed = 0;
        if !answer || caller != Caller::NoReset {
            self.held = [0; 2];
            self.holds = 0;
        }
    }
}

impl Caller {
    fn end_frame(self, next: &mut State) -> Result<(), String> {
        next.risen = false;
        let wire = &next.wire[..usize::from(next.sent)];
        let torn = match wire {
            [key, second, rest @ ..] => {
                let same = rest.windows(2).all(|pair| pair[0] == pair[1]);
                let own = rest.first().is_none_or(|&serial| shared(serial) == *second);
                *key != 0 || *second == 0 || !same || !own
            }
            _ => false,
        };
        if torn {
            return Err(format!("the Pi read parts of two replies: {wire:?}"));
        }
        let number = next.under_way;
        let follows = |last| number == last || number == last + 1;
        if !next.carried.is_none_or(follows) {
            return Err(format!("reply {number} after {:?}", next.carried));
        }
        if next.carried == Some(number) && !next.hurried {
            return Err(format!("reply {number} is repeated without need"));
        }
        next.carried = Some(number);
        next.wire = [0; LEN];
        next.sent = 0;
        next.hurried = !core::mem::take(&mut next.rested);
        next.ended += 1;
        next.waiting = next.receive;
        let dma = next.handover.end_frame(next.received, Micros(0));
        let number = next.handover.next_reply().number - 1;
        next.arm(self, dma.receive, dma.transmit, number, false);
        next.gap = true;
        Ok(())
    }

    fn submit(self, next: &mut State, reply: Reply, purpose: Purpose) {
        next.robot = Robot::Idle;
        match purpose {
            Purpose::Answer => {
                let late = !next.gap && self != Self::AnyTimeIsGap;
                let now = Micros(SWAP_WINDOW_US + u32::from(late));
                if let Some(dma) = next.handover.answer(reply, now) {
                    next.arm(self, dma.receive, dma.transmit, reply.number, true);
                }
                if self != Self::NoStandby {
                    next.build(self, Purpose::Standby, next.handover.next_reply());
                }
            }
            Purpose::Refresh => {
                let bytes = |buffer: u8| &next.tx[usize::from(buffer)][..usize::from(FETCHED)];
                let begin_alike =
                    bytes(reply.buffer) == bytes(next.transmit) || self == Self::AnyPrefix;
                let idle = !next.low && next.fed <= FETCHED;
                match next.handover.refresh(reply, begin_alike) {
                    Some(armed) if idle => next.robot = Robot::Refreshing(reply.buffer, armed),
                    _ => next.build(self, Purpose::Standby, next.handover.next_reply()),
                }
            }
            Purpose::Standby => next.handover.stand_by(reply),
        }
    }

    fn go(self, next: &mut State) -> Result<(), String> {
        match next.robot {
            Robot::Idle => {}
            Robot::Reading {
                buffer,
                len,
                read,
                frame,
                answer,
            } => {
                if read == len {
                    next.build(self, Purpose::Answer, answer);
                    return Ok(());
                }
                let byte = next.rx[usize::from(buffer)][usize::from(read)];
                if read > 0 && byte != frame {
                    return Err("the robot read parts of two frames".into());
                }
                next.robot = Robot::Reading {
                    buffer,
                    len,
                    read: read + 1,
                    frame: byte,
                    answer,
                };
            }
            Robot::Building(reply, purpose, built) => {
                if usize::from(built) < LEN {
                    if reply.buffer == next.transmit {
                        return Err("the robot writes the armed buffer".into());
                    }
                    next.tx[usize::from(reply.buffer)][usize::from(built)] = match built {
                        0 => 0,
                        1 => shared(next.serial),
                        _ => next.serial,
                    };
                    next.robot = Robot::Building(reply, purpose, built + 1);
                } else {
                    self.submit(next, reply, purpose);
                }
            }
            Robot::Refreshing(fresh, armed) => {
                next.tx[usize::from(armed)] = next.tx[usize::from(fresh)];
                next.build(self, Purpose::Standby, next.handover.next_reply());
            }
        }
        Ok(())
    }
}

impl Model for Caller {
    type State = State;
    type Event = Event;

    fn starts(&self) -> Vec<State> {
        let mut handover = Handover::new(1);
        handover.stand_by(handover.next_reply());
        let dma = handover.dma_buffers();
        vec![State {
            handover,
            robot: Robot::Idle,
            rx: [[0; LEN]; RX_BUFFERS as usize],
            received: 0,
            waiting: 0,
            tx: [[0, 11, 7, 7], [0, 10, 8, 8], [0; LEN]],
            serial: 0,
            receive: dma.receive,
            transmit: dma.transmit,
            fed: 0,
            held: [0; 2],
            holds: 0,
            wire: [0; LEN],
            sent: 0,
            low: false,
            risen: false,
            gap: false,
            begun: 0,
            ended: 0,
            claimed: 0,
            lost: 0,
            ticks: 0,
            carried: None,
            under_way: 1,
            rested: true,
            hurried: false,
        }]
    }

    fn events(&self, state: &State) -> Vec<Event> {
        let mut events = Vec::new();
        // The wire and the DMA go on whatever the processor does.
        if !state.low && !state.risen && !state.gap && state.begun < FRAMES {
            events.push(Event::Fall);
        }
        if state.low {
            events.push(Event::Rise);
            if usize::from(state.sent) < LEN && state.holds > 0 {
                events.push(Event::Clock);
            }
        }
        // The transmitter holds two bytes: the one under way and the next.
        let masked = matches!(state.robot, Robot::Refreshing(..));
        let in_time = !masked || state.fed < FETCHED;
        if !state.risen && usize::from(state.fed) < LEN && state.holds < 2 && in_time {
            events.push(Event::Feed);
        }
        if state.risen && !masked {
            events.push(Event::EndFrame);
        }
        if state.gap && !state.risen {
            events.push(Event::GapEnds);
        }
        if state.robot == Robot::Idle {
            if state.handover.ended_at().is_some() {
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
                next.wire[usize::from(next.sent)] = next.held[0];
                next.sent += 1;
                next.held = [next.held[1], 0];
                next.holds -= 1;
                if matches!(next.robot, Robot::Reading { buffer, .. } if buffer == next.receive) {
                    return Err("the DMA writes a frame that is the robot's".into());
                }
                if usize::from(next.received) < LEN {
                    next.rx[usize::from(next.receive)][usize::from(next.received)] = next.begun;
                    next.received += 1;
                }
            }
            Event::Feed => {
                let at = usize::from(next.fed);
                next.held[usize::from(next.holds)] = next.tx[usize::from(next.transmit)][at];
                next.holds += 1;
                next.fed += 1;
            }
            Event::Rise => {
                next.low = false;
                next.risen = true;
            }
            Event::EndFrame => self.end_frame(&mut next)?,
            Event::GapEnds => next.gap = false,
            Event::Claim => {
                let claim = next.handover.claim().ok_or("nothing to claim")?;
                next.claimed += 1;
                if *self != Self::LostIgnored {
                    next.lost += u8::try_from(claim.lost).unwrap_or(u8::MAX);
                }
                next.robot = Robot::Reading {
                    buffer: claim.frame.buffer,
                    len: claim.frame.clocked,
                    read: 0,
                    frame: 0,
                    answer: claim.answer,
                };
            }
            Event::Tick => {
                next.ticks += 1;
                match next.handover.fresh_reply() {
                    Some(reply) => next.build(*self, Purpose::Refresh, reply),
                    None => next.build(*self, Purpose::Standby, next.handover.next_reply()),
                }
            }
            Event::Go => self.go(&mut next)?,
        }
        next.normalise();
        // Frames that end while one awaits the robot are counted when the next one is claimed.
        if next.robot == Robot::Idle && next.handover.ended_at().is_none() {
            next.rested = true;
            let seen = next.claimed + next.lost;
            if seen != next.ended {
                return Err(format!("{} frames ended, {seen} were seen", next.ended));
            }
        }
        Ok(next)
    }
}

// Requirement: DOC-3.3-1
#[test]
fn handover_every_interleaving_tears_and_loses_nothing() {
    const { assert!(SWAP_WINDOW_US < GAP_US) };
    assert_holds(&Caller::Right, 10_000);
}

#[test]
fn handover_broken_caller_is_found() {
    assert_broken(&[
        (Caller::WrongBuffer, "armed buffer"),
        (Caller::AnyTimeIsGap, "two replies"),
        (Caller::NoStandby, "is repeated"),
        (Caller::LostIgnored, "were seen"),
        (Caller::NoReset, "two replies"),
        (Caller::AnyPrefix, "two replies"),
    ]);
}
