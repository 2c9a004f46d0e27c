//! The steps that take time, a hundredth of a second each turn, in the order of [`Step`].

use crate::gyro::Gyro;
use crate::motors::Motors;
use crate::rangefinders;
use crate::spi::SpiSlave;
use crate::uart::Uart;
use crate::{adc, encoders, stack};
use fw_core::captured::CapturedEcho;
use fw_core::log::{Level, Log};
use fw_core::sensing::mpu6050::{BusRequest, BusResult, WHO_AM_I};
use fw_core::types::{Duty, MotorCommand, RangefinderId};
use fw_core::wire::test_frame;

/// Ticks of a second.
const SECOND: u32 = 100;
/// Ticks that an echo may take, out of range included.
const ECHO_TICKS: u32 = 10;
/// Most counts of a wheel that stands.
const REST_COUNTS: i32 = 4;
/// Ticks for each wheel to be turned by hand.
const HAND_TICKS: u32 = 30 * SECOND;
/// Counts by hand that make a turn of the wheel no accident: an eighth of the first board's wheel.
const HAND_COUNTS: i32 = 150;
/// Ticks to take the hands off before the motors run.
const WARNING_TICKS: u32 = 3 * SECOND;
/// Ticks that a motor runs and then rests, and its duty, hundredths of a percent: well above the dead zone.
const RUN_TICKS: u32 = 40;
const REST_TICKS: u32 = 40;
const DUTY: i32 = 6_000;

/// A wheel.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Wheel {
    Left,
    Right,
}

impl Wheel {
    const fn name(self) -> &'static str {
        match self {
            Self::Left => "left",
            Self::Right => "right",
        }
    }
}

/// What is tried.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Step {
    /// Battery taps and the part's own supply.
    Supply,
    /// Identity of the gyroscope.
    Gyro,
    /// One rangefinder.
    Echo(RangefinderId),
    /// Counts of wheels that stand.
    Rest,
    /// A wheel is turned forward by hand.
    Hand(Wheel),
    /// The motors are about to run.
    Warning,
    /// A motor runs, forward or backward.
    Motor(Wheel, bool),
    /// The stack overflows on purpose; the part restarts.
    Stack,
    /// Frames of [`test_frame`] both ways, for good.
    Link,
}

/// The drivers.
pub struct Drivers {
    /// The link to the Pi.
    pub spi: SpiSlave,
    /// Both bridges.
    pub motors: Motors,
    /// The gyroscope's bus.
    pub gyro: Gyro,
    /// The log's transmitter.
    pub uart: Uart,
}

// Requirement: WIRE-bringup-1
/// The step under way and what it has seen.
pub struct Sequence {
    step: Step,
    /// Ticks since the step began.
    ticks: u32,
    /// Counters when the step began.
    origin: (u32, u16),
    /// Both wheels stood, then were turned by hand: the motors may run.
    consent: bool,
    /// Width of the last echo, microseconds.
    echo_us: Option<u32>,
    frames: u32,
    good: u32,
    lost: u32,
    /// Bytes of a reply that the idle slave holds ready.
    prefetched: u32,
}

impl Sequence {
    /// The first step.
    pub const FIRST: Self = Self {
        step: Step::Supply,
        ticks: 0,
        origin: (0, 0),
        consent: true,
        echo_us: None,
        frames: 0,
        good: 0,
        lost: 0,
        prefetched: 0,
    };

    /// The steps up to the overflow were done before the reset.
    pub fn resume_after_overflow(&mut self) {
        self.step = Step::Link;
    }

    /// An echo has come back.
    pub fn on_echo(&mut self, echo: &CapturedEcho) {
        if self.step == Step::Echo(echo.which) {
            self.echo_us = Some(echo.fall.since(echo.rise));
        }
    }

    /// A frame has arrived, and `lost` before it were not read.
    pub fn on_frame(&mut self, bytes: &[u8], lost: u32) {
        self.frames = self.frames.wrapping_add(1);
        self.lost = self.lost.wrapping_add(lost);
        self.good = self.good.wrapping_add(test_frame::is_whole(bytes).into());
    }

    /// One turn of the step under way.
    pub fn on_tick(&mut self, drivers: &mut Drivers, log: &mut Log) {
        if self.ticks == 0 {
            self.origin = encoders::read();
            self.begin(drivers, log);
        }
        self.ticks += 1;
        if let Some(next) = self.turn(drivers, log) {
            self.step = next;
            self.ticks = 0;
        }
    }

    /// Starts what the step does to the board.
    fn begin(&mut self, drivers: &mut Drivers, log: &mut Log) {
        match self.step {
            Step::Echo(which) => {
                self.echo_us = None;
                rangefinders::trigger(which);
            }
            Step::Link => self.prefetched = drivers.spi.prefetched().unwrap_or(self.prefetched),
            Step::Hand(wheel) => log.line(Level::Info, |line| {
                line.text("hand turn the ").text(wheel.name());
                line.text(" wheel forward, a quarter turn");
            }),
            Step::Warning => log.text(Level::Warn, "hands off, the motors run in 3 s"),
            Step::Motor(wheel, forward) => {
                let duty = Duty::saturating(if forward { DUTY } else { -DUTY });
                let (run, other) = (MotorCommand::Run(duty), MotorCommand::Coast);
                match wheel {
                    Wheel::Left => drivers.motors.set(run, other),
                    Wheel::Right => drivers.motors.set(other, run),
                }
            }
            _ => {}
        }
    }

    /// Counts of both wheels since the step began.
    fn counts(&self) -> (i32, i32) {
        let (left, right) = encoders::read();
        let left = left.wrapping_sub(self.origin.0) as i32;
        let right = right.wrapping_sub(self.origin.1) as i16;
        (left, right.into())
    }

    /// The step that follows once this one has ended.
    fn turn(&mut self, drivers: &mut Drivers, log: &mut Log) -> Option<Step> {
        let after = |ticks: u32, next: Step| (self.ticks >= ticks).then_some(next);
        let next = match self.step {
            Step::Supply => after(3, Step::Gyro)?,
            Step::Gyro => {
                let result = drivers.gyro.take();
                if self.ticks == 1 {
                    let (register, count) = (WHO_AM_I, 1);
                    drivers.gyro.begin(BusRequest::Read { register, count });
                    return None;
                }
                report_gyro(result, log);
                return Some(Step::Echo(RangefinderId::Front));
            }
            Step::Echo(which) => after(ECHO_TICKS, after_echo(which))?,
            Step::Rest => {
                let next = after(SECOND, Step::Hand(Wheel::Left))?;
                // What counts at rest is no hand that agrees.
                let (left, right) = self.counts();
                self.consent = left.abs().max(right.abs()) <= REST_COUNTS;
                next
            }
            Step::Hand(wheel) => {
                let (left, right) = self.counts();
                let own = if wheel == Wheel::Left { left } else { right };
                let turned = own.abs() >= HAND_COUNTS;
                if !turned && self.ticks < HAND_TICKS {
                    return None;
                }
                self.consent &= turned;
                match wheel {
                    Wheel::Left => Step::Hand(Wheel::Right),
                    Wheel::Right if self.consent => Step::Warning,
                    Wheel::Right => Step::Stack,
                }
            }
            Step::Warning => return after(WARNING_TICKS, Step::Motor(Wheel::Left, true)),
            Step::Motor(wheel, forward) => {
                if self.ticks == RUN_TICKS {
                    drivers.motors.set(MotorCommand::Brake, MotorCommand::Brake);
                }
                let next = match (wheel, forward) {
                    (wheel, true) => Step::Motor(wheel, false),
                    (Wheel::Left, false) => Step::Motor(Wheel::Right, true),
                    (Wheel::Right, false) => Step::Stack,
                };
                after(RUN_TICKS + REST_TICKS, next)?
            }
            Step::Stack => {
                if self.ticks == 1 {
                    drivers.motors.set(MotorCommand::Coast, MotorCommand::Coast);
                    log.text(Level::Info, "stack overflows on purpose");
                    return None;
                }
                if !log.pending().is_empty() && self.ticks < SECOND {
                    return None;
                }
                stack::overflow()
            }
            Step::Link => after(SECOND, Step::Link)?,
        };
        self.report(log);
        Some(next)
    }

    /// The line of a step that has ended.
    fn report(&self, log: &mut Log) {
        let (left, right) = self.counts();
        log.line(Level::Info, |line| {
            match self.step {
                Step::Supply => {
                    let calibration = adc::calibration();
                    line.text("supply calibration ")
                        .int(calibration.reference.into());
                    if let Some((_, reference)) = adc::temperature() {
                        line.text(" reference ").int(reference.into());
                    }
                    if let Some([first, second]) = adc::words() {
                        line.text(" taps ")
                            .int(first.into())
                            .text(" ")
                            .int(second.into());
                    }
                    return;
                }
                Step::Echo(which) => {
                    line.text("echo ").text(which.name());
                    match self.echo_us {
                        Some(width) => line.text(" us ").int(width.into()),
                        None => line
                            .text(" level ")
                            .int(rangefinders::pins(which).1.is_high().into()),
                    };
                    return;
                }
                Step::Link => {
                    line.text("link frames ").int(self.frames.into());
                    line.text(" good ").int(self.good.into());
                    line.text(" lost ").int(self.lost.into());
                    line.text(" prefetched ").int(self.prefetched.into());
                    return;
                }
                Step::Rest => line.text("rest"),
                Step::Hand(wheel) => line.text("turned ").text(wheel.name()),
                Step::Motor(wheel, forward) => {
                    line.text("motor ").text(wheel.name());
                    line.text(if forward { " forward" } else { " backward" })
                }
                Step::Gyro | Step::Warning | Step::Stack => return,
            };
            line.text(" counts ")
                .int(left.into())
                .text(" ")
                .int(right.into());
        });
    }
}

/// Each rangefinder in turn.
const fn after_echo(which: RangefinderId) -> Step {
    match which {
        RangefinderId::Front => Step::Echo(RangefinderId::Right),
        RangefinderId::Right => Step::Echo(RangefinderId::Left),
        RangefinderId::Left => Step::Rest,
    }
}

fn report_gyro(result: BusResult, log: &mut Log) {
    log.line(Level::Info, |line| {
        line.text("gyro ");
        match result {
            BusResult::Bytes([identity, _]) => line.text("identity 0x").hex(identity.into(), 2),
            BusResult::Nack => line.text("error no answer at 0x68"),
            BusResult::Done | BusResult::Timeout => line.text("error I2C held"),
        };
    });
}
