//! The whole board register by register, without a program.

use super::*;
use crate::components::eeprom::Eeprom;
use crate::components::i2c_bus::{I2cBus, I2cController::Stm, SharedBus};
use crate::components::mpu6050::{ADDRESS, Mpu6050};
use crate::components::spi_master::{SpiStep, pack};
use crate::fixture::Fixture;
use plant::{GyroParams, Params, Pose2, Room, Sides, World};

/// A board whose ports, SPI1, SYSCFG, TIM2 to TIM4 and TIM1 have their clocks.
fn board() -> Fixture<McuOnBoard> {
    let world = World::new(Params::default(), Room::two_rooms(), Pose2::default(), 1);
    let bus = SharedBus::new(I2cBus::new(Some(Eeprom::new(&[])), None));
    let board = VirtualBoard::new(BoardModel::new(world, bus), 8_000_000, NonZeroU64::MIN).unwrap();
    let mut board = Fixture::new(board.mcu);
    board.write(0x4002_3830, 7);
    board.write(0x4002_3840, 0xF);
    board.write(0x4002_3844, 1 | 1 << 12 | 1 << 14);
    board
}

const GPIOA: u64 = 0x4002_0000;
const GPIOB: u64 = 0x4002_0400;
const GPIOC: u64 = 0x4002_0800;
const MODER: u64 = 0;
const PUPDR: u64 = 0xC;
const BSRR: u64 = 0x18;
const AFRL: u64 = 0x20;
const AFRH: u64 = 0x24;

#[test]
fn timers_count_wheel_rotation() {
    let mut board = board();
    for (timer, last) in [(0x4000_0000, 0xFFFF_FFFF), (0x4000_0400, 0xFFFF)] {
        board.write(timer + 0x18, 0x0101);
        board.write(timer + 0x2C, last);
        board.write(timer + 8, 3);
        board.write(timer, 1);
    }
    board.write(GPIOA + AFRH, 1 << 28);
    board.write(GPIOA + MODER, 2 << 30 | 1 << 4 | 1 << 6);
    board.write(GPIOB + AFRL, 1 << 12);
    board.write(GPIOC + AFRL, 0x2200_0000);
    board.write(GPIOC + MODER, 2 << 12 | 2 << 14 | 1 << 28 | 1 << 30);
    // The encoders' outputs are open collectors.
    for (port, pulls) in [
        (GPIOA, 1 << 30),
        (GPIOB, 1 << 6),
        (GPIOC, 1 << 12 | 1 << 14),
    ] {
        board.write(port + PUPDR, pulls);
    }
    // Both enables high by hand; the right wheel forward, the left one backward.
    board.write(GPIOB + MODER, 2 << 6 | 1 << 16 | 1 << 18);
    board.write(GPIOB + BSRR, 1 << 8 | 1 << 9);
    board.write(GPIOA + BSRR, 1 << 2);
    board.write(GPIOC + BSRR, 1 << 15);
    board.run(700_000_000);
    // To rest: every edge is driven then.
    board.write(GPIOB + BSRR, 1 << 24 | 1 << 25);
    board.run(2_000_000_000);
    let Sides { left, right } = board.mcu.board.world.wheel_counts();
    assert!(left > 500 && right < -500, "{left} {right}");
    let low = |count: i64, mask: u64| count.cast_unsigned() & mask;
    assert_eq!(board.read(0x4000_0024), low(left, 0xFFFF_FFFF));
    assert_eq!(board.read(0x4000_0424), low(right, 0xFFFF));
}

#[test]
fn trigger_yields_echo_pulse() {
    let mut board = board();
    board.write(GPIOC + MODER, 1 << 16);
    board.write(GPIOC + BSRR, 1 << 8);
    board.run(10_000);
    board.write(GPIOC + BSRR, 1 << 24);
    let mut high = 0;
    for _ in 0..4_000 {
        board.run(10_000);
        high += board.read(GPIOC + 0x10) >> 9 & 1;
    }
    // Tens of microseconds; the room is a few metres across: 1 to 20 ms, or 38 without echo.
    assert!((50..4_000).contains(&high), "{high}");
}

#[test]
fn spi_transfer_needs_routed_pins() {
    let mut board = board();
    let transfer = |board: &mut Fixture<McuOnBoard>| {
        let steps = vec![
            SpiStep::Select(true),
            SpiStep::Wait(1_000),
            SpiStep::bytes(&[0x3C], 8_000_000),
            SpiStep::Wait(1_000),
            SpiStep::Select(false),
        ];
        board.act(|mcu, now| {
            mcu.board.spi.play(now.0, steps);
            mcu.poll(now);
        });
        board.run(10_000);
        pack(&board.mcu.board.spi.take_miso())
    };
    board.write(0x4001_300C, 0xA5);
    board.write(0x4001_3000, 1 << 6);
    assert_eq!(transfer(&mut board), [0], "no pin carries it yet");
    board.write(GPIOA + AFRL, 0x5555_0000);
    board.write(GPIOA + MODER, 0xAA00);
    assert_eq!(transfer(&mut board), [0xA5]);
    assert_eq!(board.read(0x4001_300C), 0x3C);
}

#[test]
fn tim1_pulse_turns_servo_once_outputs_are_enabled() {
    const TIM1: u64 = 0x4001_0000;
    let mut board = board();
    board.write(GPIOA + AFRH, 1);
    board.write(GPIOA + MODER, 2 << 16);
    // 16 MHz by 16; PWM mode 2 from 1 on, up to the end of the count.
    for (register, value) in [(0x28, 15), (0x34, 1), (0x18, 7 << 4), (0x20, 1), (0x14, 1)] {
        board.write(TIM1 + register, value);
    }
    let pulses = |board: &mut Fixture<McuOnBoard>, width: u64| {
        for _ in 0..40 {
            board.write(TIM1 + 0x2C, width);
            board.write(TIM1, 1 << 3 | 1);
            board.run(20_000_000);
        }
        board.mcu.board.world.servo.angle_rad.to_degrees()
    };
    assert!(pulses(&mut board, 2000).abs() < 1e-9, "the outputs are off");
    board.write(TIM1 + 0x44, 1 << 15);
    assert!((pulses(&mut board, 2000) - 90.0).abs() < 0.5);
    assert!((pulses(&mut board, 1250) + 45.0).abs() < 0.5);
    let bearing = board.mcu.board.world.mount(0).bearing_rad;
    assert!((bearing.to_degrees() + 45.0).abs() < 0.5);
}

#[test]
fn mpu_measures_yaw_rate_and_pulses_interrupt() {
    let mut board = board();
    let mut mpu = Mpu6050::new(GyroParams::exact(), 1);
    for bytes in [[0x6B, 0], [0x1B, 8], [0x38, 1]] {
        assert!(mpu.start(ADDRESS, false) && bytes.map(|byte| mpu.write(byte)) == [true; 2]);
    }
    board.mcu.board.i2c.lock().mpu = Some(mpu);
    board.mcu.board.world.faults.twist_deg_s = -90.0;
    board.run(100_000_000);
    let mut bus = board.mcu.board.i2c.lock();
    assert!(bus.start(Stm, 0, ADDRESS, false) && bus.write(Stm, 0x47));
    assert!(bus.start(Stm, 0, ADDRESS, true));
    let word = i16::from_be_bytes([bus.read(Stm), bus.read(Stm)]);
    drop(bus);
    assert!((f64::from(word) + 90.0 * 65.5).abs() < 3.0, "{word}");
    // GPIOB's IDR, bit 13: up for 50 µs of every millisecond.
    let mut high = 0;
    for _ in 0..200 {
        board.run(10_000);
        high += board.read(GPIOB + 0x10) >> 13 & 1;
    }
    assert!((8..=12).contains(&high), "{high} of 200 looks");
}
