//! `bringup`: a bare board part by part, by the log of the bring-up firmware.

use super::args::Bringup;
use super::connection::{Context, interrupt, open_linux};
use super::doctor;
use host_link::error::{Error, Exit};
use host_link::file;
use host_link::uart::{BOOT_BAUD, SerialPort};
use pilot::doctor::Findings;
use pilot::doctor::bringup;
use std::fs;
use std::thread;
use std::time::{Duration, Instant};

/// Time between two looks at the serial device.
const LOOK: Duration = Duration::from_millis(20);
/// Frames that are exchanged at each clock.
const FRAMES: u32 = 1_000;
/// Begin of the last step's lines.
const LAST_STEP: &str = ": link frames ";

/// Runs the command.
pub fn run(options: &Bringup, context: Context<'_>) -> Result<Exit, Error> {
    let mut findings = Findings::default();
    if !options.log.exists() {
        let advice = "name the serial device of the log, or a file with one that was kept";
        return Err(Error::device(
            options.log.display(),
            "there is none",
            advice,
        ));
    }
    let is_file = fs::metadata(&options.log).is_ok_and(|present| present.is_file());
    if is_file && options.link {
        let what = "--link exchanges frames while a serial device is read, not with a file";
        return Err(Error::Usage(what.into()));
    }
    let log = if is_file {
        file::read_text(&options.log)?
    } else {
        listen(options, context, &mut findings)?
    };
    let mut judged = Findings::default();
    bringup::judge(&log, &mut judged);
    judged.0.append(&mut findings.0);
    doctor::report(&judged, context)
}

/// Shows the log as it comes, up to the last step; with `--link` that step exchanges frames.
fn listen(
    options: &Bringup,
    context: Context<'_>,
    findings: &mut Findings,
) -> Result<String, Error> {
    let interrupt = interrupt()?;
    let mut port = SerialPort::new(&options.log);
    let (mut log, mut shown, mut exchanged) = (String::new(), 0, !options.link);
    let mut heard = Instant::now();
    while heard.elapsed() < Duration::from_secs(options.patience.into()) {
        interrupt.check()?;
        log.push_str(&String::from_utf8_lossy(&port.read_new(BOOT_BAUD)?));
        while let Some(end) = log[shown..].find('\n') {
            context.output.message(log[shown..shown + end].trim_end());
            shown += end + 1;
            heard = Instant::now();
        }
        if log[..shown].contains(LAST_STEP) {
            if exchanged {
                log.truncate(shown);
                return Ok(log);
            }
            exchanged = true;
            let open = |hz| Ok(open_linux(context, hz, interrupt.clone())?.0);
            bringup::exchange(open, context.board.spi_hz, FRAMES, findings)?;
            // The STM counts the frames in a line each second.
            thread::sleep(Duration::from_millis(1100));
            heard = Instant::now();
            // What was counted before is of no frame.
            log.truncate(shown);
            log = log.replace(LAST_STEP, ": ");
            shown = log.len();
        }
        thread::sleep(LOOK);
    }
    Ok(log)
}
