//! Tuning end to end: the Pi's steps and fit against the virtual motors, whose figures are known.

use host_link::eeprom;
use host_link::session::Session;
use pilot::tune::{Axis, battery, drive_model, step_response, temporary_mode};
use plant::MotorParams;
use robot_tests::reference::original_image;
use robot_tests::test_board::Rig;
use twin::Options;
use twin::plant::Room;

fn rig() -> Rig {
    Rig::ready(Options::with_eeprom(original_image()).in_room(Room::default()))
}

/// Millimetres of travel per degree of a wheel.
const MM_PER_DEG: f64 = 80.0 * std::f64::consts::PI / 360.0;

/// Mean of both wheels' speeds between 50 and 100 % duty, °/s per %.
fn slope() -> f64 {
    mean(|motor| (motor.speeds_deg_s[2] - motor.speeds_deg_s[0]) / 50.0)
}

/// Of both motors.
fn mean(of: impl Fn(MotorParams) -> f64) -> f64 {
    let left = of(MotorParams::first_board_left());
    f64::midpoint(left, of(MotorParams::first_board_right()))
}

fn tuned(axis: Axis) -> drive_model::DriveModel {
    let rig = rig();
    let mut machine = rig.io();
    let original = eeprom::read(&mut machine).expect("the EEPROM");
    let plan = step_response::StepPlan {
        levels: vec![50.0, 75.0, 100.0],
        hold_s: 1.2,
        rest_s: 0.8,
        travel: axis.default_travel(),
    };
    let recorder = temporary_mode::with_modes(&mut machine, &original, None, 1000, |modes| {
        let (machine, config) = modes.enter(axis.mode())?;
        let mut session = Session::with_config(machine, config, 40);
        step_response::run(&mut session, &plan, |_| {})
    })
    .expect("the steps");
    assert!(eeprom::read(&mut machine).expect("the EEPROM") == original);
    assert_eq!(recorder.lost(), 0);
    assert!(rig.motors_off());
    rig.assert_modelled();
    drive_model::fit(&drive_model::steps(recorder.samples())).expect("a model")
}

// Requirement: DOC-5.2.2-2, DOC-5.2.3-4, WIRE-log-8
#[test]
fn tuning_identifies_motor_gain_and_lag() {
    let lag = mean(|motor| motor.lag_s);
    // Both wheels turn the robot: 125 mm of track.
    let turning = slope() * MM_PER_DEG * 2.0 / 125.0 * 180.0 / std::f64::consts::PI;
    for (axis, expected) in [(Axis::Rotate, turning), (Axis::Move, slope() * MM_PER_DEG)] {
        let model = tuned(axis);
        // The supply is not the nominal one, and the curve bends at 75 %.
        let ratio = model.gain / expected;
        assert!((0.9..1.25).contains(&ratio), "{axis:?}: {ratio} {model:?}");
        assert!((model.lag_s / lag - 1.0).abs() < 0.1, "{axis:?}: {model:?}");
        assert!((12.0..24.0).contains(&model.dead_zone), "{model:?}");
    }
}

// Requirement: DOC-5.1.3-4, WIRE-battery-2
#[test]
fn tuning_battery_proposes_resistor() {
    let rig = rig();
    let mut machine = rig.io();
    let mut session = Session::open(&mut machine, 40, 1000).expect("a session");
    for _ in 0..40 {
        let standing = host_link::session::CommandRequest::default();
        session.exchange(&standing).expect("a frame");
    }
    let shown = session.snapshot().cells_v[0].expect("cell 1");
    let divider = session.config().dividers()[0];
    let reference = shown * 0.9;
    let ohm = battery::measure_upper_resistor(&mut session, 1, reference).expect("a proposal");
    let whole = f64::from(divider.upper.0) + f64::from(divider.lower.0);
    let expected = whole * 0.9 - f64::from(divider.lower.0);
    // The ADC's noise and the wire's 5 mV.
    assert!((f64::from(ohm) - expected).abs() < 150.0, "{ohm}");
}
