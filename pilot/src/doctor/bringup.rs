//! Judges what the bring-up firmware reports on the log's UART: the bare board part by part, without a
//! configuration and without a Pi.

mod lines;

use super::Findings;
use fw_core::sensing::mpu6050::IDENTITY;
use fw_core::wire::{MAX_FRAME, test_frame};
use host_link::board_io::BoardIo;
use host_link::error::Error;
use host_link::link::{SETUP_NS, transfer};
use lines::Lines;
use std::ops::RangeInclusive;

/// Device code of the STM32F411 (RM0383, 23.6.1).
const DEVICE: u32 = 0x431;
/// Least flash, KiB.
const FLASH_KB: u32 = 64;
/// `BOR_LEV` of level 2, 2.4 V: below that four wait states are too few (RM0383, 3.4.1 and 3.8.6).
const BROWN_OUT_BITS: u32 = 1;
/// The supply at which the voltage reference's calibration word was taken, and what is accepted, millivolts.
const CALIBRATION_MV: u32 = 3_300;
const SUPPLY_MV: RangeInclusive<u32> = 3_130..=3_470;
/// A tap below this is open, and one as near to the supply too high for the converter, millivolts at the pin.
const OPEN_MV: u32 = 320;
const FULL_MV: u32 = 5;
/// Longest echo of an object within 2.5 m, microseconds; without one the line stays high longer.
const ECHO_US: u32 = 15_000;
/// Counts of wheels that stand, and fewest of a motor that runs for 0.4 s.
const REST_COUNTS: u32 = 4;
const MOTOR_COUNTS: u32 = 60;

/// Names of the checks of what is there more than once.
const TAPS: [&str; 2] = ["battery tap 1", "battery tap 2"];
const ON_THE_BUS: [&str; 2] = ["EEPROM", "gyroscope"];
const RANGEFINDERS: [&str; 3] = ["rangefinder front", "rangefinder right", "rangefinder left"];
const ENCODERS: [&str; 2] = ["encoder left", "encoder right"];
const MOTORS: [&str; 2] = ["motor left", "motor right"];

/// Judges the firmware's lines so far.
pub fn judge(log: &str, findings: &mut Findings) {
    let text = |line| str::split_once(line, ": ").map_or(line, |(_, text)| text);
    let lines = Lines(log.lines().map(text).collect());
    let Some(boot) = lines.rest("bringup 1 after ") else {
        let advice = "flash it (`cargo xtask flash --bringup`), connect TX_STM (PA9) and ground, and set the port \
                      to 115200 baud, 8N1; below 2.76 V it waits";
        findings.fail("firmware", "no line of the bring-up firmware", advice);
        for checks in [
            &["crystal", "part", "brown-out reset", "supply"][..],
            &TAPS,
            &["I2C lines"],
            &ON_THE_BUS,
            &RANGEFINDERS,
            &["encoders at rest"],
            &ENCODERS,
            &MOTORS,
            &["stack", "link at the STM"],
        ] {
            findings.skip(checks, "the firmware is not heard");
        }
        return;
    };
    findings.pass("firmware", format!("heard, after {boot}"));
    part(&lines, findings);
    supply(&lines, findings);
    buses(&lines, findings);
    for check in RANGEFINDERS {
        rangefinder(&lines, check, findings);
    }
    wheels(&lines, findings);
    stack(&lines, findings);
    link(&lines, findings);
}

fn part(lines: &Lines, findings: &mut Findings) {
    let khz = lines.number("crystal", "khz").unwrap_or(0);
    let found = match khz {
        0 => "it does not oscillate".into(),
        khz => format!("{khz} kHz against the internal oscillator"),
    };
    findings.judge(
        "crystal",
        // The firmware takes it for its clock if it is one of 8 MHz.
        lines.number("crystal", "use") == Some(1),
        found,
        "fit an 8 MHz crystal with its load capacitors at PH0 and PH1; the firmware falls back to the internal \
         oscillator and reports clock-fallback",
    );
    let [device, flash_kb] = ["device", "flash_kb"].map(|key| lines.number("part", key));
    findings.judge(
        "part",
        device == Some(DEVICE) && flash_kb.is_some_and(|kb| kb >= FLASH_KB),
        lines.rest("part").unwrap_or("not reported").into(),
        "the firmware is for an STM32F411 (device 0x431)",
    );
    let level = lines.number("part", "bor");
    let found = match level {
        Some(bits @ 0..=2) => format!("level {}", 3 - bits),
        _ => "off".into(),
    };
    findings.judge(
        "brown-out reset",
        level.is_some_and(|bits| bits <= BROWN_OUT_BITS),
        found,
        "below 2.4 V the flash reads wrongly and the motors may run: set level 2, `openocd -f interface/stlink.cfg \
         -f target/stm32f4x.cfg -c 'init; reset halt; stm32f2x options_write 0 0xE4; exit'`, and cycle the power",
    );
}

fn supply(lines: &Lines, findings: &mut Findings) {
    let [calibration, reference] =
        ["calibration", "reference"].map(|key| lines.number("supply", key).unwrap_or(0));
    let supply_mv = calibration
        .saturating_mul(CALIBRATION_MV)
        .checked_div(reference)
        .unwrap_or(0);
    let good = SUPPLY_MV.contains(&supply_mv);
    findings.judge(
        "supply",
        good,
        format!("{supply_mv} mV at VDDA by the part's own reference"),
        "check the 3.3 V regulator, VDDA and its filter; 0 means that the converter does not convert",
    );
    if !good {
        findings.skip(&TAPS, "the converter's reference is wrong");
        return;
    }
    let taps = lines
        .rest("supply")
        .and_then(|rest| rest.split_once("taps "));
    let mut words = taps.map_or("", |(_, taps)| taps).split(' ');
    for check in TAPS {
        let word: Option<u32> = words.next().and_then(|word| word.parse().ok());
        // The firmware gives words as they would be at the calibration's supply.
        let pin_mv = word.map(|word| word.saturating_mul(CALIBRATION_MV) / 4095);
        let found = pin_mv.map_or("not converted".into(), |mv| format!("{mv} mV at the pin"));
        findings.judge(
            check,
            pin_mv.is_some_and(|mv| (OPEN_MV..=supply_mv - FULL_MV).contains(&mv)),
            found,
            "connect the battery; check this tap's divider (docs/board.md) and its wire to PA0 or PA1",
        );
    }
}

fn buses(lines: &Lines, findings: &mut Findings) {
    let levels = lines.rest("i2c scl ").unwrap_or("not reported");
    let released = levels.starts_with("1 sda 1");
    findings.judge(
        "I2C lines",
        released,
        format!("SCL {levels}"),
        "SCL (PB6) and SDA (PB7) need pull-ups to 3.3 V; a device without supply holds them low",
    );
    if !released {
        findings.skip(&ON_THE_BUS, "a line of the bus is held low");
        return;
    }
    let scan = lines.rest("i2c found").unwrap_or_default();
    let eeprom = lines.rest("eeprom").unwrap_or("not reported");
    findings.judge(
        "EEPROM",
        eeprom.starts_with("key"),
        match (
            lines.number("eeprom", "key"),
            lines.number("eeprom", "blank"),
        ) {
            (Some(1), _) => "configured".into(),
            (_, Some(1)) => "blank, as new".into(),
            (Some(_), _) => "foreign content".into(),
            _ => format!("{eeprom}; found on the bus: {scan}"),
        },
        "check the AT24C's supply, A0 to A2 at ground (address 0x50), and that SELECT is low",
    );
    match lines.number("gyro", "identity") {
        Some(identity) => findings.judge(
            "gyroscope",
            identity == u32::from(IDENTITY),
            format!("identity {identity:#04x}"),
            "an MPU6050 says 0x68; others are not supported",
        ),
        None if scan.contains("0x68") => findings.fail(
            "gyroscope",
            "0x68 is on the bus and does not say what it is",
            "check its supply and the length of its wires",
        ),
        None => findings.skip(&["gyroscope"], "none fitted: nothing answers at 0x68"),
    }
}

fn rangefinder(lines: &Lines, check: &'static str, findings: &mut Findings) {
    let start = check.replace("rangefinder", "echo");
    let width = lines.number(&start, "us");
    let found = match width {
        Some(us) if us <= ECHO_US => format!("an echo of {us} µs, {} mm", us * 343 / 2000),
        Some(_) => "nothing within 2.5 m".into(),
        None if lines.number(&start, "level") == Some(1) => "no echo; its line is high".into(),
        None => "no echo; its line is low".into(),
    };
    let advice = "check its 5 V, its trigger and its echo; a line that stays high has no pull-down or sees no end";
    findings.judge(check, width.is_some(), found, advice);
}

fn wheels(lines: &Lines, findings: &mut Findings) {
    let rest = lines.counts("rest");
    let rests = |count: &i32| count.unsigned_abs() <= REST_COUNTS;
    let quiet = |counts: [i32; 2]| counts.iter().all(rests);
    findings.judge(
        "encoders at rest",
        rest.is_some_and(quiet),
        rest.map_or("not reported".into(), |[left, right]| {
            format!("{left} and {right} counts in a second")
        }),
        "an open encoder input counts noise: check its supply and both channels",
    );
    for (side, name) in ["left", "right"].into_iter().enumerate() {
        let [encoder, motor] = [ENCODERS[side], MOTORS[side]];
        let Some(turned) = lines.counts(&format!("turned {name}")) else {
            findings.skip(&[encoder, motor], "the wheel has not been turned by hand");
            continue;
        };
        let (own, other) = (turned[side], turned[1 - side]);
        let good = own.unsigned_abs() > other.unsigned_abs().max(REST_COUNTS).saturating_mul(4);
        let down = "down: encoder_reversed = true";
        let up = "up: encoder_reversed = false";
        let sign = if own < 0 { down } else { up };
        let found = if good {
            format!("{own} counts by hand; forward counts {sign}")
        } else {
            format!("{own} counts of its own and {other} of the other wheel's")
        };
        let advice = "one channel dead gives 0, both wheels' plugs swapped count at the other; turn the wheel forward \
                      by a quarter turn when asked";
        findings.judge(encoder, good, found, advice);
        let runs = ["forward", "backward"].map(|way| lines.counts(&format!("motor {name} {way}")));
        let [Some(forward), Some(backward)] = runs else {
            findings.skip(
                &[motor],
                "motors run only after both wheels were turned by hand",
            );
            continue;
        };
        let [ahead, back] = [forward[side], backward[side]];
        let moves = ahead.unsigned_abs().min(back.unsigned_abs()) >= MOTOR_COUNTS;
        let follows = moves && ahead.signum() == own.signum() && back.signum() == -own.signum();
        let apart = forward[1 - side].unsigned_abs() <= REST_COUNTS;
        findings.judge(
            motor,
            follows && apart,
            format!("{ahead} counts forward, {back} backward; the other wheel {}", forward[1 - side]),
            "no counts: check EN, the bridge's supply and the motor; the wrong way: swap its leads or set \
             motor_reversed; the other wheel turns: the plugs are swapped",
        );
    }
}

fn stack(lines: &Lines, findings: &mut Findings) {
    let place = |text: &str| lines.0.iter().position(|line| line.contains(text));
    let Some(begin) = place("stack overflows on purpose") else {
        findings.skip(&["stack"], "not reached");
        return;
    };
    let after = lines.0.get(begin..).unwrap_or_default().join("\n");
    let faulted = after.contains("HardFault, motors off");
    let restarted = after.contains("bringup 1 after watchdog reset");
    let says = |good: bool| if good { "yes" } else { "no" };
    findings.judge(
        "stack",
        faulted && restarted,
        format!(
            "overflow is a HardFault: {}, the watchdog restarts: {}",
            says(faulted),
            says(restarted)
        ),
        "the memory below 0x20000000 must fault; do not drive with this part",
    );
}

fn link(lines: &Lines, findings: &mut Findings) {
    let [frames, good] = ["frames", "good"].map(|key| lines.number("link", key).unwrap_or(0));
    if frames == 0 {
        findings.skip(
            &["link at the STM", "SPI prefetch"],
            "no frames: `robot bringup --link` on the Pi sends them",
        );
        return;
    }
    let found = format!("{good} of {frames} frames whole");
    findings.judge("link at the STM", good == frames, found, LINK_ADVICE);
    let prefetched = lines.number("link", "prefetched");
    findings.judge(
        "SPI prefetch",
        prefetched.is_some_and(|bytes| (1..=3).contains(&bytes)),
        prefetched.map_or("not reported".into(), |bytes| {
            format!("{bytes} bytes of the idle reply")
        }),
        "the reply's refresh relies on three at most; do not drive with this part",
    );
}

const LINK_ADVICE: &str =
    "lower --spi-hz; check ground, and MOSI, MISO, SCK and SS for length and crosstalk";

/// Clocks that are tried below the chosen one, hertz.
const CLOCKS_HZ: [u32; 4] = [1_000_000, 2_000_000, 4_000_000, 8_000_000];
/// The least wait from chip-select to the first clock that the interface allows, nanoseconds.
const LEAST_SETUP_NS: u32 = 60;

/// Exchanges `count` test frames at each clock up to `hz`, with the usual wait behind chip-select and with the
/// least; replies that are not whole fail. `open` gives the bus at a clock.
///
/// # Errors
/// Those of `open`; [`Error::Spi`]; [`Error::Interrupted`].
pub fn exchange(
    open: impl Fn(u32) -> Result<BoardIo, Error>,
    hz: u32,
    count: u32,
    findings: &mut Findings,
) -> Result<(), Error> {
    let lower = CLOCKS_HZ.into_iter().filter(|&lower| lower < hz);
    let clocks: Vec<u32> = lower.chain([hz]).collect();
    let mut good = [Vec::new(), Vec::new()];
    for &hz in &clocks {
        let mut io = open(hz)?;
        for (by_clock, wait_ns) in good.iter_mut().zip([SETUP_NS, LEAST_SETUP_NS]) {
            by_clock.push(whole_replies(&mut io, count, wait_ns)?);
        }
    }
    let checks = ["link at the Pi", "chip-select's set-up"];
    for (check, by_clock) in checks.into_iter().zip(good) {
        let each = clocks.iter().zip(&by_clock);
        let each = each.map(|(&hz, good)| format!("{good} at {} MHz", f64::from(hz) / 1e6));
        let each: Vec<_> = each.collect();
        findings.judge(
            check,
            by_clock.iter().all(|&good| good == count),
            format!("of {count} replies whole: {}", each.join(", ")),
            LINK_ADVICE,
        );
    }
    Ok(())
}

/// Exchanges `count` test frames; the number of whole replies.
fn whole_replies(io: &mut BoardIo, count: u32, wait_ns: u32) -> Result<u32, Error> {
    let mut good = 0;
    for number in 0..count {
        io.interrupt.check()?;
        let (mut frame, mut reply) = ([0; MAX_FRAME], [0; MAX_FRAME]);
        test_frame::encode(number, &mut frame);
        transfer(&mut *io.spi, &frame, &mut reply, wait_ns)?;
        good += u32::from(test_frame::is_whole(&reply));
        (io.delay)(500);
    }
    Ok(good)
}

#[test]
fn motor_that_turns_both_wheels_or_garbled_numbers_fail() {
    let mut findings = Findings::default();
    let log = "bringup 1 after power-on\nturned left counts 500 0\nmotor left forward counts 90 90\n\
               motor left backward counts -90 0\n";
    judge(log, &mut findings);
    assert!(findings.failed().contains(&"motor left"));
    let mut findings = Findings::default();
    let log = "bringup 1 after power-on\nsupply calibration 4294967295 reference 1 taps 4294967295 0\n\
               turned left counts -2147483648 -2147483648\n";
    judge(log, &mut findings);
    assert!(findings.failed().contains(&"supply") && findings.failed().contains(&"encoder left"));
}
