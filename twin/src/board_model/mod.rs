//! Everything around the microcontroller, moved along in virtual time: the world the robot stands
//! in, the parts of the board, and the Pi's end of the wires.
//!
//! [`Surroundings::step`] runs at every stop of the emulator. It carries out what is due, in the
//! order in which the board would show it, and asks for the next stop; nothing polls.

use std::collections::VecDeque;

use plant::{Pose2, Sides, World};
use rigless::device::Level;
use rigless::soc::stm32f427::peripherals::adc::Channel;
use rigless::time::VirtualNanos;

use crate::components::bridge;
use crate::components::encoder::Encoder;
use crate::components::i2c_bus::{SharedBus, Side};
use crate::components::mpu6050::Mpu6050;
use crate::components::rangefinder::Rangefinder;
use crate::components::servo::ServoLine;
use crate::components::spi_master::{Action, SpiMaster};
use crate::components::uart_receiver::{self as uart, LogByte, Wire};
use crate::pinout;
use crate::soc::{Pin, Role, Stm32f411};

/// The world is integrated in pieces of this length; encoder edges are placed inside them.
pub const TICK_NS: u64 = 1_000_000;
const TICK_S: f64 = 0.001;
const TICK_LENGTH: f64 = 1e6;

/// Edges of the chip select kept for who measures them, when nobody does.
const SELECTS_KEPT: usize = 16;

/// The alternate functions that connect the SPI, the log and the I2C to their pins.
const SPI_FUNCTION: Role = Role::Function(5);
const LOG_FUNCTION: Role = Role::Function(7);
/// And TIM1 to the servo.
const SERVO_FUNCTION: Role = Role::Function(1);

/// A change of one of the board's outputs, for who follows them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct OutputChange {
    /// Nanoseconds of virtual time.
    pub at: u64,
    /// The pin.
    pub pin: Pin,
    /// Its level.
    pub level: bool,
}

/// A burst of a rangefinder, and what it met.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ping {
    /// Nanoseconds of virtual time.
    pub at_ns: u64,
    /// 0 front, 1 right, 2 left.
    pub sensor: usize,
    /// Where it looked, radians counter-clockwise from the robot's own heading.
    pub bearing_rad: f64,
    /// Where the robot stood, in the room's frame.
    pub robot: Pose2,
    /// The range that a sensor without errors would have said, millimetres.
    pub range_mm: Option<f64>,
}

/// The surroundings.
#[derive(Debug)]
pub struct Surroundings {
    /// The physical world.
    pub world: World,
    /// The EEPROM's bus.
    pub i2c: SharedBus,
    /// The Pi's SPI controller.
    pub spi: SpiMaster,
    /// The log as it arrived.
    pub log: Vec<LogByte>,
    /// Whether the Pi holds the RESET line low.
    pub reset_low: bool,
    /// Changes of READY and of the LEDs.
    pub outputs: Vec<OutputChange>,
    /// The chip select's edges since somebody last took them: when, and whether it selects.
    pub selects: VecDeque<(u64, bool)>,
    encoders: [Encoder; 2],
    counts: [i64; 2],
    /// The levels each timer was last told: a pin that is not its yet tells it nothing.
    told: [[Level; 2]; 2],
    rangers: [Rangefinder; 3],
    /// Every burst so far.
    pub pings: Vec<Ping>,
    /// When echoes under way come back, and whose they are.
    sounds: Vec<(u64, usize)>,
    servo: ServoLine,
    nss: Level,
    irq: bool,
    next_tick: u64,
    /// The world when the piece in hand began, for what lies between.
    before: Moment,
}

/// The pose and the wheels' speeds at an instant.
#[derive(Clone, Copy, Debug)]
struct Moment {
    pose: Pose2,
    wheels: Sides<f64>,
}

impl Moment {
    fn of(world: &World) -> Self {
        Self {
            pose: world.pose(),
            wheels: world.wheel_speeds_deg_s(),
        }
    }
}

/// The encoders' pins in the order of the plant: left, right.
const ENCODERS: [pinout::EncoderPins; 2] = [pinout::LEFT_ENCODER, pinout::RIGHT_ENCODER];

impl Surroundings {
    /// The surroundings of a board that stands in `world`.
    #[must_use]
    pub fn new(world: World, i2c: SharedBus) -> Self {
        let counts = world.wheel_counts();
        Self {
            before: Moment::of(&world),
            counts: [counts.left, counts.right],
            world,
            i2c,
            spi: SpiMaster::default(),
            log: Vec::new(),
            reset_low: false,
            outputs: Vec::new(),
            selects: VecDeque::new(),
            encoders: Default::default(),
            told: [[Level::Low; 2]; 2],
            rangers: Default::default(),
            pings: Vec::new(),
            sounds: Vec::new(),
            servo: ServoLine::default(),
            nss: Level::High,
            irq: false,
            next_tick: 0,
        }
    }

    /// Connects the board to a part fresh out of reset.
    pub fn connect(&mut self, chip: &mut Stm32f411, now: VirtualNanos) {
        for pin in pinout::RANGERS.map(|ranger| ranger.trigger) {
            chip.board_port.watch(pin);
        }
        for pin in [pinout::SCL, pinout::READY].into_iter().chain(pinout::LEDS) {
            chip.board_port.watch(pin);
        }
        chip.drive_pin(now, pinout::NSS, Some(self.nss));
        chip.drive_pin(now, pinout::SCL, Some(Level::High));
        chip.drive_pin(now, pinout::MPU_IRQ, Some(Level::from(self.irq)));
        for ranger in pinout::RANGERS {
            chip.drive_pin(now, ranger.echo, Some(Level::Low));
        }
        for (nth, pins) in ENCODERS.into_iter().enumerate() {
            let levels = Encoder::levels(self.counts[nth]);
            for (pin, level) in pins.pins.into_iter().zip(levels) {
                chip.drive_pin(now, pin, Some(level));
            }
            self.told[nth] = [Level::Low; 2];
            self.tell(chip, now, nth, levels);
        }
        self.show_bus(chip, now);
        self.show_analog(chip);
        chip.wake_at(now, now);
    }

    /// The I2C switch and a held data line as the STM sees them.
    pub fn show_bus(&mut self, chip: &mut Stm32f411, now: VirtualNanos) {
        let bus = self.i2c.lock();
        let pi = bus.owner() == Side::Pi;
        let stuck = bus.is_stuck(Side::Stm);
        drop(bus);
        chip.drive_pin(now, pinout::SELECT, Some(Level::from(pi)));
        chip.drive_pin(now, pinout::SDA, Some(Level::from(!stuck)));
        chip.hold_i2c1_low(now, stuck);
    }

    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "a tap is a few volts, and a chip is no star"
    )]
    fn show_analog(&self, chip: &mut Stm32f411) {
        let centi_celsius = (self.world.chip_temperature_c() * 100.0).round() as i32;
        chip.adc.set_temperature(centi_celsius);
        for (channel, volts) in (0..).zip(self.world.battery().pins()) {
            let channel = Channel::new(channel).expect("two of sixteen channels");
            chip.adc
                .set_input(channel, (volts * 1000.0).round().max(0.0) as u32);
        }
    }

    /// Carries out everything due by `now` and asks for the next stop.
    pub fn step(&mut self, chip: &mut Stm32f411, now: VirtualNanos) {
        self.steer(chip, now);
        self.hear(chip, now);
        self.play(chip, now);
        self.turn(chip, now);
        self.echo(chip, now);
        self.receive(chip);
        while self.next_tick <= now.0 {
            self.tick(chip);
        }
        self.interrupt(chip, now);
        if let Some(next) = self.next(chip) {
            chip.wake_at(now, VirtualNanos(next.max(now.0 + 1)));
        }
    }

    fn next(&self, chip: &Stm32f411) -> Option<u64> {
        let rangers = self.rangers.iter().filter_map(Rangefinder::next);
        let encoders = self.encoders.iter().filter_map(Encoder::next);
        rangers
            .chain(encoders)
            .chain(self.spi.next(Self::clocks_ahead(chip)))
            .chain(self.i2c.lock().mpu.as_ref().and_then(Mpu6050::next))
            .chain([self.next_tick])
            .min()
    }

    /// The true pose and the wheels' speeds (left, right), °/s, at `now`, which lies within the
    /// piece the world has been moved along already.
    #[must_use]
    pub fn at(&self, now: u64) -> (Pose2, Sides<f64>) {
        let after = Moment::of(&self.world);
        let left = u32::try_from(self.next_tick.saturating_sub(now)).unwrap_or(u32::MAX);
        let share = (1.0 - f64::from(left) / TICK_LENGTH).clamp(0.0, 1.0);
        let between = |from: f64, to: f64| from + (to - from) * share;
        let (a, b) = (self.before, after);
        let pose = Pose2::new(
            between(a.pose.x_mm, b.pose.x_mm),
            between(a.pose.y_mm, b.pose.y_mm),
            between(a.pose.heading_rad, b.pose.heading_rad),
        );
        let wheels = a.wheels.zip(b.wheels).map(|(a, b)| between(a, b));
        (pose, wheels)
    }

    /// What the firmware did to its pins.
    fn hear(&mut self, chip: &mut Stm32f411, now: VirtualNanos) {
        for change in chip.take_pin_changes() {
            let high = change.level == Level::High;
            if let Some(nth) = pinout::RANGERS
                .iter()
                .position(|ranger| ranger.trigger == change.pin)
            {
                let unplugged = self.world.faults.unplugged[nth];
                if self.rangers[nth].trigger(change.at.0, high) && !unplugged {
                    self.ping(nth, change.at.0);
                }
            } else if change.pin == pinout::SCL {
                if high && chip.role(pinout::SCL) == Role::Output {
                    self.i2c.lock().pulse(Side::Stm);
                    self.show_bus(chip, now);
                }
            } else {
                self.outputs.push(OutputChange {
                    at: change.at.0,
                    pin: change.pin,
                    level: high,
                });
            }
        }
    }

    /// A burst leaves. Its echo reaches all the sensors: which of them hears it is a matter of who
    /// listens when it comes, whatever they look at. That is worse than rooms are, on purpose.
    fn ping(&mut self, nth: usize, at: u64) {
        self.pings.push(Ping {
            at_ns: at,
            sensor: nth,
            bearing_rad: self.world.mount(nth).bearing_rad,
            robot: self.at(at).0,
            range_mm: self.world.true_range_mm(nth),
        });
        let echo = self.world.echo_us(nth);
        let back = self.rangers[nth].measure(at, echo);
        self.sounds.retain(|&(back, _)| back >= at);
        for &(back, of) in &self.sounds {
            if of != nth {
                self.rangers[nth].hear(back, at);
            }
        }
        if let Some(back) = back {
            for (other, ranger) in self.rangers.iter_mut().enumerate() {
                if other != nth {
                    ranger.hear(back, at);
                }
            }
            self.sounds.push((back, nth));
        }
    }

    /// The servo's line: TIM1's output where the pin is its, else what the port drives.
    fn steer(&mut self, chip: &Stm32f411, now: VirtualNanos) {
        let level = match chip.role(pinout::SERVO) {
            SERVO_FUNCTION => chip.tim1_output(1),
            _ => chip.output(pinout::SERVO),
        };
        // The board's pull-down holds a line that nobody drives.
        let high = level == Some(Level::High);
        if let Some(width_us) = self.servo.level(now.0, high) {
            self.world.servo_mut().pulse(width_us);
        }
    }

    /// The Pi's SPI.
    fn play(&mut self, chip: &mut Stm32f411, now: VirtualNanos) {
        while let Some(action) = self.next_action(chip, now) {
            match action {
                Action::Select(selected) => {
                    self.nss = Level::from(!selected);
                    if self.selects.len() == SELECTS_KEPT {
                        self.selects.pop_front();
                    }
                    self.selects.push_back((now.0, selected));
                    chip.drive_pin(now, pinout::NSS, Some(self.nss));
                    self.route_nss(chip, now);
                }
                Action::Clock(bit) => {
                    let connected =
                        [pinout::SCK, pinout::MOSI].map(|pin| chip.role(pin) == SPI_FUNCTION);
                    let driven = chip.role(pinout::MISO) == SPI_FUNCTION;
                    self.route_nss(chip, now);
                    let answer = if connected[0] {
                        chip.drive_spi(now, |spi, registers, context| {
                            spi.clock(bit && connected[1], registers, context)
                        })
                    } else {
                        None
                    };
                    // The Pi's input has a pull-down: a line nobody drives is low.
                    self.spi.answer(answer.unwrap_or(false) && driven);
                }
            }
        }
    }

    /// How many of the master's clocks may pass before the slave does something that could be seen.
    fn clocks_ahead(chip: &Stm32f411) -> usize {
        let registers = chip.spi_registers();
        if chip.spi.listens(registers) {
            chip.spi.clocks_to_act(registers) as usize - 1
        } else {
            0
        }
    }

    /// The next action due by `now`, once the clock the slave acts at is.
    fn next_action(&mut self, chip: &Stm32f411, now: VirtualNanos) -> Option<Action> {
        if self.spi.next(Self::clocks_ahead(chip))? > now.0 {
            return None;
        }
        self.spi.take(now.0)
    }

    fn route_nss(&self, chip: &mut Stm32f411, now: VirtualNanos) {
        let routed = chip.role(pinout::NSS) == SPI_FUNCTION;
        let level = routed.then_some(self.nss);
        chip.drive_spi(now, |spi, registers, context| {
            spi.select(level, registers, context);
        });
    }

    /// The wheels' edges.
    fn turn(&mut self, chip: &mut Stm32f411, now: VirtualNanos) {
        for (nth, pins) in ENCODERS.into_iter().enumerate() {
            while let Some(edge) = self.encoders[nth].take(now.0) {
                let before = Encoder::levels(self.counts[nth]);
                let after = Encoder::levels(edge.count);
                self.counts[nth] = edge.count;
                for channel in 0..2 {
                    if before[channel] != after[channel] {
                        chip.drive_pin(now, pins.pins[channel], Some(after[channel]));
                    }
                }
                if pins
                    .pins
                    .iter()
                    .all(|&pin| chip.role(pin) == Role::Function(pins.function))
                {
                    self.tell(chip, now, nth, after);
                }
            }
        }
    }

    fn tell(&mut self, chip: &mut Stm32f411, now: VirtualNanos, nth: usize, levels: [Level; 2]) {
        for (channel, told) in (1..).zip(0..2) {
            if self.told[nth][told] != levels[told] {
                self.told[nth][told] = levels[told];
                chip.drive_timer(now, ENCODERS[nth].timer, channel, levels[told]);
            }
        }
    }

    fn echo(&mut self, chip: &mut Stm32f411, now: VirtualNanos) {
        for (ranger, pins) in self.rangers.iter_mut().zip(pinout::RANGERS) {
            while let Some(high) = ranger.take(now.0) {
                chip.drive_pin(now, pins.echo, Some(Level::from(high)));
            }
        }
    }

    fn receive(&mut self, chip: &mut Stm32f411) {
        let arrived = chip.usart[0]
            .chip_mut::<Wire>()
            .map(Wire::take)
            .unwrap_or_default();
        if arrived.is_empty() || chip.role(pinout::TX) != LOG_FUNCTION {
            return;
        }
        let readable = uart::readable(chip.usart1_baud());
        self.log.extend(arrived.into_iter().map(|word| LogByte {
            byte: if readable { word.byte } else { 0xFF },
            ..word
        }));
    }

    /// The motion sensor's interrupt pin.
    fn interrupt(&mut self, chip: &mut Stm32f411, now: VirtualNanos) {
        let mut bus = self.i2c.lock();
        let high = bus.mpu.as_mut().is_some_and(|mpu| mpu.interrupt(now.0));
        drop(bus);
        if high != self.irq {
            self.irq = high;
            chip.drive_pin(now, pinout::MPU_IRQ, Some(Level::from(high)));
        }
    }

    /// The motion sensor feels the piece of the world's way that ends now.
    fn feel(&mut self, now: u64) {
        let turned = self.world.pose().heading_rad - self.before.pose.heading_rad;
        if let Some(mpu) = &mut self.i2c.lock().mpu {
            mpu.millisecond(now, turned.to_degrees() / TICK_S);
        }
    }

    /// Integrates the world over the next millisecond with what the bridge applies now.
    fn tick(&mut self, chip: &mut Stm32f411) {
        let start = self.next_tick;
        self.next_tick += TICK_NS;
        let left = bridge::input(chip, pinout::LEFT_BRIDGE);
        let right = bridge::input(chip, pinout::RIGHT_BRIDGE);
        self.feel(start);
        let before = self.world.wheel_phase();
        self.before = Moment::of(&self.world);
        self.world.step(TICK_S, left, right);
        let after = self.world.wheel_phase();
        self.encoders[0].plan(start, TICK_NS, before.left, after.left);
        self.encoders[1].plan(start, TICK_NS, before.right, after.right);
        self.show_analog(chip);
    }
}

#[cfg(test)]
mod tests;
