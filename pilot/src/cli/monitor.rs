//! `monitor` and `teleop`: everything the robot reports, live.

use super::args::{Monitor, Teleop};
use super::connection::{Context, interrupt};
use super::output::Output;
use super::{explore, screen};
use host_link::error::{Error, Exit};
use host_link::snapshot::Snapshot;
use host_link::statistics::{LinkStatistics, RejectCounts, StmStatistics};
use pilot::client::Client;
use pilot::gamepad::Gamepad;
use pilot::hints;
use pilot::serve::protocol::{Message, Request};
use pilot::teleop::DeadMan;
use std::fmt::Write;

/// Frames between two lines for people.
const EVERY: u32 = 4;

/// Shows a screen on a terminal, else lines.
pub fn run(monitor: &Monitor, context: Context<'_>) -> Result<(), Error> {
    let built = cfg!(any(test, feature = "terminal"));
    let is_screen = built && context.output.is_screen() && monitor.count.is_none();
    context.with_client(
        |_| Ok(()),
        |client| {
            if is_screen {
                return screen::run(client, None);
            }
            lines(client, monitor, context)
        },
    )
}

/// Drives by keys or a gamepad.
pub fn teleop(teleop: &Teleop, context: Context<'_>) -> Result<(), Error> {
    if !context.output.is_screen() {
        let what = "teleop needs a terminal, without --json: the dead man's handle is its keyboard";
        return Err(Error::Usage(what.into()));
    }
    let gamepad = teleop.gamepad.as_deref().map(Gamepad::open).transpose()?;
    let dead_man = DeadMan::new(teleop.speed, teleop.turn, gamepad);
    context.with_client(
        |connection| explore::ensure_mode(connection, teleop.yes, context),
        |client| screen::run(client, Some(dead_man)),
    )
}

fn lines(client: &mut Client, monitor: &Monitor, context: Context<'_>) -> Result<(), Error> {
    let (output, interrupt) = (context.output, interrupt()?);
    let every = if output.is_json() { 1 } else { EVERY };
    client.request(&Request::Watch { every })?;
    let (mut remaining, mut shown_us) = (monitor.count.unwrap_or(u64::MAX), None);
    while remaining > 0 {
        interrupt.check()?;
        Output::check_reader()?;
        let Some(Message::Frame(frame)) = client.message()? else {
            continue;
        };
        if let Some(text) = frame.error {
            let exit = Exit::Link;
            return Err(Error::Server { text, exit });
        }
        if shown_us.replace(frame.robot.time_us) == Some(frame.robot.time_us) {
            continue;
        }
        remaining -= 1;
        let driver = frame.driver.map(|driver| format!("  driven by {driver}"));
        output.result(&frame.robot, || {
            line(&frame.robot) + &driver.unwrap_or_default()
        })?;
    }
    Ok(())
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
    for &cell in &snapshot.cells_v {
        let _ = write!(line, " {}", or_dash(cell, 0, 2));
    }
    line.push_str(" V  ");
    if let Some(bearing) = snapshot.bearing_deg {
        let mm = or_dash(snapshot.ranges_mm[0], 4, 0);
        let _ = write!(line, "at {bearing:5.1}° {mm} mm  ");
    } else if snapshot.pose.is_some() {
        for (name, range) in ["front", "right", "left"].iter().zip(snapshot.ranges_mm) {
            let _ = write!(line, "{name} {} ", or_dash(range, 4, 0));
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

/// A number with so many decimals, or a dash, at least so many characters wide.
pub fn or_dash(value: Option<f64>, width: usize, decimals: usize) -> String {
    match value {
        Some(value) => format!("{value:width$.decimals$}"),
        None => format!("{:>width$}", "–"),
    }
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
        let _ = write!(text, ", round trip {}", hints::frames(frames.into()));
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
    let mut text = format!("{}, {rejected} rejected", hints::frames(frames));
    for (cause, count) in causes.nonzero() {
        let _ = write!(text, " {} {count}", cause.name());
    }
    text
}

/// Milliseconds to one decimal.
fn tenths(us: u64) -> String {
    format!("{}.{}", us / 1000, us % 1000 / 100)
}
