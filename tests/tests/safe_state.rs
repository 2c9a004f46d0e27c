//! The safe state: a panic, a `HardFault`, a missing tick, a dead crystal; and the watchdog.

use fw_core::eeprom::{Image, fields};
use fw_core::robot::leds;
use fw_core::wire::State;
use object::{Object, ObjectSection, ObjectSymbol};
use robot_tests::reference::original_image;
use robot_tests::stack::Stack;
use robot_tests::test_board::{
    ELF, ELF_OVERFLOW, ELF_PANIC, Rig, TIM5_CCR1, ahead, elf, elf_of_mortal_crystal, take_writes,
};
use twin::{Options, ResetSource};

// Requirement: WIRE-safe-1
#[test]
fn panic_stops_motors_and_watchdog_restarts() {
    let rig = with_original_image(&elf(ELF_PANIC));
    ends_standing(&rig, "panic");
}

// Requirement: WIRE-safe-1
#[test]
fn stack_overflow_faults_and_stops_motors() {
    let elf = elf(ELF_OVERFLOW);
    let rig = with_original_image(&elf);
    let stack = Stack::paint(&elf, &rig).expect("a stack to paint");
    ends_standing(&rig, "HardFault");
    // It was the stack's end that stopped it: less than one more frame was left.
    let left = stack.bytes() - stack.used(&rig);
    assert!(left < 512, "{left} bytes of the stack are left");
}

// Requirement: WIRE-fault-11, WIRE-safe-1, WIRE-safe-2
#[test]
fn missing_tick_stops_motors_and_restarts() {
    let rig = Rig::driving();
    rig.run_to_tick();
    let stopped = rig.now_us();
    rig.stop_ticks();
    assert!(rig.run_until(31_000, 10, |_| rig.motors_off()));
    let after = rig.now_us() - stopped;
    // The count begins at the tick's end.
    assert!((30_000..=30_200).contains(&after), "{after} µs");
    rig.run_us(10_000);
    rig.assert_logged("no tick, motors off");
    // 68 to 188 ms over the tolerance of its oscillator, which is exact here.
    let after = assert_restarts(&rig, 400_000) - stopped;
    assert!((95_000..=105_000).contains(&after), "{after} µs");
    rig.assert_logged("restarted after a failure");
    // The next reset has its own cause.
    for (is_brown_out, cause) in [(false, "reset by pin"), (true, "brown-out")] {
        let before = rig.uart().len();
        rig.hold_reset(true);
        if is_brown_out {
            rig.brown_out();
        }
        rig.run_us(1_000);
        rig.hold_reset(false);
        rig.run_us(100_000);
        let log = &rig.log()[before..];
        assert!(log.contains(cause), "{log}");
        let is_failure = log.contains("restarted after a failure");
        assert_eq!(is_failure, is_brown_out, "{log}");
    }
}

/// The watchdog resets the robot within so many microseconds, and then it stands; when that was, microseconds.
#[track_caller]
fn assert_restarts(rig: &Rig, within_us: u64) -> u64 {
    assert!(rig.run_until(within_us, 1_000, |board| !board.resets().is_empty()));
    let reset_us = rig.now_us();
    assert_eq!(rig.resets()[0], ResetSource::Watchdog);
    rig.assert_ready();
    assert!(rig.motors_off(), "after the restart it stands");
    rig.run_us(100_000);
    assert!(rig.motors_off(), "after the restart it stands");
    rig.assert_logged("watchdog");
    reset_us
}

/// TIM5's flags.
const TIM5_SR: u64 = 0x4000_0C10;

/// A tick that comes while the handler of its timer clears another flag is served after it.
#[test]
fn tick_within_its_timers_handler_is_not_lost() {
    let rig = Rig::driving();
    rig.trace_memory(&[TIM5_SR], 0..0);
    let _ = rig.keep_sending(&ahead(), 50_000);
    let accesses = rig.take_snapshots();
    let clears = accesses.iter().rfind(|access| access.written);
    let clears = clears.expect("a flag was cleared").instruction;
    rig.trace_writes(TIM5_CCR1);
    // Longer than from the battery's conversion, whichever of the next arrivals it is, to the tick.
    for skip in 0..3 {
        rig.stall_once(clears, skip, 250_000);
        let _ = rig.keep_sending(&ahead(), 200_000);
    }
    // Each is set from the one before, not from when that was served.
    let set = take_writes(&rig);
    let mut pairs = set.windows(2);
    assert!(pairs.all(|two| two[1].value - two[0].value == 10_000));
    let drives = rig.resets().is_empty() && !rig.motors_off();
    assert!(drives, "{}", rig.log());
}

fn with_original_image(elf: &[u8]) -> Rig {
    let options = Options::with_eeprom(original_image());
    Rig::with_elf(elf, options)
}

/// Set and reset registers of the ports, and both motors' enables and inputs and the servo there.
const DRIVEN_PINS: [(u64, u64); 3] = [
    (0x4002_0018, 0x010C),
    (0x4002_0418, 0x0300),
    (0x4002_0818, 0xC000),
];

/// Two seconds after READY the firmware fails on purpose while it drives: the motors go off, the log
/// says `why`, and the watchdog restarts a robot that stands.
fn ends_standing(rig: &Rig, why: &str) {
    rig.assert_ready();
    let ready = rig.now_us();
    let _ = rig.keep_sending(&ahead(), 1_500_000);
    assert!(!rig.motors_off(), "it drives until it fails: {}", rig.log());
    for (port, _) in DRIVEN_PINS {
        rig.trace_writes(port);
    }
    // The host goes on as if nothing had happened.
    while rig.is_ready() {
        let _ = rig.frame(&ahead());
        rig.run_us(2_000);
        assert!(rig.now_us() - ready < 2_100_000, "nothing failed");
    }
    assert!(rig.motors_off(), "READY is low and the motors run");
    assert_eq!(rig.leds(), leds(State::Faulted));
    // Enables, inputs and servo have been set low since the last frame.
    let since = (rig.now_us() - 3_000) * 1000;
    let mut writes = take_writes(rig);
    writes.retain(|write| write.at_ns > since);
    for (port, pins) in DRIVEN_PINS {
        let own = writes.iter().filter(|write| write.address == port);
        let low = own.fold(0, |low, write| low | write.value >> 16);
        assert_eq!(low & pins, pins, "{port:#x}");
    }
    // 87 µs for each letter.
    rig.run_us(5_000);
    rig.assert_logged(why);
    assert_restarts(rig, 300_000);
}

/// The release ELF with other code, half-words, at a function's begin.
fn patched(function: &str, code: &[u16]) -> Vec<u8> {
    let mut elf = elf(ELF);
    patch(&mut elf, function, code);
    elf
}

fn patch(elf: &mut [u8], function: &str, code: &[u16]) {
    let file = object::File::parse(&*elf).expect("an ELF");
    let text = file.section_by_name(".text").expect("code");
    let mut symbols = file.symbols();
    let symbol = symbols.find(|symbol| symbol.name() == Ok(function));
    let offset = (symbol.expect("a function").address() & !1) - text.address();
    let begin = text.file_range().expect("in the file").0;
    let at = usize::try_from(begin + offset).expect("an offset");
    let code: Vec<u8> = code.iter().copied().flat_map(u16::to_le_bytes).collect();
    elf[at..at + code.len()].copy_from_slice(&code);
}

/// A branch to itself.
const ENDLESS: u16 = 0xE7FE;

/// A handler that does not return keeps its priority's others away, but not the safe state's.
// Requirement: WIRE-safe-1
#[test]
fn handler_without_end_is_reported_by_the_safe_state() {
    for handler in ["robot_tick", "EXTI4"] {
        let rig = with_original_image(&patched(handler, &[ENDLESS]));
        rig.assert_ready();
        // Its end is that of a frame.
        let _ = rig.frame(&ahead());
        rig.run_us(40_000);
        assert!(!rig.is_ready(), "{handler}");
        rig.assert_logged("no tick, motors off");
    }
}

/// That of the safe state, whose wait for the watchdog is cut short here, is one; that of other software, as of a
/// debugger after flashing, is none.
// Requirement: WIRE-fault-11, WIRE-safe-2
#[test]
fn reset_by_the_core_is_a_failure_where_the_safe_state_made_it() {
    let mut elf = patched("EXTI4", &[ENDLESS]);
    // `movw` and `movt` of AIRCR's address, `movs` and `movt` of its key with SYSRESETREQ, the store.
    let reset = [
        0xF64E, 0x500C, 0xF2CE, 0x0000, 0x2104, 0xF2C0, 0x51FA, 0x6001,
    ];
    patch(&mut elf, "EXTI0", &reset);
    let polls = 100_000_001_u32.to_le_bytes();
    let mut found = elf
        .windows(4)
        .enumerate()
        .filter(|(_, word)| *word == polls);
    let (Some((at, _)), None) = (found.next(), found.next()) else {
        panic!("the wait is not one word of the ELF");
    };
    elf[at..at + 4].copy_from_slice(&1_000_u32.to_le_bytes());
    let rig = with_original_image(&elf);
    let plug_in = |plugged: bool| rig.set_faults(move |faults| faults.unplugged[1] = !plugged);
    plug_in(false);
    rig.assert_ready();
    for failures in [1, 0] {
        let (resets, before) = (rig.resets().len(), rig.log().len());
        // The end of a frame, or an echo.
        if failures == 1 {
            let _ = rig.frame(&ahead());
        } else {
            plug_in(true);
        }
        assert!(rig.run_until(400_000, 100, |board| board.resets().len() > resets));
        plug_in(false);
        assert_eq!(rig.resets()[resets], ResetSource::Core);
        rig.assert_ready();
        rig.run_us(60_000);
        let log = &rig.log()[before..];
        assert!(log.contains("boot after software reset"), "{log}");
        let logged = log.matches("restarted after a failure").count();
        assert_eq!(logged, failures, "{log}");
    }
}

fn with_crystal_that_dies() -> Rig {
    let rig = with_original_image(&elf_of_mortal_crystal(elf(ELF)));
    rig.assert_ready();
    rig.drive_off();
    rig
}

// Requirement: WIRE-safe-1, WIRE-fault-1
#[test]
fn dead_crystal_stops_motors_and_restarts_on_hsi() {
    let rig = with_crystal_that_dies();
    rig.stop_crystal();
    assert!(rig.run_until(100, 10, |_| rig.motors_off()));
    rig.run_us(10_000);
    assert!(!rig.is_ready());
    // From 16 MHz, at the log's rate.
    rig.assert_logged("crystal failed, motors off");
    assert_restarts(&rig, 300_000);
    rig.assert_logged("internal oscillator");
}

/// The safe state's line is whole although the DMA was sending another one.
// Requirement: WIRE-safe-1
#[test]
fn safe_state_is_reported_in_the_middle_of_a_line() {
    let rig = with_crystal_that_dies();
    let before = rig.uart().len();
    let _ = rig.frame(&[0xA5; 19]);
    assert!(rig.run_until(20_000, 10, |board| board.uart().len() > before + 8));
    rig.stop_crystal();
    rig.run_us(10_000);
    let log = rig.log();
    let ends = log.strip_suffix("\nE: crystal failed, motors off\n");
    let line = &ends.expect(&log)[before..];
    assert!(line.starts_with('W') && !line.contains('\n'), "{line}");
}

/// Each byte waits for the one before, at a rate at which that takes a millisecond.
// Requirement: WIRE-safe-1
#[test]
fn safe_state_is_reported_at_a_slow_rate() {
    let image = Image::FIRST_BOARD.with(fields::LOG_BAUD, 9_600);
    let rig = Rig::configured(image.0.to_vec());
    rig.run_us(500_000);
    let before = rig.board.log().len();
    rig.stop_ticks();
    rig.run_us(70_000);
    let log = rig.board.log();
    let line = &log[before..];
    assert_eq!(line.len(), "\nE: no tick, motors off\n".len());
    assert!(line.windows(2).all(|two| two[1].at - two[0].at > 1_040_000));
}

/// The watchdog's key register (RM0383, 15.4.1), and the key that feeds it.
const IWDG_KR: u64 = 0x4000_3000;
const FEED: u64 = 0xAAAA;

/// Frames and echoes wake the core, but a tick alone has the watchdog fed.
// Requirement: WIRE-safe-2
#[test]
fn watchdog_is_fed_once_a_tick() {
    let rig = Rig::driving();
    rig.trace_writes(IWDG_KR);
    let begin = rig.now_us();
    let _ = rig.keep_sending(&ahead(), 1_000_000);
    let ticks = (rig.now_us() - begin) / 10_000;
    let writes = take_writes(&rig).into_iter();
    let fed = writes.filter(|write| write.value == FEED).count() as u64;
    let once = (ticks..=ticks + 1).contains(&fed);
    assert!(once, "{fed} times in {ticks} ticks");
}
