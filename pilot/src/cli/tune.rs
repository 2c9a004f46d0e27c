//! `tune …`.

use super::args::{Consent, Robot, StepArgs, Tune};
use super::connection::{self, Job};
use super::output::Output;
use super::prompt;
use fw_core::eeprom::{Gains, Image};
use host_link::board_io::{Machine, Wires};
use host_link::eeprom::{self, image, journal::Journal};
use host_link::error::{Error, Exit};
use host_link::session::Session;
use host_link::settings::{changes, Change, Settings};
use pilot::tune::{battery, drive_model, export, gains, step_response, temporary_mode, Axis};
use serde::Serialize;
use std::path::{Path, PathBuf};

/// Runs one of the commands.
pub fn run(command: &Tune, robot: &Robot, output: Output) -> Result<Exit, Error> {
    let kept = Kept::of(robot);
    let steps = |axis, arguments| Steps {
        axis,
        arguments,
        kept: &kept,
        robot,
        output,
    };
    match command {
        Tune::Rotate(arguments) => connection::with_machine(robot, steps(Axis::Rotate, arguments)),
        Tune::Move(arguments) => connection::with_machine(robot, steps(Axis::Move, arguments)),
        Tune::Battery {
            cell,
            volts,
            consent,
        } => connection::with_machine(
            robot,
            Tap {
                cell: *cell,
                volts: *volts,
                consent,
                kept: &kept,
                robot,
                output,
            },
        ),
        Tune::Rollback => connection::with_machine(
            robot,
            Rollback {
                kept: &kept,
                robot,
                output,
            },
        ),
    }
}

/// What is kept on disk.
pub(super) struct Kept {
    /// The EEPROM before its mode was changed for a measurement; exists only meanwhile.
    mode: Journal,
    /// The EEPROM before the latest tuning or calibration was written.
    before: PathBuf,
}

impl Kept {
    pub fn of(robot: &Robot) -> Self {
        Self {
            mode: Journal::new(connection::kept(robot, connection::TUNE_MODE)),
            before: connection::kept(robot, "tune.before"),
        }
    }

    /// Restores what a killed measurement left.
    pub fn repair<W: Wires>(&self, machine: &mut Machine<W>, timeout: u32) -> Result<bool, Error> {
        temporary_mode::repair(machine, &self.mode, timeout)
    }
}

/// Shows what would change, asks, and writes it. Returns the changes and whether they were written.
pub(super) fn apply<W: Wires>(
    machine: &mut Machine<W>,
    (before, wanted): (&Image, &Image),
    (yes, dry_run): (bool, bool),
    (kept, journal): (&Kept, &Journal),
    timeout: u32,
    output: Output,
) -> Result<(Vec<Change>, bool), Error> {
    let changes = changes(
        &Settings::from_image(before)?,
        &Settings::from_image(wanted)?,
    );
    tell(&changes, output);
    let question = "Write this to the EEPROM?";
    if changes.is_empty()
        || dry_run
        || !(yes || prompt::whether(question, &machine.interrupt, output)?)
    {
        return Ok((changes, false));
    }
    machine.interrupt.check()?;
    image::save(&kept.before, before)?;
    eeprom::program(machine, wanted, timeout, Some(journal), |_| {})?;
    Ok((changes, true))
}

/// Before and after.
fn tell(changes: &[Change], output: Output) {
    for change in changes {
        output.remark(&format!(
            "0x{:04X} {}: {} -> {}",
            change.address, change.key, change.before, change.after
        ));
    }
}

/// How it ended, for people.
pub(super) fn ending(changes: &[Change], written: bool) -> &'static str {
    match (changes.is_empty(), written) {
        (true, _) => "nothing to change",
        (false, true) => "written; `host-link tune rollback` brings back the old ones",
        (false, false) => "not written",
    }
}

struct Steps<'a> {
    axis: Axis,
    arguments: &'a StepArgs,
    kept: &'a Kept,
    robot: &'a Robot,
    output: Output,
}

/// Gains as numbers.
#[derive(Serialize)]
struct Figures {
    p: f64,
    i: f64,
    d: f64,
    anti_windup: f64,
}

impl From<&Gains> for Figures {
    fn from(gains: &Gains) -> Self {
        let number = |double: fw_core::binary64::Binary64| f64::from_bits(double.0);
        Self {
            p: number(gains.p),
            i: number(gains.i),
            d: number(gains.d),
            anti_windup: number(gains.anti_windup),
        }
    }
}

#[derive(Serialize)]
struct Tuned {
    axis: Axis,
    model: drive_model::Model,
    samples: usize,
    lost: u32,
    present: Figures,
    proposed: Figures,
    predicted_present: gains::Response,
    predicted: gains::Response,
    csv: PathBuf,
    picture: PathBuf,
    changes: Vec<Change>,
    written: bool,
}

impl Job for Steps<'_> {
    type Result = Exit;

    fn run<W: Wires>(self, machine: &mut Machine<W>, journal: &Journal) -> Result<Exit, Error> {
        let (axis, output, arguments) = (self.axis, self.output, self.arguments);
        let timeout = self.robot.ready_timeout;
        let plan = arguments.plan(axis);
        plan.check()?;
        self.kept.repair(machine, timeout)?;
        let original = eeprom::read(machine)?;
        let mut config = Settings::from_image(&original)?.config;
        let rate = self.robot.rate.max(SLOWEST_HZ);
        let recorder = temporary_mode::with(
            machine,
            &original,
            axis.mode(),
            Some(&self.kept.mode),
            timeout,
            |machine, config| {
                let mut session = Session::with_config(machine, config, rate);
                step_response::run(&mut session, &plan, |percent| {
                    output.remark(&format!("step of {percent} %"));
                })
            },
        )?;
        let samples = recorder.samples();
        let stem = arguments.stem(axis);
        let csv = export::save_csv(&stem, axis, samples)?;
        let steps = drive_model::steps(samples);
        let model = drive_model::fit(&steps).map_err(|what| {
            // The picture shows what went wrong; that it could not be drawn matters less.
            let _ = export::save_picture(&stem, axis, samples, None);
            Error::Tuning(format!("{what} (see {})", csv.display()))
        })?;
        let present = *axis.gains(&mut config);
        let proposed = gains::propose(
            &model,
            arguments.damping.unwrap_or(axis.damping()),
            &present,
        );
        let before = gains::predict(axis, &model, &present);
        let after = gains::predict(axis, &model, &proposed);
        let picture = export::save_picture(
            &stem,
            axis,
            samples,
            Some((&model, &steps, &before, &after)),
        )?;
        output.remark(&told(axis, &model, &before, &after));
        let wanted =
            temporary_mode::with_config(&original, |config| *axis.gains(config) = proposed)?;
        let (changes, written) = apply(
            machine,
            (&original, &wanted),
            (arguments.consent.yes, arguments.consent.dry_run),
            (self.kept, journal),
            timeout,
            output,
        )?;
        let done = Tuned {
            axis,
            model,
            samples: samples.len(),
            lost: recorder.lost(),
            present: (&present).into(),
            proposed: (&proposed).into(),
            predicted_present: before,
            predicted: after,
            csv,
            picture,
            changes,
            written,
        };
        output.result(&done, || {
            format!(
                "gains {}; {} samples ({} lost) in {}, {}",
                ending(&done.changes, written),
                done.samples,
                done.lost,
                done.csv.display(),
                done.picture.display()
            )
        });
        Ok(Exit::Ok)
    }
}

/// Slower frames would let the stop deadline end a step.
const SLOWEST_HZ: u32 = 20;

fn told(
    axis: Axis,
    model: &drive_model::Model,
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

struct Tap<'a> {
    cell: u8,
    volts: f64,
    consent: &'a Consent,
    kept: &'a Kept,
    robot: &'a Robot,
    output: Output,
}

impl Job for Tap<'_> {
    type Result = Exit;

    fn run<W: Wires>(self, machine: &mut Machine<W>, journal: &Journal) -> Result<Exit, Error> {
        #[derive(Serialize)]
        struct Done {
            cell: u8,
            volts: f64,
            upper_ohm: u32,
            changes: Vec<Change>,
            written: bool,
        }
        let timeout = self.robot.ready_timeout;
        self.kept.repair(machine, timeout)?;
        let original = eeprom::read(machine)?;
        let mut session = Session::open(machine, self.robot.rate, timeout)?;
        let upper_ohm = battery::ask(&mut session, self.cell, self.volts)?;
        let wanted = temporary_mode::with_config(&original, |config| {
            if let Some(tap) = config.dividers.get_mut(usize::from(self.cell) - 1) {
                tap.upper = upper_ohm;
            }
        })?;
        let (changes, written) = apply(
            machine,
            (&original, &wanted),
            (self.consent.yes, self.consent.dry_run),
            (self.kept, journal),
            timeout,
            self.output,
        )?;
        let done = Done {
            cell: self.cell,
            volts: self.volts,
            upper_ohm,
            changes,
            written,
        };
        self.output.result(&done, || {
            format!(
                "tap {}: {upper_ohm} ohm {}",
                self.cell,
                ending(&done.changes, written)
            )
        });
        Ok(Exit::Ok)
    }
}

/// Both `rollback` commands: tuning and calibration share one memory, of the latest.
pub(super) struct Rollback<'a> {
    pub kept: &'a Kept,
    pub robot: &'a Robot,
    pub output: Output,
}

impl Job for Rollback<'_> {
    type Result = Exit;

    fn run<W: Wires>(self, machine: &mut Machine<W>, journal: &Journal) -> Result<Exit, Error> {
        #[derive(Serialize)]
        struct Done {
            repaired_mode: bool,
            rolled_back: bool,
        }
        let timeout = self.robot.ready_timeout;
        let before: &Path = &self.kept.before;
        let repaired_mode = self.kept.repair(machine, timeout)?;
        let rolled_back = !repaired_mode && before.exists();
        if rolled_back {
            let image = image::load(before)?;
            let present = eeprom::read(machine)?;
            if let Ok(present) = Settings::from_image(&present) {
                tell(
                    &changes(&present, &Settings::from_image(&image)?),
                    self.output,
                );
            }
            eeprom::program(machine, &image, timeout, Some(journal), |_| {})?;
            std::fs::remove_file(before).map_err(|cause| Error::unwritable(before, &cause))?;
        } else if !repaired_mode {
            let what = format!(
                "no tuning or calibration to roll back: there is no {}",
                before.display()
            );
            return Err(Error::Usage(what));
        }
        let done = Done {
            repaired_mode,
            rolled_back,
        };
        self.output.result(&done, || {
            if repaired_mode {
                "the EEPROM's mode that a killed tuning left is restored".into()
            } else {
                "the EEPROM is as it was before the latest tuning or calibration".into()
            }
        });
        Ok(Exit::Ok)
    }
}
