//! The theorems: each a property written once, decided by Kani, by exhaustion or by sampling.
//!
//! `cargo kani` in this folder (or `cargo kani -p proofs` in the root) runs every harness;
//! `cargo test -p proofs` runs every test of the same properties; `docs/proofs.md` says what each
//! theorem claims, how it is decided, under which bounds, and what is not proven.
//!
//! | module | theorems |
//! |---|---|
//! | [`units`] | the units' own arithmetic: what the others rest on |
//! | [`wire`] | T1, T2: frames, links, codes |
//! | [`double`] | T4: binary64 to fixed point and back |
//! | [`eeprom`] | T3, T5: the image and what an accepted configuration promises |
//! | [`motion`] | T5 to T8, T14: heading, position, regulators, controller, wheels, stop deadline |
//! | [`sensing`] | T5, T6, T9, T10: gyroscope, rangefinders and battery |
//! | [`log`] | T13: the log's queue |
//! | [`robot`] | T5, T8, T14: the whole robot under any order of events |
//! | [`property`] | how a property is declared |
//! | [`input`] | where inputs come from |
//! | [`search`] | the explicit-state search of the models in `tests/` |
#![forbid(unsafe_code)]
#![allow(
    clippy::missing_panics_doc,
    reason = "a property panics exactly where it does not hold"
)]
#![allow(
    clippy::needless_pass_by_value,
    reason = "a property owns its inputs: whoever drew them is done with them"
)]

pub mod binary64;
pub mod eeprom;
pub mod input;
pub mod log;
pub mod motion;
pub mod property;
pub mod robot;
#[cfg(test)]
mod sampled;
pub mod search;
pub mod sensing;
pub mod units;
pub mod wire;

use property::Property;

/// The theorems of every area.
pub const PROPERTIES: &[&[Property]] = &[
    units::PROPERTIES,
    wire::parsing::PROPERTIES,
    wire::checksum::PROPERTIES,
    wire::link::PROPERTIES,
    wire::codes::PROPERTIES,
    binary64::PROPERTIES,
    eeprom::image::PROPERTIES,
    eeprom::checksum::PROPERTIES,
    eeprom::contract::PROPERTIES,
    motion::trig::PROPERTIES,
    motion::odometry::PROPERTIES,
    motion::pid::PROPERTIES,
    motion::mixer::PROPERTIES,
    motion::pose_controller::PROPERTIES,
    motion::drive_monitor::PROPERTIES,
    motion::deadline::PROPERTIES,
    sensing::rangefinder::PROPERTIES,
    sensing::servo_scan::PROPERTIES,
    sensing::temperature::PROPERTIES,
    sensing::battery::PROPERTIES,
    sensing::gyro::PROPERTIES,
    log::PROPERTIES,
    robot::PROPERTIES,
];

/// Every theorem, area by area.
pub fn properties() -> impl Iterator<Item = &'static Property> {
    PROPERTIES.iter().copied().flatten()
}

/// One theorem on the inputs that `bytes` hold: the first two bytes choose it, the rest are its inputs.
/// For fuzzing. Panics where the theorem does not hold.
pub fn run(bytes: &[u8]) {
    let Some((choice, rest)) = bytes.split_first_chunk() else {
        return;
    };
    if let Some(property) = chosen(*choice) {
        let _ = (property.run)(&mut input::Bytes::new(rest));
    }
}

/// The theorem that a choice stands for: the one whose name, hashed with it, comes to most. A new theorem
/// so takes a few choices from each of the others and leaves the rest alone: what a fuzzer has learned
/// goes on meaning what it meant.
fn chosen(choice: [u8; 2]) -> Option<&'static Property> {
    properties().max_by_key(|property| {
        // FNV-1a.
        let bytes = choice.iter().chain(property.name.as_bytes());
        bytes.fold(0xCBF2_9CE4_8422_2325_u64, |hash, byte| {
            (hash ^ u64::from(*byte)).wrapping_mul(0x100_0000_01B3)
        })
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_property_can_be_chosen() {
        let mut never: Vec<_> = properties().map(|property| property.name).collect();
        for choice in 0..8192_u16 {
            let chosen = chosen(choice.to_le_bytes()).unwrap();
            never.retain(|&name| name != chosen.name);
        }
        assert!(never.is_empty(), "{never:?}");
    }
}
