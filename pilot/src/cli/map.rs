//! `map`: driven or from a recording.

use super::args::Map;
use super::connection::Context;
use super::drive;
use host_link::error::Error;
use host_link::settings::Settings;
use host_link::snapshot::Snapshot;
use host_link::statistics::LinkStatistics;
use pilot::mapping::{self, Files, Mapping, RangeSample};
use pilot::recording::{self, Recorder};
use pilot::waypoints;
use serde_json::json;

/// Runs the command.
pub fn run(map: &Map, context: Context<'_>) -> Result<(), Error> {
    let cell_mm = f64::from(map.cell);
    match (&map.tour, &map.from) {
        (_, Some(file)) => {
            let samples = recording::load(file)?;
            recording::check_extent(&samples, cell_mm, file)?;
            let mut mapping = Mapping::new(mapping::mapper_config(
                Settings::first_board()?.config(),
                cell_mm,
            ));
            for sample in &samples {
                mapping.add(sample);
            }
            save(map, &mapping, None, context)
        }
        (Some(file), None) => {
            let waypoints = waypoints::load(file)?;
            Files::check(&map.out)?;
            context.with_board(|connection| {
                let mut session = context.open_session(&mut connection.io)?;
                let config = mapping::mapper_config(session.config(), cell_mm);
                let mut mapping = Mapping::new(config);
                let mut recorder = map.record.as_deref().map(Recorder::create).transpose()?;
                let mut written = Ok(());
                let watch = |snapshot: &Snapshot| {
                    if let Some(sample) = RangeSample::of(snapshot) {
                        mapping.add(&sample);
                        record(&mut recorder, &mut written, &sample, snapshot);
                    }
                };
                let (_, outcome) =
                    drive::follow(&mut session, &waypoints, &map.criteria, context, watch);
                // What was measured before an error is worth keeping, whatever the error was.
                let end_us = session.now_us();
                if let Some(recorder) = recorder {
                    written = written.and(recorder.finish(end_us, mapping.mapper().grid()));
                }
                let saved = save(map, &mapping, Some(session.statistics()), context);
                outcome.and(saved).and(written)
            })
        }
        (None, None) => Err(Error::Usage(
            "map needs a tour to drive or --from a recording".into(),
        )),
    }
}

/// Adds a report to a recording, if there is one. The first failure is kept: the drive goes on without.
pub fn record(
    recorder: &mut Option<Recorder>,
    outcome: &mut Result<(), Error>,
    sample: &RangeSample,
    snapshot: &Snapshot,
) {
    if let (Some(recorder), true) = (recorder, outcome.is_ok()) {
        let added = recorder.add(sample);
        *outcome = added.and_then(|()| recorder.add_state(snapshot));
    }
}

fn save(
    map: &Map,
    mapping: &Mapping,
    link: Option<LinkStatistics>,
    context: Context<'_>,
) -> Result<(), Error> {
    let files = mapping.save_map(&map.out)?;
    let (reports, path_mm) = (mapping.trace().len(), mapping.path_mm());
    let done = json!({ "files": files, "reports": reports, "path_mm": path_mm, "link": link });
    context.output.result(&done, || {
        format!(
            "map of {reports} reports over {:.2} m in {}, {}, {}",
            path_mm / 1000.0,
            files.png.display(),
            files.pgm.display(),
            files.yaml.display()
        )
    })
}
