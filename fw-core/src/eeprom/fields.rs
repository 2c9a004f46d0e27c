//! The schema: every field of the register map.
//!
//! The ranges are wide enough for any robot of this kind and narrow enough that nothing downstream
//! can overflow or divide by zero; each says why it is what it is.

use super::field::{Accepted, Field, Kind, Unit};

const fn int(min: u32, max: u32) -> Accepted {
    Accepted::IntRange { min, max }
}

const ANY: Accepted = int(0, u32::MAX);
const SWITCH: Accepted = int(0, 1);
/// A negative gain would drive away from the target. Ten thousand percent of duty per millimetre,
/// degree or sample is full duty at the smallest error there is.
// Requirement: WIRE-refused-4
const GAIN: Accepted = Accepted::RealRange {
    min: 0,
    max: 10_000,
};
/// No microcontroller's ADC measures more than 10 V; less than 100 mV is noise.
// Requirement: DOC-6.0.3-1, WIRE-refused-6
const ADC_VOLTS: Accepted = Accepted::RealRange {
    min: 429_496_730,
    max: 10,
};
/// Larger than any divider for a battery needs; times a 16-bit word still far inside 64 bits.
const UPPER: Accepted = int(0, 10_000_000);
// Requirement: WIRE-refused-5
const LOWER: Accepted = int(1, 10_000_000);
/// From 10 mm, a wheel smaller than which the motor's shaft would not fit, to 1 m.
const DIAMETER: Accepted = int(10_000, 1_000_000);
/// A dead zone of 100 % would be a robot that cannot move.
const DEAD_ZONE: Accepted = int(0, 9_999);
/// So would a limit of 0.
const LIMIT: Accepted = int(1, 10_000);
/// Above any cell there is; 0 switches the supervision off.
const CELL_MILLIVOLTS: Accepted = int(0, 5_000);

/// A wheel that does not turn at full duty cannot be controlled; 5 m/s is no robot of this kind.
const FULL_SPEED: Accepted = int(1, 5_000);
/// Slower than 10 mm/s is below a count a tick; the wheels' speeds stay within 16 bits of a count.
const SPEED: Accepted = int(10, 2_000);
/// Below 50 mm/s² a robot needs metres to start or to stop; above 1 g its wheels slip.
const RATE_OF_SPEED: Accepted = int(50, 10_000);

/// Bits of an unwritten resistor.
const UNWRITTEN: u64 = u32::MAX as u64;

const fn bit(shift: u8) -> Kind {
    Kind::Bits { shift, width: 1 }
}

const fn real(value: f64) -> u64 {
    value.to_bits()
}

/// A row by itself: some versions of Kani take a constant reference into an array for one to its first element.
#[allow(clippy::indexing_slicing, reason = "evaluated by the compiler")]
const fn row(index: Index) -> Field {
    TABLE[index as usize]
}

/// One row per field; rows of a battery tap end with its number. Only `FIELDS` is linked into the
/// firmware.
macro_rules! fields {
    ($($(#[$attribute:meta])* $constant:ident $address:literal $kind:expr, $name:literal
       [$unit:ident] $accepted:expr, = $first:expr, $help:literal $($tap:literal)?;)*) => {
        #[derive(Clone, Copy)]
        #[allow(non_camel_case_types, clippy::upper_case_acronyms, reason = "the fields' names")]
        enum Index { $($constant),* }

        $(
            #[doc = $help]
            #[allow(clippy::doc_markdown, reason = "the help is also printed as plain text")]
            pub const $constant: &Field = &row(Index::$constant);
        )*

        /// Number of fields.
        pub const COUNT: usize = [$(Index::$constant),*].len();

        pub(super) const TABLE: [Field; COUNT] = [$(Field {
            address: $address,
            unit: Unit::$unit,
            kind: $kind,
            accepted: &$accepted,
            tap: 0 $(+ $tap)?,
            index: Index::$constant as u8,
        }),*];

        /// The fields' names in the order of [`FIELDS`], then those of the EEPROM key and of the checksum.
        const NAMES: &str = concat!($($name, "\n",)* "EEPROM key\ncrc\n");

        /// The first board's raw values, in the order of [`FIELDS`].
        // Requirement: DOC-2.2-2, DOC-2.3-5
        pub const FIRST_BOARD: [u64; COUNT] = [$($first),*];

        /// One line on each field, in the order of [`FIELDS`]. Not linked into a firmware.
        pub const HELP: [&str; COUNT] = [$($help),*];
    };
}

/// Position of the EEPROM key's name, see [`name`].
#[allow(clippy::cast_possible_truncation, reason = "an index has 8 bits")]
pub(super) const KEY_NAME: u8 = COUNT as u8;
/// Position of the checksum's name.
pub(super) const CRC_NAME: u8 = KEY_NAME + 1;

/// The name at a position of [`NAMES`]. One text for all: a reference in each field would cost flash.
pub(super) fn name(position: u8) -> &'static str {
    let (mut begin, mut left) = (0, position);
    for (at, byte) in NAMES.bytes().enumerate() {
        if byte == b'\n' {
            if left == 0 {
                return NAMES.get(begin..at).unwrap_or_default();
            }
            (begin, left) = (at.wrapping_add(1), left.wrapping_sub(1));
        }
    }
    ""
}

/// Every field, by address; the EEPROM key at 0x0000 and the checksum at 0x034E are none.
pub static FIELDS: [Field; COUNT] = TABLE;

#[rustfmt::skip]
fields! {
    // Page 0x00 (document, 6.0.1). Any byte can be a key.
    // Requirement: DOC-5.1.6-2
    KEY_FROM_PI 0x000A Kind::U8, "key_from_pi" [None] ANY, = 0x96, "first byte of every frame Pi -> STM";
    KEY_FROM_STM 0x000B Kind::U8, "key_from_stm" [None] ANY, = 0x5A, "first byte of every frame STM -> Pi";
    // Requirement: DOC-6.0.1-2
    MODE 0x000C Kind::U8, "mode" [None] Accepted::Mode, = 0, "chain of strategies, the same at both ends: \"Normal\", \"Guarded Normal\", … or its number";

    // Page 0x01 (document, 6.0.2).
    // Requirement: DOC-6.0.2-1
    FORWARD_P 0x0100 Kind::Binary64, "forward.p" [PercentPerMillimetre] GAIN, = real(6.5088), "% of duty per mm";
    FORWARD_I 0x0108 Kind::Binary64, "forward.i" [PercentPerMillimetre] GAIN, = real(0.073_412), "% of duty per mm, each 10 ms sample";
    FORWARD_D 0x0110 Kind::Binary64, "forward.d" [PercentPerMillimetre] GAIN, = real(106.72), "% of duty per mm of change in a 10 ms sample";
    FORWARD_ANTI_WINDUP 0x0118 Kind::Binary64, "forward.anti_windup" [None] GAIN, = real(0.3), "back-calculation factor";
    ROTATION_P 0x0120 Kind::Binary64, "rotation.p" [PercentPerDegree] GAIN, = real(1.3686), "% of duty per degree";
    ROTATION_I 0x0128 Kind::Binary64, "rotation.i" [PercentPerDegree] GAIN, = real(0.009_326_3), "% of duty per degree, each 10 ms sample";
    ROTATION_D 0x0130 Kind::Binary64, "rotation.d" [PercentPerDegree] GAIN, = real(50.209), "% of duty per degree of change in a 10 ms sample";
    ROTATION_ANTI_WINDUP 0x0138 Kind::Binary64, "rotation.anti_windup" [None] GAIN, = real(1.4), "back-calculation factor";

    // Page 0x02 (document, 6.0.3).
    // Requirement: WIRE-refused-7
    CELLS 0x0203 Kind::U8, "cells" [None] int(1, 8), = 2, "cells in series, 1 to 8; tap n is the sum of cells 1 to n";
    ADC_MAX 0x0204 Kind::Binary64, "adc_max" [Volts] ADC_VOLTS, = real(3.3), "volts at the ADC pin that read as adc_max_word";
    // Up to 16 bits.
    ADC_MAX_WORD 0x020C Kind::U32, "adc_max_word" [None] int(1, 65_535), = 4095, "the ADC's largest word";
    TAP_1_UPPER 0x0210 Kind::U32, "tap_1.upper" [Ohms] UPPER, = 10_000, "between the tap and the ADC pin, ohm" 1;
    TAP_1_LOWER 0x0214 Kind::U32, "tap_1.lower" [Ohms] LOWER, = 33_000, "between the ADC pin and ground, ohm" 1;
    TAP_2_UPPER 0x0218 Kind::U32, "tap_2.upper" [Ohms] UPPER, = 33_000, "between the tap and the ADC pin, ohm" 2;
    TAP_2_LOWER 0x021C Kind::U32, "tap_2.lower" [Ohms] LOWER, = 22_000, "between the ADC pin and ground, ohm" 2;
    TAP_3_UPPER 0x0220 Kind::U32, "tap_3.upper" [Ohms] UPPER, = UNWRITTEN, "between the tap and the ADC pin, ohm" 3;
    TAP_3_LOWER 0x0224 Kind::U32, "tap_3.lower" [Ohms] LOWER, = UNWRITTEN, "between the ADC pin and ground, ohm" 3;
    TAP_4_UPPER 0x0228 Kind::U32, "tap_4.upper" [Ohms] UPPER, = UNWRITTEN, "between the tap and the ADC pin, ohm" 4;
    TAP_4_LOWER 0x022C Kind::U32, "tap_4.lower" [Ohms] LOWER, = UNWRITTEN, "between the ADC pin and ground, ohm" 4;
    TAP_5_UPPER 0x0230 Kind::U32, "tap_5.upper" [Ohms] UPPER, = UNWRITTEN, "between the tap and the ADC pin, ohm" 5;
    TAP_5_LOWER 0x0234 Kind::U32, "tap_5.lower" [Ohms] LOWER, = UNWRITTEN, "between the ADC pin and ground, ohm" 5;
    TAP_6_UPPER 0x0238 Kind::U32, "tap_6.upper" [Ohms] UPPER, = UNWRITTEN, "between the tap and the ADC pin, ohm" 6;
    TAP_6_LOWER 0x023C Kind::U32, "tap_6.lower" [Ohms] LOWER, = UNWRITTEN, "between the ADC pin and ground, ohm" 6;
    TAP_7_UPPER 0x0240 Kind::U32, "tap_7.upper" [Ohms] UPPER, = UNWRITTEN, "between the tap and the ADC pin, ohm" 7;
    TAP_7_LOWER 0x0244 Kind::U32, "tap_7.lower" [Ohms] LOWER, = UNWRITTEN, "between the ADC pin and ground, ohm" 7;
    TAP_8_UPPER 0x0248 Kind::U32, "tap_8.upper" [Ohms] UPPER, = UNWRITTEN, "between the tap and the ADC pin, ohm" 8;
    TAP_8_LOWER 0x024C Kind::U32, "tap_8.lower" [Ohms] LOWER, = UNWRITTEN, "between the ADC pin and ground, ohm" 8;

    // Page 0x03, ours.
    // Requirement: WIRE-platform-1
    LAYOUT_VERSION 0x0300 Kind::U8, "layout_version" [None] int(2, 2), = 2, "layout of this page";
    LAYOUT_LENGTH 0x0301 Kind::U8, "layout_length" [None] int(0x52, 0x52), = 0x52, "bytes it defines, checksum included";
    // Below 100 counts a turn a count is centimetres and degrees.
    COUNTS_PER_TURN 0x0302 Kind::U16, "counts_per_turn" [None] int(100, 60_000), = 3840, "encoder counts per wheel turn, both channels, both edges";
    WHEEL_DIAMETER_LEFT 0x0304 Kind::U32, "wheel_diameter_left" [Micrometres] DIAMETER, = 80_000, "mm, resolution 0.001";
    WHEEL_DIAMETER_RIGHT 0x0308 Kind::U32, "wheel_diameter_right" [Micrometres] DIAMETER, = 80_000, "mm, resolution 0.001";
    // Not narrower than two motors' shafts, not wider than a door is high.
    TRACK 0x030C Kind::U32, "track" [Micrometres] int(20_000, 2_000_000), = 125_000, "between the wheels' contact points, mm, resolution 0.001";
    // The first board's encoders count down when its wheels roll forward.
    ENCODER_LEFT_REVERSED 0x0310 bit(0), "encoder_left_reversed" [None] SWITCH, = 1, "it counts down when the wheel rolls forward";
    ENCODER_RIGHT_REVERSED 0x0310 bit(1), "encoder_right_reversed" [None] SWITCH, = 1, "it counts down when the wheel rolls forward";
    MOTOR_LEFT_REVERSED 0x0310 bit(2), "motor_left_reversed" [None] SWITCH, = 0, "a positive duty turns the wheel backward";
    MOTOR_RIGHT_REVERSED 0x0310 bit(3), "motor_right_reversed" [None] SWITCH, = 0, "a positive duty turns the wheel backward";
    SERVO_REVERSED 0x0310 bit(4), "servo_reversed" [None] SWITCH, = 0, "a longer pulse turns it clockwise";
    SIGNS_RESERVED 0x0310 Kind::Bits { shift: 5, width: 3 }, "signs_reserved" [None] int(0, 0), = 0, "unused bits";
    RANGEFINDERS 0x0311 Kind::U8, "rangefinders" [None] int(0, 3), = 3, "fitted, 0 to 3, in the order front, right, left";
    BEARING_FRONT 0x0312 Kind::U16, "bearing_front" [Turns] ANY, = 0, "degrees counter-clockwise from straight ahead";
    BEARING_RIGHT 0x0314 Kind::U16, "bearing_right" [Turns] ANY, = 0xC000, "degrees counter-clockwise from straight ahead";
    BEARING_LEFT 0x0316 Kind::U16, "bearing_left" [Turns] ANY, = 0x4000, "degrees counter-clockwise from straight ahead";
    SERVO 0x0318 Kind::U8, "servo" [None] SWITCH, = 0, "a servo swings the front rangefinder";
    GYRO 0x0319 Kind::U8, "gyro" [None] SWITCH, = 0, "the MPU6050 corrects the heading while a wheel slips";
    // Two ticks at least; at the robot's 1 m/s, 2 s without a host are too far already.
    STOP_DEADLINE 0x031A Kind::U16, "stop_deadline" [Milliseconds] int(20, 2_000), = 250, "ms without a fresh valid frame until the motors brake";
    DEAD_ZONE_LEFT 0x031C Kind::U16, "dead_zone_left" [PercentHundredths] DEAD_ZONE, = 1600, "duty below which the motor does not turn, %, resolution 0.01";
    DEAD_ZONE_RIGHT 0x031E Kind::U16, "dead_zone_right" [PercentHundredths] DEAD_ZONE, = 2300, "duty below which the motor does not turn, %, resolution 0.01";
    LIMIT_LEFT 0x0320 Kind::U16, "limit_left" [PercentHundredths] LIMIT, = 10_000, "largest duty, %, resolution 0.01";
    LIMIT_RIGHT 0x0322 Kind::U16, "limit_right" [PercentHundredths] LIMIT, = 10_000, "largest duty, %, resolution 0.01";
    // The USART's divider from 100 MHz is 16 bits wide and at least 16.
    LOG_BAUD 0x0324 Kind::U32, "log_baud" [Baud] int(9_600, 2_000_000), = 115_200, "UART log, baud";
    BATTERY_WARN 0x0328 Kind::U16, "battery_warn" [Millivolts] CELL_MILLIVOLTS, = 3400, "per cell, V, resolution 0.001; 0 = off";
    BATTERY_CUTOFF 0x032A Kind::U16, "battery_cutoff" [Millivolts] CELL_MILLIVOLTS, = 3000, "per cell, V, resolution 0.001: below it the motors stop; 0 = off";
    // A tolerance below what a count can tell is never met; half a turn is no rotation at all.
    POSITION_TOLERANCE 0x032C Kind::U16, "position_tolerance" [Micrometres] int(200, 65_535), = 3000, "how near counts as there, mm, resolution 0.001";
    ROTATION_TOLERANCE 0x032E Kind::U16, "rotation_tolerance" [Turns] int(8, 0x2000), = 91, "how near counts as there, degrees, resolution 0.0055";
    LOG_PERIOD 0x0330 Kind::U16, "log_period" [Milliseconds] int(0, 60_000), = 0, "ms between pose lines in the log, 0 = none";
    // A sensor that looks further back than sideways sees the robot.
    SERVO_TRAVEL 0x0332 Kind::U16, "servo_travel" [Turns] int(0, 0x8000), = 0, "degrees between pulses of 1.0 and 2.0 ms, 0 to 180; 0 stands for 180";
    // The obstacle stop and the limits of the velocity.
    // Requirement: WIRE-platform-13
    STOP_DISTANCE 0x0334 Kind::U16, "stop_distance" [Millimetres] int(0, 2_000), = 150, "kept between the robot's front edge and an obstacle, mm";
    FRONT_OVERHANG 0x0336 Kind::U16, "front_overhang" [Millimetres] int(0, 1_000), = 20, "from the front rangefinder's face to the robot's front edge, mm";
    REACTION_TIME 0x0338 Kind::U16, "reaction_time" [Milliseconds] int(0, 1_000), = 100, "from an echo to slower wheels, ms";
    DECELERATION 0x033A Kind::U16, "deceleration" [MillimetresPerSecondSquared] RATE_OF_SPEED, = 400, "of the obstacle stop, mm/s²";
    BLIND_SPEED 0x033C Kind::U16, "blind_speed" [MillimetresPerSecond] int(0, 2_000), = 100, "largest forward speed without a front distance, mm/s";
    REVERSE_SPEED 0x033E Kind::U16, "reverse_speed" [MillimetresPerSecond] int(0, 2_000), = 50, "largest backward speed, mm/s";
    REVERSE_DISTANCE 0x0340 Kind::U16, "reverse_distance" [Millimetres] int(0, 10_000), = 300, "driven by velocity: longest way back before the next way forward, mm";
    MAX_SPEED 0x0342 Kind::U16, "max_speed" [MillimetresPerSecond] SPEED, = 200, "driven by velocity: largest forward speed, mm/s";
    // Half a turn a second, as on the wire.
    MAX_YAW_RATE 0x0344 Kind::U16, "max_yaw_rate" [TurnsPerSecond] int(0x100, 0x8000), = 0x4000, "driven by velocity: largest yaw rate, degrees/s, resolution 0.0055";
    ACCELERATION 0x0346 Kind::U16, "acceleration" [MillimetresPerSecondSquared] RATE_OF_SPEED, = 400, "driven by velocity, mm/s²";
    YAW_ACCELERATION 0x0348 Kind::U16, "yaw_acceleration" [TurnsPerSecondSquared] int(0x100, 0xFFFF), = 0x8000, "driven by velocity, degrees/s², resolution 0.0055";
    FULL_SPEED_LEFT 0x034A Kind::U16, "full_speed_left" [MillimetresPerSecond] FULL_SPEED, = 134, "of the wheel at full duty without load, mm/s";
    FULL_SPEED_RIGHT 0x034C Kind::U16, "full_speed_right" [MillimetresPerSecond] FULL_SPEED, = 169, "of the wheel at full duty without load, mm/s";
}
