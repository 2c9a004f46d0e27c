//! Reproducible courses.

/// Counts of one tick, forward positive.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Tick {
    /// The left wheel's.
    pub left: i32,
    /// The right wheel's.
    pub right: i32,
}

/// An endless course.
#[derive(Clone, Debug)]
pub struct Course {
    curves: bool,
    tick: u32,
    state: u64,
    left: i32,
    right: i32,
}

impl Course {
    /// A new pair of speeds every half second, with a jitter of one count.
    pub const fn curves() -> Self {
        Self {
            curves: true,
            tick: 0,
            state: 0x9E37_79B9_7F4A_7C15,
            left: 0,
            right: 0,
        }
    }

    /// Some 47° on the spot, then straight on at 177 mm/s.
    pub const fn straight() -> Self {
        Self {
            curves: false,
            ..Self::curves()
        }
    }

    /// xorshift: within ±`bound`.
    pub(crate) fn below(&mut self, bound: i32) -> i32 {
        self.state ^= self.state << 13;
        self.state ^= self.state >> 7;
        self.state ^= self.state << 17;
        ((self.state >> 33) as i32) % bound
    }
}

impl Iterator for Course {
    type Item = Tick;

    fn next(&mut self) -> Option<Tick> {
        let first = self.tick == 0;
        let turn = self.tick.is_multiple_of(50);
        self.tick += 1;
        if !self.curves {
            let (left, right) = if first { (-391, 392) } else { (27, 27) };
            return Some(Tick { left, right });
        }
        if turn {
            self.left = self.below(70) - 25;
            self.right = self.below(70) - 25;
        }
        Some(Tick {
            left: self.left + self.below(3) - 1,
            right: self.right + self.below(3) - 1,
        })
    }
}
