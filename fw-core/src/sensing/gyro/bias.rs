//! Bias of the gyroscope: its mean rate at rest.
//!
//! The zero-rate output may be off by 20 °/s, and by as much again over temperature (PS-MPU-6000A, 6.1).
//! At rest means: no count on either wheel for [`SETTLING_TICKS`] and then for a block of samples, whose
//! rates are within [`MAX_SPREAD`]. Every such block replaces the bias, so it drifts only between stops.

/// Ticks without a count before a block: the body and the filter settle.
const SETTLING_TICKS: u8 = 20;
/// Samples of a block: 0.64 s. The noise of their mean is 0.05 °/s ÷ 8.
const BLOCK: u8 = 64;
/// Largest spread within a block, LSB: 1 °/s, twenty times the noise's deviation.
const MAX_SPREAD: i32 = 66;
/// Largest bias accepted, LSB: 40 °/s, the sum of the data sheet's figures.
pub const MAX_BIAS: i32 = 2_620;

/// The bias and the present block.
#[derive(Clone, Copy, Debug)]
pub(super) struct Bias {
    /// 2⁻⁸ LSB, within ±[`MAX_BIAS`].
    value: Option<i32>,
    rest_ticks: u8,
    sum: i32,
    min: i16,
    max: i16,
}

impl Bias {
    pub const fn new() -> Self {
        Self {
            value: None,
            rest_ticks: 0,
            sum: 0,
            min: 0,
            max: 0,
        }
    }

    /// 2⁻⁸ LSB; `None` before the first rest.
    pub const fn get(&self) -> Option<i32> {
        self.value
    }

    /// Whether the wheels stand long enough for a block.
    pub const fn at_rest(&self) -> bool {
        self.rest_ticks >= SETTLING_TICKS
    }

    /// A wheel moved, or a sample is missing.
    pub const fn disturb(&mut self) {
        self.rest_ticks = 0;
    }

    /// A tick's rate with the wheels standing. Whether this is the first bias.
    pub fn rest(&mut self, raw: i16) -> bool {
        if self.rest_ticks < SETTLING_TICKS {
            self.rest_ticks += 1;
            (self.sum, self.min, self.max) = (0, raw, raw);
            return false;
        }
        self.sum += i32::from(raw);
        self.min = self.min.min(raw);
        self.max = self.max.max(raw);
        self.rest_ticks += 1;
        if self.rest_ticks < SETTLING_TICKS + BLOCK {
            return false;
        }
        let first = self.end_block();
        self.rest_ticks = SETTLING_TICKS;
        (self.sum, self.min, self.max) = (0, raw, raw);
        first
    }

    fn end_block(&mut self) -> bool {
        // 64 samples: the sum is the mean in 2⁻⁶.
        let mean = self.sum << 2;
        if i32::from(self.max) - i32::from(self.min) > MAX_SPREAD || mean.abs() > MAX_BIAS << 8 {
            return false;
        }
        let first = self.value.is_none();
        self.value = Some(mean);
        first
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bias_block_limits_are_exact() {
        // Lowest and highest reading of a block, LSB.
        for (min, max, accepted) in [
            (0, 66, true),
            (0, 67, false),
            (-30, 36, true),
            (-30, 37, false),
            (2_620, 2_620, true),
            (2_619, 2_622, false),
            (-2_620, -2_620, true),
            (-2_622, -2_619, false),
        ] {
            let mut bias = Bias::new();
            for tick in 0..84 {
                let first = bias.rest(if tick % 2 == 0 { min } else { max });
                assert_eq!(first, accepted && tick == 83, "{min} {max} {tick}");
            }
            let mean = i32::from(min + max) * 128;
            assert_eq!(bias.get(), accepted.then_some(mean));
        }
    }

    #[test]
    fn bias_follows_calm_blocks_whatever_was_before() {
        let mut bias = Bias::new();
        (0..20).for_each(|_| assert!(!bias.rest(0)));
        for (level, bump) in [(0, 0), (40, 0), (80, 0), (80, 99), (120, 0)] {
            for tick in 0..64 {
                bias.rest(level + i16::from(tick == 32) * bump);
            }
            assert_eq!(bias.get(), Some(i32::from(level) << 8), "{bump}");
        }
    }
}
