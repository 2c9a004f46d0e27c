//! What must hold whatever happens: silence, a panic, a dead tick, an empty battery.

use fw_core::eeprom::{Image, fields};
use fw_core::robot::leds;
use fw_core::wire::State;
use object::{Object, ObjectSection};
use robot_tests::reference::{NormalReply, normal_frame, original_image};
use robot_tests::stack::Stack;
use robot_tests::test_board::{ELF, ELF_OVERFLOW, ELF_PANIC, Rig, elf};
use twin::plant::{Room, Sides};
use twin::trace::EventKind;
use twin::{Board, Options, ResetSource};

fn driving() -> Rig {
    let rig = Rig::booted(Some(original_image()));
    drive(&rig);
    rig
}

fn drive(rig: &Rig) {
    let _ = rig.keep_sending(&normal_frame(3_000_000, 0, 0, true), 1_000_000);
    assert!(!rig.motors_off(), "{}", rig.log());
}

// Requirement: DOC-2.1-3, WIRE-status-6, WIRE-deadline-1, WIRE-deadline-2
#[test]
fn stop_deadline_silent_host_brakes() {
    let rig = driving();
    assert_eq!(rig.leds(), leds(State::Moving));
    let silent_since = rig.now_us();
    assert!(rig.run_until(400_000, 500, |_| rig.motors_off()));
    let after = rig.now_us() - silent_since;
    assert!((230_000..=261_000).contains(&after), "{after} µs");
    rig.run_us(1_000_000);
    assert!(rig.motors_off());
    let speed = rig.truth().wheel_deg_s;
    assert!(speed.left.abs().max(speed.right.abs()) < 0.1, "{speed:?}");
    rig.assert_logged("stop");
    assert_eq!(rig.leds(), leds(State::Stopped));
    let _ = rig.keep_sending(&normal_frame(3_000_000, 0, 0, true), 300_000);
    assert!(!rig.motors_off(), "a frame with the apply bit resumes");
}

// Requirement: WIRE-deadline-1
#[test]
fn stop_deadline_ignores_invalid_frames() {
    let rig = driving();
    let since = rig.now_us();
    while rig.now_us() - since < 300_000 {
        let _ = rig.frame(&[0xA5; 19]);
        rig.run_us(5_000);
    }
    assert!(rig.motors_off());
}

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
    let rig = driving();
    let stopped = rig.now_us();
    rig.stop_ticks();
    assert!(rig.run_until(31_000, 100, |_| rig.motors_off()));
    rig.run_us(10_000);
    rig.assert_logged("no tick, motors off");
    let restarted = |board: &Board| !board.resets().is_empty();
    assert!(rig.run_until(400_000, 1_000, restarted));
    // 68 to 188 ms over the tolerance of its oscillator.
    let after = rig.now_us() - stopped;
    assert!(after <= 190_000, "{after} µs");
    assert_eq!(rig.resets()[0].source, ResetSource::Watchdog);
    rig.assert_ready();
    rig.run_us(100_000);
    assert!(rig.motors_off(), "after the restart it stands");
    rig.assert_logged("watchdog");
    let reason = "restarted after a failure";
    rig.assert_logged(reason);
}

/// TIM5's flags.
const TIM5_SR: u64 = 0x4000_0C10;

/// A tick that comes while the handler of its timer clears another flag is served after it.
#[test]
fn tick_within_its_timers_handler_is_not_lost() {
    let rig = driving();
    let target = normal_frame(3_000_000, 0, 0, true);
    rig.trace_memory(&[TIM5_SR], 0..0);
    let _ = rig.keep_sending(&target, 50_000);
    let accesses = rig.take_snapshots();
    let clears = accesses
        .iter()
        .rev()
        .find(|access| access.written.is_some());
    let clears = clears.expect("a flag was cleared").instruction;
    // Longer than from the battery's conversion, whichever of the next arrivals it is, to the tick.
    for skip in 0..3 {
        rig.stall_once(clears, skip, 250_000);
        let _ = rig.keep_sending(&target, 200_000);
    }
    assert!(
        rig.resets().is_empty() && !rig.motors_off(),
        "{}",
        rig.log()
    );
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
    let go = normal_frame(3_000_000, 0, 0, true);
    let ready = rig.now_us();
    let _ = rig.keep_sending(&go, 1_500_000);
    assert!(!rig.motors_off(), "it drives until it fails: {}", rig.log());
    for (port, _) in DRIVEN_PINS {
        rig.trace_writes(port);
    }
    // The host goes on as if nothing had happened.
    while rig.is_ready() {
        let _ = rig.frame(&go);
        rig.run_us(2_000);
        assert!(rig.now_us() - ready < 2_100_000, "nothing failed");
    }
    assert!(rig.motors_off(), "READY is low and the motors run");
    assert_eq!(rig.leds(), leds(State::Faulted));
    // Enables, inputs and servo have been set low since the last frame.
    let since = (rig.now_us() - 3_000) * 1000;
    let events = rig.take_events();
    for (port, pins) in DRIVEN_PINS {
        let low = events.iter().filter(|event| event.at_ns > since);
        let low = low.fold(0, |low, event| match event.kind {
            EventKind::Write { address, value } if address == port => low | value >> 16,
            _ => low,
        });
        assert_eq!(low & pins, pins, "{port:#x}");
    }
    rig.assert_logged(why);
    assert!(rig.run_until(300_000, 1_000, |board| !board.resets().is_empty()));
    assert_eq!(rig.resets()[0].source, ResetSource::Watchdog);
    rig.assert_ready();
    assert!(rig.motors_off(), "after the restart it stands");
    rig.run_us(100_000);
    rig.assert_logged("watchdog");
}

/// Nothing moves for as long as the host goes on asking.
fn stays_off(rig: &Rig, line: &str) {
    rig.assert_logged(line);
    assert_eq!(rig.leds(), leds(State::Faulted));
    let go = normal_frame(3_000_000, 0, 0, true);
    let _ = rig.keep_sending(&go, 500_000);
    assert!(rig.motors_off());
}

// Requirement: WIRE-fault-14
#[test]
fn supply_below_threshold_stops_motors() {
    let rig = driving();
    rig.set_supply(2_800);
    let go = normal_frame(3_000_000, 0, 0, true);
    let _ = rig.keep_sending(&go, 100_000);
    assert!(!rig.motors_off(), "{}", rig.log());
    rig.set_supply(2_600);
    assert!(rig.run_until(11_000, 100, |_| rig.motors_off()));
    rig.set_supply(3_300);
    stays_off(&rig, "supply low: motors off");
}

// Requirement: WIRE-battery-4
#[test]
fn cells_read_the_same_at_any_supply() {
    // Nearly empty: the taps' pins, 2.3 and 2.4 V, stay below every supply.
    let mut options = Options::with_eeprom(original_image());
    options.params.battery.charge = [0.01; 2];
    let rig = Rig::ready(options);
    let stand = normal_frame(0, 0, 0, false);
    for millivolts in [2_600, 3_000, 3_600, 3_300] {
        rig.set_supply(millivolts);
        let _ = rig.keep_sending(&stand, 1_000_000);
        let cells = rig.truth().cells_v();
        for _ in 0..2 {
            let reply = NormalReply::of(&rig.keep_sending(&stand, 25_000));
            let volts = f64::from(reply.voltage) / 200.0;
            let truth = cells[usize::from(reply.cell)];
            let error = volts / truth - 1.0;
            assert!(
                error.abs() < 0.01,
                "{volts} V, truly {truth} V, at {millivolts} mV"
            );
        }
    }
}

// Requirement: WIRE-fault-4
#[test]
fn converter_without_new_words_stops_motors() {
    for stop in [Board::stop_converter, Board::stop_conversions] {
        let mut rig = driving();
        rig.end_check(); // a part without its clock refuses every access
        stop(&rig);
        let go = normal_frame(3_000_000, 0, 0, true);
        let _ = rig.keep_sending(&go, 400_000);
        assert!(!rig.motors_off(), "{}", rig.log());
        let _ = rig.keep_sending(&go, 150_000);
        assert!(rig.motors_off());
        stays_off(&rig, "battery empty: motors off");
    }
}

/// Driving, with the NMI's handler as that of I2C1's errors: the emulated core has no line to its NMI.
fn with_crystal_that_dies() -> Rig {
    let mut elf = elf(ELF);
    let file = object::File::parse(&*elf).expect("an ELF");
    let vectors = file.section_by_name(".vector_table").expect("vectors");
    let at = usize::try_from(vectors.file_range().expect("in the file").0).expect("an offset");
    elf.copy_within(at + 4 * 2..at + 4 * 3, at + 4 * (16 + 32));
    let rig = with_original_image(&elf);
    rig.assert_ready();
    drive(&rig);
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
    assert!(rig.run_until(300_000, 1_000, |board| !board.resets().is_empty()));
    rig.assert_ready();
    rig.run_us(100_000);
    assert!(rig.motors_off(), "after the restart it stands");
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
    let ends: Vec<u64> = rig.board.log()[before..]
        .iter()
        .map(|sent| sent.at)
        .collect();
    assert_eq!(ends.len(), "\nE: no tick, motors off\n".len());
    assert!(ends.windows(2).all(|two| two[1] - two[0] > 1_040_000));
}

/// The watchdog's key register (RM0383, 15.4.1), and the key that feeds it.
const IWDG_KR: u64 = 0x4000_3000;
const FEED: u64 = 0xAAAA;

/// Frames and echoes wake the core, but a tick alone has the watchdog fed.
// Requirement: WIRE-safe-2
#[test]
fn watchdog_is_fed_once_a_tick() {
    let rig = driving();
    rig.trace_writes(IWDG_KR);
    let begin = rig.now_us();
    let _ = rig.keep_sending(&normal_frame(3_000_000, 0, 0, true), 1_000_000);
    let ticks = (rig.now_us() - begin) / 10_000;
    let fed = rig.take_events().into_iter();
    let fed = fed.filter(|event| matches!(event.kind, EventKind::Write { value: FEED, .. }));
    let fed = fed.count() as u64;
    assert!(
        (ticks..=ticks + 1).contains(&fed),
        "{fed} times in {ticks} ticks"
    );
}

// Requirement: DOC-2.3-2
#[test]
fn bridge_inputs_change_after_dead_time() {
    // The wait is counted in cycles: on the fastest core it is shortest.
    let mut options = Options::with_eeprom(original_image());
    options.mips = 100.try_into().expect("not zero");
    let rig = Rig::ready(options);
    drive(&rig);
    rig.trace_bridges();
    for x_um in [-3_000_000, 3_000_000, -3_000_000] {
        let _ = rig.keep_sending(&normal_frame(x_um, 0, 0, true), 1_500_000);
    }
    for changes in rig.take_input_changes() {
        assert!(changes.len() >= 4, "{changes:?}");
    }
}

/// TIM4's prescaler and reload.
const TIM4_PERIOD: [u64; 2] = [0x4000_0828, 0x4000_082C];

/// Inaudible, and within the L298P's 40 kHz.
// Requirement: DOC-2.3-2
#[test]
fn bridge_is_chopped_at_20_khz() {
    let written = Rig::written_at_boot(&TIM4_PERIOD);
    let cycles = TIM4_PERIOD.map(|register| {
        let last = written.iter().rfind(|(address, _)| *address == register);
        last.expect("written").1 + 1
    });
    assert_eq!(cycles[0] * cycles[1], 100_000_000 / 20_000);
}

#[test]
fn empty_battery_stops_for_good() {
    let mut options = Options::with_eeprom(original_image());
    options.params.battery.charge = [0.0; 2];
    let rig = Rig::new(options);
    rig.await_ready();
    let go = normal_frame(3_000_000, 0, 0, true);
    let _ = rig.keep_sending(&go, 2_000_000);
    let taps = rig.truth().battery_v;
    assert!(taps[0] < 3.0, "the model's battery is not empty: {taps:?}");
    assert!(rig.motors_off());
    rig.assert_logged("battery");
    let reply = NormalReply::of(&rig.frame(&go));
    assert!(reply.voltage > 0);
}

/// A robot whose battery warns and cuts off where page 0x03 says, both above what an original EEPROM
/// means, and that lasts for some seconds of driving.
fn on_its_last_charge(warn_mv: u64, cutoff_mv: u64) -> Rig {
    let image = Image::FIRST_BOARD
        .with(fields::BATTERY_WARN, warn_mv)
        .with(fields::BATTERY_CUTOFF, cutoff_mv)
        // At full speed: the load that drains it.
        .with(fields::BLIND_SPEED, 2000);
    let mut options = Options::with_eeprom(image.0.to_vec()).in_room(Room::default());
    options.params.battery.capacity_ah = 0.004;
    options.params.battery.idle_a = 0.05;
    options.params.battery.cell_ohm = 0.15;
    Rig::ready(options)
}

/// The lower cell's voltage.
fn lowest(rig: &Rig) -> f64 {
    let [one, other] = rig.truth().cells_v();
    one.min(other)
}

// Requirement: WIRE-fault-3, WIRE-fault-4, WIRE-platform-10
#[test]
fn battery_warns_and_cuts_off_at_configured_voltages() {
    let (warn, cutoff) = (3.75, 3.65);
    let rig = on_its_last_charge(3750, 3650);
    // Farther than the charge lasts.
    let go = normal_frame(30_000_000, 0, 0, true);
    let (mut below_warn, mut below_cutoff) = (0, 0);
    while !rig.motors_off() || rig.now_us() < 200_000 {
        let _ = rig.keep_sending(&go, 25_000);
        let volts = lowest(&rig);
        below_warn += u32::from(volts < warn);
        below_cutoff += u32::from(volts < cutoff);
        // Half a second below a threshold counts, and the filter takes its time.
        let warned = rig.log().contains("battery low");
        assert!(warned || below_warn < 30, "{volts} V and no warning");
        assert!(!warned || below_warn > 15, "warned at {volts} V");
        assert!(below_cutoff < 30, "{volts} V and still driving");
    }
    assert!(below_cutoff > 15, "stopped at {} V", lowest(&rig));
    rig.assert_logged("battery empty");
    assert!(lowest(&rig) > 3.4, "an original EEPROM would warn too");
    // Without its load the battery is better again, and the Pi goes on asking.
    for x_um in [3_000_000, -1_000_000] {
        let frame = normal_frame(x_um, 0, 0, true);
        for _ in 0..40 {
            let _ = rig.keep_sending(&frame, 25_000);
            assert!(rig.motors_off(), "{}", rig.log());
        }
        assert!(lowest(&rig) > cutoff, "{} V", lowest(&rig));
    }
    assert_eq!(rig.truth().wheel_deg_s, Sides::default());
}

// Requirement: WIRE-ready-3
#[test]
fn reset_while_driving_stops_at_once() {
    let rig = driving();
    rig.hold_reset(true);
    assert!(rig.motors_off());
    rig.run_us(100_000);
    assert!(!rig.is_ready());
    rig.hold_reset(false);
    rig.assert_ready();
    rig.run_us(100_000);
    assert!(rig.motors_off());
}
