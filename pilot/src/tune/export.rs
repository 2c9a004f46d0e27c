//! The files of a tuning: the samples as CSV; input, response and prediction as a picture.

use super::Axis;
use super::drive_model::{DriveModel, Step, replay};
use super::gains::Response;
use crate::tune::samples::Sample;
use host_link::error::Error;
use host_link::file::{self, Kind};
use mapper::line_plot::{Curve, Panel, draw};
use std::fmt::Write;
use std::path::{Path, PathBuf};

/// The samples as a table: seconds, percent, degrees or millimetres.
pub fn csv(axis: Axis, samples: &[Sample]) -> String {
    let mut text = format!("seconds,percent,{}\n", axis.unit());
    for sample in samples {
        let _ = writeln!(
            text,
            "{:.2},{:.2},{:.3}",
            sample.seconds(),
            sample.percent,
            sample.value
        );
    }
    text
}

/// Whether both files can be written, before the wheels turn.
///
/// # Errors
/// [`Error::Unwritable`].
pub fn check(stem: &Path) -> Result<(), Error> {
    file::check(&file::with_suffix(stem, ".csv"), Kind::Samples)?;
    file::check(&file::with_suffix(stem, ".png"), Kind::Png)
}

/// Writes `stem`.csv.
///
/// # Errors
/// [`Error::Unwritable`].
pub fn save_csv(stem: &Path, axis: Axis, samples: &[Sample]) -> Result<PathBuf, Error> {
    let path = file::with_suffix(stem, ".csv");
    file::save(&path, Kind::Samples, csv(axis, samples).as_bytes())?;
    Ok(path)
}

/// Writes `stem`.png: duty; measured and modelled position; the predicted response with the
/// present gains and with those proposed.
///
/// # Errors
/// [`Error::Unwritable`].
pub fn save_picture(
    stem: &Path,
    axis: Axis,
    samples: &[Sample],
    fitted: Option<(&DriveModel, &[Step], &Response, &Response)>,
) -> Result<PathBuf, Error> {
    let curve = |name: &str, points: Vec<(f64, f64)>| Curve {
        name: name.into(),
        points,
    };
    let of = |value: fn(&Sample) -> f64| {
        let points = samples
            .iter()
            .map(|sample| (sample.seconds(), value(sample)));
        points.collect()
    };
    let unit = axis.unit().to_uppercase();
    let mut position = vec![curve("MEASURED", of(|sample| sample.value))];
    if let Some((model, steps, ..)) = fitted {
        position.push(curve("MODEL", replay(model, steps)));
    }
    let mut panels = vec![
        Panel {
            title: "INPUT PERCENT OVER SECONDS".into(),
            curves: vec![curve("DUTY", of(|sample| sample.percent))],
        },
        Panel {
            title: format!("RESPONSE {unit} OVER SECONDS"),
            curves: position,
        },
    ];
    if let Some((.., before, after)) = fitted {
        panels.push(Panel {
            title: format!("PREDICTED {unit} OVER SECONDS"),
            curves: vec![
                curve("PROPOSED GAINS", after.curve.clone()),
                curve("PRESENT GAINS", before.curve.clone()),
            ],
        });
    }
    let path = file::with_suffix(stem, ".png");
    let png = draw(&panels);
    let png = png.map_err(|cause| Error::unwritable(&path, &cause))?;
    file::save(&path, Kind::Png, &png)?;
    Ok(path)
}
