//! `goto` and `tour`.

use super::args::{Robot, TermsArgs};
use super::connection::Job;
use super::output::Output;
use host_link::board_io::{Machine, Wires};
use host_link::drive;
use host_link::eeprom::journal::Journal;
use host_link::error::{Error, Exit};
use host_link::pose::Place;
use host_link::session::Session;
use host_link::statistics::Statistics;
use serde::Serialize;

/// The commands.
pub struct Drive<'a> {
    pub way: Vec<Place>,
    pub terms: &'a TermsArgs,
    pub robot: &'a Robot,
    pub output: Output,
}

#[derive(Serialize)]
struct Done {
    arrivals: Vec<drive::Arrival>,
    link: Statistics,
}

impl Job for Drive<'_> {
    type Result = Exit;

    fn run<W: Wires>(self, machine: &mut Machine<W>, _: &Journal) -> Result<Exit, Error> {
        let mut session = Session::open(machine, self.robot.rate, self.robot.ready_timeout)?;
        let output = self.output;
        let mut arrivals = Vec::new();
        let outcome = drive::tour(
            &mut session,
            &self.way,
            &self.terms.terms(),
            |_, snapshot| output.live(&super::monitor::line(snapshot)),
            |index, arrival| {
                output.live("");
                if self.way.len() > 1 {
                    output.remark(&format!(
                        "{} of {}: {}",
                        index + 1,
                        self.way.len(),
                        told(arrival)
                    ));
                }
                arrivals.push(*arrival);
            },
        );
        if outcome.is_err() {
            output.end_live();
        }
        outcome?;
        let done = Done {
            arrivals,
            link: session.statistics(),
        };
        output.result(&done, || done.arrivals.last().map(told).unwrap_or_default());
        Ok(Exit::Ok)
    }
}

/// An arrival as a sentence.
pub fn told(arrival: &drive::Arrival) -> String {
    let pose = arrival.pose;
    format!(
        "arrived at x {:.1} mm, y {:.1} mm, {:.2}° after {:.1} s ({:.1} mm and {:.2}° from the target)",
        pose.x_mm,
        pose.y_mm,
        pose.rotation_deg,
        arrival.seconds,
        arrival.off_mm,
        arrival.off_deg.abs()
    )
}
