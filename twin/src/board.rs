//! The handle on a virtual robot: boot it, let virtual time pass, inspect it.

use std::path::Path;
use std::sync::Arc;

use plant::{Pose2, Sides, World};
use rigless::device::{Level, ResetCause};
use rigless::image::Image;

use crate::board_model::{BoardModel, Ping};
use crate::components::bridge;
use crate::components::eeprom::Eeprom;
use crate::components::i2c_bus::{I2cBus, I2cController, SharedBus};
use crate::components::mpu6050::Mpu6050;
use crate::components::spi_master::SpiStep;
use crate::components::uart_receiver::LogByte;
use crate::emulator::{EmulationEnded, Emulator, StoppedBoard};
use crate::options::Options;
use crate::peripherals::board_port::PinChange;
use crate::pinout;
use crate::unmodelled::unmodelled;
use crate::virtual_board::{McuOnBoard, VirtualBoard};

/// The true state of the robot, independent of the firmware's estimate.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Truth {
    /// Nanoseconds of virtual time.
    pub at_ns: u64,
    /// Pose in the room's frame.
    pub pose: Pose2,
    /// The wheels' speeds, °/s, positive forward.
    pub wheel_deg_s: Sides<f64>,
    /// What the bridge applies to the motors, −1..=1; 0 with the brake on.
    pub duty: Sides<f64>,
    /// The battery's cells, volts.
    pub cells_v: [f64; 2],
    /// Length of the path so far, millimetres.
    pub path_mm: f64,
    /// Number of collisions.
    pub collisions: u32,
}

/// The source of a reset of the microcontroller.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ResetSource {
    /// The RESET line.
    Pin,
    /// The firmware's own request, or a lock-up of the core.
    Core,
    /// The independent watchdog.
    Watchdog,
    /// Anything else.
    Other,
}

/// Address of what the factory writes: the flash's size in KiB at 0x1FFF7A22, calibration words at 0x1FFF7A2A,
/// 0x1FFF7A2C and 0x1FFF7A2E.
const FACTORY_WORDS: u64 = 0x1FFF_7A22;
const FLASH_KIB: u16 = 512;
/// Start of the part's flash.
const FLASH: u64 = 0x0800_0000;

/// A vector table and, behind it, `wfi` and a jump back to it: for a board whose firmware does not
/// matter, or is loaded by a debugger. The emulator boots no empty flash.
const IDLE_PROGRAM: [u8; 12] = [
    0x00, 0x00, 0x02, 0x20, // stack at the end of the RAM
    0x09, 0x00, 0x00, 0x08, // reset: the next word, Thumb
    0x30, 0xBF, // wfi
    0xFD, 0xE7, // b wfi
];

/// A virtual robot. Clones are handles on the same one.
///
/// Virtual time passes only inside the methods that say so. When the emulation ends (a model failed,
/// or a debugger ended the run), every method that does not return [`EmulationEnded`] panics with the
/// reason; the embedded-hal implementations return an error.
#[derive(Clone, Debug)]
pub struct Board {
    emulator: Arc<Emulator>,
    pub(crate) elf: Arc<[u8]>,
}

fn image(name: &str, bytes: Vec<u8>, at: Option<u64>) -> Result<Image, EmulationEnded> {
    Image::new(Path::new(name), bytes, at).map_err(EmulationEnded::because)
}

fn running<T>(result: Result<T, EmulationEnded>) -> T {
    result.unwrap_or_else(|ended| panic!("{ended}"))
}

impl Board {
    /// The board with the ELF file `elf` in its flash, powered and stopped before the first
    /// instruction. An empty `elf` stands for a program that only sleeps.
    ///
    /// # Errors
    /// A file that is no ELF of this part, or does not fit it.
    pub fn new(elf: &[u8], options: Options) -> Result<Self, EmulationEnded> {
        let firmware = if elf.is_empty() {
            image("idle", IDLE_PROGRAM.to_vec(), Some(FLASH))?
        } else {
            image("firmware", elf.to_vec(), None)?
        };
        let [reference, cold, hot] = options.calibration_words;
        let words = [FLASH_KIB, 0xFFFF, 0xFFFF, 0xFFFF, reference, cold, hot];
        let words = words.map(u16::to_le_bytes).concat();
        let factory = image("factory words", words, Some(FACTORY_WORDS))?;
        let start = options.start.unwrap_or(options.room.start);
        let imperfections = options.params.imperfections;
        let world = World::new(options.params, options.room, start, options.seed);
        let eeprom = options.eeprom.as_deref().map(Eeprom::new);
        let mpu = options.mpu.map(|errors| {
            let errors = imperfections.draw_gyro(errors, options.seed);
            Mpu6050::new(errors, options.seed)
        });
        let model = BoardModel::new(world, SharedBus::new(I2cBus::new(eeprom, mpu)));
        let mut board = VirtualBoard::new(model, options.crystal_hz, options.mips)
            .map_err(EmulationEnded::because)?;
        board.mcu.chip.spi.prefetch = options.spi_prefetch;
        let emulator = Emulator::start(board, vec![firmware, factory], options.debugger)?;
        if !elf.is_empty() {
            emulator.stopped(|stopped| stopped.time_exceptions(FLASH))?;
        }
        Ok(Self {
            emulator: Arc::new(emulator),
            elf: elf.into(),
        })
    }

    /// Does `work` on the stopped board.
    ///
    /// # Errors
    /// When the emulation has ended.
    pub fn try_stopped<T: Send + 'static>(
        &self,
        work: impl FnOnce(&mut StoppedBoard<'_>) -> T + Send + 'static,
    ) -> Result<T, EmulationEnded> {
        self.emulator.stopped(work)
    }

    /// Does `work` on the stopped board.
    pub fn stopped<T: Send + 'static>(
        &self,
        work: impl FnOnce(&mut StoppedBoard<'_>) -> T + Send + 'static,
    ) -> T {
        running(self.try_stopped(work))
    }

    fn model<T: Send + 'static>(
        &self,
        work: impl FnOnce(&mut BoardModel) -> T + Send + 'static,
    ) -> T {
        self.stopped(|stopped| work(&mut stopped.mcu().board))
    }

    /// Lets virtual time pass, nanoseconds.
    ///
    /// # Errors
    /// When the emulation has ended.
    pub fn try_run_ns(&self, ns: u64) -> Result<(), EmulationEnded> {
        self.emulator
            .run_until(move |stopped| stopped.now + ns, |_| ())
    }

    /// Lets virtual time pass, microseconds.
    pub fn run_us(&self, us: u64) {
        running(self.try_run_ns(us * 1000));
    }

    /// Lets virtual time pass in steps of `step_us` until `done`; returns whether it was within
    /// `limit_us`.
    pub fn run_until(
        &self,
        limit_us: u64,
        step_us: u64,
        mut done: impl FnMut(&Self) -> bool,
    ) -> bool {
        let ends = self.now_us() + limit_us;
        while !done(self) {
            if self.now_us() >= ends {
                return false;
            }
            self.run_us(step_us);
        }
        true
    }

    /// Virtual time since power-on, nanoseconds.
    pub fn now_ns(&self) -> u64 {
        running(self.emulator.now())
    }

    /// Virtual time since power-on, microseconds.
    pub fn now_us(&self) -> u64 {
        self.now_ns() / 1000
    }

    /// Instructions the core has retired since power-on.
    pub fn instructions(&self) -> u64 {
        self.stopped(|stopped| stopped.instructions)
    }

    /// The true state right now.
    pub fn truth(&self) -> Truth {
        self.stopped(|stopped| {
            let (at_ns, at) = (stopped.now, stopped.at());
            let McuOnBoard { chip, board } = stopped.mcu();
            let duty = |pins| bridge::input(chip, at, pins).duty;
            let (pose, wheel_deg_s) = board.at(at_ns);
            let [one, both] = board.world.battery().taps();
            Truth {
                at_ns,
                pose,
                wheel_deg_s,
                duty: Sides::new(duty(pinout::LEFT_BRIDGE), duty(pinout::RIGHT_BRIDGE)),
                cells_v: [one, both - one],
                path_mm: board.world.path_mm(),
                collisions: u32::try_from(board.world.collisions().len()).unwrap_or(u32::MAX),
            }
        })
    }

    /// Inspects or changes the physical world: its faults, a push, the servo.
    pub fn world<T: Send + 'static>(
        &self,
        work: impl FnOnce(&mut World) -> T + Send + 'static,
    ) -> T {
        self.model(|model| work(&mut model.world))
    }

    /// The log's bytes so far.
    pub fn uart(&self) -> Vec<u8> {
        self.uart_from(0)
    }

    /// The log's bytes from byte `from` on.
    pub fn uart_from(&self, from: usize) -> Vec<u8> {
        self.model(move |model| {
            let new = model.log.get(from..).unwrap_or_default();
            new.iter().map(|word| word.byte).collect()
        })
    }

    /// Sets the rate at which the log is received from now on; 115200 baud until then.
    pub fn set_receiver(&self, baud: u32) {
        self.model(move |model| model.receiver_baud = baud.into());
    }

    /// The log's bytes so far with their times.
    pub fn log(&self) -> Vec<LogByte> {
        self.model(|model| model.log.clone())
    }

    /// Every change of READY and of the LEDs so far.
    pub fn outputs(&self) -> Vec<PinChange> {
        self.model(|model| model.outputs.clone())
    }

    /// Every burst of a rangefinder so far.
    pub fn pings(&self) -> Vec<Ping> {
        self.model(|model| model.pings.clone())
    }

    /// Whether READY is high.
    pub fn is_ready(&self) -> bool {
        self.stopped(|stopped| stopped.mcu().is_ready())
    }

    /// Which LEDs are lit, bit 0 = LED 1.
    pub fn leds(&self) -> u8 {
        self.stopped(|stopped| {
            let chip = &stopped.mcu().chip;
            let lit = |pin| u8::from(chip.output(pin) == Some(Level::Low));
            (0..)
                .zip(pinout::LEDS)
                .map(|(nth, pin)| lit(pin) << nth)
                .sum()
        })
    }

    /// Every register access without a model and every objection of a model so far, a line each.
    pub fn unmodelled(&self) -> Vec<String> {
        self.stopped(|stopped| unmodelled(stopped.session))
    }

    /// Every reset so far.
    pub fn resets(&self) -> Vec<ResetSource> {
        self.stopped(|stopped| {
            let resets = stopped.session.resets().iter();
            let resets = resets.map(|reset| match reset.cause {
                ResetCause::Pin => ResetSource::Pin,
                ResetCause::Core => ResetSource::Core,
                ResetCause::Model("IWDG") => ResetSource::Watchdog,
                _ => ResetSource::Other,
            });
            resets.collect()
        })
    }

    /// Pulls the RESET line low (the microcontroller stays in reset) or releases it (it boots).
    pub fn hold_reset(&self, low: bool) {
        self.stopped(move |stopped| stopped.hold_reset(low));
    }

    /// Switches the EEPROM's bus.
    pub fn switch_i2c(&self, to: I2cController) {
        self.stopped(move |stopped| stopped.switch_i2c(to));
    }

    /// Works on the EEPROM's bus at the present time: contents, write protection, a held line.
    pub fn i2c_bus<T: Send + 'static>(
        &self,
        work: impl FnOnce(&mut I2cBus, u64) -> T + Send + 'static,
    ) -> T {
        self.stopped(|stopped| stopped.i2c_bus(work))
    }

    /// Plays `steps` on the Pi's SPI wires and lets virtual time pass until they end. Returns the
    /// bit on MISO at every clock.
    ///
    /// # Errors
    /// When the emulation has ended.
    pub fn try_spi_steps(&self, steps: Vec<SpiStep>) -> Result<Vec<bool>, EmulationEnded> {
        let play = move |stopped: &mut StoppedBoard<'_>| {
            let now = stopped.now;
            // One nanosecond on, so the last step is carried out.
            stopped.mcu().board.spi.play(now, steps) + 1
        };
        let take = |stopped: &mut StoppedBoard<'_>| stopped.mcu().board.spi.take_miso();
        self.emulator.run_until(play, take)
    }

    /// Like [`Board::try_spi_steps`].
    pub fn spi_steps(&self, steps: Vec<SpiStep>) -> Vec<bool> {
        running(self.try_spi_steps(steps))
    }
}

impl StoppedBoard<'_> {
    pub(crate) fn hold_reset(&mut self, low: bool) {
        let at = self.at();
        let was_low = std::mem::replace(&mut self.mcu().board.reset_low, low);
        if low && !was_low {
            self.session.reset_by_pin(at, self.instructions, self.host);
        }
        self.hold_core(low);
    }

    pub(crate) fn switch_i2c(&mut self, to: I2cController) {
        self.i2c_bus(|bus, _| bus.switch_to(to));
    }

    /// Works on the EEPROM's bus at the present time.
    pub fn i2c_bus<T>(&mut self, work: impl FnOnce(&mut I2cBus, u64) -> T) -> T {
        let at = self.at();
        let McuOnBoard { chip, board } = self.mcu();
        let result = work(&mut board.i2c.lock(), at.0);
        board.drive_i2c_lines(chip, at);
        result
    }
}
