//! Text → [`Settings`]. Every complaint has the key, the value, what is accepted, and the line.

use super::format::{self, Format};
use super::Settings;
use crate::error::Error;
use fw_core::eeprom::{fields, Config, ConfigError, Field, Image, FIELDS};
use fw_core::wire::Mode;
use std::fmt::Write;
use std::path::Path;
use toml::de::{DeTable, DeValue};
use toml::Spanned;

/// Reads a configuration file's text.
pub(super) fn parse(text: &str, path: &Path) -> Result<Settings, Error> {
    let complain = |at: Option<usize>, what: String| {
        Error::content(path, at.map(|at| line_of(text, at)), what)
    };
    let document = DeTable::parse(text)
        .map_err(|error| complain(error.span().map(|span| span.start), error.message().into()))?;
    let document = document.get_ref();
    let keys: Vec<_> = format::all().map(format::key).collect();
    unknown(document, "", &keys).map_err(|(at, what)| complain(Some(at), what))?;

    let mut image = Image::FIRST_BOARD;
    for (field, key) in format::all().zip(&keys) {
        let unused = u64::from(field.tap) > image.get(fields::CELLS);
        match find(document, key) {
            Some(value) => {
                let raw = raw(field, value.get_ref()).map_err(|accepted| {
                    let shown = text.get(value.span()).unwrap_or_default();
                    let what = format!("{key} = {shown}: accepted is {accepted}");
                    complain(Some(value.span().start), what)
                })?;
                image.set(field, raw);
            }
            None if format::is_optional(field) || unused => {}
            None => {
                let help = fields::HELP.get(usize::from(field.index)).unwrap_or(&"");
                return Err(complain(None, format!("{key} is missing: {help}")));
            }
        }
    }
    if document.get("platform").is_none() {
        image.make_original();
    }
    image.seal();
    let config = Config::decode(&image).map_err(|error| {
        rejected(&error, path, |key| {
            find(document, key).map(|value| line_of(text, value.span().start))
        })
    })?;
    Ok(Settings { image, config })
}

/// The core's judgement of the image, with the file's line and key.
fn rejected(error: &ConfigError, path: &Path, line: impl Fn(&str) -> Option<usize>) -> Error {
    let mut location = format!("in {}", path.display());
    if let Some(field) = FIELDS.iter().find(|field| field.name == error.field) {
        let key = format::key(field);
        if let Some(line) = line(&key) {
            let _ = write!(location, ", line {line}");
        }
        let _ = write!(location, " ({key})");
    }
    Error::Rejected {
        location,
        what: error.to_string(),
    }
}

/// 1-based line of a byte offset.
fn line_of(text: &str, at: usize) -> usize {
    text.bytes().take(at).filter(|&byte| byte == b'\n').count() + 1
}

/// The value of a dotted key.
fn find<'t, 'i>(table: &'t DeTable<'i>, key: &str) -> Option<&'t Spanned<DeValue<'i>>> {
    match key.split_once('.') {
        None => table.get(key),
        Some((first, rest)) => find(table.get(first)?.get_ref().as_table()?, rest),
    }
}

/// The first key that the table of fields does not have.
fn unknown(table: &DeTable<'_>, prefix: &str, keys: &[String]) -> Result<(), (usize, String)> {
    for (name, value) in table {
        let key = format!("{prefix}{}", name.get_ref());
        if keys.contains(&key) {
            continue;
        }
        let section = format!("{key}.");
        let is_section = keys.iter().any(|key| key.starts_with(&section));
        match value.get_ref().as_table() {
            Some(inner) if is_section => unknown(inner, &section, keys)?,
            None if is_section => {
                let what = format!("{key} must be a section, [{key}]");
                return Err((name.span().start, what));
            }
            _ => {
                let rests = keys.iter().filter_map(|key| key.strip_prefix(prefix));
                let mut accepted: Vec<_> =
                    rests.filter_map(|rest| rest.split('.').next()).collect();
                accepted.dedup();
                let accepted = accepted.join(", ");
                let what = format!("unknown key {key}: accepted here are {accepted}");
                return Err((name.span().start, what));
            }
        }
    }
    Ok(())
}

/// The raw value of a value of the file.
///
/// # Errors
/// What would be accepted.
fn raw(field: &Field, value: &DeValue<'_>) -> Result<u64, String> {
    let max = field.kind.max();
    match Format::of(field) {
        Format::Mode => mode(value),
        Format::Flag => Ok(value.as_bool().ok_or("true or false")?.into()),
        Format::Hex | Format::Int => {
            let value = whole(value).and_then(|value| u64::try_from(value).ok());
            let value = value.filter(|&value| value <= max);
            value.ok_or_else(|| format!("a whole number from 0 to {max}"))
        }
        Format::Scaled(scale) => format::scaled(real(value)?, scale, max),
        Format::Bearing => format::bearing(real(value)?),
        Format::Real => Ok(real(value)?.to_bits()),
    }
}

fn whole(value: &DeValue<'_>) -> Option<i64> {
    let integer = value.as_integer()?;
    i64::from_str_radix(integer.as_str(), integer.radix()).ok()
}

#[allow(clippy::cast_precision_loss)] // no field tells 2⁵³ from its neighbour
fn real(value: &DeValue<'_>) -> Result<f64, String> {
    let float = value.as_float();
    let float = float.and_then(|float| float.as_str().parse().ok());
    let number = float.or_else(|| whole(value).map(|whole| whole as f64));
    number.ok_or_else(|| "a number".into())
}

fn mode(value: &DeValue<'_>) -> Result<u64, String> {
    let (name, code) = (value.as_str().unwrap_or_default(), whole(value));
    let modes = Mode::ALL.iter().map(|mode| (mode.name(), mode.code()));
    let meant = |&(by_name, by_code): &(&str, u8)| {
        by_name.eq_ignore_ascii_case(name) || code == Some(by_code.into())
    };
    let mode = modes.clone().find(meant).ok_or_else(|| {
        let all = modes.map(|(name, code)| format!("\"{name}\" ({code:#04x})"));
        all.collect::<Vec<_>>().join(", ")
    })?;
    Ok(mode.1.into())
}
