//! `calibrate distance`: a straight line against a tape measure.

use super::measurement::Measurement;
use crate::cli::connection::Connection;
use crate::cli::measuring_args::{DistanceArgs, parse_measured};
use crate::cli::tune::ending;
use host_link::board_io::BoardIo;
use host_link::error::Error;
use host_link::file::{self, Kind};
use pilot::calibrate::distance::{self, Measured, Scale};
use pilot::calibrate::run::straight;
use pilot::calibrate::wheel_geometry::WheelGeometry;
use pilot::calibrate::wheel_path::WheelPath;
use serde_json::json;
use std::path::PathBuf;

const QUESTION: &str = "How many mm is the middle of the axle ahead of where it began, and how many to the left of the line it \
     faced there (minus: behind, to the right)? For example: 997.5,-12";

/// Measured distance minus odometry's, millimetres.
fn distance_error_mm(path: &WheelPath, measured: &Measured) -> f64 {
    measured.ahead_mm.hypot(measured.left_mm.unwrap_or(0.0)) - path.odometry_end().distance_mm()
}

/// Where the path of the latest drive is kept.
fn path_file(measurement: &Measurement<'_>) -> PathBuf {
    measurement.context.state_file("distance.json")
}

/// The path of an earlier drive, for a measurement given on the command line.
fn earlier_path(
    measurement: &Measurement<'_>,
    present: &WheelGeometry,
) -> Result<WheelPath, Error> {
    let path = path_file(measurement);
    if !path.exists() {
        let what = "--measured is of an earlier drive, and there is none: `robot calibrate distance` drives";
        return Err(Error::Usage(what.into()));
    }
    file::ensure_trusted(&path)?;
    let text = file::read_text(&path)?;
    let driven: WheelPath = serde_json::from_str(&text)
        .map_err(|cause| Error::content(&path, cause.line(), cause.to_string()))?;
    if driven.wheels() != present {
        let what = "the EEPROM's diameters or track have changed since that drive; drive again";
        return Err(Error::content(&path, None, what));
    }
    Ok(driven)
}

fn drive(
    measurement: &Measurement<'_>,
    io: &mut BoardIo,
    length_mm: f64,
) -> Result<WheelPath, Error> {
    let path = measurement.drive(io, &straight(length_mm))?;
    let text = serde_json::to_string(&path).unwrap_or_default();
    file::save(&path_file(measurement), Kind::Json, text.as_bytes())?;
    Ok(path)
}

/// Runs the command.
pub fn run(
    arguments: &DistanceArgs,
    measurement: Measurement<'_>,
    connection: &mut Connection,
) -> Result<(), Error> {
    let (output, length) = (measurement.context.output, arguments.length);
    let (original, before) = measurement.begin(connection)?;
    let (path, measured) = if let Some(measured) = arguments.measured {
        (earlier_path(&measurement, &before)?, measured)
    } else {
        let what = format!(
            "The robot will drive {length} mm straight ahead. Mark the floor under the middle of its axle \
             and the line it faces; leave half a metre free to each side."
        );
        file::check(&path_file(&measurement), Kind::Json)?;
        measurement.confirm(&connection.io, &what)?;
        let path = drive(&measurement, &mut connection.io, length)?;
        let measured = measurement.measure(connection, QUESTION, parse_measured);
        let measured = measured.map_err(|error| match error {
            Error::Usage(why) => Error::Usage(format!("{why}; give it by --measured MM,LEFT")),
            error => error,
        });
        (path, measured?)
    };
    let solved = distance::solve(&path, &measured).map_err(Error::Calibration)?;
    output.message(&summary(&measured, &solved));
    let (changes, written) = measurement.write(connection, &original, &solved.wheels)?;
    let mut verified_mm = None;
    if written && arguments.measured.is_none() && measurement.verifies(&connection.io)? {
        let mut verify = || {
            measurement.put_back(connection)?;
            let path = drive(&measurement, &mut connection.io, length)?;
            let again = measurement.measure(connection, QUESTION, parse_measured)?;
            Ok(distance_error_mm(&path, &again))
        };
        verified_mm = measurement.verified(verify())?;
    }
    let (scale, error_mm) = (&solved, distance_error_mm(&path, &measured));
    let done = json!({
        "measured": measured, "odometry_end": scale.odometry_end, "scale": scale.scale, "ratio": scale.ratio,
        "wheels": scale.wheels, "before": before, "error_mm": error_mm, "verified_mm": verified_mm,
        "changes": changes, "written": written,
    });
    output.result(&done, || {
        let verified = verified_mm.map_or_else(String::new, |now| {
            format!("; it was {error_mm:+.1} mm off and is now {now:+.1} mm off")
        });
        format!(
            "diameters and track {}{verified}",
            ending(&changes, written)
        )
    })
}

fn summary(measured: &Measured, solved: &Scale) -> String {
    let side = match measured.left_mm {
        Some(left) => format!(", {left:.1} mm to the left"),
        None => ", the offset to the side not measured: the path is taken as straight".into(),
    };
    format!(
        "odometry {:.1} mm, measured {:.1} mm ahead{side}: scale {:+.3} %, right wheel against left {:+.3} %",
        solved.odometry_end.distance_mm(),
        measured.ahead_mm,
        (solved.scale - 1.0) * 100.0,
        (solved.ratio - 1.0) * 100.0
    )
}
