//! The checked configuration.
#![allow(
    clippy::cast_possible_truncation,
    reason = "a raw value is as wide as the field it was read from"
)]

use super::constraint::CONSTRAINTS;
use super::error::{ConfigError, Expected};
use super::field::Field;
use super::fields::{
    ACCELERATION, ADC_MAX, ADC_MAX_WORD, BATTERY_CUTOFF, BATTERY_WARN, BEARING_FRONT, BEARING_LEFT,
    BEARING_RIGHT, BLIND_SPEED, CELLS, COUNTS_PER_TURN, DEAD_ZONE_LEFT, DEAD_ZONE_RIGHT,
    DECELERATION, ENCODER_LEFT_REVERSED, ENCODER_RIGHT_REVERSED, FIELDS, FORWARD_P, FRONT_OVERHANG,
    FULL_SPEED_LEFT, FULL_SPEED_RIGHT, GYRO, KEY_FROM_PI, KEY_FROM_STM, LIMIT_LEFT, LIMIT_RIGHT,
    LOG_BAUD, LOG_PERIOD, MAX_SPEED, MAX_YAW_RATE, MODE, MOTOR_LEFT_REVERSED, MOTOR_RIGHT_REVERSED,
    POSITION_TOLERANCE, RANGEFINDERS, REACTION_TIME, REVERSE_DISTANCE, REVERSE_SPEED,
    ROTATION_ANTI_WINDUP, ROTATION_P, ROTATION_TOLERANCE, SERVO, SERVO_REVERSED, SERVO_TRAVEL,
    STOP_DEADLINE, STOP_DISTANCE, TAP_1_LOWER, TAP_1_UPPER, TAP_8_LOWER, TRACK,
    WHEEL_DIAMETER_LEFT, WHEEL_DIAMETER_RIGHT, YAW_ACCELERATION,
};
use super::image::{FIRST_PLATFORM, Image, PLATFORM};
use super::parts::{Divider, Gain, Gains, ObstacleStop, Servo, VelocityLimits, Wheel};
use crate::binary64::Binary64;
use crate::types::{Duty, Micrometres, Milliseconds, Ohms, RangefinderId, Turns, Volts};
use crate::wire::{Mode, Setup};
use fixed::types::{I32F32, U16F16};

/// Most cells of a battery (document, 6.0.3).
pub const MAX_CELLS: usize = 8;

/// Everything the robot needs to know, checked: what holds of its parts, their documentation says.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Config {
    mode: Mode,
    key_from_pi: u8,
    key_from_stm: u8,
    forward: Gains,
    rotation: Gains,
    adc_max: I32F32,
    adc_max_word: u16,
    cells: u8,
    rangefinders: u8,
    dividers: [Divider; MAX_CELLS],
    left: Wheel,
    right: Wheel,
    track: Micrometres,
    counts_per_turn: u16,
    stop_deadline: Milliseconds,
    bearings: [Turns; 3],
    servo: Option<Servo>,
    gyro: bool,
    log_period: Milliseconds,
    log_baud: u32,
    battery_warn: Volts,
    battery_cutoff: Volts,
    position_tolerance: Micrometres,
    rotation_tolerance: Turns,
    obstacle_stop: ObstacleStop,
    velocity_limits: VelocityLimits,
}

impl Config {
    /// The configuration of an image, if all of it is right.
    ///
    /// # Errors
    /// The first field that is not: the EEPROM key, then version, length and checksum of page 0x03
    /// (unless that is blank: the first board's values), then the fields by address, then the
    /// constraints between them.
    // Requirement: DOC-6-4, DOC-6-5, WIRE-refused-2
    pub fn decode(image: &Image) -> Result<Self, ConfigError> {
        image.verify()?;
        let original = image.is_original();
        Self::from_fields(|field| raw(image, original, field))
    }

    /// The configuration of raw values, if they are accepted. `raw` always answers the same for a
    /// field.
    ///
    /// # Errors
    /// The first field, by address, that is not within its range; then the first constraint that
    /// does not hold.
    pub fn from_fields(raw: impl Fn(&'static Field) -> u64) -> Result<Self, ConfigError> {
        let cells = raw(CELLS) as u8;
        for field in &FIELDS {
            let value = raw(field);
            if !field.contains(value, cells) {
                return Err(ConfigError::range(field, value));
            }
        }
        let config = Self::of_checked(&raw);
        for constraint in CONSTRAINTS {
            if !constraint.holds(&config) {
                let expected = Expected::Constraint(constraint.expected);
                let value = raw(constraint.field);
                return Err(ConfigError::new(constraint.field, value, expected));
            }
        }
        Ok(config)
    }

    /// Of raw values that [`Self::from_fields`] accepts; of others it has no meaning.
    pub fn of_checked(raw: &impl Fn(&'static Field) -> u64) -> Self {
        let at = |index| raw_at(raw, index);
        let raw = |field: &Field| at(field.index);
        let flag = |field| raw(field) != 0;
        let word = |field| raw(field) as u16;
        let micrometres = |field| Micrometres(raw(field) as u32);
        let turns = |field| Turns((raw(field) as u32) << 16);
        let millivolts = |field| Volts(U16F16::from_bits(((raw(field) as u32) << 16) / 1000));
        let real = |field| real(raw(field));
        const { assert!(TAP_8_LOWER.index == TAP_1_UPPER.index + 15) };
        let divider = |cell: usize| Divider {
            upper: Ohms(at(TAP_1_UPPER.index + 2 * cell as u8) as u32),
            lower: Ohms(at(TAP_1_LOWER.index + 2 * cell as u8) as u32),
        };
        Self {
            mode: Mode::from_code(raw(MODE) as u8).unwrap_or_default(),
            key_from_pi: raw(KEY_FROM_PI) as u8,
            key_from_stm: raw(KEY_FROM_STM) as u8,
            forward: gains(&at, FORWARD_P),
            rotation: gains(&at, ROTATION_P),
            adc_max: real(ADC_MAX),
            adc_max_word: word(ADC_MAX_WORD),
            cells: raw(CELLS) as u8,
            rangefinders: raw(RANGEFINDERS) as u8,
            dividers: core::array::from_fn(divider),
            left: wheel(&at, 0),
            right: wheel(&at, 1),
            track: micrometres(TRACK),
            counts_per_turn: word(COUNTS_PER_TURN),
            stop_deadline: Milliseconds(word(STOP_DEADLINE)),
            bearings: [
                turns(BEARING_FRONT),
                turns(BEARING_RIGHT),
                turns(BEARING_LEFT),
            ],
            servo: flag(SERVO).then(|| Servo {
                travel: match turns(SERVO_TRAVEL) {
                    Turns(0) => Turns(1 << 31),
                    travel => travel,
                },
                reversed: flag(SERVO_REVERSED),
            }),
            gyro: flag(GYRO),
            log_period: Milliseconds(word(LOG_PERIOD)),
            log_baud: raw(LOG_BAUD) as u32,
            battery_warn: millivolts(BATTERY_WARN),
            battery_cutoff: millivolts(BATTERY_CUTOFF),
            position_tolerance: micrometres(POSITION_TOLERANCE),
            rotation_tolerance: turns(ROTATION_TOLERANCE),
            obstacle_stop: ObstacleStop {
                stop_distance_mm: word(STOP_DISTANCE),
                overhang_mm: word(FRONT_OVERHANG),
                reaction_time: Milliseconds(word(REACTION_TIME)),
                deceleration_mm_s2: word(DECELERATION),
                blind_speed_mm_s: word(BLIND_SPEED),
                reverse_speed_mm_s: word(REVERSE_SPEED),
                reverse_distance_mm: word(REVERSE_DISTANCE),
            },
            velocity_limits: VelocityLimits {
                speed_mm_s: word(MAX_SPEED),
                yaw_rate: turns(MAX_YAW_RATE).0,
                acceleration_mm_s2: word(ACCELERATION),
                yaw_acceleration: turns(YAW_ACCELERATION).0,
            },
        }
    }

    /// The chain of strategies.
    pub const fn mode(&self) -> Mode {
        self.mode
    }

    /// What both ends of the link need to know to understand each other.
    pub const fn link_setup(&self) -> Setup {
        Setup {
            mode: self.mode,
            key_from_pi: self.key_from_pi,
            key_from_stm: self.key_from_stm,
            cells: self.cells,
        }
    }

    /// Gains of the forward PID, percent of duty per millimetre.
    pub const fn forward(&self) -> &Gains {
        &self.forward
    }

    /// Gains of the rotation PID, percent of duty per degree.
    pub const fn rotation(&self) -> &Gains {
        &self.rotation
    }

    /// Battery cells in series, 1 ..= 8.
    pub const fn cells(&self) -> u8 {
        self.cells
    }

    /// Volts at an ADC pin that read as [`Self::adc_max_word`], 0.1 ..= 10.
    pub const fn adc_max_volts(&self) -> I32F32 {
        self.adc_max
    }

    /// The ADC's largest word, 1 ..= 65 535.
    pub const fn adc_max_word(&self) -> u16 {
        self.adc_max_word
    }

    /// One divider per cell; tap n is the sum of cells 1 to n.
    pub fn dividers(&self) -> &[Divider] {
        let cells = usize::from(self.cells);
        self.dividers.get(..cells).unwrap_or_default()
    }

    /// The left wheel.
    pub const fn left(&self) -> &Wheel {
        &self.left
    }

    /// The right wheel.
    pub const fn right(&self) -> &Wheel {
        &self.right
    }

    /// Distance between the wheels' contact points, 20 mm to 2 m.
    pub const fn track(&self) -> Micrometres {
        self.track
    }

    /// Encoder counts per wheel turn, both channels, both edges: 100 ..= 60 000.
    pub const fn counts_per_turn(&self) -> u16 {
        self.counts_per_turn
    }

    /// Time without a fresh valid frame until the motors brake, 20 ms to 2 s.
    pub const fn stop_deadline(&self) -> Milliseconds {
        self.stop_deadline
    }

    /// Rangefinders fitted, 0 ..= 3, in the order front, right, left; at least 1 in the sweep mode.
    pub const fn rangefinders(&self) -> u8 {
        self.rangefinders
    }

    /// Where a rangefinder points, counter-clockwise from straight ahead.
    pub const fn bearing(&self, rangefinder: RangefinderId) -> Turns {
        let [front, right, left] = self.bearings;
        match rangefinder {
            RangefinderId::Front => front,
            RangefinderId::Right => right,
            RangefinderId::Left => left,
        }
    }

    /// The servo of the front rangefinder, if there is one; there is in the sweep mode.
    pub const fn servo(&self) -> Option<Servo> {
        self.servo
    }

    /// Whether the MPU6050 corrects the heading while a wheel slips.
    pub const fn gyro(&self) -> bool {
        self.gyro
    }

    /// Time between pose lines in the log, up to 60 s; 0 = none.
    pub const fn log_period(&self) -> Milliseconds {
        self.log_period
    }

    /// Rate of the UART log, 9 600 ..= 2 000 000 baud.
    pub const fn log_baud(&self) -> u32 {
        self.log_baud
    }

    /// A cell below this is reported, up to 5 V; 0 = off.
    pub const fn battery_warn(&self) -> Volts {
        self.battery_warn
    }

    /// A cell below this stops the motors, up to [`Self::battery_warn`]; 0 = off.
    pub const fn battery_cutoff(&self) -> Volts {
        self.battery_cutoff
    }

    /// Distance from the target that counts as arrived, 0.2 mm to 65.5 mm.
    pub const fn position_tolerance(&self) -> Micrometres {
        self.position_tolerance
    }

    /// Rotation from the target that counts as arrived, 0.044° to 45°.
    pub const fn rotation_tolerance(&self) -> Turns {
        self.rotation_tolerance
    }

    /// The obstacle stop's figures.
    pub const fn obstacle_stop(&self) -> &ObstacleStop {
        &self.obstacle_stop
    }

    /// The limits of a commanded velocity.
    pub const fn velocity_limits(&self) -> &VelocityLimits {
        &self.velocity_limits
    }
}

/// The raw value of the field at an index: a number takes less code at each call than an address.
#[inline(never)]
fn raw_at(raw: &impl Fn(&'static Field) -> u64, index: u8) -> u64 {
    FIELDS.get(usize::from(index)).map_or(0, raw)
}

/// The gains whose fields follow one another from `first`, by the raw values at their indices.
#[inline(never)]
fn gains(raw: &impl Fn(u8) -> u64, first: &Field) -> Gains {
    const { assert!(ROTATION_ANTI_WINDUP.index == FORWARD_P.index + 7) };
    let gain = |place| Gain(real(raw(first.index + place)));
    Gains {
        p: gain(0),
        i: gain(1),
        d: gain(2),
        anti_windup: gain(3),
    }
}

/// The wheel of a `side`: 0 left, 1 right, by the raw values at the fields' indices.
#[inline(never)]
fn wheel(raw: &impl Fn(u8) -> u64, side: u8) -> Wheel {
    const {
        assert!(WHEEL_DIAMETER_RIGHT.index == WHEEL_DIAMETER_LEFT.index + 1);
        assert!(ENCODER_RIGHT_REVERSED.index == ENCODER_LEFT_REVERSED.index + 1);
        assert!(MOTOR_RIGHT_REVERSED.index == MOTOR_LEFT_REVERSED.index + 1);
        assert!(DEAD_ZONE_RIGHT.index == DEAD_ZONE_LEFT.index + 1);
        assert!(LIMIT_RIGHT.index == LIMIT_LEFT.index + 1);
        assert!(FULL_SPEED_RIGHT.index == FULL_SPEED_LEFT.index + 1);
    }
    let raw = |left: &Field| raw(left.index + side);
    let duty = |field| Duty::saturating(i32::from(raw(field) as u16));
    Wheel {
        diameter: Micrometres(raw(WHEEL_DIAMETER_LEFT) as u32),
        encoder_reversed: raw(ENCODER_LEFT_REVERSED) != 0,
        motor_reversed: raw(MOTOR_LEFT_REVERSED) != 0,
        dead_zone: duty(DEAD_ZONE_LEFT),
        limit: duty(LIMIT_LEFT),
        full_speed_mm_s: raw(FULL_SPEED_LEFT) as u16,
    }
}

/// A checked number.
#[inline(never)]
fn real(bits: u64) -> I32F32 {
    Binary64(bits).to_fixed().unwrap_or_default()
}

/// The raw value of a field; on an `original` image the first board's platform.
// One copy in flash: a copy for each field would be 0.7 KiB more.
#[inline(never)]
fn raw(image: &Image, original: bool, field: &Field) -> u64 {
    if original && field.address >= PLATFORM {
        field.read(&FIRST_PLATFORM, PLATFORM)
    } else {
        image.get(field)
    }
}

impl From<&Config> for Setup {
    fn from(config: &Config) -> Self {
        config.link_setup()
    }
}
