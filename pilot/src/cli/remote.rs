//! Commands as clients of a running server.

use super::args::{Explore, Goto, Monitor};
use super::connection::{Context, interrupt};
use super::{drive, monitor};
use host_link::error::Error;
use pilot::client::{self, Client, View};
use pilot::drive::Arrival;
use pilot::mapping::{self, Files};
use pilot::serve::protocol::{Frame, Message, Request};
use serde::Serialize;

/// Joins the server of the chosen robot, if one runs.
pub fn connect(command: &str, context: Context<'_>) -> Result<Option<Client>, Error> {
    let name = format!("{command} ({})", std::process::id());
    Client::connect(&context.state_file("sock"), &name)
}

/// Shows every report.
pub fn monitor(client: &mut Client, command: &Monitor, context: Context<'_>) -> Result<(), Error> {
    let (output, interrupt) = (context.output, interrupt()?);
    let every = if output.is_json() { 1 } else { 4 };
    client.request(&Request::Watch { every })?;
    let mut remaining = command.count.unwrap_or(u64::MAX);
    while remaining > 0 {
        interrupt.check()?;
        let Some(Message::Frame(frame)) = client.message()? else {
            continue;
        };
        remaining -= 1;
        if output.is_live() && remaining > 0 {
            output.live(&line(&frame));
        } else {
            output.live("");
            output.result(&frame.robot, || line(&frame))?;
        }
    }
    Ok(())
}

fn line(frame: &Frame) -> String {
    let line = monitor::line(&frame.robot);
    match (&frame.error, &frame.driver) {
        (Some(error), _) => format!("{line}  {error}"),
        (None, Some(driver)) => format!("{line}  driven by {driver}"),
        (None, None) => line,
    }
}

/// Stops the robot.
pub fn stop(client: &mut Client, context: Context<'_>) -> Result<(), Error> {
    client.request(&Request::Stop)?;
    context
        .output
        .result(&serde_json::json!({ "stopped": true }), || "stopped".into())
}

/// Shows the STM's log.
pub fn log(client: &mut Client, context: Context<'_>) -> Result<(), Error> {
    let interrupt = interrupt()?;
    client.request(&Request::Watch { every: 400 })?;
    loop {
        interrupt.check()?;
        if let Some(Message::Log { line }) = client.message()? {
            context
                .output
                .result(&serde_json::json!({ "line": line }), || line)?;
        }
    }
}

/// Makes a motion and shows it as it goes; how it ended, and what was seen.
fn drive_live(
    client: &mut Client,
    request: &Request,
    context: Context<'_>,
) -> Result<(Result<f64, Error>, View), Error> {
    let (output, mut view) = (context.output, View::default());
    let driven = client.drive(request, &interrupt()?, |message| {
        if let Message::Frame(frame) = message {
            output.live(&line(frame));
        }
        view.take(message);
    });
    output.end_live();
    Ok((driven, view))
}

/// Drives to a pose.
pub fn go_to(client: &mut Client, goto: &Goto, context: Context<'_>) -> Result<(), Error> {
    let (target, output) = (goto.target(), context.output);
    let request = client::goto(target, &goto.criteria.criteria());
    let (driven, view) = drive_live(client, &request, context)?;
    let seconds = driven?;
    let pose = view
        .frame
        .and_then(|frame| frame.robot.pose)
        .unwrap_or_default();
    let arrival = Arrival {
        pose,
        off_mm: pose.distance_mm(target),
        off_deg: pose.rotation_to_deg(target),
        seconds,
    };
    output.result(&arrival, || drive::summary(&arrival))
}

#[derive(Serialize)]
struct Explored {
    files: Files,
    seconds: Option<f64>,
    targets: usize,
}

/// Explores and leaves the map.
pub fn explore(client: &mut Client, explore: &Explore, context: Context<'_>) -> Result<(), Error> {
    if explore.record.is_some() {
        return Err(Error::Usage(
            "--record needs the robot itself: end the server".into(),
        ));
    }
    let (driven, view) = drive_live(client, &client::EXPLORE, context)?;
    // What was seen before an error is worth keeping, whatever the error was.
    let explored = Explored {
        files: mapping::save_map(&view.grid(), &view.path, &explore.out)?,
        seconds: driven.as_ref().ok().copied(),
        targets: view.frame.map_or(0, |frame| frame.targets),
    };
    context.output.result(&explored, || {
        let Files { png, pgm, yaml } = &explored.files;
        format!(
            "map in {}, {}, {}",
            png.display(),
            pgm.display(),
            yaml.display()
        )
    })?;
    driven.map(|_| ())
}
