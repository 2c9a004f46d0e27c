//! Steps against the mock board: whatever fails, the last command is zero percent and the EEPROM is
//! restored. And the fit on a known drive.

use super::*;
use crate::tune::samples::{Sample, SampleRecorder};
use fw_core::eeprom::Image;
use host_link::board_io::BoardIo;
use host_link::eeprom::journal::Journal;
use host_link::eeprom::repair::repair;
use host_link::error::Error;
use host_link::mock_board::{IoFault, MockBoard, mock_board, reconnect};
use host_link::session::Session;
use host_link::settings::Settings;
use std::panic::{AssertUnwindSafe, catch_unwind};

fn original() -> Image {
    Image::FIRST_BOARD
}

fn plan() -> step_response::StepPlan {
    step_response::StepPlan {
        levels: vec![50.0, 100.0],
        hold_s: 0.5,
        rest_s: 0.3,
        travel: 300.0,
    }
}

fn tune(
    io: &mut BoardIo,
    plan: &step_response::StepPlan,
    journal: Option<&Journal>,
) -> Result<SampleRecorder, Error> {
    temporary_mode::with_modes(io, &original(), journal, 100, |modes| {
        let (io, config) = modes.enter(Mode::TuneRotate)?;
        let mut session = Session::with_config(io, config, 40);
        step_response::run(&mut session, plan, |_| {})
    })
}

/// The EEPROM and its lines are as before the tuning; the last command is zero percent.
#[track_caller]
fn assert_restored(board: &MockBoard, fault: Option<IoFault>) {
    assert!(board.memory == original(), "EEPROM after {fault:?}");
    assert!(board.protected && !board.selected, "{fault:?}");
    assert!(!board.in_reset, "{fault:?}");
    if let Some(last) = board.commands.last() {
        assert_eq!(last.percent.0, 0, "{fault:?}");
    }
}

#[test]
fn tuning_known_drive_recovers_model() {
    let (board, mut io) = mock_board(&original(), None);
    // Of an earlier record.
    board.borrow_mut().log.extend(b"I00500: T 77.00 9.000\n");
    let recorder = tune(&mut io, &plan(), None).unwrap();
    assert_restored(&board.borrow(), None);
    assert!(recorder.samples()[0].percent.abs() < 1.0);
    let steps = drive_model::steps(recorder.samples());
    let levels: Vec<_> = steps.iter().map(|step| step.percent).collect();
    assert_eq!(levels, [50.0, -50.0, 100.0, -100.0]);
    let model = drive_model::fit(&steps).unwrap();
    assert!((model.gain - 2.0).abs() < 0.02, "{model:?}");
    assert!((model.dead_zone - 20.0).abs() < 0.5, "{model:?}");
    assert!((model.lag_s - 0.15).abs() < 0.003, "{model:?}");
}

#[test]
fn tuning_fault_at_any_call_restores_eeprom() {
    let (board, mut io) = mock_board(&original(), None);
    tune(&mut io, &plan(), None).unwrap();
    let calls = board.borrow().calls;
    for at in (0..calls).step_by(3) {
        for fault in [
            IoFault::Interrupt(at),
            IoFault::Panic(at),
            IoFault::FailOnce(at),
            IoFault::BusesFail(at),
        ] {
            // A panic on the way back, while a panic is handled, ends the process.
            if matches!(fault, IoFault::Panic(at) if at + 150 >= calls) {
                continue;
            }
            let (board, mut io) = mock_board(&original(), Some(fault));
            let outcome = catch_unwind(AssertUnwindSafe(|| tune(&mut io, &plan(), None)));
            let board = board.borrow();
            match (fault, outcome) {
                // After the last step there is nothing left to interrupt.
                (IoFault::Interrupt(_), Ok(Ok(_) | Err(Error::Interrupted)))
                | (IoFault::Panic(_), Err(_)) => assert_restored(&board, Some(fault)),
                (IoFault::FailOnce(_), Ok(_)) => {
                    assert!(board.memory == original(), "{fault:?}");
                    assert!(board.protected && !board.selected);
                }
                (IoFault::BusesFail(_), Ok(outcome)) => {
                    assert!(board.protected && !board.selected && !board.in_reset);
                    if board.memory != original() {
                        assert!(matches!(outcome, Err(Error::NotRestored { .. })), "{at}");
                    }
                }
                (fault, outcome) => panic!("{fault:?}: {:?}", outcome.map(Result::err)),
            }
        }
    }
}

#[test]
fn killed_tuning_is_undone_by_repair() {
    let folder = tempfile::tempdir().unwrap();
    let journal = Journal::new(folder.path().join("before"));
    let (board, mut io) = mock_board(&original(), None);
    tune(&mut io, &plan(), Some(&journal)).unwrap();
    assert!(!journal.unfinished());
    let calls = board.borrow().calls;
    let mut left = 0;
    for at in (0..calls).step_by(3) {
        // What follows a kill reaches no wire.
        let (board, mut io) = mock_board(&original(), Some(IoFault::AllFail(at)));
        let _ = tune(&mut io, &plan(), Some(&journal));
        left += usize::from(board.borrow().memory != original());
        board.borrow_mut().fault = None;
        repair(&mut reconnect(&board), &journal, true, 100).unwrap();
        let board = board.borrow();
        assert!(board.memory == original() && board.protected && !board.selected);
        assert!(!journal.unfinished() && !journal.reset_due(), "{at}");
    }
    assert!(2 * left > calls / 3, "{left} of {calls}");
    // In a shared folder any user can put a link in the journal's place.
    let (board, mut io) = mock_board(&original(), None);
    std::os::unix::fs::symlink(folder.path().join("other"), journal.path()).unwrap();
    std::fs::write(folder.path().join("other"), [0xFF; 0x400]).unwrap();
    assert!(matches!(
        repair(&mut io, &journal, false, 100),
        Err(Error::Unreadable(..))
    ));
    assert!(board.borrow().memory == original());
}

#[test]
fn step_link_lost_ends_within_eight_frames() {
    let (board, mut io) = mock_board(&original(), None);
    board.borrow_mut().garbled_from = 20;
    let outcome = tune(&mut io, &plan(), None);
    assert!(matches!(outcome, Err(Error::Silent { .. })), "{outcome:?}");
    let board = board.borrow();
    assert_restored(&board, None);
    let lost = board.commands.iter().skip(20);
    let under_duty = lost.filter(|command| f64::from_bits(command.percent.0) != 0.0);
    assert!(under_duty.count() <= 8);
}

#[test]
fn step_without_log_is_not_started() {
    let (board, mut io) = mock_board(&original(), None);
    board.borrow_mut().log_connected = false;
    let plan = step_response::StepPlan {
        rest_s: 0.8,
        ..plan()
    };
    let outcome = tune(&mut io, &plan, None);
    assert!(matches!(outcome, Err(Error::Tuning(_))), "{outcome:?}");
    let board = board.borrow();
    assert_restored(&board, None);
    let mut duties = board.commands.iter().map(|command| command.percent.0);
    assert!(duties.all(|bits| f64::from_bits(bits) == 0.0));
}

#[test]
fn step_ends_at_its_travel() {
    let (board, mut io) = mock_board(&original(), None);
    let plan = step_response::StepPlan {
        travel: 20.0,
        hold_s: 2.0,
        ..plan()
    };
    let recorder = tune(&mut io, &plan, None).unwrap();
    for step in drive_model::steps(recorder.samples()) {
        let furthest = step.travel.last().unwrap().1.abs();
        // A frame's delay at full speed.
        assert!(furthest < 20.0 + 160.0 * 0.05, "{furthest}");
    }
    assert_restored(&board.borrow(), None);
}

#[test]
fn robot_that_slides_away_ends_the_steps() {
    let (board, mut io) = mock_board(&original(), None);
    let mut slid = 0.0;
    board.borrow_mut().on_command = Some(Box::new(move |_, report| {
        slid += 20.0;
        let measured = f64::from_bits(report.measurement.0) + slid;
        report.measurement.0 = measured.to_bits();
    }));
    let outcome = tune(&mut io, &plan(), None);
    assert!(
        matches!(&outcome, Err(Error::Tuning(text)) if text.contains("further than 600")),
        "{outcome:?}"
    );
    assert_restored(&board.borrow(), None);
}

/// A drive whose figures are known.
pub(super) fn known_drive(gain: f64, dead_zone: f64, lag_s: f64) -> drive_model::DriveModel {
    drive_model::DriveModel {
        gain,
        dead_zone,
        lag_s,
        residual: 0.0,
        steps: 0,
    }
}

/// Steps of a known drive, with noise of ±`noise`.
fn synthetic(gain: f64, dead_zone: f64, lag_s: f64, noise: f64) -> Vec<Sample> {
    let known = known_drive(gain, dead_zone, lag_s);
    let (mut samples, mut at, mut seed) = (Vec::new(), 0.0, 1_u32);
    let mut push = |percent: f64, value: f64| {
        samples.push(Sample {
            tick: u32::try_from(samples.len()).unwrap(),
            percent,
            value,
        });
    };
    for percent in [50.0, -50.0, 75.0, -75.0, 100.0, -100.0] {
        (0..30).for_each(|_| push(0.0, at));
        let from = at;
        for since in 0..120_u32 {
            seed = seed.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            let scatter = (f64::from(seed) / f64::from(u32::MAX) - 0.5) * 2.0 * noise;
            at = from + known.step_travel(percent, f64::from(since) * 0.01) + scatter;
            push(percent, at);
        }
    }
    samples
}

#[test]
fn drive_model_fit_recovers_known_drives() {
    for (gain, dead_zone, lag) in [
        (1.73, 20.1, 0.144),
        (1.89, 20.1, 0.146),
        (5.0, 0.0, 0.05),
        (0.3, 45.0, 0.4),
    ] {
        let fit = |noise| {
            let samples = synthetic(gain, dead_zone, lag, noise);
            drive_model::fit(&drive_model::steps(&samples)).unwrap()
        };
        let model = fit(0.0);
        assert!((model.gain / gain - 1.0).abs() < 1e-3, "{model:?}");
        assert!((model.dead_zone - dead_zone).abs() < 0.05, "{model:?}");
        assert!((model.lag_s / lag - 1.0).abs() < 1e-3, "{model:?}");
        let model = fit(0.1);
        assert!((model.gain / gain - 1.0).abs() < 0.05, "noisy: {model:?}");
        assert!((model.lag_s / lag - 1.0).abs() < 0.1, "noisy: {model:?}");
    }
}

#[test]
fn drive_model_fit_survives_lost_samples() {
    let mut samples = synthetic(1.73, 20.1, 0.144, 0.0);
    let mut index = 0;
    samples.retain(|_| {
        index += 1;
        index % 7 != 3
    });
    let model = drive_model::fit(&drive_model::steps(&samples)).unwrap();
    assert!((model.gain - 1.73).abs() < 0.01, "{model:?}");
}

#[test]
fn drive_model_fit_rejects_implausible_steps() {
    let fit = |edit: fn(f64) -> f64, noise| {
        let mut samples = synthetic(1.73, 20.1, 0.144, noise);
        for sample in &mut samples {
            sample.value = edit(sample.value);
        }
        drive_model::fit(&drive_model::steps(&samples))
    };
    assert!(drive_model::fit(&[]).is_err());
    assert!(fit(|_| 3.0, 0.0).unwrap_err().contains("moved"));
    assert!(fit(|value| -value, 0.0).is_err());
    assert!(fit(|value| value, 500.0).is_err());
    // It is held whenever it backs off.
    let (mut held, mut at) = (synthetic(1.73, 20.1, 0.144, 0.0), 0.0);
    for sample in &mut held {
        if sample.percent < 0.0 {
            sample.value = at;
        }
        at = sample.value;
    }
    let why = drive_model::fit(&drive_model::steps(&held)).unwrap_err();
    assert!(why.contains("unexplained"), "{why}");
}

#[test]
fn proposed_gains_settle_with_small_overshoot() {
    for axis in [Axis::Rotate, Axis::Move] {
        for (gain, lag) in [(1.0, 0.1), (1.8, 0.15), (3.0, 0.2)] {
            let model = known_drive(gain, 20.0, lag);
            let present = gains::Factors::of(Axis::Rotate, &Settings::first_board().unwrap());
            let proposed = gains::propose(&model, axis.damping(), &present);
            assert_eq!(
                proposed.anti_windup.to_bits(),
                present.anti_windup.to_bits()
            );
            let integral_s = 0.01 * proposed.p / proposed.i;
            assert!((integral_s / lag - 10.0).abs() < 0.01, "{integral_s} s");
            let response = gains::predict(axis, &model, &proposed);
            assert!(response.overshoot < 0.04 * response.target, "{response:?}");
            assert!(
                response.settled_s.is_some(),
                "{axis:?} {gain} {lag}: {}",
                response.overshoot
            );
        }
    }
}

#[test]
fn dead_zone_leaves_less_for_the_predicted_drive() {
    let present = gains::Factors::of(Axis::Move, &Settings::first_board().unwrap());
    let settled = |dead_zone| {
        let model = known_drive(3.0, dead_zone, 0.1);
        gains::predict(Axis::Move, &model, &gains::propose(&model, 0.5, &present)).settled_s
    };
    // At 120 instead of 300 mm/s the way alone takes 1.5 s more.
    assert!(settled(60.0).unwrap() > settled(0.0).unwrap() + 1.0);
}

#[test]
fn divider_far_off_worse_gains_and_idle_duties_are_refused() {
    let settings = Settings::first_board().unwrap();
    let config = settings.config();
    // 10 kΩ over 33 kΩ.
    for (ohm, accepted) in [
        (10_000, true),
        (10_400, true),
        (13_200, false),
        (6_800, false),
    ] {
        assert_eq!(battery::check(config, 1, ohm).is_ok(), accepted, "{ohm}");
    }
    let response = |settled_s, overshoot| gains::Response {
        target: 90.0,
        overshoot,
        settled_s,
        curve: Vec::new(),
    };
    for (after, before, worse) in [
        ((Some(0.99), 9.0), (Some(1.0), 0.0), false),
        ((Some(1.01), 0.0), (Some(1.0), 9.0), true),
        ((Some(1.0), 1.0), (Some(1.0), 1.0), false),
        ((Some(1.0), 1.1), (Some(1.0), 1.0), true),
        ((None, 0.0), (Some(4.9), 0.0), true),
        ((Some(4.9), 0.0), (None, 0.0), false),
        ((None, 2.0), (None, 1.0), true),
    ] {
        let (after, before) = (response(after.0, after.1), response(before.0, before.1));
        assert_eq!(after.is_worse_than(&before), worse, "{after:?} {before:?}");
    }
    // Dead zones of 16 and 23 %.
    for (levels, accepted) in [
        (vec![100.0, 20.0], false),
        (vec![100.0, 23.0], false),
        (vec![100.0, 24.0], true),
        (vec![100.0], false),
    ] {
        let plan = step_response::StepPlan { levels, ..plan() };
        assert_eq!(plan.check(config).is_ok(), accepted, "{plan:?}");
    }
}
