//! `goto` and `tour`.

use super::args::CriteriaArgs;
use super::connection::Context;
use super::monitor;
use host_link::error::Error;
use host_link::pose::Pose;
use host_link::statistics::LinkStatistics;
use pilot::drive::{self, Arrival};
use serde::Serialize;

#[derive(Serialize)]
struct Done {
    arrivals: Vec<Arrival>,
    link: LinkStatistics,
}

/// Drives from way-point to way-point.
pub fn run(waypoints: &[Pose], criteria: &CriteriaArgs, context: Context<'_>) -> Result<(), Error> {
    let output = context.output;
    context.with_board(|connection| {
        let mut session = context.open_session(&mut connection.io)?;
        let mut arrivals = Vec::new();
        let outcome = drive::tour(
            &mut session,
            waypoints,
            &criteria.criteria(),
            |_, snapshot| output.live(&monitor::line(snapshot)),
            |index, arrival| {
                output.live("");
                if waypoints.len() > 1 {
                    let summary = summary(arrival);
                    output.message(&format!("{} of {}: {summary}", index + 1, waypoints.len()));
                }
                arrivals.push(*arrival);
            },
        );
        if outcome.is_err() {
            output.end_live();
        }
        outcome?;
        let link = session.statistics();
        let done = Done { arrivals, link };
        output.result(&done, || {
            done.arrivals.last().map(summary).unwrap_or_default()
        })
    })
}

/// An arrival as a sentence.
pub fn summary(arrival: &Arrival) -> String {
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
