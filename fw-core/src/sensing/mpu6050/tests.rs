//! A part played by hand: registers that remember, and everything that can go wrong.

extern crate std;

use super::*;
use std::vec::Vec;

/// The part as far as the conversation sees it.
#[allow(
    clippy::struct_excessive_bools,
    reason = "what can be wrong, each on its own"
)]
struct Part {
    registers: [u8; 128],
    absent: bool,
    held: bool,
    /// Clock pulses until it lets go.
    pulses: u8,
    noise: u8,
    frozen: bool,
    clock: bool,
}

impl Part {
    fn new() -> Self {
        let mut part = Self {
            registers: [0; 128],
            absent: false,
            held: false,
            pulses: 0,
            noise: 0,
            frozen: false,
            clock: true,
        };
        part.reset();
        part
    }

    fn reset(&mut self) {
        self.registers = [0; 128];
        self.registers[usize::from(PWR_MGMT_1)] = 0x40;
        self.registers[usize::from(WHO_AM_I)] = IDENTITY;
    }

    fn carry_out(&mut self, order: BusRequest) -> BusResult {
        match order {
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
                BusResult::Bytes(match count {
                    1 => [self.registers[at], 0],
                    _ => [self.registers[at], self.registers[at + 1]],
                })
            }
        }
    }
}

/// So many ticks of conversation: what was learned, by tick, and what was ordered.
fn talk(
    mpu: &mut Mpu6050,
    part: &mut Part,
    outcome: &mut BusResult,
    ticks: u32,
) -> (Vec<(u32, GyroReading)>, Vec<BusRequest>) {
    let mut news = Vec::new();
    let mut orders = Vec::new();
    for tick in 0..ticks {
        let (order, heard) = mpu.step(*outcome);
        *outcome = part.carry_out(order);
        if heard != GyroReading::None {
            news.push((tick, heard));
        }
        orders.push(order);
    }
    (news, orders)
}

fn rates(news: &[(u32, GyroReading)]) -> usize {
    news.iter()
        .filter(|(_, news)| matches!(news, GyroReading::Rate(_)))
        .count()
}

fn losses(news: &[(u32, GyroReading)]) -> Vec<DeviceError> {
    news.iter()
        .filter_map(|(_, news)| match news {
            GyroReading::Lost(trouble) => Some(*trouble),
            _ => None,
        })
        .collect()
}

#[test]
fn a_part_that_answers_is_set_up_and_read_every_tick_from_then_on() {
    let (mut mpu, mut part, mut outcome) = (Mpu6050::new(), Part::new(), BusResult::Done);
    let (news, orders) = talk(&mut mpu, &mut part, &mut outcome, 200);
    let first = news.first().expect("it streams").0;
    assert!(first < 50, "half a second is enough: {first}");
    assert_eq!(rates(&news), 200 - first as usize);
    assert!(orders[..9].iter().all(|order| *order == BusRequest::Idle));
    assert_eq!(part.registers[usize::from(PWR_MGMT_1)], 3, "awake");
    assert_eq!(part.registers[usize::from(CONFIG)], LOW_PASS);
    assert_eq!(part.registers[usize::from(GYRO_CONFIG)], FULL_SCALE);
}

#[test]
fn an_absent_part_is_told_once_asked_ever_more_rarely_and_found_when_it_comes() {
    let (mut mpu, mut part, mut outcome) = (Mpu6050::new(), Part::new(), BusResult::Done);
    part.absent = true;
    let (news, orders) = talk(&mut mpu, &mut part, &mut outcome, 6_000);
    assert_eq!(losses(&news), [DeviceError::NotResponding]);
    let asked = orders
        .iter()
        .filter(|order| **order != BusRequest::Idle)
        .count();
    assert!((8..=12).contains(&asked), "{asked} tries in a minute");
    part.absent = false;
    let (news, _) = talk(&mut mpu, &mut part, &mut outcome, 1_000);
    assert!(rates(&news) > 100);
    part.absent = true;
    let (news, _) = talk(&mut mpu, &mut part, &mut outcome, 1_000);
    assert_eq!(
        losses(&news),
        [DeviceError::NotResponding],
        "lost anew, told anew"
    );
}

#[test]
fn after_power_up_it_is_asked_set_up_step_by_step_and_given_its_time_after_each() {
    let (mut mpu, mut part, mut outcome) = (Mpu6050::new(), Part::new(), BusResult::Done);
    let (_, orders) = talk(&mut mpu, &mut part, &mut outcome, 60);
    // What is ordered in a tick is carried out before the next: 100 ms until it answers.
    let identify = BusRequest::Read {
        register: WHO_AM_I,
        count: 1,
    };
    let mut expected = std::vec![BusRequest::Idle; 9];
    expected.push(identify);
    let write = |register, value| BusRequest::Write { register, value };
    for (order, rests) in [
        // 100 ms and one tick, for the order may be carried out at its end.
        (write(PWR_MGMT_1, 0x80), 11),
        // 30 ms, and two ticks more.
        (write(PWR_MGMT_1, 0x03), 5),
        // The low-pass of 42 Hz and ±500 °/s, which it is asked for below.
        (write(CONFIG, 3), 1),
        (write(GYRO_CONFIG, 0x08), 1),
        (write(SMPLRT_DIV, 0), 3),
    ] {
        expected.push(order);
        expected.extend(core::iter::repeat_n(BusRequest::Idle, rests));
    }
    let read = |register| BusRequest::Read { register, count: 2 };
    expected.push(read(CONFIG));
    expected.resize(60, read(GYRO_ZOUT));
    assert_eq!(orders, expected);
}

#[test]
fn an_absent_part_is_asked_after_one_second_two_four_and_eight() {
    let (mut mpu, mut part, mut outcome) = (Mpu6050::new(), Part::new(), BusResult::Done);
    part.absent = true;
    let (_, orders) = talk(&mut mpu, &mut part, &mut outcome, 3_300);
    let asked: Vec<usize> = (0..orders.len())
        .filter(|&tick| orders[tick] != BusRequest::Idle)
        .collect();
    let apart: Vec<usize> = asked.windows(2).map(|two| two[1] - two[0]).collect();
    // A tick in which the answer is missed comes before each pause.
    assert_eq!(apart, [101, 201, 401, 801, 801, 801]);
}

#[test]
fn every_trouble_says_what_it_is() {
    for (trouble, text) in [
        (DeviceError::NotResponding, "no answer at 0x68"),
        (DeviceError::WrongId, "not an MPU6050 at 0x68"),
        (DeviceError::BusHeld, "I2C held"),
        (DeviceError::Frozen, "its data stand still"),
    ] {
        assert_eq!(trouble.reason(), text);
    }
}

#[test]
fn a_missed_read_or_three_lose_nothing() {
    let (mut mpu, mut part, mut outcome) = (Mpu6050::new(), Part::new(), BusResult::Done);
    let _ = talk(&mut mpu, &mut part, &mut outcome, 100);
    part.absent = true;
    let (news, _) = talk(&mut mpu, &mut part, &mut outcome, 3);
    assert!(losses(&news).is_empty());
    part.absent = false;
    let (news, _) = talk(&mut mpu, &mut part, &mut outcome, 10);
    assert_eq!(rates(&news), 9);
}

#[test]
fn a_stranger_is_left_alone() {
    let (mut mpu, mut part, mut outcome) = (Mpu6050::new(), Part::new(), BusResult::Done);
    part.registers[usize::from(WHO_AM_I)] = 0x70;
    let (news, orders) = talk(&mut mpu, &mut part, &mut outcome, 1_000);
    assert_eq!(losses(&news), [DeviceError::WrongId]);
    assert_eq!(rates(&news), 0);
    let writes = |order: &&BusRequest| matches!(order, BusRequest::Write { .. });
    assert_eq!(orders.iter().filter(writes).count(), 0);
}

#[test]
fn a_part_that_stands_still_is_reset_and_one_that_fell_asleep_wakes() {
    let (mut mpu, mut part, mut outcome) = (Mpu6050::new(), Part::new(), BusResult::Done);
    let _ = talk(&mut mpu, &mut part, &mut outcome, 100);
    part.frozen = true;
    let (news, orders) = talk(&mut mpu, &mut part, &mut outcome, 400);
    assert_eq!(losses(&news), [DeviceError::Frozen]);
    let reset = BusRequest::Write {
        register: PWR_MGMT_1,
        value: 0x80,
    };
    assert!(orders.contains(&reset));
    part.frozen = false;
    let _ = talk(&mut mpu, &mut part, &mut outcome, 1_000);
    // Its supply failed for a moment.
    part.reset();
    let (news, _) = talk(&mut mpu, &mut part, &mut outcome, 400);
    assert_eq!(losses(&news), [DeviceError::Frozen]);
    assert!(matches!(news.last(), Some((399, GyroReading::Rate(_)))));
}

#[test]
fn a_held_bus_is_clocked_out_edge_by_edge_and_ends_with_a_stop() {
    let (mut mpu, mut part, mut outcome) = (Mpu6050::new(), Part::new(), BusResult::Done);
    let _ = talk(&mut mpu, &mut part, &mut outcome, 100);
    (part.held, part.pulses) = (true, 9);
    let (news, orders) = talk(&mut mpu, &mut part, &mut outcome, 300);
    assert_eq!(losses(&news), [DeviceError::BusHeld]);
    let lines: Vec<_> = orders
        .iter()
        .filter_map(|order| match order {
            BusRequest::DriveLines { clock, data } => Some((*clock, *data)),
            _ => None,
        })
        .collect();
    let pulse = [(false, true), (true, true)];
    let mut expected: Vec<_> = core::iter::repeat_n(pulse, 9).flatten().collect();
    expected.extend([(false, false), (true, false), (true, true)]);
    assert_eq!(lines, expected);
    assert!(orders.contains(&BusRequest::ReleaseLines));
    assert!(matches!(news.last(), Some((299, GyroReading::Rate(_)))));
}

#[test]
fn a_bus_held_for_good_is_told_once() {
    let (mut mpu, mut part, mut outcome) = (Mpu6050::new(), Part::new(), BusResult::Done);
    part.held = true;
    let (news, _) = talk(&mut mpu, &mut part, &mut outcome, 10_000);
    assert_eq!(losses(&news), [DeviceError::BusHeld]);
}
