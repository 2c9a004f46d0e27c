//! `stop` and `log` without a server.

use super::connection::Context;
use host_link::error::Error;

/// Time between two looks at the log, microseconds.
const LOOK_US: u32 = 20_000;

/// Stops the robot.
pub fn run(context: Context<'_>) -> Result<(), Error> {
    context.with_board(|connection| {
        let mut session = context.open_session(&mut connection.io)?;
        session.wait_for_reply()?;
        session.stop();
        let state = session.snapshot().state;
        context.output.result(
            &serde_json::json!({ "stopped": true, "state": state }),
            || {
                format!(
                    "stopped{}",
                    state.map(|state| format!(" ({state})")).unwrap_or_default()
                )
            },
        )
    })
}

/// Shows the STM's log until Ctrl-C.
pub fn log(context: Context<'_>) -> Result<(), Error> {
    context.with_board(|connection| {
        let io = &mut connection.io;
        let mut partial = Vec::new();
        loop {
            io.interrupt.check()?;
            for byte in io.log.read_new()? {
                if byte == b'\n' {
                    let line = String::from_utf8_lossy(&partial).trim_end().to_string();
                    context
                        .output
                        .result(&serde_json::json!({ "line": line }), || line)?;
                    partial.clear();
                } else if partial.len() < 256 {
                    partial.push(byte);
                }
            }
            io.delay.delay_us(LOOK_US);
        }
    })
}
