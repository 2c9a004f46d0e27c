//! EEPROM images: accepted ones with every raw value, rejected ones with what they name.

use std::collections::BTreeSet;

use crate::json::{Value, file, hex, list, number, text};
use fw_core::binary64::Binary64;
use fw_core::eeprom::{Config, FIELDS, FieldValue, Image, PLATFORM};

/// The image of a vector: what it does not list was never written.
fn image(vector: &Value) -> Image {
    let mut image = Image::BLANK;
    for (address, bytes) in vector["image"].as_object().expect("an image") {
        let at = usize::try_from(number(address)).unwrap();
        let bytes = hex(bytes.as_str().expect("bytes"));
        image.0[at..at + bytes.len()].copy_from_slice(&bytes);
    }
    image
}

/// A raw value: a binary64 as `0x…`, the others as integers.
fn raw(value: &Value) -> u64 {
    match value {
        Value::String(bits) => number(bits),
        value => value.as_u64().expect("an integer"),
    }
}

// Requirement: DOC-6.0.3-1, DOC-6-5, DOC-6.0.1-2, DOC-6.0.2-1, DOC-6.0.3-2
#[test]
fn accepted_image_decodes_to_these_raw_values() {
    for vector in list(&file("eeprom")["accepted"]) {
        let name = text(vector, "name");
        let values = vector["fields"].as_object().expect("fields");
        assert_eq!(values.len(), FIELDS.len());
        let raw = |name: &str| raw(&values[name]);
        let image = image(vector);
        let original = vector["original"] == true;
        assert_eq!(image.is_original(), original);
        for field in &FIELDS {
            if !original || field.address < PLATFORM {
                let listed = raw(field.name());
                assert_eq!(image.get(field), listed, "{name}: {}", field.name());
            }
        }
        let listed = Config::from_fields(|field| raw(field.name()));
        assert_eq!(Config::decode(&image), listed, "{name}");
        assert!(listed.is_ok());
    }
}

// Requirement: WIRE-eeprom-9
#[test]
fn raw_values_encode_to_these_bytes() {
    for vector in list(&file("eeprom")["accepted"]) {
        let expected = image(vector);
        let mut fields = Image::BLANK;
        for field in &FIELDS {
            fields.set(field, raw(&vector["fields"][field.name()]));
        }
        if vector["original"] == true {
            fields.make_original();
        }
        fields.seal();
        // Onto an image of other values: undefined bytes stay.
        let mut written = expected.clone();
        for field in &FIELDS {
            written.set(field, !expected.get(field));
        }
        written.copy_defined(&fields);
        assert_eq!(written, expected, "{}", text(vector, "name"));
        if crate::json::is_written(vector) {
            assert_eq!(fields, expected, "{}", text(vector, "name"));
        }
    }
}

// Requirement: WIRE-eeprom-3, WIRE-refused-2
#[test]
fn rejected_image_names_address_field_and_value() {
    for vector in list(&file("eeprom")["rejected"]) {
        let name = text(vector, "name");
        let error = Config::decode(&image(vector)).expect_err(name);
        let address = u64::from(error.address);
        assert_eq!(address, number(text(vector, "address")), "{name}: {error}");
        assert_eq!(error.field(), text(vector, "field"), "{name}: {error}");
        let value = &vector["value"];
        let expected = match error.value {
            FieldValue::Key(key) => hex(value.as_str().expect("a key")) == key,
            FieldValue::Int(int) | FieldValue::Checksum(int) => raw(value) == u64::from(int),
            FieldValue::Real(Binary64(bits)) => raw(value) == bits,
        };
        assert!(expected, "{name}: {error}, not {value}");
    }
}

#[test]
fn every_rejectable_field_has_a_rejected_vector() {
    let file = file("eeprom");
    let rejected = list(&file["rejected"])
        .iter()
        .map(|vector| text(vector, "field"));
    let rejected: BTreeSet<_> = rejected.collect();
    assert!(rejected.contains("EEPROM key") && rejected.contains("crc"));
    for field in &FIELDS {
        let any = field.contains(0, 8) && field.contains(field.kind.max(), 8);
        assert!(any || rejected.contains(field.name()), "{}", field.name());
    }
}
