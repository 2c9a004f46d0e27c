//! `calibrate …`.

mod distance;
mod measurement;
mod umbmark;

use super::args::{Calibrate, Robot};
use super::connection;
use super::output::Output;
use super::tune::{Kept, Rollback};
use distance::Distance;
use host_link::error::{Error, Exit};
use measurement::Floor;
use pilot::calibrate::run::check;
use umbmark::Umbmark;

/// Runs one of the commands.
pub fn run(command: &Calibrate, robot: &Robot, output: Output) -> Result<Exit, Error> {
    let kept = &Kept::of(robot);
    match command {
        Calibrate::Distance(arguments) => {
            check("a length of", arguments.length)?;
            let floor = Floor::new(&arguments.measuring, robot, output, kept)?;
            connection::with_machine(robot, Distance { arguments, floor })
        }
        Calibrate::Umbmark(arguments) => {
            check("a side of", arguments.side)?;
            let floor = Floor::new(&arguments.measuring, robot, output, kept)?;
            connection::with_machine(robot, Umbmark { arguments, floor })
        }
        Calibrate::Rollback => connection::with_machine(
            robot,
            Rollback {
                kept,
                robot,
                output,
            },
        ),
    }
}
