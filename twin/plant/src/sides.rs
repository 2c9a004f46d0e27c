//! A pair of values, one for each side of the robot.

/// One value for each side of the robot.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Sides<T> {
    /// The left one.
    pub left: T,
    /// The right one.
    pub right: T,
}

impl<T> Sides<T> {
    /// A pair from its two halves.
    pub const fn new(left: T, right: T) -> Self {
        Self { left, right }
    }

    /// Both halves through `change`.
    pub fn map<U>(self, mut change: impl FnMut(T) -> U) -> Sides<U> {
        Sides::new(change(self.left), change(self.right))
    }

    /// Each half with that of `other`.
    pub fn zip<U>(self, other: Sides<U>) -> Sides<(T, U)> {
        Sides::new((self.left, other.left), (self.right, other.right))
    }

    /// Both halves to be changed.
    pub const fn as_mut(&mut self) -> Sides<&mut T> {
        Sides::new(&mut self.left, &mut self.right)
    }
}
