//! The bring-up firmware on the virtual board: a sound board passes every check of `robot bringup`, and each
//! mistake of the hardware fails exactly its own.

use host_link::board_io::Interrupt;
use pilot::doctor::{Findings, Outcome, bringup};
use pilot::virtual_board::board_io;
use robot_tests::test_board::{ELF_BRINGUP, Rig, elf, near_walls};
use twin::Options;
use twin::plant::Sides;

/// A hand's speed, degrees of a wheel a second.
const HAND_DEG_S: f64 = 90.0;
/// The whole of it, with both waits for a turn by hand.
const LIMIT_US: u64 = 90_000_000;

/// Both wheels.
const BOTH: &[&str] = &["left", "right"];

/// Runs the steps on a board that was spoilt before its power came; turns the wheels of `hands` when asked;
/// exchanges frames at the end. Hands that turn `always` are an encoder's noise.
fn bring_up(options: Options, hands: &[&str], spoil: impl FnOnce(&Rig)) -> (Findings, Rig) {
    let rig = Rig::with_elf(&elf(ELF_BRINGUP), options);
    spoil(&rig);
    let asked = |log: &str, name: &str| {
        let begin = format!("hand turn the {name} wheel");
        log.contains(&begin) && !log.contains(&format!("turned {name}"))
    };
    let linked = |rig: &Rig| rig.log().contains("link frames");
    // Samples after the warning, and those in which a motor runs.
    let (mut warned, mut runs) = (0, 0);
    let ended = rig.run_until(LIMIT_US, 20_000, |_| {
        let log = rig.log();
        warned += u32::from(log.contains("hands off"));
        let is_run = !rig.motors_off() && !log.contains("stack overflows");
        assert!(!is_run || warned >= 145, "{warned}");
        runs += u32::from(is_run);
        let always = hands.contains(&"always");
        let turned = |name| always || hands.contains(&name) && asked(&log, name);
        let turns = |name| HAND_DEG_S * f64::from(u8::from(turned(name)));
        let speeds = Sides::new(turns("left"), turns("right"));
        rig.world(move |world| world.hand_deg_s = speeds);
        linked(&rig)
    });
    assert!(ended, "{}", rig.log());
    // Two motors run and brake, each both ways, for 0.4 s each.
    assert!(runs == 0 || (70..=170).contains(&runs), "{runs}");
    let mut findings = Findings::default();
    let open = |hz| Ok(board_io(&rig.board, hz, Interrupt::new()));
    bringup::exchange(open, 12_000_000, 100, &mut findings).expect("the bus works");
    rig.run_us(1_100_000);
    bringup::judge(&rig.log(), &mut findings);
    assert!(rig.motors_off() && !rig.is_ready());
    // The stack overflows on purpose into what lies below the RAM.
    let is_overflow = |line: &String| line.starts_with("nothing at 0x1f");
    let unmodelled = rig.unmodelled();
    assert!(unmodelled.iter().all(is_overflow), "{unmodelled:#?}");
    (findings, rig)
}

fn sound() -> Options {
    Options::default().in_room(near_walls())
}

fn named(findings: &Findings, outcome: Outcome) -> Vec<&str> {
    let found = findings.0.iter().filter(|one| one.outcome == outcome);
    found.map(|finding| finding.check).collect()
}

// Requirement: WIRE-bringup-1
#[test]
fn bringup_sound_board_passes_every_check() {
    for (spi_prefetch, bytes) in [(1, "1 bytes"), (2, "2 bytes"), (3, "3 bytes")] {
        let options = Options {
            spi_prefetch,
            ..sound()
        };
        let (findings, _) = bring_up(options, BOTH, |_| ());
        assert_eq!(named(&findings, Outcome::Passed).len(), 23, "{findings:#?}");
        assert_eq!(findings.0.len(), 23);
        let prefetch = findings.0.iter().find(|one| one.check == "SPI prefetch");
        let found = &prefetch.expect("judged").found;
        assert!(found.starts_with(bytes), "{found}");
    }
}

// Requirement: WIRE-bringup-1
#[test]
fn bringup_mistake_of_the_hardware_fails_its_check() {
    let mistakes = |expected: &[&str], options: Options, spoil: &dyn Fn(&Rig)| {
        let (findings, _) = bring_up(options, BOTH, |rig| spoil(rig));
        assert_eq!(findings.failed(), expected, "{findings:#?}");
    };
    let mistake =
        |expected: &str, options, spoil: &dyn Fn(&Rig)| mistakes(&[expected], options, spoil);
    for crystal_hz in [0, 12_000_000, 25_000_000] {
        let mut other = sound();
        other.crystal_hz = crystal_hz;
        mistake("crystal", other, &|_| ());
    }
    mistake("brown-out reset", sound(), &|rig| rig.reset_option_bytes());
    mistake("supply", sound(), &|rig| rig.set_supply(2_950));
    let mut open = sound();
    open.params.battery.dividers[1].upper_ohm = f64::INFINITY;
    mistake("battery tap 2", open, &|_| ());
    let mut unfitted = sound();
    unfitted.eeprom = None;
    mistake("EEPROM", unfitted, &|_| ());
    mistake("I2C lines", sound(), &|rig| {
        rig.i2c_bus(|bus, _| bus.sda_held = u32::MAX);
    });
    for (nth, check) in ["front", "right", "left"].into_iter().enumerate() {
        let check = format!("rangefinder {check}");
        mistake(&check, sound(), &|rig| {
            rig.set_faults(move |faults| faults.unplugged[nth] = true);
        });
    }
    mistake("encoder right", sound(), &|rig| {
        rig.set_faults(|faults| faults.dead_encoder.right = true);
    });
    mistake("motor left", sound(), &|rig| {
        rig.set_faults(|faults| faults.jammed.left = true);
    });
    mistakes(&["motor left", "motor right"], sound(), &|rig| {
        rig.set_faults(|faults| faults.crossed_motors = true);
    });
}

// Requirement: WIRE-bringup-1
#[test]
fn bringup_wheels_not_turned_by_hand_motors_stay_off() {
    for hands in [&[][..], &["left"], &["right"]] {
        let (findings, rig) = bring_up(sound(), hands, |_| ());
        assert!(!hands.is_empty() || rig.truth().path_mm < 0.001);
        let skipped = named(&findings, Outcome::Skipped);
        assert_eq!(skipped, ["motor left", "motor right"], "{findings:#?}");
        let resting = BOTH.iter().filter(|name| !hands.contains(name));
        let resting: Vec<_> = resting.map(|name| format!("encoder {name}")).collect();
        assert_eq!(findings.failed(), resting);
    }
    // Inputs that count noise are no hands.
    let (findings, _) = bring_up(sound(), &["always"], |_| ());
    assert_eq!(findings.failed()[0], "encoders at rest", "{findings:#?}");
    let skipped = named(&findings, Outcome::Skipped);
    assert_eq!(skipped, ["motor left", "motor right"], "{findings:#?}");
}
