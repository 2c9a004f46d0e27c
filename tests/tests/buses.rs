//! How the STM serves its buses, by its registers and by what is on the wires.

use fw_core::eeprom::{Image, SPANS, fields};
use robot_tests::reference::{KEY_STM, NormalReply, normal_frame, original_image};
use robot_tests::test_board::{I2C1_CR1, Rig, START, STOP, take_writes, wrote};
use twin::Options;

/// The control register of a DMA controller's stream (RM0383, tables 1 and 35); behind it stand the
/// number of items and the peripheral's address.
const fn control(controller: u64, stream: u64) -> u64 {
    0x4002_6000 + 0x400 * (controller - 1) + 0x10 + 0x18 * stream
}

/// Bits of it: enabled, memory to peripheral.
const ENABLED: u64 = 1;
const SENDING: u64 = 1 << 6;

const SPI1_CR1: u64 = 0x4001_3000;
const SPI1_CR2: u64 = 0x4001_3004;
const SPI1_DR: u64 = 0x4001_300C;
const USART1_DR: u64 = 0x4001_1004;
const USART1_BRR: u64 = 0x4001_1008;
const I2C1_DR: u64 = 0x4000_5410;
const ADC1_SR: u64 = 0x4001_2000;
const ADC1_CR2: u64 = 0x4001_2008;

/// Of each bus: the stream, its channel, which way, and the data register.
const STREAMS: [(u64, u64, u64, u64); 4] = [
    (control(2, 0), 3, 0, SPI1_DR),
    (control(2, 3), 3, SENDING, SPI1_DR),
    (control(2, 7), 4, SENDING, USART1_DR),
    (control(1, 0), 1, 0, I2C1_DR),
];

/// A master may see a bus error without a cause (ES0287, 2.10).
// Requirement: DOC-6-1
#[test]
fn boot_ignores_spurious_bus_errors() {
    let rig = Rig::new(Options::with_eeprom(original_image()));
    while !rig.is_ready() && rig.now_us() < 20_000 {
        rig.run_us(83);
        rig.raise_bus_error();
    }
    let log = rig.log();
    assert!(rig.is_ready() && !log.contains("I2C"), "{log}");
}

/// In the address, the register's bytes, the repeated START, the first and a later byte: the transfer ends at
/// once instead of with its time-out.
// Requirement: DOC-6-1
#[test]
fn boot_lost_arbitration_ends_transfer_and_is_retried() {
    let rig = Rig::new(Options::with_eeprom(original_image()));
    rig.trace_writes(I2C1_CR1);
    for later in [10, 40, 60, 85, 120, 600] {
        assert!(rig.run_until(20_000, 1, wrote(START)), "{}", rig.log());
        rig.run_us(later);
        assert!(rig.lose_arbitration(), "{later} µs");
        assert!(rig.run_until(250, 1, wrote(STOP)), "{later} µs");
    }
    rig.assert_ready();
    rig.run_us(20_000);
    rig.assert_logged("I2C stuck, clocking it free");
    rig.assert_logged("configured, mode Normal");
}

// Requirement: DOC-2.1-5, DOC-3.3-1, DOC-3.3-2, DOC-3.3-3, WIRE-spi-4, WIRE-eeprom-7
#[test]
fn buses_use_dma() {
    let rig = Rig::new(Options::with_eeprom(original_image()));
    for (control, ..) in STREAMS {
        for register in [control, control + 4, control + 8] {
            rig.trace_writes(register);
        }
    }
    for register in [
        SPI1_CR1, SPI1_CR2, SPI1_DR, USART1_DR, I2C1_DR, ADC1_SR, ADC1_CR2,
    ] {
        rig.trace_writes(register);
    }
    rig.assert_ready();
    rig.run_us(50_000);
    let mut cells = [0; 2];
    for _ in 0..10 {
        let reply = NormalReply::of(&rig.frame(&normal_frame(0, 0, 0, false)));
        assert_eq!(reply.key, KEY_STM);
        cells[usize::from(reply.cell)] += 1;
        rig.run_us(1_000);
    }
    // Every reply went out and every frame came in.
    assert_eq!(cells, [5, 5]);
    assert!(rig.log().len() > 50, "{}", rig.log());

    let writes = take_writes(&rig);
    let written = |register: u64| -> Vec<u64> {
        let own = writes.iter().filter(|write| write.address == register);
        own.map(|write| write.value).collect()
    };
    for (control, channel, way, data) in STREAMS {
        let mut starts = written(control);
        starts.retain(|settings| settings & ENABLED != 0);
        assert!(!starts.is_empty(), "{control:#x} was never started");
        for settings in starts {
            assert_eq!((settings >> 25, settings & 0xC0), (channel, way));
        }
        assert!(written(control + 8).iter().all(|&at| at == data));
    }
    // Each span of the configuration at once, and no byte by hand but the addresses of part and register.
    let lengths = written(control(1, 0) + 4);
    let addresses = SPANS.iter().flat_map(|span| {
        let [high, low] = span.address.to_be_bytes().map(u64::from);
        [0xA0, high, low, 0xA1]
    });
    assert!(SPANS.iter().all(|span| lengths.contains(&span.len.into())));
    assert_eq!(written(I2C1_DR), addresses.collect::<Vec<_>>());
    // Of replies and log none at all, and no interrupt asks for one.
    assert!(written(SPI1_DR).is_empty() && written(USART1_DR).is_empty());
    let requests = written(SPI1_CR2);
    assert!(requests.contains(&0b11) && requests.iter().all(|bits| bits & 0xE0 == 0));
    // A slave of mode 0, 8 bits, most significant first, selected by its pin: nothing but on or off.
    assert!(written(SPI1_CR1).iter().all(|&bits| bits & !(1 << 6) == 0));
    // An overrun of the battery's ADC, which would stop its requests, ends with the next scan.
    let scans = written(ADC1_CR2).into_iter().filter(|bits| bits >> 30 == 1);
    assert_eq!(written(ADC1_SR), vec![0; scans.count()]);
    rig.assert_modelled();
}

/// The time from byte to byte within the lines, µs, of those that `which` picks.
fn pace(rig: &Rig, which: impl Fn(&str) -> bool) -> f64 {
    let log = rig.board.log();
    let mut paces = Vec::new();
    for line in log.split_inclusive(|sent| sent.byte == b'\n') {
        let text: Vec<u8> = line.iter().map(|sent| sent.byte).collect();
        if which(&String::from_utf8_lossy(&text)) {
            paces.extend(line.windows(2).map(|two| two[1].at - two[0].at));
        }
    }
    paces.sort_unstable();
    #[allow(clippy::cast_precision_loss, reason = "some tens of thousands")]
    let median = paces[paces.len() / 2] as f64;
    median / 1000.0
}

// Requirement: WIRE-log-4
#[test]
fn log_baud_changes_to_configured_rate_after_boot() {
    // Both within what a receiver at 115200 baud reads.
    for baud in [115_200_u32, 117_600, 113_000] {
        let image = Image::FIRST_BOARD
            .with(fields::LOG_BAUD, baud.into())
            .with(fields::LOG_PERIOD, 100);
        let rig = Rig::configured(image.0.to_vec());
        rig.run_us(1_000_000);
        // A start bit, eight bits, a stop bit.
        let boot = pace(&rig, |line| line.contains("boot after"));
        assert!((boot - 10e6 / 115_200.0).abs() < 0.2, "{boot} µs");
        let later = pace(&rig, |line| line.contains(": pose "));
        assert!((later - 10e6 / f64::from(baud)).abs() < 0.2, "{later} µs");
    }
    // A reader at the boot's rate sees the last of its lines whole; what follows it cannot read.
    let image = Image::FIRST_BOARD.with(fields::LOG_BAUD, 9_600);
    let log = Rig::configured(image.0.to_vec()).uart();
    assert!(String::from_utf8_lossy(&log).contains("configured, mode Normal\n"));
}

// Requirement: WIRE-log-4
#[test]
fn log_divider_is_the_nearest() {
    for baud in [9_600, 460_800, 921_600, 1_900_000] {
        let image = Image::FIRST_BOARD.with(fields::LOG_BAUD, baud);
        let rig = Rig::new(Options::with_eeprom(image.0.to_vec()));
        rig.trace_writes(USART1_BRR);
        rig.assert_ready();
        let last = take_writes(&rig).pop().expect("written").value;
        assert_eq!(last, (100_000_000 + baud / 2) / baud, "{baud} baud");
    }
}
