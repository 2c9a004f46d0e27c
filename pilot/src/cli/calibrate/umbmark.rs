//! `calibrate umbmark`: squares both ways, after Borenstein and Feng.

use super::measurement::Floor;
use crate::cli::args::UmbmarkArgs;
use crate::cli::connection::Job;
use crate::cli::tune::ending;
use host_link::board_io::{Machine, Wires};
use host_link::eeprom::journal::Journal;
use host_link::error::{Error, Exit};
use host_link::settings::Change;
use pilot::calibrate::run::square;
use pilot::calibrate::umbmark::{self, Estimate, Run, Score};
use pilot::calibrate::wheel_geometry::Geometry;
use pilot::calibrate::wheel_path::Spot;
use serde::Serialize;

pub struct Umbmark<'a> {
    pub arguments: &'a UmbmarkArgs,
    pub floor: Floor<'a>,
}

#[derive(Serialize)]
struct UmbmarkDone {
    #[serde(flatten)]
    estimate: Estimate,
    ends: Vec<End>,
    before: Geometry,
    verified: Option<Score>,
    changes: Vec<Change>,
    written: bool,
}

#[derive(Serialize)]
struct End {
    clockwise: bool,
    measured: Spot,
    error: Spot,
}

impl Umbmark<'_> {
    /// `runs` squares each way, one way and the other in turn.
    fn squares<W: Wires>(
        &self,
        machine: &mut Machine<W>,
        runs: u8,
        stands: bool,
    ) -> Result<Vec<Run>, Error> {
        let mut done = Vec::new();
        for _ in 0..runs {
            for clockwise in [true, false] {
                if !(stands && done.is_empty()) {
                    self.floor.put_back(machine)?;
                }
                let way = square(self.arguments.side, clockwise);
                let path = self.floor.drive(machine, &way)?;
                let ends = "How many mm is the middle of the axle ahead of where it began, and how many to the \
                            left (minus: behind, to the right)? For example: -15,22";
                let end = self.floor.measure(machine, ends)?;
                let measured = Spot {
                    ahead_mm: end.ahead_mm,
                    left_mm: end.left_mm.unwrap_or(0.0),
                };
                let run = Run {
                    clockwise,
                    path,
                    measured,
                };
                let error = run.error();
                self.floor.output.remark(&format!(
                    "{}: {:.1} mm ahead and {:.1} mm to the left of where the robot believes it is",
                    if clockwise {
                        "clockwise"
                    } else {
                        "counter-clockwise"
                    },
                    error.ahead_mm,
                    error.left_mm
                ));
                done.push(run);
            }
        }
        Ok(done)
    }
}

impl Job for Umbmark<'_> {
    type Result = Exit;

    fn run<W: Wires>(self, machine: &mut Machine<W>, journal: &Journal) -> Result<Exit, Error> {
        let (floor, output, side) = (self.floor, self.floor.output, self.arguments.side);
        let (original, before) = floor.begin(machine)?;
        floor.agreed(
            machine,
            &format!(
                "The robot will drive {} squares of {side} mm to its right and as many to its left. Mark the floor \
                 under the middle of its axle and the line it faces; leave half a metre free all round.",
                self.arguments.runs
            ),
        )?;
        let runs = self.squares(machine, self.arguments.runs, true)?;
        let estimate = umbmark::solve(&runs, side).map_err(Error::Calibration)?;
        output.remark(&explained(&estimate));
        let (changes, written) = floor.write(machine, &original, &estimate.figures, journal)?;
        let mut verified = None;
        if written && floor.verifies(machine)? {
            let again = self.squares(machine, 1, false)?;
            verified = Some(umbmark::score(&again).map_err(Error::Calibration)?);
        }
        let done = UmbmarkDone {
            ends: runs
                .iter()
                .map(|run| End {
                    clockwise: run.clockwise,
                    measured: run.measured,
                    error: run.error(),
                })
                .collect(),
            estimate,
            before,
            verified,
            changes,
            written,
        };
        output.result(&done, || {
            let verified = done.verified.map_or_else(String::new, |score| {
                format!(
                    "; squares ended {:.1} mm off at worst and end {:.1} mm off now",
                    done.estimate.score.worst_mm, score.worst_mm
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

fn explained(estimate: &Estimate) -> String {
    let percent = |factor: f64| (factor - 1.0) * 100.0;
    let cloud = |name: &str, cloud: &umbmark::Cloud| {
        format!(
            "{name}: {:.1} mm ahead, {:.1} mm to the left on average, {:.1} mm scatter over {}",
            cloud.centre.ahead_mm, cloud.centre.left_mm, cloud.deviation_mm, cloud.runs
        )
    };
    format!(
        "{}\n{}\ntrack {:+.3} % (± {:.3}), right wheel against left {:+.3} % (± {:.3}); {:.2} mm stay unexplained; \
         by the small-angle formulas {:+.2} % and {:+.2} %",
        cloud("clockwise", &estimate.score.clockwise),
        cloud("counter-clockwise", &estimate.score.counter_clockwise),
        percent(estimate.track),
        estimate.track_deviation * 100.0,
        percent(estimate.ratio),
        estimate.ratio_deviation * 100.0,
        estimate.residual_mm,
        percent(estimate.first_order[0]),
        percent(estimate.first_order[1])
    )
}
