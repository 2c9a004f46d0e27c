//! `map`: driven, from a recording or of a server.

use super::args::Map;
use super::connection::{Context, interrupt};
use super::drive;
use host_link::error::Error;
use host_link::file;
use host_link::session::Session;
use host_link::snapshot::Snapshot;
use host_link::statistics::LinkStatistics;
use pilot::client::View;
use pilot::exploring::{Localisation, raw_stem};
use pilot::mapping::{self, Files, RangeSample};
use pilot::recording::{self, Recorder};
use pilot::serve::protocol::{Message, Request};
use pilot::waypoints;
use serde_json::json;
use std::path::{Path, PathBuf};

/// Frames without a new part of the map after which it is whole.
const WHOLE: u32 = 40;

/// Runs the command.
pub fn run(map: &Map, context: Context<'_>) -> Result<(), Error> {
    if map.served {
        return served(map, context);
    }
    let (body_mm, cell_mm) = (context.board.body_radius, f64::from(map.cell));
    match (&map.tour, &map.from) {
        (_, Some(file)) => {
            let interrupt = interrupt()?;
            let (settings, samples, cut) = recording::load(file)?;
            if let Some(cut) = cut {
                context.output.warn(&cut);
            }
            let poses = samples.iter().map(|sample| sample.pose);
            mapping::check_extent(poses, cell_mm, file)?;
            let mut localisation = Localisation::new(settings.config(), body_mm, cell_mm);
            for sample in &samples {
                interrupt.check()?;
                localisation.observe(sample);
            }
            save(&map.out, &localisation, None, context)
        }
        (Some(file), None) => {
            let waypoints = waypoints::load(file)?;
            mapping::check_extent(waypoints.iter().copied(), cell_mm, file)?;
            check(&map.out, map.record.as_deref(), context)?;
            context.with_board(|connection| {
                let mut session = context.open_session(&mut connection.io)?;
                let mut samples = Vec::new();
                // Once nothing refuses the drive: it replaces files.
                pilot::drive::resume_to_pose(&mut session)?;
                let mut recorder = recorder(map.record.as_deref(), body_mm, &mut session)?;
                let watch = |snapshot: &Snapshot| {
                    if let Some(sample) = RangeSample::of(snapshot) {
                        if let Some(recorder) = &mut recorder {
                            recorder.record(&sample, snapshot);
                        }
                        // Localising takes longer than the stop deadline at times.
                        samples.push(sample);
                    }
                };
                let (_, outcome) =
                    drive::follow(&mut session, &waypoints, &map.criteria, context, watch);
                // What was measured before an error is worth keeping, whatever the error was.
                let end_us = session.now_us();
                let mut localisation = Localisation::new(session.config(), body_mm, cell_mm);
                for sample in &samples {
                    localisation.observe(sample);
                }
                let written = recorder.map_or(Ok(()), |recorder| {
                    let (grid, odom) = (localisation.localiser.grid(), localisation.odom_in_map());
                    recorder.finish(end_us, grid, odom)
                });
                let link = Some(session.statistics());
                let out = stem(&map.out, outcome.is_err());
                let saved = save(&out, &localisation, link, context);
                let saved = context.output.both(saved, written);
                context.output.both(outcome, saved)
            })
        }
        (None, None) => Err(Error::Usage(
            "map needs a tour to drive or --from a recording".into(),
        )),
    }
}

/// Saves the map of a server.
// Requirement: SERVE-map-1
fn served(map: &Map, context: Context<'_>) -> Result<(), Error> {
    let none = "--served saves the map of a running `robot serve`; none runs for this robot";
    let server = context.server()?;
    let mut client = server.ok_or_else(|| Error::Usage(none.into()))?;
    Files::check(&map.out)?;
    let interrupt = interrupt()?;
    // Without a frame there would be none to count.
    client.status()?;
    client.request(&Request::Watch { every: 1 })?;
    let (mut view, mut unchanged) = (View::default(), 0);
    while unchanged < WHOLE {
        interrupt.check()?;
        let Some(message) = client.message()? else {
            continue;
        };
        let known = view.tiles();
        view.take(&message);
        let is_frame = matches!(message, Message::Frame(_));
        unchanged = if view.tiles() > known {
            0
        } else {
            unchanged + u32::from(is_frame)
        };
    }
    if view.tiles() == 0 {
        let none = "the server has no map yet: its robot has not reported a pose with a range";
        return Err(Error::Usage(none.into()));
    }
    let files = mapping::save_map(&view.grid(), &[], &map.out)?;
    context.output.result(&json!({ "files": files }), || {
        let [png, pgm, yaml] = [&files.png, &files.pgm, &files.yaml].map(|file| file.display());
        format!("map of the server in {png}, {pgm}, {yaml}")
    })
}

/// Whether both maps can be written, and no file is written twice.
// Requirement: WIRE-program-1
pub fn check(out: &Path, record: Option<&Path>, context: Context<'_>) -> Result<(), Error> {
    let (raw, log) = (raw_stem(out), &context.board.virtual_board.uart_log);
    let maps = [out, &raw].map(Files::new).into_iter();
    let maps = maps.flat_map(|files| [files.png, files.pgm, files.yaml]);
    let others = [record, log.as_deref()].into_iter().flatten();
    let mut files: Vec<PathBuf> = maps.chain(others.map(Path::to_path_buf)).collect();
    files.sort();
    if let Some([twice, _]) = files.array_windows().find(|[one, next]| one == next) {
        return Err(Error::Usage(format!(
            "{} would be written twice; name another file with --out, --record or --uart-log",
            twice.display()
        )));
    }
    Files::check(out)?;
    Files::check(&raw)
}

/// The recording that is asked for.
pub fn recorder(
    path: Option<&Path>,
    body_mm: f64,
    session: &mut Session<'_>,
) -> Result<Option<Recorder>, Error> {
    path.map(|path| Recorder::of(session.io(), path, body_mm))
        .transpose()
}

/// Where a map goes: one whose drive an error has ended does not replace another.
pub fn stem(out: &Path, is_aborted: bool) -> PathBuf {
    let replaces = is_aborted && Files::new(out).pgm.exists();
    file::with_suffix(out, if replaces { "-aborted" } else { "" })
}

fn save(
    out: &Path,
    localisation: &Localisation,
    link: Option<LinkStatistics>,
    context: Context<'_>,
) -> Result<(), Error> {
    let [files, raw_files] = localisation.save_maps(out)?;
    let (reports, path_mm) = (localisation.trace.len(), localisation.path_mm());
    let done = json!({
        "files": files, "raw_files": raw_files, "reports": reports, "path_mm": path_mm, "link": link,
    });
    context.output.result(&done, || {
        format!(
            "map of {reports} reports over {:.2} m in {}, {}, {}; by odometry alone in {}",
            path_mm / 1000.0,
            files.png.display(),
            files.pgm.display(),
            files.yaml.display(),
            raw_files.png.display()
        )
    })
}
