//! `explore`: the robot finds its own way and maps the room.

use super::args::{Explore, Goto};
use super::connection::{Connection, Context};
use super::output::Output;
use super::{calibrate::explored, map, prompt};
use fw_core::eeprom::fields;
use fw_core::wire::{Field, Mode};
use host_link::eeprom;
use host_link::error::Error;
use host_link::session::Session;
use host_link::settings::{self, Settings};
use host_link::statistics::LinkStatistics;
use mapper::{Cell, Grid, Localiser, Point, PoseEstimate};
use navigator::{Explorer, GoTo, Outcome};
use pilot::calibrate::explored::Explored;
use pilot::exploring::{self, Drive, Localisation, Plan, Step};
use pilot::mapping;
use pilot::serve::control::CELL_MM;
use serde_json::json;
use std::ops::ControlFlow;
use std::path::Path;
use std::time::{Duration, Instant};

/// Frames between two live lines: counting the map's cells takes time.
const LIVE_FRAMES: u32 = 20;
/// Time between two lines where there is no terminal.
const PROGRESS: Duration = Duration::from_secs(10);
/// Nearer than this ends a way to the point itself, mm; a way that ends farther off led beside it.
const ENDS_MM: f64 = 60.0;

/// Explores and leaves the map.
pub fn run(explore: &Explore, context: Context<'_>) -> Result<(), Error> {
    map::check(&explore.out, explore.record.as_deref(), context)?;
    explored::check(context)?;
    let body_mm = context.board.body_radius;
    context.with_board(|connection| {
        ensure_mode(connection, explore.yes, context)?;
        let mut session = context.open_session(&mut connection.io)?;
        let config = session.config();
        let mut localisation = Localisation::new(config, body_mm, CELL_MM);
        let mut plan = Explorer::new(navigator::Config {
            time_limit_s: explore.timeout,
            ..exploring::navigator_config(config, body_mm)?
        });
        // Once nothing refuses the drive: it replaces files.
        session.resume()?;
        let mut recorder = map::recorder(explore.record.as_deref(), body_mm, &mut session)?;
        let driven = drive(
            &mut session,
            &mut localisation,
            &mut plan,
            context,
            |step| {
                if let Some(recorder) = &mut recorder {
                    recorder.record(&step.sample, step.snapshot);
                }
            },
        );
        let learned = Explored::new(session.config(), &localisation.localiser.calibration());
        let end_us = session.now_us();
        let written = recorder.map_or(Ok(()), |recorder| {
            let (grid, odom) = (localisation.localiser.grid(), localisation.odom_in_map());
            recorder.finish(end_us, grid, odom)
        });
        // What was seen before an error is worth keeping, whatever the error was.
        let link = session.statistics();
        let driving = driven.as_ref().ok();
        // An error before something was learned leaves what another run has.
        let is_worth = driving.is_some() || learned.wheels().is_ok();
        let kept = if is_worth {
            explored::keep(&learned, context)
        } else {
            Ok(())
        };
        let out = map::stem(&explore.out, driving.is_none());
        let saved = save(&out, &localisation, (driving, learned), link, context);
        let saved = context.output.both(saved, kept);
        let saved = context.output.both(saved, written);
        let complete =
            driven.and_then(|driven| driven.ensure_complete("the room is not wholly explored"));
        context.output.both(complete, saved)
    })
}

/// Covariance of a start that a person gives: 50 mm and 5°.
const GIVEN_START: [[f64; 3]; 3] = [[2500.0, 0.0, 0.0], [0.0, 2500.0, 0.0], [0.0, 0.0, 0.0076]];

/// Goes to a point of a saved map.
pub fn go_to(goto: &Goto, map: &Path, context: Context<'_>) -> Result<(), Error> {
    let grid = mapping::load_map(map)?;
    let (target, body_mm) = (Point::new(goto.x, goto.y), context.board.body_radius);
    if !GoTo::has_floor(&grid, target) {
        let (map, x, y) = (map.display(), goto.x, goto.y);
        let why = format!("{map} shows no free floor at x {x} mm, y {y} mm: choose a point on it");
        return Err(Error::Usage(why));
    }
    let start = goto.start.map(|start| PoseEstimate {
        pose: mapping::mapper_pose(start),
        covariance: GIVEN_START,
    });
    context.with_board(|connection| {
        ensure_mode(connection, goto.yes, context)?;
        let mut session = context.open_session(&mut connection.io)?;
        let config = session.config();
        let settings = exploring::localiser_config(config, body_mm, grid.cell_mm());
        let mut localiser = Localiser::on_map(settings, grid, start);
        if !localiser.is_located() {
            context.output.message("looking for where the robot stands on the map");
            let show = live(context.output);
            let located = exploring::locate(&mut session, &mut localiser, body_mm, show);
            context.output.end_live();
            located?.ensure_complete("the robot is not found on the map")?;
            if !localiser.is_located() {
                let why = "what is around fits the map nowhere or at several places";
                return Err(Error::Usage(format!("{why}: give --start X,Y,ROT")));
            }
        }
        let config = session.config();
        let mut localisation = Localisation::with(localiser, config, body_mm, CELL_MM);
        let mut plan = GoTo::new(exploring::navigator_config(config, body_mm)?, target);
        let driven = drive(&mut session, &mut localisation, &mut plan, context, |_| ())?;
        driven.ensure_complete("the target is not reached")?;
        let pose = localisation.localiser.estimate().pose;
        let (x_mm, y_mm, seconds) = (pose.x_mm, pose.y_mm, driven.seconds);
        let off_mm = pose.position().distance_mm(target);
        let beside = ", as near as the body can stand";
        let near = if off_mm > ENDS_MM { beside } else { "" };
        let arrival = json!({ "x_mm": x_mm, "y_mm": y_mm, "off_mm": off_mm, "seconds": seconds });
        context.output.result(&arrival, || {
            format!(
                "arrived at x {x_mm:.0} mm, y {y_mm:.0} mm of the map after {seconds:.1} s ({off_mm:.0} mm \
                 from the target{near})"
            )
        })
    })
}

/// Drives by a plan with a live line; `watch` gets every report.
fn drive(
    session: &mut Session<'_>,
    localisation: &mut Localisation,
    plan: &mut impl Plan,
    context: Context<'_>,
    mut watch: impl FnMut(&Step<'_>),
) -> Result<Drive, Error> {
    let mut show = live(context.output);
    let driven = exploring::drive(session, localisation, plan, |step| {
        show(step);
        watch(step);
        ControlFlow::Continue(())
    });
    context.output.end_live();
    driven
}

/// Shows a line now and then.
fn live(output: Output) -> impl FnMut(&Step<'_>) {
    let (mut frames, mut shown) = (0, Instant::now());
    move |step| {
        frames += 1;
        if output.is_live() && frames % LIVE_FRAMES == 0 {
            output.live(&line(step));
        } else if !output.is_live() && shown.elapsed() > PROGRESS {
            shown = Instant::now();
            output.message(&line(step));
        }
    }
}

fn line(step: &Step<'_>) -> String {
    let PoseEstimate { pose, .. } = step.estimate;
    format!(
        "x {:6.0} mm  y {:6.0} mm  {:4.0}°  free {:5.1} m²  targets {}",
        pose.x_mm,
        pose.y_mm,
        pose.heading_rad.to_degrees(),
        free_m2(step.grid),
        step.targets
    )
}

/// Area of the map that is free, m².
#[allow(clippy::cast_precision_loss)] // far below 2^53
fn free_m2(grid: &Grid) -> f64 {
    let is_free = |&(column, row): &_| grid.cell(column, row) == Cell::Free;
    grid.cells().filter(is_free).count() as f64 * grid.cell_mm().powi(2) / 1e6
}

/// Makes both ends run Guarded Velocity: with `--yes`, or where a person agrees, writes it to the EEPROM
/// with the gyro on and resets the STM.
// Requirement: DOC-5.2-2
pub fn ensure_mode(
    connection: &mut Connection,
    yes: bool,
    context: Context<'_>,
) -> Result<(), Error> {
    let Connection { io, journal, .. } = connection;
    let image = eeprom::read(io)?;
    let config = settings::decode(&image)?;
    pilot::drive::check_rate(context.board.rate, &config)?;
    let mode = config.mode();
    if mode.has(Field::Velocity) {
        if !config.gyro() {
            context.output.warn(
                "the EEPROM holds gyro = false: without the gyroscope pose and map are as good as the \
                 wheels' grip",
            );
        }
        return Ok(());
    }
    let wanted = Mode::GuardedVelocity;
    let question = format!(
        "The EEPROM holds the mode {}; this command drives in {}. Write it, with gyro = 1, and reset the STM?",
        mode.name(),
        wanted.name()
    );
    if !yes && !prompt::confirm(&question, &io.interrupt, context.output)? {
        return Err(Error::WrongMode(mode.name(), "velocity to drive at"));
    }
    let wanted = [(fields::MODE, wanted.code().into()), (fields::GYRO, 1)];
    let wanted = Settings::from_image(&image)?.with(&wanted)?;
    let (timeout, output) = (context.board.ready_timeout, context.output);
    eeprom::program(io, wanted.image(), timeout, Some(journal), |step| {
        output.progress(step);
    })?;
    output.live("");
    output.message(&format!(
        "mode {} -> Guarded Velocity, gyro = 1",
        mode.name()
    ));
    Ok(())
}

fn save(
    out: &Path,
    localisation: &Localisation,
    (drive, learned): (Option<&Drive>, Explored),
    link: LinkStatistics,
    context: Context<'_>,
) -> Result<(), Error> {
    let [files, raw_files] = localisation.save_maps(out)?;
    let (path_mm, free_m2) = (
        localisation.path_mm(),
        free_m2(localisation.localiser.grid()),
    );
    let outcome = drive.map(|drive| outcome_name(drive.outcome));
    let seconds = drive.map(|drive| drive.seconds);
    let stops = drive.map(|drive| drive.stops);
    let done = json!({
        "files": files, "raw_files": raw_files, "outcome": outcome, "seconds": seconds, "stops": stops,
        "free_m2": free_m2, "path_mm": path_mm, "learned": learned, "link": link,
    });
    context.output.message(&format!(
        "{}; `robot calibrate from-explore` writes the wheels' figures",
        learned.summary()
    ));
    let ended = outcome.zip(seconds).map(|(outcome, seconds)| {
        let minutes = seconds / 60.0;
        format!("{outcome} after {minutes:.1} min: ")
    });
    context.output.result(&done, || {
        format!(
            "{}map of {free_m2:.1} m² over {:.1} m of way in {}, {}, {}; by odometry alone in {}",
            ended.unwrap_or_default(),
            path_mm / 1000.0,
            files.png.display(),
            files.pgm.display(),
            files.yaml.display(),
            raw_files.png.display()
        )
    })
}

/// An outcome's word.
const fn outcome_name(outcome: Outcome) -> &'static str {
    match outcome {
        Outcome::Complete => "complete",
        Outcome::TimeLimit => "time-limit",
        Outcome::Recalled => "recalled",
        Outcome::Unreachable => "unreachable",
    }
}
