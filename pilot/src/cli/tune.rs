//! `tune …`.

use super::connection::{Connection, Context};
use super::measuring_args::{Consent, StepArgs, Tune};
use super::prompt;
use fw_core::eeprom::{FIELDS, Image};
use host_link::eeprom::{self, image};
use host_link::error::Error;
use host_link::file::{self, Kind};
use host_link::session::Session;
use host_link::settings::{Change, Settings, changes};
use pilot::tune::{Axis, battery, drive_model, export, gains, step_response, temporary_mode};
use serde_json::json;
use std::path::PathBuf;

/// Runs one of the commands.
pub fn run(command: &Tune, context: Context<'_>) -> Result<(), Error> {
    context.with_board(|connection| match command {
        Tune::Rotate(arguments) => steps(Axis::Rotate, arguments, connection, context),
        Tune::Move(arguments) => steps(Axis::Move, arguments, connection, context),
        Tune::Battery {
            cell,
            volts,
            consent,
        } => divider(*cell, *volts, consent, connection, context),
        Tune::Rollback => rollback(connection, context),
    })
}

/// Where the EEPROM's content before the latest tuning or calibration is kept.
fn before_file(context: Context<'_>) -> PathBuf {
    context.state_file("tune.before")
}

/// Shows what would change, asks, and writes it. Returns the changes and whether they were written.
pub(super) fn apply(
    Connection { io, journal, .. }: &mut Connection,
    (before, wanted): (&Image, &Image),
    consent: &Consent,
    context: Context<'_>,
) -> Result<(Vec<Change>, bool), Error> {
    let output = context.output;
    let changes = changes(
        &Settings::from_image(before)?,
        &Settings::from_image(wanted)?,
    );
    show(&changes, context);
    let question = "Write this to the EEPROM?";
    let nothing = changes.is_empty() || consent.dry_run;
    if nothing || !(consent.yes || prompt::confirm(question, &io.interrupt, output)?) {
        return Ok((changes, false));
    }
    io.interrupt.check()?;
    file::save(&before_file(context), Kind::Image, &before.0)?;
    let timeout = context.board.ready_timeout;
    eeprom::program(io, wanted, timeout, Some(journal), |_| {})?;
    Ok((changes, true))
}

/// Before and after.
fn show(changes: &[Change], context: Context<'_>) {
    for change in changes {
        context.output.message(&format!(
            "0x{:04X} {}: {} -> {}",
            change.address, change.key, change.before, change.after
        ));
    }
}

/// The outcome in words.
pub(super) fn ending(changes: &[Change], written: bool) -> &'static str {
    match (changes.is_empty(), written) {
        (true, _) => "nothing to change",
        (false, true) => "written; `robot tune rollback` brings back the old ones",
        (false, false) => "not written",
    }
}

fn steps(
    axis: Axis,
    arguments: &StepArgs,
    connection: &mut Connection,
    context: Context<'_>,
) -> Result<(), Error> {
    let output = context.output;
    let Connection { io, journal, .. } = &mut *connection;
    let plan = arguments.plan(axis);
    let original = eeprom::read(io)?;
    let settings = Settings::from_image(&original)?;
    let rate = context.board.rate;
    pilot::drive::check_rate(rate, settings.config())?;
    plan.check(settings.config())?;
    let stem = arguments.stem(axis);
    export::check(&stem)?;
    let what = axis.announce(&plan);
    prompt::confirm_drive(arguments.consent.yes, &what, &io.interrupt, output)?;
    let timeout = context.board.ready_timeout;
    let recorder = temporary_mode::with_modes(io, &original, Some(journal), timeout, |modes| {
        let (io, config) = modes.enter(axis.mode())?;
        let mut session = Session::with_config(io, config, rate);
        step_response::run(&mut session, &plan, |percent| {
            output.message(&format!("step of {percent} %"));
        })
    })?;
    let samples = recorder.samples();
    let csv = export::save_csv(&stem, axis, samples)?;
    let steps = drive_model::steps(samples);
    let model = drive_model::fit(&steps).map_err(|what| {
        // The picture shows what went wrong; an error in drawing it matters less.
        let _ = export::save_picture(&stem, axis, samples, None);
        Error::Tuning(format!("{what} (see {})", csv.display()))
    })?;
    let present = gains::Factors::of(axis, &settings);
    let damping = arguments.damping.unwrap_or(axis.damping());
    let proposed = gains::propose(&model, damping, &present);
    let before = gains::predict(axis, &model, &present);
    let after = gains::predict(axis, &model, &proposed);
    let fitted = Some((&model, steps.as_slice(), &before, &after));
    let picture = export::save_picture(&stem, axis, samples, fitted)?;
    output.message(&summary(axis, &model, &before, &after));
    if after.is_worse_than(&before) {
        let what = "the proposed gains are predicted to be worse than the present ones, which stay; \
                    try another --damping";
        return Err(Error::Tuning(format!("{what} (see {})", picture.display())));
    }
    let wanted = settings.with(&proposed.values(axis))?;
    let images = (&original, wanted.image());
    let (changes, written) = apply(connection, images, &arguments.consent, context)?;
    let (samples, lost) = (samples.len(), recorder.lost());
    let done = json!({
        "axis": axis, "model": model, "samples": samples, "lost": lost, "present": present, "proposed": proposed,
        "predicted_present": before, "predicted": after, "csv": csv, "picture": picture, "changes": changes,
        "written": written,
    });
    output.result(&done, || {
        let (ending, csv, picture) = (ending(&changes, written), csv.display(), picture.display());
        format!("gains {ending}; {samples} samples ({lost} lost) in {csv}, {picture}")
    })
}

fn summary(
    axis: Axis,
    model: &drive_model::DriveModel,
    before: &gains::Response,
    after: &gains::Response,
) -> String {
    let unit = axis.unit();
    let response = |name: &str, response: &gains::Response| {
        let settled = response.settled_s.map_or_else(
            || "does not settle within 5 s".into(),
            |seconds| format!("settled after {seconds:.2} s"),
        );
        format!(
            "{name} gains, {} {unit}: {settled}, overshoot {:.2} {unit} (predicted)",
            response.target, response.overshoot
        )
    };
    format!(
        "drive: {:.3} {unit}/s per % beyond a dead zone of {:.1} %, two lags of {:.3} s; \
         {:.2} {unit} RMS unexplained over {} steps\n{}\n{}",
        model.gain,
        model.dead_zone,
        model.lag_s,
        model.residual,
        model.steps,
        response("present", before),
        response("proposed", after)
    )
}

/// Corrects the divider of a battery tap.
fn divider(
    cell: u8,
    volts: f64,
    consent: &Consent,
    connection: &mut Connection,
    context: Context<'_>,
) -> Result<(), Error> {
    let io = &mut connection.io;
    let original = eeprom::read(io)?;
    let mut session = context.open_session(io)?;
    let upper_ohm = battery::measure_upper_resistor(&mut session, cell, volts)?;
    battery::check(session.config(), cell, upper_ohm)?;
    let upper = FIELDS.iter().filter(|field| field.tap == cell).take(1);
    let changes: Vec<_> = upper.map(|field| (field, upper_ohm.into())).collect();
    let wanted = Settings::from_image(&original)?.with(&changes)?;
    let (changes, written) = apply(connection, (&original, wanted.image()), consent, context)?;
    let done = json!({
        "cell": cell, "volts": volts, "upper_ohm": upper_ohm, "changes": changes, "written": written,
    });
    context.output.result(&done, || {
        format!("tap {cell}: {upper_ohm} ohm {}", ending(&changes, written))
    })
}

/// Both `rollback` commands: tuning and calibration share one file, of the latest.
pub(super) fn rollback(connection: &mut Connection, context: Context<'_>) -> Result<(), Error> {
    let Connection { io, journal, .. } = connection;
    let before = before_file(context);
    if !before.exists() {
        let what = format!(
            "no tuning or calibration to roll back: {} does not exist",
            before.display()
        );
        return Err(Error::Usage(what));
    }
    file::ensure_trusted(&before)?;
    let image = image::load(&before)?;
    if let Ok(present) = Settings::from_image(&eeprom::read(io)?) {
        show(&changes(&present, &Settings::from_image(&image)?), context);
    }
    let timeout = context.board.ready_timeout;
    eeprom::program(io, &image, timeout, Some(journal), |_| {})?;
    std::fs::remove_file(&before).map_err(|cause| Error::unwritable(&before, &cause))?;
    let done = json!({ "rolled_back": true });
    context.output.result(&done, || {
        "the EEPROM is as it was before the latest tuning or calibration".into()
    })
}
