//! `goto` and `tour`.

use super::args::CriteriaArgs;
use super::connection::Context;
use super::monitor;
use host_link::error::Error;
use host_link::pose::Pose;
use host_link::session::Session;
use host_link::snapshot::Snapshot;
use pilot::drive::{self, Arrival};
use serde_json::json;

/// Drives from way-point to way-point.
pub fn run(waypoints: &[Pose], criteria: &CriteriaArgs, context: Context<'_>) -> Result<(), Error> {
    context.with_board(|connection| {
        let mut session = context.open_session(&mut connection.io)?;
        let (arrivals, outcome) = follow(&mut session, waypoints, criteria, context, |_| ());
        outcome?;
        let done = json!({ "arrivals": arrivals, "link": session.statistics() });
        let last = || arrivals.last().map(summary).unwrap_or_default();
        context.output.result(&done, last)
    })
}

/// Drives the way-points with a live line; `watch` gets every report.
pub fn follow(
    session: &mut Session<'_>,
    waypoints: &[Pose],
    criteria: &CriteriaArgs,
    context: Context<'_>,
    mut watch: impl FnMut(&Snapshot),
) -> (Vec<Arrival>, Result<(), Error>) {
    let (output, mut arrivals) = (context.output, Vec::new());
    let show = |snapshot: &Snapshot| {
        watch(snapshot);
        output.live(&monitor::line(snapshot));
    };
    let reached = |index, arrival: &Arrival| {
        output.live("");
        if waypoints.len() > 1 {
            let summary = summary(arrival);
            output.message(&format!("{} of {}: {summary}", index + 1, waypoints.len()));
        }
        arrivals.push(*arrival);
    };
    let outcome = drive::tour(session, waypoints, &criteria.criteria(), show, reached);
    if outcome.is_err() {
        output.end_live();
    }
    (arrivals, outcome)
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
