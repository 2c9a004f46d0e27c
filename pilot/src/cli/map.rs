//! `map`: driven or from a recording.

use super::args::{Map, Robot};
use super::connection::{self, Job};
use super::output::Output;
use fw_core::eeprom::first_board;
use host_link::board_io::{Machine, Wires};
use host_link::drive;
use host_link::eeprom::journal::Journal;
use host_link::error::{Error, Exit};
use host_link::pose::Place;
use host_link::session::Session;
use host_link::statistics::Statistics;
use pilot::mapping::{self, Files, Look, Survey};
use pilot::waypoints;
use serde::Serialize;

/// Runs the command.
pub fn run(map: &Map, robot: &Robot, output: Output) -> Result<Exit, Error> {
    match (&map.tour, &map.from) {
        (_, Some(recording)) => {
            let looks = mapping::load_recording(recording)?;
            let mut survey =
                Survey::new(mapping::mapper_config(&first_board(), f64::from(map.cell)));
            for look in &looks {
                survey.take(look);
            }
            finish(map, &survey, None, output)
        }
        (Some(way), None) => {
            let way = waypoints::load(way)?;
            connection::with_machine(
                robot,
                Drive {
                    way,
                    map,
                    robot,
                    output,
                },
            )
        }
        (None, None) => Err(Error::Usage(
            "map needs a tour to drive or --from a recording".into(),
        )),
    }
}

struct Drive<'a> {
    way: Vec<Place>,
    map: &'a Map,
    robot: &'a Robot,
    output: Output,
}

impl Job for Drive<'_> {
    type Result = Exit;

    fn run<W: Wires>(self, machine: &mut Machine<W>, _: &Journal) -> Result<Exit, Error> {
        let mut session = Session::open(machine, self.robot.rate, self.robot.ready_timeout)?;
        let output = self.output;
        let config = mapping::mapper_config(session.config(), f64::from(self.map.cell));
        let mut survey = Survey::new(config);
        let outcome = drive::tour(
            &mut session,
            &self.way,
            &self.map.terms.terms(),
            |_, snapshot| {
                if let Some(look) = Look::of(snapshot) {
                    survey.take(&look);
                }
                output.live(&super::monitor::line(snapshot));
            },
            |index, arrival| {
                output.live("");
                let told = super::drive::told(arrival);
                output.remark(&format!("{} of {}: {told}", index + 1, self.way.len()));
            },
        );
        if outcome.is_err() {
            output.end_live();
        }
        // What was seen before an error is worth keeping, whatever the error was.
        let drawn = finish(self.map, &survey, Some(session.statistics()), output);
        outcome.and(drawn)
    }
}

#[derive(Serialize)]
struct Done {
    files: Files,
    reports: usize,
    path_mm: f64,
    link: Option<Statistics>,
}

fn finish(
    map: &Map,
    survey: &Survey,
    link: Option<Statistics>,
    output: Output,
) -> Result<Exit, Error> {
    if let Some(recording) = &map.record {
        survey.save_recording(recording)?;
    }
    let files = survey.save_map(&map.out)?;
    let (reports, path_mm) = (survey.trace().len(), survey.path_mm());
    let done = Done {
        files,
        reports,
        path_mm,
        link,
    };
    output.result(&done, || {
        format!(
            "map of {reports} reports over {:.2} m in {}, {}, {}",
            path_mm / 1000.0,
            done.files.png.display(),
            done.files.pgm.display(),
            done.files.yaml.display()
        )
    });
    Ok(Exit::Ok)
}
