//! The Raspberry Pi's own buses: spidev, i2c-dev and the GPIO character device.
//!
//! GPIO numbers are BCM's, of the first board. The lines' idle levels need no program: when this
//! one ends, the kernel keeps them or makes them inputs, and the board pulls `WP_EEPROM` up and SELECT
//! down.

use crate::board_io::{BoardIo, Interrupt, IoError, delay, i2c, input, output, spi};
use crate::error::Error;
use crate::uart::SerialPort;
use linux_embedded_hal::gpio_cdev::{self, Chip, Line, LineHandle, LineRequestFlags};
use linux_embedded_hal::spidev::{SpiModeFlags, SpidevOptions};
use linux_embedded_hal::{CdevPin, CdevPinError, Delay, I2cdev, SpidevDevice};
use std::fs;
use std::path::{Path, PathBuf};
use std::time::Instant;

/// BCM number of RESET: the STM's NRST.
pub const RESET: u32 = 0;
/// BCM number of SELECT: the I2C switch.
pub const SELECT: u32 = 4;
/// BCM number of `WP_EEPROM`.
pub const PROTECT: u32 = 17;
/// BCM number of `STM_READY`.
pub const READY: u32 = 22;

/// Which device files to use.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Devices {
    /// `/dev/spidev0.0`.
    pub spi: PathBuf,
    /// SPI clock, hertz.
    pub spi_hz: u32,
    /// `/dev/i2c-1`.
    pub i2c: PathBuf,
    /// `/dev/gpiochip0`; where that is no Pi's, the chip beside it that is.
    pub gpiochip: PathBuf,
    /// `/dev/serial0`: opened when the log is first asked for.
    pub uart: PathBuf,
}

/// Opens everything. SELECT and `WP_EEPROM` are at their idle levels from the first moment on.
///
/// # Errors
/// [`Error::Device`] names the device and what to do.
pub fn open(devices: &Devices, interrupt: Interrupt) -> Result<BoardIo, Error> {
    let gpio_failed = |cause| Error::device(devices.gpiochip.display(), cause, GPIO_ADVICE);
    let mut chip = open_chip(&devices.gpiochip).map_err(gpio_failed)?;
    let path = chip.path().to_path_buf();
    let mut pin = |net: &str, offset: u32, flags: LineRequestFlags, value: u8| {
        let line = chip.get_line(offset);
        let handle = line.and_then(|line| line.request(flags, value, net));
        handle.and_then(CdevPin::new).map_err(|cause| {
            let name = format!("{} line {offset} ({net})", path.display());
            Error::device(name, cause, GPIO_ADVICE)
        })
    };
    let protect = pin("WP_EEPROM", PROTECT, LineRequestFlags::OUTPUT, 1)?;
    let select = pin("SELECT", SELECT, LineRequestFlags::OUTPUT, 0)?;
    let ready = pin("STM_READY", READY, LineRequestFlags::INPUT, 0)?;
    let line = chip.get_line(RESET).map_err(gpio_failed)?;
    let mut reset = OpenDrain { line, low: None };

    // Requirement: DOC-2.1-5, WIRE-spi-4
    let spi_failed = |cause| Error::device(devices.spi.display(), cause, SPI_ADVICE);
    let mut device = SpidevDevice::open(&devices.spi).map_err(spi_failed)?;
    let options = SpidevOptions::new()
        .bits_per_word(8)
        .max_speed_hz(devices.spi_hz)
        .mode(SpiModeFlags::SPI_MODE_0)
        .build();
    let configured = device.0.configure(&options);
    configured.map_err(|cause| Error::device(devices.spi.display(), cause, SPI_ADVICE))?;
    let bus = I2cdev::new(&devices.i2c);
    let bus = bus.map_err(|cause| Error::device(devices.i2c.display(), cause, I2C_ADVICE))?;

    let mut uart = SerialPort::new(&devices.uart);
    // The computer's monotonic clock.
    let start = Instant::now();
    let micros = move || u64::try_from(start.elapsed().as_micros()).unwrap_or(u64::MAX);
    Ok(BoardIo {
        spi: spi(device),
        i2c: i2c(bus),
        reset: Box::new(move |high| reset.set(high).map_err(IoError::new)),
        select: output(select),
        protect: output(protect),
        ready: input(ready),
        delay: delay(Delay),
        clock: Box::new(micros),
        real_time: true,
        log: Box::new(move |baud| uart.read_new(baud)),
        interrupt,
    })
}

/// Labels of a Pi's own GPIO chip: up to model 3, model 4, model 5.
const LABELS: [&str; 3] = ["pinctrl-bcm2835", "pinctrl-bcm2711", "pinctrl-rp1"];

/// The chip at `path`; where that is not the Pi's, the one beside it that is: a Pi 5's has another number
/// from kernel to kernel.
fn open_chip(path: &Path) -> Result<Chip, gpio_cdev::Error> {
    let named = Chip::new(path)?;
    let is_pis = |chip: &Chip| LABELS.contains(&chip.label());
    if is_pis(&named) {
        return Ok(named);
    }
    let folder = path.parent().map(fs::read_dir);
    let beside = folder.into_iter().flatten().flatten().flatten();
    let chips = beside.filter(|file| file.file_name().to_string_lossy().starts_with("gpiochip"));
    let mut chips = chips.filter_map(|file| Chip::new(file.path()).ok());
    Ok(chips.find(is_pis).unwrap_or(named))
}

const GPIO_ADVICE: &str = "check that --gpiochip names the Pi's GPIOs, that no other program holds the line, and that \
     you are in the group gpio";
const SPI_ADVICE: &str =
    "enable SPI (raspi-config, or dtparam=spi=on in config.txt) and join the group spi";
const I2C_ADVICE: &str =
    "enable I2C (raspi-config, or dtparam=i2c_arm=on in config.txt) and join the group i2c";

/// A line that is driven low or released to an input, never driven high.
struct OpenDrain {
    line: Line,
    low: Option<LineHandle>,
}

impl OpenDrain {
    fn set(&mut self, high: bool) -> Result<(), CdevPinError> {
        if !high && self.low.is_none() {
            self.low = Some(self.line.request(LineRequestFlags::OUTPUT, 0, "RESET")?);
        } else if high {
            // The line must be free before it can be asked for as an input, and stays one after that.
            self.low = None;
            self.line.request(LineRequestFlags::INPUT, 0, "RESET")?;
        }
        Ok(())
    }
}

impl Drop for OpenDrain {
    fn drop(&mut self) {
        // A held reset line must not outlive the program.
        let _ = self.set(true);
    }
}
