//! The whole robot: any configuration that the EEPROM accepts, any events in any order, each as its
//! interrupt would hand it in. Nothing panics, and after the stop deadline without a fresh frame
//! nothing drives.
#![no_main]

use fw_core::eeprom::{check, first_board, Config, FIELDS};
use fw_core::log::Log;
use fw_core::robot::{ReceivedFrame, Robot, TickInput};
use fw_core::sensing::mpu6050::{BusRequest, BusResult};
use fw_core::sensing::Calibration;
use fw_core::types::{Faults, Micros, MotorCommand, RangefinderId};
use fw_core::wire::{Mode, MAX_FRAME};
use libfuzzer_sys::fuzz_target;
use robot_fuzz::{frame, Bytes};

/// A tick and what the clock of a tick may be late, in microseconds.
const SLACK: u32 = 20_000;
/// Ticks in an input: enough for a gyroscope to be found and to rest, and no more, for many short lives
/// find more than a long one.
const LIFE: u32 = 1_000;

/// Of the MPU6050, whose GYRO_CONFIG follows CONFIG.
const CONFIG: u8 = 0x1A;
const GYRO_CONFIG: u8 = 0x1B;
const WHO_AM_I: u8 = 0x75;

fuzz_target!(|data: &[u8]| {
    let mut bytes = Bytes::new(data);
    let Some(config) = config(&mut bytes) else {
        return;
    };
    let mut bench = Bench::new(&config, Micros(u32::from_le_bytes(bytes.array())));
    bench.robot.calibrate(Calibration {
        reference: u16::from_le_bytes(bytes.array()),
        cold: u16::from_le_bytes(bytes.array()),
        hot: u16::from_le_bytes(bytes.array()),
    });
    while bytes.more() && bench.ticks < LIFE {
        bench.event(&mut bytes, &config);
    }
});

/// The first board's with a few fields changed, if that is accepted.
fn config(bytes: &mut Bytes) -> Option<Config> {
    let mut config = first_board();
    let modes: Vec<Mode> = (0..=u8::MAX).filter_map(Mode::from_code).collect();
    let [mode, switches, changes] = bytes.array();
    config.mode = modes[usize::from(mode) % modes.len()];
    config.platform.gyro = switches & 1 != 0;
    config.platform.servo = switches & 2 != 0;
    for _ in 0..changes % 8 {
        let field = usize::from(bytes.byte()) % FIELDS.len();
        FIELDS[field].set(&mut config, u64::from_le_bytes(bytes.array()));
    }
    check(&config).is_ok().then_some(config)
}

/// The robot and what happens around it.
struct Bench {
    robot: Robot,
    log: Log,
    now: Micros,
    sample: TickInput,
    words: [u16; 8],
    ticks: u32,
    /// Number of the next reply.
    reply: u32,
    /// What became of the gyroscope's last order, and what its registers hold.
    outcome: BusResult,
    registers: [u8; 2],
    /// Microseconds since a frame was taken, and how many may pass.
    silent: u32,
    deadline: u32,
}

impl Bench {
    fn new(config: &Config, now: Micros) -> Self {
        let sample = TickInput {
            now,
            ..TickInput::default()
        };
        Self {
            robot: Robot::new(config, sample),
            log: Log::new(),
            now,
            sample,
            words: [0; 8],
            ticks: 0,
            reply: 1,
            outcome: BusResult::Done,
            registers: [0; 2],
            silent: 0,
            deadline: u32::from(config.platform.stop_deadline) * 1000,
        }
    }

    fn event(&mut self, bytes: &mut Bytes, config: &Config) {
        let choice = bytes.byte();
        let high = choice >> 4;
        match choice % 12 {
            0..=2 => {
                let [left, right] = bytes.array::<2>().map(u8::cast_signed);
                self.tick(left, right, bytes.byte());
            }
            // A while in which nothing changes: a gyroscope wakes up, a battery stays as it is.
            3 => {
                for noise in 0..u16::from(bytes.byte()) {
                    self.tick(0, 0, noise.to_le_bytes()[0]);
                }
            }
            4 | 5 => {
                let received = frame(bytes, config.mode, config.key_from_pi);
                self.frame(&received);
            }
            6 => {
                let which = RangefinderId::ALL[usize::from(high) % 3];
                let [rise, fall] = [bytes.array(), bytes.array()].map(u16::from_le_bytes);
                let rise = self.now.after(rise.into());
                self.robot.on_echo(which, rise, rise.after(fall.into()));
            }
            7 => {
                let [rise, fall] = [bytes.array(), bytes.array()].map(u32::from_le_bytes);
                let which = RangefinderId::ALL[usize::from(high) % 3];
                self.robot.on_echo(which, Micros(rise), Micros(fall));
            }
            8 => {
                let [sensor, reference] = [bytes.array(), bytes.array()].map(u16::from_le_bytes);
                self.robot.on_temperature(sensor, reference, &mut self.log);
            }
            9 => {
                self.outcome = match high % 4 {
                    0 => BusResult::Nack,
                    1 => BusResult::Timeout,
                    2 => BusResult::Done,
                    _ => BusResult::Bytes(bytes.array()),
                }
            }
            10 => {
                let tap = usize::from(high) % self.words.len();
                self.words[tap] = u16::from_le_bytes(bytes.array());
                self.robot.on_lost_frames(high.into(), &mut self.log);
                self.robot
                    .raise(Faults::from_bits(u16::from(bytes.byte())), &mut self.log);
            }
            _ => self.log.sent(usize::from(high) * 16),
        }
    }

    /// 10 ms later: the gyroscope's answer, then the tick.
    fn tick(&mut self, left: i8, right: i8, rate: u8) {
        self.ticks += 1;
        self.now = self.now.after(10_000);
        self.silent = self.silent.saturating_add(10_000);
        let order = self.robot.on_gyro(self.outcome, &mut self.log);
        self.outcome = self.answer(order, rate);
        self.sample = TickInput {
            now: self.now,
            left: self.sample.left.wrapping_add_signed(left.into()),
            right: self.sample.right.wrapping_add_signed(right.into()),
        };
        let outputs = self.robot.on_tick(self.sample, &self.words, &mut self.log);
        if self.silent > self.deadline.saturating_add(SLACK) {
            for drive in [outputs.left, outputs.right] {
                assert!(
                    !matches!(drive, MotorCommand::Run(_)),
                    "driving without a frame"
                );
            }
            assert!(outputs.servo.is_none(), "a servo held without a frame");
        }
        let mut out = [0; MAX_FRAME];
        self.robot.encode_reply(self.reply, &mut out);
    }

    /// What an MPU6050 in order makes of the driver's wish.
    fn answer(&mut self, order: BusRequest, rate: u8) -> BusResult {
        match order {
            BusRequest::Write { register, value } => {
                match register {
                    CONFIG => self.registers[0] = value,
                    GYRO_CONFIG => self.registers[1] = value,
                    _ => {}
                }
                BusResult::Done
            }
            BusRequest::Read {
                register: WHO_AM_I, ..
            } => BusResult::Bytes([0x68, 0]),
            BusRequest::Read {
                register: CONFIG, ..
            } => BusResult::Bytes(self.registers),
            BusRequest::Read { .. } => BusResult::Bytes([rate >> 6, rate]),
            _ => BusResult::Done,
        }
    }

    fn frame(&mut self, received: &[u8]) {
        let mut out = [0; MAX_FRAME];
        let accepted = self.robot.counters().accepted;
        self.reply += 1;
        let frame = ReceivedFrame {
            bytes: received,
            overflow_len: 0,
            at: self.now,
            reply: self.reply,
        };
        self.robot.on_frame(&frame, &mut self.log);
        if self.robot.counters().accepted != accepted {
            self.silent = 0;
        }
        self.robot.encode_reply(self.reply, &mut out);
    }
}
