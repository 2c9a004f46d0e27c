//! What must hold of the set of theorems itself.

use std::collections::BTreeSet;

#[test]
fn every_theorem_is_decided_somehow_and_named_once() {
    let mut names = BTreeSet::new();
    for theorem in proofs::theorems() {
        assert!(names.insert(theorem.name), "{} twice", theorem.name);
        assert!(
            !theorem.tests.is_empty(),
            "{} runs in no test",
            theorem.name
        );
    }
}

#[test]
fn what_a_theorem_needs_is_a_theorem() {
    let names: BTreeSet<_> = proofs::theorems().map(|theorem| theorem.name).collect();
    for theorem in proofs::theorems() {
        for need in theorem.needs {
            assert!(
                names.contains(need) && *need != theorem.name,
                "{} needs {need}, which is no other theorem",
                theorem.name
            );
        }
    }
}

/// What a configuration promises is proven beside the code that accepts it; everybody else who is given
/// one takes that for granted, and says so.
#[test]
fn whoever_takes_an_accepted_configuration_names_its_theorem() {
    let mut pairs = 0;
    for theorem in proofs::theorems() {
        let given = theorem.inputs.contains(&"AcceptedConfig");
        if given && !theorem.area.contains("::eeprom") {
            assert!(
                theorem.needs.contains(&"accepted_configuration_is_bounded"),
                "{} takes a configuration for accepted and does not say what it needs of it",
                theorem.name
            );
            pairs += 1;
        }
    }
    assert!(pairs > 0);
}

#[test]
fn the_page_names_every_theorem_and_no_other() {
    let page = include_str!("../../docs/proofs.md");
    let known: BTreeSet<_> = proofs::theorems().map(|theorem| theorem.name).collect();
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
