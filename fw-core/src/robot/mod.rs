//! The robot: one value, one method per event. Interrupts read registers, hand one event in here
//! and write what comes back; all of it runs at one interrupt priority, so no event interrupts another.
//!
//! | event | method | comes from |
//! |---|---|---|
//! | 100 Hz tick | [`Robot::on_gyro`], then [`Robot::on_tick`] | TIM5, with both encoder counters and the last ADC words; I2C1 |
//! | frame | [`Robot::receive`], [`Robot::encode_reply`], then [`Robot::execute`] | chip-select's rising edge |
//! | echo | [`Robot::on_echo`] | EXTI, both edges timed |
//! | temperature | [`Robot::on_temperature`] | ADC1, once a second |

mod control;
mod event_log;
mod io;
mod link_stats;
mod ranging;
mod reply;
mod slip_monitor;
mod supervisor;

pub use io::{ReceivedFrame, TickInput, TickOutput, leds};
pub use supervisor::{AllowedMotion, Halt, Supervisor, SupervisorCommand};

use crate::eeprom::Config;
use crate::log::{Level, Log};
use crate::motion::{ArrivalTimer, DriveMonitor, ObstacleLimit, Odometry, StopDeadline};
use crate::sensing::battery::MAX_CELLS;
use crate::sensing::{Battery, Calibration, Rangefinders, ServoScan, Thermometer};
use crate::types::{Delta, Duty, Faults, Micros, MotorCommands, Pose, RangefinderId, Velocity};
use crate::wire::{
    CellCode, Command, Field, FrameError, LinkCounters, Mode, Order, PoseCode, Report, State,
    StmLink,
};
use control::{Control, DriveRequest, MeasuredQuantity, percent};
use event_log::EventLog;
use link_stats::LinkStats;
use slip_monitor::SlipMonitor;

#[cfg(test)]
mod tests;

/// The robot's whole state.
#[derive(Clone, Debug)]
pub struct Robot {
    quantity: MeasuredQuantity,
    link: StmLink,
    supervisor: Supervisor,
    odometry: Odometry,
    delta: Delta,
    /// The configuration has a gyroscope, and the mode can use one.
    gyro_enabled: bool,
    slip_monitor: SlipMonitor,
    control: Control,
    arrival: ArrivalTimer,
    obstacle: ObstacleLimit,
    drive_monitor: DriveMonitor,
    /// Motor commands applied since the last tick.
    applied: MotorCommands,
    battery: Battery,
    rangefinders: Rangefinders,
    servo_scan: ServoScan,
    thermometer: Thermometer,
    request: DriveRequest,
    target: PoseCode,
    /// Since reset, for tuning: the way along the path, 2⁻¹⁶ mm, or the rotation, 2⁻³² turns; unlike the
    /// heading it counts whole turns.
    measured: i64,
    /// Next report but for cell, faults and state, see [`Self::encode_reply`].
    report: Report,
    /// The cells' voltages in the wire's code.
    voltages: [u16; MAX_CELLS],
    event_log: EventLog,
    link_stats: LinkStats,
    /// Lines that the log had dropped by the last tick.
    dropped_lines: u32,
}

impl Robot {
    /// A configured robot, standing, its pose zero: `first` is where the counters stand now.
    // Requirement: DOC-3.2-1
    pub fn new(config: &Config, first: TickInput) -> Self {
        let quantity = MeasuredQuantity::of(config.mode());
        let sweeps = config.mode() == Mode::GuardedSweep;
        let by_velocity = config.mode() == Mode::GuardedVelocity;
        Self {
            quantity,
            // Requirement: DOC-5.2-1, WIRE-ready-2
            link: StmLink::new(config.link_setup()),
            // Requirement: WIRE-platform-8
            supervisor: Supervisor::new(StopDeadline::new(config.stop_deadline())),
            odometry: Odometry::new(config, first.left, first.right),
            delta: Delta::default(),
            // Requirement: WIRE-platform-7
            gyro_enabled: config.gyro() && quantity == MeasuredQuantity::Pose,
            slip_monitor: SlipMonitor::new(),
            control: Control::new(config),
            arrival: ArrivalTimer::new(config),
            obstacle: ObstacleLimit::new(config.obstacle_stop(), by_velocity),
            drive_monitor: DriveMonitor::new(config),
            applied: MotorCommands::default(),
            battery: Battery::new(config),
            // The sweep is of one, which then need not wait for the others.
            rangefinders: Rangefinders::new(if sweeps { 1 } else { config.rangefinders() }),
            servo_scan: ServoScan::new(config, sweeps || by_velocity),
            thermometer: Thermometer::new(Calibration::UNWRITTEN),
            request: DriveRequest::None,
            target: PoseCode::default(),
            measured: 0,
            report: Report::default(),
            voltages: [0; MAX_CELLS],
            event_log: EventLog::new(config.log_period()),
            link_stats: LinkStats::default(),
            dropped_lines: 0,
        }
    }

    /// The 100 Hz tick: where the robot is, whether it may move, and the motor commands.
    // Requirement: DOC-4.1-2
    pub fn on_tick(&mut self, input: TickInput, adc_words: &[u16], log: &mut Log) -> TickOutput {
        self.delta = self.odometry.step(input.left, input.right);
        self.slip_monitor.add_to(&mut self.delta);
        if self.quantity != MeasuredQuantity::Pose {
            self.measure();
        }
        let pose = self.odometry.pose();
        self.obstacle.step(&self.delta);
        let faults = self.drive_monitor.step(&self.applied, &self.delta);
        self.raise(faults, log);

        self.battery.sample(adc_words);
        self.raise(power_faults(&self.battery, input.supply_low), log);
        // Not logged: the log reports dropped lines itself once there is room.
        // Requirement: WIRE-fault-10
        if self.dropped_lines != log.dropped() {
            self.dropped_lines = log.dropped();
            self.raise(Faults::LOG_DROPPED, log);
        }

        // Requirement: WIRE-deadline-3
        let requested = self.request != DriveRequest::None;
        let busy = self.busy(log);
        let wheels = match self.supervisor.on_tick(input.now, requested, busy) {
            AllowedMotion::Coast => MotorCommands::default(),
            AllowedMotion::Brake => {
                self.stop_motion();
                MotorCommands::BRAKE
            }
            AllowedMotion::Drive => self.drive(&pose),
        };
        (self.report.clipped, self.report.obstacle_limited) = self.control.reduced();
        self.applied = wheels;
        self.log_tick(input.now, log);
        let (servo, trigger) = self.update_ranging(input.now);
        while let Some(which) = self.rangefinders.take_updated() {
            self.update_range(which);
            if which == RangefinderId::Front {
                self.update_obstacle();
            }
            self.event_log
                .rangefinder(which, &self.rangefinders.stats(which), log);
        }
        self.update_report(&pose);
        TickOutput {
            left: wheels.left,
            right: wheels.right,
            trigger,
            servo,
            leds: leds(self.supervisor.state()),
        }
    }

    /// Stopped: a later resume drives to the target from rest; by duty or velocity only the next command does.
    // Requirement: WIRE-deadline-5
    fn stop_motion(&mut self) {
        self.control.halt();
        match &mut self.request {
            DriveRequest::None | DriveRequest::Target => {}
            DriveRequest::Velocity(velocity) => *velocity = Velocity::default(),
            DriveRequest::Duty(duty) => *duty = Duty::ZERO,
        }
    }

    // Requirement: WIRE-deadline-5
    fn drive(&mut self, pose: &Pose) -> MotorCommands {
        match (&mut self.control, self.request) {
            (Control::Pose(controller), DriveRequest::Target) => {
                if !controller.moving() && !controller.arrived() {
                    // Halted since the target was set.
                    controller.set_target(self.target.to_pose());
                }
                controller.limit_speed(&self.obstacle);
                controller.drive(pose, &self.delta)
            }
            (Control::Pose(controller), DriveRequest::Duty(duty)) => match self.quantity {
                MeasuredQuantity::Displacement => controller.tune_move(duty, pose, &self.delta),
                MeasuredQuantity::Rotation | MeasuredQuantity::Pose => controller.tune_rotate(duty),
            },
            (Control::Velocity(controller), DriveRequest::Velocity(velocity)) => {
                controller.step(velocity, &self.obstacle, &self.delta)
            }
            _ => MotorCommands::default(),
        }
    }

    /// A frame ended: the command in it, for [`Self::execute`], once the reply is on its way.
    ///
    /// # Errors
    /// Why the frame was rejected: nothing of it takes effect, the stop deadline keeps running.
    #[inline]
    pub fn receive(&mut self, frame: &ReceivedFrame<'_>) -> Result<Command, FrameError> {
        let received = (self.link).receive(frame.bytes, frame.overflow_len, frame.reply);
        match &received {
            Ok(command) => self.supervise(command, frame.at),
            Err(error) => self.on_rejected(*error),
        }
        received
    }

    /// What the reply shows of an accepted command.
    #[inline]
    fn supervise(&mut self, command: &Command, now: Micros) {
        // In the modes without an order of their own, apply or 0 % ends a stop.
        let resumes = !self.link.mode().has(Field::Status)
            && match self.quantity {
                MeasuredQuantity::Pose => command.apply,
                _ => percent(command.percent) == Duty::ZERO,
            };
        self.supervisor.on_fresh(
            now,
            SupervisorCommand {
                resumes,
                order: command.order,
                clear_faults: command.clear_faults,
            },
        );
    }

    /// Takes over the motion that an accepted command requests; its frame ended at `at`.
    // Requirement: WIRE-modes-2, DOC-5.1.1-4
    #[inline]
    pub fn execute(&mut self, command: &Command, at: Micros, log: &mut Log) {
        self.link_stats.on_frame(at);
        if self.quantity != MeasuredQuantity::Pose {
            // Requirement: WIRE-deadline-5
            if !self.supervisor.halted() {
                self.request = DriveRequest::Duty(percent(command.percent));
            }
        } else if command.apply {
            let known = self.request == DriveRequest::Target && command.expected == self.target;
            if !known {
                let PoseCode { x, y, rotation } = command.expected;
                self.set_target(x, y, rotation);
            }
        } else if self.link.mode().has(Field::Velocity) {
            self.servo_scan.set_width(command.sweep);
            // Requirement: WIRE-velocity-7
            if !self.supervisor.halted() {
                let is_driven = command.order == Order::None;
                let velocity = if is_driven {
                    command.velocity
                } else {
                    Velocity::default()
                };
                self.request = DriveRequest::Velocity(velocity);
            }
        }
        if command.tune.voltage != 0 {
            self.tune_cell(command.tune.cell, command.tune.voltage, log);
        }
    }

    // Requirement: DOC-2.1-2
    // Field by field: a reference would keep the whole command in memory.
    #[cold]
    #[inline(never)]
    fn set_target(&mut self, x: i32, y: i32, rotation: u16) {
        let expected = PoseCode { x, y, rotation };
        self.request = DriveRequest::Target;
        self.target = expected;
        self.arrival.restart();
        if let Control::Pose(controller) = &mut self.control {
            controller.set_target(expected.to_pose());
        }
        self.event_log.target_set(expected);
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
        self.event_log.frame_rejected(error);
    }

    /// Frames that ended before the robot came to read the one before them.
    // Requirement: WIRE-spi-3, WIRE-fault-2
    pub fn on_lost_frames(&mut self, frames: u32, log: &mut Log) {
        self.link.overrun(frames);
        self.supervisor.raise(Faults::FRAME_REJECTED);
        log.line(Level::Warn, |line| {
            line.int(frames.into())
                .text(" frames lost: not read in time");
        });
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
        event_log::log_faults(faults.difference(self.supervisor.faults()), log);
        self.supervisor.raise(faults);
    }

    /// [`Self::measurement`] in thousandths, for the log.
    // Requirement: WIRE-log-7
    fn thousandths(&self) -> i64 {
        match self.quantity {
            MeasuredQuantity::Pose => 0,
            MeasuredQuantity::Rotation => (self.measured >> 8).saturating_mul(360_000) >> 24,
            MeasuredQuantity::Displacement => self.measured.saturating_mul(1000) >> 16,
        }
    }

    /// What the robot is doing.
    pub const fn state(&self) -> State {
        self.supervisor.state()
    }

    /// Latched faults, see [`Faults::TABLE`].
    pub const fn faults(&self) -> Faults {
        self.supervisor.faults()
    }

    /// The estimated pose.
    // Requirement: DOC-1-1
    pub const fn pose(&self) -> Pose {
        self.odometry.pose()
    }

    /// The link's counters.
    pub const fn counters(&self) -> &LinkCounters {
        self.link.counters()
    }

    fn log_tick(&mut self, now: Micros, log: &mut Log) {
        let mut busy = self.event_log.tick(
            self.supervisor.state(),
            self.supervisor.halt(),
            self.report.obstacle_limited,
            log,
        );
        if let DriveRequest::Duty(duty) = self.request {
            event_log::log_tuning(duty, self.thousandths(), log);
        }
        if self.event_log.pose_due() {
            event_log::log_pose(&PoseCode::from_pose(&self.odometry.pose()), log);
            busy = true;
        }
        let numbered = self.link.mode().has(Field::Sequence);
        self.link_stats
            .tick(now, busy, numbered, self.link.counters(), log);
    }
}

// Requirement: WIRE-fault-3, WIRE-fault-4, WIRE-fault-14
const fn power_faults(battery: &Battery, supply_low: bool) -> Faults {
    let mut faults = Faults::NONE;
    if supply_low {
        faults = faults.union(Faults::SUPPLY_LOW);
    }
    if battery.low() {
        faults = faults.union(Faults::BATTERY_LOW);
    }
    if battery.empty() {
        faults = faults.union(Faults::BATTERY_CUTOFF);
    }
    faults
}
