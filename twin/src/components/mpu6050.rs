//! The MPU6050 on the STM's own side of the I2C switch: its gyroscope about the vertical (Product
//! Specification PS-MPU-6000A 3.4, Register Map RM-MPU-6000A 4.2).
//!
//! | register or section | behaviour |
//! |---|---|
//! | `WHO_AM_I` | 0x68 |
//! | `PWR_MGMT_1` | asleep at power-up (0x40): the data registers keep their values; `DEVICE_RESET` puts every register back |
//! | `SMPLRT_DIV`, `CONFIG` | a sample every (1 + divider) ms with the low-pass on, eighths of a ms without; the low-pass is two equal lags of the table's delay together |
//! | `GYRO_CONFIG` | full scale 250, 500, 1000 or 2000 °/s; what is beyond saturates |
//! | `GYRO_ZOUT` | rate · scale + bias + drift + noise ([`GyroParams`]); the other data registers read 0 |
//! | `INT_ENABLE`, `INT_STATUS`, `INT_PIN_CFG` | data ready: a pulse of 50 µs, or held until the status (or, so set, anything) is read; active low if so set |
//! | address pointer | set by the first byte written, advances with every byte either way |
//!
//! Not modelled: accelerometers, the x and y axes, temperature, FIFO, the auxiliary bus, self-test, the
//! standby bits, and the start-up times.

use plant::{GyroParams, Rng};

/// The address on the bus with AD0 low.
pub const ADDRESS: u8 = 0x68;

const SMPLRT_DIV: usize = 0x19;
const CONFIG: usize = 0x1A;
const GYRO_CONFIG: usize = 0x1B;
const INT_PIN_CFG: usize = 0x37;
const INT_ENABLE: usize = 0x38;
const INT_STATUS: usize = 0x3A;
const GYRO_ZOUT: usize = 0x47;
const PWR_MGMT_1: usize = 0x6B;
const WHO_AM_I: usize = 0x75;
const REGISTERS: usize = 128;

/// `DEVICE_RESET` and `SLEEP`.
const RESET: u8 = 0x80;
const SLEEP: u8 = 0x40;
/// `INT_PIN_CFG`: active low, held, cleared by any read.
const INT_LOW: u8 = 0x80;
const INT_HELD: u8 = 0x20;
const INT_ANY_READ: u8 = 0x10;
const DATA_READY: u8 = 1;

/// Data ready's pulse, nanoseconds.
const PULSE_NS: u64 = 50_000;
/// Delay of the gyroscope's low-pass by `DLPF_CFG`, milliseconds (RM, 4.3).
const DELAY_MS: [f64; 8] = [0.98, 1.9, 2.8, 4.8, 8.3, 13.4, 18.6, 0.17];

/// Its fault.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Mpu6050Fault {
    /// Nothing.
    #[default]
    None,
    /// It acknowledges nothing.
    Silent,
    /// It acknowledges its address and this many bytes.
    RefusesAfter(u32),
    /// Its data do not change.
    Frozen,
    /// Its rate is off by this, °/s.
    Offset(i16),
    /// The same, and every quarter of a second the other way round.
    Jumps(i16),
    /// `WHO_AM_I` has another value.
    WrongId(u8),
}

/// The part.
#[derive(Clone, Debug)]
pub struct Mpu6050 {
    params: GyroParams,
    /// Its fault; change it at any time.
    pub fault: Mpu6050Fault,
    registers: [u8; REGISTERS],
    pointer: usize,
    /// The next byte written is the register's address.
    addressing: bool,
    reading: bool,
    /// Bytes it acknowledged since the start.
    taken: u32,
    lags: [f64; 2],
    /// Milliseconds since the last sample.
    since: f64,
    rng: Rng,
    pin: bool,
    falls: Option<u64>,
    reads: u64,
}

impl Mpu6050 {
    /// A part just powered.
    pub fn new(params: GyroParams, seed: u64) -> Self {
        let mut part = Self {
            params,
            fault: Mpu6050Fault::None,
            registers: [0; REGISTERS],
            pointer: 0,
            addressing: false,
            reading: false,
            taken: 0,
            lags: [0.0; 2],
            since: 0.0,
            rng: Rng::new(seed),
            pin: false,
            falls: None,
            reads: 0,
        };
        part.reset();
        part
    }

    fn reset(&mut self) {
        self.registers = [0; REGISTERS];
        self.registers[PWR_MGMT_1] = SLEEP;
        self.registers[WHO_AM_I] = ADDRESS;
        (self.pin, self.falls) = (false, None);
    }

    /// How often its rate has been read.
    pub fn reads(&self) -> u64 {
        self.reads
    }

    /// Whether a read is under way, in which a lost clock leaves the part driving the data line.
    pub fn is_reading(&self) -> bool {
        self.reading
    }

    /// Advances by a millisecond that ends at `now`, in which the part turned at `rate_deg_s`,
    /// counter-clockwise positive.
    pub fn step_ms(&mut self, now: u64, rate_deg_s: f64) {
        let low_pass = usize::from(self.registers[CONFIG] & 7);
        // Two lags in a row, each of half the delay, in steps of a millisecond.
        let share = 1.0 - libm::exp(-2.0 / DELAY_MS[low_pass]);
        self.lags[0] += share * (rate_deg_s - self.lags[0]);
        self.lags[1] += share * (self.lags[0] - self.lags[1]);
        if self.registers[PWR_MGMT_1] & SLEEP != 0 {
            return;
        }
        let base = if matches!(low_pass, 0 | 7) {
            0.125
        } else {
            1.0
        };
        self.since += 1.0;
        let period = base * (1.0 + f64::from(self.registers[SMPLRT_DIV]));
        if self.since + 1e-9 < period {
            return;
        }
        self.since = 0.0;
        self.sample(now);
    }

    #[expect(clippy::cast_precision_loss, reason = "nanoseconds of days")]
    fn sample(&mut self, now: u64) {
        if self.fault != Mpu6050Fault::Frozen {
            let scale = f64::from(1 << (self.registers[GYRO_CONFIG] >> 3 & 3));
            let noise = self.params.noise_deg_s * self.rng.normal();
            let offset = match self.fault {
                Mpu6050Fault::Offset(offset) => f64::from(offset),
                Mpu6050Fault::Jumps(by) if now % 500_000_000 < 250_000_000 => f64::from(by),
                Mpu6050Fault::Jumps(by) => f64::from(-by),
                _ => 0.0,
            };
            let rate = self.params.reading_deg_s(self.lags[1], now as f64 / 1e9) + noise + offset;
            #[expect(
                clippy::cast_possible_truncation,
                reason = "it saturates, as the part does"
            )]
            let word = (rate * 131.0 / scale).round() as i16;
            self.registers[GYRO_ZOUT..GYRO_ZOUT + 2].copy_from_slice(&word.to_be_bytes());
        }
        self.registers[INT_STATUS] |= DATA_READY;
        if self.registers[INT_ENABLE] & DATA_READY != 0 {
            self.pin = true;
            let held = self.registers[INT_PIN_CFG] & INT_HELD != 0;
            self.falls = (!held).then_some(now + PULSE_NS);
        }
    }

    /// The interrupt pin's level at `now`.
    pub fn interrupt(&mut self, now: u64) -> bool {
        if self.falls.is_some_and(|at| at <= now) {
            (self.pin, self.falls) = (false, None);
        }
        self.pin != (self.registers[INT_PIN_CFG] & INT_LOW != 0)
    }

    /// When the pin changes by itself.
    pub fn next_event(&self) -> Option<u64> {
        self.falls
    }

    /// A start with `address`. Returns the acknowledge.
    pub fn start(&mut self, address: u8, read: bool) -> bool {
        self.reading = false;
        if address != ADDRESS || self.fault == Mpu6050Fault::Silent {
            return false;
        }
        self.reading = read;
        self.addressing = !read;
        self.taken = 0;
        true
    }

    /// A byte from the controller. Returns the acknowledge.
    pub fn write(&mut self, byte: u8) -> bool {
        if matches!(self.fault, Mpu6050Fault::RefusesAfter(bytes) if self.taken >= bytes) {
            return false;
        }
        self.taken += 1;
        if self.addressing {
            self.addressing = false;
            self.pointer = usize::from(byte) % REGISTERS;
            return true;
        }
        match self.pointer {
            PWR_MGMT_1 if byte & RESET != 0 => self.reset(),
            // Read only: interrupt status, data, identity.
            INT_STATUS..=0x60 | WHO_AM_I => {}
            register => self.registers[register] = byte,
        }
        self.pointer = (self.pointer + 1) % REGISTERS;
        true
    }

    /// A byte to the controller.
    pub fn read(&mut self) -> u8 {
        let register = self.pointer;
        self.pointer = (self.pointer + 1) % REGISTERS;
        let byte = match (register, self.fault) {
            (WHO_AM_I, Mpu6050Fault::WrongId(identity)) => identity,
            _ => self.registers[register],
        };
        if register == GYRO_ZOUT {
            self.reads += 1;
        }
        if register == INT_STATUS || self.registers[INT_PIN_CFG] & INT_ANY_READ != 0 {
            self.registers[INT_STATUS] = 0;
            if self.falls.is_none() {
                self.pin = false;
            }
        }
        byte
    }

    /// A stop.
    pub fn stop(&mut self) {
        self.reading = false;
    }
}

#[cfg(test)]
mod tests;
