//! `calibrate from-explore`: the wheels that the latest exploration has learned.

use crate::cli::connection::{Connection, Context};
use crate::cli::measuring_args::Consent;
use crate::cli::tune::{apply, ending};
use host_link::eeprom;
use host_link::error::Error;
use host_link::file::{self, Kind};
use host_link::settings::Settings;
use pilot::calibrate::explored::Explored;
use pilot::calibrate::wheel_geometry::WheelGeometry;
use serde_json::json;
use std::path::PathBuf;

/// Where what was learned is kept.
fn learned_file(context: Context<'_>) -> PathBuf {
    context.state_file("explored.json")
}

/// # Errors
/// [`Error::Unwritable`] where [`keep`] could not write.
pub fn check(context: Context<'_>) -> Result<(), Error> {
    file::check(&learned_file(context), Kind::Json)
}

/// Keeps what an exploration has learned.
///
/// # Errors
/// [`Error::Unwritable`].
pub fn keep(learned: &Explored, context: Context<'_>) -> Result<(), Error> {
    let text = serde_json::to_string(learned).unwrap_or_default();
    file::save(&learned_file(context), Kind::Json, text.as_bytes())
}

/// Runs the command.
// Requirement: NAV-calibrate-1
pub fn run(
    consent: &Consent,
    connection: &mut Connection,
    context: Context<'_>,
) -> Result<(), Error> {
    let path = learned_file(context);
    if !path.exists() {
        let what = "nothing was learned yet: `robot explore` first";
        return Err(Error::Usage(what.into()));
    }
    file::ensure_trusted(&path)?;
    let learned: Explored = serde_json::from_str(&file::read_text(&path)?)
        .map_err(|cause| Error::content(&path, cause.line(), cause.to_string()))?;
    let original = eeprom::read(&mut connection.io)?;
    let settings = Settings::from_image(&original)?;
    if WheelGeometry::from_config(settings.config()) != learned.before {
        let what = "the EEPROM's diameters or track have changed since; explore again";
        return Err(Error::content(&path, None, what));
    }
    context.output.message(&learned.summary());
    let wheels = learned.wheels().map_err(Error::Calibration)?;
    let wanted = settings.with(&wheels.values())?;
    let (changes, written) = apply(connection, (&original, wanted.image()), consent, context)?;
    let done = json!({ "learned": learned, "changes": changes, "written": written });
    context.output.result(&done, || {
        format!("diameters and track {}", ending(&changes, written))
    })
}
