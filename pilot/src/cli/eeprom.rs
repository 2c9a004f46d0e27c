//! `eeprom …`.

use super::args::{Eeprom, Robot};
use super::connection::{self, Job};
use super::output::Output;
use fw_core::eeprom::{first_board, Image};
use host_link::board_io::{Machine, Wires};
use host_link::eeprom::{self, chip, image, journal::Journal, Step};
use host_link::error::{Error, Exit};
use host_link::settings::{changes, render, Change, Settings};
use serde::Serialize;
use std::fmt::Write;
use std::path::Path;

/// Runs one of the commands.
pub fn run(command: &Eeprom, robot: &Robot, output: Output) -> Result<Exit, Error> {
    match command {
        Eeprom::Init { file, force } => init(file.as_deref(), *force, output),
        Eeprom::Write { file, dry_run } => {
            let wanted = Settings::load(file)?.image();
            put(&wanted, *dry_run, robot, output)
        }
        Eeprom::Restore { file, dry_run } => {
            let wanted = image::load(file)?;
            put(&wanted, *dry_run, robot, output)
        }
        Eeprom::Migrate { dry_run } => {
            let present = get(None, robot)?;
            let Settings { config, .. } = Settings::from_image(&present)?;
            put(
                &Settings {
                    config,
                    platform_page: true,
                }
                .image(),
                *dry_run,
                robot,
                output,
            )
        }
        Eeprom::Check { file } => {
            let image = get(file.as_deref(), robot)?;
            check(&image, output)
        }
        Eeprom::Dump { image, hex } => {
            let image = get(image.as_deref(), robot)?;
            dump(&image, *hex, output)
        }
        Eeprom::Diff { file, image } => {
            let wanted = load(file)?;
            let present = get(image.as_deref(), robot)?;
            let difference = Difference::between(&present, &wanted);
            output.result(&difference, || difference.told());
            Ok(if difference.bytes == 0 {
                Exit::Ok
            } else {
                Exit::Differs
            })
        }
        Eeprom::Backup { file, force } => {
            spare(file, *force)?;
            let present = get(None, robot)?;
            image::save(file, &present)?;
            output.result(
                &Saved {
                    bytes: present.len(),
                },
                || format!("{} bytes saved in {}", present.len(), file.display()),
            );
            Ok(Exit::Ok)
        }
    }
}

#[derive(Serialize)]
struct Saved {
    bytes: usize,
}

/// An image from a file: a configuration file by its ending, else bytes.
fn load(file: &Path) -> Result<Image, Error> {
    if file
        .extension()
        .is_some_and(|ending| ending.eq_ignore_ascii_case("toml"))
    {
        Ok(Settings::load(file)?.image())
    } else {
        image::load(file)
    }
}

/// An image from a file, or from the robot.
fn get(file: Option<&Path>, robot: &Robot) -> Result<Image, Error> {
    struct Read;
    impl Job for Read {
        type Result = Image;
        fn run<W: Wires>(self, machine: &mut Machine<W>, _: &Journal) -> Result<Image, Error> {
            eeprom::read(machine)
        }
    }
    match file {
        Some(file) => load(file),
        None => connection::with_machine(robot, Read),
    }
}

/// Refuses to overwrite a file.
fn spare(file: &Path, force: bool) -> Result<(), Error> {
    if file.exists() && !force {
        let what = format!("{} exists; give --force to overwrite it", file.display());
        return Err(Error::Usage(what));
    }
    Ok(())
}

fn init(file: Option<&Path>, force: bool, output: Output) -> Result<Exit, Error> {
    let text = render(&Settings {
        config: first_board(),
        platform_page: true,
    });
    let Some(file) = file else {
        output.result(&Text { toml: &text }, || text.clone());
        return Ok(Exit::Ok);
    };
    spare(file, force)?;
    image::save(file, text.as_bytes())?;
    output.result(&Saved { bytes: text.len() }, || {
        format!(
            "{} written; edit it, then run `host-link eeprom write {0}`",
            file.display()
        )
    });
    Ok(Exit::Ok)
}

fn check(image: &Image, output: Output) -> Result<Exit, Error> {
    #[derive(Serialize)]
    struct Checked {
        mode: &'static str,
        cells: u8,
        platform_page: bool,
    }
    let Settings {
        config,
        platform_page,
    } = Settings::from_image(image)?;
    let checked = Checked {
        mode: config.mode.name(),
        cells: config.cells,
        platform_page,
    };
    output.result(&checked, || {
        let page = if platform_page {
            "written"
        } else {
            "unwritten, the first board's figures apply"
        };
        format!(
            "accepted: mode {}, {} cells; page 0x03 is {page}",
            config.mode.name(),
            config.cells
        )
    });
    Ok(Exit::Ok)
}

/// A configuration file's text.
#[derive(Serialize)]
struct Text<'a> {
    toml: &'a str,
}

fn dump(image: &Image, hex: bool, output: Output) -> Result<Exit, Error> {
    #[derive(Serialize)]
    struct Bytes {
        bytes: usize,
        hex: String,
    }
    #[derive(Serialize)]
    struct Dumped<'a> {
        platform_page: bool,
        settings: serde_json::Value,
        #[serde(flatten)]
        text: Text<'a>,
    }
    if hex {
        let bytes = Bytes {
            bytes: image.len(),
            hex: image.iter().fold(String::new(), |mut hex, byte| {
                let _ = write!(hex, "{byte:02X}");
                hex
            }),
        };
        output.result(&bytes, || image::hex(image));
        return Ok(Exit::Ok);
    }
    let settings = Settings::from_image(image)?;
    let text = render(&settings);
    let dumped = Dumped {
        platform_page: settings.platform_page,
        settings: settings.json(),
        text: Text { toml: &text },
    };
    output.result(&dumped, || text.clone());
    Ok(Exit::Ok)
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
        let stretches: Vec<_> = image::differences(present, wanted)
            .into_iter()
            .map(|stretch| (stretch.start, stretch.end - 1))
            .collect();
        let decoded = (Settings::from_image(present), Settings::from_image(wanted));
        let (fields, rejected) = match decoded {
            (Ok(before), Ok(after)) => (Some(changes(&before, &after)), None),
            (Err(why), _) => (None, Some(format!("what is there now: {why}"))),
            (_, Err(why)) => (None, Some(format!("what is to be written: {why}"))),
        };
        Self {
            bytes: stretches.iter().map(|(first, last)| last - first + 1).sum(),
            bursts: chip::bursts(present, wanted).len(),
            fields,
            rejected,
            stretches,
        }
    }

    fn told(&self) -> String {
        if self.bytes == 0 {
            return "no difference".into();
        }
        let mut lines = Vec::new();
        if let Some(why) = &self.rejected {
            lines.push(why.clone());
        }
        for change in self.fields.iter().flatten() {
            lines.push(format!(
                "0x{:04X} {}: {} -> {}",
                change.address, change.key, change.before, change.after
            ));
        }
        if self.fields.as_ref().is_none_or(Vec::is_empty) {
            for (first, last) in &self.stretches {
                lines.push(format!("0x{first:04X} to 0x{last:04X} differ"));
            }
        }
        lines.push(format!(
            "{} bytes differ, {} bursts",
            self.bytes, self.bursts
        ));
        lines.join("\n")
    }
}

/// Shows the difference, then writes it.
fn put(wanted: &Image, dry_run: bool, robot: &Robot, output: Output) -> Result<Exit, Error> {
    connection::with_machine(
        robot,
        Put {
            wanted,
            dry_run,
            robot,
            output,
        },
    )
}

struct Put<'a> {
    wanted: &'a Image,
    dry_run: bool,
    robot: &'a Robot,
    output: Output,
}

#[derive(Serialize)]
struct Outcome {
    difference: Difference,
    written: bool,
    ready_ms: Option<u32>,
}

impl Job for Put<'_> {
    type Result = Exit;

    fn run<W: Wires>(self, machine: &mut Machine<W>, journal: &Journal) -> Result<Exit, Error> {
        let output = self.output;
        if self.dry_run {
            let difference = Difference::between(&eeprom::read(machine)?, self.wanted);
            let done = Outcome {
                difference,
                written: false,
                ready_ms: None,
            };
            output.result(&done, || done.difference.told());
            return Ok(Exit::Ok);
        }
        let timeout = self.robot.ready_timeout;
        let outcome =
            eeprom::program(
                machine,
                self.wanted,
                timeout,
                Some(journal),
                |step| match step {
                    Step::Before(before) => {
                        output.remark(&Difference::between(before, self.wanted).told());
                    }
                    Step::Written { done, of } => output.live(&format!("{done} of {of} bytes")),
                },
            );
        output.live("");
        let programmed = outcome?;
        let difference = Difference::between(&programmed.before, self.wanted);
        let done = Outcome {
            difference,
            written: true,
            ready_ms: Some(programmed.ready_ms),
        };
        output.result(&done, || {
            format!(
                "{} bytes written and read back; protected; STM ready {} ms after its reset",
                programmed.bytes, programmed.ready_ms
            )
        });
        Ok(Exit::Ok)
    }
}
