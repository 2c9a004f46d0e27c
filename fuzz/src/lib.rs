//! How the targets read the fuzzer's bytes: a few bytes choose, the rest are what comes over a wire.

use fw_core::wire::crc::crc16;
use fw_core::wire::{Field, MAX_FRAME, Mode, Setup, frame_len};

/// The fuzzer's bytes, taken from the front; zeros when they are used up.
pub struct Bytes<'a>(&'a [u8]);

impl<'a> Bytes<'a> {
    /// Reads `data` from its beginning.
    pub const fn new(data: &'a [u8]) -> Self {
        Self(data)
    }

    /// Whether bytes are left.
    pub const fn more(&self) -> bool {
        !self.0.is_empty()
    }

    /// The next byte.
    pub fn byte(&mut self) -> u8 {
        let [byte] = self.array();
        byte
    }

    /// The next `N` bytes.
    pub fn array<const N: usize>(&mut self) -> [u8; N] {
        let mut taken = [0; N];
        let count = N.min(self.0.len());
        let (front, rest) = self.0.split_at(count);
        taken[..count].copy_from_slice(front);
        self.0 = rest;
        taken
    }

    /// All that is left.
    pub fn rest(&mut self) -> &'a [u8] {
        self.some(self.0.len())
    }

    /// The next up to `count` bytes.
    pub fn some(&mut self, count: usize) -> &'a [u8] {
        let (front, rest) = self.0.split_at(count.min(self.0.len()));
        self.0 = rest;
        front
    }
}

/// A mode, both keys and a number of cells.
pub fn setup(bytes: &mut Bytes) -> Setup {
    let [mode, key_from_pi, key_from_stm, cells] = bytes.array();
    Setup {
        mode: Mode::ALL[usize::from(mode) % Mode::ALL.len()],
        key_from_pi,
        key_from_stm,
        cells: cells % 8 + 1,
    }
}

/// What one chip-select brings: any bytes of any length, or, where the fuzzer wishes, a frame whose
/// length, key and CRC are right, so that the strategies behind them are reached.
pub fn frame(bytes: &mut Bytes, mode: Mode, key: u8) -> Vec<u8> {
    let choice = bytes.byte();
    if choice & 1 == 0 {
        return bytes
            .some(usize::from(choice >> 1) % (MAX_FRAME + 8))
            .to_vec();
    }
    let mut frame = bytes.array::<MAX_FRAME>()[..frame_len(mode)].to_vec();
    frame[0] = key;
    if mode.has(Field::Crc) {
        let end = frame.len() - 2;
        let crc = crc16(&frame[..end]);
        frame[end..].copy_from_slice(&crc.to_be_bytes());
    }
    frame
}
