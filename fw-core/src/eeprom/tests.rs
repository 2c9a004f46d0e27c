use super::fields::*;
use super::*;
use crate::types::{Duty, Micrometres, Milliseconds, Ohms, RangefinderId, Turns, Volts};
use crate::wire::Mode;
use fixed::types::{I32F32, U16F16};
use std::collections::BTreeSet;
use std::string::{String, ToString};
use std::vec::Vec;

/// The first board's configuration.
pub(crate) fn first_board() -> Config {
    config_with(&[])
}

/// The first board's configuration with other raw values in some fields.
pub(crate) fn config_with(changes: &[(&Field, u64)]) -> Config {
    Config::decode(&image_with(changes)).expect("accepted")
}

fn image_with(changes: &[(&Field, u64)]) -> Image {
    let change = |image: Image, &(field, raw): &(&Field, u64)| image.with(field, raw);
    changes.iter().fold(Image::FIRST_BOARD, change)
}

fn rejection(image: &Image) -> ConfigError {
    Config::decode(image).unwrap_err()
}

fn put(image: &mut Image, address: usize, hex: &str) {
    for (at, byte) in hex.split_whitespace().enumerate() {
        image.0[address + at] = u8::from_str_radix(byte, 16).unwrap();
    }
}

/// Every byte from the document's tables by hand; pages 0x00 to 0x02.
fn original_by_hand() -> Image {
    let mut image = Image::BLANK;
    put(&mut image, 0x0000, "15 26 37 48 59 6A 7B 8C 9D AE");
    put(&mut image, 0x000A, "96 5A 00");
    // 2.5 = 0x4004000000000000, 0.125 = 0x3FC0…, 100 = 0x4059…, 0.5 = 0x3FE0…
    put(&mut image, 0x0100, "00 00 00 00 00 00 04 40");
    put(&mut image, 0x0108, "00 00 00 00 00 00 C0 3F");
    put(&mut image, 0x0110, "00 00 00 00 00 00 59 40");
    put(&mut image, 0x0118, "00 00 00 00 00 00 E0 3F");
    // 1.25 = 0x3FF4…, 0 , 50 = 0x4049…, 1 = 0x3FF0…
    put(&mut image, 0x0120, "00 00 00 00 00 00 F4 3F");
    put(&mut image, 0x0128, "00 00 00 00 00 00 00 00");
    put(&mut image, 0x0130, "00 00 00 00 00 00 49 40");
    put(&mut image, 0x0138, "00 00 00 00 00 00 F0 3F");
    // Two cells; 3.25 V = 0x400A… reads as 4095; 10k/33k, 33k/22k.
    put(&mut image, 0x0203, "02");
    put(&mut image, 0x0204, "00 00 00 00 00 00 0A 40");
    put(&mut image, 0x020C, "FF 0F 00 00");
    put(&mut image, 0x0210, "10 27 00 00 E8 80 00 00");
    put(&mut image, 0x0218, "E8 80 00 00 F0 55 00 00");
    image
}

fn real(value: f64) -> u64 {
    value.to_bits()
}

// Requirement: DOC-6.0.1-2, DOC-6.0.2-1, DOC-6.0.3-1
#[test]
fn original_image_decodes_with_first_platform() {
    let image = original_by_hand();
    let config = Config::decode(&image).unwrap();
    let gains = |p, i, d, anti_windup| [p, i, d, anti_windup].map(I32F32::lit);
    let found = |gains: &Gains| [gains.p, gains.i, gains.d, gains.anti_windup].map(Gain::value);
    let setup = config.link_setup();
    assert_eq!((setup.mode, setup.cells), (Mode::Normal, 2));
    assert_eq!((setup.key_from_pi, setup.key_from_stm), (0x96, 0x5A));
    assert_eq!(found(config.forward()), gains("2.5", "0.125", "100", "0.5"));
    assert_eq!(found(config.rotation()), gains("1.25", "0", "50", "1"));
    assert_eq!(config.adc_max_volts(), I32F32::lit("3.25"));
    assert_eq!((config.adc_max_word(), config.cells()), (4095, 2));
    let divider = |upper, lower| Divider {
        upper: Ohms(upper),
        lower: Ohms(lower),
    };
    let dividers = [divider(10_000, 33_000), divider(33_000, 22_000)];
    assert_eq!(config.dividers(), dividers);
    let first = first_board();
    assert!(config.left() == first.left() && config.right() == first.right());
    assert_eq!(config.track(), Micrometres(125_000));

    let gains = FIELDS.iter().filter(|field| field.address >> 8 == 1);
    let values = [2.5, 0.125, 100.0, 0.5, 1.25, 0.0, 50.0, 1.0];
    let mut changes: Vec<_> = gains.zip(values.map(real)).collect();
    changes.push((ADC_MAX, real(3.25)));
    let mut written = image_with(&changes);
    written.make_original();
    assert_eq!(written, image);
}

// Requirement: DOC-6-5, WIRE-eeprom-8, WIRE-platform-13
#[test]
fn page_three_by_hand_decodes() {
    let mut image = original_by_hand();
    put(&mut image, 0x0300, "02 52 D0 07");
    put(&mut image, 0x0304, "10 98 02 00 C0 D4 01 00 F0 49 02 00");
    put(&mut image, 0x0310, "16 02 01 00 02 C0 03 40 01 01");
    put(&mut image, 0x031A, "2C 01 E8 03 D0 07 28 23 10 27");
    put(&mut image, 0x0324, "00 C2 01 00 AC 0D E4 0C");
    put(&mut image, 0x032C, "E8 03 B6 00 64 00 34 52");
    put(&mut image, 0x0334, "C8 00 1E 00 50 00 F4 01");
    put(&mut image, 0x033C, "5A 00 28 00 FA 00");
    put(&mut image, 0x0342, "2C 01 00 20 58 02 00 60 96 00 A0 00");
    image.seal();
    let config = Config::decode(&image).unwrap();
    assert_eq!(config.counts_per_turn(), 2000);
    let wheel = |um, encoder_reversed, motor_reversed, dead_zone, limit, full_speed_mm_s| Wheel {
        diameter: Micrometres(um),
        encoder_reversed,
        motor_reversed,
        dead_zone: Duty::saturating(dead_zone),
        limit: Duty::saturating(limit),
        full_speed_mm_s,
    };
    let left = wheel(170_000, false, true, 1000, 9000, 150);
    let right = wheel(120_000, true, false, 2000, 10_000, 160);
    assert_eq!((config.left(), config.right()), (&left, &right));
    assert_eq!((config.track().0, config.rangefinders()), (150_000, 2));
    let bearings = RangefinderId::ALL.map(|id| config.bearing(id));
    let expected = [0x0001, 0xC002, 0x4003].map(|code| Turns(code << 16));
    assert_eq!(bearings, expected);
    let servo = config.servo().unwrap();
    assert_eq!(servo.travel, Turns(0x5234 << 16));
    assert!(servo.reversed && config.gyro());
    assert_eq!(config.stop_deadline(), Milliseconds(300));
    assert_eq!(config.log_baud(), 115_200);
    assert_eq!(config.log_period(), Milliseconds(100));
    assert_eq!(config.battery_warn(), Volts(U16F16::lit("3.5")));
    assert_eq!(config.battery_cutoff(), Volts(U16F16::from_bits(0x34CCC)));
    assert_eq!(config.position_tolerance(), Micrometres(1000));
    assert_eq!(config.rotation_tolerance(), Turns(182 << 16));
    let stop = ObstacleStop {
        stop_distance_mm: 200,
        overhang_mm: 30,
        reaction_time: Milliseconds(80),
        deceleration_mm_s2: 500,
        blind_speed_mm_s: 90,
        reverse_speed_mm_s: 40,
        reverse_distance_mm: 250,
    };
    let limits = VelocityLimits {
        speed_mm_s: 300,
        yaw_rate: 1 << 29,
        acceleration_mm_s2: 600,
        yaw_acceleration: 3 << 29,
    };
    assert_eq!(config.obstacle_stop(), &stop);
    assert_eq!(config.velocity_limits(), &limits);
}

#[test]
fn servo_travel_zero_is_half_a_turn() {
    let config = config_with(&[(SERVO, 1)]);
    assert_eq!(config.servo().unwrap().travel, Turns(1 << 31));
    assert_eq!(config_with(&[(SERVO_TRAVEL, 0x1000)]).servo(), None);
}

#[test]
fn spans_are_the_defined_bytes() {
    let spans: Vec<_> = SPANS.map(|span| (span.address, span.len)).into();
    assert_eq!(spans, [(0, 13), (0x100, 64), (0x203, 77), (0x300, 82)]);
    // Every byte of a field, and every byte of a span but the EEPROM key's and the checksum's.
    let bytes = |field: &Field| field.address..field.address + field.kind.bytes();
    let touched = FIELDS.iter().flat_map(bytes).chain(0..10);
    let touched: BTreeSet<_> = touched.chain(CRC_ADDRESS..CRC_ADDRESS + 4).collect();
    let bytes = |span: &Span| span.address..span.address + span.len;
    assert!(SPANS.iter().flat_map(bytes).eq(touched));
}

#[test]
fn fields_are_sorted_unique_and_described() {
    assert!(FIELDS.is_sorted_by_key(|field| (field.address, field.kind.mask().trailing_zeros())));
    for (index, field) in FIELDS.iter().enumerate() {
        let same = FIELDS.iter().filter(|other| other.name() == field.name());
        assert_eq!(same.count(), 1);
        assert!(!HELP[index].is_empty() && usize::from(field.index) == index);
    }
    let end = usize::from(PLATFORM) + PLATFORM_LEN;
    assert_eq!(usize::from(CRC_ADDRESS) + 4, end);
    assert_eq!(Image::FIRST_BOARD.get(LAYOUT_VERSION), u64::from(LAYOUT));
    assert_eq!(Image::FIRST_BOARD.get(LAYOUT_LENGTH), PLATFORM_LEN as u64);
}

#[test]
fn byte_beyond_the_last_is_erased() {
    let bytes = [0, 1, 2].map(|at| super::field::byte(&[7], at));
    assert_eq!(bytes, [7, 0xFF, 0xFF]);
}

// Requirement: DOC-6.0.1-1
#[test]
fn eeprom_key_any_wrong_byte_rejected() {
    let error = rejection(&Image::BLANK);
    assert_eq!((error.address, error.field()), (0x0000, "EEPROM key"));
    assert_eq!(error.value, FieldValue::Key([0xFF; 10]));
    let text = "EEPROM page 0x00 address 0x00: EEPROM key is FFFFFFFFFFFFFFFFFFFF, \
                accepted: 15263748596A7B8C9DAE";
    assert_eq!(error.to_string(), text);
    for at in 0..KEY.len() {
        let mut image = original_by_hand();
        image.0[at] ^= 0x10;
        assert_eq!(rejection(&image).field(), "EEPROM key");
    }
}

// Requirement: WIRE-eeprom-3
#[test]
fn rejections_read_as_one_sentence() {
    // A field, its raw value, the rejection.
    let cases = "\
track 0 03 address 0x0C: track is 0 um, accepted: 20000 to 2000000
forward.i 7FF8000000000000 01 address 0x08: forward.i is NaN %/mm, accepted: 0.0 to 10000.0
rotation.anti_windup FFF0000000000000 01 address 0x38: rotation.anti_windup is infinity, accepted: \
0.0 to 10000.0
rotation.p 7E37E43C8800759C 01 address 0x20: rotation.p is a binary64 of bits 0x7E37E43C8800759C \
%/deg, accepted: 0.0 to 10000.0
adc_max 0 02 address 0x04: adc_max is 0.000000 V, accepted: 0.1 to 10.0
cells 9 02 address 0x03: cells is 9, accepted: 1 to 8
mode 7 00 address 0x0C: mode is 7, accepted: 0x00, 0x01, 0x02, 0x10, 0x11, 0x12, 0x20, 0x30
mode 20 03 address 0x18: servo is 0, accepted: 1 in mode 0x20
signs_reserved 5 03 address 0x10: signs_reserved is 5, accepted: 0
layout_version 1 03 address 0x00: layout_version is 1, accepted: 2; run robot eeprom migrate";
    for case in cases.lines() {
        let [name, raw, text] = case.splitn(3, ' ').collect::<Vec<_>>()[..] else {
            panic!("{case}");
        };
        let field = FIELDS.iter().find(|field| field.name() == name).unwrap();
        let raw = u64::from_str_radix(raw, 16).unwrap();
        let error = rejection(&image_with(&[(field, raw)]));
        assert_eq!(error.to_string(), String::from("EEPROM page 0x") + text);
    }
    let mut image = Image::FIRST_BOARD;
    image.0[0x0351] ^= 0x80;
    let (sum, found) = (image.checksum(), image.stored_checksum());
    let text = std::format!("crc is 0x{found:08X}, accepted: 0x{sum:08X}");
    let place = "EEPROM page 0x03 address 0x4E: ";
    assert_eq!(rejection(&image).to_string(), place.to_string() + &text);
}

// Requirement: WIRE-eeprom-1
#[test]
fn page_three_with_one_byte_written_rejected() {
    for at in 0x300..0x352 {
        let mut image = original_by_hand();
        image.0[at] = 0xFE;
        assert_eq!(rejection(&image).page(), 3);
    }
}

// Requirement: WIRE-platform-1, WIRE-refused-2
#[test]
fn other_layout_named_before_checksum() {
    let (version, length) = (LAYOUT_VERSION, LAYOUT_LENGTH);
    for (field, raw) in [(version, 1), (version, 3), (length, 0x38)] {
        let mut image = Image::FIRST_BOARD;
        image.set(field, raw);
        assert_eq!(rejection(&image).field(), field.name());
    }
}

// Requirement: DOC-6.0.1-3, WIRE-eeprom-9
#[test]
fn undefined_bytes_survive_a_rewrite() {
    let mut image = Image([0x5C; IMAGE_LEN]);
    image.copy_defined(&Image::FIRST_BOARD);
    assert_eq!(Config::decode(&image), Ok(first_board()));
    for at in [0x000D, 0x0140, 0x0202, 0x0250, 0x0352, 0x03FF] {
        assert_eq!(image.0[at], 0x5C);
    }
}
