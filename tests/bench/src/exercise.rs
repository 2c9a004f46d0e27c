//! The whole core in use: a robot that drives a course, in each mode, with frames, echoes, a gyroscope
//! and its log, and a digest of all that it put out.

use fw_core::binary64::Binary64;
use fw_core::eeprom::{Config, Image, fields};
use fw_core::log::Log;
use fw_core::robot::{ReceivedFrame, Robot, TickInput};
use fw_core::sensing::Calibration;
use fw_core::sensing::mpu6050::{BusRequest, BusResult, CONFIG, WHO_AM_I};
use fw_core::types::{Faults, Micros, MotorCommand, Velocity};
use fw_core::wire::{Command, MAX_FRAME, Mode, Order, PiLink, PoseCode};

use crate::course::Course;

/// Ticks driven in each mode.
const TICKS: u32 = 50_000;
/// A new command every two seconds.
const COMMAND_TICKS: u32 = 200;
/// One frame in so many arrives with a wrong bit.
const CORRUPT: u32 = 37;

/// FNV-1a of bytes.
struct Digest(u64);

impl Digest {
    fn bytes(&mut self, bytes: &[u8]) {
        for &byte in bytes {
            self.0 = (self.0 ^ u64::from(byte)).wrapping_mul(0x0000_0100_0000_01B3);
        }
    }

    fn motor(&mut self, command: MotorCommand) {
        let code = match command {
            MotorCommand::Coast => i16::MIN,
            MotorCommand::Brake => i16::MAX,
            MotorCommand::Run(duty) => duty.hundredths(),
        };
        self.bytes(&code.to_le_bytes());
    }
}

/// An MPU6050 that reads `rate`.
fn gyro(request: BusRequest, rate: i16) -> BusResult {
    match request {
        BusRequest::Read { register, .. } if register == WHO_AM_I => BusResult::Bytes([0x68, 0]),
        BusRequest::Read { register, .. } if register == CONFIG => BusResult::Bytes([3, 8]),
        BusRequest::Read { .. } => BusResult::Bytes(rate.to_be_bytes()),
        _ => BusResult::Done,
    }
}

/// Drives in this mode. Returns the digest and the last reply's pose: x, y, rotation.
pub fn exercise(mode: Mode) -> (u64, [i32; 3]) {
    let image = Image::FIRST_BOARD
        .with(fields::MODE, mode.code().into())
        .with(fields::GYRO, 1)
        .with(fields::SERVO, 1)
        .with(fields::LOG_PERIOD, 100);
    let config = Config::decode(&image).expect("accepted");
    let (mut random, mut course) = (Course::curves(), Course::curves());
    let mut input = TickInput::default();
    let mut robot = Robot::new(&config, input);
    robot.calibrate(Calibration {
        reference: 1501,
        cold: 959,
        hot: 1207,
    });
    let (mut pi, mut log) = (PiLink::new(config.link_setup()), Log::new());
    let (mut command, mut reply, mut number) = (Command::default(), [0; MAX_FRAME], 1);
    let (mut bus, mut rate, mut pose) = (BusResult::Done, 0_i16, [0; 3]);
    let mut digest = Digest(0xCBF2_9CE4_8422_2325);
    let mut len = robot.encode_reply(number, &mut reply);
    for tick in 1..=TICKS {
        input.now = Micros(tick * 10_000);
        let request = robot.on_gyro(bus, &mut log);
        bus = gyro(request, rate);
        let words = [
            3400 + random.below(60) as u16,
            3540 + random.below(60) as u16,
        ];
        let output = robot.on_tick(input, &words, &mut log);
        digest.motor(output.left);
        digest.motor(output.right);
        digest.bytes(&output.servo.unwrap_or_default().to_le_bytes());
        digest.bytes(&[output.leds, output.trigger.map_or(9, |which| which as u8)]);
        if let Some(which) = output.trigger {
            let rise = input.now.after(400);
            let width = 600 + random.below(24_000).unsigned_abs();
            robot.on_echo(which, rise, rise.after(width));
        }
        if tick % 100 == 0 {
            robot.on_temperature(940 + random.below(30) as u16, 1501, &mut log);
        }
        if tick % COMMAND_TICKS == 1 {
            command = Command {
                expected: PoseCode {
                    x: random.below(1_000_000),
                    y: random.below(1_000_000),
                    rotation: random.below(0x8000).unsigned_abs() as u16,
                },
                apply: true,
                percent: Binary64::from_scaled(random.below(100).into(), 0),
                velocity: Velocity {
                    forward: random.below(200_000),
                    yaw_rate: random.below(1 << 29),
                },
                sweep: random.below(0x4000).unsigned_abs() as u16,
                clear_faults: Faults::from_bits(u16::MAX),
                order: Order::Resume,
                ..command
            };
        }
        if tick % 3 == 0 {
            let mut frame = [0; MAX_FRAME];
            let sent = pi.send(&command, &mut frame);
            if tick % CORRUPT == 0 {
                frame[tick as usize % sent] ^= 1 << (tick % 8);
            }
            digest.bytes(&reply[..len]);
            if let Ok(report) = pi.receive(&reply[..len]) {
                let PoseCode { x, y, rotation } = report.pose;
                pose = [x, y, rotation.into()];
                digest.bytes(&report.measurement.0.to_le_bytes());
            }
            number += 1;
            let received = ReceivedFrame {
                bytes: &frame[..sent],
                overflow_len: 0,
                at: input.now.after(3_000),
                reply: number,
            };
            let accepted = robot.receive(&received);
            len = robot.encode_reply(number, &mut reply);
            if let Ok(command) = accepted {
                robot.execute(&command, received.at, &mut log);
            }
            (command.clear_faults, command.order) = (Faults::NONE, Order::None);
        }
        digest.bytes(log.pending());
        log.sent(log.pending().len());
        // What the wheels rolled until the next tick; now and then one of them slips.
        let counts = course.next().unwrap_or(crate::Tick { left: 0, right: 0 });
        let slip = if tick % 1_000 < 60 { 9 } else { 0 };
        input.left = input.left.wrapping_sub((counts.left + slip) as u32);
        input.right = input.right.wrapping_sub(counts.right as u16);
        // A count of difference is 0.03° in a tick of 10 ms.
        rate = ((counts.right - counts.left) * 196 + random.below(7)) as i16;
    }
    (digest.0, pose)
}
