//! A robot, the other end of its link and its parts, driven by a script of bytes; and what must be true
//! of it after each event.

use fw_core::binary64::Binary64;
use fw_core::log::Log;
use fw_core::motion::Odometry;
use fw_core::robot::{ReceivedFrame, Robot, TickInput, TickOutput, leds};
use fw_core::sensing::Calibration;
use fw_core::sensing::mpu6050::{self, BusRequest, BusResult};
use fw_core::wire::{
    self, CellCode, Command, DistanceCode, MAX_FRAME, Mode, PiLink, PoseCode, Report, Setup, State,
    frame_len,
};

use crate::property::Seen;
use fw_core::eeprom::Config;
use fw_core::types::{Faults, Micros, MotorCommand, RangefinderId};

/// The cases of [`robot_obeys_whatever_happens`](super::robot_obeys_whatever_happens).
const DROVE: u32 = 0;
const STOPPED: u32 = 1;
const FAULTED: u32 = 2;
const REJECTED: u32 = 3;
const FOLLOWED: u32 = 4;
const AIR: u32 = 5;

/// What happens, as bytes: each event is one, and takes its figures from those after it.
pub type Script = [u8; 192];

/// The script as it is read.
pub struct Events<'a>(core::slice::Iter<'a, u8>);

impl<'a> Events<'a> {
    pub fn new(script: &'a Script) -> Self {
        Self(script.iter())
    }

    pub fn more(&self) -> bool {
        !self.0.as_slice().is_empty()
    }

    pub fn byte(&mut self) -> u8 {
        self.0.next().copied().unwrap_or_default()
    }

    fn word(&mut self) -> u16 {
        u16::from_le_bytes([self.byte(), self.byte()])
    }

    /// A number of either sign, small more often than large.
    fn number(&mut self) -> i32 {
        let (size, value) = (self.byte(), self.byte());
        (i32::from(value) - 128) << (size % 20)
    }
}

/// An MPU6050 in order, as far as the conversation sees it.
#[derive(Default)]
struct Part {
    /// `CONFIG` and `GYRO_CONFIG`, which follows it.
    settings: [u8; 2],
    noise: i32,
}

impl Part {
    /// Least significant bits where nothing turns.
    const ZERO: i32 = 77;
    /// Least significant bits of a turn in a tick, 2⁻³²: 65.5 times 36 000.
    const RATE: i64 = 36_000 * mpu6050::LSB_PER_DEGREE_TENTHS as i64 / 10;

    /// What becomes of an order when the robot turned by `turn` in the last tick, 2⁻³², and by `apart`
    /// least significant bits more.
    fn answer(&mut self, order: BusRequest, turn: i32, apart: i32) -> BusResult {
        self.noise = (self.noise + 3) % 7;
        match order {
            BusRequest::Write { register, value } => {
                match register {
                    mpu6050::CONFIG => self.settings[0] = value,
                    mpu6050::GYRO_CONFIG => self.settings[1] = value,
                    _ => {}
                }
                BusResult::Done
            }
            BusRequest::Read { register, .. } => BusResult::Bytes(match register {
                mpu6050::WHO_AM_I => [mpu6050::IDENTITY, 0],
                mpu6050::CONFIG => self.settings,
                _ => {
                    let rate = (i64::from(turn) * Self::RATE) >> 32;
                    let rate = rate + i64::from(Self::ZERO + self.noise + apart);
                    let end = if rate < 0 { i16::MIN } else { i16::MAX };
                    i16::try_from(rate).unwrap_or(end).to_be_bytes()
                }
            }),
            BusRequest::Idle | BusRequest::DriveLines { .. } | BusRequest::ReleaseLines => {
                BusResult::Done
            }
        }
    }
}

/// The robot, its other end, its parts, and what must be true of it.
pub struct Rig {
    config: Config,
    pub setup: Setup,
    robot: Robot,
    /// The same wheels without anything else.
    encoders: Odometry,
    pi: PiLink,
    /// Number of the last reply.
    reply: u32,
    part: Part,
    /// Result of the last request to the gyroscope.
    outcome: BusResult,
    log: Log,
    now: Micros,
    sample: TickInput,
    last: [u8; MAX_FRAME],
    /// The rangefinder triggered last, and when.
    triggered: (RangefinderId, Micros),
    /// When the robot last took a frame, if it ever did.
    fresh: Option<Micros>,
    /// The robot has reported a slip, or the gyroscope did.
    slipped: bool,
    /// The cases met so far.
    pub seen: Seen,
}

impl Rig {
    pub fn new(config: Config, now: Micros, events: &mut Events<'_>) -> Self {
        let setup = config.link_setup();
        let sample = TickInput {
            now,
            ..TickInput::default()
        };
        let mut robot = Robot::new(&config, sample);
        // A part of the middle, one as the factory may leave it, or any words.
        let middle = |reference| Calibration {
            reference,
            cold: 959,
            hot: 1207,
        };
        robot.calibrate(match events.byte() % 4 {
            0 | 1 => middle(1501),
            2 => middle(1400 + events.word() % 201),
            _ => Calibration {
                reference: events.word(),
                cold: events.word(),
                hot: events.word(),
            },
        });
        Self {
            setup,
            robot,
            encoders: Odometry::new(&config, sample.left, sample.right),
            pi: PiLink::new(setup),
            reply: 1,
            part: Part::default(),
            outcome: BusResult::Done,
            log: Log::new(),
            now,
            sample,
            last: [0; MAX_FRAME],
            triggered: (RangefinderId::Front, now),
            fresh: None,
            slipped: false,
            seen: Seen::NOTHING,
            config,
        }
    }

    /// Half of what is pending leaves.
    pub fn transmit(&mut self) {
        let pending = self.log.pending().len();
        self.log.sent(pending / 2);
    }

    /// The last frame again, or what was made of it, so many bytes long.
    pub fn frame(&mut self, clocked: usize) {
        let before = *self.robot.counters();
        let frame = self.last;
        let received = ReceivedFrame {
            bytes: frame.get(..clocked).unwrap_or(&frame),
            overflow_len: clocked.saturating_sub(frame.len()),
            at: self.now,
            reply: self.reply + 1,
        };
        let received = self.robot.receive(&received);
        let after = self.robot.counters();
        assert!(received.is_ok() == (after.accepted == before.accepted + 1));
        assert!(received.is_err() == (after.rejected_total() == before.rejected_total() + 1));
        if let Ok(command) = received {
            self.robot.execute(&command, self.now, &mut self.log);
            self.fresh = Some(self.now);
        } else {
            self.seen = self.seen.case(REJECTED, self.fresh.is_some());
        }
        self.reply += 1;
        let _ = self.report();
    }

    /// A reply is one that the Pi takes.
    fn read(&self, reply: &[u8; MAX_FRAME], len: usize) -> Report {
        assert!(len == frame_len(self.setup.mode));
        let report = PiLink::new(self.setup).receive(&reply[..len]);
        assert!(report.is_ok());
        report.unwrap_or_default()
    }

    /// Anything at all, of any length.
    pub fn noise(&mut self, events: &mut Events<'_>) {
        let salt = events.byte();
        for byte in &mut self.last {
            *byte = byte.wrapping_mul(31) ^ salt;
        }
        self.frame(usize::from(events.byte()));
    }

    /// What the Pi may say.
    pub fn command(&mut self, events: &mut Events<'_>) {
        let kind = events.byte();
        let percent = [0.0_f64, 50.0, -100.0, 12.5][usize::from(kind & 3)];
        let command = Command {
            expected: PoseCode {
                x: events.number(),
                y: events.number(),
                rotation: u16::from(events.byte()) << 7,
            },
            apply: kind & 4 != 0,
            percent: Binary64(percent.to_bits()),
            tune: CellCode {
                cell: kind % self.setup.cells,
                voltage: if kind & 8 == 0 { 0 } else { 800 },
            },
            order: match kind >> 4 & 7 {
                0 => wire::Order::Stop,
                1..=3 => wire::Order::Resume,
                _ => wire::Order::None,
            },
            clear_faults: if kind & 0x80 == 0 {
                Faults::NONE
            } else {
                Faults::ALL_BITS
            },
            ..Command::default()
        };
        let len = self.pi.send(&command, &mut self.last);
        self.frame(len);
    }

    /// An echo, of the last trigger more often than not.
    pub fn echo(&mut self, events: &mut Events<'_>) {
        let choice = usize::from(events.byte() % 8);
        let which = RangefinderId::ALL.get(choice).copied();
        let which = which.unwrap_or(self.triggered.0);
        let rise = self.triggered.1.after(u32::from(events.byte()) * 16);
        let fall = rise.after(u32::from(events.byte()) * 128);
        let before = self.report().ranges;
        self.robot.on_echo(which, rise, fall);
        let after = self.report().ranges;
        for (DistanceCode(before), DistanceCode(after)) in before.into_iter().zip(after) {
            if after == before || DistanceCode(after) == DistanceCode::NONE {
                continue;
            }
            // Micrometres to a step of the code, and half the way at 306 to 384 m/s: from −40 to 85 °C.
            let width = u64::from(fall.since(rise));
            let distance = u64::from(after) * 2_500_000 / 65_535;
            assert!(distance + 40 >= width * 153 && distance <= width * 192 + 40);
            let assumed = width * 343 / 2;
            self.seen = self.seen.case(AIR, assumed.abs_diff(distance) > 1_000);
        }
    }

    /// What the robot would tell now.
    fn report(&mut self) -> Report {
        let mut reply = [0; MAX_FRAME];
        let len = self.robot.encode_reply(self.reply, &mut reply);
        self.read(&reply, len)
    }

    pub fn fault(&mut self, events: &mut Events<'_>) {
        let fault = Faults::from_bits(1 << (events.byte() & 0xF));
        self.robot.raise(fault, &mut self.log);
        self.robot
            .on_lost_frames(u32::from(events.byte()), &mut self.log);
    }

    /// Up to 4.2 s in which no tick comes.
    pub fn pause(&mut self, events: &mut Events<'_>) {
        self.now = self.now.after(u32::from(events.byte()) << 14);
    }

    /// Words of the temperature's channels, mostly near those of a part at 30 °C.
    pub fn temperature(&mut self, events: &mut Events<'_>) {
        let (sensor, reference) = (events.word(), events.word());
        let (sensor, reference) = match events.byte() % 4 {
            0 => (sensor, reference),
            _ => (750 + sensor % 512, 1400 + reference % 201),
        };
        self.robot.on_temperature(sensor, reference, &mut self.log);
    }

    /// Something else became of the gyroscope's order.
    pub fn upset(&mut self, events: &mut Events<'_>) {
        self.outcome = match events.byte() % 4 {
            0 => BusResult::Nack,
            1 => BusResult::Timeout,
            2 => BusResult::Done,
            _ => BusResult::Bytes(events.word().to_le_bytes()),
        };
    }

    /// A tick in which the wheels do as they like.
    pub fn tick(&mut self, events: &mut Events<'_>) {
        self.pass(events.number(), events.number(), events.byte(), 0);
    }

    /// A while in which the robot rests or turns evenly: a gyroscope wakes up, finds its zero, agrees with
    /// the wheels or does not.
    pub fn stretch(&mut self, events: &mut Events<'_>) {
        let (wheels, apart, ticks) = (events.byte(), events.byte(), events.byte());
        let counts = i32::from(wheels & 1) * (i32::from(wheels >> 1) % 32);
        let apart = (i32::from(apart) - 208) * if apart < 160 { 0 } else { 64 };
        // From a third of a second to one and a half.
        for _ in 0..32 + ticks / 2 {
            self.pass(-counts, counts, 0xE0, apart);
        }
    }

    /// 10 ms later: the gyroscope's answer, then the tick.
    fn pass(&mut self, left: i32, right: i32, word: u8, apart: i32) {
        self.sample.supply_low = word % 32 == 31;
        self.sample.left = self.sample.left.wrapping_add_signed(left);
        self.sample.right = self.sample.right.wrapping_add_signed(right as i16);
        self.now = self.now.after(10_000);
        self.sample.now = self.now;
        let order = self.robot.on_gyro(self.outcome, &mut self.log);
        self.order_is_right(order);
        // Only a command clears it.
        self.slipped |= self.robot.faults().intersects(Faults::SLIP);
        let delta = self.encoders.step(self.sample.left, self.sample.right);
        self.outcome = self.part.answer(order, delta.turn, apart);
        let word = u16::from(word) << 4;
        let outputs = self
            .robot
            .on_tick(self.sample, &[word / 2, word], &mut self.log);
        self.outputs_are_right(&outputs);
        assert!(self.slipped || self.robot.pose() == self.encoders.pose());
        if let Some(which) = outputs.trigger {
            self.triggered = (which, self.now);
        }
        let _ = self.report();
    }

    /// Nothing is asked of a gyroscope that is not there, nor in the tuning modes.
    fn order_is_right(&self, order: BusRequest) {
        let drives = matches!(
            self.setup.mode,
            Mode::Normal | Mode::GuardedNormal | Mode::GuardedSweep | Mode::GuardedVelocity
        );
        assert!(order == BusRequest::Idle || drives && self.config.gyro());
    }

    fn outputs_are_right(&mut self, outputs: &TickOutput) {
        let braked = outputs.left == MotorCommand::Brake && outputs.right == MotorCommand::Brake;
        let state = self.robot.state();
        assert!(outputs.leds == leds(state) && state != State::Booting);
        for (drive, limit) in [
            (outputs.left, self.config.left().limit),
            (outputs.right, self.config.right().limit),
        ] {
            if let MotorCommand::Run(duty) = drive {
                assert!(duty.hundredths().abs() <= limit.hundredths());
                assert!(self.fresh.is_some());
                self.seen = self.seen.case(DROVE, true);
            }
        }
        // Silence, from the last frame that was taken.
        let allowed = u32::from(self.config.stop_deadline().0) * 1000;
        let since_fresh = self.fresh.map(|fresh| self.now.since(fresh));
        if since_fresh >= Some(allowed) {
            assert!(braked && matches!(state, State::Stopped | State::Faulted));
            self.seen = self.seen.case(STOPPED, self.seen.has(DROVE));
        }
        if self.robot.faults().intersects(Faults::BLOCKING) {
            assert!(braked && state == State::Faulted);
        }
        assert!(braked || state != State::Stopped && !self.sample.supply_low);
        let turned = self.robot.pose().heading != self.encoders.pose().heading;
        self.seen = self.seen.case(FAULTED, state == State::Faulted);
        self.seen = self.seen.case(FOLLOWED, turned);
        if let Some(width) = outputs.servo {
            assert!((1000..=2000).contains(&width) && self.config.servo().is_some());
            assert!(state != State::Faulted);
            // Like the motors: not before a frame was taken, not after the silence.
            assert!(since_fresh.is_some_and(|since| since < allowed));
        }
    }
}
