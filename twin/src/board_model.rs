//! Everything around the microcontroller, advanced in virtual time: the world the robot stands in,
//! the components of the board, and the Pi's end of the wires.
//!
//! [`BoardModel::step`] runs at every stop of the emulator. It carries out what is due, in the order
//! of the board's signals, and requests the next stop; nothing polls.

mod encoder_lines;
mod spi_lines;

use std::collections::VecDeque;

use plant::{FRONT, Pose2, RIGHT, Sides, World};
use rigless::device::Level;
use rigless::soc::stm32f427::peripherals::adc::Channel;
use rigless::time::VirtualNanos;

use crate::components::bridge;
use crate::components::encoder::Encoder;
use crate::components::i2c_bus::{I2cController, SharedBus};
use crate::components::mpu6050::Mpu6050;
use crate::components::rangefinder::Rangefinder;
use crate::components::servo::ServoLine;
use crate::components::spi_master::SpiMaster;
use crate::components::uart_receiver::{LogByte, UartReceiver, is_readable};
use crate::peripherals::board_port::PinChange;
use crate::pinout::{self, ENCODERS};
use crate::soc::{Role, Stm32f411};

/// The world is integrated in steps of this length; encoder edges are placed inside them.
pub const TICK_NS: u64 = 1_000_000;
const TICK_S: f64 = 0.001;
const TICK_LENGTH: f64 = 1e6;

/// The alternate functions that connect USART1 and TIM1 to their pins.
const USART_FUNCTION: Role = Role::Function(7);
const TIM1_FUNCTION: Role = Role::Function(1);

/// A burst of a rangefinder, and its true result.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ping {
    /// Nanoseconds of virtual time.
    pub at_ns: u64,
    /// 0 front, 1 right, 2 left.
    pub sensor: usize,
    /// Direction, radians counter-clockwise from the robot's heading.
    pub bearing_rad: f64,
    /// The robot's pose in the room's frame.
    pub robot: Pose2,
    /// The range that a sensor without errors measures, millimetres.
    pub range_mm: Option<f64>,
    /// How long its echo takes, µs, as its line shows where no other sensor's comes first.
    pub echo_us: Option<f64>,
}

/// The board and the world around the microcontroller.
#[derive(Debug)]
pub struct BoardModel {
    /// The physical world.
    pub world: World,
    /// The EEPROM's bus.
    pub i2c: SharedBus,
    /// The Pi's SPI controller.
    pub spi: SpiMaster,
    /// The log as it arrived.
    pub log: Vec<LogByte>,
    /// The rate its receiver is set to.
    pub receiver_baud: u64,
    /// Whether the Pi holds the RESET line low.
    pub reset_low: bool,
    /// Changes of READY and of the LEDs.
    pub outputs: Vec<PinChange>,
    /// The chip select's latest edges: when, and whether it selects.
    pub selects: VecDeque<(u64, bool)>,
    /// Every burst so far.
    pub pings: Vec<Ping>,
    encoders: [Encoder; 2],
    counts: [i64; 2],
    /// The levels at each timer's inputs: a pin that is not routed to it leaves them unchanged.
    timer_inputs: [[Level; 2]; 2],
    rangefinders: [Rangefinder; 3],
    /// Echoes in flight: when they return, and to which sensor.
    echoes: Vec<(u64, usize)>,
    servo: ServoLine,
    nss: Level,
    imu_irq: bool,
    next_tick: u64,
    /// The world at the start of the present tick, for interpolation.
    before: Motion,
}

/// The pose and the wheels' speeds at an instant.
#[derive(Clone, Copy, Debug)]
struct Motion {
    pose: Pose2,
    wheel_deg_s: Sides<f64>,
}

impl Motion {
    fn of(world: &World) -> Self {
        Self {
            pose: world.pose(),
            wheel_deg_s: world.wheel_speeds_deg_s(),
        }
    }
}

impl BoardModel {
    /// The board of a robot in `world`.
    pub fn new(world: World, i2c: SharedBus) -> Self {
        let counts = world.wheel_counts();
        Self {
            before: Motion::of(&world),
            counts: [counts.left, counts.right],
            world,
            i2c,
            spi: SpiMaster::default(),
            log: Vec::new(),
            receiver_baud: 115_200,
            reset_low: false,
            outputs: Vec::new(),
            selects: VecDeque::new(),
            pings: Vec::new(),
            encoders: Default::default(),
            timer_inputs: [[Level::Low; 2]; 2],
            rangefinders: Default::default(),
            echoes: Vec::new(),
            servo: ServoLine::default(),
            nss: Level::High,
            imu_irq: false,
            next_tick: 0,
        }
    }

    /// Connects the board to a part fresh out of reset.
    pub fn connect(&mut self, chip: &mut Stm32f411, now: VirtualNanos) {
        let triggers = pinout::RANGEFINDERS.map(|rangefinder| rangefinder.trigger);
        let watched = triggers.into_iter().chain(pinout::LEDS);
        for pin in watched.chain([pinout::SCL, pinout::READY]) {
            chip.board_port.watch(pin);
        }
        chip.drive_pin(now, pinout::NSS, Some(self.nss));
        chip.drive_pin(now, pinout::SCL, Some(Level::High));
        chip.drive_pin(now, pinout::MPU_IRQ, Some(Level::from(self.imu_irq)));
        for rangefinder in pinout::RANGEFINDERS {
            chip.drive_pin(now, rangefinder.echo, Some(Level::Low));
        }
        for (nth, pins) in ENCODERS.into_iter().enumerate() {
            let levels = Encoder::levels(self.counts[nth]);
            for (pin, level) in pins.pins.into_iter().zip(levels) {
                chip.drive_pin(now, pin, Some(level));
            }
            self.timer_inputs[nth] = [Level::Low; 2];
            self.drive_timer_inputs(chip, now, nth, levels);
        }
        self.drive_i2c_lines(chip, now);
        self.drive_analog_inputs(chip);
        chip.wake_at(now, now);
    }

    /// Drives the I2C switch's sense line and a held data line.
    pub fn drive_i2c_lines(&mut self, chip: &mut Stm32f411, now: VirtualNanos) {
        let bus = self.i2c.lock();
        let pi = bus.controller() == I2cController::Pi;
        let held = bus.is_sda_held(I2cController::Stm);
        drop(bus);
        chip.drive_pin(now, pinout::SELECT, Some(Level::from(pi)));
        chip.drive_pin(now, pinout::SDA, Some(Level::from(!held)));
        chip.hold_i2c1_low(now, held);
    }

    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "taps are a few volts, and the chip's temperature is below 1000 °C"
    )]
    fn drive_analog_inputs(&self, chip: &mut Stm32f411) {
        let centi_celsius = (self.world.chip_temperature_c() * 100.0).round() as i32;
        chip.adc.set_temperature(centi_celsius);
        for (channel, volts) in (0..).zip(self.world.cell_pins()) {
            let channel = Channel::new(channel).expect("two of sixteen channels");
            let millivolts = (volts * 1000.0).round().max(0.0) as u32;
            chip.adc.set_input(channel, millivolts);
        }
    }

    /// Carries out everything due by `now` and requests the next stop.
    pub fn step(&mut self, chip: &mut Stm32f411, now: VirtualNanos) {
        self.read_servo_pwm(chip, now);
        self.on_gpio(chip, now);
        self.run_spi(chip, now);
        self.step_encoders(chip, now);
        self.drive_echo_lines(chip, now);
        self.receive_log(chip);
        while self.next_tick <= now.0 {
            self.step_world(chip);
        }
        self.drive_imu_irq(chip, now);
        if let Some(next) = self.next_event(chip) {
            chip.wake_at(now, VirtualNanos(next.max(now.0 + 1)));
        }
    }

    fn next_event(&self, chip: &Stm32f411) -> Option<u64> {
        let rangefinders = self.rangefinders.iter().filter_map(Rangefinder::next_event);
        let encoders = self.encoders.iter().filter_map(Encoder::next_event);
        rangefinders
            .chain(encoders)
            .chain(self.spi.next_event(Self::clocks_ahead(chip)))
            .chain(self.i2c.lock().mpu.as_ref().and_then(Mpu6050::next_event))
            .chain([self.next_tick])
            .min()
    }

    /// The true pose and the wheels' speeds, °/s, at `now`, which lies within the present tick.
    pub fn at(&self, now: u64) -> (Pose2, Sides<f64>) {
        let (a, b) = (self.before, Motion::of(&self.world));
        let left = u32::try_from(self.next_tick.saturating_sub(now)).unwrap_or(u32::MAX);
        let share = (1.0 - f64::from(left) / TICK_LENGTH).clamp(0.0, 1.0);
        let between = |from: f64, to: f64| from + (to - from) * share;
        let pose = Pose2::new(
            between(a.pose.x_mm, b.pose.x_mm),
            between(a.pose.y_mm, b.pose.y_mm),
            between(a.pose.heading_rad, b.pose.heading_rad),
        );
        let wheels = a.wheel_deg_s.zip(b.wheel_deg_s);
        (pose, wheels.map(|(from, to)| between(from, to)))
    }

    /// Handles the changes of the firmware's outputs.
    fn on_gpio(&mut self, chip: &mut Stm32f411, now: VirtualNanos) {
        for change in chip.board_port.take_changes() {
            let PinChange { at, pin, high } = change;
            let mut rangefinders = pinout::RANGEFINDERS.iter();
            if let Some(nth) = rangefinders.position(|pins| pins.trigger == pin) {
                let unplugged = self.world.faults.unplugged[nth];
                if self.rangefinders[nth].trigger(at, high) && !unplugged {
                    self.ping(nth, at);
                }
            } else if pin == pinout::SCL {
                if high && chip.role(pinout::SCL) == Role::Output {
                    self.i2c.lock().clock_pulse();
                    self.drive_i2c_lines(chip, now);
                }
            } else {
                self.outputs.push(change);
            }
        }
    }

    /// Sends a burst. Its echo reaches every sensor that listens when it returns, whatever its
    /// direction: stronger crosstalk than in a real room.
    fn ping(&mut self, nth: usize, at: u64) {
        let echo_us = self.world.echo_us(nth);
        self.pings.push(Ping {
            at_ns: at,
            sensor: nth,
            bearing_rad: self.world.mount(nth).bearing_rad,
            robot: self.at(at).0,
            range_mm: self.world.true_range_mm(nth),
            echo_us,
        });
        let returns = self.rangefinders[nth].measure(at, echo_us);
        self.echoes.retain(|&(returns, _)| returns >= at);
        for &(returns, _) in self.echoes.iter().filter(|echo| echo.1 != nth) {
            self.rangefinders[nth].receive_crosstalk(returns, at);
        }
        if let Some(returns) = returns {
            let (before, after) = self.rangefinders.split_at_mut(nth);
            for other in before.iter_mut().chain(&mut after[1..]) {
                other.receive_crosstalk(returns, at);
            }
            self.echoes.push((returns, nth));
        }
    }

    /// Reads the servo's line: TIM1's output where the pin is routed to it, else the port's.
    fn read_servo_pwm(&mut self, chip: &Stm32f411, now: VirtualNanos) {
        let level = match chip.role(pinout::SERVO) {
            TIM1_FUNCTION => chip.tim1_output(1),
            _ => chip.output(pinout::SERVO),
        };
        // The board pulls an undriven line down.
        let high = level == Some(Level::High);
        if let Some(width_us) = self.servo.level(now.0, high) {
            self.world.servo.pulse(width_us);
        }
    }

    fn drive_echo_lines(&mut self, chip: &mut Stm32f411, now: VirtualNanos) {
        let mut lines = pinout::RANGEFINDERS.map(|pins| pins.echo);
        if self.world.faults.crossed_echoes {
            lines.swap(FRONT, RIGHT);
        }
        for (rangefinder, line) in self.rangefinders.iter_mut().zip(lines) {
            while let Some(high) = rangefinder.take(now.0) {
                chip.drive_pin(now, line, Some(Level::from(high)));
            }
        }
    }

    fn receive_log(&mut self, chip: &mut Stm32f411) {
        let receiver = chip.usart[0].chip_mut::<UartReceiver>();
        let arrived = receiver.map(UartReceiver::take).unwrap_or_default();
        if arrived.is_empty() || chip.role(pinout::TX) != USART_FUNCTION {
            return;
        }
        let readable = is_readable(chip.usart1_baud(), self.receiver_baud);
        self.log.extend(arrived.into_iter().map(|word| LogByte {
            byte: if readable { word.byte } else { 0xFF },
            ..word
        }));
    }

    /// Drives the motion sensor's interrupt line.
    fn drive_imu_irq(&mut self, chip: &mut Stm32f411, now: VirtualNanos) {
        let mut bus = self.i2c.lock();
        let high = bus.mpu.as_mut().is_some_and(|mpu| mpu.interrupt(now.0));
        drop(bus);
        if std::mem::replace(&mut self.imu_irq, high) != high {
            chip.drive_pin(now, pinout::MPU_IRQ, Some(Level::from(high)));
        }
    }

    /// Gives the motion sensor the yaw rate of the tick that ends now.
    fn step_imu(&mut self, now: u64) {
        let turned = self.world.pose().heading_rad - self.before.pose.heading_rad;
        if let Some(mpu) = &mut self.i2c.lock().mpu {
            mpu.step_ms(now, turned.to_degrees() / TICK_S);
        }
    }

    /// Integrates the world over the next tick with what the bridge applies now.
    fn step_world(&mut self, chip: &mut Stm32f411) {
        let start = self.next_tick;
        let at = VirtualNanos(start);
        self.next_tick += TICK_NS;
        let left = bridge::input(chip, at, pinout::LEFT_BRIDGE);
        let right = bridge::input(chip, at, pinout::RIGHT_BRIDGE);
        self.step_imu(start);
        let before = self.world.wheel_phase();
        self.before = Motion::of(&self.world);
        self.world.step(TICK_S, left, right);
        let after = self.world.wheel_phase();
        self.encoders[0].plan(start, TICK_NS, before.left, after.left);
        self.encoders[1].plan(start, TICK_NS, before.right, after.right);
        self.drive_analog_inputs(chip);
    }
}
