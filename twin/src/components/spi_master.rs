//! The Pi's SPI controller: plays chip select and bits onto the wires in virtual time, and keeps
//! what came back.

use std::collections::VecDeque;

/// A step of what the master does on its wires.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Step {
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

impl Step {
    /// The bytes, most significant bit first.
    #[must_use]
    pub fn bytes(bytes: &[u8], hz: u64) -> Self {
        let mosi = bytes
            .iter()
            .flat_map(|byte| (0..8).rev().map(move |bit| byte >> bit & 1 != 0))
            .collect();
        Self::Bits { mosi, hz }
    }

    /// Nanoseconds it takes.
    #[must_use]
    pub fn duration(&self) -> u64 {
        match self {
            Self::Select(_) => 0,
            Self::Bits { mosi, hz } => mosi.len() as u64 * 1_000_000_000 / hz,
            Self::Wait(ns) => *ns,
        }
    }
}

/// What the wires do next.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Action {
    /// The chip select changes: `true` selects.
    Select(bool),
    /// A rising clock edge with this bit on MOSI.
    Clock(bool),
}

/// The controller.
#[derive(Debug, Default)]
pub struct SpiMaster {
    steps: VecDeque<Step>,
    /// When the step in hand began.
    began: u64,
    /// Bits of the step in hand already clocked.
    clocked: usize,
    miso: Vec<bool>,
}

impl SpiMaster {
    /// Starts playing `steps` at `now`; answers when the last one ends.
    ///
    /// # Panics
    /// When the steps before are still playing, or a clock is at no rate.
    pub fn play(&mut self, now: u64, steps: Vec<Step>) -> u64 {
        assert!(self.steps.is_empty(), "one transfer at a time");
        let ends = now + steps.iter().map(Step::duration).sum::<u64>();
        self.steps = steps.into();
        self.began = now;
        self.clocked = 0;
        self.miso.clear();
        ends
    }

    /// The bits that came back, one for each clock.
    pub fn take_miso(&mut self) -> Vec<bool> {
        std::mem::take(&mut self.miso)
    }

    /// Whether nothing is left to play.
    #[must_use]
    pub fn is_idle(&self) -> bool {
        self.steps.is_empty()
    }

    /// When the clock `ahead` clocks from here rises (0 = the next one), or when the step in hand
    /// ends, whichever is first. Bits settle half a period after the step begins, mode 0.
    #[must_use]
    pub fn next(&self, ahead: usize) -> Option<u64> {
        Some(match self.steps.front()? {
            Step::Select(_) => self.began,
            Step::Wait(ns) => self.began + ns,
            Step::Bits { mosi, hz } => {
                if self.clocked < mosi.len() {
                    let bit = (self.clocked + ahead).min(mosi.len() - 1) as u64;
                    self.began + (2 * bit + 1) * 500_000_000 / hz
                } else {
                    self.began + mosi.len() as u64 * 1_000_000_000 / hz
                }
            }
        })
    }

    /// Takes the next action due by `now`. The answer to a clock goes to [`SpiMaster::answer`].
    pub fn take(&mut self, now: u64) -> Option<Action> {
        loop {
            let due = self.next(0)?;
            if due > now {
                return None;
            }
            match self.steps.front()? {
                Step::Select(selected) => {
                    let selected = *selected;
                    self.finish(due);
                    return Some(Action::Select(selected));
                }
                Step::Bits { mosi, .. } if self.clocked < mosi.len() => {
                    let bit = mosi[self.clocked];
                    self.clocked += 1;
                    return Some(Action::Clock(bit));
                }
                _ => self.finish(due),
            }
        }
    }

    /// The level of MISO at the clock just taken.
    pub fn answer(&mut self, bit: bool) {
        self.miso.push(bit);
    }

    fn finish(&mut self, at: u64) {
        self.steps.pop_front();
        self.began = at;
        self.clocked = 0;
    }
}

/// Bits as bytes, most significant first; a rest of fewer than eight is dropped.
#[must_use]
pub fn pack(bits: &[bool]) -> Vec<u8> {
    bits.chunks_exact(8)
        .map(|byte| byte.iter().fold(0, |byte, &bit| byte << 1 | u8::from(bit)))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn clocks_rise_in_the_middle_of_their_bits() {
        let mut master = SpiMaster::default();
        let ends = master.play(
            1000,
            vec![
                Step::Select(true),
                Step::Wait(100),
                Step::bytes(&[0x80], 8_000_000),
                Step::Select(false),
            ],
        );
        assert_eq!(ends, 1000 + 100 + 1000);
        assert_eq!(master.take(1000), Some(Action::Select(true)));
        assert_eq!(master.take(1161), None);
        assert_eq!(master.next(0), Some(1162));
        assert_eq!(master.take(1162), Some(Action::Clock(true)));
        assert_eq!(master.next(6), Some(1100 + 937));
        for _ in 0..7 {
            assert_eq!(master.take(2050), Some(Action::Clock(false)));
        }
        assert_eq!(master.take(2050), None);
        assert_eq!(master.take(2100), Some(Action::Select(false)));
        assert!(master.is_idle());
    }

    #[test]
    fn bytes_and_bits_are_each_others_inverse() {
        let Step::Bits { mosi, .. } = Step::bytes(&[0xA5, 0x01], 1) else {
            panic!("bits");
        };
        assert_eq!(pack(&mosi), [0xA5, 0x01]);
        assert_eq!(pack(&mosi[..15]), [0xA5]);
    }
}
