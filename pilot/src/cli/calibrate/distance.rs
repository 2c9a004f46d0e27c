//! `calibrate distance`: a straight line against a tape measure.

use super::measurement::Floor;
use crate::cli::args::DistanceArgs;
use crate::cli::connection::{self, Job};
use crate::cli::tune::ending;
use host_link::board_io::{Machine, Wires};
use host_link::eeprom::{image, journal::Journal};
use host_link::error::{Error, Exit};
use host_link::settings::Change;
use pilot::calibrate::distance::{self, Measured, Scale};
use pilot::calibrate::run::straight;
use pilot::calibrate::wheel_geometry::Geometry;
use pilot::calibrate::wheel_path::Path;
use serde::Serialize;
use std::fs;

const ENDS: &str =
    "How many mm is the middle of the axle ahead of where it began, and how many to the left of the line it \
     faced there (minus: behind, to the right)? For example: 997.5,-12";

pub struct Distance<'a> {
    pub arguments: &'a DistanceArgs,
    pub floor: Floor<'a>,
}

#[derive(Serialize)]
struct DistanceDone {
    measured: Measured,
    #[serde(flatten)]
    solved: Scale,
    before: Geometry,
    /// Error of the distance before, and in the run that verified it, millimetres.
    error_mm: f64,
    verified_mm: Option<f64>,
    changes: Vec<Change>,
    written: bool,
}

/// What the tape said beyond what the wheels said, along the way.
fn beyond(path: &Path, measured: &Measured) -> f64 {
    measured.ahead_mm.hypot(measured.left_mm.unwrap_or(0.0)) - path.end().distance_mm()
}

impl Distance<'_> {
    /// The path of an earlier drive, for a measurement given on the command line.
    fn earlier(&self, present: &Geometry) -> Result<Path, Error> {
        let file = connection::kept(self.floor.robot, "distance.json");
        let text = fs::read_to_string(&file).map_err(|cause| Error::unreadable(&file, &cause))?;
        let path: Path = serde_json::from_str(&text)
            .map_err(|cause| Error::content(&file, cause.line(), cause.to_string()))?;
        if path.believed() != present {
            return Err(Error::content(
                &file,
                None,
                "the EEPROM's diameters or track have changed since that drive; drive again",
            ));
        }
        Ok(path)
    }

    fn driven<W: Wires>(&self, machine: &mut Machine<W>) -> Result<Path, Error> {
        let length = self.arguments.length;
        let path = self.floor.drive(machine, &straight(length))?;
        let file = connection::kept(self.floor.robot, "distance.json");
        let text = serde_json::to_string(&path).unwrap_or_default();
        image::save(&file, text.as_bytes())?;
        Ok(path)
    }
}

impl Job for Distance<'_> {
    type Result = Exit;

    fn run<W: Wires>(self, machine: &mut Machine<W>, journal: &Journal) -> Result<Exit, Error> {
        let (floor, output, length) = (self.floor, self.floor.output, self.arguments.length);
        let (original, before) = floor.begin(machine)?;
        let (path, measured) = if let Some(measured) = self.arguments.measured {
            (self.earlier(&before)?, measured)
        } else {
            floor.agreed(
                machine,
                &format!(
                    "The robot will drive {length} mm straight ahead. Mark the floor under the middle of its \
                     axle and the line it faces; leave half a metre free to each side."
                ),
            )?;
            let path = self.driven(machine)?;
            (path, floor.measure(machine, ENDS)?)
        };
        let solved = distance::solve(&path, &measured).map_err(Error::Calibration)?;
        output.remark(&told(&measured, &solved));
        let (changes, written) = floor.write(machine, &original, &solved.figures, journal)?;
        let mut verified_mm = None;
        if written && self.arguments.measured.is_none() && floor.verifies(machine)? {
            floor.put_back(machine)?;
            let path = self.driven(machine)?;
            let again = floor.measure(machine, ENDS)?;
            verified_mm = Some(beyond(&path, &again));
        }
        let done = DistanceDone {
            measured,
            solved,
            before,
            error_mm: beyond(&path, &measured),
            verified_mm,
            changes,
            written,
        };
        output.result(&done, || {
            let verified = done.verified_mm.map_or_else(String::new, |mm| {
                format!(
                    "; it was {:+.1} mm off and is now {mm:+.1} mm off",
                    done.error_mm
                )
            });
            format!(
                "diameters and track {}{verified}",
                ending(&done.changes, written)
            )
        });
        Ok(Exit::Ok)
    }
}

fn told(measured: &Measured, solved: &Scale) -> String {
    let side = match measured.left_mm {
        Some(left) => format!(", {left:.1} mm to the left"),
        None => ", the offset to the side not measured: the way is taken as straight".into(),
    };
    format!(
        "the wheels say {:.1} mm, measured {:.1} mm ahead{side}: everything {:+.3} %, right wheel against left \
         {:+.3} %",
        solved.believed.distance_mm(),
        measured.ahead_mm,
        (solved.scale - 1.0) * 100.0,
        (solved.ratio - 1.0) * 100.0
    )
}
