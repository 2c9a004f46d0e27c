//! A share of a long piece of work, for one machine of several.

use crate::error::{Error, Result};

/// Every so-many-th of a list: what one machine of several does. Neighbours cost alike, so each machine gets
/// one of them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Shard {
    number: usize,
    count: usize,
}

impl Shard {
    /// All of them.
    pub const ALL: Self = Self {
        number: 0,
        count: 1,
    };

    /// `K/N`, K from 0 to N − 1, as cargo-mutants counts them.
    ///
    /// # Errors
    /// [`Error::Usage`] for anything else.
    pub fn parse(text: &str) -> Result<Self> {
        let parts = text
            .split_once('/')
            .and_then(|(number, count)| number.parse().ok().zip(count.parse().ok()));
        match parts {
            Some((number, count)) if number < count => Ok(Self { number, count }),
            _ => Err(Error::Usage(format!(
                "--shard {text}: not K/N with K from 0 to N - 1"
            ))),
        }
    }

    /// Its part of all.
    pub fn of<T>(self, all: impl Iterator<Item = T>) -> impl Iterator<Item = T> {
        all.skip(self.number).step_by(self.count)
    }
}

impl Default for Shard {
    fn default() -> Self {
        Self::ALL
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shards_together_are_all_and_nothing_is_in_two() {
        for count in [1, 2, 4, 59] {
            let shards =
                (0..count).map(|number| Shard::parse(&format!("{number}/{count}")).unwrap());
            let mut taken: Vec<_> = shards.flat_map(|shard| shard.of(0..59)).collect();
            taken.sort_unstable();
            assert!(taken.into_iter().eq(0..59));
        }
        assert_eq!(Shard::parse("0/1").unwrap(), Shard::ALL);
        for wrong in ["", "1", "4/4", "-1/4", "0/0", "a/b"] {
            assert!(Shard::parse(wrong).is_err(), "{wrong}");
        }
    }
}
