//! `calibrate …`.

mod distance;
pub mod explored;
mod measurement;
mod umbmark;

use super::connection::Context;
use super::measuring_args::Calibrate;
use super::tune::rollback;
use host_link::error::Error;
use measurement::Measurement;

/// Runs one of the commands.
pub fn run(command: &Calibrate, context: Context<'_>) -> Result<(), Error> {
    match command {
        Calibrate::Distance(arguments) => {
            let measurement = Measurement::new(&arguments.measuring, context)?;
            context.with_board(|connection| distance::run(arguments, measurement, connection))
        }
        Calibrate::Umbmark(arguments) => {
            let measurement = Measurement::new(&arguments.measuring, context)?;
            context.with_board(|connection| umbmark::run(arguments, measurement, connection))
        }
        Calibrate::FromExplore(consent) => {
            context.with_board(|connection| explored::run(consent, connection, context))
        }
        Calibrate::Rollback => context.with_board(|connection| rollback(connection, context)),
    }
}
