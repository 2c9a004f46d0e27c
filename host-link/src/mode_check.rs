//! Detects that the other end runs another mode. In guarded modes the checksum of a reply proves the
//! mode; the document's modes have no checksum. There the beginning of a longer frame can pass for a
//! shorter one, but the battery's cell index is constant, and the position jumps with the other end's
//! frame counter; and a shorter frame can pass for a longer one, but its last byte repeats to the end.
//!
//! `TuneRotatePID` and `TuneMovePID`, bare or guarded, have the same frames and cannot be
//! distinguished. With a single cell the cell index is always constant, and a bare tuning mode has no
//! other evidence.

use fw_core::eeprom::Config;
use fw_core::types::Faults;
use fw_core::wire::{Field, Report};

/// When none of the first frames is valid, the two ends run other chains or keys: reported at once,
/// without waiting for [`SILENCE_TIMEOUT_US`](crate::session::SILENCE_TIMEOUT_US).
pub const MODE_CHECK_FRAMES: u32 = 10;

/// More than a robot drives between two frames, micrometres.
const JUMP_UM: u64 = 10_000_000;

/// A reset makes one jump of the position; so many in a row are no reset.
const MAX_JUMPS: u32 = 4;

/// The evidence of the replies so far.
#[derive(Clone, Debug, Default)]
pub(crate) struct ModeCheck {
    guarded: bool,
    position: bool,
    cells: u8,
    first: Option<u8>,
    cell_changes: bool,
    replies: u32,
    x_um: i32,
    jumps: u32,
    repeats: u32,
}

impl ModeCheck {
    pub(crate) fn new(config: &Config) -> Self {
        Self {
            guarded: config.mode().has(Field::Sequence),
            position: config.mode().has(Field::Position),
            cells: config.cells(),
            ..Self::default()
        }
    }

    /// Whether enough replies show that both ends run the same mode.
    pub(crate) fn is_confirmed(&self) -> bool {
        self.replies >= if self.guarded { 1 } else { MODE_CHECK_FRAMES }
    }

    /// Checks a reply that passed the chain.
    ///
    /// # Errors
    /// What shows that the other end runs another mode.
    pub(crate) fn update(&mut self, report: &Report) -> Result<(), String> {
        self.replies = self.replies.saturating_add(1);
        if self.guarded {
            return Ok(());
        }
        let cell = report.cell.cell;
        self.cell_changes |= *self.first.get_or_insert(cell) != cell;
        if self.cells > 1 && !self.cell_changes && self.replies >= MODE_CHECK_FRAMES {
            return Err(format!("all of cell {} of {}", cell + 1, self.cells));
        }
        self.repeats += u32::from(self.position && repeats(report));
        if self.replies == MODE_CHECK_FRAMES && self.repeats == self.replies {
            return Err("battery and distances are all one byte repeated".into());
        }
        let step = i64::from(report.pose.x) - i64::from(self.x_um);
        self.x_um = report.pose.x;
        let jumps = step.unsigned_abs() >= JUMP_UM;
        self.jumps = if jumps { self.jumps + 1 } else { 0 };
        if self.jumps >= MAX_JUMPS {
            let metres = step / 1_000_000;
            return Err(format!("positions {metres} m apart from frame to frame"));
        }
        Ok(())
    }
}

/// Whether battery and distances are the same two bytes, which four real readings are not.
fn repeats(report: &Report) -> bool {
    let battery = u16::from(report.cell.cell) << 13 | report.cell.voltage;
    report.ranges.iter().all(|range| range.0 == battery)
}

/// The fault that a session causes by beginning: the STM rejects its first frames as stale where their numbers lie
/// behind those of the last session.
#[derive(Default)]
pub(crate) struct StartFaults {
    /// Latched before this session's first frame.
    before: Option<Faults>,
    /// To clear.
    pub own: Faults,
}

impl StartFaults {
    /// Frames after which a rejected one is the wire's fault.
    const FRAMES: u64 = 8;

    /// Of a report after so many frames.
    pub fn update(&mut self, frames: u64, faults: Faults) {
        let before = *self.before.get_or_insert(faults);
        let starting = frames <= Self::FRAMES;
        let new = faults.difference(before) & Faults::FRAME_REJECTED;
        self.own = if starting { new } else { Faults::NONE };
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mock_board::mock_board;
    use crate::session::{CommandRequest, RATE_HZ, Session};
    use fw_core::eeprom::{Image, fields};
    use fw_core::wire::{
        CellCode, Command, DistanceCode, MAX_FRAME, Mode, PiLink, StmLink, chain, frame_len,
    };

    /// The Pi in one mode, the STM in another, at rest, for ten frames: whether the Pi detects it.
    fn is_detected(pi_mode: Mode, stm_mode: Mode, cells: u8) -> bool {
        let config = |mode: Mode| {
            let image = Image::FIRST_BOARD
                .with(fields::SERVO, 1)
                .with(fields::MODE, u64::from(mode.code()))
                .with(fields::CELLS, cells.into());
            Config::decode(&image).unwrap()
        };
        let mut pi = PiLink::new(config(pi_mode).link_setup());
        let stm = StmLink::new(config(stm_mode).link_setup());
        let mut mode_check = ModeCheck::new(&config(pi_mode));
        let mut accepted = 0;
        for frame in 0..MODE_CHECK_FRAMES {
            let cell = u8::try_from(frame).unwrap() % cells;
            // 0x0320 and 0x031F: repeated, their last bytes pass for one cell and the other.
            let voltage = 800 - u16::from(cell);
            let report = Report {
                cell: CellCode { cell, voltage },
                ..Report::default()
            };
            let mut out = [0; MAX_FRAME];
            let _ = pi.send(&Command::default(), &mut out);
            let sent = stm.encode_reply(frame + 1, &report, &mut out);
            // What is clocked after the reply's end repeats its last byte.
            let last = out[sent - 1];
            out[sent..].fill(last);
            let Ok(report) = pi.receive(&out[..frame_len(pi_mode)]) else {
                continue;
            };
            accepted += 1;
            if mode_check.update(&report).is_err() {
                return true;
            }
        }
        accepted == 0
    }

    #[test]
    fn other_cell_in_the_tenth_reply_is_in_time() {
        let mut check = ModeCheck::new(&Config::decode(&Image::FIRST_BOARD).unwrap());
        for nth in 1..=MODE_CHECK_FRAMES {
            let cell = u8::from(nth == MODE_CHECK_FRAMES);
            let report = Report {
                cell: CellCode { cell, voltage: 800 },
                ..Report::default()
            };
            assert_eq!(check.update(&report), Ok(()), "{nth}");
        }
    }

    #[test]
    fn other_chain_is_detected_within_ten_frames() {
        for &pi in Mode::ALL {
            for &stm in Mode::ALL {
                let differs = chain(pi) != chain(stm);
                let modes = [pi, stm].map(Mode::name);
                assert_eq!(is_detected(pi, stm, 2), differs, "{modes:?}");
            }
        }
        // A single cell is no evidence, but the position is.
        assert!(is_detected(Mode::Normal, Mode::GuardedNormal, 1));
        assert!(is_detected(Mode::Normal, Mode::TuneMove, 1));
        assert!(!is_detected(Mode::Normal, Mode::Normal, 1));
    }

    #[test]
    fn position_that_jumps_ten_metres_four_times_is_another_chain() {
        for (step_m, jumps, is_other) in
            [(10, 3, false), (10, 4, true), (-10, 4, true), (9, 9, false)]
        {
            let outcomes = updates(0, (1..=9).map(|frame| jumps.min(frame) * step_m));
            let far = Err(format!("positions {step_m} m apart from frame to frame"));
            let expected = if is_other { far } else { Ok(()) };
            assert_eq!(outcomes[3], expected, "{jumps} of {step_m} m");
            assert_eq!(outcomes[..3], [const { Ok(()) }; 3]);
        }
    }

    /// Updates with these x, metres, from a robot of one cell whose battery and distances are one byte
    /// repeated in so many of the first replies.
    fn updates(repeated: usize, x_m: impl IntoIterator<Item = i32>) -> Vec<Result<(), String>> {
        let config = Config::decode(&Image::FIRST_BOARD.with(fields::CELLS, 1)).unwrap();
        let mut mode_check = ModeCheck::new(&config);
        let updates = x_m.into_iter().enumerate().map(|(reply, x_m)| {
            let mut report = Report {
                ranges: [DistanceCode(u16::from(reply >= repeated)); 3],
                ..Report::default()
            };
            report.pose.x = x_m * 1_000_000;
            mode_check.update(&report)
        });
        updates.collect()
    }

    #[test]
    fn mismatch_needs_every_reply_repeated_or_jumps_in_a_row() {
        let outcomes = updates(10, [0; 10]);
        assert!(outcomes[..9].iter().all(Result::is_ok) && outcomes[9].is_err());
        for repeated in [0, 9] {
            assert_eq!(updates(repeated, [0; 10]), [const { Ok(()) }; 10]);
        }
        // Three and three more after a pause.
        let pause = [10, 20, 30, 30, 40, 50, 60];
        assert!(updates(0, pause).iter().all(Result::is_ok));
    }

    #[test]
    fn cell_that_never_changes_is_named_from_1() {
        let mismatch = Err("all of cell 2 of 2".into());
        // A guarded reply needs no further evidence.
        for (mode, expected) in [(Mode::Normal, mismatch), (Mode::GuardedNormal, Ok(()))] {
            let image = Image::FIRST_BOARD.with(fields::MODE, mode.code().into());
            let mut mode_check = ModeCheck::new(&Config::decode(&image).unwrap());
            let mut report = Report::default();
            report.cell.cell = 1;
            let last = (0..10).map(|_| mode_check.update(&report)).last();
            assert_eq!(last, Some(expected));
        }
    }

    #[test]
    fn robot_reset_far_from_origin_is_no_mismatch() {
        let mut mode_check = ModeCheck::new(&Config::decode(&Image::FIRST_BOARD).unwrap());
        for frame in 0..40_u8 {
            let mut report = Report::default();
            report.cell.cell = frame % 2;
            report.pose.x = if frame < 20 { 1_500_000_000 } else { 0 };
            assert_eq!(mode_check.update(&report), Ok(()));
        }
        assert!(mode_check.is_confirmed());
    }

    #[test]
    fn session_clears_the_rejections_of_its_own_start_only() {
        let mode = Mode::GuardedNormal.code().into();
        let image = Image::FIRST_BOARD.with(fields::MODE, mode);
        for before in [Faults::NONE, Faults::FRAME_REJECTED] {
            let (board, mut io) = mock_board(&image, None);
            let mut session = Session::open(&mut io, RATE_HZ, 100).unwrap();
            let exchange = |session: &mut Session<'_>, frames: u32| {
                for _ in 0..frames {
                    session.exchange(&CommandRequest::default()).unwrap();
                }
            };
            exchange(&mut session, 50);
            board.borrow_mut().report.faults = before;
            let mut session = Session::open(&mut io, RATE_HZ, 100).unwrap();
            exchange(&mut session, 2);
            // The second one's number follows the fiftieth's.
            assert_eq!(board.borrow().commands.len(), 51);
            assert_eq!(board.borrow().commands[50].sequence.own, 51);
            assert_eq!(board.borrow().report.faults, Faults::FRAME_REJECTED);
            board.borrow_mut().report.faults |= Faults::SLIP;
            exchange(&mut session, 5);
            // The last one of the start.
            board.borrow_mut().report.faults |= Faults::FRAME_REJECTED;
            exchange(&mut session, 2);
            assert_eq!(board.borrow().report.faults, before | Faults::SLIP);
            // Later it is the wire's.
            board.borrow_mut().report.faults = Faults::FRAME_REJECTED;
            exchange(&mut session, 10);
            assert_eq!(board.borrow().report.faults, Faults::FRAME_REJECTED);
        }
    }
}
