//! The steps that every calibration has: confirm, drive, measure, write.

use crate::cli::connection::{Connection, Context};
use crate::cli::measuring_args::{MeasureWith, Measuring};
use crate::cli::tune::apply;
use crate::cli::{monitor, prompt};
use fw_core::eeprom::Image;
use host_link::board_io::BoardIo;
use host_link::eeprom;
use host_link::error::Error;
use host_link::pose::Pose;
use host_link::settings::{Change, Settings};
use pilot::calibrate::distance::Measured;
use pilot::calibrate::run;
use pilot::calibrate::wheel_geometry::WheelGeometry;
use pilot::calibrate::wheel_path::WheelPath;

/// How the runs of a calibration are confirmed, driven and measured.
#[derive(Clone, Copy)]
pub struct Measurement<'a> {
    measuring: &'a Measuring,
    pub context: Context<'a>,
}

impl<'a> Measurement<'a> {
    /// # Errors
    /// [`Error::Usage`] for options that exclude each other.
    pub fn new(measuring: &'a Measuring, context: Context<'a>) -> Result<Self, Error> {
        let truth = measuring.measure_with == MeasureWith::Truth;
        if truth && !context.board.virtual_board.chosen {
            let what =
                "--measure-with truth needs --virtual: only the virtual robot knows the truth";
            return Err(Error::Usage(what.into()));
        }
        if !truth && measuring.noise != 0.0 {
            let what = "--noise needs --measure-with truth: a tape measure has its own noise";
            return Err(Error::Usage(what.into()));
        }
        Ok(Self { measuring, context })
    }

    /// The robot's image, and its wheels.
    pub fn begin(&self, connection: &mut Connection) -> Result<(Image, WheelGeometry), Error> {
        if self.measuring.measure_with == MeasureWith::Truth && connection.truth.is_none() {
            let what = "--measure-with truth needs the simulation in this process: end the server";
            return Err(Error::Usage(what.into()));
        }
        let io = &mut connection.io;
        let original = eeprom::read(io)?;
        let before = WheelGeometry::from_config(Settings::from_image(&original)?.config());
        Ok((original, before))
    }

    /// Asks before anything moves.
    pub fn confirm(&self, io: &BoardIo, what: &str) -> Result<(), Error> {
        prompt::confirm_drive(
            self.measuring.consent.yes,
            what,
            &io.interrupt,
            self.context.output,
        )
    }

    /// Drives the way-points in a new session: minutes may have passed since the last frame.
    pub fn drive(&self, io: &mut BoardIo, waypoints: &[Pose]) -> Result<WheelPath, Error> {
        let output = self.context.output;
        let mut session = self.context.open_session(io)?;
        let path = run::run(&mut session, waypoints, |reached| {
            if waypoints.len() > 1 {
                output.live(&format!("corner {reached} of {}", waypoints.len()));
            }
        });
        output.live("");
        let path = path?;
        output.message(&monitor::line(session.snapshot()));
        Ok(path)
    }

    /// Back to the marks.
    pub fn put_back(&self, connection: &mut Connection) -> Result<(), Error> {
        if let (MeasureWith::Truth, Some(truth)) =
            (self.measuring.measure_with, &mut connection.truth)
        {
            truth.put_back();
            return Ok(());
        }
        prompt::ask(
            "Lift the robot back on its marks, facing as at the start, and press Enter.",
            &connection.io.interrupt,
            self.context.output,
            |_| Ok(()),
        )
    }

    /// Where it stands, seen from the marks.
    pub fn measure(
        &self,
        connection: &mut Connection,
        question: &str,
        parse: impl Fn(&str) -> Result<Measured, String>,
    ) -> Result<Measured, Error> {
        if let (MeasureWith::Truth, Some(truth)) =
            (self.measuring.measure_with, &mut connection.truth)
        {
            return Ok(truth.measure(self.measuring.noise).into());
        }
        let interrupt = &connection.io.interrupt;
        prompt::ask(question, interrupt, self.context.output, parse)
    }

    /// Shows the wheels' figures, asks, and writes them. An original image gets its page 0x03.
    pub fn write(
        &self,
        connection: &mut Connection,
        original: &Image,
        wheels: &WheelGeometry,
    ) -> Result<(Vec<Change>, bool), Error> {
        let wanted = Settings::from_image(original)?.with(&wheels.values())?;
        let images = (original, wanted.image());
        apply(connection, images, &self.measuring.consent, self.context)
    }

    /// What was found by driving once more; none without an answer.
    pub fn verified<T>(&self, found: Result<T, Error>) -> Result<Option<T>, Error> {
        match found {
            Err(Error::Usage(why)) => {
                self.context.output.warn(&format!("not verified: {why}"));
                Ok(None)
            }
            found => found.map(Some),
        }
    }

    /// Whether to drive once more.
    pub fn verifies(&self, io: &BoardIo) -> Result<bool, Error> {
        let question = "Put the robot back on its marks. Drive once more to verify?";
        let output = self.context.output;
        Ok(!self.measuring.no_verify
            && (self.measuring.consent.yes || prompt::confirm(question, &io.interrupt, output)?))
    }
}
