//! Numbers between the file's units and the EEPROM's codes.

/// The nearest code of `value` × `scale`.
///
/// # Errors
/// The accepted range, in the file's unit, if the code would not fit 0 ..= `max`.
pub(super) fn code(value: f64, scale: f64, max: u32) -> Result<u32, String> {
    let scaled = (value * scale).round();
    if (0.0..=f64::from(max)).contains(&scaled) {
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)] // 0 ..= max
        return Ok(scaled as u32);
    }
    Err(format!("0 to {}", f64::from(max) / scale))
}

/// `code` / `scale` with as few decimals as bring the same code back.
pub(super) fn text(code: u32, scale: f64) -> String {
    let value = f64::from(code) / scale;
    for decimals in 0..10 {
        let text = format!("{value:.decimals$}");
        if text
            .parse()
            .ok()
            .and_then(|value: f64| self::code(value, scale, u32::MAX).ok())
            == Some(code)
        {
            return if decimals == 0 { text + ".0" } else { text };
        }
    }
    format!("{value:?}")
}

/// Codes of a turn.
const TURN: f64 = 65_536.0;

/// The nearest bearing of an angle in degrees, wrapped.
///
/// # Errors
/// The accepted range.
pub(super) fn bearing(degrees: f64) -> Result<u16, String> {
    if !(-360.0..=360.0).contains(&degrees) {
        return Err("-360 to 360".into());
    }
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)] // 0 ..= 0x10000
    let code = (degrees.rem_euclid(360.0) / 360.0 * TURN).round() as u32;
    Ok((code & 0xFFFF) as u16)
}

/// A bearing in degrees, −180 to below 180, with as few decimals as bring the same code back.
pub(super) fn bearing_text(code: u16) -> String {
    let signed = code.cast_signed();
    let magnitude = text(signed.unsigned_abs().into(), TURN / 360.0);
    if signed < 0 {
        format!("-{magnitude}")
    } else {
        magnitude
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_word_survives_every_scale() {
        for scale in [100.0, 1000.0, TURN / 360.0] {
            for word in 0..=u32::from(u16::MAX) {
                let value: f64 = text(word, scale).parse().unwrap();
                assert_eq!(code(value, scale, 0xFFFF), Ok(word));
            }
        }
    }

    #[test]
    fn every_bearing_survives() {
        for word in 0..=u16::MAX {
            assert_eq!(bearing(bearing_text(word).parse().unwrap()), Ok(word));
        }
    }

    #[test]
    fn texts_are_short() {
        assert_eq!(text(91, TURN / 360.0), "0.5");
        assert_eq!(text(80_000, 1000.0), "80.0");
        assert_eq!(bearing_text(0xC000), "-90.0");
    }

    #[test]
    fn what_does_not_fit_is_refused_with_the_range() {
        assert_eq!(code(70.0, 1000.0, 0xFFFF), Err("0 to 65.535".into()));
        assert!(code(-1.0, 1.0, 0xFFFF).is_err());
        assert!(code(f64::NAN, 1.0, 0xFFFF).is_err());
        assert!(bearing(f64::INFINITY).is_err());
    }
}
