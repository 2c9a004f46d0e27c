//! With the wheels off the floor: rangefinders, servo and gyroscope at rest, then the wheels.

use super::Findings;
use crate::drive::StopOnDrop;
use crate::tune::step_response::{self, StepPlan};
use crate::tune::{drive_model, temporary_mode};
use fw_core::eeprom::{Config, Image};
use fw_core::types::Faults;
use fw_core::wire::Mode;
use host_link::board_io::BoardIo;
use host_link::eeprom::journal::Journal;
use host_link::error::Error;
use host_link::session::{CommandRequest, Session, VelocityRequest};

/// Names of the checks, in order.
const CHECKS: [&str; 8] = [
    "front rangefinder",
    "right rangefinder",
    "left rangefinder",
    "servo",
    "gyroscope",
    "left wheel",
    "right wheel",
    "dead zones",
];

/// Time at rest, and of one drive, microseconds.
const REST_US: u64 = 3_000_000;
const DRIVE_US: u64 = 1_500_000;
/// Speed of the drives, mm/s: below the one at which the obstacle stop wants fresh ranges.
const SPEED_MM_S: f64 = 60.0;
/// Half the sweep, degrees, and the bearing that it must reach to either side.
const SWEEP_DEG: f64 = 60.0;
const SWEPT_DEG: f64 = 45.0;
/// Largest drift of a gyroscope at rest, turns.
const DRIFT_TURNS: f64 = 0.01;
/// Largest difference of the dead zone from the EEPROM's, percent of duty.
const DEAD_ZONE_ERROR: f64 = 8.0;

/// Skips the checks of a robot that is not fit for them.
pub fn skip(findings: &mut Findings) {
    findings.skip(&CHECKS, "an earlier check failed");
}

/// Changes the mode for the time of the checks. The wheels turn.
///
/// # Errors
/// [`Error::Interrupted`], and what the change of the mode may fail with.
pub fn check(
    io: &mut BoardIo,
    image: &Image,
    rate_hz: u32,
    ready_timeout_ms: u32,
    journal: &Journal,
    findings: &mut Findings,
) -> Result<(), Error> {
    let outcome = temporary_mode::with_modes(io, image, Some(journal), ready_timeout_ms, |modes| {
        let (io, config) = modes.enter(Mode::GuardedVelocity)?;
        if !watch(&mut Session::with_config(io, config, rate_hz), findings)? {
            findings.skip(&["dead zones"], "a wheel does not turn");
            return Ok(());
        }
        let (io, config) = modes.enter(Mode::TuneMove)?;
        check_dead_zones(&mut Session::with_config(io, config, rate_hz), findings)
    });
    outcome.or_else(|error| unfinished(error, findings))
}

/// What was not checked fails with the reason.
fn unfinished(error: Error, findings: &mut Findings) -> Result<(), Error> {
    if matches!(error, Error::Interrupted | Error::NotRestored { .. }) {
        return Err(error);
    }
    let done = |name: &&&str| findings.0.iter().all(|finding| finding.check != **name);
    let open: Vec<_> = CHECKS.iter().filter(done).copied().collect();
    if let Some((first, rest)) = open.split_first() {
        findings.fail(
            first,
            error.to_string(),
            "correct that and run `robot doctor --wheels-up` again",
        );
        findings.skip(rest, "an earlier check ended the run");
    }
    Ok(())
}

/// At rest, then ahead and back; whether both wheels turned.
fn watch(session: &mut Session<'_>, findings: &mut Findings) -> Result<bool, Error> {
    session.resume()?;
    let stopping = StopOnDrop::new(session);
    let session = &mut *stopping.session;
    let config = session.config().clone();
    let mut readings = [0_u32; 3];
    let (mut swept, mut gyro) = ((0.0_f64, 0.0_f64), Vec::new());
    drive(session, 0.0, REST_US, |session| {
        let snapshot = session.snapshot();
        for (count, range) in readings.iter_mut().zip(snapshot.ranges_mm) {
            *count += u32::from(range.is_some());
        }
        let bearing = snapshot.bearing_deg.unwrap_or_default();
        swept = (swept.0.min(bearing), swept.1.max(bearing));
        gyro.extend(snapshot.gyro_turns);
    })?;
    for (sensor, (check, count)) in CHECKS.into_iter().zip(readings).enumerate() {
        if sensor >= usize::from(config.rangefinders()) {
            findings.skip(&[check], "not fitted");
            continue;
        }
        findings.judge(
            check,
            count > 0,
            format!("{count} reports with an echo within 3 s"),
            "hold something flat a metre before it; check trigger, echo and 5 V",
        );
    }
    if config.servo().is_some() {
        findings.judge(
            "servo",
            swept.0 < -SWEPT_DEG && swept.1 > SWEPT_DEG,
            format!(
                "sent from {:.0}° to {:.0}°; nothing reports its angle: look whether it turned",
                swept.0, swept.1
            ),
            "correct servo_travel in the configuration",
        );
    } else {
        findings.skip(&["servo"], "servo = false in the configuration");
    }
    check_gyro(&config, &gyro, findings);
    let start = session.snapshot().pose;
    drive(session, SPEED_MM_S, DRIVE_US, |_| ())?;
    let there = session.snapshot().pose;
    drive(session, 0.0, DRIVE_US / 5, |_| ())?;
    drive(session, -SPEED_MM_S, DRIVE_US, |_| ())?;
    let both = start.zip(there);
    let moved_mm = both.map_or(0.0, |(start, there)| start.distance_mm(there));
    let limited = session.snapshot().obstacle_limited;
    let latched = &session.snapshot().faults;
    let causes = [
        Faults::LEFT_STALLED.union(Faults::LEFT_REVERSED),
        Faults::RIGHT_STALLED.union(Faults::RIGHT_REVERSED),
    ]
    .map(|causes| {
        let names = causes.iter().map(|fault| fault.name);
        names.filter(|name| latched.contains(name)).collect()
    });
    let turned = causes.iter().all(Vec::is_empty);
    for (check, causes) in ["left wheel", "right wheel"].into_iter().zip(causes) {
        const ADVICE: &str = "check motor, bridge and encoder of this wheel, both signs in the configuration, \
            and that each motor is at its own bridge";
        if turned {
            findings.pass(check, format!("it turned ahead and back, {moved_mm:.0} mm"));
        } else if causes.is_empty() {
            findings.skip(&[check], "the other wheel's fault ended the drive");
        } else {
            findings.fail(check, causes.join(", "), ADVICE);
        }
    }
    if turned && moved_mm < 0.5 * SPEED_MM_S {
        let found = format!(
            "only {moved_mm:.0} mm although no wheel is at fault (obstacle stop: {limited})"
        );
        findings.fail(
            "drive",
            found,
            "clear the space ahead and behind, charge the battery",
        );
        return Ok(false);
    }
    Ok(turned)
}

fn check_gyro(config: &Config, angles: &[f64], findings: &mut Findings) {
    const ADVICE: &str = "leave the robot still; check the MPU6050's wires, or write gyro = false";
    match angles {
        _ if !config.gyro() => findings.skip(&["gyroscope"], "gyro = false in the configuration"),
        [first, .., last] => {
            let drift = last - first;
            let found = format!("it drifted by {:.2}° at rest", drift * 360.0);
            findings.judge("gyroscope", drift.abs() < DRIFT_TURNS, found, ADVICE);
        }
        _ => findings.fail("gyroscope", "it has no angle", ADVICE),
    }
}

fn check_dead_zones(session: &mut Session<'_>, findings: &mut Findings) -> Result<(), Error> {
    let plan = StepPlan {
        levels: vec![50.0, 100.0],
        hold_s: 0.8,
        rest_s: 0.6,
        travel: 300.0,
    };
    let [left, right] = [session.config().left(), session.config().right()]
        .map(|wheel| f64::from(wheel.dead_zone.hundredths()) / 100.0);
    let recorder = step_response::run(session, &plan, |_| {})?;
    let model = drive_model::fit(&drive_model::steps(recorder.samples())).map_err(Error::Tuning)?;
    let (measured, stated) = (model.dead_zone, f64::midpoint(left, right));
    findings.judge(
        "dead zones",
        (measured - stated).abs() <= DEAD_ZONE_ERROR,
        format!(
            "{measured:.0} % for both wheels together; the EEPROM has {left} % left, {right} % right"
        ),
        "enter the right dead zones in the configuration, or free the drive train",
    );
    Ok(())
}

/// Frames at a speed for so long; ends early on a fault that keeps the motors off.
fn drive(
    session: &mut Session<'_>,
    forward_mm_s: f64,
    us: u64,
    mut each: impl FnMut(&Session<'_>),
) -> Result<(), Error> {
    let request = CommandRequest {
        velocity: Some(VelocityRequest {
            forward_mm_s,
            sweep_half_width_deg: SWEEP_DEG,
            ..VelocityRequest::default()
        }),
        ..CommandRequest::default()
    };
    let ends_us = session.now_us() + us;
    while session.now_us() < ends_us {
        if let Some(report) = session.exchange(&request)? {
            each(session);
            if report.faults.intersects(Faults::BLOCKING) {
                return Ok(());
            }
        }
    }
    Ok(())
}

#[test]
fn unrestored_robot_is_an_error_and_others_are_findings() {
    let mut findings = Findings::default();
    let (step, cause, first) = ("restoring", "no bus".into(), None);
    let not_restored = Error::NotRestored { step, cause, first };
    assert!(unfinished(not_restored, &mut findings).is_err());
    assert_eq!(unfinished(Error::NotReady(100), &mut findings), Ok(()));
    assert_eq!(findings.failed(), ["front rangefinder"]);
}

#[test]
fn gyroscope_that_drifts_either_way_fails() {
    let image = Image::FIRST_BOARD.with(fw_core::eeprom::fields::GYRO, 1);
    let config = Config::decode(&image).unwrap();
    for (turns, failed) in [(0.009, 0), (0.02, 1), (-0.02, 1)] {
        let mut findings = Findings::default();
        check_gyro(&config, &[0.3, 0.3, 0.3 + turns], &mut findings);
        assert_eq!(findings.failed().len(), failed, "{turns}");
    }
}
