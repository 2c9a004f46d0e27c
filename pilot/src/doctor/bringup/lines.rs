//! The lines of the bring-up firmware, by what they begin with.

/// The lines of the firmware, without what the log puts before them.
pub struct Lines<'a>(pub Vec<&'a str>);

impl<'a> Lines<'a> {
    /// The rest of the last line that begins with `start`.
    pub fn rest(&self, start: &str) -> Option<&'a str> {
        let mut lines = self.0.iter().rev();
        lines
            .find_map(|line| line.strip_prefix(start))
            .map(str::trim)
    }

    /// The number that follows `key` in the last line that begins with `start`, hexadecimal after `0x`.
    pub fn number(&self, start: &str, key: &str) -> Option<u32> {
        let mut words = self.rest(start)?.split(' ');
        words.find(|&word| word == key)?;
        let word = words.next()?;
        match word.strip_prefix("0x") {
            Some(digits) => u32::from_str_radix(digits, 16).ok(),
            None => word.parse().ok(),
        }
    }

    /// Left and right counts of a line.
    pub fn counts(&self, start: &str) -> Option<[i32; 2]> {
        let (_, counts) = self.rest(start)?.split_once("counts ")?;
        let (left, right) = counts.split_once(' ')?;
        Some([left.parse().ok()?, right.parse().ok()?])
    }
}
