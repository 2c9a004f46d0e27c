//! Step responses: constant duty for a bounded time and travel, rest in between, the log recorded. Every
//! end commands zero percent and sends no further frame, so that the stop deadline holds the motors.

use crate::drive::{MAX_UNANSWERED, StopOnDrop};
use crate::tune::samples::SampleRecorder;
use fw_core::eeprom::Config;
use host_link::error::Error;
use host_link::session::{CommandRequest, Session};

/// Which steps.
#[derive(Clone, Debug, PartialEq)]
pub struct StepPlan {
    /// Levels of duty, percent, 1 to 100; each in both directions.
    pub levels: Vec<f64>,
    /// Seconds of each step.
    pub hold_s: f64,
    /// Seconds at rest before each step.
    pub rest_s: f64,
    /// A step ends when it went this far, degrees or millimetres.
    pub travel: f64,
}

/// Longest time one step may take, seconds.
pub const LONGEST_S: f64 = 3.0;

/// Time-out of the log, microseconds: in the tuning modes it has a sample every 10 ms.
const LOG_TIMEOUT_US: u64 = 500_000;

/// Largest distance from the start of the steps, in multiples of the travel.
const MAX_STRAY: f64 = 2.0;

impl StepPlan {
    /// # Errors
    /// [`Error::Usage`] for fewer than two duties, or for one that does not turn both wheels.
    pub fn check(&self, config: &Config) -> Result<(), Error> {
        if self.levels.len() < 2 {
            let what = "--levels: accepted are two or more duties";
            return Err(Error::Usage(what.into()));
        }
        let dead = config.left().dead_zone.max(config.right().dead_zone);
        let dead = f64::from(dead.hundredths()) / 100.0;
        match self.levels.iter().find(|&&level| level <= dead) {
            Some(level) => Err(Error::Usage(format!(
                "--levels {level}: a wheel's dead zone is {dead} %; accepted are duties above it"
            ))),
            None => Ok(()),
        }
    }
}

/// Runs the steps and returns the record. `watch` gets each duty as its step begins.
///
/// # Errors
/// Those of [`Session::exchange`]; [`Error::Silent`] after a fifth of a second without a valid reply;
/// [`Error::Tuning`] without samples in the log or when the robot goes too far. On each of them, and on a panic, it
/// is stopped first.
pub fn run(
    session: &mut Session<'_>,
    plan: &StepPlan,
    mut watch: impl FnMut(f64),
) -> Result<SampleRecorder, Error> {
    let moving = StopOnDrop::new(session);
    let mut stepping = StepRunner {
        session: &mut *moving.session,
        recorder: SampleRecorder::default(),
        sampled_us: None,
        origin: None,
    };
    // Earlier lines of the log belong to no step.
    stepping.session.read_log()?;
    for level in &plan.levels {
        for percent in [*level, -level] {
            stepping.hold(0.0, plan.rest_s, plan.travel)?;
            watch(percent);
            stepping.hold(percent, plan.hold_s, plan.travel)?;
        }
    }
    stepping.hold(0.0, plan.rest_s, plan.travel)?;
    Ok(stepping.recorder)
}

/// What the steps share.
struct StepRunner<'s, 'm> {
    session: &'s mut Session<'m>,
    recorder: SampleRecorder,
    sampled_us: Option<u64>,
    origin: Option<f64>,
}

impl StepRunner<'_, '_> {
    /// `percent` for `seconds`, or until it went `travel` far.
    fn hold(&mut self, percent: f64, seconds: f64, travel: f64) -> Result<(), Error> {
        let begun_us = self.session.now_us();
        let mut from = None;
        loop {
            let measured = self.frame(percent)?;
            let now_us = self.session.now_us();
            let samples = self.recorder.samples().len();
            self.recorder.feed(&self.session.read_log()?);
            if self.recorder.samples().len() > samples {
                self.sampled_us = Some(now_us);
            } else if now_us.saturating_sub(*self.sampled_us.get_or_insert(now_us)) > LOG_TIMEOUT_US
            {
                return Err(Error::Tuning(
                    "no sample came from the STM's log; check its wire, the slide switch and --uart"
                        .into(),
                ));
            }
            if let Some(value) = measured {
                if (value - *self.origin.get_or_insert(value)).abs() > MAX_STRAY * travel {
                    return Err(Error::Tuning(format!(
                        "the robot is further than {}, {MAX_STRAY} times a step's travel, from where it began",
                        MAX_STRAY * travel
                    )));
                }
                if percent != 0.0 && (value - *from.get_or_insert(value)).abs() >= travel {
                    return Ok(());
                }
            }
            #[allow(clippy::cast_precision_loss)] // seconds
            if now_us.saturating_sub(begun_us) as f64 >= seconds * 1e6 {
                return Ok(());
            }
        }
    }

    /// One frame; the measurement if the reply was valid.
    fn frame(&mut self, percent: f64) -> Result<Option<f64>, Error> {
        let request = CommandRequest {
            percent,
            ..CommandRequest::default()
        };
        let report = self.session.exchange(&request)?;
        self.session.check_answered(MAX_UNANSWERED)?;
        Ok(report.and(self.session.snapshot().measurement))
    }
}
