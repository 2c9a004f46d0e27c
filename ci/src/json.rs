//! What other programs tell us in JSON, looked into without a structure for each.

use std::collections::HashMap;

use tinyjson::JsonValue;

use crate::error::Result;

/// Reads what `who` said.
///
/// # Errors
/// Where it is no JSON.
pub fn parse(text: &str, who: &str) -> Result<JsonValue> {
    let value = text.parse::<JsonValue>();
    value.map_err(|error| crate::error::anyhow!(format!("{who}: {error}")))
}

/// The entries of a list; none where there is no list.
pub fn entries(value: &JsonValue) -> &[JsonValue] {
    value.get::<Vec<JsonValue>>().map_or(&[], Vec::as_slice)
}

/// What stands under a key of an object.
pub fn at<'a>(value: &'a JsonValue, key: &str) -> Option<&'a JsonValue> {
    value.get::<HashMap<String, JsonValue>>()?.get(key)
}

/// The entries of the list under a key.
pub fn list<'a>(value: &'a JsonValue, key: &str) -> &'a [JsonValue] {
    at(value, key).map_or(&[], entries)
}

/// The string under a key.
pub fn text<'a>(value: &'a JsonValue, key: &str) -> Option<&'a str> {
    at(value, key)?.get::<String>().map(String::as_str)
}

/// A line, a column, a count.
#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "counts are whole, and small beside 2^53"
)]
pub fn count(value: &JsonValue) -> usize {
    value.get::<f64>().map_or(0, |&number| number as usize)
}
