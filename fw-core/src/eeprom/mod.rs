//! The configuration: EEPROM image → [`Config`] and back.
//!
//! Pages 0x00–0x02 are the original register map; page 0x03 adds the platform's own figures. An
//! accepted [`Config`] excludes every overflow and division by zero downstream.
//!
//! | file | what it holds |
//! |---|---|
//! | [`field`] | the one table: address, type, name, unit, accepted range of every field |
//! | [`rule`] | what fields must hold together |
//! | [`decode`](fn@decode), [`encode`](fn@encode), [`check`](fn@check) | along these tables |
//! | [`error`] | which field was rejected, what it held, what is accepted |
//! | [`crc32`](fn@crc32) | the checksum of page 0x03 |

#![cfg_attr(
    not(test),
    deny(
        clippy::indexing_slicing,
        clippy::panic,
        clippy::unwrap_used,
        clippy::expect_used,
        clippy::float_arithmetic
    )
)]

mod codec;
mod crc32;
pub mod error;
pub mod field;
pub mod rule;

pub use codec::{check, decode, encode, encode_original, CRC_ADDRESS, KEY, PLATFORM_LEN};
pub use crc32::crc32;
pub use error::{ConfigError, Value};
pub use field::{Accepted, Field, Kind, FIELDS};

use crate::binary64::Binary64;
use crate::wire::{Mode, Setup};

/// Bytes of the image that carry a meaning: pages 0x00 to 0x03.
pub const IMAGE_LEN: usize = 0x400;

/// The configuration's image, as read from or written to addresses 0x0000 to 0x03FF.
pub type Image = [u8; IMAGE_LEN];

/// Everything the STM needs to know, validated.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Config {
    /// 0x000A: the key the STM expects from the Pi.
    pub key_from_pi: u8,
    /// 0x000B: the key the STM sends.
    pub key_from_stm: u8,
    /// 0x000C.
    pub mode: Mode,
    /// 0x0100: forward/backward PID.
    pub forward: Gains,
    /// 0x0120: rotation PID.
    pub rotation: Gains,
    /// 0x0203: 1 ..= 8.
    pub cells: u8,
    /// 0x0204: volts at the ADC pin that read as `adc_max_word`.
    pub adc_max_voltage: Binary64,
    /// 0x020C.
    pub adc_max_word: u32,
    /// 0x0210: one divider per battery tap; tap n is the sum of cells 1 to n.
    pub dividers: [Divider; 8],
    /// Page 0x03; the first board's figures where that page is blank.
    pub platform: Platform,
}

/// A PID's factors as they stand in the EEPROM: per 10 ms sample, output in percent of duty.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Gains {
    /// Proportional.
    pub p: Binary64,
    /// Integral, per sample.
    pub i: Binary64,
    /// Derivative, per sample.
    pub d: Binary64,
    /// Back-calculation factor.
    pub anti_windup: Binary64,
}

/// A voltage divider's resistors, in ohms.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Divider {
    /// Between the tap and the ADC pin.
    pub upper: u32,
    /// Between the ADC pin and ground.
    pub lower: u32,
}

/// Page 0x03: the platform's figures. Little-endian, addresses within the page:
///
/// | address | type | field |
/// |---|---|---|
/// | 0x00 | u8 | layout version, 1 |
/// | 0x01 | u8 | bytes the layout defines, CRC included: 0x38 |
/// | 0x02 | u16 | `counts_per_turn` |
/// | 0x04 | u32 | `wheel_diameter_left`, µm |
/// | 0x08 | u32 | `wheel_diameter_right`, µm |
/// | 0x0C | u32 | `track`, µm |
/// | 0x10 | u8 | signs: bit 0 left encoder, 1 right encoder, 2 left motor, 3 right motor, 4 servo reversed |
/// | 0x11 | u8 | `rangefinders`, 0 ..= 3 |
/// | 0x12 | 3 × u16 | `bearings` front, right, left, turn × 0x10000 |
/// | 0x18 | u8 | `servo`, 0 or 1 |
/// | 0x19 | u8 | `gyro`, 0 or 1 |
/// | 0x1A | u16 | `stop_deadline`, ms |
/// | 0x1C | u16 | `dead_zone_left`, 0.01 % |
/// | 0x1E | u16 | `dead_zone_right`, 0.01 % |
/// | 0x20 | u16 | `limit_left`, 0.01 % |
/// | 0x22 | u16 | `limit_right`, 0.01 % |
/// | 0x24 | u32 | `log_baud` |
/// | 0x28 | u16 | `battery_warn`, mV per cell |
/// | 0x2A | u16 | `battery_cutoff`, mV per cell |
/// | 0x2C | u16 | `position_tolerance`, µm |
/// | 0x2E | u16 | `rotation_tolerance`, turn × 0x10000 |
/// | 0x30 | u16 | `log_period`, ms between pose lines, 0 = none |
/// | 0x32 | u16 | `servo_travel`, turn × 0x10000, 0 = half a turn |
/// | 0x34 | u32 | CRC-32 (ISO-HDLC) over 0x0000 ..= 0x02FF and 0x0300 ..= 0x0333 |
#[allow(
    clippy::struct_excessive_bools,
    reason = "switches of the page, each on its own"
)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Platform {
    /// Encoder counts per wheel turn, both channels, both edges.
    pub counts_per_turn: u16,
    /// Micrometres.
    pub wheel_diameter_left: u32,
    /// Micrometres.
    pub wheel_diameter_right: u32,
    /// Distance between the wheels' contact points, micrometres.
    pub track: u32,
    /// The left encoder counts down when the wheel rolls forward.
    pub encoder_left_reversed: bool,
    /// The right encoder counts down when the wheel rolls forward.
    pub encoder_right_reversed: bool,
    /// A positive left duty must be wired backwards.
    pub motor_left_reversed: bool,
    /// A positive right duty must be wired backwards.
    pub motor_right_reversed: bool,
    /// A longer pulse turns the servo clockwise.
    pub servo_reversed: bool,
    /// Rangefinders fitted, in the order front, right, left.
    pub rangefinders: u8,
    /// Front, right, left: turn × 0x10000, counter-clockwise from straight ahead.
    pub bearings: [u16; 3],
    /// A servo swings the front rangefinder.
    pub servo: bool,
    /// The MPU6050 guards the heading against wheels that slip.
    pub gyro: bool,
    /// Milliseconds without a fresh valid frame until the motors brake.
    pub stop_deadline: u16,
    /// Duty below which the left motor does not turn, 0.01 %.
    pub dead_zone_left: u16,
    /// Duty below which the right motor does not turn, 0.01 %.
    pub dead_zone_right: u16,
    /// Largest duty of the left motor, 0.01 %.
    pub limit_left: u16,
    /// Largest duty of the right motor, 0.01 %.
    pub limit_right: u16,
    /// UART log, baud.
    pub log_baud: u32,
    /// Millivolts per cell.
    pub battery_warn: u16,
    /// Millivolts per cell.
    pub battery_cutoff: u16,
    /// How near the expected position counts as there, micrometres.
    pub position_tolerance: u16,
    /// How near the expected rotation counts as there, turn × 0x10000.
    pub rotation_tolerance: u16,
    /// Milliseconds between pose lines in the log, 0 = none.
    pub log_period: u16,
    /// How far the servo turns from a pulse of 1.0 ms to one of 2.0 ms, turn × 0x10000; 0 = half a turn.
    pub servo_travel: u16,
}

impl Platform {
    /// The first board: what a blank page 0x03 stands for.
    // Requirement: DOC-2.2-2
    pub const FIRST_BOARD: Self = Self {
        counts_per_turn: 3840,
        wheel_diameter_left: 80_000,
        wheel_diameter_right: 80_000,
        track: 125_000,
        // The first board's encoders count down when its wheels roll forward.
        encoder_left_reversed: true,
        encoder_right_reversed: true,
        motor_left_reversed: false,
        motor_right_reversed: false,
        servo_reversed: false,
        rangefinders: 3,
        bearings: [0, 0xC000, 0x4000],
        servo: false,
        gyro: false,
        stop_deadline: 250,
        dead_zone_left: 1600,
        dead_zone_right: 2300,
        limit_left: 10_000,
        limit_right: 10_000,
        log_baud: 115_200,
        battery_warn: 3400,
        battery_cutoff: 3000,
        position_tolerance: 3000,
        rotation_tolerance: 91,
        log_period: 0,
        servo_travel: 0,
    };
}

impl Divider {
    /// A tap that no cell uses: what an EEPROM cell that was never written reads as.
    pub const UNWRITTEN: Self = Self {
        upper: u32::MAX,
        lower: u32::MAX,
    };
}

impl From<&Config> for Setup {
    fn from(config: &Config) -> Self {
        Self {
            mode: config.mode,
            key_from_pi: config.key_from_pi,
            key_from_stm: config.key_from_stm,
            cells: config.cells,
        }
    }
}

/// The first board as it ran: what a new EEPROM starts from.
// Requirement: DOC-2.3-5
#[must_use]
pub const fn first_board() -> Config {
    let mut dividers = [Divider::UNWRITTEN; 8];
    dividers[0] = Divider {
        upper: 10_000,
        lower: 33_000,
    };
    dividers[1] = Divider {
        upper: 33_000,
        lower: 22_000,
    };
    Config {
        key_from_pi: 0x96,
        key_from_stm: 0x5A,
        mode: Mode::Normal,
        forward: Gains {
            p: Binary64(6.5088_f64.to_bits()),
            i: Binary64(0.073_412_f64.to_bits()),
            d: Binary64(106.72_f64.to_bits()),
            anti_windup: Binary64(0.3_f64.to_bits()),
        },
        rotation: Gains {
            p: Binary64(1.3686_f64.to_bits()),
            i: Binary64(0.009_326_3_f64.to_bits()),
            d: Binary64(50.209_f64.to_bits()),
            anti_windup: Binary64(1.4_f64.to_bits()),
        },
        cells: 2,
        adc_max_voltage: Binary64(3.3_f64.to_bits()),
        adc_max_word: 4095,
        dividers,
        platform: Platform::FIRST_BOARD,
    }
}

#[cfg(test)]
#[allow(
    clippy::cast_possible_truncation,
    clippy::cast_possible_wrap,
    clippy::cast_sign_loss,
    reason = "values are drawn from within their ranges"
)]
mod tests;
