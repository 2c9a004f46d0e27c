//! What must hold whatever happens: silence, a low supply, an empty battery, a reset, a bridge's dead time.

use fw_core::eeprom::{Image, fields};
use fw_core::robot::leds;
use fw_core::wire::State;
use robot_tests::reference::{NormalReply, normal_frame, original_image};
use robot_tests::test_board::{BRIDGES, ELF, Rig, ahead, elf, take_writes};
use twin::plant::{Room, Sides};
use twin::trace::functions;
use twin::{Board, Options};

// Requirement: DOC-2.1-3, WIRE-status-6, WIRE-deadline-1, WIRE-deadline-2
#[test]
fn stop_deadline_silent_host_brakes() {
    let rig = Rig::driving();
    assert_eq!(rig.leds(), leds(State::Moving));
    for (compare, ..) in BRIDGES {
        rig.trace_writes(compare);
    }
    let silent_since = rig.now_us();
    assert!(rig.run_until(400_000, 500, |_| rig.motors_off()));
    let after = rig.now_us() - silent_since;
    assert!((230_000..=261_000).contains(&after), "{after} µs");
    rig.run_us(10_000);
    // Above the reload: both enables stay high.
    let writes = take_writes(&rig);
    let braked = writes.last_chunk::<2>().expect("both enables");
    assert_eq!(braked.map(|write| write.value), [5_000; 2]);
    rig.run_us(1_000_000);
    assert!(rig.motors_off());
    let speed = rig.max_wheel_deg_s();
    assert!(speed < 0.1, "{speed} deg/s");
    rig.assert_logged("stop");
    assert_eq!(rig.leds(), leds(State::Stopped));
    let _ = rig.keep_sending(&ahead(), 300_000);
    assert!(!rig.motors_off(), "a frame with the apply bit resumes");
    // Frames that are rejected do not count.
    let since = rig.now_us();
    while rig.now_us() - since < 300_000 {
        let _ = rig.frame(&[0xA5; 19]);
        rig.run_us(5_000);
    }
    assert!(rig.motors_off());
}

/// The robot's handler is held off until it finds both a frame and the tick at which the deadline has passed.
// Requirement: WIRE-deadline-1
#[test]
fn frame_and_late_tick_waiting_together_are_handled_by_age() {
    let rig = Rig::driving();
    let all = functions(&elf(ELF)).expect("an ELF file");
    let handler = all.iter().find(|f| f.name == "PendSV").expect("a handler");
    for (tick_first, wait_us) in [(false, 0), (true, 7_000)] {
        rig.run_to_tick();
        rig.run_us(5_000);
        let _ = rig.frame(&ahead());
        rig.run_us(249_000);
        rig.stall_once(handler.address, 0, 7_000_000);
        rig.run_us(wait_us);
        let _ = rig.frame(&ahead());
        rig.run_us(30_000);
        let stopped = rig.log().contains("no fresh frame in time");
        assert_eq!(stopped, tick_first, "{}", rig.log());
    }
}

/// Nothing moves for as long as the host goes on asking.
fn stays_off(rig: &Rig, line: &str) {
    rig.assert_logged(line);
    assert_eq!(rig.leds(), leds(State::Faulted));
    let _ = rig.keep_sending(&ahead(), 500_000);
    assert!(rig.motors_off());
}

// Requirement: WIRE-fault-14
#[test]
fn supply_below_threshold_stops_motors() {
    let rig = Rig::driving();
    rig.set_supply(2_800);
    let _ = rig.keep_sending(&ahead(), 100_000);
    assert!(!rig.motors_off(), "{}", rig.log());
    rig.set_supply(2_600);
    assert!(rig.run_until(11_000, 100, |_| rig.motors_off()));
    rig.run_us(10_000);
    rig.set_supply(3_300);
    stays_off(&rig, "supply low: motors off");
}

/// Until then the core runs at the 16 MHz of its reset and the watchdog is fed.
// Requirement: WIRE-fault-14
#[test]
fn supply_below_threshold_delays_boot() {
    let rig = Rig::new(Options::with_eeprom(original_image()));
    rig.set_supply(2_600);
    rig.run_us(500_000);
    assert!(!rig.is_ready() && rig.log().is_empty() && rig.resets().is_empty());
    rig.set_supply(3_300);
    rig.assert_ready();
}

/// Between two ticks and over before the next.
// Requirement: WIRE-fault-14
#[test]
fn supply_dip_between_ticks_stops_motors() {
    let rig = Rig::driving();
    rig.run_to_tick();
    rig.run_us(4_000);
    rig.dip_supply(2_800, 1_000);
    rig.run_us(20_000);
    assert!(!rig.motors_off(), "{}", rig.log());
    rig.run_to_tick();
    rig.run_us(4_000);
    rig.dip_supply(2_600, 1_000);
    assert!(!rig.motors_off(), "not before the tick");
    rig.run_us(5_500);
    assert!(rig.motors_off());
    rig.run_us(10_000);
    stays_off(&rig, "supply low: motors off");
}

/// Motors with a twentieth of their speed turn the wheels, but half a metre would take more than a minute.
// Requirement: WIRE-fault-15
#[test]
fn target_that_takes_too_long_stops_motors() {
    let mut options = Options::with_eeprom(original_image());
    let motors = &mut options.params.motors;
    for motor in [&mut motors.left, &mut motors.right] {
        motor.speeds_deg_s = motor.speeds_deg_s.map(|speed| speed / 20.0);
    }
    let rig = Rig::ready(options);
    let go = normal_frame(500_000, 0, 0, true);
    // 10 s, and a metre at 33.5 mm/s.
    let _ = rig.keep_sending(&go, 39_500_000);
    assert!(!rig.motors_off(), "{}", rig.log());
    let _ = rig.keep_sending(&go, 800_000);
    assert!(rig.motors_off());
    stays_off(&rig, "not arrived in time");
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
        let cells = rig.truth().cells_v;
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
        let mut rig = Rig::driving();
        rig.end_check(); // a part without its clock refuses every access
        stop(&rig);
        let _ = rig.keep_sending(&ahead(), 400_000);
        assert!(!rig.motors_off(), "{}", rig.log());
        let _ = rig.keep_sending(&ahead(), 150_000);
        assert!(rig.motors_off());
        stays_off(&rig, "battery empty or unread: motors off");
    }
}

// Requirement: DOC-2.3-2
#[test]
fn bridge_inputs_change_after_dead_time() {
    // The wait is counted in cycles: on the fastest core it is shortest.
    let rig = Rig::with_mips(100, Options::with_eeprom(original_image()));
    rig.drive_off();
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
    let cycles = Rig::registers_after_boot(TIM4_PERIOD).map(|last| last + 1);
    assert_eq!(cycles[0] * cycles[1], 100_000_000 / 20_000);
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
    let [one, other] = rig.truth().cells_v;
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
    let rig = Rig::driving();
    rig.hold_reset(true);
    assert!(rig.motors_off());
    rig.run_us(100_000);
    assert!(!rig.is_ready());
    rig.hold_reset(false);
    rig.assert_ready();
    rig.run_us(100_000);
    assert!(rig.motors_off());
}
