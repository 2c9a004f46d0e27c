//! What must hold of the set of properties itself.

use std::collections::BTreeSet;

#[test]
fn property_is_named_once_and_its_kind_has_its_tests() {
    let mut names = BTreeSet::new();
    for property in proofs::properties() {
        let name = property.name;
        assert!(names.insert(name), "{name} is declared twice");
        assert!(!property.tests.is_empty(), "{name} runs in no test");
        let exhaustive = property.tests.contains(&"exhaustive");
        match property.kind {
            "theorem" => assert!(exhaustive || !property.harnesses.is_empty(), "{name}"),
            "property" => assert!(!exhaustive, "{name}"),
            kind => panic!("{name} is a {kind}"),
        }
    }
}

/// The bounds of an accepted configuration are established by one theorem; every other property that
/// takes one names it.
#[test]
fn needed_property_exists_and_is_named() {
    let names: BTreeSet<_> = proofs::properties().map(|property| property.name).collect();
    let mut pairs = 0;
    for property in proofs::properties() {
        for need in property.needs {
            assert!(
                names.contains(need) && *need != property.name,
                "{} needs {need}, which is no other property",
                property.name
            );
        }
        if property.inputs.contains(&"AcceptedConfig") && !property.area.contains("::eeprom") {
            assert!(
                property
                    .needs
                    .contains(&"accepted_configuration_is_bounded"),
                "{} does not name what it needs of a configuration",
                property.name
            );
            pairs += 1;
        }
    }
    assert!(pairs > 0);
}

#[test]
fn fuzz_entry_any_bytes_run_without_panic() {
    proofs::run(&[]);
    for selector in 0..=u8::MAX {
        for filler in [0, 1, 0x7F, 0x80, 0xFF] {
            let mut bytes = vec![filler; 600];
            bytes[0] = selector;
            proofs::run(&bytes);
        }
    }
}
