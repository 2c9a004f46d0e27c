//! Keys and values of the file, derived from a field's page, name, unit and range.

use fw_core::eeprom::{Accepted, FIELDS, Field, Kind, PLATFORM, Unit};
use fw_core::log::Line;
use fw_core::wire::Mode;

/// Codes of a turn.
const TURN: f64 = 65_536.0;

/// The fields that the file has, in its order: those that may hold more than one value.
pub(super) fn all() -> impl Iterator<Item = &'static Field> {
    FIELDS.iter().filter(|field| field.constant().is_none())
}

/// `section.key`: the page's section, the field's name, and the unit of the file.
pub(super) fn key(field: &Field) -> String {
    let section = match field.address >> 8 {
        0 => "link",
        1 => "pid",
        2 => "battery",
        _ => "platform",
    };
    let unit = match field.unit {
        Unit::None | Unit::PercentPerMillimetre | Unit::PercentPerDegree | Unit::Baud => "",
        Unit::PercentHundredths => "_percent",
        Unit::Volts | Unit::Millivolts => "_v",
        Unit::Ohms => "_ohm",
        Unit::Micrometres | Unit::Millimetres => "_mm",
        Unit::Turns => "_deg",
        Unit::Milliseconds => "_ms",
        Unit::MillimetresPerSecond => "_mm_s",
        Unit::MillimetresPerSecondSquared => "_mm_s2",
        Unit::TurnsPerSecond => "_deg_s",
        Unit::TurnsPerSecondSquared => "_deg_s2",
    };
    format!("{section}.{}{unit}", field.name())
}

/// Whether the file may leave it out: then the first board's value applies.
pub(super) fn is_optional(field: &Field) -> bool {
    field.address >= PLATFORM
}

/// How the file writes a field.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Format {
    /// The mode, by name or number.
    Mode,
    /// True or false.
    Flag,
    /// A whole number, hexadecimal.
    Hex,
    /// A whole number.
    Int,
    /// A number, stored as this multiple.
    Scaled(f64),
    /// An angle of a whole circle in degrees.
    Bearing,
    /// A number, stored as it is.
    Real,
}

impl Format {
    pub fn of(field: &Field) -> Self {
        let any = matches!(*field.accepted, Accepted::IntRange { min: 0, max } if u64::from(max) >= field.kind.max());
        match (field.unit, *field.accepted) {
            (_, Accepted::Mode) => Self::Mode,
            (_, Accepted::RealRange { .. }) => Self::Real,
            (Unit::Turns, _) if any => Self::Bearing,
            (Unit::Turns | Unit::TurnsPerSecond | Unit::TurnsPerSecondSquared, _) => {
                Self::Scaled(TURN / 360.0)
            }
            (Unit::Micrometres | Unit::Millivolts, _) => Self::Scaled(1000.0),
            (Unit::PercentHundredths, _) => Self::Scaled(100.0),
            (_, Accepted::IntRange { min: 0, max: 1 }) => Self::Flag,
            (Unit::None, _) if any && field.kind == Kind::U8 => Self::Hex,
            _ => Self::Int,
        }
    }
}

/// A raw value as the file writes it.
pub(super) fn text(field: &Field, raw: u64) -> String {
    match Format::of(field) {
        Format::Mode => {
            let mode = u8::try_from(raw).ok().and_then(Mode::from_code);
            format!("\"{}\"", mode.unwrap_or_default().name())
        }
        Format::Flag => (raw != 0).to_string(),
        Format::Hex => format!("0x{raw:02X}"),
        Format::Int => raw.to_string(),
        Format::Scaled(scale) => shortest(u32::try_from(raw).unwrap_or(u32::MAX), scale),
        Format::Bearing => {
            let signed = u16::try_from(raw).unwrap_or_default().cast_signed();
            let sign = if signed < 0 { "-" } else { "" };
            let size = shortest(signed.unsigned_abs().into(), TURN / 360.0);
            format!("{sign}{size}")
        }
        // `{:?}` is the shortest text that reads back as the same number, always with a point.
        Format::Real => format!("{:?}", f64::from_bits(raw)),
    }
}

/// What a field may hold, as the file writes it.
pub(super) fn accepted(field: &Field) -> String {
    let largest = field.kind.max();
    let (min, max) = match *field.accepted {
        Accepted::IntRange { min, max } => (min.into(), largest.min(max.into())),
        _ => (0, largest),
    };
    match Format::of(field) {
        Format::Mode => {
            let mode = |mode: &Mode| format!("\"{}\" ({:#04x})", mode.name(), mode.code());
            Mode::ALL.iter().map(mode).collect::<Vec<_>>().join(", ")
        }
        Format::Flag => "true or false".into(),
        Format::Hex | Format::Int => format!("a whole number from {min} to {max}"),
        Format::Scaled(_) => format!("{} to {}", text(field, min), text(field, max)),
        Format::Bearing => "-360 to 360".into(),
        Format::Real => {
            let mut line = Line::new();
            field.accepted.log(&mut line);
            line.as_str().into()
        }
    }
}

/// `code` / `scale` with as few decimals as bring the same code back.
fn shortest(code: u32, scale: f64) -> String {
    let value = f64::from(code) / scale;
    for decimals in 0..10 {
        let text = format!("{value:.decimals$}");
        let back = text.parse().unwrap_or(f64::NAN);
        if scaled(back, scale, u32::MAX.into()) == Some(code.into()) {
            return if decimals == 0 { text + ".0" } else { text };
        }
    }
    format!("{value:?}")
}

/// The nearest code of `value` × `scale`, if it is one of 0 ..= `max`.
#[allow(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    clippy::cast_precision_loss,
    reason = "32 bits at most"
)]
pub(super) fn scaled(value: f64, scale: f64, max: u64) -> Option<u64> {
    let code = (value * scale).round();
    (0.0..=max as f64).contains(&code).then_some(code as u64)
}

/// The nearest bearing of an angle from -360 to 360 degrees.
pub(super) fn bearing(degrees: f64) -> Option<u64> {
    let within = (-360.0..=360.0).contains(&degrees);
    let code = scaled(degrees.rem_euclid(360.0), TURN / 360.0, 0x1_0000);
    Some(code.filter(|_| within)? & 0xFFFF)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn scaled_codes_survive_their_text_within_range() {
        for scale in [100.0, 1000.0, TURN / 360.0] {
            for code in 0..=0xFFFF {
                let value: f64 = shortest(code, scale).parse().unwrap();
                assert_eq!(scaled(value, scale, 0xFFFF), Some(code.into()));
            }
        }
        let front = fw_core::eeprom::fields::BEARING_FRONT;
        for code in 0..=0xFFFF {
            assert_eq!(bearing(text(front, code).parse().unwrap()), Some(code));
        }
        assert_eq!(text(front, 0xC000), "-90.0");
        let key = fw_core::eeprom::fields::KEY_FROM_PI;
        assert_eq!(accepted(key), "a whole number from 0 to 255");
        let travel = fw_core::eeprom::fields::SERVO_TRAVEL;
        assert_eq!(text(travel, 0x8000), "180.0");
        assert_eq!(shortest(91, TURN / 360.0), "0.5");
        assert_eq!(shortest(80_000, 1000.0), "80.0");
        let refused = |mm| scaled(mm, 1000.0, 0xFFFF).is_none();
        assert!(refused(70.0) && refused(-1.0) && refused(f64::NAN));
        assert_eq!(shortest(100, TURN / 360.0), "0.55");
        assert!(bearing(f64::INFINITY).is_none());
        assert_eq!([-360.0, 360.0].map(bearing), [Some(0); 2]);
        assert_eq!([-360.1, 360.1].map(bearing), [None; 2]);
    }
}
