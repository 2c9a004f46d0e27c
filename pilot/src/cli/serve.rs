//! `serve`: this process owns the robot, others use it.

use super::args::Serve;
use super::connection::{Connection, Context};
use super::explore;
use host_link::eeprom;
use host_link::error::Error;
use host_link::settings::Settings;
use pilot::serve::control::{self, Options};
use pilot::serve::hub::Hub;
use pilot::serve::{listener, token};
use std::sync::Arc;

/// Runs the command.
pub fn run(serve: &Serve, context: Context<'_>) -> Result<(), Error> {
    let (simulated, output) = (context.board.virtual_board.chosen, context.output);
    if serve.speed.is_some() && !simulated {
        return Err(Error::Usage("--speed is for --virtual only".into()));
    }
    context.with_own_board(|connection| {
        if simulated {
            configure_blank(connection, context)?;
        }
        explore::ensure_mode(connection, serve.yes, context).or_else(|error| match error {
            Error::WrongMode { .. } => Ok(()),
            error => Err(error),
        })?;
        let (hub, events) = Hub::new();
        let path = context.state_file("sock");
        let _socket = listener::unix(&path, &hub)?;
        output.message(&format!("serving on {}", path.display()));
        if let Some(address) = &serve.listen {
            let token = load_token(context)?;
            let address = listener::tcp(address, &token, &hub)?;
            output.message(&format!("serving on {address}"));
        }
        #[cfg(feature = "web")]
        if let Some(address) = &serve.web {
            let token = load_token(context)?;
            let url = pilot::web::serve(address, &token, &hub)?;
            output.message(&format!("page: {url}"));
        }
        let options = Options {
            rate_hz: context.board.rate,
            ready_timeout_ms: context.board.ready_timeout,
            body_mm: context.board.body_radius,
            speed: simulated.then_some(serve.speed.unwrap_or(1.0)),
            journal: Some(connection.journal.clone()),
        };
        // It ends by a signal only.
        control::run(&mut connection.io, &options, events).and(Err(Error::Interrupted))
    })
}

fn load_token(context: Context<'_>) -> Result<Arc<str>, Error> {
    let (path, output) = (context.state_file("token"), context.output);
    let token = token::load(&path)?;
    output.message(&format!("token in {}", path.display()));
    Ok(token.into())
}

/// A new virtual robot gets the sample configuration.
fn configure_blank(connection: &mut Connection, context: Context<'_>) -> Result<(), Error> {
    let Connection { io, journal, .. } = connection;
    if eeprom::read(io)?.0.iter().any(|&byte| byte != 0xFF) {
        return Ok(());
    }
    let (settings, timeout) = (Settings::sample()?, context.board.ready_timeout);
    eeprom::program(io, settings.image(), timeout, Some(journal), |_| ())?;
    let text = "the virtual EEPROM was blank: the sample configuration is in it now";
    context.output.message(text);
    Ok(())
}
