//! The robot from outside: counters, words of the ADC and frames in; duties, pulses, replies and lines
//! of the log out.

mod platform;

use fw_core::eeprom::{fields, Config, Field, Image};
use fw_core::log::Log;
use fw_core::robot::{ReceivedFrame, Robot, TickInput, TickOutput};
use fw_core::types::{Micros, MotorCommand};
use fw_core::wire::{Command, Mode, PiLink, PoseCode, Report, MAX_FRAME};

/// Microseconds from tick to tick.
const TICK_US: u32 = 10_000;

/// A robot on the bench, and its Pi.
struct Bench {
    robot: Robot,
    pi: PiLink,
    /// Number of the last reply.
    reply: u32,
    log: Log,
    sample: TickInput,
    /// What the first board's two taps say: some 3.6 V a cell.
    words: [u16; 2],
}

impl Bench {
    /// The first board in this mode, with other raw values in some fields.
    fn new(mode: Mode, changes: &[(&Field, u64)]) -> Self {
        let mut image = Image::FIRST_BOARD.with(fields::MODE, mode.code().into());
        for &(field, raw) in changes {
            image = image.with(field, raw);
        }
        let config = Config::decode(&image).expect("accepted");
        let sample = TickInput {
            now: Micros(u32::MAX - 3 * TICK_US),
            left: 1_000,
            right: 64_000,
        };
        Self {
            robot: Robot::new(&config, sample),
            pi: PiLink::new(config.link_setup()),
            reply: 0,
            log: Log::new(),
            sample,
            words: [3428, 3574],
        }
    }

    fn tick(&mut self) -> TickOutput {
        self.sample.now = self.sample.now.after(TICK_US);
        self.robot.on_tick(self.sample, &self.words, &mut self.log)
    }

    /// Both counters go on by so many counts, then a tick.
    fn roll(&mut self, left: i32, right: i16) -> TickOutput {
        self.sample.left = self.sample.left.wrapping_add_signed(left);
        self.sample.right = self.sample.right.wrapping_add_signed(right);
        self.tick()
    }

    /// One chip-select: what the robot says in it.
    fn frame(&mut self, command: &Command) -> Report {
        let (mut back, mut out) = ([0; MAX_FRAME], [0; MAX_FRAME]);
        self.reply += 1;
        let len = self.robot.encode_reply(self.reply, &mut back);
        let sent = self.pi.send(command, &mut out);
        let frame = ReceivedFrame {
            bytes: &out[..sent],
            overflow_len: 0,
            at: self.sample.now,
            reply: self.reply + 1,
        };
        self.robot.on_frame(&frame, &mut self.log);
        self.pi.receive(&back[..len]).expect("a valid reply")
    }
}

/// To drive to: millimetres along x, and hundredths of a turn.
fn go(x_mm: i32, hundredths: u16) -> Command {
    Command {
        expected: PoseCode {
            x: x_mm * 1000,
            y: 0,
            rotation: hundredths * 327,
        },
        apply: true,
        ..Command::default()
    }
}

/// To set on the engines, in a tuning mode.
fn percent(percent: f64) -> Command {
    Command {
        percent: fw_core::binary64::Binary64(percent.to_bits()),
        ..Command::default()
    }
}

/// A motor's duty in hundredths of a percent; 0 for one that is not driven.
fn duty(drive: MotorCommand) -> i32 {
    match drive {
        MotorCommand::Run(duty) => duty.hundredths().into(),
        MotorCommand::Brake | MotorCommand::Coast => 0,
    }
}
