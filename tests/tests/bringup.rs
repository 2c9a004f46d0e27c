//! The bring-up firmware on the virtual board: a sound board passes every check of `robot bringup`, and each
//! mistake of the hardware fails exactly its own.

use host_link::board_io::Interrupt;
use host_link::link::SETUP_NS;
use pilot::doctor::{Findings, Outcome, bringup};
use pilot::virtual_board::board_io;
use robot_tests::test_board::{ELF_BRINGUP, Rig, elf, near_walls};
use std::collections::BTreeSet;
use twin::Options;
use twin::components::mpu6050::Mpu6050Fault;
use twin::plant::{Faults, Sides};

/// A hand's speed, degrees of a wheel a second.
const HAND_DEG_S: f64 = 90.0;
/// The whole of it, with both waits for a turn by hand.
const LIMIT_US: u64 = 90_000_000;

/// Both wheels.
const BOTH: &[&str] = &["left", "right"];

/// What the wires do to a frame: whether it goes to the STM, its bytes, and the wait behind chip-select, ns.
type Wires = fn(bool, &mut [u8], u32);
/// Wires without a fault.
const WHOLE: Wires = |_, _, _| ();

/// Runs the steps on a board that was spoilt before its power came; turns the wheels of `hands` when asked;
/// exchanges frames over `wires` at the end. Hands that turn `always` or `at rest` are an encoder's noise.
fn bring_up(
    options: Options,
    hands: &[&str],
    wires: Wires,
    spoil: impl FnOnce(&Rig),
) -> (Findings, Rig) {
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
        let resting = hands.contains(&"at rest") && !log.contains("rest counts");
        let noise = resting || hands.contains(&"always");
        let turned = |name| noise || hands.contains(&name) && asked(&log, name);
        let turns = |name| HAND_DEG_S * f64::from(u8::from(turned(name)));
        let speeds = Sides::new(turns("left"), turns("right"));
        rig.world(move |world| world.hand_deg_s = speeds);
        linked(&rig)
    });
    assert!(ended, "{}", rig.log());
    // Two motors run and brake, each both ways, for 0.4 s each.
    assert!(runs == 0 || (70..=170).contains(&runs), "{runs}");
    let mut findings = Findings::default();
    let open = |hz| {
        let mut io = board_io(&rig.board, hz, Interrupt::new());
        let mut spi = io.spi;
        io.spi = Box::new(move |out, back, wait_ns| {
            let mut out = out.to_vec();
            wires(true, &mut out, wait_ns);
            spi(&out, back, wait_ns)?;
            wires(false, back, wait_ns);
            Ok(())
        });
        Ok(io)
    };
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

/// What a board of other parts gives.
fn parts(change: impl FnOnce(&mut Options)) -> Findings {
    let mut parts = sound();
    change(&mut parts);
    bring_up(parts, BOTH, WHOLE, |_| ()).0
}

/// What a board that was spoilt before its power came gives.
fn spoilt(spoil: impl FnOnce(&Rig)) -> Findings {
    bring_up(sound(), BOTH, WHOLE, spoil).0
}

/// What a board with a fault gives.
fn faulty(change: impl FnOnce(&mut Faults) + Send + 'static) -> Findings {
    spoilt(|rig| rig.set_faults(change))
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
        let (findings, _) = bring_up(options, BOTH, WHOLE, |_| ());
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
    let mut seen = BTreeSet::new();
    let mut fails = |checks: &[&'static str], findings: Findings| {
        assert_eq!(findings.failed(), checks, "{findings:#?}");
        seen.extend(checks);
    };
    for crystal_hz in [0, 12_000_000, 25_000_000] {
        fails(&["crystal"], parts(|parts| parts.crystal_hz = crystal_hz));
    }
    fails(&["brown-out reset"], spoilt(|rig| rig.reset_option_bytes()));
    fails(&["supply"], spoilt(|rig| rig.set_supply(2_950)));
    for (nth, tap) in ["battery tap 1", "battery tap 2"].into_iter().enumerate() {
        let open =
            |parts: &mut Options| parts.params.battery.dividers[nth].upper_ohm = f64::INFINITY;
        fails(&[tap], parts(open));
    }
    fails(&["EEPROM"], parts(|parts| parts.eeprom = None));
    fails(
        &["I2C lines"],
        spoilt(|rig| rig.i2c_bus(|bus, _| bus.sda_held = u32::MAX)),
    );
    let other = Mpu6050Fault::WrongId(0x71);
    fails(
        &["gyroscope"],
        spoilt(|rig| rig.set_mpu(move |mpu| mpu.fault = other)),
    );
    for (nth, check) in ["rangefinder front", "rangefinder right", "rangefinder left"]
        .into_iter()
        .enumerate()
    {
        fails(&[check], faulty(move |faults| faults.unplugged[nth] = true));
    }
    let (noisy, _) = bring_up(sound(), &["left", "right", "at rest"], WHOLE, |_| ());
    fails(&["encoders at rest"], noisy);
    fails(
        &["encoder left"],
        faulty(|faults| faults.dead_encoder.left = true),
    );
    fails(
        &["encoder right"],
        faulty(|faults| faults.dead_encoder.right = true),
    );
    fails(&["motor left"], faulty(|faults| faults.jammed.left = true));
    fails(
        &["motor right"],
        faulty(|faults| faults.jammed.right = true),
    );
    fails(
        &["motor left", "motor right"],
        faulty(|faults| faults.crossed_motors = true),
    );
    let wires = |wires| bring_up(sound(), BOTH, wires, |_| ()).0;
    let to_stm = wires(|to_stm, bytes, _| bytes[5] ^= u8::from(to_stm));
    fails(&["link at the STM"], to_stm);
    let to_pi = wires(|to_stm, bytes, _| bytes[5] ^= u8::from(!to_stm));
    fails(&["link at the Pi", "chip-select's set-up"], to_pi);
    let early = wires(|to_stm, bytes, wait_ns| bytes[5] ^= u8::from(!to_stm && wait_ns < SETUP_NS));
    fails(&["chip-select's set-up"], early);
    let judged = |log: &str| {
        let mut findings = Findings::default();
        bringup::judge(log, &mut findings);
        findings
    };
    let release = Rig::new(sound());
    release.run_us(100_000);
    release.assert_logged("power-on");
    fails(&["firmware"], judged(&release.log()));
    // The virtual board has no other part, memory below its RAM or longer prefetch: the line is what such a
    // board logs.
    let (whole, rig) = bring_up(sound(), BOTH, WHOLE, |_| ());
    for (check, right, wrong) in [
        ("part", "device 0x431", "device 0x433"),
        ("part", "flash_kb 512", "flash_kb 63"),
        ("stack", "HardFault", "no fault"),
        ("stack", "after watchdog", "after software"),
        ("SPI prefetch", "prefetched 3", "prefetched 4"),
    ] {
        fails(&[check], judged(&rig.log().replace(right, wrong)));
    }
    assert_eq!(seen, whole.0.iter().map(|one| one.check).collect());
}

// Requirement: WIRE-bringup-1
#[test]
fn bringup_wheels_not_turned_by_hand_motors_stay_off() {
    for hands in [&[][..], &["left"], &["right"]] {
        let (findings, rig) = bring_up(sound(), hands, WHOLE, |_| ());
        assert!(!hands.is_empty() || rig.truth().path_mm < 0.001);
        let skipped = named(&findings, Outcome::Skipped);
        assert_eq!(skipped, ["motor left", "motor right"], "{findings:#?}");
        let resting = BOTH.iter().filter(|name| !hands.contains(name));
        let resting: Vec<_> = resting.map(|name| format!("encoder {name}")).collect();
        assert_eq!(findings.failed(), resting);
    }
    // Inputs that count noise are no hands.
    let (findings, _) = bring_up(sound(), &["always"], WHOLE, |_| ());
    assert_eq!(findings.failed()[0], "encoders at rest", "{findings:#?}");
    let skipped = named(&findings, Outcome::Skipped);
    assert_eq!(skipped, ["motor left", "motor right"], "{findings:#?}");
}
