//! The steps against doubles: whatever fails, the robot is told zero percent last and the EEPROM
//! holds what it held. And the fit on a drive that is known.

use super::*;
use fw_core::eeprom::{first_board, Image};
use host_link::board_io::BoardIo;
use host_link::error::Error;
use host_link::mock_board::{mock_board, IoFault, MockBoard};
use host_link::samples::{Sample, SampleRecorder};
use host_link::session::Session;
use host_link::settings::Settings;
use std::panic::{catch_unwind, AssertUnwindSafe};

fn original() -> Image {
    Settings {
        config: first_board(),
        platform_page: true,
    }
    .image()
}

fn plan() -> step_response::StepPlan {
    step_response::StepPlan {
        levels: vec![50.0, 100.0],
        hold_s: 0.5,
        rest_s: 0.3,
        travel: 300.0,
    }
}

fn tune(io: &mut BoardIo, plan: &step_response::StepPlan) -> Result<SampleRecorder, Error> {
    temporary_mode::with_mode(
        io,
        &original(),
        Mode::TuneRotate,
        None,
        100,
        |io, config| {
            let mut session = Session::with_config(io, config, 40);
            step_response::run(&mut session, plan, |_| {})
        },
    )
}

#[track_caller]
fn assert_as_before(board: &MockBoard, fault: Option<IoFault>) {
    assert!(board.memory == original(), "EEPROM after {fault:?}");
    assert!(
        board.protected && !board.selected && !board.in_reset,
        "{fault:?}"
    );
    if let Some(last) = board.commands.last() {
        assert_eq!(last.percent.0, 0, "{fault:?}");
    }
}

fn calls() -> usize {
    let (board, mut io) = mock_board(&original(), None);
    tune(&mut io, &plan()).unwrap();
    let calls = board.borrow().calls;
    calls
}

#[test]
fn steps_give_the_drive_of_the_doubles() {
    let (board, mut io) = mock_board(&original(), None);
    let recorder = tune(&mut io, &plan()).unwrap();
    assert_as_before(&board.borrow(), None);
    let steps = drive_model::steps(recorder.samples());
    assert_eq!(
        steps.iter().map(|step| step.percent).collect::<Vec<_>>(),
        [50.0, -50.0, 100.0, -100.0]
    );
    let model = drive_model::fit(&steps).unwrap();
    assert!((model.gain - 2.0).abs() < 0.02, "{model:?}");
    assert!((model.dead_zone - 20.0).abs() < 0.5, "{model:?}");
    assert!((model.lag_s - 0.15).abs() < 0.003, "{model:?}");
}

#[test]
fn ctrl_c_anywhere_stops_the_robot_and_restores_the_mode() {
    for at in (0..calls()).step_by(3) {
        let fault = Some(IoFault::Interrupt(at));
        let (board, mut io) = mock_board(&original(), fault);
        let outcome = tune(&mut io, &plan());
        assert_as_before(&board.borrow(), fault);
        // Once the steps are over there is nothing left to interrupt.
        assert!(
            matches!(outcome, Ok(_) | Err(Error::Interrupted)),
            "{fault:?}"
        );
    }
}

#[test]
fn a_panic_anywhere_stops_the_robot_and_restores_the_mode() {
    // Not in the way back itself: a panic while a panic is handled ends the process.
    for at in (0..calls() - 150).step_by(3) {
        let fault = Some(IoFault::Panic(at));
        let (board, mut io) = mock_board(&original(), fault);
        let outcome = catch_unwind(AssertUnwindSafe(|| tune(&mut io, &plan())));
        assert!(outcome.is_err(), "{fault:?}");
        assert_as_before(&board.borrow(), fault);
    }
}

#[test]
fn one_failing_call_anywhere_is_survived_or_stops_the_robot() {
    for at in (0..calls()).step_by(3) {
        let fault = Some(IoFault::FailOnce(at));
        let (board, mut io) = mock_board(&original(), fault);
        let _ = tune(&mut io, &plan());
        assert!(board.borrow().memory == original(), "{fault:?}");
        assert!(board.borrow().protected && !board.borrow().selected);
    }
}

#[test]
fn buses_that_die_leave_an_error_that_says_so() {
    for at in (0..calls()).step_by(7) {
        let (board, mut io) = mock_board(&original(), Some(IoFault::BusesFail(at)));
        let outcome = tune(&mut io, &plan());
        let board = board.borrow();
        assert!(board.protected && !board.selected && !board.in_reset);
        if board.memory != original() {
            assert!(matches!(outcome, Err(Error::NotRestored { .. })), "{at}");
        }
    }
}

#[test]
fn a_killed_tuning_is_repaired_but_what_was_written_since_stays() {
    let path = std::env::temp_dir().join(format!("host-link-note-{}", std::process::id()));
    let note = host_link::eeprom::journal::Journal::new(&path);
    let guard =
        temporary_mode::edit_config(&original(), |config| config.mode = Mode::TuneMove).unwrap();
    let newer =
        temporary_mode::edit_config(&original(), |config| config.mode = Mode::GuardedNormal)
            .unwrap();
    let mut half_written = original();
    half_written[0x0C] = 0x77;
    for (present, repaired) in [(guard, true), (half_written, true), (newer, false)] {
        note.begin(&original()).unwrap();
        let (board, mut io) = mock_board(&present, None);
        assert_eq!(
            temporary_mode::restore_after_kill(&mut io, &note, 100),
            Ok(repaired)
        );
        let expected = if repaired { original() } else { present };
        assert!(board.borrow().memory == expected);
        assert!(!note.unfinished());
        assert_eq!(
            temporary_mode::restore_after_kill(&mut io, &note, 100),
            Ok(false)
        );
    }
}

#[test]
fn a_link_lost_during_a_step_ends_it_within_a_fifth_of_a_second() {
    let (board, mut io) = mock_board(&original(), None);
    board.borrow_mut().garbled_from = 20;
    let outcome = tune(&mut io, &plan());
    assert!(matches!(outcome, Err(Error::Silent { .. })), "{outcome:?}");
    let board = board.borrow();
    assert_as_before(&board, None);
    let under_duty = board
        .commands
        .iter()
        .skip(20)
        .filter(|command| f64::from_bits(command.percent.0) != 0.0)
        .count();
    assert!(under_duty <= 8, "{under_duty}");
}

#[test]
fn without_a_log_there_is_no_step() {
    let (board, mut io) = mock_board(&original(), None);
    board.borrow_mut().log_connected = false;
    let mut plan = plan();
    plan.rest_s = 0.8;
    let outcome = tune(&mut io, &plan);
    assert!(matches!(outcome, Err(Error::Tuning(_))), "{outcome:?}");
    let board = board.borrow();
    assert_as_before(&board, None);
    let moved = |command: &fw_core::wire::Command| f64::from_bits(command.percent.0) != 0.0;
    assert!(!board.commands.iter().any(moved));
}

#[test]
fn a_step_ends_at_its_travel() {
    let (board, mut io) = mock_board(&original(), None);
    let plan = step_response::StepPlan {
        travel: 20.0,
        hold_s: 2.0,
        ..plan()
    };
    let recorder = tune(&mut io, &plan).unwrap();
    for step in drive_model::steps(recorder.samples()) {
        let furthest = step.way.last().unwrap().1.abs();
        // A frame's delay at full speed.
        assert!(furthest < 20.0 + 160.0 * 0.05, "{furthest}");
    }
    assert_as_before(&board.borrow(), None);
}

#[test]
fn plans_that_are_not_safe_are_refused() {
    let refused = |plan: step_response::StepPlan| assert!(plan.check().is_err(), "{plan:?}");
    refused(step_response::StepPlan {
        hold_s: 10.0,
        ..plan()
    });
    refused(step_response::StepPlan {
        hold_s: f64::NAN,
        ..plan()
    });
    refused(step_response::StepPlan {
        travel: f64::INFINITY,
        ..plan()
    });
    refused(step_response::StepPlan {
        levels: vec![50.0, 120.0],
        ..plan()
    });
    refused(step_response::StepPlan {
        levels: vec![50.0, f64::NAN],
        ..plan()
    });
    refused(step_response::StepPlan {
        levels: vec![50.0],
        ..plan()
    });
}

/// Steps of a known drive, with noise of ±`noise`.
fn synthetic(gain: f64, dead_zone: f64, lag: f64, noise: f64) -> Vec<Sample> {
    let known = drive_model::DriveModel {
        gain,
        dead_zone,
        lag_s: lag,
        residual: 0.0,
        steps: 0,
    };
    let (mut samples, mut tick, mut at) = (Vec::new(), 0_u32, 0.0);
    let mut seed = 1_u32;
    let mut scatter = move || {
        seed = seed.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        (f64::from(seed) / f64::from(u32::MAX) - 0.5) * 2.0 * noise
    };
    for percent in [50.0, -50.0, 75.0, -75.0, 100.0, -100.0] {
        for _ in 0..30 {
            samples.push(Sample {
                tick,
                percent: 0.0,
                value: at,
            });
            tick += 1;
        }
        let from = at;
        for since in 0..120_u32 {
            at = from + known.step_way(percent, f64::from(since) * 0.01) + scatter();
            samples.push(Sample {
                tick,
                percent,
                value: at,
            });
            tick += 1;
        }
    }
    samples
}

#[test]
fn the_fit_recovers_known_drives() {
    for (gain, dead_zone, lag) in [
        (1.73, 20.1, 0.144),
        (1.89, 20.1, 0.146),
        (5.0, 0.0, 0.05),
        (0.3, 45.0, 0.4),
    ] {
        let model =
            drive_model::fit(&drive_model::steps(&synthetic(gain, dead_zone, lag, 0.0))).unwrap();
        assert!((model.gain / gain - 1.0).abs() < 1e-3, "{model:?}");
        assert!((model.dead_zone - dead_zone).abs() < 0.05, "{model:?}");
        assert!((model.lag_s / lag - 1.0).abs() < 1e-3, "{model:?}");
        let model =
            drive_model::fit(&drive_model::steps(&synthetic(gain, dead_zone, lag, 0.1))).unwrap();
        assert!((model.gain / gain - 1.0).abs() < 0.05, "noisy: {model:?}");
        assert!((model.lag_s / lag - 1.0).abs() < 0.1, "noisy: {model:?}");
    }
}

#[test]
fn lost_samples_cost_the_fit_nothing() {
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
fn what_is_no_drive_is_refused_with_a_reason() {
    assert!(drive_model::fit(&[]).is_err());
    let still: Vec<Sample> = synthetic(1.73, 20.1, 0.144, 0.0)
        .into_iter()
        .map(|sample| Sample {
            value: 3.0,
            ..sample
        })
        .collect();
    assert!(drive_model::fit(&drive_model::steps(&still))
        .unwrap_err()
        .contains("moved"));
    let reversed: Vec<Sample> = synthetic(1.73, 20.1, 0.144, 0.0)
        .into_iter()
        .map(|sample| Sample {
            value: -sample.value,
            ..sample
        })
        .collect();
    assert!(drive_model::fit(&drive_model::steps(&reversed)).is_err());
    let nonsense: Vec<Sample> = synthetic(1.73, 20.1, 0.144, 500.0);
    assert!(drive_model::fit(&drive_model::steps(&nonsense)).is_err());
}

#[test]
fn proposed_gains_settle_with_the_overshoot_of_their_damping() {
    for axis in [Axis::Rotate, Axis::Move] {
        for (gain, lag) in [(1.0, 0.1), (1.8, 0.15), (3.0, 0.2)] {
            let model = drive_model::DriveModel {
                gain,
                dead_zone: 20.0,
                lag_s: lag,
                residual: 0.0,
                steps: 6,
            };
            let present = first_board().rotation;
            let proposed = gains::propose(&model, axis.damping(), &present);
            assert_eq!(proposed.anti_windup, present.anti_windup);
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
fn the_battery_s_resistor_comes_from_the_log() {
    let (board, mut io) = mock_board(&original(), None);
    let mut session = Session::open(&mut io, 40, 100).unwrap();
    assert_eq!(
        battery::measure_upper_resistor(&mut session, 2, 3.7),
        Ok(33_120)
    );
    let asked = board.borrow().commands.last().unwrap().tune;
    assert_eq!((asked.cell, asked.voltage), (1, 740));
    for (cell, volts) in [(0, 3.7), (3, 3.7), (1, 0.0), (1, 41.0), (1, f64::NAN)] {
        assert!(matches!(
            battery::measure_upper_resistor(&mut session, cell, volts),
            Err(Error::Usage(_))
        ));
    }
    board.borrow_mut().log_connected = false;
    let mute = battery::measure_upper_resistor(&mut session, 1, 3.7);
    assert!(matches!(mute, Err(Error::Tuning(_))), "{mute:?}");
}
