//! What the gyroscope says when nothing turns.
//!
//! Its zero may be off by 20 °/s, and by as much again over the temperature (PS-MPU-6000A, 6.1), so
//! the rate is worth nothing until it has been seen at rest. At rest means: no count on either wheel
//! for [`SETTLE`] ticks and then for a whole block, in which the rate keeps within [`SPREAD`]. Every
//! such block replaces the bias: what warms up between two stops is the only drift there is.

/// Ticks without a count before a block begins: the body has stopped swaying, the filter has settled.
const SETTLE: u8 = 20;
/// Samples of a block, a power of two: 0.64 s. Their mean's noise is 0.05 °/s ÷ 8.
pub(super) const BLOCK: u8 = 64;
/// Largest spread within a block, least significant bits: 1 °/s, twenty times the noise's deviation.
pub(super) const SPREAD: i32 = 66;
/// Largest bias believed, least significant bits: 40 °/s, both of the data sheet's figures together.
pub const MOST: i32 = 2_620;

/// The bias and the block under way.
#[derive(Clone, Copy, Debug)]
pub(super) struct Bias {
    /// 2⁻⁸ least significant bits, within ±[`MOST`].
    known: Option<i32>,
    still: u8,
    sum: i32,
    least: i16,
    most: i16,
}

impl Bias {
    pub const fn new() -> Self {
        Self {
            known: None,
            still: 0,
            sum: 0,
            least: 0,
            most: 0,
        }
    }

    /// 2⁻⁸ least significant bits; nothing before the first rest.
    pub const fn get(&self) -> Option<i32> {
        self.known
    }

    /// Whether the wheels have stood long enough.
    pub const fn at_rest(&self) -> bool {
        self.still >= SETTLE
    }

    /// Something moved, or a sample is missing.
    pub const fn disturb(&mut self) {
        self.still = 0;
    }

    /// A tick's rate, the wheels standing. Whether a bias was found that there was none before.
    pub fn rest(&mut self, raw: i16) -> bool {
        if self.still < SETTLE {
            self.still += 1;
            (self.sum, self.least, self.most) = (0, raw, raw);
            return false;
        }
        self.sum += i32::from(raw);
        self.least = self.least.min(raw);
        self.most = self.most.max(raw);
        self.still += 1;
        if self.still < SETTLE + BLOCK {
            return false;
        }
        let found = self.block();
        self.still = SETTLE;
        (self.sum, self.least, self.most) = (0, raw, raw);
        found
    }

    fn block(&mut self) -> bool {
        // 64 samples: the sum is the mean in 2⁻⁶.
        let mean = self.sum << 2;
        if i32::from(self.most) - i32::from(self.least) > SPREAD || mean.abs() > MOST << 8 {
            return false;
        }
        let first = self.known.is_none();
        self.known = Some(mean);
        first
    }
}
