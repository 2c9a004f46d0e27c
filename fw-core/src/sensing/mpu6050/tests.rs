//! The driver against a model of the part, its bus and their failures.

use super::*;
use std::vec::Vec;

/// Model of the part.
#[allow(
    clippy::struct_excessive_bools,
    reason = "independent faults and a line"
)]
struct Part {
    registers: [u8; 128],
    absent: bool,
    /// SDA is held low, until so many more clock pulses.
    held: bool,
    pulses: u8,
    noise: u8,
    frozen: bool,
    clock: bool,
}

impl Part {
    fn reset(&mut self) {
        self.registers = [0; 128];
        self.registers[usize::from(PWR_MGMT_1)] = 0x40;
        self.registers[usize::from(WHO_AM_I)] = IDENTITY;
    }

    fn execute(&mut self, request: BusRequest) -> BusResult {
        match request {
            BusRequest::Idle | BusRequest::ReleaseLines => BusResult::Done,
            BusRequest::DriveLines { clock, .. } => {
                if clock && !self.clock && self.pulses > 0 {
                    self.pulses -= 1;
                    self.held = self.pulses > 0;
                }
                self.clock = clock;
                BusResult::Done
            }
            _ if self.held => BusResult::Timeout,
            _ if self.absent => BusResult::Nack,
            BusRequest::Write { register, value } => {
                if register == PWR_MGMT_1 && value & 0x80 != 0 {
                    self.reset();
                } else {
                    self.registers[usize::from(register)] = value;
                }
                BusResult::Done
            }
            BusRequest::Read { register, count } => {
                if !self.frozen {
                    self.noise = (self.noise + 3) % 7;
                }
                if self.registers[usize::from(PWR_MGMT_1)] & 0x40 == 0 {
                    self.registers[usize::from(GYRO_ZOUT) + 1] = self.noise;
                }
                let at = usize::from(register);
                let second = self.registers[at + 1] * u8::from(count > 1);
                BusResult::Bytes([self.registers[at], second])
            }
        }
    }
}

/// Driver and part, with what the last ticks gave.
struct Bus {
    driver: Mpu6050,
    part: Part,
    result: BusResult,
    requests: Vec<BusRequest>,
    rates: Vec<usize>,
    losses: Vec<DeviceError>,
}

impl Bus {
    fn new() -> Self {
        let mut part = Part {
            registers: [0; 128],
            absent: false,
            held: false,
            pulses: 0,
            noise: 0,
            frozen: false,
            clock: true,
        };
        part.reset();
        Self {
            driver: Mpu6050::new(),
            part,
            result: BusResult::Done,
            requests: Vec::new(),
            rates: Vec::new(),
            losses: Vec::new(),
        }
    }

    fn streaming() -> Self {
        let mut bus = Self::new();
        bus.run(100);
        assert_eq!(bus.rates.last(), Some(&99));
        bus
    }

    fn run(&mut self, ticks: usize) {
        self.requests.clear();
        self.rates.clear();
        self.losses.clear();
        for tick in 0..ticks {
            let (request, reading) = self.driver.step(self.result);
            self.result = self.part.execute(request);
            self.requests.push(request);
            match reading {
                GyroReading::Rate(_) => self.rates.push(tick),
                GyroReading::Lost(error) => self.losses.push(error),
                GyroReading::None => {}
            }
        }
    }
}

#[test]
fn set_up_has_its_order_times_and_values() {
    let mut bus = Bus::new();
    bus.run(60);
    // 100 ms until the part answers.
    let mut expected = std::vec![BusRequest::Idle; 9];
    let read = |register, count| BusRequest::Read { register, count };
    expected.push(read(WHO_AM_I, 1));
    for (register, value, rest) in [
        // Reset 100 ms, wake-up 30 ms; a request may be executed at the end of its tick.
        (PWR_MGMT_1, 0x80, 11),
        (PWR_MGMT_1, 0x03, 5),
        (CONFIG, 3, 1),
        (GYRO_CONFIG, 0x08, 1),
        (SMPLRT_DIV, 0, 3),
    ] {
        expected.push(BusRequest::Write { register, value });
        expected.extend(core::iter::repeat_n(BusRequest::Idle, rest));
    }
    expected.push(read(CONFIG, 2));
    let first = expected.len();
    expected.resize(60, read(GYRO_ZOUT, 2));
    assert_eq!(bus.requests, expected);
    assert_eq!(bus.rates, (first + 1..60).collect::<Vec<_>>());
    assert_eq!(bus.part.registers[usize::from(PWR_MGMT_1)], 3);
    assert_eq!(bus.part.registers[usize::from(CONFIG)], LOW_PASS);
    assert_eq!(bus.part.registers[usize::from(GYRO_CONFIG)], FULL_SCALE);
}

#[test]
fn absent_part_is_reported_once_and_retried_ever_more_rarely() {
    let mut bus = Bus::new();
    bus.part.absent = true;
    bus.run(3_300);
    assert_eq!(bus.losses, [DeviceError::NotResponding]);
    let active = |&tick: &usize| bus.requests[tick] != BusRequest::Idle;
    let tries: Vec<usize> = (0..3_300).filter(active).collect();
    let pauses: Vec<usize> = tries.windows(2).map(|two| two[1] - two[0]).collect();
    assert_eq!(pauses, [101, 201, 401, 801, 801, 801]);
    bus.part.absent = false;
    bus.run(1_000);
    assert!(bus.rates.len() > 100);
    bus.part.absent = true;
    bus.run(1_000);
    assert_eq!(bus.losses, [DeviceError::NotResponding]);
    // Four missed reads, and the shortest pause.
    let identify = |request: &BusRequest| matches!(request, BusRequest::Read { count: 1, .. });
    assert_eq!(bus.requests.iter().position(identify), Some(104));
}

#[test]
fn three_missed_reads_are_tolerated() {
    let mut bus = Bus::streaming();
    for _ in 0..3 {
        bus.part.absent = true;
        bus.run(3);
        assert!(bus.losses.is_empty());
        bus.part.absent = false;
        bus.run(10);
        assert_eq!((bus.rates.len(), bus.losses.len()), (9, 0));
    }
    bus.part.absent = true;
    bus.run(5);
    assert_eq!(bus.losses, [DeviceError::NotResponding]);
    bus.part.absent = false;
    while !matches!(bus.requests[..], [BusRequest::Read { register, .. }] if register == CONFIG) {
        bus.run(1);
    }
    // The first read after a new set-up may fail, too.
    bus.part.absent = true;
    bus.run(1);
    bus.part.absent = false;
    bus.run(10);
    assert_eq!((bus.rates.len(), bus.losses.len()), (9, 0));
}

#[test]
fn wrong_identity_is_never_written_to() {
    let mut bus = Bus::new();
    bus.part.registers[usize::from(WHO_AM_I)] = 0x70;
    bus.run(1_000);
    assert_eq!(bus.losses, [DeviceError::WrongId]);
    assert!(bus.rates.is_empty());
    let write = |request: &BusRequest| matches!(request, BusRequest::Write { .. });
    assert!(!bus.requests.iter().any(write));
}

#[test]
fn frozen_or_restarted_part_is_set_up_again() {
    let mut bus = Bus::streaming();
    bus.part.frozen = true;
    bus.run(380);
    assert_eq!(bus.losses, [DeviceError::Frozen]);
    // 20 equal words each time.
    assert_eq!(bus.rates.len(), 20 + 19);
    let (register, value) = (PWR_MGMT_1, 0x80);
    let reset = BusRequest::Write { register, value };
    assert!(bus.requests.contains(&reset));
    bus.part.frozen = false;
    bus.run(1_000);
    bus.part.reset();
    bus.run(400);
    assert_eq!(bus.losses, [DeviceError::Frozen]);
    assert_eq!(bus.rates.last(), Some(&399));
}

#[test]
fn held_bus_is_recovered_with_nine_pulses_and_a_stop() {
    let mut bus = Bus::streaming();
    (bus.part.held, bus.part.pulses) = (true, 9);
    bus.run(300);
    assert_eq!(bus.losses, [DeviceError::BusHeld]);
    let lines = |request: &BusRequest| match request {
        BusRequest::DriveLines { clock, data } => Some((*clock, *data)),
        _ => None,
    };
    let lines: Vec<_> = bus.requests.iter().filter_map(lines).collect();
    let mut expected = [(false, true), (true, true)].repeat(9);
    expected.extend([(false, false), (true, false), (true, true)]);
    assert_eq!(lines, expected);
    assert!(bus.requests.contains(&BusRequest::ReleaseLines));
    assert_eq!(bus.rates.last(), Some(&299));
}

#[test]
fn bus_held_permanently_after_absence_is_reported_once() {
    let mut bus = Bus::new();
    bus.part.absent = true;
    bus.run(100);
    assert_eq!(bus.losses, [DeviceError::NotResponding]);
    bus.part.held = true;
    bus.run(10_000);
    assert_eq!(bus.losses, [DeviceError::BusHeld]);
    // The pause of an absent part, behind each recovery.
    let active = |request: &&BusRequest| !matches!(request, BusRequest::Idle);
    let active = bus.requests.iter().filter(active).count();
    assert!((200..=300).contains(&active), "{active}");
}

#[test]
fn device_error_has_its_text() {
    for (error, text) in [
        (DeviceError::NotResponding, "no answer at 0x68"),
        (DeviceError::WrongId, "not an MPU6050 at 0x68"),
        (DeviceError::BusHeld, "I2C held"),
        (DeviceError::Frozen, "data frozen"),
    ] {
        assert_eq!(error.reason(), text);
    }
}
