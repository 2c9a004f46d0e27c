//! `monitor`: everything the robot reports, live.

use super::args::Monitor;
use super::connection::Context;
use host_link::error::Error;
use host_link::session::CommandRequest;
use host_link::snapshot::Snapshot;
use host_link::statistics::{LinkStatistics, RejectCounts, StmStatistics};
use std::fmt::Write;

/// Time between two lines for people, microseconds.
const REFRESH_US: u64 = 100_000;

/// Runs the command.
pub fn run(monitor: &Monitor, context: Context<'_>) -> Result<(), Error> {
    let output = context.output;
    context.with_board(|connection| {
        let mut session = context.open_session(&mut connection.io)?;
        let mut remaining = monitor.count.unwrap_or(u64::MAX);
        let mut shown_us = 0;
        while remaining > 0 {
            let report = session.exchange(&CommandRequest::default())?;
            session.poll_log();
            if report.is_none() {
                continue;
            }
            remaining -= 1;
            let snapshot = session.snapshot();
            let due = snapshot.time_us.saturating_sub(shown_us) >= REFRESH_US;
            if output.is_live() && due {
                output.live(&line(snapshot));
            } else if !output.is_live() && (output.is_json() || remaining == 0 || due) {
                output.result(snapshot, || line(snapshot))?;
            } else {
                continue;
            }
            shown_us = snapshot.time_us;
        }
        if output.is_live() {
            output.live("");
            output.result(session.snapshot(), || line(session.snapshot()))?;
        }
        Ok(())
    })
}

/// One line of everything.
pub fn line(snapshot: &Snapshot) -> String {
    let mut line = robot(snapshot);
    let _ = write!(line, "  {}", pi(&snapshot.link));
    if let Some(counters) = &snapshot.stm {
        let _ = write!(line, "; STM {}", stm(counters));
    }
    line
}

/// What the robot reports of itself.
pub fn robot(snapshot: &Snapshot) -> String {
    let mut line = String::new();
    if let Some(pose) = snapshot.pose {
        let _ = write!(
            line,
            "x {:8.1} mm  y {:8.1} mm  {:6.2}°  ",
            pose.x_mm, pose.y_mm, pose.rotation_deg
        );
    }
    if let Some(measurement) = snapshot.measurement {
        let _ = write!(line, "measured {measurement:.3}  ");
    }
    line.push_str("cells");
    for cell in &snapshot.cells_v {
        let _ = match cell {
            Some(volts) => write!(line, " {volts:.2}"),
            None => write!(line, " –"),
        };
    }
    line.push_str(" V  ");
    if let Some(bearing) = snapshot.bearing_deg {
        let _ = match snapshot.ranges_mm[0] {
            Some(mm) => write!(line, "at {bearing:5.1}° {mm:4.0} mm  "),
            None => write!(line, "at {bearing:5.1}°    – mm  "),
        };
    } else if snapshot.pose.is_some() {
        for (name, range) in ["front", "right", "left"].iter().zip(snapshot.ranges_mm) {
            let _ = match range {
                Some(mm) => write!(line, "{name} {mm:4.0} "),
                None => write!(line, "{name}    – "),
            };
        }
        line.push_str("mm  ");
    }
    if let Some(state) = snapshot.state {
        let _ = write!(line, "{state} ");
        if !snapshot.faults.is_empty() {
            let _ = write!(line, "({}) ", snapshot.faults.join(", "));
        }
    }
    line.truncate(line.trim_end().len());
    line
}

/// The Pi's end of the link.
pub fn pi(link: &LinkStatistics) -> String {
    let mut text = frames(link.frames, link.rejected, &link.causes);
    if let Some(missed) = link.missed {
        let _ = write!(text, ", {missed} missed");
    }
    if let (Some(latest), Some(worst)) = (link.round_trip_us, link.worst_round_trip_us) {
        let _ = write!(
            text,
            ", round trip {} ms, worst {}",
            tenths(latest),
            tenths(worst)
        );
    }
    let _ = write!(text, ", worst gap {} ms", tenths(link.worst_gap_us));
    text
}

/// The STM's end of the link.
pub fn stm(link: &StmStatistics) -> String {
    let mut text = frames(link.frames.into(), link.rejected, &link.causes);
    let _ = write!(text, ", {} lost", link.lost);
    if let Some(missed) = link.missed {
        let _ = write!(text, ", {missed} missed");
    }
    if let Some(frames) = link.round_trip_frames {
        let _ = write!(text, ", round trip {frames} frames");
    }
    let _ = write!(
        text,
        ", gap {} ms, worst {}",
        tenths(link.recent_gap_us.into()),
        tenths(link.worst_gap_us.into())
    );
    text
}

fn frames(frames: u64, rejected: u32, causes: &RejectCounts) -> String {
    let mut text = format!("{frames} frames, {rejected} rejected");
    for (cause, count) in causes.nonzero() {
        let _ = write!(text, " {} {count}", cause.name());
    }
    text
}

/// Milliseconds to one decimal.
fn tenths(us: u64) -> String {
    format!("{}.{}", us / 1000, us % 1000 / 100)
}
