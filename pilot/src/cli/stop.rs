//! `stop` and `log`.

use super::connection::{Context, interrupt};
use super::lock;
use super::output::Output;
use host_link::error::{Error, Exit};
use host_link::log::Lines;
use host_link::uart::BOOT_BAUD;
use pilot::serve::protocol::{Message, Request};
use serde_json::json;
use std::thread;
use std::time::{Duration, Instant};

/// Time for another process to stop the robot and end.
const END: Duration = Duration::from_secs(5);
const POLL: Duration = Duration::from_millis(50);
/// Time between two looks at the log, microseconds.
const LOOK_US: u32 = 20_000;

/// Stops the robot, whichever process drives it.
pub fn run(context: Context<'_>) -> Result<(), Error> {
    let output = context.output;
    if let Some(mut client) = context.server()? {
        client.request(&Request::Stop)?;
        if let Some(error) = client.status()?.error {
            return Err(Error::Server {
                text: format!("the robot cannot be reached and stops by its deadline: {error}"),
                exit: Exit::Link,
            });
        }
        let stopped = json!({ "stopped": true });
        return output.result(&stopped, || "stopped".into());
    }
    let busy = match stop(context) {
        Err(Error::Busy(_, Some(process))) => process,
        outcome => return outcome,
    };
    // Its drive ends by a stop; the state is read once it is gone.
    lock::end(busy)?;
    let ends = Instant::now() + END;
    loop {
        thread::sleep(POLL);
        match stop(context) {
            Err(Error::Busy { .. }) if Instant::now() < ends => {}
            outcome => return outcome,
        }
    }
}

/// Stops the robot that no other process uses.
fn stop(context: Context<'_>) -> Result<(), Error> {
    let output = context.output;
    context.with_own_board(|connection| {
        let mut session = context.open_session(&mut connection.io)?;
        session.wait_for_reply()?;
        session.stop();
        let state = session.snapshot().state;
        let stopped = json!({ "stopped": true, "state": state });
        let other = state.filter(|&state| state != "stopped");
        let other = other.map_or_else(String::new, |state| format!(" ({state})"));
        output.result(&stopped, || format!("stopped{other}"))
    })
}

/// Shows the STM's log until Ctrl-C.
pub fn log(context: Context<'_>) -> Result<(), Error> {
    let output = context.output;
    let show = |line: String| output.result(&json!({ "line": line }), || line.clone());
    if let Some(mut client) = context.server()? {
        let interrupt = interrupt()?;
        client.request(&Request::Watch { every: 400 })?;
        loop {
            interrupt.check()?;
            Output::check_reader()?;
            if let Some(Message::Log { line }) = client.message()? {
                show(line)?;
            }
        }
    }
    context.with_own_board(|connection| {
        let io = &mut connection.io;
        // Of an STM that does not run, the boot's lines.
        let running = context.open_session(io);
        let baud = running.map_or(BOOT_BAUD, |session| session.config().log_baud());
        let mut lines = Lines::default();
        loop {
            io.interrupt.check()?;
            Output::check_reader()?;
            for line in lines.feed(&(io.log)(baud)?) {
                show(String::from_utf8_lossy(&line).trim_end().to_string())?;
            }
            (io.delay)(LOOK_US);
        }
    })
}
