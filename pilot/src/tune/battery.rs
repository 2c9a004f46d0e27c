//! Tuning a battery tap (document, 5.1.3): a reference voltage stands in for the cell, the STM
//! computes the upper resistor that would have shown it exactly, and logs it.

use fw_core::eeprom::Config;
use fw_core::wire::CellCode;
use host_link::error::Error;
use host_link::log::{LogLine, LogParser};
use host_link::session::{CommandRequest, Session};

/// The largest voltage of the wire, volts: 0x1FFF.
pub const LARGEST_V: f64 = 40.955;

/// Answers taken.
const ANSWERS: usize = 15;

/// Frames in which they must have come.
const FRAMES: usize = 80;

/// Frames before the first request.
const WARM_UP: usize = 20;

/// Measures the upper resistor of `cell` (1 to 8) with `volts` at it; the median of fifteen answers,
/// ohm.
///
/// # Errors
/// [`Error::Usage`] for a cell the robot does not have or a voltage beyond the wire's; those of
/// [`Session::exchange`]; [`Error::Device`] of the log; [`Error::Tuning`] without an answer.
// Requirement: DOC-5.1.3-4
pub fn measure_upper_resistor(
    session: &mut Session<'_>,
    cell: u8,
    volts: f64,
) -> Result<u32, Error> {
    let cells = session.config().cells();
    if !(1..=cells).contains(&cell) {
        return Err(Error::Usage(format!(
            "cell {cell}: accepted is 1 to {cells}, the robot's cells"
        )));
    }
    let code = code(volts)?;
    session.read_log()?;
    for _ in 0..WARM_UP {
        session.exchange(&CommandRequest::default())?;
    }
    let request = CommandRequest {
        tune: Some(CellCode {
            cell: cell - 1,
            voltage: code,
        }),
        ..CommandRequest::default()
    };
    let mut lines = LogParser::default();
    let mut answers = Vec::new();
    for _ in 0..FRAMES {
        session.exchange(&request)?;
        for line in lines.feed(&session.read_log()?) {
            match line {
                (_, LogLine::Tuned { tap, ohm }) if tap == cell => answers.push(ohm),
                _ => {}
            }
        }
        if answers.len() >= ANSWERS {
            break;
        }
    }
    answers.sort_unstable();
    let median = answers.get(answers.len() / 2).copied();
    median.ok_or_else(|| {
        let check = format!("check that {volts} V is at it, and the log's wire and --uart");
        Error::Tuning(format!(
            "the STM's log proposes no resistor for tap {cell}; {check}"
        ))
    })
}

/// Largest correction of a tap's voltage: resistors of 1 % and the ADC's reference need less.
const MAX_CORRECTION: f64 = 0.05;

/// # Errors
/// [`Error::Tuning`] for an upper resistor that would change the tap's voltage by more than parts can be off:
/// then the voltage at the cell is not the stated one.
pub fn check(config: &Config, cell: u8, upper_ohm: u32) -> Result<(), Error> {
    let tap = usize::from(cell).saturating_sub(1);
    let Some(present) = config.dividers().get(tap) else {
        return Ok(());
    };
    let whole = |upper: u32| f64::from(upper) + f64::from(present.lower.0);
    let correction = whole(upper_ohm) / whole(present.upper.0) - 1.0;
    if correction.abs() <= MAX_CORRECTION {
        return Ok(());
    }
    Err(Error::Tuning(format!(
        "{upper_ohm} ohm instead of {} changes the voltage of tap {cell} by {:.2} %, accepted are {:.0} %; check \
         cell and volts, or correct the resistor in the configuration",
        present.upper.0,
        correction * 100.0,
        MAX_CORRECTION * 100.0
    )))
}

/// Volts in the wire's steps of 5 mV.
fn code(volts: f64) -> Result<u16, Error> {
    if !(0.005..=LARGEST_V).contains(&volts) {
        return Err(Error::Usage(format!(
            "{volts} V: accepted is 0.005 to {LARGEST_V}"
        )));
    }
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)] // checked
    Ok((volts * 200.0).round() as u16)
}

// Requirement: DOC-5.1.3-4
#[test]
fn upper_resistor_is_read_from_log() {
    use fw_core::eeprom::Image;
    use host_link::mock_board::mock_board;
    let (board, mut io) = mock_board(&Image::FIRST_BOARD, None);
    let mut session = Session::open(&mut io, 40, 100).unwrap();
    assert_eq!(measure_upper_resistor(&mut session, 2, 3.699), Ok(33_120));
    let asked = board.borrow().commands.last().unwrap().tune;
    assert_eq!((asked.cell, asked.voltage), (1, 740));
    for (cell, volts) in [(0, 3.7), (3, 3.7), (1, 0.0), (1, 41.0), (1, f64::NAN)] {
        assert!(matches!(
            measure_upper_resistor(&mut session, cell, volts),
            Err(Error::Usage(_))
        ));
    }
    // The first fifteen of this tap, in any order, beside those of another one.
    let (_, mut io) = mock_board(&Image::FIRST_BOARD, None);
    let mut number = 0;
    io.log = Box::new(move |_| {
        number += 1;
        let (tap, ohm) = match number % 2 {
            0 => (1, 10),
            _ => (2, 33_000 + number / 2 * 7 % 15),
        };
        Ok(format!("I{number:05}: tuned tap {tap}: upper resistor {ohm} ohm\n").into_bytes())
    });
    let mut varied = Session::open(&mut io, 40, 100).unwrap();
    let median = measure_upper_resistor(&mut varied, 2, 3.7);
    assert_eq!(median, Ok(33_007));
    board.borrow_mut().log_connected = false;
    let mute = measure_upper_resistor(&mut session, 1, 3.7);
    assert!(matches!(mute, Err(Error::Tuning(_))), "{mute:?}");
}
