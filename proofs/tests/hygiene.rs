//! What must hold of the set of theorems itself.

use std::collections::BTreeSet;

#[test]
fn every_theorem_is_decided_somehow_and_named_once() {
    let mut names = BTreeSet::new();
    for property in proofs::properties() {
        assert!(names.insert(property.name), "{} twice", property.name);
        assert!(
            !property.tests.is_empty(),
            "{} runs in no test",
            property.name
        );
    }
}

#[test]
fn what_a_theorem_needs_is_a_theorem() {
    let names: BTreeSet<_> = proofs::properties().map(|property| property.name).collect();
    for property in proofs::properties() {
        for need in property.needs {
            assert!(
                names.contains(need) && *need != property.name,
                "{} needs {need}, which is no other property",
                property.name
            );
        }
    }
}

/// What a configuration promises is proven beside the code that accepts it; everybody else who is given
/// one takes that for granted, and says so.
#[test]
fn whoever_takes_an_accepted_configuration_names_its_theorem() {
    let mut pairs = 0;
    for property in proofs::properties() {
        let given = property.inputs.contains(&"AcceptedConfig");
        if given && !property.area.contains("::eeprom") {
            assert!(
                property
                    .needs
                    .contains(&"accepted_configuration_is_bounded"),
                "{} takes a configuration for accepted and does not say what it needs of it",
                property.name
            );
            pairs += 1;
        }
    }
    assert!(pairs > 0);
}

#[test]
fn the_page_names_every_theorem_and_no_other() {
    let page = include_str!("../../docs/proofs.md");
    let known: BTreeSet<_> = proofs::properties().map(|property| property.name).collect();
    // The rows of the tables: | T1 | `property` | …
    let listed: BTreeSet<_> = page
        .lines()
        .filter_map(|line| line.strip_prefix("| T")?.split('`').nth(1))
        .collect();
    assert_eq!(known, listed);
}

#[test]
fn any_bytes_run_some_theorem_without_a_panic() {
    proofs::run(&[]);
    for choice in 0..=u8::MAX {
        for filler in [0, 1, 0x7F, 0x80, 0xFF] {
            let mut bytes = vec![filler; 600];
            bytes[0] = choice;
            proofs::run(&bytes);
        }
    }
}
