//! The handle on a virtual robot: boot it, let time pass, look at it, break it.

use std::collections::VecDeque;
use std::sync::{Arc, Mutex};

use plant::{Params, Pose2, Room, Sides, World};
use rigless::device::{Level, ResetCause};
use rigless::image::Image;
use rigless::soc::Width;

use crate::board_model::{OutputChange, Ping, Surroundings};
use crate::components::bridge;
use crate::components::eeprom::Eeprom;
use crate::components::i2c_bus::{I2cBus, SharedBus, Side};
use crate::components::mpu6050::{Mpu6050, Mpu6050Params};
use crate::components::spi_master::Step;
use crate::components::uart_receiver::LogByte;
use crate::emulator::{Debugger, Emulation, Ended, Scene};
use crate::fault_injection::Disturbance;
use crate::pinout;
use crate::trace::{code, Code, Event, Function, NoFunction};
use crate::unmodelled::Unmodelled;
use crate::virtual_board::{Robot, VirtualBoard};

/// How a virtual robot is built. The default is the first board with a blank EEPROM at the start of
/// the default room.
#[derive(Debug)]
pub struct Options {
    /// What all chance of the run is drawn from.
    pub seed: u64,
    /// The room.
    pub room: Room,
    /// Where the robot stands in it; the room's own start when `None`.
    pub start: Option<Pose2>,
    /// Motors, battery, chassis and rangefinders.
    pub params: Params,
    /// The EEPROM's first bytes, erased past their end; `None`: no EEPROM is fitted.
    pub eeprom: Option<Vec<u8>>,
    /// The MPU6050's errors; `None`: none is fitted.
    pub mpu: Option<Mpu6050Params>,
    /// Whether the 8 MHz crystal works.
    pub crystal: bool,
    /// The factory's words: voltage reference, temperature sensor at 30 and at 110 °C.
    pub factory_words: [u16; 3],
    /// A debugger's port.
    pub debugger: Option<Debugger>,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            seed: 1,
            room: Room::two_rooms(),
            start: None,
            params: Params::default(),
            eeprom: Some(Vec::new()),
            mpu: Some(Mpu6050Params::default()),
            crystal: true,
            factory_words: FACTORY_WORDS,
            debugger: None,
        }
    }
}

/// What is true of the robot, whatever the firmware believes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Truth {
    /// Nanoseconds of virtual time.
    pub at_ns: u64,
    /// Where it is, in the room's frame: millimetres and radians.
    pub pose: Pose2,
    /// The wheels' speeds, °/s, positive forward.
    pub wheel_deg_s: Sides<f64>,
    /// What the bridge applies to the motors, −1..=1; 0 with the brake on.
    pub duty: Sides<f64>,
    /// The battery's taps against ground, volts.
    pub battery_v: [f64; 2],
    /// Length of the path so far, millimetres.
    pub path_mm: f64,
    /// How often it ran into something.
    pub collisions: u32,
}

/// A restart of the microcontroller.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Reset {
    /// Nanoseconds of virtual time.
    pub at_ns: u64,
    /// Why.
    pub cause: ResetBy,
}

/// Why the microcontroller restarted.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ResetBy {
    /// The RESET line.
    Pin,
    /// The firmware's own request, or a lock-up of the core.
    Core,
    /// The independent watchdog.
    Watchdog,
    /// Anything else.
    Other,
}

/// The reference's 1.21 V, and 0.76 V at 25 °C with 2.5 mV/K, converted at 3.3 V: what the converter's
/// model answers (STM32F411xC/xE data sheet, temperature sensor and internal reference characteristics).
const FACTORY_WORDS: [u16; 3] = [1501, 959, 1207];

/// Where the factory left them: 0x1FFF7A2A, 0x1FFF7A2C, 0x1FFF7A2E.
const FACTORY_WORDS_AT: u64 = 0x1FFF_7A2A;

/// Where the part's flash begins.
const FLASH: u64 = 0x0800_0000;

/// A vector table and, behind it, `wfi` and a jump back to it: for a board whose firmware does not
/// matter, or is to be loaded by a debugger. The emulator boots no empty flash.
const SLEEPER: [u8; 12] = [
    0x00, 0x00, 0x02, 0x20, // stack at the end of the RAM
    0x09, 0x00, 0x00, 0x08, // reset: the next word, Thumb
    0x30, 0xBF, // wfi
    0xFD, 0xE7, // b wfi
];

/// A virtual robot. Clones are handles on the same one.
///
/// Virtual time stands still except inside the methods that say they let it pass. A method panics
/// when the emulation has ended, with the reason: a model failed or a debugger killed the run. The
/// embedded-hal implementations answer with an error instead.
#[derive(Clone, Debug)]
pub struct Board {
    emulation: Arc<Emulation>,
    /// What is to happen to the Pi's next transfers.
    pub(crate) disturbances: Arc<Mutex<VecDeque<Disturbance>>>,
    elf: Arc<[u8]>,
}

impl Board {
    /// The board with the ELF file `elf` in its flash, powered and standing before the first
    /// instruction. An empty `elf` stands for a program that only sleeps.
    ///
    /// # Errors
    /// A file that is no ELF of this part, or does not fit it.
    pub fn new(elf: &[u8], options: Options) -> Result<Self, Ended> {
        let (bytes, at) = if elf.is_empty() {
            (SLEEPER.to_vec(), Some(FLASH))
        } else {
            (elf.to_vec(), None)
        };
        let image = Image::new(std::path::Path::new("firmware"), bytes, at)
            .map_err(|error| Ended(error.to_string()))?;
        let start = options.start.unwrap_or(options.room.start);
        let world = World::new(options.params, options.room, start, options.seed);
        let mpu = options.mpu.map(|errors| Mpu6050::new(errors, options.seed));
        let bus = I2cBus::new(options.eeprom.as_deref().map(Eeprom::holding)).with_mpu(mpu);
        let around = Surroundings::new(world, SharedBus::new(bus));
        let board =
            VirtualBoard::new(around, options.crystal).map_err(|error| Ended(error.to_string()))?;
        let words = options.factory_words.map(u16::to_le_bytes).concat();
        let factory = Image::new(
            std::path::Path::new("factory"),
            words,
            Some(FACTORY_WORDS_AT),
        )
        .map_err(|error| Ended(error.to_string()))?;
        let emulation = Emulation::start(board, vec![image, factory], options.debugger)?;
        Ok(Self {
            emulation: Arc::new(emulation),
            disturbances: Arc::default(),
            elf: elf.into(),
        })
    }

    /// Does `work` where the run stands.
    ///
    /// # Errors
    /// When the emulation has ended.
    pub fn try_with<T: Send + 'static>(
        &self,
        work: impl FnOnce(&mut Scene<'_>) -> T + Send + 'static,
    ) -> Result<T, Ended> {
        self.emulation.with(work)
    }

    fn with<T: Send + 'static>(
        &self,
        work: impl FnOnce(&mut Scene<'_>) -> T + Send + 'static,
    ) -> T {
        self.try_with(work)
            .unwrap_or_else(|ended| panic!("{ended}"))
    }

    fn robot<T: Send + 'static>(&self, work: impl FnOnce(&mut Robot) -> T + Send + 'static) -> T {
        self.with(|scene| work(&mut scene.session.board_mut().robot))
    }

    /// Lets virtual time pass, nanoseconds.
    ///
    /// # Errors
    /// When the emulation has ended.
    pub fn try_run_ns(&self, ns: u64) -> Result<(), Ended> {
        self.emulation.run_for(ns)
    }

    /// Lets virtual time pass, microseconds.
    ///
    /// # Panics
    /// When the emulation has ended.
    pub fn run_us(&self, us: u64) {
        self.try_run_ns(us * 1000)
            .unwrap_or_else(|ended| panic!("{ended}"));
    }

    /// Lets virtual time pass in pieces of `step_us` until `done`; answers whether it was within
    /// `limit_us`.
    ///
    /// # Panics
    /// When the emulation has ended.
    pub fn run_until(
        &self,
        limit_us: u64,
        step_us: u64,
        mut done: impl FnMut(&Self) -> bool,
    ) -> bool {
        let ends = self.now_us() + limit_us;
        loop {
            if done(self) {
                return true;
            }
            if self.now_us() >= ends {
                return false;
            }
            self.run_us(step_us);
        }
    }

    /// Virtual time since power-on, nanoseconds.
    ///
    /// # Panics
    /// When the emulation has ended.
    #[must_use]
    pub fn now_ns(&self) -> u64 {
        self.emulation
            .now()
            .unwrap_or_else(|ended| panic!("{ended}"))
    }

    /// Virtual time since power-on, microseconds.
    #[must_use]
    pub fn now_us(&self) -> u64 {
        self.now_ns() / 1000
    }

    /// Instructions the core has retired since power-on.
    #[must_use]
    pub fn instructions(&self) -> u64 {
        self.with(|scene| scene.instructions)
    }

    /// What is true right now.
    #[must_use]
    pub fn truth(&self) -> Truth {
        self.with(|scene| {
            let Robot { chip, around } = &scene.session.board_mut().robot;
            let duty = |pins| bridge::input(chip, pins).duty;
            let (pose, wheel_deg_s) = around.at(scene.now);
            Truth {
                at_ns: scene.now,
                pose,
                wheel_deg_s,
                duty: Sides::new(duty(pinout::LEFT_BRIDGE), duty(pinout::RIGHT_BRIDGE)),
                battery_v: around.world.battery().taps(),
                path_mm: around.world.path_mm(),
                collisions: around.world.collisions(),
            }
        })
    }

    /// Looks at the physical world or changes it: its faults, a push, a servo.
    pub fn world<T: Send + 'static>(
        &self,
        work: impl FnOnce(&mut World) -> T + Send + 'static,
    ) -> T {
        self.robot(|robot| work(&mut robot.around.world))
    }

    /// The log's bytes so far.
    #[must_use]
    pub fn uart(&self) -> Vec<u8> {
        self.uart_from(0)
    }

    /// The log's bytes from byte `from` on.
    #[must_use]
    pub fn uart_from(&self, from: usize) -> Vec<u8> {
        self.robot(move |robot| {
            let new = robot.around.log.get(from..).unwrap_or_default();
            new.iter().map(|word| word.byte).collect()
        })
    }

    /// The log's bytes so far with their times.
    #[must_use]
    pub fn log(&self) -> Vec<LogByte> {
        self.robot(|robot| robot.around.log.clone())
    }

    /// Every change of READY and of the LEDs so far.
    #[must_use]
    pub fn outputs(&self) -> Vec<OutputChange> {
        self.robot(|robot| robot.around.outputs.clone())
    }

    /// Every burst of a rangefinder so far.
    #[must_use]
    pub fn pings(&self) -> Vec<Ping> {
        self.robot(|robot| robot.around.pings.clone())
    }

    /// Whether READY is high.
    #[must_use]
    pub fn is_ready(&self) -> bool {
        self.robot(|robot| robot.is_ready())
    }

    /// Which LEDs are lit, bit 0 = LED 1.
    #[must_use]
    pub fn leds(&self) -> u8 {
        self.robot(|robot| {
            (0..)
                .zip(pinout::LEDS)
                .filter(|&(_, pin)| robot.chip.output(pin) == Some(Level::Low))
                .fold(0, |lit, (nth, _)| lit | 1 << nth)
        })
    }

    /// Everything the firmware touched that no model covers, and everything it did that a model
    /// objects to.
    #[must_use]
    pub fn unmodelled(&self) -> Unmodelled {
        self.with(|scene| Unmodelled::of(scene.session))
    }

    /// Every restart so far.
    #[must_use]
    pub fn resets(&self) -> Vec<Reset> {
        self.with(|scene| {
            scene
                .session
                .resets()
                .iter()
                .map(|reset| Reset {
                    at_ns: reset.at.0,
                    cause: match reset.cause {
                        ResetCause::Pin => ResetBy::Pin,
                        ResetCause::Core => ResetBy::Core,
                        ResetCause::Model("IWDG") => ResetBy::Watchdog,
                        _ => ResetBy::Other,
                    },
                })
                .collect()
        })
    }

    /// Pulls the RESET line low (the microcontroller stays in reset) or lets it go (it boots).
    ///
    /// # Errors
    /// When the emulation has ended.
    pub fn hold_reset(&self, low: bool) -> Result<(), Ended> {
        self.try_with(move |scene| {
            let around = &mut scene.session.board_mut().robot.around;
            let fell = low && !around.reset_low;
            around.reset_low = low;
            if fell {
                let at = rigless::time::VirtualNanos(scene.now);
                scene
                    .session
                    .reset_by_pin(at, scene.instructions, scene.host);
            }
            scene.host.hold(low);
        })
    }

    /// Throws the I2C switch: the EEPROM to the Pi, or back to the STM.
    ///
    /// # Errors
    /// When the emulation has ended.
    pub fn give_eeprom_to_pi(&self, pi: bool) -> Result<(), Ended> {
        self.try_with(move |scene| {
            let now = rigless::time::VirtualNanos(scene.now);
            let Robot { chip, around } = &mut scene.session.board_mut().robot;
            let side = if pi { Side::Pi } else { Side::Stm };
            around.i2c.lock().give_to(side);
            around.show_bus(chip, now);
        })
    }

    /// Works on the EEPROM's bus: its contents, its write protection, a part that holds it.
    ///
    /// # Errors
    /// When the emulation has ended.
    pub fn i2c_bus<T: Send + 'static>(
        &self,
        work: impl FnOnce(&mut I2cBus, u64) -> T + Send + 'static,
    ) -> Result<T, Ended> {
        self.try_with(|scene| {
            let now = scene.now;
            let at = rigless::time::VirtualNanos(now);
            let Robot { chip, around } = &mut scene.session.board_mut().robot;
            let answer = work(&mut around.i2c.lock(), now);
            around.show_bus(chip, at);
            answer
        })
    }

    /// Plays `steps` on the Pi's SPI wires and lets virtual time pass until they end. Answers with
    /// the bit on MISO at every clock.
    ///
    /// # Errors
    /// When the emulation has ended.
    pub fn spi_raw(&self, steps: Vec<Step>) -> Result<Vec<bool>, Ended> {
        let ends = self.try_with(move |scene| {
            let now = scene.now;
            let robot = &mut scene.session.board_mut().robot;
            robot.around.spi.play(now, steps)
        })?;
        // One nanosecond on, so the last step has been carried out.
        self.emulation.run_until(ends + 1)?;
        self.try_with(|scene| scene.session.board_mut().robot.around.spi.take_miso())
    }

    /// The words in memory from `address` on, as a debugger would read them.
    ///
    /// # Errors
    /// When the emulation has ended, or there is no memory.
    pub fn words(&self, address: u64, count: u64) -> Result<Vec<u32>, Ended> {
        self.try_with(move |scene| {
            (0..count)
                .map(|nth| {
                    let word = scene.host.read(address + 4 * nth, Width::W32).ok();
                    word.and_then(|word| u32::try_from(word).ok())
                })
                .collect::<Option<Vec<u32>>>()
        })?
        .ok_or_else(|| Ended(format!("no memory at {address:#x}")))
    }

    /// Follows every run through the function `name` from now on: [`crate::trace`].
    ///
    /// # Errors
    /// When the firmware has no such function.
    ///
    /// # Panics
    /// When the emulation has ended.
    pub fn trace(&self, name: &str) -> Result<Function, NoFunction> {
        let function = Function::find(&self.elf, name)?;
        for address in function.watched() {
            self.emulation
                .watch(address, true)
                .unwrap_or_else(|ended| panic!("{ended}"));
        }
        Ok(function)
    }

    /// Follows every instruction of the firmware from now on: [`crate::trace::shares`]. Slow.
    ///
    /// # Errors
    /// When the firmware's ELF file cannot be read.
    ///
    /// # Panics
    /// When the emulation has ended.
    pub fn profile(&self) -> Result<Vec<Code>, NoFunction> {
        let code = code(&self.elf)?;
        let addresses: Vec<u64> = code.iter().flat_map(|c| c.instructions.clone()).collect();
        self.with(move |scene| {
            for address in addresses {
                scene
                    .session
                    .watch(rigless::emulator::Watch::Instruction(address));
            }
        });
        Ok(code)
    }

    /// Follows every write of the firmware to the register at `address` from now on.
    pub fn follow_writes(&self, address: u64) {
        self.with(move |scene| scene.followed.registers.push(address));
    }

    /// Follows the chip select from now on.
    pub fn follow_select(&self) {
        self.with(|scene| {
            scene.session.board_mut().robot.around.selects.clear();
            scene.followed.select = true;
        });
    }

    /// Fills RAM with a byte: paint, to see later what the firmware wrote over.
    ///
    /// # Errors
    /// When the emulation has ended.
    ///
    /// # Panics
    /// Where that is no RAM.
    pub fn paint(&self, range: std::ops::Range<u64>, byte: u8) -> Result<(), Ended> {
        self.try_with(move |scene| {
            for address in range {
                scene
                    .host
                    .write(address, Width::W8, byte.into())
                    .unwrap_or_else(|error| panic!("{address:#x}: {error}"));
            }
        })
    }

    /// How many bytes from the start of a painted range still hold the paint.
    ///
    /// # Errors
    /// When the emulation has ended.
    pub fn painted(&self, range: std::ops::Range<u64>, byte: u8) -> Result<u64, Ended> {
        self.try_with(move |scene| {
            let mut left = range.clone();
            let first =
                left.find(|&address| scene.host.read(address, Width::W8).ok() != Some(byte.into()));
            first.unwrap_or(range.end) - range.start
        })
    }

    /// Takes what was followed since the last call, in the order it happened.
    #[must_use]
    pub fn take_events(&self) -> Vec<Event> {
        self.with(|scene| std::mem::take(&mut scene.followed.events))
    }
}
