//! Frames as steps on the wires of the Pi's SPI.

use twin::SpiStep;

/// The first `count` bits of a frame.
pub fn first_bits(frame: &[u8], hz: u64, count: usize) -> SpiStep {
    let mut bits = SpiStep::bytes(frame, hz);
    if let SpiStep::Bits { mosi, .. } = &mut bits {
        mosi.truncate(count);
    }
    bits
}

/// `bits` under chip-select, `setup_ns` before and behind them.
pub fn selected(setup_ns: u64, bits: SpiStep) -> [SpiStep; 5] {
    let setup = SpiStep::Wait(setup_ns);
    let [begin, end] = [true, false].map(SpiStep::Select);
    [begin, setup.clone(), bits, setup, end]
}
