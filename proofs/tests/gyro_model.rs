//! T18, every order of bus results: the core's own MPU6050 driver with a part and a bus that answer rightly,
//! wrongly or not at all, until no new state is left.
//!
//! Domain: every kind of result, with five words, to each transfer, and a part that is 0, 1 or 9 clock pulses
//! short of letting go of a bus that it holds. Between two transfers there are only ticks without a result, so a
//! step goes up to the next transfer.
//!
//! `cargo test -p proofs --test gyro_model -- --nocapture` shows the way to each broken invariant.

mod common;

use common::ByText;
use fw_core::sensing::Mpu6050;
use fw_core::sensing::mpu6050::{
    BusRequest, BusResult, CONFIG, DeviceError, GYRO_CONFIG, GYRO_ZOUT, GyroReading, IDENTITY,
    PWR_MGMT_1, SMPLRT_DIV, WHO_AM_I,
};
use proofs::search::{Model, assert_broken, assert_holds};

const fn read(register: u8, count: u8) -> BusRequest {
    BusRequest::Read { register, count }
}

const fn write(register: u8, value: u8) -> BusRequest {
    BusRequest::Write { register, value }
}

/// The conversation: request, right answer, ticks without a transfer after it.
const CONVERSATION: [(BusRequest, BusResult, u32); 7] = [
    (read(WHO_AM_I, 1), BusResult::Bytes([IDENTITY, 0]), 0),
    (write(PWR_MGMT_1, 0x80), BusResult::Done, 11),
    (write(PWR_MGMT_1, 0x03), BusResult::Done, 5),
    (write(CONFIG, 3), BusResult::Done, 1),
    (write(GYRO_CONFIG, 8), BusResult::Done, 1),
    (write(SMPLRT_DIV, 0), BusResult::Done, 3),
    (read(CONFIG, 2), BusResult::Bytes([3, 8]), 0),
];
/// Progress of a part whose rate is read.
const STREAMS: usize = CONVERSATION.len();
/// What can be read: the registers' right contents, another part's identity, two rates.
const WORDS: [[u8; 2]; 5] = [[IDENTITY, 0], [0x70, 0], [3, 8], [0, 0], [0xFF, 0x35]];
/// Failed reads in a row that are tolerated, and equal words in a row that are not.
const TOLERATED: u8 = 3;
const FROZEN: u8 = 20;
/// Ticks in which a held bus is clocked free: nine pulses of two edges, a stop of three.
const RECOVERY: u32 = 21;

#[derive(Clone, Copy, Debug)]
struct Facts {
    driver: Mpu6050,
    /// The transfer under way.
    request: BusRequest,
    /// Answers of [`CONVERSATION`] that came right since the last loss.
    progress: usize,
    /// Failed reads in a row.
    misses: u8,
    /// The last rate, and how many before it were equal.
    word: [u8; 2],
    equal: u8,
    /// Losses, and the reason reported last, since the rate last changed.
    losses: u32,
    reported: Option<DeviceError>,
    /// The last rate as the bus returned it; for [`Caller::Stale`] alone.
    kept: BusResult,
}

/// A result of the transfer under way; the pulses that a part which holds the bus is short of.
#[derive(Clone, Copy, Debug)]
struct Event(BusResult, u8);

/// The caller of the driver, right or broken on purpose.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Caller {
    Right,
    /// Returns the last rate again where a read is not acknowledged.
    Stale,
    /// Leaves out ticks whose transfer was not acknowledged.
    Silent,
    /// Ticks every 5 ms.
    Hasty,
    /// Does not drive the lines.
    Stuck,
    /// Starts a lost driver again.
    Restarting,
}

impl Facts {
    fn known(self) -> ByText<Self> {
        let text = format!("{self:?}");
        ByText { value: self, text }
    }

    /// What must come of a result, and whether the part is lost.
    fn due(&mut self, result: BusResult) -> (GyroReading, bool) {
        let streams = self.progress == STREAMS;
        let mut rate = None;
        let lost = match result {
            BusResult::Timeout => Some(DeviceError::BusHeld),
            BusResult::Bytes(word) if streams => {
                self.misses = 0;
                self.equal = if word == self.word { self.equal + 1 } else { 0 };
                self.word = word;
                rate = Some(i16::from_be_bytes(word));
                (self.equal >= FROZEN).then_some(DeviceError::Frozen)
            }
            _ if streams => {
                self.misses += 1;
                (self.misses > TOLERATED).then_some(DeviceError::NotResponding)
            }
            BusResult::Nack => Some(DeviceError::NotResponding),
            _ if result == CONVERSATION[self.progress].1 => {
                self.progress += 1;
                (self.misses, self.equal) = (0, 0);
                None
            }
            _ => Some(DeviceError::WrongId),
        };
        let reading = match (lost, rate) {
            (Some(error), _) if self.reported != Some(error) => GyroReading::Lost(error),
            (None, Some(rate)) => GyroReading::Rate(rate),
            _ => GyroReading::None,
        };
        if lost.is_some() {
            self.progress = 0;
            self.reported = lost;
        } else if rate.is_some() && self.equal == 0 {
            (self.losses, self.reported) = (0, None);
        }
        (reading, lost.is_some())
    }

    /// Ticks up to the next transfer, with a part that is `short` of so many pulses; those without a request.
    fn next_transfer(&mut self, caller: Caller, mut short: u8, held: bool) -> Result<u32, String> {
        let (mut idle, mut edges, mut low, mut stopped) = (0, 0, false, !held);
        loop {
            match self.request {
                BusRequest::Read { .. } | BusRequest::Write { .. } => {
                    return if short == 0 && stopped {
                        Ok(if caller == Caller::Hasty {
                            idle / 2
                        } else {
                            idle
                        })
                    } else {
                        Err("a transfer while the part holds the bus".into())
                    };
                }
                BusRequest::Idle => idle += 1,
                BusRequest::DriveLines { .. } if caller == Caller::Stuck => {}
                BusRequest::DriveLines { clock, data } => {
                    edges += 1;
                    short = short.saturating_sub((low && clock).into());
                    low = !clock;
                    stopped = edges == RECOVERY && clock && data;
                }
                BusRequest::ReleaseLines => {}
            }
            let (request, news) = self.driver.step(BusResult::Done);
            self.request = request;
            if news != GyroReading::None || idle > 2_000 || edges > RECOVERY {
                return Err(format!("{news:?} after {idle} ticks without a transfer"));
            }
        }
    }
}

impl Model for Caller {
    type State = ByText<Facts>;
    type Event = Event;

    fn starts(&self) -> Vec<Self::State> {
        let mut driver = Mpu6050::new();
        let (request, _) = driver.step(BusResult::Done);
        let mut facts = Facts {
            driver,
            request,
            progress: 0,
            misses: 0,
            word: [0; 2],
            equal: 0,
            losses: 0,
            reported: None,
            kept: BusResult::Done,
        };
        // 100 ms after power-up.
        assert_eq!(facts.next_transfer(Self::Right, 0, false), Ok(9));
        vec![facts.known()]
    }

    fn events(&self, _: &Self::State) -> Vec<Event> {
        let mut events = Vec::from(WORDS.map(|word| Event(BusResult::Bytes(word), 0)));
        events.extend([BusResult::Done, BusResult::Nack].map(|result| Event(result, 0)));
        events.extend([0, 1, 9].map(|short| Event(BusResult::Timeout, short)));
        events
    }

    fn step(
        &self,
        state: &Self::State,
        &Event(result, short): &Event,
    ) -> Result<Self::State, String> {
        let mut facts = state.value;
        let before = facts.progress;
        let handed = match (self, result) {
            (Self::Stale, BusResult::Nack) if before == STREAMS => facts.kept,
            _ => result,
        };
        if *self == Self::Stale && before == STREAMS {
            facts.kept = handed;
        }
        let skipped = *self == Self::Silent && result == BusResult::Nack;
        let (request, reading) = if skipped {
            (facts.request, GyroReading::None)
        } else {
            facts.driver.step(handed)
        };
        facts.request = request;
        let (due, lost) = facts.due(result);
        if matches!(reading, GyroReading::Rate(_)) && !matches!(due, GyroReading::Rate(_)) {
            return Err(format!("a rate although the transfer returned {result:?}"));
        }
        if reading != due {
            return Err(format!("{reading:?} in place of {due:?}"));
        }
        if *self == Self::Restarting && lost {
            facts.driver = Mpu6050::new();
            facts.request = BusRequest::Idle;
        }
        let held = result == BusResult::Timeout;
        let idle = facts.next_transfer(*self, short, held)?;
        let rest = if lost {
            // 1, 2, 4 and then every 8 s; after a held bus 2 first.
            let rest = (100 << (facts.losses + u32::from(held)).min(3)).min(800);
            facts.losses = (facts.losses + 1).min(3);
            rest
        } else {
            CONVERSATION.get(before).map_or(0, |step| step.2)
        };
        let expected = CONVERSATION
            .get(facts.progress)
            .map_or(read(GYRO_ZOUT, 2), |step| step.0);
        if facts.request != expected {
            return Err(format!("{:?} in place of {expected:?}", facts.request));
        }
        if idle != rest {
            return Err(format!(
                "{idle} ticks without a transfer in place of {rest}"
            ));
        }
        Ok(facts.known())
    }
}

// Requirement: DOC-2.3-3, WIRE-fault-13
#[test]
fn gyro_conversation_holds_in_every_order() {
    assert_holds(&Caller::Right, 30_000);
}

#[test]
fn broken_gyro_caller_is_found() {
    assert_broken(&[
        (Caller::Stale, "a rate although"),
        (Caller::Silent, "None in place of Lost(NotResponding)"),
        (Caller::Hasty, "50 ticks without a transfer"),
        (Caller::Stuck, "while the part holds"),
        (Caller::Restarting, "10 ticks without a transfer"),
    ]);
}
