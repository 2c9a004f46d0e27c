//! EEPROM images: accepted ones in both directions, rejected ones with what they name.

use crate::json::{file, hex, list, number, text, Value};
use fw_core::binary64::Binary64;
use fw_core::eeprom::{
    self, decode, encode, encode_original, first_board, Config, Field, Image, FIELDS, IMAGE_LEN,
};

/// The image of a vector: what it does not list was never written.
fn image(vector: &Value) -> Image {
    let mut image = [0xFF; IMAGE_LEN];
    for (address, bytes) in vector["image"].as_object().expect("an image") {
        let at = usize::try_from(number(address)).unwrap();
        let bytes = hex(bytes.as_str().expect("bytes"));
        image[at..at + bytes.len()].copy_from_slice(&bytes);
    }
    image
}

/// A field's bits: a double as `0x…`, the others as integers.
fn raw(value: &Value) -> u64 {
    match value {
        Value::String(bits) => number(bits),
        value => value.as_u64().expect("an integer"),
    }
}

/// The configuration of a vector; every field of the core's table must be there, and no other.
fn config(vector: &Value) -> Config {
    let values = vector["fields"].as_object().expect("fields");
    assert_eq!(values.len(), FIELDS.len());
    let mut config = first_board();
    for field in FIELDS {
        let value = values.get(field.name);
        let value = raw(value.unwrap_or_else(|| panic!("no {}", field.name)));
        field.set(&mut config, value);
        assert_eq!(field.get(&config), value, "{}", field.name);
    }
    config
}

// Requirement: DOC-6.0.3-1, DOC-6-5, DOC-6.0.1-2, DOC-6.0.2-1, DOC-6.0.3-2
#[test]
fn accepted_images_decode_to_vector_values() {
    for vector in list(&file("eeprom")["accepted"]) {
        let found = decode(&image(vector));
        assert_eq!(found, Ok(config(vector)), "{}", text(vector, "name"));
    }
}

#[test]
fn configurations_encode_to_vector_bytes() {
    for vector in list(&file("eeprom")["accepted"]) {
        if !crate::json::is_written(vector) {
            continue;
        }
        let mut written = [0xFF; IMAGE_LEN];
        if vector["original"] == true {
            encode_original(&config(vector), &mut written);
        } else {
            encode(&config(vector), &mut written);
        }
        assert_eq!(written, image(vector), "{}", text(vector, "name"));
    }
}

// Requirement: WIRE-eeprom-9
#[test]
fn encode_leaves_unclaimed_bytes() {
    for vector in list(&file("eeprom")["accepted"]) {
        let mut written = image(vector);
        if vector["original"] == true {
            encode_original(&config(vector), &mut written);
        } else {
            encode(&config(vector), &mut written);
        }
        assert_eq!(written, image(vector), "{}", text(vector, "name"));
    }
}

// Requirement: WIRE-eeprom-3, WIRE-refused-2
#[test]
fn rejected_images_match_vector_errors() {
    for vector in list(&file("eeprom")["rejected"]) {
        let name = text(vector, "name");
        let error = decode(&image(vector)).expect_err(name);
        let address = u64::from(error.address);
        assert_eq!(address, number(text(vector, "address")), "{name}: {error}");
        assert_eq!(error.field, text(vector, "field"), "{name}: {error}");
        let value = &vector["value"];
        let expected = match error.value {
            eeprom::Value::Key(key) => hex(value.as_str().expect("a key")) == key,
            eeprom::Value::Whole(whole) | eeprom::Value::Checksum(whole) => {
                raw(value) == u64::from(whole)
            }
            eeprom::Value::Number(Binary64(bits)) => raw(value) == bits,
        };
        assert!(expected, "{name}: {error}, not {value}");
    }
}

#[test]
fn vectors_reject_every_partial_field() {
    let file = file("eeprom");
    let rejected = |name: &str| {
        list(&file["rejected"])
            .iter()
            .any(|vector| text(vector, "field") == name)
    };
    assert!(rejected("EEPROM key") && rejected("crc"));
    // Every byte is a key, every 16-bit word a bearing.
    let total = |field: &&Field| {
        let wide = 8 * field.kind.len();
        field.takes(0, 8) && field.takes(u64::MAX >> (64 - wide), 8)
    };
    for field in FIELDS.iter().filter(|field| !total(field)) {
        assert!(rejected(field.name), "{}", field.name);
    }
}
