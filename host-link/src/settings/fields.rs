//! The one table of the configuration file: key, EEPROM address, unit, meaning, and the place in
//! [`Config`]. Reading, writing and the messages all follow from it.

use fw_core::binary64::Binary64;
use fw_core::eeprom::{Config, Divider};
use fw_core::wire::Mode;

/// Where a field lies in the configuration, and how the file writes it.
#[derive(Clone, Copy)]
pub(super) enum Access {
    /// The mode, by name or number.
    Mode(fn(&mut Config) -> &mut Mode),
    /// True or false.
    Flag(fn(&mut Config) -> &mut bool),
    /// A whole number.
    Byte(fn(&mut Config) -> &mut u8),
    /// A whole number.
    Long(fn(&mut Config) -> &mut u32),
    /// A number, stored as the given multiple.
    Word(f64, fn(&mut Config) -> &mut u16),
    /// A number, stored as the given multiple.
    ScaledLong(f64, fn(&mut Config) -> &mut u32),
    /// An angle in degrees, stored as turn × 0x10000.
    Bearing(fn(&mut Config) -> &mut u16),
    /// A number, stored as it is.
    Binary64(fn(&mut Config) -> &mut Binary64),
}

/// One field.
#[derive(Clone, Copy)]
pub(super) struct Field {
    /// `section.key` of the file.
    pub key: &'static str,
    /// EEPROM address of its first byte.
    pub address: u16,
    /// What it means, and its unit.
    pub help: &'static str,
    /// Its place.
    pub access: Access,
}

impl Field {
    /// The file's section.
    pub fn section(&self) -> &'static str {
        self.key.rsplit_once('.').map_or("", |(section, _)| section)
    }

    /// The key inside the section.
    pub fn name(&self) -> &'static str {
        self.key.rsplit_once('.').map_or(self.key, |(_, name)| name)
    }

    /// Whether the file may leave it out: then the first board's figure applies.
    pub fn optional(&self) -> bool {
        self.address >= PLATFORM
    }

    /// The tap it belongs to, 1 to 8, if it is a resistor.
    pub fn tap(&self) -> Option<u8> {
        self.section().strip_prefix("battery.tap_")?.parse().ok()
    }
}

/// Where page 0x03 begins.
pub(super) const PLATFORM: u16 = 0x0300;

/// Every field, in the order of the file.
pub(super) fn all() -> impl Iterator<Item = &'static Field> {
    SCALARS.iter().chain(TAPS.iter().flatten()).chain(&PAGE_3)
}

/// The field at or around an EEPROM address; the first where several share it.
pub(super) fn at(address: u16) -> Option<&'static Field> {
    all()
        .filter(|field| field.address <= address)
        .reduce(|best, field| {
            if field.address > best.address {
                field
            } else {
                best
            }
        })
}

const fn field(key: &'static str, address: u16, help: &'static str, access: Access) -> Field {
    Field {
        key,
        address,
        help,
        access,
    }
}

macro_rules! gain {
    ($key:literal, $address:literal, $help:literal, $pid:ident.$factor:ident) => {
        field(
            $key,
            $address,
            $help,
            Access::Binary64(|c| &mut c.$pid.$factor),
        )
    };
}

macro_rules! tap {
    ($tap:literal, $index:literal) => {
        [
            field(
                concat!("battery.tap_", $tap, ".upper_ohm"),
                0x0210 + 8 * $index,
                "between the tap and the ADC pin, ohm",
                Access::Long(|c| &mut divider(c, $index).upper),
            ),
            field(
                concat!("battery.tap_", $tap, ".lower_ohm"),
                0x0214 + 8 * $index,
                "between the ADC pin and ground, ohm",
                Access::Long(|c| &mut divider(c, $index).lower),
            ),
        ]
    };
}

#[allow(clippy::indexing_slicing)] // the table below knows 0 to 7 only
fn divider(config: &mut Config, index: usize) -> &mut Divider {
    &mut config.dividers[index]
}

#[allow(clippy::indexing_slicing)] // the table below knows 0 to 2 only
fn bearing(config: &mut Config, index: usize) -> &mut u16 {
    &mut config.platform.bearings[index]
}

/// Pages 0x00 to 0x02 without the resistors.
static SCALARS: [Field; 14] = [
    field(
        "link.mode",
        0x000C,
        "chain of strategies; both ends run it: \"Normal\", \"Guarded Normal\", … or its number",
        Access::Mode(|c| &mut c.mode),
    ),
    field(
        "link.key_from_pi",
        0x000A,
        "first byte of every frame Pi -> STM",
        Access::Byte(|c| &mut c.key_from_pi),
    ),
    field(
        "link.key_from_stm",
        0x000B,
        "first byte of every frame STM -> Pi",
        Access::Byte(|c| &mut c.key_from_stm),
    ),
    gain!("pid.forward.p", 0x0100, "% of duty per mm", forward.p),
    gain!(
        "pid.forward.i",
        0x0108,
        "% of duty per mm, each 10 ms sample",
        forward.i
    ),
    gain!(
        "pid.forward.d",
        0x0110,
        "% of duty per mm of change in a 10 ms sample",
        forward.d
    ),
    gain!(
        "pid.forward.anti_windup",
        0x0118,
        "back-calculation factor",
        forward.anti_windup
    ),
    gain!("pid.rotation.p", 0x0120, "% of duty per degree", rotation.p),
    gain!(
        "pid.rotation.i",
        0x0128,
        "% of duty per degree, each 10 ms sample",
        rotation.i
    ),
    gain!(
        "pid.rotation.d",
        0x0130,
        "% of duty per degree of change in a 10 ms sample",
        rotation.d
    ),
    gain!(
        "pid.rotation.anti_windup",
        0x0138,
        "back-calculation factor",
        rotation.anti_windup
    ),
    field(
        "battery.cells",
        0x0203,
        "cells in series, 1 to 8; tap n is the sum of cells 1 to n",
        Access::Byte(|c| &mut c.cells),
    ),
    field(
        "battery.adc_max_v",
        0x0204,
        "volts at the ADC pin that read as adc_max_word",
        Access::Binary64(|c| &mut c.adc_max_voltage),
    ),
    field(
        "battery.adc_max_word",
        0x020C,
        "the ADC's largest word",
        Access::Long(|c| &mut c.adc_max_word),
    ),
];

static TAPS: [[Field; 2]; 8] = [
    tap!(1, 0),
    tap!(2, 1),
    tap!(3, 2),
    tap!(4, 3),
    tap!(5, 4),
    tap!(6, 5),
    tap!(7, 6),
    tap!(8, 7),
];

static PAGE_3: [Field; 27] = [
    field(
        "platform.counts_per_turn",
        0x0302,
        "encoder counts per wheel turn, both channels, both edges",
        Access::Word(1.0, |c| &mut c.platform.counts_per_turn),
    ),
    field(
        "platform.wheel_diameter_left_mm",
        0x0304,
        "mm, resolution 0.001",
        Access::ScaledLong(1000.0, |c| &mut c.platform.wheel_diameter_left),
    ),
    field(
        "platform.wheel_diameter_right_mm",
        0x0308,
        "mm, resolution 0.001",
        Access::ScaledLong(1000.0, |c| &mut c.platform.wheel_diameter_right),
    ),
    field(
        "platform.track_mm",
        0x030C,
        "between the wheels' contact points, mm, resolution 0.001",
        Access::ScaledLong(1000.0, |c| &mut c.platform.track),
    ),
    field(
        "platform.encoder_left_reversed",
        0x0310,
        "it counts down when the wheel rolls forward",
        Access::Flag(|c| &mut c.platform.encoder_left_reversed),
    ),
    field(
        "platform.encoder_right_reversed",
        0x0310,
        "it counts down when the wheel rolls forward",
        Access::Flag(|c| &mut c.platform.encoder_right_reversed),
    ),
    field(
        "platform.motor_left_reversed",
        0x0310,
        "a positive duty turns the wheel backward",
        Access::Flag(|c| &mut c.platform.motor_left_reversed),
    ),
    field(
        "platform.motor_right_reversed",
        0x0310,
        "a positive duty turns the wheel backward",
        Access::Flag(|c| &mut c.platform.motor_right_reversed),
    ),
    field(
        "platform.rangefinders",
        0x0311,
        "fitted, 0 to 3, in the order front, right, left",
        Access::Byte(|c| &mut c.platform.rangefinders),
    ),
    field(
        "platform.bearing_front_deg",
        0x0312,
        "degrees counter-clockwise from straight ahead",
        Access::Bearing(|c| bearing(c, 0)),
    ),
    field(
        "platform.bearing_right_deg",
        0x0314,
        "degrees counter-clockwise from straight ahead",
        Access::Bearing(|c| bearing(c, 1)),
    ),
    field(
        "platform.bearing_left_deg",
        0x0316,
        "degrees counter-clockwise from straight ahead",
        Access::Bearing(|c| bearing(c, 2)),
    ),
    field(
        "platform.servo",
        0x0318,
        "a servo swings the front rangefinder",
        Access::Flag(|c| &mut c.platform.servo),
    ),
    field(
        "platform.servo_reversed",
        0x0310,
        "a longer pulse turns it clockwise",
        Access::Flag(|c| &mut c.platform.servo_reversed),
    ),
    field(
        "platform.servo_travel_deg",
        0x0332,
        "degrees between pulses of 1.0 and 2.0 ms, 0 to 180; 0 stands for 180",
        Access::Word(65_536.0 / 360.0, |c| &mut c.platform.servo_travel),
    ),
    field(
        "platform.gyro",
        0x0319,
        "the MPU6050 guards the heading against slip",
        Access::Flag(|c| &mut c.platform.gyro),
    ),
    field(
        "platform.stop_deadline_ms",
        0x031A,
        "ms without a fresh valid frame until the motors brake",
        Access::Word(1.0, |c| &mut c.platform.stop_deadline),
    ),
    field(
        "platform.dead_zone_left_percent",
        0x031C,
        "duty below which the motor does not turn, %, resolution 0.01",
        Access::Word(100.0, |c| &mut c.platform.dead_zone_left),
    ),
    field(
        "platform.dead_zone_right_percent",
        0x031E,
        "duty below which the motor does not turn, %, resolution 0.01",
        Access::Word(100.0, |c| &mut c.platform.dead_zone_right),
    ),
    field(
        "platform.limit_left_percent",
        0x0320,
        "largest duty, %, resolution 0.01",
        Access::Word(100.0, |c| &mut c.platform.limit_left),
    ),
    field(
        "platform.limit_right_percent",
        0x0322,
        "largest duty, %, resolution 0.01",
        Access::Word(100.0, |c| &mut c.platform.limit_right),
    ),
    field(
        "platform.log_baud",
        0x0324,
        "UART log, baud",
        Access::Long(|c| &mut c.platform.log_baud),
    ),
    field(
        "platform.battery_warn_v",
        0x0328,
        "per cell, V, resolution 0.001",
        Access::Word(1000.0, |c| &mut c.platform.battery_warn),
    ),
    field(
        "platform.battery_cutoff_v",
        0x032A,
        "per cell, V, resolution 0.001: below it the motors stop",
        Access::Word(1000.0, |c| &mut c.platform.battery_cutoff),
    ),
    field(
        "platform.position_tolerance_mm",
        0x032C,
        "how near counts as there, mm, resolution 0.001",
        Access::Word(1000.0, |c| &mut c.platform.position_tolerance),
    ),
    field(
        "platform.rotation_tolerance_deg",
        0x032E,
        "how near counts as there, degrees, resolution 0.0055",
        Access::Word(65_536.0 / 360.0, |c| &mut c.platform.rotation_tolerance),
    ),
    field(
        "platform.log_period_ms",
        0x0330,
        "ms between pose lines in the log, 0 = none",
        Access::Word(1.0, |c| &mut c.platform.log_period),
    ),
];
