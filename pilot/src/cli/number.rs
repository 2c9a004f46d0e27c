//! Numbers on the command line.

use std::ops::RangeInclusive;

/// Smallest tolerance, time or length.
pub const SMALLEST: f64 = 1e-3;

/// A number within a range.
pub fn number(
    range: RangeInclusive<f64>,
) -> impl Fn(&str) -> Result<f64, String> + Clone + Send + Sync + 'static {
    move |text| match text.parse::<f64>() {
        // NaN is in no range.
        Ok(value) if range.contains(&value) => Ok(value),
        _ => Err(format!("accepted is {} to {}", range.start(), range.end())),
    }
}
