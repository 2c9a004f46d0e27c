//! What every calibration does: asks, drives, measures, writes.

use crate::cli::args::{measured, MeasureWith, Measuring, Robot};
use crate::cli::output::Output;
use crate::cli::tune::{apply, Kept};
use crate::cli::{monitor, prompt};
use fw_core::eeprom::{encode, Image};
use host_link::board_io::{Machine, Wires};
use host_link::drive::Terms;
use host_link::eeprom::{self, journal::Journal};
use host_link::error::Error;
use host_link::pose::Place;
use host_link::session::Session;
use host_link::settings::{decode, Change};
use pilot::calibrate::distance::Measured;
use pilot::calibrate::run;
use pilot::calibrate::wheel_geometry::Geometry;
use pilot::calibrate::wheel_path::Path;

/// The robot on the floor, and who measures there.
#[derive(Clone, Copy)]
pub struct Floor<'a> {
    measuring: &'a Measuring,
    pub robot: &'a Robot,
    pub output: Output,
    kept: &'a Kept,
}

impl<'a> Floor<'a> {
    pub fn new(
        measuring: &'a Measuring,
        robot: &'a Robot,
        output: Output,
        kept: &'a Kept,
    ) -> Result<Self, Error> {
        let truth = measuring.measure_with == MeasureWith::Truth;
        if truth && !robot.board.chosen {
            return Err(Error::Usage(
                "--measure-with truth: only the virtual robot has somebody who sees the truth"
                    .into(),
            ));
        }
        if !truth && measuring.noise != 0.0 {
            return Err(Error::Usage(
                "--noise: a person's tape has its own; it is for --measure-with truth".into(),
            ));
        }
        Ok(Self {
            measuring,
            robot,
            output,
            kept,
        })
    }

    /// Mends what an earlier run left half done; the robot's image, and its figures.
    pub fn begin<W: Wires>(&self, machine: &mut Machine<W>) -> Result<(Image, Geometry), Error> {
        self.kept.repair(machine, self.robot.ready_timeout)?;
        let original = eeprom::read(machine)?;
        let before = Geometry::of(&decode(&original)?);
        Ok((original, before))
    }

    /// Asks before anything moves.
    pub fn agreed<W: Wires>(&self, machine: &Machine<W>, what: &str) -> Result<(), Error> {
        let question = format!("{what} Keep hands off the wheels, Ctrl-C stops it. Drive?");
        if self.measuring.yes || prompt::whether(&question, &machine.interrupt, self.output)? {
            return Ok(());
        }
        Err(Error::Usage("nothing was driven: nobody agreed".into()))
    }

    /// Drives `way`, from a new conversation: minutes may have passed since the last frame.
    pub fn drive<W: Wires>(&self, machine: &mut Machine<W>, way: &[Place]) -> Result<Path, Error> {
        let mut session = Session::open(machine, self.robot.rate, self.robot.ready_timeout)?;
        let path = run::run(&mut session, way, &Terms::default(), |reached| {
            if way.len() > 1 {
                self.output
                    .live(&format!("corner {reached} of {}", way.len()));
            }
        });
        self.output.live("");
        let path = path?;
        self.output.remark(&monitor::line(session.snapshot()));
        Ok(path)
    }

    /// Back to the marks.
    pub fn put_back<W: Wires>(&self, machine: &mut Machine<W>) -> Result<(), Error> {
        match (self.measuring.measure_with, &mut machine.tape) {
            (MeasureWith::Truth, Some(tape)) => {
                tape.put_back();
                Ok(())
            }
            _ => prompt::until(
                "Lift the robot back on its marks, facing as at the start, and press Enter.",
                &machine.interrupt,
                self.output,
                |_| Ok(()),
            ),
        }
    }

    /// Where it stands, seen from the marks.
    pub fn measure<W: Wires>(
        &self,
        machine: &mut Machine<W>,
        question: &str,
    ) -> Result<Measured, Error> {
        match (self.measuring.measure_with, &mut machine.tape) {
            (MeasureWith::Truth, Some(tape)) => {
                let spot = tape.measure(self.measuring.noise);
                Ok(Measured {
                    ahead_mm: spot.ahead_mm,
                    left_mm: Some(spot.left_mm),
                })
            }
            _ => prompt::until(question, &machine.interrupt, self.output, measured),
        }
    }

    /// The image with other figures; an original one gets its page 0x03 with them.
    fn image(original: &Image, figures: &Geometry) -> Result<Image, Error> {
        let mut config = decode(original)?;
        figures.put(&mut config);
        let mut wanted = *original;
        encode(&config, &mut wanted);
        decode(&wanted)?;
        Ok(wanted)
    }

    /// Shows the figures, asks, and writes them.
    pub fn write<W: Wires>(
        &self,
        machine: &mut Machine<W>,
        original: &Image,
        figures: &Geometry,
        journal: &Journal,
    ) -> Result<(Vec<Change>, bool), Error> {
        apply(
            machine,
            (original, &Self::image(original, figures)?),
            (self.measuring.yes, self.measuring.dry_run),
            (self.kept, journal),
            self.robot.ready_timeout,
            self.output,
        )
    }

    /// Whether to drive once more.
    pub fn verifies<W: Wires>(&self, machine: &Machine<W>) -> Result<bool, Error> {
        let question = "Put the robot back on its marks. Drive once more to see how good it is?";
        Ok(!self.measuring.no_verify
            && (self.measuring.yes || prompt::whether(question, &machine.interrupt, self.output)?))
    }
}
