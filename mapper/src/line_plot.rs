//! Curves over time as a PNG file: panels one above the other, each with its own scale.

use plotters::prelude::*;

use crate::PlotError;
use crate::png_canvas::{Area, Drawn, FONT, INK, TEXT_PX, legend, png};

/// One curve.
#[derive(Clone, Debug, PartialEq)]
pub struct Curve {
    /// Its name in the legend.
    pub name: String,
    /// Its points (x, y); one that is not finite interrupts the line.
    pub points: Vec<(f64, f64)>,
}

/// One panel.
#[derive(Clone, Debug, PartialEq)]
pub struct Panel {
    /// What its axes show.
    pub title: String,
    /// Its curves; later ones are drawn over earlier ones.
    pub curves: Vec<Curve>,
}

const COLOURS: [RGBColor; 4] = [
    RGBColor(20, 110, 220),
    RGBColor(214, 96, 40),
    RGBColor(30, 160, 70),
    RGBColor(150, 60, 170),
];
const WIDTH: u32 = 1300;
const PANEL_HEIGHT: u32 = 380;
const HEAD_PX: u32 = 36;

/// The panels as a PNG file.
///
/// # Errors
/// If the plot cannot be drawn or encoded.
pub fn draw(panels: &[Panel]) -> Result<Vec<u8>, PlotError> {
    let rows = panels.len().max(1);
    let height = PANEL_HEIGHT * u32::try_from(rows).unwrap_or(1);
    png(WIDTH, height, |area| {
        let areas = area.split_evenly((rows, 1));
        panels
            .iter()
            .zip(&areas)
            .try_for_each(|(panel, area)| draw_panel(area, panel))
    })
}

fn draw_panel(area: &Area<'_>, panel: &Panel) -> Drawn {
    let (head, body) = area.split_vertically(HEAD_PX);
    let style = TextStyle::from((FONT, TEXT_PX + 2)).color(&INK);
    head.draw(&Text::new(panel.title.clone(), (70, 12), style.clone()))?;
    let title_px = i32::try_from(area.estimate_text_size(&panel.title, &style)?.0)?;
    let names = panel.curves.iter().map(|curve| curve.name.as_str());
    let entries: Vec<_> = names.zip(COLOURS.into_iter().cycle()).collect();
    legend(&head, 70 + title_px + 40, 13, &entries)?;

    let points = || panel.curves.iter().flat_map(|curve| &curve.points);
    let mut chart = ChartBuilder::on(&body)
        .margin_right(24)
        .x_label_area_size(36)
        .y_label_area_size(70)
        .build_cartesian_2d(
            range(points().map(|point| point.0)),
            range(points().map(|point| point.1)),
        )?;
    chart
        .configure_mesh()
        .label_style(TextStyle::from((FONT, TEXT_PX)).color(&INK))
        .axis_style(INK)
        .light_line_style(TRANSPARENT)
        .draw()?;
    for (curve, colour) in panel.curves.iter().zip(COLOURS.into_iter().cycle()) {
        let finite = |point: &(f64, f64)| point.0.is_finite() && point.1.is_finite();
        for line in curve.points.split(|point| !finite(point)) {
            chart.draw_series(LineSeries::new(
                line.iter().copied(),
                colour.stroke_width(2),
            ))?;
        }
    }
    Ok(())
}

/// The range of all finite values with a margin, never empty.
fn range(values: impl Iterator<Item = f64>) -> std::ops::Range<f64> {
    let (low, high) = values
        .filter(|value| value.is_finite())
        .map(|value| (value, value))
        .reduce(|(low, high), (value, _)| (low.min(value), high.max(value)))
        .unwrap_or((0.0, 1.0));
    let margin = ((high - low) * 0.03).max(1e-6);
    low - margin..high + margin
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::png_canvas::decode;

    #[test]
    fn empty_and_degenerate_panels_are_drawn() {
        let panel = Panel {
            title: "speed, mm/s".into(),
            curves: vec![Curve {
                name: "measured".into(),
                points: vec![(1.0, 1.0), (f64::NAN, 0.0), (2.0, 1.0), (3.0, 1.0)],
            }],
        };
        let (_, height, _) = decode(&draw(&[]).unwrap());
        assert_eq!(height, PANEL_HEIGHT);
        let (_, height, _) = decode(&draw(&[panel.clone(), panel.clone()]).unwrap());
        assert_eq!(height, 2 * PANEL_HEIGHT);
        let (_, _, pixels) = decode(&draw(&[panel]).unwrap());
        let curves = &pixels[(3 * WIDTH * HEAD_PX) as usize..];
        for RGBColor(r, g, b) in [COLOURS[0], INK] {
            assert!(curves.chunks(3).any(|pixel| pixel == [r, g, b]));
        }
    }
}
