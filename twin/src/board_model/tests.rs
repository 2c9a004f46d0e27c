use super::*;
use crate::components::eeprom::Eeprom;
use crate::components::i2c_bus::I2cBus;
use crate::components::spi_master::{pack, Step};
use crate::virtual_board::VirtualBoard;
use plant::{Params, Room};
use rigless::emulator::{Error, Memory};
use rigless::mcu::{Mcu, Operate};
use rigless::soc::Width;

struct NoMemory;

impl Memory for NoMemory {
    fn read(&mut self, address: u64, width: Width) -> Result<u64, Error> {
        Err(Error::Memory { address, width })
    }

    fn write(&mut self, address: u64, width: Width, _value: u64) -> Result<(), Error> {
        Err(Error::Memory { address, width })
    }
}

/// A whole board driven register by register, without a program.
struct Bench {
    board: VirtualBoard,
    now: VirtualNanos,
}

impl Bench {
    fn new() -> Self {
        let room = Room::two_rooms();
        let start = room.start;
        let world = World::new(Params::default(), room, start, 1);
        let bus = SharedBus::new(I2cBus::new(Some(Eeprom::holding(&[]))));
        let board = VirtualBoard::new(Surroundings::new(world, bus), true).unwrap();
        let mut bench = Self {
            board,
            now: VirtualNanos(0),
        };
        bench.write(0x4002_3830, 7);
        bench.write(0x4002_3840, 0xF);
        bench.write(0x4002_3844, 1 << 12 | 1 << 14);
        bench
    }

    fn write(&mut self, address: u64, value: u64) {
        let robot = &mut self.board.robot;
        robot.write(self.now, address, Width::W32, value).unwrap();
        robot.settle(&mut NoMemory).unwrap();
    }

    fn read(&mut self, address: u64) -> u64 {
        let robot = &mut self.board.robot;
        let value = robot.read(self.now, address, Width::W32).unwrap();
        robot.settle(&mut NoMemory).unwrap();
        value
    }

    fn run(&mut self, ns: u64) {
        let ends = VirtualNanos(self.now.0 + ns);
        let robot = &mut self.board.robot;
        while let Some(at) = robot.next_event().filter(|&at| at <= ends) {
            self.now = at;
            robot.advance_to(at);
            robot.poll(at);
            robot.settle(&mut NoMemory).unwrap();
        }
        self.now = ends;
    }
}

const GPIOA: u64 = 0x4002_0000;
const GPIOB: u64 = 0x4002_0400;
const GPIOC: u64 = 0x4002_0800;
const MODER: u64 = 0;
const BSRR: u64 = 0x18;
const AFRL: u64 = 0x20;
const AFRH: u64 = 0x24;

#[test]
fn the_timers_count_what_the_wheels_do() {
    let mut bench = Bench::new();
    for (timer, last) in [(0x4000_0000, 0xFFFF_FFFF), (0x4000_0400, 0xFFFF)] {
        bench.write(timer + 0x18, 0x0101);
        bench.write(timer + 0x2C, last);
        bench.write(timer + 8, 3);
        bench.write(timer, 1);
    }
    bench.write(GPIOA + AFRH, 1 << 28);
    bench.write(GPIOA + MODER, 2 << 30 | 1 << 4 | 1 << 6);
    bench.write(GPIOB + AFRL, 1 << 12);
    bench.write(GPIOC + AFRL, 0x2200_0000);
    bench.write(GPIOC + MODER, 2 << 12 | 2 << 14 | 1 << 28 | 1 << 30);
    // Both enables high by hand; the right wheel forward, the left one backward.
    bench.write(GPIOB + MODER, 2 << 6 | 1 << 16 | 1 << 18);
    bench.write(GPIOB + BSRR, 1 << 8 | 1 << 9);
    bench.write(GPIOA + BSRR, 1 << 2);
    bench.write(GPIOC + BSRR, 1 << 15);
    bench.run(700_000_000);
    // To rest, so that what the wheels have done the board has shown.
    bench.write(GPIOB + BSRR, 1 << 24 | 1 << 25);
    bench.run(2_000_000_000);
    let Sides { left, right } = bench.board.robot.around.world.wheel_counts();
    assert!(left > 500 && right < -500, "{left} {right}");
    let counted = |bench: &mut Bench, timer: u64| bench.read(timer + 0x24);
    let low = |count: i64, mask: u64| count.cast_unsigned() & mask;
    assert_eq!(counted(&mut bench, 0x4000_0000), low(left, 0xFFFF_FFFF));
    assert_eq!(counted(&mut bench, 0x4000_0400), low(right, 0xFFFF));
}

#[test]
fn a_trigger_is_answered_by_an_echo_as_long_as_the_way() {
    let mut bench = Bench::new();
    bench.write(GPIOC + MODER, 1 << 16);
    bench.write(GPIOC + BSRR, 1 << 8);
    bench.run(10_000);
    bench.write(GPIOC + BSRR, 1 << 24);
    let echo = |bench: &mut Bench| bench.read(GPIOC + 0x10) >> 9 & 1 != 0;
    let mut high = 0;
    for _ in 0..4_000 {
        bench.run(10_000);
        high += u32::from(echo(&mut bench));
    }
    // Tens of microseconds; the room is a few metres across: 1 to 20 ms, or 38 without echo.
    assert!((50..4_000).contains(&high), "{high}");
}

#[test]
fn a_transfer_crosses_the_wires_once_the_pins_are_the_spis() {
    let mut bench = Bench::new();
    let transfer = |bench: &mut Bench| {
        let steps = vec![
            Step::Select(true),
            Step::Wait(1_000),
            Step::bytes(&[0x3C], 8_000_000),
            Step::Wait(1_000),
            Step::Select(false),
        ];
        let now = bench.now;
        let robot = &mut bench.board.robot;
        robot.around.spi.play(now.0, steps);
        robot.poll(now);
        robot.settle(&mut NoMemory).unwrap();
        bench.run(10_000);
        pack(&bench.board.robot.around.spi.take_miso())
    };
    bench.write(0x4001_300C, 0xA5);
    bench.write(0x4001_3000, 1 << 6);
    assert_eq!(transfer(&mut bench), [0], "no pin carries it yet");
    bench.write(GPIOA + AFRL, 0x5555_0000);
    bench.write(GPIOA + MODER, 0xAA00);
    assert_eq!(transfer(&mut bench), [0xA5]);
    assert_eq!(bench.read(0x4001_300C), 0x3C);
}

#[test]
fn a_pulse_of_the_advanced_timer_turns_the_servo_once_its_outputs_are_switched_on() {
    const TIM1: u64 = 0x4001_0000;
    let mut bench = Bench::new();
    bench.write(0x4002_3844, 1 << 0 | 1 << 12 | 1 << 14);
    bench.write(GPIOA + AFRH, 1);
    bench.write(GPIOA + MODER, 2 << 16);
    // 16 MHz by 16; PWM mode 2 from 1 on, up to the end of the count.
    for (register, value) in [(0x28, 15), (0x34, 1), (0x18, 7 << 4), (0x20, 1), (0x14, 1)] {
        bench.write(TIM1 + register, value);
    }
    let pulses = |bench: &mut Bench, width: u64| {
        for _ in 0..40 {
            bench.write(TIM1 + 0x2C, width);
            bench.write(TIM1, 1 << 3 | 1);
            bench.run(20_000_000);
        }
        let servo = *bench.board.robot.around.world.servo();
        servo.angle_rad().to_degrees()
    };
    assert!(pulses(&mut bench, 2000).abs() < 1e-9, "the outputs are off");
    bench.write(TIM1 + 0x44, 1 << 15);
    assert!((pulses(&mut bench, 2000) - 90.0).abs() < 0.5);
    assert!((pulses(&mut bench, 1250) + 45.0).abs() < 0.5);
    let bearing = bench.board.robot.around.world.mount(0).bearing_rad;
    assert!((bearing.to_degrees() + 45.0).abs() < 0.5);
}

#[test]
fn the_motion_sensor_feels_the_robot_turn_and_pulls_its_pin() {
    use crate::components::i2c_bus::Side;
    use crate::components::mpu6050::{Mpu6050, Mpu6050Params, ADDRESS};
    let mut bench = Bench::new();
    let mut mpu = Mpu6050::new(
        Mpu6050Params {
            zero_deg_s: 0.0,
            scale: 1.0,
            noise_deg_s: 0.0,
        },
        1,
    );
    for bytes in [[0x6B, 0], [0x1B, 8], [0x38, 1]] {
        assert!(mpu.start(ADDRESS, false) && bytes.map(|byte| mpu.write(byte)) == [true; 2]);
    }
    let around = &mut bench.board.robot.around;
    around.i2c.lock().mpu = Some(mpu);
    around.world.faults.twist_deg_s = -90.0;
    bench.run(100_000_000);
    let mut bus = bench.board.robot.around.i2c.lock();
    assert!(bus.start(Side::Stm, 0, ADDRESS, false) && bus.write(Side::Stm, 0x47));
    assert!(bus.start(Side::Stm, 0, ADDRESS, true));
    let word = i16::from_be_bytes([bus.read(Side::Stm), bus.read(Side::Stm)]);
    drop(bus);
    assert!((f64::from(word) + 90.0 * 65.5).abs() < 3.0, "{word}");
    // GPIOB's IDR, bit 13: up for 50 µs of every millisecond.
    let level = |bench: &mut Bench| bench.read(GPIOB + 0x10) >> 13 & 1;
    let mut high = 0;
    for _ in 0..200 {
        bench.run(10_000);
        high += level(&mut bench);
    }
    assert!((8..=12).contains(&high), "{high} of 200 looks");
}
