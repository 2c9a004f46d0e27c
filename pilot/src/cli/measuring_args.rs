//! The arguments of `tune` and `calibrate`.
#![allow(clippy::doc_markdown)] // the comments are the help text

use super::number::number;
use clap::builder::{PathBufValueParser, TypedValueParser};
use clap::{Args, Subcommand};
use pilot::calibrate::distance::Measured;
use pilot::calibrate::run::LENGTHS_MM;
use pilot::tune::Axis;
use pilot::tune::battery::LARGEST_V;
use pilot::tune::step_response::{LONGEST_S, StepPlan};
use std::path::PathBuf;

#[derive(Subcommand)]
pub enum Calibrate {
    /// Drive straight ahead: the scale of diameters and track
    Distance(DistanceArgs),
    /// Drive squares both ways (UMBmark): the wheels' ratio and the track; calibrate the distance first
    Umbmark(UmbmarkArgs),
    /// Correct wheels and track by what the latest `explore` has learned about them
    FromExplore(Consent),
    /// Bring back what the EEPROM held before the latest calibration or tuning was written
    Rollback,
}

#[derive(Args)]
pub struct DistanceArgs {
    /// How far to drive, mm; the longer, the less a millimetre of the tape matters
    #[arg(long, value_name = "MM", default_value = "1000", value_parser = number(LENGTHS_MM))]
    pub length: f64,
    /// Do not drive: this was measured after the latest `calibrate distance`, mm from start to end, and mm
    /// to the left of the line the robot faced (minus: to the right)
    #[arg(long, value_name = "MM[,LEFT]", allow_hyphen_values = true, value_parser = parse_measured)]
    pub measured: Option<Measured>,
    #[command(flatten)]
    pub measuring: Measuring,
}

#[derive(Args)]
pub struct UmbmarkArgs {
    /// The square's side, mm
    #[arg(long, value_name = "MM", default_value = "1000", value_parser = number(LENGTHS_MM))]
    pub side: f64,
    /// Squares each way
    #[arg(long, value_name = "N", default_value_t = 3, value_parser = number::<u8>(1..=10))]
    pub runs: u8,
    #[command(flatten)]
    pub measuring: Measuring,
}

/// How a calibration measures, and what it does without asking.
#[derive(Args)]
pub struct Measuring {
    /// Who measures: you, or on the virtual robot the simulation
    #[arg(long, value_name = "BY", value_enum, default_value = "tape")]
    pub measure_with: MeasureWith,
    /// Standard deviation of the simulated readings, mm
    #[arg(long, value_name = "MM", default_value = "0", value_parser = number(0.0..=100.0))]
    pub noise: f64,
    #[command(flatten)]
    pub consent: Consent,
    /// Do not drive once more after writing to see how good it became
    #[arg(long)]
    pub no_verify: bool,
}

/// The source of a measurement.
#[derive(Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub enum MeasureWith {
    /// You, with a tape: the program asks
    Tape,
    /// The simulation, which knows where the virtual robot stands
    Truth,
}

/// Files to write, without their endings.
pub fn stem() -> impl TypedValueParser<Value = PathBuf> {
    PathBufValueParser::new().try_map(checked_stem)
}

/// A text to the last ending: a map's YAML and JSON hold it.
fn checked_stem(path: PathBuf) -> Result<PathBuf, &'static str> {
    match path.to_str().and_then(|text| text.rsplit('/').next()) {
        None => Err("accepted is a text in UTF-8"),
        Some("" | "." | "..") => Err("a folder: add the files' name"),
        Some(_) => Ok(path),
    }
}

/// One or two numbers, separated by a comma or a blank.
pub fn parse_measured(text: &str) -> Result<Measured, String> {
    let words = text.split([',', ' ']).filter(|word| !word.is_empty());
    let numbers: Result<Vec<f64>, _> = words.map(str::parse).collect();
    match numbers.as_deref() {
        Ok(&[ahead_mm]) if ahead_mm.is_finite() => Ok(Measured {
            ahead_mm,
            left_mm: None,
        }),
        Ok(&[ahead_mm, left]) if ahead_mm.is_finite() && left.is_finite() => Ok(Measured {
            ahead_mm,
            left_mm: Some(left),
        }),
        _ => Err("accepted are millimetres ahead, and to the left: 1003.5 or 1003.5,-12".into()),
    }
}

#[derive(Subcommand)]
pub enum Tune {
    /// Make steps on the spot, fit a model, propose gains of the rotation PID
    Rotate(StepArgs),
    /// Make steps forward and backward, fit a model, propose gains of the forward PID
    Move(StepArgs),
    /// With a known voltage in place of a cell: correct its tap's upper resistor
    Battery {
        /// The cell, 1 = nearest to ground; tune from 1 upwards
        #[arg(value_parser = number::<u8>(1..=8))]
        cell: u8,
        /// Volts in its place
        #[arg(value_parser = number(0.005..=LARGEST_V))]
        volts: f64,
        #[command(flatten)]
        consent: Consent,
    },
    /// Bring back what the EEPROM held before the latest tuning was written
    Rollback,
}

/// What may be done without asking.
#[derive(Args)]
pub struct Consent {
    /// Drive and write without asking
    #[arg(long)]
    pub yes: bool,
    /// Measure and show, write nothing
    #[arg(long)]
    pub dry_run: bool,
}

#[derive(Args)]
pub struct StepArgs {
    /// Duties, percent; each in both directions
    #[arg(
        long,
        value_name = "PERCENT,…",
        value_delimiter = ',',
        default_value = "50,75,100",
        value_parser = number(1.0..=100.0)
    )]
    pub levels: Vec<f64>,
    /// Seconds of each step
    #[arg(long, value_name = "S", default_value = "1.2", value_parser = number(0.2..=LONGEST_S))]
    pub hold: f64,
    /// Seconds at rest between steps
    #[arg(long, value_name = "S", default_value = "0.8", value_parser = number(0.2..=10.0))]
    pub rest: f64,
    /// A step ends when it went this far, degrees or mm; 360 degrees or 300 mm without it
    #[arg(long, value_name = "TRAVEL", value_parser = number(1.0..=2000.0))]
    pub travel: Option<f64>,
    /// Damping of the loop to propose gains for, 1 = no overshoot; 0.8 to rotate, 0.5 to move without it
    #[arg(long, value_name = "ZETA", value_parser = number(0.3..=3.0))]
    pub damping: Option<f64>,
    /// Files to write, without their endings .csv and .png; tune-rotate or tune-move without it
    #[arg(long, value_name = "STEM", value_parser = stem())]
    pub out: Option<PathBuf>,
    #[command(flatten)]
    pub consent: Consent,
}

impl StepArgs {
    pub fn plan(&self, axis: Axis) -> StepPlan {
        StepPlan {
            levels: self.levels.clone(),
            hold_s: self.hold,
            rest_s: self.rest,
            travel: self.travel.unwrap_or(axis.default_travel()),
        }
    }

    pub fn stem(&self, axis: Axis) -> PathBuf {
        let name = match axis {
            Axis::Rotate => "tune-rotate",
            Axis::Move => "tune-move",
        };
        self.out.clone().unwrap_or_else(|| name.into())
    }
}
