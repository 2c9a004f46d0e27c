//! The command line.
#![allow(clippy::doc_markdown)] // the comments are the help text

use super::board_args::BoardArgs;
use super::measuring_args::{Calibrate, Tune, stem};
use super::number::{SMALLEST, number};
use clap::{Args, Parser, Subcommand};
use fw_core::wire::Mode;
use host_link::error::Exit;
use host_link::pose::{MAX_COORDINATE_MM, Pose};
use pilot::drive::ArrivalCriteria;
use pilot::mode;
use pilot::waypoints::{MAX_ROTATION_DEG, parse_pose};
use std::fmt::Write;
use std::path::PathBuf;

/// Configures, drives and maps with the robot, real or virtual.
#[derive(Parser)]
#[command(
    name = "robot",
    version,
    max_term_width = 100,
    after_help = "`robot COMMAND --help` shows a command's options, `--help-all` those of the robot, too, and \
                  what the exit codes mean."
)]
pub struct Arguments {
    #[command(subcommand)]
    pub command: Command,
    /// Print machine-readable JSON on standard output: an object a line, an error last
    #[arg(long)]
    pub json: bool,
    #[command(flatten)]
    pub board: BoardArgs,
}

/// The table of exit codes, as text.
pub fn exit_codes() -> String {
    let mut text = String::from("Exit codes:\n");
    for (exit, meaning) in Exit::ALL {
        let _ = writeln!(text, "  {:>3}  {meaning}", exit.code());
    }
    text
}

#[derive(Subcommand)]
pub enum Command {
    /// Read, write and compare the configuration in the EEPROM
    Eeprom {
        #[command(subcommand)]
        command: Eeprom,
    },
    /// Repair what a killed run left (EEPROM protected, its bus with the STM), reset the STM, await STM_READY
    Reset,
    /// Change the mode: rewrite it in the EEPROM, reset the STM, and carry on in it on both ends
    Mode {
        /// Name, e.g. "Guarded Normal" or guarded-normal, or number, e.g. 0x10
        #[arg(value_parser = mode::parse)]
        mode: Mode,
    },
    /// Exchange frames without a command and show state, faults, battery and both ends of the link
    Status(Status),
    /// Check everything from the device files to the link, with --wheels-up to the wheels; exit code 14 if
    /// anything fails
    Doctor(Doctor),
    /// Judge a bare board part by part, by the log of the bring-up firmware
    Bringup(Bringup),
    /// Show map, pose, ranges, cells, faults with advice, link and log, live; lines where there is no terminal
    Monitor(Monitor),
    /// Drive by the keyboard or a gamepad, with the screen of `monitor`; a key that is released stops the robot
    Teleop(Teleop),
    /// Own the robot and let other commands, programs and browsers use it: many look on, one drives
    Serve(Serve),
    /// Be a node of ROS 2: publish everything, drive by /cmd_vel and /goal_pose, stop by /estop
    #[cfg(feature = "ros2")]
    Ros2(Ros2),
    /// Stop the robot, whichever client drives it
    Stop,
    /// Show the STM's log, live
    Log,
    /// Drive to a pose and stop there; with --map, find the way to a point of a saved map
    Goto(Goto),
    /// Drive from way-point to way-point
    Tour(Tour),
    /// Draw a map (PNG, and PGM + YAML for ROS) while driving, from a recording or of a server
    Map(Map),
    /// Print the reports of a recording
    Replay(Replay),
    /// Explore an unknown room alone: localise, avoid, map everything reachable, come back
    Explore(Explore),
    /// Measure the drive or a battery tap, and tune gains or divider by it
    Tune {
        #[command(subcommand)]
        command: Tune,
    },
    /// Drive, have the end measured on the floor, and correct wheel diameters and track by it
    Calibrate {
        #[command(subcommand)]
        command: Calibrate,
    },
    /// Write the manual pages and the shells' completions, for a package
    #[command(hide = true)]
    Manual {
        /// The folder they go to
        folder: PathBuf,
    },
}

#[derive(Subcommand)]
pub enum Eeprom {
    /// Write the commented configuration file of the first board, to start from
    Init {
        /// Where to; standard output without it
        file: Option<PathBuf>,
        /// Overwrite the file if it exists
        #[arg(long)]
        force: bool,
    },
    /// Write a configuration file to the EEPROM, verify it, reset the STM and await STM_READY
    Write {
        /// Configuration file (TOML)
        file: PathBuf,
        /// Only show what would change
        #[arg(long)]
        dry_run: bool,
    },
    /// Check the EEPROM, or a file
    Check {
        /// Configuration file (.toml) or image; the robot's EEPROM without it
        file: Option<PathBuf>,
    },
    /// Print the EEPROM as a configuration file
    Dump {
        /// Image file to print instead of the robot's EEPROM
        #[arg(long, value_name = "FILE")]
        image: Option<PathBuf>,
        /// Print bytes, also of an EEPROM that is rejected
        #[arg(long)]
        hex: bool,
    },
    /// Show what writing a file would change; exit code 1 if anything
    Diff {
        /// Configuration file (.toml) or image
        file: PathBuf,
        /// Image file to compare with instead of the robot's EEPROM
        #[arg(long, value_name = "FILE")]
        image: Option<PathBuf>,
    },
    /// Give an original EEPROM its page 0x03, with the first board's figures that apply anyway, or convert layout 1
    Migrate {
        /// Only show what would change
        #[arg(long)]
        dry_run: bool,
    },
    /// Save the EEPROM's pages 0x00 to 0x03 as an image file
    Backup {
        /// Image file to write
        file: PathBuf,
        /// Overwrite the file if it exists
        #[arg(long)]
        force: bool,
    },
    /// Write an image file back, also one that is rejected
    Restore {
        /// Image file of 768 (original) to 65536 bytes, of which pages 0x00 to 0x03 are written
        file: PathBuf,
        /// Only show what would change
        #[arg(long)]
        dry_run: bool,
    },
}

#[derive(Args)]
pub struct Status {
    /// For how long, beside a server at most; the STM's log reports its end once a second
    #[arg(long, value_name = "MS", default_value_t = 2200, value_parser = number::<u32>(1..=600_000))]
    pub ms: u32,
}

#[derive(Args)]
pub struct Doctor {
    /// With the wheels off the floor: motors, encoders, dead zones, rangefinders, servo and gyroscope, too
    #[arg(long)]
    pub wheels_up: bool,
    /// Turn the wheels without asking
    #[arg(long, requires = "wheels_up")]
    pub yes: bool,
}

#[derive(Args)]
pub struct Bringup {
    /// The log's serial device, 115200 baud (e.g. /dev/ttyUSB0), or a file with a log that was kept
    pub log: PathBuf,
    /// Also exchange frames with the STM, on a Pi
    #[arg(long)]
    pub link: bool,
    /// End this long after the last line
    #[arg(long, value_name = "S", default_value_t = 35, value_parser = number::<u32>(1..=600))]
    pub patience: u32,
}

#[derive(Args)]
pub struct Monitor {
    /// End after this many valid reports
    #[arg(long, value_name = "N", value_parser = number(1..=u64::MAX))]
    pub count: Option<u64>,
}

#[derive(Args)]
pub struct Teleop {
    /// Speed ahead and back, mm/s
    #[arg(long, value_name = "MM/S", default_value = "150", value_parser = number(1.0..=1000.0))]
    pub speed: f64,
    /// Yaw rate, degrees/s
    #[arg(long, value_name = "DEG/S", default_value = "45", value_parser = number(1.0..=180.0))]
    pub turn: f64,
    /// Also drive by a gamepad: its left stick while a shoulder button is held; its four round buttons stop
    #[arg(long, value_name = "DEVICE", num_args = 0..=1, default_missing_value = "/dev/input/js0")]
    pub gamepad: Option<PathBuf>,
    /// Write the mode Guarded Velocity to the EEPROM without asking, where it holds another
    #[arg(long)]
    pub yes: bool,
}

#[derive(Args)]
pub struct Serve {
    /// Also serve over TCP, e.g. 127.0.0.1:8040, clients that show the token
    #[arg(long, value_name = "ADDRESS", value_parser = parse_address)]
    pub listen: Option<String>,
    /// Also serve a page for browsers; its address with the token is printed
    #[cfg(feature = "web")]
    #[arg(long, value_name = "ADDRESS", num_args = 0..=1, default_missing_value = "127.0.0.1:8080", value_parser = parse_address)]
    pub web: Option<String>,
    /// With --virtual: how many times faster than real time, or max; 1 without it
    #[arg(long, value_name = "N", value_parser = parse_speed)]
    pub speed: Option<f64>,
    /// Write the mode Guarded Velocity to the EEPROM without asking, where it holds another
    #[arg(long)]
    pub yes: bool,
}

#[cfg(feature = "ros2")]
#[derive(Args)]
pub struct Ros2 {
    /// Namespace of node and topics, e.g. kitchen: /kitchen/odom
    #[arg(long, value_name = "NAME", default_value = "")]
    pub namespace: String,
    /// Domain of DDS
    #[arg(long, env = "ROS_DOMAIN_ID", default_value_t = 0, value_parser = number::<u16>(0..=101))]
    pub domain: u16,
    /// Speak DDS to programs on this computer only
    #[arg(long)]
    pub localhost: bool,
    /// Write the mode Guarded Velocity to the EEPROM without asking, where it holds another
    #[arg(long)]
    pub yes: bool,
}

/// How many times faster than real time.
fn parse_speed(text: &str) -> Result<f64, String> {
    if text == "max" {
        return Ok(f64::INFINITY);
    }
    number(0.01..=1000.0)(text).map_err(|why| format!("{why}, or max"))
}

/// The address of a socket: a host and a port.
fn parse_address(text: &str) -> Result<String, String> {
    match text.rsplit_once(':') {
        Some((_, port)) if port.parse::<u16>().is_ok() => Ok(text.into()),
        _ => Err("accepted is HOST:PORT, e.g. 127.0.0.1:8040".into()),
    }
}

#[derive(Args)]
#[command(allow_negative_numbers = true)]
pub struct Goto {
    /// Millimetres ahead of where the robot was switched on
    #[arg(value_parser = number(-MAX_COORDINATE_MM..=MAX_COORDINATE_MM))]
    pub x: f64,
    /// Millimetres to the left of where the robot was switched on
    #[arg(value_parser = number(-MAX_COORDINATE_MM..=MAX_COORDINATE_MM))]
    pub y: f64,
    /// Degrees, counter-clockwise
    #[arg(value_name = "ROT", required_unless_present_any = ["map", "start", "yes"], value_parser = number(-MAX_ROTATION_DEG..=MAX_ROTATION_DEG))]
    pub rotation: Option<f64>,
    /// Go to X Y of this map (the .yaml that `explore` or ROS wrote), around what it shows; to a point within
    /// 100 mm where the body cannot stand on it
    #[arg(long, value_name = "FILE", conflicts_with_all = ["rotation", "tolerance_mm", "tolerance_deg", "timeout"])]
    pub map: Option<PathBuf>,
    /// Where the robot stands on the map: mm, mm and degrees; without it the robot finds out by itself
    #[arg(long, value_name = "X,Y,ROT", requires = "map", allow_hyphen_values = true, value_parser = parse_start)]
    pub start: Option<Pose>,
    /// With --map: write the mode Guarded Velocity to the EEPROM without asking, where it holds another
    #[arg(long, requires = "map")]
    pub yes: bool,
    #[command(flatten)]
    pub criteria: CriteriaArgs,
}

/// A pose from three numbers, separated by commas.
fn parse_start(text: &str) -> Result<Pose, String> {
    let parts: Vec<_> = text.split(',').map(str::trim).collect();
    match parts.as_slice() {
        [x, y, rotation] => parse_pose(x, y, rotation).map_err(|(_, what)| what),
        _ => Err("accepted is X,Y,ROT: 1200,-350,90".into()),
    }
}

impl Goto {
    /// The pose to drive to.
    pub fn target(&self) -> Pose {
        Pose::new(self.x, self.y, self.rotation.unwrap_or_default())
    }
}

#[derive(Args)]
pub struct Tour {
    /// Way-points: one `x y rotation` a line, mm and degrees, # begins a comment
    pub file: PathBuf,
    #[command(flatten)]
    pub criteria: CriteriaArgs,
}

#[derive(Args)]
pub struct Map {
    /// Way-points to drive while mapping
    #[arg(required_unless_present_any = ["from", "served"], conflicts_with = "from")]
    pub tour: Option<PathBuf>,
    /// Save the map that a running `robot serve` has
    #[arg(long, conflicts_with_all = ["tour", "from", "record", "cell", "tolerance_mm", "tolerance_deg", "timeout"])]
    pub served: bool,
    /// Draw from a recording instead of driving
    #[arg(long, value_name = "FILE", conflicts_with_all = ["tolerance_mm", "tolerance_deg", "timeout"])]
    pub from: Option<PathBuf>,
    /// Record while driving (MCAP with ROS 2 messages)
    #[arg(long, value_name = "FILE", conflicts_with = "from")]
    pub record: Option<PathBuf>,
    /// Files to write, without their endings .png, .pgm, .yaml; the map by odometry alone gets -raw, that of an
    /// aborted drive -aborted where there is another
    #[arg(long, value_name = "STEM", default_value = "map", value_parser = stem())]
    pub out: PathBuf,
    /// Size of a map cell, mm
    #[arg(long, value_name = "MM", default_value_t = 25, value_parser = number::<u16>(5..=500))]
    pub cell: u16,
    #[command(flatten)]
    pub criteria: CriteriaArgs,
}

#[derive(Args)]
pub struct Replay {
    /// Recording (MCAP)
    pub file: PathBuf,
    /// How many times as fast; as fast as possible without it
    #[arg(long, value_name = "N", value_parser = number(0.01..=1000.0))]
    pub speed: Option<f64>,
}

#[derive(Args)]
pub struct Explore {
    /// Files to write, without their endings .png, .pgm, .yaml; the map by odometry alone gets -raw, that of an
    /// aborted drive -aborted where there is another
    #[arg(long, value_name = "STEM", default_value = "map", value_parser = stem())]
    pub out: PathBuf,
    /// Record while driving (MCAP with ROS 2 messages)
    #[arg(long, value_name = "FILE")]
    pub record: Option<PathBuf>,
    /// Go home after this time, seconds
    #[arg(long, value_name = "S", default_value_t = navigator::Config::default().time_limit_s, value_parser = number(SMALLEST..=1e6))]
    pub timeout: f64,
    /// Write the mode Guarded Velocity to the EEPROM without asking, where it holds another
    #[arg(long)]
    pub yes: bool,
}

/// When a drive counts as done.
#[derive(Args)]
pub struct CriteriaArgs {
    /// Largest distance from a target, mm
    #[arg(long, value_name = "MM", default_value = "5", value_parser = number(0.2..=1e6))]
    pub tolerance_mm: f64,
    /// Largest difference from a target's rotation, degrees
    #[arg(long, value_name = "DEG", default_value = "1", value_parser = number(0.05..=1e6))]
    pub tolerance_deg: f64,
    /// Time for each target, seconds; by its distance without it
    #[arg(long, value_name = "S", value_parser = number(SMALLEST..=1e6))]
    pub timeout: Option<f64>,
}

impl CriteriaArgs {
    pub fn criteria(&self) -> ArrivalCriteria {
        ArrivalCriteria {
            tolerance_mm: self.tolerance_mm,
            tolerance_deg: self.tolerance_deg,
            timeout_s: self.timeout,
        }
    }
}
