//! `doctor` on the virtual board: a sound robot passes every check, and each fault fails exactly its own.

use fw_core::eeprom::{Image, fields};
use fw_core::wire::Mode;
use host_link::board_io::{BoardIo, IoError};
use host_link::eeprom::journal::Journal;
use pilot::doctor::{Finding, Findings, Outcome, check_board, check_wheels};
use robot_tests::test_board::{Rig, image_with_servo, near_walls};
use twin::Options;
use twin::components::i2c_bus::I2cController;

/// The first board with everything fitted.
fn image() -> Image {
    image_with_servo(Mode::GuardedNormal).with(fields::GYRO, 1)
}

/// The checks of a board that boots with `options` and is then spoilt.
fn findings(options: Options, wheels: bool, spoil: impl FnOnce(&Rig, &mut BoardIo)) -> Findings {
    let rig = Rig::new(options);
    rig.await_ready();
    let mut io = rig.io();
    spoil(&rig, &mut io);
    let mut findings = Findings::default();
    let image = check_board(&mut io, 40, 300, &mut findings).expect("not interrupted");
    // Wheels turn on a sound board only.
    assert_eq!(image.is_some(), findings.failed().is_empty());
    if let (true, Some(image)) = (wheels, image) {
        let folder = tempfile::tempdir().expect("a folder");
        let journal = Journal::new(folder.path().join("before"));
        let before = image.clone();
        check_wheels(&mut io, &image, 40, 300, &journal, &mut findings).expect("restored");
        assert!(!journal.unfinished() && rig.motors_off());
        let after = host_link::eeprom::read(&mut io);
        assert!(after == Ok(before), "the mode is restored");
    }
    findings
}

fn with_image(image: &Image) -> Options {
    Options::with_eeprom(image.0.to_vec()).in_room(near_walls())
}

#[track_caller]
fn assert_fails(expected: &str, findings: &Findings) {
    assert_eq!(findings.failed(), [expected], "{findings:#?}");
    let failed = findings.0.iter().find(|one| one.check == expected);
    assert!(failed.is_some_and(|one| one.advice.is_some()));
}

// Requirement: WIRE-program-4
#[test]
fn doctor_sound_robot_passes_every_check() {
    let findings = findings(with_image(&image()), true, |_, _| ());
    let passed = |one: &Finding| one.outcome == Outcome::Passed;
    assert!(findings.0.iter().all(passed), "{findings:#?}");
    assert_eq!(findings.0.len(), 19, "{findings:#?}");
}

// Requirement: WIRE-program-4
#[test]
fn doctor_fault_of_the_board_fails_its_check() {
    let board = |expected, options, spoil: &dyn Fn(&Rig, &mut BoardIo)| {
        let findings = findings(options, false, |rig, io| spoil(rig, io));
        assert_fails(expected, &findings);
    };
    let sound = || with_image(&image());
    let dead = |_| Err(IoError::new("dead"));
    board("lines", sound(), &|_, io| io.reset = Box::new(dead));
    board("bus switch", sound(), &|rig, io| {
        io.select = Box::new(|_| Ok(()));
        rig.switch_i2c(I2cController::Pi);
    });
    for (check, eeprom) in [("EEPROM", None), ("EEPROM key", Some(Vec::new()))] {
        board(check, Options { eeprom, ..sound() }, &|_, _| ());
    }
    let mut torn = image();
    torn.0[0x100] ^= 4;
    board("configuration", with_image(&torn), &|_, _| ());
    board("READY", sound(), &|_, io| io.ready = Box::new(|| Ok(false)));
    let other_key = image().with(fields::KEY_FROM_STM, 0x11);
    board("link", sound(), &|rig, _| {
        let bytes = other_key.0.to_vec();
        rig.eeprom(move |part| part.bytes_mut()[..bytes.len()].copy_from_slice(&bytes));
    });
    board("log port", sound(), &|_, io| {
        io.log = Box::new(|_| Ok(Vec::new()));
    });
    let slower = || with_image(&image().with(fields::LOG_BAUD, 9600));
    board("firmware", slower(), &|rig, io| {
        let mut wrong = rig.io().log;
        io.log = Box::new(move |_| wrong(115_200));
    });
    assert_eq!(findings(slower(), false, |_, _| ()).failed(), [""; 0]);
    board("firmware", sound(), &|_, io| {
        io.log = Box::new(|_| Ok(b"login:\n".to_vec()));
    });
    let mut slow = sound();
    slow.crystal_hz = 0;
    board("faults", slow, &|_, _| ());
    let mut flat = sound();
    flat.params.battery.charge[1] = 0.02;
    board("battery", flat, &|_, _| ());
    for cells_v in [[3.0, 3.9], [3.6, 4.5]] {
        board("battery", sound(), &|rig, _| {
            rig.set_faults(move |faults| faults.cells_v = Some(cells_v));
        });
    }
}

// Requirement: WIRE-program-4
#[test]
fn doctor_fault_of_the_wheels_fails_its_check() {
    let wheels = |expected: &str, options, spoil: &dyn Fn(&Rig)| {
        assert_fails(expected, &findings(options, true, |rig, _| spoil(rig)));
    };
    let sound = || with_image(&image());
    for (sensor, place) in ["front", "right", "left"].into_iter().enumerate() {
        wheels(&format!("{place} rangefinder"), sound(), &|rig| {
            rig.set_faults(move |faults| faults.missing_echo[sensor] = true);
        });
    }
    let mut unfitted = sound();
    unfitted.mpu = None;
    wheels("gyroscope", unfitted, &|_| ());
    wheels("gyroscope", sound(), &|rig| {
        rig.set_faults(|faults| faults.twist_deg_s = 60.0);
    });
    let short = image().with(fields::SERVO_TRAVEL, 80 * 0x8000 / 180);
    wheels("servo", with_image(&short), &|_| ());
    let walled = near_walls().with_wall(160.0, -800.0, 160.0, 800.0);
    wheels("drive", sound().in_room(walled), &|_| ());
    // Each wheel's error drives the other wheel; the first to turn backwards ends it.
    wheels("right wheel", sound(), &|rig| {
        rig.set_faults(|faults| faults.crossed_motors = true);
    });
    wheels("left wheel", sound(), &|rig| {
        rig.set_faults(|faults| faults.jammed.left = true);
    });
    wheels("right wheel", sound(), &|rig| {
        rig.set_faults(|faults| faults.dead_encoder.right = true);
    });
    let zones = image()
        .with(fields::DEAD_ZONE_LEFT, 3400)
        .with(fields::DEAD_ZONE_RIGHT, 3400);
    wheels("dead zones", with_image(&zones), &|_| ());
}
