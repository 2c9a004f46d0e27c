//! The map as a PNG file, alone or under the path driven.

use plotters::prelude::*;

use crate::png_canvas::{FONT, INK, TEXT_PX, legend, png};
use crate::{Cell, Grid, PlotError, Point, Pose2, Segment};

const OCCUPIED: RGBColor = RGBColor(28, 32, 40);
const FREE: RGBColor = RGBColor(252, 252, 250);
const UNKNOWN: RGBColor = RGBColor(205, 208, 212);
const WALL: RGBColor = RGBColor(214, 96, 40);
const ESTIMATE: RGBColor = RGBColor(20, 110, 220);
const TRUTH: RGBColor = RGBColor(30, 160, 70);
const START: RGBColor = RGBColor(190, 30, 90);

/// Most pixels per cell, and most of a side: fewer per cell in a large map.
const ZOOM: f64 = 5.0;
const SIDE_PX: f64 = 4000.0;
/// Most cells of a picture's side.
pub const MAX_SIDE_CELLS: u32 = 4000;
/// Room for title and legend above, the labels of the axes and the margin at the right, pixels.
const HEAD_PX: u32 = 88;
const LEGEND_PX: i32 = 36;
const LABELS_PX: u32 = 52;
const MARGIN_PX: u32 = 16;

/// The map as a PNG file: dark = occupied, white = free, grey in between; axes in metres.
///
/// # Errors
/// If the plot cannot be drawn or encoded.
pub fn map(grid: &Grid) -> Result<Vec<u8>, PlotError> {
    let names = [("occupied", OCCUPIED), ("free", FREE), ("unknown", UNKNOWN)];
    Layers {
        grid,
        walls: &[],
        paths: &[],
    }
    .draw("Map", &names)
}

/// The map under the estimated path, the true path and the true walls (all in the grid's frame), as
/// a PNG file. What is not known is given empty.
///
/// # Errors
/// If the plot cannot be drawn or encoded.
pub fn trajectory(
    grid: &Grid,
    estimate: &[Pose2],
    truth: &[Pose2],
    walls: &[Segment],
) -> Result<Vec<u8>, PlotError> {
    let given = !estimate.is_empty() || !truth.is_empty();
    let names: Vec<_> = [
        ("estimated path", ESTIMATE, !estimate.is_empty()),
        ("true path", TRUTH, !truth.is_empty()),
        ("true walls", WALL, !walls.is_empty()),
        ("start", START, given),
        ("occupied", OCCUPIED, true),
        ("free", FREE, true),
        ("unknown", UNKNOWN, true),
    ]
    .into_iter()
    .filter_map(|(name, colour, shown)| shown.then_some((name, colour)))
    .collect();
    Layers {
        grid,
        walls,
        paths: &[(truth, TRUTH, 5), (estimate, ESTIMATE, 2)],
    }
    .draw("Map and path", &names)
}

/// What is drawn, from the bottom to the top.
struct Layers<'a> {
    grid: &'a Grid,
    walls: &'a [Segment],
    /// Poses, colour and width in pixels.
    paths: &'a [(&'a [Pose2], RGBColor, u32)],
}

impl Layers<'_> {
    /// The lower left corner, and the columns and rows of all that is to be seen.
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)] // metres of room
    fn extent(&self) -> (Point, u32, u32) {
        let (grid, cell) = (self.grid, self.grid.cell_mm());
        let known = grid
            .cells()
            .filter(|&(column, row)| grid.cell(column, row) != Cell::Unknown)
            .map(|(column, row)| grid.middle(column, row));
        let walls = self.walls.iter().flat_map(|wall| [wall.from, wall.to]);
        let paths = self.paths.iter().flat_map(|path| path.0);
        let (low, high) = Point::bounds(known.chain(walls).chain(paths.map(Pose2::position)))
            .unwrap_or((Point::new(-500.0, -500.0), Point::new(500.0, 500.0)));
        let down = |mm: f64| ((mm / cell).floor() - 4.0) * cell;
        let corner = Point::new(down(low.x_mm), down(low.y_mm));
        let cells = |from: f64, to: f64| ((to - from) / cell) as u32 + 5;
        let columns = cells(corner.x_mm, high.x_mm);
        (corner, columns, cells(corner.y_mm, high.y_mm))
    }

    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)] // pixels
    fn draw(&self, title: &str, names: &[(&str, RGBColor)]) -> Result<Vec<u8>, PlotError> {
        let (grid, cell_m) = (self.grid, self.grid.cell_mm() / 1000.0);
        let (corner, columns, rows) = self.extent();
        let metres = |point: Point| (point.x_mm / 1000.0, point.y_mm / 1000.0);
        let side = columns.max(rows);
        if side > MAX_SIDE_CELLS {
            let what =
                format!("{columns} × {rows} cells: a picture has at most {MAX_SIDE_CELLS} a side");
            return Err(PlotError::new(what));
        }
        let zoom = ZOOM.min(SIDE_PX / f64::from(side));
        let pixels = |cells: u32| (f64::from(cells) * zoom) as u32;
        let (width_m, height_m) = (f64::from(columns) * cell_m, f64::from(rows) * cell_m);
        let title = format!(
            "{title}: {width_m:.1} m × {height_m:.1} m, cells of {} mm",
            grid.cell_mm()
        );
        let width = pixels(columns) + LABELS_PX + MARGIN_PX;
        let height = pixels(rows) + HEAD_PX + LABELS_PX + MARGIN_PX / 2;
        png(width.max(800), height, |area| {
            let text = TextStyle::from((FONT, TEXT_PX)).color(&INK);
            let at = LABELS_PX.cast_signed();
            let heading = TextStyle::from((FONT, TEXT_PX + 3)).color(&INK);
            area.draw(&Text::new(title.clone(), (at, 10), heading))?;
            legend(area, at, LEGEND_PX, names)?;
            let (left, bottom) = metres(corner);
            let (_, body) = area.split_vertically(HEAD_PX);
            let (body, _) = body.split_horizontally(width);
            let mut chart = ChartBuilder::on(&body)
                .margin_right(MARGIN_PX)
                .margin_bottom(MARGIN_PX / 2)
                .x_label_area_size(LABELS_PX)
                .y_label_area_size(LABELS_PX)
                .build_cartesian_2d(left..left + width_m, bottom..bottom + height_m)?;
            chart.plotting_area().fill(&UNKNOWN)?;
            let known = |&(column, row): &(usize, usize)| grid.log_odds(column, row) != 0.0;
            chart.draw_series(grid.cells().filter(known).map(|(column, row)| {
                let (x, y) = metres(grid.middle(column, row));
                let half = cell_m / 2.0;
                let corners = [(x - half, y - half), (x + half, y + half)];
                Rectangle::new(corners, shade(grid.probability(column, row)).filled())
            }))?;
            chart
                .configure_mesh()
                .x_labels(labels(width_m))
                .y_labels(labels(height_m))
                .bold_line_style(INK.mix(0.15))
                .light_line_style(TRANSPARENT)
                .label_style(text.clone())
                .axis_style(INK)
                .x_desc("x (m)")
                .y_desc("y (m)")
                .draw()?;
            let line = |segment: &Segment, style: ShapeStyle| {
                PathElement::new([metres(segment.from), metres(segment.to)], style)
            };
            let walls = self.walls.iter();
            chart.draw_series(walls.map(|wall| line(wall, WALL.stroke_width(2))))?;
            for (poses, colour, width) in self.paths {
                let steps = thinned(poses);
                let steps = steps.windows(2).map(|ends| Segment::new(ends[0], ends[1]));
                chart.draw_series(steps.map(|step| line(&step, colour.stroke_width(*width))))?;
            }
            if let Some(start) = self.paths.iter().find_map(|path| path.0.first()) {
                let nose = Segment::new(start.position(), start.point_at(150.0, 0.0));
                let arrow = line(&nose, START.stroke_width(3));
                chart.draw_series([arrow])?;
                let at = metres(start.position());
                chart.draw_series([Circle::new(at, 6, START.filled())])?;
            }
            let bar_m = scale_bar(width_m);
            let (x, y) = (left + width_m * 0.03, bottom + height_m * 0.03);
            let bar = PathElement::new([(x, y), (x + bar_m, y)], INK.stroke_width(4));
            chart.draw_series([bar])?;
            let above = (x, y + 1.5 * cell_m.max(height_m / 60.0));
            chart.draw_series([Text::new(format!("{bar_m} m"), above, text)])?;
            Ok(())
        })
    }
}

/// One label a metre, in larger maps fewer.
#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)] // at most 20
fn labels(metres: f64) -> usize {
    metres.clamp(2.0, 20.0) as usize
}

/// A round length of about a fifth of the width, metres.
fn scale_bar(width_m: f64) -> f64 {
    let lengths = [50.0, 20.0, 10.0, 5.0, 2.0, 1.0, 0.5, 0.2];
    let fits = |length: &f64| *length <= width_m / 4.0;
    lengths.into_iter().find(fits).unwrap_or(0.1)
}

/// The path in steps of at least 10 mm: shorter ones only blur.
fn thinned(poses: &[Pose2]) -> Vec<Point> {
    let mut points: Vec<Point> = poses.iter().map(Pose2::position).collect();
    points.dedup_by(|point, last| point.distance_mm(*last) < 10.0);
    points
}

/// From white (free) over grey (unknown) to dark (occupied).
fn shade(probability: f32) -> RGBColor {
    let (from, to, share) = if probability < 0.5 {
        (FREE, UNKNOWN, probability * 2.0)
    } else {
        (UNKNOWN, OCCUPIED, probability * 2.0 - 1.0)
    };
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)] // between two bytes
    let mix = |a: u8, b: u8| (f32::from(a) + share * (f32::from(b) - f32::from(a))).round() as u8;
    RGBColor(mix(from.0, to.0), mix(from.1, to.1), mix(from.2, to.2))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::png_canvas::decode;

    fn has(pixels: &[u8], RGBColor(r, g, b): RGBColor) -> bool {
        pixels.chunks(3).any(|pixel| pixel == [r, g, b])
    }

    #[test]
    fn plots_show_every_layer_given() {
        let (low, high) = (Point::new(0.0, -200.0), Point::new(800.0, 200.0));
        let grid = Grid::from_fn(25.0, low, high, |p| if p.y_mm > 0.0 { -4.0 } else { 0.0 });
        let (width, height, pixels) = decode(&map(&grid).unwrap());
        assert!(width >= 800 && height > 100);
        assert!(has(&pixels, UNKNOWN) && has(&pixels, INK) && !has(&pixels, WALL));

        let path = [(0.0, 0.0), (400.0, 0.0), (400.0, 300.0)].map(|(x, y)| Pose2::new(x, y, 0.0));
        let wall = Segment::new(Point::new(9000.0, -400.0), Point::new(9000.0, 400.0));
        let (width, _, pixels) = decode(&trajectory(&grid, &path, &path, &[wall]).unwrap());
        assert!(width > 1800, "as far as the walls: {width}");
        let picture = &pixels[3 * (width * HEAD_PX) as usize..];
        assert!([WALL, ESTIMATE, START].iter().all(|&c| has(picture, c)));
    }

    #[test]
    fn legend_names_what_is_given() {
        let (grid, path) = (Grid::new(25.0), [Pose2::default(); 2]);
        let wall = [Segment::new(Point::new(0.0, 0.0), Point::new(900.0, 0.0))];
        // A real run has no truth.
        for [estimate, truth, walls] in [[1, 0, 0], [0, 1, 0], [0, 0, 1], [0, 0, 0]] {
            let plot = trajectory(&grid, &path[..estimate], &path[..truth], &wall[..walls]);
            let (width, _, pixels) = decode(&plot.unwrap());
            let legend = &pixels[..3 * (width * HEAD_PX) as usize];
            let found = [ESTIMATE, TRUTH, WALL, START].map(|colour| has(legend, colour));
            let given = [estimate, truth, walls, estimate + truth].map(|count| count > 0);
            assert_eq!(found, given);
        }
    }

    #[test]
    fn largest_x_is_right_and_largest_y_on_top() {
        let (low, high) = (Point::new(0.0, 0.0), Point::new(799.0, 799.0));
        let corner = |p: Point| {
            if p.x_mm > 400.0 && p.y_mm > 400.0 {
                4.0
            } else {
                -4.0
            }
        };
        let grid = Grid::from_fn(25.0, low, high, corner);
        let (width, _, pixels) = decode(&map(&grid).unwrap());
        let is_dark = |(x, y)| pixels[3 * (y * width + x) as usize] < 100;
        // 32 cells of 5 pixels, 4 cells of margin.
        let [left, right] = [40, 120].map(|x| LABELS_PX + 20 + x);
        let [top, bottom] = [40, 120].map(|y| HEAD_PX + 20 + y);
        let corners = [(left, top), (right, top), (left, bottom), (right, bottom)];
        assert_eq!(corners.map(is_dark), [false, true, false, false]);
    }

    #[test]
    fn large_map_is_scaled_and_endless_one_refused() {
        let far = |mm: f64| [Pose2::default(), Pose2::new(mm, mm / 50.0, 0.0)];
        let grid = Grid::new(25.0);
        let (width, height, _) = decode(&trajectory(&grid, &far(90_000.0), &[], &[]).unwrap());
        assert!(width < 4200 && height < 1000, "{width} × {height}");
        let refused = trajectory(&grid, &far(4e6), &[], &[]).unwrap_err();
        let text = refused.to_string();
        assert!(text.contains("at most 4000 a side"), "{text}");
        let bars = [1.0, 10.0, 100.0].map(|width_m| scale_bar(width_m).to_string());
        assert_eq!(bars, ["0.2", "2", "20"]);
    }

    #[test]
    fn empty_map_is_drawn() {
        let (width, height, _) = decode(&map(&Grid::new(25.0)).unwrap());
        assert!(width > 100 && height > 100);
    }
}
