//! Curves over time, drawn: panels one above the other, each with its scale.

use crate::canvas::{Canvas, Colour};
use crate::map_plot::PictureError;

/// One curve.
#[derive(Clone, Debug, PartialEq)]
pub struct Curve {
    /// Its name in the legend: capitals, digits, space, point and hyphen are drawn.
    pub name: String,
    /// Its points; one that is not finite lifts the pen.
    pub points: Vec<(f64, f64)>,
}

/// One panel.
#[derive(Clone, Debug, PartialEq)]
pub struct Panel {
    /// What its axes are.
    pub title: String,
    /// Its curves, the first undermost.
    pub curves: Vec<Curve>,
}

const PAPER: Colour = [252, 252, 250];
const INK: Colour = [40, 44, 52];
const GRID: Colour = [224, 226, 230];
const COLOURS: [Colour; 4] = [[20, 110, 220], [214, 96, 40], [30, 160, 70], [150, 60, 170]];

const WIDTH: usize = 1200;
const HEIGHT: usize = 300;
const LEFT: usize = 100;
const RIGHT: usize = 30;
const TOP: usize = 44;
const BOTTOM: usize = 36;

/// The panels as a PNG file.
///
/// # Errors
/// If the encoder refuses.
pub fn draw(panels: &[Panel]) -> Result<Vec<u8>, PictureError> {
    let height = (TOP + HEIGHT + BOTTOM) * panels.len().max(1);
    let mut canvas = Canvas::new(LEFT + WIDTH + RIGHT, height, PAPER);
    for (index, panel) in panels.iter().enumerate() {
        draw_panel(&mut canvas, index * (TOP + HEIGHT + BOTTOM) + TOP, panel);
    }
    canvas.png().map_err(PictureError)
}

/// One axis: from `low` to `high`, with a mark every `step`.
struct Axis {
    low: f64,
    high: f64,
    step: f64,
}

impl Axis {
    /// Around all finite values, with some five marks.
    fn around(values: impl Iterator<Item = f64>) -> Self {
        let (mut low, mut high) = (f64::MAX, f64::MIN);
        for value in values.filter(|value| value.is_finite()) {
            (low, high) = (low.min(value), high.max(value));
        }
        if low > high {
            (low, high) = (0.0, 1.0);
        }
        let span = (high - low).max(1e-9);
        let decade = 10f64.powf((span / 5.0).log10().floor());
        let step = [1.0, 2.0, 5.0, 10.0]
            .into_iter()
            .map(|part| part * decade)
            .find(|step| span / step <= 6.0)
            .unwrap_or(10.0 * decade);
        Self {
            low: (low / step).floor() * step,
            high: ((high / step).floor() + 1.0) * step,
            step,
        }
    }

    /// 0 at the low end, 1 at the high end.
    fn part(&self, value: f64) -> f64 {
        (value - self.low) / (self.high - self.low)
    }

    fn marks(&self) -> impl Iterator<Item = f64> + '_ {
        (0..=12_u8)
            .map(|index| self.low + f64::from(index) * self.step)
            .take_while(|mark| *mark <= self.high + self.step * 0.01)
    }

    fn label(&self, mark: f64) -> String {
        let decimals = usize::from(self.step < 1.0) + usize::from(self.step < 0.1);
        format!("{:.decimals$}", mark + 0.0)
    }
}

#[allow(
    clippy::cast_precision_loss,
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss
)] // pixels
fn draw_panel(canvas: &mut Canvas, top: usize, panel: &Panel) {
    let points = || panel.curves.iter().flat_map(|curve| &curve.points);
    let across = Axis::around(points().map(|point| point.0));
    let up = Axis::around(points().map(|point| point.1));
    let pixel = |(x, y): (f64, f64)| {
        (
            LEFT as f64 + across.part(x) * WIDTH as f64,
            top as f64 + (1.0 - up.part(y)) * HEIGHT as f64,
        )
    };
    for mark in across.marks() {
        let x = pixel((mark, up.low)).0 as usize;
        canvas.fill(x, top, 1, HEIGHT, GRID);
        canvas.text(
            x.saturating_sub(8),
            top + HEIGHT + 10,
            3,
            &across.label(mark),
            INK,
        );
    }
    for mark in up.marks() {
        let y = pixel((across.low, mark)).1 as usize;
        canvas.fill(LEFT, y, WIDTH, 1, GRID);
        canvas.text(6, y.saturating_sub(7), 3, &up.label(mark), INK);
    }
    canvas.fill(LEFT, top, 2, HEIGHT, INK);
    canvas.fill(LEFT, top + HEIGHT, WIDTH, 2, INK);
    let mut x = LEFT + canvas.text(LEFT, top - 26, 3, &panel.title, INK) + 40;
    for (curve, colour) in panel.curves.iter().zip(COLOURS.into_iter().cycle()) {
        canvas.fill(x, top - 22, 26, 6, colour);
        x += 34 + canvas.text(x + 34, top - 26, 3, &curve.name, INK) + 24;
        let mut last: Option<(f64, f64)> = None;
        for &point in &curve.points {
            let here = (point.0.is_finite() && point.1.is_finite()).then(|| pixel(point));
            if let (Some(from), Some(to)) = (last, here) {
                canvas.line(from, to, 2.5, colour);
            }
            last = here;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn marks_are_round_and_reach_around_every_value() {
        let axis = Axis::around([-3.0, 96.5, f64::NAN].into_iter());
        assert!(axis.low <= -3.0 && axis.high >= 96.5);
        let labels: Vec<String> = axis.marks().map(|mark| axis.label(mark)).collect();
        assert_eq!(labels, ["-20", "0", "20", "40", "60", "80", "100"]);
    }

    #[test]
    fn nothing_and_a_single_value_are_still_pictures() {
        let one = Panel {
            title: "T".into(),
            curves: vec![Curve {
                name: "A".into(),
                points: vec![(1.0, 1.0), (f64::NAN, 0.0), (2.0, 1.0)],
            }],
        };
        for panels in [&[][..], &[one]] {
            assert!(draw(panels).unwrap().starts_with(b"\x89PNG"));
        }
    }
}
