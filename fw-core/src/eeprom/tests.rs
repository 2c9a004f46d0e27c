use super::*;
use fixed::types::I32F32;
use proptest::prelude::*;
use std::string::ToString;
use std::vec::Vec;

const BLANK: Image = [0xFF; IMAGE_LEN];

fn image_of(config: &Config) -> Image {
    let mut image = BLANK;
    encode(config, &mut image);
    image
}

fn put(image: &mut Image, address: usize, hex: &str) {
    for (at, byte) in hex.split_whitespace().enumerate() {
        image[address + at] = u8::from_str_radix(byte, 16).unwrap();
    }
}

/// With a checksum that is right again.
fn seal(image: &mut Image) {
    let sum = crc32(&image[..0x334]).to_le_bytes();
    image[0x334..0x338].copy_from_slice(&sum);
}

fn store(image: &mut Image, field: &Field, raw: u64) {
    let at = usize::from(field.address);
    let len = field.kind.len();
    image[at..at + len].copy_from_slice(&raw.to_le_bytes()[..len]);
}

fn rejection(image: &Image) -> ConfigError {
    decode(image).unwrap_err()
}

/// Every byte from the document's tables by hand; pages 0x00 to 0x02.
fn original_by_hand() -> Image {
    let mut image = BLANK;
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

fn by_hand() -> Config {
    let double = |value: f64| Binary64(value.to_bits());
    let gains = |p, i, d, anti_windup| Gains {
        p: double(p),
        i: double(i),
        d: double(d),
        anti_windup: double(anti_windup),
    };
    Config {
        forward: gains(2.5, 0.125, 100.0, 0.5),
        rotation: gains(1.25, 0.0, 50.0, 1.0),
        adc_max_voltage: double(3.25),
        ..first_board()
    }
}

// Requirement: DOC-6.0.1-2, DOC-6.0.2-1, DOC-6.0.3-1, DOC-6.0.3-2
#[test]
fn an_original_image_is_read_and_the_first_boards_platform_applies() {
    assert_eq!(decode(&original_by_hand()), Ok(by_hand()));
    let mut image = BLANK;
    encode_original(&by_hand(), &mut image);
    assert_eq!(image, original_by_hand());
}

// Requirement: DOC-6-5, WIRE-eeprom-8
#[test]
fn page_three_stands_where_its_table_says() {
    let mut image = original_by_hand();
    put(&mut image, 0x0300, "01 38 D0 07");
    put(&mut image, 0x0304, "10 98 02 00 C0 D4 01 00 F0 49 02 00");
    put(&mut image, 0x0310, "16 02 01 00 02 C0 03 40 01 01");
    put(&mut image, 0x031A, "2C 01 E8 03 D0 07 28 23 10 27");
    put(&mut image, 0x0324, "00 C2 01 00 AC 0D E4 0C");
    put(&mut image, 0x032C, "E8 03 B6 00 64 00 34 52");
    seal(&mut image);
    let config = Config {
        platform: Platform {
            counts_per_turn: 2000,
            wheel_diameter_left: 170_000,
            wheel_diameter_right: 120_000,
            track: 150_000,
            encoder_left_reversed: false,
            encoder_right_reversed: true,
            motor_left_reversed: true,
            motor_right_reversed: false,
            servo_reversed: true,
            rangefinders: 2,
            bearings: [0x0001, 0xC002, 0x4003],
            servo: true,
            gyro: true,
            stop_deadline: 300,
            dead_zone_left: 1000,
            dead_zone_right: 2000,
            limit_left: 9000,
            limit_right: 10_000,
            log_baud: 115_200,
            battery_warn: 3500,
            battery_cutoff: 3300,
            position_tolerance: 1000,
            rotation_tolerance: 182,
            log_period: 100,
            servo_travel: 0x5234,
        },
        ..by_hand()
    };
    assert_eq!(decode(&image), Ok(config.clone()));
    assert_eq!(image_of(&config), image);
}

#[test]
fn the_first_board_is_accepted_and_comes_back() {
    let config = first_board();
    assert_eq!(check(&config), Ok(()));
    assert_eq!(decode(&image_of(&config)), Ok(config));
}

// Requirement: DOC-6.0.1-1
#[test]
fn a_blank_eeprom_names_its_key_and_what_was_found() {
    let error = rejection(&BLANK);
    assert_eq!((error.address, error.field), (0x0000, "EEPROM key"));
    assert_eq!(error.value, Value::Key([0xFF; 10]));
    assert_eq!(
        error.to_string(),
        "EEPROM page 0x00 address 0x00: EEPROM key is FFFFFFFFFFFFFFFFFFFF, \
         accepted: 15263748596A7B8C9DAE"
    );
    // Every single byte of it counts.
    for at in 0..KEY.len() {
        let mut image = original_by_hand();
        image[at] ^= 0x10;
        assert_eq!(rejection(&image).field, "EEPROM key");
    }
}

// Requirement: WIRE-eeprom-3
#[test]
fn an_error_reads_as_one_sentence() {
    let text = |change: &dyn Fn(&mut Image)| {
        let mut image = image_of(&first_board());
        change(&mut image);
        seal(&mut image);
        rejection(&image).to_string()
    };
    assert_eq!(
        text(&|image| put(image, 0x030C, "00 00 00 00")),
        "EEPROM page 0x03 address 0x0C: track is 0 um, accepted: 20000 to 2000000"
    );
    assert_eq!(
        text(&|image| put(image, 0x0108, "00 00 00 00 00 00 F8 7F")),
        "EEPROM page 0x01 address 0x08: forward.i is NaN %/mm, accepted: 0.0 to 10000.0"
    );
    assert_eq!(
        text(&|image| put(image, 0x0138, "00 00 00 00 00 00 F0 FF")),
        "EEPROM page 0x01 address 0x38: rotation.anti_windup is infinity, accepted: 0.0 to 10000.0"
    );
    assert_eq!(
        text(&|image| put(image, 0x0204, "00 00 00 00 00 00 00 00")),
        "EEPROM page 0x02 address 0x04: adc_max_voltage is 0.000000 V, accepted: 0.1 to 10.0"
    );
    assert_eq!(
        text(&|image| put(image, 0x000C, "07")),
        "EEPROM page 0x00 address 0x0C: mode is 7, \
         accepted: 0x00, 0x01, 0x02, 0x10, 0x11, 0x12, 0x20"
    );
    assert_eq!(
        text(&|image| put(image, 0x000C, "20")),
        "EEPROM page 0x03 address 0x18: servo is 0, accepted: 1 in mode 0x20"
    );
    assert_eq!(
        text(&|image| put(image, 0x0300, "02")),
        "EEPROM page 0x03 address 0x00: layout_version is 2, accepted: 1"
    );
    let mut image = image_of(&first_board());
    image[0x0337] ^= 0x80;
    let sum = crc32(&image[..0x334]);
    assert_eq!(
        rejection(&image).to_string(),
        std::format!(
            "EEPROM page 0x03 address 0x34: crc is 0x{:08X}, accepted: 0x{sum:08X}",
            sum ^ 0x8000_0000
        )
    );
    let huge = Value::Number(Binary64(0x7E37_E43C_8800_759C));
    let error = ConfigError {
        value: huge,
        ..rejection(&BLANK)
    };
    assert!(error
        .to_string()
        .contains("a double of bits 0x7E37E43C8800759C"));
}

#[test]
fn the_table_is_in_order_without_overlap_and_leaves_key_and_checksum_alone() {
    let mut end = KEY.len();
    for field in FIELDS {
        let at = usize::from(field.address);
        assert!(at >= end, "{}", field.name);
        assert!(!field.kind.is_empty());
        end = at + field.kind.len();
        assert!(std::ptr::eq(Field::at(field.address).unwrap(), field));
        let same = FIELDS.iter().filter(|other| other.name == field.name);
        assert_eq!(same.count(), 1);
    }
    assert_eq!(end, usize::from(CRC_ADDRESS));
    assert_eq!(usize::from(CRC_ADDRESS) + 4, 0x300 + PLATFORM_LEN);
    assert_eq!(
        rule::RULES
            .iter()
            .filter(|rule| Field::at(rule.address).is_none())
            .count(),
        0
    );
}

/// A configuration with every field in play: eight cells, a servo.
fn roomy() -> Config {
    let mut config = first_board();
    config.cells = 8;
    config.dividers = [Divider {
        upper: 1000,
        lower: 500_000,
    }; 8];
    config.mode = Mode::GuardedSweep;
    config.platform.servo = true;
    config.platform.dead_zone_left = 0;
    config.platform.dead_zone_right = 0;
    config.platform.battery_warn = 5000;
    config.platform.battery_cutoff = 0;
    config
}

// Requirement: WIRE-eeprom-10, WIRE-refused-3, WIRE-refused-4, WIRE-refused-5, WIRE-refused-6
// Requirement: WIRE-refused-7
#[test]
fn every_field_is_accepted_at_its_ends_and_rejected_beyond_them() {
    let good = image_of(&roomy());
    for field in FIELDS {
        let (inside, outside): (Vec<u64>, Vec<u64>) = match *field.accepted {
            Accepted::Whole { min, max } => {
                let widest = u64::MAX >> (64 - 8 * field.kind.len());
                let inside = [u64::from(min), u64::from(max).min(widest)].to_vec();
                let below = u64::from(min).checked_sub(1);
                let above = Some(u64::from(max) + 1).filter(|&above| above <= widest);
                (inside, below.into_iter().chain(above).collect())
            }
            Accepted::Number { min, max } => {
                let double = |fixed| Binary64::from_fixed(fixed).0;
                let step = I32F32::from_bits(1 << 10);
                let odd = [
                    f64::NAN,
                    -f64::NAN,
                    f64::INFINITY,
                    f64::NEG_INFINITY,
                    f64::MAX,
                    -1.0,
                ];
                let beyond = [double(min - step), double(max + step)];
                let outside = odd.map(f64::to_bits).into_iter().chain(beyond).collect();
                (std::vec![double(min), double(max)], outside)
            }
            Accepted::Mode => {
                let known: Vec<_> = Mode::ALL.iter().map(|mode| mode.code().into()).collect();
                let unknown = (0..=255).filter(|code| !known.contains(code)).collect();
                (known, unknown)
            }
            _ => panic!("{}", field.name),
        };
        for raw in inside {
            // What other fields demand is looked at below.
            let mut config = roomy();
            field.set(&mut config, raw);
            assert_eq!(field.get(&config), raw, "{}", field.name);
            let mut image = good;
            store(&mut image, field, raw);
            seal(&mut image);
            match decode(&image) {
                Ok(decoded) => assert_eq!(decoded, config),
                Err(error) => assert!(matches!(error.expected, Accepted::Rule(_)), "{error}"),
            }
        }
        for raw in outside {
            let mut image = good;
            store(&mut image, field, raw);
            seal(&mut image);
            let error = rejection(&image);
            assert_eq!((error.address, error.field), (field.address, field.name));
            assert_eq!(
                (error.value, error.expected),
                (field.value(raw), *field.accepted)
            );
            assert_eq!(error.page(), (field.address / 256) as u8);
        }
    }
}

// Requirement: WIRE-eeprom-13, WIRE-refused-1
#[test]
fn fields_must_fit_together() {
    let rejected = |change: &dyn Fn(&mut Config)| {
        let mut config = roomy();
        change(&mut config);
        let error = check(&config).err();
        assert_eq!(decode(&image_of(&config)).err(), error);
        error.map(|error| error.field)
    };
    assert_eq!(rejected(&|_| ()), None);
    for tap in 0..8 {
        let name = ["1", "2", "3", "4", "5", "6", "7", "8"][tap];
        let divider = |upper| Divider { upper, lower: 100 };
        assert_eq!(
            rejected(&|config| config.dividers[tap] = divider(9900)),
            None
        );
        let field = rejected(&|config| config.dividers[tap] = divider(9901));
        assert_eq!(field, Some(std::format!("dividers.{name}.upper").as_str()));
        // Nothing where there is no cell, whatever stands there.
        let unused = rejected(&|config| {
            config.cells = 1;
            config.dividers[tap] = divider(20_000);
        });
        assert_eq!(unused.is_none(), tap >= 1);
        for cells in 1..=8 {
            let field = rejected(&|config| {
                config.cells = cells;
                config.dividers[tap] = Divider::UNWRITTEN;
            });
            assert_eq!(field.is_none(), usize::from(cells) <= tap);
        }
    }
    assert_eq!(
        rejected(&|config| config.platform.rangefinders = 0),
        Some("rangefinders")
    );
    assert_eq!(
        rejected(&|config| config.platform.servo = false),
        Some("servo")
    );
    let plain = |config: &mut Config| {
        config.mode = Mode::Normal;
        config.platform.rangefinders = 0;
        config.platform.servo = false;
    };
    assert_eq!(rejected(&plain), None);
    let left = |config: &mut Config| config.platform.dead_zone_left = 1;
    assert_eq!(
        rejected(&|config| (left(config), config.platform.limit_left = 2).1),
        None
    );
    assert_eq!(
        rejected(&|config| (left(config), config.platform.limit_left = 1).1),
        Some("dead_zone_left")
    );
    let right = |config: &mut Config| config.platform.dead_zone_right = 500;
    assert_eq!(
        rejected(&|config| (right(config), config.platform.limit_right = 501).1),
        None
    );
    assert_eq!(
        rejected(&|config| (right(config), config.platform.limit_right = 500).1),
        Some("dead_zone_right")
    );
    assert_eq!(
        rejected(&|config| config.platform.battery_cutoff = 5000),
        None
    );
    let warn = |config: &mut Config| config.platform.battery_warn = 3000;
    assert_eq!(
        rejected(&|config| (warn(config), config.platform.battery_cutoff = 3001).1),
        Some("battery_cutoff")
    );
}

// Requirement: WIRE-eeprom-2
#[test]
fn every_single_bit_error_in_a_protected_image_is_rejected() {
    let mut image = image_of(&roomy());
    for bit in 0..(0x300 + PLATFORM_LEN) * 8 {
        image[bit / 8] ^= 1 << (bit % 8);
        assert!(decode(&image).is_err(), "bit {bit}");
        image[bit / 8] ^= 1 << (bit % 8);
    }
    assert!(decode(&image).is_ok());
    // What no field and no checksum covers is nobody's business.
    image[0x338..].fill(0);
    assert_eq!(decode(&image), Ok(roomy()));
}

// Requirement: WIRE-eeprom-1
#[test]
fn a_page_three_that_is_not_wholly_blank_must_be_right() {
    for at in 0x300..0x338 {
        let mut image = original_by_hand();
        image[at] = 0xFE;
        assert_eq!(rejection(&image).page(), 3);
    }
}

// Requirement: WIRE-platform-1, WIRE-refused-2
#[test]
fn another_layout_is_named_before_its_checksum_is_looked_for() {
    for (at, name) in [(0x300, "layout_version"), (0x301, "layout_length")] {
        let mut image = image_of(&first_board());
        image[at] ^= 0x04;
        assert_eq!(rejection(&image).field, name);
    }
}

// Requirement: DOC-6.0.1-3, WIRE-eeprom-9
#[test]
fn unused_bytes_survive_a_rewrite() {
    let mut image = [0x5C; IMAGE_LEN];
    encode(&first_board(), &mut image);
    assert_eq!(decode(&image), Ok(first_board()));
    assert_eq!(
        (image[0x000D], image[0x0140], image[0x0202], image[0x0250]),
        (0x5C, 0x5C, 0x5C, 0x5C)
    );
    assert_eq!(image[0x0338..], [0x5C; 0xC8]);
}

/// Any configuration, accepted ones often.
fn config() -> impl Strategy<Value = Config> {
    let raw = prop::collection::vec(
        (any::<u64>(), any::<prop::sample::Index>(), 0_u8..20),
        FIELDS.len(),
    );
    raw.prop_map(|choices| {
        let mut config = roomy();
        for (field, (raw, within, kind)) in FIELDS.iter().zip(choices) {
            if kind == 0 && field.accepted != &Accepted::Mode {
                // Anything that fits into the field.
                field.set(&mut config, raw >> (64 - 8 * field.kind.len()));
            } else if let Accepted::Whole { min, max } = *field.accepted {
                let span = (max - min) as usize;
                let offset = if span == usize::MAX {
                    within.index(span)
                } else {
                    within.index(span + 1)
                };
                field.set(
                    &mut config,
                    (u64::from(min) + offset as u64) & (u64::MAX >> (64 - 8 * field.kind.len())),
                );
            } else if let Accepted::Number { min, max } = *field.accepted {
                let span = (max - min).to_bits() as usize;
                let fixed = I32F32::from_bits(min.to_bits() + within.index(span) as i64);
                field.set(&mut config, Binary64::from_fixed(fixed).0);
            }
        }
        if config.platform.limit_left < config.platform.dead_zone_left {
            core::mem::swap(
                &mut config.platform.limit_left,
                &mut config.platform.dead_zone_left,
            );
        }
        config
    })
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(5_000))]

    #[test]
    fn what_check_accepts_decode_reads_back_and_the_rest_it_rejects(config in config()) {
        let image = image_of(&config);
        match check(&config) {
            Ok(()) => prop_assert_eq!(decode(&image), Ok(config)),
            Err(error) => prop_assert_eq!(decode(&image), Err(error)),
        }
    }

    #[test]
    fn an_accepted_image_is_written_again_byte_by_byte(
        noise in any::<[u8; 32]>(),
        places in prop::collection::vec(0_usize..IMAGE_LEN, 32),
        original in any::<bool>(),
    ) {
        let mut image = if original { original_by_hand() } else { image_of(&roomy()) };
        for (&at, byte) in places.iter().zip(noise) {
            image[at] = byte;
        }
        if !original {
            seal(&mut image);
        }
        if let Ok(config) = decode(&image) {
            prop_assert_eq!(check(&config), Ok(()));
            let mut again = image;
            if original {
                encode_original(&config, &mut again);
            } else {
                encode(&config, &mut again);
            }
            prop_assert_eq!(again, image);
        }
    }

    #[test]
    fn every_burst_of_up_to_32_bits_in_a_protected_image_is_rejected(
        start in 0_usize..(0x300 + PLATFORM_LEN) * 8,
        pattern in any::<u32>(),
    ) {
        let mut image = image_of(&roomy());
        for bit in (0..32).filter(|bit| (pattern | 1) >> bit & 1 == 1) {
            let at = start + bit;
            if at / 8 < 0x300 + PLATFORM_LEN {
                image[at / 8] ^= 1 << (at % 8);
            }
        }
        prop_assert!(decode(&image).is_err());
    }

    #[test]
    fn any_image_is_decided(bytes in prop::collection::vec(any::<u8>(), IMAGE_LEN), key in any::<bool>()) {
        let mut image: Image = bytes.try_into().unwrap();
        if key {
            image[..10].copy_from_slice(&KEY);
        }
        let _ = decode(&image);
    }
}
