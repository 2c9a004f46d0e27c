//! `calibrate umbmark`: squares both ways, after Borenstein and Feng.

use super::measurement::Measurement;
use crate::cli::connection::Connection;
use crate::cli::measuring_args::{UmbmarkArgs, parse_measured};
use crate::cli::tune::ending;
use host_link::error::Error;
use pilot::calibrate::distance::Measured;
use pilot::calibrate::run::square;
use pilot::calibrate::umbmark::{self, Estimate, SquareRun, direction_name};
use pilot::ground_truth::Point;
use serde_json::json;

const QUESTION: &str = "How many mm is the middle of the axle ahead of where it began, and how many to the left (minus: \
     behind, to the right)? For example: -15,22";

/// `runs` squares each way, clockwise and counter-clockwise in turn. `on_marks`: the robot stands on
/// its marks already.
fn squares(
    side_mm: f64,
    runs: u8,
    on_marks: bool,
    measurement: &Measurement<'_>,
    connection: &mut Connection,
) -> Result<Vec<SquareRun>, Error> {
    let mut done = Vec::new();
    for _ in 0..runs {
        for clockwise in [true, false] {
            if !(on_marks && done.is_empty()) {
                measurement.put_back(connection)?;
            }
            let path = measurement.drive(&mut connection.io, &square(side_mm, clockwise))?;
            let end = measurement.measure(connection, QUESTION, parse_point)?;
            let run = SquareRun {
                clockwise,
                path,
                measured: Point::new(end.ahead_mm, end.left_mm.unwrap_or_default()),
            };
            let error = run.error();
            measurement.context.output.message(&format!(
                "{}: {:.1} mm ahead and {:.1} mm to the left of its odometry",
                direction_name(clockwise),
                error.ahead_mm,
                error.left_mm
            ));
            done.push(run);
        }
    }
    Ok(done)
}

/// The end of a square needs both numbers.
fn parse_point(text: &str) -> Result<Measured, String> {
    let measured = parse_measured(text)?;
    match measured.left_mm {
        Some(_) => Ok(measured),
        None => Err("accepted are millimetres ahead and to the left: -12.5,31".into()),
    }
}

/// Runs the command.
pub fn run(
    arguments: &UmbmarkArgs,
    measurement: Measurement<'_>,
    connection: &mut Connection,
) -> Result<(), Error> {
    let (output, side) = (measurement.context.output, arguments.side);
    let (original, before) = measurement.begin(connection)?;
    let what = format!(
        "The robot will drive {} squares of {side} mm to its right and as many to its left. Mark the floor \
         under the middle of its axle and the line it faces; leave half a metre free all round.",
        arguments.runs
    );
    measurement.confirm(&connection.io, &what)?;
    let runs = squares(side, arguments.runs, true, &measurement, connection)?;
    let estimate = umbmark::solve(&runs, side).map_err(Error::Calibration)?;
    output.message(&summary(&estimate));
    let (changes, written) = measurement.write(connection, &original, &estimate.wheels)?;
    let mut verified = None;
    if written && measurement.verifies(&connection.io)? {
        let again = squares(side, 1, false, &measurement, connection);
        let score = again.and_then(|again| umbmark::score(&again).map_err(Error::Calibration));
        verified = measurement.verified(score)?;
    }
    let end = |run: &SquareRun| {
        let (clockwise, measured, error) = (run.clockwise, run.measured, run.error());
        json!({ "clockwise": clockwise, "measured": measured, "error": error })
    };
    let mut done = json!(estimate);
    done["ends"] = runs.iter().map(end).collect();
    done["before"] = json!(before);
    done["verified"] = json!(verified);
    done["changes"] = json!(changes);
    done["written"] = json!(written);
    output.result(&done, || {
        let before_mm = estimate.score.worst_mm;
        let verified = verified.map_or_else(String::new, |score| {
            let now_mm = score.worst_mm;
            format!("; squares ended {before_mm:.1} mm off at worst and end {now_mm:.1} mm off now")
        });
        format!(
            "diameters and track {}{verified}",
            ending(&changes, written)
        )
    })
}

fn summary(estimate: &Estimate) -> String {
    let correction = |factor: f64, deviation: f64| {
        let uncertain = ", which is uncertain and not corrected: more --runs measure it better";
        let why = umbmark::certain(factor, deviation).map_or(uncertain, |_| "");
        let (percent, deviation) = ((factor - 1.0) * 100.0, deviation * 100.0);
        format!("{percent:+.3} % (± {deviation:.3}){why}")
    };
    let cluster = |name: &str, cluster: &umbmark::EndCluster| {
        format!(
            "{name}: {:.1} mm ahead, {:.1} mm to the left on average, {:.1} mm scatter over {}",
            cluster.centre.ahead_mm, cluster.centre.left_mm, cluster.deviation_mm, cluster.runs
        )
    };
    format!(
        "{}\n{}\ntrack {}; right wheel against left {}; {:.2} mm residual",
        cluster("clockwise", &estimate.score.clockwise),
        cluster("counter-clockwise", &estimate.score.counter_clockwise),
        correction(estimate.track, estimate.track_deviation),
        correction(estimate.ratio, estimate.ratio_deviation),
        estimate.residual_mm
    )
}

#[test]
fn end_of_a_square_is_two_numbers() {
    assert!(parse_point("5").is_err() && parse_point("x").is_err());
    assert_eq!(parse_point("5, -3").unwrap().left_mm, Some(-3.0));
}
