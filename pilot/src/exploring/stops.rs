//! What stops a drive by a plan.

use crate::mapping::RangeSample;
use fw_core::types::Faults;
use fw_core::wire::{Report, State};
use host_link::error::Error;
use host_link::snapshot;
use navigator::StopReason;

/// Faults that a plan answers by another way.
const STALLS: Faults = Faults::LEFT_STALLED
    .union(Faults::RIGHT_STALLED)
    .union(Faults::LEFT_REVERSED)
    .union(Faults::RIGHT_REVERSED)
    .union(Faults::ENCODER_JUMP);

/// A slip that is latched again so soon after it was cleared has not ended, s.
const SLIP_LASTS_S: f64 = 1.0;

/// What is nearer than a sensor can see makes it silent as long as the robot stands there, s.
const SILENCE_S: f64 = 3.0;

/// Reads stops out of the reported state and faults.
#[derive(Default)]
pub(super) struct Stops {
    /// So far.
    pub count: u32,
    stopped: bool,
    slipped_s: Option<f64>,
    /// Reports in a row that show a slip: what clears it is on its way in the second one, whenever that comes.
    slips: u32,
    /// Since when a rangefinder does not answer.
    silent_s: Option<f64>,
}

impl Stops {
    /// The stop that a report shows, if it does.
    ///
    /// # Errors
    /// [`Error::Fault`] and [`Error::SilentRangefinder`] where driving on needs a person.
    pub fn update(
        &mut self,
        report: &Report,
        sample: &RangeSample,
        time_s: f64,
    ) -> Result<Option<StopReason>, Error> {
        if let Some(name) = snapshot::silent_names(sample.silent).next() {
            if time_s - *self.silent_s.get_or_insert(time_s) > SILENCE_S {
                return Err(Error::SilentRangefinder(name));
            }
        } else {
            self.silent_s = None;
        }
        let is_held = matches!(report.state, State::Stopped | State::Faulted);
        let beyond_plans = (report.faults & Faults::BLOCKING).difference(STALLS);
        if is_held && !beyond_plans.is_empty() {
            return Err(Error::Fault {
                state: report.state.name(),
                faults: snapshot::fault_names(report.faults).join(", "),
            });
        }
        let slips = report.faults.intersects(Faults::SLIP);
        let since_s = self.slipped_s.map_or(f64::INFINITY, |then| time_s - then);
        let again = self.slips != 1 && (0.1..SLIP_LASTS_S).contains(&since_s);
        self.slips = if slips { self.slips + 1 } else { 0 };
        self.slipped_s = slips.then_some(time_s).or(self.slipped_s);
        let reason = if !is_held {
            // A wheel that slips over a sill is what the localiser is for.
            (slips && again).then_some(StopReason::Slip)
        } else if report.faults.intersects(STALLS) {
            Some(StopReason::Stall)
        } else {
            Some(StopReason::Link)
        };
        let stopped = std::mem::replace(&mut self.stopped, reason.is_some());
        self.count += u32::from(self.stopped && !stopped);
        Ok(reason)
    }
}
