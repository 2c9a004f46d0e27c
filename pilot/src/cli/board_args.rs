//! The options that choose a robot. All are global: they stand before or after the command.
#![allow(clippy::doc_markdown)] // the comments are the help text

use super::number::number;
use clap::parser::ValueSource;
use clap::{ArgMatches, Args};
use host_link::error::Error;
use host_link::{reset, session};
use std::path::PathBuf;

/// Which robot, and how to reach it.
#[derive(Args)]
#[command(next_help_heading = "Robot")]
pub struct BoardArgs {
    /// Frames per second
    #[arg(long, default_value_t = session::RATE_HZ, value_parser = number::<u32>(1..=2000))]
    pub rate: u32,
    /// How long to await STM_READY, ms
    #[arg(long, default_value_t = reset::READY_TIMEOUT_MS, value_parser = number::<u32>(1..=600_000))]
    pub ready_timeout: u32,
    /// Radius of the robot's body around the middle of its axle, mm: plans keep it off walls; the front sensor
    /// is front_overhang inside its rim, the others 40 mm
    #[arg(long, default_value = "100", value_parser = number(100.0..=300.0))]
    pub body_radius: f64,
    /// SPI device
    #[arg(long, default_value = "/dev/spidev0.0")]
    pub spi: PathBuf,
    /// SPI clock, Hz
    #[arg(long, default_value_t = 8_000_000, value_parser = number::<u32>(1_000..=25_000_000))]
    pub spi_hz: u32,
    /// I2C device
    #[arg(long, default_value = "/dev/i2c-1")]
    pub i2c: PathBuf,
    /// GPIO chip; where it is no Pi's, the one beside it that is
    #[arg(long, default_value = "/dev/gpiochip0")]
    pub gpiochip: PathBuf,
    /// Serial device with the STM's log; `tune`, `monitor` and `status` read it
    #[arg(long, default_value = "/dev/serial0")]
    pub uart: PathBuf,
    /// Folder of the lock and of the journal of an unfinished EEPROM write [default: /var/lib/robot of the
    /// package, or /var/tmp]
    #[arg(long, env = "ROBOT_STATE_DIR")]
    pub state_dir: Option<PathBuf>,
    #[command(flatten)]
    pub virtual_board: VirtualBoardArgs,
}

/// The virtual board.
#[derive(Args)]
#[command(next_help_heading = "Virtual robot")]
pub struct VirtualBoardArgs {
    /// Use the virtual board instead of this computer's buses
    #[arg(long = "virtual")]
    pub chosen: bool,
    /// Firmware to run
    #[arg(long, env = "ROBOT_ELF", default_value = "target/elf/fw-pac.elf")]
    pub elf: PathBuf,
    /// Room to stand in; the default room without it
    #[arg(long)]
    pub room: Option<PathBuf>,
    /// Seed of everything random
    #[arg(long, default_value_t = 1, value_parser = number(0..=u64::MAX))]
    pub seed: u64,
    /// A world without imperfections: wheels and track as stated, grip everywhere, walls that scatter
    /// ultrasound, a steady gyroscope
    #[arg(long)]
    pub ideal: bool,
    /// Air temperature, °C
    #[arg(long, default_value_t = 20, allow_negative_numbers = true, value_parser = number::<i16>(-40..=85))]
    pub air: i16,
    /// File that keeps the virtual EEPROM from run to run; blank if it does not exist
    #[arg(long, default_value = "target/virtual/eeprom.bin")]
    pub eeprom_image: PathBuf,
    /// True diameter of the virtual left wheel, mm, independent of the EEPROM
    #[arg(long, default_value = "80", value_parser = number(10.0..=500.0))]
    pub true_diameter_left: f64,
    /// True diameter of the virtual right wheel, mm
    #[arg(long, default_value = "80", value_parser = number(10.0..=500.0))]
    pub true_diameter_right: f64,
    /// True track of the virtual robot, mm
    #[arg(long, default_value = "125", value_parser = number(20.0..=2000.0))]
    pub true_track: f64,
    /// Write the STM's log to this file
    #[arg(long)]
    pub uart_log: Option<PathBuf>,
}

/// Options of the virtual robot only; the first says which one, the others how it is made.
const VIRTUAL_ONLY: [&str; 10] = [
    "eeprom_image",
    "elf",
    "room",
    "seed",
    "ideal",
    "air",
    "uart_log",
    "true_track",
    "true_diameter_left",
    "true_diameter_right",
];
/// Of the real one only.
const REAL_ONLY: [&str; 5] = ["spi", "i2c", "gpiochip", "uart", "state_dir"];

/// # Errors
/// Names an option that has no meaning for the robot that is chosen.
pub fn check(matches: &ArgMatches, is_virtual: bool) -> Result<(), Error> {
    if is_virtual {
        refuse(matches, &REAL_ONLY, "the real robot only")
    } else {
        refuse(matches, &VIRTUAL_ONLY, "--virtual only")
    }
}

/// # Errors
/// Names an option that makes a virtual robot: a server has made it already.
pub fn check_joined(matches: &ArgMatches) -> Result<(), Error> {
    let robot = "a new virtual robot, and a server runs this one: give it to `robot serve`";
    refuse(matches, &VIRTUAL_ONLY[1..], robot)
}

fn refuse(matches: &ArgMatches, ids: &[&str], robot: &str) -> Result<(), Error> {
    let given = |id: &&&str| matches.value_source(id) == Some(ValueSource::CommandLine);
    ids.iter().find(given).map_or(Ok(()), |id| {
        let option = id.replace('_', "-");
        Err(Error::Usage(format!("--{option} is for {robot}")))
    })
}

#[cfg(feature = "virtual")]
impl BoardArgs {
    /// The virtual board that the options choose.
    pub fn virtual_options(&self) -> pilot::virtual_board::Options {
        let board = &self.virtual_board;
        let (left, right) = (board.true_diameter_left, board.true_diameter_right);
        let mut params = plant::Params {
            mounts: plant::Mount::on_body(self.body_radius, 20.0),
            ..plant::Params::default()
        };
        params.chassis.wheel_diameter_mm = plant::Sides::new(left, right);
        params.chassis.track_mm = board.true_track;
        params.chassis.radius_mm = self.body_radius;
        params.rangefinder.temperature_c = board.air.into();
        if !board.ideal {
            params.imperfections = plant::Imperfections::default();
        }
        pilot::virtual_board::Options {
            elf: board.elf.clone(),
            room: board.room.clone(),
            seed: board.seed,
            params,
            spi_hz: self.spi_hz,
            eeprom_image: board.eeprom_image.clone(),
            uart_log: board.uart_log.clone(),
        }
    }
}

#[cfg(feature = "linux")]
impl BoardArgs {
    /// This computer's buses that the options choose.
    pub fn devices(&self) -> host_link::linux::Devices {
        host_link::linux::Devices {
            spi: self.spi.clone(),
            spi_hz: self.spi_hz,
            i2c: self.i2c.clone(),
            gpiochip: self.gpiochip.clone(),
            uart: self.uart.clone(),
        }
    }
}
