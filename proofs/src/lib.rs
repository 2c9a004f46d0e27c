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
//! | [`motion`] | T6 to T8, T14: heading, position, regulators, wheels, stop deadline |
//! | [`sensing`] | T5, T6, T9, T10: gyroscope, rangefinders and battery |
//! | [`log`] | T13: the log's queue |
//! | [`robot`] | T5, T8, T14: the whole robot under any order of events |
//! | [`theorem`] | how a property is declared |
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

pub mod double;
pub mod eeprom;
pub mod input;
pub mod log;
pub mod motion;
pub mod robot;
#[cfg(test)]
mod sampled;
pub mod search;
pub mod sensing;
pub mod theorem;
pub mod units;
pub mod wire;

use theorem::Theorem;

/// The theorems of every area.
pub const THEOREMS: &[&[Theorem]] = &[
    units::THEOREMS,
    wire::parsing::THEOREMS,
    wire::checksum::THEOREMS,
    wire::link::THEOREMS,
    wire::codes::THEOREMS,
    double::THEOREMS,
    eeprom::image::THEOREMS,
    eeprom::checksum::THEOREMS,
    eeprom::contract::THEOREMS,
    motion::trig::THEOREMS,
    motion::odometry::THEOREMS,
    motion::pid::THEOREMS,
    motion::wheels::THEOREMS,
    motion::plausibility::THEOREMS,
    motion::deadline::THEOREMS,
    sensing::rangefinder::THEOREMS,
    sensing::sweep::THEOREMS,
    sensing::thermometer::THEOREMS,
    sensing::battery::THEOREMS,
    sensing::gyro::THEOREMS,
    log::THEOREMS,
    robot::THEOREMS,
];

/// Every theorem, area by area.
pub fn theorems() -> impl Iterator<Item = &'static Theorem> {
    THEOREMS.iter().copied().flatten()
}

/// One theorem on the inputs that `bytes` hold: the first byte chooses it, the rest are its inputs.
/// For fuzzing. Panics where the theorem does not hold.
pub fn run(bytes: &[u8]) {
    let Some((choice, rest)) = bytes.split_first() else {
        return;
    };
    let count = theorems().count();
    if let Some(theorem) = theorems().nth(usize::from(*choice) % count.max(1)) {
        let _ = (theorem.run)(&mut input::Bytes::new(rest));
    }
}
