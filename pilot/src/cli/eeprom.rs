//! `eeprom …`.

use super::args::Eeprom;
use super::connection::{Connection, Context};
use super::output::Output;
use fw_core::eeprom::Image;
use host_link::eeprom::{self, Progress, chip, image};
use host_link::error::{Error, Exit};
use host_link::file::{self, Kind};
use host_link::settings::{Change, Settings, changes, render};
use serde::Serialize;
use serde_json::json;
use std::fmt::Write;
use std::path::Path;

/// Runs one of the commands.
pub fn run(command: &Eeprom, context: Context<'_>) -> Result<Exit, Error> {
    match command {
        Eeprom::Init { file, force } => init(file.as_deref(), *force, context.output),
        Eeprom::Write { file, dry_run } => {
            let settings = Settings::load(file)?;
            put(|present| onto(present, &settings), *dry_run, context)
        }
        Eeprom::Restore { file, dry_run } => {
            let image = image::load(file)?;
            if !file::is_image(&image.0) {
                let what = "it holds no EEPROM image; write a .toml with `robot eeprom write`";
                return Err(Error::content(file, None, what));
            }
            put(|_| image, *dry_run, context)
        }
        Eeprom::Migrate { dry_run } => {
            let settings = Settings::migrated(&get(None, context)?)?;
            put(|_| settings.platform_written(), *dry_run, context)
        }
        Eeprom::Check { file } => check(file.as_deref(), context),
        Eeprom::Dump { image, hex } => dump(image.as_deref(), *hex, context),
        Eeprom::Diff { file, image } => {
            let loaded = load(file)?;
            let present = get(image.as_deref(), context)?;
            let wanted = if is_settings(file) {
                onto(&present, &Settings::from_image(&loaded)?)
            } else {
                loaded
            };
            let difference = Difference::between(&present, &wanted);
            let output = context.output;
            output.result(&difference, || difference.summary())?;
            if difference.bytes > 0 {
                return Ok(Exit::Differs);
            }
            Ok(())
        }
        Eeprom::Backup { file, force } => {
            check_overwrite(file, *force)?;
            let present = get(None, context)?;
            let text = format!("{} bytes saved in {}", present.0.len(), file.display());
            save(file, &present.0, text, context.output)
        }
    }?;
    Ok(Exit::Ok)
}

/// Writes a file that may replace one, and reports it.
fn save(file: &Path, bytes: &[u8], text: String, output: Output) -> Result<(), Error> {
    file::save(file, Kind::Any, bytes)?;
    output.result(&json!({ "bytes": bytes.len() }), || text)
}

fn is_settings(file: &Path) -> bool {
    let ending = file.extension().unwrap_or_default();
    ending.eq_ignore_ascii_case("toml")
}

/// An image with these settings; what no table defines stays.
// Requirement: WIRE-eeprom-9
fn onto(present: &Image, settings: &Settings) -> Image {
    let mut image = present.clone();
    image.copy_defined(settings.image());
    image
}

/// An image from a file: a configuration file by its ending, else bytes.
fn load(file: &Path) -> Result<Image, Error> {
    if is_settings(file) {
        return Ok(Settings::load(file)?.image().clone());
    }
    image::load(file)
}

/// An image from a file, or from the robot.
fn get(file: Option<&Path>, context: Context<'_>) -> Result<Image, Error> {
    match file {
        Some(file) => load(file),
        None => context.with_board(|connection| eeprom::read(&mut connection.io)),
    }
}

/// An existing file is overwritten only by force.
fn check_overwrite(file: &Path, force: bool) -> Result<(), Error> {
    if file.exists() && !force {
        let what = format!("{} exists; give --force to overwrite it", file.display());
        return Err(Error::Usage(what));
    }
    Ok(())
}

fn init(file: Option<&Path>, force: bool, output: Output) -> Result<(), Error> {
    let text = render(&Settings::sample()?);
    let Some(file) = file else {
        return output.result(&json!({ "toml": text }), || text.clone());
    };
    check_overwrite(file, force)?;
    let next = format!(
        "{} written; edit it, then run `robot eeprom write {0}`",
        file.display()
    );
    save(file, text.as_bytes(), next, output)
}

fn check(file: Option<&Path>, context: Context<'_>) -> Result<(), Error> {
    let settings = Settings::from_image(&get(file, context)?);
    let settings = settings.map_err(|error| error.of_image(context.image_file(file)))?;
    let platform_page = settings.platform_page();
    let (mode, cells) = (settings.config().mode().name(), settings.config().cells());
    let checked = json!({ "mode": mode, "cells": cells, "platform_page": platform_page });
    context.output.result(&checked, || {
        let unwritten = "unwritten, the first board's figures apply";
        let page = if platform_page { "written" } else { unwritten };
        format!("accepted: mode {mode}, {cells} cells; page 0x03 is {page}")
    })
}

fn dump(file: Option<&Path>, hex: bool, context: Context<'_>) -> Result<(), Error> {
    let (image, output) = (&get(file, context)?, context.output);
    if hex {
        let digits = image.0.iter().fold(String::new(), |mut digits, byte| {
            let _ = write!(digits, "{byte:02X}");
            digits
        });
        let bytes = json!({ "bytes": image.0.len(), "hex": digits });
        return output.result(&bytes, || image::hex(image));
    }
    let settings = Settings::migrated(image);
    let settings = settings.map_err(|error| error.of_image(context.image_file(file)))?;
    let toml = render(&settings);
    let dumped = json!({
        "platform_page": settings.platform_page(),
        "settings": settings.json(),
        "toml": toml,
    });
    output.result(&dumped, || toml.clone())
}

/// What writing an image changes.
#[derive(Debug, Serialize)]
struct Difference {
    /// Bytes that differ.
    bytes: usize,
    /// Bursts that write them.
    bursts: usize,
    /// The fields that change, where both images are accepted.
    fields: Option<Vec<Change>>,
    /// Why one of them is not.
    rejected: Option<String>,
    /// First and last address of each stretch that differs.
    stretches: Vec<(usize, usize)>,
}

impl Difference {
    fn between(present: &Image, wanted: &Image) -> Self {
        let stretches = image::differences(present, wanted).into_iter();
        let stretches = stretches.map(|stretch| (stretch.start, stretch.end - 1));
        let stretches: Vec<_> = stretches.collect();
        let decoded = [present, wanted].map(|image| {
            Settings::migrated(image).map_err(|error| match error {
                Error::Rejected(_, what) => what,
                error => error.to_string(),
            })
        });
        let (fields, rejected) = match decoded {
            [Ok(before), Ok(after)] => (Some(changes(&before, &after)), None),
            [Err(_), _] if *present == Image::BLANK => (None, Some("the EEPROM is blank".into())),
            [Err(why), _] => (None, Some(format!("what is there now: {why}"))),
            [_, Err(why)] => (None, Some(format!("what is to be written: {why}"))),
        };
        Self {
            bytes: stretches.iter().map(|(first, last)| last - first + 1).sum(),
            bursts: chip::bursts(present, wanted).len(),
            fields,
            rejected,
            stretches,
        }
    }

    fn summary(&self) -> String {
        if self.bytes == 0 {
            return "no difference".into();
        }
        let mut lines = Vec::from_iter(self.rejected.clone());
        for change in self.fields.iter().flatten() {
            lines.push(format!(
                "0x{:04X} {}: {} -> {}",
                change.address, change.key, change.before, change.after
            ));
        }
        if self.fields.as_ref().is_none_or(Vec::is_empty) {
            let stretch = |(first, last): &_| format!("0x{first:04X} to 0x{last:04X} differ");
            lines.extend(self.stretches.iter().map(stretch));
        }
        lines.push(format!(
            "{} bytes differ, {} bursts",
            self.bytes, self.bursts
        ));
        lines.join("\n")
    }
}

/// Shows the difference, then writes it.
fn put(
    wanted: impl FnOnce(&Image) -> Image,
    dry_run: bool,
    context: Context<'_>,
) -> Result<(), Error> {
    let output = context.output;
    context.with_board(|Connection { io, journal, .. }| {
        let present = eeprom::read(io)?;
        let wanted = &wanted(&present);
        if dry_run {
            let difference = Difference::between(&present, wanted);
            let done = json!({ "difference": difference, "written": false, "ready_ms": null });
            return output.result(&done, || difference.summary());
        }
        let timeout = context.board.ready_timeout;
        let outcome = eeprom::program(io, wanted, timeout, Some(journal), |step| {
            if let Progress::Before(before) = step {
                output.message(&Difference::between(before, wanted).summary());
            }
            output.progress(step);
        });
        output.live("");
        let programmed = outcome?;
        let difference = Difference::between(&programmed.before, wanted);
        let (bytes, ready_ms) = (programmed.bytes, programmed.ready_ms);
        let done = json!({ "difference": difference, "written": true, "ready_ms": ready_ms });
        output.result(&done, || {
            format!("{bytes} bytes written and read back; protected; STM ready {ready_ms} ms after its reset")
        })
    })
}

// Requirement: WIRE-eeprom-9
#[test]
fn settings_leave_undefined_bytes_alone() {
    let mut present = Image::FIRST_BOARD;
    (present.0[0x20], present.0[0x3FF]) = (0x42, 0x43);
    let settings = Settings::sample().unwrap();
    let image = onto(&present, &settings);
    assert!(changes(&settings, &Settings::from_image(&image).unwrap()).is_empty());
    assert_eq!((image.0[0x20], image.0[0x3FF]), (0x42, 0x43));
}
