//! Text → [`Settings`]. Every complaint has the key, the value, what is accepted, and the line.

use super::fields::{self, Access, Field};
use super::{number, Settings};
use crate::error::Error;
use fw_core::binary64::Binary64;
use fw_core::eeprom::{self, Config};
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
    unknown(document, "").map_err(|(at, what)| complain(Some(at), what))?;

    let mut config = eeprom::first_board();
    for field in fields::all() {
        match find(document, field.key) {
            Some(value) => set(field, &mut config, value.get_ref()).map_err(|accepted| {
                let shown = text.get(value.span()).unwrap_or_default();
                let what = format!("{} = {shown}: accepted is {accepted}", field.key);
                complain(Some(value.span().start), what)
            })?,
            None if field.optional() || field.tap().is_some_and(|tap| tap > config.cells) => {}
            None => {
                let what = format!("{} is missing: {}", field.key, field.help);
                return Err(complain(None, what));
            }
        }
    }
    let settings = Settings {
        config,
        platform_page: document.get("platform").is_some(),
    };
    check(&settings, path, |key| {
        find(document, key).map(|value| line_of(text, value.span().start))
    })?;
    Ok(settings)
}

/// The core's own judgement of the image, told in the file's words.
fn check(
    settings: &Settings,
    path: &Path,
    line: impl Fn(&str) -> Option<usize>,
) -> Result<(), Error> {
    eeprom::check(&settings.config).map_err(|error| {
        let mut place = format!("in {}", path.display());
        if let Some(field) = fields::at(error.address) {
            if let Some(line) = line(field.key) {
                let _ = write!(place, ", line {line}");
            }
            let _ = write!(place, " ({})", field.key);
        }
        Error::Rejected {
            location: place,
            what: error.to_string(),
        }
    })
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
fn unknown(table: &DeTable<'_>, prefix: &str) -> Result<(), (usize, String)> {
    for (name, value) in table {
        let key = format!("{prefix}{}", name.get_ref());
        if fields::all().any(|field| field.key == key) {
            continue;
        }
        let section = format!("{key}.");
        let is_section = fields::all().any(|field| field.key.starts_with(&section));
        match value.get_ref().as_table() {
            Some(inner) if is_section => unknown(inner, &section)?,
            None if is_section => {
                return Err((
                    name.span().start,
                    format!("{key} must be a section, [{key}]"),
                ));
            }
            _ => {
                let mut accepted: Vec<&str> = fields::all()
                    .filter_map(|field| field.key.strip_prefix(prefix))
                    .map(|rest| rest.split('.').next().unwrap_or(rest))
                    .collect();
                accepted.dedup();
                let what = format!(
                    "unknown key {key}: accepted here are {}",
                    accepted.join(", ")
                );
                return Err((name.span().start, what));
            }
        }
    }
    Ok(())
}

/// Stores one value.
///
/// # Errors
/// What would be accepted.
fn set(field: &Field, config: &mut Config, value: &DeValue<'_>) -> Result<(), String> {
    match field.access {
        Access::Mode(place) => *place(config) = mode(value)?,
        Access::Flag(place) => {
            *place(config) = value.as_bool().ok_or("true or false")?;
        }
        Access::Byte(place) => {
            *place(config) = whole(value)
                .and_then(|value| value.try_into().ok())
                .ok_or("a whole number from 0 to 255")?;
        }
        Access::Long(place) => {
            *place(config) = whole(value)
                .and_then(|value| value.try_into().ok())
                .ok_or("a whole number from 0 to 4294967295")?;
        }
        Access::Word(scale, place) => {
            let code = number::code(real(value)?, scale, u16::MAX.into())?;
            *place(config) = u16::try_from(code).unwrap_or(u16::MAX);
        }
        Access::ScaledLong(scale, place) => {
            *place(config) = number::code(real(value)?, scale, u32::MAX)?;
        }
        Access::Bearing(place) => *place(config) = number::bearing(real(value)?)?,
        Access::Binary64(place) => *place(config) = Binary64(real(value)?.to_bits()),
    }
    Ok(())
}

fn whole(value: &DeValue<'_>) -> Option<i64> {
    let integer = value.as_integer()?;
    i64::from_str_radix(integer.as_str(), integer.radix()).ok()
}

#[allow(clippy::cast_precision_loss)] // no field tells 2⁵³ from its neighbour
fn real(value: &DeValue<'_>) -> Result<f64, String> {
    let float = value
        .as_float()
        .and_then(|float| float.as_str().parse().ok());
    float
        .or_else(|| whole(value).map(|whole| whole as f64))
        .ok_or_else(|| "a number".into())
}

fn mode(value: &DeValue<'_>) -> Result<Mode, String> {
    let by_name = value.as_str().and_then(|name| {
        Mode::ALL
            .iter()
            .copied()
            .find(|m| m.name().eq_ignore_ascii_case(name))
    });
    let by_code = whole(value)
        .and_then(|code| u8::try_from(code).ok())
        .and_then(Mode::from_code);
    by_name.or(by_code).ok_or_else(|| {
        let all: Vec<String> = Mode::ALL
            .iter()
            .map(|m| format!("\"{}\" ({:#04x})", m.name(), m.code()))
            .collect();
        all.join(", ")
    })
}
