//! Text → [`Settings`]. Every complaint has the key, the value, what is accepted, and the line.

use super::Settings;
use super::format::{self, Format};
use crate::error::Error;
use crate::file::FileFault;
use fw_core::eeprom::{CONSTRAINTS, Config, Constraint, Field, Image, fields};
use fw_core::wire::Mode;
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

    let (mut image, mut wrong) = (Image::FIRST_BOARD, Vec::new());
    for (field, key) in format::all().zip(&keys) {
        let cells = u8::try_from(image.get(fields::CELLS)).unwrap_or_default();
        match find(document, key) {
            Some(value) => {
                let raw = raw(field, value.get_ref());
                if let Some(raw) = raw.filter(|&raw| field.contains(raw, cells)) {
                    image.set(field, raw);
                    continue;
                }
                wrong.push(field.index);
                faults.push(fault(text, key, value, &format::accepted(field)));
            }
            None if format::is_optional(field) || field.tap > cells => {}
            None => {
                let help = fields::HELP.get(usize::from(field.index)).unwrap_or(&"");
                faults.push(FileFault::whole(format!("{key} is missing: {help}")));
            }
        }
    }
    // A wrong value counts as the first board's.
    let config = Config::of_checked(&|field| image.get(field));
    let unmet = |one: &&Constraint| !wrong.contains(&one.field.index) && !one.holds(&config);
    for Constraint {
        field, expected, ..
    } in CONSTRAINTS.iter().filter(unmet)
    {
        let key = format::key(field);
        faults.push(match find(document, &key) {
            Some(value) => fault(text, &key, value, expected),
            None => FileFault::whole(format!("{key} is missing: accepted is {expected}")),
        });
    }
    if !faults.is_empty() {
        faults.sort_by_key(|fault| fault.line.unwrap_or(usize::MAX));
        return Err(content(faults));
    }
    if document.get("platform").is_none() {
        image.make_original();
    }
    image.seal();
    Settings::from_image(&image)
}

/// What stands at a key is not what is accepted.
fn fault(text: &str, key: &str, value: &Spanned<DeValue<'_>>, accepted: &str) -> FileFault {
    let shown = text.get(value.span()).unwrap_or_default();
    let what = format!("{key} = {shown}: accepted is {accepted}");
    FileFault::at(text, value.span(), what)
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
