//! `stop` and `log`.

use super::connection::{Context, interrupt};
use super::output::Output;
use host_link::error::{Error, Exit};
use pilot::serve::protocol::{Message, Request};
use serde_json::json;

/// Time between two looks at the log, microseconds.
const LOOK_US: u32 = 20_000;

/// Stops the robot.
pub fn run(context: Context<'_>) -> Result<(), Error> {
    if let Some(mut client) = context.server()? {
        client.request(&Request::Stop)?;
        if let Some(error) = client.status()?.error {
            let text = format!("the robot cannot be reached and stops by its deadline: {error}");
            return Err(Error::Server {
                text,
                exit: Exit::Link,
            });
        }
        let stopped = json!({ "stopped": true });
        return context.output.result(&stopped, || "stopped".into());
    }
    context.with_own_board(|connection| {
        let mut session = context.open_session(&mut connection.io)?;
        session.wait_for_reply()?;
        session.stop();
        let state = session.snapshot().state;
        context
            .output
            .result(&json!({ "stopped": true, "state": state }), || {
                format!(
                    "stopped{}",
                    state.map(|state| format!(" ({state})")).unwrap_or_default()
                )
            })
    })
}

/// Shows the STM's log until Ctrl-C.
pub fn log(context: Context<'_>) -> Result<(), Error> {
    let show = |line: String| {
        context
            .output
            .result(&json!({ "line": line }), || line.clone())
    };
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
        let mut partial = Vec::new();
        loop {
            io.interrupt.check()?;
            Output::check_reader()?;
            for byte in io.log.read_new()? {
                if byte == b'\n' {
                    show(String::from_utf8_lossy(&partial).trim_end().to_string())?;
                    partial.clear();
                } else if partial.len() < 256 {
                    partial.push(byte);
                }
            }
            io.delay.delay_us(LOOK_US);
        }
    })
}
