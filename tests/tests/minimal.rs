//! The firmware without its optional parts: it does all the rest, and refuses what it lacks in words.

use fw_core::eeprom::{encode, first_board, Config, IMAGE_LEN};
use fw_core::wire::Mode;
use robot_tests::reference::{image_in_mode, normal_frame, original_image, NormalReply, KEY_STM};
use robot_tests::test_board::{elf, Rig, ELF_MINIMAL};
use twin::Options;

fn minimal(image: Vec<u8>) -> Rig {
    let rig = Rig::with_elf(
        &elf(ELF_MINIMAL),
        Options {
            eeprom: Some(image),
            ..Options::default()
        },
    );
    rig.await_ready();
    rig
}

fn image(change: impl FnOnce(&mut Config)) -> Vec<u8> {
    let mut config = first_board();
    change(&mut config);
    let mut image = [0xFF; IMAGE_LEN];
    encode(&config, &mut image);
    image.to_vec()
}

#[test]
fn it_boots_answers_frames_and_drives_to_a_pose() {
    let rig = minimal(original_image());
    assert!(rig.board.is_ready(), "{}", rig.log());
    rig.board.run_us(20_000);
    let reply = NormalReply::of(&rig.frame(&normal_frame(0, 0, 0, false)));
    assert_eq!((reply.key, reply.x, reply.y), (KEY_STM, 0, 0));
    let back = rig.keep_sending(&normal_frame(300_000, 100_000, 0x1000, true), 8_000_000);
    let reply = NormalReply::of(&back);
    let off = f64::from((reply.x - 300_000).abs().max((reply.y - 100_000).abs())) / 1000.0;
    assert!(off < 10.0, "{reply:?}\n{}", rig.log());
    let truth = rig.board.truth();
    assert!(
        (truth.pose.x_mm - 300.0).hypot(truth.pose.y_mm - 100.0) < 15.0,
        "{truth:?}"
    );
    assert!(!rig.log().contains("rejected"), "{}", rig.log());
    rig.assert_modelled();
}

#[test]
fn a_torn_frame_costs_that_frame_alone_and_silence_stops_it() {
    let rig = minimal(image_in_mode(0));
    let frame = normal_frame(2_000_000, 0, 0, true);
    let _ = rig.keep_sending(&frame, 1_000_000);
    assert!(!rig.motors_off());
    let _ = rig.frame(&frame[..7]);
    rig.board.run_us(25_000);
    assert_eq!(NormalReply::of(&rig.frame(&frame)).key, KEY_STM);
    assert!(rig.log().contains("frame too short"), "{}", rig.log());
    rig.board.run_us(300_000);
    assert!(
        rig.log().contains("no fresh frame in time"),
        "{}",
        rig.log()
    );
    assert_eq!(rig.board.truth().duty, (0.0, 0.0));
}

// Requirement: WIRE-refused-8
#[test]
fn a_configuration_that_asks_for_more_is_refused_in_words() {
    type Asks = (&'static str, fn(&mut Config));
    let asks: [Asks; 3] = [
        ("gyro is 1", |config| config.platform.gyro = true),
        ("servo is 1", |config| config.platform.servo = true),
        ("mode is 32", |config| {
            config.mode = Mode::GuardedSweep;
            config.platform.servo = true;
        }),
    ];
    for (told, change) in asks {
        let rig = minimal(image(change));
        let _ = rig.keep_sending(&normal_frame(1_000_000, 0, 0, true), 200_000);
        assert!(!rig.board.is_ready(), "{told}: READY is high");
        assert!(rig.motors_off(), "{told}: the motors run");
        let log = rig.log();
        assert!(
            log.contains("configuration rejected") && log.contains(told),
            "{log}"
        );
        assert!(log.contains("this is the minimal one"), "{log}");
        assert!(rig.board.resets().is_empty());
    }
}
