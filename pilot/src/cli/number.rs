//! Numbers on the command line.

use std::fmt::Display;
use std::ops::RangeInclusive;
use std::str::FromStr;

/// Smallest time or length.
pub const SMALLEST: f64 = 1e-3;

/// A number within a range.
pub fn number<T: FromStr + PartialOrd + Display + Clone + Send + Sync + 'static>(
    range: RangeInclusive<T>,
) -> impl Fn(&str) -> Result<T, String> + Clone + Send + Sync + 'static {
    move |text| match text.parse() {
        // NaN is in no range.
        Ok(value) if range.contains(&value) => Ok(value),
        _ => Err(format!("accepted is {} to {}", range.start(), range.end())),
    }
}
