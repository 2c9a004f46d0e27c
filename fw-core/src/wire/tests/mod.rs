mod chain;
mod link;
mod vectors;

use super::strategy::Context;
use super::{Mode, Setup};

/// The first board's keys, two cells.
pub const fn setup(mode: Mode) -> Setup {
    Setup {
        mode,
        key_from_pi: 0x96,
        key_from_stm: 0x5A,
        cells: 2,
    }
}

/// The first frame of an end.
pub const CONTEXT: Context = Context {
    key_from_pi: 0x96,
    key_from_stm: 0x5A,
    cells: 2,
    own: 1,
    last: None,
};

pub const GUARDED: [Mode; 4] = [
    Mode::GuardedNormal,
    Mode::GuardedTuneRotate,
    Mode::GuardedTuneMove,
    Mode::GuardedSweep,
];
