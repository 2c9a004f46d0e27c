//! MPU6050 driver, one bus request a tick: identify, wake, set up, then read the rate about the vertical;
//! start again when it stops answering.
//!
//! The firmware executes a [`BusRequest`] in the background of a tick and returns its [`BusResult`] with
//! the next; nothing blocks, whatever the part or the bus does.
//!
//! Registers and figures: MPU-6000/MPU-6050 Product Specification (PS-MPU-6000A) 3.4 and Register Map
//! (RM-MPU-6000A) 4.2.

/// The part's address with AD0 low (RM, `WHO_AM_I`).
pub const ADDRESS: u8 = 0x68;
/// Content of `WHO_AM_I`, independent of AD0.
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

/// 42 Hz with a delay of 4.8 ms: half the tick's rate, and the mean delay of a tick's encoder counts.
const LOW_PASS: u8 = 3;
/// ±500 °/s: the first board turns at 140 °/s at most, by hand at 300.
const FULL_SCALE: u8 = 1 << 3;
/// Tenths of an LSB per °/s at this full scale (PS, 6.1).
pub const LSB_PER_DEGREE_TENTHS: u32 = 655;

/// Set-up sequence: register, value, ticks without a request after it, at least 1.
const SETUP: [(u8, u8, u8); 5] = [
    // Reset; 100 ms (RM, 4.28 and 4.27).
    (PWR_MGMT_1, 0x80, 11),
    // Awake, clocked by the z gyroscope, as the manual recommends; starts within 30 ms (PS, 6.1).
    (PWR_MGMT_1, 0x03, 5),
    (CONFIG, LOW_PASS, 1),
    (GYRO_CONFIG, FULL_SCALE, 1),
    // A sample every millisecond: no reading is older.
    (SMPLRT_DIV, 0, 3),
];

/// Request to the bus for the time until the next tick.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BusRequest {
    /// No transfer.
    Idle,
    /// Write one register.
    Write {
        /// Its address.
        register: u8,
        /// Its new content.
        value: u8,
    },
    /// Read `count`, 1 or 2, registers.
    Read {
        /// The first one's address.
        register: u8,
        /// How many.
        count: u8,
    },
    /// Drive the lines as GPIOs: each low or released.
    DriveLines {
        /// SCL is released.
        clock: bool,
        /// SDA is released.
        data: bool,
    },
    /// Return the lines to the I2C interface after its reset.
    ReleaseLines,
}

/// Result of the last request.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum BusResult {
    /// Completed, or there was no transfer.
    #[default]
    Done,
    /// The bytes read; the second is 0 if one was requested.
    Bytes([u8; 2]),
    /// Not acknowledged.
    Nack,
    /// Incomplete after a whole tick, or could not start: a line is held low.
    Timeout,
}

/// Reason why there is no rate.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum DeviceError {
    /// No acknowledge at 0x68.
    NotResponding,
    /// Another identity, or the settings were not kept.
    WrongId,
    /// A line is held low.
    BusHeld,
    /// Constant data: a working gyroscope is noisy.
    Frozen,
}

impl DeviceError {
    /// Text for the log.
    #[must_use]
    pub const fn reason(self) -> &'static str {
        match self {
            Self::NotResponding => "no answer at 0x68",
            Self::WrongId => "not an MPU6050 at 0x68",
            Self::BusHeld => "I2C held",
            Self::Frozen => "data frozen",
        }
    }
}

/// News of a tick.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum GyroReading {
    /// Nothing.
    None,
    /// Rate about the vertical, LSB, counter-clockwise positive.
    Rate(i16),
    /// The part is lost; reported once per reason until it recovers.
    Lost(DeviceError),
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Stage {
    /// Ticks until it is identified.
    Wait(u16),
    Identify,
    /// Writes this step of the set-up.
    Set(u8),
    /// Step of the set-up, ticks until the next.
    Settle(u8, u8),
    Verify,
    /// Reads the rate.
    Stream,
    /// Recovers the bus, edge by edge.
    Recover(u8),
    Release,
}

/// Ticks from power-up to the first request: 100 ms (PS, 6.3).
const POWER_UP_TICKS: u16 = 10;
/// Ticks between attempts, doubled each time.
const MIN_PAUSE: u16 = 100;
const MAX_PAUSE: u16 = 800;
/// Consecutive failed reads that are tolerated.
const MAX_MISSES: u8 = 3;
/// Consecutive equal words that no working gyroscope sends: its noise of 0.05 °/s rms (PS, 6.1) is
/// three bits, so one word in ten equals the last. Of a part with a third of it one in four does, and 20 in
/// a row once in 75 years.
const MAX_REPEATS: u8 = 20;
/// Edges of the bus recovery: nine clock pulses, before a stop (UM10204, 3.1.16).
const RECOVERY_EDGES: u8 = 18;

/// The driver.
#[derive(Clone, Copy, Debug)]
pub struct Mpu6050 {
    stage: Stage,
    pause: u16,
    misses: u8,
    last: [u8; 2],
    repeats: u8,
    reported: Option<DeviceError>,
}

impl Default for Mpu6050 {
    fn default() -> Self {
        Self::new()
    }
}

impl Mpu6050 {
    /// Waits for the part's power-up.
    pub const fn new() -> Self {
        Self {
            stage: Stage::Wait(POWER_UP_TICKS),
            pause: MIN_PAUSE,
            misses: 0,
            last: [0; 2],
            repeats: 0,
            reported: None,
        }
    }

    /// Whether the last word was the one before it.
    pub const fn repeats(&self) -> bool {
        self.repeats > 0
    }

    /// One tick: takes the result of the last request, gives the next.
    pub fn step(&mut self, result: BusResult) -> (BusRequest, GyroReading) {
        let reading = self.advance(result);
        (self.request(), reading)
    }

    fn advance(&mut self, result: BusResult) -> GyroReading {
        match (self.stage, result) {
            (Stage::Recover(edge), _) => {
                self.stage = if edge < RECOVERY_EDGES + 2 {
                    Stage::Recover(edge + 1)
                } else {
                    Stage::Release
                };
            }
            (Stage::Release, _) => self.stage = Stage::Wait(self.pause),
            (_, BusResult::Timeout) => {
                let reading = self.lost(DeviceError::BusHeld);
                self.stage = Stage::Recover(0);
                return reading;
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
                if self.misses > MAX_MISSES {
                    return self.lost(DeviceError::NotResponding);
                }
            }
            (_, BusResult::Nack) => return self.lost(DeviceError::NotResponding),
            (Stage::Identify, BusResult::Bytes([identity, _])) if identity == IDENTITY => {
                self.stage = Stage::Set(0);
            }
            (Stage::Set(nth), BusResult::Done) => {
                self.stage = Stage::Settle(nth, settling_ticks(nth));
            }
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
                self.repeats = 0;
            }
            (Stage::Identify | Stage::Set(_) | Stage::Verify, _) => {
                return self.lost(DeviceError::WrongId);
            }
        }
        GyroReading::None
    }

    fn rate(&mut self, word: [u8; 2]) -> GyroReading {
        self.misses = 0;
        self.repeats = if word == self.last {
            self.repeats.saturating_add(1)
        } else {
            0
        };
        self.last = word;
        if self.repeats >= MAX_REPEATS {
            return self.lost(DeviceError::Frozen);
        }
        // Reported again when it is lost again, but only after data that changed.
        if self.repeats == 0 {
            self.reported = None;
            self.pause = MIN_PAUSE;
        }
        GyroReading::Rate(i16::from_be_bytes(word))
    }

    // One copy in flash.
    #[inline(never)]
    fn lost(&mut self, error: DeviceError) -> GyroReading {
        self.stage = Stage::Wait(self.pause);
        self.pause = (self.pause * 2).min(MAX_PAUSE);
        if self.reported == Some(error) {
            return GyroReading::None;
        }
        self.reported = Some(error);
        GyroReading::Lost(error)
    }

    fn request(&self) -> BusRequest {
        match self.stage {
            Stage::Wait(_) | Stage::Settle(..) => BusRequest::Idle,
            Stage::Identify => BusRequest::Read {
                register: WHO_AM_I,
                count: 1,
            },
            Stage::Set(nth) => match SETUP.get(usize::from(nth)) {
                Some(&(register, value, _)) => BusRequest::Write { register, value },
                None => BusRequest::Idle,
            },
            // CONFIG and GYRO_CONFIG, which follows it.
            Stage::Verify => BusRequest::Read {
                register: CONFIG,
                count: 2,
            },
            Stage::Stream => BusRequest::Read {
                register: GYRO_ZOUT,
                count: 2,
            },
            // Nine pulses, then a stop: data low with the clock, and released after it.
            Stage::Recover(edge) if edge < RECOVERY_EDGES => BusRequest::DriveLines {
                clock: edge & 1 == 1,
                data: true,
            },
            Stage::Recover(edge) => BusRequest::DriveLines {
                clock: edge > RECOVERY_EDGES,
                data: edge > RECOVERY_EDGES + 1,
            },
            Stage::Release => BusRequest::ReleaseLines,
        }
    }
}

/// Ticks without a request after a step of the set-up.
fn settling_ticks(nth: u8) -> u8 {
    SETUP.get(usize::from(nth)).map_or(1, |step| step.2)
}

#[cfg(test)]
mod tests;
