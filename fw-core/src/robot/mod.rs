//! The robot: one value, one method per event. Interrupts read registers, hand one event in here
//! and write what comes back; all of it runs at one interrupt priority, so no event interrupts another.
//!
//! | event | method | comes from |
//! |---|---|---|
//! | 100 Hz tick | [`Robot::on_gyro`], then [`Robot::on_tick`] | TIM5, with both encoder counters and the last ADC words; I2C1 |
//! | frame | [`Robot::reply_gone`], [`Robot::on_frame`], then [`Robot::refresh_reply`] | chip-select's rising edge |
//! | echo | [`Robot::on_echo`] | EXTI, both edges timed |
//! | temperature | [`Robot::on_temperature`] | ADC1, once a second |

mod guard;
mod io;
mod link_line;
mod reply;
mod supervisor;
mod telling;

pub use io::{leds, Outputs, Sample};
pub use supervisor::{Intent, Permit, Supervisor};

use crate::binary64::Binary64;
use crate::eeprom::Config;
use crate::log::{Level, Log};
use crate::motion::{DriveMonitor, Odometry, PoseController, StopDeadline};
use crate::sensing::battery::MAX_CELLS;
use crate::sensing::{Battery, EchoStats, Rangefinders, ServoScan};
use crate::sensing::{Calibration, Thermometer};
use crate::types::{Delta, Duty, Faults, Micros, MotorCommands, Pose, RangefinderId};
use crate::wire::{
    CellCode, Command, FrameError, LinkCounters, Mode, PoseCode, Report, Setup, State, StmLink,
};
use guard::Guard;
use link_line::LinkLine;
use telling::Telling;

#[cfg(test)]
mod tests;

/// What the Pi wants of the motors.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Want {
    /// Nothing yet.
    Nothing,
    /// The controller's target.
    Target,
    /// Tuning: a constant duty.
    Constant(Duty),
}

/// What a mode lets the Pi ask for and what it reports.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Measure {
    /// Drive to a pose, report the pose.
    Pose,
    /// Constant duty, report the rotation.
    Rotation,
    /// Constant duty with the angle held, report the displacement.
    Displacement,
}

impl Measure {
    const fn of(mode: Mode) -> Self {
        match mode {
            Mode::Normal | Mode::GuardedNormal | Mode::GuardedSweep => Self::Pose,
            Mode::TuneRotate | Mode::GuardedTuneRotate => Self::Rotation,
            Mode::TuneMove | Mode::GuardedTuneMove => Self::Displacement,
        }
    }
}

/// Everything the robot knows.
#[derive(Clone, Debug)]
pub struct Robot {
    measure: Measure,
    link: StmLink,
    supervisor: Supervisor,
    odometry: Odometry,
    delta: Delta,
    /// The configuration wants a gyroscope, and the mode can use one.
    guarded: bool,
    guard: Guard,
    controller: PoseController,
    plausibility: DriveMonitor,
    /// What the motors have been told since the last tick.
    told: MotorCommands,
    battery: Battery,
    rangefinders: Rangefinders,
    servo_scan: ServoScan,
    thermometer: Thermometer,
    want: Want,
    target: PoseCode,
    /// Millimetres along the path since reset, 2⁻¹⁶.
    travelled: i64,
    /// Rotation since reset, 2⁻³² turns; unlike the heading it counts whole turns.
    turned: i64,
    /// The cell whose turn it is in the replies.
    cell: u8,
    /// What a reply says: what the robot senses is in it already, see [`Self::sense`], the rest
    /// comes with each reply.
    said: Report,
    /// The cells' voltages in the wire's code.
    voltages: [u16; MAX_CELLS],
    telling: Telling,
    link_line: LinkLine,
    /// Lines that the log had dropped by the last tick.
    dropped: u32,
}

impl Robot {
    /// A configured robot, standing, its pose zero: `first` is where the counters stand now.
    // Requirement: DOC-3.2-1
    #[inline(never)]
    #[must_use]
    pub fn new(config: &Config, first: Sample) -> Self {
        let platform = &config.platform;
        let sweeps = config.mode == Mode::GuardedSweep;
        Self {
            measure: Measure::of(config.mode),
            // Requirement: DOC-5.2-1, WIRE-ready-2
            link: StmLink::new(Setup::from(config)),
            // Requirement: WIRE-platform-8
            supervisor: Supervisor::new(StopDeadline::new(platform.stop_deadline)),
            odometry: Odometry::new(platform, first.left, first.right),
            delta: Delta::default(),
            // Requirement: WIRE-platform-7
            guarded: platform.gyro && matches!(Measure::of(config.mode), Measure::Pose),
            guard: Guard::new(),
            controller: PoseController::new(config),
            plausibility: DriveMonitor::new(platform),
            told: MotorCommands::default(),
            battery: Battery::new(config),
            // The sweep is of one, which then need not wait for the others.
            rangefinders: Rangefinders::new(if sweeps { 1 } else { platform.rangefinders }),
            servo_scan: ServoScan::new(platform, sweeps),
            thermometer: Thermometer::new(Calibration::UNWRITTEN),
            want: Want::Nothing,
            target: PoseCode::default(),
            travelled: 0,
            turned: 0,
            cell: 0,
            said: Report::default(),
            voltages: [0; MAX_CELLS],
            telling: Telling::new(platform.log_period),
            link_line: LinkLine::default(),
            dropped: 0,
        }
    }

    /// The 100 Hz tick: where the robot is, whether it may move, and what the motors are told.
    // Requirement: DOC-4.1-2
    pub fn on_tick(&mut self, sample: Sample, adc_words: &[u16], log: &mut Log) -> Outputs {
        self.delta = self.odometry.step(sample.left, sample.right);
        self.guard.add_to(&mut self.delta);
        self.travelled = self
            .travelled
            .wrapping_add(self.delta.travel.to_bits().into());
        self.turned = self.turned.wrapping_add(self.delta.turn.into());
        let pose = self.odometry.pose();
        let implausible = self.plausibility.step(&self.told, &self.delta);
        self.raise(implausible, log);

        self.battery.sample(adc_words);
        self.raise(battery_faults(&self.battery), log);
        // No line tells of it but the log's own: there is no room for one.
        // Requirement: WIRE-fault-10
        if self.dropped != log.dropped() {
            self.dropped = log.dropped();
            self.raise(Faults::LOG_DROPPED, log);
        }

        // Requirement: WIRE-deadline-3
        let wanted = self.want != Want::Nothing;
        let busy = match self.want {
            Want::Nothing => false,
            Want::Target => self.controller.moving(),
            Want::Constant(duty) => duty != Duty::ZERO,
        };
        let wheels = match self.supervisor.on_tick(sample.now, wanted, busy) {
            Permit::Coast => MotorCommands::default(),
            Permit::Brake => {
                self.stand();
                MotorCommands::BRAKE
            }
            Permit::Drive => self.drive(&pose),
        };
        self.told = wheels;
        self.tell(sample.now, log);
        let (servo, trigger) = self.look(sample.now);
        while let Some(which) = self.rangefinders.take_updated() {
            self.sense_range(which);
            self.telling
                .rangefinder(which, &self.rangefinders.stats(which), log);
        }
        self.sense(&pose);
        Outputs {
            left: wheels.left,
            right: wheels.right,
            trigger,
            servo,
            leds: leds(self.supervisor.state()),
        }
    }

    /// The servo's pulse and the rangefinder to trigger. Nobody talks to the robot, or a fault has
    /// stopped it: the servo rests.
    // Requirement: WIRE-servo-1
    fn look(&mut self, now: Micros) -> (Option<u16>, Option<RangefinderId>) {
        let live = self.supervisor.attended(now) && self.supervisor.state() != State::Faulted;
        let servo = self.servo_scan.tick(live);
        if self.servo_scan.is_off() {
            self.rangefinders.invalidate();
        }
        let trigger = self
            .rangefinders
            .tick(now, self.servo_scan.settled_bearing());
        if trigger == Some(RangefinderId::Front) {
            self.servo_scan.triggered();
        }
        (servo, trigger)
    }

    /// Stopped: a later resume drives to the target from rest, and in the tuning modes nowhere until
    /// the Pi asks anew.
    // Requirement: WIRE-deadline-5
    fn stand(&mut self) {
        match self.want {
            Want::Nothing => {}
            Want::Target => self.controller.halt(),
            Want::Constant(_) => {
                self.controller.halt();
                self.want = Want::Constant(Duty::ZERO);
            }
        }
    }

    fn drive(&mut self, pose: &Pose) -> MotorCommands {
        match (self.want, self.measure) {
            (Want::Nothing, _) => MotorCommands::default(),
            (Want::Target, _) => {
                if !self.controller.moving() && !self.controller.arrived() {
                    // Halted since the target was set.
                    self.controller.set_target(self.target.to_pose());
                }
                self.controller.drive(pose, &self.delta)
            }
            (Want::Constant(duty), Measure::Displacement) => {
                self.controller.tune_move(duty, pose, &self.delta)
            }
            (Want::Constant(duty), Measure::Rotation | Measure::Pose) => {
                self.controller.tune_rotate(duty)
            }
        }
    }

    /// A frame ended: `clocked` bytes crossed the wire, `buffer` holds those it had room for.
    /// Nothing of a rejected frame takes effect; the stop deadline keeps running.
    #[inline]
    pub fn on_frame(&mut self, buffer: &[u8], clocked: usize, now: Micros, log: &mut Log) {
        if let Some(command) = self.link.receive_whole(buffer, clocked) {
            self.on_command(&command, now, log);
            return;
        }
        self.on_doubtful_frame(buffer, clocked, now, log);
    }

    /// With the small parser, which can also say what is wrong.
    #[cold]
    #[inline(never)]
    fn on_doubtful_frame(&mut self, buffer: &[u8], clocked: usize, now: Micros, log: &mut Log) {
        match self.link.receive_clocked(buffer, clocked) {
            Ok(command) => self.on_command(&command, now, log),
            Err(error) => self.on_rejected(error),
        }
    }

    #[inline]
    fn on_command(&mut self, command: &Command, now: Micros, log: &mut Log) {
        self.link_line.frame(now);
        if self.measure == Measure::Pose {
            self.fresh(now, command, command.apply);
            // Requirement: WIRE-modes-2
            let known = self.want == Want::Target && command.expected == self.target;
            // Requirement: DOC-5.1.1-4
            if command.apply && !known {
                let PoseCode { x, y, rotation } = command.expected;
                self.set_target(x, y, rotation);
            }
        } else {
            // Only the tuning modes carry a percentage; the others do not pay for decoding one.
            let duty = percent(command.percent);
            self.fresh(now, command, duty == Duty::ZERO);
            if !self.supervisor.halted() {
                self.want = Want::Constant(duty);
            }
        }
        if command.tune.voltage != 0 {
            self.tune_cell(command.tune.cell, command.tune.voltage, log);
        }
    }

    /// A frame counts. `resumes`: in the modes without an order of their own, what it asks for ends a
    /// stop.
    #[inline]
    fn fresh(&mut self, now: Micros, command: &Command, resumes: bool) {
        let bare = !self.link.mode().tells_fresh();
        self.supervisor.on_fresh(
            now,
            Intent {
                resumes: bare && resumes,
                order: command.order,
                clear: command.clear_faults,
            },
        );
    }

    // Requirement: DOC-2.1-2
    // Field by field, here and below: a reference would keep the whole command in memory.
    #[cold]
    #[inline(never)]
    fn set_target(&mut self, x: i32, y: i32, rotation: u16) {
        let expected = PoseCode { x, y, rotation };
        self.want = Want::Target;
        self.target = expected;
        self.controller.set_target(expected.to_pose());
        self.telling.target(expected);
    }

    // Requirement: WIRE-battery-2
    #[cold]
    #[inline(never)]
    fn tune_cell(&mut self, cell: u8, voltage: u16, log: &mut Log) {
        let tune = CellCode { cell, voltage };
        let Some(upper) = self.battery.tune(tune.cell, tune.to_volts()) else {
            return;
        };
        log.line(Level::Info, |line| {
            line.text("tuned tap ")
                .int(i64::from(tune.cell) + 1)
                .text(": upper resistor ")
                .int(upper.into())
                .text(" ohm");
        });
    }

    // Requirement: WIRE-chain-2, WIRE-fault-2, WIRE-rejected-4
    #[cold]
    fn on_rejected(&mut self, error: FrameError) {
        self.supervisor.raise(Faults::FRAME_REJECTED);
        self.telling.rejected(error);
    }

    /// Frames that ended before the robot came to read the one before them.
    // Requirement: WIRE-spi-3
    pub fn on_lost_frames(&mut self, frames: u32, log: &mut Log) {
        self.link.overrun(frames);
        self.supervisor.raise(Faults::FRAME_REJECTED);
        log.line(Level::Warn, |line| {
            line.int(frames.into())
                .text(" frames came too fast and were lost");
        });
    }

    /// An echo of the rangefinder triggered last: both edges on the robot's clock.
    pub fn on_echo(&mut self, which: RangefinderId, rise: Micros, fall: Micros) {
        self.rangefinders.echo(which, rise, fall);
        self.sense_range(which);
    }

    /// The factory's words for the temperature sensor; without them sound is taken at 343 m/s.
    pub fn calibrate(&mut self, calibration: Calibration) {
        self.thermometer = Thermometer::new(calibration);
    }

    /// The words of the chip's temperature sensor and of its voltage reference, once a second or so:
    /// how fast sound travels from now on.
    pub fn on_temperature(&mut self, sensor: u16, reference: u16, log: &mut Log) {
        let air = self.thermometer.read(sensor, reference);
        self.rangefinders.set_temperature(air);
        self.telling.temperature(air, log);
    }

    /// Latches faults that the registers found.
    #[inline]
    pub fn raise(&mut self, faults: Faults, log: &mut Log) {
        if !faults.difference(self.supervisor.faults()).is_empty() {
            self.latch(faults, log);
        }
    }

    #[cold]
    #[inline(never)]
    fn latch(&mut self, faults: Faults, log: &mut Log) {
        telling::faults(faults.difference(self.supervisor.faults()), log);
        self.supervisor.raise(faults);
    }

    /// [`Self::measurement`] in thousandths, for the log.
    fn thousandths(&self) -> i64 {
        match self.measure {
            Measure::Pose => 0,
            Measure::Rotation => (self.turned >> 8).saturating_mul(360_000) >> 24,
            Measure::Displacement => self.travelled.saturating_mul(1000) >> 16,
        }
    }

    /// What the robot is doing.
    #[must_use]
    pub const fn state(&self) -> State {
        self.supervisor.state()
    }

    /// Latched faults, see [`Faults::TABLE`].
    #[must_use]
    pub const fn faults(&self) -> Faults {
        self.supervisor.faults()
    }

    /// Where the robot believes it is.
    // Requirement: DOC-1-1
    #[must_use]
    pub const fn pose(&self) -> Pose {
        self.odometry.pose()
    }

    /// How a rangefinder's triggers ended so far.
    #[must_use]
    pub fn stats(&self, which: RangefinderId) -> EchoStats {
        self.rangefinders.stats(which)
    }

    /// The link's counters.
    #[must_use]
    pub const fn counters(&self) -> &LinkCounters {
        self.link.counters()
    }

    fn tell(&mut self, now: Micros, log: &mut Log) {
        let mut busy = self
            .telling
            .state(self.supervisor.state(), self.supervisor.faults(), log);
        if let Want::Constant(duty) = self.want {
            telling::tuning(duty, self.thousandths(), log);
        }
        if self.telling.pose_is_due() {
            telling::pose_line(&PoseCode::from_pose(&self.odometry.pose()), log);
            busy = true;
        }
        let numbered = self.link.mode().tells_fresh();
        self.link_line
            .tick(now, busy, numbered, self.link.counters(), log);
    }
}

/// The Pi's percent as a duty: the wire accepts nothing beyond ±100.
#[inline(never)]
fn percent(percent: Binary64) -> Duty {
    // 2⁻³² %, and hundredths of a percent, to the nearest.
    let bits = percent
        .to_scaled(32)
        .unwrap_or(0)
        .clamp(-PERCENT_100, PERCENT_100);
    let hundredths = (bits * 100 + (1 << 31)) >> 32;
    Duty::saturating(i32::try_from(hundredths).unwrap_or(0))
}

/// 100 %, 2⁻³².
const PERCENT_100: i64 = 100 << 32;

// Requirement: WIRE-fault-3, WIRE-fault-4
const fn battery_faults(battery: &Battery) -> Faults {
    let mut faults = Faults::NONE;
    if battery.low() {
        faults = faults.union(Faults::BATTERY_LOW);
    }
    if battery.empty() {
        faults = faults.union(Faults::BATTERY_CUTOFF);
    }
    faults
}
