//! `replay`: a recording's reports, as they came.

use super::args::Replay;
use super::connection::interrupt;
use super::monitor::or_dash;
use super::output::Output;
use host_link::error::Error;
use pilot::mapping::RangeSample;
use pilot::recording;
use std::time::{Duration, Instant};

/// Longest sleep between two looks at Ctrl-C.
const POLL: Duration = Duration::from_millis(50);

/// Runs the command.
pub fn run(replay: &Replay, output: Output) -> Result<(), Error> {
    let (_, samples, cut) = recording::load(&replay.file)?;
    if let Some(cut) = cut {
        output.warn(&cut);
    }
    let (interrupt, begun) = (interrupt()?, Instant::now());
    let first_us = samples.first().map_or(0, |sample| sample.time_us);
    for sample in &samples {
        let since = Duration::from_micros(sample.time_us.saturating_sub(first_us));
        let due = replay
            .speed
            .map_or(Duration::ZERO, |speed| since.div_f64(speed));
        while let Some(wait) = due.checked_sub(begun.elapsed()) {
            interrupt.check()?;
            std::thread::sleep(wait.min(POLL));
        }
        interrupt.check()?;
        output.result(sample, || line(sample, since))?;
    }
    Ok(())
}

fn line(sample: &RangeSample, since: Duration) -> String {
    let [front, right, left] = sample.ranges_mm.map(|mm| or_dash(mm, 0, 0));
    let bearing = or_dash(sample.bearing_deg, 0, 0);
    format!(
        "{:8.2} s  x {:7.1} mm  y {:7.1} mm  {:6.2}°  front {front} (at {bearing}°) right {right} left {left} mm",
        since.as_secs_f64(),
        sample.pose.x_mm,
        sample.pose.y_mm,
        sample.pose.rotation_deg
    )
}
