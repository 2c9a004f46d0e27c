//! Changing the mode on both ends without leaving the program.

use crate::tune::temporary_mode::set_mode;
use fw_core::wire::Mode;
use host_link::board_io::BoardIo;
use host_link::eeprom::{self, Programmed, Progress, journal::Journal};
use host_link::error::Error;
use host_link::session::Session;
use host_link::settings;

/// A mode by its name, upper or lower case, with or without its spaces, or by its number, decimal
/// or after `0x`.
///
/// # Errors
/// Names and numbers of every mode.
pub fn parse(text: &str) -> Result<Mode, String> {
    let plain = |name: &str| name.replace([' ', '-', '_'], "").to_ascii_lowercase();
    let by_name = |mode: &Mode| plain(mode.name()) == plain(text);
    let code = match text.strip_prefix("0x") {
        Some(digits) => u8::from_str_radix(digits, 16),
        None => text.parse(),
    };
    let by_code = || code.ok().and_then(Mode::from_code);
    let found = Mode::ALL.iter().copied().find(by_name).or_else(by_code);
    found.ok_or_else(|| {
        let all = Mode::ALL.iter();
        let all = all.map(|mode| format!("\"{}\" ({:#04x})", mode.name(), mode.code()));
        format!("accepted is {}", all.collect::<Vec<_>>().join(", "))
    })
}

/// Rewrites the mode in the EEPROM, resets the STM, opens a new session by the EEPROM's content, and
/// exchanges frames until both ends are known to run the new mode. The mode before, what was written, and the session.
///
/// # Errors
/// Those of [`eeprom::read`], [`eeprom::program`], [`Session::open`] and [`Session::confirm_mode`];
/// [`Error::Rejected`] if the EEPROM holds no acceptable configuration to begin with.
// Requirement: DOC-5.2-2
pub fn change<'m>(
    io: &'m mut BoardIo,
    mode: Mode,
    rate_hz: u32,
    ready_timeout_ms: u32,
    journal: Option<&Journal>,
    watch: impl FnMut(Progress<'_>),
) -> Result<(Mode, Programmed, Session<'m>), Error> {
    let present = eeprom::read(io)?;
    let before = settings::decode(&present)?.mode();
    let wanted = set_mode(&present, mode)?;
    let programmed = eeprom::program(io, wanted.image(), ready_timeout_ms, journal, watch)?;
    let mut session = Session::open(io, rate_hz, ready_timeout_ms)?;
    session.confirm_mode()?;
    Ok((before, programmed, session))
}

#[cfg(test)]
mod tests {
    use super::*;
    use fw_core::eeprom::Image;
    use host_link::mock_board::mock_board;

    // Requirement: DOC-5.2-2
    #[test]
    fn mode_change_without_valid_replies_is_an_error() {
        let (board, mut io) = mock_board(&Image::FIRST_BOARD, None);
        board.borrow_mut().garbled_from = 0;
        assert!(change(&mut io, Mode::GuardedNormal, 40, 100, None, |_| ()).is_err());
    }

    #[test]
    fn mode_parse_accepts_names_and_numbers() {
        for &mode in Mode::ALL {
            assert_eq!(parse(mode.name()), Ok(mode));
            assert_eq!(parse(&mode.code().to_string()), Ok(mode));
            assert_eq!(parse(&format!("{:#04x}", mode.code())), Ok(mode));
        }
        assert_eq!(parse("guarded-normal"), Ok(Mode::GuardedNormal));
        for wrong in ["", "3", "0x", "256", "Guarded"] {
            let accepted = parse(wrong).unwrap_err();
            assert!(
                accepted.contains("\"Normal\" (0x00)"),
                "{wrong}: {accepted}"
            );
        }
    }
}
