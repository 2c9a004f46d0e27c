//! A share of a long piece of work, for one machine of several.

use std::str::FromStr;

/// Every so-many-th of a list: neighbours cost alike, so each machine gets one of them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Shard {
    number: usize,
    count: usize,
}

impl Shard {
    pub const ALL: Self = Self {
        number: 0,
        count: 1,
    };

    /// Its part of all.
    pub fn of<T>(self, all: impl Iterator<Item = T>) -> impl Iterator<Item = T> {
        all.skip(self.number).step_by(self.count)
    }
}

/// `K/N`, K from 0 to N − 1, as cargo-mutants counts them.
impl FromStr for Shard {
    type Err = &'static str;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        let parts = text.split_once('/');
        let numbers = parts.and_then(|(k, n)| k.parse().ok().zip(n.parse().ok()));
        match numbers {
            Some((number, count)) if number < count => Ok(Self { number, count }),
            _ => Err("not K/N with K from 0 to N - 1"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shards_together_are_all_without_overlap() {
        for count in [1, 2, 4, 59] {
            let shards = (0..count).map(|number| format!("{number}/{count}").parse::<Shard>());
            let mut taken: Vec<_> = shards.flat_map(|shard| shard.unwrap().of(0..59)).collect();
            taken.sort_unstable();
            assert!(taken.into_iter().eq(0..59));
        }
        assert_eq!("0/1".parse(), Ok(Shard::ALL));
        for wrong in ["", "1", "4/4", "-1/4", "0/0", "a/b"] {
            assert!(wrong.parse::<Shard>().is_err(), "{wrong}");
        }
    }
}
