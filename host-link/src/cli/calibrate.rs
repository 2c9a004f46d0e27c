//! `calibrate …`.

use super::args::{measured, Calibrate, DistanceArgs, MeasureWith, Measuring, Robot, UmbmarkArgs};
use super::place::{self, Job};
use super::report::Output;
use super::tune::{apply, ending, Kept, Rollback};
use super::{ask, monitor};
use fw_core::eeprom::{encode, Image};
use host_link::calibrate::distance::{self, Measured, Scale};
use host_link::calibrate::geometry::Geometry;
use host_link::calibrate::path::{Path, Spot};
use host_link::calibrate::run::{self, check, square, straight};
use host_link::calibrate::umbmark::{self, Estimate, Run, Score};
use host_link::drive::Terms;
use host_link::eeprom::{self, image, journal::Journal};
use host_link::error::{Error, Exit};
use host_link::machine::{Machine, Wires};
use host_link::pose::Place;
use host_link::session::Session;
use host_link::settings::{decode, Change};
use serde::Serialize;
use std::fs;

/// Runs one of the commands.
pub fn run(command: &Calibrate, robot: &Robot, output: Output) -> Result<Exit, Error> {
    let kept = &Kept::of(robot);
    match command {
        Calibrate::Distance(arguments) => {
            check("a length of", arguments.length)?;
            let floor = Floor::new(&arguments.measuring, robot, output)?;
            let job = Distance {
                arguments,
                floor,
                kept,
            };
            place::with_machine(robot, job)
        }
        Calibrate::Umbmark(arguments) => {
            check("a side of", arguments.side)?;
            let floor = Floor::new(&arguments.measuring, robot, output)?;
            let job = Umbmark {
                arguments,
                floor,
                kept,
            };
            place::with_machine(robot, job)
        }
        Calibrate::Rollback => place::with_machine(
            robot,
            Rollback {
                kept,
                robot,
                output,
            },
        ),
    }
}

/// The robot on the floor, and who measures there.
#[derive(Clone, Copy)]
struct Floor<'a> {
    measuring: &'a Measuring,
    robot: &'a Robot,
    output: Output,
}

impl<'a> Floor<'a> {
    fn new(measuring: &'a Measuring, robot: &'a Robot, output: Output) -> Result<Self, Error> {
        let truth = measuring.measure_with == MeasureWith::Truth;
        if truth && !robot.board.chosen {
            return Err(Error::Usage(
                "--measure-with truth: only the virtual robot has somebody who sees the truth"
                    .into(),
            ));
        }
        if !truth && measuring.noise != 0.0 {
            return Err(Error::Usage(
                "--noise: a person's tape has its own; it is for --measure-with truth".into(),
            ));
        }
        Ok(Self {
            measuring,
            robot,
            output,
        })
    }

    /// Asks before anything moves.
    fn agreed<W: Wires>(&self, machine: &Machine<W>, what: &str) -> Result<(), Error> {
        let question = format!("{what} Keep hands off the wheels, Ctrl-C stops it. Drive?");
        if self.measuring.yes || ask::whether(&question, &machine.interrupt, self.output)? {
            return Ok(());
        }
        Err(Error::Usage("nothing was driven: nobody agreed".into()))
    }

    /// Drives `way`, from a new conversation: minutes may have passed since the last frame.
    fn drive<W: Wires>(&self, machine: &mut Machine<W>, way: &[Place]) -> Result<Path, Error> {
        let mut session = Session::open(machine, self.robot.rate, self.robot.ready_timeout)?;
        let path = run::run(&mut session, way, &Terms::default(), |reached| {
            if way.len() > 1 {
                self.output
                    .live(&format!("corner {reached} of {}", way.len()));
            }
        });
        self.output.live("");
        let path = path?;
        self.output.remark(&monitor::line(session.snapshot()));
        Ok(path)
    }

    /// Back to the marks.
    fn put_back<W: Wires>(&self, machine: &mut Machine<W>) -> Result<(), Error> {
        match (self.measuring.measure_with, &mut machine.tape) {
            (MeasureWith::Truth, Some(tape)) => {
                tape.put_back();
                Ok(())
            }
            _ => ask::until(
                "Lift the robot back on its marks, facing as at the start, and press Enter.",
                &machine.interrupt,
                self.output,
                |_| Ok(()),
            ),
        }
    }

    /// Where it stands, seen from the marks.
    fn measure<W: Wires>(
        &self,
        machine: &mut Machine<W>,
        question: &str,
    ) -> Result<Measured, Error> {
        match (self.measuring.measure_with, &mut machine.tape) {
            (MeasureWith::Truth, Some(tape)) => {
                let spot = tape.measure(self.measuring.noise);
                Ok(Measured {
                    ahead_mm: spot.ahead_mm,
                    left_mm: Some(spot.left_mm),
                })
            }
            _ => ask::until(question, &machine.interrupt, self.output, measured),
        }
    }

    /// The image with other figures; an original one gets its page 0x03 with them.
    fn image(original: &Image, figures: &Geometry) -> Result<Image, Error> {
        let mut config = decode(original)?;
        figures.put(&mut config);
        let mut wanted = *original;
        encode(&config, &mut wanted);
        decode(&wanted)?;
        Ok(wanted)
    }

    /// Shows the figures, asks, and writes them.
    fn write<W: Wires>(
        &self,
        machine: &mut Machine<W>,
        original: &Image,
        figures: &Geometry,
        (kept, journal): (&Kept, &Journal),
    ) -> Result<(Vec<Change>, bool), Error> {
        apply(
            machine,
            (original, &Self::image(original, figures)?),
            (self.measuring.yes, self.measuring.dry_run),
            (kept, journal),
            self.robot.ready_timeout,
            self.output,
        )
    }

    /// Whether to drive once more.
    fn verifies<W: Wires>(&self, machine: &Machine<W>) -> Result<bool, Error> {
        let question = "Put the robot back on its marks. Drive once more to see how good it is?";
        Ok(!self.measuring.no_verify
            && (self.measuring.yes || ask::whether(question, &machine.interrupt, self.output)?))
    }
}

const ENDS: &str =
    "How many mm is the middle of the axle ahead of where it began, and how many to the left of the line it \
     faced there (minus: behind, to the right)? For example: 997.5,-12";

struct Distance<'a> {
    arguments: &'a DistanceArgs,
    floor: Floor<'a>,
    kept: &'a Kept,
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
        let file = place::kept(self.floor.robot, "distance.json");
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
        let file = place::kept(self.floor.robot, "distance.json");
        let text = serde_json::to_string(&path).unwrap_or_default();
        image::save(&file, text.as_bytes())?;
        Ok(path)
    }
}

impl Job for Distance<'_> {
    type Result = Exit;

    fn run<W: Wires>(self, machine: &mut Machine<W>, journal: &Journal) -> Result<Exit, Error> {
        let (floor, output, length) = (self.floor, self.floor.output, self.arguments.length);
        self.kept.repair(machine, floor.robot.ready_timeout)?;
        let original = eeprom::read(machine)?;
        let before = Geometry::of(&decode(&original)?);
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
        let (changes, written) =
            floor.write(machine, &original, &solved.figures, (self.kept, journal))?;
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

struct Umbmark<'a> {
    arguments: &'a UmbmarkArgs,
    floor: Floor<'a>,
    kept: &'a Kept,
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
        self.kept.repair(machine, floor.robot.ready_timeout)?;
        let original = eeprom::read(machine)?;
        let before = Geometry::of(&decode(&original)?);
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
        let (changes, written) =
            floor.write(machine, &original, &estimate.figures, (self.kept, journal))?;
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
