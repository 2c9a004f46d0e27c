//! The Pi's SPI controller: plays chip select and bits on the wires in virtual time, and records
//! MISO.

use std::collections::VecDeque;

/// A step of the master.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum SpiStep {
    /// Drives the chip select: `true` selects (low).
    Select(bool),
    /// Clocks these bits out at this rate, first bit first.
    Bits {
        /// The bits on MOSI.
        mosi: Vec<bool>,
        /// The clock, hertz.
        hz: u64,
    },
    /// Does nothing for so many nanoseconds.
    Wait(u64),
}

impl SpiStep {
    /// The bytes, most significant bit first.
    pub fn bytes(bytes: &[u8], hz: u64) -> Self {
        let mosi = bytes
            .iter()
            .flat_map(|byte| (0..8).rev().map(move |bit| byte >> bit & 1 != 0))
            .collect();
        Self::Bits { mosi, hz }
    }

    /// Nanoseconds it takes.
    pub fn duration(&self) -> u64 {
        match self {
            Self::Select(_) => 0,
            Self::Bits { mosi, hz } => mosi.len() as u64 * 1_000_000_000 / hz,
            Self::Wait(ns) => *ns,
        }
    }
}

/// The next change on the wires.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SpiAction {
    /// The chip select changes: `true` selects.
    Select(bool),
    /// A rising clock edge with this bit on MOSI.
    Clock(bool),
}

/// The controller.
#[derive(Debug, Default)]
pub struct SpiMaster {
    steps: VecDeque<SpiStep>,
    /// When the step in hand began.
    began: u64,
    /// Bits of the step in hand already clocked.
    clocked: usize,
    miso: Vec<bool>,
}

impl SpiMaster {
    /// Starts playing `steps` at `now`; returns when the last one ends.
    ///
    /// # Panics
    /// When the steps before are still playing, or a clock is at no rate.
    pub fn play(&mut self, now: u64, steps: Vec<SpiStep>) -> u64 {
        assert!(self.steps.is_empty(), "one transfer at a time");
        let ends = now + steps.iter().map(SpiStep::duration).sum::<u64>();
        self.steps = steps.into();
        self.began = now;
        self.clocked = 0;
        self.miso.clear();
        ends
    }

    /// The bits on MISO, one for each clock.
    pub fn take_miso(&mut self) -> Vec<bool> {
        std::mem::take(&mut self.miso)
    }

    /// When the clock `ahead` clocks from here rises (0 = the next one), or when the step in hand
    /// ends, whichever is first. Bits settle half a period after the step begins, mode 0.
    pub fn next_event(&self, ahead: usize) -> Option<u64> {
        Some(match self.steps.front()? {
            SpiStep::Select(_) => self.began,
            SpiStep::Wait(ns) => self.began + ns,
            SpiStep::Bits { mosi, hz } if self.clocked < mosi.len() => {
                let bit = (self.clocked + ahead).min(mosi.len() - 1) as u64;
                self.began + (2 * bit + 1) * 500_000_000 / hz
            }
            ended @ SpiStep::Bits { .. } => self.began + ended.duration(),
        })
    }

    /// Takes the next action due by `now`. The bit at a clock goes to [`SpiMaster::receive`].
    pub fn take(&mut self, now: u64) -> Option<SpiAction> {
        loop {
            let due = self.next_event(0)?;
            if due > now {
                return None;
            }
            match self.steps.front()? {
                &SpiStep::Select(selected) => {
                    self.finish(due);
                    return Some(SpiAction::Select(selected));
                }
                SpiStep::Bits { mosi, .. } if self.clocked < mosi.len() => {
                    let bit = mosi[self.clocked];
                    self.clocked += 1;
                    return Some(SpiAction::Clock(bit));
                }
                _ => self.finish(due),
            }
        }
    }

    /// The rate of the clock just taken, hertz.
    pub fn rate(&self) -> u64 {
        match self.steps.front() {
            Some(SpiStep::Bits { hz, .. }) => *hz,
            _ => 0,
        }
    }

    /// The level of MISO at the clock just taken.
    pub fn receive(&mut self, bit: bool) {
        self.miso.push(bit);
    }

    fn finish(&mut self, at: u64) {
        self.steps.pop_front();
        self.began = at;
        self.clocked = 0;
    }
}

/// Bits as bytes, most significant first; a rest of fewer than eight is dropped.
pub fn pack(bits: &[bool]) -> Vec<u8> {
    bits.chunks_exact(8)
        .map(|byte| byte.iter().fold(0, |byte, &bit| byte << 1 | u8::from(bit)))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn clocks_rise_in_middle_of_their_bits() {
        let mut master = SpiMaster::default();
        let ends = master.play(
            1000,
            vec![
                SpiStep::Select(true),
                SpiStep::Wait(100),
                SpiStep::bytes(&[0x80], 8_000_000),
                SpiStep::Select(false),
            ],
        );
        assert_eq!(ends, 1000 + 100 + 1000);
        assert_eq!(master.take(1000), Some(SpiAction::Select(true)));
        assert_eq!(master.take(1161), None);
        assert_eq!(master.next_event(0), Some(1162));
        assert_eq!(master.take(1162), Some(SpiAction::Clock(true)));
        assert_eq!(master.next_event(6), Some(1100 + 937));
        for _ in 0..7 {
            assert_eq!(master.take(2050), Some(SpiAction::Clock(false)));
        }
        assert_eq!(master.take(2050), None);
        assert_eq!(master.take(2100), Some(SpiAction::Select(false)));
        assert_eq!(master.next_event(0), None);
    }

    #[test]
    fn pack_is_inverse_of_bytes() {
        let SpiStep::Bits { mosi, .. } = SpiStep::bytes(&[0xA5, 0x01], 1) else {
            panic!("bits");
        };
        assert_eq!(pack(&mosi), [0xA5, 0x01]);
        assert_eq!(pack(&mosi[..15]), [0xA5]);
    }
}
