//! Properties of `fw-core`, each written once and decided by Kani, by exhaustion or by sampling.
//!
//! ```
//! use proofs::sensing::rangefinder::distance_is_monotone;
//!
//! // A property is a function of its inputs; it panics where it does not hold, and returns the
//! // declared cases that it met.
//! assert!(distance_is_monotone(10_000).has(0));
//!
//! let theorems = proofs::properties().filter(|property| property.kind == "theorem");
//! println!("{} properties are decided for all inputs", theorems.count());
//! ```
//!
//! `cargo kani -p proofs` runs every harness, `cargo test -p proofs` every test of the same
//! properties; `cargo run -p proofs --example theorems` lists them. `docs/proofs.md` states bounds,
//! cost, and what is not proven.
#![forbid(unsafe_code)]
#![allow(
    clippy::missing_panics_doc,
    reason = "a property panics exactly where it does not hold"
)]
#![allow(
    clippy::needless_pass_by_value,
    reason = "a property owns the inputs drawn for it"
)]
#![allow(
    clippy::cast_possible_truncation,
    clippy::cast_possible_wrap,
    reason = "every pattern of bits is an input, of either sign"
)]

#[macro_use]
pub mod property;
#[macro_use]
pub mod input;

pub mod binary64;
pub mod divide;
pub mod eeprom;
pub mod log;
pub mod motion;
pub mod robot;
#[cfg(test)]
mod sampled;
pub mod search;
pub mod sensing;
pub mod units;
pub mod wire;

use property::Property;

/// The properties of every area.
pub const PROPERTIES: &[&[Property]] = &[
    units::PROPERTIES,
    wire::parsing::PROPERTIES,
    wire::checksum::PROPERTIES,
    wire::link::PROPERTIES,
    wire::sequence::PROPERTIES,
    wire::codes::PROPERTIES,
    binary64::PROPERTIES,
    divide::PROPERTIES,
    eeprom::image::PROPERTIES,
    eeprom::burst::PROPERTIES,
    eeprom::checksum::PROPERTIES,
    eeprom::contract::PROPERTIES,
    motion::trig::PROPERTIES,
    motion::arc::PROPERTIES,
    motion::odometry::PROPERTIES,
    motion::pid::PROPERTIES,
    motion::mixer::PROPERTIES,
    motion::pose_controller::PROPERTIES,
    motion::obstacle_limit::PROPERTIES,
    motion::stopping::PROPERTIES,
    motion::velocity_controller::PROPERTIES,
    motion::drive_monitor::PROPERTIES,
    motion::deadline::PROPERTIES,
    motion::arrival::PROPERTIES,
    sensing::rangefinder::PROPERTIES,
    sensing::servo_scan::PROPERTIES,
    sensing::temperature::PROPERTIES,
    sensing::battery::PROPERTIES,
    sensing::gyro::PROPERTIES,
    log::PROPERTIES,
    robot::PROPERTIES,
    robot::target::PROPERTIES,
];

/// Every property, area by area.
pub fn properties() -> impl Iterator<Item = &'static Property> {
    PROPERTIES.iter().copied().flatten()
}

/// For fuzzing: the first two bytes select a property, the rest are its inputs. Panics where the
/// property does not hold.
pub fn run(bytes: &[u8]) {
    let Some((selector, rest)) = bytes.split_first_chunk() else {
        return;
    };
    if let Some(property) = select(*selector) {
        let _ = (property.run)(&mut input::Bytes::new(rest));
    }
}

/// Rendezvous hashing: the property whose name, hashed with the selector, gives the largest value. A
/// new property takes a few selectors from each of the others, so a corpus keeps its meaning.
fn select(selector: [u8; 2]) -> Option<&'static Property> {
    properties().max_by_key(|property| {
        // FNV-1a.
        let bytes = selector.iter().chain(property.name.as_bytes());
        bytes.fold(0xCBF2_9CE4_8422_2325_u64, |hash, byte| {
            (hash ^ u64::from(*byte)).wrapping_mul(0x100_0000_01B3)
        })
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_property_has_a_selector() {
        let mut missing: Vec<_> = properties().map(|property| property.name).collect();
        for selector in 0..8192_u16 {
            let selected = select(selector.to_le_bytes()).unwrap();
            missing.retain(|&name| name != selected.name);
        }
        assert!(missing.is_empty(), "{missing:?}");
    }
}
