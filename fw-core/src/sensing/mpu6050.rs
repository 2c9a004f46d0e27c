//! The conversation with the MPU6050, one bus order a tick: who is there, wake it, set it up, read its
//! rate of turn about the vertical for as long as it answers, and begin again when it does not.
//!
//! The driver carries an [`BusRequest`] out in the background of a tick and brings its [`BusResult`] with
//! the next; it waits for nothing. Whatever the part or the bus does, every tick ends with an order
//! and nothing else depends on it.
//!
//! Registers and figures: MPU-6000/MPU-6050 Product Specification (PS-MPU-6000A) 3.4 and Register Map
//! (RM-MPU-6000A) 4.2.

/// The part's address with AD0 low (RM, `WHO_AM_I`).
pub const ADDRESS: u8 = 0x68;
/// What `WHO_AM_I` holds, whatever AD0 is.
pub const IDENTITY: u8 = 0x68;

/// Sample rate divider.
pub const SMPLRT_DIV: u8 = 0x19;
/// Digital low-pass filter.
pub const CONFIG: u8 = 0x1A;
/// The gyroscopes' full scale.
pub const GYRO_CONFIG: u8 = 0x1B;
/// Rate about the z axis, high byte; the low byte follows.
pub const GYRO_ZOUT: u8 = 0x47;
/// Reset, sleep, clock.
pub const PWR_MGMT_1: u8 = 0x6B;
/// Identity.
pub const WHO_AM_I: u8 = 0x75;

/// 42 Hz, 4.8 ms of delay: half the tick's rate, and the delay of half a tick that a tick's worth of
/// encoder counts has too, so both tell of the same instant.
const LOW_PASS: u8 = 3;
/// ±500 °/s: the first board turns at 140 °/s at most, a hand easily at 300.
const FULL_SCALE: u8 = 1 << 3;
/// Least significant bits per °/s at that full scale, tenths (PS, 6.1).
pub const LSB_PER_DEGREE_TENTHS: u32 = 655;

/// A write of the set-up, and how many ticks to leave the part alone after it.
struct Setting {
    register: u8,
    value: u8,
    rest: u8,
}

const fn setting(register: u8, value: u8, rest: u8) -> Setting {
    Setting {
        register,
        value,
        rest,
    }
}

/// The set-up, in this order.
const SETUP: [Setting; 5] = [
    // Everything to its reset value; 100 ms (RM, 4.28 and 4.27).
    setting(PWR_MGMT_1, 0x80, 11),
    // Awake, clocked by the z gyroscope, as the manual recommends; 30 ms until it moves (PS, 6.1).
    setting(PWR_MGMT_1, 0x03, 5),
    setting(CONFIG, LOW_PASS, 0),
    setting(GYRO_CONFIG, FULL_SCALE, 0),
    // A sample every millisecond: what is read is never older.
    setting(SMPLRT_DIV, 0, 3),
];

/// What the driver is to do until the next tick.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BusRequest {
    /// Leave the bus alone.
    Idle,
    /// Write one register.
    Write {
        /// Its address.
        register: u8,
        /// What it shall hold.
        value: u8,
    },
    /// Read `count`, 1 or 2, registers.
    Read {
        /// The first one's address.
        register: u8,
        /// How many.
        count: u8,
    },
    /// Take the lines from the interface and hold each low or let it go.
    DriveLines {
        /// SCL is let go.
        clock: bool,
        /// SDA is let go.
        data: bool,
    },
    /// Give the lines back to the interface, freshly reset.
    ReleaseLines,
}

/// What became of the last order.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum BusResult {
    /// Carried out, or there was nothing to do.
    #[default]
    Done,
    /// These bytes were read; the second is 0 where only one was asked for.
    Bytes([u8; 2]),
    /// Nobody acknowledged.
    Nack,
    /// It is still under way after a whole tick, or could not begin: somebody holds a line.
    Timeout,
}

/// Why there is no rate.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum DeviceError {
    /// Nothing acknowledges at 0x68.
    NotResponding,
    /// Something else answers there, or it did not keep its settings.
    WrongId,
    /// A line is held low.
    BusHeld,
    /// It answers, and always the same: a live gyroscope is noisy.
    Frozen,
}

impl DeviceError {
    /// For the log.
    #[must_use]
    pub const fn reason(self) -> &'static str {
        match self {
            Self::NotResponding => "no answer at 0x68",
            Self::WrongId => "not an MPU6050 at 0x68",
            Self::BusHeld => "I2C held",
            Self::Frozen => "its data stand still",
        }
    }
}

/// What a tick learned.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum GyroReading {
    /// Nothing.
    None,
    /// The rate about the vertical, least significant bits, counter-clockwise positive.
    Rate(i16),
    /// It is lost; told once for each reason until it is found again.
    Lost(DeviceError),
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Stage {
    /// Ticks until the part is asked who it is.
    Wait(u16),
    /// Asked who it is.
    Identify,
    /// Setting number so was written.
    Set(u8),
    /// Ticks until the next setting.
    Settle(u8, u8),
    /// Asked for its settings.
    Verify,
    /// Asked for the rate.
    Stream,
    /// Clocking the bus out, edge by edge.
    Free(u8),
    /// The lines are being given back.
    Attach,
}

/// From power-up to a part that answers: 100 ms at most (PS, 6.3).
const POWER_UP: u16 = 10;
/// From one failed try to the next, ticks: doubled each time.
const SHORTEST_PAUSE: u16 = 100;
const LONGEST_PAUSE: u16 = 800;
/// Reads in a row that may go unanswered; the rate is held meanwhile.
const MISSES: u8 = 3;
/// The same word so many times in a row is no gyroscope: its noise of 0.05 °/s rms (PS, 6.1) is three
/// bits, so two words in a row agree one time in ten.
const SAME: u8 = 50;
/// Edges that free the bus: nine clock pulses, then a stop (UM10204, 3.1.16).
const EDGES: u8 = 18;

/// The conversation.
#[derive(Clone, Copy, Debug)]
pub struct Mpu6050 {
    stage: Stage,
    pause: u16,
    misses: u8,
    last: [u8; 2],
    same: u8,
    told: Option<DeviceError>,
}

impl Default for Mpu6050 {
    fn default() -> Self {
        Self::new()
    }
}

impl Mpu6050 {
    /// Nothing said yet.
    #[must_use]
    pub const fn new() -> Self {
        Self {
            stage: Stage::Wait(POWER_UP),
            pause: SHORTEST_PAUSE,
            misses: 0,
            last: [0; 2],
            same: 0,
            told: None,
        }
    }

    /// One tick: what became of the last order, and the next one.
    pub fn step(&mut self, outcome: BusResult) -> (BusRequest, GyroReading) {
        let news = self.hear(outcome);
        (self.order(), news)
    }

    /// Moves to the next stage.
    fn hear(&mut self, outcome: BusResult) -> GyroReading {
        match (self.stage, outcome) {
            // By hand, the lines answer nothing.
            (Stage::Free(edge), _) => {
                self.stage = if edge < EDGES + 2 {
                    Stage::Free(edge + 1)
                } else {
                    Stage::Attach
                };
            }
            (Stage::Attach, _) => self.stage = Stage::Wait(self.pause),
            (_, BusResult::Timeout) => {
                let news = self.lost(DeviceError::BusHeld);
                self.stage = Stage::Free(0);
                return news;
            }
            (Stage::Wait(ticks), _) => {
                self.stage = if ticks > 1 {
                    Stage::Wait(ticks - 1)
                } else {
                    Stage::Identify
                };
            }
            (Stage::Stream, BusResult::Bytes(word)) => return self.rate(word),
            (Stage::Stream, _) => {
                self.misses += 1;
                if self.misses > MISSES {
                    return self.lost(DeviceError::NotResponding);
                }
            }
            (_, BusResult::Nack) => return self.lost(DeviceError::NotResponding),
            (Stage::Identify, BusResult::Bytes([identity, _])) if identity == IDENTITY => {
                self.stage = Stage::Set(0);
            }
            (Stage::Set(nth), BusResult::Done) => self.stage = Stage::Settle(nth, self.rest(nth)),
            (Stage::Settle(nth, rest), _) if rest > 1 => self.stage = Stage::Settle(nth, rest - 1),
            (Stage::Settle(nth, _), _) => {
                self.stage = if usize::from(nth) + 1 < SETUP.len() {
                    Stage::Set(nth + 1)
                } else {
                    Stage::Verify
                };
            }
            (Stage::Verify, BusResult::Bytes([LOW_PASS, FULL_SCALE])) => {
                self.stage = Stage::Stream;
                self.misses = 0;
                self.same = 0;
            }
            (Stage::Identify | Stage::Set(_) | Stage::Verify, _) => {
                return self.lost(DeviceError::WrongId);
            }
        }
        GyroReading::None
    }

    /// At least a tick, in which nothing is asked.
    fn rest(&self, nth: u8) -> u8 {
        let _ = self;
        SETUP
            .get(usize::from(nth))
            .map_or(1, |setting| setting.rest.max(1))
    }

    fn rate(&mut self, word: [u8; 2]) -> GyroReading {
        self.misses = 0;
        self.same = if word == self.last {
            self.same.saturating_add(1)
        } else {
            0
        };
        self.last = word;
        if self.same >= SAME {
            return self.lost(DeviceError::Frozen);
        }
        // Told again should it be lost again, but not before it has shown that it lives.
        if self.same == 0 {
            self.told = None;
            self.pause = SHORTEST_PAUSE;
        }
        GyroReading::Rate(i16::from_be_bytes(word))
    }

    fn lost(&mut self, trouble: DeviceError) -> GyroReading {
        self.stage = Stage::Wait(self.pause);
        self.pause = (self.pause * 2).min(LONGEST_PAUSE);
        if self.told == Some(trouble) {
            return GyroReading::None;
        }
        self.told = Some(trouble);
        GyroReading::Lost(trouble)
    }

    fn order(&self) -> BusRequest {
        match self.stage {
            Stage::Wait(_) | Stage::Settle(..) => BusRequest::Idle,
            Stage::Identify => BusRequest::Read {
                register: WHO_AM_I,
                count: 1,
            },
            Stage::Set(nth) => SETUP
                .get(usize::from(nth))
                .map_or(BusRequest::Idle, |setting| BusRequest::Write {
                    register: setting.register,
                    value: setting.value,
                }),
            // CONFIG and GYRO_CONFIG, which follows it.
            Stage::Verify => BusRequest::Read {
                register: CONFIG,
                count: 2,
            },
            Stage::Stream => BusRequest::Read {
                register: GYRO_ZOUT,
                count: 2,
            },
            // Nine pulses; then data low while the clock is, and up after it: a stop.
            Stage::Free(edge) if edge < EDGES => BusRequest::DriveLines {
                clock: edge & 1 == 1,
                data: true,
            },
            Stage::Free(edge) => BusRequest::DriveLines {
                clock: edge > EDGES,
                data: edge > EDGES + 1,
            },
            Stage::Attach => BusRequest::ReleaseLines,
        }
    }
}

#[cfg(test)]
mod tests;
