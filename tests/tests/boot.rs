//! Boot: a good, a blank, a corrupt, an absent EEPROM, a stuck bus, a dead crystal.

use fw_core::eeprom::{Image, SPANS, fields};
use fw_core::robot::leds;
use fw_core::wire::State;
use robot_tests::reference::{KEY_STM, NormalReply, image_in_mode, normal_frame, original_image};
use robot_tests::test_board::{ELF, Rig, elf, take_writes};
use twin::components::eeprom::{ADDRESS, Eeprom, WRITE_CYCLE_NS};
use twin::trace::functions;
use twin::{Board, I2cController, Options};

const I2C1_DR: u64 = 0x4000_5410;
const GPIOB_BSRR: u64 = 0x4002_0418;

/// What every refusal to start must look like, however long one waits and whatever one sends.
fn assert_stays_off(rig: &Rig, why: &str) {
    let frame = normal_frame(1_000_000, 0, 0, true);
    for _ in 0..40 {
        let _ = rig.frame(&frame);
        rig.run_us(25_000);
        assert!(!rig.is_ready(), "READY is high");
        assert!(rig.motors_off(), "the motors run");
    }
    rig.assert_logged(why);
    assert_eq!(rig.leds(), leds(State::Faulted));
    assert!(rig.resets().is_empty(), "waiting is no reason for a reset");
    rig.assert_modelled();
}

// Requirement: DOC-2.1-1, DOC-2.3-1, WIRE-ready-1, WIRE-modes-1, WIRE-eeprom-1
#[test]
fn boot_original_eeprom_ready_within_50_ms() {
    let rig = Rig::configured(original_image());
    assert!(rig.now_us() <= 50_000, "{} µs", rig.now_us());
    rig.run_us(20_000);
    let reply = NormalReply::of(&rig.frame(&normal_frame(0, 0, 0, false)));
    assert_eq!((reply.key, reply.rotation), (KEY_STM, 0));
    assert_eq!((reply.x, reply.y), (0, 0));
    assert!(rig.motors_off());
    assert_eq!(rig.leds(), leds(State::Ready));
    let version = env!("CARGO_PKG_VERSION");
    rig.assert_logged(&format!(": firmware {version}, boot after power-on\n"));
    rig.assert_logged("configured, mode Normal");
    assert!(!rig.log().contains("internal oscillator"), "{}", rig.log());
    rig.assert_modelled();
}

// Requirement: DOC-5.1.6-2, WIRE-ready-2
#[test]
fn boot_keys_come_from_eeprom() {
    let mut image = original_image();
    (image[0x000A], image[0x000B]) = (0x11, 0xEE);
    let rig = Rig::configured(image);
    rig.run_us(20_000);
    let mut frame = normal_frame(1_000_000, 0, 0, true);
    let _ = rig.keep_sending(&frame, 100_000);
    assert!(rig.motors_off(), "the first board's key is another one");
    rig.assert_logged("expected 0x11");
    frame[0] = 0x11;
    let reply = NormalReply::of(&rig.keep_sending(&frame, 100_000));
    assert_eq!(reply.key, 0xEE);
    assert!(!rig.motors_off(), "{}", rig.log());
    // As they were at reset, whatever stands there by now.
    rig.eeprom(|part| part.bytes_mut()[0x000A..=0x000C].copy_from_slice(&[0x12, 0xED, 1]));
    let reply = NormalReply::of(&rig.keep_sending(&frame, 400_000));
    assert_eq!(reply.key, 0xEE);
    assert!(!rig.motors_off(), "{}", rig.log());
}

// Requirement: DOC-6-1
#[test]
fn boot_eeprom_is_never_written() {
    let rig = Rig::new(Options::with_eeprom(original_image()));
    let part = |rig: &Rig| {
        rig.eeprom(|part| {
            part.write_protected = false;
            (part.writes(), part.bytes().to_vec())
        })
    };
    let (_, before) = part(&rig);
    rig.assert_ready();
    // Driving, a cell to be tuned, and a reset on the way.
    let mut frame = normal_frame(300_000, 0, 0, true);
    frame[11..13].copy_from_slice(&720_u16.to_be_bytes());
    let _ = rig.keep_sending(&frame, 1_000_000);
    rig.assert_logged("tuned tap 1");
    rig.hold_reset(true);
    rig.run_us(100_000);
    rig.hold_reset(false);
    rig.assert_ready();
    assert_eq!(part(&rig), (0, before));
}

/// RESET goes low while the core stands still for another reason, which ends meanwhile.
#[test]
fn reset_outlasts_a_standstill_of_the_core() {
    let rig = Rig::ready(Options::with_eeprom(original_image()));
    let all = functions(&elf(ELF)).expect("an ELF file");
    let handler = all.iter().find(|f| f.name == "PendSV").expect("a handler");
    rig.stall_once(handler.address, 0, 15_000_000);
    rig.run_us(12_000);
    rig.hold_reset(true);
    let before = rig.instructions();
    rig.run_us(20_000);
    assert_eq!(rig.instructions(), before);
    rig.hold_reset(false);
    rig.assert_ready();
}

// Requirement: WIRE-ready-1, WIRE-eeprom-3
#[test]
fn boot_blank_eeprom_stays_off_and_logs() {
    let absent = "no configuration: EEPROM 0x50 does not answer";
    for (eeprom, why) in [(Some(Vec::new()), "EEPROM key"), (None, absent)] {
        assert_stays_off(&Rig::booted(eeprom), why);
    }
}

// Requirement: WIRE-eeprom-3, DOC-6-8, DOC-6.0.1-2, DOC-6.0.3-1, WIRE-refused-3, WIRE-refused-4
// Requirement: WIRE-refused-5, WIRE-refused-6, WIRE-refused-7
#[test]
fn boot_corrupt_field_is_rejected_with_address() {
    let infinity = f64::INFINITY.to_le_bytes();
    let broken: [(usize, &[u8], &str); 7] = [
        (0x0000, &[0x16], "page 0x00 address 0x00"),
        (0x000C, &[0x07], "page 0x00 address 0x0C"),
        (0x0100, &f64::NAN.to_le_bytes(), "page 0x01 address 0x00"),
        (0x0130, &infinity, "page 0x01 address 0x30"),
        (0x0203, &[9], "page 0x02 address 0x03"),
        (0x020C, &[0, 0, 0, 0], "page 0x02 address 0x0C"),
        (0x0210, &[0; 8], "page 0x02 address 0x1"),
    ];
    for (address, bytes, named) in broken {
        let mut image = original_image();
        image[address..address + bytes.len()].copy_from_slice(bytes);
        let rig = Rig::booted(Some(image));
        assert!(!rig.is_ready(), "{address:#06x} was accepted");
        rig.run_us(50_000);
        assert!(rig.motors_off());
        rig.assert_logged("configuration rejected");
        rig.assert_logged(named);
    }
}

// Requirement: WIRE-eeprom-2
#[test]
fn boot_wrong_page_3_crc_stays_off() {
    let mut image = Image::FIRST_BOARD.0.to_vec();
    assert!(Rig::booted(Some(image.clone())).board.is_ready());
    image[0x0310] ^= 4;
    let rig = Rig::booted(Some(image));
    assert_stays_off(&rig, "page 0x03 address 0x4E");
}

#[test]
fn boot_warns_of_cells_without_taps() {
    for cells in [2, 3] {
        let image = Image::FIRST_BOARD
            .with(fields::CELLS, cells)
            .with(fields::TAP_3_UPPER, 33_000)
            .with(fields::TAP_3_LOWER, 10_000);
        let rig = Rig::configured(image.0.to_vec());
        rig.run_us(20_000);
        let warned = rig.log().contains("more cells than this board has taps");
        assert_eq!(warned, cells > 2, "{}", rig.log());
    }
}

/// A part in its write cycle does not acknowledge: the Pi has written a byte, and the reset came at once.
#[test]
fn boot_in_a_write_cycle_waits_for_its_end() {
    let image = original_image();
    let bytes = [0, 0, image[0]];
    let rig = Rig::new(Options::with_eeprom(image));
    rig.i2c_bus(move |bus, now| {
        let eeprom = bus.eeprom.as_mut().expect("fitted");
        eeprom.write_protected = false;
        eeprom.start(now, ADDRESS, false);
        assert!(bytes.iter().all(|&byte| eeprom.write(byte)));
        eeprom.stop(now);
        eeprom.write_protected = true;
    });
    let busy_until = rig.now_ns() + WRITE_CYCLE_NS;
    rig.trace_writes(I2C1_DR);
    rig.assert_ready();
    let first = rig.take_events()[0].at_ns;
    assert!(first < busy_until, "it asked only after {first} ns");
    assert!(!rig.log().contains("stuck"), "{}", rig.log());
}

#[test]
fn boot_held_bus_is_cleared_and_starts() {
    let rig = Rig::new(Options::with_eeprom(original_image()));
    rig.i2c_bus(|bus, _| bus.sda_held = 9);
    rig.trace_writes(GPIOB_BSRR);
    rig.assert_ready();
    rig.assert_logged("W");
    // Nine clocks at 100 kHz or slower, then a STOP (UM10204, 3.1.16).
    let [scl, sda] = [1 << 6, 1 << 7];
    let mut edges = vec![scl, sda];
    edges.extend([scl << 16, scl].repeat(9));
    edges.extend([scl << 16, sda << 16, scl, sda]);
    let lines = (scl | sda) * 0x1_0001;
    let writes = take_writes(&rig).into_iter();
    let driven = writes.filter(|write| write.value & lines != 0);
    let (at, values): (Vec<u64>, Vec<u64>) = driven
        .map(|write| (write.at_ns, write.value & lines))
        .unzip();
    assert_eq!(values, edges);
    for pair in at[1..].windows(2) {
        let half_period = pair[1] - pair[0];
        assert!(half_period >= 5_000, "{half_period} ns");
    }
    // A slave that nine clocks do not free gets nine more at each attempt.
    let rig = Rig::new(Options::with_eeprom(original_image()));
    rig.i2c_bus(|bus, _| bus.sda_held = 20);
    rig.assert_ready();
}

#[test]
fn boot_shorted_bus_stays_off_and_logs() {
    let rig = Rig::new(Options::with_eeprom(original_image()));
    rig.i2c_bus(|bus, _| bus.sda_held = u32::MAX);
    rig.await_ready();
    assert_stays_off(&rig, "no configuration: I2C held low");
}

// Requirement: DOC-2.3-4, DOC-6-6
#[test]
fn boot_waits_while_pi_has_eeprom() {
    let rig = Rig::new(Options::with_eeprom(original_image()));
    rig.switch_i2c(I2cController::Pi);
    rig.trace_writes(I2C1_DR);
    assert!(!rig.await_ready());
    rig.assert_logged("the Pi has the EEPROM, waiting");
    assert_eq!(rig.take_events(), [], "it keeps off the bus");
    assert!(rig.resets().is_empty(), "waiting is no reason for a reset");
    rig.switch_i2c(I2cController::Stm);
    rig.assert_ready();
}

fn is_reading(board: &Board) -> bool {
    board.i2c_bus(|bus, _| bus.eeprom.as_ref().is_some_and(Eeprom::is_reading))
}

/// A part that stretches the clock for a while only delays the read; one that does not end is an error.
#[test]
fn boot_waits_for_a_stretched_clock_but_not_for_ever() {
    for (stretched_us, ends) in [(500, "configured"), (400_000, "no configuration: I2C")] {
        let rig = Rig::new(Options::with_eeprom(original_image()));
        assert!(rig.run_until(20_000, 10, is_reading));
        rig.stretch_i2c(true);
        rig.run_us(stretched_us);
        assert!(!rig.is_ready());
        rig.stretch_i2c(false);
        rig.run_us(100_000);
        rig.assert_logged(ends);
        assert!(rig.resets().is_empty());
    }
    // An address byte, too.
    let rig = Rig::new(Options::with_eeprom(original_image()));
    rig.trace_writes(I2C1_DR);
    assert!(rig.run_until(20_000, 5, |board| !board.take_events().is_empty()));
    rig.stretch_i2c(true);
    rig.run_us(500);
    rig.stretch_i2c(false);
    rig.assert_ready();
    assert!(!rig.log().contains("stuck"), "{}", rig.log());
}

/// The Pi takes the bus in the middle of the read: that is no error, what came is not used, and the STM leaves the
/// lines alone.
// Requirement: DOC-2.3-4
#[test]
fn boot_gives_the_bus_up_in_the_middle_of_a_read() {
    for last in [0, SPANS.len() - 1] {
        let rig = Rig::new(Options::with_eeprom(original_image()));
        for span in 0..=last {
            assert!(rig.run_until(20_000, 10, is_reading));
            assert!(span == last || rig.run_until(20_000, 10, |board| !is_reading(board)));
        }
        rig.switch_i2c(I2cController::Pi);
        rig.trace_writes(GPIOB_BSRR);
        rig.run_us(10_000);
        assert_eq!(rig.take_events(), [], "span {last}");
        assert!(!rig.is_ready());
        rig.switch_i2c(I2cController::Stm);
        rig.assert_ready();
        assert!(!rig.log().contains("stuck"), "{}", rig.log());
    }
}

// Requirement: DOC-2.3-1, WIRE-fault-1
#[test]
fn boot_without_crystal_uses_hsi_and_logs() {
    let rig = Rig::ready(Options {
        crystal_hz: 0,
        ..Options::with_eeprom(image_in_mode(0x10))
    });
    // A crystal may take milliseconds.
    assert!(rig.now_us() > 10_000, "given up after {} us", rig.now_us());
    rig.run_us(20_000);
    rig.assert_logged("internal oscillator");
    // Guarded Normal: the clock's fault is bit 1 of the status behind key and sequence.
    let reply = rig.frame(&[0; 26]);
    assert_eq!(u16::from_be_bytes([reply[3], reply[4]]) & 0b10, 0b10);
    rig.assert_modelled();
}

#[test]
fn run_is_reproducible_from_seed() {
    let run = || {
        let rig = Rig::booted(Some(original_image()));
        let reply = rig.keep_sending(&normal_frame(200_000, 100_000, 0x2000, true), 1_500_000);
        let time = (rig.instructions(), rig.now_ns());
        (time, rig.log(), reply, rig.truth())
    };
    assert_eq!(run(), run());
}

#[test]
fn boot_low_speed_oscillator_left_on_gives_its_pins_back() {
    let rig = Rig::new(Options::with_eeprom(original_image()));
    rig.start_lse();
    assert!(rig.await_ready());
    let _ = rig.keep_sending(&normal_frame(1_000_000, 0, 0, true), 500_000);
    let wheels = rig.truth().wheel_deg_s;
    assert!(wheels.left > 100.0 && wheels.right > 100.0, "{wheels:?}");
    rig.assert_modelled();
}

/// `FLASH_ACR`, and I2C1's `CCR` (RM0383, 3.8.1 and 18.6.8).
const FLASH_ACR: u64 = 0x4002_3C00;
const I2C1_CCR: u64 = 0x4000_541C;

/// Four wait states serve 100 MHz down to 2.4 V, and the bus is not faster than the EEPROM.
#[test]
fn boot_flash_and_bus_keep_their_limits() {
    let [access, clock] = Rig::registers_after_boot([FLASH_ACR, I2C1_CCR]);
    // Four wait states, prefetch and both caches on, and none held in reset.
    assert_eq!(access & 0x1F0F, 0x0704);
    // Fast mode, low for two thirds: three times the divider of 50 MHz.
    assert_eq!(clock >> 14, 0b10);
    assert!(3 * (clock & 0xFFF) * 20 >= 2_500, "{clock:#x}");
}

/// `CCMR1` of TIM2 and TIM3.
const ENCODER_INPUTS: [u64; 2] = [0x4000_0018, 0x4000_0418];

/// Spikes below 0.64 us are no edges: eight samples of 12.5 MHz.
#[test]
fn boot_encoder_inputs_are_filtered() {
    let written = Rig::written_at_boot(&ENCODER_INPUTS).into_iter();
    let filters = written.map(|write| (write.value >> 4 & 15, write.value >> 12 & 15));
    // RM0383, 13.4.7: a quarter of the dead-time clock, 8 samples.
    assert!(filters.eq([(0b0111, 0b0111); 2]));
    // Half the timers' clock.
    let control = Rig::registers_after_boot([0x4000_0000, 0x4000_0400]);
    assert_eq!(control.map(|value| value >> 8 & 3), [1; 2]);
}

/// Lines that may have no driver get a pull (RM0383, 8.4.4): chip-select, UART, encoders and the EEPROM's switch. The
/// others float, except for the debugger's.
// Requirement: DOC-2.3-4
#[test]
fn boot_pulls_lines_without_a_driver() {
    let up = |pin: u32| 1 << (2 * pin);
    let down = |pin: u32| 2 << (2 * pin);
    let board = [
        // Chip-select, both lines of the UART, left encoder; the debugger's.
        up(4) | up(9) | up(10) | up(15) | up(13) | down(14),
        // Left encoder, the EEPROM's switch; the debugger's.
        up(3) | down(12) | up(4),
        // Right encoder.
        up(6) | up(7),
    ];
    let registers = [0x4002_000C, 0x4002_040C, 0x4002_080C];
    assert_eq!(Rig::registers_after_boot(registers), board);
}
