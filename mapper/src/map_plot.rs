//! The map drawn: by itself, and with the way driven.

use crate::canvas::{Canvas, Colour};
use crate::{Cell, Grid, Pose, Segment};

const OCCUPIED: Colour = [28, 32, 40];
const FREE: Colour = [252, 252, 250];
const UNKNOWN: Colour = [205, 208, 212];
const PAPER: Colour = [236, 238, 240];
const INK: Colour = [40, 44, 52];
const WALL: Colour = [214, 96, 40];
const BELIEVED: Colour = [20, 110, 220];
const TRUE: Colour = [30, 160, 70];
const START: Colour = [190, 30, 90];

/// Pixels per cell.
const ZOOM: usize = 5;
/// Paper around the map, and its strip for the legend, pixels.
const BORDER: usize = 24;
const STRIP: usize = 64;

/// A picture could not be encoded; the text is the encoder's.
#[derive(Debug)]
pub struct PictureError(pub(crate) png::EncodingError);

impl std::fmt::Display for PictureError {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "the map's picture could not be encoded: {}", self.0)
    }
}

impl std::error::Error for PictureError {
    fn source(&self) -> Option<&(dyn std::error::Error + 'static)> {
        Some(&self.0)
    }
}

/// The map as a PNG file: dark = occupied, white = free, grey between, with a scale and a legend.
///
/// # Errors
/// If the encoder refuses (a picture of more pixels than PNG allows).
pub fn map(grid: &Grid) -> Result<Vec<u8>, PictureError> {
    let sheet = Sheet::new(grid, &[]);
    let legend = [("OCCUPIED", OCCUPIED), ("FREE", FREE), ("UNKNOWN", UNKNOWN)];
    sheet.finish(&legend)
}

/// The map, paler, under the believed path, the true path and the true walls (all in the grid's
/// frame), as a PNG file. What is not known is given empty.
///
/// # Errors
/// If the encoder refuses (a picture of more pixels than PNG allows).
pub fn trajectory(
    grid: &Grid,
    believed: &[Pose],
    truth: &[Pose],
    walls: &[Segment],
) -> Result<Vec<u8>, PictureError> {
    let mut corners: Vec<(f64, f64)> = believed
        .iter()
        .chain(truth)
        .map(|pose| (pose.x_mm, pose.y_mm))
        .collect();
    corners.extend(
        walls
            .iter()
            .flat_map(|wall| [(wall.x1, wall.y1), (wall.x2, wall.y2)]),
    );
    let mut sheet = Sheet::new(grid, &corners);
    for wall in walls {
        sheet.line((wall.x1, wall.y1), (wall.x2, wall.y2), 2.0, WALL);
    }
    sheet.path(truth, 5.0, TRUE);
    sheet.path(believed, 2.0, BELIEVED);
    if let Some(start) = believed.first().or(truth.first()) {
        let nose = (
            start.x_mm + 150.0 * start.heading_rad.cos(),
            start.y_mm + 150.0 * start.heading_rad.sin(),
        );
        let at = (start.x_mm, start.y_mm);
        sheet.line(at, at, 12.0, START);
        sheet.line(at, nose, 3.0, START);
    }
    let legend = [
        ("BELIEVED", BELIEVED),
        ("TRUE PATH", TRUE),
        ("TRUE WALLS", WALL),
        ("START", START),
        ("MAP", OCCUPIED),
    ];
    sheet.finish(&legend)
}

/// A canvas with the map on it, and the way from millimetres to pixels.
struct Sheet {
    canvas: Canvas,
    cell_mm: f64,
    /// The map's left edge and top edge, mm.
    left: f64,
    top: f64,
    height: usize,
}

impl Sheet {
    #[allow(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        clippy::cast_precision_loss
    )] // metres of room
    fn new(grid: &Grid, corners: &[(f64, f64)]) -> Self {
        let cell = grid.cell_mm();
        let known = grid
            .cells()
            .filter(|&(column, row)| grid.cell(column, row) != Cell::Unknown)
            .map(|(column, row)| grid.middle_mm(column, row));
        let (mut low, mut high) = ((f64::MAX, f64::MAX), (f64::MIN, f64::MIN));
        for (x, y) in known.chain(corners.iter().copied()) {
            low = (low.0.min(x), low.1.min(y));
            high = (high.0.max(x), high.1.max(y));
        }
        if low.0 > high.0 {
            (low, high) = ((-500.0, -500.0), (500.0, 500.0));
        }
        let down = |mm: f64| (mm / cell).floor() * cell - 4.0 * cell;
        let (left, bottom) = (down(low.0), down(low.1));
        let columns = ((high.0 - left) / cell) as usize + 5;
        let rows = ((high.1 - bottom) / cell) as usize + 5;
        let top = bottom + f64::from(u32::try_from(rows).unwrap_or(u32::MAX)) * cell;
        let height = rows * ZOOM;
        let canvas = Canvas::new(
            (columns * ZOOM + 2 * BORDER).max(960),
            height + 2 * BORDER + STRIP,
            PAPER,
        );
        let mut sheet = Self {
            canvas,
            cell_mm: cell,
            left,
            top,
            height,
        };
        sheet
            .canvas
            .fill(BORDER, BORDER, columns * ZOOM, height, UNKNOWN);
        for (column, row) in grid.cells() {
            if grid.log_odds(column, row) == 0.0 {
                continue;
            }
            let (x, y) = sheet.pixel(grid.middle_mm(column, row));
            let half = ZOOM as f64 / 2.0;
            if x < BORDER as f64 || y < BORDER as f64 {
                continue;
            }
            let colour = shade(grid.probability(column, row));
            let (x, y) = ((x - half).round() as usize, (y - half).round() as usize);
            if x + ZOOM <= BORDER + columns * ZOOM && y + ZOOM <= BORDER + height {
                sheet.canvas.fill(x, y, ZOOM, ZOOM, colour);
            }
        }
        sheet
    }

    #[allow(clippy::cast_precision_loss)] // pixels
    fn pixel(&self, (x, y): (f64, f64)) -> (f64, f64) {
        let zoom = ZOOM as f64 / self.cell_mm;
        (
            BORDER as f64 + (x - self.left) * zoom,
            BORDER as f64 + (self.top - y) * zoom,
        )
    }

    fn line(&mut self, from: (f64, f64), to: (f64, f64), width: f64, colour: Colour) {
        self.canvas
            .line(self.pixel(from), self.pixel(to), width, colour);
    }

    fn path(&mut self, poses: &[Pose], width: f64, colour: Colour) {
        // Pieces of at least 5 mm: shorter ones only blur.
        let mut from: Option<&Pose> = None;
        for (index, pose) in poses.iter().enumerate() {
            let Some(last) = from else {
                from = Some(pose);
                continue;
            };
            let way = (pose.x_mm - last.x_mm).hypot(pose.y_mm - last.y_mm);
            if way >= 5.0 || index + 1 == poses.len() {
                self.line(
                    (last.x_mm, last.y_mm),
                    (pose.x_mm, pose.y_mm),
                    width,
                    colour,
                );
                from = Some(pose);
            }
        }
    }

    /// Adds scale and legend, and encodes.
    #[allow(
        clippy::cast_precision_loss,
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss
    )]
    fn finish(mut self, legend: &[(&str, Colour)]) -> Result<Vec<u8>, PictureError> {
        let y = self.height + BORDER + STRIP / 2;
        let metre = (1000.0 / self.cell_mm * ZOOM as f64) as usize;
        self.canvas.fill(BORDER, y, metre, 4, INK);
        self.canvas.fill(BORDER, y - 6, 3, 16, INK);
        self.canvas.fill(BORDER + metre, y - 6, 3, 16, INK);
        self.canvas
            .text(BORDER + metre / 2 - 16, y + 12, 3, "1 M", INK);
        let mut x = BORDER + metre + 32;
        for (name, colour) in legend {
            self.canvas.fill(x, y - 8, 20, 20, INK);
            self.canvas.fill(x + 1, y - 7, 18, 18, *colour);
            x += 28 + self.canvas.text(x + 28, y - 5, 3, name, INK) + 12;
        }
        self.canvas.png().map_err(PictureError)
    }
}

/// From white (surely free) over grey to dark (surely occupied).
#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)] // between two bytes
fn shade(probability: f32) -> Colour {
    let (from, to, part) = if probability < 0.5 {
        (FREE, UNKNOWN, probability * 2.0)
    } else {
        (UNKNOWN, OCCUPIED, probability * 2.0 - 1.0)
    };
    std::array::from_fn(|i| {
        (f32::from(from[i]) + part * (f32::from(to[i]) - f32::from(from[i]))).round() as u8
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Cone;

    fn decode(file: &[u8]) -> (u32, u32, Vec<u8>) {
        let mut reader = png::Decoder::new(std::io::Cursor::new(file))
            .read_info()
            .unwrap();
        let mut pixels = vec![0; reader.output_buffer_size().unwrap()];
        let info = reader.next_frame(&mut pixels).unwrap();
        (info.width, info.height, pixels)
    }

    fn has(pixels: &[u8], colour: Colour) -> bool {
        pixels.chunks(3).any(|pixel| pixel == colour)
    }

    #[test]
    fn pictures_decode_and_show_what_they_were_given() {
        let mut grid = Grid::new(25.0);
        for _ in 0..20 {
            Cone::default().echo(&mut grid, &Pose::default(), 800.0);
        }
        let (width, height, pixels) = decode(&map(&grid).unwrap());
        assert!(width >= 960 && height > 100);
        assert!(has(&pixels, UNKNOWN) && has(&pixels, INK) && !has(&pixels, WALL));

        let way = [
            Pose::default(),
            Pose::new(400.0, 0.0, 0.0),
            Pose::new(400.0, 300.0, 1.0),
        ];
        let wall = [Segment::new(900.0, -400.0, 900.0, 400.0)];
        let (_, _, pixels) = decode(&trajectory(&grid, &way, &way, &wall).unwrap());
        assert!(has(&pixels, WALL) && has(&pixels, BELIEVED) && has(&pixels, START));
    }

    #[test]
    fn an_empty_map_is_still_a_picture() {
        let (width, height, _) = decode(&map(&Grid::new(25.0)).unwrap());
        assert!(width > 100 && height > 100);
    }
}
