//! Boot: a good, a blank, a corrupt, an absent EEPROM, a stuck bus, a dead crystal.

use robot_tests::reference::{image_in_mode, normal_frame, original_image, NormalReply, KEY_STM};
use robot_tests::test_board::Rig;
use twin::{I2cController, Options};

/// What every refusal to start must look like, however long one waits and whatever one sends.
fn assert_stays_off(rig: &Rig, why: &str) {
    let frame = normal_frame(1_000_000, 0, 0, true);
    for _ in 0..40 {
        let _ = rig.frame(&frame);
        rig.board.run_us(25_000);
        assert!(!rig.board.is_ready(), "READY is high");
        assert!(rig.motors_off(), "the motors run");
    }
    let log = rig.log();
    assert!(log.contains(why), "the log does not say `{why}`:\n{log}");
    assert!(
        rig.board.resets().is_empty(),
        "waiting is no reason for a reset"
    );
    rig.assert_modelled();
}

// Requirement: DOC-2.1-1, DOC-2.3-1, WIRE-ready-1, WIRE-modes-1, WIRE-eeprom-1
#[test]
fn an_original_eeprom_of_the_first_board_makes_it_ready_within_50_ms() {
    let rig = Rig::booted(Some(original_image()));
    assert!(rig.board.is_ready(), "{}", rig.log());
    assert!(rig.board.now_us() <= 50_000, "{} µs", rig.board.now_us());
    rig.board.run_us(20_000);
    let reply = NormalReply::of(&rig.frame(&normal_frame(0, 0, 0, false)));
    assert_eq!(
        (reply.key, reply.x, reply.y, reply.rotation),
        (KEY_STM, 0, 0, 0)
    );
    assert!(rig.motors_off());
    assert!(
        rig.log().contains("configured, mode Normal"),
        "{}",
        rig.log()
    );
    assert!(!rig.log().contains("internal oscillator"), "{}", rig.log());
    rig.assert_modelled();
}

// Requirement: DOC-5.1.6-2, WIRE-ready-2
#[test]
fn the_keys_are_those_of_the_eeprom() {
    let mut image = original_image();
    (image[0x000A], image[0x000B]) = (0x11, 0xEE);
    let rig = Rig::booted(Some(image));
    assert!(rig.board.is_ready(), "{}", rig.log());
    rig.board.run_us(20_000);
    let mut frame = normal_frame(1_000_000, 0, 0, true);
    let _ = rig.keep_sending(&frame, 100_000);
    assert!(rig.motors_off(), "the first board's key is another one");
    assert!(rig.log().contains("expected 0x11"), "{}", rig.log());
    frame[0] = 0x11;
    let reply = NormalReply::of(&rig.keep_sending(&frame, 100_000));
    assert_eq!(reply.key, 0xEE);
    assert!(!rig.motors_off(), "{}", rig.log());
    // As they were at reset, whatever stands there by now.
    rig.board.i2c_bus(|bus, _| {
        let part = bus.eeprom.as_mut().expect("it is fitted");
        part.bytes_mut()[0x000A..=0x000C].copy_from_slice(&[0x12, 0xED, 1]);
    });
    let reply = NormalReply::of(&rig.keep_sending(&frame, 400_000));
    assert_eq!(reply.key, 0xEE);
    assert!(!rig.motors_off(), "{}", rig.log());
}

// Requirement: DOC-6-1
#[test]
fn the_eeprom_is_read_and_never_written_even_where_nothing_protects_it() {
    let rig = Rig::new(Options {
        eeprom: Some(original_image()),
        ..Options::default()
    });
    let part = |rig: &Rig| {
        rig.board.i2c_bus(|bus, _| {
            let part = bus.eeprom.as_mut().expect("it is fitted");
            part.set_write_protect(false);
            (part.writes(), part.bytes().to_vec())
        })
    };
    let (_, before) = part(&rig);
    assert!(rig.await_ready(), "{}", rig.log());
    // Driving, a cell to be tuned, and a reset on the way.
    let mut frame = normal_frame(300_000, 0, 0, true);
    frame[11..13].copy_from_slice(&720_u16.to_be_bytes());
    let _ = rig.keep_sending(&frame, 1_000_000);
    assert!(rig.log().contains("tuned tap 1"), "{}", rig.log());
    rig.board.hold_reset(true);
    rig.board.run_us(100_000);
    rig.board.hold_reset(false);
    assert!(rig.await_ready(), "{}", rig.log());
    assert_eq!(part(&rig), (0, before));
}

// Requirement: WIRE-ready-1, WIRE-eeprom-3
#[test]
fn a_blank_eeprom_keeps_it_off_and_the_log_says_so() {
    let rig = Rig::booted(Some(Vec::new()));
    assert_stays_off(&rig, "E");
    assert!(rig.log().contains("EEPROM key"), "{}", rig.log());
}

// Requirement: WIRE-ready-1
#[test]
fn no_eeprom_keeps_it_off_and_the_log_says_so() {
    let rig = Rig::booted(None);
    assert_stays_off(&rig, "no configuration");
}

// Requirement: WIRE-eeprom-3, DOC-6-8, DOC-6.0.1-2, DOC-6.0.3-1, WIRE-refused-3, WIRE-refused-4
// Requirement: WIRE-refused-5, WIRE-refused-6, WIRE-refused-7
#[test]
fn every_corrupt_field_is_named_with_its_address() {
    let broken: [(usize, &[u8], &str); 7] = [
        (0x0000, &[0x16], "page 0x00 address 0x00"),
        (0x000C, &[0x07], "page 0x00 address 0x0C"),
        (0x0100, &f64::NAN.to_le_bytes(), "page 0x01 address 0x00"),
        (
            0x0130,
            &f64::INFINITY.to_le_bytes(),
            "page 0x01 address 0x30",
        ),
        (0x0203, &[9], "page 0x02 address 0x03"),
        (0x020C, &[0, 0, 0, 0], "page 0x02 address 0x0C"),
        (0x0210, &[0; 8], "page 0x02 address 0x1"),
    ];
    for (address, bytes, named) in broken {
        let mut image = original_image();
        image[address..address + bytes.len()].copy_from_slice(bytes);
        let rig = Rig::booted(Some(image));
        assert!(!rig.board.is_ready(), "{address:#06x} was accepted");
        rig.board.run_us(50_000);
        assert!(rig.motors_off());
        assert!(
            rig.log().contains("configuration rejected"),
            "{}",
            rig.log()
        );
        assert!(
            rig.log().contains(named),
            "{named} is not named:\n{}",
            rig.log()
        );
    }
}

// Requirement: WIRE-eeprom-2
#[test]
fn a_page_3_whose_crc_is_wrong_keeps_it_off() {
    let mut image = [0xFF; fw_core::eeprom::IMAGE_LEN];
    fw_core::eeprom::encode(&fw_core::eeprom::first_board(), &mut image);
    assert!(Rig::booted(Some(image.to_vec())).board.is_ready());
    image[0x0310] ^= 4;
    let rig = Rig::booted(Some(image.to_vec()));
    assert_stays_off(&rig, "page 0x03 address 0x34");
}

#[test]
fn a_slave_that_holds_the_bus_is_clocked_out_and_the_robot_starts() {
    let rig = Rig::new(Options {
        eeprom: Some(original_image()),
        ..Options::default()
    });
    rig.board.i2c_bus(|bus, _| bus.hold_sda(7));
    assert!(rig.await_ready(), "{}", rig.log());
    assert!(
        rig.log().contains('W'),
        "the log is silent about it:\n{}",
        rig.log()
    );
    rig.assert_modelled();
}

#[test]
fn a_slave_that_never_lets_go_keeps_it_off_and_the_log_says_so() {
    let rig = Rig::new(Options {
        eeprom: Some(original_image()),
        ..Options::default()
    });
    rig.board.i2c_bus(|bus, _| bus.hold_sda(u32::MAX));
    rig.await_ready();
    assert_stays_off(&rig, "no configuration");
}

// Requirement: DOC-2.3-4, DOC-6-6
#[test]
fn while_the_pi_has_the_bus_it_waits_and_starts_when_the_bus_comes_back() {
    let rig = Rig::new(Options {
        eeprom: Some(original_image()),
        ..Options::default()
    });
    rig.board.switch_i2c(I2cController::Pi);
    assert!(!rig.await_ready());
    rig.board.switch_i2c(I2cController::Stm);
    assert!(rig.await_ready(), "{}", rig.log());
}

// Requirement: DOC-2.3-1, WIRE-fault-1
#[test]
fn without_the_crystal_it_runs_from_the_internal_oscillator_and_says_so() {
    let rig = Rig::new(Options {
        eeprom: Some(image_in_mode(0x10)),
        crystal: false,
        ..Options::default()
    });
    assert!(rig.await_ready(), "{}", rig.log());
    rig.board.run_us(20_000);
    assert!(rig.log().contains("internal oscillator"), "{}", rig.log());
    // Guarded Normal: the clock's fault is bit 1 of the status behind key and sequence.
    let reply = rig.frame(&[0; 26]);
    assert_eq!(u16::from_be_bytes([reply[3], reply[4]]) & 0b10, 0b10);
    rig.assert_modelled();
}

#[test]
fn the_same_seed_is_the_same_run() {
    let run = || {
        let rig = Rig::booted(Some(original_image()));
        let reply = rig.keep_sending(&normal_frame(200_000, 100_000, 0x2000, true), 1_500_000);
        (
            rig.board.instructions(),
            rig.board.now_ns(),
            rig.log(),
            reply,
            rig.board.truth(),
        )
    };
    assert_eq!(run(), run());
}
