//! Text → [`Settings`]. Every complaint has the key, the value, what is accepted, and the line.

use super::Settings;
use super::format::{self, Format};
use crate::error::Error;
use crate::file::FileFault;
use fw_core::eeprom::{Config, ConfigError, Expected, FIELDS, Field, Image, MAX_CELLS, fields};
use fw_core::wire::Mode;
use std::fmt::Write;
use std::ops::Range;
use std::path::Path;
use toml::Spanned;
use toml::de::{DeTable, DeValue};

/// Reads a configuration file's text. Complains of everything that is wrong with keys and values at once.
pub(super) fn parse(text: &str, path: &Path) -> Result<Settings, Error> {
    let content = |faults| Error::Content {
        path: path.into(),
        faults,
    };
    let document = DeTable::parse(text).map_err(|error| {
        let span = error.span().unwrap_or_default();
        content(vec![FileFault::at(text, span, error.message())])
    })?;
    let document = document.get_ref();
    let keys: Vec<_> = format::all().map(format::key).collect();
    let mut faults = Vec::new();
    unknown(document, "", &keys, &mut |span, what| {
        faults.push(FileFault::at(text, span, what));
    });

    let mut image = Image::FIRST_BOARD;
    for (field, key) in format::all().zip(&keys) {
        // A number that no robot has is complained of by itself, below.
        let cells = Some(image.get(fields::CELLS)).filter(|&cells| cells <= MAX_CELLS as u64);
        let unused = u64::from(field.tap) > cells.unwrap_or_default();
        match find(document, key) {
            Some(value) => {
                if let Some(raw) = raw(field, value.get_ref()) {
                    image.set(field, raw);
                    continue;
                }
                let shown = text.get(value.span()).unwrap_or_default();
                let accepted = format::accepted(field);
                let what = format!("{key} = {shown}: accepted is {accepted}");
                faults.push(FileFault::at(text, value.span(), what));
            }
            None if format::is_optional(field) || unused => {}
            None => {
                let help = fields::HELP.get(usize::from(field.index)).unwrap_or(&"");
                faults.push(FileFault::whole(format!("{key} is missing: {help}")));
            }
        }
    }
    if !faults.is_empty() {
        faults.sort_by_key(|fault| fault.line.unwrap_or(usize::MAX));
        return Err(content(faults));
    }
    if document.get("platform").is_none() {
        image.make_original();
    }
    image.seal();
    match Config::decode(&image) {
        Ok(config) => Ok(Settings { image, config }),
        Err(error) => Err(rejected(error, image, path, |key| {
            FileFault::at(text, find(document, key)?.span(), "").line
        })),
    }
}

/// The core's judgement of the image, with the file's lines and keys. It names one field at a time: each is
/// replaced by the first board's to find the next.
fn rejected(
    mut error: ConfigError,
    mut image: Image,
    path: &Path,
    line: impl Fn(&str) -> Option<usize>,
) -> Error {
    let mut rejections = Vec::new();
    for _ in &FIELDS {
        let field = FIELDS.iter().find(|field| field.name() == error.field());
        let mut location = format!("in {}", path.display());
        let mut what = error.to_string();
        if let Some(field) = field {
            let key = format::key(field);
            if let Some(line) = line(&key) {
                let _ = write!(location, ", line {line}");
            }
            let _ = write!(location, " ({key})");
            if let Expected::Range(_) = error.expected {
                let value = format::text(field, image.get(field));
                what = format!("{key} is {value}, accepted is {}", format::accepted(field));
            }
        }
        rejections.push((location, what));
        let Some(field) = field else { break };
        image.set(field, Image::FIRST_BOARD.get(field));
        image.seal();
        match Config::decode(&image) {
            Err(next) if next.field() != error.field() => error = next,
            _ => break,
        }
    }
    let mut rejections = rejections.into_iter();
    let (location, mut what) = rejections.next().unwrap_or_default();
    for (also_at, also) in rejections {
        let _ = write!(what, "; {also_at}: {also}");
    }
    Error::Rejected(location, what)
}

/// The value of a dotted key.
fn find<'t, 'i>(table: &'t DeTable<'i>, key: &str) -> Option<&'t Spanned<DeValue<'i>>> {
    match key.split_once('.') {
        None => table.get(key),
        Some((first, rest)) => find(table.get(first)?.get_ref().as_table()?, rest),
    }
}

/// Complains of every key that the table of fields does not have.
fn unknown(
    table: &DeTable<'_>,
    prefix: &str,
    keys: &[String],
    complain: &mut impl FnMut(Range<usize>, String),
) {
    for (name, value) in table {
        let key = format!("{prefix}{}", name.get_ref());
        if keys.contains(&key) {
            continue;
        }
        let section = format!("{key}.");
        let is_section = keys.iter().any(|key| key.starts_with(&section));
        match value.get_ref().as_table() {
            Some(inner) if is_section => unknown(inner, &section, keys, complain),
            None if is_section => {
                complain(name.span(), format!("{key} must be a section, [{key}]"));
            }
            _ => {
                let rests = keys.iter().filter_map(|key| key.strip_prefix(prefix));
                let mut accepted: Vec<_> =
                    rests.filter_map(|rest| rest.split('.').next()).collect();
                accepted.dedup();
                let accepted = accepted.join(", ");
                let what = format!("unknown key {key}: accepted here are {accepted}");
                complain(name.span(), what);
            }
        }
    }
}

/// The raw value of a value of the file, if the field can store it.
fn raw(field: &Field, value: &DeValue<'_>) -> Option<u64> {
    let max = field.kind.max();
    match Format::of(field) {
        Format::Mode => mode(value),
        Format::Flag => value.as_bool().map(u64::from),
        Format::Hex | Format::Int => {
            let value = u64::try_from(whole(value)?).ok();
            value.filter(|&value| value <= max)
        }
        Format::Scaled(scale) => format::scaled(real(value)?, scale, max),
        Format::Bearing => format::bearing(real(value)?),
        Format::Real => real(value).map(f64::to_bits),
    }
}

fn whole(value: &DeValue<'_>) -> Option<i64> {
    let integer = value.as_integer()?;
    i64::from_str_radix(integer.as_str(), integer.radix()).ok()
}

#[allow(clippy::cast_precision_loss)] // no field tells 2⁵³ from its neighbour
fn real(value: &DeValue<'_>) -> Option<f64> {
    let float = value.as_float();
    let float = float.and_then(|float| float.as_str().parse().ok());
    float.or_else(|| whole(value).map(|whole| whole as f64))
}

fn mode(value: &DeValue<'_>) -> Option<u64> {
    let (name, code) = (value.as_str().unwrap_or_default(), whole(value));
    let meant =
        |mode: &&Mode| mode.name().eq_ignore_ascii_case(name) || code == Some(mode.code().into());
    Some(Mode::ALL.iter().find(meant)?.code().into())
}
